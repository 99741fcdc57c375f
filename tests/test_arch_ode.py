"""The reduced ODE: energy, small-amplitude limit, convergence, statics."""

from dataclasses import replace

import numpy as np
import pytest

from fasbody.arch import lagrange, linear
from fasbody.arch import ode as arch_ode
from fasbody.arch.bones import DAMPERS, Arch

NOMINAL = Arch.nominal()


def undamped(arch: Arch) -> Arch:
    """No dampers; a dashpot as stiff as c_1 = 1e12 never yields, so that its branch is one more spring."""
    return replace(arch, **dict.fromkeys(DAMPERS, 0.0) | {"c_1": 1e12})


def test_energy_is_conserved_without_dampers() -> None:
    arch = replace(undamped(NOMINAL), k_2=2.0, k_3=2.0, k_4=2.0)  # soft joints: slow enough to follow
    start = arch_ode.initial_state(arch) + np.array([1e-3, 5e-4, 0.05, -0.04, 0.03, 0, 0.1, 0, 1, 0, 0])
    motion = arch_ode.solve(arch, lambda t: 0.0, np.linspace(0, 0.005, 21), initial=start, tolerance=1e-8)
    q_dot = np.column_stack([motion.states[:, 5:10], np.zeros(21)])
    energy = lagrange.kinetic(arch, motion.q, q_dot) + lagrange.potential(arch, motion.q)
    assert np.ptp(motion.states[:, 2]) > 0.02  # it does move
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


def test_small_amplitude_steady_state_is_the_linear_transmissibility() -> None:
    amplitude, f = 1e-3, 25.0
    time = np.linspace(0, 0.4, 401)
    motion = arch_ode.solve(NOMINAL, lambda t: amplitude * np.sin(2 * np.pi * f * t), time, tolerance=1e-8)
    last = slice(360, 400)  # one period
    carrier = np.exp(-2j * np.pi * f * time[last])
    measured = 2j * np.mean(motion.malleolus[last] * carrier) / amplitude
    assert measured == pytest.approx(complex(linear.transmissibility(NOMINAL, np.array(f))), rel=1e-5)


@pytest.mark.long
def test_output_is_the_second_derivative_of_the_malleolus_height() -> None:
    """Eq. (4.13) against differences of y_T from Eq. (4.8)."""
    time = np.linspace(0, 0.03, 3001)
    w, a = 2 * np.pi * 30, 8.95
    motion = arch_ode.solve(NOMINAL, lambda t: a * np.sin(w * t), time, tolerance=1e-10)
    q = motion.q
    height = q[:, 0] + q[:, 1] + sum(
        L * np.cos(q[:, i]) for L, i in ((NOMINAL.L_2, 2), (NOMINAL.L_3, 3), (NOMINAL.L_4, 4))
    )  # fmt: skip
    height -= a / w**2 * np.sin(w * time) - a / w * time
    h = time[1]
    second = (height[2:] - 2 * height[1:-1] + height[:-2]) / h**2
    np.testing.assert_allclose(second[200:], motion.malleolus[1:-1][200:], atol=2e-3 * a)


def test_gravity_settles_at_weight_over_stiffness() -> None:
    motion = arch_ode.solve(NOMINAL, lambda t: 0.0, np.array([0.0, 3.0]), gravity=9.81, tolerance=1e-7)
    weight = (NOMINAL.m_T + NOMINAL.m_F) * 9.81
    assert motion.states[-1, 0] == pytest.approx(-weight / NOMINAL.k_F, rel=1e-4)
    assert motion.states[-1, 1] == pytest.approx(-NOMINAL.m_T * 9.81 / NOMINAL.k_T, rel=1e-4)
    assert motion.states[-1, 10] == pytest.approx(
        lagrange.deformations(NOMINAL, motion.q[-1]).e, rel=1e-4
    )  # the dashpot has yielded to the whole elongation


@pytest.mark.long
def test_energy_lost_is_what_the_dampers_took() -> None:
    start = arch_ode.initial_state(NOMINAL) + np.array([1e-3, 0, 0.05, 0, 0.03, 0, 0, 0, 0, 0, 0])
    time = np.linspace(0, 0.02, 4001)
    motion = arch_ode.solve(NOMINAL, lambda t: 0.0, time, initial=start, tolerance=1e-9)
    q, q_dot, _ = arch_ode.split(NOMINAL, motion.states)
    energy = lagrange.kinetic(NOMINAL, q, q_dot) + lagrange.potential(NOMINAL, q)
    late = time >= 0.001  # the first instants decay faster than the samples resolve
    lost = np.trapezoid(lagrange.dissipated_power(NOMINAL, q, q_dot)[late], time[late])
    assert energy[late][0] - energy[-1] == pytest.approx(lost, rel=1e-5)
