"""The results of the heel's analysis as tables on a terminal."""

from collections.abc import Sequence

import numpy as np

from fasbody.console import console, results
from fasbody.heel.analysis import INCLUDES, TESTS, Analysis
from fasbody.heel.laws import LAWS
from fasbody.heel.population import Population
from fasbody.page import show as show_sheet
from fasbody.presentation import Sheet


def show(result: Analysis) -> None:
    """Print the result as tables."""
    study = result.study
    about = f"{study}; {study.origin}; compression: {INCLUDES}"
    results.print(about, markup=False, soft_wrap=True)
    show_sheet(_persons(result), "subject", "speed")
    show_sheet(_laws(result), "law", "Eq.", "contact")
    if result.population is not None:
        law = LAWS[result.law]
        units = {item.name: f"{item.name} [{item.unit}]" for item in law.parameters if item.unit}
        title = f"Population: {law.formula}"
        show_sheet(_intervals(title, "speed", "parameter", [result.population], 1, units), "speed", "parameter")
    if result.slopes:
        title = "Slope of the loading where the foot rests on the shaker [kN/m]"
        show_sheet(_intervals(title, "load", "speed", result.slopes, 1e-3, {}), "load", "speed")
    for sentence in result.sentences():
        results.print(sentence, markup=False, soft_wrap=True)
    computed = f"{result.computed} of {len(result.laws)} laws computed"
    console.print(f"{computed} in {result.seconds:.0f} s")


def _persons(result: Analysis) -> Sheet:
    columns = {
        "at peak [mm]": ("compression_at_peak_mm", 2), "work [J]": ("work_to_peak_j", 2),
        "speed [m/s]": ("contact_speed_m_s", 2), "to peak [ms]": ("time_to_peak_ms", 1),
        "deepest [mm]": ("deepest_mm", 1), "work to standstill [J]": ("work_to_standstill_j", 2),
    }  # fmt: skip
    rows = [
        (row["subject"], row["speed"], str(row["strikes"]),
         *(f"{row[key]:.{digits}f}" for key, digits in columns.values()))
        for row in result.persons
    ]  # fmt: skip
    heads = ("subject", "speed", "strikes", *columns)
    return Sheet("Persons: means of their strikes", heads, rows)


def _laws(result: Analysis) -> Sheet:
    rows = []
    for d in result.laws:
        errors = [d["misfit"], *(np.mean([i["error"] for i in d[t]]) if d[t] else None for t in TESTS)]
        contact = "to peak" if d["window"] == "loading" else "whole"
        shares = ("-" if value is None else f"{100 * value:.1f} %" for value in errors)
        bound = f"{d['at_bound']} of {len(d['persons'])}"
        rows.append((d["name"], d["equation"], contact, *shares, bound))
    tests = ("fitted strikes", "slow to normal", "another person", "at a bound")
    return Sheet("Error of the force, divided by the peak force", ("law", "Eq.", "contact", *tests), rows)


def _intervals(
    title: str, first: str, second: str, populations: Sequence[Population], scale: float,
    names: dict[str, str],
) -> Sheet:  # fmt: skip
    rows = []
    for row in (row for people in populations for row in people.rows()):
        name = names.get(row["parameter"], row["parameter"])
        about = (row["speed"], name) if first == "speed" else (name, row["speed"])
        value, *ends = (f"{scale * row[key]:.3g}" for key in list(row)[2:])
        rows.append((*about, value, " to ".join(ends[:2]), " to ".join(ends[2:])))
    columns = (first, second, "median", "95 % interval", "a new person, 95 %")
    return Sheet(title, columns, rows)
