"""Which mirror branch a subject's fits belong to, all together: likelihood, continuity, a prior.

Each fit alone may not decide between its two branches. Together they can: the constants of one foot change smoothly
with frequency and load, so that a choice which jumps between branches from one fit to the next is unlikely. The
probability of every assignment is

    log P = - sum_i D_i(b_i) / 2 - sum_(neighbours i, j) d_ij(b_i, b_j) / 2 + log prior

with the deviances D of the fits and d = sum over curves of (difference of logarithms)^2 / variance. Smoothness cannot
tell all-of-one-branch from all-of-the-other, as the mirror image of a smooth curve is smooth; likelihood or prior must.
Marginal odds are exact: a forward-backward pass over frequencies, all fits of one as a state.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
from scipy.special import logsumexp

from fasbody.exceptions import SettingError, unknown
from fasbody.presentation import readable
from identification.branches import DECISIVE_ODDS, EXCHANGED, pinned
from identification.parameters import limits

#: Curves whose continuity counts.
CURVES = EXCHANGED
#: Prior odds for each fit of the stated order of the stiffnesses.
BELIEVED = 1e4
#: A value outside a prior's range costs one standard deviation for this change of its logarithm.
_OUTSIDE = 0.1
#: Change of a constant's logarithm that is usual: for a factor e of frequency, for a kilogram of load, between trials.
PER_LOG_FREQUENCY, PER_KG, BETWEEN_TRIALS = 1.5, 0.4, 0.1
#: States of one frequency at most: memory, and 16 fits.
_STATES = 2**16
#: Tables of two neighbouring columns by places in them.
Link = Mapping[tuple[int, int], np.ndarray]


@dataclass(frozen=True)
class BranchFit:
    """One branch of one fit: named values, their relative standard errors (missing: unknown), -2 log likelihood."""

    name: str
    values: Mapping[str, float]
    relative_errors: Mapping[str, float]
    deviance: float


@dataclass(frozen=True)
class Fit:
    """One fit of a subject.

    Attributes:
        frequency_hz: None for a pooled one.
        added_mass_kg: load.
        branches: both of them.
        key: of its document.
    """

    frequency_hz: float | None
    added_mass_kg: float
    branches: tuple[BranchFit, ...]
    key: str = ""

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """From a fit's JSON document with `result`, as a study stores it.

        Where the model misfits, the deviances of a model assumed exact are scaled by the reduced chi-square as in
        branches.judge; where the scatter of the recordings was estimated, they are Student's. As in branches.judge
        a branch whose stiffness or damping rests on a bound is not penalised, as it would fit better beyond.
        """
        result = document["result"]
        weighed = deviances(result)
        branches, least = [], min(weighed)
        for branch, deviance in zip(result["branches"], weighed, strict=True):
            values, errors = {}, {}
            for key, e in branch["parameters"].items():
                name = next((n for n in (*CURVES, "c_12", "c_13", "c_22", "c_23") if key.startswith(f"{n}_")), key)
                values[name] = e["value"]
                if e["std_error"] is not None and np.isfinite(e["std_error"]) and e["value"]:
                    errors[name] = abs(e["std_error"] / e["value"])
            rests = pinned({key: bool(e["at_bound"]) for key, e in branch["parameters"].items()})
            branches.append(BranchFit(branch["name"], values, errors, least if rests else deviance))
        f = document["frequency_hz"]
        frequency_hz = None if f is None else round(f, 1)
        return cls(frequency_hz, document["added_mass_kg"], tuple(branches), document.get("key", ""))


def deviances(result: Mapping[str, Any]) -> list[float]:
    """-2 log likelihood of each branch of a result's document, up to a constant."""
    objectives = [float(branch["deviance"]) for branch in result["branches"]]
    world, goodness = result["branches"][0].get("world"), result["goodness_of_fit"]
    if world is None:
        excess = max(1.0, goodness["chi_square"] / max(1, goodness["dof"]))
        return [objective / excess for objective in objectives]
    if not world["repeatability"]:
        return objectives
    nu, least = max(2, world["dof"]), min(objectives)
    return [float(nu * np.log1p((objective - least) / nu)) for objective in objectives]


