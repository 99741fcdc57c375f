"""Figures in the manner of 2.3 to 2.8 and 2.10: all subjects, means, and the plane of the single mass."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import Akima1DInterpolator

from fasbody.constants import Z95
from fasbody.presentation import COLOURS, MARKS, panels, printed
from fasbody.transmissibility import sdof
from fasbody.transmissibility.table import Condition, Table


def _smooth(f: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spline through the measured points (Akima's does not overshoot); straight lines through fewer than four."""
    known = np.isfinite(values)
    if known.sum() < 4:
        return f[known], values[known]
    fine = np.linspace(f[known][0], f[known][-1], 200)
    return fine, Akima1DInterpolator(f[known], values[known], method="makima")(fine)


def _name(condition: Condition, conditions: Sequence[Condition]) -> str:
    """Load or posture, whichever distinguishes the conditions."""
    by_load = len({mass for _, mass in conditions}) > 1
    by_posture = len({posture for posture, _ in conditions}) > 1
    parts = ([condition[0]] if by_posture or not by_load else []) + ([f"{condition[1]:g} kg"] if by_load else [])
    return ", ".join(parts)


@printed
def subjects(table: Table, pair: str, conditions: Sequence[Condition]) -> Figure:
    """Figures 2.3, 2.4, 2.6, 2.7: every subject thin, the mean heavy, the resonance range shaded."""
    figure, axes = panels(2, len(conditions), 2.4 * len(conditions) + 0.6, 4.6, sharex=True, sharey="row")
    for column, condition in enumerate(conditions):
        c = table.curves(pair, *condition)
        colour = COLOURS[column % len(COLOURS)]
        top, bottom = axes[0, column], axes[1, column]
        for axis, rows, mean in ((top, c.T, c.mean), (bottom, -c.phase_deg, -c.mean_phase_deg)):
            for row in rows:
                axis.plot(*_smooth(c.frequency_hz, row), lw=0.5, color="#8a8a8a", alpha=0.7)
            axis.plot(*_smooth(c.frequency_hz, mean), lw=2.2, color=colour)
            axis.plot(c.frequency_hz, mean, "o", ms=3.5, color=colour)
        top.axhline(1, lw=0.8, ls="--", color="#444444")
        r = c.resonance
        if r.has_range:
            ends = (r.low, r.high) if r.high > r.low else (r.low - 1, r.high + 1)
            hollow: dict[str, Any] = {"fill": False, "ec": colour, "ls": (0, (4, 3)), "lw": 0.9}
            style = {"color": colour, "alpha": 0.15, "lw": 0} if c.resonance_by_tests.confirms(r) else hollow
            for axis in (top, bottom):
                axis.axvspan(*ends, **style)
        label = "no peak or plateau" if r.kind == "none" else f"{'' if r.tested else 'resonance '}{r}"
        top.set_title(f"{_name(condition, conditions)}  (n = {len(c.subjects)})\n{label}")
        bottom.set_xlabel("frequency [Hz]")
    axes[0, 0].set_ylabel(f"{pair} transmissibility")
    axes[1, 0].set_ylabel(f"{pair} phase lag [deg]")
    marks = "shaded: resonance range by section 2.3.1 if significant; dashed: not significant"
    return _origin(figure, table, f"thin: subjects; heavy: mean; {marks}")


