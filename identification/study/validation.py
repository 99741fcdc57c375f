"""Leave one frequency out: the error of a model where it was not fitted, and which damper law predicts better.

Per recording, a left-out recording is predicted from the estimates at the neighbouring frequencies
under the same load; pooled, from constants fitted to the other frequencies under that load. The
lowest and the highest frequency are extrapolations, and marked so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, SimulationError, unknown
from fasbody.foot.hysteresis import periodic_motion
from fasbody.foot.model import Foot
from fasbody.foot.steady_state import Balance
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification import optimiser
from identification.engines.twin import twin_applies
from identification.fitting import Settings
from identification.harmonics import Line
from identification.intervals import Solution
from identification.parameters import DELAY, MASSES, space_of
from identification.residual import Problem
from identification.setup import Setup
from identification.steady import SIDES
from identification.study import MODES

#: Constants that bend the dampers' law; without them it is linear.
NONLINEAR = ("c_12", "c_13", "c_22", "c_23")


def predicted(line: Line, foot: Foot, values: Mapping[str, float], two_mass: bool) -> np.ndarray:
    """Malleolus harmonics (H,) on the measured base, delayed like the measurement [m/s^2].

    Raises:
        SimulationError: the foot has no periodic motion there.
    """
    f, base = line.base.frequency_hz, line.base.amplitudes
    moving = {**values, **line.recording.condition.masses}
    if two_mass:
        Y = periodic_motion(foot, f, base, moving).shank[0]
    else:
        declared = {name: value for name, value in moving.items() if name in foot.parameters}
        Y = Balance(foot).orbit(f, base, declared).harmonics()
    delay = values.get(DELAY.name, 0.0)
    return np.asarray(Y[: line.count] * np.exp(-2j * np.pi * f * delay * np.arange(1, line.count + 1)))


def compare(line: Line, Y: np.ndarray, edge: bool = False) -> dict[str, Any]:
    """Predicted harmonics (H,) against those measured, and the noise of malleolus and base.

    Args:
        line: the recording.
        Y: predicted.
        edge: its frequency was outside those used.

    Returns:
        `chi_square`, the squared error over the noise of the measurement alone, of `numbers`, as
        harmonics count as two each; the norm of the error in `percent` of that of the harmonics.
    """
    measured = line.malleolus.amplitudes
    gain = abs(measured[0] / line.base.amplitudes[0])
    std = np.hypot(line.malleolus.std, gain * line.base.std)
    error = Y - measured
    condition = line.recording.condition
    return {
        "file": line.recording.file,
        "frequency_hz": float(condition.frequency_hz or np.nan),
        "added_mass_kg": condition.added_mass_kg,
        "edge": edge,
        "chi_square": float(np.sum(np.abs(error / std) ** 2)),
        "numbers": 2 * error.size,
        "percent": float(100 * np.linalg.norm(error) / np.linalg.norm(measured)),
    }


def interpolated(at: float, frequencies_hz: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Search variables (p,) at a frequency, linear in log f between those (n, p) at others (n,).

    Beyond the ends they are those of the last one.
    """
    order = np.argsort(frequencies_hz)
    x = np.log(frequencies_hz[order])
    return np.array([np.interp(np.log(at), x, column) for column in q[order].T])


def held(setup: Setup) -> Problem:
    """The problem with the model assumed exact: only constants and delays are free."""
    problem = setup.problem()
    kinds = [item.kind for item in problem.variables.nuisances if item.kind != "delay"]
    return problem.with_held(problem.variables.held(kinds))


def quick_fit(recordings: Sequence[Recording], foot: Foot, settings: Settings) -> Solution:
    """The likelier end of a fit, the model assumed exact, not replayed in MuJoCo."""
    problem = held(Setup.of(recordings, foot, replace(settings, domain="periodic")))
    variables = problem.variables
    signs = (1, -1) if variables.ratio is not None else (0,)
    first = variables.start(variables.model_values)[None]
    effort = optimiser.Effort(starts=settings.starts, rounds=1)
    search = optimiser.search(problem, signs, effort, seed=settings.seed, estimate=False, first=first)
    best = search.optima[0]
    return Solution(SIDES[best.sign], search.problem, best)


def values_of(solution: Solution) -> dict[str, float]:
    """Constants by name without masses, and the delay where it is free."""
    values = {name: value for name, value in solution.foot(0).items() if name not in MASSES}
    variables = solution.problem.variables
    delay = variables.of_kind("delay", sensor="malleolus")
    if delay is not None:
        values[DELAY.name] = float(variables.value(solution.q, delay))
    return values


