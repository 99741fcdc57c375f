"""Results on the terminal, and on one self-contained page: report.html."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from fasbody.console import console, results, write_whole
from fasbody.presentation import Presented, Sheet, inline, picture, write_figure

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

#: Characters of a name in the first column that stay in one line.
_NAME = 20


@dataclass(frozen=True)
class Section:
    """One part of a page.

    Attributes:
        sheet: its heading, sentences and table.
        origin: what the part comes from, one line.
        figures: SVG and caption of each.
        details: tables that a reader may open.
    """

    sheet: Sheet
    origin: str
    figures: Sequence[tuple["Markup", str]]
    details: Sequence[Sheet] = ()


def templates(package: str, **options: Any) -> "Environment":
    """The templates of a package, beside those that all share.

    Args:
        package: that has a folder of them.
        options: of Jinja.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, select_autoescape

    loader = ChoiceLoader([PackageLoader(package), PackageLoader("fasbody")])
    return Environment(loader=loader, autoescape=select_autoescape(default=True), **options)


def html(sections: Sequence[Section]) -> str:
    """The page as text; no outside address is needed to read it."""
    template = templates("fasbody").get_template("page.html")
    return template.render(sections=sections, day=date.today().isoformat())


def show(sheet: Sheet, *words: str, spared: Sequence[str] = ()) -> None:
    """Print a sheet for a person.

    Args:
        sheet: of a result.
        words: the columns of words; the others are of numbers.
        spared: the columns that go first where room lacks, as `print_table` takes them.
    """
    print_table(sheet.columns, [tuple(map(escape, row)) for row in sheet.rows], words, spared, sheet.title)
    for number, text in enumerate(sheet.notes):
        results.print(escape(text) if number else f"[bold]{escape(text)}[/]", soft_wrap=True)


def print_table(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    words: Sequence[str] = (),
    spared: Sequence[str] = (),
    title: str = "",
) -> None:
    """Print a table of whole numbers: where room lacks, headings break, then columns are left out and named.

    Args:
        columns: headings; the first column folds, and stays.
        rows: cells, as markup.
        words: the columns of words; the others are of numbers.
        spared: the columns that go first, in this order; the others go from the right.
        title: above the table.
    """
    out = Console(highlight=False, width=None if os.environ.get("COLUMNS", "").isdigit() else results.width)
    room = out.options.update(width=10_000)
    order = [*(name for name in spared if name in columns), *(name for name in columns[:0:-1] if name not in spared)]
    widest = [max((Text.from_markup(row[i]).cell_len for row in rows), default=0) for i in range(len(columns))]
    first: dict[str, Any] = {"overflow": "fold", "min_width": min(_NAME, widest[0])}
    others: dict[str, Any] = {"overflow": "crop", "no_wrap": True}

    def table(dropped: Sequence[str], broken: bool) -> Table:
        made = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, padding=0)
        kept = [i for i, name in enumerate(columns) if name not in dropped]
        for i in kept:
            heading = escape(columns[i].replace(" ", "\n") if broken else columns[i])
            side: Literal["left", "right"] = "left" if columns[i] in words else "right"
            # without a least width, the measured one is that of a cell's longest word
            made.add_column(heading, justify=side, **({**others, "min_width": widest[i]} if i else first))
        for row in rows:
            made.add_row(*(row[i] for i in kept))
        return made

    layouts = [(0, False), *((count, True) for count in range(len(order) + 1))]
    for count, broken in layouts:
        made = table(order[:count], broken)
        need = out.measure(made, options=room)
        if (need.minimum if broken else need.maximum) <= out.width:
            break
    out.print(made)
    if count:
        left = ", ".join(name for name in columns if name in order[:count])
        why = "columns that this terminal is too narrow for (--json has them)"
        out.print(f"{why}: {left}", markup=False, soft_wrap=True)


def write(result: Presented, folder: Path, command: str) -> list[Path]:
    """Write the numbers of a result, each figure as SVG and PNG, and report.html; say so.

    Args:
        result: what is presented.
        folder: to write into.
        command: that made it, as it was typed.
    """
    from markupsafe import Markup

    files, pictures = result.write(folder), []
    for kind in result.plots:
        figure = result.plot(kind)
        caption = cleandoc(getattr(import_module(result.figures), kind).__doc__ or "").replace("\n", " ")
        pictures.append((Markup(inline(picture(figure, "svg"))), caption))
        files += write_figure(figure, folder / f"{kind}.svg", folder / f"{kind}.png")
    text = html([Section(result.sheet(), Markup("<code>{}</code>").format(command), pictures)])
    beside = ", ".join(path.name for path in files if path.suffix in (".json", ".csv"))
    console.print(
        f"report: [bold]{folder}/report.html[/], with {beside} and figures beside it", soft_wrap=True
    )
    return [*files, write_whole(folder / "report.html", text)]
