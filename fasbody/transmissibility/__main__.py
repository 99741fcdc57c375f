"""`fasbody transmissibility STUDY`: the table, the statistics and the figures of Chapter 2."""

from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from fasbody.console import command_line, console, make_folder, print_json, results, write_whole
from fasbody.exceptions import RecordingError, SettingError, pip_install
from fasbody.page import print_table

if TYPE_CHECKING:
    from fasbody.transmissibility.findings import Finding
    from fasbody.transmissibility.table import Condition, Curves, Table

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
_ENDINGS = ("svg", "png", "pdf")


@app.command()
def main(
    data: Annotated[list[Path], typer.Argument(metavar="STUDY|FILES...", help="study folder, or recordings")],
    study: Annotated[
        Path | None, typer.Option("--study", help="study.toml that maps channels, units and sensitivities of files")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for tables and figures (default results/NAME)")] = None,
    json_: Annotated[
        bool, typer.Option("--json", help="print one JSON document on stdout; files only with --out")
    ] = False,
    figure_format: Annotated[str, typer.Option("--figures", help="svg, png or pdf")] = "png",
    resolution: Annotated[float, typer.Option(help="spacing of frequencies in Hz, for broadband excitation")] = 1.0,
    estimate: Annotated[
        str, typer.Option(help="for broadband excitation: best (by periods, or local models), H1, H2 or Hv by Welch")
    ] = "best",
    model: Annotated[
        str | None,
        typer.Option(help="groups and covariates of subjects.csv for a mixed model: 'group * added_mass_kg + age_yr'"),
    ] = None,
    jobs: Annotated[int, typer.Option(help="processes; 0 for all cores")] = 0,
) -> None:
    """Transmissibility between base, malleolus and tuberosity by load and posture, with statistics and figures.

    Exit code 2 if a recording cannot be used; the results of the others are still written.

    Examples:
      fasbody transmissibility my_study --out results/my_study

      fasbody transmissibility my_study --model "group * added_mass_kg + age_yr"

      fasbody transmissibility 20hz.csv --json

      fasbody transmissibility 20hz.tdms 30hz.tdms --study study.toml
    """
    from fasbody.recording.study import StudyFolder, read_file
    from fasbody.recording.trials import people, posture_remarks
    from fasbody.transmissibility.table import Table

    if figure_format not in _ENDINGS:
        raise SettingError(f"figures cannot be {figure_format!r} (valid: {', '.join(_ENDINGS)}).")
    if not 0.05 <= resolution <= 20:
        raise SettingError(f"--resolution {resolution:g} makes no curve (valid: 0.05 to 20 Hz).")
    path = data[0]
    if any(p.is_dir() for p in data) and (len(data) > 1 or study is not None):
        raise SettingError("give one study folder, which has a study.toml of its own, or recordings.")
    if model is not None and not path.is_dir():
        raise SettingError("--model needs a study folder, whose subjects.csv has the groups and covariates.")
    folder = out or (None if json_ else Path("results") / path.resolve().stem)
    opened = StudyFolder.open(path) if path.is_dir() else [read_file(p, study) for p in data]
    if folder is not None:
        make_folder(folder)  # before the work: a folder that cannot be written costs no time
    if isinstance(opened, StudyFolder):
        for remark in posture_remarks(opened.trials):
            console.print(f"[yellow]warning:[/] {escape(remark)}", soft_wrap=True)
        table = Table.of(opened, resolution, jobs, estimate)
    else:
        table = Table.of_recordings(opened, resolution, estimate)
    terms = ""
    if model is not None:  # before anything is printed: it may be refused
        from fasbody.transmissibility.comparisons import mixed

        terms = mixed(table, people(path), model).to_csv(index=False, float_format="%.6g")
    if json_:
        print_json(table.frame.to_dict("records"))
    else:
        show(table)
    console.print(f"Standard errors include {table.covers}.", markup=False, soft_wrap=True)
    if remark := table.resolved(resolution):
        console.print(f"[yellow]warning:[/] {escape(remark)}", soft_wrap=True)
    if folder is not None:
        write(table, folder, figure_format)
        if terms:
            write_whole(folder / "mixed.csv", terms)
        console.print(f"tables and figures in [bold]{escape(str(folder))}[/]", soft_wrap=True)
    for problem in table.problems:
        console.print(f"not used: {problem}", markup=False, soft_wrap=True)
    if table.problems:
        total = len(table.problems) + table.frame["file"].nunique()
        raise RecordingError(f"{len(table.problems)} of {total} recordings could not be used; they are named above.")


def show(table: "Table") -> None:
    """Mean curves, resonance ranges and the findings, for people."""
    from fasbody.transmissibility.findings import judged

    results.print(str(table))
    several = len({c.posture for c in table.each()}) > 1  # a single one may be the default, stated by nobody
    for (pair, posture), group in groupby(table.each(), lambda c: (c.pair, c.posture)):
        curves = list(group)
        every = sorted({float(f) for c in curves for f in c.frequency_hz})
        drawn = every[:: max(1, round(len(every) / 9))]
        rows = [(f"{f:g} Hz", *(_at(c, f) for c in curves)) for f in drawn]
        if any(c.resonance.tested for c in curves):
            rows.append(("resonance, rule of the thesis", *(str(c.resonance) for c in curves)))
            rows.append(("resonance, controlled error rates", *(str(c.resonance_by_tests) for c in curves)))
        loads = [f"{c.added_mass_kg:g} kg{_people(c)}" for c in curves]
        of = f"{pair}, {posture}" if several else pair
        results.print(f"\n{of}: mean transmissibility (phase [deg]) by load", markup=False)
        print_table(("frequency", *loads), rows)
    results.print("MB: malleolus over base. TB: tuberosity over base. TM: tuberosity over malleolus.")
    stated, why = judged(table)
    if stated:
        show_findings(stated, table.origin)
    else:
        results.print(f"Statistical tests are left out: {why}.")


def _at(c: "Curves", f: float) -> str:
    """Mean transmissibility and phase at a frequency [Hz]."""
    at = c.frequency_hz.searchsorted(f)
    if at >= c.frequency_hz.size or c.frequency_hz[at] != f:
        return "–"
    return f"{c.mean[at]:.2f} ({c.mean_phase_deg[at]:.0f})"


def _people(c: "Curves") -> str:
    """How many subjects, and how many of them were tested for a resonance."""
    tested, count = c.resonance.subjects, len(c.subjects)
    partly = f", {tested} tested" if c.resonance.tested and tested < count else ""
    return f" (n = {count}{partly})"


def show_findings(stated: list["Finding"], origin: str) -> None:
    """What sections 2.3 and 2.4 state, beside what came out."""
    from rich.table import Table as Printed

    from fasbody.transmissibility.findings import summary

    printed = Printed("section", "the thesis states", f"this study ({origin})", "holds", "note")
    colours = {"yes": "green", "no": "red", "not tested": "yellow"}
    for f in stated:
        printed.add_row(f.section, f.says, f.came_out, f"[{colours[f.verdict]}]{f.verdict}[/]", f.note)
    results.print(printed)
    results.print(summary(stated))
    if origin == "synthetic":
        results.print("The virtual subjects were calibrated to these statements: agreement is no evidence for them.")


def write(table: "Table", folder: Path, figure_format: str) -> None:
    """Tables as CSV, curves as NetCDF where xarray is installed, statistics, and the figures."""
    import importlib.util

    import pandas as pd

    from fasbody.presentation import picture
    from fasbody.transmissibility import comparisons, figures
    from fasbody.transmissibility.findings import judged

    def keep(name: str, frame: pd.DataFrame, **form: str) -> None:
        write_whole(folder / f"{name}.csv", frame.to_csv(index=False, **form))

    write_whole(folder / "transmissibility.csv", table.csv())
    several = table.frame["subject"].nunique() >= 3
    if several:
        keep("resonances", comparisons.resonances(table))
    stated, _ = judged(table)
    if stated:
        keep("findings", pd.DataFrame(stated))
    if importlib.util.find_spec("xarray") and importlib.util.find_spec("h5netcdf"):
        write_whole(folder / "transmissibility.nc", table.netcdf())
    else:
        console.print(f"transmissibility.nc is not written; it needs {pip_install('statistics')}", markup=False)
    sets = comparable(table)
    if several:
        keep("against_unity", comparisons.against_unity(table), float_format="%.6g")
        for name, conditions in sets.items():
            if len(conditions) > 1:
                keep(f"between_{name}", comparisons.between(table, conditions), float_format="%.6g")
                keep(f"pairs_{name}", comparisons.pairwise(table, conditions), float_format="%.6g")
    fine = table.frame["frequency_hz"].nunique() > 25
    for name, conditions in sets.items():
        drawn = {f"{name}_mean": figures.spectrum(table, conditions) if fine else figures.means(table, conditions)}
        if not fine:
            drawn |= {f"{name}_{pair}": figures.subjects(table, pair, conditions) for pair in table.pairs}
        for stem, figure in drawn.items():
            write_whole(folder / f"{stem}.{figure_format}", picture(figure, figure_format))
    write_whole(folder / f"single_mass.{figure_format}", picture(_single_mass(table), figure_format))


def comparable(table: "Table") -> dict[str, list["Condition"]]:
    """Conditions that belong into one figure: loads in one posture, postures under one load."""
    conditions = table.conditions
    posture, load = conditions[0]
    sets = {
        "loads": [c for c in conditions if c[0] == posture],
        "postures": [c for c in conditions if c[1] == load],
    }
    if len(sets["postures"]) == 1:
        del sets["postures"]
    elif len(sets["loads"]) == 1:
        del sets["loads"]
    left = [c for c in conditions if not any(c in s for s in sets.values())]
    return sets | ({"others": left} if left else {})


def _single_mass(table: "Table"):  # type: ignore[no-untyped-def]
    """Figure 2.10 with the study's own mean MB in it, unloaded or of the first condition."""
    import numpy as np

    from fasbody.constants import Z95
    from fasbody.transmissibility import figures, sdof

    condition = table.conditions[0]
    c = table.curves("MB", *condition)
    std = figures.half_interval(c.T) / Z95  # the figure takes it times that
    if not np.isfinite(std).all():
        rows = table.frame[table.frame["pair"] == "MB"].groupby("frequency_hz")["transmissibility_std"].mean()
        std = np.maximum(rows.reindex(c.frequency_hz).to_numpy(), 0.01)
    drawn = [f for f in (10.0, 20.0, 30.0, 40.0) if f in c.frequency_hz] or [float(c.frequency_hz[0])]
    place = [int(np.flatnonzero(c.frequency_hz == f)[0]) for f in drawn]
    measured = {f: (float(c.mean[i]), float(std[i])) for f, i in zip(drawn, place, strict=True)}
    count = len(c.subjects)
    what = f"mean MB of {count} subjects (95 % interval)" if count > 1 else "MB of one subject (95 % by its noise)"
    load = f" and the load of {condition[1]:g} kg" if condition[1] else ""
    origin = f"{table.origin} {what}, {c.condition}; mass: foot and shank of the thesis{load}"
    return figures.single_mass(drawn, sdof.MASS_KG + condition[1], measured, origin)


if __name__ == "__main__":
    command_line(app)
