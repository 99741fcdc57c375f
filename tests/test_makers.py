"""Files as their makers describe them, written by hand: statements above the numbers, takes, gaps, slower channels.

The base moves at 20 Hz and the malleolus 1.3 times as much, 25 degrees behind. Each file is read rightly, or refused
with its cause.
"""

import json
from pathlib import Path

import in_process
import numpy as np
import pytest
from test_account import LATE, TIME, G, base, malleolus, mapped, read, right

from fasbody.exceptions import InputFileError
from fasbody.recording import text as texts
from fasbody.recording.checks import checked, reasons
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study

B, M = base(TIME), malleolus(TIME)
NONE = [""] * TIME.size
VOLTS = mapped("CH1", "CH2", 'unit = "V"\nsensitivity = "100 mV/g"')
IN_G = mapped("Base", "Malleolus", 'unit = "g"')
QUALISYS = "NO_OF_SAMPLES\t1500\nFREQUENCY\t1000\nCHANNEL_NAMES\tBase\tMalleolus\nCHANNEL_GAIN\t{}\t1\n"
LABCHART = "Interval=\t0.001 s\nTimeFormat=\tStartOfBlock\nChannelTitle=\tBase\tMalleolus\nRange=\t5.000 g\t5.000 g\n"


def file(path: Path, head: str, columns: list, mark: str = ",", tail: str = "") -> Path:
    body = (mark.join(x if isinstance(x, str) else f"{x:.15g}" for x in row) for row in zip(*columns, strict=True))
    path.write_text(head + "\n".join(body) + "\n" + tail, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("head", "columns", "mark", "toml"),
    [
        (QUALISYS.format(1), [B / G, M / G], "\t", IN_G),
        (LABCHART, [TIME, B / G, M / G], "\t", IN_G),
        ("1 msec/sample\n2 channels\nmin\tCH1\tCH2\n\t1500\t1500\n", [TIME / 60, B / G, M / G], "\t",
         '[channels.time]\ncolumn = "min"\nunit = "min"\n' + mapped("CH1", "CH2", 'unit = "g"')),
        ("X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-1.5e+00,1.0e-03\n",
         [np.arange(1500), 0.1 * B / G, 0.1 * M / G, NONE], ",", VOLTS),
        ("Sample Interval,Analog:0.001\nVertical Scale,CH1:0.1 CH2:0.1\nSecond,Volt,Volt\n",
         [TIME, 0.1 * B / G, 0.1 * M / G], ",", '[channels.time]\ncolumn = 1\nunit = "s"\n'
         + mapped(2, 3, 'unit = "V"\nsensitivity = "100 mV/g"')),
        ('"sep=\t"\nS1_Timestamp_CAL\tS1_Accel_Z_CAL\tS2_Accel_Z_CAL\nms\tm/(s^2)\tm/(s^2)\n',
         [1772400000000 + np.arange(1500), B, M], "\t", '[channels.time]\ncolumn = "S1_Timestamp_CAL"\n'
         + mapped("S1_Accel_Z_CAL", "S2_Accel_Z_CAL", "")),
        ("---- Data File Created By ActiGraph date format M/d/yyyy at 1000 Hz  Filter Normal ----\nSerial Number: T1\n"
         "Base (g),Malleolus (g)\n", [B / G, M / G], ",", ""),
        ("Sampling frequency [kHz],1\nOperator,A. B.\n\nBase (g),Malleolus (g)\n", [B / G, M / G], ",", ""),
        ("Time,Table,,,Ankle,,\ns,x [g],y [g],z [g],x [g],y [g],z [g]\n",
         [TIME, M, B, B / G, B, B, M / G], ",", mapped("Table z", "Ankle z", "")),
        ("Time (ms),Base (g),Time (s),Malleolus (g)\n", [1e3 * TIME, B / G, TIME + LATE, malleolus(TIME + LATE) / G],
         ",", ""),
        ("Time,Base [g],Malleolus [g]\n", [[f"{59 + t // 60:02.0f}:{t % 60:06.3f}" for t in TIME], B / G, M / G],
         ",", ""),
        ("time,seconds_elapsed,z,y\n", [1.7e18 + 1e9 * TIME, TIME, B, M], ",", mapped("z", "y", 'unit = "m/s^2"')),
        ("timestamp_ms,Base (g),Malleolus (g)\n", [1.7e12 + 1e3 * TIME, B / G, M / G], ",", ""),
        ("Time,Base,Malleolus\ns,g,g\nai0,ai1,ai2\n", [TIME, B / G, M / G], ",", ""),
        ("min_base,base_g,malleolus_g,Zeit_s\n", [M, B / G, M / G, TIME], ",", ""),
        ("Date/Time,Base [g],Malleolus [g]\n", [46000 + TIME / 86400 * 1000, B / G, M / G], ",",
         '[channels.time]\ncolumn = "Date/Time"\nunit = "d"\n[channels.base]\nunit = "g"\n'),
    ],
    ids=["qualisys", "labchart", "biopac", "rigol", "siglent", "shimmer", "actigraph", "statement", "merged", "clocks",
         "minutes", "sensor logger", "stamps in ms", "names of inputs", "a minimum", "days"],
)  # fmt: skip
def test_a_layout_of_a_maker(tmp_path: Path, head: str, columns: list, mark: str, toml: str) -> None:
    if "Date/Time" in head:  # a thousand times slower, so that the digits of a day suffice
        with pytest.raises(InputFileError, match="no column 'time_s'"):
            read(file(tmp_path / "a.csv", head, columns, mark))
        assert read(tmp_path / "a.csv", toml).time_s[-1] == pytest.approx(1000 * TIME[-1] + 46000 * 86400, rel=1e-9)
        return
    recording = read(file(tmp_path / "a.csv", head, columns, mark), toml)
    right(recording)
    assert len(recording.used) == 3  # the clock is among them


