"""Figures of the leg. Every function returns a matplotlib Figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fasbody.leg.statements import ADDED_KG, RANGES_HZ
from fasbody.presentation import COLOURS, LINES, MARKS, PAGE, named_lines, printed

if TYPE_CHECKING:
    from fasbody.leg.peaks import Peaks

_LOADS = [f"{added:g} kg" for added in ADDED_KG]


def unity(ax: Axes) -> None:
    """A line at a transmissibility of 1."""
    ax.axhline(1, color="0.6", lw=0.8, zorder=0)


def judged(ax: Axes, f: np.ndarray, MB: np.ndarray, peak_hz: Sequence[float]) -> None:
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
        unity(ax)
        if pair == "MB":
            judged(ax, f, np.array(curves), [result.highest("MB", load)[0] for load in range(len(curves))])
            named_lines(ax, f, curves, _LOADS, COLOURS[:3])
    names = ("malleolus / base (MB)", "tuberosity / base (TB)", "tuberosity / malleolus (TM)")
    for letter, ax, name in zip("abc", panels, names, strict=True):
        ax.set_title(f"{letter}  {name}", loc="left")
    panels[0].set_ylabel("transmissibility")
    return figure