@dataclass(frozen=True)
class Prior:
    """Prior knowledge of the constants.

    Attributes:
        ranges: name -> (lower, upper) in which the constant lies.
        stiff_ankle_odds: of k_T above k_F over the contrary, 1 for none.
    """

    ranges: Mapping[str, tuple[float, float]] | None = None
    stiff_ankle_odds: float = 1.0

    @classmethod
    def read(cls, texts: Sequence[str]) -> Self | None:
        """From the command line: "k_T>k_F", "k_T<k_F", or ranges such as "k_F=5e4:2e5"; None of nothing.

        Raises:
            SettingError: none of these, or more than one order.
        """
        odds = {"k_T>k_F": BELIEVED, "k_F<k_T": BELIEVED, "k_T<k_F": 1 / BELIEVED, "k_F>k_T": 1 / BELIEVED}
        plain = [text.replace(" ", "") for text in texts]
        orders = [text for text in texts if "<" in text or ">" in text]
        try:
            ranges = limits([text for text in plain if text not in odds], "--prior")
        except SettingError as problem:
            raise SettingError(f"{str(problem).rstrip('.')}, nor an order: k_T>k_F or k_T<k_F.") from None
        for name, (low, high) in ranges.items():
            if name not in CURVES:
                raise SettingError(f"{unknown('parameter with a prior', name, CURVES)}, or k_T>k_F, k_T<k_F.")
            if not 0 < low < high:
                raise SettingError(f"--prior {name}={low:g}:{high:g} is not a range; give 0 < lower < upper.")
        if len(orders) > 1:
            raise SettingError(f"--prior orders k_T and k_F {len(orders)} times ({', '.join(orders)}); give one order.")
        order = next((odds[text] for text in plain if text in odds), 1.0)
        return cls(ranges, order) if texts else None

    def log(self, values: Mapping[str, float]) -> float:
        """Log prior up to a constant."""
        total = np.log(self.stiff_ankle_odds) if values["k_T"] > values["k_F"] else 0.0
        for name, (low, high) in (self.ranges or {}).items():
            beyond = np.log(values[name] / np.clip(values[name], low, high))
            total -= 0.5 * (beyond / _OUTSIDE) ** 2
        return float(total)


def log_weight(fit: Fit, branch: BranchFit, prior: Prior) -> float:
    """Log probability of one branch of one fit, without its neighbours, up to a constant."""
    least = min(b.deviance for b in fit.branches)
    return float(-0.5 * (branch.deviance - least) + prior.log(branch.values))


@dataclass(frozen=True)
class Choice:
    """The branch of one fit: its name, or "undecided"; the likelier one; its odds over the others."""

    key: str
    frequency_hz: float | None
    added_mass_kg: float
    branch: str
    likelier: str
    odds: float