def test_lines_beside_the_headings_are_named_and_contradictions_told(tmp_path: Path) -> None:
    head = "Sampling rate: 500 Hz\nOperator: A. B.\nTime (s),Base (g),Malleolus (g)\n"
    recording = read(file(tmp_path / "a.csv", head, [TIME, B / G, M / G]))
    right(recording)
    assert recording.unused == ("1 line beside the headings (Operator: A. B.)",)
    assert "states 500 Hz, and its time runs at 1000 Hz, which counts" in recording.warnings[0]
    file(tmp_path / "b.tsv", QUALISYS.format(10), [B / G, M / G], "\t")
    with pytest.raises(InputFileError, match=r"CHANNEL_GAIN = 10, 1 for its channels.*sensitivity .*\(1 if they do"):
        read(tmp_path / "b.tsv", IN_G)
    file(tmp_path / "b.tsv", QUALISYS.format(1), [B / G, M / G], "\t")
    overruled = read(tmp_path / "b.tsv", "[study]\nsampling_rate_hz = 500\n" + IN_G)
    assert (
        "its rate is 500 Hz as study.toml says, though the file says 1000 Hz"
        in overruled.warnings[0]
    )
    file(tmp_path / "c.csv", "Frequency: 20 Hz\nVibration at 40 Hz\nbase_g,malleolus_g\n", [B / G, M / G])
    with pytest.raises(InputFileError, match="no column 'time_s'"):  # of the shaker, not of the clock
        read(tmp_path / "c.csv")


VICON = (
    "Devices\n1000\n,,Acc - Base,,,Acc - Malleolus,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,," + ",".join(["m/s^2"] * 6) + "\n"
)
MARKERS = "\nTrajectories\n100\n,,S1:ANK,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n" + "1,0,9.5,5.1,7.2\n" * 150


