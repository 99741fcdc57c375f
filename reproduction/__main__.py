"""`python -m reproduction`: run the rows, print them, write docs/reproduction.md."""

from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import typer

from fasbody.console import command_line, console, make_folder, print_json, results, write_whole
from fasbody.exceptions import InputFileError, SettingError
from fasbody.runner import ROOT
from reproduction.row import Row, Verdict

PAGE = ROOT / "docs" / "reproduction.md"
KEPT = ROOT / "results" / "reproduction"
_COLOURS = {
    Verdict.REPRODUCED: "green",
    Verdict.CORRECTED: "cyan",
    Verdict.SYNTHETIC: "blue",
    Verdict.CALIBRATED: "blue",
    Verdict.FAILED: "bold red",
}

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def _named(given: str | Path) -> Path:
    """The path; an empty one would be the current folder, which nobody who types nothing means."""
    if not str(given).strip():  # the default, a path already, comes by here, too
        raise typer.BadParameter("is empty; name a place.")
    return Path(given)


@app.command()
def main(
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="id, beginning of an id, number (4.11) or part of a chapter's title; repeat. No page is written then."
        ),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Run every row again, even if its result is stored.")] = False,
    jobs: Annotated[int, typer.Option(help="Processes.", min=1, max=64)] = 2,
    page: Annotated[
        Path | None,
        typer.Option(
            help="Page to write, from all rows.", show_default="docs/reproduction.md", parser=_named, metavar="PATH"
        ),
    ] = None,
    kept: Annotated[
        Path,
        typer.Option(
            help="Folder of stored results.", show_default="results/reproduction", parser=_named, metavar="PATH"
        ),
    ] = KEPT,
    list_: Annotated[bool, typer.Option("--list", help="Print the ids and what they are; run nothing.")] = False,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Run every equation, table, figure and statement of the thesis, and report the results. Takes some minutes.

    Results are stored row by row, so an interrupted run can be continued. Rows whose code has changed
    are run again. Exit code 1 if a row failed.

    Examples:
      python -m reproduction

      python -m reproduction --only "Eq. 2.5" --only "Chapter 5" --json

      python -m reproduction --only validation

      python -m reproduction --fresh
    """
    from reproduction.report import counts, markdown
    from reproduction.run import run_rows

    chosen = select(only)
    if only is not None and page is not None:
        raise SettingError("--page is written from all rows; leave out --only, or leave out --page.")
    if list_:
        _list(chosen, json_)
        return
    page = PAGE if page is None else page
    if only is None:  # a wrong name is told before the work
        make_folder(page.parent)
        if page.is_dir():
            raise InputFileError(page, "is a folder", "name a file for the page")
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
        rows = "1 row; it" if len(ordered) == 1 else f"{len(ordered)} rows; they"
        results.print(f"{rows} took {seconds:.0f} s of processor time to make.")
    if only is None:
        console.print(f"written: {write_whole(page, markdown(ordered))}", soft_wrap=True)
    if str(Verdict.FAILED) in tally:
        raise typer.Exit(1)


def _list(rows: list[Row], as_json: bool) -> None:
    """Ids and what they are."""
    if as_json:
        print_json([{"id": row.id, "what": row.what, "command": row.command} for row in rows])
        return
    for row in rows:
        results.print(f"{row.id}: {row.what}", markup=False, soft_wrap=True)


def select(only: list[str] | None) -> list[Row]:
    """Rows by id, by one item of it ("Eq. 4.9", or "4.9" for whatever has that number), by its beginning, or by a part
    of a chapter's title; capital letters and spaces around do not matter.

    Raises:
        SettingError: a name that fits no row, or none at all.
    """
    from reproduction.book import CHAPTERS, OUTSIDE, ROWS

    if only is None:
        return ROWS
    titles = {row.id: title.casefold() for title, rows in CHAPTERS.items() for row in rows}
    titles |= {row.id: "outside data: validation" for row in OUTSIDE}
    wanted: set[str] = set()
    for given in only:
        name = " ".join(given.split()).casefold()
        if not name:
            raise SettingError("--only is empty; give an id, a number or a part of a chapter's title.")
        fits = {row.id for row in ROWS if row.id.casefold() == name}
        fits = fits or {row.id for row in ROWS if name in _names(row)}
        fits = fits or {row.id for row in ROWS if row.id.casefold().startswith(name) or name in titles[row.id]}
        if not fits:
            meant = _near(name)
            raise SettingError(f"no row is called {given!r}{meant}; `python -m reproduction --list` prints all ids.")
        wanted |= fits
    return [row for row in ROWS if row.id in wanted]


def _near(name: str) -> str:
    """What the name that fits no row may have meant."""
    from reproduction.book import ROWS

    known = {item.casefold(): item for row in ROWS for item in (row.id, *row.numbers)}
    near = get_close_matches(name, known, n=1)
    return f", did you mean {known[near[0]]!r}?" if near else ""


def _names(row: Row) -> set[str]:
    """What its items may be called: "eq. 4.9", and "4.9" alone where the number has a point."""
    items = {item.casefold() for item in row.numbers}
    return items | {number for item in items if "." in (number := item.split(" ", 1)[-1])}


def show(rows: list[Row], found: dict[str, dict[str, Any]]) -> None:
    """The rows as a table for people."""
    from rich.table import Table

    from reproduction.report import numbers

    table = Table("id", "result (limits)", "verdict")
    for row in rows:
        verdict = Verdict(found[row.id]["verdict"])
        colour = _COLOURS.get(verdict, "yellow")
        table.add_row(row.id, numbers(found[row.id]).replace("[", r"\["), f"[{colour}]{verdict}[/]", end_section=True)
    results.print(table)


if __name__ == "__main__":
    command_line(app)
