"""Ends replayed in MuJoCo: on the orbit, at a step that is fine enough, with springs that relax; or left out."""

import numpy as np
import pytest
from steady_cases import BENT, BOTH, problem, recorded, session
from test_time_domain import ANKLE_STOPPED

from fasbody.exceptions import SimulationError, UnstableError
from fasbody.foot.model import Foot
from fasbody.foot.simulate import Batch
from identification import steady
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.fitting import fit_foot
from identification.replay import LONGEST_STEP, RESOLVED, Replayed, replay, residual, traces
from identification.residual import Problem

Array = np.ndarray
FREQUENCIES = (10.0, 25.0, 45.0)


def at(problem: Problem, **values: float) -> Array:
    """Where a bent foot is, with nuisances of the malleolus by kind, or of a spring by kind and constant."""
    v, q = problem.variables, problem.variables.start(BENT)
    for name, value in values.items():
        kind, _, constant = name.replace("__", " ").partition("_of_")
        i = v.of_kind(kind, constant, "malleolus" if kind in ("gain", "delay", "rocking", "mount") else "")
        assert i is not None, name
        q[i] = value / v.scale[i]
    return q


@pytest.mark.parametrize("relaxes", [False, True])
def test_a_rollout_stays_on_the_orbit(foot: Foot, relaxes: bool) -> None:
    """Two loads, two sensors, and in one case a Maxwell element beside each spring."""
    data = [
        recorded(BENT, hz, added=added, second=True) for hz, added in zip(FREQUENCIES, (0.0, 2.3, 4.5), strict=True)
    ]
    made = problem(data, sensors=BOTH)
    q = at(made, relaxing_of_k_T=0.4, relaxing_of_k_F=0.3) if relaxes else at(made)
    run = replay(foot, made, q)
    assert run.difference < RESOLVED and run.base_error < 1e-6 and run.step <= LONGEST_STEP
    want, _ = made.motion.states(made.variables.theta(q))
    have = run.harmonics[..., : want.shape[-1]]
    size = np.abs(want).max(axis=2, keepdims=True)
    assert have.shape == want.shape == (3, 2, made.motion.base.shape[1])
    assert np.abs((have - want) / size).max() < 3 * RESOLVED
    read, r = residual(made, q, run)
    np.testing.assert_allclose(read, made.predicted(q), atol=2e-4 * np.abs(read).max())
    assert r @ r == pytest.approx(np.sum(made.evaluate(q[None]).residual[0, : made.size] ** 2), rel=0.05)


def test_a_best_fit_that_no_step_follows_is_refused(foot: Foot, monkeypatch: pytest.MonkeyPatch) -> None:
    made, tried = problem([recorded(BENT, 25.0)]), []

    def unstable(batch: Batch, controls: Array, step: float, *_: Array) -> None:
        tried.append(step)
        raise UnstableError("two_dof")

    monkeypatch.setattr(Batch, "run", unstable)
    with pytest.raises(SimulationError, match=r"unstable at the best fit, even in steps .*\(--bounds\) or estimate"):
        replay(foot, made, at(made))
    assert tried[0] == pytest.approx(16 * tried[-1])


def test_traces_are_what_the_recording_has(foot: Foot) -> None:
    """Noise is all that is left of a trace, with the channel's gain, delay and rocking in it."""
    made = problem(session(BENT, FREQUENCIES, noise=0.01))
    plain, moved = at(made), at(made, gain=0.02, delay=3e-4, rocking=0.05)
    for q, near in ((plain, True), (moved, False)):
        for line, row in zip(made.measured.lines, traces(made, q, replay(foot, made, q)), strict=True):
            left = (row["malleolus"] - line.recording.malleolus_m_s2).std()
            assert bool(left < 0.012) is near
    run, T = replay(foot, made, moved), made.channel(moved[None], 3)
    for r, row in enumerate(traces(made, moved, run)):
        line = made.measured.lines[r]
        t = line.recording.time_s - line.recording.time_s[0]
        turn = np.exp(2j * np.pi * line.base.frequency_hz * t)
        first = 2 * np.mean(row["malleolus"] * turn.conj())
        want = T[0][0, r, 0, 0] * (run.harmonics[r, 0, 0] + T[1][0, r, 0, 0])
        assert first == pytest.approx(want, rel=0.02)


def test_a_step_that_is_too_coarse_is_halved(foot: Foot) -> None:
    """Dampers at their bounds: 5e-4 s is 0.7 % wrong, and a finer step stays on the orbit."""
    data = [recorded(ANKLE_STOPPED, 20.0, added=4.5)]
    made = problem(data, ANKLE_STOPPED)
    q = made.variables.start(ANKLE_STOPPED)
    run = replay(foot, made, q)
    assert run.step < 0.6 * LONGEST_STEP and run.difference < RESOLVED
    gentle = problem([recorded(BENT, 20.0, added=4.5)])
    assert replay(foot, gentle, gentle.variables.start(BENT)).step == pytest.approx(LONGEST_STEP, rel=1e-3)


@pytest.mark.parametrize(
    ("c_21", "c_23", "lasts"), [(100.0, 300.0, True), (100.0, 600.0, False), (300.0, 600.0, False)]
)
def test_a_motion_that_does_not_last_is_refused(foot: Foot, c_21: float, c_23: float, lasts: bool) -> None:
    """A soft pad swings so far that its damper drives: slowly (multiplier 2, which three periods hide), or fast."""
    soft = BENT | {"k_F": 1.2e4, "c_11": 100.0, "c_12": 0.0, "c_13": 0.1, "c_21": c_21, "c_22": 0.0, "c_23": c_23}
    made = problem([recorded(BENT, 5.0)], soft)
    q = made.variables.start(soft)
    assert bool(made.motion.multipliers(made.variables.theta(q))[0] < 1) is lasts
    if lasts:
        assert replay(foot, made, q).difference < RESOLVED
    else:
        with pytest.raises(SimulationError, match="5 Hz that a foot would not stay on"):
            replay(foot, made, q)


@pytest.mark.long
def test_a_branch_whose_motion_does_not_last_is_left_out(foot: Foot, monkeypatch: pytest.MonkeyPatch) -> None:
    data = session(BENT, (10.0, 20.0, 30.0, 40.0))
    lasts = {STIFF_ANKLE: 1, STIFF_PAD: -1}

    def replayed(foot: Foot, problem: Problem, q: Array) -> Replayed:
        if np.sign(q[problem.variables.index["k_F"]]) not in lasts.values():
            raise SimulationError("this motion does not last.")
        return replay(foot, problem, q)

    monkeypatch.setattr(steady, "replay", replayed)
    usual = fit_foot(data, foot, starts=2)
    other = ({STIFF_ANKLE, STIFF_PAD} - {usual.best.name}).pop()
    del lasts[other]
    result = fit_foot(data, foot, starts=2)
    assert [b.name for b in result.branches] == [usual.best.name]
    assert result.best.deviance == pytest.approx(usual.best.deviance, rel=1e-6)
    assert result.verdict == "not compared" and result.reason.startswith(f"The {other} branch is left out")
    lasts.clear()
    with pytest.raises(SimulationError, match="this motion does not last"):
        fit_foot(data, foot, starts=2)
