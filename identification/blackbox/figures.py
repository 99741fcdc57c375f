"""Figures of a report: output (as Figures 3.3 to 3.6), Bode with confidence, residual tests, poles and zeros."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fasbody.constants import Z95
from fasbody.presentation import COLOURS as SERIES
from fasbody.presentation import PAGE, picture, printed
from identification.blackbox.identify import ChosenModel, Report

#: One colour for each structure in every figure.
COLOURS = dict(zip(("arx", "armax", "oe", "bj", "ss", "hw", "narx"), (*SERIES, "#7F4F24"), strict=True))
DASHES: dict[str, Any] = {
    "arx": "-", "armax": "--", "oe": "-.", "bj": ":", "ss": (0, (5, 1, 1, 1)), "hw": (0, (3, 2)), "narx": (0, (1, 1)),
}  # fmt: skip


def all_figures(report: Report) -> dict[str, bytes]:
    """PNG files by name: output, bode, residuals, poles_zeros."""
    return {name: picture(draw(report), "png") for name, draw in DRAWINGS.items()}


@printed
def output(report: Report) -> Figure:
    """Held-out output, measured and freely simulated: the whole record at the left, one cycle and its errors right."""
    series = report.validation[0]
    figure = Figure(figsize=(PAGE, 4.8), layout="constrained")
    places = figure.subplot_mosaic("ab\nac", width_ratios=[1.5, 1], height_ratios=[2, 1])
    whole, cycle, error = places["a"], places["b"], places["c"]
    offset = 0.0 if len(report.estimation) > 1 else len(report.estimation[0]) * series.sample_time
    time = series.time + offset
    part = _one_cycle(report, len(series))
    whole.plot(time, series.y, color="0.25", lw=1.4, zorder=1)
    cycle.plot(time[part], series.y[part], color="0.25", lw=2.4, label="measured", zorder=1)
    for name, chosen in report.models.items():
        simulated = chosen.best.model.simulate(series)
        if not np.isfinite(simulated).all():
            continue
        style: dict[str, Any] = {"color": COLOURS[name], "ls": DASHES[name]}
        whole.plot(time, simulated, lw=0.4, **style)
        label = f"{chosen.best.model.label}: {chosen.best.fit_percent:.1f} %"
        cycle.plot(time[part], simulated[part], lw=1.3, label=label, **style)
        error.plot(time[part], (series.y - simulated)[part], lw=1.0, **style)
    whole.set_xlabel("time [s]")
    error.set_xlabel("time [s]")
    cycle.sharex(error)
    cycle.tick_params(labelbottom=False)
    error.set_ylabel("error")
    whole.set_ylabel("output without its mean\n[unit of the recording]")
    whole.set_title("held-out part, free simulation")
    cycle.set_title("one cycle" if np.isfinite(report.excitation.frequency_hz) else "a short stretch")
    handles, labels = cycle.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    figure.suptitle(f"{report.name} ({series.name})" if len(report.validation) > 1 else report.name)
    return figure


def _one_cycle(report: Report, length: int) -> slice:
    frequency = report.excitation.frequency_hz
    count = length // 25 if not np.isfinite(frequency) else round(1.0 / (frequency * report.validation[0].sample_time))
    middle = length // 2
    return slice(middle, min(middle + max(count, 10) + 1, length))


@printed
def bode(report: Report) -> Figure:
    """Gain and phase with 95 % bands, drawn only where the input excites and the model determines them."""
    return _points_of_sine(report) if report.excitation.single_sine else _bode_band(report)


def _responding(report: Report) -> dict[str, ChosenModel]:
    return {name: chosen for name, chosen in report.models.items() if np.isfinite(chosen.response.value).any()}


def _bode_band(report: Report) -> Figure:
    figure = Figure(figsize=(PAGE, 5.6), layout="constrained")
    gain, phase = figure.subplots(2, 1, sharex=True)
    lines = report.excitation.lines  # points, for nothing is known between them
    if report.nonparametric is not None:
        seen = report.nonparametric
        size = np.abs(seen.value)
        sure = Z95 * seen.std < 0.5 * size
        angle = np.angle(seen.value[sure], deg=True)
        if models := _responding(report):  # the points turn with the first curve, gaps between them or not
            r = next(iter(models.values())).response
            curve = np.interp(seen.frequency_hz[sure], r.frequency_hz, np.rad2deg(np.unwrap(np.angle(r.value))))
            angle += 360.0 * np.round((curve - angle) / 360.0)
        style: dict[str, Any] = {"fmt": "o", "ms": 2, "color": "0.55", "elinewidth": 0.6, "zorder": 0}
        at_hz = seen.frequency_hz[sure]
        gain.errorbar(at_hz, size[sure], Z95 * seen.std[sure], label="no model", **style)
        phase.errorbar(at_hz, angle, np.rad2deg(Z95 * seen.std[sure] / size[sure]), **style)
    for name, chosen in _responding(report).items():
        r = chosen.response
        size, angle = np.abs(r.value), np.rad2deg(np.unwrap(np.angle(r.value)))
        gain_band, phase_band = Z95 * r.gain_std, Z95 * r.phase_std_deg
        unknown = gain_band >= size
        label = chosen.best.model.label + (" (undetermined)" if unknown.all() else "")
        label += " (no valid band)" if np.isnan(gain_band).all() else ""
        for axes, value, band in ((gain, size, gain_band), (phase, angle, phase_band)):
            value = np.where(unknown, np.nan, value)
            if lines:
                size_of = 7 - list(report.models).index(name)
                style = {"fmt": "o", "ms": size_of, "mfc": "none", "capsize": 2, "lw": 1}
                axes.errorbar(r.frequency_hz, value, band, color=COLOURS[name], label=label, **style)
                continue
            axes.plot(r.frequency_hz, value, color=COLOURS[name], ls=DASHES[name], label=label)
            axes.fill_between(r.frequency_hz, value - band, value + band, color=COLOURS[name], alpha=0.18, lw=0)
    gain.set_yscale("log")
    gain.set_xscale("log")
    gain.set_ylabel("gain [output / input]")
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    for axis in (gain.yaxis, phase.xaxis):
        low, high = axis.get_view_interval()
        axis.set_major_formatter("{x:g}")
        few = high < 30 * low  # a decade or so: label 2, 3, 5 as well
        axis.set_minor_formatter(lambda x, _, few=few: f"{x:g}" if few and f"{x:e}"[0] in "235" else "")
    for axes in (gain, phase):
        axes.grid(alpha=0.3, lw=0.5, which="both")
    gain.legend(fontsize=8, ncols=2)
    where = "excited lines only" if lines else "excited band"
    gain.set_title(f"{report.name}: response with 95 % confidence, {where}")
    return figure


def _points_of_sine(report: Report) -> Figure:
    """Gain and phase at the only frequency that a sine identifies, model by model."""
    figure = Figure(figsize=(PAGE, 4.6), layout="constrained")
    gain, phase = figure.subplots(2, 1, sharex=True)
    models = _responding(report)
    for place, (name, chosen) in enumerate(models.items()):
        r = chosen.response
        style: dict[str, Any] = {"color": COLOURS[name], "fmt": "o", "ms": 5, "capsize": 4, "lw": 1.3}
        if Z95 * r.gain_std[0] >= abs(r.value[0]):
            gain.annotate("undetermined", (place, 0.5), xycoords=("data", "axes fraction"), ha="center")
            continue
        gain.errorbar(place, abs(r.value[0]), Z95 * r.gain_std[0], **style)
        phase.errorbar(place, np.angle(r.value[0], deg=True), Z95 * r.phase_std_deg[0], **style)
    labels = [
        chosen.best.model.label.replace(" ", "\n", 1) + ("\nsmall amplitude" if name == "hw" else "")
        for name, chosen in models.items()
    ]
    phase.set_xticks(range(len(models)), labels)
    phase.set_xlim(-0.6, len(models) - 0.4)
    for axes, text in ((gain, "gain [output / input]"), (phase, "phase [deg]")):
        axes.set_ylabel(text)
        axes.ticklabel_format(axis="y", useOffset=False)
    frequency = report.excitation.frequency_hz
    gain.set_title(
        f"{report.name}: response at {frequency:.4g} Hz with 95 % confidence; it tells nothing of other frequencies",
    )
    return figure


@printed
def residuals(report: Report) -> Figure:
    """Autocorrelation of held-out residuals, and their correlation with past inputs, with 99 % bands."""
    count = len(report.models)
    figure = Figure(figsize=(PAGE, 0.8 + 0.95 * count), layout="constrained")
    rows = figure.subplots(count, 2, sharex="col", squeeze=False)
    for (left, right), (name, chosen) in zip(rows, report.models.items(), strict=True):
        test = chosen.test
        _bars(left, test.lags, test.auto, test.bound, COLOURS[name])
        _bars(right, test.cross_lags, test.cross, test.cross_bound, COLOURS[name])
        left.set_ylabel(name.upper(), rotation=0, ha="right", va="center")
    rows[0][0].set_title("residual autocorrelation")
    rows[0][1].set_title("residual(t) with input(t - lag)")
    rows[-1][0].set_xlabel("lag [samples]")
    rows[-1][1].set_xlabel("lag [samples]; negative: input after output")
    figure.suptitle(f"{report.name}: residuals of held-out data; shaded: 99 % band of no correlation")
    return figure


def _bars(axes: Axes, lags: np.ndarray, values: np.ndarray, bound: float, colour: str) -> None:
    axes.axhspan(-bound, bound, color="0.85", lw=0)
    axes.vlines(lags, 0, values, color=colour, lw=1.6)
    axes.axhline(0, color="0.3", lw=0.6)
    reach = max(1.25 * float(np.abs(values).max()), 1.6 * bound)
    axes.set_ylim(-reach, reach)
    axes.tick_params(labelsize=7)


@printed
def poles(report: Report) -> Figure:
    """Poles and zeros in the z plane, the part near the unit circle where the models differ enlarged."""
    figure = Figure(figsize=(PAGE, 4.2), layout="constrained")
    plane, near = figure.subplots(1, 2)
    angle = np.linspace(0, 2 * np.pi, 721)
    models = {name: chosen for name, chosen in report.models.items() if len(chosen.best.model.poles())}
    for axes in (plane, near):
        axes.plot(np.cos(angle), np.sin(angle), color="0.6", lw=0.8)
        axes.axhline(0, color="0.85", lw=0.6, zorder=0)
        axes.axvline(0, color="0.85", lw=0.6, zorder=0)
        for place, (name, chosen) in enumerate(models.items()):
            p, z = chosen.best.model.poles(), chosen.best.model.zeros()
            size = 8 - 0.8 * place  # smaller on top, so that agreeing models stay visible
            axes.plot(p.real, p.imag, "x", color=COLOURS[name], ms=size, mew=1.2)
            axes.plot(z.real, z.imag, "o", color=COLOURS[name], ms=0.8 * size, mfc="none", mew=0.9)
        axes.set_aspect("equal")
        axes.set_xlabel("Re z")
    plane.set_ylabel("Im z")
    plane.set_xlim(-1.6, 1.6)
    plane.set_ylim(-1.6, 1.6)
    sample_time = report.estimation[0].sample_time
    reach = float(np.clip(np.sin(2 * np.pi * report.excitation.band_hz[-1] * sample_time) * 2.5, 0.3, 1.1))
    near.set_xlim(1.08 - 2 * reach, 1.08)
    near.set_ylim(-reach, reach)
    near.set_title("slow modes, enlarged")
    plane.set_title("whole plane (zeros beyond are not shown)")
    labels = {name: chosen.best.model.label for name, chosen in models.items()}
    marks = [Line2D([], [], color=COLOURS[name], marker="s", ls="", label=label) for name, label in labels.items()]
    marks += [Line2D([], [], color="0.2", marker="x", ls="", label="pole")]
    marks += [Line2D([], [], color="0.2", marker="o", mfc="none", ls="", label="zero")]
    figure.legend(handles=marks, loc="outside lower center", ncols=4)
    figure.suptitle(f"{report.name}: poles and zeros")
    return figure


DRAWINGS: dict[str, Callable[[Report], Figure]] = {
    "output": output, "bode": bode, "residuals": residuals, "poles_zeros": poles,
}  # fmt: skip
