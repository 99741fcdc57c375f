"""report.html of a plan or a comparison: its sentences, its table and its figures on one self-contained page."""

from datetime import date
from importlib import import_module
from inspect import cleandoc
from pathlib import Path

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from fasbody.console import write_whole
from fasbody.presentation import Presented, inline, picture, write_figure


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
    environment = Environment(loader=PackageLoader("identification"), autoescape=select_autoescape(default=True))
    text = environment.get_template("page.html").render(
        sheet=result.sheet(), figures=pictures, command=command, day=date.today().isoformat()
    )
    return [*files, write_whole(folder / "report.html", text)]


def _caption(result: Presented, kind: str) -> str:
    """What the function says that draws the figure."""
    return cleandoc(getattr(import_module(result.figures), kind).__doc__ or "").replace("\n", " ")