@dataclass(frozen=True)
class Tracking:
    """The branches of all fits, chosen together.

    Attributes:
        choices: one a fit.
        overall: odds of each branch for all fits, over the other one for all. Assignments that mix branches are not in
            it.
        sentence: for people.
    """

    choices: tuple[Choice, ...]
    overall: Mapping[str, float]
    sentence: str

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def track(fits: Sequence[Fit], *, prior: Prior | None = None) -> Tracking:
    """Choose the branches of a subject's fits together.

    Args:
        fits: per recording, or pooled (frequency None), of one subject and posture.
        prior: of the constants.

    Raises:
        SettingError: no fit, one without branches, or too many at one frequency.
    """
    if not fits or any(not fit.branches for fit in fits):
        raise SettingError("tracking needs a fit, and each fit a branch.")
    alone = [np.array([log_weight(fit, b, prior or Prior()) for b in fit.branches]) for fit in fits]
    columns: list[list[int]] = []
    for f in sorted({fit.frequency_hz for fit in fits}, key=lambda f: -np.inf if f is None else f):
        at = [i for i, fit in enumerate(fits) if fit.frequency_hz == f]
        columns.append(sorted(at, key=lambda i: fits[i].added_mass_kg))
    if max(np.prod([len(fits[i].branches) for i in column]) for column in columns) > _STATES:
        raise SettingError(
            f"too many fits at one frequency for exact odds ({max(map(len, columns))}; valid: up to 16)."
        )
    inside = [_inside(fits, alone, column) for column in columns]
    links = [_links(fits, left, right) for left, right in pairwise(columns)]
    forward = [inside[0]]
    for weight, link in zip(inside[1:], links, strict=True):
        forward.append(weight + _carry(forward[-1], link, weight.ndim))
    backward = [np.zeros_like(inside[-1])]
    for before, weight, link in zip(inside[-2::-1], inside[:0:-1], links[::-1], strict=True):
        back = {(n, m): table.T for (m, n), table in link.items()}
        backward.insert(0, _carry(weight + backward[0], back, before.ndim) + np.zeros_like(before))
    decided: dict[int, Choice] = {}
    for column, a, b in zip(columns, forward, backward, strict=True):
        for place, i in enumerate(column):
            others = tuple(axis for axis in range(len(column)) if axis != place)
            decided[i] = _decide(fits[i], logsumexp(a + b, axis=others))
    overall = _overall(fits, alone, columns, links)
    choices = tuple(choice for _, choice in sorted(decided.items()))
    return Tracking(choices, overall, _sentence(choices, overall))


def _step(a: Fit, i: int, b: Fit, j: int) -> float:
    """Log probability of two neighbouring branches, the same for their mirror images.

    Exact images change as smoothly as what they mirror. Estimates at bounds or without an error are no exact images,
    and would decide by that alone: a link may say that two fits belong together, and not which branch they are.
    """
    if len(a.branches) == len(b.branches) == 2:
        return 0.5 * (_smooth(a, i, b, j) + _smooth(a, 1 - i, b, 1 - j))
    return _smooth(a, i, b, j)


def _smooth(a: Fit, i: int, b: Fit, j: int) -> float:
    """Log probability of two neighbouring values, the variance being that of the estimates and of a usual change."""
    p, q = a.branches[i], b.branches[j]
    usual = (PER_KG * (a.added_mass_kg - b.added_mass_kg)) ** 2 + 2 * BETWEEN_TRIALS**2
    if a.frequency_hz and b.frequency_hz:
        usual += (PER_LOG_FREQUENCY * np.log(a.frequency_hz / b.frequency_hz)) ** 2
    total = 0.0
    for name in CURVES:
        if name in p.values and name in q.values and p.values[name] > 0 < q.values[name]:
            variance = usual + p.relative_errors.get(name, 1.0) ** 2 + q.relative_errors.get(name, 1.0) ** 2
            total -= 0.5 * (np.log(p.values[name] / q.values[name]) ** 2 / variance + np.log(variance))
    return total


def _table(a: Fit, b: Fit) -> np.ndarray:
    """Log weight (branches of a, branches of b) of two neighbours: all that a link ever needs."""
    return np.array([[_step(a, i, b, j) for j in range(len(b.branches))] for i in range(len(a.branches))])


def _inside(fits: Sequence[Fit], alone: Sequence[np.ndarray], column: Sequence[int]) -> np.ndarray:
    """Log weight of the states of one frequency, an axis a fit: every fit alone, and neighbouring loads together."""
    total = np.zeros([len(fits[i].branches) for i in column])
    for place, i in enumerate(column):
        total = total + _along(alone[i], (place,), total.ndim)
    for place, (i, j) in enumerate(pairwise(column)):
        total = total + _along(_table(fits[i], fits[j]), (place, place + 1), total.ndim)
    return total


def _along(values: np.ndarray, axes: tuple[int, ...], ndim: int) -> np.ndarray:
    """Values whose axes are those of a larger array, in ascending order, made to broadcast to it."""
    return np.expand_dims(values, tuple(axis for axis in range(ndim) if axis not in axes))


