"""`python -m reproduction`: run the rows, print them, write docs/reproduction.md."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from fasbody.console import command_line, console, make_folder, print_json, results, write_whole
from fasbody.exceptions import SettingError
from reproduction.book import CHAPTERS, OUTSIDE, ROWS
from reproduction.report import counts, markdown, numbers
from reproduction.row import Row, Verdict
from reproduction.run import ROOT, run_rows

PAGE = ROOT / "docs" / "reproduction.md"
KEPT = ROOT / "results" / "reproduction"
_COLOURS = {
    Verdict.REPRODUCED: "green",
    Verdict.CORRECTED: "cyan",
    Verdict.SYNTHETIC: "blue",
    Verdict.FAILED: "bold red",
}

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    only: Annotated[
        list[str] | None,
        typer.Option(help="id, beginning of an id, or part of a chapter's title; repeat. No page is written then."),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Run every row again, whatever is kept.")] = False,
    jobs: Annotated[int, typer.Option(help="Processes.", min=1, max=64)] = 2,
    page: Annotated[Path, typer.Option(help="Page to write.", show_default="docs/reproduction.md")] = PAGE,
    kept: Annotated[Path, typer.Option(help="Folder of kept results.", show_default="results/reproduction")] = KEPT,
    list_: Annotated[bool, typer.Option("--list", help="Print the ids and what they are; run nothing.")] = False,
    json_: Annotated[bool, typer.Option("--json", help="The results as one JSON document on stdout.")] = False,
) -> None:
    """Run every equation, table, figure and statement of the thesis and say what came of it. Some minutes.

    Results are kept one by one: stop it and start it again, it goes on where it was; rows whose code has changed since
    run again. Exit code 1 if a row failed.

    Examples:
      python -m reproduction

      python -m reproduction --only "Eq. 2.5" --only "Chapter 5" --json

      python -m reproduction --only validation

      python -m reproduction --fresh
    """
    chosen = select(only)
    if list_:
        for row in chosen:
            results.print(f"{row.id}: {row.what}", markup=False)
        return
    make_folder(kept)
    found: dict[str, dict[str, Any]] = {}
    for document in run_rows(chosen, kept, fresh, jobs):
        found[document["id"]] = document
    ordered = {row.id: found[row.id] for row in chosen}
    tally = counts(chosen, ordered)
    if json_:
        print_json({"counts": tally, "rows": list(ordered.values())})
    else:
        show(chosen, ordered)
        results.print(", ".join(f"{count} {verdict}" for verdict, count in tally.items()))
        seconds = sum(document["cpu_seconds"] for document in ordered.values())
        results.print(f"{len(ordered)} rows; they took {seconds:.0f} s of processor time when they ran.")
    if only is None:
        console.print(f"written: {write_whole(page, markdown(ordered))}", soft_wrap=True)
    if str(Verdict.FAILED) in tally:
        raise typer.Exit(1)


def select(only: list[str] | None) -> list[Row]:
    """Rows by id, by the beginning of an id, by one item of it ("Eq. 4.9"), or by a part of a chapter's title.

    Raises:
        SettingError: a name that fits no row.
    """
    if only is None:
        return ROWS
    titles = {row.id: title for title, rows in CHAPTERS.items() for row in rows}
    titles |= {row.id: "Outside data: validation" for row in OUTSIDE}
    wanted: set[str] = set()
    for name in only:
        fits = {row.id for row in ROWS if row.id == name or name in row.numbers}
        low = name.casefold()
        begin = {row.id for row in ROWS if row.id.casefold().startswith(low) or low in titles[row.id].casefold()}
        if not fits | begin:
            raise SettingError(f"no row is called {name!r}; `python -m reproduction --list` prints all ids.")
        wanted |= fits or begin
    return [row for row in ROWS if row.id in wanted]


def show(rows: list[Row], found: dict[str, dict[str, Any]]) -> None:
    """The rows as a table for people."""
    table = Table("id", "came out (asked for)", "verdict")
    for row in rows:
        verdict = Verdict(found[row.id]["verdict"])
        colour = _COLOURS.get(verdict, "yellow")
        table.add_row(row.id, numbers(found[row.id]).replace("[", r"\["), f"[{colour}]{verdict}[/]", end_section=True)
    results.print(table)


if __name__ == "__main__":
    command_line(app)
