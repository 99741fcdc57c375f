"""Figures of cycles in the manner of 4.6 to 4.17: traces, hysteresis loops, energies; each returns a Figure."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from identification.figures import panels
from identification.study.figures import MARKERS, MEASURED, MODEL, colour_of, distinct, noted, styled
from identification.study.summary import OPEN, POOR_FIT, follows, nominal

#: Circles of a trace at most, of all samples that are stored.
_CIRCLES = 36
#: Line of a model that does not follow its recording.
_POOR = ":"


def _poor(cycles: Sequence[Mapping[str, Any]]) -> str:
    """What the dotted lines are, where there are any."""
    some = not all(c.get("follows", True) for c in cycles)
    return f"; dotted: the model follows its recording to less than {POOR_FIT:g} %" if some else ""


@styled
def traces(cycles: Sequence[Mapping[str, Any]], fits: Mapping[str, float], origin: str) -> Figure:
    """Figures 4.6 to 4.14: measured and modelled malleolus acceleration of one subject, frequencies by loads.

    Args:
        cycles: entries of the branch shown, with traces. fits: file -> fit percentage. origin: of the data.
    """
    f, loads = distinct(nominal(c["frequency_hz"]) for c in cycles), distinct(c["added_mass_kg"] for c in cycles)
    figure, axes = panels(len(f), len(loads), 2.5 * len(loads) + 0.4, 1.25 * len(f) + 0.7, sharex=True, sharey="row")
    for axis in axes.flat:
        axis.set_visible(False)
    plain = axes.flat[0].title.get_color()
    for c in cycles:
        axis = axes[f.index(nominal(c["frequency_hz"])), loads.index(c["added_mass_kg"])]
        axis.set_visible(True)
        t = np.array(c["trace"]["time_s"]) * c["frequency_hz"]
        good = c.get("follows", True)
        axis.plot(t, c["trace"]["model_m_s2"], lw=1.3, ls="-" if good else _POOR, color=MODEL, label="model", zorder=3)
        axis.plot(
            t, c["trace"]["measured_m_s2"], "o", ms=3, mfc="none", mew=0.6, color=MEASURED, label=origin,
            markevery=max(1, round(t.size / _CIRCLES)),
        )  # fmt: skip
        fit = f": fit {fits[c['file']]:.1f} %" if c["file"] in fits else ""
        axis.set_title(f"{nominal(c['frequency_hz']):g} Hz, {c['added_mass_kg']:g} kg{fit}", fontsize=8, pad=3,
                       color=plain if good else MODEL)  # fmt: skip
        axis.tick_params(labelsize=7)
    for axis in axes[-1]:
        axis.set_xlabel("time [periods]")
    for axis in axes[:, 0]:
        axis.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    figure.supylabel("malleolus acceleration [m/s²]", fontsize=9)
    handles, labels = next(axis for axis in axes.flat if axis.lines).get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, fontsize=8, markerscale=1.6)
    return noted(figure, f"circles: some of the samples{_poor(cycles)}")


@styled
def loops(cycles: Sequence[Mapping[str, Any]], origin: str) -> Figure:
    """Figures 4.15 to 4.17: force against displacement of ankle and fat pad, a loop a frequency, a column a load.

    Args:
        cycles: entries with points of their loops; where `decided` is False they are dashed, where
            `follows` is dotted. origin: of the data.
    """
    loads = distinct(c["added_mass_kg"] for c in cycles)
    figure, axes = panels(2, len(loads), 2.5 * len(loads) + 1.0, 5.0, sharex="row", sharey="row")
    f = [nominal(c["frequency_hz"]) for c in cycles]
    colour = ScalarMappable(Normalize(min(f), max(f)), "viridis_r")
    for c in sorted(cycles, key=lambda c: c["frequency_hz"]):
        for row, part in enumerate(("ankle", "fat_pad")):
            x, F = (np.append(c[part][key], c[part][key][0]) for key in ("displacement_m", "force_n"))
            axis = axes[row, loads.index(c["added_mass_kg"])]
            style = "-" if c.get("decided", True) else (0, (2.5, 1.5))
            style = style if c.get("follows", True) else _POOR
            axis.plot(1e3 * x, F, lw=1.1, ls=style, color=colour.to_rgba(np.array(nominal(c["frequency_hz"]))))
    for column, load in enumerate(loads):
        axes[0, column].set_title(f"talocrural joint, {load:g} kg")
        axes[1, column].set_title(f"fat pad, {load:g} kg")
        axes[1, column].set_xlabel("relative displacement [mm]")
    for row in axes:
        row[0].set_ylabel("force [N]")
        row[0].xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))  # shared by the row
    bar = figure.colorbar(colour, ax=axes, label="frequency [Hz]", shrink=0.7, pad=0.02)
    bar.set_ticks(distinct(f) if len(set(f)) < 12 else [])
    dashed = "; dashed: the branch is not decided" if not all(c.get("decided", True) for c in cycles) else ""
    text = f"model driven by the base of {origin} recordings; area = energy dissipated in one cycle"
    return noted(figure, text + dashed + _poor(cycles))


@styled
def energies(table: pd.DataFrame, origin: str) -> Figure:
    """Energy dissipated in one cycle by ankle and fat pad, and the pad's share: medians and quartiles of the subjects.

    Args:
        table: `summary.cycle_table`, rows of one mode. origin: of the data.
    """
    rows = table[table["shown"] & follows(table["fit_percent"])]
    loads, count = distinct(rows["added_mass_kg"]), rows["subject"].nunique()
    share = 100 * rows["fat_pad_j"] / (rows["fat_pad_j"] + rows["ankle_j"])
    shown = (
        ("talocrural joint", 1e3 * rows["ankle_j"], "energy a cycle [mJ]"),
        ("fat pad", 1e3 * rows["fat_pad_j"], ""),
        ("fat pad's share", share, "share of the whole [%]"),
    )
    figure, axes = panels(1, 3, 8.4, 3.0, sharex=True)
    axes[0, 1].sharey(axes[0, 0])
    for axis, (title, values, label) in zip(axes[0], shown, strict=True):
        for i, load in enumerate(loads):
            at = rows["added_mass_kg"] == load
            grouped = values[at].groupby(rows.loc[at, "frequency_hz"])
            low, middle, high = (grouped.quantile(q) for q in (0.25, 0.5, 0.75))
            shift = 0.5 * (i - (len(loads) - 1) / 2)  # so that the bars do not hide each other
            colour, marker = colour_of(load, loads), MARKERS[i % 5]
            axis.errorbar(
                middle.index + shift, middle, yerr=[middle - low, high - middle], fmt=f"{marker}-", ms=3.8, lw=1.2,
                elinewidth=0.8, capsize=1.5, color=colour, label=f"{load:g} kg added",
            )  # fmt: skip
            open_ = rows[at]["decided_by"].isin(OPEN).groupby(rows.loc[at, "frequency_hz"]).mean() > 0.5
            axis.plot(middle.index[open_] + shift, middle[open_], marker, ms=3.8, mfc="white", color=colour, zorder=4)
        axis.set_title(title)
        axis.set_xlabel("frequency [Hz]")
        axis.set_ylabel(label)
    axes[0, 0].set_yscale("log")
    axes[0, 2].set_ylim(0, 102)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(loads), fontsize=8)
    text = "medians and quartiles over subjects; open: most branches not decided; medians of parts need not add up"
    return noted(figure, f"{origin} data, n = {count}; {text}")
