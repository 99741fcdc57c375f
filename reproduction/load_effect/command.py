"""Commands of the load effect, which the leg's command line hands on: load_effect, drop, decide."""

from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from fasbody.console import console, make_folder, print_json, progress_bar
from fasbody.exceptions import SettingError
from fasbody.presentation import ready, write_figure

if TYPE_CHECKING:
    from identification.rivals.mechanism_fit import Confusion
    from reproduction.load_effect.search import Searched

JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]


def load_effect(
    draws: Annotated[int, typer.Option(help="draws from each linear mechanism's space", min=20)] = 20000,
    lift_off_draws: Annotated[
        int,
        typer.Option(help="draws of each mechanism whose pad cannot pull, a tenth of a second each", min=20),
    ] = 400,
    seed: Annotated[int, typer.Option(help="seed of the random numbers", min=0)] = 0,
    figures: Annotated[Path | None, typer.Option(help="folder for leg-mechanisms, as SVG and PNG")] = None,
    json: JsonOption = False,
) -> None:
    """Show which mechanisms can raise the resonance with the load, for published values of the constants.

    Takes some minutes, most of them for lift-off.

    Examples:
      fasbody load effect --draws 2000 --lift-off-draws 50

      fasbody load effect --figures docs/figures --json
    """
    if figures is not None:
        make_folder(figures)
    from reproduction.load_effect.amplitude import halved
    from reproduction.load_effect.search import EXPLANATIONS, feet, search

    searched = []
    with progress_bar() as progress:
        for number, (name, (mechanism, _)) in enumerate(EXPLANATIONS.items(), 1):
            count, rounds = (lift_off_draws, 6) if mechanism.response is None else (draws, 20)
            task = progress.add_task(f"{number}/{len(EXPLANATIONS)} {name}", total=feet(count, rounds))
            searched.append(search(name, count, seed, rounds, partial(progress.advance, task)))
    console.print(_table(searched))
    for result in searched:
        constants = ", ".join(f"{name} {value:.3g}" for name, value in result.best.items())
        console.print(f"{result.name}, best set: {constants}", highlight=False)
    amplitudes = halved(next(result.best for result in searched if result.name == "lift-off"))
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
        from reproduction.load_effect import figures as drawn

        for written in write_figure(
            drawn.mechanisms(searched), *(figures / f"leg-mechanisms.{e}" for e in ("svg", "png"))
        ):
            console.print(f"written: {written}")
    if json:
        print_json({
            "seed": seed,
            "mechanisms": [
                {
                    "name": result.name, "draws": result.drawn,
                    "share_by_ranges_met": {str(n): result.share(n) for n in (1, 2, 3)},
                    "best": result.best, "best_peaks_hz": result.best_judged.peak_hz[0].tolist(),
                    "best_statements": int(result.best_judged.count[0]),
                }
                for result in searched
            ],
            "lift_off_amplitude": [vars(row) for row in amplitudes],
        })  # fmt: skip


def _table(searched: "list[Searched]") -> Table:
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
    for result in searched:
        best = result.best_judged
        table.add_row(
            result.name, str(result.drawn), *(f"{100 * result.share(n):.2g} %" for n in (1, 2, 3)),
            ", ".join(f"{hz:g}" for hz in best.peak_hz[0]), f"{best.held[0, about_mb].sum()}/{sum(about_mb)}",
            f"{best.count[0]}/{result.statements}",
        )  # fmt: skip
    return table


