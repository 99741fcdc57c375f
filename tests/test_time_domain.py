"""The choice of domain, and the time step that follows the dampers.

Energies of strongly damped feet against SciPy's LSODA.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import oracle
import pytest
from scipy.integrate import solve_ivp

from fasbody.exceptions import SettingError
from fasbody.foot import hysteresis
from fasbody.foot.model import Foot
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.checks import checked
from fasbody.recording.condition import Condition
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Recording
from identification.parameters import space_of
from identification.setup import choose_domain
from identification.time_domain import TimeDomain, halvings

#: A shaker with some distortion [m/s^2], and what it shakes.
BASE = np.array([-8.95j, 0.13 + 0.05j, 0.07j])
HEAVY = Condition("9", "midstance", 4.5, 70.31, 20.0)
#: Ends of fits of one 20 Hz recording under 4.5 kg, dampers at their bounds: feet that the data do not forbid.
ANKLE_STOPPED = {
    "k_T": 4.967e5, "k_F": 2.078e5, "c_11": 3000.0, "c_12": -130.2, "c_13": 0.0, "c_21": 2599.0, "c_22": 207.9,
    "c_23": 410.9,
}  # fmt: skip
PAD_STOPPED = {
    "k_T": 1.818e5, "k_F": 4.743e5, "c_11": 2613.0, "c_12": 268.6, "c_13": 367.2, "c_21": 3000.0, "c_22": 30.86,
    "c_23": 600.0,
}  # fmt: skip
BOTH_STOPPED = {**PAD_STOPPED, "c_11": 3000.0, "c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0}
FEET = {"ankle": ANKLE_STOPPED, "pad": PAD_STOPPED, "both": BOTH_STOPPED}


def settled(values: dict[str, float], f: float) -> tuple[np.ndarray, complex]:
    """Energies (2,) of ankle and pad in a cycle [J] and Y_1 [m/s^2] by LSODA, integrated along with the motion."""
    two = TwoDof.from_values({**values, **HEAVY.masses})
    omega = 2j * np.pi * f * np.arange(1, BASE.size + 1)

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        u, (z, z_dot) = (np.exp(omega * t) @ BASE).real, (x[:2], x[2:4])
        c_T = two.c_11 * np.exp(-two.c_12 * z[0]) * np.cos(two.c_13 * z[0])
        c_F = two.c_21 * np.exp(-two.c_22 * z[1]) * np.cos(two.c_23 * z[1])
        T, F = two.k_T * z[0] + c_T * z_dot[0], two.k_F * z[1] + c_F * z_dot[1]
        y, turn = -T / two.m_S, 2 * f * np.exp(-omega[0] * t)
        rest = [c_T * z_dot[0] ** 2, c_F * z_dot[1] ** 2, y * turn.real, y * turn.imag]
        return np.array([*z_dot, (F - T) / two.m_F - T / two.m_S, (T - F) / two.m_F - u, *rest])

    t = np.array([30, 31]) / f
    x = solve_ivp(rates, (0, t[1]), np.zeros(8), method="LSODA", rtol=1e-10, atol=1e-13, t_eval=t).y
    energies_and_line = np.diff(x[4:], axis=1)[:, 0]
    return energies_and_line[:2], complex(*energies_and_line[2:])


@pytest.mark.parametrize(("name", "twin"), [("ankle", False), ("pad", True), ("both", True), ("both", False)])
def test_energies_and_fundamental_of_strong_dampers_are_those_of_an_ode_solver(
    foot: Foot, name: str, twin: bool
) -> None:
    """The bars were 3e-4, 5e-5 and 1e-4 of a stepped orbit."""
    values = {**foot.values(), **FEET[name], **HEAVY.masses}
    (ankle, pad), Y_1 = settled(values, 20.0)
    found = hysteresis.cycle(foot, 20.0, BASE, values, twin)
    assert found.ankle.dissipated_j == pytest.approx(ankle, rel=1e-6)
    assert found.fat_pad.dissipated_j == pytest.approx(pad, rel=1e-6)
    assert abs(found.imbalance) < 1e-6
    assert abs(found.malleolus_m_s2 - Y_1) < 1e-6 * abs(Y_1)


def test_halvings_of_a_fourth_order_method_and_of_what_no_step_mends() -> None:
    right, error = np.sin(np.arange(20.0)), np.cos(np.arange(20.0))
    assert halvings(lambda times: right + 1e-6 * error) == 0
    assert halvings(lambda times: right + 0.02 * error / 16**times) == 2  # 1.25e-3, then 7e-5 of change
    assert halvings(lambda times: None if times < 2 else right) == 2
    assert halvings(lambda times: None) == 0
    assert halvings(lambda times: right + error / 2**times) == 0


@pytest.fixture(scope="module")
def strong() -> Recording:
    """A recording of the stopped ankle without noise to speak of, from the ODE solver's own harmonics."""
    two = TwoDof.from_values({**ANKLE_STOPPED, **HEAVY.masses})
    t = np.arange(2000) / 1000.0
    u = np.exp(np.multiply.outer(t + 2.0, 2j * np.pi * 20.0 * np.arange(1, BASE.size + 1)))

    def rates(time: float, x: np.ndarray) -> np.ndarray:
        turning = np.exp(2j * np.pi * 20.0 * np.arange(1, BASE.size + 1) * time)
        return two.rates(time, x, float((turning @ BASE).real))

    x = solve_ivp(rates, (0, 4.0), np.zeros(4), method="LSODA", rtol=1e-9, atol=1e-13, t_eval=t + 2.0).y
    rng = np.random.default_rng(0)
    base, malleolus = ((u @ BASE).real, two.output(x))
    noisy = (channel + rng.normal(0, 1e-3, t.size) for channel in (base, malleolus))
    return checked(Recording(t, *noisy, condition=HEAVY, file="strong.csv", origin="synthetic"))


