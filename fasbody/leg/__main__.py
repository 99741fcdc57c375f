"""Command line of the leg: `fasbody leg peaks | crosscheck | drop | decide | name`."""

from pathlib import Path
from typing import Annotated

import typer

from fasbody.console import command_line, console, print_json
from fasbody.exceptions import SettingError
from fasbody.lazy import command
from fasbody.presentation import Sheet, ready, write_figure

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

ModelOption = Annotated[str, typer.Option(help="shipped leg or MJCF file")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]


@app.command("peaks")
def print_peaks(
    model: ModelOption = "leg",
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write")] = None,
    json: JsonOption = False,
) -> None:
    """Peaks of MB, TB and TM of a leg under 0, 2.3 and 4.5 kg, and which statements of the thesis hold.

    Examples:
      fasbody leg peaks --figure peaks.svg

      fasbody leg peaks --model my_leg.xml --json
    """
    if figure is not None:
        ready(figure)
    from fasbody.foot.model import load
    from fasbody.leg.chain import Leg
    from fasbody.leg.peaks import peaks
    from fasbody.leg.statements import STATEMENTS

    foot = load(model)
    result = peaks(Leg.from_model(foot.model, foot.name), foot.name)
    console.print(str(result.sheet()), highlight=False, markup=False)
    if figure is not None:
        console.print(f"written: {write_figure(result.plot(), figure)[0]}")
    if json:
        statements = [
            {"section": s.section, "pair": s.pair, "says": s.says, "holds": holds}
            for s, holds in zip(STATEMENTS, result.held, strict=True)
        ]
        print_json({"model": model, "loads": result.records(), "statements": statements})


@app.command("crosscheck")
def print_crosscheck(
    model: ModelOption = "leg",
    added_mass: Annotated[
        float | None,
        typer.Option(help=r"added mass \[kg], in place of that in the file"),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Matrices and stepped response of a leg from the equations, Pinocchio and MuJoCo; exit 1 on disagreement.

    Examples:
      fasbody leg crosscheck --model my_leg.xml --added-mass 4.5
    """
    if added_mass is not None and not 0 <= added_mass <= 50:
        raise SettingError(f"--added-mass is {added_mass:g}, but must be between 0 and 50 kg.")
    from fasbody.leg.crosscheck import RESPONSES, crosscheck

    result = crosscheck(model, added_mass)
    title = f"{result.model} with {result.added_mass_kg:g} kg: largest relative difference"
    named = {f"response stepped at {hz:g} Hz": off for hz, off in result.responses.items()}
    rows = [(name, f"{off:.1e}") for name, off in (result.matrices | named).items()]
    console.print(str(Sheet(title, ("quantity", "difference"), rows)), highlight=False, markup=False)
    verdict = "agree" if result.agrees else "DISAGREE"
    limits = f"matrices {result.limit:.0e}, responses {RESPONSES:.0e}"
    console.print(f"The engines {verdict} ({limits}).")
    if result.note:
        console.print(result.note, highlight=False)
    if json:
        print_json(vars(result) | {"agrees": result.agrees, "note": result.note})
    if not result.agrees:
        raise typer.Exit(1)


app.command("drop")(command("reproduction.load_effect.command:drop"))
app.command("decide")(command("reproduction.load_effect.command:decide"))
app.command("name")(command("identification.rivals.naming_command:name"))

if __name__ == "__main__":
    command_line(app)
