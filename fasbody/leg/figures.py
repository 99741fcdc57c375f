"""Figures of the leg. Every function returns a matplotlib Figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fasbody.leg.statements import ADDED_KG, RANGES_HZ
from fasbody.presentation import COLOURS, LINES, MARKS, PAGE, named_lines, printed

if TYPE_CHECKING:
    from fasbody.leg.decide import Confusion
    from fasbody.leg.mechanisms import Searched
    from fasbody.leg.naming import Naming
    from fasbody.leg.peaks import Peaks

_LOADS = [f"{added:g} kg" for added in ADDED_KG]
#: Where the thesis shook [Hz]: the highest MB is sought there.
_SHAKEN = (10.0, 50.0)


def _unity(ax: Axes) -> None:
    ax.axhline(1, color="0.6", lw=0.8, zorder=0)


def _judged(ax: Axes, f: np.ndarray, MB: np.ndarray, peak_hz: Sequence[float]) -> None:
    """A bar above where each load's resonance was measured; a mark where MB (3, f) is highest, hollow outside it."""
    for (low, high), T, peak, colour, mark in zip(RANGES_HZ, MB, peak_hz, COLOURS, MARKS, strict=False):
        ax.axvspan(low, high, color=colour, alpha=0.1, lw=0, zorder=0)
        ax.plot([low + 0.3, high - 0.3], [0.975] * 2, color=colour, lw=3.5, solid_capstyle="butt",
                transform=ax.get_xaxis_transform())  # fmt: skip
        face = colour if low <= peak <= high else "white"
        ax.plot(peak, np.interp(peak, f, T), mark, color=colour, mfc=face, ms=5, zorder=4)


@printed
def peaks(result: "Peaks") -> Figure:
    """MB, TB and TM over frequency under three loads, and where MB was measured to resonate."""
    figure = Figure(figsize=(PAGE, 2.6), layout="constrained")
    panels = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
    f = np.asarray(result.frequency_hz)
    for ax, pair in zip(panels, ("MB", "TB", "TM"), strict=True):
        curves = [np.abs(T) for T in getattr(result, pair)]
        for T, colour, line in zip(curves, COLOURS, LINES, strict=False):
            ax.plot(f, T, color=colour, ls=line)
        ax.set_xlabel("frequency [Hz]")
        ax.set_xlim(0, f[-1])
        ax.set_ylim(0.8 if pair == "MB" else 0, 1.4 if pair == "MB" else 1.75)
        _unity(ax)
        if pair == "MB":
            _judged(ax, f, np.array(curves), [result.highest("MB", load)[0] for load in range(len(curves))])
            named_lines(ax, f, curves, _LOADS, COLOURS[:3])
    names = ("malleolus / base (MB)", "tuberosity / base (TB)", "tuberosity / malleolus (TM)")
    for letter, ax, name in zip("abc", panels, names, strict=True):
        ax.set_title(f"{letter}  {name}", loc="left")
    panels[0].set_ylabel("transmissibility")
    return figure


@printed
def mechanisms(found: "Sequence[Searched]") -> Figure:
    """MB of each mechanism's best set under three loads, 10-50 Hz, and where MB was measured to resonate."""
    columns = min(4, len(found))
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(PAGE, 0.6 + 1.65 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
    f = np.arange(_SHAKEN[0], _SHAKEN[1] + 0.25, 0.5)
    for letter, ax, each in zip("abcdefghijkl", panels.flat, found, strict=False):
        values = {name: np.array([value]) for name, value in each.best.items()}
        MB = np.abs(each.mechanism.response(f, values)[0][0])
        for T, colour, line in zip(MB, COLOURS, LINES, strict=False):
            ax.plot(f, T, color=colour, ls=line)
        ax.set_title(f"{letter}  {each.mechanism.name.replace('load moves along', 'load moves')}", loc="left")
        low, high = np.nanmin(MB), np.nanmax(MB)
        ax.set_ylim(min(0.9, low) - 0.1, max(1.2, high) + 0.25 * (max(1.2, high) - min(0.9, low)))
        _unity(ax)
        _judged(ax, f, MB, each.best_judged.peak_hz[0])
    for ax in panels.flat[len(found) :]:
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
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), handlelength=2.6, columnspacing=1.2)
    return figure


@printed
def confusion(found: "Sequence[Confusion]") -> Figure:
    """What an analysis calls the virtual subjects of each mechanism, one panel a plan."""
    shown = [c for c in found if c.plan.endswith("(the thesis)")] + list(found[-1:])
    figure = Figure(figsize=(min(PAGE, 3.3 * len(shown) + 0.5), 3.0), layout="constrained")
    panels = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    for letter, ax, each in zip("ab", panels, shown, strict=False):
        record = each.record()["named"]
        names = list(next(iter(record.values())))
        counts = np.array([[float(row[says]) for says in names] for row in record.values()])
        share = counts / counts.sum(axis=1, keepdims=True)
        ax.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for (i, j), value in np.ndenumerate(counts):
            if value:
                ax.text(j, i, f"{value:.0f}", ha="center", va="center", color="white" if share[i, j] > 0.6 else "black")
        ax.set_xticks(range(len(names)), names, rotation=40, ha="right")
        ax.set_yticks(range(len(record)), list(record))
        ax.axvline(len(record) - 0.5, color="0.5", lw=0.8)
        ax.tick_params(length=0)
        ax.grid(False)
        known = {"and the tuberosity (the thesis)": "the thesis' protocol", "all of these": "the better protocol"}
        ax.set_title(f"{letter}  {known.get(each.plan, each.plan)}", loc="left")
        ax.set_xlabel("named")
    panels[0].set_ylabel("true mechanism of the subjects")
    return figure


@printed
def naming(result: "Naming") -> Figure:
    """|MB| and |TB| as recorded (marks, hollow for a smaller amplitude) and of the best mechanism's fit (lines)."""
    seen, best = result.seen, result.fits[0]
    kept = seen.recordings.repeats
    plan = seen.plan.only(kept)
    pairs = ("MB", "TB") if plan.tuberosity else ("MB",)
    figure = Figure(figsize=(min(PAGE, 3.35 * len(pairs) + 0.4), 2.8), layout="constrained")
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
        ax.set_title(f"{pair}: recorded (marks), {best.rival} (lines)", loc="left")
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylim(0, 1.1 * max(1.0, read.max(), fitted.max()))
        _unity(ax)
    panels[0].set_ylabel("transmissibility")
    handles, labels = panels[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(labels)))
    return figure
