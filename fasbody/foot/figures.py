"""The motion of a simulated foot."""

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from fasbody.presentation import printed

if TYPE_CHECKING:
    from fasbody.foot.simulate import Simulation

#: Simulations beyond these would hide each other.
_MOST = 6


@printed
def motion(result: "Simulation") -> Figure:
    """What each accelerometer reads over time in each simulation, in the first six if there are more."""
    names = list(result.outputs)
    figure = Figure(figsize=(6.4, 1.2 + 1.4 * (1 + len(names))), layout="constrained")
    axes = list(figure.subplots(1 + len(names), sharex=True))
    for i in range(min(_MOST, len(result.time))):
        for axis, values in zip(axes, (result.base, *result.outputs.values()), strict=True):
            axis.plot(result.time[i], values[i], lw=0.9, label=f"simulation {i + 1}")
    for axis, name in zip(axes, ("base", *names), strict=True):
        axis.set_ylabel(f"{name} [m/s²]")
    axes[-1].set_xlabel("time [s]")
    if len(result.time) > 1:
        axes[0].legend()
    return figure
