"""What the measured heels mean for the foot on the shaker: its nominal pad, its bounds, and its resonance."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fasbody.foot.model import load
from fasbody.foot.two_dof import TwoDof
from identification.heel.population import Population

#: Pad of the bundled synthetic subject [N/m].
BUNDLED_K_F = 9.4e4


def beside() -> dict[str, float]:
    """The nominal stiffness of the fat pad in `two_dof.xml`, its bounds, and that of the bundled subject [N/m]."""
    foot = load("two_dof")
    item = foot.parameters["k_F"]
    return {
        "nominal_n_per_m": foot.values()["k_F"], "bound_lower_n_per_m": item.lower, "bound_upper_n_per_m": item.upper,
        "bundled_n_per_m": BUNDLED_K_F,
    }  # fmt: skip


def resonances(slopes: Sequence[Population], speed: str = "normal") -> list[dict[str, Any]]:
    """Peak of the linear two-mass foot's transmissibility with the nominal and with the measured pad, load by load.

    Everything else stays nominal. The slope is of a pad pressed at half a metre a second; vibration is slower.
    """
    values = load("two_dof").values()
    f = np.linspace(2.0, 80.0, 3901)
    out = []
    for population in slopes:
        (name,) = population.names
        k_F = population.interval(speed if speed in population.speeds else population.speeds[0], name)[0]
        row: dict[str, Any] = {"load": name, "k_F_n_per_m": k_F}
        for which, stiffness in (("nominal", values["k_F"]), ("measured", k_F)):
            T = np.abs(TwoDof.from_values({**values, "k_F": stiffness}).transmissibility(f))
            row |= {f"{which}_peak_hz": float(f[T.argmax()]), f"{which}_peak": float(T.max())}
        out.append(row)
    return out
