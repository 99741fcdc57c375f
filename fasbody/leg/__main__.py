"""Command line of the leg: `python -m fasbody.leg peaks | crosscheck | drop | decide | name --help`."""

from itertools import combinations
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from fasbody.console import command_line, console, make_folder, print_json, progress_bar, results
from fasbody.exceptions import FasError, InputFileError, RecordingError, SettingError
from fasbody.presentation import write_figure

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

ModelOption = Annotated[str, typer.Option(help="shipped leg or MJCF file")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")]


def _ready(figure: Path | None) -> None:
    """Make the folder of a figure before the work that it shows; refuse a folder in its place."""
    if figure is not None:
        make_folder(figure.parent)
        if figure.is_dir():
            raise InputFileError(figure, "is a folder", "name an SVG or PNG file")


@app.command("peaks")
def print_peaks(
    model: ModelOption = "leg",
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write")] = None,
    json: JsonOption = False,
) -> None:
    """Where a leg's MB, TB and TM are highest under 0, 2.3 and 4.5 kg; which statements of the thesis hold.

    Examples:
      python -m fasbody.leg peaks --figure peaks.svg

      python -m fasbody.leg peaks --model my_leg.xml --json
    """
    _ready(figure)
    from fasbody.foot.model import load
    from fasbody.leg.chain import Leg
    from fasbody.leg.peaks import peaks
    from fasbody.leg.statements import STATEMENTS

    foot = load(model)
    result = peaks(Leg.from_model(foot.model, foot.name), foot.name)
    console.print(str(result.sheet()), highlight=False, markup=False)
    if figure is not None:
        from fasbody.leg import figures

        console.print(f"written: {write_figure(figures.peaks(result), figure)[0]}")
    if json:
        stated = zip(STATEMENTS, result.held, strict=True)
        print_json({
            "model": model, "loads": result.records(),
            "statements": [{"section": s.section, "pair": s.pair, "says": s.says, "holds": h} for s, h in stated],
        })  # fmt: skip


@app.command("crosscheck")
def print_crosscheck(
    model: ModelOption = "leg",
    added_mass: Annotated[
        float | None, typer.Option(help=r"\[kg] where the model says that it goes, in place of what the file has there")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Matrices and stepped response of a leg from the equations, Pinocchio and MuJoCo; exit 1 on disagreement.

    Examples:
      python -m fasbody.leg crosscheck --model my_leg.xml --added-mass 4.5
    """
    if added_mass is not None and not 0 <= added_mass <= 50:
        raise SettingError(f"--added-mass is {added_mass:g}, but must be between 0 and 50 kg.")
    from fasbody.leg.crosscheck import RESPONSES, crosscheck

    result = crosscheck(model, added_mass)
    table = Table(title=f"{result.model} with {result.added_mass_kg:g} kg: largest relative difference")
    table.add_column("quantity")
    table.add_column("difference", justify="right")
    for name, value in result.matrices.items():
        table.add_row(name, f"{value:.1e}")
    for frequency, value in result.responses.items():
        table.add_row(f"response stepped at {frequency:g} Hz", f"{value:.1e}")
    console.print(table)
    verdict = "agree" if result.agrees else "DISAGREE"
    console.print(f"The engines {verdict} (matrices {result.limit:.0e}, responses {RESPONSES:.0e}).")
    if result.note:
        console.print(result.note, highlight=False)
    if json:
        print_json(vars(result) | {"agrees": result.agrees, "note": result.note})
    if not result.agrees:
        raise typer.Exit(1)


@app.command("drop")
def print_drop(
    law: Annotated[str, typer.Option(help='of the pad, as the `user` field of a joint: "2 4884 282 2 0 -1"')] = "",
    json: JsonOption = False,
) -> None:
    """Kinoshita's drop, 5 kg at 0.93 m/s on a heel pad, stepped by MuJoCo with gravity.

    Examples:
      python -m fasbody.leg drop

      python -m fasbody.leg drop --law "1 30000 43 2.6 1.5 0 -1" --json
    """
    from fasbody.arch.drop import MEASURED
    from fasbody.leg.drop import checked, drop, drops

    found = {law: drop(checked(law))} if law else drops()
    limits = ", ".join(f"{low:g}-{high:g} ({middle:g})" for low, middle, high in MEASURED.values())
    table = Table(title=f"5 kg dropped at 0.93 m/s; measured {limits}")
    for column in ("pad", "peak [weights]", "depth [mm]", "absorbed [%]", "tangent at 43 N [kN/m]", "met"):
        table.add_column(column, justify="left" if column == "pad" else "right")
    for name, each in found.items():
        values = (each.peak_g, each.depth_mm, each.absorbed_percent, each.tangent_kn_m)
        table.add_row(name, *(f"{value:.1f}" for value in values), f"{sum(each.met.values())} of 3")
    console.print(table)
    if json:
        print_json({name: vars(each) | {"met": each.met} for name, each in found.items()})


@app.command("decide")
def print_decide(
    subjects: Annotated[int, typer.Option(help="virtual subjects of each of the five mechanisms", min=1)] = 40,
    plans: Annotated[str, typer.Option(help="two (the thesis' protocol, the better one) or all six")] = "two",
    folder: Annotated[Path, typer.Option(help="folder of results; what is there is not computed again")] = Path(
        "decide"
    ),
    departure: Annotated[
        float, typer.Option(help="how far a foot departs from every mechanism [1]", min=0, max=0.5)
    ] = 0.08,
    seed: Annotated[int, typer.Option(help="seed of the subjects", min=0)] = 0,
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write")] = None,
    json: JsonOption = False,
) -> None:
    """Which mechanism made a recording: how often an analysis of virtual subjects names the right one.

    Takes two seconds per subject and plan. Ctrl-C stops it, and the same command goes on.

    Examples:
      python -m fasbody.leg decide --subjects 2 --folder results/decide

      python -m fasbody.leg decide --plans all --folder results/decide --figure decide.svg --json
    """
    if plans not in ("two", "all"):
        raise SettingError(f"--plans is {plans!r}, but must be two or all.")
    _ready(figure)
    from fasbody.leg.decide import ALL, NONE, PLANS, RIVALS, THESIS, UNDECIDED, Confusion, study

    found: list[Confusion] = []
    with progress_bar() as progress:
        bar = progress.add_task("virtual subjects", total=subjects * len(RIVALS))
        chosen = (THESIS, ALL) if plans == "two" else PLANS
        for found in study(chosen, subjects, folder, seed, departure):  # noqa: B007 - the last one is shown
            progress.advance(bar)
    for each in found:
        table = Table(title=f"{each.plan}: {each.right} of {each.subjects} right, {each.wrong} wrong")
        table.add_column("truth")
        for says in (*RIVALS, UNDECIDED, NONE):
            table.add_column(says, justify="right")
        for truth in RIVALS:
            table.add_row(truth, *(str(each.count(truth, says)) for says in (*RIVALS, UNDECIDED, NONE)))
        console.print(table)
    pairs = Table(title="Share of both mechanisms' subjects that are told apart [%]")
    pairs.add_column("pair")
    for each in found:
        pairs.add_column(each.plan, justify="right")
    for one, other in combinations(RIVALS, 2):
        pairs.add_row(f"{one} | {other}", *(f"{100 * each.told_apart(one, other):.0f}" for each in found))
    console.print(pairs)
    console.print(
        "The analysis knows the noise, the scatter of gains and masses and the departure that made the subjects,"
        " and shares their family of models: a real foot is named less surely."
    )
    if figure is not None:
        from fasbody.leg import figures

        console.print(f"written: {write_figure(figures.confusion(found), figure)[0]}")
    if json:
        print_json({"seed": seed, "departure": departure, "plans": [each.record() for each in found]})


@app.command("name")
def print_name(
    data: Annotated[list[Path], typer.Argument(metavar="STUDY|FILES...", help="study folder, or recordings of sines")],
    layout: Annotated[
        Path | None, typer.Option("--study", help="study.toml that maps channels, units and sensitivities of files")
    ] = None,
    subjects: Annotated[
        int, typer.Option(help="virtual subjects of each of the five mechanisms, shaken in the same way", min=0)
    ] = 4,
    seed: Annotated[int, typer.Option(help="seed of the virtual subjects", min=0)] = 0,
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write, of one person")] = None,
    json: JsonOption = False,
) -> None:
    """Name the mechanism that made a person's recordings: a second mode, stiffening, lift-off, both, or none of these.

    Takes sines under any loads, best as docs/load.md asks for them. Then virtual subjects are shaken as the person was,
    to count how many of them are named correctly; a second or two each. --subjects 0 leaves them out.

    Examples:
      python -m fasbody.leg name my_study --figure mechanism.svg

      python -m fasbody.leg name my_study --subjects 0 --json
    """
    _ready(figure)
    from fasbody.leg.decide import RIVALS
    from fasbody.leg.naming import Naming, name, read
    from fasbody.recording.study import StudyFolder, read_file

    if any(p.is_dir() for p in data) and (len(data) > 1 or layout is not None):
        raise SettingError("give one study folder, which has a study.toml of its own, or recordings.")
    unreadable: list[str] = []
    if data[0].is_dir():
        study, recordings = StudyFolder.open(data[0]), []
        for trial in study.trials:
            try:
                recordings.append(study.read(trial))
            except FasError as error:
                unreadable.append(str(error))  # the others may still name a mechanism
    else:
        recordings = [read_file(p, layout) for p in data]
    people = read(recordings)
    if figure is not None and len(people) > 1:
        raise SettingError(f"--figure shows one person in one posture, and {len(people)} were recorded.")
    found: list[Naming] = []
    for seen in people:
        try:
            with progress_bar() as progress:
                bar = progress.add_task("mechanisms, then virtual subjects", total=1 + subjects * len(RIVALS))
                for at, result in enumerate(name(seen, subjects, seed), 1):  # noqa: B007 - the last one is shown
                    progress.update(bar, completed=at)
        except RecordingError as error:
            unreadable.append(str(error))
            continue
        found.append(result)
        results.print(str(result.sheet()), highlight=False, markup=False)
    for text in unreadable:
        console.print(f"not used: {text}", markup=False, soft_wrap=True)
    if not found:
        raise RecordingError(unreadable[0] if unreadable else f"{data[0]} lists no recording.")
    if figure is not None:
        console.print(f"written: {write_figure(found[0].plot(), figure)[0]}")
    if json:
        print_json([result.document() for result in found])


if __name__ == "__main__":
    command_line(app)
