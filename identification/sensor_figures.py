"""Figures of a fit by sensor, and of the force on the table over a cycle."""

from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from fasbody.recording.harmonics import fit_harmonics

if TYPE_CHECKING:
    from identification.result import FitResult, RecordingFit

_STYLE: Any = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.25,
    "svg.fonttype": "path", "svg.hashsalt": "fasbody", "legend.frameon": False,
}  # fmt: skip
#: One colour a load, apart for the colour-blind.
_LOADS = ("#c8102e", "#1f6fb2", "#2e8b57", "#b8860b", "#8d6a9f")


def sensors(result: "FitResult") -> Figure:
    """Amplitude and phase lag of each sensor over the base at the excited frequencies: data points, model lines."""
    names = list(dict.fromkeys(sensor.name for r in result.recordings for sensor in r.sensors if sensor.harmonics))
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(1.2 + 3.4 * max(1, len(names)), 4.4), layout="constrained")
        axes = figure.subplots(2, max(1, len(names)), squeeze=False, sharex=True)
        loads = sorted({r.added_mass_kg for r in result.recordings})
        for column, name in zip(axes.T, names, strict=False):
            for load, colour in zip(loads, _LOADS * len(loads), strict=False):
                rows = sorted(
                    _over_base(r, name) for r in result.recordings if r.added_mass_kg == load and _has(r, name)
                )
                if not rows:
                    continue
                f, data, model = (np.array(part) for part in zip(*rows, strict=True))
                for H, style, what in ((data, "o", "data"), (model, "-", "model")):
                    label = f"{what}, {load:g} kg added"
                    lag = -np.degrees(np.unwrap(np.angle(H)))
                    column[0].plot(f, np.abs(H), style, ms=4, lw=1.0, color=colour, mfc="none", label=label)
                    column[1].plot(f, lag, style, ms=4, lw=1.0, color=colour, mfc="none")
            column[0].set_title(name, fontsize=9)
            column[1].set_xlabel("frequency [Hz]")
        axes[0, 0].set_ylabel("over the base")
        axes[1, 0].set_ylabel("phase lag [deg]")
        if names:
            axes[0, 0].legend(fontsize=7)
    return figure


def _has(recording: "RecordingFit", name: str) -> bool:
    return any(sensor.name == name and sensor.harmonics for sensor in recording.sensors)


def _over_base(recording: "RecordingFit", name: str) -> tuple[float, complex, complex]:
    """Frequency [Hz], measured and modelled fundamental of a sensor over that of the base."""
    first = next(sensor.harmonics[0] for sensor in recording.sensors if sensor.name == name)
    t = recording.time_s - recording.time_s[0]
    base = complex(fit_harmonics(t, recording.base, first.frequency_hz, 1).amplitudes[0])
    return first.frequency_hz, first.measured / base, first.model / base


def contact(result: "FitResult") -> Figure:
    """The force of the table on the foot over a cycle, a panel a load; below zero the table would have to pull."""
    loads = sorted({each.added_mass_kg for each in result.contact})
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(1.0 + 3.2 * max(1, len(loads)), 3.0), layout="constrained")
        axes = figure.subplots(1, max(1, len(loads)), squeeze=False, sharey=True)[0]
        colours = matplotlib.colormaps["viridis"]
        for axis, load in zip(axes, loads, strict=False):
            rows = sorted((c for c in result.contact if c.added_mass_kg == load), key=lambda c: c.frequency_hz)
            for number, each in enumerate(rows):
                closed = np.append(each.force_n, each.force_n[0])
                colour = colours(0.9 * number / max(1, len(rows) - 1))
                axis.plot(
                    np.linspace(0, 1, closed.size), closed, lw=1.1, color=colour, label=f"{each.frequency_hz:.4g} Hz"
                )
            low = min(min(float(c.force_n.min()) for c in rows), 0.0)
            axis.axhspan(1.08 * low, 0, color="#c8102e", alpha=0.08, lw=0)
            axis.axhline(0, color="#444444", lw=0.8)
            axis.axhline(rows[0].static_force_n, color="#444444", lw=0.8, ls="--")
            axis.set_title(f"{load:g} kg added", fontsize=9)
            axis.set_xlabel("cycle")
            axis.set_xlim(0, 1)
        axes[0].set_ylabel("force on the table [N]")
        if loads:
            axes[-1].legend(fontsize=7, ncols=1, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
