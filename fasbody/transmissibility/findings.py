"""The findings that sections 2.3 and 2.4 state, each beside what came out of a study."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fasbody import statistics
from fasbody.statistics import one_sample
from fasbody.transmissibility.table import Curves, Table

LOADS = (("midstance", 0.0), ("midstance", 2.3), ("midstance", 4.5))
POSTURES = (("midstance", 0.0), ("plantarflexion", 0.0), ("dorsiflexion", 0.0))


@dataclass(frozen=True)
class Finding:
    """One statement: where it is made, what it says, what came out, whether that is the same; a note on conflicts."""

    section: str
    says: str
    came_out: str
    holds: bool
    note: str = ""

    def __str__(self) -> str:
        return f"{self.says}: {self.came_out} ({'holds' if self.holds else 'does not hold'})"


_SECOND = "the text prints 'below' here; 'above' is meant"
_TENSION = "with MB highest at 35-40 Hz, TM would have to fall steeply from 30 Hz and yet be 1 at 40 Hz"
_CONFLICT = "cannot hold with MB above 1 everywhere, TM at 1 to 40 Hz and a peak under load"


def findings(table: Table) -> list[Finding]:
    """Judge every statement that the study has the conditions for."""
    have = set(table.conditions)
    made: list[Finding] = []
    if set(LOADS) <= have:
        made += _loads(table)
    if set(POSTURES) <= have:
        made += _postures(table)
    return made


def _loads(table: Table) -> list[Finding]:
    made = _malleolus(table)
    if "TB" in table.pairs:
        made += _tuberosity(table)
    return made


def _malleolus(table: Table) -> list[Finding]:
    mb = [table.curves("MB", *c) for c in LOADS]
    made = []
    free = _unity(mb[0])
    made.append(_judge("2.3.1", "MB unloaded above 1 below 40 Hz", free, lambda f, v: f >= 40 or v == "above"))
    made.append(_judge("2.3.1", "MB unloaded close to 1 at 45 and 50 Hz", free, lambda f, v: f < 45 or v == "equal"))
    for curves in mb[1:]:
        says = f"MB with {curves.added_mass_kg:g} kg above 1 at all frequencies"
        made.append(_judge("2.3.1", says, _unity(curves), lambda f, v: v == "above"))
    for curves, (kind, low, high) in zip(mb, _RESONANCES, strict=True):
        r = curves.resonance
        says = f"MB resonance with {curves.added_mass_kg:g} kg: {low}-{high} Hz ({kind})"
        made.append(Finding("2.3.1", says, str(r), (r.kind, r.low, r.high) == (kind, low, high)))
    slow = mb[0].frequency_hz < 20
    falls = bool(np.all(mb[0].mean[slow] > mb[1].mean[slow]) and np.all(mb[1].mean[slow] > mb[2].mean[slow]))
    at_10 = ", ".join(f"{c.mean[0]:.2f}" for c in mb)
    made.append(Finding("2.4", "MB below 20 Hz falls with load", f"at 10 Hz {at_10}", falls))
    for curves, (_, from_hz, to_hz) in zip(mb, _RESONANCES, strict=True):
        lag = -curves.mean_phase_deg
        steps = np.diff(lag)
        at = int(np.argmax(steps))
        f = curves.frequency_hz
        says = f"MB phase with {curves.added_mass_kg:g} kg steepest within 5 Hz of the resonance"
        came = f"steepest {f[at]:g}-{f[at + 1]:g} Hz ({steps[at]:.1f} degrees in {f[at + 1] - f[at]:g} Hz)"
        made.append(Finding("2.3.1", says, came, bool(f[at] >= from_hz - 5 and f[at + 1] <= to_hz + 5)))
    for curves in mb[1:]:
        less = curves.mean_phase_deg - mb[0].mean_phase_deg
        at, f = int(np.argmax(less)), curves.frequency_hz
        says = f"lag of MB less with {curves.added_mass_kg:g} kg, most at 30-35 Hz"
        came = (
            f"most at {f[at]:g} Hz ({less[at]:.0f} degrees; {less[0]:.0f} at {f[0]:g}, {less[-1]:.0f} at {f[-1]:g} Hz)"
        )
        made.append(Finding("2.3.1", says, came, bool(25 < f[at] < 40)))
    return made


_RESONANCES = (("plateau", 15, 25), ("peak", 30, 35), ("peak", 35, 40))


def _tuberosity(table: Table) -> list[Finding]:
    tb = [table.curves("TB", *c) for c in LOADS]
    made = []
    p = statistics.one_way(table.levels("TB", LOADS, 10.0)).p
    made.append(Finding("2.3.1", "TB at 10 Hz differs between the loads", f"p = {p:.2g}", bool(p < statistics.ALPHA)))
    made.append(
        Finding("2.3.1", "TB unloaded without peak or plateau", str(tb[0].resonance), tb[0].resonance.kind == "none")
    )
    for curves in tb[1:]:
        r = curves.resonance
        says = f"TB peak with {curves.added_mass_kg:g} kg: 25-30 Hz"
        note = _TENSION if curves.added_mass_kg > 3 else ""
        made.append(Finding("2.3.1", says, str(r), (r.kind, r.low, r.high) == ("peak", 25, 30), note))
    f = tb[1].frequency_hz
    same = [statistics.one_way(table.levels("TB", LOADS[1:], x)).p >= statistics.ALPHA for x in f]
    middle = (f >= 15) & (f <= 35)
    came = "equal at " + (", ".join(f"{x:g}" for x in f[np.array(same)]) or "no") + " Hz (one-way ANOVA)"
    made.append(
        Finding("2.3.1", "TB alike with 2.3 and 4.5 kg at 15-35 Hz", came, bool(np.all(np.array(same)[middle])))
    )
    for limits, note in (((30, 35, 40), _CONFLICT), ((40, 45, 50), f"{_SECOND}; {_CONFLICT}")):
        for curves, limit in zip(tb, limits, strict=True):
            says = f"TB with {curves.added_mass_kg:g} kg below 1 {'at' if limit == 50 else 'above'} {limit} Hz"
            first = 50 if limit == 50 else limit + 1  # the text says "at 50 Hz", and "above" for the others
            made.append(_judge("2.3.1", says, _unity(curves), lambda f, v, at=first: f < at or v == "below", note))
    for c, limit in zip(LOADS, (25, 40, 40), strict=True):
        tm = table.curves("TM", *c)
        says = f"TM with {c[1]:g} kg without a peak"
        made.append(Finding("2.3.1", says, str(tm.resonance), tm.resonance.kind != "peak"))
        says = f"TM with {c[1]:g} kg below 1 above {limit} Hz"
        made.append(_judge("2.3.1", says, _unity(tm), lambda f, v, at=limit: f == at or (v == "below") == (f > at)))
    return made


def _postures(table: Table) -> list[Finding]:
    made = []
    for pair in table.pairs:
        f = table.curves(pair, *POSTURES[0]).frequency_hz
        p = np.array([statistics.one_way(table.levels(pair, POSTURES, x)).p for x in f])
        hits = ", ".join(f"{x:g}" for x in f[p < statistics.ALPHA]) or "no"
        if pair == "TM":
            says, right = "TM does not differ between postures", not np.any(p < statistics.ALPHA)
        else:
            says = f"{pair} differs between postures at 10 Hz only"
            right = bool(p[0] < statistics.ALPHA and not np.any(p[1:] < statistics.ALPHA))
        made.append(Finding("2.3.2", says, f"differs at {hits} Hz (one-way ANOVA, p < 0.05)", bool(right)))
    r = table.curves("MB", *POSTURES[1]).resonance
    right = (r.kind, r.low, r.high) == ("plateau", 15, 25)
    made.append(Finding("2.3.2", "MB in plantarflexion: plateau 15-25 Hz", str(r), right))
    r = table.curves("MB", *POSTURES[2]).resonance
    made.append(Finding("2.3.2", "MB in dorsiflexion without a resonance", str(r), r.kind == "none"))
    return made


def _unity(curves: Curves) -> list[tuple[float, str, float]]:
    """Frequency, verdict against unity and mean."""
    return [
        (float(f), one_sample(values).verdict, float(np.nanmean(values)))
        for f, values in zip(curves.frequency_hz, curves.T.T, strict=True)
    ]


def _judge(
    section: str,
    says: str,
    against_unity: list[tuple[float, str, float]],
    right: Callable[..., bool],
    note: str = "",
) -> Finding:
    signs = {"above": ">", "below": "<", "equal": "="}
    came = " ".join(f"{f:g}{signs[v]}" for f, v, _ in against_unity)
    return Finding(section, says, f"Hz against 1: {came}", all(right(f, v) for f, v, _ in against_unity), note)
