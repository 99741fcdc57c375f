"""report.html: everything a fit found on one self-contained page."""

from datetime import date
from pathlib import Path

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from fasbody import console
from identification import figures, sensor_figures
from identification.result import FitResult, label


def html(result: FitResult) -> str:
    """The page as text; no outside address is needed to read it."""
    environment = Environment(
        loader=PackageLoader("identification"),
        autoescape=select_autoescape(default=True),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pictures = {
        name: Markup(figures.svg(getattr(figures, name)(result)))
        for name in ("traces", "residuals", "parameters", "waterfall", "correlation")
    }
    own = (("sensors", len(result.by_sensor) > 0), ("contact", len(result.contact) > 0))
    pictures |= {name: Markup(figures.svg(getattr(sensor_figures, name)(result))) for name, shown in own if shown}
    page = environment.get_template("report.html")
    return page.render(result=result, pictures=pictures, label=label, day=date.today().isoformat())


def write(result: FitResult, folder: Path) -> list[Path]:
    """Write result.json, parameters.csv and report.html into a folder, each whole or not at all."""
    files = {
        "result.json": console.to_json(result.document()) + "\n",
        "parameters.csv": result.csv(),
        "report.html": html(result),
    }
    return [console.write_whole(folder / name, text) for name, text in files.items()]
