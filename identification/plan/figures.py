"""The printed figure of a plan: information by frequency and load, and the session beside the thesis'."""

from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from fasbody.presentation import COLOURS, MARKS, counted, panels, printed
from identification.branches import EXCHANGED
from identification.plan.candidates import PLANNED, THESIS, UNLOADED, Step
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
def session(result: "Planned") -> Figure:
    """a, b: information of one recording at the largest amplitude; open marks are the planned steps. c: recordings.

    The area of marks in a to c is the time. d: expected 95 % intervals, median and range of 80 % of the simulated feet.
    """
    figure, axes = panels(2, 2, 7.4, 5.4)
    _curves(result, axes[0, 0], after=False)
    _curves(result, axes[0, 1], after=True)
    for axis in axes[0]:
        axis.set_xlabel("frequency [Hz]")
        axis.set_ylabel("information [nat]")
    axes[0, 0].scatter([], [], 60, facecolor="none", edgecolor="#2b2b2b", label="planned")
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
        mine = _together([s for s in result.steps if s.added_mass_kg == load and s.kind == SINE])
        x = np.array([frequency for frequency, _ in mine])
        axis.scatter(
            x, np.interp(x, f, values), [3.0 * time for time in mine.values()], facecolor="none",
            edgecolor=colour, lw=1.2, marker=mark, zorder=3, clip_on=False,
        )  # fmt: skip
    axis.set_ylim(0, _ROOM * axis.get_ylim()[1])


def _together(steps: Sequence[Step]) -> dict[tuple[float, float], float]:
    times: dict[tuple[float, float], float] = defaultdict(float)
    for step in steps:
        times[step.frequency_hz, step.added_mass_kg] += step.seconds
    return times


def _times(result: "Planned", axis: Axes) -> None:
    loads = sorted({s.added_mass_kg for e in result.expected.values() for s in e.steps})
    for name, lower in ((THESIS, 0.16), (PLANNED, -0.16)):
        label, colour = _LOOKS[name]
        steps = result.expected[name].steps
        seconds = sum(s.seconds for s in steps)
        together = _together(steps)
        x, y = [f for f, _ in together], [loads.index(load) + lower for _, load in together]
        text = f"{label}: {counted(len(steps), 'recording')}, {minutes(seconds)}"
        axis.scatter(x, y, [3.0 * time for time in together.values()], color=colour, label=text, alpha=0.9)
    axis.set_yticks(range(len(loads)), [f"{load:g} kg" for load in loads])
    axis.set_ylim(-0.5, len(loads) + 0.35)
    axis.set_xlabel("frequency [Hz]")
    axis.legend(loc="upper left", markerscale=0.7)


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
