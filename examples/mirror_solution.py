"""Two feet that one sensor cannot tell apart: `python examples/mirror_solution.py [FIGURE.png]`.

A foot with a stiff ankle and its mirror image with a stiff pad, k_T' = a k_F and k_F' = k_T / a with
a = m_S / (m_S + m_F). At the malleolus their linear responses are the same to rounding. On the foot bones they are not,
and with another mass on the knee they are not either.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from linear_foot import FOOT
from matplotlib.figure import Figure

from fasbody.foot.two_dof import TwoDof
from fasbody.presentation import PAGE, printed, write_figure

F = np.linspace(2, 60, 400)  # Hz
LOAD = 4.5  # kg


def foot_bones(foot: TwoDof) -> np.ndarray:
    """Acceleration of the foot bones over that of the base, by the balance of forces on the shank."""
    shank, w = foot.transmissibility(F), 2j * np.pi * F
    z_1 = -foot.m_S * shank / (foot.k_T + foot.c_11 * w)  # Eq. 4.31, solved for the stretch of the ankle
    return shank - w**2 * z_1


@printed
def main(picture: Path = Path("mirror_solution.png")) -> dict[str, float]:
    """Draw the three responses of both feet; return the largest difference of each."""
    feet = {"stiff ankle": FOOT, "stiff pad (mirror)": FOOT.mirror()}
    loaded = {name: replace(foot, m_S=foot.m_S + LOAD) for name, foot in feet.items()}
    panels = {
        "malleolus": [foot.transmissibility(F) for foot in feet.values()],
        "foot bones": [foot_bones(foot) for foot in feet.values()],
        f"malleolus, {LOAD:g} kg on the knee": [foot.transmissibility(F) for foot in loaded.values()],
    }
    figure = Figure(figsize=(PAGE, 2.8), layout="constrained")
    for ax, (title, responses) in zip(figure.subplots(1, 3, sharey=True), panels.items(), strict=True):
        for name, style, response in zip(feet, ("-", "--"), responses, strict=True):
            ax.plot(F, np.abs(response), style, lw=1.8, label=f"{name}, $k_T$ {feet[name].k_T / 1e3:.0f} kN/m")
        ax.set_title(title, loc="left")
        ax.set_xlabel("frequency [Hz]")
    figure.axes[2].set_xlim(8, 22)
    figure.axes[0].set_ylabel("transmissibility")
    figure.axes[0].legend()
    write_figure(figure, picture)
    return {title: float(np.abs(one - other).max()) for title, (one, other) in panels.items()}


if __name__ == "__main__":
    print(main(*map(Path, sys.argv[1:2])))
