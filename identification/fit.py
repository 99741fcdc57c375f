"""`fasbody fit`: stiffness and damping of a foot from its recordings."""

import sys
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.markup import escape

from fasbody.console import command_line, console, make_folder, print_json, results, stages
from identification.options import AddedMass, BodyMass, Data, DelayStd, GainStd, Mapping, MassStd

if TYPE_CHECKING:
    from identification.result import FitResult

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    data: Data = None,
    model: Annotated[str, typer.Option(help="shipped model or MJCF file")] = "two_dof",
    body_mass: BodyMass = None,
    added_mass: AddedMass = None,
    study: Mapping = None,
    free: Annotated[
        str | None, typer.Option(help="parameters to estimate, e.g. k_T,k_F,c_11,c_21 (default: all)")
    ] = None,
    bounds: Annotated[list[str] | None, typer.Option(help="NAME=LOWER:UPPER in SI units; repeat for several")] = None,
    starts: Annotated[
        int, typer.Option(help="random starts per branch and round; rounds end when the minimum was found twice")
    ] = 12,
    seed: Annotated[int, typer.Option(min=0, help="seed of the random starts")] = 0,
    domain: Annotated[str, typer.Option(help="auto, periodic (steady state) or time")] = "auto",
    mass_std: MassStd = None,
    gain_std: GainStd = None,
    delay_std: DelayStd = None,
    exclude: Annotated[
        str | None,
        typer.Option(
            help="nuisance parameters to exclude: mount, relaxation, load, rocking, drift, share, seating, or all"
        ),
    ] = None,
    sensors: Annotated[
        str | None, typer.Option(help="accelerometers to fit, e.g. malleolus,foot (default: all that the model has)")
    ] = None,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
    out: Annotated[
        Path | None, typer.Option(help="folder for report.html, result.json, parameters.csv, figures/")
    ] = None,
) -> None:
    """Estimate the parameters of a foot from recordings of its vibration.

    Examples:
      fasbody fit

      fasbody fit my_study --starts 20 --out results

      fasbody fit loaded/*.csv --body-mass 72.5 --added-mass 2.3

      fasbody fit 20hz.tdms 30hz.tdms --study study.toml --body-mass 72.5

      fasbody fit my_study --exclude mount,rocking --mass-std 0.03

      fasbody fit my_study --sensors malleolus,foot

      fasbody fit bare.csv loaded.csv --body-mass 72.5 --added-mass 0 --added-mass 2.3

      fasbody fit my_study --model my_foot.xml --free k_T,k_F --bounds k_F=3e3:5e5
    """
    from fasbody.foot.model import load
    from fasbody.recording.sources import gather
    from fasbody.recording.study import BUNDLED
    from identification.fitting import Settings, fit_foot
    from identification.parameters import limits, names

    source, recordings, truth = gather(data or [BUNDLED], body_mass, added_mass, study)
    settings = Settings(
        free=names(free), bounds=limits(bounds), starts=starts, seed=seed, domain=domain, mass_std=mass_std,
        gain_std=gain_std, delay_std_s=delay_std, exclude=names(exclude) or (), sensors=names(sensors),
    )  # fmt: skip
    foot = load(model)
    folder = out or (None if json_ else Path("results") / _slug(source))
    if folder is not None:
        make_folder(folder)
    with stages() as advance:
        result = fit_foot(recordings, foot, settings, advance=advance).with_source(source, truth)
    provenance = {**result.provenance, "command": _typed(), "model": model}
    if study is not None:
        provenance["study"] = str(study)
    result = replace(result, provenance=provenance)
    if json_:
        print_json(result.document())
    else:
        show(result)
    if folder is not None:
        from identification.report import write  # its figures take seconds that the table need not wait

        write(result, folder)
        console.print(
            f"report: [bold]{escape(str(folder / 'report.html'))}[/], with result.json, parameters.csv and figures/ "
            "beside it",
            soft_wrap=True,
        )


def _typed() -> str:
    """The command as it was typed."""
    return " ".join(["fasbody fit", *map(quote, sys.argv[1:])])


def _slug(text: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in text.lower()).strip("_")[:60] or "fit"


def show(result: "FitResult") -> None:
    """Print the result as a table for a person."""
    from rich.table import Table

    sheet = result.sheet()
    table = Table(title=sheet.title, title_justify="left")
    for column in sheet.columns:
        side: Literal["left", "right"] = "left" if column in ("parameter", "") else "right"
        table.add_column(column, justify=side, no_wrap=not column)
    for row in sheet.rows:
        table.add_row(*map(escape, row))
    results.print(table)
    results.print(f"[bold]{escape(result.sentence())}[/]", soft_wrap=True)
    results.print(result.reason, soft_wrap=True, markup=False)
    for text in (*result.by_sensor, *result.impossible):
        results.print(text, soft_wrap=True, markup=False)
    for text in result.warnings:
        results.print(f"[yellow]note:[/] {escape(text)}", soft_wrap=True)


if __name__ == "__main__":
    command_line(app)
