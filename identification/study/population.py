"""The persons behind a study's pooled fits: the mean of each constant, how much persons differ, and each one shrunk.

The logarithm of a constant of person i is mu + u_i, and the fit knows it to its standard error s_i, model and sensor
errors included. The mean is found by restricted maximum likelihood, by the machinery of the heels (heel/population.py),
with Student's t and the persons less one; no shape of the population enters. How much persons differ, each one's own
value and whether it belongs to the others' come from a posterior with tails that may be heavy (posterior.py). What all
persons have in common, such as a wrong gain of one laboratory's sensor, no number of persons takes away: it is not in
these intervals.

A person whose value does not belong to the others' is named, and stays in the estimate.

The odds of the branches multiply over persons whose errors are their own. Gain and mass tables are one laboratory's:
what a branch needs of them it may need once, and not once a person. So the odds are told twice, with what each fit pays
for departing from the stated gain, masses and so on summed over persons, and with its mean (what all would pay who
depart alike). The branch is decided where both say so, and go on saying so whichever person is left out: one whose
recordings were mixed up must not decide for the others.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.foot.parameters import symbol_and_unit
from fasbody.heel.population import FEWEST, Observed, estimate
from fasbody.presentation import Tabled, readable
from identification.branches import DECISIVE_ODDS, EXCHANGED, STIFF_ANKLE, STIFF_PAD
from identification.study.posterior import Posterior
from identification.study.summary import misfit
from identification.study.tracking import deviances

Document = Mapping[str, Any]
_LEVEL = 0.95
#: Chance, times the number of persons, below which a value does not belong to the others': so at most one clean
#: population of twenty has such a person whatever its shape (`python -m benchmarks.study_population`).
_ODD = 0.01
#: Logarithm of odds below which they are even.
_EVEN = 0.05


@dataclass(frozen=True)
class LeftOut:
    """A person who is left out, and why."""

    subject: str
    why: str


@dataclass(frozen=True)
class Person:
    """One person's constant, by the fit alone and shrunk to the population.

    Attributes:
        subject: who.
        value: of the fit.
        relative_error: its standard error over the value.
        shrunk: the value in view of the other persons.
        lower: end of its 95 % interval.
        upper: the other end.
        chance: that any of the persons lies so far from what the others predict.
    """

    subject: str
    value: float
    relative_error: float
    shrunk: float
    lower: float
    upper: float
    chance: float = 1.0


@dataclass(frozen=True)
class Constant(Tabled):
    """One constant of a population.

    Attributes:
        name: thesis symbol.
        mean: geometric mean over persons, in the constant's unit.
        lower: end of its 95 % interval.
        upper: the other end.
        spread: half the width that holds the logarithms of the middle two thirds of persons; of Gaussian persons their
            standard deviation.
        spread_lower: end of its 95 % interval.
        spread_upper: the other end.
        persons: one a person.
        left_out: persons whose fit has no estimate of it.
    """

    name: str
    mean: float
    lower: float
    upper: float
    spread: float
    spread_lower: float
    spread_upper: float
    persons: tuple[Person, ...]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def spread_text(self) -> tuple[str, str]:
        """The spread between persons and its 95 % interval, in words where none can be told."""
        if not self.spread_lower:
            return f"not determined by {len(self.persons)} persons", f"at most {100 * self.spread_upper:.2g} %"
        ends = f"{100 * self.spread_lower:.2g} to {100 * self.spread_upper:.2g} %"
        return f"{100 * self.spread:.2g} %", ends

    @property
    def odd(self) -> tuple[Person, ...]:
        """Persons whose value does not belong to the others', the oddest first."""
        return tuple(sorted((p for p in self.persons if p.chance < _ODD), key=lambda p: p.chance))


