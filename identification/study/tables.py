"""The tables and sentences of a study's report, as ready text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

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
    documents: Sequence[Mapping[str, Any]], table: pd.DataFrame, energy: pd.DataFrame, found: pd.DataFrame
) -> list[str]:
    """The study in a few sentences."""
    totals = summary.counts(documents)
    done, failed = int(totals["done"].sum()), int(totals["failed"].sum())
    sentences = [f"{done} of {done + failed} fits done{f', {failed} failed' if failed else ''}."]
    chosen = table[table["chosen"]]
    for row in totals.to_dict("records"):
        if row["done"]:
            known = (chosen.loc[chosen["mode"] == row["mode"], "verdict"] == "identified").mean()
            sentence = (
                f"{row['mode'].capitalize()}: mean fit {row['fit_percent']:.1f} %, {_percent(known)} of estimates "
            )
            sentences.append(f"{sentence}identified, mirror decided in {row['decided']} of {row['done']}.")
    for row in found[found["parameter"] == "all"].to_dict("records") if len(found) else []:
        sentences.append(
            f"Truth within three standard errors, {row['mode']}: {_of(row, 'chosen')} on the chosen branch, "
            f"{_of(row, 'either')} on the nearer one."
        )
    return [*sentences, *([balance(energy)] if len(energy) else [])]


def _percent(share: float) -> str:
    return "–" if not np.isfinite(share) else f"{100 * share:.0f} %"


def _of(row: Mapping[str, Any], name: str) -> str:
    of = row[f"{name}_of"]
    return f"{row[name]} of {of} ({_percent(row[name] / of)})" if of else "none"


def counts(documents: Sequence[Mapping[str, Any]]) -> Grid:
    """What was fitted, done and failed, a row a mode."""
    header = ["mode", "fits", "done", "failed", "recordings", "mean fit [%]", "computing time [s]"]
    rows = []
    for r in summary.counts(documents).to_dict("records"):
        fit = f"{r['fit_percent']:.2f}" if r["done"] else "–"
        rows.append(
            [r["mode"], *(str(r[k]) for k in ("fits", "done", "failed", "recordings")), fit, f"{r['seconds']:.0f}"]
        )
    return Grid(header, rows)


def verdicts(table: pd.DataFrame) -> Grid:
    """Shares of verdicts, a row a parameter."""
    chosen = table[table["chosen"]]
    modes = list(dict.fromkeys(chosen["mode"]))
    rows = []
    for parameter in dict.fromkeys(chosen["parameter"]):
        own = chosen[chosen["parameter"] == parameter]
        cells = []
        for mode in modes:
            verdict = own.loc[own["mode"] == mode, "verdict"]
            each = [(verdict == word).mean() for word in ("identified", "weak", "not identifiable")]
            cells.append(" / ".join(f"{100 * share:.0f}" for share in each) + " %" if len(verdict) else "–")
        rows.append([parameter, *cells])
    return Grid(["identified / weak / not", *modes], rows)


def branches(documents: Sequence[Mapping[str, Any]]) -> Grid:
    """Which branches were chosen, and whether the data decided, a row a mode."""
    rows = []
    for mode in dict.fromkeys(d["mode"] for d in documents):
        results = [d["result"] for d in documents if d["mode"] == mode and d["status"] == "done"]
        words = [r["verdict"] for r in results]
        first = [r["branches"][0]["name"] for r in results]
        counts = [words.count(w) for w in ("decided", "undecided", "not compared")]
        rows.append([mode, *map(str, counts), *(str(first.count(name)) for name in ("stiff ankle", "stiff pad"))])
    return Grid(["mode", "decided", "undecided", "not compared", "chosen: stiff ankle", "chosen: stiff pad"], rows)


def outliers(table: pd.DataFrame) -> Grid:
    """Outliers by parameter, a row a mode and load."""
    chosen = table[table["chosen"]]
    parameters = list(dict.fromkeys(chosen["parameter"]))
    rows = []
    for (mode, load), group in chosen.groupby(["mode", "added_mass_kg"], sort=False):
        counts = [group[group["parameter"] == p] for p in parameters]
        cells = [f"{int(c['outlier'].sum())} of {len(c)}" if len(c) else "–" for c in counts]
        rows.append([f"{mode}, {load:g} kg", *cells])
    return Grid(["outliers", *parameters], rows)


def recovery(found: pd.DataFrame) -> Grid:
    """`truth.recovery` for people."""
    header = ["mode", "parameter", "estimates", "at a bound", "right", "right, nearer branch",
              "said identified, and right", "median error", "median standard error"]  # fmt: skip
    rows = [
        [
            r["mode"] if r["parameter"] == "all" else "", r["parameter"], str(r["estimates"]), str(r["no_error"]),
            _of(r, "chosen"), _of(r, "either"), _of(r, "identified_chosen"), _percent(r["error"]),
            _percent(r["std_error"]),
        ]
        for r in found.to_dict("records")
    ]  # fmt: skip
    return Grid(header, rows)


def energies(energy: pd.DataFrame) -> Grid:
    """Median energies of the chosen branch, a row a condition."""
    header = [
        "mode",
        "posture",
        "added mass [kg]",
        "frequency [Hz]",
        "cycles",
        "ankle [mJ]",
        "fat pad [mJ]",
        "shaker [mJ]",
    ]
    chosen = energy[energy["chosen"]]
    rows = []
    for (mode, posture, load, f), g in chosen.groupby(["mode", "posture", "added_mass_kg", "frequency_hz"]):
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
