"""Why a fit percentage chooses no order: `python examples/black_box_order.py [FIGURE.png]`.

Models of thirteen structures and orders, all identified from one 20 Hz sine (single_sine.py). Their fits to held-out
data cannot be told apart; their responses between 10 and 50 Hz are wrong by tens to thousands of percent.
"""

import sys
from pathlib import Path

import numpy as np
import single_sine
from matplotlib.figure import Figure

from fasbody.presentation import COLOURS, PAGE, printed, write_figure


@printed
def main(picture: Path = Path("black_box_order.png")) -> tuple[np.ndarray, np.ndarray]:
    """Draw fit and error of each model; return the fits and the errors in percent."""
    rows = single_sine.single()
    labels = [label for label, *_ in rows]
    fits, errors = np.array([fit for _, fit, *_ in rows]), np.array([error for *_, error, _ in rows])
    figure = Figure(figsize=(PAGE, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot(fits, labels, "o", ms=4, color=COLOURS[0])
    left.set_xlim(0, 105)
    left.set_xlabel("fit to held-out data [%]")
    left.set_title(f"all fit: {fits.min():.1f} to {fits.max():.1f} %", loc="left")
    right.plot(errors, labels, "s", ms=4, color=COLOURS[1])
    right.set_xscale("log")
    right.set_xlabel("largest error of the response, 10-50 Hz [%]")
    right.set_title(f"responses are wrong: {errors.min():.0f} to {errors.max():.0f} %", loc="left")
    left.invert_yaxis()
    write_figure(figure, picture)
    return fits, errors


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
