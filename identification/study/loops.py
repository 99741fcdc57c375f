"""Hysteresis loops of ankle and fat pad over one cycle, and the energy that goes through the foot.

The loops are Eq. (4.42) along the periodic orbit that the recording's own base motion drives: force against relative
displacement. Their areas are what ankle and pad dissipate a cycle. What the shaker puts in is computed without any
damper's force, and in a closed cycle the two must be equal: the imbalance is printed with every cycle.

- The two-mass foot: the compiled twin's orbit. The shaker's force is the rate of change of the momentum on the base.
- Any other MJCF foot with a `talocrural` and a `fat_pad` (joint or tendon, or the pads of foot_arch): MuJoCo's orbit.
  The force of each part comes from the model with all other parts silenced, the shaker's from its actuator.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.foot.two_dof import TwoDof, path, periodic
from fasbody.recording.recording import Recording
from identification.domains import resolved
from identification.engines.engine import LONGEST_STEP, Excitation
from identification.engines.twin import twin_applies
from identification.periodic import Line
from identification.space import DELAY
from identification.study.cycle import Cycle, Loop, short
from identification.study.parts import CLOSED, mujoco_cycle

#: Periods and samples of a stored trace at most.
_PERIODS, _SAMPLES = 2, 120
#: Newton steps to a closed orbit.
_PASSES = 30


def cycle(foot: Foot, excitation: Excitation, values: Mapping[str, float], twin: bool) -> Cycle:
    """The cycle of a foot with the given parameter values; `twin`: the compiled two-mass model is this foot.

    Raises:
        SimulationError: no periodic motion. ModelError: the model has no ankle or no fat pad by these names.
    """
    excitation = resolved(excitation, foot, values, twin)
    return _twin_cycle(excitation, values) if twin else mujoco_cycle(foot, excitation, values)


def _twin_cycle(e: Excitation, values: Mapping[str, float]) -> Cycle:
    foot = TwoDof.from_values({**values, **e.masses})
    model = (foot.theta, foot.m_S, foot.m_F, e.motion.half_steps(e.step, e.steps), e.step)
    malleolus, _, start, _, gap = periodic(np.zeros(4), *model, CLOSED, _PASSES)
    if not gap < CLOSED:
        raise SimulationError(f"no periodic motion at {e.frequency_hz:g} Hz for {foot}.")
    x = path(start, *model).T
    F_T, F_F = foot.forces(x)  # Eq. (4.42)
    ankle, fat_pad = _loop(x[0], x[2], F_T, e), _loop(x[1], x[3], F_F, e)
    base = base_velocity(e)
    momentum = foot.m_S * (x[2] + x[3] + base) + foot.m_F * (x[3] + base)
    work = float(np.mean(_rate(momentum, e) * base)) / e.frequency_hz
    return Cycle(ankle, fat_pad, ankle.dissipated_j + fat_pad.dissipated_j, work, malleolus)


def base_velocity(e: Excitation) -> np.ndarray:
    """Velocity of the base at the steps of one period (n,), without a mean [m/s]."""
    omega = 2j * np.pi * e.frequency_hz * np.arange(1, e.amplitudes.size + 1)
    t = e.step * np.arange(e.steps)
    return (np.exp(np.multiply.outer(t, omega)) @ (e.amplitudes / omega)).real


def _rate(values: np.ndarray, e: Excitation) -> np.ndarray:
    """Time derivative of a periodic signal (n,), by its harmonics."""
    spectrum = np.fft.rfft(values)
    omega = 2j * np.pi * e.frequency_hz * np.arange(spectrum.size)
    if values.size % 2 == 0:
        omega[-1] = 0.0  # the phase of the highest line is unknown
    return np.fft.irfft(omega * spectrum, values.size)


def _loop(x: np.ndarray, x_dot: np.ndarray, force: np.ndarray, e: Excitation) -> Loop:
    """The work of a closed loop is its power averaged over a period: exact for the harmonics the steps resolve."""
    return Loop(x, force, float(np.mean(force * x_dot)) / e.frequency_hz)


def cycles(
    result: Mapping[str, Any], foot: Foot, recordings: Sequence[Recording | Line], twin: bool | None = None
) -> list[dict[str, Any]]:
    """The cycles of a fit as plain data: one entry a recording and branch.

    Loops and traces are of both branches, as all fits of a subject together may decide for the other one later; of a
    trend, which is not weighed together with others, of the best branch only.

    Args:
        result: `FitResult.document()`, or that of a trend, with parameters a point in each branch ("points"), and the
            foot of each recording on the best branch, which lies off the curves a little ("foot").
        foot: the model. recordings: those of the fit, checked, or their harmonics. twin: whether the compiled twin is
            this model, where that is known already.

    Returns:
        Entries with file, frequency_hz, added_mass_kg, branch, chosen, ankle, fat_pad, dissipated_j, shaker_work_j,
        imbalance and, where loops are kept, their points and trace (time_s, measured_m_s2, model_m_s2). Recordings
        that are not periodic have no entry.
    """
    twin = twin_applies(foot) if twin is None else twin
    step = min(LONGEST_STEP, foot.step)
    feet = {r["file"]: r.get("foot") for r in result.get("recordings", ())}
    entries = []
    for given in recordings:
        if isinstance(given, Recording) and given.condition.frequency_hz is None:
            continue
        line = given if isinstance(given, Line) else Line.of(given)
        condition = line.recording.condition
        e = Excitation(line.base.frequency_hz, line.base.amplitudes, condition.masses, step)
        for number, branch in enumerate(result["branches"]):
            own = feet.get(line.recording.file) if number == 0 else None
            values = own or values_of(branch, foot, line.base.frequency_hz, condition.added_mass_kg)
            found = cycle(foot, e, {**foot.values(), **values}, twin)
            points = number == 0 or "parameters" in branch
            entry: dict[str, Any] = {
                "file": line.recording.file, "frequency_hz": line.base.frequency_hz,
                "added_mass_kg": condition.added_mass_kg, "branch": branch["name"], "chosen": number == 0,
                "ankle": found.ankle.document(points), "fat_pad": found.fat_pad.document(points),
                "dissipated_j": found.dissipated_j, "shaker_work_j": found.shaker_work_j, "imbalance": found.imbalance,
            }  # fmt: skip
            if points:
                entry["trace"] = _trace(line, found, values.get(DELAY.name, 0.0))
            entries.append(entry)
    return entries


def values_of(branch: Mapping[str, Any], foot: Foot, frequency_hz: float, added_mass_kg: float) -> dict[str, float]:
    """The branch's parameter values by name at a recording's condition."""
    estimates = branch.get("parameters")
    if estimates is None:
        distance = [
            abs(p["frequency_hz"] - frequency_hz) + abs(p["added_mass_kg"] - added_mass_kg) for p in branch["points"]
        ]
        estimates = branch["points"][int(np.argmin(distance))]["parameters"]
    name_of = {item.key: name for name, item in {**foot.parameters, DELAY.name: DELAY}.items()}
    return {name_of[key]: each["value"] for key, each in estimates.items()}


def _trace(line: Line, found: Cycle, delay: float) -> dict[str, list[float]]:
    """A few periods from the middle of a recording, measured and modelled."""
    r, f = line.recording, line.base.frequency_hz
    since = r.time_s - r.time_s[0]
    first = r.time_s.size // 2
    last = int(np.searchsorted(since, since[first] + _PERIODS / f))
    at = np.arange(first, min(last + 1, since.size), max(1, -(-(last - first) // _SAMPLES)))
    Y = 2 / found.malleolus_m_s2.size * np.fft.rfft(found.malleolus_m_s2)[1:]
    omega = 2j * np.pi * f * np.arange(1, Y.size + 1)
    model = (np.exp(np.multiply.outer(since[at] - delay, omega)) @ Y).real
    channels = {"time_s": since[at] - since[first], "measured_m_s2": r.malleolus_m_s2[at], "model_m_s2": model}
    return {name: short(values) for name, values in channels.items()}
