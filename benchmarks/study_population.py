"""Whether a population's intervals hold: quickly on estimates drawn at random, and on persons recorded and fitted.

Drawn: persons differ by tau, each estimate is off by its standard error; then persons of five shapes, one of which
is the Gaussian, and how often one of them is named who belongs to the others. Fitted: virtual persons whose constants
differ by 15 %, whose legs weigh another 10 % than stated, recorded at seven frequencies with a gain that is off by 1 %,
and fitted with model and sensor errors included. This command prints what docs/study_methods.md quotes.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, console, progress_bar
from fasbody.foot.model import load
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.study import steady
from fasbody.laboratory.subject import Tuberosity
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording
from identification.branches import EXCHANGED, STIFF_ANKLE
from identification.fitting import fit_foot
from identification.study.population import Constant, constant, populations
from identification.study.posterior import MIDDLE
from reproduction.check import Check, at_least, at_most, within

FREQUENCIES_HZ = (10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0)
#: The median person, and how persons, legs and gain differ (standard deviations of logarithms).
MEDIAN = {"k_T": 1.3e5, "k_F": 9e4, "c_11": 300.0, "c_21": 700.0}
BENT = {"c_12": 60.0, "c_13": 120.0, "c_22": -80.0, "c_23": 160.0}
BETWEEN, OF_LEGS, OF_GAIN = 0.15, 0.10, 0.01
_BODY_KG = 70.0
#: Persons, spread between them, and the range of the standard errors, of what is drawn.
CASES = (
    (5, 0.15, 0.05, 0.05),
    (5, 0.3, 0.03, 0.4),
    (8, 0.15, 0.15, 0.15),
    (20, 0.05, 0.15, 0.15),
    (20, 0.3, 0.03, 0.4),
)


#: Persons of each shape, the spread between them and the standard error.
GROUP, OF_GROUP, OF_ESTIMATE = 12, 0.15, 0.05


def shapes(rng: np.random.Generator, size: int) -> dict[str, np.ndarray]:
    """So many persons of each shape, of mean zero and unit standard deviation."""
    return {
        "Gaussian": rng.normal(size=size),
        "Student's t, 3 degrees of freedom": rng.standard_t(3, size) / np.sqrt(3),
        "skewed (gamma, shape 2)": (rng.gamma(2, size=size) - 2) / np.sqrt(2),
        "uniform": np.sqrt(3) * rng.uniform(-1, 1, size),
        "two groups": np.sqrt(0.19) * rng.normal(size=size) + 0.9 * rng.choice([-1, 1], size),
    }


def estimated(rng: np.random.Generator, logs: np.ndarray, errors: np.ndarray) -> Constant:
    """The population behind so many persons, each estimate off by its own standard error."""
    return constant("k_T", [f"{i:02}" for i in range(logs.size)], logs + errors * rng.normal(size=logs.size), errors)


def drawn(seeds: int) -> list[Check]:
    """Coverage of mean, spread and each person's value, over estimates drawn at random."""
    rows: list[Check] = []
    for n, tau, least, most in CASES:
        rng, mean, spread, individual = np.random.default_rng(n), [], [], []
        for _ in range(seeds):
            errors = np.exp(rng.uniform(np.log(least), np.log(most), n))
            u = tau * rng.normal(size=n)
            c = estimated(rng, u, errors)
            mean.append(c.lower <= 1 <= c.upper)
            spread.append(c.spread_lower <= tau <= c.spread_upper)
            by_name = {person.subject: person for person in c.persons}
            individual += [by_name[f"{i:02}"].lower <= np.exp(v) <= by_name[f"{i:02}"].upper for i, v in enumerate(u)]
        about = f"{n} persons, spread {tau:g}, errors {least:g} to {most:g}, {seeds} draws"
        for what, hits in (("mean", mean), ("spread", spread), ("each person", individual)):
            rows.append(at_least(f"95 % interval of {what} holds, {about}", 100 * float(np.mean(hits)), 90.0, "%"))
    return rows


