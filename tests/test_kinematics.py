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


def test_heel_and_heads_stay_at_one_height(q: np.ndarray) -> None:
    theta_1 = kinematics.closing_angle(ARCH, q)
    E_2 = kinematics.arms(ARCH, q).E_2
    np.testing.assert_allclose(ARCH.L_1 * np.cos(theta_1), E_2, rtol=1e-13)
    for pose, angle in zip(q, theta_1, strict=True):
        heel = joints(pose)[0]
        np.testing.assert_allclose(heel[0], -ARCH.L_1 * np.sin(angle), rtol=1e-12)
        np.testing.assert_allclose(heel[1], pose[0], atol=1e-15)


def test_centres_lie_in_the_middle_of_each_link(q: np.ndarray) -> None:
    centres = kinematics.centres(ARCH, q, y_B=0.02)
    for pose, centre in zip(q, centres, strict=True):
        points = joints(pose) + np.array([0, 0.02])
        np.testing.assert_allclose(centre[1:], (points[1:] + points[:-1]) / 2, atol=1e-15)
        np.testing.assert_allclose(centre[0], [0, points[1][1] + pose[1]], atol=1e-15)


def test_relative_coordinates_invert(q: np.ndarray) -> None:
    y_F, y_T = kinematics.absolute(ARCH, q, 0.3)
    z_F, z_T = kinematics.relative(ARCH, q, y_F, y_T, 0.3)
    np.testing.assert_allclose([z_F, z_T], [q[:, 0], q[:, 1]], atol=1e-16)


def test_aponeurosis_spans_heel_to_heads(q: np.ndarray) -> None:
    span = [np.linalg.norm(joints(pose)[-1] - joints(pose)[0]) for pose in q]
    np.testing.assert_allclose(kinematics.deformations(ARCH, q).e, np.array(span) - ARCH.l_0, atol=1e-15)
    assert ARCH.l_0 == pytest.approx(0.16665, abs=5e-6)


def test_gradients_by_complex_steps(q: np.ndarray) -> None:
    step = 1e-30
    gradients = kinematics.gradients(ARCH, q)
    for i, unit in enumerate(np.eye(6)):
        moved = kinematics.deformations(ARCH, q + 1j * step * unit)
        for name in ("e", "d_2", "d_3", "d_4"):
            slope = np.imag(getattr(moved, name)) / step
            np.testing.assert_allclose(getattr(gradients, name)[:, i], slope, rtol=1e-12, atol=1e-15)
        slope = kinematics.closing_angle(ARCH, q + 1j * step * unit).imag / step
        ours = kinematics.closing_gradient(ARCH, q)
        np.testing.assert_allclose(ours[:, i - 2] if 2 <= i <= 4 else 0, slope, rtol=1e-12, atol=1e-15)


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
