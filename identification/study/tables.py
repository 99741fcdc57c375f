"""The sentences and tables of a study's report: frames of ready text, which the page only lays out."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from fasbody.presentation import readable
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.recommendations import follows
from identification.result import symbol_and_unit
from identification.study import summary
from identification.study.findings import Findings
from identification.study.population import Population

#: Imbalance of energy that a cycle may have.
BALANCED = 0.005
#: Rows of a check's table at most.
LISTED = 40
#: Whether two domains agree, in words, in the order of the table.
_ANSWER = {False: "no", True: "yes", None: "nothing to compare"}


def short(
    documents: Sequence[Mapping[str, Any]], table: pd.DataFrame, energy: pd.DataFrame, recovered: pd.DataFrame,
    tracked: Mapping[str, str] | None = None,
) -> list[str]:  # fmt: skip
    """The study in a few sentences."""
    totals = summary.counts(documents, tracked)
    done, failed = int(totals["done"].sum()), int(totals["failed"].sum())
    sentences = [f"{done} of {done + failed} fits done{f', {failed} failed' if failed else ''}."]
    sentences += [first] if (first := summary.first(documents, tracked)) else []
    rows = table[table["shown"]]
    for row in totals.to_dict("records"):
        if row["done"]:
            of_mode = rows[rows["mode"] == row["mode"]]
            known = (of_mode["verdict"] == "identified").mean()
            sentence = (
                f"{row['mode'].capitalize()}: mean fit {row['fit_percent']:.1f} %, {_percent(known)} of estimates "
                f"identified, mirror decided in {row['decided']} of {row['done']} alone."
            )
            sentence += f" {drawn(of_mode)}" if len(of_mode) else ""
            for r in recovered.to_dict("records"):
                if (r["parameter"], r["mode"]) == ("all", row["mode"]):
                    sentence += (
                        f" Truth within two standard errors: {_of(r, 'chosen')} on each fit's own branch, "
                        f"{_of(r, 'tracked')} on the branch shown, {_of(r, 'either')} on the nearer one."
                    )
            sentences.append(sentence)
    return [*sentences, *([balance(energy)] if len(energy) else [])]


def drawn(rows: pd.DataFrame) -> str:
    """Which branches are shown, in a sentence: of rows of the tidy table, or of energies, of one mode."""
    fits = rows[rows["shown"]].drop_duplicates("key")
    by = fits["decided_by"]
    turned = int((by.eq("tracking") & ~fits["chosen"]).sum())
    number = {word: int(by.eq(word).sum()) for word in summary.DECIDED_BY}
    parts = {
        "tracking": "on the branch that all fits of a subject together decide"
        + (f" ({turned} of them against their own choice)" if turned else ""),
        "likelihood": "not tracked and on the one that its data decide alone",
        "undecided": "undecided and on their own likelier branch",
        "not compared": "with one branch only",
        "no mirror": "of a model without a known mirror",
    }
    listed = ", ".join(f"{number[word]} {text}" for word, text in parts.items() if number[word])
    return f"Of {len(fits)} fits shown: {listed}."


def _percent(share: float) -> str:
    return "–" if not np.isfinite(share) else f"{100 * share:.0f} %"


def _of(row: Mapping[str, Any], name: str) -> str:
    of = row[f"{name}_of"]
    return f"{row[name]} of {of} ({_percent(row[name] / of)})" if of else "none"


def balance(energy: pd.DataFrame) -> str:
    """Whether the energies balance, in a sentence."""
    if energy.empty:
        return "No recording is periodic, so there are no cycles."
    worst = energy["imbalance"].abs()
    holds = "closes" if worst.max() < BALANCED else f"does not close in {int((worst >= BALANCED).sum())} cycles"
    worst_percent, allowed = f"{100 * worst.max():.1g} %", f"{100 * BALANCED:g} %"
    return (
        f"The energy balance {holds}: in {len(energy)} cycles the shaker's work, from the inertia of the masses alone, "
        f"and what ankle and fat pad dissipate differ by {worst_percent} at most ({allowed} are allowed)."
    )


def counts(documents: Sequence[Mapping[str, Any]], tracked: Mapping[str, str] | None = None) -> pd.DataFrame:
    """What was fitted, done and failed, a row a mode."""
    totals = summary.counts(documents, tracked)
    rows = totals.to_dict("records")
    return totals[["mode", "fits", "done", "failed", "recordings"]].assign(**{
        "mean fit [%]": [f"{row['fit_percent']:.2f}" if row["done"] else "–" for row in rows],
        "best end met by a second start": [_of(row, "again") for row in rows],
        "computing time [s]": [f"{row['seconds']:.0f}" for row in rows],
    })  # fmt: skip


def verdicts(table: pd.DataFrame) -> pd.DataFrame:
    """Shares of verdicts on the branch shown, a row a parameter, a column a mode."""

    def shares(verdict: pd.Series) -> str:
        return " / ".join(f"{100 * (verdict == word).mean():.0f}" for word in summary.VERDICTS) + " %"

    crossed = _crossed(table[table["shown"]], "parameter", "mode", "verdict", shares, table["mode"].unique())
    return crossed.rename_axis("identified / weak / not").reset_index()


def outliers(table: pd.DataFrame) -> pd.DataFrame:
    """Outliers among the estimates with a standard error, a row a mode and load, a column a parameter."""
    rows = table[table["shown"] & summary.measured(table)]
    rows = rows.assign(at=[f"{m}, {load:g} kg" for m, load in zip(rows["mode"], rows["added_mass_kg"], strict=True)])
    crossed = _crossed(
        rows, "at", "parameter", "outlier", lambda o: f"{int(o.sum())} of {len(o)}", table["parameter"].unique()
    )
    return crossed.rename_axis("outliers").reset_index()


def branches(documents: Sequence[Mapping[str, Any]], table: pd.DataFrame) -> pd.DataFrame:
    """How many fits decide alone, what chose the branch that is shown, and which it is, a row a mode.

    "Decided alone" is of every fit, whatever tracking says of it then; the columns after it add up to the fits.
    """
    alone = {row["mode"]: row["decided"] for row in summary.counts(documents).to_dict("records")}
    fits = table[table["shown"]].drop_duplicates("key")
    header = ["mode", "fits", "decided alone", "shown as tracking decides", "shown as it decides alone, not tracked"]
    header += [*summary.DECIDED_BY[2:], f"shown: {STIFF_ANKLE}", f"shown: {STIFF_PAD}"]
    rows = [
        [mode, len(rows), alone[mode], *((rows["decided_by"] == word).sum() for word in summary.DECIDED_BY),
         *((rows["branch"] == name).sum() for name in (STIFF_ANKLE, STIFF_PAD))]
        for mode, rows in fits.groupby("mode", sort=False)
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=header)


def recovery(recovered: pd.DataFrame) -> pd.DataFrame:
    """`truth.recovery` for people."""
    ways = ("chosen", "tracked", "either")
    header = [
        "", "distinct estimates", "right on the fit's own branch", "right on the branch shown",
        "right on the branch nearer to the truth", "median error on its own branch", "median error on the branch shown",
        "median error on the nearer branch", "median standard error stated", "right of those that say identified",
    ]  # fmt: skip

    def share(row: Mapping[str, Any], name: str) -> str:
        of = row[f"{name}_of"]
        return f"{_percent(row[name] / of)} of {of}" if of else "none"

    rows = [
        [
            f"{r['mode']}, all" if r["parameter"] == "all" else r["parameter"], r["estimates"],
            *(share(r, way) for way in ways), *(_percent(r[f"{way}_error"]) for way in ways), _percent(r["std_error"]),
            share(r, "identified"),
        ]
        for r in recovered.to_dict("records")
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=header)


def energies(energy: pd.DataFrame) -> pd.DataFrame:
    """Median energies of the branch shown, a row a condition."""
    header = ["mode", "posture", "added mass [kg]", "frequency [Hz]", "cycles", "median ankle [mJ]",
              "median fat pad [mJ]", "median shaker [mJ]"]  # fmt: skip
    cycles = energy[energy["shown"] & follows(energy["fit_percent"])]
    rows = [
        [mode, posture, f"{load:g}", f"{f:g}", len(g),
         *(f"{1e3 * g[column].median():.3g}" for column in ("ankle_j", "fat_pad_j", "shaker_work_j"))]
        for (mode, posture, load, f), g in cycles.groupby(["mode", "posture", "added_mass_kg", "frequency_hz"])
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=header)


def sections(findings: Findings) -> dict[str, pd.DataFrame]:
    """Title -> table of what the checks found, where there is any."""
    of = {
        "Population": population, "Branches over a subject": tracking, "Profile likelihood": profiles,
        "Leave one frequency out": held_out, "Linear or nonlinear damping": damping,
        "Steady state and time domain": agreement,
    }  # fmt: skip
    return {title: table for title, make in of.items() if len(table := make(findings))}


def population(findings: Findings) -> pd.DataFrame:
    """Mean and spread of each constant over persons, a row each; both branches where neither is decided."""
    rows = []
    for p in findings.populations:
        for c in p.constants:
            scale, unit = (1e-3, "kN/m") if c.name.startswith("k_") else (1.0, "N s/m")
            where = f"{p.posture}, {p.added_mass_kg:g} kg"
            alone, shrunk = (np.log([getattr(q, n) for q in c.persons]) for n in ("value", "shrunk"))
            rows.append([
                where, f"{p.branch} ({p.verdict})", f"{c.name} [{unit}]", len(c.persons),
                f"{scale * c.mean:.3g}", f"{scale * c.lower:.3g} to {scale * c.upper:.3g}", *c.spread_text,
                f"{_percent(float(np.std(alone, ddof=1)))} to {_percent(float(np.std(shrunk, ddof=1)))}",
                p.dropped(c) or "nobody", " and ".join(q.subject for q in c.odd) or "nobody",
            ])  # fmt: skip
    header = ["condition", "branch", "constant", "persons", "mean", "95 % of the mean", "spread between persons",
              "95 % of the spread", "scatter of the estimates, before and after shrinking",
              "persons left out", "does not belong (kept)"]  # fmt: skip
    return pd.DataFrame(rows, columns=header)


def left_out(populations: Sequence[Population]) -> str:
    """Who is in none or not in all of the estimates of some populations, and why, in a sentence."""
    listed = [f"{p.added_mass_kg:g} kg, {p.branch}: {who}" for p in populations if (who := p.dropped())]
    return f"Persons left out: {'. '.join(listed)}." if listed else "No person is left out."


def circled(populations: Sequence[Population]) -> str:
    """The outliers that the figure circles, in a sentence; empty where there are none."""
    odd = dict.fromkeys(q.subject for p in populations for c in p.constants for q in c.odd)
    return f"Circled, kept in the means: what does not belong to the other persons' ({', '.join(odd)}). " if odd else ""


def odds(populations: Sequence[Population]) -> list[str]:
    """Odds of the branches over all persons, a sentence a condition; then persons who are outliers."""
    first = {(p.posture, p.added_mass_kg): p for p in reversed(populations)}
    branch_odds = [f"{posture}, {load:g} kg: {p.odds_text}." for (posture, load), p in sorted(first.items())]
    return [*branch_odds, *(sentence for p in populations for sentence in p.odd())]


def tracking(findings: Findings) -> pd.DataFrame:
    """How many fits of each subject are on which branch when all are weighed together."""
    rows = []
    for s in findings.subjects:
        names = [c.branch for c in s.tracking.choices] if s.tracking else []
        name, odds = max(s.tracking.overall.items(), key=lambda i: i[1], default=("", 0.0)) if s.tracking else ("", 0)
        text = "–" if not odds else "over a million to 1" if odds > 1e6 else f"{readable(odds)} to 1"
        text = "even" if 1 <= odds < 1.05 else text
        cells = [names.count(n) for n in (STIFF_ANKLE, STIFF_PAD, "undecided")]
        rows.append([f"{s.mode}, {s.posture}", s.subject, *cells, name, text])
    header = ["mode", "subject", STIFF_ANKLE, STIFF_PAD, "undecided", "if one branch for all"]
    return pd.DataFrame(rows, columns=[*header, "its odds over the other for all"])


def profiles(findings: Findings) -> pd.DataFrame:
    """Profiles beside the intervals of the standard errors, those that depart first."""
    rows = []
    for d, r in sorted(findings.of("profile"), key=lambda pair: not pair[1]["departs"])[:LISTED]:
        low, high = ("open" if r[f"open_{side}"] else readable(r[name], 4)
                     for side, name in (("below", "lower"), ("above", "upper")))  # fmt: skip
        verdict = r["verdict"] + ("; a better fit was met" if r["better"] else "")
        rows.append([f"{summary.place(d)} ({d['mode']})", symbol_and_unit(r["key"])[0], verdict,
                     "departs" if r["departs"] else "", readable(r['value'], 4), f"{low} to {high}",
                     " to ".join(readable(x, 4) for x in r["wald"])])  # fmt: skip
    header = ["fit", "parameter", "verdict", "profile against standard error", "estimate", "95 % by profile",
              "95 % by standard error"]  # fmt: skip
    return pd.DataFrame(rows, columns=header)


def held_out(findings: Findings) -> pd.DataFrame:
    """Medians of the errors at frequencies that were left out, a row a mode."""
    by_mode: dict[str, list[Mapping[str, Any]]] = {}
    for d, r in findings.of("validation"):
        by_mode.setdefault(d["mode"], []).append(r["held_out"])
    rows = []
    for mode, groups in by_mode.items():
        inside, ends = ([row for r in groups for row in r["rows"] if row["edge"] == edge] for edge in (False, True))
        rows.append([
            mode, len(groups), len(inside), _median(row["percent"] for row in inside),
            _median(row["chi_square"] / row["numbers"] for row in inside), _median(row["percent"] for row in ends),
            sum(len(r["failed"]) for r in groups),
        ])  # fmt: skip
    header = ["mode", "groups of recordings", "recordings predicted between others", "their error [%]",
              "their chi-square per number", "error of the lowest and highest frequency [%]"]  # fmt: skip
    return pd.DataFrame(rows, columns=[*header, "no stable prediction"])


def damping(findings: Findings) -> pd.DataFrame:
    """Linear against nonlinear damping, a row a fit."""
    rows = []
    for d, r in [(d, r["damping"]) for d, r in findings.of("validation") if r["damping"]][:LISTED]:
        linear, bent = r["linear"], r["nonlinear"]
        errors = " / ".join(f"{c['held_out_percent']:.3g}" for c in (linear, bent))
        less = [f"{linear[name] - bent[name]:.4g}" for name in ("aic", "bic")]
        rows.append([d["mode"], summary.place(d), *less, errors, *r["preferred"].values()])
    header = ["mode", "fit", "AIC, linear less nonlinear", "BIC, linear less nonlinear",
              "error at frequencies left out [%], linear / nonlinear"]  # fmt: skip
    return pd.DataFrame(rows, columns=[*header, "law that AIC prefers", "law that BIC prefers",
                                       "law that frequencies left out prefer"])  # fmt: skip


def agreement(findings: Findings) -> pd.DataFrame:
    """Steady state against time domain, disagreements first."""
    order, rows = list(_ANSWER), []
    for d, r in sorted(findings.of("agreement"), key=lambda pair: order.index(pair[1]["agrees"]))[:LISTED]:
        known = [abs(x["z"]) for x in r["differences"] if x["z"] is not None and np.isfinite(x["z"])]
        rows.append([d["mode"], summary.place(d), r["branch"], _ANSWER[r["agrees"]],
                     f"{max(known):.2g}" if known else "–", r["sentence"]])  # fmt: skip
    header = ["mode", "fit", "branch", "agrees", "largest difference [joint errors]", "why"]
    return pd.DataFrame(rows, columns=header)


def _crossed(
    rows: pd.DataFrame, index: str, columns: str, values: str, text: Callable[[pd.Series], str], header: Iterable[str]
) -> pd.DataFrame:
    """A text on each group of values, a row each in the order in which they come, a column each of the header."""
    table = rows.groupby([index, columns], sort=False)[values].agg(text).unstack(columns)
    return table.reindex(index=rows[index].unique(), columns=header).astype(object).fillna("–")


def _median(values: Iterable[float]) -> str:
    numbers = list(values)
    return f"{np.median(numbers):.3g}" if numbers else "–"
