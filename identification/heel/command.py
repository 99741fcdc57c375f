"""The command `python -m identification.heel`: which law the heel pads of measured people follow."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.console import console, print_json, results, to_json, write_whole
from fasbody.exceptions import SettingError
from fasbody.heel.laws import LAWS
from fasbody.heel.laws import law as law_of
from fasbody.heel.study import BUNDLED, HeelStudy
from identification.heel.analysis import INCLUDES, POPULATION_LAW, POPULATION_WINDOW, Analysis, analyse
from identification.heel.estimate import WINDOWS

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[
        Path, typer.Argument(help="folder of heel strikes (default: the bundled twelve walkers)")
    ] = BUNDLED,
    law: Annotated[list[str] | None, typer.Option(help=f"only this law; repeat ({', '.join(LAWS)})")] = None,
    population: Annotated[str, typer.Option(help="law of the population")] = POPULATION_LAW,
    window: Annotated[
        str, typer.Option(help=f"contact that the population's law describes: {', '.join(WINDOWS)}")
    ] = POPULATION_WINDOW,
    out: Annotated[Path | None, typer.Option(help="folder for documents and figures; resumes what is there")] = None,
    mjcf: Annotated[Path | None, typer.Option(help="write two_dof.xml with the population's law as its pad")] = None,
    load_n: Annotated[float, typer.Option(min=1.0, help="load under which that pad rests [N]")] = 43.0,
    sample: Annotated[bool, typer.Option("--sample", help="sample the population, too (extra: population)")] = False,
    workers: Annotated[int, typer.Option(min=0, help="processes; 0 for one a core, 1 for this one")] = 0,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Hold laws of the heel pad against measured heel strikes of people.

    The compression is the travel of a heel point fixed to the shank, so everything between skin and shank is in it.

    Examples:
      python -m identification.heel

      python -m identification.heel --out results/heel --json

      python -m identification.heel my_drop_tests --law power --law hunt_crossley

      python -m identification.heel --mjcf foot_with_measured_pad.xml --load-n 66
    """
    keys = tuple(law_of(key).key for key in dict.fromkeys(law or LAWS))
    if window not in WINDOWS:
        raise SettingError(f"--window {window} is none (valid: {', '.join(WINDOWS)}).")
    law_of(population)
    if population not in keys:
        keys = (*keys, population)
    read = HeelStudy.read(study)
    for problem in read.problems:
        console.print(problem, style="yellow", markup=False, soft_wrap=True)
    found = analyse(read, out, keys, population, window, workers)
    document = found.document()
    if sample and found.population is not None:
        from identification.heel.sampler import sampled

        document["population"]["sampled"] = sampled(found)
    for remark in found.remarks:
        console.print(remark, style="yellow", markup=False, soft_wrap=True)
    if out:
        from fasbody.heel.figures import save
        from identification.heel import figures

        write_whole(out / "heel.json", to_json(document) + "\n")
        for name, figure in figures.everything(found).items():
            write_whole(out / f"{name}.png", save(figure))
        console.print(f"heel.json and figures: {out}", markup=False, soft_wrap=True)
    if mjcf:
        _write_model(mjcf, found, load_n)
    if json_:
        print_json(document)
    else:
        show(found)


def _write_model(file: Path, found: Analysis, load_n: float) -> None:
    from fasbody.heel.pad import write_model

    if found.population is None:
        raise SettingError("there is no population whose law could be written into a model.")
    theta = np.exp(found.population.mu[0])
    write_model(file, LAWS[found.law], theta, load_n)
    console.print(f"{file}: {found.law} of {found.population.speeds[0] or 'all'} strikes, resting under {load_n:g} N.",
                  markup=False, soft_wrap=True)  # fmt: skip


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
        misfit = np.nan if d["misfit"] is None else d["misfit"]
        table.add_row(
            d["name"], d["equation"], "to peak" if d["window"] == "loading" else "whole",
            *(f"{100 * value:.1f} %" for value in (misfit, *errors)), f"{d['at_bound']} of {len(d['persons'])}",
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
