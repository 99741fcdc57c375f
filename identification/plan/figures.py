"""The printed figures of a plan: information by frequency and load, and the session beside the thesis'."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from fasbody.presentation import COLOURS, MARKS, counted, panels, printed
from identification.branches import EXCHANGED
from identification.plan.candidates import PLANNED, THESIS, UNLOADED
from identification.plan.shaker import SINE
from identification.plan.words import minutes

if TYPE_CHECKING:
    from identification.plan.result import Planned

_LOOKS = {
    PLANNED: ("planned", COLOURS[0]),
    THESIS: ("thesis, three loads", "#8c8c8c"),
    UNLOADED: ("thesis, unloaded", "#ffffff"),
}
#: Room above the highest mark.
_ROOM = 1.06
_LABELS = {"k_T": "$k_T$", "k_F": "$k_F$", "c_11": "$c_{11}$", "c_21": "$c_{21}$"}


@printed
def information(result: "Planned") -> Figure:
    """What one recording adds by frequency and load: as the first one, and as one more after the plan.

    Curves are of sines at the largest amplitude; marks are the planned steps, larger where they last longer.
    """
    figure, axes = panels(1, 2, 7.4, 3.0, sharex=True)
    _curves(result, axes[0, 0], after=False)
    _curves(result, axes[0, 1], after=True)
    axes[0, 0].set_title("the first recording")
    axes[0, 1].set_title("one more recording after the plan")
    axes[0, 0].set_ylabel("information [nat]")
    for axis in axes[0]:
        axis.set_xlabel("frequency [Hz]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


@printed
def session(result: "Planned") -> Figure:
    """Information by frequency and load, the recordings of both protocols, and the intervals that they leave."""
    figure, axes = panels(2, 2, 7.4, 5.4)
    _curves(result, axes[0, 0], after=False)
    _curves(result, axes[0, 1], after=True)
    for axis in axes[0]:
        axis.set_xlabel("frequency [Hz]")
        axis.set_ylabel("information [nat]")
    axes[0, 0].legend()
    _times(result, axes[1, 0])
    _widths(result, axes[1, 1])
    titles = ("the first recording", "one more recording after the plan", "recordings", "expected intervals")
    for letter, title, axis in zip("abcd", titles, axes.flat, strict=True):
        axis.set_title(letter, loc="left", fontweight="bold")
        axis.set_title(title)
    return figure


def _curves(result: "Planned", axis: Axes, after: bool) -> None:
    loads = sorted({p.step.added_mass_kg for p in result.places})
    for number, load in enumerate(loads):
        colour, mark = COLOURS[number % len(COLOURS)], MARKS[number % len(MARKS)]
        best: dict[float, float] = {}
        for p in result.places:
            if p.step.added_mass_kg == load and p.step.kind == SINE:
                value = (p.more if after else p.first).information
                best[p.step.frequency_hz] = max(value, best.get(p.step.frequency_hz, -np.inf))
        f = np.array(sorted(best))
        values = np.array([best[x] for x in f])
        axis.plot(f, values, color=colour, lw=1.2, marker=mark, ms=2.5, label=f"{load:g} kg")
        mine = [s for s in result.steps if s.added_mass_kg == load and s.kind == SINE]
        x = np.array([s.frequency_hz for s in mine])
        size = np.array([3.0 * s.seconds for s in mine])
        axis.scatter(
            x, np.interp(x, f, values), size, facecolor="none", edgecolor=colour, lw=1.2, marker=mark, zorder=3,
            clip_on=False,
        )  # fmt: skip
    axis.set_ylim(0, _ROOM * axis.get_ylim()[1])


def _times(result: "Planned", axis: Axes) -> None:
    """Where and how long both protocols shake."""
    loads = sorted({s.added_mass_kg for e in result.expected.values() for s in e.steps})
    for name, lower in ((THESIS, 0.16), (PLANNED, -0.16)):
        label, colour = _LOOKS[name]
        steps = result.expected[name].steps
        x = [s.frequency_hz for s in steps]
        y = [loads.index(s.added_mass_kg) + lower for s in steps]
        seconds = sum(s.seconds for s in steps)
        text = f"{label}: {counted(len(steps), 'recording')}, {minutes(seconds)}"
        axis.scatter(x, y, [3.0 * s.seconds for s in steps], color=colour, label=text, alpha=0.9)
    axis.set_yticks(range(len(loads)), [f"{load:g} kg" for load in loads])
    axis.set_ylim(-0.5, len(loads) + 0.35)
    axis.set_xlabel("frequency [Hz]")
    handles = axis.get_legend_handles_labels()
    axis.legend(*handles, loc="upper left", markerscale=0.7)


def _widths(result: "Planned", axis: Axes) -> None:
    """Half-widths of the 95 % intervals: median of the feet, and where eight in ten of them lie."""
    names = [name for name in (PLANNED, THESIS, UNLOADED) if name in result.expected]
    for number, name in enumerate(names):
        label, colour = _LOOKS[name]
        e = result.expected[name]
        x = np.arange(len(EXCHANGED)) + 0.27 * (number - 0.5 * (len(names) - 1))
        height = np.array([100 * e.outlook.half_width[c] for c in EXCHANGED])
        low, high = 100 * np.quantile(e.outlook.half, (0.1, 0.9), axis=0)
        axis.errorbar(
            x, height, [height - low, high - height], fmt=MARKS[number], ms=5, color="#2b2b2b", mfc=colour, lw=0.8,
            capsize=1.5, label=label,
        )  # fmt: skip
    axis.set_yscale("log")
    axis.set_ylim(top=4 * axis.get_ylim()[1])
    axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=99))
    axis.yaxis.set_minor_locator(NullLocator())
    axis.yaxis.set_major_formatter(lambda y, _: f"{y:g}")
    axis.set_xticks(range(len(EXCHANGED)), [_LABELS[c] for c in EXCHANGED])
    axis.set_ylabel("half of the 95 % interval [%]")
    axis.legend(ncols=2, loc="upper left")
