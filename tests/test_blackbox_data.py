"""Reading and checking recordings: one clear sentence for each kind of useless data."""

from pathlib import Path

import linear_foot as foot
import numpy as np
import pytest

from fasbody.exceptions import FasError, RecordingError, SettingError
from identification.blackbox import data
from identification.blackbox.data import Series
from identification.blackbox.identify import identify

U = foot.prbs(200)
Y = foot.linear_output(U)


@pytest.mark.parametrize(
    ("u", "y", "sentence"),
    [
        (np.full(200, 5.0), Y, r"input 'volts' is constant \(5 in all 200 samples\)"),
        (np.zeros(200), Y, "input 'volts' is zero throughout: an output without input"),
        (U, np.full(200, 3.0), r"output 'speed' is constant \(3 in all 200 samples\)"),
        (U, U, "the same signal"),
        (U[:2], Y[:2], "2 samples are too few"),
        (np.full(200, np.nan), Y, "input 'volts' has no finite number in 200 samples"),
        (np.where(np.arange(200) == 7, np.nan, U), Y, "'volts' is not a finite number at sample 8"),
        (U, np.where(np.arange(200) < 2, np.nan, Y), r"output 'speed' is .* sample 1 \(2 of 200\)"),
        (U, np.where(np.arange(200) == 9, np.inf, Y), "'speed' is not a finite number at sample 10"),
        (U, np.exp(0.1 * np.arange(200)), "grows from beginning to end"),
        (U, 0.1 * np.exp(0.03 * np.arange(200)) * np.sin(np.arange(200)), "grows from beginning"),
        (U, Y[:-1], "of equal length"),
        (U, np.where(np.arange(200) == 9, 1e308, Y), r"'speed' is 1e\+308, which nothing measures, at sample 10"),
    ],
)
def test_useless_data_get_one_sentence_with_the_channel(
    u: np.ndarray, y: np.ndarray, sentence: str
) -> None:
    with pytest.raises(RecordingError, match=sentence) as caught:
        Series(u, y, 1e-3, channels=("volts", "speed"))
    assert str(caught.value).count("\n") == 0
    assert str(caught.value).endswith(".")


def test_a_record_that_starts_at_rest_does_not_grow_without_bound() -> None:
    for frequency in (5.0, 20.0, 50.0):
        u = foot.sine(frequency, 2000)
        Series(u, foot.linear_output(u), 1e-3)


def test_split_removes_the_means_of_the_first_part() -> None:
    first, second = Series(U + 5.0, Y - 2.0, 1e-3).split(0.6)
    assert (len(first), len(second)) == (120, 80)
    assert abs(first.u.mean()) < 1e-12 and abs(first.y.mean()) < 1e-12
    np.testing.assert_allclose(second.u, U[120:] - U[:120].mean(), atol=1e-12)
    with pytest.raises(SettingError) as caught:
        Series(U, Y, 1e-3).split(0.01)
    assert caught.value.setting == "split"


def test_arrays_are_kept_from_change_and_seconds_positive() -> None:
    with pytest.raises(RecordingError, match="positive number of seconds"):
        Series(U, Y, 0.0)
    series = Series(U, Y, 1e-3)
    with pytest.raises(ValueError, match="read-only"):
        series.u[0] = 1.0


TIME_MS = np.arange(200.0)


@pytest.mark.parametrize(
    ("header", "columns", "options"),
    [
        ("time_s,base_m_s2,malleolus_m_s2", (1e-3 * TIME_MS, U, Y), {}),
        ("time_s,malleolus_m_s2,base_m_s2", (1e-3 * TIME_MS, Y, U), {}),
        ("force,speed", (U, Y), {"sample_time": 1e-3}),
        ("speed,force", (Y, U), {"input": "force", "output": "speed", "sample_time": 1e-3}),
        ("a,b,c", (Y, U, Y), {"input": "2", "output": "3", "sample_time": 1e-3}),
        ("", (U, Y), {"sample_time": 1e-3}),
        ("", (1e-3 * TIME_MS, U, Y), {}),
        ("time_ms,u,y", (TIME_MS, U, Y), {}),
        ("Time (ms),force,speed", (TIME_MS, U, Y), {}),
        ("t [us],force,speed", (1e3 * TIME_MS, U, Y), {}),
        ("Time (s),force,speed", (1e-3 * TIME_MS, U, Y), {"sample_time": 1e-3}),
        ("timestamp,force,speed", (1e-3 * TIME_MS, U, Y), {}),
        ("Zeit,force,speed", (TIME_MS, U, Y), {"sample_time": 1e-3}),
        ("time_min,force,speed", (TIME_MS, U, Y), {"sample_time": 1e-3}),
    ],
)
@pytest.mark.parametrize("separator", [",", ";"])
def test_csv_of_many_forms(
    tmp_path: Path, header: str, columns: tuple[np.ndarray, ...], options: dict, separator: str
) -> None:
    """With and without header and time, whose unit is recognised; the second with a byte order mark."""
    file = tmp_path / "record.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=separator, header=header.replace(",", separator), comments="")
    mark = b"\xef\xbb\xbf" if separator == ";" else b""
    file.write_bytes(mark + file.read_bytes().lstrip(b"\n"))
    series = data.read_csv(file, **options)
    np.testing.assert_allclose(series.u, U)
    np.testing.assert_allclose(series.y, Y)
    assert series.sample_time == pytest.approx(1e-3, rel=1e-9)
    names = header.split(",") if header else [f"column {k + 1}" for k in range(len(columns))]
    place = max(k for k, column in enumerate(columns) if column is U)
    assert series.channels == (names[place], names[place - 1 if columns[-1] is not Y else place + 1])


