"""The motion of a simulated foot."""

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from fasbody.foot.simulate import Simulation

#: Simulations beyond these would hide each other.
_MOST = 6


def motion(result: "Simulation") -> Figure:
    """Base and malleolus acceleration over time of each simulation, of the first six if there are more."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    for i in range(min(_MOST, len(result.time))):
        for axis, values in ((upper, result.base[i]), (lower, result.malleolus[i])):
            axis.plot(result.time[i], values, lw=0.9, label=f"simulation {i + 1}")
    upper.set_ylabel("base [m/s²]")
    lower.set_ylabel("malleolus [m/s²]")
    lower.set_xlabel("time [s]")
    for axis in (upper, lower):
        axis.grid(color="0.9")
        axis.spines[["top", "right"]].set_visible(False)
    if len(result.time) > 1:
        upper.legend(fontsize=8, frameon=False)
    return figure
