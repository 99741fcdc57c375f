"""The stepped arch against the reduced ODE (Radau): accuracy, order, and random arches that must all stay finite."""

from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mjcf
from fasbody.arch import linear
from fasbody.arch import ode as arch_ode
from fasbody.arch.bones import PARAMETERS, Arch
from fasbody.arch.kinematics import deformations
from fasbody.arch.motion import move
from fasbody.exceptions import SimulationError
from fasbody.foot.model import load
from fasbody.foot.shaker import harmonics
from simulator import bends
from simulator.arch import with_constants

FOOT = load("foot_arch")
DURATION = 0.1


def table(frequency: float):
    return harmonics(frequency, [-8.95j], DURATION)


@cache
def oracle(frequency: float) -> np.ndarray:
    """Malleolus acceleration every 1e-4 s."""
    omega, time = 2 * np.pi * frequency, 1e-4 * np.arange(1000)
    return arch_ode.solve(Arch.nominal(), lambda t: 8.95 * np.sin(omega * t), time, tolerance=1e-8).malleolus


@pytest.mark.parametrize("frequency", [30.0, *(pytest.param(f, marks=pytest.mark.long) for f in (10.0, 50.0))])
def test_default_and_accurate_mode(frequency: float) -> None:
    plain, accurate = move(FOOT, table(frequency)), move(FOOT, table(frequency), accurate=True)
    exact = oracle(frequency)
    assert plain.note == accurate.note == ""
    assert np.abs(plain.malleolus - exact).max() < 1e-3 * np.abs(exact).max()
    assert np.abs(accurate.malleolus - exact).max() < 2e-4 * np.abs(exact).max()


def test_accurate_mode_is_of_second_order_and_the_plain_one_of_first() -> None:
    exact, steps = oracle(30.0), (5e-5, 2.5e-5, 1.25e-5)
    orders = {}
    for accurate in (False, True):
        motions = [move(FOOT, table(30.0), step, accurate) for step in steps]
        errors = [np.abs(m.malleolus[:: round(1e-4 / m.step)] - exact).max() for m in motions]
        orders[accurate] = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[False] == pytest.approx([1, 1], abs=0.2)
    assert orders[True].min() > 1.6
    assert orders[True][1] > 1.8  # 1.25, 1.73, 1.85, ... from 1e-4 s downwards


def test_constants_arrive() -> None:
    arch = Arch.draw(np.random.default_rng(0), 0.015)
    read = Arch.from_model(with_constants(FOOT, arch).model)
    for name in PARAMETERS:
        assert getattr(read, name) == pytest.approx(getattr(arch, name), rel=1e-12)
    assert asdict(Arch.from_model(FOOT.model))["k_2"] == 230  # the original is untouched


@pytest.mark.parametrize("lever_arm_m", [None, 0.015], ids=["literal", "15 mm"])
def test_random_arches_stay_finite_and_near_the_linear_response(lever_arm_m: float | None) -> None:
    rng, changed = np.random.default_rng(0), 0
    for _ in range(30):
        arch = Arch.draw(rng, lever_arm_m)
        motion = move(with_constants(FOOT, arch), table(50.0))
        changed += bool(motion.note)
        last = motion.malleolus[-200:]
        carrier = np.exp(-2j * np.pi * 50 * motion.time[-200:])
        amplitude = np.abs(2 * np.mean(last * carrier)) / 8.95
        assert np.isfinite(motion.malleolus).all()
        # a light damper has not forgotten the start after five periods
        assert amplitude == pytest.approx(np.abs(linear.transmissibility(arch, np.array(50.0))), rel=0.5, abs=0.1)
    assert changed == 0 or lever_arm_m is None


def test_hopeless_arch_says_so() -> None:
    impossible = replace(Arch.nominal(), k_T=1e16, c_T=0.0)
    with pytest.raises(SimulationError, match="unstable down to a step of"):
        move(with_constants(FOOT, impossible), table(30.0))


def test_the_file_with_bends_is_made_of_the_arch() -> None:
    assert mjcf.path("foot_arch_bent").read_text() == bends.mjcf()


def bent(arch: Arch, state: np.ndarray) -> Arch:
    """The arch whose dampers are what c_1 exp(-c_2 x) cos(c_3 x) is in a state (11,)."""
    q = np.concatenate([state[:5], state[10:]])
    d = deformations(arch, q)
    laws = {"F": (q[0], -50, 100), "T": (q[1], 50, 100), "2": (d.d_2, 2, 4), "3": (d.d_3, 2, 4), "4": (d.d_4, 2, 4)}
    now = {f"c_{i}": getattr(arch, f"c_{i}") * np.exp(-b * x) * np.cos(c * x) for i, (x, b, c) in laws.items()}
    return replace(arch, **now)


def test_bends_against_the_equations_with_dampers_that_bend() -> None:
    """The native callback carries them: the motion follows the bent equations, and not the linear ones."""
    foot, frequency, time = load("foot_arch_bent"), 20.0, 1e-4 * np.arange(500)
    arch, w = Arch.from_model(foot.model), 2 * np.pi * frequency
    assert arch == Arch.nominal()
    run = solve_ivp(
        lambda t, x: arch_ode.state_rate(bent(arch, x), x, 8.95 * np.sin(w * t)), (0, time[-1]),
        arch_ode.initial_state(arch), method="Radau", t_eval=time, rtol=1e-7, atol=1e-7 * arch_ode.SCALE,
        jac=lambda t, x: arch_ode.jacobian(bent(arch, x), x, 8.95 * np.sin(w * t)),
    )  # fmt: skip
    exact = [
        arch_ode.malleolus_acceleration(bent(arch, x), x, 8.95 * np.sin(w * t))
        for t, x in zip(time, run.y.T, strict=True)
    ]
    peak = np.abs(exact).max()
    have = move(foot, table(frequency), accurate=True).malleolus[:500]
    assert np.abs(have - exact).max() < 2e-4 * peak
    assert np.abs(move(FOOT, table(frequency)).malleolus[:500] - exact).max() > 1e-3 * peak
