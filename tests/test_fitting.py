"""What a fit says about data whose truth is known: two loads, hopeless cases, another model, bounds."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import oracle
import pytest
from steady_cases import BENT, session

from fasbody.console import to_json
from fasbody.exceptions import PeriodicMotionError, RecordingError, SettingError
from fasbody.foot import shaker
from fasbody.foot.model import Foot, load
from fasbody.foot.simulate import simulate
from fasbody.recording.recording import Condition, Recording
from identification import steady
from identification.fitting import Settings, fit_foot
from identification.report import html
from identification.result import FitResult
from viz.fitted import fitted

Trial = Callable[..., Recording]
TRUTH = {name: float(value) for name, value in oracle.TRUTH.items()}
NEARLY_LINEAR = {**TRUTH, "c_12": 3.0, "c_13": 10.0, "c_22": -3.0, "c_23": 10.0}
#: Parameters of the linear foot; the others are held.
LINEAR = ("k_T", "k_F", "c_11", "c_21")
#: Nothing else may be true than the model.
NOTHING_ELSE = {"mass_std": 0.0, "gain_std": 0.0, "delay_std_s": 0.0, "exclude": ("all",)}


def near(result: FitResult, truth: dict[str, float], keys: dict[str, str], allowed: float) -> None:
    for key, name in keys.items():
        e = result.parameters[key]
        assert abs(e.value - truth[name]) < 3 * e.std_error, f"{key}: {e} for {truth[name]}"
        inner = e.if_model_true or e  # with one load, masses are as they were stated or a little off
        assert inner.value == pytest.approx(truth[name], rel=allowed), key


KEYS = {"k_T_n_per_m": "k_T", "k_F_n_per_m": "k_F", "c_11_n_s_per_m": "c_11", "c_21_n_s_per_m": "c_21"}


@pytest.fixture(scope="module")
def light(trial: Trial) -> list[Recording]:
    return [trial(NEARLY_LINEAR, f) for f in (10.0, 20.0, 30.0, 50.0)]


@pytest.mark.long
def test_nearly_linear_damping_is_undecided(foot: Foot, light: list[Recording]) -> None:
    result = fit_foot(light, foot, Settings(starts=2))
    assert result.verdict == "undecided"
    assert "A second load can decide, if the constants do not change" in result.reason
    assert len(result.branches) == 2
    by_name = {b.name: b.parameters for b in result.branches}
    true = by_name["stiff ankle"]["k_T_n_per_m"]
    assert abs(true.value - TRUTH["k_T"]) < 3 * true.std_error


def test_two_loads_separate_the_mirror(foot: Foot, light: list[Recording], trial: Trial) -> None:
    heavy = [trial(NEARLY_LINEAR, f, added=4.5) for f in (20.0, 30.0, 50.0)]
    linear = foot.with_values({n: v for n, v in NEARLY_LINEAR.items() if n not in LINEAR})
    settings = Settings(free=LINEAR, starts=2, **NOTHING_ELSE)  # type: ignore[arg-type]
    two = fit_foot(light + heavy, linear, settings)
    assert two.verdict == "decided"
    assert two.best.name == "stiff ankle"
    near(two, NEARLY_LINEAR, KEYS, 0.03)
    assert not any("second load" in text for text in two.warnings)


def test_a_single_20_hz_recording_tells_little_and_says_so(foot: Foot, trial: Trial) -> None:
    result = fit_foot([trial(TRUTH, 20.0)], foot, Settings(starts=1))
    assert result.verdict == "undecided"
    assert {e.identifiability for b in result.branches for e in b.parameters.values()} == {"not identifiable"}
    assert {row[1] for row in result.sheet().rows} == {"–"} and result.sentence().startswith("No constant is reported")
    document = json.loads(to_json(result.document()))
    assert {p[end] for p in document["parameters"].values() for end in ("lower", "upper", "std_error")} == {None}
    page = html(result)
    assert "identified, model assumed exact" not in page and "– to –" not in page
    shown = fitted(document, foot.parameters)["branches"][0]["rows"]
    assert {row["interval"] for row in shown} == {"–"} and not any("lower" in row for row in shown)
    assert result.excitation_rank == 2
    text = " ".join(result.warnings)
    assert "This recording gives at most 2 numbers on a linear foot" in text
    assert "They cannot determine 8 free parameters" in text
    assert "Fit recordings of several frequencies together." in text
    assert "Not identifiable from these recordings" in text
    assert "One frequency cannot separate a delay" in text
    assert "delay_s" not in result.parameters
    assert result.fit_percent > 98  # and yet the fit percentage is splendid


def test_without_a_periodic_motion_every_sample_is_fitted_if_asked(
    foot: Foot, trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the error advises, --domain time, does not end in the same error."""

    def none(*_: object, **__: object) -> None:
        raise PeriodicMotionError(foot.name, 20.0, 0.44)

    monkeypatch.setattr(steady, "fit", none)
    short = trial(TRUTH, 20.0).between(0.0, 0.5)
    with pytest.raises(PeriodicMotionError, match=r"up to 44 % of the amplitude of the base.*--domain time"):
        fit_foot([short], foot, Settings(starts=1, free=("k_T", "c_11")))
    found = fit_foot([short], foot, Settings(starts=1, free=("k_T", "c_11"), domain="time"))
    assert found.domain == "time" and found.values()["k_T_n_per_m"] > 0


