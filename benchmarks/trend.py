"""What a trend over frequency and load recovers, and what it cannot: coverage, branches by load, held-out errors.

The foot follows power laws of frequency and load exactly, so that every number has a truth. This command
prints what docs/study_methods.md quotes.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, console, progress_bar
from fasbody.foot.model import Foot, load
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.study import steady
from fasbody.laboratory.subject import Tuberosity
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording
from identification.branches import STIFF_ANKLE
from identification.estimate import Settings
from identification.study.curves import Order
from identification.study.trend import CURVES, TrendBranch, fit_trend, refit
from identification.study.validation import leave_one_frequency_out
from reproduction.check import Check, told, within

FREQUENCIES_HZ = (10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0)
LOADS_KG = (0.0, 2.3, 4.5)
STRONG = {"c_12": 60.0, "c_13": 120.0, "c_22": -80.0, "c_23": 160.0}
FLAT = {"c_12": 3.0, "c_13": 10.0, "c_22": -3.0, "c_23": 10.0}
_BODY_KG = 70.0
Law = Callable[[float, float], dict[str, float]]


def power_laws(f: float, added: float, bend: dict[str, float] = STRONG) -> dict[str, float]:
    """Constants at a frequency and a load: straight lines in log f and in the load."""
    x, t = np.log(f / 20), added / 4.5
    return {
        "k_T": 1.3e5 * np.exp(0.5 * x + 0.3 * t), "k_F": 9e4 * np.exp(0.3 * x + 0.2 * t),
        "c_11": 300 * np.exp(-0.3 * x + 0.4 * t), "c_21": 700 * np.exp(0.1 * x + 0.15 * t), **bend,
    }  # fmt: skip


def study(law: Law, loads: tuple[float, ...], seed: int, scatter: float = 0.0) -> list[Recording]:
    """Steady recordings of 3 s, noise 0.03 and 0.05 m/s^2, constants off their law by `scatter`."""
    made = []
    for added in loads:
        for f in FREQUENCIES_HZ:
            rng = np.random.default_rng((seed, round(f), round(10 * added)))
            condition = Condition("1", "midstance", added, _BODY_KG, f)
            values = law(f, added)
            for name in CURVES:
                values[name] *= float(np.exp(scatter * rng.normal()))
            foot = TwoDof(**values, m_S=condition.masses["m_S"], m_F=condition.masses["m_F"])
            sensors = Instrument(bits=16, delay_s=0.0)
            r, _ = steady(foot, Tuberosity.under(0.0), f, 3.0, sensors, rng)
            made.append(checked(replace(r, condition=condition, file=f"{f:g} Hz, {added:g} kg")))
    return made


def coverage(foot: Foot, start: TrendBranch, seeds: int, scatter: float) -> list[Check]:
    """Share of 95 % intervals of the curves that hold the truth, and what is learnt of the scatter."""
    space = replace(start.space, scatter=scatter > 0)
    begin = replace(start, space=space, scatter=dict.fromkeys(CURVES, 0.1))
    inside: list[bool] = []
    errors, tau = [], []
    with progress_bar() as bar:
        for seed in bar.track(range(seeds), description=f"coverage, scatter {100 * scatter:g} %"):
            found = refit(begin, study(power_laws, LOADS_KG, seed, scatter), foot, threads=1)
            branch = replace(begin, space=found.space, z=found.z, covariance=found.covariance)
            tau.append(found.tau)
            for f, m in ((10.0, 0.0), (20.0, 2.3), (35.0, 0.0), (50.0, 4.5)):
                for key, e in branch.at(f, m).items():
                    name = key.split("_n_")[0]
                    if name in CURVES:
                        inside.append(e.lower <= power_laws(f, m)[name] <= e.upper)
                        errors.append(e.std_error / e.value)
    about = f"scatter {100 * scatter:g} %, {seeds} seeds"
    rows = [
        within(f"95 % interval of a curve holds the truth, {about}", 100 * float(np.mean(inside)), 92.0, 98.0, "%"),
        told(f"median standard error of a curve, {about}", f"{100 * float(np.median(errors)):.2g} %"),
    ]
    if scatter:
        learnt = 100 * float(np.median(tau))
        rows.append(within(f"scatter learnt, median, {about}", learnt, 80 * scatter, 120 * scatter, "%"))
    return rows


#: Damping, loads, powers of the load in curves and truth, and whether the loads and the damping then tell the branches.
CASES = (
    (STRONG, LOADS_KG[:1], 0, True), (FLAT, LOADS_KG[:1], 0, False), (FLAT, LOADS_KG[::2], 0, True),
    (FLAT, LOADS_KG[::2], 1, False), (FLAT, LOADS_KG, 1, True), (FLAT, LOADS_KG, 2, False),
)  # fmt: skip


def branches(foot: Foot) -> list[Check]:
    """By how much the mirror branch is worse, for damping, loads and orders of the curves in the load."""
    rows: list[Check] = []
    for bend, loads, order, clear in CASES:

        def law(f: float, m: float, bend: dict[str, float] = bend, fixed: bool = order == 0) -> dict[str, float]:
            return power_laws(f, 0.0 if fixed else m, bend)

        result = fit_trend(
            study(law, loads, 0), foot, Settings(starts=2, threads=1), order=Order(2, order, 1), scatter=False,
            certify=False,
        )  # fmt: skip
        apart = result.branches[1].deviance - result.best.deviance if len(result.branches) > 1 else float("nan")
        damping = "nonlinear" if bend is STRONG else "nearly linear"
        what = f"other branch worse by (-2 log L), {damping} damping, {len(loads)} loads, load to the power of {order}"
        right = result.best.name == STIFF_ANKLE or result.verdict == "undecided"
        holds = right and result.verdict == ("decided" if clear else "undecided")
        ahead = "" if result.best.name == STIFF_ANKLE else ", wrong branch ahead"
        said, wanted = f"{apart:.3g}, {result.verdict}{ahead}", "decided, rightly" if clear else "undecided"
        rows.append(Check(what.replace("1 loads", "1 load"), float(holds), 1, 1, said=said, beside=wanted))
    return rows


def held_out(foot: Foot, start: TrendBranch) -> list[Check]:
    """Held-out errors of the three modes on one subject with two loads."""
    data = study(power_laws, LOADS_KG[::2], 1)
    settings = Settings(starts=1, threads=1)
    rows: list[Check] = []
    for mode in ("per-recording", "pooled", "trend"):
        branch = start if mode == "trend" else None
        found = leave_one_frequency_out(data, foot, mode, settings, branch=branch)
        text = f"{found.percent:.2g} %, chi-square a number {found.chi_square_per_number:.3g}"
        rows.append(told(f"error of a frequency left out, median, {mode}", text))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(min=2, help="noise seeds for the coverage")] = 25,
    json_: JsonOption = False,
) -> None:
    """Coverage of the curves' intervals, separation of the mirror branches, held-out errors; a few minutes.

    Examples:
      python -m benchmarks.trend --seeds 30
    """
    foot = load("two_dof")
    start = fit_trend(
        study(power_laws, LOADS_KG, 99), foot, Settings(starts=1, threads=1), order=Order(2, 1, 1), scatter=False,
        certify=False,
    ).best  # fmt: skip
    rows = [row for scatter in (0.0, 0.05) for row in coverage(foot, start, seeds, scatter)]
    console.print("branches, then held-out errors")
    report("trend", [*rows, *branches(foot), *held_out(foot, start)], json_)


if __name__ == "__main__":
    command_line(app)
