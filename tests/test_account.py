"""Every column and statement of a file is used, or named: clocks, merged headings, counts, marks between thousands.

The base moves at 20 Hz and the malleolus 1.3 times as much, 25 degrees behind; each file says so in a way that a reader
which overlooks one of its columns would read wrongly.
"""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from fasbody.exceptions import FasError, InputFileError, RecordingError
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from fasbody.recording.trials import parsed
from fasbody.transmissibility.estimate import rows

T, PHASE_DEG, HZ, RATE = 1.3, -25.0, 20.0, 1000
TIME = np.arange(1500) / RATE
LATE = 3.4e-3
G = 9.80665


def base(time_s: np.ndarray) -> np.ndarray:
    return 8.95 * np.sin(2 * np.pi * HZ * time_s)


def malleolus(time_s: np.ndarray) -> np.ndarray:
    return T * 8.95 * np.sin(2 * np.pi * HZ * time_s + np.radians(PHASE_DEG))


def text(file: Path, head: str, columns: list[np.ndarray], separator: str = ",") -> Path:
    file.write_text(head + "".join(separator.join(f"{x:.7g}" for x in row) + "\n" for row in np.column_stack(columns)))
    return file


def read(file: Path, toml: str = "") -> Recording:
    return Recording.read(file, layout=parsed(file.with_name("study.toml"), tomllib.loads(toml))[1] if toml else None)


def right(recording: Recording, apart_deg: float = 0.2) -> None:
    (row,) = (r for r in rows(recording) if r.pair == "MB")
    wanted = pytest.approx(T, rel=2e-3), pytest.approx(PHASE_DEG, abs=apart_deg)
    assert (row.transmissibility, row.phase_deg) == wanted


def mapped(one: object, other: object, more: str = 'unit = "m/s^2"') -> str:
    names = (f'"{column}"' if isinstance(column, str) else column for column in (one, other))
    return "".join(f"[channels.{n}]\ncolumn = {c}\n{more}\n" for n, c in zip(("base", "malleolus"), names, strict=True))


TWO_CLOCKS = [TIME, base(TIME) / G, TIME + LATE, malleolus(TIME + LATE) / G]


@pytest.mark.parametrize(
    ("head", "toml"),
    [
        ("Time (s),Base (g),Time 2 (s),Malleolus (g)\n", ""),
        (
            "time,base,time,malleolus\ns,g,s,g\n",
            '[channels.time]\ncolumn = 1\n[channels.malleolus]\nclock = "time 2"\n',
        ),
        ("X [s],Table: ACC.X 1 [g],X.1 [s],Ankle: ACC.X 2 [g]\n", mapped("Table: ACC.X 1", "Ankle: ACC.X 2", "")),
        ("t1 (s),base_g,t2 (s),malleolus_g\n", ""),
    ],
)
def test_a_clock_for_each_sensor_of_a_table(tmp_path: Path, head: str, toml: str) -> None:
    recording = read(text(tmp_path / "a.csv", head, TWO_CLOCKS), toml)
    right(recording)
    assert "times" in next(use for use in recording.used if use.startswith("malleolus"))


def test_a_clock_for_each_sensor_of_a_file_of_matlab(tmp_path: Path) -> None:
    from scipy.io import savemat

    b, m = base(TIME), malleolus(TIME + LATE)
    savemat(tmp_path / "a.mat", {"base_g": b / G, "t_base": TIME, "malleolus_g": m / G, "t_malleolus": TIME + LATE,
                                 "fs": 1000.0})  # fmt: skip
    right(read(tmp_path / "a.mat"))
    sensors = {"base": {"t": TIME, "acc": b}, "ankle": {"t": TIME + LATE, "acc": m}}
    savemat(tmp_path / "b.mat", {"fs": 1000.0, **sensors})
    right(read(tmp_path / "b.mat", mapped("base/acc", "ankle/acc")))
    signals = {
        name: {"x_values": {"start_value": start, "increment": 1e-3}, "y_values": {"values": values}}
        for name, start, values in (("Signal_0", 0.0, b), ("Signal_1", LATE, m))
    }
    savemat(tmp_path / "c.mat", signals)
    right(read(tmp_path / "c.mat", mapped("Signal_0/y_values/values", "Signal_1/y_values/values")))


