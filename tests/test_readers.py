"""CSV dialects and units, and the line and column of whatever is wrong."""

from pathlib import Path

import numpy as np
import pytest

from fasbody.exceptions import InputFileError
from fasbody.recording.channels import Channels, Layout
from fasbody.recording.csv import column, read_table
from fasbody.recording.files import reading

ROWS = np.array([[0.0, 1.5, -2.25], [0.001, 2.5, -3.25], [0.002, -1e-3, 4.0]])



def read_csv(file: Path, layout: Layout | None = None) -> Channels:
    return reading(file, layout).channels


def write(tmp_path: Path, text: str | bytes) -> Path:
    file = tmp_path / "r.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def table(separator: str = ",", header: str = "time_s,base_m_s2,malleolus_m_s2", rows: np.ndarray = ROWS) -> str:
    lines = [header.replace(",", separator)] + [separator.join(f"{x:.10g}" for x in row) for row in rows]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        ("time_ms,base_g,malleolus_mm_s2", (1e-3, 9.80665, 1e-3)),
        ("time_us,base_cm_s2,malleolus_m_s2", (1e-6, 1e-2, 1)),
        ("Time_s,BASE_m_s2,Malleolus_M_S2", (1, 1, 1)),
        ('"time_s","base_m_s2","malleolus_g"', (1, 1, 9.80665)),
    ],
)
def test_units(tmp_path: Path, header: str, factors: tuple[float, ...]) -> None:
    channels = read_csv(write(tmp_path, table(header=header)))
    np.testing.assert_allclose(np.column_stack(list(channels.values())), ROWS * factors, rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", r"is empty; the first line must be time_s,base_m_s2,malleolus_m_s2\."),
        (
            "Zeit;Basis;Knöchel\n0,000;1,5;2,5\n",
            r"line 1: names no channel \(found: Zeit, Basis, Knöchel\); .* study\.toml .*\[channels\.time\] column = ",
        ),
        ("Uhr;base_g;malleolus_g\n0;1;2\n", r"no column 'time_s' .* \(\[channels\.time\] column = \.\.\.\)"),
        ("time_s,base_m_s2\n0,1\n", r"line 1: has no column 'malleolus_m_s2' \(found: time_s, base_m_s2\)"),
        ("0,1,2\n0.001,1,2\n", r"has no header line; the first line must be time_s,base_m_s2,malleolus_m_s2, or --c"),
        ("time_s,base_ft_s2,malleolus_m_s2\n0,1,2\n", r"line 1: unknown unit of the column 'base': 'ft_s2'"),
        (table() + "0.003,abc,1\n", r"line 5: base_m_s2 is 'abc', not a number"),
        (table() + "0.003,1\n", r"line 5: malleolus_m_s2 is '', not a number"),
        (table() + "0.003,1,nan\n", r"line 5: malleolus_m_s2 is 'nan'; every sample must be finite"),
        (table() + "0.003,inf,1\n", r"line 5: base_m_s2 is 'inf'; every sample must be finite"),
        ("time_s;base_m_s2;malleolus_m_s2\n0,000;1,5;2.234,5\n", r"line 2: malleolus_m_s2 is '2.234,5', not a number"),
        (
            "time_s,base_g,malleolus_g\n0,000,1,5,2,5\n",
            r"line 2: has 6 cells, and the header 3; if its decimals have commas, .* by ;",
        ),
        ("time_s,base_g,malleolus_g\n0,1,2\n\n1,2,3,\n0,001,1,2\n", r"line 5: has 4 cells, and the header 3; if its"),
        ("time_s base_g malleolus_g\n0 1 2\n1 2 3 4\n", r"line 3: has 4 cells, and the header 3\."),
        ("time_s,base,malleolus_g\n0,1,2\n", r"line 1: base has no unit; name the column base_m_s2 .*base\] unit = "),
        (table() + '0.003,"1,2\n' + "0,1,2\n" * 999, r"line 5: opens a quotation mark that nothing closes"),
        (table() + "0.003," + "x" * 9999 + ",2\n", r"line 5: base_m_s2 is 'x{117}\.\.\.', not a number"),
        (b"time_s,base_g,malleolus_g\n0,1,2\n" + bytes(8), "line 3: holds zero bytes behind its text; it was cut off"),
        ("time_s,base (m/s),malleolus_m_s2\n0,1,2\n", r"line 1: base is in m/s, a velocity; differentiate it"),
        ("time_s,base [0.1 m/s^2],malleolus_g\n0,1,2\n", r"line 1: unknown unit of .*: '0.1 m/s\^2' \(valid: "),
        ("time_s,base [m/sec^2],malleolus_g\n0,1,2\n", r"'m/sec\^2', did you mean 'm_s2'\?"),
        ("time,base,malleolus\ns,ell,g\n0,1,2\n", r"line 1: unknown unit of the column 'base': 'ell'"),
        ("time_s,base_g,a\u200bx\n0,1,2\n", r"no column 'malleolus_m_s2' \(found: time_s, base_g, a\?x\)"),
        (table() + "0.003,1_0,1\n", r"line 5: base_m_s2 is '1_0', not a number"),
        (b"\xff\xfe\x00\x01\x80", r"is not a text file; a CSV file with a header line is needed"),
        ("time_s,base_g,malleolus_g,base_m_s2\n0,1,2,3\n", r"line 1: has two columns for base; keep one of them"),
        ("time_s,time_ms,base_g,malleolus_g\n0,1,2,3\n", r"line 1: has two columns for time; keep one of them"),
        (b"time_s,base_g,malleolus_g\n0,1,2\0\n", r"is not a text file; a CSV file with a header line is needed"),
    ],
)
def test_what_is_wrong_and_where(tmp_path: Path, text: str | bytes, sentence: str) -> None:
    with pytest.raises(InputFileError, match=sentence) as caught:
        read_csv(write(tmp_path, text))
    assert "r.csv" in str(caught.value)


