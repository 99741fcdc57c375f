"""The printed figures of a fit, and the rows that each of them draws: one colour a load in all of them."""

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from fasbody.foot.parameters import symbol_and_unit
from fasbody.presentation import COLOURS, MARKS, inline, panels, picture, printed
from fasbody.recording.clock import rate_of
from fasbody.recording.condition import ADDED_MASSES_KG
from fasbody.recording.harmonics import fit_harmonics
from fasbody.transmissibility.estimate import unwrapped
from fasbody.transmissibility.spectra import h1
from identification.derived_quantities import Row, derived
from identification.result import FitResult, RecordingFit

_DATA, _OTHER = "#2b2b2b", "#8a8a8a"
#: The best branch, and its mirror image.
_LINES = ("-", "--")
#: Their colours where each has a band: of the wider interval, and of the narrower one within it.
_SHADES = (("#5a5a5a", "#8e5ba6"), ("#8e5ba6", "#2f78b7"))
_MM, _MJ = 1e3, 1e3


def save(figure: Figure, ending: str) -> bytes:
    """The figure as the content of an .svg or .png file, laid out once for all."""
    data = picture(figure, ending)
    figure.set_layout_engine("none")
    return data


def svg(figure: Figure) -> str:
    """A figure as SVG text, to be put into a page."""
    return inline(save(figure, "svg"))


def of_loads(loads: Iterable[float]) -> dict[float, tuple[str, str]]:
    """Added mass [kg] -> colour and mark: the thesis' loads have the same in every figure, whichever are drawn."""
    distinct = sorted(set(loads))
    order = ADDED_MASSES_KG if set(distinct) <= set(ADDED_MASSES_KG) else distinct
    return {
        load: (COLOURS[order.index(load) % len(COLOURS)], MARKS[order.index(load) % len(MARKS)]) for load in distinct
    }


def _loads(result: FitResult) -> dict[float, tuple[str, str]]:
    return of_loads(recording.added_mass_kg for recording in result.recordings)


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


def _legend(figure: Figure, axes: np.ndarray) -> None:
    """One legend for all panels, above them."""
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2)


def _title(recording: RecordingFit) -> str:
    at = "broadband" if recording.frequency_hz is None else f"{recording.frequency_hz:.4g} Hz"
    return f"{at}, {recording.added_mass_kg:g} kg added"


def trace_rows(result: FitResult) -> list[Row]:
    """Measured and modelled malleolus acceleration, three periods of each recording (or its first second)."""
    rows: list[Row] = []
    for recording in result.recordings:
        start, length = _window(recording)
        window = (recording.time_s >= start) & (recording.time_s < start + length)
        columns = (recording.time_s[window] - start, recording.measured[window], recording.model[window])
        rows += [
            {"file": recording.file, "time_s": float(t), "measured_m_s2": float(x), "model_m_s2": float(y)}
            for t, x, y in zip(*columns, strict=True)
        ]
    return rows


@printed
def traces(result: FitResult) -> Figure:
    """Measured and modelled malleolus acceleration, three periods of each recording (or its first second)."""
    figure, axes = _by_recording(result, 2.0, "time [ms]", "malleolus [m/s²]")
    rows, loads = trace_rows(result), _loads(result)
    for axis, recording in zip(axes.flat, result.recordings, strict=False):
        mine = [row for row in rows if row["file"] == recording.file]
        t = [1e3 * row["time_s"] for row in mine]
        colour, _ = loads[recording.added_mass_kg]
        axis.plot(t, [row["measured_m_s2"] for row in mine], ".", ms=2.5, color=_DATA, label="data")
        axis.plot(t, [row["model_m_s2"] for row in mine], lw=1.1, color=colour, label="model")
        axis.set_title(f"{_title(recording)}: fit {recording.fit_percent:.1f} %")
    _legend(figure, axes)
    return figure


