"""Reports as a table in the form of Table 3.2, as JSON and as CSV."""

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from fasbody.constants import Z95
from identification.blackbox.identify import Found, Report
from identification.blackbox.polynomial import STRUCTURES


def document(reports: Sequence[Report]) -> dict[str, Any]:
    """The JSON document of a run; `models` lists the models of all recordings."""
    return {
        "models": [model(report, chosen) for report in reports for chosen in report.models.values()],
        "excitation_rank": min(report.excitation.rank for report in reports),
        "recordings": [recording(report) for report in reports],
    }


def recording(report: Report) -> dict[str, Any]:
    """Notes on one recording or pool, without its models."""
    seen = report.excitation
    about: dict[str, Any] = {
        "recording": report.name,
        "files": [series.name for series in report.estimation],
        "estimation_samples": sum(len(series) for series in report.estimation),
        "held_out_samples": sum(len(series) for series in report.validation),
        "input": report.estimation[0].channels[0],
        "output": report.estimation[0].channels[1],
        "sample_time_s": report.estimation[0].sample_time,
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
            "frequency_hz": free.frequency_hz, "gain": np.abs(free.value), "gain_std": free.std,
            "phase_deg": np.angle(free.value, deg=True),
        }  # fmt: skip
    if report.rational and report.left_out:
        poles = report.rational.poles()
        about["rational_fit"] = {
            "poles_rad_per_s": [[p.real, p.imag] for p in poles],
            "chi_square": report.rational.chi_square,
            "degrees_of_freedom": report.rational.freedom,
            "distortion": report.rational.distortion,
            "warnings": list(report.rational.warnings),
            "left_out_frequency_hz": report.left_out.frequency_hz,
            "left_out_error": report.left_out.error,
        }
    return about


def model(report: Report, chosen: Found) -> dict[str, Any]:
    """One model as JSON."""
    best = chosen.best
    estimate = best.model
    response = chosen.response
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
        "noise_variance": getattr(estimate, "noise_variance", None),  # of e(t), polynomial models only
        "parameters": estimate.parameters,
        "coefficients": coefficients(estimate),
        "poles": [[p.real, p.imag] for p in np.asarray(estimate.poles(), dtype=complex)],
        "zeros": [[z.real, z.imag] for z in np.asarray(estimate.zeros(), dtype=complex)],
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
        return {"lags": estimate.lags, "nk": estimate.nk, "step": estimate.step, "terms": len(estimate.terms)}
    linear = getattr(estimate, "linear", estimate)
    numbers = {name: getattr(linear.orders, name) for name in STRUCTURES[linear.structure]}
    if estimate.structure == "hw":
        numbers |= dict(zip(("input_degree", "output_degree"), estimate.degrees, strict=True))
    return numbers


def coefficients(estimate: Any) -> dict[str, Any]:
    """Estimated coefficients with standard errors, or the state-space matrices."""
    if estimate.structure == "ss":
        return {key: getattr(estimate, key) for key in ("A", "B", "C", "D", "K", "x0")}
    if estimate.structure == "narx":
        return {"terms": estimate.names, "theta": estimate.theta, "std_error": estimate.std_error}
    linear = getattr(estimate, "linear", estimate)
    values = {"theta": linear.theta, "std_error": linear.std_error}
    if estimate.structure == "hw":
        values |= {"input_terms": estimate.input_terms, "output_terms": estimate.output_terms}
    return values


def strongest(report: Report) -> int:
    """Which of the frequencies shown the estimation inputs excite most: there table and CSV give the gain."""
    frequency = next(iter(report.models.values())).response.frequency_hz
    power = np.zeros(len(frequency))
    for series in report.estimation:
        windowed = np.hanning(len(series)) * series.u
        power += np.abs(np.exp(-2j * np.pi * np.outer(frequency, series.time)) @ windowed) ** 2
    return int(power.argmax())


def single_table(report: Report) -> Table:
    """Models of one recording or pool, one a row; the gain, with its 95 % interval, where the input is strongest.

    It fits into 80 columns; the criteria stand in JSON and CSV.
    """
    best = max(report.models.values(), key=lambda chosen: chosen.best.fit_percent)
    place = strongest(report)
    at = f" at {best.response.frequency_hz[place]:.4g} Hz, 95 %"
    series = report.estimation[0]
    what = f"input {series.channels[0]}, output {series.channels[1]}, sample time {series.sample_time:.6g} s"
    table = Table(title=f"{escape(f'{report.name}: {what}')}\n{report.excitation}", title_justify="left")
    for heading in ("model", "fit %", "one step %", f"gain{at}", "alike"):
        table.add_column(heading, justify="left" if heading == "model" else "right")
    for chosen in report.models.values():
        c, response = chosen.best, chosen.response
        fit = f"{c.fit_percent:.2f}" if np.isfinite(c.fit_percent) else "-"
        gain = "-"
        if np.isfinite(response.value[place]):
            gain = f"{abs(response.value[place]):.4g}"
            if np.isfinite(response.gain_std[place]):
                gain += f" +- {Z95 * response.gain_std[place]:.1g}"
        table.add_row(
            c.model.label, f"[bold]{fit}[/]" if chosen is best else fit, f"{c.one_step_percent:.2f}", gain,
            str(len(chosen.selection.alike)),
        )  # fmt: skip
    return table


def thesis_table(reports: Sequence[Report]) -> Table:
    """All recordings in the form of Table 3.2: orders and fit of each structure."""
    names = list(dict.fromkeys(name for report in reports for name in report.models))
    table = Table(title="orders and held-out fit in free simulation (form of Table 3.2)", title_justify="left")
    for heading in ("recording", "rank", *(name.upper() for name in names)):
        table.add_column(heading)
    for report in reports:
        cells = []
        best = max(chosen.best.fit_percent for chosen in report.models.values())
        for name in names:
            chosen = report.models.get(name)
            if chosen is None:
                cells.append("-")
                continue
            fit = chosen.best.fit_percent
            numbers = chosen.best.model.label.split(" ", 1)[1]
            cells.append(f"{numbers} {'[bold]' if fit == best else ''}{fit:.1f}{'[/]' if fit == best else ''}")
        table.add_row(report.name, str(report.excitation.rank), *cells)
    return table


def csv_text(reports: Sequence[Report]) -> str:
    """One row for each model: a table to continue with."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([
        "recording", "frequency_hz", "excitation_rank", "model", "fit_percent", "aic", "bic", "fpe", "parameters",
        "gain", "gain_std", "gain_frequency_hz", "warnings",
    ])  # fmt: skip
    for report in reports:
        k = strongest(report)
        for chosen in report.models.values():
            c, r = chosen.best, chosen.response
            gain, std = abs(complex(r.value[k])), float(r.gain_std[k])
            writer.writerow([
                report.name, f"{report.excitation.frequency_hz:.6g}", report.excitation.rank, c.model.label,
                f"{c.fit_percent:.4f}", f"{c.aic:.6f}", f"{c.bic:.6f}", f"{c.fpe:.6g}", c.model.parameters,
                f"{gain:.6g}", f"{std:.3g}", f"{r.frequency_hz[k]:.6g}", " | ".join(chosen.warnings),
            ])  # fmt: skip
    return text.getvalue()