@dataclass(frozen=True)
class Population(Tabled):
    """The persons of a study in one posture under one load, all on one branch.

    Attributes:
        posture: what they share.
        added_mass_kg: what they share.
        branch: which.
        verdict: "decided" where all persons' fits together speak for it by more than 1000 to 1, by both odds and
            without any one of them, else "undecided".
        odds_log: natural logarithm of the odds if each person errs alone.
        common_odds_log: if what they depart from the stated gain, masses and so on is common to all.
        constants: by name.
        left_out: persons without a fit that counts.
    """

    posture: str
    added_mass_kg: float
    branch: str
    verdict: str
    odds_log: float
    common_odds_log: float
    constants: tuple[Constant, ...]
    left_out: tuple[LeftOut, ...]

    @property
    def odds_text(self) -> str:
        """Both odds, in a clause."""
        alone, common = (_to_one(odds) for odds in (self.odds_log, self.common_odds_log))
        shared = f"{common} if all share those of gain and masses"
        return f"{self.branch}: {alone} for independent errors of the persons, {shared}"

    def dropped(self, constant: Constant | None = None) -> str:
        """Who is left out and why, of one constant or of all, in a clause; empty where nobody is."""
        constants = [constant] if constant else self.constants
        return _listed([*self.left_out, *(x for c in constants for x in c.left_out)])

    def odd(self) -> list[str]:
        """Who does not belong to the others, and in what, a sentence each."""
        where = f"{self.posture}, {self.added_mass_kg:g} kg, {self.branch}"
        return [
            f"{where}: {c.name} of subject {p.subject} is {readable(p.value / c.mean)} times the mean, an outlier "
            f"(probability {readable(p.chance, 2)}, corrected for {len(c.persons)} persons); "
            "it is included in the estimate, so check its recordings."
            for c in self.constants
            for p in c.odd
        ]

    def document(self) -> dict[str, Any]:
        """As plain data."""
        constants = [asdict(c) | {"does_not_belong": [p.subject for p in c.odd]} for c in self.constants]
        return asdict(self) | {"constants": constants}


def _listed(left_out: Sequence[LeftOut]) -> str:
    reasons: dict[str, list[str]] = {}
    for one in left_out:
        reasons.setdefault(one.why, []).append(one.subject)
    return ", ".join(f"{' and '.join(who)} ({why})" for why, who in reasons.items())


def _to_one(odds_log: float) -> str:
    if abs(odds_log) < _EVEN:
        return "even odds"
    if abs(odds_log) >= np.log(1e6):
        return "less than 1 to a million" if odds_log < 0 else "over a million to 1"
    odds = readable(float(np.exp(abs(odds_log))))
    return f"1 to {odds}" if odds_log < 0 else f"{odds} to 1"


def constant(name: str, subjects: Sequence[str], logs: np.ndarray, errors: np.ndarray) -> Constant:
    """The population of one constant, from logarithms (n,) of its values and their standard errors.

    Raises:
        RecordingError: fewer than four persons, one of them twice, or an error that is not a positive number.
    """
    if len(set(subjects)) < len(subjects):
        twice = next(who for who in subjects if subjects.count(who) > 1)
        raise RecordingError(f"subject {twice} occurs twice; a population can have each person only once.")
    for who, s in zip(subjects, errors, strict=True):
        if not (np.isfinite(s) and s > 0):
            raise RecordingError(
                f"{name} of subject {who} has a standard error of {s:g}; it must be a positive number."
            )
    rows = zip(subjects, logs, errors, strict=True)
    fit = estimate((name,), [Observed(who, "", np.array([y]), np.array([[s**2]])) for who, y, s in rows])
    mean, low, high = fit.interval("", name)
    behind = Posterior.of(logs, errors)
    people = np.column_stack([np.exp(logs), errors, np.exp(behind.persons(_LEVEL)), behind.chances()]).tolist()
    persons = tuple(Person(who, *row) for who, row in zip(subjects, people, strict=True))
    return Constant(name, mean, low, high, *behind.spread(_LEVEL), persons)


def populations(documents: Sequence[Document]) -> tuple[list[Population], list[str]]:
    """The populations of a study's pooled fits, a posture and load each, and why there are no others.

    Both branches are given where neither is decided. Several persons who make no population have a
    sentence each; one person has none. Fits that are not pooled are passed over.
    """
    groups: dict[tuple[str, float], list[Document]] = {}
    for fit in documents:
        if fit["mode"] == "pooled":
            groups.setdefault((fit["posture"], fit["added_mass_kg"]), []).append(fit)
    made: list[Population] = []
    reasons: dict[tuple[str, str], list[str]] = {}
    for (posture, load), fits in sorted(groups.items()):
        twice = [who for who, count in Counter(_who(fit) for fit in fits).items() if count > 1]
        unfit = [LeftOut(_who(fit), why) for fit in fits if (why := _unfit(fit))]
        usable = [fit for fit in fits if not _unfit(fit)]
        of_group = [] if twice else _of_group(posture, load, usable, unfit)
        made += of_group
        if of_group or len(fits) < 2:
            continue
        if twice:
            why = f"subject {twice[0]} occurs twice; "
            why += "give the two persons different names in subjects.csv"
        else:
            few = f"only {len(usable)} of {len(fits)} persons can be used"
            why = few if len(usable) < FEWEST else "too few persons have an estimate of a constant"
            why += f" and at least {FEWEST} are needed"
            why += f"; left out: {_listed(unfit)}" if unfit else ""
        reasons.setdefault((posture, why), []).append(f"{load:g}")
    return made, [
        f"{posture}, {' and '.join(loads)} kg: no population, as {why}." for (posture, why), loads in reasons.items()
    ]


