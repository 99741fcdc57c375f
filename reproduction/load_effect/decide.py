"""How often the analysis of mechanisms names the right one: virtual subjects of each, shaken by plans."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from fasbody.console import to_json
from fasbody.leg.statements import ADDED_KG
from fasbody.runner import Store, key, program, versions
from fasbody.transmissibility.findings import FREQUENCIES_HZ
from identification.rivals.mechanism_fit import DEPARTURE, Analysis, Confusion, Plan, Verdict
from identification.rivals.mechanisms import MECHANISMS
from identification.rivals.pad_balance import TABLE_M_S2
from identification.rivals.virtual import THESIS, draw, measured

RIVALS = tuple(MECHANISMS)
_Part = tuple[Sequence[float], Sequence[float], float]


def _plan(name: str, *parts: _Part, tuberosity: bool = True, harmonics: bool = False) -> Plan:
    rows = [(f, kg, a) for hz, loads, a in parts for kg in loads for f in hz]
    f, kg, a = (np.array(column) for column in zip(*rows, strict=True))
    return Plan(name, f, kg, a, tuberosity, harmonics)


_THESIS = (FREQUENCIES_HZ, ADDED_KG, TABLE_M_S2)
_SLOW = ((5.0, 7.0), ADDED_KG, TABLE_M_S2 / 2)
_HALF = ((15.0, 20.0, 25.0, 30.0, 35.0), (ADDED_KG[0], ADDED_KG[2]), TABLE_M_S2 / 2)
ALL = _plan("all of these", _THESIS, _SLOW, _HALF, harmonics=True)
#: The thesis' protocol with one sensor, with each addition alone, as it was, and the better one.
PLANS: tuple[Plan, ...] = (
    _plan("malleolus alone", _THESIS, tuberosity=False),
    THESIS,
    _plan("and 5, 7 Hz", _THESIS, _SLOW, tuberosity=False),
    _plan("and half the amplitude", _THESIS, _HALF, tuberosity=False),
    _plan("and second harmonics", _THESIS, tuberosity=False, harmonics=True),
    ALL,
)


def judged(
    rival: str,
    number: int,
    analyses: Sequence[Analysis],
    seed: int = 0,
    departure: float = DEPARTURE,
) -> dict[str, Verdict]:
    """One virtual subject through several plans: plan's name -> verdict, of the same recordings.

    Args:
        rival: what the subject is.
        number: of the subject.
        analyses: of plans that are parts of `ALL`.
        seed: of all.
        departure: how far the responses are off every mechanism [1].
    """
    rng = np.random.default_rng([seed, RIVALS.index(rival), number])
    whole = measured(draw(rival, rng), ALL, rng, departure)
    rows = {row: i for i, row in enumerate(_rows(ALL))}
    return {
        analysis.plan.name: analysis.verdict(whole.only(np.array([rows[row] for row in _rows(analysis.plan)])))
        for analysis in analyses
    }


def _rows(plan: Plan) -> list[tuple[float, float, float]]:
    return list(zip(plan.frequency_hz, plan.added_kg, plan.table, strict=True))


def study(
    plans: Sequence[Plan], subjects: int, folder: Path, seed: int = 0, departure: float = DEPARTURE
) -> Iterator[list[Confusion]]:
    """Confusion of each plan after every subject; what a folder holds is not computed again.

    Args:
        plans: parts of `ALL`.
        subjects: of each mechanism.
        folder: of results.
        seed: of all subjects.
        departure: how far their responses are off every mechanism [1].

    Raises:
        InputFileError: the folder cannot be written.
    """
    store, of = Store(folder), key(seed, departure, program(__name__), versions("numpy", "numba"))
    store.make()
    analyses: dict[str, Analysis] = {}
    verdicts: dict[str, dict[str, list[Verdict]]]
    verdicts = {plan.name: {rival: [] for rival in RIVALS} for plan in plans}
    for number in range(subjects):
        for rival in RIVALS:
            file = f"{rival}-{number}.json".replace(" ", "-")
            document, _ = store.load(file, json.loads)
            kept = document.get("plans", {}) if document and document.get("key") == of else {}
            missing = [plan for plan in plans if plan.name not in kept]
            for plan in missing:
                analyses.setdefault(plan.name, Analysis(plan, departure=departure))
            if missing:
                some = [analyses[plan.name] for plan in missing]
                new = judged(rival, number, some, seed, departure)
                kept |= {name: vars(verdict) for name, verdict in new.items()}
                store.save(file, to_json({"key": of, "plans": kept}))
            for plan in plans:
                v = dict(kept[plan.name])
                v["criteria"] = {k: np.inf if x is None else x for k, x in v["criteria"].items()}
                verdicts[plan.name][rival].append(Verdict(**v))
            yield [Confusion(name, by_rival) for name, by_rival in verdicts.items()]
