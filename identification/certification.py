"""A branch of a fit in the time domain converged on the MuJoCo rollout, with its standard errors.

The estimate is then run over whole recordings (`replay`), for the traces of the report and the thesis' fit percentage.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.simulate import Batch
from fasbody.recording.recording import Recording
from identification.criteria import fit_percent
from identification.delay import delayed
from identification.engines.certified import CertifiedRollouts
from identification.engines.engine import Whole
from identification.engines.mujoco import Coordinates
from identification.engines.twin import Twin
from identification.multistart import Descent, descend
from identification.parameters import delay_of
from identification.sensors import MALLEOLUS, SensorFit
from identification.time_domain import TimeDomain
from identification.time_problem import TimeProblem

#: So many ends of a branch are tried in MuJoCo before it is given up.
_CANDIDATES = 3


@dataclass(frozen=True, eq=False)
class Replay:
    """Model traces of all recordings.

    Attributes:
        traces: malleolus acceleration (n,) of each recording at its samples, delayed like the
            measurement [m/s^2].
        fits: fit percentage of each, Eq. (3.20).
        base_error: largest relative error of the realised base acceleration.
        twin_difference: largest difference between twin and MuJoCo over the peak, None where no
            twin exists.
        others: the same traces of further sensors by name, of each recording.
    """

    traces: list[np.ndarray]
    fits: list[float]
    base_error: float
    twin_difference: float | None
    others: Sequence[Mapping[str, np.ndarray]] = ()


@dataclass(frozen=True, eq=False)
class Certified:
    """A branch converged on the MuJoCo rollout."""

    name: str
    problem: TimeProblem
    descent: Descent
    deviance: float
    run: Replay

    def sensors(self, recordings: Sequence[Recording]) -> list[tuple[SensorFit, ...]]:
        """How each sensor of each recording is followed."""
        run, rows = self.run, []
        for i, recording in enumerate(recordings):
            traces = {MALLEOLUS[0]: run.traces[i]} | dict(run.others[i] if run.others else {})
            rows.append(
                tuple(
                    SensorFit.of(name, fit_percent(recording.sensors[name], y), recording.sensors[name], y)
                    for name, y in traces.items()
                )
            )
        return rows


def certify_first(domain: TimeDomain, name: str, candidates: Sequence[Descent]) -> tuple[Certified | None, int]:
    """The best descent of a branch that MuJoCo can follow over whole recordings, and how many it could not.

    A parameter set may have a periodic motion that no foot would stay on. Descents that end at the same place are
    tried once.
    """
    skipped: list[Descent] = []
    for descent in candidates:
        if descent.unstable or any(abs(descent.cost - other.cost) <= 1e-6 * other.cost for other in skipped):
            continue
        try:
            return _certify(domain, name, descent), len(skipped)
        except SimulationError:
            skipped.append(descent)
        if len(skipped) == _CANDIDATES:
            break
    return None, len(skipped)


def _certify(domain: TimeDomain, name: str, descent: Descent) -> Certified:
    """Refine the step, converge on the MuJoCo rollout, and run the recordings.

    Raises:
        SimulationError: the motion is unstable over whole recordings.
    """
    domain, problem, descent = _refined(domain, descent)
    final = problem if domain.by_twin else problem.certified(domain.foot)
    if not domain.by_twin:
        descent = _continued(final, descent)
    if isinstance(final.engine, CertifiedRollouts):
        run = _ran(final, descent.z)
    else:
        starts = [final.states(descent.z, number) for number in range(len(domain.recordings))]
        values = domain.space.values(descent.theta)
        made = (domain.twin, domain.threads, domain.sensors, domain.replayed)
        run = replay(domain.foot, domain.recordings, values, starts, *made)
    return Certified(name, final, descent, descent.cost + final.log_determinant, run)


def _continued(problem: TimeProblem, descent: Descent) -> Descent:
    """A descent that goes on from its end; evaluations are counted together."""
    end = descend(problem, descent.label, descent.z, tight=True)
    return replace(end, theta0=descent.theta0, evaluations=descent.evaluations + end.evaluations)


def _refined(domain: TimeDomain, descent: Descent) -> tuple[TimeDomain, TimeProblem, Descent]:
    """Bring the time step up to date at a descent's end and go on, until it stays."""
    finer = domain.refined(descent.z)
    while True:
        domain = finer
        problem = domain.problem()
        descent = _continued(problem, descent)
        finer = domain.refined(descent.z)
        if finer is domain:
            return domain, problem, descent