def _of_group(posture: str, load: float, fits: Sequence[Document], unfit: Sequence[LeftOut]) -> list[Population]:
    """The population of usable fits of different persons, on one branch or both; or none."""
    alone, common = _odds(fits)
    branches = [STIFF_ANKLE, STIFF_PAD] if alone >= 0 else [STIFF_PAD, STIFF_ANKLE]
    without_one = [_odds([fit for fit in fits if fit is not one]) for one in fits]
    odds = np.sign(alone) * np.array([(alone, common), *without_one])
    decided = bool(odds.min() > np.log(DECISIVE_ODDS))
    made = []
    for name in branches[:1] if decided else branches:
        constants, left_out = _constants(fits, name)
        if constants:
            sign = 1 if name == STIFF_ANKLE else -1
            verdict = "decided" if decided else "undecided", sign * alone, sign * common
            made.append(Population(posture, load, name, *verdict, constants, (*unfit, *left_out)))
    return made


def _who(fit: Document) -> str:
    return str(fit["subject"])


def _unfit(fit: Document) -> str:
    """Why a fit says nothing of its person; empty where it does."""
    if fit["status"] != "done":
        return "the fit failed"
    allows = all(branch.get("world") for branch in fit["result"]["branches"])
    return misfit(fit) or ("" if allows else "the fit assumes an exact model")


def _odds(fits: Sequence[Document]) -> tuple[float, float]:
    """Log odds of the stiff ankle: allowances paid by every person, and paid once by all."""
    misfit, paid = [0.0], [0.0]
    for fit in fits:
        worlds = {branch["name"]: branch["world"] for branch in fit["result"]["branches"]}
        apart = dict(zip(worlds, deviances(fit["result"]), strict=True))
        if {STIFF_ANKLE, STIFF_PAD} <= set(worlds) and next(iter(worlds.values()))["follows"]:
            ankle, pad = worlds[STIFF_ANKLE], worlds[STIFF_PAD]
            whole, part = (pad[name] - ankle[name] for name in ("objective", "chi_square"))
            log_odds = 0.5 * (apart[STIFF_PAD] - apart[STIFF_ANKLE])  # Student's with scatter
            misfit.append(log_odds * part / whole if whole else 0.0)
            paid.append(log_odds - misfit[-1])
    return sum(misfit) + sum(paid), sum(misfit) + sum(paid) / max(1, len(paid) - 1)


def _constants(fits: Sequence[Document], name: str) -> tuple[tuple[Constant, ...], tuple[LeftOut, ...]]:
    """The constants on one branch that enough persons have, and who is left out of all."""
    known: dict[str, list[tuple[str, float, float]]] = {symbol: [] for symbol in EXCHANGED}
    unknown: dict[str, list[LeftOut]] = {symbol: [] for symbol in EXCHANGED}
    left_out = []
    for fit in fits:
        branch = next((b for b in fit["result"]["branches"] if b["name"] == name), None)
        if branch is None or not branch["world"]["follows"]:
            follow = f"the {name} does not follow the recordings"
            left_out.append(LeftOut(_who(fit), follow if branch else f"no {name} was found"))
            continue
        for symbol, e in ((symbol_and_unit(key)[0], e) for key, e in branch["parameters"].items()):
            error = e["std_error"]
            if symbol in known and not e["at_bound"] and error and np.isfinite(error) and error > 0:
                row = (_who(fit), float(np.log(e["value"])), float(error / e["value"]))
                known[symbol].append(row)
            elif symbol in known:
                why = "has no standard error" if error != 0 else "has a standard error of zero"
                why = "rests on a bound" if e["at_bound"] else why
                unknown[symbol].append(LeftOut(_who(fit), f"{symbol} {why}"))
    constants = []
    for symbol, rows in known.items():
        if len(rows) >= FEWEST:
            people, logs, errors = zip(*rows, strict=True)
            one = constant(symbol, people, np.array(logs), np.array(errors))
            constants.append(replace(one, left_out=tuple(unknown[symbol])))
    return tuple(constants), tuple(left_out)
