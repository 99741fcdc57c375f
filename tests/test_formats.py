"""Files written by the formats' own libraries, and what their headings, units and times may say."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from fasbody.exceptions import InputFileError
from fasbody.recording.channels import Layout
from fasbody.recording.recording import HEADER, Recording

T = np.arange(300) / 1000
BASE = 8.95 * np.sin(2 * np.pi * 20 * T)
CHANNELS = {"time_s": T, "base_m_s2": BASE, "malleolus_m_s2": 1.3 * BASE, "tuberosity_m_s2": 1.2 * BASE}


@pytest.mark.parametrize("ending", ["csv", "mat", "h5", "hdf5", "uff", "unv", "tdms"])
def test_round_trip(tmp_path: Path, ending: str) -> None:
    Recording(**CHANNELS).write(tmp_path / f"r.{ending}")
    back = Recording.read(tmp_path / f"r.{ending}")
    tolerance = {"csv": 1e-6, "uff": 1e-6, "unv": 1e-6}.get(ending, 1e-12)
    for name in HEADER:
        assert getattr(back, name) == pytest.approx(CHANNELS[name], abs=tolerance)


def test_version_7_3_is_written_as_matlab_does(tmp_path: Path) -> None:
    """The header of 128 bytes, the class of every variable, vectors as (1, n) because MATLAB counts axes backwards."""
    Recording(**CHANNELS).write(tmp_path / "r.mat", matlab="7.3")
    whole = (tmp_path / "r.mat").read_bytes()
    assert whole[:19] == b"MATLAB 7.3 MAT-file" and whole[116:128] == b" " * 8 + b"\x00\x02IM"
    assert whole[512:520] == b"\x89HDF\r\n\x1a\n"
    with h5py.File(tmp_path / "r.mat") as file:
        assert set(file) == set(HEADER) and file.userblock_size == 512
        for name in HEADER:
            assert file[name].attrs["MATLAB_class"] == b"double" and file[name].shape == (1, 300)
            np.testing.assert_array_equal(file[name][0], CHANNELS[name])
    back = Recording.read(tmp_path / "r.mat")
    np.testing.assert_array_equal(back.tuberosity_m_s2, CHANNELS["tuberosity_m_s2"])


def test_what_is_no_real_column_is_named(tmp_path: Path) -> None:
    savemat(tmp_path / "c.mat", {"time_s": T, "base_m_s2": BASE, "malleolus_m_s2": BASE + 1j, "note": "left foot"})
    says = r"no column 'malleolus_m_s2' \(found: .*; passed over: .*'malleolus_m_s2' is complex"
    with pytest.raises(InputFileError, match=says):
        Recording.read(tmp_path / "c.mat")
    savemat(tmp_path / "s.mat", {"data": {"note": "left"}, "parts": np.array([BASE, "x"], object)})
    says = r"no numeric channel \('parts' is a cell array, 'note' is text\)"
    with pytest.raises(InputFileError, match=says):
        Recording.read(tmp_path / "s.mat")
    with h5py.File(tmp_path / "c.h5", "w") as out:
        out["base_m_s2"], out["malleolus_m_s2"], out["fs"] = BASE, BASE + 1j, 1000.0
    with pytest.raises(InputFileError, match=r"'malleolus_m_s2' is complex"):
        Recording.read(tmp_path / "c.h5")


def test_layout_maps_columns_volts_sign_and_delay(tmp_path: Path) -> None:
    """A logger's matrix in volts: 100 mV/g, malleolus mounted upside down and 0.4 ms late."""
    volts = BASE / 9.80665 * 0.1
    late = -1.3 * 8.95 * np.sin(2 * np.pi * 20 * (T - 4e-4)) / 9.80665 * 100  # mV
    savemat(tmp_path / "r.mat", {"data": np.column_stack([volts, late])})
    table = {
        "base": {"column": "data_1", "unit": "V", "sensitivity": "100 mV/g"},
        "malleolus": {"column": "data_2", "unit": "mV", "sensitivity": "100 mV/g", "sign": -1, "delay_s": 4e-4},
    }
    layout = Layout.from_toml(Path("study.toml"), table, 1000)
    back = Recording.read(tmp_path / "r.mat", layout=layout)
    assert back.base_m_s2 == pytest.approx(BASE[:-1])
    assert back.malleolus_m_s2[5:-5] == pytest.approx(1.3 * BASE[5:-6], abs=2e-4)


def write_tdms(file: Path, **channels: tuple[np.ndarray, float]) -> None:
    with TdmsWriter(file) as writer:
        objects = [
            ChannelObject("g", name, values, properties={"wf_increment": 1 / rate, "unit_string": "m/s^2"})
            for name, (values, rate) in channels.items()
        ]
        writer.write_segment(objects)