def shaped(seeds: int) -> list[Check]:
    """Coverage of mean and spread over persons of each shape, and clean groups of whom one is named."""
    rows: list[Check] = []
    for name, many in shapes(np.random.default_rng(1), 1_000_000).items():
        rng, mean, spread, odd = np.random.default_rng(GROUP), [], [], []
        truth = OF_GROUP * float(np.diff(np.quantile(many, (0.5 - MIDDLE / 2, 0.5 + MIDDLE / 2)))[0]) / 2
        for _ in range(seeds):
            c = estimated(rng, OF_GROUP * shapes(rng, GROUP)[name], np.full(GROUP, OF_ESTIMATE))
            mean.append(c.lower <= 1 <= c.upper)
            spread.append(c.spread_lower <= truth <= c.spread_upper)
            odd.append(bool(c.odd))
        about = f"{GROUP} persons, {name}, {seeds} draws"
        for what, hits in (("mean", mean), ("spread", spread)):
            rows.append(within(f"95 % interval of {what} holds, {about}", 100 * float(np.mean(hits)), 90.0, 98.0, "%"))
        rows.append(at_most(f"a person named who belongs to the others, {about}", 100 * float(np.mean(odd)), 5.0, "%"))
    return rows


def recorded(rng: np.random.Generator, gain: float) -> list[Recording]:
    """One person's recordings; the fit does not get the true masses or the gain."""
    foot = {name: value * float(np.exp(BETWEEN * rng.normal())) for name, value in MEDIAN.items()} | BENT
    legs = np.exp(OF_LEGS * rng.normal(size=2))
    made = []
    for f in FREQUENCIES_HZ:
        condition = Condition("1", "midstance", 0.0, _BODY_KG, f)
        stated = condition.masses
        two = TwoDof(**foot, m_S=stated["m_S"] * legs[0], m_F=stated["m_F"] * legs[1])
        r, _ = steady(two, Tuberosity.under(0.0), f, 3.0, Instrument(bits=16, delay_s=0.0), rng)
        read = replace(r, malleolus_m_s2=r.malleolus_m_s2 * gain, condition=condition, file=f"{f:g} Hz")
        made.append(checked(read))
    return made


def fitted(count: int, people: int) -> tuple[list[Mapping[str, Any]], ...]:
    """So many populations as documents of pooled fits, each with a separate gain."""
    foot = load("two_dof")
    groups: list[list[Mapping[str, Any]]] = []
    with progress_bar() as bar:
        for seed in bar.track(range(count), description="populations"):
            rng = np.random.default_rng(seed)
            gain = 1 + OF_GAIN * rng.normal()
            documents: list[Mapping[str, Any]] = []
            for person in range(people):
                result = fit_foot(recorded(rng, gain), foot, starts=2, threads=1, replay=0).document()
                about = {"mode": "pooled", "subject": str(person), "posture": "midstance", "added_mass_kg": 0.0}
                documents.append(about | {"status": "done", "frequency_hz": None, "result": result})
            groups.append(documents)
    return tuple(groups)


def held(count: int, people: int) -> list[Check]:
    """Coverage of the means and spreads over fitted populations, on the true branch, and branches decided wrongly."""
    mean, spread, wrong = [], [], 0
    for documents in fitted(count, people):
        groups, _ = populations(documents)
        wrong += bool(groups and groups[0].verdict == "decided" and groups[0].branch != STIFF_ANKLE)
        for c in (c for p in groups if p.branch == STIFF_ANKLE for c in p.constants):
            mean.append(c.lower <= MEDIAN[c.name] <= c.upper)
            spread.append(c.spread_lower <= BETWEEN <= c.spread_upper)
    about = f"{count} populations of {people} persons fitted, {len(EXCHANGED)} constants"
    return [
        within(f"95 % interval of a mean holds, {about}", 100 * float(np.mean(mean)), 92.0, 100.0, "%"),
        within(f"95 % interval of a spread holds, {about}", 100 * float(np.mean(spread)), 92.0, 100.0, "%"),
        at_most(f"decided for the wrong branch, {count} populations", float(wrong), 0.0),
    ]


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(min=2, help="populations drawn of each kind")] = 400,
    shape_seeds: Annotated[int, typer.Option(min=2, help="populations drawn of each shape")] = 200,
    count: Annotated[int, typer.Option(min=0, help="populations recorded and fitted")] = 24,
    people: Annotated[int, typer.Option(min=4, help="persons of each")] = 5,
    json_: JsonOption = False,
) -> None:
    """Coverage of a population's intervals, drawn and fitted. Takes about ten minutes.

    Examples:
      python -m benchmarks.study_population --seeds 20 --count 1
    """
    console.print("  drawn", markup=False)
    rows = [*drawn(seeds), *shaped(shape_seeds)]
    report("study_population", [*rows, *(held(count, people) if count else [])], json_)


if __name__ == "__main__":
    command_line(app)