def test_a_clock_for_each_sensor_of_hdf5(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as out:
        for name, at, values in (("base", TIME, base), ("malleolus", TIME + LATE, malleolus)):
            out[f"{name}/acc"], out[f"{name}/time"] = values(at), at
            out[f"{name}/time"].attrs["units"] = "s"
    right(read(tmp_path / "a.h5", mapped("base/acc", "malleolus/acc")))
    with h5py.File(tmp_path / "b.h5", "w") as out:  # in the order of the alphabet
        out["base"], out["malleolus"] = base(TIME), malleolus(TIME + LATE)
        out["time_base"], out["time_malleolus"] = TIME, TIME + LATE
        out.attrs["fs"] = RATE
    right(read(tmp_path / "b.h5", mapped("base", "malleolus")))


def test_rates_of_a_folder_and_of_what_lies_in_it_must_agree(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as out:
        for name, values in (("base_g", base(TIME)), ("malleolus_g", malleolus(TIME))):
            out[f"run/{name}"] = values / G
            out[f"run/{name}"].attrs["fs"] = RATE
    right(read(tmp_path / "a.h5"))
    with h5py.File(tmp_path / "a.h5", "r+") as out:
        out.attrs["fs"] = 500.0
    with pytest.raises(InputFileError, match=r"states two sampling rates, fs = 500 and run/base_g/fs = 1000"):
        read(tmp_path / "a.h5")


def test_a_sheet_for_each_sensor(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for name, at, values in (("Base", TIME, base), ("Ankle", TIME + LATE, malleolus)):
        sheet = book.create_sheet(name)
        for row in [("Time (s)", "Acc (m/s^2)"), *zip(at.tolist(), values(at).tolist(), strict=True)]:
            sheet.append(row)
    book.save(tmp_path / "a.xlsx")
    right(read(tmp_path / "a.xlsx", mapped("Base/Acc (m/s^2)", "Ankle/Acc (m/s^2)", "")))


LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\t{x}\n***End_of_Header***\t\n\nChannels\t2\n"
    "Time\t10:11:12\t10:11:12.0034\nY_Unit_Label\tg\tg\nX0\t0\t0\nDelta_X\t0.001\t0.001\n***End_of_Header***\t\n{names}\n"
)


def test_the_times_of_labview_count(tmp_path: Path) -> None:
    b, m = base(TIME) / G, malleolus(TIME + LATE) / G
    text(tmp_path / "a.lvm", LVM.format(x="Multi", names="X_Value\tbase\tX_Value\tmalleolus\tComment"),
         [TIME, b, TIME, m], "\t")  # fmt: skip
    right(read(tmp_path / "a.lvm"))
    head = LVM.format(x="No", names="X_Value\tbase\tmalleolus\tComment")
    body = "".join(f"\t{x:.8g}\t{y:.8g}\n" for x, y in zip(b, m, strict=True))
    (tmp_path / "b.lvm").write_text(head + body)
    right(read(tmp_path / "b.lvm"))
    days = "Date\t2026/03/01\t2026/03/02\nTime\t23:59:59.999\t00:00:00.0024"  # over midnight
    (tmp_path / "d.lvm").write_text(head.replace("Time\t10:11:12\t10:11:12.0034", days) + body)
    right(read(tmp_path / "d.lvm"))
    (tmp_path / "c.lvm").write_text(head.replace("X_Columns\tNo", "X_Columns\tOne") + body.replace("\t", "0\t", 1))
    with pytest.raises(InputFileError, match=r"holds something other than numbers|start at different times"):
        read(tmp_path / "c.lvm")


def test_a_time_that_belongs_to_nobody_is_named(tmp_path: Path) -> None:
    b, m = base(TIME), malleolus(TIME)
    head = "base_m_s2,malleolus_m_s2,time_s,time 2 (s)\n"
    other = read(text(tmp_path / "a.csv", head, [b, m, TIME, TIME + LATE]))
    assert "'time 2 (s)' is another time, and nothing says of which channel" in " ".join(other.warnings)
    same = read(text(tmp_path / "b.csv", head, [b, m, TIME, TIME]))
    assert same.warnings == () and "time 2 (s)" in same.unused
    right(same)


def test_clocks_of_other_rates_or_without_common_time_are_refused(tmp_path: Path) -> None:
    head = "Time (s),Base (g),Time 2 (s),Malleolus (g)\n"
    with pytest.raises(InputFileError, match="too short for the start times"):
        read(text(tmp_path / "a.csv", head, [TIME, base(TIME), TIME + 0.5, base(TIME)]))
    with pytest.raises(InputFileError, match=r"different rates \(base at 1000 Hz, malleolus at 980.\d+ Hz\)"):
        read(text(tmp_path / "b.csv", head, [TIME, base(TIME), 1.02 * TIME, base(TIME)]))
    drifting = 1.002 * TIME  # a crystal that runs 0.2 % slow is brought to the base's clock
    right(read(text(tmp_path / "c.csv", head, [TIME, base(TIME), drifting, malleolus(drifting)])))


def test_clocks_of_rounded_stamps_and_columns_that_are_none(tmp_path: Path) -> None:
    """Stamps of a millisecond at 1600 Hz repeat themselves; a temperature is no time, whatever its letter."""
    t = np.arange(2400) / 1600
    head = "Time (s),Base (g),Time 2 (s),Malleolus (g)\n"
    columns = [np.round(t, 3), base(t), np.round(t + LATE, 3), malleolus(t + LATE)]
    right(read(text(tmp_path / "a.csv", head, columns)), 0.5)  # eight phases to a stamp leave up to 0.06 ms
    head = "time_s,base_g,T (C),malleolus_g,Time to go (m)\n"
    recording = read(text(tmp_path / "b.csv", head, [TIME, base(TIME), 20 + TIME, malleolus(TIME), TIME]))
    right(recording)
    assert recording.unused == ("T (C)", "Time to go (m)") and not recording.warnings


@pytest.mark.parametrize(
    "order", [("time_mal_s", "base_g", "time_base_s", "malleolus_g"), ("base_g", "time_s", "time_mal_s", "malleolus_g")]
)
def test_a_clock_that_is_named_by_the_first_letters_of_its_channel(tmp_path: Path, order: tuple[str, ...]) -> None:
    late = TIME + 0.004
    columns = {"time_s": TIME, "time_base_s": TIME, "time_mal_s": late,
               "base_g": base(TIME) / G, "malleolus_g": malleolus(late) / G}  # fmt: skip
    own = "time_s" if "time_s" in order else "time_base_s"
    toml = f'[channels.time]\ncolumn = "{own}"\nunit = "s"\n'
    right(read(text(tmp_path / "a.csv", ",".join(order) + "\n", [columns[name] for name in order]), toml))


def test_headings_that_are_more_than_the_cells_below(tmp_path: Path) -> None:
    toml = "[study]\nsampling_rate_hz = 1000\n" + mapped("base", "malleolus")
    both = [base(TIME), malleolus(TIME)]
    right(read(text(tmp_path / "a.tsv", "CHANNEL_NAMES\tbase\tmalleolus\n", both, "\t"), toml))  # as Qualisys writes
    with pytest.raises(InputFileError, match=r"names 3 columns \(frame, base, malleolus\), and its rows have 2 cells"):
        read(text(tmp_path / "b.tsv", "frame\tbase\tmalleolus\n", both, "\t"), toml)
    right(read(text(tmp_path / "c.csv", "time_s,base_m_s2,malleolus_m_s2,comment\n", [TIME, *both])))
    with pytest.raises(InputFileError, match=r"names 4 columns \(time_s, .*, temp\), and its rows"):
        read(text(tmp_path / "d.csv", "time_s,base_m_s2,malleolus_m_s2,temp\n", [TIME, *both]))


def test_an_axis_in_a_name_is_no_unit(tmp_path: Path) -> None:
    columns = [TIME, base(TIME) / G, malleolus(TIME)]
    right(read(text(tmp_path / "a.csv", "time_s,base_z_g,malleolus_z_m_s2\n", columns)))
    with pytest.raises(InputFileError, match="has two columns for base"):
        read(text(tmp_path / "b.csv", "time_s,base_x_g,base_z_g,malleolus_g\n", [*columns, base(TIME)]))


def test_a_time_that_runs_backwards_is_refused_at_reading(tmp_path: Path) -> None:
    rows = [TIME[::-1], base(TIME), malleolus(TIME)]
    with pytest.raises(InputFileError, match=r"its time runs backwards .*; sort the rows by time"):
        read(text(tmp_path / "a.csv", "time_s,base_m_s2,malleolus_m_s2\n", rows))


AXES = [TIME, 0.1 * base(TIME), base(TIME), 0.3 * base(TIME), 0.2 * base(TIME), malleolus(TIME), 0.4 * base(TIME)]


def test_merged_headings_are_columns_of_their_own(tmp_path: Path) -> None:
    units = "s" + ",m/s^2" * 6 + "\n"
    file = text(tmp_path / "a.csv", "Time,Base,,,Malleolus,,\n" + units, AXES)
    with pytest.raises(
        InputFileError, match=r"two columns for base; .*study\.toml \(\[channels\.base\] column = 2 or "
    ):
        read(file)
    right(read(file, mapped(3, 6, "")))
    right(read(file, mapped("Base 2", "Malleolus 2", "")))
    file = text(tmp_path / "b.csv", "Time,Base,,,Malleolus,,\n,X,Y,Z,X,Y,Z\n" + units, AXES)
    right(read(file, mapped("Base Y", "Malleolus Y", "")))
    file = text(tmp_path / "c.csv", ",Pod 1,,,Pod 2,,\ntime_s,X,Y,Z,X,Y,Z\n" + units, AXES)
    right(read(file, mapped("Pod 1 Y", "Pod 2 Y", "")))
    file = text(tmp_path / "d.csv", "time_s,X,Y,Z,X,Y,Z\n" + units, AXES)
    right(read(file, mapped("Y", "Y 2", "").replace('"Y"', '"Y 1"')))


def test_a_row_of_counts_is_no_sample(tmp_path: Path) -> None:
    head = "run.acq\n1 msec/sample\n2 channels\nsec,base,malleolus\n,1500,1500\n"
    toml = "[study]\nsampling_rate_hz = 1000\n" + mapped("base", "malleolus")
    recording = read(text(tmp_path / "a.csv", head, [TIME, base(TIME), malleolus(TIME)]), toml)
    assert recording.time_s.size == TIME.size
    assert "a row of counts (,1500,1500)" in recording.unused
    right(recording)
    file = text(tmp_path / "b.csv", "time_s,base_g,malleolus_g\n", [TIME, base(TIME), malleolus(TIME)])
    file.write_text(file.read_text().replace("\n0,0,", "\n,7,", 1))  # a sample that lost its time is no count
    with pytest.raises(InputFileError, match="line 2: time_s is ''"):
        read(file)


@pytest.mark.parametrize(("separator", "mark"), [(";", ","), ("\t", ","), (",", ".")])
def test_marks_between_thousands(tmp_path: Path, separator: str, mark: str) -> None:
    scale = 1e3
    head = separator.join(["time_ms", "base_mm_s2", "malleolus_mm_s2"]) + "\n"

    def grouped(x: float) -> str:
        return f"{round(x):,}".replace(",", mark)

    body = [[f"{1e3 * t:.0f}", grouped(scale * b), grouped(scale * m)]
            for t, b, m in zip(TIME[:900], base(TIME), malleolus(TIME), strict=False)]  # fmt: skip
    (tmp_path / "a.txt").write_text(head + "".join(separator.join(row) + "\n" for row in body))
    with pytest.raises(InputFileError, match=r"a mark between thousands would be read as that of decimals"):
        read(tmp_path / "a.txt")
    plain = [[cell.replace(mark, "") for cell in row] for row in body]
    (tmp_path / "b.txt").write_text(head + "".join(separator.join(row) + "\n" for row in plain))
    right(read(tmp_path / "b.txt"))


def test_three_decimals_are_no_thousands(tmp_path: Path) -> None:
    """Cells such as 8,100 beside 0,950 and 9,000 are decimals."""
    body = [
        f"{t:.3f};{b:.3f};{m:.3f}\n".replace(".", ",")
        for t, b, m in zip(TIME, base(TIME), malleolus(TIME), strict=True)
    ]
    (tmp_path / "a.csv").write_text("time_s;base_m_s2;malleolus_m_s2\n" + "".join(body))
    right(read(tmp_path / "a.csv"))


IN_M_S2, IN_G = [TIME, base(TIME), malleolus(TIME)], [TIME, base(TIME) / G, malleolus(TIME) / G]
NAMED = '[study]\ncolumns = ["time_s", "base_m_s2", "malleolus_m_s2"]\n'
BOTH_IN_G = '[channels.base]\nunit = "g"\n[channels.malleolus]\nunit = "g"\n'


@pytest.mark.parametrize(
    ("head", "columns", "toml"),
    [
        ("Channel Title=;A;B\nRange=;10 V;10 V\n", IN_M_S2, NAMED),  # as LabChart writes
        ("some words, and more of them\n", IN_M_S2, NAMED),
        (
            "Zeit [s];Tisch [g];Knöchel [g]\n",
            IN_G,
            mapped("Tisch", "Knöchel", "") + '[channels.time]\ncolumn = "Zeit"\n',
        ),
        ("Zeit [s];base [g];malleolus [g]\n", IN_G, ""),
        ("time_s;Base (100g);Malleolus (100g)\n", IN_G, BOTH_IN_G),
        ("time_s;x;y\n", IN_M_S2, mapped(2, 3)),
        ("Interval=;1 ms;\nChannelTitle=;base;malleolus\n", IN_M_S2, NAMED),
        ("run 7;of 9\nhere;there;elsewhere\ns;g;g\n", IN_G, mapped(2, 3, "")),
        ("Zeit;base;malleolus\ns;g;g\n", IN_G, ""),
    ],
)
def test_fair_files_are_read(tmp_path: Path, head: str, columns: list[np.ndarray], toml: str) -> None:
    right(read(text(tmp_path / "a.csv", head, columns, ";"), toml))


def test_a_clock_of_twelve_hours(tmp_path: Path) -> None:
    stamps = [f"{(11 if s < 3600 else 12)}:{int(s % 3600 // 60):02}:{s % 60:06.3f} {'AM' if s < 3600 else 'PM'}"
              for s in 3599.25 + TIME]  # fmt: skip
    body = zip(stamps, base(TIME), malleolus(TIME), strict=True)
    (tmp_path / "a.csv").write_text(
        "Time,base_m_s2,malleolus_m_s2\n" + "".join(f"{t},{b:.6f},{m:.6f}\n" for t, b, m in body)
    )
    right(read(tmp_path / "a.csv"))


def test_dates_are_times_under_any_name_and_a_footer_is_none(tmp_path: Path) -> None:
    whole = "started;base_m_s2;malleolus_m_s2\n"
    whole += "".join(f"2026-03-04T10:00:{t:06.3f}Z;{b:.6f};{m:.6f}\n" for t, b, m in zip(*IN_M_S2, strict=True))
    for footer in ("End of data", "recorded by app 1.2"):
        (tmp_path / "a.csv").write_text(f"{whole}{footer}\n\n")
        recording = read(tmp_path / "a.csv")
        right(recording)
        assert recording.unused == (f"a footer ({footer})",)


def test_headings_between_blanks_keep_their_units(tmp_path: Path) -> None:
    rows = "".join(f"{t:.3f} {b:.6f} {m:.6f}\n" for t, b, m in zip(*IN_M_S2, strict=True))
    (tmp_path / "a.txt").write_text(f"Zeit [s] Tisch [m/s^2] Fuß (m/s^2)\n{rows}")
    right(read(tmp_path / "a.txt", mapped("Tisch", "Fuß", "")))
    (tmp_path / "b.txt").write_text(f"time base malleolus\n[s] [m/s^2] (m/s^2)\n{rows}")
    right(read(tmp_path / "b.txt"))


def test_times_of_xarray_count_nanoseconds_since_a_date(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.nc", "w") as out:
        out["time"] = np.round(1e9 * TIME).astype("i8")
        out["time"].attrs["units"] = "nanoseconds since 2026-03-04 10:00:00"
        for name, values in (("base", base(TIME)), ("malleolus", malleolus(TIME))):
            out[name] = values
            out[name].attrs["units"] = "m/s^2"
    right(read(tmp_path / "a.nc"))


def test_refusals_are_sentences(tmp_path: Path) -> None:
    head = "time_s,base_g,malleolus_g,temperature\n"
    with pytest.raises(FasError, match=r"'temperature' is no clock of malleolus_m_s2: its numbers do not rise"):
        read(text(tmp_path / "b.csv", head, AXES[:4]), '[channels.malleolus]\nclock = "temperature"\n')
    with pytest.raises(FasError, match=r"no column 'time 9' for the times of malleolus"):
        read(
            text(tmp_path / "a.csv", "time_s,base_g,malleolus_g\n", AXES[:3]),
            '[channels.malleolus]\nclock = "time 9"\n',
        )


def stamped(recorded: np.ndarray, time_s: np.ndarray) -> Recording:
    """A recording whose stamps are rounded to a millisecond."""
    return Recording.from_arrays(np.round(recorded, 3), base(time_s), malleolus(time_s), name="a.csv")


def test_one_missing_sample_among_rounded_stamps_is_no_slow_clock() -> None:
    """A single step of 2 ms: a clock of 999.3 Hz, whose samples go on evenly, or a gap, over which they jump."""
    slow = np.arange(1500) / 999.7 + 2e-4
    assert np.round(np.diff(np.round(slow, 3)) * 1e3).max() == 2
    right(stamped(slow, slow))
    there = np.delete(np.arange(1501), 700) / 1000
    with pytest.raises(RecordingError, match=r"time is not uniform: 0\.002 s after 0\.699 s .* samples are missing"):
        checked(stamped(there, there))
