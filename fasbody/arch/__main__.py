"""Command line of the five-body arch: sensitivity, reduction, load, validate, crosscheck; see each one's --help."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.arch.bones import Arch
from fasbody.arch.load import ARANGIO_LOAD, load_study, sag_study
from fasbody.arch.reduction import reduce
from fasbody.console import command_line, console, make_folder, print_json, progress_bar
from fasbody.exceptions import SettingError
from fasbody.lazy import command
from fasbody.presentation import Presented, ready, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fasbody.arch.crosscheck import Crosscheck, Dynamics

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

ModelOption = Annotated[str, typer.Option(help="shipped arch or MJCF file")]
SeedOption = Annotated[int, typer.Option(help="seed of the random numbers", min=0)]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]


@app.command("sensitivity")
def print_sensitivity(
    model: ModelOption = "foot_arch",
    this: Annotated[
        bool, typer.Option("--this", help="only around the model's own constants, without random draws")
    ] = False,
    draws: Annotated[int, typer.Option(help="random arches from Table 4.2, on the model's bones", min=1)] = 30,
    seed: SeedOption = 0,
    lever_arm: Annotated[
        list[float] | None,
        typer.Option(help=r"also with the rotational constants read as N/m at this arm \[m]; may be repeated"),
    ] = None,
    trajectory: Annotated[
        float | None, typer.Option(help=r"also along nonlinear trajectories at this frequency \[Hz], 1 s per draw")
    ] = None,
    figures: Annotated[Path | None, typer.Option(help="folder for the charts like Figures 4.3 and C.1")] = None,
    json: JsonOption = False,
) -> None:
    """Relative sensitivity of the five-body arch to its 13 constants.

    First around the model's own constants, then around random ones of Table 4.2, which replace all 13 of them.

    Examples:
      fasbody arch sensitivity --model my_arch.xml --this

      fasbody arch sensitivity --lever-arm 0.015 --lever-arm 0.1 --json
    """
    if trajectory is not None and not 1 <= trajectory <= 1000:
        raise SettingError(f"{trajectory:g} Hz must be between 1 and 1000 Hz.", "trajectory")
    if figures is not None:
        make_folder(figures)
    from fasbody.arch.sensitivity import CLAIMED, of_arch, study

    arch = Arch.read(model)
    arms_m = [] if this else [None, *(lever_arm or [])]
    methods = [None] if trajectory is None else [None, trajectory]
    name = "the nominal arch" if model == "foot_arch" else _called(model)
    of_one, studies = [of_arch(arch, name, frequency_hz) for frequency_hz in methods], []
    with progress_bar() as progress:
        task = progress.add_task("random arches", total=draws * len(arms_m) * len(methods))
        for lever_arm_m in arms_m:
            for frequency_hz in methods:
                for so_far in study(draws, seed, lever_arm_m, frequency_hz, arch):
                    result = so_far
                    progress.advance(task)
                studies.append(result)
    for result in (*of_one, *studies):
        _show(result)
    if figures is not None:
        from fasbody.arch.figures import sensitivity_bars, sensitivity_cases

        pictures = {"sensitivity": sensitivity_bars([*of_one, *studies])}
        if studies:
            pictures["sensitivity-cases"] = sensitivity_cases(studies)
        _draw(figures, pictures)
    if json:
        print_json({
            "model": model, "seed": seed, "claimed": sorted(CLAIMED),
            "own": [result.document() for result in of_one],
            "studies": [result.document() for result in studies],
        })  # fmt: skip


@app.command("reduction")
def print_reduction(
    model: ModelOption = "foot_arch",
    draws: Annotated[
        int, typer.Option(help="random arches from Table 4.2 for each reading, on the model's bones", min=1)
    ] = 30,
    seed: SeedOption = 0,
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write")] = None,
    json: JsonOption = False,
) -> None:
    """Error of the malleolus' motion when two masses replace the five-body arch, 1-100 Hz.

    Examples:
      fasbody arch reduction --draws 200 --figure reduction.svg
    """
    if figure is not None:
        ready(figure)
    result = reduce(draws, seed, arch=Arch.read(model), name=_called(model))
    _show(result)
    if figure is not None:
        from fasbody.arch import figures

        console.print(f"written: {write_figure(figures.reduction(result), figure)[0]}")
    if json:
        print_json({"model": model, "seed": seed, "draws": draws, "rows": result.summary()})


@app.command("load")
def print_load(
    model: ModelOption = "foot_arch",
    load: Annotated[float, typer.Option(help=r"static load on the arch \[N]")] = ARANGIO_LOAD,
    figures: Annotated[Path | None, typer.Option(help="folder for sag and load, as SVG and PNG")] = None,
    json: JsonOption = False,
) -> None:
    """Sag of the arch under a static load, and its resonance under the added masses of Chapter 2.

    Examples:
      fasbody arch load --figures docs/figures
    """
    if not 0 < load < 1e5:
        raise SettingError(f"{load:g} N must be above 0 and below 100000 N.", "load")
    if figures is not None:
        make_folder(figures)
    arch, name = Arch.read(model), "Nominal arch" if model == "foot_arch" else _called(model)
    sag, masses = sag_study(arch, np.array([0.02, 0.03, 0.04, 0.05, 0.06]), load), load_study(arch)
    _show(sag, name)
    _show(masses, name)
    if figures is not None:
        from fasbody.arch.figures import arch_sag, load_resonance

        smooth = sag_study(arch, np.linspace(0.02, 0.06, 41), load)
        pictures = {"sag": arch_sag(smooth), "load": load_resonance(masses)}
        _draw(figures, pictures)
    if json:
        rows = [{key: value for key, value in vars(case).items() if key != "transmissibility"} for case in masses.cases]
        print_json({"model": model, "sag": vars(sag), "load": rows})


app.command("validate")(command("reproduction.arch_validation.command:validate"))


@app.command("crosscheck")
def print_crosscheck(
    model: ModelOption = "foot_arch",
    samples: Annotated[int, typer.Option(help="random configurations", min=1)] = 1000,
    seed: SeedOption = 0,
    dynamics: Annotated[
        bool, typer.Option("--dynamics", help="also step the model against the integrated equations, 10-50 Hz")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Compare mass matrix and velocity terms of the arch: equations, Pinocchio, MuJoCo; exit 1 on disagreement.

    Examples:
      fasbody arch crosscheck --model my_arch.xml --samples 200
    """
    from fasbody.arch.crosscheck import AGREEMENT, MOTION_AGREEMENT, crosscheck

    with progress_bar() as progress:
        hertz = partial(progress.track, description="stepped against the equations")
        result = crosscheck(model, samples, seed, dynamics, hertz)
    console.print(_crosscheck_table(result))
    if result.dynamics is not None:
        console.print(_dynamics_table(result.dynamics))
    if result.note:
        console.print(f"Note: {result.note}")
    verdict = "agree" if result.agrees else "DISAGREE"
    console.print(f"The three engines {verdict} (limit {AGREEMENT:.0e}, motion {MOTION_AGREEMENT:.0e}).")
    if json:
        print_json(result.document())
    if not result.agrees:
        raise typer.Exit(1)


