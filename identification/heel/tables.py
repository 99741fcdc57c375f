"""The findings of the heel's analysis as tables on a terminal."""

import numpy as np
from rich.table import Table

from fasbody.console import console, results
from fasbody.heel.laws import LAWS
from identification.heel.analysis import INCLUDES, Analysis


def show(found: Analysis) -> None:
    """The findings as tables."""
    results.print(f"{found.study}; {found.study.origin}; compression: {INCLUDES}", markup=False, soft_wrap=True)
    table = Table(title="Persons: means of their strikes", title_justify="left")
    heads = ("subject", "speed", "strikes", r"at peak \[mm]", r"work \[J]", r"speed \[m/s]", r"to peak \[ms]",
             r"deepest \[mm]",
             r"work to standstill \[J]")  # fmt: skip
    for head in heads:
        table.add_column(head, justify="left" if head in heads[:2] else "right")
    for row in found.persons:
        table.add_row(
            row["subject"], row["speed"], str(row["strikes"]), f"{row['compression_at_peak_mm']:.2f}",
            f"{row['work_to_peak_j']:.2f}", f"{row['contact_speed_m_s']:.2f}", f"{row['time_to_peak_ms']:.1f}",
            f"{row['deepest_mm']:.1f}", f"{row['work_to_standstill_j']:.2f}",
        )  # fmt: skip
    results.print(table)
    table = Table(title="Laws: error of the force over its peak", title_justify="left")
    for head in ("law", "Eq.", "contact", "own strikes", "slow to normal", "another person", "on a bound"):
        table.add_column(head, justify="left" if head in ("law", "Eq.", "contact") else "right")
    for d in found.laws:
        errors = [
            np.mean([i["error"] for i in d[test]]) if d[test] else np.nan for test in ("other_speed", "other_person")
        ]
        errors = [np.nan if d["misfit"] is None else d["misfit"], *errors]
        shown = ["-" if np.isnan(value) else f"{100 * value:.1f} %" for value in errors]
        table.add_row(
            d["name"], d["equation"], "to peak" if d["window"] == "loading" else "whole",
            *shown, f"{d['at_bound']} of {len(d['persons'])}",
        )  # fmt: skip
    results.print(table)
    _show_population(found)
    for sentence in found.sentences():
        results.print(sentence, markup=False, soft_wrap=True)
    console.print(f"{found.computed} of {len(found.laws)} laws computed in {found.seconds:.0f} s")


def _show_population(found: Analysis) -> None:
    if found.population is not None:
        table = Table(title=f"Population: {LAWS[found.law].formula}", title_justify="left")
        for head in ("speed", "parameter", "median", "95 % interval", "a new person, 95 %"):
            table.add_column(head)
        for speed in found.population.speeds:
            for item in LAWS[found.law].parameters:
                value, lower, upper = found.population.interval(speed, item.name)
                low, high = found.population.predictive(speed, item.name)
                unit = rf" \[{item.unit}]" if item.unit else ""
                table.add_row(speed, f"{item.name}{unit}", f"{value:.3g}", f"{lower:.3g} to {upper:.3g}",
                              f"{low:.3g} to {high:.3g}")  # fmt: skip
        results.print(table)
    if found.slopes:
        table = Table(title=r"Slope of the loading where the foot rests on the shaker \[kN/m]", title_justify="left")
        for head in ("load", "speed", "median", "95 % interval", "a new person, 95 %"):
            table.add_column(head)
        for slope in found.slopes:
            (name,) = slope.names
            for speed in slope.speeds:
                value, lower, upper = (1e-3 * x for x in slope.interval(speed, name))
                low, high = (1e-3 * x for x in slope.predictive(speed, name))
                table.add_row(name, speed, f"{value:.3g}", f"{lower:.3g} to {upper:.3g}", f"{low:.3g} to {high:.3g}")
        results.print(table)
