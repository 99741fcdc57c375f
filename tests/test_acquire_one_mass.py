"""Both sensors on one mass: gain, delay, noise and the watch's trip, and what a fit then knows of the channel."""

import json
from pathlib import Path

import numpy as np
import pytest
from feeder import refusal

from fasbody.acquire.commands import app
from fasbody.acquire.one_mass import OneMass, rest
from fasbody.exceptions import AcquisitionError, SettingError
from fasbody.recording.recording import Condition, Recording, gain_and_delay
from fasbody.recording.study import Study

RATE = 1000.0


def shaken(hz: float, gain: float = 1.03, delay: float = 2e-4, seed: int = 0, seconds: float = 4.0) -> Recording:
    t = np.arange(round(seconds * RATE)) / RATE
    noise = np.random.default_rng(seed).normal(0, 0.05, (2, t.size))
    base, malleolus = 5 * np.sin(2 * np.pi * hz * t), 5 * gain * np.sin(2 * np.pi * hz * (t - delay))
    return Recording(t, base + noise[0], malleolus + noise[1], condition=Condition(frequency_hz=hz))


def test_gain_and_delay_are_found_within_their_own_deviations() -> None:
    off = []
    for seed in range(60):
        found = OneMass.of([shaken(hz, seed=100 * seed + i) for i, hz in enumerate((10.0, 20.0, 40.0))])
        off.append([(found.gain - 1.03) / found.gain_std, (found.delay_s - 2e-4) / found.delay_std_s])
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all((spread > 0.4) & (spread < 1.3)) and found.gain_std < 2e-3 and found.delay_std_s < 2e-5


@pytest.mark.parametrize(("more", "fits"), [(1.035, True), (1.055, False)])
def test_a_ratio_that_differs_between_frequencies_is_no_mass(more: float, fits: bool) -> None:
    """The largest is 3 % off the mean where one of three is 4.6 % more than the others."""
    recordings = [shaken(10.0, 1.0), shaken(20.0, 1.0), shaken(40.0, more)]
    if fits:
        assert OneMass.of(recordings).gain == pytest.approx(1 + (more - 1) / 3, abs=2e-3)
    else:
        with pytest.raises(AcquisitionError, match=r"1\.05\d at 40 Hz; are both sensors tight"):
            OneMass.of(recordings)


def test_rest_tells_noise_hum_and_what_is_common() -> None:
    t, rng = np.arange(1500) / RATE, np.random.default_rng(1)
    own, shared = rng.normal(0, 0.1, (2, t.size)), rng.normal(0, 0.1, t.size)
    hum = 0.3 * np.sin(2 * np.pi * 50 * t)
    values = np.column_stack([own[0] + shared + 9.81, own[1] + shared + hum])
    found = rest(values, RATE)
    assert found["hum_m_s2"][1] == pytest.approx(0.3, abs=0.03) and found["hum_m_s2"][0] < 0.03
    assert found["noise_m_s2"][0] == pytest.approx(np.hypot(0.1, 0.1), rel=0.1)
    assert rest(values[:, [0]] + own.T, RATE)["common"] > 0.5 > abs(rest(own.T, RATE)["common"])
    assert rest(np.zeros((100, 2)), RATE)["common"] == 0


def test_what_should_be_mended_is_said() -> None:
    sound = OneMass(1.09, 1e-3, 0.0, 1e-5, (10.0, 20.0), off_s=0.9)
    assert sound.remarks() == []
    assert len(OneMass(1.11, 1e-3, 0.0, 1e-5, (10.0, 20.0), off_s=1.1).remarks()) == 2


def test_study_toml_takes_it_and_takes_it_anew(tmp_path: Path) -> None:
    study, found = tmp_path / "study", OneMass(1.03, 2e-3, 2e-4, 1e-5, (10.0, 20.0))
    study.mkdir()
    found.write(study, "measured")
    once = (study / "study.toml").read_text()
    found.write(study, "measured")
    assert (study / "study.toml").read_text() == once and once.count("[channels.malleolus]") == 1
    assert json.loads((study / "check.json").read_text())["gain"] == 1.03
    other = tmp_path / "other"
    other.mkdir()
    (other / "study.toml").write_text('[study]\nname = "x"\n[channels.malleolus]\nsign = -1\n')
    with pytest.raises(SettingError, match=r"put sensitivity = 1\.03, delay_s = 0\.0002"):
        found.write(other, "measured")


@pytest.mark.long
@pytest.mark.usefixtures("patient")
def test_check_on_the_bench_ends_as_the_prior_of_every_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The bench's second sensor has a gain of 1.02, and a study recorded afterwards is read with it taken out."""
    study = tmp_path / "study"
    app(["check", "--simulate", "--seconds", "1", "--frequencies", "15,30", "--out", str(study), "--json"],
        standalone_mode=False)  # fmt: skip
    found = json.loads(capsys.readouterr().out)
    assert found["gain"] == pytest.approx(1.02, abs=4 * found["gain_std"] + 1e-4)
    assert found["delay_s"] == pytest.approx(0, abs=4 * found["delay_std_s"]) and 0 <= found["off_s"] < 1
    assert found["noise_m_s2"] == pytest.approx([0.03, 0.05], rel=0.2) and abs(found["common"]) < 0.2
    app(["record", "--simulate", "--frequency", "20", "--seconds", "1", "--out", str(study)], standalone_mode=False)
    (one,) = Study.read(study).recordings
    raw = np.loadtxt(study / "recordings" / "20hz_0kg.csv", delimiter=",", skiprows=1)[:, 2]
    assert np.std(one.malleolus_m_s2) == pytest.approx(np.std(raw) / found["gain"], rel=1e-3)
    assert gain_and_delay(one, "malleolus", "base") == pytest.approx(
        (found["gain_std"], found["delay_std_s"]), rel=0.01
    )


def test_check_refuses_what_cannot_tell(tmp_path: Path) -> None:
    words = ["check", "--simulate", "--out", str(tmp_path / "x"), "--frequencies"]
    assert "at least two" in refusal(*words, "20,20") and "no numbers" in refusal(*words, "a,b")