@printed
def means(table: Table, conditions: Sequence[Condition]) -> Figure:
    """Figures 2.5 and 2.8: means with 95 % intervals for every pair, an arrow at each resonance."""
    pairs = table.pairs
    figure, axes = panels(2, len(pairs), 2.5 * len(pairs) + 0.6, 4.8, sharex=True, sharey="row")
    highest = 0.0
    alone = not any(np.isfinite(half_interval(c.T)).any() for c in table.each())
    for column, pair in enumerate(pairs):
        top, bottom = axes[0, column], axes[1, column]
        for i, condition in enumerate(conditions):
            c = table.curves(pair, *condition)
            colour, marker = COLOURS[i % len(COLOURS)], MARKS[i % len(MARKS)]
            half = half_interval(c.T)
            shift = 0.0 if alone else 0.45 * (i - (len(conditions) - 1) / 2)  # so that no bar hides another
            top.plot(*_smooth(c.frequency_hz, c.mean), lw=1.4, color=colour)
            top.errorbar(
                c.frequency_hz + shift, c.mean, yerr=None if alone else half, fmt=marker, ms=3.5, lw=0.8,
                capsize=1.5, color=colour, label=_name(condition, conditions),
            )  # fmt: skip
            bottom.plot(*_smooth(c.frequency_hz, -c.mean_phase_deg), lw=1.4, color=colour)
            bottom.plot(c.frequency_hz, -c.mean_phase_deg, marker, ms=3.5, color=colour)
            r = c.resonance
            if r.has_range:
                at = r.top if r.kind == "peak" else 0.5 * (r.low + r.high)
                level = float(np.interp(at, c.frequency_hz, c.mean + np.nan_to_num(half)))
                fill = colour if c.resonance_by_tests.confirms(r) else "white"
                style = {"arrowstyle": "-|>,head_width=0.3,head_length=0.5", "ec": colour, "fc": fill, "lw": 1.1}
                top.annotate("", (at, level + 0.02), (at, level + 0.16), arrowprops=style)
                highest = max(highest, level + 0.17)
        top.axhline(1, lw=0.8, ls="--", color="#444444")
        top.set_title(_PAIRS[pair])
        top.margins(y=0.12)
        highest = max(highest, top.get_ylim()[1])
        bottom.set_xlabel("frequency [Hz]")
    axes[0, 0].set_ylim(top=highest)  # the axes share it; an arrow must not run into a title
    axes[0, 0].set_ylabel("mean transmissibility")
    axes[1, 0].set_ylabel("mean phase lag [deg]")
    if len(conditions) > 1:
        axes[0, -1].legend(loc="upper right")
    else:
        figure.suptitle(_name(conditions[0], conditions) + f", {conditions[0][1]:g} kg")
    bars = "one subject, no intervals" if alone else "bars: 95 % intervals of the mean"
    bars += "; lines: interpolated"
    arrows = (
        "arrows: resonance (peak, middle of a plateau) by section 2.3.1, hollow where not significant"
    )
    return _origin(figure, table, f"{bars}; {arrows}" if any(axis.texts for axis in axes[0]) else bars)


_PAIRS = {"MB": "MB: malleolus / base", "TB": "TB: tuberosity / base", "TM": "TM: tuberosity / malleolus"}


def half_interval(T: np.ndarray) -> np.ndarray:
    """Half of the 95 % interval of each mean (f,), NaN where fewer than two subjects were measured."""
    from scipy.stats import t

    n = np.isfinite(T).sum(axis=0)
    half = np.full(n.size, np.nan)
    known = n > 1
    half[known] = t.ppf(0.975, n[known] - 1) * np.nanstd(T[:, known], axis=0, ddof=1) / np.sqrt(n[known])
    return half


#: Fewer subjects than this have no 80 % band: the lines themselves are drawn.
_BAND_OF = 10


@printed
def spectrum(table: Table, conditions: Sequence[Condition]) -> Figure:
    """Broadband excitation: mean curves over a fine frequency axis, with the band of subjects, or each of a few."""
    pairs = table.pairs
    few = min(len(table.curves(pair, *c).subjects) for pair in pairs for c in conditions) < _BAND_OF
    figure, axes = panels(2, len(pairs), 2.5 * len(pairs) + 0.6, 4.6, sharex=True, sharey="row")
    for column, pair in enumerate(pairs):
        for i, condition in enumerate(conditions):
            c = table.curves(pair, *condition)
            colour = COLOURS[i % len(COLOURS)]
            for axis, rows in ((axes[0, column], c.T), (axes[1, column], -c.phase_deg)):
                if few:
                    axis.plot(c.frequency_hz, rows.T, lw=0.5, color=colour, alpha=0.4)
                else:
                    low, high = np.nanquantile(rows, [0.1, 0.9], axis=0)
                    axis.fill_between(c.frequency_hz, low, high, color=colour, alpha=0.15, lw=0)
                label = _name(condition, conditions)
                axis.plot(c.frequency_hz, np.nanmean(rows, axis=0), lw=1.6, color=colour, label=label)
        axes[0, column].axhline(1, lw=0.8, ls="--", color="#444444")
        axes[0, column].set_title(_PAIRS[pair])
        axes[1, column].set_xlabel("frequency [Hz]")
    axes[0, 0].set_ylabel("mean transmissibility (H1)")
    axes[1, 0].set_ylabel("mean phase lag [deg]")
    axes[0, -1].legend(loc="upper right")
    return _origin(figure, table, "heavy: mean; " + ("thin: subjects" if few else "bands: 80 % of the subjects"))


