"""The command `python -m identification.heel`: which law the heel pads of measured people follow."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fasbody.console import console, print_json, to_json, write_whole
from fasbody.exceptions import SettingError, unknown

if TYPE_CHECKING:
    from identification.heel.analysis import Analysis

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[
        Path | None, typer.Argument(help="folder of heel strikes", show_default="the bundled twelve walkers")
    ] = None,
    law: Annotated[list[str] | None, typer.Option(help="only this law, e.g. power; repeat for several")] = None,
    population: Annotated[str | None, typer.Option(help="law of the population (default: power)")] = None,
    window: Annotated[
        str | None, typer.Option(help="contact that the population's law describes (default: to the first peak)")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for documents and figures; resumes what is there")] = None,
    mjcf: Annotated[Path | None, typer.Option(help="write two_dof.xml with the population's law as its pad")] = None,
    load_n: Annotated[float, typer.Option(min=1.0, help="load under which the pad rests [N]")] = 43.0,
    sample: Annotated[bool, typer.Option("--sample", help="sample the population, too (extra: population)")] = False,
    workers: Annotated[int, typer.Option(min=0, help="processes; 0 for one per core, 1 for this one")] = 0,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Compare laws of the heel pad with measured heel strikes of people.

    The compression is the travel of a heel point fixed to the shank, so it includes everything between skin and shank.

    Examples:
      python -m identification.heel

      python -m identification.heel --out results/heel --json

      python -m identification.heel my_drop_tests --law power --law hunt_crossley

      python -m identification.heel --mjcf foot_with_measured_pad.xml --load-n 66
    """
    from fasbody.heel.laws import LAWS
    from fasbody.heel.laws import law as law_of
    from fasbody.heel.study import BUNDLED, HeelStudy
    from identification.heel.analysis import POPULATION_LAW, POPULATION_WINDOW, analyse
    from identification.heel.estimate import WINDOWS

    keys = tuple(law_of(key).key for key in dict.fromkeys(law or LAWS))
    population, window = population or POPULATION_LAW, window or POPULATION_WINDOW
    if window not in WINDOWS:
        raise SettingError(f"{unknown('--window', window, WINDOWS)}.")
    law_of(population)
    if population not in keys:
        keys = (*keys, population)
    read = HeelStudy.read(study or BUNDLED)
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
        from fasbody.presentation import write_figure
        from identification.heel import figures

        write_whole(out / "heel.json", to_json(document) + "\n")
        for name, figure in figures.everything(found).items():
            write_figure(figure, out / f"{name}.svg", out / f"{name}.png")
        console.print(f"heel.json and figures: {out}", markup=False, soft_wrap=True)
    if mjcf:
        _write_model(mjcf, found, load_n)
    if json_:
        print_json(document)
    else:
        from identification.heel.tables import show

        show(found)


def _write_model(file: Path, found: "Analysis", load_n: float) -> None:
    import numpy as np

    from fasbody.heel.laws import LAWS
    from fasbody.heel.pad import write_model

    if found.population is None:
        raise SettingError("there is no population whose law could be written into a model.")
    theta = np.exp(found.population.mu[0])
    write_model(file, LAWS[found.law], theta, load_n)
    console.print(f"{file}: {found.law} of {found.population.speeds[0] or 'all'} strikes, resting under {load_n:g} N.",
                  markup=False, soft_wrap=True)  # fmt: skip
