"""Leave one frequency out: what a model is worth where it was not fitted.

Per recording, a left-out recording is predicted from the estimates at the neighbouring frequencies under the same load;
pooled, from constants fitted to the other frequencies under that load; trend, from the curves fitted to all recordings
but those at that frequency. The lowest and the highest frequency are extrapolations, and marked so.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, SimulationError, unknown
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.certification import settle
from identification.domains import PeriodicDomain
from identification.engines.twin import twin_applies
from identification.estimate import Settings
from identification.periodic import Line
from identification.search import explore
from identification.space import Space, space_of
from identification.study.heldout import HeldOut, compare, interpolated, predicted
from identification.study.trend import TrendBranch, fit_trend, refit

MODES = ("per-recording", "pooled", "trend")


@dataclass(frozen=True)
class Validation:
    """Held-out errors of one mode.

    Attributes:
        mode: see MODES. rows: one a recording. failed: files whose prediction had no stable motion.
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

    def __str__(self) -> str:
        return f"{self.mode}: held-out error {self.percent:.2g} % (median), {len(self.rows)} recordings"


@dataclass(frozen=True, eq=False)
class QuickFit:
    """The likelier end of a fit on the twin, not certified: parameters q in the space, and what criteria need."""

    space: Space
    q: np.ndarray
    chi_square: float
    deviance: float
    numbers: int

    @property
    def values(self) -> dict[str, float]:
        """Parameters by name."""
        return self.space.values(self.space.to_theta(self.q))


def quick_fit(recordings: Sequence[Recording], foot: Foot, settings: Settings, twin: bool) -> QuickFit:
    """Fit checked recordings with constants, from the model's values and random starts, weights settled.

    Raises:
        SimulationError: every start was unstable.
    """
    several = len({round(r.condition.frequency_hz or 0.0, 1) for r in recordings}) > 1
    space = space_of(foot, settings.free, settings.bounds, several if settings.delay is None else settings.delay)
    domain = PeriodicDomain(foot, list(recordings), space, twin, settings.threads)
    rng = np.random.default_rng(settings.seed)
    starts = [("model", space.to_q(space.theta(foot.values())))]
    starts += [(f"random {i}", space.random(rng)) for i in range(1, settings.starts)]
    descents, _ = explore(replace(domain, excess=np.inf).problem(), starts)
    if descents[0].unstable:
        raise SimulationError(f"{foot.name}: every start was unstable; check the bounds and the model's parameters.")
    problem, d = settle(domain.weighed(descents[0].z), descents[0])
    return QuickFit(space, d.z, d.cost, d.cost + problem.log_determinant, problem.size)


def leave_one_frequency_out(
    recordings: Sequence[Recording],
    foot: Foot,
    mode: str,
    settings: Settings | None = None,
    *,
    estimates: Sequence[Mapping[str, float]] | None = None,
    branch: TrendBranch | None = None,
    advance: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> Validation:
    """Predict each frequency from the others.

    Args:
        recordings: of one subject in one posture. foot: the model. mode: see MODES. settings: of the fits.
        estimates: per-recording only: named values of each recording, such as a study has them; None fits here.
        branch: trend only: a fit of all recordings to start from; None fits here. advance: for a progress bar.

    Raises:
        SettingError: no such mode, or fewer than three frequencies under some load. SimulationError: no prediction was
            stable.
    """
    settings = settings or Settings()
    data = [checked(recording) for recording in recordings]
    lines, twin = [Line.of(recording) for recording in data], twin_applies(foot)
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
            Y = predicted(lines[i], foot, {**foot.values(), **values}, twin)
        except SimulationError:
            failed.append(data[i].file)
        else:
            rows.append(compare(lines[i], Y, edge=not used.min() < f[i] < used.max()))

    if mode == "trend" and branch is None:
        branch = fit_trend(data, foot, settings, certify=False).best
    if mode == "per-recording":
        space = space_of(foot, settings.free, settings.bounds, delay=True)
        named = estimates or [quick_fit([r], foot, settings, twin).values for r in data]
        q = np.array([space.to_q(space.theta(values)) for values in named])
        for i in range(len(data)):
            others = (loads == loads[i]) & (f != f[i])
            predict(i, space.values(space.to_theta(interpolated(f[i], list(f[others]), list(q[others])))), f[others])
        return _validation(mode, rows, failed)
    folds = [(m, at) for m in sorted(set(loads)) for at in sorted(set(f[loads == m]))] if mode == "pooled" else [
        (None, at) for at in sorted(set(f))]  # fmt: skip
    for number, (m, at) in enumerate(folds):
        advance(f"leaving out {at:g} Hz", number, len(folds))
        mine = np.ones(len(data), bool) if m is None else loads == m
        used, out = np.flatnonzero(mine & (f != at)), np.flatnonzero(mine & (f == at))
        try:
            if mode == "pooled":
                found = quick_fit([data[i] for i in used], foot, settings, twin)
                feet = [found.values for _ in out]
            else:
                assert branch is not None
                curves = refit(branch, [data[i] for i in used], foot, settings.threads)
                B = curves.space.design(f[out], loads[out])
                beta = curves.z[: curves.space.size]
                feet = [curves.space.values(curves.space.foot(weights, beta)[0]) for weights in B]
        except SimulationError:
            failed += [data[i].file for i in out]
            continue
        for place, values in zip(out, feet, strict=True):
            predict(int(place), values, f[used])
    return _validation(mode, rows, failed)


def _validation(mode: str, rows: Sequence[HeldOut], failed: Sequence[str]) -> Validation:
    if not rows:
        raise SimulationError(f"none of the {len(failed)} recordings left out had a stable prediction.")
    return Validation(mode, tuple(rows), tuple(failed))
