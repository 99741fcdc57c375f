"""Every test of a study in one table: the thesis' own, and beside each the one for repeated measures."""

from typing import Any

import numpy as np
import pandas as pd

from fasbody.exceptions import RecordingError
from fasbody.transmissibility import statistics
from fasbody.transmissibility.resonance import Resonance
from fasbody.transmissibility.table import Condition, Table


def against_unity(table: Table) -> pd.DataFrame:
    """One-sample t test of each pair, condition and frequency against 1, with Holm's correction within a curve."""
    lines: list[dict[str, Any]] = []
    for curves in table.each():
        part = []
        for f, values in zip(curves.frequency_hz, curves.T.T, strict=True):
            try:
                c = statistics.one_sample(values)
            except RecordingError:
                continue
            part.append(
                {"pair": curves.pair, "posture": curves.posture, "added_mass_kg": curves.added_mass_kg,
                 "frequency_hz": f, "mean": 1 + c.difference, "lower_95": 1 + c.lower, "upper_95": 1 + c.upper,
                 "p": c.p, "verdict": c.verdict, "effect_d": c.effect, "subjects": c.subjects}
            )  # fmt: skip
        _holm(part)
        lines += part
    return pd.DataFrame(lines)


def between(table: Table, conditions: list[Condition]) -> pd.DataFrame:
    """Analyses of variance between conditions at each frequency: one-way as in print, and repeated measures.

    Raises:
        SettingError: statsmodels is not installed.
    """
    lines: list[dict[str, Any]] = []
    for pair in table.pairs:
        part = []
        for f in table.curves(pair, *conditions[0]).frequency_hz:
            levels = table.levels(pair, conditions, float(f))
            try:
                thesis = statistics.one_way(levels)
                gaps = not np.isfinite(levels).all()
                right = statistics.with_gaps(levels) if gaps else statistics.repeated_measures(levels)
            except RecordingError:
                continue
            part.append(
                {"pair": pair, "frequency_hz": f, "F_one_way": thesis.F, "p_one_way": thesis.p,
                 "eta2_one_way": thesis.effect, "test": right.test, "F": right.F, "p": right.p,
                 "partial_eta2": right.effect, "epsilon": right.epsilon, "subjects": right.subjects}
            )  # fmt: skip
        _holm(part)
        lines += part
    return pd.DataFrame(lines)


def _holm(part: list[dict[str, Any]]) -> None:
    if part:
        for line, p in zip(part, statistics.holm([line["p"] for line in part]), strict=True):
            line["p_holm"] = p


def resonances(table: Table) -> pd.DataFrame:
    """Resonance range of each pair and condition by the rule of section 2.3.1, and what is shown beyond chance."""
    return pd.DataFrame(
        [
            {"pair": c.pair, "posture": c.posture, "added_mass_kg": c.added_mass_kg, "kind": _kind(c.resonance),
             "low_hz": c.resonance.low, "high_hz": c.resonance.high, "top_hz": c.resonance.top,
             "shown_kind": _kind(c.shown), "shown_low_hz": c.shown.low, "shown_high_hz": c.shown.high,
             "subjects": len(c.subjects), "subjects_tested": c.resonance.subjects,
             "frequencies": c.frequency_hz.size, "frequencies_left_out": len(c.resonance.left_out)}
            for c in table.each()
        ]
    )  # fmt: skip


def _kind(resonance: Resonance) -> str:
    return resonance.kind if resonance.tested else str(resonance)
