"""`fasbody leg name`: which mechanism made a person's recordings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fasbody.console import console, print_json, progress_bar, results
from fasbody.exceptions import FasError, RecordingError, SettingError
from fasbody.presentation import ready, write_figure

if TYPE_CHECKING:
    from fasbody.recording.recording import Recording
    from identification.rivals.naming import Naming, Sines


def name(
    data: Annotated[
        list[Path],
        typer.Argument(metavar="STUDY|FILES...", help="study folder, or recordings of sines"),
    ],
    layout: Annotated[
        Path | None,
        typer.Option("--study", help="study.toml that maps channels, units and sensitivities of files"),
    ] = None,
    subjects: Annotated[
        int,
        typer.Option(help="virtual subjects of each of the five mechanisms, with the same recordings", min=0),
    ] = 4,
    seed: Annotated[int, typer.Option(help="seed of the virtual subjects", min=0)] = 0,
    figure: Annotated[Path | None, typer.Option(help="SVG or PNG to write, of one person")] = None,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Name the mechanism in recordings: constant parameters, stiffening, second mode, lift-off, both, or none.

    Needs recordings of sines under one or more loads; docs/load.md has the best protocol. Virtual
    subjects with the same recordings show how often the mechanism is named correctly. They take a
    second or two each; --subjects 0 omits them.

    Examples:
      fasbody leg name my_study --figure mechanism.svg

      fasbody leg name my_study --subjects 0 --json
    """
    if figure is not None:
        ready(figure)
    from identification.rivals.naming import read

    recordings, unused = _recordings(data, layout)
    people = read(recordings)
    if figure is not None and len(people) > 1:
        raise SettingError(f"--figure shows one person in one posture, and {len(people)} were recorded.")
    named: list[Naming] = []
    for seen in people:
        try:
            named.append(_named(seen, subjects, seed))
        except RecordingError as error:
            unused.append(str(error))
        else:
            results.print(str(named[-1].sheet()), highlight=False, markup=False)
    for text in unused:
        console.print(f"not used: {text}", markup=False, soft_wrap=True)
    if not named:
        raise RecordingError(unused[0] if unused else f"{data[0]} lists no recording.")
    if figure is not None:
        console.print(f"written: {write_figure(named[0].plot(), figure)[0]}")
    if json:
        print_json([result.document() for result in named])


def _recordings(data: list[Path], layout: Path | None) -> "tuple[list[Recording], list[str]]":
    """What can be read of a study or of files, and why other trials of a study cannot."""
    from fasbody.recording.study import StudyFolder, read_file

    if not any(path.is_dir() for path in data):
        return [read_file(path, layout) for path in data], []
    if len(data) > 1 or layout is not None:
        raise SettingError("give one study folder, which has a study.toml of its own, or recordings.")
    study, recordings, unused = StudyFolder.open(data[0]), [], []
    for trial in study.trials:
        try:
            recordings.append(study.read(trial))
        except FasError as error:
            unused.append(str(error))  # the others may still name a mechanism
    return recordings, unused


def _named(seen: "Sines", subjects: int, seed: int) -> "Naming":
    from identification.rivals import naming
    from identification.rivals.mechanisms import MECHANISMS

    total = 1 + subjects * len(MECHANISMS)
    with progress_bar() as progress:
        bar = progress.add_task("mechanisms, then virtual subjects", total=total)
        for count, result in enumerate(naming.name(seen, subjects, seed), 1):  # noqa: B007
            progress.update(bar, completed=count)
    return result
