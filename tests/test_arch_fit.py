"""The five-body arch in a fit: MuJoCo alone, against motion from the analytic equations."""

from dataclasses import replace

import numpy as np
import pytest
from steady_cases import BENT, session

from fasbody.arch.bones import Arch
from fasbody.exceptions import RecordingError
from fasbody.foot import shaker
from fasbody.foot.model import load
from fasbody.foot.simulate import simulate
from fasbody.recording.recording import Condition, Recording
from identification.fitting import Settings, fit_foot


def recording(foot_values: dict[str, float], frequency: float, rng: np.random.Generator) -> Recording:
    """The last second of three, from a finer step than the fit uses."""
    foot = load("foot_arch").with_values(foot_values)
    step = 2.5e-5
    out = simulate(foot, shaker.sine(frequency, 2.0), step=step)
    kept = slice(round(1.0 / step), None, round(1e-3 / step))
    base, malleolus = out.base[0, kept], out.malleolus[0, kept]
    noisy = (values + rng.normal(0, 0.05, values.size) for values in (base, malleolus))
    return Recording(np.arange(base.size) / 1000, *noisy, condition=Condition(body_mass_kg=72.57))


def test_a_load_that_no_parameter_carries_is_refused() -> None:
    """The mounted arch is made for its load; a fit under another would leave it out in silence."""
    data = session(BENT, (20.0, 30.0), (2.3,))
    with pytest.raises(RecordingError, match=r"20hz_2.3kg.csv: was recorded under 2.3 kg"):
        fit_foot(data, load("mounted_arch"), starts=1)


@pytest.mark.long
def test_fit_of_named_arch_parameters_recovers_them() -> None:
    """The step of the model errs by some 1e-4 of the peak, more than the noise of a long record: 1 % is what counts."""
    truth = {"k_F": 1.4e5, "c_F": 2200.0, "m_T": 0.0465 * 72.57}
    rng = np.random.default_rng(4)
    data = [recording(truth, frequency, rng) for frequency in (20.0, 40.0)]
    result = fit_foot(data, load("foot_arch"), Settings(departures=False, free=("k_F", "c_F"), starts=1, delay=False))
    assert result.parameters["k_F_n_per_m"].value == pytest.approx(1.4e5, rel=0.01)
    assert result.parameters["c_F_n_s_per_m"].value == pytest.approx(2200.0, rel=0.01)
    assert result.verdict == "not compared"
    assert result.twin_mujoco_difference is not None and result.twin_mujoco_difference < 3e-4  # orbit and rollout


def test_parameters_of_the_model_reach_the_equations() -> None:
    changed = load("foot_arch").with_values({"k_F": 1.4e5, "c_F": 2200.0, "k_2": 300.0})
    arch = Arch.from_model(changed.model)
    assert (arch.k_F, arch.c_F, arch.k_2) == pytest.approx((1.4e5, 2200.0, 300.0))
    assert replace(arch, k_F=1e5, c_F=3000.0, k_2=230.0) == Arch.from_model(load("foot_arch").model)


def test_a_leg_under_a_load_is_fitted_with_whatever_else_may_be_true() -> None:
    """The model declares the load: it stays on the knee while the foot's mass is estimated beside the constants."""
    foot, data, rng = load("leg"), [], np.random.default_rng(0)
    every = round(1e-3 / foot.step)
    for frequency, added in ((15.0, 0.0), (25.0, 2.3)):
        out = simulate(foot.with_values({"m_F": 0.0145 * 72.57, "added_mass": added}), shaker.sine(frequency, 0.9))
        kept = slice(out.time.size // 3, None, every)
        noisy = (values[0, kept] + rng.normal(0, 0.05, values[0, kept].size) for values in (out.base, out.malleolus))
        data.append(Recording(out.time[0, kept], *noisy, condition=Condition("", "midstance", added, 72.57)))
    result = fit_foot(data, foot, free=("k_F",), starts=1)
    assert result.departures.follows and result["k_F"].identifiability == "identified"
    assert result["k_F"].value == pytest.approx(foot.values()["k_F"], rel=0.02)
    named = [row[0] for row in result.sheet().rows] + list(result.parameters)
    assert {"k_F [N/m]", "delay [s]", "m_F [kg]", "delay_s"} <= set(named)
    foot.with_values(dict.fromkeys(named, 1.0))  # whatever a fit prints
