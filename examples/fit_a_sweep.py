"""One sweep instead of nine sines: `python examples/fit_a_sweep.py [FIGURE.png]`.

A synthetic foot is shaken from 5 to 60 Hz in four seconds. Nothing settles, so the fit compares sample by sample in the
time domain, and estimates the initial states too.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from linear_foot import BODY_MASS, FOOT
from matplotlib.figure import Figure

from fasbody.foot.model import load
from fasbody.foot.shaker import sweep
from fasbody.laboratory.foot import record
from fasbody.laboratory.instrument import Instrument
from fasbody.presentation import COLOURS, PAGE, printed, write_figure
from fasbody.recording.recording import Condition
from identification.fitting import fit_foot
from identification.result import FitResult

TRUTH = replace(FOOT, c_11=380.0, c_21=760.0)
SECONDS = 4.0


@printed
def main(picture: Path = Path("fit_a_sweep.png")) -> FitResult:
    """Record, fit, draw the malleolus and what the model leaves of it; return the result."""
    motion = sweep(5.0, 60.0, SECONDS)
    made = record(TRUTH, motion, SECONDS, Instrument(delay_s=0.0), np.random.default_rng(1), settle=0.0)
    made = replace(made, file="sweep", condition=Condition("1", "midstance", 0.0, BODY_MASS, None))
    result = fit_foot([made], load("two_dof"), domain="time", starts=1, delay=False)
    run = result.recordings[0]
    figure = Figure(figsize=(PAGE, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    above.plot(run.time_s, run.measured, color="0.4", lw=0.7)
    above.set_title(f"5 to 60 Hz in {SECONDS:g} s: fit {run.fit_percent:.1f} %", loc="left")
    above.set_ylabel("malleolus [m/s$^2$]")
    below.plot(run.time_s, run.measured - run.model, color=COLOURS[1], lw=0.5)
    below.set_ylabel("residual [m/s$^2$]")
    below.set_xlabel("time [s]")
    below.margins(x=0)
    write_figure(figure, picture)
    return result


if __name__ == "__main__":
    print(main(*map(Path, sys.argv[1:2])))
