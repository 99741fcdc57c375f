"""The command `fasbody heel`: which law the heel pads of people follow."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fasbody.console import console, print_json, to_json, write_whole
from fasbody.exceptions import SettingError, unknown

if TYPE_CHECKING:
    from fasbody.heel.analysis import Analysis

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[
        Path | None,
        typer.Argument(help="folder of heel strikes", show_default="the bundled twelve walkers"),
    ] = None,
    law: Annotated[list[str] | None, typer.Option(help="only this law, e.g. power; repeat for several")] = None,
    population: Annotated[str | None, typer.Option(help="law of the population (default: power)")] = None,
    window: Annotated[
        str | None,
        typer.Option(help="part of the contact for the population's law (default: to the first peak)"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for results and figures; existing ones are reused")] = None,
    mjcf: Annotated[Path | None, typer.Option(help="write two_dof.xml with the population's law as its pad")] = None,
    load_n: Annotated[float, typer.Option(min=1.0, help="static force on the pad [N]")] = 43.0,
    sample: Annotated[bool, typer.Option("--sample", help="also sample the posterior of the population")] = False,
    workers: Annotated[int, typer.Option(min=0, help="number of processes; 0: one per core; 1: no extra process")] = 0,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Compare laws of the heel pad with measured heel strikes of people.

    The compression is the displacement of a heel point fixed to the shank, so it includes all tissue
    between skin and shank.

    Examples:
      fasbody heel

      fasbody heel --out results/heel --json

      fasbody heel my_drop_tests --law power --law hunt_crossley

      fasbody heel --mjcf foot_with_measured_pad.xml --load-n 66
    """
    from fasbody.heel import analysis
    from fasbody.heel.estimate import WINDOWS
    from fasbody.heel.laws import LAWS
    from fasbody.heel.laws import law as law_of
    from fasbody.heel.population import sampled
    from fasbody.heel.study import BUNDLED, HeelStudy
    from fasbody.heel.tables import show

    keys = tuple(law_of(key).key for key in dict.fromkeys(law or LAWS))
    population, window = population or analysis.POPULATION_LAW, window or analysis.POPULATION_WINDOW
    if window not in WINDOWS:
        raise SettingError(f"{unknown('--window', window, WINDOWS)}.")
    if law_of(population).key not in keys:
        keys = (*keys, population)
    strikes = HeelStudy.read(study or BUNDLED)
    for problem in strikes.problems:
        console.print(problem, style="yellow", markup=False, soft_wrap=True)
    result = analysis.analyse(strikes, out, keys, population, window, workers)
    document = result.document()
    if sample and result.population is not None:
        document["population"]["sampled"] = sampled(result.population.names, result.observed()[0])
    for remark in result.remarks:
        console.print(remark, style="yellow", markup=False, soft_wrap=True)
    if out:
        from fasbody.heel import figures
        from fasbody.presentation import write_figure

        write_whole(out / "heel.json", to_json(document) + "\n")
        for name, figure in figures.everything(result).items():
            write_figure(figure, out / f"{name}.svg", out / f"{name}.png")
        console.print(f"heel.json and figures: {out}", markup=False, soft_wrap=True)
    if mjcf:
        _write_model(mjcf, result, load_n)
    if json_:
        print_json(document)
    else:
        show(result)


def _write_model(file: Path, result: "Analysis", load_n: float) -> None:
    import numpy as np

    from fasbody.heel.laws import LAWS
    from fasbody.heel.pad import write_model

    people = result.population
    if people is None:
        raise SettingError("there is no population whose law could be written into a model.")
    write_model(file, LAWS[result.law], np.exp(people.mu[0]), load_n)
    text = f"{file}: {result.law} of {people.speeds[0] or 'all'} strikes, resting under {load_n:g} N."
    console.print(text, markup=False, soft_wrap=True)
