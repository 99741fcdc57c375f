"""Command `fasbody blackbox`: black-box models of recordings, with what the data cannot tell."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fasbody.console import command_line, console, make_folder, print_json, progress_bar, to_json, write_whole
from fasbody.exceptions import SettingError, unknown
from identification.blackbox.data import ALL, DEFAULT

if TYPE_CHECKING:
    from identification.blackbox.data import Series
    from identification.blackbox.identify import Report

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

EXAMPLES = """
Black-box models of recordings: linear, Hammerstein-Wiener and NARX.

Works on a study folder, on recordings (time_s, base_m_s2, malleolus_m_s2) and on any CSV with two signals. Orders are
chosen by free simulation of a part of the data, or by one-step errors if simulation cannot be used (steps, feedback,
unstable plants). The fit is that of held-out data, which are not used for the choice. Warnings say what the input did
not excite.

Examples:
  fasbody blackbox recording.csv

  fasbody blackbox motor.csv --input volts --output speed --sample-time 0.01

  fasbody blackbox recording.csv --structures oe,ss --orders "oe=4,4,1;ss=4" --json

  fasbody blackbox drifting.csv --detrend 1 --robust --structures oe,bj

  fasbody blackbox plant.csv --input u1,u2 --output y1,y2 --structures arx,ss

  fasbody blackbox study/ --pool --structures oe --out results/
"""


@app.command(help=EXAMPLES)
def main(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="CSV files or study folders")],
    input: Annotated[str, typer.Option(help="input column, by name or number from 1; several with commas")] = "",
    output: Annotated[str, typer.Option(help="output column, by name or number from 1; several with commas")] = "",
    sample_time: Annotated[float | None, typer.Option(help=r"sample time \[s] when there is no time column")] = None,
    structures: Annotated[
        str, typer.Option(help=f"model structures, separated by commas: {', '.join(ALL)}")
    ] = ",".join(DEFAULT),
    orders: Annotated[
        str, typer.Option(help='"auto", or orders as in Table 3.2: "oe=4,4,1;ss=4" (others are selected).')
    ] = "auto",
    split: Annotated[float, typer.Option(help="fraction used for estimation; the rest is held out")] = 0.5,
    pool: Annotated[bool, typer.Option("--pool", help="one model for all recordings")] = False,
    detrend: Annotated[int, typer.Option(help="degree of the polynomials in time to subtract")] = 0,
    robust: Annotated[bool, typer.Option("--robust", help="replace single wrong samples of the output")] = False,
    input_noise: Annotated[
        float, typer.Option(help="RMS noise of the input's sensor, in the unit of the input: widens intervals")
    ] = 0.0,
    json: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
    out: Annotated[
        Path | None, typer.Option(help="folder for report.html, result.json, models.csv, figures and models")
    ] = None,
) -> None:
    """Identify, report, draw."""
    from identification.blackbox import data, report
    from identification.blackbox.identify import identify
    from identification.parameters import names

    several = "," in input + output
    chosen = names(structures.lower()) or ()
    if several:
        from identification.blackbox import mimo

        if pool or robust or input_noise:
            raise SettingError("--pool, --robust and --input-noise are for one input and one output.")
        if not (names(input) and names(output)):
            raise SettingError("several inputs or outputs need both --input and --output.")
        if len(files) != 1:
            raise SettingError("several inputs or outputs are fitted from one file at a time.")
        chosen = mimo.STRUCTURES if chosen == DEFAULT else chosen
    valid = mimo.STRUCTURES if several else ALL
    if not chosen:
        raise SettingError(f"no structure named (valid: {', '.join(valid)}).")
    for name in chosen:
        if name not in valid:
            what = "structure for several inputs or outputs" if several else "structure"
            raise SettingError(unknown(what, name, valid) + ".", setting="structures")
    if not 0.0 < split < 1.0:
        raise SettingError(f"split {split:g} is not between 0 and 1.", setting="split")
    numbers = parse_orders(orders, chosen)
    if out is not None:
        make_folder(out)
    recordings = [
        series for path in files for series in data.read(path, input=input, output=output, sample_time=sample_time)
    ]
    if several:
        _several(recordings[0], chosen, numbers, split, detrend, json, out)
        return
    groups = [recordings] if pool else [[series] for series in recordings]
    reports: list[Report] = []
    with progress_bar() as progress:
        task = progress.add_task("", total=len(groups) * (len(chosen) + 1))
        for group in groups:
            name = group[0].name if len(group) == 1 else f"{len(group)} pooled"

            def step(text: str, name: str = name) -> None:
                progress.update(task, advance=1, description=f"{name}: {text}")

            reports.append(
                identify(group, chosen, numbers, split, step, detrend=detrend, robust=robust, input_noise=input_noise)
            )
    document = report.document(reports)
    if json:
        print_json(document)
    _show(reports, pool)
    if out is not None:
        _write(out, reports, document)


def _several(
    series: "Series", structures: tuple[str, ...], orders: dict[str, tuple[int, ...]],
    split: float, detrend: int, json: bool, out: Path | None,
) -> None:  # fmt: skip
    from identification.blackbox import condition, keep, mimo

    report = mimo.identify(condition.detrend(series, detrend), structures, orders, split)
    console.print(str(report), markup=False, soft_wrap=True)
    if json:
        print_json(report.document())
    if out is not None:
        write_whole(out / "result.json", to_json(report.document()))
        for name, candidate in report.models.items():
            keep.save(candidate.model, out / f"{series.name}_{name}.json")
        console.print(f"written to {out}", markup=False)


def parse_orders(text: str, structures: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Orders by structure from the option's text.

    Raises:
        SettingError: it cannot be read, or names a structure that is not requested.
    """
    if text.strip().lower() == "auto":
        return {}
    orders = {}
    for entry in text.split(";"):
        name, _, numbers = entry.rpartition("=")
        name = name.strip().lower() or (structures[0] if len(structures) == 1 else "")
        if name not in structures:
            problem = unknown("structure", name, structures)
            raise SettingError(f"orders {entry.strip()!r}: {problem}.", setting="orders")
        try:
            orders[name] = tuple(int(number) for number in numbers.split(","))
        except ValueError as error:
            raise SettingError(
                f'orders {entry.strip()!r} are not whole numbers; write them as "oe=4,4,1;ss=4" or "auto".',
                setting="orders",
            ) from error
    return orders