@pytest.mark.parametrize(
    ("toml", "says"),
    [
        ({"heel": {}}, "describes the channel 'heel'"),
        ({"base": {"sensitivity": "100 mV per g"}}, "sensitivity = '100 mV per g'"),
        ({"base": {"sensitivity": 0}}, "sensitivity = 0; valid"),
        ({"base": {"unit": "furlong"}}, "unknown unit"),
        ({"base": {"gain": 2}}, r"\[channels\.base\] 'gain'"),
    ],
)
def test_layouts_that_make_no_sense(toml: dict, says: str) -> None:
    with pytest.raises(InputFileError, match=says):
        Layout.from_toml(Path("study.toml"), toml)


def test_contradicting_units_and_missing_sensitivity(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("time,base [g],malleolus_v\ns,mg,V\n0,0,0\n")
    with pytest.raises(InputFileError, match=r"base is in mg \(a unit with the column\), and its heading says g; "):
        Recording.read(tmp_path / "r.csv")
    (tmp_path / "r.csv").write_text("time_s,base_g,malleolus_v\n0,0,0\n")
    with pytest.raises(InputFileError, match="malleolus is in V; give study"):
        Recording.read(tmp_path / "r.csv")


def test_mixed_rates_and_lengths(tmp_path: Path) -> None:
    write_tdms(tmp_path / "a.tdms", base=(BASE, 1000), malleolus=(BASE, 500))
    with pytest.raises(InputFileError, match=r"different rates \(base at 1000 Hz, malleolus at 500 Hz\)"):
        Recording.read(tmp_path / "a.tdms")
    write_tdms(tmp_path / "b.tdms", base=(BASE, 1000), malleolus=(BASE[::2], 500))
    back = Recording.read(tmp_path / "b.tdms")
    assert back.malleolus_m_s2 == pytest.approx(back.base_m_s2, abs=1e-6) and back.rate_hz == pytest.approx(1000)
    assert "malleolus at 500 Hz), resampled to the highest by a spline" in back.warnings[0]
    write_tdms(tmp_path / "b.tdms", base=(BASE, 1000), malleolus=(BASE[:150], 1000))
    with pytest.raises(InputFileError, match=r"different lengths \(base_m_s2 300, malleolus_m_s2 150\)"):
        Recording.read(tmp_path / "b.tdms")
    savemat(tmp_path / "c.mat", {"base_g": BASE, "malleolus_g": BASE})
    with pytest.raises(InputFileError, match="neither a time nor a sampling rate"):
        Recording.read(tmp_path / "c.mat")


def write_uff(file: Path, x: np.ndarray, spacing: int, **channels: np.ndarray) -> None:
    sets = [
        pyuff.prepare_58(
            binary=0, id1=name, func_type=1, rsp_node=1, rsp_dir=1, ref_dir=1, ref_node=1, ord_data_type=4,
            num_pts=x.size, abscissa_spacing=spacing, abscissa_min=0.0, abscissa_inc=0.0 if spacing == 0 else x[1],
            data=values, x=x, ordinate_axis_units_lab="m/s^2", orddenom_spec_data_type=0, z_axis_value=0.0,
            z_axis_spec_data_type=0, ver_num=0, load_case_id=0, rsp_ent_name="foot", ref_ent_name="foot",
            ordinate_spec_data_type=12, abscissa_spec_data_type=17,
        )
        for name, values in channels.items()
    ]  # fmt: skip
    pyuff.UFF(str(file)).write_sets(sets, mode="overwrite")


def test_uff_with_an_uneven_abscissa_keeps_its_times(tmp_path: Path) -> None:
    uneven = T + np.where(np.arange(300) % 2, 3e-4, 0.0)
    write_uff(tmp_path / "r.uff", uneven, 0, base=BASE, malleolus=1.3 * BASE)
    back = Recording.read(tmp_path / "r.uff")
    assert back.time_s == pytest.approx(uneven, abs=1e-6)
    write_uff(tmp_path / "e.uff", T, 0, base=BASE, malleolus=1.3 * BASE)  # uneven by its header, and yet uniform
    assert Recording.read(tmp_path / "e.uff").rate_hz == pytest.approx(1000)


def test_uff_with_times_of_its_own_for_each_channel(tmp_path: Path) -> None:
    """They are brought to those of the base, if they run alike."""
    uneven = T + np.where(np.arange(300) % 2, 3e-4, 0.0)
    write_uff(tmp_path / "a.uff", uneven, 0, base=BASE)

    def joined(x: np.ndarray, spacing: int, values: np.ndarray) -> Recording:
        write_uff(tmp_path / "b.uff", x, spacing, malleolus=values)
        (tmp_path / "c.uff").write_bytes((tmp_path / "a.uff").read_bytes() + (tmp_path / "b.uff").read_bytes())
        return Recording.read(tmp_path / "c.uff")

    late = uneven + 2.2e-3
    back = joined(late, 0, np.sin(2 * np.pi * 20 * late))
    assert back.malleolus_m_s2 == pytest.approx(np.sin(2 * np.pi * 20 * back.time_s), abs=1e-3)
    for x, spacing, says in ((2 * uneven, 0, "different rates"), (T, 1, "channels with uneven times")):
        with pytest.raises(InputFileError, match=says):
            joined(x, spacing, BASE)


def test_a_time_that_wanders_is_not_stored_as_a_rate(tmp_path: Path) -> None:
    for share, written in ((0.03, True), (0.2, False)):
        time = T + np.where(np.arange(300) % 2, share * 1e-3, 0.0)
        recording = Recording(**{**CHANNELS, "time_s": time})
        if written:
            recording.write(tmp_path / f"{share}.uff")
        else:
            with pytest.raises(InputFileError, match=r"time is not uniform; write \.csv or \.h5"):
                recording.write(tmp_path / f"{share}.uff")


def test_a_uff_without_its_end_is_said_to_be_cut_off(tmp_path: Path) -> None:
    Recording(**CHANNELS).write(tmp_path / "r.uff")
    (tmp_path / "r.uff").write_bytes((tmp_path / "r.uff").read_bytes()[:-200])
    with pytest.raises(InputFileError, match="is cut off: its last data set has no end"):
        Recording.read(tmp_path / "r.uff")


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("100 mV/g", 0.1 / 9.80665), ("10.2 mV/m/s^2", 0.0102), ("10.2 mV/(m/s^2)", 0.0102), ("10.2 mV/m/s²", 0.0102),
        ("10.2 mV/(m/s²)", 0.0102), ("0.5 V/(m/s**2)", 0.5), ("10.2mV/(g)", 0.0102 / 9.80665),
    ],
)  # fmt: skip
def test_sensitivities_as_data_sheets_write_them(text: str, factor: float) -> None:
    layout = Layout.from_toml(Path("study.toml"), {"base": {"sensitivity": text}})
    assert layout.channels["base"].volts and layout.channels["base"].sensitivity == pytest.approx(factor)


