"""The five-body arch on the shaker: `python examples/shake_the_arch.py [FIGURE.png]`.

MuJoCo runs the shipped model from rest at three frequencies. Well below its resonance the malleolus follows the table,
near it the malleolus moves more, above it less and ever later.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fasbody.arch.motion import move
from fasbody.foot.model import load
from fasbody.foot.shaker import sine
from fasbody.presentation import COLOURS, PAGE, printed, write_figure

FREQUENCIES_HZ = (8.0, 20.0, 50.0)


@printed
def main(picture: Path = Path("shake_the_arch.png")) -> dict[float, float]:
    """Draw the last two periods; return the ratio of the peaks, malleolus over table, at each frequency."""
    foot, ratios = load("foot_arch"), {}
    figure = Figure(figsize=(PAGE, 5), layout="constrained")
    for ax, f in zip(figure.subplots(len(FREQUENCIES_HZ), sharey=True), FREQUENCIES_HZ, strict=True):
        table = sine(f, 12 / f)
        run = move(foot, table)
        last = run.time > 10 / f
        t, base, malleolus = run.time[last], table.acceleration(run.time[last]), run.malleolus[last]
        ratios[f] = float(np.abs(malleolus).max() / np.abs(base).max())
        ax.plot(1e3 * (t - t[0]), base, color="0.5", label="table")
        ax.plot(1e3 * (t - t[0]), malleolus, color=COLOURS[1], label="malleolus")
        ax.set_title(f"{f:g} Hz: malleolus / table {ratios[f]:.2f}", loc="left")
        ax.set_ylabel("m/s$^2$")
        ax.margins(x=0)
    ax.set_xlabel("time [ms]")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper right", ncols=2)
    write_figure(figure, picture)
    return ratios


if __name__ == "__main__":
    print(main(*map(Path, sys.argv[1:2])))
