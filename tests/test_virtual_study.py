"""The virtual study: fast engine against DOP853, truth, reproducibility, trends of section 4.6, broadband."""

import csv
import subprocess
from pathlib import Path

import in_process
import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from fasbody.exceptions import FasError
from fasbody.foot import shaker
from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.recording import moving, steady
from fasbody.laboratory.study import Plan, make
from fasbody.laboratory.subject import BETWEEN, MEAN_MASS_KG, Tuberosity, VirtualSubject, constants, panel
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.study import StudyFolder
from fasbody.transmissibility.estimate import rows

#: A subject without scatter.
MEAN = VirtualSubject(0, MEAN_MASS_KG, dict.fromkeys(BETWEEN, 1.0))
CLEAN = Instrument(noise_base=0.0, noise_malleolus=0.0, bits=40, delay_s=0.0)


@pytest.mark.long
@pytest.mark.parametrize(("f", "mass"), [(10.0, 0.0), (30.0, 2.3), (50.0, 4.5)])
def test_orbit_and_tuberosity_equal_dop853(f: float, mass: float) -> None:
    """One integration of foot and tuberosity together, by another method, from rest to steady state."""
    foot, tuberosity = MEAN.foot(f, mass), Tuberosity.under(mass)
    recording, truth = steady(foot, tuberosity, f, 1.0, CLEAN, np.random.default_rng(3))
    U = fit_harmonics(recording.time_s, recording.base_m_s2, f, 3).amplitudes
    motion = shaker.harmonics(f, U, 3.0)
    w, zeta = 2 * np.pi * tuberosity.frequency_hz, tuberosity.zeta

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        u = float(motion.acceleration(np.array([t]))[0])
        on_shank = -(w**2) * x[4] - 2 * zeta * w * x[5] - foot.output(x[:4])
        return np.concatenate([foot.rates(t, x[:4], u), [x[5], on_shank]])

    t = 1.0 + np.arange(round(10 / f * 1000)) / 1000
    x = solve_ivp(rates, (0, t[-1]), np.zeros(6), method="DOP853", t_eval=t, rtol=1e-9, atol=1e-13, max_step=2e-3).y
    shank = -(w**2) * x[4] - 2 * zeta * w * x[5]
    for name, values in (("malleolus_m_s2", foot.output(x[:4])), ("tuberosity_m_s2", shank)):
        want = fit_harmonics(t, values, f, 3).amplitudes
        have = fit_harmonics(recording.time_s, getattr(recording, name), f, 3).amplitudes
        assert np.abs(have - want).max() < 2e-5 * abs(want[0])
    assert truth["MB"] == pytest.approx(fit_harmonics(t, foot.output(x[:4]), f, 1).amplitudes[0] / U[0], rel=2e-5)


def test_broadband_trajectory_has_the_steady_response_of_its_lines() -> None:
    foot, tuberosity = MEAN.foot(25.0), Tuberosity.under(0.0)
    motion = shaker.sine(25.0, 4.0)
    recording = moving(foot, tuberosity, motion, 2.0, CLEAN, np.random.default_rng(1), settle=1.5)
    _, truth = steady(foot, tuberosity, 25.0, 2.0, Instrument(distortion=(0.0, 0.0)), np.random.default_rng(1))
    fits = {
        name: fit_harmonics(recording.time_s, getattr(recording, f"{name}_m_s2"), 25.0, 1).amplitudes[0]
        for name in ("base", "malleolus", "tuberosity")
    }
    assert fits["malleolus"] / fits["base"] == pytest.approx(truth["MB"], rel=1e-4)
    assert fits["tuberosity"] / fits["base"] == pytest.approx(truth["TB"], rel=2e-4)


@pytest.mark.long
def test_a_study_is_what_its_seed_says_whatever_the_number_of_processes(tmp_path: Path) -> None:
    conditions = (("midstance", 0.0), ("dorsiflexion", 2.3))
    plan = Plan(subjects=2, seconds=0.5, conditions=conditions, frequencies_hz=(20.0, 30.0))
    one, two = make(tmp_path / "one", plan, processes=1), make(tmp_path / "two", plan, processes=2)
    for file in sorted(p.relative_to(one) for p in one.rglob("*") if p.is_file()):
        assert (one / file).read_bytes() == (two / file).read_bytes(), file
    study = StudyFolder.open(one)
    assert (study.origin, len(study.trials)) == ("synthetic", 8)
    assert {t.condition.posture for t in study.trials} == {"midstance", "dorsiflexion"}


def test_estimates_find_the_stored_truth(tmp_path: Path) -> None:
    """With an instrument that only adds noise and quantisation the truth lies within the stated uncertainty."""
    quiet = Instrument(delay_s=0.0, offset_m_s2=0.2)
    under = (("midstance", 2.3),)
    plan = Plan(subjects=3, seconds=2.0, conditions=under, frequencies_hz=(15.0, 40.0), instrument=quiet)
    study = StudyFolder.open(make(tmp_path / "s", plan, processes=1))
    truth = {(r["file"], r["pair"]): r for r in csv.DictReader((tmp_path / "s" / "truth.csv").read_text().splitlines())}
    scores = []
    for trial in study.trials:
        for row in rows(study.read(trial)):
            known = truth[trial.file, row.pair]
            scores.append((row.transmissibility - float(known["transmissibility"])) / row.transmissibility_std)
            scores.append((row.phase_deg - float(known["phase_deg"])) / row.phase_std_deg)
    assert len(scores) == 36
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1, abs=0.35)