@pytest.mark.parametrize("text", ["10.2 mV/(m/s^2", "10.2 mV/m/s^2)", "10.2 mV/s", "-- mV/g"])
def test_sensitivities_that_are_none(text: str) -> None:
    with pytest.raises(InputFileError, match=r"valid: a number \(unit per m/s\^2\), "):
        Layout.from_toml(Path("study.toml"), {"base": {"sensitivity": text}})


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ({"Fs": 500.0, "fs": 1000.0}, "two sampling rates, Fs = 500 and fs = 1000"),
        ({"dt": 0.002, "fs": 1000.0}, "two sampling rates, dt = 0.002 and fs = 1000"),
        ({"sampling_rate": 1000.0, "dt": 0.001}, ""),
        ({"sampling_frequency": 1000.0}, ""),
        ({"dt": 0.001}, ""),
    ],
)
@pytest.mark.parametrize("ending", ["mat", "h5", "npz"])
def test_rates_and_intervals_that_disagree_are_named(
    tmp_path: Path, ending: str, told: dict[str, float], says: str
) -> None:
    t = np.arange(3000) / 1000
    columns = {"base_m_s2": np.sin(40 * np.pi * t), "malleolus_m_s2": np.sin(40 * np.pi * t - 0.4)}
    file = tmp_path / f"run.{ending}"
    if ending == "mat":
        savemat(file, columns | told)
    elif ending == "npz":
        np.savez(file, **columns, **told)
    else:
        with h5py.File(file, "w") as out:
            out.attrs.update(told)
            for name, values in columns.items():
                out[name] = values
    if says:
        with pytest.raises(InputFileError, match=says):
            Recording.read(file)
    else:
        assert Recording.read(file).rate_hz == pytest.approx(1000)


def test_attributes_of_hdf5_that_scale_or_shift_a_channel(tmp_path: Path) -> None:
    t = np.arange(3000) / 1000
    start, scaled = tmp_path / "start.h5", tmp_path / "scaled.h5"
    for file, key, value in ((start, "start_time", 0.01), (scaled, "conversion", 0.5)):
        with h5py.File(file, "w") as out:
            out.attrs["fs"] = 1000.0
            for name, own in (("base_m_s2", value - 0.01), ("malleolus_m_s2", value)):
                out[name] = np.sin(40 * np.pi * (t + (own if file == start else 0.0)))
                out[name].attrs[key] = own
    read = Recording.read(start)
    assert np.allclose(read.base_m_s2, read.malleolus_m_s2, atol=1e-3)
    with pytest.raises(InputFileError, match=r"conversion = 0\.49 with 'base_m_s2'"):
        Recording.read(scaled)
