"""One measured heel strike, from volts to force over compression: `python examples/heel_strike.py [FIGURE.png]`.

Subject 05 of the bundled walkers at normal speed (doi 10.1371/journal.pone.0197428), each correction in its panel. The
compression is the travel of a heel point fixed to the shank, so everything between skin and shank is in it.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fasbody.heel.strike import Steps, Strike
from fasbody.heel.study import Person
from fasbody.presentation import COLOURS, PAGE, printed, write_figure


def main(picture: Path = Path("heel_strike.png")) -> Strike:
    """Draw the corrections of one strike and return it."""
    person = Person.bundled("05")
    speed, number = person.names()[1]
    strike = person.strike(person.trial(speed, number))
    write_figure(corrections(person.steps(speed, number), strike), picture)
    return strike


@printed
def corrections(steps: Steps, strike: Strike) -> Figure:
    """The steps of one strike: force, point of application, heel point, force over compression."""
    figure = Figure(figsize=(PAGE, 5.0), layout="constrained")
    (force, place), (path, loop) = figure.subplots(2, 2)
    _force(force, steps)
    _place(place, steps)
    _path(path, steps)
    _loop(loop, strike)
    for ax in figure.axes:
        ax.set_title(ax.get_title(), loc="left")
        ax.set_title("")
    return figure


def _force(ax: Any, steps: Steps) -> None:
    """Force before and after the plate's offset is taken off."""
    t = 1e3 * (steps.time_s - steps.time_s[steps.contact])
    part = (t > -15) & (t < 70)
    ax.plot(t[part], steps.raw_n[part], color="0.7", label="volts × gain")
    ax.plot(t[part], steps.force_n[part], color=COLOURS[0], label="less the empty plate")
    _mark(ax, t, steps.force_n, {"contact": (steps.contact, (-36, 7)), "first peak": (steps.peak, (5, 5))})
    ax.set(title="a  offset, gain, contact, peak", xlabel="time from contact [ms]", ylabel="vertical force [N]")
    ax.legend(loc="lower right")


def _mark(ax: Any, x: np.ndarray, y: np.ndarray, places: Mapping[str, tuple[int, tuple[int, int]]]) -> None:
    """Name samples of a curve, each with a shift of its name [points]."""
    for name, (i, shift) in places.items():
        ax.plot(x[i], y[i], "o", color=COLOURS[1], ms=4)
        ax.annotate(name, (x[i], y[i]), shift, textcoords="offset points")


def _place(ax: Any, steps: Steps) -> None:
    """Points of application in the shank's frame, and their mean."""
    points = 1e3 * (steps.application_m - steps.heel_point_m)
    ax.plot(points[:, 1], points[:, 2], ".", color="0.6", ms=4, label="point of application")
    ax.plot(0, 0, "o", color=COLOURS[1], ms=5, label="heel point: their mean")
    reach = 1.15 * max(3.0, float(np.abs(points[:, 1:]).max()))
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.set(title="b  heel point, in the shank's frame")
    ax.set(xlabel="forward [mm]", ylabel="along the shank [mm]")
    ax.legend(loc="upper right", fontsize=7)


def _path(ax: Any, steps: Steps) -> None:
    """Height of the heel point before and after the filter."""
    t = 1e3 * (steps.frame_time_s - steps.time_s[steps.contact])
    part = (t > -15) & (t < 70)
    raw, path = (1e3 * (y - steps.path_m[steps.frames[0]]) for y in (steps.raw_path_m, steps.path_m))
    ax.plot(t[part], raw[part], ".", color="0.6", ms=3, label="markers")
    ax.plot(t[part], path[part], color=COLOURS[0], label="filtered")
    ax.axhline(0.0, color="0.8", lw=0.6, zorder=0)
    names = {"contact": (5, 4), "first peak": (5, 4), "standstill": (-20, -13)}
    _mark(ax, t, path, dict(zip(names, zip(steps.frames, names.values(), strict=True), strict=True)))
    ax.margins(y=0.15)
    ax.set(title="c  filter, standstill", xlabel="time from contact [ms]", ylabel="height of the heel point [mm]")
    ax.legend(loc="upper right")


def _loop(ax: Any, strike: Strike) -> None:
    """Force over compression, the work to the peak shaded."""
    x, F = 1e3 * strike.compression_m, strike.force_n
    ends = [strike.peak, strike.standstill]
    ax.fill_between(x[strike.loading], F[strike.loading], color=COLOURS[5], alpha=0.35, lw=0)
    ax.plot(x[strike.whole], F[strike.whole], color=COLOURS[0])
    ax.plot(x[ends], F[ends], "o", color=COLOURS[1], ms=4)
    work = strike.published.work_to_peak_j
    ax.text(0.97, 0.06, f"work to peak {work:.2f} J", transform=ax.transAxes, ha="right")
    ax.set(title="d  force over compression", xlim=(0, None), ylim=(0, None))
    ax.set(xlabel="compression, skin to shank [mm]", ylabel="vertical force [N]")


if __name__ == "__main__":
    found = main(*map(Path, sys.argv[1:2])).published
    print(f"{1e3 * found.compression_at_peak_m:.1f} mm and {found.work_to_peak_j:.2f} J to the first force peak")
