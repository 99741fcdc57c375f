"""report.html: the models of every recording, on one self-contained page in the style of the fit's report."""

from collections.abc import Sequence
from datetime import date

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from fasbody.presentation import inline, picture
from identification.blackbox import figures
from identification.blackbox.data import Series
from identification.blackbox.identify import Report
from identification.blackbox.keep import Single, named


def html(reports: Sequence[Report]) -> str:
    """The page as text; no outside address is needed to read it."""
    environment = Environment(
        loader=PackageLoader("identification"), autoescape=select_autoescape(default=True), trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    pictures = [
        {name: Markup(inline(picture(draw(one), "svg"))) for name, draw in figures.DRAWINGS.items()} for one in reports
    ]
    return environment.get_template("blackbox.html").render(
        reports=reports, pictures=pictures, day=date.today().isoformat(), named=named, held=_samples, answer=_answer,
        percent=_percent, slowest=_slowest, number=_number,
    )  # fmt: skip


def _samples(parts: Sequence[Series]) -> int:
    return sum(len(series) for series in parts)


def _percent(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "diverges"


def _number(value: float) -> str:
    return f"{value:.2g}" if np.isfinite(value) else "–"


def _answer(report: Report) -> str:
    """The best model in one sentence."""
    best = max(report.models.values(), key=lambda chosen: chosen.best.fit_percent).best
    if not np.isfinite(best.fit_percent):
        best = max(report.models.values(), key=lambda chosen: chosen.best.one_step_percent).best
        return (
            f"{best.model.label} predicts {best.one_step_percent:.1f} % one step ahead; none can be simulated freely."
        )
    return f"{best.model.label} simulates {best.fit_percent:.1f} % of the held-out output freely."


def _slowest(model: Single, sample_time: float) -> str:
    """Frequency and damping of the mode nearest to the unit circle."""
    poles = model.poles()
    if not len(poles) or not np.abs(poles).max() > 0:
        return "–"
    s = np.log(complex(poles[np.argmax(np.abs(poles))])) / sample_time
    if abs(s.imag) * sample_time < 1e-9:
        return f"{1 / max(-s.real, 1e-300):.3g} s"
    return f"{abs(s) / 2 / np.pi:.4g} Hz, damping {100 * -s.real / abs(s):.2g} %"