PAD = '<joint name="fat_pad" stiffness="1.0e5" damping="800" user="4.25 800 -50 100"/>'


@pytest.mark.long
def test_a_model_without_twin_is_fitted_in_mujoco_alone(edited: Callable[..., Path], trial: Trial) -> None:
    """The strain-proportional pad of Eq. 4.24: E = 1900 N, eta = 140 N s, recovered from oracle data."""
    E, eta, h, e0 = 1900.0, 140.0, 0.02, 0.15

    def pad(x: float, v: float) -> float:
        e = e0 - x / h
        return E * e0 - (E * e + eta * e * (-v / h) if e > 0 else 0.0)

    c_21 = '<text name="c_21" data="N s/m | 1 | 3e3 | joint fat_pad user 1'
    c_22 = '<text name="c_22" data="1/m | -600 | 600 | joint fat_pad user 2'
    file = edited(
        (PAD, f'<joint name="fat_pad" user="4.24 1200 60 {h} {e0}"/>'),
        (c_21, '<text name="E" data="N | 100 | 2e4 | joint fat_pad user 1'),
        (c_22, '<text name="eta" data="N s | 1 | 2e3 | joint fat_pad user 2'),
    )
    foot = load(file)
    truth = {**TRUTH, "c_12": 50.0, "c_13": 100.0}
    recordings = [trial(truth, f, pad=pad, seconds=1.0) for f in (10.0, 20.0, 40.0)]
    result = fit_foot(recordings, foot, Settings(free=("k_T", "c_11", "E", "eta"), starts=1))
    assert result.twin_mujoco_difference is not None and result.twin_mujoco_difference < 3e-4  # orbit and rollout
    assert result.model == "edited.xml"
    keys = {"k_T_n_per_m": "k_T", "c_11_n_s_per_m": "c_11", "E_n": "E", "eta_n_s": "eta"}
    near(result, {**truth, "E": E, "eta": eta}, keys, 0.03)
    assert result.best.name == "best"
    assert result.best.p_value is not None
    assert result.best.p_value > 1e-3


def test_bounds_are_kept_and_told(foot: Foot, trial: Trial) -> None:
    start = foot.with_values(TRUTH)
    recordings = [trial(TRUTH, f) for f in (10.0, 20.0, 30.0)]
    result = fit_foot(recordings, start, Settings(free=("k_T", "c_11"), bounds={"k_T": (1.4e5, 2e5)}, starts=1))
    e = result.parameters["k_T_n_per_m"]
    assert e.value == pytest.approx(1.4e5, rel=1e-4)
    assert e.at_bound
    assert e.identifiability == "not identifiable"
    assert any(text.startswith("At a bound: k_T") for text in result.warnings)
    assert any("the misfit is larger than the noise" in text for text in result.warnings)


def test_unknown_masses_are_the_models_and_told(foot: Foot, trial: Trial) -> None:
    from dataclasses import replace

    r = replace(trial(TRUTH, 20.0), condition=Condition(frequency_hz=20.0))
    result = fit_foot([r], foot.with_values(TRUTH), Settings(free=("k_T", "k_F"), starts=1))
    assert any("body mass is unknown" in text for text in result.warnings)
    assert result.parameters["k_T_n_per_m"].value == pytest.approx(TRUTH["k_T"], rel=0.02)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (Settings(starts=0), "the number of starts is 0"),
        (Settings(domain="frequency"), r"the domain is 'frequency' \(valid: auto, periodic, time\)"),
        (Settings(free=("k_X",)), "unknown parameter to estimate 'k_X'"),
    ],
)
def test_settings_that_cannot_be_meant(foot: Foot, trial: Trial, settings: Settings, sentence: str) -> None:
    with pytest.raises(SettingError, match=sentence):
        fit_foot([trial(TRUTH, 20.0)], foot, settings)


