"""Every test of a study in tables: those for repeated measures, corrected, and separately those of the thesis.

A family is all tests of one pair of channels in one table; Holm's correction is over it, and verdicts are by what is
left. Columns that begin with `thesis_` are the tests of section 2.3 as printed, uncorrected.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from fasbody.exceptions import RecordingError, SettingError, required, unknown
from fasbody.transmissibility import statistics
from fasbody.transmissibility.resonance import Resonance
from fasbody.transmissibility.table import Condition, Table

#: What is tested between conditions.
QUANTITIES = ("transmissibility", "phase_deg")


def against_unity(table: Table) -> pd.DataFrame:
    """One-sample t test of each pair, condition and frequency against 1; `verdict` is after Holm."""
    lines: list[dict[str, Any]] = []
    for curves in table.each():
        for f, values in zip(curves.frequency_hz, curves.T.T, strict=True):
            try:
                c = statistics.one_sample(values)
            except RecordingError:
                continue
            lines.append(
                {"pair": curves.pair, "posture": curves.posture, "added_mass_kg": curves.added_mass_kg,
                 "frequency_hz": f, "mean": 1 + c.difference, "lower_95": 1 + c.lower, "upper_95": 1 + c.upper,
                 "effect_d": c.effect, "subjects": c.subjects, "p": c.p, "thesis_verdict": c.verdict}
            )  # fmt: skip
    return _corrected(lines, "mean", 1.0)


def between(table: Table, conditions: list[Condition]) -> pd.DataFrame:
    """Analyses of variance between conditions at each frequency, of transmissibility and phase."""
    lines: list[dict[str, Any]] = []
    for pair, quantity, f, levels in _levels(table, conditions):
        try:
            thesis = statistics.one_way(levels)
            right = statistics.repeated_measures(levels)
        except RecordingError:
            continue
        lines.append(
            {"pair": pair, "quantity": quantity, "frequency_hz": f, "test": right.test, "F": right.F, "p": right.p,
             "partial_eta2": right.effect, "epsilon": right.epsilon, "subjects": right.subjects,
             "thesis_F": thesis.F, "thesis_p": thesis.p, "thesis_eta2": thesis.effect}
        )  # fmt: skip
    return _corrected(lines)


def pairwise(table: Table, conditions: list[Condition]) -> pd.DataFrame:
    """Paired t tests between every two conditions at each frequency, after Holm over a pair's tests: which differ."""
    lines: list[dict[str, Any]] = []
    for pair, quantity, f, levels in _levels(table, conditions):
        for i, j in combinations(range(len(conditions)), 2):
            try:
                c = statistics.paired(levels[:, j], levels[:, i])
            except RecordingError:
                continue
            (from_posture, from_kg), (to_posture, to_kg) = conditions[i], conditions[j]
            lines.append(
                {"pair": pair, "quantity": quantity, "frequency_hz": f, "from_posture": from_posture,
                 "from_kg": from_kg, "to_posture": to_posture, "to_kg": to_kg, "difference": c.difference,
                 "lower_95": c.lower, "upper_95": c.upper, "effect_d": c.effect, "subjects": c.subjects, "p": c.p}
            )  # fmt: skip
    return _corrected(lines, "difference", 0.0)


