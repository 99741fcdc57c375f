"""The stepped five-body arch: error against the reduced ODE of the equations, cost, threads, and random arches.

The oracle is Radau at a tolerance of 1e-9 on Eq. (4.11), which shares no step and no closure with the MuJoCo tree.
"""

import os
import time
from typing import Annotated

import numpy as np
import typer

from benchmarks.callbacks import thread_gain
from benchmarks.table import JsonOption, judged_if_idle, report
from fasbody.arch import ode as arch_ode
from fasbody.arch.bones import Arch
from fasbody.arch.motion import move
from fasbody.console import command_line, progress_bar
from fasbody.exceptions import SimulationError
from fasbody.foot.model import load
from fasbody.foot.shaker import BaseMotion, sine
from reproduction.check import Check, at_least, at_most
from simulator.arch import with_constants

FREQUENCIES_HZ = (10.0, 20.0, 30.0, 40.0, 50.0)
_SECONDS = 0.2


def errors(frequency: float, seconds: float = _SECONDS) -> tuple[float, float]:
    """Largest error of the malleolus acceleration over its peak, plain and accurate, from rest."""
    foot, motion = load("foot_arch"), sine(frequency, seconds)
    instants = foot.step * np.arange(round(seconds / foot.step))
    omega = 2 * np.pi * frequency
    exact = arch_ode.solve(Arch.nominal(), lambda t: 8.95 * np.sin(omega * t), instants, tolerance=1e-9).malleolus
    runs = [move(foot, motion, accurate=accurate) for accurate in (False, True)]
    plain, accurate = (float(np.abs(run.malleolus - exact).max() / np.abs(exact).max()) for run in runs)
    return plain, accurate


def cost(accurate: bool, seconds: float = 10.0) -> float:
    """CPU time [s] of so many seconds of motion."""
    foot, motion = load("foot_arch"), sine(30.0, seconds)
    began = time.process_time()
    move(foot, motion, accurate=accurate)
    return time.process_time() - began


def finite_draws(draws: int = 60, motion: BaseMotion | None = None) -> tuple[int, int]:
    """How many random arches of Table 4.2 end finite, and how many of those needed help (which the result says)."""
    rng, motion = np.random.default_rng(0), motion or sine(50.0, 0.1)
    finite = helped = 0
    for _ in range(draws):
        try:
            run = move(with_constants(load("foot_arch"), Arch.draw(rng)), motion)
        except SimulationError:
            continue
        finite += bool(np.isfinite(run.malleolus).all())
        helped += bool(run.note)
    return finite, helped


def measure(draws: int = 60) -> list[Check]:
    """Rows of the arch."""
    load_average = os.getloadavg()[0]
    rows: list[Check] = []
    with progress_bar() as progress:
        task = progress.add_task("arch", total=len(FREQUENCIES_HZ) + 3)
        by_frequency = []
        for frequency in FREQUENCIES_HZ:
            by_frequency.append(errors(frequency))
            progress.advance(task)
        plain, accurate = np.max(by_frequency, axis=0)
        span = f"{FREQUENCIES_HZ[0]:g}-{FREQUENCIES_HZ[-1]:g} Hz"
        rows.append(at_most(f"arch, malleolus error over the peak, default step, {span}", float(plain), 1e-3))
        rows.append(at_most(f"arch, the same in the accurate mode, {span}", float(accurate), 2e-4))
        for mode, limit in ((False, 0.6), (True, 1.8)):
            name = "accurate" if mode else "default"
            rows.append(at_most(f"arch, CPU time of 10 s of motion, {name}", cost(mode), limit, "s"))
        progress.advance(task)
        one, two = thread_gain(10, model="foot_arch")
        gain = at_least(f"arch, steps a second on two threads over {1 / one:.3g} on one", one / two, 1.7, "times")
        rows.append(judged_if_idle(gain, load_average))
        progress.advance(task)
        finite, helped = finite_draws(draws)
        what = f"arch, random arches of Table 4.2 that end finite ({helped} with help that is said)"
        rows.append(at_least(what, finite, draws))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    draws: Annotated[int, typer.Option(help="random arches")] = 60,
    json_: JsonOption = False,
) -> None:
    """Error, cost and stability of the stepped arch.

    Examples:
      python -m benchmarks.arch --draws 60
    """
    report("arch", measure(draws), json_)


if __name__ == "__main__":
    command_line(app)
