"""`fasbody recording`: check what a file holds, convert it to another format, init a study of a folder."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from fasbody.console import command_line, console, print_json, results, to_json, write_whole
from fasbody.exceptions import FasError, InputFileError, RecordingError, SettingError, unknown
from fasbody.presentation import counted

if TYPE_CHECKING:
    from fasbody.recording.channels import Layout
    from fasbody.recording.recording import Recording

#: Of more recordings only those are listed that are not sound.
_MANY = 100

#: Kinds of files, by what their columns are used for, that are listed.
_LEDGERS = 6

#: Columns that a narrow terminal goes without, in this order, before and after the rms of the channels.
_SPARED = ("samples", "rate [Hz]"), ("phase [deg]", "T")

app: typer.Typer = typer.Typer(add_completion=False, pretty_exceptions_enable=False, no_args_is_help=True)

_Columns = Annotated[
    str | None, typer.Option("--columns", help="columns of a text file without a header, separated by commas")
]
_Study = Annotated[Path | None, typer.Option("--study", help="study.toml that maps channels, units and sensitivities")]
_Take = Annotated[int | None, typer.Option("--take", min=1, help="which recording of a file that holds several")]


@app.callback()
def main() -> None:
    """Recordings: check how a file is read, convert it, make a study from a folder.

    Examples:
      fasbody check my_study
    """


@app.command()
def check(
    paths: Annotated[
        list[Path], typer.Argument(help="recordings (CSV, Excel, MAT, HDF5, UFF, TDMS ...) or a study folder")
    ],
    study: _Study = None,
    columns: _Columns = None,
    take: _Take = None,
    report: Annotated[Path | None, typer.Option(help="write a page with one second of each recording, .html")] = None,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
    jobs: Annotated[int, typer.Option(help="processes for a study; 0 for all cores")] = 0,
) -> None:
    """Show how recordings or a study are read, and what is wrong with them.

    Exit code 2 if any recording cannot be used.

    Examples:
      fasbody check measured.tdms --study study.toml --json

      fasbody check bare.log --columns time_s,base_g,malleolus_g --report check.html
    """
    from fasbody.heel.study import is_heel_study
    from fasbody.recording.checks import reasons
    from fasbody.recording.report import write as write_report
    from fasbody.recording.study import StudyFolder, understood_trial
    from fasbody.recording.together import out_of_line
    from fasbody.recording.trials import posture_remarks
    from fasbody.runner import run

    if report is not None and report.suffix.lower() not in (".html", ".htm"):
        raise InputFileError(report, f"has the ending {report.suffix!r}", "a report is written as .html")

    rows: list[dict[str, Any]] = []
    path = paths[0]
    if len(paths) > 1 and any(p.is_dir() for p in paths):
        raise SettingError("check takes one study folder, or recordings; give the folders one by one.")
    if path.is_dir() and is_heel_study(path):
        _check_heel(path, json_)
        return
    if path.is_dir():
        folder = StudyFolder.open(path)
        _warn(posture_remarks(folder.trials))
        light = replace(folder, trials=())  # what a process needs besides its trial
        tasks = [(light, trial, report is not None) for trial in folder.trials]
        by_number = dict(run(understood_trial, tasks, "checking", jobs))
        rows += [by_number[i] for i in range(len(by_number))]
    else:
        layout = _layout(study, columns, take)
        rows += [_of_file(one, layout, report is not None) for one in paths]
    _warn(out_of_line(rows))
    if report is not None:
        write_report(report, f"Recordings of {path.name}" if path.is_dir() else "Recordings", rows)
        rows = [{key: value for key, value in row.items() if key != "excerpt"} for row in rows]
    if json_:
        print_json({"path": str(path), "recordings": rows})
    else:
        _show(rows)
        _by_subject(rows)
    wrong = [row for row in rows if row["problem"]]
    if len(wrong) == 1:
        raise RecordingError(wrong[0]["problem"])
    if wrong:
        for text in reasons(rows):
            console.print(text, markup=False, soft_wrap=True)
        raise RecordingError(f"{len(wrong)} of {counted(len(rows), 'recording')} cannot be used.")


def _warn(remarks: Iterable[str]) -> None:
    for text in remarks:
        console.print(f"[yellow]warning:[/] {escape(text)}", soft_wrap=True)


def _remarks(recording: "Recording") -> Sequence[str]:
    """What the checks remark on a recording, or why it cannot be used."""
    from fasbody.recording.checks import checked

    try:
        return checked(recording).warnings
    except RecordingError as error:
        return (f"It cannot be used as it is. {error}",)


def _of_file(file: Path, layout: "Layout | None", drawn: bool) -> dict[str, Any]:
    from fasbody.recording.checks import understood
    from fasbody.recording.report import excerpt
    from fasbody.recording.study import read_bare

    try:
        recording = read_bare(file, layout)
    except FasError as error:
        return {"file": file.name, "problem": error.sentence}
    return understood(recording) | ({"excerpt": excerpt(recording)} if drawn else {})


def _by_subject(rows: list[dict[str, Any]]) -> None:
    """Quality of a study by subject: how many recordings serve, and the worst of what is told of them."""
    from fasbody.page import print_table
    from fasbody.recording.checks import QUALITIES, quality_cells, verdict

    subjects = list(dict.fromkeys(row["subject"] for row in rows if row.get("subject")))
    if len(subjects) < 2:
        return
    heads = ("subject", "recordings", "sound", "unusable", *(f"worst {name}" for name in QUALITIES))
    lines = []
    for subject in subjects:
        mine = [row for row in rows if row.get("subject") == subject]
        verdicts = [verdict(row) for row in mine]
        known = [[float(cell) for cell in cells if cell] for cells in zip(*map(quality_cells, mine), strict=True)]
        worst = [f"{(max if i else min)(values):.4g}" if values else "" for i, values in enumerate(known)]
        lines.append(
            (escape(subject), str(len(mine)), str(verdicts.count("sound")), str(verdicts.count("unusable")), *worst)
        )
    print_table(heads, lines, ("subject",))


def _check_heel(path: Path, json_: bool) -> None:
    """The same of a study of heel strikes: strikes by person and speed, and a sentence on each that cannot serve."""
    from fasbody.heel.study import HeelStudy
    from fasbody.page import show
    from fasbody.presentation import Sheet

    study = HeelStudy.read(path)
    rows = [
        {"subject": subject, "speed": speed, "strikes": len(strikes)}
        for (subject, speed), strikes in study.groups().items()
    ]
    if json_:
        about = {name: getattr(study, name) for name in ("origin", "doi", "licence")}
        counts = {"strikes": len(study.strikes), "persons": rows, "problems": list(study.problems)}
        print_json({"path": str(path), "kind": "heel strikes"} | about | counts)
        return
    results.print(
        f"{study}; licence: {study.licence or 'not said'}; doi: {study.doi or 'none'}", markup=False, soft_wrap=True
    )
    cells = [tuple(map(str, row.values())) for row in rows]
    show(Sheet("", ("subject", "speed", "strikes"), cells), "subject", "speed")
    for problem in study.problems:
        console.print(problem, style="yellow", markup=False, soft_wrap=True)


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="the recording to read")],
    target: Annotated[Path, typer.Argument(help="file to write: .csv, .mat, .h5, .uff or .tdms")],
    study: _Study = None,
    columns: _Columns = None,
    take: _Take = None,
    matlab: Annotated[
        str | None, typer.Option(help="version of a .mat file: 5 (default), or 7.3 (which is HDF5)")
    ] = None,
) -> None:
    """Convert a recording to another format, in m/s^2, with signs, sensitivities and delays applied.

    A recording that cannot be analysed is converted, too, with a warning.

    Examples:
      fasbody convert measured.tdms measured.csv --study study.toml

      fasbody convert session.csv second.csv --take 2
    """
    from fasbody.recording.recording import Recording

    if target.exists():
        raise InputFileError(target, "exists", "name a new file")
    if matlab not in (None, "5", "7.3"):
        raise SettingError(f"--matlab {matlab} is not written (valid: 5, 7.3).")
    if matlab and target.suffix.lower() != ".mat":
        raise SettingError(f"--matlab {matlab} is for .mat files, and {target} is not one.")
    recording = Recording.read(source, layout=_layout(study, columns, take))
    recording.write(target, matlab or "5")
    _warn(_remarks(recording))
    console.print(
        f"{recording.time_s.size} samples of {len(recording.channels) - 1} channels in {target}", markup=False
    )


@app.command()
def merge(
    table: Annotated[Path, typer.Argument(help="recording of the logger on the shaker's table")],
    foot: Annotated[Path, typer.Argument(help="recording of the logger on the foot, made at the same time")],
    target: Annotated[
        Path, typer.Argument(help="file to write (.csv); a .json file beside it gets the delay and its uncertainty")
    ],
    base: Annotated[str, typer.Option(help="column of the table's file (default: the one named base)")] = "",
    malleolus: Annotated[str, typer.Option(help="column of the foot's file (default: the one named malleolus)")] = "",
    way: Annotated[str, typer.Option(help="knock or correlation (default: a knock, if there is one)")] = "",
    study: _Study = None,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Merge the recordings of two loggers, one on the foot and one on the table, aligned by knocks.

    Phases and fits of the merged recording include the uncertainty of the delay.

    Examples:
      fasbody merge table.csv foot.csv merged.csv --base z --malleolus z
    """
    from fasbody.recording.files import read_one
    from fasbody.recording.merge import WAYS
    from fasbody.recording.merge import merge as merged

    if way and way not in WAYS:
        raise SettingError(f"{unknown('way to merge', way, WAYS)}.")
    if target.suffix.lower() != ".csv":
        raise InputFileError(target, f"has the ending {target.suffix!r}", "a merged recording is written as .csv")
    layout = _layout(study, None, None)
    t, u, of_table = read_one(table, "base", layout, base)
    s, y, of_foot = read_one(foot, "malleolus", layout, malleolus)
    made = merged(t, u, s, y, way, target.name)
    made.recording.write(target)
    warnings = [f"{target.name} is made of two loggers, {made}.", *of_table, *of_foot]
    about = {
        "delay_s": made.delay_s, "delay_std_s": {"malleolus": made.delay_std_s}, "clock": made.clock, "way": made.way,
        "warnings": warnings,
    }  # fmt: skip
    write_whole(target.with_suffix(".json"), to_json(about))
    _warn([*of_table, *of_foot, *_remarks(made.recording)])  # files the wrong way round make the malleolus lead
    if json_:
        print_json(about)
    else:
        results.print(f"{made}; written to {target}", markup=False, soft_wrap=True)


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="folder of the recordings, also in subfolders")],
    pattern: Annotated[
        str | None,
        typer.Option(help="pattern of the file names, with {subject}, {posture}, {load}, {frequency}, {any}"),
    ] = None,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Make a study from a folder of recordings: write study.toml, subjects.csv and recordings.csv.

    File names are scanned and one file of each kind is read. Nothing is overwritten; an existing study gets a line
    for each new recording.

    Examples:
      fasbody study init my_study

      fasbody study init my_study --pattern "S{subject}_{frequency}Hz_{load}kg"
    """
    from fasbody.recording.proposal import propose

    proposal = propose(folder, pattern)
    proposal.write()
    if json_:
        keys = ("pattern", "count", "left_out", "missing")
        print_json({"folder": str(folder)} | {key: getattr(proposal, key) for key in keys})
        return
    results.print(f"{counted(proposal.count, 'recording')} named {proposal.pattern}", markup=False, soft_wrap=True)
    if proposal.left_out:
        named = ", ".join(proposal.left_out[:5]) + (" ..." if len(proposal.left_out) > 5 else "")
        results.print(f"left out, named otherwise: {len(proposal.left_out)} ({named})", markup=False, soft_wrap=True)
    if not proposal.tables:
        results.print(f"{folder} lists them all; nothing is added.", markup=False, soft_wrap=True)
        return
    results.print(f"written: {', '.join(proposal.tables)} in {folder}; still missing:", markup=False, soft_wrap=True)
    for text in proposal.missing:
        results.print(f"  {text}", markup=False, soft_wrap=True)


def _layout(study: Path | None, columns: str | None, take: int | None) -> "Layout | None":
    from fasbody.recording.channels import Layout
    from fasbody.recording.trials import describe

    layout = None if study is None else describe(study)[1]
    if columns is not None:
        layout = replace(layout or Layout(), columns=tuple(name.strip() for name in columns.split(",")))
    return layout if take is None else replace(layout or Layout(), take=take)


def _show(rows: list[dict[str, Any]]) -> None:
    from fasbody.page import print_table
    from fasbody.recording.checks import QUALITIES, cells, verdict

    colours = {"unusable": "red", "usable, see below": "yellow", "sound": "default"}
    read = list(dict.fromkeys(name for row in rows for name in row.get("rms_m_s2", {})))
    felt = [f"{name} rms [m/s²]" for name in read]
    heads = ["file", "verdict", "samples", "rate [Hz]", "excitation [Hz]", "T", "phase [deg]", *felt, *QUALITIES]
    folders = {str(Path(row["file"]).parent) for row in rows}
    names = {row["file"]: Path(row["file"]).name if len(folders) == 1 else row["file"] for row in rows}
    lines = []
    listed = [row for row in rows if len(rows) <= _MANY or verdict(row) != "sound"]
    for row in listed:
        word = f"[{colours[verdict(row)]}]{verdict(row).partition(',')[0]}[/]"
        line = cells(row) | {"file": escape(names[row["file"]]), "verdict": word}
        lines.append([line.get(head, "") for head in heads])
    if listed:
        print_table(heads, lines, ("file", "verdict"), (*_SPARED[0], *felt, *_SPARED[1]))
    if len(listed) < len(rows):
        results.print(f"{len(rows) - len(listed)} more recordings are sound (--json lists them).", markup=False)
    alike: dict[tuple[tuple[str, ...], tuple[str, ...]], list[str]] = {}
    for row in rows:
        if row.get("used"):
            alike.setdefault((row["used"], row["unused"]), []).append(names[row["file"]])
        for text in row.get("warnings", []):
            console.print(text, markup=False, soft_wrap=True)
    for (used, unused), files in list(alike.items())[:_LEDGERS]:
        of = "" if len(rows) == 1 else f"{', '.join(files[:3])}{f' and {len(files) - 3} more' * (len(files) > 3)}: "
        left = f"not used: {'; '.join(unused)}" if unused else "all columns are used"
        results.print(f"{of}{'; '.join(used)}\n{left}", markup=False, soft_wrap=True)
    if len(alike) > _LEDGERS:
        results.print(f"{len(alike) - _LEDGERS} more kinds of files (--json lists them, --report draws them).")


if __name__ == "__main__":
    command_line(app)