def drop(
    law: Annotated[
        str, typer.Option(help='force law of the pad, as the `user` field of a joint: "2 4884 282 2 0 -1"')
    ] = "",
    json: JsonOption = False,
) -> None:
    """Kinoshita's drop, 5 kg at 0.93 m/s on a heel pad, stepped by MuJoCo with gravity.

    Examples:
      fasbody leg drop

      fasbody leg drop --law "1 30000 43 2.6 1.5 0 -1" --json
    """
    from reproduction.load_effect import drop as dropping

    falls = {law: dropping.drop(dropping.checked(law))} if law else dropping.drops()
    peak, depth, loss = (f"{middle:g} ({low:g}-{high:g})" for low, middle, high in dropping.MEASURED.values())
    measured = f"peak {peak} weights, depth {depth} mm, absorbed {loss} %"
    table = Table(title=f"5 kg dropped at 0.93 m/s; measured: {measured}")
    for column in (
        "pad",
        "peak [weights]",
        "depth [mm]",
        "absorbed [%]",
        "tangent at 43 N [kN/m]",
        "met",
    ):
        table.add_column(column, justify="left" if column == "pad" else "right")
    for name, fall in falls.items():
        values = (fall.peak_g, fall.depth_mm, fall.absorbed_percent, fall.tangent_kn_m)
        table.add_row(name, *(f"{value:.1f}" for value in values), f"{sum(fall.met.values())} of 3")
    console.print(table)
    if json:
        print_json({name: vars(fall) | {"met": fall.met} for name, fall in falls.items()})


def decide(
    subjects: Annotated[int, typer.Option(help="virtual subjects of each of the five mechanisms", min=1)] = 40,
    plans: Annotated[str, typer.Option(help="two (the thesis' protocol, the better one) or all six")] = "two",
    folder: Annotated[Path, typer.Option(help="folder of results; existing ones are reused")] = Path(
        "decide"
    ),
    departure: Annotated[
        float, typer.Option(help="smooth relative error of every mechanism, standard deviation", min=0, max=0.5)
    ] = 0.08,
    seed: Annotated[int, typer.Option(help="seed of the subjects", min=0)] = 0,
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write")] = None,
    json: JsonOption = False,
) -> None:
    """Count how often the analysis names the right mechanism of virtual subjects.

    Takes about five seconds per subject and plan. Stop it with Ctrl-C; the same command then resumes.

    Examples:
      fasbody leg decide --subjects 2 --folder results/decide

      fasbody leg decide --plans all --folder results/decide --figure decide.svg --json
    """
    if plans not in ("two", "all"):
        raise SettingError(f"--plans is {plans!r}, but must be two or all.")
    if figure is not None:
        ready(figure)
    from identification.rivals.mechanism_fit import NONE, UNDECIDED
    from reproduction.load_effect.decide import ALL, PLANS, RIVALS, THESIS, study

    confusions: list[Confusion] = []
    with progress_bar() as progress:
        bar = progress.add_task("virtual subjects", total=subjects * len(RIVALS))
        chosen = (THESIS, ALL) if plans == "two" else PLANS
        for confusions in study(chosen, subjects, folder, seed, departure):  # noqa: B007 - the last one is shown
            progress.advance(bar)
    for result in confusions:
        table = Table(title=f"{result.plan}: {result.right} of {result.subjects} right, {result.wrong} wrong")
        table.add_column("truth")
        for says in (*RIVALS, UNDECIDED, NONE):
            table.add_column(says, justify="right")
        for truth in RIVALS:
            table.add_row(truth, *(str(result.count(truth, says)) for says in (*RIVALS, UNDECIDED, NONE)))
        console.print(table)
    pairs = Table(title="Share of both mechanisms' subjects that are told apart [%]")
    pairs.add_column("pair")
    for result in confusions:
        pairs.add_column(result.plan, justify="right")
    for one, other in combinations(RIVALS, 2):
        pairs.add_row(
            f"{one} | {other}",
            *(f"{100 * result.separated(one, other):.0f}" for result in confusions),
        )
    console.print(pairs)
    console.print(
        "The analysis knows the noise, the scatter of gains and masses and the departure that made the subjects,"
        " and shares their family of models: a real foot is named less surely."
    )
    if figure is not None:
        from reproduction.load_effect import figures

        console.print(f"written: {write_figure(figures.confusion(confusions), figure)[0]}")
    if json:
        print_json(
            {
                "seed": seed,
                "departure": departure,
                "plans": [result.record() for result in confusions],
            }
        )