@pytest.mark.parametrize(
    ("header", "step", "options", "says"),
    [
        ("time", 10.0, {}, True), ("time_s", 10.0, {}, False), ("time", 0.01, {}, False), ("time_ms", 10.0, {}, False),
        ("time", 10.0, {"sample_time": 10.0}, False),
    ],
)  # fmt: skip
def test_a_time_without_unit_is_remarked_where_it_may_be_in_another(
    tmp_path: Path, header: str, step: float, options: dict, says: bool
) -> None:
    table = np.column_stack([step * np.arange(200), U, Y])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=f"{header},u,y", comments="")
    series = data.read_csv(tmp_path / "a.csv", **options)
    assert series.remarks == ("'time' is read as seconds, 0.1 Hz; --sample-time overrides it",) * says
    assert ("read as seconds" in " ".join(identify(series, ("oe",), {"oe": (2, 2, 1)}).notes)) == says


def test_study_folder_keeps_the_corrections_of_its_study(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name in ("a.csv", "b.csv"):
        table = np.column_stack([np.arange(200) * 1e-3, U, Y])
        np.savetxt(folder / name, table, delimiter=",", header="time_s,base_m_s2,malleolus_m_s2", comments="")
    (tmp_path / "study.toml").write_text("[channels.malleolus]\nsign = -1\n")
    (tmp_path / "subjects.csv").write_text("subject,mass_kg\n16,72.57\n")
    rows = "recordings/a.csv,16,0\nrecordings/b.csv,16,0\n"
    (tmp_path / "recordings.csv").write_text("file,subject,added_mass_kg\n" + rows)
    read = data.read(tmp_path)
    assert [series.name for series in read] == ["a", "b"]
    np.testing.assert_allclose(read[0].y, -Y)


ROWS = "".join(f"{k},{k % 5},{k % 7}\n" for k in range(50))


@pytest.mark.parametrize(
    ("content", "options", "sentence"),
    [
        ("", {}, "is empty"),
        ("u,y\n" + "1,2\n2,3\n" * 20, {}, "has no time column"),
        ("time_s,u\n0,1\n1,2\n", {}, "has no column left for the output"),
        ("time_s,u,y\n", {}, "has 0 rows of numbers; 20 are needed"),
        ("time_s,u,y\n0,1,1\n1,2,1\n1,2,3\n", {}, "line 4: .*does not increase from row to row: 1 s after 1 s"),
        ("time_s,u,y\n0,1,1\n# lost\n1,2,1\n5,2,3\n6,1,2\n", {}, "line 5: is not sampled uniformly: a step of 4 s"),
        ("time_s,u,y\n0,1,1\n1,2,1e308\n", {}, r"line 3: y is 1e\+308, which nothing measures"),
        ("u,y\n1,x\n2,3\n", {"sample_time": 1.0}, "not a number"),
        ("force,speed\n1,2\n2,3\n", {"input": "forces", "sample_time": 1.0}, "did you mean 'force'"),
        ("time_fortnight,u,y\n" + ROWS, {}, "unit of the time column"),
        ("Zeit,u,y\n" + ROWS, {}, "call it time_s, time_ms"),
        ("time_s;u;y\n0;1;2\n1;2,5;3\n", {}, "2 samples are too few"),
        ("time_s,u,y\n0,0,1,5,2,5\n0,1,1,5,2,5\n", {}, "6 cells, and the header 3; .*separate the columns by ;"),
        ("time_s,u,y\n0,1,2\n1,lost,3\n", {}, "line 3: u is 'lost', not a number"),
        ("t,u,y\n0,1,2\n1,2,3\n", {}, "2 samples are too few"),
    ],
)
def test_useless_files_get_one_sentence(tmp_path: Path, content: str, options: dict, sentence: str) -> None:
    file = tmp_path / "record.csv"
    file.write_text(content)
    with pytest.raises(FasError, match=rf"record\.csv.*{sentence}") as caught:
        data.read_csv(file, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("at", [60, 100])
def test_steps_and_impulses_are_recordings(at: int) -> None:
    """The second half of a step's or an impulse's record has no changing input; the record still identifies."""
    n = 600
    for u in (np.where(np.arange(n) < at, 0.0, 1.0), np.where(np.arange(n) == at, 50.0, 0.0)):
        y = foot.linear_output(u) + 1e-3 * np.random.default_rng(at).standard_normal(n)
        found = identify(Series(u, y, 1e-3, "blow"), ("oe",), {"oe": (4, 4, 1)})
        poles = np.sort_complex(found.models["oe"].best.model.poles())[-2:]
        np.testing.assert_allclose(poles, np.sort_complex(np.roots(foot.transfer()[1]))[-2:], atol=0.02)
        assert any("constant in the held-out part" in text for text in found.models["oe"].warnings)


def test_a_late_step_names_the_part_and_the_remedy() -> None:
    u = np.where(np.arange(600) < 400, 0.0, 1.0)
    late = Series(u, foot.linear_output(u) + 1e-3 * np.random.default_rng(0).standard_normal(600), 1e-3, "late")
    with pytest.raises(RecordingError, match=r"estimation part \(samples 1 to 300 of 600\).*larger --split"):
        late.split()
    first, second = late.split(0.8)
    assert (len(first), len(second)) == (480, 120)
