"""Figures of the leg. Every function returns a matplotlib Figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fasbody.leg.statements import ADDED_KG, RANGES_HZ
from fasbody.presentation import COLOURS, MARKS

if TYPE_CHECKING:
    from fasbody.leg.decide import Confusion
    from fasbody.leg.mechanisms import Searched
    from fasbody.leg.naming import Naming
    from fasbody.leg.peaks import Peaks

#: One line a load, so that a print without colour tells them apart.
LINES = ("-", "--", "-.")


def _plain(ax: Axes) -> None:
    ax.axhline(1, color="0.6", lw=0.8, zorder=0)
    ax.grid(color="0.92")
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def _ranges(ax: Axes) -> None:
    """Bars at the foot of a panel: where each load's resonance was measured."""
    for load, ((low, high), colour) in enumerate(zip(RANGES_HZ, COLOURS, strict=False)):
        height = 0.03 + 0.035 * load
        ax.plot(
            [low, high], [height] * 2, color=colour, lw=4, solid_capstyle="butt", transform=ax.get_xaxis_transform()
        )


def peaks(result: "Peaks") -> Figure:
    """MB, TB and TM over frequency under three loads; bars mark where MB was measured to resonate."""
    figure = Figure(figsize=(7.2, 2.9), layout="constrained")
    panels = figure.subplots(1, 3)
    for ax, pair in zip(panels, ("MB", "TB", "TM"), strict=True):
        for added, T, colour, line in zip(ADDED_KG, getattr(result, pair), COLOURS, LINES, strict=False):
            ax.plot(result.frequency_hz, np.abs(T), color=colour, ls=line, lw=1.4, label=f"{added:g} kg added")
        ax.set_title(pair, fontsize=9, loc="left")
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylim(bottom=0)
        _plain(ax)
    _ranges(panels[0])
    panels[0].set_xlabel("frequency [Hz]\nbars: resonance as measured")
    panels[0].set_ylabel("transmissibility [1]")
    panels[1].legend(fontsize=8, frameon=False)
    return figure


def mechanisms(found: "Sequence[Searched]") -> Figure:
    """MB of each mechanism's best set under three loads, 10-50 Hz; bars mark the measured ranges."""
    rows = -(-len(found) // 2)
    figure = Figure(figsize=(7.2, 2.2 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True).ravel()
    f = np.arange(10.0, 50.25, 0.5)
    for ax, each in zip(panels, found, strict=False):
        values = {name: np.array([value]) for name, value in each.best.items()}
        MB = np.abs(each.mechanism.response(f, values)[0][0])
        for added, T, colour, line in zip(ADDED_KG, MB, COLOURS, LINES, strict=False):
            ax.plot(f, T, color=colour, ls=line, lw=1.4, label=f"{added:g} kg added")
        ax.set_title(f"{each.mechanism.name}: {each.best_judged.ranges[0]} of 3 ranges", fontsize=9, loc="left")
        ax.set_ylim(0.0 if MB.min() < 0.8 else 0.8, 1.15 * max(1.2, MB.max()))
        ax.tick_params(labelbottom=True)
        _ranges(ax)
        _plain(ax)
    handles, labels = panels[0].get_legend_handles_labels()
    for ax in panels[len(found) :]:
        ax.axis("off")
        ax.legend(handles, labels, frameon=False, loc="center", title="bars: measured resonance")
    if len(found) == panels.size:
        panels[0].legend(fontsize=8, frameon=False)
    figure.supxlabel("frequency [Hz]; bars: where the resonance of each load was measured", fontsize=10)
    figure.supylabel("MB [1]", fontsize=10)
    return figure


def confusion(found: "Sequence[Confusion]") -> Figure:
    """What an analysis calls the virtual subjects of each mechanism, one panel a plan."""
    shown = [c for c in found if c.plan.endswith("(the thesis)")] + list(found[-1:])
    figure = Figure(figsize=(3.7 * len(shown) + 0.6, 3.5), layout="constrained")
    panels = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    for ax, each in zip(panels, shown, strict=True):
        record = each.record()["named"]
        names = list(next(iter(record.values())))
        counts = np.array([[float(row[says]) for says in names] for row in record.values()])
        share = counts / counts.sum(axis=1, keepdims=True)
        ax.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for (i, j), value in np.ndenumerate(counts):
            if value:
                ax.text(j, i, f"{value:.0f}", ha="center", va="center", fontsize=9,
                        color="white" if share[i, j] > 0.6 else "black")  # fmt: skip
        ax.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=8)
        ax.set_yticks(range(len(record)), list(record), fontsize=8)
        ax.axvline(len(record) - 0.5, color="0.5", lw=0.8)
        ax.tick_params(length=0)
        known = {"and the tuberosity (the thesis)": "the thesis' protocol", "all of these": "the better protocol"}
        ax.set_title(known.get(each.plan, each.plan), fontsize=9, loc="left")
        ax.set_xlabel("named", fontsize=9)
    panels[0].set_ylabel("truth", fontsize=9)
    return figure


def naming(result: "Naming") -> Figure:
    """|MB| and |TB| as recorded (marks, hollow for a smaller amplitude) and of the best mechanism's fit (lines)."""
    seen, best = result.seen, result.fits[0]
    kept = seen.recordings.repeats
    plan = seen.plan.only(kept)
    pairs = ("MB", "TB") if plan.tuberosity else ("MB",)
    figure = Figure(figsize=(3.5 * len(pairs) + 0.4, 3.0), layout="constrained")
    panels = figure.subplots(1, len(pairs), squeeze=False)[0]
    smaller = plan.partner >= 0
    for ax, pair in zip(panels, pairs, strict=True):
        read, fitted = (np.abs(part) for part in (getattr(seen.recordings, pair)[kept], getattr(best, pair)))
        for added, colour, mark in zip(np.unique(plan.added_kg), COLOURS, MARKS, strict=False):
            for some, hollow in (
                ((plan.added_kg == added) & ~smaller, False),
                ((plan.added_kg == added) & smaller, True),
            ):
                if not some.any():
                    continue
                at = np.flatnonzero(some)[np.argsort(plan.frequency_hz[some])]
                label = f"{added:g} kg added" + (", smaller amplitude" if hollow else "")
                face = "none" if hollow else colour
                ax.plot(plan.frequency_hz[at], read[at], mark, color=colour, mfc=face, ms=4.5, label=label)
                ax.plot(plan.frequency_hz[at], fitted[at], color=colour, lw=1, ls=":" if hollow else "-")
        ax.set_title(f"{pair}: recorded (marks), {best.rival} (lines)", fontsize=9, loc="left")
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylim(0, 1.1 * max(1.0, read.max(), fitted.max()))
        _plain(ax)
    panels[0].set_ylabel("transmissibility [1]")
    panels[-1].legend(fontsize=8, frameon=False)
    return figure
