"""Command line of the leg: `python -m fasbody.leg peaks | crosscheck --help`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from fasbody.console import command_line, console, make_folder, print_json, write_whole
from fasbody.exceptions import InputFileError, SettingError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

ModelOption = Annotated[str, typer.Option(help="shipped leg or MJCF file")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]


@app.command("peaks")
def print_peaks(
    model: ModelOption = "leg",
    figure: Annotated[Path | None, typer.Option(help="PNG to write")] = None,
    json: JsonOption = False,
) -> None:
    """Where MB, TB and TM of a leg are highest under 0, 2.3 and 4.5 kg, and which statements they meet.

    Examples:
      python -m fasbody.leg peaks --figure peaks.png

      python -m fasbody.leg peaks --model my_leg.xml --json
    """
    if figure is not None:
        make_folder(figure.parent)
        if figure.is_dir():
            raise InputFileError(figure, "is a folder", "name a PNG file")
    from fasbody.foot.model import load
    from fasbody.leg.chain import Leg
    from fasbody.leg.peaks import peaks
    from fasbody.leg.statements import STATEMENTS

    foot = load(model)
    result = peaks(Leg.from_model(foot.model, foot.name), foot.name)
    console.print(str(result.sheet()), highlight=False, markup=False)
    if figure is not None:
        from fasbody.leg import figures

        console.print(f"written: {write_whole(figure, figures.png(figures.peaks(result)))}")
    if json:
        stated = zip(STATEMENTS, result.held, strict=True)
        print_json({
            "model": model, "loads": result.records(),
            "statements": [{"section": s.section, "pair": s.pair, "says": s.says, "holds": h} for s, h in stated],
        })  # fmt: skip


@app.command("crosscheck")
def print_crosscheck(
    model: ModelOption = "leg",
    added_mass: Annotated[float, typer.Option(help=r"where the model says that it goes \[kg]")] = 0.0,
    json: JsonOption = False,
) -> None:
    """Matrices and stepped response of a leg from the equations, Pinocchio and MuJoCo; exit 1 on disagreement.

    Examples:
      python -m fasbody.leg crosscheck --model my_leg.xml --added-mass 4.5
    """
    if not 0 <= added_mass <= 50:
        raise SettingError(f"--added-mass is {added_mass:g}, but must be between 0 and 50 kg.")
    from fasbody.leg.crosscheck import MATRICES, RESPONSES, crosscheck

    result = crosscheck(model, added_mass)
    table = Table(title=f"{result.model} with {added_mass:g} kg: largest relative difference")
    table.add_column("quantity")
    table.add_column("difference", justify="right")
    for name, value in result.matrices.items():
        table.add_row(name, f"{value:.1e}")
    for frequency, value in result.responses.items():
        table.add_row(f"response stepped at {frequency:g} Hz", f"{value:.1e}")
    console.print(table)
    verdict = "agree" if result.agrees else "DISAGREE"
    console.print(f"The engines {verdict} (matrices {MATRICES:.0e}, responses {RESPONSES:.0e}).")
    if json:
        print_json(vars(result) | {"agrees": result.agrees})
    if not result.agrees:
        raise typer.Exit(1)


if __name__ == "__main__":
    command_line(app)
