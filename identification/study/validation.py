"""Leave one frequency out: prediction error of a model where it was not fitted, and which damper law predicts better.

Per recording, a left-out recording is predicted from the estimates at the neighbouring frequencies under the same load;
pooled, from constants fitted to the other frequencies under that load. The lowest and the highest frequency are
extrapolations, and marked so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, SimulationError, unknown
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
from identification.study.filters import MODES
from identification.study.loops import periodic_motion

#: Constants that bend the dampers' law; without them it is linear.
NONLINEAR = ("c_12", "c_13", "c_22", "c_23")


@dataclass(frozen=True)
class HeldOut:
    """The error of one prediction.

    Attributes:
        file: of the recording.
        frequency_hz: its excitation.
        added_mass_kg: its load.
        edge: its frequency was outside those used.
        chi_square: squared error over the noise of the measurement alone.
        numbers: harmonics count as two each.
        percent: norm of the error over that of the harmonics.
    """

    file: str
    frequency_hz: float
    added_mass_kg: float
    edge: bool
    chi_square: float
    numbers: int
    percent: float


def predicted(line: Line, foot: Foot, values: Mapping[str, float], two_mass: bool) -> np.ndarray:
    """Malleolus harmonics (H,) of a foot on the measured base, delayed like the measurement [m/s^2].

    Raises:
        SimulationError: it has no periodic motion there.
    """
    f, base, moving = line.base.frequency_hz, line.base.amplitudes, {**values, **line.recording.condition.masses}
    if two_mass:
        Y = periodic_motion(foot, f, base, moving).shank[0]
    else:
        declared = {name: value for name, value in moving.items() if name in foot.parameters}
        Y = Balance(foot).orbit(f, base, declared).harmonics()
    turn = np.exp(-2j * np.pi * f * np.arange(1, line.count + 1) * values.get(DELAY.name, 0.0))
    return np.asarray(Y[: line.count] * turn)


def compare(line: Line, Y: np.ndarray, edge: bool = False) -> HeldOut:
    """Predicted harmonics (H,) against those measured; the base's noise through the measured transmissibility."""
    measured = line.malleolus.amplitudes
    gain = abs(measured[0] / line.base.amplitudes[0])
    std = np.hypot(line.malleolus.std, gain * line.base.std)
    error = np.concatenate([(Y - measured).real, (Y - measured).imag])
    condition = line.recording.condition
    return HeldOut(
        file=line.recording.file, frequency_hz=float(condition.frequency_hz or np.nan),
        added_mass_kg=condition.added_mass_kg, edge=edge, numbers=error.size,
        chi_square=float(np.sum((error / np.tile(std, 2)) ** 2)),
        percent=float(100 * np.linalg.norm(error) / np.linalg.norm(measured)),
    )  # fmt: skip


def interpolated(at: float, frequencies_hz: Sequence[float], values: Sequence[np.ndarray]) -> np.ndarray:
    """Search variables (p,) at a frequency, linear in log f between neighbours; the nearest one's beyond the ends."""
    order = np.argsort(frequencies_hz)
    x, q = np.log(np.asarray(frequencies_hz, float))[order], np.asarray(values)[order]
    return np.array([np.interp(np.log(at), x, column) for column in q.T])


@dataclass(frozen=True)
class Validation:
    """Held-out errors of one mode.

    Attributes:
        mode: see MODES.
        rows: one a recording.
        failed: files whose prediction had no stable motion.
    """

    mode: str
    rows: tuple[HeldOut, ...]
    failed: tuple[str, ...] = ()

    @property
    def percent(self) -> float:
        """Median error of the interior frequencies [%]; of all where there are none."""
        return float(np.median([row.percent for row in self._inner]))

    @property
    def chi_square_per_number(self) -> float:
        """Squared error over measurement noise, the median over the interior frequencies."""
        return float(np.median([row.chi_square / row.numbers for row in self._inner]))

    @property
    def _inner(self) -> Sequence[HeldOut]:
        return [row for row in self.rows if not row.edge] or self.rows

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "mode": self.mode, "percent": self.percent, "chi_square_per_number": self.chi_square_per_number,
            "rows": [asdict(row) for row in self.rows], "failed": list(self.failed),
        }  # fmt: skip


def held(setup: Setup) -> Problem:
    """The problem of recordings with the model assumed exact: only constants and delays are free."""
    problem = setup.problem()
    variables = problem.variables
    return problem.with_held(variables.held([item.kind for item in variables.nuisances if item.kind != "delay"]))


def quick_fit(recordings: Sequence[Recording], foot: Foot, settings: Settings) -> Solution:
    """The likelier end of a fit of constants, the model assumed exact, not replayed in MuJoCo."""
    problem = held(Setup.of(recordings, foot, replace(settings, domain="periodic")))
    variables = problem.variables
    signs = (1, -1) if variables.ratio is not None else (0,)
    first = variables.start(variables.model_values)[None]
    search = optimiser.search(
        problem, signs, starts=settings.starts, rounds=1, seed=settings.seed, estimate=False, first=first
    )
    best = search.optima[0]
    return Solution(SIDES[best.sign], search.problem, best)


def values_of(solution: Solution) -> dict[str, float]:
    """Constants by name without masses, and the delay where it is free."""
    values = {name: value for name, value in solution.foot(0).items() if name not in MASSES}
    delay = solution.problem.variables.of_kind("delay", sensor="malleolus")
    if delay is not None:
        values[DELAY.name] = float(solution.problem.variables.value(solution.q, delay))
    return values