def _links(fits: Sequence[Fit], left: Sequence[int], right: Sequence[int]) -> Link:
    """Tables of neighbouring frequencies under the same load, by places in their columns; repeat goes with repeat."""

    def under(column: Sequence[int], load: float) -> list[int]:
        return [place for place, i in enumerate(column) if fits[i].added_mass_kg == load]

    loads = sorted({fits[i].added_mass_kg for i in left})
    same = [pair for load in loads for pair in zip(under(left, load), under(right, load), strict=False)]
    return {(m, n): _table(fits[left[m]], fits[right[n]]) for m, n in same}


def _carry(message: np.ndarray, link: Link, ndim: int) -> np.ndarray:
    """Sum a message over the states of its own column, for each state of the next, which has `ndim` fits.

    A link is a sum over pairs of fits, so that one fit after the other is summed out: n 2^n terms where the pairs of
    states are 4^n. Fits without a partner are summed out, and the message does not depend on the next column's others.
    """
    tables = {m: table for (m, _), table in link.items()}
    for m in range(message.ndim):
        table = tables.get(m, np.zeros((message.shape[m], 1)))
        moved = np.moveaxis(message, m, -1)[..., :, None] + table
        message = np.moveaxis(logsumexp(moved, axis=-2), -1, m)
    lone = tuple(m for m in range(message.ndim) if m not in tables)
    order = [n for _, n in sorted(link)]
    message = message.squeeze(lone).transpose(np.argsort(order))
    return _along(message, tuple(sorted(order)), ndim)


def _decide(fit: Fit, log_p: np.ndarray) -> Choice:
    best = int(np.argmax(log_p))
    rest = np.delete(log_p, best)
    odds = float(np.exp(min(700.0, log_p[best] - logsumexp(rest)))) if rest.size else float("inf")
    name = fit.branches[best].name
    chosen = name if odds > DECISIVE_ODDS else "undecided"
    return Choice(fit.key, fit.frequency_hz, fit.added_mass_kg, chosen, name, odds)


def _overall(
    fits: Sequence[Fit], alone: Sequence[np.ndarray], columns: Sequence[Sequence[int]], links: Sequence[Link]
) -> dict[str, float]:
    """Odds of keeping to one branch throughout, for each branch that every fit has, against keeping to another.

    Assignments that mix branches, which may be likelier than both, are not in it.
    """
    branches = [[b.name for b in fit.branches] for fit in fits]
    names = [n for n in branches[0] if all(n in of_fit for of_fit in branches)]
    weights = []
    for name in names:
        k = [of_fit.index(name) for of_fit in branches]
        total = sum(float(alone[i][k[i]]) for i in range(len(fits)))
        for column in columns:
            total += sum(_step(fits[i], k[i], fits[j], k[j]) for i, j in pairwise(column))
        for (left, right), link in zip(pairwise(columns), links, strict=True):
            total += sum(table[k[left[m]], k[right[n]]] for (m, n), table in link.items())
        weights.append(total)
    odds = {}
    for name, weight in zip(names, weights, strict=True):
        rest = [w for other, w in zip(names, weights, strict=True) if other != name]
        odds[name] = float(np.exp(np.clip(weight - logsumexp(rest), -700, 700))) if rest else float("inf")
    return odds


def _sentence(choices: Sequence[Choice], overall: Mapping[str, float]) -> str:
    count = Counter(c.branch for c in choices if c.branch != "undecided")
    parts = ", ".join(f"{n} {name}" for name, n in count.items()) or "none"
    text = f"Of {len(choices)} fits together {count.total()} are decided ({parts})."
    if overall:
        name, odds = max(overall.items(), key=lambda item: item[1])
        if odds <= DECISIVE_ODDS:
            even = "the odds are even" if odds < 1.05 else f"odds {readable(odds)} to 1 for the {name}"
            text += f" If it is one branch throughout, {even}, which is undecided: "
            text += "a second load, a prior or a sensor on the foot bones must tell."
        else:
            size = "more than a million" if odds > 1e6 else readable(odds)
            text += f" If it is one branch throughout: {name}, odds {size} to 1."
    return text
