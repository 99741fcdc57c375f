"""The three engines: orbits against a long DOP853 simulation, derivatives against each other and the orbit's own.

And where the twin may stand for a model.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pytest

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import sine
from fasbody.foot.two_dof import NAMES, TwoDof, trajectory
from fasbody.laboratory.foot import TRUTH
from fasbody.recording.checks import checked
from identification.engines.certified import CertifiedRollouts
from identification.engines.engine import Excitation, Whole
from identification.engines.mujoco import Columns, Coordinates, Rollouts
from identification.engines.twin import Twin, twin_applies

EXCITATIONS = [Excitation(f, np.array([-8.95j, 0.1]), oracle.MASSES) for f in (10.0, 30.0, 50.0)]
DISTORTED = [Excitation(f, np.array([8.0, 0.6 - 0.4j, 0.2j]), oracle.MASSES) for f in (12.0, 35.0)]
VALUES = {**oracle.TRUTH, **oracle.MASSES}


def test_steps_divide_the_period() -> None:
    for e in EXCITATIONS:
        assert e.steps * e.step * e.frequency_hz == pytest.approx(1, rel=1e-14)
        assert e.step <= 5e-4 * (1 + 1e-12)
        assert e.steps >= 48


@pytest.mark.parametrize("number", range(3))
def test_both_engines_find_the_settled_motion(foot: Foot, number: int) -> None:
    e = EXCITATIONS[number]
    t = np.concatenate([[0.0], (round(0.8 * e.frequency_hz) + np.arange(e.steps) / e.steps) / e.frequency_hz])
    base = lambda time: float(e.motion.acceleration(np.array([time]))[0])  # noqa: E731
    want = oracle.malleolus(oracle.TRUTH, base, t, rtol=1e-9)[1:]
    twin, _ = Twin(foot, EXCITATIONS).orbit(number, VALUES, (), 1e-9)
    rollouts, _ = Rollouts(foot, EXCITATIONS, ()).orbit(number, VALUES, (), 1e-9)
    peak = np.abs(want).max()
    assert np.abs(twin - want).max() < 2e-4 * peak  # the step of 5e-4 s
    assert np.abs(rollouts - twin).max() < 1e-6 * peak


def test_derivatives_of_both_engines_agree_and_are_those_of_the_orbit(foot: Foot) -> None:
    twin = Twin(foot, EXCITATIONS)
    _, exact = twin.orbit(1, VALUES, NAMES, 1e-10)
    _, differences = Rollouts(foot, EXCITATIONS, NAMES).orbit(1, VALUES, NAMES, 1e-10)
    for j, name in enumerate(NAMES):
        size = 1e-4 * max(1, abs(VALUES[name]))
        up, down = (twin.orbit(1, {**VALUES, name: VALUES[name] + s * size}, (), 1e-10)[0] for s in (1, -1))
        want = (up - down) / (2 * size)
        assert np.abs(exact[:, j] - want).max() < 1e-4 * np.abs(want).max(), name
        assert np.abs(differences[:, j] - want).max() < 1e-3 * np.abs(want).max(), name


def test_a_loose_tolerance_is_corrected_to_first_order(foot: Foot) -> None:
    """Accepted at a gap of 1e-2 or 1e-3, the orbit is off by about the square of the gap, also near the last one."""
    tight, _ = Twin(foot, EXCITATIONS).orbit(1, VALUES, (), 1e-12)
    loose = Twin(foot, EXCITATIONS)
    loose.orbit(1, {**VALUES, "k_T": 1.3e5}, NAMES, 1e-3)
    y, _ = loose.orbit(1, VALUES, NAMES, 1e-3)
    assert np.abs(y - tight).max() < 1e-5 * np.abs(tight).max()


@pytest.mark.parametrize("kind", [Twin, Rollouts, CertifiedRollouts])
def test_nearby_drives_move_the_orbit_as_shooting_afresh_does(foot: Foot, kind: type) -> None:
    """What `reweigh` differences: the change of the output, not the output, has to be right."""
    made = (foot, EXCITATIONS, ()) if kind is Rollouts else (foot, EXCITATIONS)
    engine = kind(*made)
    y, _ = Twin(foot, EXCITATIONS).orbit(1, VALUES, (), 1e-12)
    drives = [replace(EXCITATIONS[1], amplitudes=np.array([-8.95j + 1e-3, 0.1 - 2e-3j]))]
    (moved,) = engine.nearby(1, VALUES, (), drives)
    want, _ = Twin(foot, drives).orbit(0, VALUES, (), 1e-12)
    (still,) = engine.nearby(1, VALUES, (), [EXCITATIONS[1]])
    assert np.abs(moved - still - (want - y)).max() < 1e-3 * np.abs(want - y).max()


def test_no_orbit_is_an_error(foot: Foot) -> None:
    wrong = {**VALUES, "c_11": -2e4, "c_21": -2e4}
    with pytest.raises(SimulationError), np.errstate(all="ignore"):
        Twin(foot, EXCITATIONS).orbit(1, wrong, NAMES, 1e-3)
    with pytest.raises(SimulationError), np.errstate(all="ignore"):
        Rollouts(foot, EXCITATIONS, ()).orbit(1, wrong, (), 1e-3)


@pytest.mark.parametrize("number", [0, 1])
def test_certified_orbits_are_those_of_mujoco(foot: Foot, number: int) -> None:
    values = {**foot.values(), **TRUTH}
    hybrid, plain = CertifiedRollouts(foot, DISTORTED), Rollouts(foot, DISTORTED, NAMES)
    y, D = hybrid.orbit(number, values, NAMES, 1e-9)
    want, differences = plain.orbit(number, values, NAMES, 1e-9)
    assert np.abs(y - want).max() < 1e-8 * np.abs(want).max()
    assert np.abs(hybrid.start(number) - plain.start(number)).max() < 1e-8 * np.abs(plain.start(number)).max()
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(D - differences).max(axis=0) < 2e-4 * scale).all()


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


Edit = Callable[..., Path]


def test_twin_stands_for_the_stock_model_and_harmless_edits(foot: Foot, edited: Edit) -> None:
    assert twin_applies(foot)
    edits = [("4.25 800 -50 100", "4.25 500 20 30"), ('stiffness="1.5e5"', 'stiffness="6e4"')]
    assert twin_applies(load(edited(*edits, ('mass="1.052265"', 'mass="0.9"'))))


@pytest.mark.parametrize(
    "edits",
    [
        [('user="4.25 800 -50 100"', 'user="4.24 1800 60 0.02 0.1"')],
        [("<actuator>", '<tendon><fixed stiffness="2e4"><joint joint="fat_pad" coef="1"/><joint joint="talocrural" '
          'coef="1"/></fixed></tendon>\n<actuator>')],
        [('integrator="RK4"', 'integrator="implicitfast"'),
         ("</sensor>", '<framelinvel name="malleolus_velocity" objtype="site" objname="malleolus"/></sensor>')],
        [('gravity="0 0 0"', 'gravity="0 -9.81 0"')],
        [('name="fat_pad" stiffness="1.0e5"', 'name="fat_pad" stiffness="1.0e5" springref="0.001"')],
        [('name="fat_pad" stiffness="1.0e5"', 'name="fat_pad" stiffness="1.0e5" armature="0.1"')],
        [('    <text name="c_23" data="1/m | 0 | 600 | joint fat_pad user 3 | nominal"/>\n', "")],
    ],
    ids=["other law", "tendon", "integrator", "gravity", "springref", "armature", "undeclared"],
)  # fmt: skip
def test_twin_does_not_stand_for_a_model_that_is_another(edited: Edit, edits: list) -> None:
    assert not twin_applies(load(edited(*edits)))
