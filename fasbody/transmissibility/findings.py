"""The findings that sections 2.3 and 2.4 state, each beside what came out of a study."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.transmissibility import statistics
from fasbody.transmissibility.resonance import Resonance
from fasbody.transmissibility.statistics import one_sample
from fasbody.transmissibility.table import Condition, Curves, Table

#: Frequencies of section 2.2.2 [Hz].
FREQUENCIES_HZ = tuple(float(f) for f in range(10, 55, 5))
LOADS = (("midstance", 0.0), ("midstance", 2.3), ("midstance", 4.5))
POSTURES = (("midstance", 0.0), ("plantarflexion", 0.0), ("dorsiflexion", 0.0))


@dataclass(frozen=True)
class Finding:
    """One statement: where it is made, what it says, what came out, whether that is the same; a note on conflicts.

    `holds` is None where too few subjects or frequencies were measured to test it, which is not success.
    """

    section: str
    says: str
    came_out: str
    holds: bool | None
    note: str = ""

    @property
    def verdict(self) -> str:
        """One of yes, no, not tested."""
        return "not tested" if self.holds is None else "yes" if self.holds else "no"


def summary(stated: Sequence[Finding]) -> str:
    """How many hold, of those that could be tested."""
    tested = [f.holds for f in stated if f.holds is not None]
    left = f", {len(stated) - len(tested)} could not be tested" if len(tested) < len(stated) else ""
    return f"{sum(tested)} of {len(tested)} statements hold{left}."


_SECOND = "the text prints 'below' here; 'above' is meant"
_TENSION = "with MB highest at 35-40 Hz, TM would have to fall steeply from 30 Hz and yet be 1 at 40 Hz"
_CONFLICT = "cannot hold with MB above 1 everywhere, TM at 1 to 40 Hz and a peak under load"


def findings(table: Table) -> list[Finding]:
    """Judge every statement that the study has the conditions for."""
    measured, stated = set(table.conditions), list[Finding]()
    if set(LOADS) <= measured:
        stated += _malleolus(table)
        stated += _tuberosity(table) if "TB" in table.pairs else []
    return stated + (_postures(table) if set(POSTURES) <= measured else [])


def judged(table: Table) -> tuple[list[Finding], str]:
    """The findings from those of the thesis' nine frequencies that were recorded; or none, and why.

    A statement on frequencies that were not recorded is not tested.
    """
    if table.broadband:
        return [], "they are about sines, and this study has broadband recordings"
    if table.frame["subject"].nunique() < 3:
        return [], f"they need at least 3 subjects, not {table.frame['subject'].nunique()}"
    have = table.frame["frequency_hz"]
    if not have.isin(FREQUENCIES_HZ).any():
        return [], f"nothing was recorded at {', '.join(f'{f:g}' for f in FREQUENCIES_HZ)} Hz"
    stated = findings(replace(table, frame=table.frame[have.isin(FREQUENCIES_HZ)]))
    return stated, "" if stated else "neither all three loads nor all three postures were recorded"


def _malleolus(table: Table) -> list[Finding]:
    mb = _curves(table, "MB", LOADS)
    stated = []
    free = _unity(mb[0])
    stated.append(_judge("2.3.1", "MB unloaded above 1 below 40 Hz", free, lambda f, v: f >= 40 or v == "above"))
    stated.append(_judge("2.3.1", "MB unloaded close to 1 at 45 and 50 Hz", free, lambda f, v: f < 45 or v == "equal"))
    for curves in mb[1:]:
        says = f"MB with {curves.added_mass_kg:g} kg above 1 at all frequencies"
        stated.append(_judge("2.3.1", says, _unity(curves), lambda f, v: v == "above"))
    for curves, (kind, low, high) in zip(mb, _RESONANCES, strict=True):
        says = f"MB resonance with {curves.added_mass_kg:g} kg: {low}-{high} Hz ({kind})"
        stated.append(_resonance("2.3.1", says, curves, kind, low, high))
    slow = mb[0].frequency_hz < 20
    falls = np.concatenate([a.mean[slow] - b.mean[slow] for a, b in pairwise(mb)])
    at_10 = ", ".join(f"{c.mean[0]:.2f}" for c in mb)
    stated.append(Finding("2.4", "MB below 20 Hz falls with load", f"at 10 Hz {at_10}", _all(falls, falls > 0)))
    f = mb[0].frequency_hz
    for curves, (_, from_hz, to_hz) in zip(mb, _RESONANCES, strict=True):
        says = f"MB phase with {curves.added_mass_kg:g} kg steepest within 5 Hz of the resonance"
        came, steps = _GAPS, -np.diff(curves.mean_phase_deg)
        at = int(np.argmax(steps))
        if np.isfinite(steps).all():
            came = f"steepest {f[at]:g}-{f[at + 1]:g} Hz ({steps[at]:.1f} degrees in {f[at + 1] - f[at]:g} Hz)"
        near = f[at] >= from_hz - 5 and f[at + 1] <= to_hz + 5
        stated.append(Finding("2.3.1", says, came, _all(steps, near)))
    for curves in mb[1:]:
        says = f"lag of MB less with {curves.added_mass_kg:g} kg, most at 30-35 Hz"
        came, less = _GAPS, curves.mean_phase_deg - mb[0].mean_phase_deg
        at = int(np.argmax(less))
        if np.isfinite(less).all():
            ends = f"{less[0]:.0f} at {f[0]:g}, {less[-1]:.0f} at {f[-1]:g} Hz"
            came = f"most at {f[at]:g} Hz ({less[at]:.0f} degrees; {ends})"
        stated.append(Finding("2.3.1", says, came, _all(less, 25 < f[at] < 40)))
    return stated


_RESONANCES = (("plateau", 15, 25), ("peak", 30, 35), ("peak", 35, 40))


def _tuberosity(table: Table) -> list[Finding]:
    tb = _curves(table, "TB", LOADS)
    stated = []
    p = _differ(table, "TB", LOADS, tb[0].frequency_hz[:1])
    came = _GAPS if np.isnan(p[0]) else f"p = {p[0]:.2g}"
    stated.append(Finding("2.3.1", "TB at 10 Hz differs between the loads", came, _all(p, p < statistics.ALPHA)))
    stated.append(_resonance("2.3.1", "TB unloaded without peak or plateau", tb[0], "none"))
    for curves in tb[1:]:
        says = f"TB peak with {curves.added_mass_kg:g} kg: 25-30 Hz"
        note = _TENSION if curves.added_mass_kg > 3 else ""
        stated.append(_resonance("2.3.1", says, curves, "peak", 25, 30, note))
    f = tb[1].frequency_hz
    p = _differ(table, "TB", LOADS[1:], f)
    middle = (f >= 15) & (f <= 35)
    came = "equal at " + (", ".join(f"{x:g}" for x in f[p >= statistics.ALPHA]) or "no") + " Hz (one-way ANOVA)"
    alike = _all(p[middle], p[middle] >= statistics.ALPHA)
    stated.append(Finding("2.3.1", "TB alike with 2.3 and 4.5 kg at 15-35 Hz", came, alike))
    for limits, note in (((30, 35, 40), _CONFLICT), ((40, 45, 50), f"{_SECOND}; {_CONFLICT}")):
        for curves, limit in zip(tb, limits, strict=True):
            says = f"TB with {curves.added_mass_kg:g} kg below 1 {'at' if limit == 50 else 'above'} {limit} Hz"
            first = 50 if limit == 50 else limit + 1  # the text says "at 50 Hz", and "above" for the others
            about = note if curves.added_mass_kg else note.removesuffix(f"; {_CONFLICT}")  # it concerns the loads
            stated.append(_judge("2.3.1", says, _unity(curves), lambda f, v, at=first: f < at or v == "below", about))
    for c, limit in zip(LOADS, (25, 40, 40), strict=True):
        tm = _curves(table, "TM", [c])[0]
        r = tm.resonance
        says = f"TM with {c[1]:g} kg without a peak"
        stated.append(Finding("2.3.1", says, str(r), r.kind != "peak" if _whole(r) else None))
        says = f"TM with {c[1]:g} kg below 1 above {limit} Hz"
        stated.append(_judge("2.3.1", says, _unity(tm), lambda f, v, at=limit: f == at or (v == "below") == (f > at)))
    return stated


def _postures(table: Table) -> list[Finding]:
    stated = []
    for pair in table.pairs:
        f = _frequencies(table)
        p = _differ(table, pair, POSTURES, f)
        hits = ", ".join(f"{x:g}" for x in f[p < statistics.ALPHA]) or "no"
        if pair == "TM":
            says, right = "TM does not differ between postures", p >= statistics.ALPHA
        else:
            says = f"{pair} differs between postures at 10 Hz only"
            right = (p < statistics.ALPHA) == (f == 10)
        stated.append(Finding("2.3.2", says, f"differs at {hits} Hz (one-way ANOVA, p < 0.05)", _all(p, right)))
    plantar, dorsi = _curves(table, "MB", POSTURES[1:])
    stated.append(_resonance("2.3.2", "MB in plantarflexion: plateau 15-25 Hz", plantar, "plateau", 15, 25))
    stated.append(_resonance("2.3.2", "MB in dorsiflexion without a resonance", dorsi, "none"))
    return stated


_GAPS = "not measured at every frequency"


def _frequencies(table: Table) -> np.ndarray:
    return np.array(sorted({*FREQUENCIES_HZ, *map(float, table.frame["frequency_hz"])}))


def _curves(table: Table, pair: str, conditions: Sequence[Condition]) -> list[Curves]:
    """Curves on the frequencies of the whole table, so that they can be compared; gaps are NaN."""
    return [table.curves(pair, *c).on(_frequencies(table)) for c in conditions]


def _differ(table: Table, pair: str, conditions: Sequence[Condition], frequency_hz: np.ndarray) -> np.ndarray:
    """p of the one-way analysis of variance at each frequency (f,), NaN where it cannot be made."""
    p_values = []
    for f in frequency_hz:
        try:
            p_values.append(statistics.one_way(table.levels(pair, conditions, float(f))).p)
        except RecordingError:
            p_values.append(np.nan)
    return np.array(p_values)


def _all(known: np.ndarray, right: np.ndarray | bool) -> bool | None:
    """Whether all is right; None if a number is missing for that."""
    return bool(np.all(right)) if np.isfinite(known).all() else None


def _resonance(
    section: str, says: str, curves: Curves, kind: str, low: float = np.nan, high: float = np.nan, note: str = ""
) -> Finding:
    """Whether a resonance is of a kind and at a place [Hz]; None if it was not tested."""
    r = curves.resonance
    same = r.kind == kind and (kind == "none" or (r.low, r.high) == (low, high))
    return Finding(section, says, str(r), same if _whole(r) else None, note)


def _whole(r: Resonance) -> bool:
    """Whether a rule could be used on all of the frequencies."""
    return r.tested and not r.left_out


def _unity(curves: Curves) -> list[tuple[float, str]]:
    verdicts = []
    for f, values in zip(curves.frequency_hz, curves.T.T, strict=True):
        try:
            verdicts.append((float(f), one_sample(values).verdict))
        except RecordingError:
            verdicts.append((float(f), "untested"))
    return verdicts


def _judge(
    section: str, says: str, against_unity: list[tuple[float, str]], right: Callable[..., bool], note: str = ""
) -> Finding:
    signs = {"above": ">", "below": "<", "equal": "=", "untested": "?"}
    came = " ".join(f"{f:g}{signs[v]}" for f, v in against_unity)
    wrong = [v for f, v in against_unity if not right(f, v)]  # of the frequencies that the statement is about
    holds = False if {*wrong} - {"untested"} else None if wrong else True
    return Finding(section, says, f"Hz against 1: {came}", holds, note)