UNITS_BELOW = "time;base;malleolus\ns;[m/s²];(m/s²)\n0,000;1,5;-2,25\n0,001;2,5;-3,25\n0,002;-1e-3;4\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings_decimal_comma_and_a_row_of_units(tmp_path: Path, encoding: str) -> None:
    channels = read_csv(write(tmp_path, UNITS_BELOW.encode(encoding)))
    np.testing.assert_array_equal(np.column_stack(list(channels.values())), ROWS)


@pytest.mark.parametrize(
    "text",
    [
        "Logger 4711; serial 8\nstarted: 12:30, by me\n\n" + table(";"),
        "# fasbody\n# time of day 12:30\n" + table("|").replace("\n0.001", "\n# the plug was pulled\n0.001"),
        "% " + table(" ").replace("\n", "\n\n") + "# end of file\n",
        '"Base: AI0","Malleolus: AI1"\n' + table().replace("0.001,2.5,-3.25", '"0.001", "2.5","-3.25"'),
        table("\t").replace(".", ",").replace("\t", " \t "),
        table(header='"time_s","base_m_s2","malleolus_m_s2"').replace("0.001,2.5,-3.25", '"0,001","2,5","-3,25"'),
        "time_s;base_m_s2;malleolus_m_s2;\n0;1,5;-2,25;\n0,001;2,5;-3,25;\n0,002;-0,001;4;\n",
    ],
)
def test_preambles_comments_and_commas(tmp_path: Path, text: str) -> None:
    channels = read_csv(write(tmp_path, text))
    np.testing.assert_array_equal(np.column_stack(list(channels.values())), ROWS)


def test_the_line_of_an_error_counts_preamble_and_units(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"line 7: base_m_s2 is 'oops', not a number"):
        read_csv(write(tmp_path, "Logger\n\n" + UNITS_BELOW.replace("-1e-3", "oops")))


def test_tables_in_the_same_dialects(tmp_path: Path) -> None:
    text = "# who took part\nsubject;mass_kg;name\n\n1;70,5;Ann\nµ;64;Zoë\n"
    for encoding in ("utf-16", "latin-1"):
        file = write(tmp_path, text.encode(encoding))
        read = read_table(file, ("subject", "mass_kg"))
        assert {line: row["subject"] for line, row in read.items()} == {4: "1", 5: "µ"}
        np.testing.assert_array_equal(column(file, read, "mass_kg"), [70.5, 64])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("subject,mass_kg\n1,70\n2,60,50\n", r"line 3: has 3 cells, and the header 2"),
        ("subject,mass_kg,mass_kg\n1,70,70\n", r"line 1: has two columns 'mass_kg'; keep one"),
        ('subject,mass_kg\n1,70\n"2,60\n3,60\n', r"line 3: opens a quotation mark that nothing closes\.$"),
        ("", r"is empty; its header must name subject, mass_kg"),
    ],
)
def test_broken_tables(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(InputFileError, match=sentence):
        read_table(write(tmp_path, text), ("subject", "mass_kg"))


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        read_csv(tmp_path / "none.csv")
    with pytest.raises(InputFileError, match="my_stduy: no such file or folder"):
        reading(tmp_path / "my_stduy", Layout())
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputFileError, match="is a folder, not a file"):
        read_csv(tmp_path / "folder.csv")


def test_decimal_commas_in_a_file_without_time(tmp_path: Path) -> None:
    """The first row alone, `0,0`, could be two integers."""
    channels = {"base": {"unit": "m/s^2"}, "malleolus": {"unit": "m/s^2"}}
    layout = Layout.from_toml(Path("study.toml"), channels, 1000)
    with pytest.raises(InputFileError, match=r"line 3: has 4 cells, and the header 2"):
        read_csv(write(tmp_path, "base,malleolus\n0,0\n1,1148,-2,6807\n"), layout)
    whole = read_csv(write(tmp_path, "base,malleolus\n0,0\n1,-2,,\n"), layout)  # empty cells are no numbers
    np.testing.assert_array_equal(whole["malleolus_m_s2"], [0, -2])