@pytest.mark.parametrize("excitation", ["sweep", "multisine", "random"])
def test_broadband_studies_are_analysed_by_h1(tmp_path: Path, excitation: str) -> None:
    plan = Plan(subjects=1, conditions=(("midstance", 0.0),), excitation=excitation, seconds=12.0, file_format="h5")
    study = StudyFolder.open(make(tmp_path / "s", plan, processes=1))
    assert study.trials[0].condition.frequency_hz is None
    found = [r for r in rows(study.read(study.trials[0]), 2.0) if r.pair == "MB" and 15 <= r.frequency_hz <= 50]
    person = panel(1, np.random.default_rng(plan.seed))[0]
    foot = person.foot(25.0, 0.0, "midstance", np.random.default_rng((plan.seed, 1, 0, 0)))
    H = foot.transmissibility(np.array([r.frequency_hz for r in found]))
    assert len(found) >= 15
    known = pd.read_csv(tmp_path / "s" / "truth.csv").set_index(["pair", "frequency_hz"])
    at = [("MB", r.frequency_hz) for r in found]
    assert known.loc[at, "transmissibility"].to_numpy() == pytest.approx(np.abs(H), abs=1e-6)
    assert known.loc[at, "phase_deg"].to_numpy() == pytest.approx(np.degrees(np.angle(H)), abs=1e-4)
    product = known.loc["MB"]["transmissibility"] * known.loc["TM"]["transmissibility"]
    assert product.to_numpy() == pytest.approx(known.loc["TB"]["transmissibility"].to_numpy(), abs=1e-5)
    assert "held at their values at 25 Hz" in study.description
    assert [r.transmissibility for r in found] == pytest.approx(np.abs(H), rel=0.1)  # a nonlinear foot, a lagging strap


def test_constants_follow_the_stated_trends() -> None:
    """Section 4.6: k_T and k_F rise with frequency and load, c_11 falls with frequency, c_21 rises and is larger."""
    f = np.arange(10.0, 55, 5)
    table = {m: {n: np.array([constants(x, m)[n] for x in f]) for n in BETWEEN} for m in (0.0, 2.3, 4.5)}
    for light, heavy in ((0.0, 2.3), (2.3, 4.5)):
        for name in ("k_T", "k_F", "c_21"):
            assert np.all(table[heavy][name] >= table[light][name])
        assert table[heavy]["c_11"][0] > table[light]["c_11"][0]
    for values in table.values():
        assert np.all(np.diff(values["k_T"]) > 0) and np.all(np.diff(values["k_F"]) > 0)
        assert np.all(np.diff(values["c_11"]) < 0) and np.all(values["c_21"] > 0.99 * values["c_11"])
        assert np.ptp(values["k_T"]) > np.ptp(values["k_F"])
    small = abs(table[4.5]["k_T"][0] - table[0.0]["k_T"][0])
    assert small < 0.02 * abs(table[4.5]["k_T"][-1] - table[0.0]["k_T"][-1])  # the loads differ little at 10 Hz


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"conditions": (("tiptoe", 0.0),)}, "unknown posture 'tiptoe'"),
        ({"excitation": "hammer"}, "unknown excitation"),
        ({"file_format": "xls"}, "unknown format"),
        ({"subjects": 0}, r"--subjects 0 makes no study \(valid: 1 to 10000\)"),
        ({"seconds": 0.1}, r"--seconds 0\.1 makes no study \(valid: 0\.5 to 3600 s\)"),
        ({"peak_to_peak": float("nan")}, r"--peak-to-peak nan makes no study \(valid: 0\.1 to 60 m/s\^2\)"),
        ({"frequencies_hz": (500.0,)}, "0.5 to 100 Hz"),
        ({"conditions": (("midstance", 90.0),)}, "0 to 20 kg"),
        ({"conditions": (("midstance", float("nan")),)}, "--added-mass: the added mass is nan kg"),
        ({"conditions": (("midstance", 2.3), ("midstance", 2.3))}, r"--added-mass 2\.3 is given twice"),
        ({"frequencies_hz": (float("nan"),)}, "--frequency: a frequency of nan makes no recording"),
    ],
)
def test_plans_that_make_no_study(wrong: dict, says: str) -> None:
    with pytest.raises(FasError, match=says):
        Plan(**wrong).check()


def test_command_and_its_refusals(tmp_path: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return in_process.command("fasbody.laboratory", str(tmp_path / "s"), *arguments)

    slow = ("--frequency", "5", "--peak-to-peak", "8")  # what the thesis left for later
    done = run("--subjects", "1", *slow, "--posture", "midstance", "--format", "mat")
    assert done.returncode == 0, done.stderr
    study = StudyFolder.open(tmp_path / "s")
    assert [t.condition.added_mass_kg for t in study.trials] == [0.0, 2.3, 4.5]
    assert np.ptp(study.read(study.trials[0]).base_m_s2) == pytest.approx(8, rel=0.1)
    refused = run("--excitation", "sweep")
    assert refused.returncode == 2 and "need --subjects" in refused.stderr and "Traceback" not in refused.stderr
