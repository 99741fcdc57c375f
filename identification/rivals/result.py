"""Estimates and scores of rivals on the same recordings, and the conclusions that they share."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fasbody.constants import Z95
from fasbody.exceptions import SettingError, unknown
from fasbody.presentation import Presented, Sheet, Tabled, listed
from identification.branches import DECISIVE_ODDS
from identification.estimates import Estimate
from identification.steady import FOLLOWS

#: Difference of BIC that odds of 1000 to 1 make.
DECISIVE = 2 * float(np.log(DECISIVE_ODDS))
#: Names of the rungs that are the model itself, and whose constants change with the load.
MODEL, LOAD = "model", "load"
_CONSTANT = (
    "The branch is decided if no constant changes with the load, as the adequate models assume. fasbody fit allows a "
    "change, so it may leave the branch undecided."
)


@dataclass(frozen=True)
class RivalConstant:
    """A constant that only a rival has: name, meaning, unit, value, 95 % limits, source of prior and bounds."""

    name: str
    says: str
    unit: str
    value: float
    lower: float
    upper: float
    source: str

    def __str__(self) -> str:
        return f"{self.name} {self.value:.3g} ({self.lower:.3g} to {self.upper:.3g}) {self.unit}".rstrip()


@dataclass(frozen=True, eq=False)
class Rival(Tabled):
    """One rung, at its best.

    Attributes:
        name, title: of the rung, or the name of a user's file.
        free: parameters that BIC counts.
        chi_square, dof: of the recordings, as all rivals weigh them.
        bic: deviance, with the squares of the priors' rows, and free log n; the deviance is
            chi-square, or Student's where repeatability was estimated.
        held_out: -2 log of the predictive density of recordings left out, by "frequency" and
            "load", as far as there are several.
        error: of those predictions, as a share of what was recorded.
        branch: the likelier one, "best" where no mirror is known.
        log_odds: over the other, None where not compared.
        k_T, k_F: without load, on the likelier branch, dynamic where springs relax; None where the
            model has none.
        log_ratio: of k_T over k_F with its standard error.
        other: k_T and k_F of the other branch where it stays open.
        constants: those that only this rival has.
        values: all constants.
        predicted: harmonics of each recording [m/s^2].
        converged: the descent came to rest.
        extra: it frees more than the model.
        repeatability: what recordings would have to repeat to if it were right.
        penalty: of its parameters, in BIC.
    """

    name: str
    title: str
    free: int
    chi_square: float
    dof: int
    bic: float
    held_out: Mapping[str, float]
    error: float
    branch: str
    log_odds: float | None
    k_T: Estimate | None
    k_F: Estimate | None
    log_ratio: tuple[float, float] | None
    other: tuple[Estimate, Estimate] | None
    constants: tuple[RivalConstant, ...]
    values: Mapping[str, float]
    predicted: tuple[np.ndarray, ...]
    converged: bool
    extra: bool
    repeatability: float
    penalty: float = 0.0

    @property
    def deviance(self) -> float:
        """BIC without the penalty for its parameters."""
        return self.bic - self.penalty

    @property
    def follows(self) -> bool:
        """It describes the recordings, if they repeat no worse than people do."""
        return self.repeatability <= FOLLOWS

    @property
    def surprise(self) -> float:
        """Mean of the held-out deviances; zero where nothing could be left out."""
        return float(np.mean(list(self.held_out.values()))) if self.held_out else 0.0

    @property
    def decided(self) -> bool:
        """One branch is likelier by 1000 to 1, and the rival follows the recordings."""
        return self.follows and self.log_odds is not None and self.log_odds > np.log(DECISIVE_ODDS)

    def estimates(self, name: str) -> list[Estimate]:
        """Of k_T or k_F: on the likelier branch, then on the other one where it stays open."""
        first = self.k_T if name == "k_T" else self.k_F
        other = self.other[name == "k_F"] if self.other and not self.decided else None
        return [e for e in (first, other) if e]

    @property
    def stiffer(self) -> str:
        """Which spring is stiffer at 95 %: "k_T", "k_F" or "" where that stays open."""
        if self.log_ratio is None or (self.log_odds is not None and not self.decided):
            return ""
        value, std = self.log_ratio
        return "" if not abs(value) > Z95 * std else "k_T" if value > 0 else "k_F"


@dataclass(frozen=True)
class Conclusion:
    """A conclusion on the foot, and whether every adequate rival supports it.

    Attributes:
        what: "k_T", "k_F", "branch" or "stiffer".
        shared: all adequate rivals support it.
        text: a sentence.
        lower, upper: of a constant, over all adequate rivals [N/m]; None else.
    """

    what: str
    shared: bool
    text: str
    lower: float | None = None
    upper: float | None = None


@dataclass(frozen=True, eq=False)
class Point:
    """One recording as measured: fundamental [Hz], load [kg], harmonics of base and malleolus, noise [m/s^2]."""

    file: str
    frequency_hz: float
    load_kg: float
    base: np.ndarray
    malleolus: np.ndarray
    std: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Rivals(Presented):
    """The comparison: rivals in order, the one that the recordings prefer first.

    Attributes:
        repeatability: relative standard deviation of a harmonic from recording to recording beside the sensors' noise,
            by the rival that needs the least; all are weighted with it.
    """

    figures: ClassVar[str] = "identification.rivals.figures"
    plots: ClassVar[tuple[str, ...]] = ("predictions", "constants")

    source: str
    model: str
    rivals: tuple[Rival, ...]
    points: tuple[Point, ...]
    repeatability: float
    warnings: tuple[str, ...]
    seconds: float

    def __getitem__(self, name: str) -> Rival:
        """A rival by its name."""
        for rival in self.rivals:
            if rival.name == name:
                return rival
        raise SettingError(f"{unknown('rival', name, (r.name for r in self.rivals))}.")

    @property
    def first(self) -> Rival:
        """The rival that the recordings prefer."""
        return self.rivals[0]

    @property
    def adequate(self) -> tuple[Rival, ...]:
        """Those that follow the recordings and are not out-predicted: BIC within odds of 1000 to 1 of the best."""
        good = [r for r in self.rivals if r.follows]
        least = min((r.bic for r in good), default=0.0)
        return tuple(r for r in good if r.bic - least <= DECISIVE)

    @property
    def not_needed(self) -> tuple[Rival, ...]:
        """Those that describe the recordings as well, and are behind for their parameters alone."""
        adequate = self.adequate
        least = min((r.deviance for r in adequate), default=-np.inf)
        return tuple(r for r in self.rivals if r.follows and r not in adequate and r.deviance - least <= DECISIVE)

    @property
    def conclusions(self) -> tuple[Conclusion, ...]:
        """Conclusions on k_T, k_F, the branch, and which spring is stiffer."""
        return conclusions(self.adequate)

    def sentence(self) -> str:
        """The result in a sentence."""
        if not self.adequate:
            return (
                f"No model follows the recordings, so there is no conclusion about the foot. The best, "
                f"{self.first.title}, deviates by {100 * self.first.repeatability:.3g} %, and recordings of people "
                f"repeat to {100 * FOLLOWS:.3g} % or better."
            )
        shared = [c.text for c in self.conclusions if c.shared]
        changing = [c.text for c in self.conclusions if not c.shared]
        also, more = [r.title for r in self.adequate if r is not self.first], [r.title for r in self.not_needed]
        rest = len(self.rivals) - 1 - len(also) - len(more)
        texts = [f"Preferred model: {self.first.title}."]
        texts += [f"Also adequate: {'; '.join(also)}."] * bool(also)
        texts += [f"Fit as well, but with more constants: {'; '.join(more)}."] * bool(more)
        texts += [f"{'The other models' if also or more else 'All other models'} are ruled out."] * bool(rest)
        agree = "All adequate models agree that" if also else f"With {self.first.title} (preferred),"
        none = "The adequate models agree on no conclusion." if also else "The preferred model allows no conclusion."
        texts.append(f"{agree} {listed(shared)}." if shared else none)
        texts += [f"Undecided {'are' if len(changing) > 1 else 'is'} {listed(changing)}."] * bool(changing)
        return " ".join([*texts, *([_CONSTANT] if self._by_load else [])])

    @property
    def _by_load(self) -> bool:
        """Whether the branch rests on the loads, and on constants that do not change with them."""
        decided = any(c.what == "branch" and c.shared for c in self.conclusions)
        loads = {point.load_kg for point in self.points}
        return decided and len(loads) > 1 and not any(r.name == LOAD for r in self.adequate)

    def sheet(self) -> Sheet:
        """The rivals side by side."""
        best = min(r.bic for r in self.rivals)
        held = min(r.surprise for r in self.rivals)
        adequate = self.adequate

        def branch(r: Rival) -> str:
            decided = r in adequate and r.decided
            return "–" if r.log_odds is None else r.branch if decided else f"{r.branch}?"

        rows = [
            (
                r.title, str(r.free), f"{100 * r.repeatability:.2g} %", f"{r.bic - best:.4g}",
                f"{r.surprise - held:.4g}" if r.held_out else "–", f"{100 * r.error:.2g} %" if r.held_out else "–",
                branch(r), r.k_T.interval() if r.k_T else "–", r.k_F.interval() if r.k_F else "–",
                "yes" if r in adequate else "no",
            )
            for r in self.rivals
        ]  # fmt: skip
        columns = (
            "model", "parameters", "scatter", "BIC over best", "held-out over best", "held-out error", "branch",
            "k_T [N/m]", "k_F [N/m]", "adequate",
        )  # fmt: skip
        notes = [self.sentence(), self._repeating()]
        if self.first.constants and self.first.follows:
            notes.append(f"{self.first.title}: {'; '.join(map(str, self.first.constants))}.")
        return Sheet(f"{self.source}: rivals of {self.model}", columns, rows, [*notes, *self.warnings])

    def _repeating(self) -> str:
        least = min(self.rivals, key=lambda r: r.repeatability)
        scatter = f"{100 * self.repeatability:.2g} %" if self.repeatability else "within the sensors' noise"
        return f"The scatter between recordings is {scatter}. It is estimated with {least.title!r} and used for all."

    def records(self) -> list[dict[str, Any]]:
        """One row a rival."""
        rows = []
        for place, r in enumerate(self.rivals, start=1):
            row: dict[str, Any] = {"place": place, "rival": r.name, "free": r.free, "chi_square": r.chi_square}
            row |= {"dof": r.dof, "bic": r.bic, "adequate": r in self.adequate, "branch": r.branch}
            row |= {"log_odds": r.log_odds, "held_out_error": r.error, "repeatability": r.repeatability}
            row |= {f"held_out_{kind}": r.held_out.get(kind) for kind in ("frequency", "load")}
            for name, e in (("k_T", r.k_T), ("k_F", r.k_F)):
                row |= {f"{name}{end}_n_per_m": getattr(e, which) if e else None for end, which in _ENDS}
            rows.append(row)
        return rows

    def document(self) -> dict[str, Any]:
        """The comparison as plain data."""
        rivals = []
        for r, row in zip(self.rivals, self.records(), strict=True):
            more = {"title": r.title, "converged": r.converged, "own": [*map(asdict, r.constants)]}
            rivals.append(row | more | {"values": dict(r.values)})
        return {
            "source": self.source, "model": self.model, "first": self.first.name, "sentence": self.sentence(),
            "adequate": [r.name for r in self.adequate], "not_needed": [r.name for r in self.not_needed],
            "rivals": rivals,
            "conclusions": [asdict(c) for c in self.conclusions], "repeatability": self.repeatability,
            "warnings": list(self.warnings), "seconds": self.seconds,
        }  # fmt: skip


#: Columns that a narrow terminal leaves out first.
SPARED = ("held-out over best", "BIC over best", "parameters", "scatter", "held-out error", "branch")
_ENDS = (("", "value"), ("_lower", "lower"), ("_upper", "upper"))


def preferred(rivals: list[Rival]) -> list[Rival]:
    """Rivals by BIC and held-out deviance together, from the best.

    A rival that frees more than the model is put before it only if BIC says so by odds of 1000 to 1 and held-out
    recordings do not say otherwise: one of many is the best by chance.
    """
    least = min(r.bic for r in rivals), min(r.surprise for r in rivals)
    order = sorted(rivals, key=lambda r: r.bic - least[0] + r.surprise - least[1])
    model = next((r for r in rivals if r.name == MODEL), None)
    if model is None:
        return order
    first = order[0]
    if first.extra and (model.bic - first.bic < DECISIVE or model.surprise < first.surprise):
        decisive = [r for r in order if r.extra and model.bic - r.bic >= DECISIVE and model.surprise >= r.surprise]
        plain = [r for r in order if not r.extra]
        first = (decisive or plain)[0]
    return [first, *(r for r in order if r is not first)]


def conclusions(adequate: tuple[Rival, ...]) -> tuple[Conclusion, ...]:
    """Conclusions of adequate rivals, and whether they agree.

    A value is shared if the interval of each rival holds the estimate of the first; a branch or an order of the springs
    if all decide it, and alike.
    """
    rivals = [r for r in adequate if r.k_T and r.k_F]
    if not rivals:
        return ()
    items = []
    for name in ("k_T", "k_F"):
        estimates = [e for r in rivals for e in r.estimates(name)]
        first, low, high = estimates[0], min(e.lower for e in estimates), max(e.upper for e in estimates)
        shared = all(e.lower <= first.value <= e.upper for e in estimates)
        union = replace(first, value=0.5 * (low + high), lower=low, upper=high)
        span = f"{union.text(low)} to {union.text(high)} N/m"
        over = " over both branches" * (len(estimates) > len(rivals))
        text = f"{name} is {span}{over}" if shared else f"{name} ({span})"
        items.append(Conclusion(name, shared, text, low, high))
    compared = [r for r in rivals if r.log_odds is not None]
    if compared:
        names = {r.branch if r.decided else "" for r in compared}
        shared = len(names) == 1 and "" not in names
        text = f"the branch is {compared[0].branch}" if shared else "the branch"
        items.append(Conclusion("branch", shared, text))
    order = {r.stiffer for r in rivals}
    shared = len(order) == 1 and "" not in order
    text = f"{order.copy().pop()} is the stiffer spring" if shared else "which spring is stiffer"
    return (*items, Conclusion("stiffer", shared, text))
