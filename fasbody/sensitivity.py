"""Which of the 13 constants matter: relative sensitivities of many random arches, section 4.4 and Figures 4.3, C.1."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from fasbody.arch import PARAMETERS, Arch
from fasbody.arch_model import read_arch
from fasbody.console import command_line, console, make_folder, print_json, progress_bar, write_whole
from fasbody.direct_differential import OUTPUTS, linear_sensitivity, trajectory_sensitivity
from fasbody.exceptions import SettingError
from fasbody.kinematics import Array

#: The constants that the thesis keeps, section 4.4.
CLAIMED = frozenset({"k_T", "c_T", "k_F", "c_F"})


@dataclass(frozen=True)
class Study:
    """Relative sensitivities of many random arches.

    Attributes:
        lever_arm_m: arm of the rotational constants [m]; None reads Table 4.2 literally.
        values: shape (draws, 12 outputs, 13 constants).
        method: "linear" (root mean square over the frequencies) or "trajectory".
    """

    lever_arm_m: float | None
    values: Array
    method: str

    @property
    def reading(self) -> str:
        """How the range of the rotational constants was read."""
        return "literal" if self.lever_arm_m is None else f"lever arm {self.lever_arm_m * 1e3:g} mm"

    def holds(self, output: str) -> Array:
        """For each draw: are the four largest sensitivities of `output` the four that the thesis keeps?"""
        largest = np.argsort(self.values[:, OUTPUTS.index(output)], axis=-1)[:, -len(CLAIMED) :]
        return np.array([{PARAMETERS[j] for j in draw} == CLAIMED for draw in largest])

    def document(self) -> dict[str, object]:
        """The study as plain data for --json."""
        return {
            "method": self.method,
            "lever_arm_m": self.lever_arm_m,
            "draws": len(self.values),
            "parameters": PARAMETERS,
            "claim_holds": {output: int(self.holds(output).sum()) for output in OUTPUTS},
            "median": {
                output: dict(zip(PARAMETERS, np.median(self.values[:, i], axis=0), strict=True))
                for i, output in enumerate(OUTPUTS)
            },
            "malleolus_by_draw": self.values[:, -1],
        }


def study(
    draws: int = 30,
    seed: int = 0,
    lever_arm_m: float | None = None,
    frequency_hz: float | None = None,
    bones: Arch | None = None,
) -> Iterator[Study]:
    """Draw arches from Table 4.2; yields after each draw the study so far.

    Args:
        draws: number of random arches.
        seed: of the random numbers.
        lever_arm_m: see `Arch.draw`.
        frequency_hz: None for the linear model over `FREQUENCIES_HZ`, else the nonlinear one at this frequency.
        bones: geometry and masses of every draw; None is Table 4.1.
    """
    bones = bones or Arch.thesis()
    rng, values = np.random.default_rng(seed), []
    for _ in range(draws):
        arch = bones.drawn(rng, lever_arm_m)
        if frequency_hz is None:
            values.append(np.sqrt(np.mean(linear_sensitivity(arch) ** 2, axis=0)))
        else:
            values.append(trajectory_sensitivity(arch, frequency_hz))
        yield Study(lever_arm_m, np.array(values), "linear" if frequency_hz is None else "trajectory")


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    model: Annotated[str, typer.Option(help="shipped arch or MJCF file whose bones every draw has")] = "foot_arch",
    draws: Annotated[int, typer.Option(help="random arches from Table 4.2", min=1)] = 30,
    seed: Annotated[int, typer.Option(help="of the random numbers", min=0)] = 0,
    lever_arm: Annotated[
        list[float] | None,
        typer.Option(help=r"also with the rotational constants read as N/m at this arm \[m]; may be repeated"),
    ] = None,
    trajectory: Annotated[
        float | None, typer.Option(help="also along nonlinear trajectories at this frequency [Hz], 1 s a draw")
    ] = None,
    figures: Annotated[Path | None, typer.Option(help="folder for the charts like Figures 4.3 and C.1")] = None,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Do only k_T, c_T, k_F, c_F matter? Relative sensitivity of the five-body arch to all 13 constants.

    Examples:
      python -m fasbody.sensitivity --seed 3

      python -m fasbody.sensitivity --lever-arm 0.015 --lever-arm 0.1 --json
    """
    if trajectory is not None and not 1 <= trajectory <= 1000:
        raise SettingError(f"--trajectory is {trajectory:g} Hz, but must be between 1 and 1000 Hz.")
    if figures is not None:
        make_folder(figures)
    bones = read_arch(model)
    arms_m: Sequence[float | None] = [None, *(lever_arm or [])]
    methods = [None] if trajectory is None else [None, trajectory]
    studies = []
    with progress_bar() as progress:
        task = progress.add_task("random arches", total=draws * len(arms_m) * len(methods))
        for lever_arm_m in arms_m:
            for frequency_hz in methods:
                for so_far in study(draws, seed, lever_arm_m, frequency_hz, bones):
                    result = so_far
                    progress.advance(task)
                studies.append(result)
    for result in studies:
        console.print(_table(result))
    if figures is not None:
        from fasbody.figures import png, sensitivity_bars, sensitivity_cases

        for figure, name in ((sensitivity_bars, "sensitivity"), (sensitivity_cases, "sensitivity-cases")):
            console.print(f"written: {write_whole(figures / f'{name}.png', png(figure(studies)))}")
    if json:
        print_json({
            "model": model, "seed": seed, "claimed": sorted(CLAIMED),
            "studies": [result.document() for result in studies],
        })  # fmt: skip


def _table(result: Study) -> Table:
    table = Table(title=f"Median relative sensitivity, {len(result.values)} draws, {result.reading}, {result.method}")
    # the rates repeat their coordinates almost exactly; they are in the JSON
    shown = [output for output in OUTPUTS if not output.endswith("_dot")]
    table.add_column("constant")
    for output in shown:
        table.add_column(output, justify="right")
    median = np.median(result.values, axis=0)
    for j, name in enumerate(PARAMETERS):
        cells = (f"{median[OUTPUTS.index(output), j]:.2g}" for output in shown)
        table.add_row(f"[bold]{name}[/]" if name in CLAIMED else name, *cells, end_section=j == len(PARAMETERS) - 1)
    table.add_row("claim holds", *(f"{result.holds(output).sum()}/{len(result.values)}" for output in shown))
    return table


if __name__ == "__main__":
    command_line(app)