def test_tables(tmp_path: Path) -> None:
    file = write(tmp_path, "subject, mass_kg\n1, 70\nb,x\n3,\n")
    read = read_table(file, ("subject", "mass_kg"))
    with pytest.raises(InputFileError, match="line 3: mass_kg is 'x', not a number"):
        column(file, read, "mass_kg")
    with pytest.raises(InputFileError, match=r"has no column 'height_m' \(found: subject, mass_kg\)"):
        read_table(file, ("height_m",))
    good = {line: row for line, row in read.items() if line != 3}
    np.testing.assert_array_equal(column(file, good, "mass_kg", optional=True), [70, np.nan])
    with pytest.raises(InputFileError, match="not a number"):
        column(file, good, "mass_kg")


def test_what_a_number_is_does_not_depend_on_what_was_imported(tmp_path: Path) -> None:
    """pandas, which parses where it is loaded already, would take 1_0 for 10 and NA for no number."""
    import pandas  # noqa: F401

    for cell in ("1_0", "NA"):
        with pytest.raises(InputFileError, match=f"line 5: base_m_s2 is '{cell}', not a number"):
            read_csv(write(tmp_path, table() + f"0.003,{cell},1\n"))


@pytest.mark.parametrize(
    ("head", "separator"),
    [
        ("abs time (s)\tbase\tmalleolus\tfoot\ns\tm/s^2\tg\tm/s^2", "\t"),
        ("Elapsed time (s)\tbase [m/s^2]\tmalleolus [g]\tfoot [m/s^2]", "\t"),
        ('"Time","10:21:33 AM"\n"rel. time [s]","base [m/s^2]","malleolus [g]","foot pad [m/s^2]"', ","),
        ("sep=;\nRun time;base;malleolus;foot\ns;m/s^2;g;m/s^2", ";"),
        ("# units: time, base and malleolus, foot\ntime_s,base_m_s2,malleolus_g,foot_m_s2", ","),
        ("# time_s base_m_s2 malleolus_g foot_m_s2", " "),
    ],
)
def test_the_rows_say_what_separates_the_headings(tmp_path: Path, head: str, separator: str) -> None:
    rows = "\n".join(separator.join(f"{x:g}" for x in (*row, 7.0)) for row in ROWS)
    channels = read_csv(write(tmp_path, f"{head}\n{rows}\n"))
    columns = np.column_stack([channels[key] for key in ("time_s", "base_m_s2", "malleolus_m_s2")])
    np.testing.assert_allclose(columns, ROWS * (1, 1, 9.80665), rtol=1e-12)


def test_a_separator_of_excel_above_a_trailing_one(tmp_path: Path) -> None:
    head = "sep=\t\nTime\tAcc A\tAcc B\t\nms\tm/(s^2)\tm/(s^2)\t\n"
    rows = "".join(f"{i}.0\t{i % 7}.5\t{i % 5}.5\t\n" for i in range(9))
    layout = Layout.from_toml(tmp_path, {"base": {"column": "Acc A"}, "malleolus": {"column": "Acc B"}})
    assert read_csv(write(tmp_path, head + rows), layout)["time_s"][-1] == pytest.approx(0.008)


@pytest.mark.parametrize("unit", ["mm/s", "a.u.", "% FS", "m/s^2"])
def test_a_unit_that_study_toml_overrules_is_named(tmp_path: Path, unit: str) -> None:
    file = write(tmp_path, table(header=f"time_s,base [m/s^2],malleolus [{unit}]"))
    layout = Layout.from_toml(file, {"malleolus": {"column": 3, "unit": "m/s^2"}})
    warnings = reading(file, layout).warnings
    assert bool(warnings) == (unit != "m/s^2") and all("though the file says" in text for text in warnings)


@pytest.mark.parametrize(
    ("times", "says"),
    [
        ([4294.965, 4294.966, 4294.967, 0.0, 0.001, 0.002], "a counter began anew; add 4294.968 s"),
        ([7200.0, 7201.0, 7202.0, 3603.0, 3604.0], "its clock was set back; add 3600 s to the times from there on"),
        ([5.0, 4.0, 3.0, 2.0], "sort the rows by time"),
    ],
)
def test_times_that_fall_back(tmp_path: Path, times: list[float], says: str) -> None:
    rows = np.array([[t, 1.5 * i, -i] for i, t in enumerate(times)])
    with pytest.raises(InputFileError, match=says):
        read_csv(write(tmp_path, table(rows=rows)))