def test_a_section_of_other_columns_below_is_named(tmp_path: Path) -> None:
    frames = [str(1 + i // 10) for i in range(1500)], [str(i % 10) for i in range(1500)]
    columns = [*frames, M, M, B, B, B, M]
    toml = "[study]\nsampling_rate_hz = 1000\n" + mapped("Acc - Base Z", "Acc - Malleolus Z", "")
    recording = read(file(tmp_path / "a.csv", VICON, columns, tail=MARKERS), toml)
    right(recording)
    assert any("line 1507 on (Trajectories)" in one for one in recording.unused)
    file(tmp_path / "b.csv", VICON, columns, tail="Pause\n" + ",".join("1" * 8) + "\n")
    with pytest.raises(InputFileError, match=r"line 1506: \w+ is '', not a number"):  # words between samples are none
        read(tmp_path / "b.csv", toml)


def test_takes_of_a_text(tmp_path: Path) -> None:
    head, late = "Time (s),Base (g),Malleolus (g)\n", 1.5 * M
    rows = "".join(f"{t:.6g},{b:.7g},{m:.7g}\n" for t, b, m in zip(TIME, B / G, late / G, strict=True))
    file(tmp_path / "a.csv", head, [TIME, B / G, M / G], tail=head + rows)
    file(tmp_path / "b.csv", head, [TIME, B / G, M / G], tail=rows)
    for name, where in (("a", "begin in lines 1, 1502"), ("b", "begins anew at sample 1500")):
        with pytest.raises(InputFileError, match=rf"holds 2 takes \(.*{where}\); say which .*--take 1 to 2"):
            read(tmp_path / f"{name}.csv")
        right(read(tmp_path / f"{name}.csv", "[study]\ntake = 1\n"))
        assert read(tmp_path / f"{name}.csv", "[study]\ntake = 2\n").malleolus_m_s2 == pytest.approx(late, rel=1e-6)
        with pytest.raises(InputFileError, match="holds 2 takes, and take 3 is asked for"):
            read(tmp_path / f"{name}.csv", "[study]\ntake = 3\n")
    done = in_process.command(
        "fasbody.recording", "convert", str(tmp_path / "a.csv"), str(tmp_path / "two.csv"), "--take", "2"
    )
    assert done.returncode == 0 and read(tmp_path / "two.csv").malleolus_m_s2 == pytest.approx(late, abs=1e-5)
    with pytest.raises(InputFileError, match=r"take = 0; valid: the number of a take"):
        read(tmp_path / "a.csv", "[study]\ntake = 0\n")


def test_takes_of_sheets(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, size in (("first", 1.0), ("second", 2.0)):
        sheet = book.create_sheet(name)
        table = np.column_stack([TIME, B, size * M]).tolist()
        for row in [("time_s", "base_m_s2", "malleolus_m_s2"), *table]:
            sheet.append(row)
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(InputFileError, match=r"holds 2 takes \('first', 'second'\)"):
        read(tmp_path / "a.xlsx")
    right(read(tmp_path / "a.xlsx", "[study]\ntake = 1\n"))
    second = read(tmp_path / "a.xlsx", "[study]\ntake = 2\n")
    assert second.malleolus_m_s2 == pytest.approx(2 * M) and "the other takes (1)" in second.unused


def test_empty_cells_are_a_slower_channel_a_shorter_one_or_refused(tmp_path: Path) -> None:
    head = "time_s,base_g,malleolus_g\n"
    cells = [f"{m:.9g}" for m in M / G]
    slow = [cell if i % 4 == 0 else "" for i, cell in enumerate(cells)]
    recording = read(file(tmp_path / "a.csv", head, [TIME, B / G, slow]))
    right(recording)
    assert "malleolus at 250 Hz), resampled to the highest by a spline" in recording.warnings[0]
    for broken, line in (([*cells[:700], "", *cells[701:]], 702), ([*cells[:-1], ""], 1501)):
        file(tmp_path / "b.csv", head, [TIME, B / G, broken])
        with pytest.raises(InputFileError, match=rf"line {line}: malleolus_m_s2 is '', not a number"):
            read(tmp_path / "b.csv")
    right(read(file(tmp_path / "c.csv", head, [TIME, B / G, M / G], tail=",,\n,,\n")))  # as Excel leaves them
    own = [f"{t:.9g}" for t in (TIME + LATE)[:400]] + NONE[400:]
    foot = [f"{m:.9g}" for m in malleolus((TIME + LATE)[:400]) / G] + NONE[400:]
    table = [f"{t:.9g}" for t in TIME[:400]] + NONE[400:], [f"{b:.9g}" for b in B[:400] / G] + NONE[400:]
    emg = np.arange(1500) / 3750
    head = "X [s],Table ACC [g],X [s],Table EMG [V],X [s],Ankle ACC [g]\n"
    delsys = file(tmp_path / "d.csv", head, [*table, emg, 0 * emg, own, foot])
    right(read(delsys, mapped("Table ACC", "Ankle ACC", "")))


@pytest.mark.parametrize("fast", ["base", "malleolus"])
def test_unlike_rates_are_brought_to_the_highest(tmp_path: Path, fast: str) -> None:
    nptdms = pytest.importorskip("nptdms")
    quick, slow = np.arange(3000) / 2000, np.arange(105) / 70  # 3.5 samples a period
    at = {"base": quick, "malleolus": slow} if fast == "base" else {"base": slow, "malleolus": quick}
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([
            nptdms.ChannelObject("g", name, move(at[name]), properties={
                "wf_increment": float(at[name][1]), "unit_string": "m/s^2"})
            for name, move in (("base", base), ("malleolus", malleolus))
        ])  # fmt: skip
    recording = Recording.read(tmp_path / "a.tdms")
    assert recording.rate_hz == pytest.approx(2000)
    right(recording)


def test_a_column_that_rises_as_a_time_is_named(tmp_path: Path) -> None:
    columns = [TIME, B, TIME + LATE, malleolus(TIME + LATE)]
    recording = read(file(tmp_path / "a.csv", "time_s,base_m_s2,col3,malleolus_m_s2\n", columns))
    assert "'col3' is another time, and nothing says of which channel" in recording.warnings[0]
    columns[2] = np.arange(1500)  # a counter of samples is none, but for a time in ms that starts alike
    assert not read(file(tmp_path / "b.csv", "time_s,base_m_s2,n,malleolus_m_s2\n", columns)).warnings


def test_an_excitation_that_only_a_wrong_time_unit_makes(tmp_path: Path) -> None:
    for unit, odd in (("s", False), ("ms", True)):
        recording = read(file(tmp_path / "a.csv", f"Time [{unit}],Base [g],Malleolus [g]\n", [TIME, B / G, M / G]))
        assert any("check the unit of its time" in text for text in checked(recording).warnings) == odd


def test_pieces_of_a_text_are_as_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    head = "Operator: Müller\ntime_s;base_m_s2;malleolus_m_s2\n"
    whole = file(tmp_path / "a.csv", head, [TIME, B, M], ";", "End of data\n")
    expected = read(whole)
    for encoding, mark in (("utf-8", "\n"), ("utf-16", "\r\n"), ("cp1252", "\r")):
        name = tmp_path / f"{encoding}.csv"
        name.write_bytes(whole.read_text("utf-8").replace("\n", mark).encode(encoding))
        monkeypatch.setattr(texts, "PIECE", 5000)
        found = read(name)
        assert np.array_equal(found.malleolus_m_s2, expected.malleolus_m_s2)
        assert found.unused == ("1 line beside the headings (Operator: Müller)", "a footer (End of data)")
    broken = tmp_path / "b.csv"
    broken.write_text(whole.read_text("utf-8").replace("\n1.2;", "\nx;"), encoding="utf-8")
    with pytest.raises(InputFileError, match="line 1203: time_s is 'x', not a number"):
        read(broken)


def test_reasons_are_grouped_and_a_page_shows_the_traces(tmp_path: Path) -> None:
    for name, head in (("a", "Base,Malleolus"), ("b", "Base,Malleolus"), ("c", "time_s,base_g")):
        file(tmp_path / f"{name}.csv", f"{head}\n", [B, M])
    file(tmp_path / "<d>.csv", "time_s,base_g,malleolus_g\n", [TIME, B / G, M / G])
    files = [str(path) for path in sorted(tmp_path.glob("*.csv"))]
    page = tmp_path / "check.html"
    done = in_process.command("fasbody.recording", "check", *files, "--report", str(page))
    assert done.returncode == 2 and "3 of 4 recordings cannot be used" in done.stderr
    assert "2 recordings (a.csv, b.csv): line 1: has no column 'time_s'" in done.stderr
    text = page.read_text()
    assert text.count("<polyline") == 2 and "T = 1.3, phase -25 degrees" in text
    assert "&lt;d&gt;.csv" in text and "<d>" not in text
    assert "time: &#39;time_s&#39; in s" in text
    refused = in_process.command("fasbody.recording", "check", files[0], "--report", str(tmp_path / "a.png"))
    assert refused.returncode == 2 and "a report is written as .html" in refused.stderr.replace("\n", " ")
    errors = [InputFileError(f"{n}.csv", f"x is 'a{n}', not a number", line=n + 1) for n in range(7)]
    rows = [{"file": error.file, "problem": error.sentence} for error in errors]
    assert reasons(rows) == ["7 recordings (0.csv, 1.csv, 2.csv, 3.csv, 4.csv ...): line 1: x is 'a0', not a number."]


def test_the_page_of_a_study(tmp_path: Path) -> None:
    study = tmp_path / "study"
    study.mkdir()
    file(study / "a.csv", "time_s,base_g,malleolus_g\n", [TIME, B / G, M / G])
    (study / "study.toml").write_text("")
    (study / "subjects.csv").write_text("subject,mass_kg\n1,70\n")
    (study / "recordings.csv").write_text("file,subject,added_mass_kg,frequency_hz\na.csv,1,0,20\n")
    words = ("check", str(study), "--report", str(tmp_path / "s.html"), "--json", "--jobs", "1")
    done = in_process.command("fasbody.recording", *words)
    (row,) = json.loads(done.stdout)["recordings"]
    assert "excerpt" not in row and (tmp_path / "s.html").read_text().count("<polyline") == 2
    assert not Study.read(study).check().problems
