"""Coverage of the intervals of the heel's laws: strikes of known laws, with plate, markers and filters.

A leg of constant mass falls on a pad that follows a law; DOP853 integrates it at tight tolerance. What the plate and
the markers would have recorded is written as volts and millimetres, with the noise, the quantisation and the two
clocks of the measured study, and goes through the same corrections and the same fit. Each person has ten strikes of
one law, with other masses and speeds of contact.
"""

import time
from collections.abc import Iterator
from typing import Annotated

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from fasbody import runner
from fasbody.console import command_line
from fasbody.heel.analysis import analyse
from fasbody.heel.estimate import LEVEL, fit
from fasbody.heel.laws import LAWS
from fasbody.heel.study import HeelStudy
from reproduction.check import Check, at_most, told, within
from simulator.strike import TRUTH, strike


def person(task: tuple[str, int]) -> tuple[str, list[bool]]:
    """Whether each 95 % interval of a person of ten strikes holds the truth."""
    key, seed = task
    law, theta = LAWS[key], np.array(TRUTH[key])
    rng = np.random.default_rng([seed, list(LAWS).index(key)])
    estimate = fit(law, [strike(law, theta, rng, k) for k in range(10)], "whole")
    return key, [
        item.lower <= true <= item.upper for item, true in zip(estimate.parameters.values(), theta, strict=True)
    ]


def measure(persons: int, jobs: int) -> Iterator[Check]:
    """The rows of this topic."""
    tasks = [(key, seed) for seed in range(persons) for key in TRUTH]
    hits: dict[str, list[bool]] = {}
    for _, (key, inside) in runner.run(person, tasks, "coverage", jobs):
        hits.setdefault(key, []).extend(inside)
    everything = [hit for inside in hits.values() for hit in inside]
    yield within(f"heel: parameters of {len(tasks)} synthetic people inside their {100 * LEVEL:g} % intervals",
                  100 * float(np.mean(everything)), 92.0, 98.0, "%")  # fmt: skip
    for key, inside in hits.items():
        yield told(f"the same, {LAWS[key].name}", f"{100 * np.mean(inside):.3g} % of {len(inside)}", "")
    began = time.perf_counter()
    analysis = analyse(HeelStudy.read())
    yield at_most("heel: the whole analysis of twelve walkers, wall time", time.perf_counter() - began, 120.0, "s")
    for window in ("loading", "whole"):
        for test, words in (("other_speed", "slow to normal"), ("other_person", "a person left out")):
            best = analysis.best(window, test)
            if best:
                yield told(
                    f"heel: {words}, {window}, error over the peak", f"{100 * best[1]:.3g} % ({LAWS[best[0]].name})", ""
                )


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    persons: Annotated[int, typer.Option(help="synthetic people per law")] = 40,
    jobs: Annotated[int, typer.Option(help="processes, 0 for all cores")] = 0,
    json_: JsonOption = False,
) -> None:
    """Count how often the intervals of the heel's laws hold the truth, and time the analysis.

    Examples:
      python -m benchmarks.heel --persons 100
    """
    report("heel", list(measure(persons, jobs)), json_)


if __name__ == "__main__":
    command_line(app)
