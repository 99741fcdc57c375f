"""Two sources of one fact: start times are honoured, and statements that disagree are refused, both named."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from fasbody.exceptions import InputFileError, RecordingError, SettingError
from fasbody.recording.channels import Layout
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Recording
from fasbody.recording.sources import gather

RATE, N, LATE = 1000.0, 2000, 2e-3
T = np.arange(N) / RATE
STAMP = np.datetime64("2026-03-04T10:00:00.000000", "us")


def sine(start_s: float = 0.0, size: float = 8.95) -> np.ndarray:
    """What a logger stores that begins `start_s` later."""
    return size * np.sin(2 * np.pi * 20 * (T + start_s))


def phase(recording: Recording) -> float:
    """Malleolus against base [deg] at 20 Hz."""
    fits = [
        fit_harmonics(recording.time_s, x, 20.0, 1).amplitudes[0]
        for x in (recording.base_m_s2, recording.malleolus_m_s2)
    ]
    return float(np.degrees(np.angle(fits[1] / fits[0])))


def tdms(file: Path, values: np.ndarray, **starts: object) -> Path:
    """Base without a start, or with that of `base_*`; malleolus with the others."""
    common = {"wf_increment": 1 / RATE, "unit_string": "m/s^2"}
    early = {key.removeprefix("base_"): value for key, value in starts.items() if key.startswith("base_")}
    later = {key: value for key, value in starts.items() if not key.startswith("base_")}
    with TdmsWriter(file) as writer:
        writer.write_segment(
            [
                ChannelObject("g", "base", sine(), properties=common | early),
                ChannelObject("g", "malleolus", values, properties=common | later),
            ]
        )
    return file


@pytest.mark.parametrize("late", [LATE, 2.37e-3, -LATE])
def test_starts_of_tdms_channels_are_honoured(tmp_path: Path, late: float) -> None:
    """Both channels see one motion; a file read as if they began together would turn it by 14.4 degrees."""
    offset = Recording.read(tdms(tmp_path / "o.tdms", sine(late), wf_start_offset=late, base_wf_start_offset=0.0))
    assert phase(offset) == pytest.approx(0, abs=1e-3)
    later = STAMP + np.timedelta64(round(1e6 * late), "us")
    dated = tdms(tmp_path / "d.tdms", sine(late), wf_start_time=later, base_wf_start_time=STAMP)
    assert phase(Recording.read(dated)) == pytest.approx(0, abs=1e-3)


def test_starts_that_cannot_be_aligned_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"when some channels start \(base 0 s\) and not when 'malleolus' does"):
        Recording.read(tdms(tmp_path / "a.tdms", sine(), base_wf_start_time=STAMP))
    with pytest.raises(InputFileError, match=r"lasts 1\.999 s, too short for the start times of its channels"):
        Recording.read(tdms(tmp_path / "b.tdms", sine(), wf_start_offset=1.0))


def test_abscissa_min_of_uff_is_honoured(tmp_path: Path) -> None:
    sets = [
        pyuff.prepare_58(
            binary=0, id1=name, func_type=1, rsp_node=1, rsp_dir=1, ref_dir=1, ref_node=1, ord_data_type=4, num_pts=N,
            abscissa_spacing=1, abscissa_min=start, abscissa_inc=1 / RATE, data=sine(start), x=T + start,
            ordinate_axis_units_lab="m/s^2", orddenom_spec_data_type=0, z_axis_value=0.0, z_axis_spec_data_type=0,
            ver_num=0, load_case_id=0, rsp_ent_name="f", ref_ent_name="f", ordinate_spec_data_type=12,
            abscissa_spec_data_type=17,
        )
        for name, start in (("base", 0.5), ("malleolus", 0.5 + LATE))
    ]  # fmt: skip
    pyuff.UFF(str(tmp_path / "r.uff")).write_sets(sets, mode="overwrite")
    assert phase(Recording.read(tmp_path / "r.uff")) == pytest.approx(0, abs=1e-3)


def test_rates_that_disagree_are_both_named(tmp_path: Path) -> None:
    twice = Layout(rate_hz=500.0)
    overruled = Recording.read(tdms(tmp_path / "r.tdms", sine()), layout=twice)
    assert overruled.rate_hz == pytest.approx(500)
    assert overruled.warnings == (
        "r.tdms: its rate is 500 Hz as study.toml says, though the file says 1000 Hz.",
    )
    nearly = Recording.read(tdms(tmp_path / "r.tdms", sine()), layout=Layout(rate_hz=1000.4))
    assert nearly.rate_hz == pytest.approx(1000)  # the file's own clock, not the nominal rate
    np.savetxt(tmp_path / "r.csv", np.column_stack([T, sine(), sine()]), delimiter=",", comments="",
               header="time_s,base_m_s2,malleolus_m_s2")  # fmt: skip
    with pytest.raises(InputFileError, match=r"sampling_rate_hz = 500, and its time runs at 1000 Hz"):
        Recording.read(tmp_path / "r.csv", layout=twice)
    for name in ("time_s", "time"):
        savemat(tmp_path / "r.mat", {"fs": 512.0, name: T, "base_m_s2": sine(), "malleolus_m_s2": sine()})
        with pytest.raises(
            InputFileError, match=r"states 512 Hz, and .* (runs at 1000 Hz|steps of its time .* 0\.001)"
        ):
            Recording.read(tmp_path / "r.mat")


def test_a_time_without_unit_is_settled_by_a_rate_or_asked_for(tmp_path: Path) -> None:
    channels = {"time": 1e3 * T, "base_m_s2": sine(), "malleolus_m_s2": sine()}
    savemat(tmp_path / "r.mat", channels | {"fs": RATE})
    assert Recording.read(tmp_path / "r.mat").time_s == pytest.approx(T)
    savemat(tmp_path / "r.mat", channels)
    with pytest.raises(
        InputFileError, match=r"'time' has no unit; name the column time_s, time_ms or time_us, or give"
    ):
        Recording.read(tmp_path / "r.mat")
    told = Layout.from_toml(Path("study.toml"), {"time": {"unit": "ms"}})
    assert Recording.read(tmp_path / "r.mat", layout=told).rate_hz == pytest.approx(RATE)


def top(recording: Recording) -> float:
    """Amplitude of the base [m/s^2]."""
    return float(np.sqrt(2) * recording.base_m_s2.std())


def headed(file: Path, base: str) -> Path:
    np.savetxt(file, np.column_stack([T, sine(size=1.0), sine(size=1.0)]), delimiter=";", comments="",
               header=f"time_s;{base};malleolus_m_s2")  # fmt: skip
    return file


@pytest.mark.parametrize("heading", ["AI0 [g]", "AI0 (g)", "knee_acc_g", "base [g]"])
def test_the_unit_in_a_mapped_heading_is_used_unless_study_toml_overrules_it(tmp_path: Path, heading: str) -> None:
    file = headed(tmp_path / "r.csv", heading)
    bare = Layout.from_toml(Path("s"), {"base": {"column": heading}})
    assert top(Recording.read(file, layout=bare)) == pytest.approx(9.80665)
    other = Layout.from_toml(Path("s"), {"base": {"column": heading, "unit": "m/s^2"}})
    overruled = Recording.read(file, layout=other)
    assert top(overruled) == pytest.approx(1.0)
    assert overruled.warnings == ("r.csv: base is in m/s^2 as study.toml says, though the file says g.",)
    same = Layout.from_toml(Path("s"), {"base": {"column": heading, "unit": "g"}})
    assert top(Recording.read(file, layout=same)) == pytest.approx(9.80665)


def hdf5(file: Path, **attributes: object) -> Path:
    with h5py.File(file, "w") as out:
        out.attrs["rate_hz"] = RATE
        for name in ("base", "malleolus"):
            out[name] = np.round(sine() * 100).astype("i2")
            out[name].attrs["units"] = "m/s^2"
        for key, value in attributes.items():
            out["base"].attrs[key] = value
    return file


def test_scale_factor_of_hdf5_is_applied_once(tmp_path: Path) -> None:
    file = hdf5(tmp_path / "r.h5", scale_factor=0.01, add_offset=np.array([0.5]))
    assert Recording.read(file).base_m_s2 == pytest.approx(sine() + 0.5, abs=0.006)
    again = Layout.from_toml(Path("s"), {"base": {"sensitivity": 100.0}})
    with pytest.raises(InputFileError, match=r"scales 'base' itself \(scale_factor = 0\.01\), and study\.toml gives"):
        Recording.read(file, layout=again)
    with pytest.raises(InputFileError, match=r"says gain = 100 with 'base', and not whether its numbers contain it"):
        Recording.read(hdf5(tmp_path / "g.h5", gain=100.0))
    told = Recording.read(hdf5(tmp_path / "g.h5", gain=100.0), layout=again)
    assert told.base_m_s2 == pytest.approx(sine(), abs=0.006)
    with pytest.raises(InputFileError, match=r"scale_factor of '/base' is no number"):
        Recording.read(hdf5(tmp_path / "t.h5", scale_factor="0.01"))


def test_masses_on_the_knee_are_one_for_all_or_one_a_file(tmp_path: Path) -> None:
    files = [headed(tmp_path / f"{i}.csv", "base_m_s2") for i in range(3)]
    found = gather(files, [70.0], [0.0, 2.3, 4.5])[1]
    assert [r.condition.added_mass_kg for r in found] == [0.0, 2.3, 4.5]
    assert {r.condition.body_mass_kg for r in found} == {70.0}
    assert {r.condition.added_mass_kg for r in gather(files, None, [2.3])[1]} == {2.3}
    with pytest.raises(SettingError, match=r"--added-mass is given 2 times \(0, 2\.3\) for 3 files or folders; valid"):
        gather(files, None, [0.0, 2.3])


def test_a_mass_on_the_command_line_does_not_override_a_study(tmp_path: Path) -> None:
    """Nor is a mass that nobody has blamed on the file."""
    headed(tmp_path / "a.csv", "base_m_s2")
    (tmp_path / "study.toml").write_text("")
    (tmp_path / "subjects.csv").write_text("subject,mass_kg\nx,72.5\n")
    (tmp_path / "recordings.csv").write_text("file,subject,added_mass_kg\na.csv,x,2.3\n")
    for data in (tmp_path, tmp_path / "a.csv"):
        assert gather([data], [72.5], [2.3])[1][0].condition.added_mass_kg == 2.3
        with pytest.raises(SettingError, match=r"a\.csv: recordings\.csv says .* 2\.3 kg, and --added-mass says 3 kg"):
            gather([data], None, [3.0])
        with pytest.raises(SettingError, match=r"subjects\.csv says .* 72\.5 kg, and --body-mass says 80 kg"):
            gather([data], [80.0], None)
    with pytest.raises(RecordingError, match=r"^--body-mass: the body mass is -5 kg; it must lie between"):
        gather([tmp_path], [-5.0], None)
