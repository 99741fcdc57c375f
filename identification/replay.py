"""A reported end, replayed in MuJoCo: the model of record runs from the orbit's state, and its harmonics are judged.

Each recording has its own foot (masses, load, constants under that load, springs that relax as Maxwell elements), its
own base motion and its own step. A step that is too coarse for the foot is halved until the rollout stays on the orbit.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import mjcf
from fasbody.exceptions import SimulationError
from fasbody.foot.damper import MAXWELL
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import harmonics
from fasbody.foot.simulate import Batch
from fasbody.sentences import Sentence, called
from identification.engines.mujoco import Coordinates
from identification.engines.twin import twin_order
from identification.residual import Problem

#: Periods that are run; the last one is compared with the orbit.
_PERIODS = 3
#: Longest step [s], and fewest steps a period, to begin with.
LONGEST_STEP, FEWEST_STEPS = 5e-4, 48
#: Share of the largest harmonic by which rollout and orbit may differ before the step is halved, and halvings at most.
RESOLVED, _HALVINGS = 1e-4, 4
#: Harmonics of a trace.
_LINES = 20
#: Beyond this share of its peak a rollout has left the orbit.
_LEFT = 0.5


@dataclass(frozen=True, eq=False)
class Replayed:
    """What MuJoCo made of a candidate.

    Attributes:
        harmonics: (R, S, K) of the motion under each sensor [m/s^2], K at least as many as were measured; (S, K) of
            one recording.
        difference: largest difference of rollout and orbit, as a share of the largest harmonic.
        base_error: largest relative error of the base acceleration that any run realised.
        step: finest step used [s].
    """

    harmonics: np.ndarray
    difference: float
    base_error: float
    step: float


def replay(foot: Foot, problem: Problem, q: np.ndarray) -> Replayed:
    """Run every recording of a problem from the orbit of q (n,).

    Raises:
        SimulationError: a motion does not last, at any step.
    """
    variables, measured = problem.variables, problem.measured
    theta = variables.theta(q)
    expected, states = problem.motion.states(theta)
    grows = problem.motion.multipliers(theta)
    if grows.max() >= 1.0:  # a few periods would not show a slow departure
        raise _lost(foot, measured.lines[int(grows.argmax())].base.frequency_hz)
    relaxes = variables.two_mass and bool(np.any(theta[:, 10:12] > 0))
    moved = relaxing(foot) if relaxes else foot
    batch, coordinates = Batch(moved, 1, 1), Coordinates(moved)
    runs = []
    for r, line in enumerate(measured.lines):
        values = dict(zip(variables.motion_names, map(float, theta[r]), strict=True))
        if relaxes:
            values |= {f"relaxing_{j}": values[f"k_{j}"] * values[f"r_{j}"] for j in ("T", "F")}
            values |= {f"tau_{j}": values["tau"] for j in ("T", "F")}
        batch.set({name: value for name, value in values.items() if name in moved.parameters})
        start = coordinates.unpack(_ordered(moved, states[r], variables.two_mass, relaxes)[None])
        runs.append(
            _resolved(batch, line.base.frequency_hz, problem.motion.base[r], start, measured.sensors, expected[r])
        )
    return Replayed(
        np.stack([run.harmonics for run in runs]),
        max(run.difference for run in runs),
        max(run.base_error for run in runs),
        min(run.step for run in runs),
    )


def _ordered(foot: Foot, x: np.ndarray, two_mass: bool, relaxes: bool) -> np.ndarray:
    """States of the two-mass foot (6,), z_1, z_2, their rates and what relaxes, in the order of the model (s,)."""
    if not two_mass:
        return x
    order = twin_order(foot)
    return x[[*order, 4, 5]] if relaxes else x[order]


def _resolved(
    batch: Batch,
    frequency_hz: float,
    base: np.ndarray,
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    sensors: Sequence[str],
    expected: np.ndarray,
) -> Replayed:
    """A few periods of one recording, with a step so fine that the last one is the orbit's, or as near as it comes."""
    steps = max(FEWEST_STEPS, int(np.ceil(1.0 / (frequency_hz * min(LONGEST_STEP, batch.foot.step)) - 1e-6)))
    size, best = np.abs(expected).max(), None
    for halved in range(_HALVINGS + 1):
        n = steps * 2**halved
        h = 1.0 / (frequency_hz * n)
        motion = harmonics(frequency_hz, base, _PERIODS / frequency_hz)
        qpos, qvel = batch.initial_state([motion], *start[:2])
        try:
            out = batch.run(motion.controls(h, _PERIODS * n)[None], h, qpos, qvel, start[2])
        except SimulationError:
            continue
        last = np.stack([out.outputs[name][0, -n:] for name in sensors])
        Y = 2 / n * np.fft.rfft(last)[:, 1 : _LINES + 1]
        difference = float(np.abs(Y[:, : expected.shape[1]] - expected).max() / size)
        run = Replayed(Y, difference, out.base_error, h)
        if best is None or difference < best.difference:
            best = run
        if difference < RESOLVED:
            break
    if best is None:
        text = f"{batch.foot.name}: MuJoCo is unstable at the best fit, even in steps of {h:.1g} s. Narrow the bounds ("
        raise SimulationError(Sentence(text, called("bounds"), ") or estimate fewer constants (", called("free"), ")."))
    if best.difference > _LEFT:
        raise _lost(batch.foot, frequency_hz)
    return best