def mixed(table: Table, people: pd.DataFrame, terms: str) -> pd.DataFrame:
    """Groups and covariates: a mixed model with an effect a subject, of each pair and quantity at each frequency.

    Args:
        table: of the study.
        people: one row a subject, with a column "subject" and groups or covariates.
        terms: right side of a formula, such as "group * added_mass_kg + age_yr"; posture and added_mass_kg are known.

    Returns:
        One row a term, with its estimate, 95 % interval (normal), and p; `verdict` is after Holm over a pair's tests.

    Raises:
        MissingPackageError: statsmodels is not installed.
        SettingError: the formula names what is not known.
    """
    import warnings

    with required("statsmodels", "statistics"):
        import statsmodels.formula.api as formulas
        from statsmodels.tools.sm_exceptions import ConvergenceWarning

    known = {*people.columns, "posture", "added_mass_kg"} - {"subject"}
    named = set(pd.Series(terms).str.findall(r"[A-Za-z_]\w*")[0]) - {"C"}
    for name in sorted(named - known):
        raise SettingError(f"{unknown('term of the model', name, sorted(known))}.")
    frame = table.frame.merge(people.assign(subject=people["subject"].astype(str)), on="subject", how="left")
    lines: list[dict[str, Any]] = []
    for (pair, f), part in frame.groupby(["pair", "frequency_hz"], sort=True):
        for quantity in QUANTITIES:
            used = part.dropna(subset=[quantity, *named])
            if quantity == "phase_deg":
                used = used.assign(phase_deg=_without_jumps(used[quantity].to_numpy()))
            if used["subject"].nunique() < 3 or len(used) < used["subject"].nunique() + 2:
                continue
            try:
                with warnings.catch_warnings():
                    for kind in (ConvergenceWarning, UserWarning, RuntimeWarning):
                        warnings.simplefilter("ignore", kind)
                    fit = formulas.mixedlm(f"{quantity} ~ {terms}", used, groups=used["subject"]).fit(reml=True)
                interval = fit.conf_int()
            except (ValueError, np.linalg.LinAlgError):
                continue
            for name in fit.fe_params.index:
                if name != "Intercept" and np.isfinite(fit.pvalues[name]):
                    lines.append(
                        {"pair": pair, "quantity": quantity, "frequency_hz": f, "term": name,
                         "difference": float(fit.fe_params[name]), "lower_95": float(interval.loc[name, 0]),
                         "upper_95": float(interval.loc[name, 1]), "subjects": used["subject"].nunique(),
                         "p": float(fit.pvalues[name])}
                    )  # fmt: skip
    return _corrected(lines, "difference", 0.0)


def _without_jumps(phase_deg: np.ndarray) -> np.ndarray:
    """Phases around their mean direction, so that no jump of 360 degrees is among them."""
    turns = np.exp(1j * np.radians(phase_deg))
    middle = np.angle(np.nansum(turns))
    return np.degrees(np.angle(turns * np.exp(-1j * middle)) + middle)


def _levels(table: Table, conditions: Sequence[Condition]) -> Iterator[tuple[str, str, float, np.ndarray]]:
    """Pair, quantity, frequency, and (subjects, conditions) values; phases around their mean direction."""
    for pair in table.pairs:
        for f in table.curves(pair, *conditions[0]).frequency_hz:
            for quantity in QUANTITIES:
                levels = table.levels(pair, conditions, float(f), quantity)
                yield pair, quantity, float(f), _without_jumps(levels) if quantity == "phase_deg" else levels


def _corrected(lines: list[dict[str, Any]], value: str = "", unity: float = 0.0) -> pd.DataFrame:
    """The lines with Holm's p over all tests of a pair, and a verdict by it: differs, or above, below, equal."""
    for pair in {line["pair"] for line in lines}:
        family = [line for line in lines if line["pair"] == pair]
        for line, p in zip(family, statistics.holm([line["p"] for line in family]), strict=True):
            differs = "differs" if not value else "above" if line[value] > unity else "below"
            line |= {"p_holm": p, "verdict": differs if p < statistics.ALPHA else "equal"}
    return pd.DataFrame(lines)


def resonances(table: Table) -> pd.DataFrame:
    """Resonance range of each pair and condition by the rule of section 2.3.1, and what is shown beyond chance."""
    return pd.DataFrame(
        [
            {"pair": c.pair, "posture": c.posture, "added_mass_kg": c.added_mass_kg, "kind": _kind(c.resonance),
             "low_hz": c.resonance.low, "high_hz": c.resonance.high, "top_hz": c.resonance.top,
             "shown_kind": _kind(c.resonance_by_tests), "shown_low_hz": c.resonance_by_tests.low,
             "shown_high_hz": c.resonance_by_tests.high,
             "subjects": len(c.subjects), "subjects_tested": c.resonance.subjects,
             "frequencies": c.frequency_hz.size, "frequencies_left_out": len(c.resonance.left_out)}
            for c in table.each()
        ]
    )  # fmt: skip


def _kind(resonance: Resonance) -> str:
    return resonance.kind if resonance.tested else str(resonance)