def leave_one_frequency_out(
    recordings: Sequence[Recording],
    foot: Foot,
    mode: str,
    settings: Settings = Settings(),
    *,
    estimates: Sequence[Mapping[str, float]] | None = None,
) -> dict[str, Any]:
    """Predict each frequency from the others.

    Args:
        recordings: of one subject in one posture.
        foot: the model.
        mode: see MODES.
        settings: of the fits.
        estimates: per-recording only: values of each recording by name; None fits here.

    Returns:
        As plain data the `mode`; `rows` of errors, one a recording; files that `failed`, as their
        prediction had no stable motion; and medians over the interior frequencies, over all where
        there are none: the error in `percent`, and squared over the noise `chi_square_per_number`.

    Raises:
        SettingError: no such mode, or fewer than three frequencies under some load.
        SimulationError: no prediction was stable.
    """
    if mode not in MODES:
        raise SettingError(f"{unknown('mode', mode, MODES)}.")
    data = [checked(recording) for recording in recordings]
    f = np.array([round(r.condition.frequency_hz or 0.0, 1) for r in data])
    loads = np.array([r.condition.added_mass_kg for r in data])
    if min(len(set(f[loads == m])) for m in set(loads)) < 3:
        raise SettingError("leaving a frequency out needs three or more frequencies under each load.")
    lines, two_mass = [Line.of(recording) for recording in data], twin_applies(foot)
    rows: list[dict[str, Any]] = []
    failed: list[str] = []
    space = space_of(foot, settings.free, settings.bounds, delay=True)
    q = np.empty((0, 0))
    if mode == "per-recording":
        by_recording = estimates or [values_of(quick_fit([r], foot, settings)) for r in recordings]
        q = np.array([space.to_q(space.theta(values)) for values in by_recording])
    for m, at in sorted(set(zip(loads, f, strict=True))):
        used, left_out = np.flatnonzero((loads == m) & (f != at)), np.flatnonzero((loads == m) & (f == at))
        try:
            if mode == "pooled":
                values = values_of(quick_fit([recordings[int(i)] for i in used], foot, settings))
            else:
                values = space.values(space.to_theta(interpolated(at, f[used], q[used])))
        except SimulationError:
            failed += [data[i].file for i in left_out]
            continue
        for i in left_out:
            try:
                Y = predicted(lines[i], foot, {**foot.values(), **values}, two_mass)
                rows.append(compare(lines[i], Y, edge=not f[used].min() < at < f[used].max()))
            except SimulationError:
                failed.append(data[i].file)
    if not rows:
        raise SimulationError(f"none of the {len(failed)} recordings left out had a stable prediction.")
    inner = [row for row in rows if not row["edge"]] or rows
    return {
        "mode": mode,
        "percent": float(np.median([row["percent"] for row in inner])),
        "chi_square_per_number": float(np.median([row["chi_square"] / row["numbers"] for row in inner])),
        "rows": rows,
        "failed": failed,
    }


def compare_damping(
    recordings: Sequence[Recording], foot: Foot, settings: Settings = Settings()
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fit with and without the constants that bend the dampers' law.

    Args:
        recordings: of one subject in one posture, which share their constants.
        foot: a model with the dampers of Eq. 4.25.
        settings: of both fits.

    Returns:
        Criteria of the laws "linear" and "nonlinear" and which of them each one prefers, as plain
        data, and the held-out errors of the nonlinear law.
    """
    missing = [name for name in NONLINEAR if name not in foot.parameters]
    if missing:
        raise SettingError(f"model {foot.name} has no {', '.join(missing)}, so damping cannot be compared.")
    free = settings.free or space_of(foot, None, None, False).names
    bounds = {name: b for name, b in (settings.bounds or {}).items() if name not in NONLINEAR}
    straight = tuple(name for name in free if name not in NONLINEAR)
    flat = foot.with_values(dict.fromkeys(NONLINEAR, 0.0))
    linear = replace(settings, free=straight, bounds=bounds or None)
    laws, errors = dict[str, dict[str, Any]](), dict[str, Any]()
    for law, model, how in (("linear", flat, linear), ("nonlinear", foot, settings)):
        fit = quick_fit(recordings, model, how)
        low, high = fit.problem.bounds()
        count, numbers = int((high > low).sum()), fit.problem.size
        errors = leave_one_frequency_out(recordings, model, "pooled", how)
        laws[law] = {
            "law": law,
            "count": count,
            "deviance": fit.chi_square,
            "aic": fit.chi_square + 2 * count,
            "bic": fit.chi_square + float(np.log(numbers)) * count,
            "chi_square": fit.chi_square,
            "dof": max(0, numbers - count),
            "held_out_percent": errors["percent"],
            "held_out_chi_square": errors["chi_square_per_number"],
        }
    criteria = ("aic", "bic", "held_out_percent")
    return laws | {"preferred": {c: min(laws, key=lambda law: laws[law][c]) for c in criteria}}, errors