def _lost(foot: Foot, frequency_hz: float) -> SimulationError:
    return SimulationError(f"{foot.name}: a periodic motion at {frequency_hz:g} Hz that a foot would not stay on.")


@functools.lru_cache(maxsize=4)
def _relaxing(name: str, xml: str) -> Foot:
    """A two-mass foot with a Maxwell element beside each spring, declared as relaxing_T, tau_T, relaxing_F, tau_F."""
    places = (("T", "talocrural"), ("F", "fat_pad"))
    texts = "".join(
        f'<text name="relaxing_{j}" data="N/m | 0 | 1e9 | actuator relaxing_{j} biasprm 1 | estimated"/>'
        f'<text name="tau_{j}" data="s | 1e-5 | 1 | actuator relaxing_{j} biasprm 2 | estimated"/>'
        for j, _ in places
    )
    actuators = "".join(
        f'<general name="relaxing_{j}" joint="{joint}" dyntype="user" actdim="1" gainprm="0" biastype="user" '
        f'biasprm="{MAXWELL:g} 1 0.005"/>'
        for j, joint in places
    )
    xml = xml.replace("</custom>", f"{texts}</custom>").replace("</actuator>", f"{actuators}</actuator>")
    return replace(load(xml), name=name)


def relaxing(foot: Foot) -> Foot:
    """The two-mass foot whose springs may relax, with the values and the step that it has."""
    # a model that came as compiled has the shipped one's equations, or it were not the two-mass foot
    made = _relaxing(foot.name, foot.xml or mjcf.text("two_dof"))
    return made.with_values(foot.values(), step=foot.step)


def traces(problem: Problem, q: np.ndarray, run: Replayed) -> list[dict[str, np.ndarray]]:
    """What each sensor of each recording reads at its samples (n,), by the channel that the fit estimates [m/s^2]."""
    K = run.harmonics.shape[-1]
    Y, rows = _sensed(problem, q, run.harmonics), []
    for r, line in enumerate(problem.measured.lines):
        recording = line.recording
        time = recording.time_s - recording.time_s[0]
        turning = np.exp(2j * np.pi * line.base.frequency_hz * np.outer(time, np.arange(1, K + 1)))
        rows.append(
            {
                name: (turning @ Y[r, s]).real
                for s, name in enumerate(problem.measured.sensors)
                if problem.measured.valid[r, s].any()
            }
        )
    return rows


def residual(problem: Problem, q: np.ndarray, run: Replayed) -> tuple[np.ndarray, np.ndarray]:
    """Harmonics (R, S, H) that the rollout's motion makes the sensors read, and the whitened residual (m,) of them."""
    Y = _sensed(problem, q, run.harmonics[..., : problem.measured.base.shape[1]])
    return Y, problem.whitened(Y)


def _sensed(problem: Problem, q: np.ndarray, harmonics: np.ndarray) -> np.ndarray:
    """What the sensors read of motions (R, S, K)."""
    T, rock = problem.channel(q[None], harmonics.shape[-1])
    return np.asarray((T * (harmonics[None] + rock))[0])