@printed
def single_mass(
    frequencies_hz: Sequence[float] = (10, 20, 30, 40), m: float = sdof.MASS_KG,
    measured: dict[float, tuple[float, float]] | None = None, origin: str = "",
) -> Figure:  # fmt: skip
    """Figure 2.10: contour lines of the single mass' transmissibility over stiffness and damping.

    Args:
        frequencies_hz: one panel each.
        m: mass [kg].
        measured: frequency -> (transmissibility, standard deviation); where given, the agreeing region is shaded.
        origin: of the measured values, and under which condition, for the caption.
    """
    k, c = np.linspace(1e3, 3e5, 400), np.linspace(20, 3000, 300)
    columns = min(2, len(frequencies_hz))
    rows = -(-len(frequencies_hz) // columns)
    figure, axes = panels(rows, columns, 3.3 * columns, 2.7 * rows, sharex=True, sharey=True)
    levels = (0.4, 0.6, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.5, 2.0, 3.0)
    for axis, f in zip(axes.flat, frequencies_hz, strict=False):
        T = sdof.transmissibility(2 * np.pi * f, m, c[:, None], k)
        lines = axis.contour(k / 1e3, c, T, levels=levels, cmap="viridis", linewidths=0.9)
        _label_lines(axis, lines, k[-1] / 1e3, c[-1])
        title = f"{f:g} Hz"
        if measured and f in measured:
            value, std = measured[f]
            inside = np.abs(T - value) <= Z95 * std
            axis.contourf(k / 1e3, c, inside, levels=(0.5, 1.5), colors=[COLOURS[1]], alpha=0.35)
            axis.contour(k / 1e3, c, T, levels=[value], colors=[COLOURS[1]], linewidths=1.8)
            title += f": T = {value:.2f} ± {Z95 * std:.2f}"
        axis.set_title(title)
        axis.grid(False)
    for axis in axes.flat[len(frequencies_hz) :]:
        axis.set_axis_off()
    for axis in axes[-1]:
        axis.set_xlabel("stiffness k [kN/m]")
    for row in axes:
        row[0].set_ylabel("damping c [N s/m]")
    text = f"contours: transmissibility of a single mass of {m:g} kg"
    text += f"; orange: agrees with the {origin}" if measured else ""
    figure.supxlabel("\n".join(wrap(text, int(17 * figure.get_figwidth()))))
    return figure


def _label_lines(axis: Any, lines: Any, width: float, height: float) -> None:
    """A number on each contour line, within the panel and apart from the others; where there is no room, none."""
    placed: list[np.ndarray] = []
    every = [np.concatenate([*paths, np.empty((0, 2))]) / (width, height) for paths in lines.allsegs]
    for i, level in enumerate(lines.levels):
        inside = ((every[i] > (0.045, 0.06)) & (every[i] < 0.94)).all(axis=1)
        if not inside.any():  # a line along the edge, such as that of 1 at a low frequency
            inside = ((every[i] > (0.025, 0.06)) & (every[i] < 0.94)).all(axis=1)
        points = every[i][inside][::3]
        if not len(points):
            continue
        others = np.concatenate([*every[:i], *every[i + 1 :], np.full((1, 2), 9.0)])[::3]
        lone = np.hypot(*(points[:, None] - others).transpose(2, 0, 1)).min(axis=1)
        apart = np.min([np.hypot(*((points - other) * (1, 1.3)).T) for other in [*placed, np.full(2, 9.0)]], axis=0)
        best = points[np.argmax(np.minimum(apart, 0.2) + 2 * np.minimum(lone, 0.1))]
        if placed and apart.max() < 0.075:
            continue
        placed.append(best)
        box = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.85}
        axis.text(*(best * (width, height)), f"{level:g}", fontsize=6.5, ha="center", va="center", bbox=box)


def _origin(figure: Figure, table: Table, text: str) -> Figure:
    # a line of this size holds about 17 characters an inch; what is cut off would be the origin
    lines = wrap(f"{table.origin} data; {text}", int(17 * figure.get_figwidth()))
    figure.supxlabel("\n".join(lines), color="#444444")
    return figure