def leave_one_frequency_out(
    recordings: Sequence[Recording],
    foot: Foot,
    mode: str,
    settings: Settings | None = None,
    *,
    estimates: Sequence[Mapping[str, float]] | None = None,
) -> Validation:
    """Predict each frequency from the others.

    Args:
        recordings: of one subject in one posture.
        foot: the model.
        mode: see MODES.
        settings: of the fits.
        estimates: per-recording only: named values of each recording, such as a study has them; None fits here.

    Raises:
        SettingError: no such mode, or fewer than three frequencies under some load.
        SimulationError: no prediction was stable.
    """
    settings = settings or Settings()
    data = [checked(recording) for recording in recordings]
    lines, two_mass = [Line.of(recording) for recording in data], twin_applies(foot)
    f = np.array([round(r.condition.frequency_hz or 0.0, 1) for r in data])
    loads = np.array([r.condition.added_mass_kg for r in data])
    if mode not in MODES:
        raise SettingError(f"{unknown('mode', mode, MODES)}.")
    if min(len(set(f[loads == m])) for m in set(loads)) < 3:
        raise SettingError("leaving a frequency out needs three or more frequencies under each load.")
    rows: list[HeldOut] = []
    failed: list[str] = []

    def predict(i: int, values: Mapping[str, float], used: np.ndarray) -> None:
        try:
            Y = predicted(lines[i], foot, {**foot.values(), **values}, two_mass)
        except SimulationError:
            failed.append(data[i].file)
        else:
            rows.append(compare(lines[i], Y, edge=not used.min() < f[i] < used.max()))

    if mode == "per-recording":
        space = space_of(foot, settings.free, settings.bounds, delay=True)
        named = estimates or [values_of(quick_fit([r], foot, settings)) for r in recordings]
        q = np.array([space.to_q(space.theta(values)) for values in named])
        for i in range(len(data)):
            others = (loads == loads[i]) & (f != f[i])
            predict(i, space.values(space.to_theta(interpolated(f[i], list(f[others]), list(q[others])))), f[others])
    for m, at in sorted(set(zip(loads, f, strict=True))) if mode == "pooled" else ():
        used, out = np.flatnonzero((loads == m) & (f != at)), np.flatnonzero((loads == m) & (f == at))
        try:
            values = values_of(quick_fit([recordings[int(i)] for i in used], foot, settings))
        except SimulationError:
            failed += [data[i].file for i in out]
            continue
        for place in out:
            predict(int(place), values, f[used])
    if not rows:
        raise SimulationError(f"none of the {len(failed)} recordings left out had a stable prediction.")
    return Validation(mode, tuple(rows), tuple(failed))


@dataclass(frozen=True)
class Criteria:
    """How well one law of the dampers does: parameters counted, criteria, and the held-out error."""

    law: str
    count: int
    deviance: float
    aic: float
    bic: float
    chi_square: float
    dof: int
    held_out_percent: float
    held_out_chi_square: float


@dataclass(frozen=True)
class DampingComparison:
    """Linear against nonlinear damping.

    Attributes:
        linear: its criteria.
        nonlinear: its criteria.
        held_out: of the nonlinear law.
    """

    linear: Criteria
    nonlinear: Criteria
    held_out: Validation

    def preferred(self, criterion: str) -> str:
        """The law with the lower "aic", "bic" or "held_out_percent"."""
        a, b = getattr(self.linear, criterion), getattr(self.nonlinear, criterion)
        return self.linear.law if a <= b else self.nonlinear.law

    def document(self) -> dict[str, Any]:
        """As plain data."""
        preferred = {c: self.preferred(c) for c in ("aic", "bic", "held_out_percent")}
        return {"linear": asdict(self.linear), "nonlinear": asdict(self.nonlinear), "preferred": preferred}


def compare_damping(recordings: Sequence[Recording], foot: Foot, settings: Settings | None = None) -> DampingComparison:
    """Fit with and without the constants that bend the dampers' law.

    Args:
        recordings: of one subject in one posture, which share their constants.
        foot: a model with the dampers of Eq. 4.25.
        settings: of the fits.
    """
    settings = settings or Settings()
    missing = [name for name in NONLINEAR if name not in foot.parameters]
    if missing:
        raise SettingError(f"model {foot.name} has no {', '.join(missing)}, so damping cannot be compared.")
    free = settings.free or tuple(n for n in space_of(foot, None, None, False).names)
    straight = replace(settings, free=tuple(n for n in free if n not in NONLINEAR), bounds={
        n: b for n, b in (settings.bounds or {}).items() if n not in NONLINEAR} or None)  # fmt: skip
    flat = foot.with_values(dict.fromkeys(NONLINEAR, 0.0))
    linear, _ = _criteria("linear", recordings, flat, straight)
    return DampingComparison(linear, *_criteria("nonlinear", recordings, foot, settings))


def _criteria(law: str, recordings: Sequence[Recording], foot: Foot, settings: Settings) -> tuple[Criteria, Validation]:
    fit = quick_fit(recordings, foot, settings)
    low, high = fit.problem.bounds()
    count, deviance, numbers = int((high > low).sum()), fit.chi_square, fit.problem.size
    errors = leave_one_frequency_out(recordings, foot, "pooled", settings)
    criteria = Criteria(
        law, count, deviance, deviance + 2 * count, deviance + float(np.log(numbers)) * count, fit.chi_square,
        max(0, numbers - count), errors.percent, errors.chi_square_per_number,
    )  # fmt: skip
    return criteria, errors
