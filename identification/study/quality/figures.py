"""Figures of a study's fits rather than of its feet: verdicts on each parameter, and where the starts ended."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from identification.branches import DECISIVE_ODDS
from identification.figures import label_of, panels
from identification.study.figures import CONSTANTS, GREY, MODEL, noted, styled

_VERDICTS = {"identified": "#2e86ab", "weak": "#edae49", "not identifiable": "#c9c9c9"}
_BLUE = _VERDICTS["identified"]
#: Difference in the sum of squares that is none, and that 1000 to 1 odds need.
_SAME, _TOLD_APART = 1e-2, round(2 * float(np.log(DECISIVE_ODDS)), 1)


@styled
def waterfall(documents: Sequence[Mapping[str, Any]]) -> Figure:
    """How far the starts ended above the best of their fit, best first: quantiles over fits, by mode.

    Below, the share of these starts that ended on the other branch than the best start.
    """
    shown = [d for d in documents if d["status"] == "done" and d["result"].get("starts")]
    modes = list(dict.fromkeys(d["mode"] for d in shown))
    width = max(4.6, 3.0 * len(modes) + 0.6)
    figure, axes = panels(2, max(1, len(modes)), width, 3.9, sharex="col", sharey="row", height_ratios=[2.6, 1])
    for column, mode in zip(axes.T, modes, strict=False):
        mine = [d["result"]["starts"] for d in shown if d["mode"] == mode]
        ranks = range(max(len(starts) for starts in mine))
        above = [np.array([max(s[k]["cost"] - s[0]["cost"], _SAME) for s in mine if len(s) > k]) for k in ranks]
        other = [np.mean([s[k]["branch"] != s[0]["branch"] for s in mine if len(s) > k]) for k in ranks]
        at = np.array(ranks) + 1
        low, lower, middle, upper, high = np.array([np.quantile(a, (0.05, 0.25, 0.5, 0.75, 0.95)) for a in above]).T
        column[0].fill_between(at, low, high, color=_BLUE, alpha=0.18, lw=0, label="90 % of the fits")
        column[0].fill_between(at, lower, upper, color=_BLUE, alpha=0.35, lw=0, label="half of them")
        column[0].plot(at, middle, "o-", lw=1.8, ms=3.5, color=_BLUE, label="median")
        column[0].axhline(_TOLD_APART, lw=0.9, ls="--", color=GREY, label="1000 to 1")
        column[0].set_yscale("log")
        column[0].set_title(f"{mode}, {len(mine)} fits")
        column[1].bar(at, 100 * np.array(other), width=0.6, color=MODEL)
        column[1].set_ylim(0, 100)
        column[1].set_xlabel("start, best first")
        column[1].xaxis.get_major_locator().set_params(integer=True)
    axes[0, 0].set_ylabel("sum of squares\nabove the best")
    axes[1, 0].set_ylabel("on the other\nbranch [%]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8, columnspacing=1.2)
    return noted(
        figure,
        f"below the dashed line ({_TOLD_APART:g}) the data do not tell two ends apart; {_SAME:g} or less is drawn as "
        f"{_SAME:g}",
    )


@styled
def verdicts(table: pd.DataFrame) -> Figure:
    """How many estimates of each parameter are identified, weak and not identifiable, by mode."""
    rows = table[table["shown"]]
    modes = list(dict.fromkeys(rows["mode"]))
    found = list(dict.fromkeys(rows["parameter"]))
    names = [n for n in CONSTANTS if n in found] + [n for n in found if n not in CONSTANTS]
    figure, axes = panels(1, max(1, len(modes)), 2.9 * max(1, len(modes)) + 0.8, 0.27 * len(names) + 1.2, sharey=True)
    for axis, mode in zip(axes[0], modes, strict=False):
        own = rows[rows["mode"] == mode]
        counts = pd.crosstab(own["parameter"], own["verdict"]).reindex(
            index=names, columns=list(_VERDICTS), fill_value=0
        )
        share = 100 * counts.div(counts.sum(axis=1).replace(0, 1), axis=0)
        left = np.zeros(len(names))
        for verdict, colour in _VERDICTS.items():
            axis.barh(range(len(names)), share[verdict], left=left, color=colour, label=verdict, height=0.72)
            left = left + share[verdict].to_numpy()
        axis.set_title(f"{mode} ({own['key'].nunique()} fits)")
        axis.set_xlabel("share of estimates [%]")
        axis.set_xlim(0, 100)
        axis.grid(axis="y", visible=False)
    axes[0, 0].set_yticks(range(len(names)), [label_of(n) for n in names])
    axes[0, 0].invert_yaxis()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=8.5)
    return figure
