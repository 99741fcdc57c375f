"""The results of the heel's analysis as tables on a terminal."""

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from fasbody.console import console, results
from fasbody.heel.analysis import INCLUDES, TESTS, Analysis
from fasbody.heel.laws import LAWS
from fasbody.heel.population import Population


def show(result: Analysis) -> None:
    """Print the result as tables."""
    study = result.study
    about = f"{study}; {study.origin}; compression: {INCLUDES}"
    results.print(about, markup=False, soft_wrap=True)
    results.print(_persons(result))
    results.print(_laws(result))
    if result.population is not None:
        law = LAWS[result.law]
        units = {item.name: rf"{item.name} \[{item.unit}]" for item in law.parameters if item.unit}
        heads = ("speed", "parameter")
        results.print(_intervals(f"Population: {law.formula}", heads, [result.population], 1, units))
    if result.slopes:
        title = r"Slope of the loading where the foot rests on the shaker \[kN/m]"
        results.print(_intervals(title, ("load", "speed"), result.slopes, 1e-3, {}))
    for sentence in result.sentences():
        results.print(sentence, markup=False, soft_wrap=True)
    computed = f"{result.computed} of {len(result.laws)} laws computed"
    console.print(f"{computed} in {result.seconds:.0f} s")


def _persons(result: Analysis) -> Table:
    columns = {
        "at peak [mm]": ("compression_at_peak_mm", 2), "work [J]": ("work_to_peak_j", 2),
        "speed [m/s]": ("contact_speed_m_s", 2), "to peak [ms]": ("time_to_peak_ms", 1),
        "deepest [mm]": ("deepest_mm", 1), "work to standstill [J]": ("work_to_standstill_j", 2),
    }  # fmt: skip
    table = Table("subject", "speed", title="Persons: means of their strikes", title_justify="left")
    for head in ("strikes", *columns):
        table.add_column(head.replace("[", r"\["), justify="right")
    for row in result.persons:
        numbers = (f"{row[key]:.{digits}f}" for key, digits in columns.values())
        table.add_row(row["subject"], row["speed"], str(row["strikes"]), *numbers)
    return table


def _laws(result: Analysis) -> Table:
    title = "Laws: error of the force over its peak"
    table = Table("law", "Eq.", "contact", title=title, title_justify="left")
    for head in ("own strikes", "slow to normal", "another person", "on a bound"):
        table.add_column(head, justify="right")
    for d in result.laws:
        errors = [d["misfit"]]
        errors += [np.mean([i["error"] for i in d[t]]) if d[t] else None for t in TESTS]
        table.add_row(
            d["name"], d["equation"], "to peak" if d["window"] == "loading" else "whole",
            *("-" if value is None else f"{100 * value:.1f} %" for value in errors),
            f"{d['at_bound']} of {len(d['persons'])}",
        )  # fmt: skip
    return table


def _intervals(
    title: str, heads: tuple[str, str], populations: Sequence[Population], scale: float, names: dict[str, str]
) -> Table:
    """Medians of populations, their intervals, and where a new person lies."""
    columns = (*heads, "median", "95 % interval", "a new person, 95 %")
    table = Table(*columns, title=title, title_justify="left")
    for row in (row for people in populations for row in people.rows()):
        name = names.get(row["parameter"], row["parameter"])
        first = (row["speed"], name) if heads[0] == "speed" else (name, row["speed"])
        value, *ends = (f"{scale * row[key]:.3g}" for key in list(row)[2:])
        table.add_row(*first, value, " to ".join(ends[:2]), " to ".join(ends[2:]))
    return table
