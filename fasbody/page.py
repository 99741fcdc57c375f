"""Results on the terminal, and on one self-contained page: report.html."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import box
from rich.markup import escape
from rich.table import Table

from fasbody.console import console, results, write_whole
from fasbody.presentation import Presented, Sheet, inline, picture, write_figure

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


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


def show(sheet: Sheet, *words: str) -> None:
    """Print a sheet for a person.

    Args:
        sheet: of a result.
        words: the columns of words; the others are of numbers.
    """
    table = Table(title=escape(sheet.title), title_justify="left", box=box.SIMPLE_HEAD, padding=0)
    table.show_edge = False
    for column in sheet.columns:
        table.add_column(escape(column), justify="left" if column in words else "right")
    for row in sheet.rows:
        table.add_row(*map(escape, row))
    results.print(table)
    for number, text in enumerate(sheet.notes):
        results.print(escape(text) if number else f"[bold]{escape(text)}[/]", soft_wrap=True)


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
        pictures.append((Markup(inline(picture(figure, "svg"))), _caption(result, kind)))
        files += write_figure(figure, folder / f"{kind}.svg", folder / f"{kind}.png")
    text = html([Section(result.sheet(), Markup("<code>{}</code>").format(command), pictures)])
    beside = ", ".join(path.name for path in files if path.suffix in (".json", ".csv"))
    console.print(
        f"report: [bold]{folder}/report.html[/], with {beside} and figures beside it", soft_wrap=True
    )
    return [*files, write_whole(folder / "report.html", text)]


def _caption(result: Presented, kind: str) -> str:
    """What the function says that draws the figure."""
    return cleandoc(getattr(import_module(result.figures), kind).__doc__ or "").replace("\n", " ")
