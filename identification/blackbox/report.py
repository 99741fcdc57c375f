"""Reports as a table in the form of Table 3.2, as JSON, as CSV and as a page."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from fasbody.presentation import Sheet, inline, picture
from identification.blackbox.frequency import with_interval
from identification.blackbox.identify import ChosenModel, Report, finite
from identification.blackbox.keep import named
from identification.blackbox.polynomial import STRUCTURES


def document(reports: Sequence[Report]) -> dict[str, Any]:
    """The JSON document of a run; `models` lists the models of all recordings."""
    return {
        "models": [model(report, m) for report in reports for m in report.models.values()],
        "excitation_rank": min(report.excitation.rank for report in reports),
        "recordings": [recording(report) for report in reports],
    }


def recording(report: Report) -> dict[str, Any]:
    """Notes on one recording or pool, without its models."""
    seen, series = report.excitation, report.estimation[0]
    about: dict[str, Any] = {
        "recording": report.name,
        "files": [series.name for series in report.estimation],
        "estimation_samples": sum(map(len, report.estimation)),
        "held_out_samples": sum(map(len, report.validation)),
        "input": series.channels[0],
        "output": series.channels[1],
        "sample_time_s": series.sample_time,
        "excitation_rank": seen.rank,
        "excitation_rank_limit": seen.limit,
        "excitation": str(seen),
        "single_sine": seen.single_sine,
        "frequency_hz": seen.frequency_hz,
        "harmonics": list(seen.harmonics),
        "notes": list(report.notes),
        "feedback": report.condition.feedback,
        "outliers": list(report.condition.spikes),
        "drift": report.condition.drift,
        "failures": list(report.failures),
    }
    if report.nonparametric is not None:
        free = report.nonparametric
        about["nonparametric"] = {
            "frequency_hz": free.frequency_hz,
            "gain": np.abs(free.value),
            "gain_std": free.std,
            "phase_deg": np.angle(free.value, deg=True),
        }
    if report.rational and report.left_out:
        about["rational_fit"] = {
            "poles_rad_per_s": _pairs(report.rational.poles()),
            "chi_square": report.rational.chi_square,
            "degrees_of_freedom": report.rational.freedom,
            "distortion": report.rational.distortion,
            "warnings": list(report.rational.warnings),
            "left_out_frequency_hz": report.left_out.frequency_hz,
            "left_out_error": report.left_out.error,
        }
    return about


def _pairs(values: np.ndarray) -> list[list[float]]:
    return [[v.real, v.imag] for v in np.asarray(values, dtype=complex)]


def model(report: Report, chosen: ChosenModel) -> dict[str, Any]:
    """One model as JSON."""
    best, response = chosen.best, chosen.response
    estimate = best.model
    return {
        "recording": report.name,
        "structure": estimate.structure,
        "orders": orders(estimate),
        "label": estimate.label,
        "fit_percent": best.fit_percent,
        "one_step_percent": best.one_step_percent,
        "aic": best.aic,
        "fpe": best.fpe,
        "bic": best.bic,
        "loss": estimate.loss,
        "noise_variance": getattr(estimate, "noise_variance", None),  # of e(t), polynomial models
        "parameters": estimate.parameters,
        "coefficients": coefficients(estimate),
        "poles": _pairs(estimate.poles()),
        "zeros": _pairs(estimate.zeros()),
        "response": {
            "frequency_hz": response.frequency_hz,
            "gain": np.abs(response.value),
            "gain_std": response.gain_std,
            "phase_deg": np.angle(response.value, deg=True),
            "phase_std_deg": response.phase_std_deg,
        },
        "residual_whiteness_p": chosen.test.white_p,
        "residual_input_independence_p": chosen.test.cross_p,
        "models_tried": chosen.selection.tried,
        "indistinguishable": list(chosen.selection.alike),
        "excitation_rank": report.excitation.rank,
        "warnings": list(chosen.warnings),
    }


def orders(estimate: Any) -> dict[str, int]:
    """Orders by name."""
    if estimate.structure == "ss":
        return {"order": estimate.order}
    if estimate.structure == "narx":
        lags = {key: getattr(estimate, key) for key in ("lags", "nk", "step")}
        return lags | {"terms": len(estimate.terms)}
    linear = getattr(estimate, "linear", estimate)
    numbers = {name: getattr(linear.orders, name) for name in STRUCTURES[linear.structure]}
    if estimate.structure == "hw":
        names = "input_degree", "output_degree"
        numbers |= dict(zip(names, estimate.degrees, strict=True))
    return numbers


def coefficients(estimate: Any) -> dict[str, Any]:
    """Estimated coefficients with standard errors, or the state-space matrices."""
    keys = {
        "ss": ("A", "B", "C", "D", "K", "x0"), "hw": ("input_terms", "output_terms"),
    }.get(estimate.structure, ())  # fmt: skip
    values = {key: getattr(estimate, key) for key in keys}
    if estimate.structure == "ss":
        return values
    linear = getattr(estimate, "linear", estimate)
    names = {"terms": estimate.names} if estimate.structure == "narx" else {}
    return {**names, "theta": linear.theta, "std_error": linear.std_error, **values}


def strongest(report: Report) -> int:
    """Which of the frequencies shown the inputs excite most: there table and CSV give the gain."""
    frequency = next(iter(report.models.values())).response.frequency_hz
    power = np.zeros(len(frequency))
    for series in report.estimation:
        windowed = np.hanning(len(series)) * series.u
        waves = np.exp(-2j * np.pi * np.outer(frequency, series.time))
        power += np.abs(waves @ windowed) ** 2
    return int(power.argmax())


def single_table(report: Report) -> Table:
    """Models of one recording or pool, one a row; the gain, with its 95 % interval, where the
    input is strongest.

    It fits into 80 columns; the criteria stand in JSON and CSV.
    """
    best = max(report.models.values(), key=lambda m: m.best.fit_percent)
    place, series = strongest(report), report.estimation[0]
    u, y = series.channels
    title = f"{report.name}: input {u}, output {y}, sample time {series.sample_time:.6g} s"
    table = Table(title=f"{escape(title)}\n{report.excitation}", title_justify="left")
    at = f"gain at {best.response.frequency_hz[place]:.4g} Hz\n(95 %)"
    for heading in ("model", "fit %", "one step %", at, "equal fits"):
        table.add_column(heading, justify="left" if heading == "model" else "right")
    for chosen in report.models.values():
        c, response = chosen.best, chosen.response
        fit = f"{c.fit_percent:.2f}" if np.isfinite(c.fit_percent) else "-"
        gain = abs(response.value[place])
        gain = with_interval(gain, response.gain_std[place]) if np.isfinite(gain) else "-"
        fit, alike = f"[bold]{fit}[/]" if chosen is best else fit, len(chosen.selection.alike)
        table.add_row(c.model.label, fit, f"{c.one_step_percent:.2f}", gain, str(alike))
    return table


def thesis_table(reports: Sequence[Report]) -> Table:
    """All recordings in the form of Table 3.2: orders and fit of each structure."""
    names = list(dict.fromkeys(name for report in reports for name in report.models))
    title = "orders and held-out fit in free simulation (form of Table 3.2)"
    table = Table("recording", "rank", *map(str.upper, names), title=title, title_justify="left")
    for report in reports:
        best = max(chosen.best.fit_percent for chosen in report.models.values())
        cells = dict.fromkeys(names, "-")
        for name, chosen in report.models.items():
            fit, numbers = chosen.best.fit_percent, chosen.best.model.label.split(" ", 1)[1]
            cells[name] = f"{numbers} " + (f"[bold]{fit:.1f}[/]" if fit == best else f"{fit:.1f}")
        table.add_row(report.name, str(report.excitation.rank), *cells.values())
    return table


def csv_text(reports: Sequence[Report]) -> str:
    """One row for each model: a table to continue with."""
    import pandas as pd

    rows = []
    for report in reports:
        k = strongest(report)
        for chosen in report.models.values():
            c, r = chosen.best, chosen.response
            rows.append({
                "recording": report.name,
                "frequency_hz": f"{report.excitation.frequency_hz:.6g}",
                "excitation_rank": report.excitation.rank,
                "model": c.model.label,
                "fit_percent": f"{c.fit_percent:.4f}",
                "aic": f"{c.aic:.6f}",
                "bic": f"{c.bic:.6f}",
                "fpe": f"{c.fpe:.6g}",
                "parameters": c.model.parameters,
                "gain": f"{abs(r.value[k]):.6g}",
                "gain_std": f"{r.gain_std[k]:.3g}",
                "gain_frequency_hz": f"{r.frequency_hz[k]:.6g}",
                "warnings": " | ".join(chosen.warnings),
            })  # fmt: skip
    return pd.DataFrame(rows).to_csv(index=False, lineterminator="\n")


def page(reports: Sequence[Report]) -> str:
    """report.html: the models of every recording on one self-contained page."""
    from markupsafe import Markup

    from fasbody.page import Section, html
    from identification.blackbox import figures

    sections = []
    for report in reports:
        series = report.estimation[0]
        u, y = series.channels
        origin = (
            f"input {u} · output {y} · sample time {series.sample_time:.6g} s · "
            f"{sum(map(len, report.estimation))} samples estimated, "
            f"{sum(map(len, report.validation))} held out"
        )
        pictures = [
            (Markup(inline(picture(draw(report), "svg"))), (draw.__doc__ or "").split("\n\n")[0])
            for draw in figures.DRAWINGS.values()
        ]
        details = []
        for m in report.models.values():
            rows = [
                (name, f"{e['value']:.6g}", finite(e["std_error"], ".2g", "–"))
                for name, e in named(m.best.model).items()
            ]
            details.append(Sheet(m.best.model.label, ("name", "value", "standard error"), rows))
        sections.append(Section(report.sheet(), origin, pictures, details))
    return html(sections)