def test_the_time_domain_refines_alike(foot: Foot, strong: Recording) -> None:
    space = space_of(foot, delay=False)
    domain = TimeDomain(foot, [strong], space, twin=True, threads=1)
    for values, step in ((foot.values(), 5e-4), (ANKLE_STOPPED, 2.5e-4)):
        z = domain.problem().start(space.to_q(space.theta(values)))
        found = domain.refined(z)
        assert (found is domain) == (step == 5e-4)
        assert found.foot.step == pytest.approx(step)
    assert domain.foot.step == foot.step == 5e-4


Trial = Callable[..., Recording]


def test_steady_recordings_are_periodic_and_broadband_ones_are_not(trial: Trial) -> None:
    steady = checked(trial(oracle.TRUTH, 20.0))
    rng = np.random.default_rng(0)
    unknown = replace(steady.condition, frequency_hz=None)
    wide = checked(replace(steady, base_m_s2=rng.normal(0, 5, 3600), condition=unknown))
    assert choose_domain([steady], "auto") == ("periodic", [])
    assert choose_domain([steady, wide], "auto") == ("time", [])
    assert choose_domain([steady], "time") == ("time", [])
    with pytest.raises(SettingError, match=r"20hz\.csv is not periodic.*use --domain time"):
        choose_domain([wide], "periodic")


def test_a_weak_sine_in_noise_is_steady() -> None:
    """Parts of a sine of 0.5 m/s^2 in noise of 1 m/s^2 scatter by 20 %, and by no more than the noise explains."""
    t, rng = np.arange(4000) / 1000, np.random.default_rng(0)
    found = [
        fit_harmonics(t, 0.5 * np.sin(2 * np.pi * 45 * t) + rng.standard_normal(t.size), 45.0, 2) for _ in range(40)
    ]
    assert [each.scatter for each in found] == pytest.approx([0.0] * 40)
    assert [each.onset for each in found] == pytest.approx([0.0] * 40)
    beating = (1 + 0.3 * np.sin(2 * np.pi * 0.7 * t)) * 8 * np.sin(2 * np.pi * 45 * t) + rng.standard_normal(t.size)
    assert fit_harmonics(t, beating, 45.0, 2).scatter == pytest.approx(0.3 / np.sqrt(2), rel=0.15)


def test_a_beating_recording_goes_to_the_time_domain_and_says_why(trial: Trial) -> None:
    steady = checked(trial(oracle.TRUTH, 20.0))
    beat = 1 + 0.2 * np.sin(2 * np.pi * 0.7 * steady.time_s)
    beating = replace(steady, malleolus_m_s2=steady.malleolus_m_s2 * beat)
    domain, why = choose_domain([steady, beating], "auto")
    assert domain == "time"
    assert "is not steady: its amplitude scatters by" in why[0]
    assert choose_domain([beating], "periodic")[0] == "periodic"
