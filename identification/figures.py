"""The printed figures of a fit, as SVG text: traces, residuals, parameters of both branches, the start waterfall."""

from io import StringIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from fasbody.foot.parameters import symbol_and_unit
from fasbody.recording.harmonics import fit_harmonics
from fasbody.transmissibility.estimate import ratio, unwrapped
from fasbody.transmissibility.spectra import h1
from identification.result import FitResult, RecordingFit
from identification.sensor_figures import contact as contact
from identification.sensor_figures import sensors as sensors

_MEASURED, _MODEL, _OTHER, _TRUTH = "#2b2b2b", "#c8102e", "#1f6fb2", "#2e8b57"
#: One colour an added mass, apart for the colour-blind.
_MASSES = ("#c8102e", "#1f6fb2", "#2e8b57", "#b8860b", "#8d6a9f")
STYLE: Any = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.25,
    "svg.fonttype": "path", "svg.hashsalt": "fasbody", "legend.frameon": False,
}  # fmt: skip


def svg(figure: Figure) -> str:
    """A figure as SVG text without date or declaration, to be put into a page."""
    text = StringIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def panels(rows: int, columns: int, width: float, height: float, **options: object) -> tuple[Figure, np.ndarray]:
    """A figure of width x height [inches] and its axes, shape (rows, columns)."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        return figure, figure.subplots(rows, columns, squeeze=False, **options)  # type: ignore[call-overload]


def _by_recording(result: FitResult, height: float, x: str, y: str, **options: object) -> tuple[Figure, np.ndarray]:
    """One panel a recording, three in a row, labelled at the left and the lower edge; spare ones are blank."""
    count = len(result.recordings)
    columns = min(3, count)
    rows = -(-count // columns)
    figure, axes = panels(rows, columns, 3.6 * columns, height * rows, **options)
    for axis in axes.flat[count:]:
        axis.set_axis_off()
    for axis in axes[-1]:
        axis.set_xlabel(x)
    for row in axes:
        row[0].set_ylabel(y)
    return figure, axes


def _title(recording: RecordingFit) -> str:
    at = "broadband" if recording.frequency_hz is None else f"{recording.frequency_hz:.4g} Hz"
    return f"{at}, {recording.added_mass_kg:g} kg added"


def traces(result: FitResult) -> Figure:
    """Measured and modelled malleolus acceleration, three periods of each recording (or its first second)."""
    figure, axes = _by_recording(result, 2.3, "time [ms]", "malleolus [m/s²]")
    for axis, recording in zip(axes.flat, result.recordings, strict=False):
        start, length = _window(recording)
        shown = (recording.time_s >= start) & (recording.time_s < start + length)
        t = 1e3 * (recording.time_s[shown] - start)
        axis.plot(t, recording.measured[shown], ".", ms=2.5, color=_MEASURED, label="data")
        axis.plot(t, recording.model[shown], lw=1.1, color=_MODEL, label="model")
        axis.set_title(f"{_title(recording)}: fit {recording.fit_percent:.1f} %", fontsize=9)
    axes[0, 0].legend(loc="upper right", fontsize=7)
    return figure


def _window(recording: RecordingFit) -> tuple[float, float]:
    middle = float(recording.time_s[recording.time_s.size // 2])
    length = 1.0 if recording.frequency_hz is None else 3 / recording.frequency_hz
    return (float(recording.time_s[0]), length) if recording.frequency_hz is None else (middle, length)


def transmissibility(result: FitResult) -> Figure:
    """Malleolus over base of data and model at the excited frequencies, and the phase lag, one colour an added mass."""
    figure, axes = panels(2, 1, 5.2, 4.6, sharex=True)
    masses = sorted({recording.added_mass_kg for recording in result.recordings})
    for mass, colour in zip(masses, _MASSES * len(masses), strict=False):
        fits = [recording for recording in result.recordings if recording.added_mass_kg == mass]
        for trace, style, name in (("measured", "o", "data"), ("model", "x-", "model")):
            found = [_response(recording, getattr(recording, trace)) for recording in fits]
            f, H = (np.concatenate(part) for part in zip(*found, strict=True))
            order = np.argsort(f, kind="stable")
            lag = -unwrapped(np.degrees(np.angle(H[order])))
            label = f"{name}, {mass:g} kg added"
            for axis, values in ((axes[0, 0], np.abs(H[order])), (axes[1, 0], lag)):
                axis.plot(f[order], values, style, ms=4, lw=0.9, color=colour, mfc="none", label=label)
    axes[0, 0].axhline(1, lw=0.8, ls="--", color="#444444")
    axes[0, 0].set_ylabel("transmissibility")
    axes[1, 0].set_ylabel("phase lag [deg]")
    axes[1, 0].set_xlabel("frequency [Hz]")
    axes[0, 0].legend(fontsize=7)
    figure.suptitle(f"{result.source} ({result.origin}), model {result.model}", fontsize=9)
    return figure


def _response(recording: RecordingFit, trace: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (n,) [Hz] and complex ratios (n,) of a trace to the base; H1 (1 Hz apart) for broadband ones."""
    t = recording.time_s
    if recording.frequency_hz is None:
        estimate = h1(recording.base, trace, (t.size - 1) / (t[-1] - t[0]))
        return estimate.frequency_hz, estimate.H
    fits = [fit_harmonics(t, values, recording.frequency_hz, 1) for values in (trace, recording.base)]
    return np.array([recording.frequency_hz]), np.array([ratio(*fits)[0]])


