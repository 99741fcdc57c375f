"""The tables and sentences of a study's report, as ready text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.study import summary

#: Imbalance of energy that a cycle may have.
BALANCED = 0.005


@dataclass(frozen=True)
class Grid:
    """A table of a page: its header and rows of ready text."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Section:
    """What else a study found: a heading, paragraphs, and a table or an inline picture if there is one."""

    title: str
    texts: Sequence[str]
    table: Grid | None = None
    svg: Markup | None = None


def short(
    documents: Sequence[Mapping[str, Any]], table: pd.DataFrame, energy: pd.DataFrame, found: pd.DataFrame,
    tracked: Mapping[str, str] | None = None,
) -> list[str]:  # fmt: skip
    """The study in a few sentences."""
    totals = summary.counts(documents, tracked)
    done, failed = int(totals["done"].sum()), int(totals["failed"].sum())
    sentences = [f"{done} of {done + failed} fits done{f', {failed} failed' if failed else ''}."]
    sentences += [said] if (said := summary.poor_sentence(documents, tracked)) else []
    rows = table[table["shown"]]
    for row in totals.to_dict("records"):
        if row["done"]:
            own = rows[rows["mode"] == row["mode"]]
            known = (own["verdict"] == "identified").mean()
            sentence = (
                f"{row['mode'].capitalize()}: mean fit {row['fit_percent']:.1f} %, {_percent(known)} of estimates "
                f"identified, mirror decided in {row['decided']} of {row['done']} alone."
            )
            sentence += f" {drawn(own)}" if len(own) else ""
            truth = found[(found["parameter"] == "all") & (found["mode"] == row["mode"])] if len(found) else found
            for r in truth.to_dict("records"):
                sentence += (
                    f" Truth within three standard errors: {_of(r, 'chosen')} on each fit's own branch, "
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
        "likelihood": "on the one that its data decide alone",
        "undecided": "undecided and on their own likelier branch",
        "not compared": "with one branch only",
        "no mirror": "of a model without a known mirror",
    }
    said = ", ".join(f"{number[word]} {text}" for word, text in parts.items() if number[word])
    return f"Of {len(fits)} fits shown: {said}."


def _percent(share: float) -> str:
    return "–" if not np.isfinite(share) else f"{100 * share:.0f} %"


def _of(row: Mapping[str, Any], name: str) -> str:
    of = row[f"{name}_of"]
    return f"{row[name]} of {of} ({_percent(row[name] / of)})" if of else "none"


def counts(documents: Sequence[Mapping[str, Any]], tracked: Mapping[str, str] | None = None) -> Grid:
    """What was fitted, done and failed, a row a mode."""
    header = ["mode", "fits", "done", "failed", "recordings", "mean fit [%]", "computing time [s]"]
    rows = []
    for r in summary.counts(documents, tracked).to_dict("records"):
        fit = f"{r['fit_percent']:.2f}" if r["done"] else "–"
        rows.append(
            [r["mode"], *(str(r[k]) for k in ("fits", "done", "failed", "recordings")), fit, f"{r['seconds']:.0f}"]
        )
    return Grid(header, rows)


def verdicts(table: pd.DataFrame) -> Grid:
    """Shares of verdicts on the branch shown, a row a parameter."""
    shown = table[table["shown"]]
    modes = list(dict.fromkeys(shown["mode"]))
    rows = []
    for parameter in dict.fromkeys(shown["parameter"]):
        own = shown[shown["parameter"] == parameter]
        cells = []
        for mode in modes:
            verdict = own.loc[own["mode"] == mode, "verdict"]
            each = [(verdict == word).mean() for word in ("identified", "weak", "not identifiable")]
            cells.append(" / ".join(f"{100 * share:.0f}" for share in each) + " %" if len(verdict) else "–")
        rows.append([parameter, *cells])
    return Grid(["identified / weak / not", *modes], rows)


def branches(table: pd.DataFrame) -> Grid:
    """What chose the branches, and which they are, a row a mode."""
    fits = table[table["shown"]].drop_duplicates("key")
    rows = []
    for mode in dict.fromkeys(fits["mode"]):
        own = fits[fits["mode"] == mode]
        number = [int((own["decided_by"] == word).sum()) for word in summary.DECIDED_BY]
        sides = [int((own["branch"] == name).sum()) for name in (STIFF_ANKLE, STIFF_PAD)]
        rows.append([mode, *map(str, [*number, *sides])])
    header = ["mode", "decided by tracking", "by its data alone", *summary.DECIDED_BY[2:]]
    return Grid([*header, f"shown: {STIFF_ANKLE}", f"shown: {STIFF_PAD}"], rows)


def reasons(documents: Sequence[Mapping[str, Any]]) -> Grid:
    """The verdict of each trend on its mirror and why it is so; trends are not weighed together with other fits."""
    trends = [d for d in documents if d["mode"] == "trend" and d["status"] == "done"]
    rows = [[summary.place(d), d["result"]["verdict"], d["result"].get("verdict_reason", "")] for d in trends]
    return Grid(["trend of", "verdict", "why"], rows)


def outliers(table: pd.DataFrame) -> Grid:
    """Outliers among the estimates with a standard error, by parameter, a row a mode and load."""
    shown = table[table["shown"] & summary.measured(table)]
    parameters = list(dict.fromkeys(table["parameter"]))
    rows = []
    for (mode, load), group in shown.groupby(["mode", "added_mass_kg"], sort=False):
        counts = [group[group["parameter"] == p] for p in parameters]
        cells = [f"{int(c['outlier'].sum())} of {len(c)}" if len(c) else "–" for c in counts]
        rows.append([f"{mode}, {load:g} kg", *cells])
    return Grid(["outliers", *parameters], rows)


def recovery(found: pd.DataFrame) -> Grid:
    """`truth.recovery` for people."""
    ways = ("chosen", "tracked", "either")
    header = ["", "estimates", "right: own", "shown", "nearer", "error: own", "shown", "nearer", "stated",
              "identified, right"]  # fmt: skip

    def share(row: Mapping[str, Any], name: str) -> str:
        of = row[f"{name}_of"]
        return f"{_percent(row[name] / of)} of {of}" if of else "none"

    rows = [
        [
            f"{r['mode']}, all" if r["parameter"] == "all" else r["parameter"], str(r["estimates"]),
            *(share(r, way) for way in ways), *(_percent(r[f"{way}_error"]) for way in ways), _percent(r["std_error"]),
            share(r, "identified"),
        ]
        for r in found.to_dict("records")
    ]  # fmt: skip
    return Grid(header, rows)


def energies(energy: pd.DataFrame) -> Grid:
    """Median energies of the branch shown, a row a condition."""
    header = ["mode", "posture", "added mass [kg]", "frequency [Hz]", "cycles", "median ankle [mJ]",
              "median fat pad [mJ]", "median shaker [mJ]"]  # fmt: skip
    shown = energy[energy["shown"] & summary.follows(energy["fit_percent"])]
    rows = []
    for (mode, posture, load, f), g in shown.groupby(["mode", "posture", "added_mass_kg", "frequency_hz"]):
        middles = [f"{1e3 * g[column].median():.3g}" for column in ("ankle_j", "fat_pad_j", "shaker_work_j")]
        rows.append([mode, posture, f"{load:g}", f"{f:g}", str(len(g)), *middles])
    return Grid(header, rows)


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
