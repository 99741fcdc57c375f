"""Figures of the load effect: the best set of each mechanism, and how virtual subjects are named."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fasbody.leg.figures import judged, unity
from fasbody.leg.statements import ADDED_KG
from fasbody.presentation import COLOURS, LINES, MARKS, PAGE, printed

if TYPE_CHECKING:
    from identification.rivals.mechanism_fit import Confusion
    from reproduction.load_effect.search import Searched

_LOADS = [f"{added:g} kg" for added in ADDED_KG]


@printed
def mechanisms(searched: "Sequence[Searched]") -> Figure:
    """MB of each mechanism's best set under three loads, 10-50 Hz, and where MB was measured to resonate."""
    columns = min(4, len(searched))
    rows = -(-len(searched) // columns)
    figure = Figure(figsize=(PAGE, 0.6 + 1.65 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for letter, ax, result in zip("abcdefghijkl", panels.flat, searched, strict=False):
        f, MB = result.MB
        for T, colour, line in zip(MB, COLOURS, LINES, strict=False):
            ax.plot(f, T, color=colour, ls=line)
        ax.set_title(f"{letter}  {result.name.replace('load moves along', 'load moves')}", loc="left")
        low, high = np.nanmin(MB), np.nanmax(MB)
        ax.set_ylim(min(0.9, low) - 0.1, max(1.2, high) + 0.25 * (max(1.2, high) - min(0.9, low)))
        unity(ax)
        judged(ax, f, MB, result.best_judged.peak_hz[0])
    for ax in panels.flat[len(searched) :]:
        ax.axis("off")
    for ax in panels[-1]:
        ax.set_xlabel("frequency [Hz]")
        ax.set_xticks([10, 20, 30, 40, 50])
    for row in panels:
        row[0].set_ylabel("MB")
    handles = [
        Line2D([], [], color=colour, ls=line, marker=mark, ms=5, label=f"{load} added")
        for load, colour, line, mark in zip(_LOADS, COLOURS, LINES, MARKS, strict=False)
    ]
    handles.append(Line2D([], [], color="0.4", lw=3.5, label="measured resonance"))
    handles.append(Line2D([], [], color="0.4", ls="", marker="o", mfc="white", ms=5, label="highest MB outside it"))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=len(handles),
        handlelength=2.6,
        columnspacing=1.2,
    )
    return figure


@printed
def confusion(confusions: "Sequence[Confusion]") -> Figure:
    """What an analysis calls the virtual subjects of each mechanism, one panel a plan."""
    drawn = [c for c in confusions if c.plan.endswith("(the thesis)")] + list(confusions[-1:])
    figure = Figure(figsize=(min(PAGE, 3.3 * len(drawn) + 0.5), 3.0), layout="constrained")
    panels = figure.subplots(1, len(drawn), squeeze=False, sharey=True)[0]
    for letter, ax, result in zip("ab", panels, drawn, strict=False):
        record = result.record()["named"]
        names = list(next(iter(record.values())))
        counts = np.array([[float(row[says]) for says in names] for row in record.values()])
        share = counts / counts.sum(axis=1, keepdims=True)
        ax.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for (i, j), value in np.ndenumerate(counts):
            if value:
                ax.text(
                    j,
                    i,
                    f"{value:.0f}",
                    ha="center",
                    va="center",
                    color="white" if share[i, j] > 0.6 else "black",
                )
        ax.set_xticks(range(len(names)), names, rotation=40, ha="right")
        ax.set_yticks(range(len(record)), list(record))
        ax.axvline(len(record) - 0.5, color="0.5", lw=0.8)
        ax.tick_params(length=0)
        ax.grid(False)
        known = {
            "and the tuberosity (the thesis)": "the thesis' protocol",
            "all of these": "the better protocol",
        }
        ax.set_title(f"{letter}  {known.get(result.plan, result.plan)}", loc="left")
        ax.set_xlabel("named")
    panels[0].set_ylabel("true mechanism of the subjects")
    return figure
