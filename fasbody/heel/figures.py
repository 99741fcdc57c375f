"""Figures of heel strikes: what each correction of the published procedure makes of one trial."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from fasbody.presentation import COLOURS, PAGE, printed

if TYPE_CHECKING:
    from fasbody.heel.strike import Steps, Strike


@printed
def corrections(steps: "Steps", strike: "Strike") -> Figure:
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


def _force(ax: Any, steps: "Steps") -> None:
    """Force before and after the plate's offset is taken off."""
    t = 1e3 * (steps.time_s - steps.time_s[steps.contact])
    part = (t > -15) & (t < 70)
    ax.plot(t[part], steps.raw_n[part], color="0.7", label="volts × gain")
    ax.plot(t[part], steps.force_n[part], color=COLOURS[0], label="less the empty plate")
    for sample, name, shift in ((steps.contact, "contact", (-36, 7)), (steps.peak, "first peak", (5, 5))):
        ax.plot(t[sample], steps.force_n[sample], "o", color=COLOURS[1], ms=4)
        ax.annotate(name, (t[sample], steps.force_n[sample]), shift, textcoords="offset points")
    ax.set(title="a  offset, gain, contact, peak", xlabel="time from contact [ms]", ylabel="vertical force [N]")
    ax.legend(loc="lower right")


def _place(ax: Any, steps: "Steps") -> None:
    """Points of application in the shank's frame, and their mean."""
    points = 1e3 * (steps.application_m - steps.heel_point_m)
    ax.plot(points[:, 1], points[:, 2], ".", color="0.6", ms=4, label="point of application")
    ax.plot(0, 0, "o", color=COLOURS[1], ms=5, label="heel point: their mean")
    reach = 1.15 * max(3.0, float(np.abs(points[:, 1:]).max()))
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title="b  heel point, in the shank's frame",
           xlabel="forward [mm]", ylabel="along the shank [mm]")  # fmt: skip
    ax.legend(loc="upper right", fontsize=7)


def _path(ax: Any, steps: "Steps") -> None:
    """Height of the heel point before and after the filter."""
    t = 1e3 * (steps.frame_time_s - steps.time_s[steps.contact])
    part = (t > -15) & (t < 70)
    at_contact = steps.path_m[steps.frames[0]]
    ax.plot(t[part], 1e3 * (steps.raw_path_m[part] - at_contact), ".", color="0.6", ms=3, label="markers")
    ax.plot(t[part], 1e3 * (steps.path_m[part] - at_contact), color=COLOURS[0], label="filtered")
    ax.axhline(0.0, color="0.8", lw=0.6, zorder=0)
    places = (("contact", (5, 4)), ("first peak", (5, 4)), ("standstill", (-20, -13)))
    for frame, (name, shift) in zip(steps.frames, places, strict=True):
        ax.plot(t[frame], 1e3 * (steps.path_m[frame] - at_contact), "o", color=COLOURS[1], ms=4)
        ax.annotate(name, (t[frame], 1e3 * (steps.path_m[frame] - at_contact)), shift, textcoords="offset points")
    ax.margins(y=0.15)
    ax.set(title="c  filter, standstill", xlabel="time from contact [ms]", ylabel="height of the heel point [mm]")
    ax.legend(loc="upper right")


def _loop(ax: Any, strike: "Strike") -> None:
    """Force over compression, the work to the peak shaded."""
    x, F = 1e3 * strike.compression_m, strike.force_n
    ax.fill_between(x[strike.loading], F[strike.loading], color=COLOURS[5], alpha=0.35, lw=0)
    ax.plot(x[strike.whole], F[strike.whole], color=COLOURS[0])
    ax.plot(x[[strike.peak, strike.standstill]], F[[strike.peak, strike.standstill]], "o", color=COLOURS[1], ms=4)
    work = strike.published.work_to_peak_j
    ax.text(0.97, 0.06, f"work to peak {work:.2f} J", transform=ax.transAxes, ha="right")
    ax.set(title="d  force over compression", xlabel="compression, skin to shank [mm]", ylabel="vertical force [N]",
           xlim=(0, None), ylim=(0, None))  # fmt: skip