def _show(reports: "list[Report]", pool: bool) -> None:
    from identification.blackbox import report

    for one in reports:
        console.print(report.single_table(one))
        for text in one.notes:
            console.print(f"  [yellow]{text}[/]", soft_wrap=True)
        sentences: dict[str, list[str]] = {}
        for name, chosen in one.models.items():
            for text in chosen.warnings:
                sentences.setdefault(text, []).append(name.upper())
        for text, names in sentences.items():
            console.print(f"  [yellow]{', '.join(names)}:[/] {text}", soft_wrap=True)
        for extra in (one.rational, *(one.rational.warnings if one.rational else ()), one.left_out, *one.failures):
            if extra:
                console.print(f"  {extra}", soft_wrap=True, markup=False)
    if len(reports) > 1:
        console.print(report.thesis_table(reports))
        if not pool and any(one.excitation.single_sine for one in reports):
            console.print("These are single sines: [bold]--pool[/] estimates one model from all of them together.")


def _write(folder: Path, reports: "list[Report]", document: dict[str, object]) -> None:
    from identification.blackbox import figures, keep, report

    write_whole(folder / "result.json", to_json(document))
    write_whole(folder / "report.html", report.page(reports))
    write_whole(folder / "models.csv", report.csv_text(reports))
    for one in reports:
        stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in one.name)
        for name, content in figures.all_figures(one).items():
            write_whole(folder / f"{stem}_{name}.png", content)
        for name, chosen in one.models.items():
            keep.save(chosen.best.model, folder / f"{stem}_{name}.json")
    console.print(f"written to {folder}", markup=False)


if __name__ == "__main__":
    command_line(app)
