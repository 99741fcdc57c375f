"""Force against stretch of ankle and fat pad: `python examples/hysteresis.py [FIGURE.png]`.

Eq. 4.42 along the settled motion at three frequencies. The area of a loop is the energy that its damper takes in one
period; the nonlinear dampers of Eq. 4.32 bend the loops.
"""

import sys
from pathlib import Path

import numpy as np
from linear_foot import BODY_MASS
from matplotlib.figure import Figure

from fasbody.foot.model import load
from fasbody.foot.shaker import sine
from fasbody.foot.simulate import simulate
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.foot import TRUTH
from fasbody.presentation import PAGE, printed, write_figure
from fasbody.recording.condition import foot_mass, shank_mass

FREQUENCIES_HZ = (10.0, 20.0, 40.0)


@printed
def main(picture: Path = Path("hysteresis.png")) -> dict[float, tuple[float, float]]:
    """Draw the loops; return the energy lost in ankle and pad in one period [J] at each frequency."""
    values = {**TRUTH, "m_S": shank_mass(BODY_MASS), "m_F": foot_mass(BODY_MASS)}
    equations, foot = TwoDof.from_values(values), load("two_dof").with_values(values)
    figure, lost = Figure(figsize=(PAGE, 3.8), layout="constrained"), {}
    panels = figure.subplots(1, 2)
    for f in FREQUENCIES_HZ:
        run = simulate(foot, sine(f, 20 / f))
        period = slice(round(19 / f / foot.step), round(20 / f / foot.step) + 1)
        pad, ankle = run.qpos[0, period, 1], run.qpos[0, period, 2]  # joints: base, fat pad, ankle
        pad_rate, ankle_rate = run.qvel[0, period, 1], run.qvel[0, period, 2]
        forces = equations.forces(np.array([ankle, pad, ankle_rate, pad_rate]))
        lost[f] = tuple(float(np.trapezoid(F, z)) for F, z in zip(forces, (ankle, pad), strict=True))
        for ax, stretch, force, energy in zip(panels, (ankle, pad), forces, lost[f], strict=True):
            ax.plot(1e3 * stretch, force, "-" if f < 40 else "--", label=f"{f:g} Hz, {1e3 * energy:.1f} mJ a period")
    for ax, name in zip(panels, ("ankle", "fat pad"), strict=True):
        ax.set_title(name, loc="left")
        ax.set_xlabel("stretch [mm]")
        ax.set_ylabel("force [N]")
        ax.legend(loc="upper left")
    write_figure(figure, picture)
    return lost


if __name__ == "__main__":
    print(main(*map(Path, sys.argv[1:2])))
