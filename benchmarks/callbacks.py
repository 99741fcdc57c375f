"""What one step costs without callback, with the native one and with the Python one; and what a second thread gains.

"Without" is the same model with no callback installed: MuJoCo does everything but our forces. All three run the same
C loop (`mj_step` with a step count) in turn, and CPU time is compared, so that a busy machine disturbs little.
"""

import contextlib
import os
import time
from collections.abc import Callable
from typing import Annotated

import mujoco
import numpy as np
import typer

from benchmarks.table import JsonOption, faster, interleaved, judged_if_idle, report
from fasbody.console import command_line, progress_bar
from fasbody.foot.engine import Callbacks, callbacks, native, python_twin
from fasbody.foot.model import load
from fasbody.foot.shaker import sine
from fasbody.foot.simulate import Batch
from reproduction.check import Check, at_least, at_most

_STEPS = 2000
_BATCH, _BATCH_STEPS = 8, 4000


def stepper(chosen: Callbacks | None, steps: int) -> Callable[[], None]:
    """A function that runs `steps` steps of the two-mass foot with these callbacks, None for none."""
    model = load("two_dof").model
    data = mujoco.MjData(model)

    def work() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[1:], data.qvel[1:] = 1e-4, 0.01  # moving, with or without forces
        data.ctrl[:5] = 0.0, 1.0, 10.0, 0.0, 0.0
        with contextlib.nullcontext() if chosen is None else callbacks(chosen):
            mujoco.mj_step(model, data, steps)

    return work


def step_costs(repeats: int, steps: int = _STEPS) -> np.ndarray:
    """Times (repeats, 3) of one step [s]: without callback, native, Python."""
    works = [stepper(None, steps), stepper(native(), steps), stepper(python_twin(), steps)]
    return interleaved(works, repeats) / steps


def thread_gain(
    repeats: int, nsim: int = _BATCH, steps: int = _BATCH_STEPS, model: str = "two_dof"
) -> tuple[float, float]:
    """Shortest times [s] of one step of a batched rollout on one and on two threads (wall time)."""
    foot = load(model)
    controls = sine(30.0, 1.0).controls(foot.step, steps)[None]
    runs = [Batch(foot, nsim, threads) for threads in (1, 2)]
    works = [lambda run=run: run.run(controls, foot.step) for run in runs]
    one, two = interleaved(works, repeats, time.perf_counter).min(axis=0) / (nsim * steps)
    return float(one), float(two)


def measure(repeats: int = 60) -> list[Check]:
    """Step costs and the gain of a second thread."""
    load = os.getloadavg()[0]
    with progress_bar() as progress:
        progress.add_task("callbacks", total=None)
        times = step_costs(repeats)
        one, two = thread_gain(max(2, repeats // 3))
    none, with_native, with_python = np.median(times, axis=0)
    cost = 100 * float(np.median(times[:, 1] / times[:, 0]) - 1)
    rows = [
        at_most(f"native callbacks, cost of a step over none ({1e6 * none:.2f} us)", cost, 15.0, "%"),
        faster("one RK4 step with native callbacks", with_native, with_python, "Python callbacks", 3.0),
    ]
    gain = at_least(f"two threads over one, {_BATCH} rollouts, wall time", one / two, 1.7, "times")
    return [*rows, judged_if_idle(gain, load)]


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    repeats: Annotated[int, typer.Option(help="how often each is timed")] = 60,
    json_: JsonOption = False,
) -> None:
    """Cost of the callbacks and gain of a second thread.

    Examples:
      python -m benchmarks.callbacks --repeats 100
    """
    report("callbacks", measure(repeats), json_)


if __name__ == "__main__":
    command_line(app)
