"""Why the resonance rises with the load: `python -m fasbody.load_effect --help`."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from fasbody.console import command_line, console, make_folder, print_json, progress_bar
from fasbody.presentation import write_figure

if TYPE_CHECKING:
    from fasbody.leg.mechanisms import Searched

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def print_load_effect(
    draws: Annotated[int, typer.Option(help="draws from each linear mechanism's space", min=20)] = 20000,
    lift_off_draws: Annotated[
        int, typer.Option(help="draws of each mechanism whose pad cannot pull, a tenth of a second each", min=20)
    ] = 400,
    seed: Annotated[int, typer.Option(help="seed of the random numbers", min=0)] = 0,
    figures: Annotated[Path | None, typer.Option(help="folder for leg-mechanisms, as SVG and PNG")] = None,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Find which mechanisms can raise the resonance with the load, and for what share of the values in the literature.

    Takes some minutes, most of them for lift-off.

    Examples:
      python -m fasbody.load_effect --draws 2000 --lift-off-draws 50

      python -m fasbody.load_effect --figures docs/figures --json
    """
    if figures is not None:
        make_folder(figures)
    from fasbody.leg.amplitude import halved
    from fasbody.leg.mechanisms import MECHANISMS, both, feet, lift_off, search

    found = []
    with progress_bar() as progress:
        for number, mechanism in enumerate(MECHANISMS, 1):
            stepped = mechanism.response in (lift_off, both)
            count, rounds = (lift_off_draws, 6) if stepped else (draws, 20)
            name = f"{number}/{len(MECHANISMS)} {mechanism.name}"
            task = progress.add_task(name, total=feet(count, rounds))
            found.append(search(mechanism, count, seed, rounds, partial(progress.advance, task)))
    console.print(_table(found))
    for each in found:
        constants = ", ".join(f"{name} {value:.3g}" for name, value in each.best.items())
        console.print(f"{each.mechanism.name}, best set: {constants}", highlight=False)
    pressed = next(each for each in found if each.mechanism.name == "lift-off")
    amplitudes = halved(pressed.best)
    table = Table(title="Lift-off, best set: what the table's amplitude does")
    for column in (
        "table [m/s²]",
        "added [kg]",
        "MB peak [Hz]",
        "second harmonic there [1]",
        "in the air [%]",
        "period",
    ):
        table.add_column(column, justify="right")
    for row in amplitudes:
        table.add_row(
            f"{row.table:.3g}", f"{row.added_kg:g}", f"{row.peak_hz:g}", f"{row.second:.2f}", f"{100 * row.air:.0f}",
            row.repeats,
        )  # fmt: skip
    console.print(table)
    if figures is not None:
        from fasbody.leg import figures as drawn

        for written in write_figure(
            drawn.mechanisms(found), *(figures / f"leg-mechanisms.{e}" for e in ("svg", "png"))
        ):
            console.print(f"written: {written}")
    if json:
        print_json({
            "seed": seed,
            "mechanisms": [
                {
                    "name": each.mechanism.name, "draws": each.drawn,
                    "share_by_ranges_met": {str(n): each.share(n) for n in (1, 2, 3)},
                    "best": each.best, "best_peaks_hz": each.best_judged.peak_hz[0].tolist(),
                    "best_statements": int(each.best_judged.count[0]),
                }
                for each in found
            ],
            "lift_off_amplitude": [vars(row) for row in amplitudes],
        })  # fmt: skip


def _table(found: "list[Searched]") -> Table:
    from fasbody.leg.mechanisms import spoken
    from fasbody.leg.statements import STATEMENTS

    table = Table(title="Share of each space that meets the measured ranges of MB (15-25, 30-35, 35-40 Hz)")
    headings = (
        "mechanism",
        "draws",
        "one",
        "two",
        "all three",
        "best: peaks [Hz]",
        "statements on MB",
        "all statements",
    )
    for column in headings:
        table.add_column(column, justify="left" if column == "mechanism" else "right")
    about_mb = [s.pair == "MB" for s in STATEMENTS]
    for each in found:
        best = each.best_judged
        table.add_row(
            each.mechanism.name, str(each.drawn), *(f"{100 * each.share(n):.2g} %" for n in (1, 2, 3)),
            ", ".join(f"{hz:g}" for hz in best.peak_hz[0]), f"{best.held[0, about_mb].sum()}/{sum(about_mb)}",
            f"{best.count[0]}/{spoken(each.mechanism)}",
        )  # fmt: skip
    return table


if __name__ == "__main__":
    command_line(app)
