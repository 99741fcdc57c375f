"""Command line of the five-body arch: sensitivity, reduction, load, validate, crosscheck; see each one's --help."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.arch.bones import PARAMETERS, Arch
from fasbody.arch.load import (
    ARANGIO_CUT,
    ARANGIO_LOAD,
    ARANGIO_SAG,
    HEEL,
    MEASURED_HZ,
    LoadStudy,
    SagStudy,
    load_study,
    sag_study,
)
from fasbody.arch.reduction import Reduction, reduce
from fasbody.console import command_line, console, make_folder, print_json, progress_bar
from fasbody.exceptions import InputFileError, SettingError
from fasbody.lazy import command
from fasbody.presentation import write_figure

if TYPE_CHECKING:
    from fasbody.arch.crosscheck import Crosscheck, Dynamics
    from fasbody.arch.sensitivity import Study

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
    """Do only k_T, c_T, k_F, c_F matter? Relative sensitivity of the five-body arch to all 13 constants.

    First around the model's own constants, then around random ones of Table 4.2, which replace all 13 of them.

    Examples:
      python -m fasbody.arch sensitivity --model my_arch.xml --this

      python -m fasbody.arch sensitivity --lever-arm 0.015 --lever-arm 0.1 --json
    """
    if trajectory is not None and not 1 <= trajectory <= 1000:
        raise SettingError(f"--trajectory is {trajectory:g} Hz, but must be between 1 and 1000 Hz.")
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
        console.print(_sensitivity_table(result))
    if figures is not None:
        from fasbody.arch.figures import sensitivity_bars, sensitivity_cases

        pictures = {"sensitivity": sensitivity_bars([*of_one, *studies])}
        if studies:
            pictures["sensitivity-cases"] = sensitivity_cases(studies)
        for file, picture in pictures.items():
            for written in write_figure(picture, figures / f"{file}.svg", figures / f"{file}.png"):
                console.print(f"written: {written}")
    if json:
        print_json({
            "model": model, "seed": seed, "claimed": sorted(CLAIMED),
            "own": [result.document() for result in of_one],
            "studies": [result.document() for result in studies],
        })  # fmt: skip


def _sensitivity_table(result: "Study") -> Table:
    from fasbody.arch.sensitivity import CLAIMED, OUTPUTS

    many = "" if result.arch_name else f"Median over {len(result.values)} draws, "
    table = Table(title=f"{many}{result.reading}, {result.method}: relative sensitivity")
    # the rates repeat their coordinates almost exactly; they are in the JSON
    outputs = [output for output in OUTPUTS if not output.endswith("_dot")]
    table.add_column("constant")
    for output in outputs:
        table.add_column(output, justify="right")
    median = np.median(result.values, axis=0)
    for j, name in enumerate(PARAMETERS):
        cells = (f"{median[OUTPUTS.index(output), j]:.2g}" for output in outputs)
        table.add_row(f"[bold]{name}[/]" if name in CLAIMED else name, *cells, end_section=j == len(PARAMETERS) - 1)
    table.add_row("claim holds", *(f"{result.holds(output).sum()}/{len(result.values)}" for output in outputs))
    return table


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
    """What the reduction of the five-body arch to two masses costs at the malleolus, 1-100 Hz.

    Examples:
      python -m fasbody.arch reduction --draws 200 --figure reduction.svg
    """
    if figure is not None:
        make_folder(figure.parent)
        if figure.is_dir():
            raise InputFileError(figure, "is a folder", "name an SVG or PNG file")
    result = reduce(draws, seed, arch=Arch.read(model), name=_called(model))
    table, rows = _reduction_table(result, draws)
    console.print(table)
    if figure is not None:
        from fasbody.arch import figures

        console.print(f"written: {write_figure(figures.reduction(result), figure)[0]}")
    if json:
        print_json({"model": model, "seed": seed, "draws": draws, "rows": rows})


def _reduction_table(result: Reduction, draws: int) -> tuple[Table, list[dict[str, object]]]:
    """The table for people, and its rows for --json."""
    table = Table(title=f"Five bodies against two masses, |T| at the malleolus, 1-100 Hz, {draws} draws")
    for column in ("rotational constants", "median", "median of worst", "worst"):
        table.add_column(column, justify="right")
    rows: list[dict[str, object]] = []
    for lever_arm_m, difference in result.differences.items():
        name = "literal" if lever_arm_m is None else f"lever arm {lever_arm_m * 1e3:g} mm"
        numbers = [np.median(difference), np.median(difference.max(axis=1)), difference.max()]
        table.add_row(name, *(f"{100 * value:.3g} %" for value in numbers))
        names = ("median", "median_of_worst", "worst")
        rows.append({"lever_arm_m": lever_arm_m} | dict(zip(names, numbers, strict=True)))
    for name, five, two in result.examples:
        difference = np.abs(five - two) / two
        table.add_row(name, f"{100 * np.median(difference):.3g} %", "", f"{100 * difference.max():.3g} %")
        rows.append({"arch": name, "median": np.median(difference), "worst": difference.max()})
    return table, rows


@app.command("load")
def print_load(
    model: ModelOption = "foot_arch",
    load: Annotated[float, typer.Option(help=r"static load on the arch \[N]")] = ARANGIO_LOAD,
    figures: Annotated[Path | None, typer.Option(help="folder for sag and load, as SVG and PNG")] = None,
    json: JsonOption = False,
) -> None:
    """Sag of the arch under a static load, and its resonance under the added masses of Chapter 2.

    Examples:
      python -m fasbody.arch load --figures docs/figures
    """
    if not 0 < load < 1e5:
        raise SettingError(f"--load is {load:g} N, but must be above 0 and below 100000 N.")
    if figures is not None:
        make_folder(figures)
    arch, name = Arch.read(model), "Nominal arch" if model == "foot_arch" else _called(model)
    sag, masses = sag_study(arch, np.array([0.02, 0.03, 0.04, 0.05, 0.06]), load), load_study(arch)
    console.print(_sag_table(sag, name))
    console.print(_load_table(masses, name))
    if figures is not None:
        from fasbody.arch.figures import arch_sag, load_resonance

        smooth = sag_study(arch, np.linspace(0.02, 0.06, 41), load)
        pictures = {"sag": arch_sag(smooth), "load": load_resonance(masses)}
        for file, picture in pictures.items():
            for written in write_figure(picture, figures / f"{file}.svg", figures / f"{file}.png"):
                console.print(f"written: {written}")
    if json:
        rows = [{key: value for key, value in vars(case).items() if key != "transmissibility"} for case in masses.cases]
        print_json({"model": model, "sag": vars(sag), "load": rows})


def _sag_table(study: SagStudy, name: str) -> Table:
    table = Table(
        title=f"{name} under {study.load:g} N; computed elsewhere in brackets (Arangio; heel: Kim & Voloshin)"
    )
    for column in (
        "height [mm]", "sag [mm]", "sag, fascia cut [mm]", "more sag [%]", "more elongation [%]",
        "fascia's share [%]", "heel's share [%]",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for i, height in enumerate(study.height):
        measured = ARANGIO_SAG.get(round(float(height), 3)) if study.load == ARANGIO_LOAD else None
        cut = ARANGIO_CUT if measured and height > 0.05 else None
        values = (study.sag[i], study.sag_cut[i])
        more = (values[1] / values[0] - 1, study.elongation_cut[i] / study.elongation[i] - 1)
        nothing = (None, None)
        cells = [_beside(v, m, lambda x: f"{1e3 * x:.1f}") for v, m in zip(values, measured or nothing, strict=True)]
        cells += [_beside(v, m, lambda x: f"{100 * x:+.0f}") for v, m in zip(more, cut or nothing, strict=True)]
        shares = [_beside(v, m, lambda x: f"{100 * x:.0f}") for v, m in ((study.share[i], None), (study.heel[i], HEEL))]
        table.add_row(f"{1e3 * height:.0f}", *cells, *shares)
    return table


def _beside(model: float, measured: float | None, show: Callable[[float], str]) -> str:
    return show(model) if measured is None else f"{show(model)} ({show(measured)})"


def _load_table(study: LoadStudy, name: str) -> Table:
    table = Table(title=f"{name} under added mass, constants unchanged")
    for column in (
        "added [kg]", "peak [Hz]", "measured [Hz]", "|T| at peak [1]", "arch [kN/m]", "springs x to meet it [1]",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for case in study.cases:
        low, high = MEASURED_HZ[case.added_mass]
        table.add_row(
            f"{case.added_mass:g}", f"{case.peak_hz:.1f}", f"{low:.0f}-{high:.0f}",
            f"{case.transmissibility.max():.2f}", f"{case.arch_stiffness / 1e3:.1f}", f"{case.factor:.2f}",
        )  # fmt: skip
    return table


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
      python -m fasbody.arch crosscheck --model my_arch.xml --samples 200
    """
    from fasbody.arch.crosscheck import AGREEMENT, MOTION_AGREEMENT, crosscheck

    result = crosscheck(model, samples, seed, dynamics)
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


def _called(model: str) -> str:
    """What tables and figures call a model."""
    return "nominal" if model == "foot_arch" else Path(model).name


if __name__ == "__main__":
    command_line(app)
