"""report.html of a plan, a comparison or a black box: sentences, tables and figures on one page."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from importlib import import_module
from inspect import cleandoc
from pathlib import Path

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from fasbody.console import write_whole
from fasbody.presentation import Presented, Sheet, inline, picture, write_figure


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
    figures: Sequence[tuple[Markup, str]]
    details: Sequence[Sheet] = ()


def html(sections: Sequence[Section]) -> str:
    """The page as text; no outside address is needed to read it."""
    loader, escape = PackageLoader("identification"), select_autoescape(default=True)
    template = Environment(loader=loader, autoescape=escape).get_template("page.html")
    return template.render(sections=sections, day=date.today().isoformat())


def write(result: Presented, folder: Path, command: str) -> list[Path]:
    """Write the numbers of a result, each figure as SVG and PNG, and report.html into a folder.

    Args:
        result: what is presented.
        folder: to write into.
        command: that made it, as it was typed.
    """
    files, pictures = result.write(folder), []
    for kind in result.plots:
        figure = result.plot(kind)
        pictures.append((Markup(inline(picture(figure, "svg"))), _caption(result, kind)))
        files += write_figure(figure, folder / f"{kind}.svg", folder / f"{kind}.png")
    text = html([Section(result.sheet(), Markup("<code>{}</code>").format(command), pictures)])
    return [*files, write_whole(folder / "report.html", text)]


def _caption(result: Presented, kind: str) -> str:
    """What the function says that draws the figure."""
    return cleandoc(getattr(import_module(result.figures), kind).__doc__ or "").replace("\n", " ")
