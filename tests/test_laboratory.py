"""The virtual laboratory: its truth, its instrument, and the bundled study made again bit for bit."""

import itertools
import json
from pathlib import Path
from typing import Any

import in_process
import numpy as np
import oracle
import pytest
import thesis

from fasbody.exceptions import FasError
from fasbody.foot import shaker
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory import foot as laboratory
from fasbody.laboratory.foot import TRUTH, make_study, record
from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.study import FREQUENCIES_HZ
from fasbody.recording.recording import Recording
from fasbody.recording.study import BUNDLED, Study

SILENT = Instrument(noise_base=0.0, noise_malleolus=0.0, bits=30, delay_s=0.0)


@pytest.mark.long
def test_the_bundled_study_is_made_by_the_stated_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every fifth recording and all descriptions, from the command that its truth states.

    The others are made of a foot that stands still: it takes as many numbers of the seed, and no time.
    """
    words = json.loads((BUNDLED / "truth.json").read_text())["command"].split()
    assert words[:4] == ["python", "-m", "fasbody.laboratory", "FOLDER"]
    options: dict[str, list[float]] = {}
    for name, value in zip(words[4::2], words[5::2], strict=True):
        options.setdefault(name, []).append(float(value))
    loads, loaded = options["--added-mass"], options["--loaded-frequency"]
    numbers, moved = itertools.count(), laboratory.exact

    def exact(foot: TwoDof, motion: shaker.BaseMotion, seconds: float, *more: Any) -> Recording:
        if next(numbers) % 5 == 0:
            return moved(foot, motion, seconds, *more)
        t = np.arange(round(1000 * seconds)) / 1000
        return Recording(t, np.zeros(t.size), np.zeros(t.size))

    monkeypatch.setattr(laboratory, "exact", exact)
    make_study(tmp_path, 16, added_masses_kg=loads, seconds=4.0, seed=16, loaded_frequencies_hz=loaded)
    names = {str(file.relative_to(BUNDLED)) for file in BUNDLED.rglob("*") if file.is_file()}
    assert names == {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*") if file.is_file()}
    made = [f"recordings/{f:g}hz_{m:g}kg.csv" for i, m in enumerate(loads) for f in (loaded if i else FREQUENCIES_HZ)]
    assert set(made) < names and len(made[::5]) > 2 and "2.3kg" in made[::5][-1]
    for name in names - (set(made) - set(made[::5])):
        assert (tmp_path / name).read_text() == (BUNDLED / name).read_text(), name


def test_the_truth_is_stored_and_bundled() -> None:
    truth = json.loads((BUNDLED / "truth.json").read_text())
    assert truth["origin"] == "synthetic"
    assert truth["parameters"] == TRUTH == {k: float(v) for k, v in oracle.TRUTH.items()}
    assert truth["instrument"]["bits"] == 12
    assert 0 < truth["instrument"]["delay_s"] < 1e-3  # a fraction of a sample
    assert tuple(FREQUENCIES_HZ) == thesis.FREQUENCIES_HZ


@pytest.mark.parametrize("settle", [0.0, 0.3])
def test_a_silent_instrument_records_the_physics(settle: float) -> None:
    foot = TwoDof(**TRUTH, **oracle.MASSES)
    made = record(foot, shaker.sine(20.0, 2.0), 0.2, SILENT, np.random.default_rng(0), settle)
    t = np.concatenate([[0.0], made.time_s + settle])[0 if settle else 1 :]
    want = oracle.malleolus(oracle.TRUTH, oracle.sine(20.0), t)[1 if settle else 0 :]
    assert np.abs(made.malleolus_m_s2 - want).max() < 1e-6 * np.abs(want).max()
    assert np.abs(made.base_m_s2 - 8.95 * np.sin(40 * np.pi * (made.time_s + settle))).max() < 1e-6
    assert made.origin == "synthetic"


def test_the_malleolus_channel_is_late_by_the_delay() -> None:
    foot = TwoDof(**TRUTH, **oracle.MASSES)
    late = Instrument(noise_base=0.0, noise_malleolus=0.0, bits=30, delay_s=5e-4)
    args = (foot, shaker.sine(20.0, 2.0), 0.2)
    a = record(*args, SILENT, np.random.default_rng(0)).malleolus_m_s2
    b = record(*args, late, np.random.default_rng(0)).malleolus_m_s2
    turn = np.exp(-2j * np.pi * 20 * np.arange(200) / 1000)
    assert np.angle((b * turn).sum() / (a * turn).sum()) == pytest.approx(-2 * np.pi * 20 * 5e-4, rel=1e-3)


def test_instrument_quantises_clips_and_adds_noise() -> None:
    instrument, rng = Instrument(noise_base=0.0), np.random.default_rng(0)
    step = 2 * 39.2 / 4096
    values = instrument.measure(np.linspace(-50, 50, 5001), 0.0, rng)
    assert np.allclose(values / step, np.round(values / step), atol=1e-9)
    assert (values.min(), values.max()) == (-39.2, 39.2 - step)
    inside = np.abs(np.linspace(-50, 50, 5001)) < 39
    assert np.abs(values - np.linspace(-50, 50, 5001))[inside].max() <= step / 2 + 1e-12
    noisy = instrument.measure(np.zeros(20_000), 0.05, rng)
    assert noisy.std() == pytest.approx(np.hypot(0.05, step / np.sqrt(12)), rel=0.02)


def test_shaker_harmonics_and_peak_to_peak() -> None:
    motion = Instrument().motion(20.0, 1.0, np.random.default_rng(0))
    spectrum = 2 / 1000 * np.abs(np.fft.rfft(motion.acceleration(np.arange(1000) / 1000)))
    np.testing.assert_allclose(spectrum[[20, 40, 60]], 8.95 * np.array([1, 0.015, 0.008]), rtol=1e-9)


def test_study_with_two_loads(tmp_path: Path) -> None:
    make_study(tmp_path, subject=7, frequencies_hz=(20.0,), added_masses_kg=(0.0, 2.3), seconds=0.5, seed=3)
    study = Study.read(tmp_path)
    assert [r.condition.added_mass_kg for r in study] == [0.0, 2.3]
    assert {r.condition.body_mass_kg for r in study} == {54.43}
    light, heavy = (np.abs(np.fft.rfft(r.malleolus_m_s2)[10]) for r in study)
    H = [oracle.linear_response({**oracle.TRUTH, **r.condition.masses}, 20.0)[0] for r in study]
    assert heavy / light == pytest.approx(abs(H[1] / H[0]), rel=0.1)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"subject": 21}, "there is no subject 21; Table 2.1 has 1 to 20"),
        ({"frequencies_hz": (200.0,)}, "a frequency of 200 cannot be recorded at 1000 Hz"),
        (
            {"frequencies_hz": (10.0,), "seconds": 0.2},
            r"a length of 0.2 is no recording of 10 Hz \(valid: 0.3 to 3600 s\)",
        ),
        ({"frequencies_hz": (float("nan"),)}, "a frequency of nan cannot be recorded"),
        ({"seconds": float("nan")}, "a length of nan is no recording"),
        ({"added_masses_kg": (float("nan"),)}, "--added-mass: the added mass is nan kg; it must lie between 0 and 100"),
        ({"added_masses_kg": (0.0, float("inf"))}, "--added-mass: the added mass is inf kg"),
        ({"added_masses_kg": (-3.0,)}, "--added-mass: the added mass is -3 kg"),
        ({"added_masses_kg": (2.3, 2.3)}, "--added-mass 2.3 is given twice"),
        ({"loaded_frequencies_hz": (float("inf"),)}, "--loaded-frequency: a frequency of inf cannot be recorded"),
        ({"frequencies_hz": (-20.0,)}, "--frequency: a frequency of -20 cannot be recorded"),
    ],
)
def test_impossible_studies_get_a_sentence(tmp_path: Path, options: dict, sentence: str) -> None:
    with pytest.raises(FasError, match=sentence):
        make_study(tmp_path / "s", **options)
    assert not (tmp_path / "s").exists()


def test_command(tmp_path: Path) -> None:
    command = in_process.command
    done = command("fasbody.laboratory", str(tmp_path / "s"), "--frequency", "30", "--seconds", "0.3")
    assert done.returncode == 0, done.stderr
    assert "1 synthetic recording in" in done.stderr.replace("\n", " ")
    assert [r.condition.frequency_hz for r in Study.read(tmp_path / "s")] == [30.0]
    (tmp_path / "s" / "truth.csv").write_text("of a whole study")
    (tmp_path / "s" / "mine.txt").write_text("kept")
    refused = command("fasbody.laboratory", str(tmp_path / "s"), "--frequency", "300")
    assert refused.returncode == 2 and len(Study.read(tmp_path / "s").recordings) == 1
    other = command("fasbody.laboratory", str(tmp_path / "s"), "--frequency", "40", "--seconds", "0.3")
    assert "replaced the study that was there, 1 recording" in other.stderr.replace("\n", " ")
    assert [p.name for p in (tmp_path / "s" / "recordings").iterdir()] == ["40hz_0kg.csv"]
    assert (tmp_path / "s" / "mine.txt").exists() and not (tmp_path / "s" / "truth.csv").exists()
    (tmp_path / "s" / "truth.json").unlink()
    again = command("fasbody.laboratory", str(tmp_path / "s"))
    assert again.returncode == 2
    assert "holds a study that was not made here" in again.stderr
    assert "Traceback" not in again.stderr