def test_a_bad_recording_is_refused(foot: Foot, trial: Trial) -> None:
    from dataclasses import replace

    r = trial(TRUTH, 20.0)
    with pytest.raises(RecordingError, match="malleolus_m_s2 is dead"):
        fit_foot([replace(r, malleolus_m_s2=np.zeros(r.time_s.size))], foot)


def test_a_recording_that_can_be_followed_exactly_is(foot: Foot, trial: Trial) -> None:
    """Four numbers for eight constants, of a foot far stiffer than the model's own."""
    stiff = {**TRUTH, "k_T": 3.1e6, "k_F": 3.2e5, "c_11": 1612.0, "c_21": 1892.0}
    found = fit_foot([trial(stiff, 50.0, added=4.5)], foot, Settings(starts=1, bounds={"k_T": (1e4, 1e7)}))
    assert found.best.dof == 0 and found.best.chi_square < 1e-3


@pytest.mark.parametrize("power", [1.0, 3.0])
def test_samples_that_the_model_does_not_follow_decide_and_offer_nothing(foot: Foot, power: float) -> None:
    """A sweep whose malleolus is cubed is no foot's; as it is, the fit offers intervals."""
    motion = simulate(foot, shaker.sweep(10.0, 40.0, 1.0))
    kept, rng = slice(None, None, round(1e-3 / foot.step)), np.random.default_rng(0)
    base, y = motion.base[0, kept], motion.malleolus[0, kept]
    y = np.abs(y).max() * np.sign(y) * np.abs(y / np.abs(y).max()) ** power
    noisy = (x + rng.normal(0, 0.05, x.size) for x in (base, y))
    recording = Recording(np.arange(base.size) / 1000, *noisy, condition=Condition(body_mass_kg=72.57))
    result = fit_foot([recording], foot, free=["k_T", "k_F", "c_11", "c_21"], starts=1, delay=False)
    follows = power == 1.0
    assert result.domain == "time" and result.offered is follows and (result.fit_percent > 85) is follows
    assert ("does not follow" in result.reason) is not follows
    assert ("does not follow" in result.sentence()) is not follows
    assert follows or result.verdict == "undecided"
    assert any("These intervals and odds assume" in text for text in result.warnings) == follows


@pytest.mark.parametrize(("scatter", "decided"), [(2e-4, True), (6e-4, False)])
def test_an_exact_model_that_misses_its_recordings_decides_nothing(foot: Foot, scatter: float, decided: bool) -> None:
    """At odds of more than a million to 1 on both sides; chi-square is 1.2 and 3.7 per degree of freedom."""
    data = session(BENT, (12.0, 25.0, 40.0), (0.0, 4.5), scatter=scatter, second=True)
    result = fit_foot(data, foot, starts=4, threads=1, departures=False)
    assert result.log_likelihood_ratio > np.log(1e6) and (result.verdict == "decided") is decided
    assert ("does not fit the recordings" in result.reason) is not decided
    assert result["k_T"].identifiability == f"{'identified' if decided else 'weak'}, model assumed exact"


@pytest.mark.parametrize(
    ("bends", "second", "verdict"),
    [(0.0, False, "undecided"), (1.0, False, "decided"), pytest.param(1.0, True, "decided", marks=pytest.mark.long)],
)
def test_a_mirror_image_beyond_its_bounds_counts(foot: Foot, bends: float, second: bool, verdict: str) -> None:
    """A linear foot has one that fits as well; of one that bends the data, and not the bounds, speak against it."""
    truth = {**TRUTH, **{name: bends * BENT[name] for name in ("c_12", "c_13", "c_22", "c_23")}}
    data = session(truth, (12.0, 20.0, 28.0, 40.0), second=second)
    result = fit_foot(data, foot, starts=1, threads=1, exclude=("all",), mass_std=0.01, bounds={"k_T": (1.2e5, 1e6)})
    assert (result.best.name, result.verdict) == ("stiff ankle", verdict)
    assert ("limited by the bound of k_T" in result.reason) is (verdict == "undecided")
    rival = result.branches[1].parameters["k_T_n_per_m"]
    assert rival.at_bound and rival.value == pytest.approx(1.2e5)
    for solution in result.evidence.solutions:  # what is reported is what was fitted
        reported = next(b for b in result.branches if b.name == solution.branch).parameters["k_T_n_per_m"]
        assert float(solution.problem.variables.dynamic(solution.q)["k_T"]) == pytest.approx(reported.value, rel=1e-4)
