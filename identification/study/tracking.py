"""Which mirror branch a subject's fits belong to, all together: likelihood, continuity, a prior.

Each fit alone may not decide between its two branches. Together they can: the constants of one foot change smoothly
with frequency and load, so that a choice which jumps between branches from one fit to the next is unlikely. The
probability of every assignment is

    log P = - sum_i D_i(b_i) / 2 - sum_(neighbours i, j) d_ij(b_i, b_j) / 2 + log prior

with the deviances D of the fits and d = sum over curves of (difference of logarithms)^2 / variance. Smoothness cannot
tell all-of-one-branch from all-of-the-other, as the mirror image of a smooth curve is smooth; likelihood or prior must.
Odds of each fit are exact sums over all assignments.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
#: Fits of one frequency at most: their joint states are 2 to that power.
MOST_FITS = 16
#: Odds beyond this are written as this: JSON has no infinity.
LARGEST_ODDS = float(np.exp(700))
#: Log weights of the branches of two fits, by their places.
Links = Mapping[tuple[int, int], np.ndarray]


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
    most = max(Counter(fit.frequency_hz for fit in fits).values())
    if most > MOST_FITS:
        raise SettingError(f"too many fits at one frequency for exact odds ({most}; valid: up to {MOST_FITS}).")
    order = sorted(range(len(fits)), key=lambda i: (fits[i].frequency_hz or 0.0, fits[i].added_mass_kg))
    ordered = [fits[i] for i in order]
    alone = []  # log probability (b,) of a fit's branches without its neighbours, up to a constant
    for fit in ordered:
        least = min(branch.deviance for branch in fit.branches)
        known = [(prior or Prior()).log(branch.values) for branch in fit.branches]
        alone.append(np.array(known) - 0.5 * np.array([b.deviance - least for b in fit.branches]))
    links = _links(ordered)
    places = zip(order, ordered, probabilities(alone, links), strict=True)
    choices = tuple(_choice(fit, p) for _, fit, p in sorted(places, key=lambda place: place[0]))
    overall = _overall(ordered, alone, links)
    return Tracking(choices, overall, _sentence(choices, overall))


def _links(fits: Sequence[Fit]) -> Links:
    """Log weights of neighbours: under the next load, or the same one at the next frequency."""
    columns: dict[float | None, list[int]] = {}
    for i, fit in enumerate(fits):
        columns.setdefault(fit.frequency_hz, []).append(i)
    pairs = [pair for column in columns.values() for pair in pairwise(column)]
    for left, right in pairwise(columns.values()):
        for load in sorted({fits[i].added_mass_kg for i in left}):
            under = [[i for i in at if fits[i].added_mass_kg == load] for at in (left, right)]
            pairs += zip(*under, strict=False)
    return {(i, j): _link(fits[i], fits[j]) for i, j in pairs}


def _link(a: Fit, b: Fit) -> np.ndarray:
    """Log weight (branches of a, branches of b) of two neighbours, the same for their mirror images.

    Exact images change as smoothly as what they mirror. Estimates at bounds or without an error are
    no exact images, and would decide by that alone: a link may say that two fits belong together,
    and not which branch they are.
    """
    table = np.array([[_smooth(a, p, b, q) for q in b.branches] for p in a.branches])
    return 0.5 * (table + table[::-1, ::-1]) if table.shape == (2, 2) else table


def _smooth(a: Fit, p: BranchFit, b: Fit, q: BranchFit) -> float:
    """Log probability of two neighbours, the variance being that of estimates and a usual change."""
    usual = (PER_KG * (a.added_mass_kg - b.added_mass_kg)) ** 2 + 2 * BETWEEN_TRIALS**2
    if a.frequency_hz and b.frequency_hz:
        usual += (PER_LOG_FREQUENCY * np.log(a.frequency_hz / b.frequency_hz)) ** 2
    total = 0.0
    for name in CURVES:
        if p.values.get(name, 0.0) > 0 < q.values.get(name, 0.0):
            errors = (branch.relative_errors.get(name, 1.0) for branch in (p, q))
            variance = usual + sum(error**2 for error in errors)
            change = np.log(p.values[name] / q.values[name])
            total -= 0.5 * (change**2 / variance + np.log(variance))
    return total


def probabilities(alone: Sequence[np.ndarray], links: Links) -> list[np.ndarray]:
    """Probability of each fit's branches, exactly, over all assignments.

    Forward, one fit after the other is joined to those that still have links ahead; a fit without
    any is summed out. Backward, the joint probability of the same few fits, until each was met.

    Args:
        alone: log weights of the branches of each fit, in order.
        links: (i, j) -> log weights of two fits, i before j.
    """
    last = [max([i, *(b for a, b in links if a == i)]) for i in range(len(alone))]
    front: list[int] = []
    log = np.zeros(())
    steps: list[tuple[int, np.ndarray] | None] = []
    for k, weight in enumerate(alone):
        log = log[..., None] + weight
        for axis, i in enumerate(front):
            if (i, k) in links:
                axes = [a for a in range(len(front)) if a != axis]
                log = log + np.expand_dims(links[i, k], axes)
        front.append(k)
        steps.append(None)
        for i in [i for i in front if last[i] <= k]:
            steps.append((front.index(i), log))
            log = np.logaddexp.reduce(log, axis=front.index(i))
            front.remove(i)
    joint, marginals = np.ones(()), list[np.ndarray]()
    for step in reversed(steps):
        if step is None:
            marginals.insert(0, joint.sum(axis=tuple(range(joint.ndim - 1))))
            joint = joint.sum(axis=-1)
        else:
            axis, before = step
            conditional = np.exp(before - np.logaddexp.reduce(before, axis=axis, keepdims=True))
            joint = np.expand_dims(joint, axis) * conditional
    return marginals


def _choice(fit: Fit, p: np.ndarray) -> Choice:
    best = int(np.argmax(p))
    others = float(np.delete(p, best).sum())
    odds = min(float(p[best]) / others, LARGEST_ODDS) if others else LARGEST_ODDS
    odds = odds if p.size > 1 else float("inf")
    name = fit.branches[best].name
    chosen = name if odds > DECISIVE_ODDS else "undecided"
    return Choice(fit.key, fit.frequency_hz, fit.added_mass_kg, chosen, name, odds)


def _overall(fits: Sequence[Fit], alone: Sequence[np.ndarray], links: Links) -> dict[str, float]:
    """Odds of one branch throughout over another one throughout, without mixed assignments."""
    names = [[branch.name for branch in fit.branches] for fit in fits]
    log = {}
    for name in (n for n in names[0] if all(n in of_fit for of_fit in names)):
        k = [of_fit.index(name) for of_fit in names]
        log[name] = sum(float(weight[at]) for weight, at in zip(alone, k, strict=True))
        log[name] += sum(float(table[k[i], k[j]]) for (i, j), table in links.items())
    odds = {}
    for name, weight in log.items():
        rest = [other for n, other in log.items() if n != name]
        odds[name] = float(np.exp(np.clip(weight - logsumexp(rest), -700, 700))) if rest else np.inf
    return odds


def _sentence(choices: Sequence[Choice], overall: Mapping[str, float]) -> str:
    count = Counter(c.branch for c in choices if c.branch != "undecided")
    parts = ", ".join(f"{n} {name}" for name, n in count.items()) or "none"
    text = f"Decided fits: {count.total()} of {len(choices)} ({parts})."
    if overall:
        name, odds = max(overall.items(), key=lambda item: item[1])
        if odds <= DECISIVE_ODDS:
            even = "the odds are even" if odds < 1.05 else f"odds {readable(odds)} to 1 for the {name}"
            text += f" If all fits are on one branch, {even}, which is undecided: "
            text += "a second load, a prior or a sensor on the foot bones is needed."
        else:
            size = "more than a million" if odds > 1e6 else readable(odds)
            text += f" If all fits are on one branch, it is the {name}, with odds of {size} to 1."
    return text
