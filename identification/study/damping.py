"""Linear against nonlinear damping: both laws fitted to the same recordings, and what each criterion prefers."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, unknown
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.engines.twin import twin_applies
from identification.estimate import Settings
from identification.space import space_of
from identification.study.trend import fit_trend
from identification.study.validation import Validation, leave_one_frequency_out, quick_fit

#: Constants that bend the dampers' law; without them it is linear.
NONLINEAR = ("c_12", "c_13", "c_22", "c_23")


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
    held_out_percent: float | None
    held_out_chi_square: float | None


@dataclass(frozen=True)
class DampingComparison:
    """Linear against nonlinear damping.

    Attributes:
        mode: of the fits. linear, nonlinear: their criteria. held_out: of the nonlinear law, None where not wanted.
    """

    mode: str
    linear: Criteria
    nonlinear: Criteria
    held_out: Validation | None = None

    def preferred(self, criterion: str) -> str:
        """The law with the lower "aic", "bic" or "held_out_percent"."""
        a, b = getattr(self.linear, criterion), getattr(self.nonlinear, criterion)
        return self.linear.law if a <= b else self.nonlinear.law

    def document(self) -> dict[str, Any]:
        """As plain data."""
        criteria = [c for c in ("aic", "bic", "held_out_percent") if getattr(self.linear, c) is not None]
        return {"mode": self.mode, "linear": asdict(self.linear), "nonlinear": asdict(self.nonlinear),
                "preferred": {c: self.preferred(c) for c in criteria}}  # fmt: skip

    def __str__(self) -> str:
        held = self.linear.held_out_percent, self.nonlinear.held_out_percent
        tail = "" if None in held else f"; held-out error {held[0]:.3g} % linear, {held[1]:.3g} % nonlinear"
        return (
            f"{self.mode}: AIC prefers {self.preferred('aic')} damping (difference "
            f"{self.linear.aic - self.nonlinear.aic:.4g}), BIC {self.preferred('bic')} "
            f"({self.linear.bic - self.nonlinear.bic:.4g}){tail}."
        )


def compare_damping(
    recordings: Sequence[Recording], foot: Foot, mode: str = "pooled", settings: Settings | None = None,
    *, held_out: bool = True,
) -> DampingComparison:  # fmt: skip
    """Fit with and without the constants that bend the dampers' law.

    Args:
        recordings: of one subject in one posture. foot: a model with the dampers of Eq. 4.25. mode: "pooled" (all
            recordings share constants) or "trend". settings: of the fits. held_out: leave one frequency out too.
    """
    settings = settings or Settings()
    if mode not in ("pooled", "trend"):
        raise SettingError(f"{unknown('mode', mode, ('pooled', 'trend'))}.")
    missing = [name for name in NONLINEAR if name not in foot.parameters]
    if missing:
        raise SettingError(f"model {foot.name} has no {', '.join(missing)}, so damping cannot be compared.")
    data = [checked(recording) for recording in recordings]
    free = settings.free or tuple(n for n in space_of(foot, None, None, False).names)
    straight = replace(settings, free=tuple(n for n in free if n not in NONLINEAR), bounds={
        n: b for n, b in (settings.bounds or {}).items() if n not in NONLINEAR} or None)  # fmt: skip
    flat = foot.with_values(dict.fromkeys(NONLINEAR, 0.0))
    found = [
        _criteria(law, data, model, mode, s, held_out)
        for law, model, s in (("linear", flat, straight), ("nonlinear", foot, settings))
    ]
    (linear, _), (nonlinear, errors) = found
    return DampingComparison(mode, linear, nonlinear, errors)


def _criteria(
    law: str, data: Sequence[Recording], foot: Foot, mode: str, settings: Settings, held_out: bool
) -> tuple[Criteria, Validation | None]:
    if mode == "pooled":
        fit = quick_fit(data, foot, settings, twin_applies(foot))
        count, deviance, chi_square, numbers = fit.q.size, fit.deviance, fit.chi_square, fit.numbers
        branch = None
    else:
        branch = fit_trend(data, foot, settings, certify=False).best
        count = branch.space.size + len(branch.scatter)
        deviance, chi_square, numbers = branch.deviance, branch.chi_square, branch.dof + branch.space.size
    errors = leave_one_frequency_out(data, foot, mode, settings, branch=branch) if held_out else None
    criteria = Criteria(
        law, count, deviance, deviance + 2 * count, deviance + float(np.log(numbers)) * count, chi_square,
        max(0, numbers - count), errors.percent if errors else None, errors.chi_square_per_number if errors else None,
    )  # fmt: skip
    return criteria, errors
