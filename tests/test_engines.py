"""The engines of whole recordings: derivatives against each other, and where the twin may stand for a model."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import oracle
import pytest

from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import sine
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import NAMES, TwoDof
from fasbody.laboratory.foot import TRUTH
from fasbody.recording.checks import checked
from identification.engines.certified import CertifiedRollouts
from identification.engines.engine import Whole
from identification.engines.mujoco import Rollouts
from identification.engines.twin import twin_applies


def test_certified_runs_are_those_of_mujoco(foot: Foot, trial: Callable) -> None:  # type: ignore[type-arg]
    recording = checked(trial(TRUTH, 20.0, seconds=1.0))
    values = {**foot.values(), **TRUTH}
    x0 = np.array([1e-4, -2e-4, 0.01, 0.02])
    drives = [Whole.of(recording, foot)]
    y, D = CertifiedRollouts(foot, drives).run(0, values, NAMES, x0)
    want, differences = Rollouts(foot, drives, NAMES).run(0, values, NAMES, x0)
    assert np.abs(y - want).max() < 1e-8 * np.abs(want).max()
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(D - differences).max(axis=0) < 2e-4 * scale).all()


def test_jacobian_equals_the_exact_sensitivities(foot: Foot) -> None:
    names = ("c_12", "k_T", "c_21", "k_F")
    engine, motion, h, n = Rollouts(foot, [], names), sine(25.0, 1.0), 5e-4, 160
    assert engine.state_scale.size == 4  # the base does not count
    x0 = np.array([-6e-4, 4e-4, -0.06, 0.04])  # the model's order: pad first
    y, D = engine.simulate(motion.controls(h, n), h, {**oracle.TRUTH, **oracle.MASSES}, x0)
    order = [1, 0, 3, 2]
    foot_ = TwoDof.from_values({**oracle.TRUTH, **oracle.MASSES})
    u = motion.half_steps(h, n)
    Y, DY, _, _ = trajectory(x0[order], foot_.theta, foot_.m_S, foot_.m_F, u, h, 1, 12)
    np.testing.assert_allclose(y, Y, atol=1e-6 * np.abs(Y).max())
    want = DY[:, [*order, *(4 + NAMES.index(name) for name in names)]]
    assert (np.abs(D - want).max(axis=0) < 2e-4 * np.abs(want).max(axis=0)).all()


def test_results_do_not_depend_on_the_run_before(foot: Foot) -> None:
    engine, controls = Rollouts(foot, [], ("k_T",)), sine(25.0, 1.0).controls(5e-4, 40)
    values = {**oracle.TRUTH, **oracle.MASSES}
    first, _ = engine.simulate(controls, 5e-4, values, np.zeros(4))
    engine.simulate(controls, 5e-4, {**values, "k_T": 3e4, "k_F": 2e5}, np.full(4, 1e-4))
    np.testing.assert_array_equal(engine.simulate(controls, 5e-4, values, np.zeros(4))[0], first)
    assert first[-1] != pytest.approx(0)


Edit = Callable[..., Path]


def test_twin_stands_for_the_stock_model_and_harmless_edits(foot: Foot, edited: Edit) -> None:
    assert twin_applies(foot)
    softer = ('damping="800" user="4.25 800 -50 100"', 'damping="500" user="4.25 500 20 30"')
    edits = [softer, ('stiffness="1.5e5"', 'stiffness="6e4"')]
    assert twin_applies(load(edited(*edits, ('mass="1.052265"', 'mass="0.9"'))))


@pytest.mark.parametrize(
    "edits",
    [
        [('damping="800" user="4.25 800 -50 100"', 'user="4.24 1800 60 0.02 0.1"')],
        [("<actuator>", '<tendon><fixed stiffness="2e4"><joint joint="fat_pad" coef="1"/><joint joint="talocrural" '
          'coef="1"/></fixed></tendon>\n<actuator>')],
        [('integrator="RK4"', 'integrator="implicitfast"'),
         ("</sensor>", '<framelinvel name="malleolus_velocity" objtype="site" objname="malleolus"/>'
          '<framelinvel name="foot_velocity" objtype="site" objname="foot"/></sensor>')],
        [('gravity="0 0 0"', 'gravity="0 -9.81 0"')],
        [('name="fat_pad" stiffness="1.0e5"', 'name="fat_pad" stiffness="1.0e5" springref="0.001"')],
        [('name="fat_pad" stiffness="1.0e5"', 'name="fat_pad" stiffness="1.0e5" armature="0.1"')],
        [('    <text name="c_23" data="1/m | 0 | 600 | joint fat_pad user 3 | nominal"/>\n', "")],
    ],
    ids=["other law", "tendon", "integrator", "gravity", "springref", "armature", "undeclared"],
)  # fmt: skip
def test_twin_does_not_stand_for_a_model_that_is_another(edited: Edit, edits: list) -> None:
    assert not twin_applies(load(edited(*edits)))
