"""Closure, positions and deformations against plain geometry."""

import numpy as np
import pytest

from fasbody.arch import kinematics
from fasbody.arch.bones import Arch
from fasbody.exceptions import SimulationError
from simulator.arch import poses

ARCH = Arch.nominal()


def joints(q: np.ndarray) -> np.ndarray:
    """Heel, apex, two joints and metatarsal heads of one pose, walked link by link from the heads backwards."""
    L, angles = (ARCH.L_4, ARCH.L_3, ARCH.L_2), q[[4, 3, 2]]
    points = [np.array([0.0, q[0]])]
    for length, angle in zip(L, angles, strict=True):
        points.append(points[-1] + length * np.array([-np.sin(angle), np.cos(angle)]))
    drop = points[-1][1] - q[0]
    points.append(points[-1] - [np.sqrt(ARCH.L_1**2 - drop**2), drop])
    return np.array(points[::-1]) - [points[3][0], 0]


@pytest.fixture(scope="module")
def q() -> np.ndarray:
    return poses(ARCH, np.random.default_rng(0), 40)[0]


def test_aponeurosis_spans_heel_to_heads(q: np.ndarray) -> None:
    span = [np.linalg.norm(joints(pose)[-1] - joints(pose)[0]) for pose in q]
    np.testing.assert_allclose(kinematics.deformations(ARCH, q).e, np.array(span) - ARCH.l_0, atol=1e-15)
    assert ARCH.l_0 == pytest.approx(0.16665, abs=5e-6)


def test_arms_of_the_aponeurosis_at_rest() -> None:
    """L_i sin(theta_1 + theta_i) / sin theta_1."""
    arch = ARCH
    expected = [
        L * np.sin(arch.theta_10 + angle) / np.sin(arch.theta_10)
        for L, angle in ((arch.L_2, arch.theta_20), (arch.L_3, arch.theta_30), (arch.L_4, arch.theta_40))
    ]
    np.testing.assert_allclose(kinematics.gradients(arch, kinematics.rest(arch)).e[2:5], expected, rtol=1e-13)
    np.testing.assert_allclose(np.array(expected) * 1e3, [13.19, 24.79, 59.41], atol=0.005)


def test_an_arch_that_cannot_close_says_so() -> None:
    with pytest.raises(SimulationError, match="cannot close"):
        kinematics.arms(ARCH, np.zeros(6))