def _window(recording: RecordingFit) -> tuple[float, float]:
    if recording.frequency_hz is None:
        return float(recording.time_s[0]), 1.0
    return float(recording.time_s[recording.time_s.size // 2]), 3 / recording.frequency_hz


@printed
def transmissibility(result: FitResult) -> Figure:
    """Malleolus over base at the excited frequencies with 95 % limits, and its phase lag; both branches' curves."""
    figure, axes = panels(2, 1, 5.2, 5.2, sharex=True)
    quantities, loads = derived(result), _loads(result)
    size, phase = axes[:, 0]
    broadband = [recording for recording in result.recordings if recording.frequency_hz is None]
    for load, (colour, mark) in loads.items():
        mine = sorted(
            (row for row in quantities.data if row["added_mass_kg"] == load), key=lambda row: row["frequency_hz"]
        )
        f = np.array([row["frequency_hz"] for row in mine])
        if mine:
            bars: Any = {"fmt": mark, "ms": 4.5, "mfc": "white", "color": colour, "capsize": 2, "lw": 0.9}
            label = f"data, {load:g} kg added"
            _limits(size, f, mine, ("transmissibility", "lower", "upper"), label=label, **bars)
            lag = unwrapped(np.array([row["phase_lag_deg"] for row in mine]))
            moved = [{**row, "lag": x, "low": x - row["phase_lag_deg"] + row["phase_lower_deg"],
                      "high": x - row["phase_lag_deg"] + row["phase_upper_deg"]}
                     for row, x in zip(mine, lag, strict=True)]  # fmt: skip
            _limits(phase, f, moved, ("lag", "low", "high"), **bars)
        for branch, line in zip(result.branches, _LINES, strict=False):
            curve = [r for r in quantities.curves if r["added_mass_kg"] == load and r["branch"] == branch.name]
            x = [row["frequency_hz"] for row in curve]
            size.plot(x, [row["transmissibility"] for row in curve], line, lw=1.1, color=colour)
            phase.plot(x, unwrapped(np.array([row["phase_lag_deg"] for row in curve])), line, lw=1.1, color=colour)
        for recording in (r for r in broadband if r.added_mass_kg == load):
            for trace, style in (("measured", "."), ("model", "-")):
                f, H = _spectrum_ratio(recording, getattr(recording, trace))
                label = f"{'data' if style == '.' else 'model'}, {load:g} kg added"
                size.plot(f, np.abs(H), style, ms=3, lw=0.9, color=colour, label=label)
                phase.plot(f, -unwrapped(np.degrees(np.angle(H))), style, ms=3, lw=0.9, color=colour)
    for branch, line in zip(result.branches, _LINES, strict=False):
        if quantities.curves:
            where = "" if branch is result.best else " (not seen where both coincide)"
            size.plot([], [], line, lw=1.1, color=_DATA, label=f"{branch.name}{where}")
    size.axhline(1, lw=0.8, ls=":", color="#444444")
    size.set_ylabel("transmissibility")
    phase.set_ylabel("phase lag [deg]")
    phase.set_xlabel("frequency [Hz]")
    size.legend()
    return figure


def _limits(
    axis: Any, x: np.ndarray, rows: Sequence[Row], keys: tuple[str, str, str], scale: float = 1.0, **options: Any
) -> None:
    """Values with their limits, in the unit of the axis; limits that are not known are not drawn."""
    y, low, high = (scale * np.array([row[key] for row in rows], float) for key in keys)
    error = np.nan_to_num(np.maximum([y - low, high - y], 0.0), nan=0.0, posinf=0.0)
    axis.errorbar(x, y, yerr=error, **options)


def _spectrum_ratio(recording: RecordingFit, trace: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (n,) [Hz] and complex ratios (n,) of a broadband trace to the base: H1, 1 Hz apart."""
    estimate = h1(recording.base, trace, rate_of(recording.time_s))
    return estimate.frequency_hz, estimate.H


@printed
def chi_square(result: FitResult) -> Figure:
    """Chi-square of every harmonic of every recording, over the harmonic's frequency."""
    figure, axes = panels(1, 1, 5.2, 3.2)
    axis, rows = axes[0, 0], derived(result).chi_square
    key = "chi_square" if result.departures else "chi_square_if_model_true"
    for load, (colour, mark) in _loads(result).items():
        mine = [row for row in rows if row["added_mass_kg"] == load]
        for first in (True, False):
            part = [row for row in mine if (row["harmonic"] == 1) == first]
            x = [row["frequency_hz"] * row["harmonic"] for row in part]
            y = [max(row[key], _LEAST) for row in part]
            face = colour if first else "white"
            which = "fundamental" if first else "higher harmonics"
            axis.semilogy(x, y, mark, ms=5, color=colour, mfc=face, label=f"{which}, {load:g} kg added")
    axis.axhline(2, lw=0.9, color=_DATA, label="expected: 2")
    axis.axhline(_RARE, lw=0.9, ls="--", color=_DATA, label="exceeded by chance once in 1000")
    axis.set_xlabel("frequency of the harmonic [Hz]")
    axis.set_ylabel("chi-square")
    axis.set_ylim(bottom=0.7 * _LEAST)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


#: A chi-square below this is drawn at it; of two degrees of freedom one in a thousand is larger than that.
_LEAST, _RARE = 1e-2, 13.82


@printed
def modes(result: FitResult) -> Figure:
    """Natural frequencies and damping ratios of small motion under each load, with 95 % limits."""
    rows, loads = derived(result).modes, _loads(result)
    names = list(dict.fromkeys(row["branch"] for row in rows))
    count = max((row["mode"] for row in rows), default=1)
    figure, axes = panels(2, count, 3.4 * count, 4.6, sharex=True)
    kinds = (
        ("natural frequency [Hz]", ("natural_frequency_hz", "lower_hz", "upper_hz")),
        ("damping ratio", ("damping_ratio", "damping_lower", "damping_upper")),
    )
    places = [(name, load) for name in names for load in loads]
    for (row, (title, keys)), mode in product(enumerate(kinds), range(count)):
        axis = axes[row, mode]
        for x, (name, load) in enumerate(places):
            colour, mark = loads[load]
            for number, basis in enumerate(result.intervals):
                mine = [r for r in rows if (r["branch"], r["added_mass_kg"], r["mode"], r["basis"])
                        == (name, load, mode + 1, basis)]  # fmt: skip
                face = colour if number == len(result.intervals) - 1 else "white"
                label = f"{basis}" if x == 0 else None
                at = np.full(len(mine), x + 0.24 * number)
                _limits(axis, at, mine, keys, fmt=mark, ms=4.5, mfc=face, color=colour, capsize=3, label=label)
        axis.set_title(f"mode {mode + 1}" if row == 0 else "")
        axis.set_xlim(-0.5, max(len(places), 1) - 0.25)
        ticks = [f"{load:g}" + (f"\n{name}" if len(names) > 1 else "") for name, load in places]
        axis.set_xticks(np.arange(len(places)) + 0.12, ticks, rotation=90 if len(places) > 4 else 0)
        axes[row, 0].set_ylabel(title)
        axes[1, mode].set_xlabel("added mass [kg]" + (", branch" if len(names) > 1 else ""))
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


@printed
def dampers(result: FitResult) -> Figure:
    """Damping of ankle and fat pad over the displacement that the recordings reached, with bands of 95 %."""
    quantities, loads = derived(result), _loads(result)
    bases = result.intervals if len(result.open) == 1 else result.intervals[:1]  # two bands a foot hide each other
    joints = list(dict.fromkeys(row["damper"] for row in quantities.dampers))
    figure, axes = panels(1, max(1, len(joints)), 3.6 * max(1, len(joints)), 3.2)
    for axis, joint in zip(axes[0], joints, strict=False):
        for branch, line, shades in zip(result.branches, _LINES, _SHADES, strict=False):
            for number, basis in enumerate(bases):
                mine = [r for r in quantities.dampers if (r["damper"], r["branch"], r["basis"])
                        == (joint, branch.name, basis)]  # fmt: skip
                if not mine:
                    continue
                x, c, low, high = (
                    np.array([row[key] for row in mine])
                    for key in ("displacement_m", "damping_n_s_per_m", "lower", "upper")
                )
                shade, name = shades[number > 0], f"{branch.name}, " if len(result.open) > 1 else ""
                axis.fill_between(_MM * x, low, high, color=shade, lw=0, alpha=0.15 + 0.25 * (len(bases) > 1))
                for limit in (low, high):  # the edges of a band can be seen within another
                    axis.plot(_MM * x, limit, line, lw=0.8, color=shade, label=f"{name}{basis}" if limit is low else "")
                if number == 0:
                    estimate = shade if len(result.open) > 1 else _DATA
                    axis.plot(_MM * x, c, line, lw=1.8, color=estimate, zorder=3, label=f"{name}estimate")
        spans = [row for row in quantities.reached if row["damper"] == joint]
        for place, row in enumerate(spans):
            colour, _ = loads[row["added_mass_kg"]]
            axis.plot(
                [_MM * row["lower_m"], _MM * row["upper_m"]], [0.02 + 0.03 * place] * 2, lw=3, color=colour,
                solid_capstyle="butt", transform=axis.get_xaxis_transform(),
                label=f"reached, {row['added_mass_kg']:g} kg added",
            )  # fmt: skip
        low, high = axis.get_ylim()
        axis.set_ylim(low - 0.12 * (high - low), high)
        axis.set_title(joint)
        axis.set_xlabel("relative displacement [mm]")
    axes[0, 0].set_ylabel("damping [N s/m]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


@printed
def energies(result: FitResult) -> Figure:
    """Energy that ankle and fat pad dissipate in a cycle, by frequency and load, with 95 % limits."""
    rows, loads = derived(result).energies, _loads(result)
    joints = list(dict.fromkeys(row["damper"] for row in rows))
    figure, axes = panels(1, max(1, len(joints)), 3.6 * max(1, len(joints)), 3.0, sharey=True)
    series = [*product(zip(result.branches, _LINES, strict=False), loads.items())]
    apart = min(0.9, 3.0 / len(series))  # [Hz], so that no mark hides another
    for axis, joint in zip(axes[0], joints, strict=False):
        for number, ((branch, line), (load, (colour, mark))) in enumerate(series):
            mine = [r for r in rows if (r["damper"], r["branch"], r["basis"], r["added_mass_kg"])
                    == (joint, branch.name, result.intervals[0], load)]  # fmt: skip
            mine.sort(key=lambda row: row["frequency_hz"])
            x = np.array([row["frequency_hz"] for row in mine]) + apart * (number - 0.5 * (len(series) - 1))
            label = f"{load:g} kg added" + (f", {branch.name}" if len(result.open) > 1 else "")
            if mine:
                keys = ("dissipated_j", "lower_j", "upper_j")
                face = colour if line == _LINES[0] else "white"
                style: Any = {"fmt": mark, "ms": 3.5, "mfc": face, "color": colour, "capsize": 1.5, "lw": 0.9}
                _limits(axis, x, mine, keys, _MJ, label=label, **style)
        axis.set_yscale("log")
        axis.set_title(joint)
        axis.set_xlabel("frequency [Hz]")
    axes[0, 0].set_ylabel("energy per cycle [mJ]")
    axes[0, 0].legend()
    return figure


def residual_rows(result: FitResult) -> list[Row]:
    """Amplitude spectrum of what the model leaves, beside that of the recording, up to 160 Hz."""
    rows: list[Row] = []
    for recording in result.recordings:
        window = np.hanning(recording.time_s.size)
        f = np.fft.rfftfreq(recording.time_s.size, (recording.time_s[1] - recording.time_s[0]))
        curves = (recording.measured, recording.measured - recording.model)
        data, rest = (2 * np.abs(np.fft.rfft(signal * window)) / window.sum() for signal in curves)
        rows += [
            {"file": recording.file, "frequency_hz": float(x), "data_m_s2": float(a), "residual_m_s2": float(b)}
            for x, a, b in zip(f[1:], data[1:], rest[1:], strict=True)
            if x <= _HIGHEST_HZ
        ]
    return rows


_HIGHEST_HZ = 160.0


@printed
def residuals(result: FitResult) -> Figure:
    """Amplitude spectrum of what the model leaves, beside that of the recording."""
    figure, axes = _by_recording(result, 1.9, "frequency [Hz]", "amplitude [m/s²]", sharex=True, sharey=True)
    rows, loads = residual_rows(result), _loads(result)
    for axis, recording in zip(axes.flat, result.recordings, strict=False):
        mine = [row for row in rows if row["file"] == recording.file]
        f = [row["frequency_hz"] for row in mine]
        colour, _ = loads[recording.added_mass_kg]
        axis.semilogy(f, [row["data_m_s2"] for row in mine], lw=0.8, color=_OTHER, label="data")
        axis.semilogy(f, [row["residual_m_s2"] for row in mine], lw=0.8, color=colour, label="residual")
        axis.set_title(_title(recording))
        axis.minorticks_off()  # they cost as much as all the rest
        axis.set_xlim(0, _HIGHEST_HZ)
        axis.set_ylim(bottom=1e-5)
    _legend(figure, axes)
    return figure


#: So many panels stand beside each other.
_ABREAST = 5


@printed
def parameters(result: FitResult) -> Figure:
    """Estimates with 95 % intervals of both branches, each parameter on its own scale; the truth where it is known."""
    keys = list(result.parameters)
    rows = 1 if len(keys) <= _ABREAST else 2
    columns = -(-len(keys) // rows)
    figure, axes = panels(rows, columns, 1.35 * columns, 0.5 + 1.9 * rows)
    for axis in axes.flat[len(keys) :]:
        axis.set_axis_off()
    for axis, key in zip(axes.flat, keys, strict=False):
        for place, (branch, colour) in enumerate(zip(result.branches, (_DATA, _OTHER), strict=False)):
            e = branch.parameters[key]
            error = [[max(0.0, e.value - e.lower)], [max(0.0, e.upper - e.value)]]
            style: Any = {"fmt": "o", "ms": 4, "color": colour, "capsize": 3, "label": branch.name}
            if e.at_bound or np.isnan(e.lower):  # no interval
                axis.errorbar([place], [e.value], mfc="white", clip_on=False, **style)
            else:
                axis.errorbar([place], [e.value], yerr=error, **style)
            if e.at_rest and e.at_rest.interval() != e.interval():
                rest = e.at_rest
                axis.errorbar(
                    [place + 0.3], [rest.value], yerr=[[rest.value - rest.lower], [rest.upper - rest.value]],
                    **{**style, "fmt": "D", "ms": 3, "mfc": "white", "label": f"{branch.name}, at rest"},
                )  # fmt: skip
        truth = result.truth_of(key)
        if truth is not None:
            axis.axhline(truth, color=_DATA, lw=1, ls=":", label="truth")
        axis.set_title(label_of(key))
        axis.set_xlim(-0.6, len(result.branches) - 0.4)
        axis.set_xticks([])
        axis.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4))
        axis.yaxis.get_offset_text().set_fontsize(7)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def label_of(key: str) -> str:
    """Symbol and unit of a parameter, for an axis."""
    symbol, unit = symbol_and_unit(key)
    stem, _, index = symbol.partition("_")
    return (f"${stem}_{{{index}}}$" if index else stem) + (f"\n[{unit}]" if unit else "")


@printed
def waterfall(result: FitResult) -> Figure:
    """Final cost of every start, best first, coloured by the branch it ended in."""
    figure, axes = panels(1, 1, 5.2, 2.6)
    axis = axes[0, 0]
    colours = {branch.name: colour for branch, colour in zip(result.branches, (_DATA, _OTHER), strict=False)}
    for name in dict.fromkeys(str(start["branch"]) for start in result.starts):
        rows = [(i + 1, start["cost"]) for i, start in enumerate(result.starts) if start["branch"] == name]
        axis.semilogy(*zip(*rows, strict=True), "o", ms=5, color=colours.get(name, "#888888"), label=name)
    axis.set_xlabel("start, best first")
    axis.set_ylabel("weighted sum of squares")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.legend()
    return figure


@printed
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
            axis.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=7, color="white" if dark else "black")
    figure.colorbar(image, label="correlation", shrink=0.85)
    return figure


@printed
def sensors(result: FitResult) -> Figure:
    """Amplitude and phase lag of each sensor over the base at the excited frequencies: data points, model lines."""
    names = list(dict.fromkeys(sensor.name for r in result.recordings for sensor in r.sensors if sensor.harmonics))
    figure = Figure(figsize=(1.2 + 3.4 * max(1, len(names)), 4.4), layout="constrained")
    axes = figure.subplots(2, max(1, len(names)), squeeze=False, sharex=True)
    loads = _loads(result)
    for column, name in zip(axes.T, names, strict=False):
        for load, (colour, mark) in loads.items():
            mine = [r for r in result.recordings if r.added_mass_kg == load and _has(r, name)]
            rows = sorted((_over_base(r, name) for r in mine), key=lambda row: row[0])
            if not rows:
                continue
            f, data, model = (np.array(part) for part in zip(*rows, strict=True))
            for H, style, what in ((data, mark, "data"), (model, "-", "model")):
                label = f"{what}, {load:g} kg added"
                lag = -np.degrees(np.unwrap(np.angle(H)))
                column[0].plot(f, np.abs(H), style, ms=4, lw=1.0, color=colour, mfc="none", label=label)
                column[1].plot(f, lag, style, ms=4, lw=1.0, color=colour, mfc="none")
        column[0].set_title(name)
        column[1].set_xlabel("frequency [Hz]")
    axes[0, 0].set_ylabel("over the base")
    axes[1, 0].set_ylabel("phase lag [deg]")
    if names:
        axes[0, 0].legend()
    return figure


def _has(recording: RecordingFit, name: str) -> bool:
    return any(sensor.name == name and sensor.harmonics for sensor in recording.sensors)


def _over_base(recording: RecordingFit, name: str) -> tuple[float, complex, complex]:
    """Frequency [Hz], measured and modelled fundamental of a sensor over that of the base."""
    first = next(sensor.harmonics[0] for sensor in recording.sensors if sensor.name == name)
    t = recording.time_s - recording.time_s[0]
    base = complex(fit_harmonics(t, recording.base, first.frequency_hz, 1).amplitudes[0])
    return first.frequency_hz, first.measured / base, first.model / base


@printed
def contact(result: FitResult) -> Figure:
    """The force of the table on the foot over a cycle, a panel a load; below zero the table would have to pull."""
    loads = sorted({contact.added_mass_kg for contact in result.contact})
    frequencies = sorted({round(contact.frequency_hz, 1) for contact in result.contact})
    figure, axes = panels(1, max(1, len(loads)), 1.0 + 3.0 * max(1, len(loads)), 3.2, sharey=True)
    lines, pulls = {}, None
    for axis, load in zip(axes[0], loads, strict=False):
        rows = sorted((c for c in result.contact if c.added_mass_kg == load), key=lambda c: c.frequency_hz)
        for contact in rows:
            closed, f = np.append(contact.force_n, contact.force_n[0]), round(contact.frequency_hz, 1)
            colour = matplotlib.colormaps["viridis"](0.9 * frequencies.index(f) / max(1, len(frequencies) - 1))
            lines[f] = axis.plot(np.linspace(0, 1, closed.size), closed, lw=1.1, color=colour, label=f"{f:g} Hz")[0]
        low = min(min(float(c.force_n.min()) for c in rows), 0.0)
        if low < 0:
            pulls = axis.axhspan(1.08 * low, 0, color="#c8102e", alpha=0.08, lw=0, label="the table would have to pull")
        axis.axhline(0, color="#444444", lw=0.8)
        rest = axis.axhline(rows[0].static_force_n, color="#444444", lw=0.8, ls="--", label="at rest")
        axis.set_title(f"{load:g} kg added")
        axis.set_xlabel("part of the cycle")
        axis.set_xlim(0, 1)
    axes[0, 0].set_ylabel("force on the table [N]")
    if loads:
        named = [handle for handle in (rest, pulls) if handle is not None]
        figure.legend(handles=[*named, *(lines[f] for f in frequencies[:_NAMED])], loc="outside lower center", ncols=4)
    return figure


#: So many lines are named beside a figure.
_NAMED = 12


def contact_rows(result: FitResult) -> list[Row]:
    """Force of the table on the foot over a cycle of each recording."""
    return [
        {"file": c.file, "added_mass_kg": c.added_mass_kg, "frequency_hz": c.frequency_hz, "time_s": t, "force_n": n}
        for c in result.contact
        for t, n in zip(c.time_s.tolist(), c.force_n.tolist(), strict=True)
    ]


def sensor_rows(result: FitResult) -> list[Row]:
    """Harmonics of every sensor, measured and modelled; none where the malleolus is alone."""
    return [
        {"file": r.file, "added_mass_kg": r.added_mass_kg, "sensor": sensor.name, **line.document()}
        for r in result.recordings
        for sensor in r.sensors
        for line in sensor.harmonics
        if result.by_sensor
    ]
