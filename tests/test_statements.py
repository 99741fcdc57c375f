"""What files state of a channel's time or scale: refused by name unless alike, neutral, or answered in study.toml."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file, savemat

from fasbody.exceptions import InputFileError
from fasbody.recording.channels import Layout
from fasbody.recording.recording import Recording
from fasbody.recording.statements import kind

T = np.arange(3000) / 1000
BASE, MALLEOLUS = (5 * size * np.sin(40 * np.pi * T - lag) for size, lag in ((1, 0), (1.5, 0.6)))
ANSWERS = {"malleolus": {"delay_s": 0.0, "sensitivity": 1.0}}


def text(file: Path, head: str) -> Path:
    rows = "\n".join(f"{t:.3f},{b:.5f},{m:.5f}" for t, b, m in zip(T, BASE, MALLEOLUS, strict=True))
    file.write_text(f"{head}\ntime_s,base_m_s2,malleolus_m_s2\n{rows}\n")
    return file


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("trigger_delay_s", "delay_s"), ("firstTimestamp_us", "delay_s"), ("t0", "delay_s"), ("LSB", "sensitivity"),
        ("time_offset", "delay_s"), ("offset", ""), ("calibration_date", ""), ("Gain", "sensitivity"),
        ("start", "delay_s"), ("first_sample_index", "delay_s"), ("sync_offset", "delay_s"), ("time_stamp", "delay_s"),
        ("toffset", "delay_s"), ("pretrigger_samples", "delay_s"), ("begin", "delay_s"), ("*TIMEDELAY", "delay_s"),
        ("Verzögerung", "delay_s"), ("retardo", "delay_s"), ("Verstärkung", "sensitivity"), ("samples", ""),
        ("trigger_level", ""), ("scaled_units", ""), ("locale", ""), ("restart_count", ""),
    ],
)  # fmt: skip
def test_kinds_of_statements(name: str, key: str) -> None:
    assert kind(name) == key


@pytest.mark.parametrize(
    ("head", "says"),
    [
        ("Channel,,base,malleolus\nGain,,1,2", "Gain = 1, 2 for its channels"),
        ("Time offset [s],,0,0.0065", r"Time offset \[s\] = 0, 0.0065 for"),
        ("Start base: 10:15:00.000\nStart malleolus: 10:15:00.005", "Start = 10:15:00.005 with 'malleolus_m_s2'"),
        ("Start time,10:15:00,10:15:01", "Start time = 10:15:00, 10:15:01 for its channels"),
        ("Calibration base: 1.000\nCalibration malleolus: 0.500", "Calibration = 0.5 with"),
        ("# multiply malleolus by 0.5", "multiply by = 0.5 with"),
        ("# note: malleolus channel lags 5.0 ms (wireless)", "lags = 5 with"),
        ("# Laufzeit Knöchel 5 ms", "Laufzeit = 5 with"), ("*TIMEDELAY\n,0,0.006", "TIMEDELAY = 0, 0.006 for"),
        ("# Start malleolus: 2026-03-02T10:15:00.004Z", "Start = 2026-03-02T10:15:00.004 with"),
    ],
)
def test_lines_that_differ_between_channels(tmp_path: Path, head: str, says: str) -> None:
    file = text(tmp_path / "r.csv", head)
    with pytest.raises(InputFileError, match=f"says .*{says}.*not whether its .* contain it.*if they do"):
        Recording.read(file)
    assert Recording.read(file, layout=Layout.from_toml(file, ANSWERS)).warnings == ()


@pytest.mark.parametrize(
    "head",
    [
        "Gain,,2,2", ";Start_time, 2026-03-02, 10:15:00.000",
        "Start base: 10:15\nStart malleolus: 10:15", "Start time: 3/2/2026 10:15:00 AM",
        "Sensitivity base: 100 mV/g\nSensitivity malleolus: 98 mV/g", "Channel 1: base\nChannel 2: malleolus",
        "Calibration date,2024,2025", "Horizontal Scale,0.8", "# malleolus sensor: 352C33, 5 g",
        "Channel,base,malleolus", "Units,m/s^2,g", "Serial number,4711,4712", "Max,1.2,3.4", "Filter,CFC 180,CFC 180",
        "Duration: 2.0 s", "COMMENT,,base,malleolus", "Vertical Offset,CH1:0.0,CH2:0.0", "Date,2024-03-05,2024-03-06",
        ";Title, X16-1D, Build date, Jan 1",
    ],
)  # fmt: skip
def test_lines_that_say_nothing_of_the_response(tmp_path: Path, head: str) -> None:
    assert Recording.read(text(tmp_path / "r.csv", head)).warnings == ()


def test_a_line_that_is_not_understood_is_quoted(tmp_path: Path) -> None:
    read = Recording.read(text(tmp_path / "r.csv", "# base scaled; malleolus in LSB of 0.0039 g"))
    assert "says '# base scaled; malleolus in LSB of 0.0039 g', which is not applied" in read.warnings[0]


@pytest.mark.parametrize(
    "line",
    [
        "# second channel frequency weighted Wk", "# divide column 3 by two", "# CH2 lags CH1 by seven samples",
        "# sensor B delayed by a quarter of a period", "# 足首センサは5ms遅延", "# Канал лодыжки задержан",
        "# Canal 2: 5 мс", "# Export,down-sampled by 2", "# Stored: every 4th sample",
    ],
)
def test_sensors_by_number_or_in_another_language_and_thinned_samples_are_quoted(tmp_path: Path, line: str) -> None:
    assert any("which is not applied" in says for says in Recording.read(text(tmp_path / "r.csv", line)).warnings)


@pytest.mark.parametrize("line", ["# Channel 2: malleolus, m/s^2", "# CH1 serial 4711", "# 2 channels", "# sensor 2 z"])
def test_numbered_sensors_that_are_only_named_are_not(tmp_path: Path, line: str) -> None:
    assert Recording.read(text(tmp_path / "r.csv", line)).warnings == ()


NOTE = "ankle amplifier gain 2, not corrected"
HARMLESS = "recorded in room 12"


def noted(file: Path, note: str) -> None:
    """A file of a kind with a remark of its own."""
    columns = {"time_s": T, "base_m_s2": BASE, "malleolus_m_s2": MALLEOLUS}
    if file.suffix == ".mat":
        savemat(file, columns | {"comment": note})
    elif file.suffix == ".npz":
        np.savez(file, **columns, README=note)
    elif file.suffix == ".h5":
        with h5py.File(file, "w") as out:
            out.attrs["notes"] = note
            for name, values in columns.items():
                out[name] = values
    elif file.suffix == ".tdms":
        nptdms = pytest.importorskip("nptdms")
        channels = [nptdms.ChannelObject("foot", name, values) for name, values in columns.items()]
        with nptdms.TdmsWriter(str(file)) as out:
            out.write_segment([nptdms.RootObject({"description": note}), *channels])
    elif file.suffix == ".parquet":
        arrow = pytest.importorskip("pyarrow")
        parquet = pytest.importorskip("pyarrow.parquet")
        parquet.write_table(arrow.table(columns).replace_schema_metadata({"remark": note}), file)
    else:
        with netcdf_file(file, "w") as out:
            out.comment = note
            out.createDimension("sample", T.size)
            for name, values in columns.items():
                out.createVariable(name, "d", ("sample",))[:] = values


@pytest.mark.parametrize("kind_of", [".mat", ".npz", ".h5", ".tdms", ".parquet", ".nc"])
def test_a_files_remark_of_a_sensor_is_not_passed_over(tmp_path: Path, kind_of: str) -> None:
    file = tmp_path / f"r{kind_of}"
    noted(file, NOTE)
    with pytest.raises(InputFileError, match="amplifier gain = 2 with 'malleolus"):
        Recording.read(file)
    noted(file, HARMLESS)
    assert Recording.read(file).warnings == ()


def attributed(tmp_path: Path, key: str, values: tuple) -> Path:
    """An HDF5 file whose base and malleolus have an attribute each, or none."""
    file = tmp_path / "r.h5"
    with h5py.File(file, "w") as out:
        out.attrs["fs"] = 1000.0
        for name, samples, value in zip(("base_m_s2", "malleolus_m_s2"), (BASE, MALLEOLUS), values, strict=True):
            out[name] = samples
            if value is not None:
                out[name].attrs[key] = value
    return file


@pytest.mark.parametrize(
    ("key", "values", "refused"),
    [
        ("delay_ms", (0.0, 6.0), True), ("delay_ms", (6.0, 6.0), False), ("gain", (2.0, 2.0), True),
        ("gain", (1, 1), False),
        ("resolution", (16, 16), False), ("resolution", (1.0, 0.5), True), ("start", ("10:15:00", "10:15:01"), True),
        ("sensitivity", ("100 mV/g", "98 mV/g"), False), ("offset", (2.4, 2.5), False),
    ],
)  # fmt: skip
def test_attributes_of_hdf5(tmp_path: Path, key: str, values: tuple, refused: bool) -> None:
    file = attributed(tmp_path, key, values)
    if not refused:
        assert Recording.read(file).warnings == ()
        return
    with pytest.raises(InputFileError, match=f"says {key} = "):
        Recording.read(file)
    tables = ANSWERS | {"base": {"sensitivity": 1.0}}
    assert Recording.read(file, layout=Layout.from_toml(file, tables)).warnings == ()


@pytest.mark.parametrize("ending", ["mat", "npz"])
@pytest.mark.parametrize(
    ("scalars", "says"),
    [
        ({"t0_base": 0.0, "t0_malleolus": 0.006}, "t0 = 0.006 with 'malleolus_m_s2'"),
        ({"cal": np.array([1.0, 0.5])}, "cal = 1, 0.5 for its channels"), ({"cal": np.array([1.0, 1.0])}, ""),
        ({"delay_malleolus": 0.0}, ""), ({"age": 50}, ""),
    ],
)  # fmt: skip
def test_scalars_beside_the_channels(tmp_path: Path, ending: str, scalars: dict, says: str) -> None:
    file = tmp_path / f"r.{ending}"
    content = {"fs": 1000.0, "base_m_s2": BASE, "malleolus_m_s2": MALLEOLUS} | scalars
    savemat(file, content) if ending == "mat" else np.savez(file, **content)
    if not says:
        assert Recording.read(file).warnings == ()
        return
    with pytest.raises(InputFileError, match=f"says {says}"):
        Recording.read(file)
    assert Recording.read(file, layout=Layout.from_toml(file, ANSWERS)).warnings == ()


@pytest.mark.parametrize(
    "toml", [{}, {"time": {"column": "time"}}, {"base": {"clock": "time"}, "malleolus": {"clock": "late"}}]
)
@pytest.mark.parametrize("version", [3, 4])
def test_each_variable_of_netcdf_has_the_time_of_its_dimension(tmp_path: Path, version: int, toml: dict) -> None:
    file = tmp_path / "r.nc"
    late = 5 * np.sin(40 * np.pi * (T + 0.004))
    columns = (("time", "time", T, "s"), ("base", "time", BASE, "m/s^2"), ("late", "late", T + 0.004, "s"),
               ("malleolus", "late", late, "m/s^2"))  # fmt: skip
    with (netcdf_file(file, "w") if version == 3 else h5py.File(file, "w")) as out:
        for axis in ("time", "late") if version == 3 else ():
            out.createDimension(axis, T.size)
        for name, axis, samples, unit in columns:
            if version == 3:
                variable = out.createVariable(name, "d", (axis,))
                variable[:], variable.units = samples, unit
                continue
            out[name] = samples
            out[name].attrs["units"] = unit
            out[name].make_scale(name) if name == axis else out[name].dims[0].attach_scale(out[axis])
    read = Recording.read(file, layout=Layout.from_toml(file, toml))
    assert np.allclose(read.base_m_s2, read.malleolus_m_s2, atol=1e-6)
    assert read.warnings == () and read.unused == ()


COUNTS = np.arange(T.size)


@pytest.mark.parametrize(
    ("counts", "says"),
    [
        (COUNTS, ""), (COUNTS % 256, ""), (7 + COUNTS, ""), (COUNTS // 10 + 1, ""),
        (2 * COUNTS, "counts by 2 from row"),
        (COUNTS + 40 * (COUNTS > 999), "goes from 999 to 1040: samples are missing there"),
        (COUNTS + (COUNTS > 99) + (COUNTS > 999), "goes from 99 to 101: .* there, and more at 1 later places"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("rate", ["Sampling rate: 1000 Hz", ""])
def test_a_counter_may_deny_the_rate(tmp_path: Path, counts: np.ndarray, says: str, rate: str) -> None:
    file = tmp_path / "r.csv"
    rows = "\n".join(f"{n},{b:.5f},{m:.5f}" for n, b, m in zip(counts, BASE, MALLEOLUS, strict=True))
    file.write_text(f"{rate}\nframe,base_m_s2,malleolus_m_s2\n{rows}\n".lstrip())
    layout = Layout(rate_hz=1000.0)
    if not says or (not rate and "by 2" in says):  # a rate of study.toml is that of the rows
        assert Recording.read(file, layout=layout).rate_hz == pytest.approx(1000)
        return
    with pytest.raises(InputFileError, match=f"has a rate of 1000 Hz, and its column 'frame' {says}"):
        Recording.read(file, layout=layout)


@pytest.mark.parametrize(
    "line",
    ["Rate: 2000 Hz (stored: every 2nd sample)", "Rate: 1,000 Hz", "Rate: 1.000 Hz", "Rate: 4 kHz, decimated by 4"],
)
def test_a_rate_with_something_behind_it_does_not_count(tmp_path: Path, line: str) -> None:
    file = tmp_path / "r.csv"
    rows = "\n".join(f"{b:.5f},{m:.5f}" for b, m in zip(BASE, MALLEOLUS, strict=True))
    file.write_text(f"{line}\nbase_m_s2,malleolus_m_s2\n{rows}\n")
    with pytest.raises(InputFileError, match="give sampling_rate_hz"):
        Recording.read(file)
    assert Recording.read(file, layout=Layout(rate_hz=1000.0)).rate_hz == pytest.approx(1000)


@pytest.mark.parametrize(
    "line",
    [
        "# ankle: 40 Hz RC low-pass in the cable", "# only base is calibrated", "# latency of the ankle unit: 4 ms",
        "# sync error between loggers: 5 ms", "Low pass [Hz],none,50", "Status,OK,overload", "Kommentar,,Kabel defekt",
        "# td_mal=0.004", "Time,10:21:33.000,10:21:33.004", "# amplifier at +6.02 dB", "# both started by hand",
    ],
)  # fmt: skip
@pytest.mark.parametrize("place", ["above", "between", "below"])
def test_lines_that_are_not_understood_are_quoted(tmp_path: Path, line: str, place: str) -> None:
    if place != "above" and line[0] != "#":
        return
    file = text(tmp_path / "r.csv", line if place == "above" else "")
    if place != "above":
        rows = file.read_text().splitlines()
        rows.insert(1000 if place == "between" else len(rows), line)
        file.write_text("\n".join(rows))
    (warning,) = Recording.read(file).warnings
    assert line in warning and warning.endswith("which is not applied.")


def test_several_lines_are_quoted_in_one_warning(tmp_path: Path) -> None:
    file = text(tmp_path / "r.csv", "# Filter base: none\n# Filter malleolus: analog low-pass")
    (warning,) = Recording.read(file).warnings
    assert "'# Filter base: none'; '# Filter malleolus" in warning
    many = text(tmp_path / "m.csv", "\n".join(f"# ankle slipped {i}" for i in range(9)))
    (warning,) = Recording.read(many).warnings
    assert "slipped 5' and 3 more, which" in warning


@pytest.mark.parametrize(
    ("key", "values", "quoted"),
    [
        ("filter_cutoff_hz", (None, 40.0), "'' with base and '40' with malleolus"),
        ("status", ("ok", "overload"), "'ok' with base and 'overload'"), ("status", ("ok", "ok"), ""),
        ("serial_number", (4711, 4712), ""), ("description", ("base sensor", "malleolus sensor"), ""),
        ("description", ("", "cable broken"), "cable broken"), ("rms", (1.0, 2.0), ""),
    ],
)  # fmt: skip
def test_attributes_that_differ_are_quoted(tmp_path: Path, key: str, values: tuple, quoted: str) -> None:
    warnings = Recording.read(attributed(tmp_path, key, values)).warnings
    assert len(warnings) == bool(quoted) and (not quoted or f"{key} = " in warnings[0])
    assert not quoted or quoted in warnings[0]


def test_start_times_as_text_are_not_dropped(tmp_path: Path) -> None:
    file = tmp_path / "r.h5"
    with h5py.File(file, "w") as out:
        out.attrs["fs"] = 1000.0
        for name, samples, at in (("base_m_s2", BASE, "0"), ("malleolus_m_s2", MALLEOLUS, "4")):
            out[name] = samples
            out[name].attrs["start_time"] = f"2026-03-02T10:15:00.00{at}"
    with pytest.raises(InputFileError, match=r"start_time = 2026-03-02T10:15:00\.004 with"):
        Recording.read(file)


@pytest.mark.parametrize(("gain", "says"), [("2", "gain = 2 with"), ("1", "")])
def test_a_column_of_one_number(tmp_path: Path, gain: str, says: str) -> None:
    file = text(tmp_path / "r.csv", "")
    head, *rows = file.read_text().split()
    file.write_text("\n".join([f"{head},malleolus_gain", *(f"{row},{gain}" for row in rows)]))
    layout = Layout.from_toml(file, {"malleolus": {"column": "malleolus_m_s2"}})
    if says:
        with pytest.raises(InputFileError, match=says):
            Recording.read(file, layout=layout)
    else:
        assert Recording.read(file, layout=layout).warnings == ()


@pytest.mark.parametrize(
    ("columns", "cells", "says"),
    [
        ("latency_s", ("0", "0.005"), "latency_s = 0.005 with"), ("status", ("good", "bad"), "says that m is bad"),
        ("sampling_frequency", ("1000", "500"), "a sampling_frequency of 500 Hz, and its rate is 1000 Hz"),
        ("status", ("good", "good"), ""), ("sampling_frequency", ("1000", "1000"), ""),
    ],
)  # fmt: skip
def test_columns_of_bids(tmp_path: Path, columns: str, cells: tuple[str, str], says: str) -> None:
    file = tmp_path / "a_motion.tsv"
    file.write_text("\n".join(f"{b:.5f}\t{m:.5f}" for b, m in zip(BASE, MALLEOLUS, strict=True)))
    (tmp_path / "a_motion.json").write_text('{"SamplingFrequency": 1000}')
    (tmp_path / "a_channels.tsv").write_text(
        f"name\tunits\t{columns}\nb\tm/s^2\t{cells[0]}\nm\tm/s^2\t{cells[1]}\n"
    )
    layout = Layout.from_toml(file, {"base": {"column": "b"}, "malleolus": {"column": "m"}})
    if says:
        with pytest.raises(InputFileError, match=says):
            Recording.read(file, layout=layout)
    else:
        recording = Recording.read(file, layout=layout)
        assert recording.warnings == () and "as its .json says" in recording.used[0]