def residuals(result: FitResult) -> Figure:
    """Amplitude spectrum of what the model leaves, beside that of the recording."""
    figure, axes = _by_recording(result, 2.0, "frequency [Hz]", "amplitude [m/s²]", sharex=True, sharey=True)
    for axis, recording in zip(axes.flat, result.recordings, strict=False):
        window = np.hanning(recording.time_s.size)
        f = np.fft.rfftfreq(recording.time_s.size, (recording.time_s[1] - recording.time_s[0]))
        for signal, colour, label in (
            (recording.measured, _MEASURED, "data"),
            (recording.measured - recording.model, _MODEL, "residual"),
        ):
            amplitude = 2 * np.abs(np.fft.rfft(signal * window)) / window.sum()
            axis.semilogy(f[1:], amplitude[1:], lw=0.8, color=colour, label=label)
        axis.set_title(_title(recording), fontsize=9)
        axis.set_xlim(0, 160)
        axis.set_ylim(bottom=1e-5)
    axes[0, 0].legend(loc="upper right", fontsize=7)
    return figure


def parameters(result: FitResult) -> Figure:
    """Estimates with 95 % intervals of both branches, each parameter on its own scale; the truth where it is known."""
    keys = list(result.parameters)
    figure, axes = panels(1, len(keys), 1.35 * len(keys), 2.6)
    for axis, key in zip(axes[0], keys, strict=True):
        for place, (branch, colour) in enumerate(zip(result.branches, (_MODEL, _OTHER), strict=False)):
            e = branch.parameters[key]
            error = [[max(0.0, e.value - e.lower)], [max(0.0, e.upper - e.value)]]
            axis.errorbar([place], [e.value], yerr=error, fmt="o", ms=4, color=colour, capsize=3, label=branch.name)
        truth = result.truth_of(key)
        if truth is not None:
            axis.axhline(truth, color=_TRUTH, lw=1, label="truth")
        axis.set_title(label_of(key), fontsize=8)
        axis.set_xlim(-0.6, len(result.branches) - 0.4)
        axis.set_xticks([])
        axis.tick_params(labelsize=7)
        axis.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4))
        axis.yaxis.get_offset_text().set_fontsize(7)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)
    return figure


def label_of(key: str) -> str:
    """Symbol and unit of a parameter, for an axis."""
    symbol, unit = symbol_and_unit(key)
    stem, _, index = symbol.partition("_")
    return (f"${stem}_{{{index}}}$" if index else stem) + (f"\n[{unit}]" if unit else "")


def waterfall(result: FitResult) -> Figure:
    """Final cost of every start, best first, coloured by the branch it ended in."""
    figure, axes = panels(1, 1, 5.2, 2.6)
    axis = axes[0, 0]
    colours = {branch.name: colour for branch, colour in zip(result.branches, (_MODEL, _OTHER), strict=False)}
    for name in dict.fromkeys(str(start["branch"]) for start in result.starts):
        rows = [(i + 1, start["cost"]) for i, start in enumerate(result.starts) if start["branch"] == name]
        axis.semilogy(*zip(*rows, strict=True), "o", ms=5, color=colours.get(name, "#888888"), label=name)
    axis.set_xlabel("start, best first")
    axis.set_ylabel("weighted sum of squares")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.legend(fontsize=8)
    return figure


def correlation(result: FitResult) -> Figure:
    """Correlation matrix of the estimates of the likelier branch."""
    keys = list(result.parameters)
    figure, axes = panels(1, 1, 4.2, 3.6)
    axis = axes[0, 0]
    matrix = np.array(result.best.correlation)
    image = axis.imshow(matrix, vmin=-1, vmax=1, cmap="RdBu_r")
    labels = [label_of(key).split("\n")[0] for key in keys]
    axis.set_xticks(range(len(keys)), labels)
    axis.set_yticks(range(len(keys)), labels)
    axis.grid(False)
    for i, row in enumerate(matrix):
        for j, value in enumerate(row):
            dark = abs(value) > 0.6
            axis.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=6, color="white" if dark else "black")
    figure.colorbar(image, label="correlation", shrink=0.85)
    return figure