def _ran(problem: TimeProblem, z: np.ndarray) -> Replay:
    """The motions of the last evaluation, which MuJoCo has run from end to end."""
    engine, traces, others, difference = problem.engine, [], [], 0.0
    assert isinstance(engine, CertifiedRollouts)
    values = problem.space.values(problem.space.to_theta(z[: problem.space.lower.size]))
    for i, sensors in enumerate(problem.sensors):
        read = dict(zip(sensors, np.split(problem.rows(z, i)[0], len(sensors)), strict=True))
        run, _ = engine.run(i, values, problem.space.names, problem.states(z, i))
        twin, _ = engine.twin.run(i, values, (), problem.states(z, i))
        peak = np.abs(twin[: read[MALLEOLUS[0]].size]).max()
        difference = max(difference, float(np.abs(run - twin).max() / peak))
        traces.append(read.pop(MALLEOLUS[0]))
        others.append(read)
    fits = [fit_percent(r.malleolus_m_s2, y) for r, y in zip(problem.recordings, traces, strict=True)]
    return Replay(traces, fits, engine.base_error, difference, others)


def standard_errors(problem: TimeProblem, descent: Descent) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors (p,) and covariance (p, p) of q; NaN at a bound.

    What rests on a bound has no standard error of its own, but is not known to lie there: the others' errors hold for
    any value it may have, not for the bound's alone.
    """
    at_bound = problem.space.at_bound(descent.theta)
    covariance = problem.covariance(descent.z, np.ones(at_bound.size, bool))
    covariance[at_bound] = covariance[:, at_bound] = np.nan
    return np.sqrt(np.diag(covariance)), covariance


def replay(
    foot: Foot,
    recordings: Sequence[Recording],
    values: Mapping[str, float],
    starts: Sequence[np.ndarray],
    twin: bool,
    threads: int = 0,
    sensors: Sequence[str] = MALLEOLUS,
    throughout: int | None = None,
) -> Replay:
    """Run every recording from its initial states [m, m/s], driven by the spline through its base channel.

    Args:
        foot: the model.
        recordings: checked.
        values: parameters by name, with the delay.
        starts: initial states of each (`Coordinates.unpack`).
        twin: compare with the compiled twin.
        threads: 0 for all cores.
        sensors: that are fitted, where a recording has them.
        throughout: how many recordings MuJoCo runs from end to end, None for all; of the others,
            which are steady and have a twin, it runs the first period.
    """
    coordinates = Coordinates(foot)
    traces: list[np.ndarray] = [np.empty(0)] * len(recordings)
    others: list[dict[str, np.ndarray]] = [{} for _ in recordings]
    base_error, difference = 0.0, 0.0
    whole = [Whole.of(recording, foot) for recording in recordings]
    part = [twin and throughout is not None and i >= throughout for i in range(len(recordings))]
    grids = [
        (long.step, _period(long) if short else long.steps, long.stride)
        for long, short in zip(whole, part, strict=True)
    ]
    full = [{**values, **r.condition.masses} for r in recordings]
    engine = Twin(foot, whole, sensors if any(part) else MALLEOLUS) if twin else None
    for shape in dict.fromkeys(grids):
        group = [i for i, g in enumerate(grids) if g == shape]
        h, n, stride = shape
        batch = Batch(foot, len(group), threads)
        batch.set({name: np.array([full[i][name] for i in group]) for name in foot.parameters if name in full[0]})
        controls = np.stack([whole[i].controls[:n] for i in group])
        out = batch.run(controls, h, *coordinates.unpack(np.stack([starts[i] for i in group])))
        base_error = max(base_error, out.base_error)
        for row, i in enumerate(group):
            read = {name: out.outputs[name][row, ::stride] for name in (*MALLEOLUS, *sensors) if name in out.outputs}
            if engine is not None:
                run, _ = engine.run(i, full[i], (), starts[i])
                other = dict(zip(engine.sensors, np.split(run, len(engine.sensors)), strict=True))
                y = read[MALLEOLUS[0]]
                apart = np.abs(y - other[MALLEOLUS[0]][: y.size]).max() / np.abs(other[MALLEOLUS[0]]).max()
                difference = max(difference, float(apart))
                read = other if part[i] else read
            for name in sensors:
                if name in recordings[i].sensors:
                    y = delayed(read[name], recordings[i].rate_hz * full[i].get(delay_of(name).name, 0.0))
                    others[i][name] = y
            traces[i] = others[i].pop(MALLEOLUS[0])
    fits = [fit_percent(r.malleolus_m_s2, y) for r, y in zip(recordings, traces, strict=True)]
    return Replay(traces, fits, base_error, difference if twin else None, others)


def _period(whole: Whole) -> int:
    """Steps of the first period of a steady recording, of whole samples; of any other, all."""
    f = whole.recording.condition.frequency_hz
    return whole.steps if f is None else min(whole.steps, whole.stride * int(np.ceil(whole.recording.rate_hz / f)))
