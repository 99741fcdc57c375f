"""`fasbody arch validate`: each published number predicted from the others, and the proofs."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from fasbody.console import console, print_json, progress_bar
from fasbody.presentation import ready, write_figure

if TYPE_CHECKING:
    from reproduction.arch_validation.proofs import Proof
    from reproduction.arch_validation.validate import Validation


def validate(
    steps: Annotated[int, typer.Option(help="steps of each Markov chain", min=20)] = 2400,
    walkers: Annotated[int, typer.Option(help="Markov chains that run at once in each fit", min=8)] = 64,
    seed: Annotated[int, typer.Option(help="seed of the random numbers", min=0)] = 0,
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write")] = None,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Predict each published measurement of feet from the others, and show which are excluded under stated assumptions.

    Takes two minutes or more.

    Examples:
      fasbody arch validate --figure docs/figures/validation.svg

      fasbody arch validate --steps 200 --json
    """
    if figure is not None:
        ready(figure)
    from reproduction.arch_validation import validate as validation
    from reproduction.arch_validation.proofs import proofs

    with progress_bar() as progress:
        proving = progress.add_task("bounds", total=None)
        bounds = proofs()
        progress.remove_task(proving)
        task = progress.add_task("legs", total=steps)
        tick = lambda: progress.advance(task)  # noqa: E731
        result = validation.validate(walkers=walkers, steps=steps, seed=seed, tick=tick)
    console.print(_validation_table(result))
    for note in result.sheet().notes:
        console.print(note)
    console.print(_proof_table(bounds))
    if figure is not None:
        console.print(f"written: {write_figure(result.plot(), figure)[0]}")
    if json:
        print_json(
            {
                "seed": seed,
                "numbers": result.records(),
                "proofs": [vars(proof) | {"excluded": proof.excluded} for proof in bounds],
            }
        )


def _validation_table(result: "Validation") -> Table:
    """A line for each published value, within 80 columns."""
    caption = "shipped: the set in foot_arch.xml; * fitted to it; ! outside the published range"
    table = Table(title=result.sheet().title, caption=caption, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("number")
    for column in ("published", "predicted", "95 %"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("shipped", justify="right", no_wrap=True)
    for p in result.predictions:
        n, mark = p.number, "*" * p.number.fitted + "!" * (not p.shipped_meets)
        name = f"{n.source.split(',')[0]}: {n.name}" + (f" [{n.unit}]" if n.unit else "")
        lines = (
            [f"{low:.3g}\u2013{high:.3g}" for low, high in zip(n.low, n.high, strict=True)],
            [f"{value:.3g}" for value in p.middle],
            [f"{low:.3g}\u2013{high:.3g}" for low, high in zip(p.low, p.high, strict=True)],
            [p.verdict],
            [f"{value:.3g}{mark}" for value in p.shipped],
        )
        table.add_row(escape(name), *("\n".join(cell) for cell in lines))
    return table


def _proof_table(bounds: Sequence["Proof"]) -> Table:
    table = Table(title="What rigid bones cannot do, whatever the springs", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("number", "bound", "needed", "excluded by", "for", "proved"):
        table.add_column(column, justify="right" if column == "needed" else "left", overflow="fold")
    for proof in bounds:
        sign = "\u2265" if proof.above else "\u2264"
        table.add_row(proof.number, f"{sign} {proof.bound:.3g} {proof.unit}", f"{proof.needed:.3g}", proof.against,
                      proof.holds, "yes" if proof.excluded else "no")  # fmt: skip
    return table
