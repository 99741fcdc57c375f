"""The sentences and tables of a study's report: frames of ready text, which the page only lays out."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from fasbody.presentation import readable
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.recommendations import follows
from identification.result import symbol_and_unit
from identification.study import VERDICTS, summary
from identification.study.findings import Findings
from identification.study.population import Population
from identification.study.truth import WAYS

Document = Mapping[str, Any]
#: Imbalance of energy that a cycle may have.
BALANCED = 0.005
#: Rows of a check's table at most.
LISTED = 40
#: Whether two domains agree, in words, in the order of the table.
_ANSWER = {False: "no", True: "yes", None: "nothing to compare"}
#: What chose the branch that is shown, in words.
_CHOSEN_BY = {
    "tracking": "on the branch decided by all fits of the subject together",
    "likelihood": "on the branch decided by the fit alone",
    "undecided": "undecided, on the likelier branch",
    "not compared": "with one branch only",
    "no mirror": "of a model without a known mirror",
}


def short(findings: Findings) -> list[str]:
    """The study in a few sentences."""
    documents, table, energy = findings.documents, findings.table, findings.energy
    totals = summary.counts(documents, findings.tracked)
    done, failed = int(totals["done"].sum()), int(totals["failed"].sum())
    more = f", {failed} failed" if failed else ""
    sentences = [f"{done} of {done + failed} fits done{more}.", summary.first(documents, findings.tracked)]
    for row in totals[totals["done"] > 0].to_dict("records"):
        of_mode = table[table["shown"] & (table["mode"] == row["mode"])]
        of_fits = [d for d in documents if d["status"] == "done" and d["mode"] == row["mode"]]
        if all(summary.misfit(fit) for fit in of_fits):
            text = f"{row['mode'].capitalize()}: mean fit {row['fit_percent']:.1f} %. No fit follows its recordings, "
            sentences.append(f"{text}so none has odds, intervals or energies.")
            continue
        known = _percent((of_mode["verdict"] == "identified").mean())
        text = f"{row['mode'].capitalize()}: mean fit {row['fit_percent']:.1f} %, {known} of estimates identified, "
        text += f"mirror decided in {row['decided']} of {row['done']} alone."
        text += f" {drawn(of_mode)}" if len(of_mode) else ""
        for r in findings.recovered.to_dict("records"):
            if (r["parameter"], r["mode"]) == ("all", row["mode"]):
                if not any(r[f"{way}_of"] for way in WAYS):
                    continue
                likelier, chosen, nearer = (_of(r, way) for way in WAYS)
                text += f" Truth within two standard errors: {likelier} on the likelier branch of each fit, "
                text += f"{chosen} on the branch shown, {nearer} on the nearer one."
        sentences.append(text)
    return [*filter(None, sentences), *([balance(energy)] if len(energy) else [])]


def drawn(rows: pd.DataFrame) -> str:
    """Which branches are shown, in a sentence: of rows of the tidy table, or of energies, of one mode."""
    fits = rows[rows["shown"]].drop_duplicates("key")
    by = fits["decided_by"]
    number = by.value_counts()
    turned = int((by.eq("tracking") & ~fits["chosen"]).sum())
    against = f" ({turned} of them against the fit alone)" if turned else ""
    parts = _CHOSEN_BY | {"tracking": _CHOSEN_BY["tracking"] + against}
    listed = (f"{number[name]} {text}" for name, text in parts.items() if name in number)
    return f"Of {len(fits)} fits shown: {', '.join(listed)}."


def _percent(share: float) -> str:
    return "–" if not np.isfinite(share) else f"{100 * share:.0f} %"


def _of(row: Document, name: str) -> str:
    of = row[f"{name}_of"]
    return f"{row[name]} of {of} ({_percent(row[name] / of)})" if of else "none"


def balance(energy: pd.DataFrame) -> str:
    """Whether the energies balance, in a sentence."""
    if energy.empty:
        return "No recording is periodic, so there are no cycles."
    worst = energy["imbalance"].abs()
    beyond = int((worst >= BALANCED).sum())
    holds = f"does not close in {beyond} cycles" if beyond else "closes"
    return (
        f"The energy balance {holds}: in {len(energy)} cycles the shaker's work, from the inertia of the masses alone, "
        f"and what ankle and fat pad dissipate differ by {100 * worst.max():.1g} % at most "
        f"({100 * BALANCED:g} % are allowed)."
    )


def counts(documents: Sequence[Document], tracked: Mapping[str, str] | None = None) -> pd.DataFrame:
    """What was fitted, done and failed, a row a mode."""
    totals = summary.counts(documents, tracked)
    rows = totals.to_dict("records")
    return totals[["mode", "fits", "done", "failed", "recordings"]].assign(**{
        "mean fit [%]": [f"{row['fit_percent']:.2f}" if row["done"] else "–" for row in rows],
        "best minimum found twice": [_of(row, "again") for row in rows],
        "computing time [s]": [f"{row['seconds']:.0f}" for row in rows],
    })  # fmt: skip


def verdicts(table: pd.DataFrame) -> pd.DataFrame:
    """Shares of verdicts on the branch shown, a row a parameter, a column a mode."""

    def shares(verdict: pd.Series) -> str:
        return " / ".join(f"{100 * (verdict == word).mean():.0f}" for word in VERDICTS) + " %"

    rows = table[table["shown"]]
    crossed = _crossed(rows, "parameter", "mode", "verdict", shares, table["mode"].unique())
    return crossed.rename_axis("identified / weak / not").reset_index()


def outliers(table: pd.DataFrame) -> pd.DataFrame:
    """Outliers among the estimates with a standard error, a row a mode and load."""
    rows = table[table["shown"] & summary.measured(table)]
    of = zip(rows["mode"], rows["added_mass_kg"], strict=True)
    rows = rows.assign(outliers=[f"{mode}, {load:g} kg" for mode, load in of])

    def share(outlier: pd.Series) -> str:
        return f"{int(outlier.sum())} of {len(outlier)}"

    header = table["parameter"].unique()
    return _crossed(rows, "outliers", "parameter", "outlier", share, header).reset_index()


def branches(documents: Sequence[Document], table: pd.DataFrame) -> pd.DataFrame:
    """How many fits decide alone, what chose the branch that is shown, and which it is, a row a mode.

    "Decided alone" is of every fit, whatever tracking says of it then; the columns after it add up.
    """
    alone = {row["mode"]: row["decided"] for row in summary.counts(documents).to_dict("records")}
    chosen = {"tracking": "decided by all fits together", "likelihood": "decided by the fit alone"}
    rows = []
    for mode, fits in table[table["shown"]].drop_duplicates("key").groupby("mode", sort=False):
        row: dict[str, Any] = {"mode": mode, "fits": len(fits), "decided alone": alone[mode]}
        for by in summary.DECIDED_BY:
            row[chosen.get(by, by)] = int((fits["decided_by"] == by).sum())
        for name in (STIFF_ANKLE, STIFF_PAD):
            row[f"shown: {name}"] = int((fits["branch"] == name).sum())
        rows.append(row)
    return pd.DataFrame(rows)


def recovery(recovered: pd.DataFrame) -> pd.DataFrame:
    """`truth.recovery` for people."""

    def share(row: Document, name: str) -> str:
        of = row[f"{name}_of"]
        return f"{_percent(row[name] / of)} of {of}" if of else "none"

    on = ("the fit's own branch", "the branch shown", "the branch nearer to the truth")
    error_on = ("its own branch", "the branch shown", "the nearer branch")
    return pd.DataFrame(
        {"": f"{r['mode']}, all" if r["parameter"] == "all" else r["parameter"],
         "distinct estimates": r["estimates"]}
        | {f"right on {where}": share(r, way) for where, way in zip(on, WAYS, strict=True)}
        | {f"median error on {where}": _percent(r[f"{way}_error"]) for where, way in zip(error_on, WAYS, strict=True)}
        | {"median standard error stated": _percent(r["std_error"]),
           "right, of those called identified": share(r, "identified")}
        for r in recovered.to_dict("records")
    )  # fmt: skip


def energies(energy: pd.DataFrame) -> pd.DataFrame:
    """Median energies of the branch shown, a row a condition; of its parts where it is decided."""
    cycles = energy[energy["shown"] & follows(energy["fit_percent"])].copy()
    cycles.loc[cycles["decided_by"].isin(summary.OPEN), ["ankle_j", "fat_pad_j"]] = np.nan
    parts = {"ankle_j": "ankle", "fat_pad_j": "fat pad", "shaker_work_j": "shaker"}
    groups = cycles.groupby(["mode", "posture", "added_mass_kg", "frequency_hz"])
    return pd.DataFrame(
        {"mode": mode, "posture": posture, "added mass [kg]": f"{load:g}", "frequency [Hz]": f"{f:g}",
         "cycles": len(group), "branch decided": int(group["ankle_j"].notna().sum())}
        | {f"median {name} [mJ]": _median(1e3 * group[column]) for column, name in parts.items()}
        for (mode, posture, load, f), group in groups
    )  # fmt: skip


def sections(findings: Findings) -> dict[str, pd.DataFrame]:
    """Title -> table of what the checks found, where there is any."""
    of: dict[str, Callable[[Findings], pd.DataFrame]] = {
        "Population": lambda findings: population(findings.populations),
        "Branches over a subject": tracking,
        "Profile likelihood": profiles,
        "Leave one frequency out": held_out,
        "Linear or nonlinear damping": damping,
        "Steady state and time domain": agreement,
    }
    return {title: table for title, make in of.items() if len(table := make(findings))}


def population(populations: Sequence[Population]) -> pd.DataFrame:
    """Mean and spread of each constant over persons, a row each; both branches where undecided."""
    rows = []
    for p in populations:
        for c in p.constants:
            scale, unit = (1e-3, "kN/m") if c.name.startswith("k_") else (1.0, "N s/m")
            mean, low, high = (f"{scale * value:.3g}" for value in (c.mean, c.lower, c.upper))
            logs = ([np.log(getattr(q, n)) for q in c.persons] for n in ("value", "shrunk"))
            scatter = (_percent(float(np.std(values, ddof=1))) for values in logs)
            spread, interval = c.spread_text
            rows.append({
                "condition": f"{p.posture}, {p.added_mass_kg:g} kg", "branch": f"{p.branch} ({p.verdict})",
                "constant": f"{c.name} [{unit}]", "persons": len(c.persons),
                "mean": mean, "95 % of the mean": f"{low} to {high}",
                "spread between persons": spread, "95 % of the spread": interval,
                "scatter of the estimates, before and after shrinking": " to ".join(scatter),
                "persons left out": p.dropped(c) or "nobody",
                "outliers (included)": " and ".join(q.subject for q in c.odd) or "nobody",
            })  # fmt: skip
    return pd.DataFrame(rows)


def left_out(populations: Sequence[Population]) -> str:
    """Who is in none or not in all of the estimates of some populations, and why, in a sentence."""
    listed = [f"{p.added_mass_kg:g} kg, {p.branch}: {who}" for p in populations if (who := p.dropped())]
    return f"Persons left out: {'. '.join(listed)}." if listed else "No person is left out."


def circled(populations: Sequence[Population]) -> str:
    """The outliers that the figure circles, in a sentence; empty where there are none."""
    odd = dict.fromkeys(q.subject for p in populations for c in p.constants for q in c.odd)
    who = ", ".join(odd)
    return f"Circled: outliers, included in the means ({who}). " if odd else ""


def odds(populations: Sequence[Population]) -> list[str]:
    """Odds of the branches over all persons, a sentence a condition; then persons who are outliers."""
    first = {(p.posture, p.added_mass_kg): p for p in reversed(populations)}
    branch_odds = [f"{where}, {load:g} kg: {p.odds_text}." for (where, load), p in sorted(first.items())]
    return [*branch_odds, *(sentence for p in populations for sentence in p.odd())]


def tracking(findings: Findings) -> pd.DataFrame:
    """How many fits of each subject are on which branch when all are weighed together."""
    rows = []
    for s in findings.subjects:
        names = [c.branch for c in s.tracking.choices] if s.tracking else []
        overall = s.tracking.overall if s.tracking else {}
        name, odds = max(overall.items(), key=lambda item: item[1], default=("", 0.0))
        text = "–" if not odds else "over a million to 1" if odds > 1e6 else f"{readable(odds)} to 1"
        rows.append(
            {"mode": f"{s.mode}, {s.posture}", "subject": s.subject}
            | {of: names.count(of) for of in (STIFF_ANKLE, STIFF_PAD, "undecided")}
            | {"if one branch for all": name}
            | {"its odds over the other for all": "even" if 1 <= odds < 1.05 else text}
        )
    return pd.DataFrame(rows)


def profiles(findings: Findings) -> pd.DataFrame:
    """Profiles beside the intervals of the standard errors, those that depart first."""
    rows = []
    for d, r in sorted(findings.of("profile"), key=lambda pair: not pair[1]["departs"])[:LISTED]:
        low = "open" if r["open_below"] else readable(r["lower"], 4)
        high = "open" if r["open_above"] else readable(r["upper"], 4)
        rows.append({
            "fit": f"{summary.place(d)} ({d['mode']})", "parameter": symbol_and_unit(r["key"])[0],
            "verdict": r["verdict"] + ("; a better fit was met" if r["better"] else ""),
            "profile against standard error": "departs" if r["departs"] else "",
            "estimate": readable(r["value"], 4), "95 % by profile": f"{low} to {high}",
            "95 % by standard error": " to ".join(readable(x, 4) for x in r["wald"]),
        })  # fmt: skip
    return pd.DataFrame(rows)


def held_out(findings: Findings) -> pd.DataFrame:
    """Medians of the errors at frequencies that were left out, a row a mode."""
    checks = [(d["mode"], r["held_out"]) for d, r in findings.of("validation")]
    rows = []
    for mode in dict.fromkeys(mode for mode, _ in checks):
        groups = [errors for of, errors in checks if of == mode]
        errors = pd.DataFrame([row for group in groups for row in group["rows"]])
        inside, ends = errors[~errors["edge"].astype(bool)], errors[errors["edge"].astype(bool)]
        rows.append({
            "mode": mode, "groups of recordings": len(groups),
            "recordings predicted between others": len(inside),
            "their error [%]": _median(inside["percent"]),
            "their chi-square per number": _median(inside["chi_square"] / inside["numbers"]),
            "error of the lowest and highest frequency [%]": _median(ends["percent"]),
            "no stable prediction": sum(len(group["failed"]) for group in groups),
        })  # fmt: skip
    return pd.DataFrame(rows)


def damping(findings: Findings) -> pd.DataFrame:
    """Linear against nonlinear damping, a row a fit."""
    compared = [(d, r["damping"]) for d, r in findings.of("validation") if r["damping"]]
    rows = []
    for d, r in compared[:LISTED]:
        linear, bent = r["linear"], r["nonlinear"]
        errors = " / ".join(f"{law['held_out_percent']:.3g}" for law in (linear, bent))
        less = {f"{n.upper()}, linear less nonlinear": f"{linear[n] - bent[n]:.4g}" for n in ("aic", "bic")}
        header = "error at frequencies left out [%], linear / nonlinear"
        preferred = zip(("AIC", "BIC", "frequencies left out"), r["preferred"].values(), strict=True)
        laws = {f"law that {criterion} prefer{'s' * criterion.isupper()}": law for criterion, law in preferred}
        rows.append({"mode": d["mode"], "fit": summary.place(d), **less, header: errors, **laws})
    return pd.DataFrame(rows)


def agreement(findings: Findings) -> pd.DataFrame:
    """Steady state against time domain, disagreements first."""
    order, rows = list(_ANSWER), []
    checks = sorted(findings.of("agreement"), key=lambda pair: order.index(pair[1]["agrees"]))
    for d, r in checks[:LISTED]:
        z = [abs(x["z"]) for x in r["differences"] if x["z"] is not None and np.isfinite(x["z"])]
        rows.append({
            "mode": d["mode"], "fit": summary.place(d), "branch": r["branch"], "agrees": _ANSWER[r["agrees"]],
            "largest difference [joint errors]": f"{max(z):.2g}" if z else "–",
            "why": r["sentence"],
        })  # fmt: skip
    return pd.DataFrame(rows)


def _crossed(
    rows: pd.DataFrame,
    index: str,
    columns: str,
    values: str,
    text: Callable[[pd.Series], str],
    header: Iterable[str],
) -> pd.DataFrame:
    """A text on each group of values, a row each in the order in which they come."""
    table = rows.groupby([index, columns], sort=False)[values].agg(text).unstack(columns)
    return table.reindex(index=rows[index].unique(), columns=header).astype(object).fillna("–")


def _median(values: pd.Series) -> str:
    return f"{values.median():.3g}" if values.notna().any() else "–"
