"""MuJoCo's motion with the twin's derivatives: the motion of plain rollouts, the derivatives of their differences."""

from collections.abc import Callable

import numpy as np
import pytest

from fasbody.foot.model import Foot
from fasbody.foot.two_dof import NAMES
from fasbody.laboratory.foot import TRUTH
from fasbody.recording.checks import checked
from fasbody.recording.condition import foot_mass, shank_mass
from identification.engines.certified import CertifiedOrbits, CertifiedRuns
from identification.engines.orbits import Excitation, Rollouts
from identification.engines.runs import TimeRollouts

MASSES = {"m_S": shank_mass(72.57, 2.3), "m_F": foot_mass(72.57)}
EXCITATIONS = [Excitation(f, np.array([8.0, 0.6 - 0.4j, 0.2j]), MASSES) for f in (12.0, 35.0)]


@pytest.mark.parametrize("number", [0, 1])
def test_orbits_are_those_of_mujoco(foot: Foot, number: int) -> None:
    values = {**foot.values(), **TRUTH}
    hybrid, plain = CertifiedOrbits(foot, EXCITATIONS), Rollouts(foot, EXCITATIONS, NAMES)
    y, D = hybrid.orbit(number, values, NAMES, 1e-9)
    want, differences = plain.orbit(number, values, NAMES, 1e-9)
    assert np.abs(y - want).max() < 1e-8 * np.abs(want).max()
    assert np.abs(hybrid.start(number) - plain.start(number)).max() < 1e-8 * np.abs(plain.start(number)).max()
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(D - differences).max(axis=0) < 2e-4 * scale).all()


def test_runs_are_those_of_mujoco(foot: Foot, trial: Callable) -> None:  # type: ignore[type-arg]
    recording = checked(trial(TRUTH, 20.0, seconds=1.0))
    values = {**foot.values(), **TRUTH}
    x0 = np.array([1e-4, -2e-4, 0.01, 0.02])
    y, D = CertifiedRuns(foot, [recording]).run(0, values, NAMES, x0)
    want, differences = TimeRollouts(foot, [recording], NAMES).run(0, values, NAMES, x0)
    assert np.abs(y - want).max() < 1e-8 * np.abs(want).max()
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(D - differences).max(axis=0) < 2e-4 * scale).all()
