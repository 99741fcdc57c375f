"""Differences of MuJoCo rollouts against the twin's exact sensitivities."""

import numpy as np
import oracle
import pytest

from fasbody.foot.model import Foot
from fasbody.foot.shaker import sine
from fasbody.foot.two_dof import NAMES, TwoDof, trajectory
from identification.engines.orbits import Columns, Coordinates


def test_jacobian_equals_the_exact_sensitivities(foot: Foot) -> None:
    names = ("c_12", "k_T", "c_21", "k_F")
    columns, motion, h, n = Columns(foot, names), sine(25.0, 1.0), 5e-4, 160
    assert columns.states == 4  # the base does not count
    x0 = np.array([-6e-4, 4e-4, -0.06, 0.04])  # the model's order: pad first
    d = columns.run(motion.controls(h, n), h, {**oracle.TRUTH, **oracle.MASSES}, x0)
    order = [1, 0, 3, 2]
    foot_ = TwoDof.from_values({**oracle.TRUTH, **oracle.MASSES})
    u = motion.half_steps(h, n)
    Y, DY, x, S = trajectory(x0[order], foot_.theta, foot_.m_S, foot_.m_F, u, h, 1, 12)
    wanted = [4 + NAMES.index(name) for name in names]
    np.testing.assert_allclose(d.y, Y, atol=1e-6 * np.abs(Y).max())
    np.testing.assert_allclose(d.x, x[order], rtol=1e-6)
    for have, want in (
        (d.y_by_state, DY[:, order]), (d.y_by_parameter, DY[:, wanted]),
        (d.x_by_state, S[np.ix_(order, order)]), (d.x_by_parameter, S[np.ix_(order, wanted)]),
    ):  # fmt: skip
        assert (np.abs(have - want).max(axis=0) < 2e-4 * np.abs(want).max(axis=0)).all()


def test_unpack_measures_from_rest_and_leaves_the_base(foot: Foot) -> None:
    qpos, qvel, act = Coordinates(foot).unpack(np.array([[1.0, 2.0, 3.0, 4.0]]))
    assert qpos.tolist() == [[0, 1, 2]]
    assert qvel.tolist() == [[0, 3, 4]]
    assert act.shape == (1, 0)
    assert foot.base == 0


def test_results_do_not_depend_on_the_run_before(foot: Foot) -> None:
    columns, controls = Columns(foot, ("k_T",)), sine(25.0, 1.0).controls(5e-4, 40)
    values = {**oracle.TRUTH, **oracle.MASSES}
    first = columns.run(controls, 5e-4, values, np.zeros(4)).y
    columns.run(controls, 5e-4, {**values, "k_T": 3e4, "k_F": 2e5}, np.full(4, 1e-4))
    np.testing.assert_array_equal(columns.run(controls, 5e-4, values, np.zeros(4)).y, first)
    assert first[-1] != pytest.approx(0)
