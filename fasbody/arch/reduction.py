"""Is the arch a two-mass foot? Transmissibility of the five bodies against their two-mass reduction, 1-100 Hz."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array
from fasbody.arch.linear import transmissibility, two_mass_transmissibility
from fasbody.arch.mjcf import read_arch
from fasbody.console import command_line, console, make_folder, print_json, write_whole
from fasbody.exceptions import InputFileError


@dataclass(frozen=True)
class Reduction:
    """Differences of two transmissibilities at the malleolus.

    Attributes:
        frequency_hz: shape (n,).
        examples: name, |T| of five bodies and of two masses, shape (n,) each.
        differences: lever arm [m] or None -> | |T_5| - |T_2| | / |T_2|, shape (draws, n).
    """

    frequency_hz: Array
    examples: list[tuple[str, Array, Array]]
    differences: dict[float | None, Array]


def reduce(
    draws: int = 30,
    seed: int = 0,
    lever_arms_m: tuple[float | None, ...] = (None, 0.1, 0.015),
    arch: Arch | None = None,
    name: str = "nominal",
) -> Reduction:
    """Compare both models for one arch, for its bones in the middle of Table 4.2 and for random draws of that table.

    Args:
        draws: random arches per lever arm.
        seed: of the random numbers, the same for each lever arm.
        lever_arms_m: readings of the rotational constants, see `Arch.draw`.
        arch: whose bones everything has; None is `Arch.nominal()`.
        name: what to call it.
    """
    arch = arch or Arch.nominal()
    frequency = np.linspace(1, 100, 199)

    def both(one: Arch) -> tuple[Array, Array]:
        return np.abs(transmissibility(one, frequency)), np.abs(two_mass_transmissibility(one, frequency))

    differences = {}
    for lever_arm_m in lever_arms_m:
        rng = np.random.default_rng(seed)
        pairs = [both(arch.drawn(rng, lever_arm_m)) for _ in range(draws)]
        differences[lever_arm_m] = np.array([np.abs(five - two) / two for five, two in pairs])
    examples = [(name, *both(arch)), ("middle of Table 4.2", *both(arch.middle()))]
    return Reduction(frequency, examples, differences)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    model: Annotated[str, typer.Option(help="shipped arch or MJCF file; the draws keep its bones")] = "foot_arch",
    draws: Annotated[int, typer.Option(help="random arches from Table 4.2 for each reading", min=1)] = 30,
    seed: Annotated[int, typer.Option(help="of the random numbers", min=0)] = 0,
    figure: Annotated[Path | None, typer.Option(help="PNG to write")] = None,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """What the reduction of the five-body arch to two masses costs at the malleolus, 1-100 Hz.

    Examples:
      python -m fasbody.arch.reduction --draws 200 --figure reduction.png
    """
    if figure is not None:
        make_folder(figure.parent)
        if figure.is_dir():
            raise InputFileError(figure, "is a folder", "name a PNG file")
    result = reduce(draws, seed, arch=read_arch(model), name="nominal" if model == "foot_arch" else Path(model).name)
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
    console.print(table)
    if figure is not None:
        from fasbody.arch import figures

        console.print(f"written: {write_whole(figure, figures.png(figures.reduction(result)))}")
    if json:
        print_json({"model": model, "seed": seed, "draws": draws, "rows": rows})


if __name__ == "__main__":
    command_line(app)