def _crosscheck_table(result: "Crosscheck") -> Table:
    drawn = f"{result.samples} random configurations, seed {result.seed}"
    table = Table(title=f"{result.model}: largest relative difference, {drawn}")
    table.add_column("pair")
    quantities = ("mass_matrix", "bias", "linear_mass_matrix")
    for quantity in quantities:
        table.add_column(quantity.replace("_", " "), justify="right")
    for pair in result.mass_matrix:
        table.add_row(pair, *(f"{getattr(result, quantity)[pair]:.1e}" for quantity in quantities))
    return table


def _dynamics_table(motions: "list[Dynamics]") -> Table:
    from fasbody.arch.crosscheck import TABLE_SECONDS

    table = Table(title=f"Malleolus, stepped MuJoCo against the equations, {TABLE_SECONDS:g} s from rest, over peak")
    for column in ("table [Hz]", "difference [1]", "accurate mode [1]", "step [s]"):
        table.add_column(column, justify="right")
    table.add_column("changed to step at all")
    for m in motions:
        table.add_row(f"{m.frequency_hz:g}", f"{m.difference:.1e}", f"{m.accurate:.1e}", f"{m.step:g}", m.note)
    return table


def _show(result: Presented, name: str = "") -> None:
    """Print a result's table on stderr, behind the name of its model."""
    sheet = result.sheet()
    text = str(replace(sheet, title=f"{name}: {sheet.title}") if name else sheet)
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def _draw(folder: Path, pictures: "dict[str, Figure]") -> None:
    for name, picture in pictures.items():
        for written in write_figure(picture, folder / f"{name}.svg", folder / f"{name}.png"):
            console.print(f"written: {written}")


def _called(model: str) -> str:
    return "nominal" if model == "foot_arch" else Path(model).name


if __name__ == "__main__":
    command_line(app)
