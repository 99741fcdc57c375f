"""Figures D.1 to D.3: the distribution of the estimates of all subjects."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from fasbody.presentation import PAGE, counted, panels, printed
from identification.study.figures import CONSTANTS, GREY, MODEL, distinct, noted, titled
from identification.study.summary import FEWEST, measured, quartiles


@printed
def boxes(table: pd.DataFrame, origin: str) -> Figure:
    """Estimates of all subjects by frequency, outliers beyond 1.5 interquartile ranges marked.

    Args:
        table: tidy rows of one mode, posture and load.
        origin: of the data.
    """
    rows = table[table["shown"]]
    f = distinct(rows["frequency_hz"].dropna())
    width = 0.55 * min(np.diff(f)) if len(f) > 1 else 1.0
    figure, axes = panels(2, 4, PAGE, 4.2, sharex=True)
    for axis, name in zip(axes.flat, CONSTANTS, strict=True):
        estimates = rows[rows["parameter"] == name]
        scale = titled(axis, estimates, name)
        estimates = estimates[measured(estimates)]
        statistics = [_box(estimates[estimates["frequency_hz"] == at], scale) for at in f]
        drawn = [(s, at) for s, at in zip(statistics, f, strict=True) if s]
        axis.bxp(
            [s for s, _ in drawn], positions=[at for _, at in drawn], widths=width,
            patch_artist=True, manage_ticks=False,
            boxprops={"facecolor": "#dbe7ef", "lw": 0.8},
            medianprops={"color": "#1b1b1b", "lw": 1.4},
            whiskerprops={"lw": 0.8}, capprops={"lw": 0.8},
            flierprops={"marker": "o", "ms": 3.2, "mfc": MODEL, "mec": MODEL},
        )  # fmt: skip
        sizes = estimates.groupby("frequency_hz")["value"].transform("size")
        few = estimates[sizes < FEWEST]
        style = {"ms": 2.6, "mfc": "none", "mew": 0.7, "color": GREY}
        axis.plot(few["frequency_hz"], scale * few["value"], "o", **style)
        count = counted(int(estimates["outlier"].sum()), "outlier")
        place = {"transform": axis.transAxes, "ha": "right", "va": "top"}
        axis.text(0.98, 0.97, count, fontsize=7, color=MODEL, **place)
        axis.margins(y=0.12)
    for axis in axes[-1]:
        axis.set_xlabel("frequency [Hz]")
        axis.set_xticks(f if len(f) < 6 else f[:: -(-len(f) // 5)])
    return noted(
        figure,
        f"{origin.capitalize()} data of {counted(rows['subject'].nunique(), 'subject')}. Boxes: "
        "quartiles (medians of the halves); whiskers: farthest within 1.5 IQR; red: beyond; grey "
        f"circles: fewer than {FEWEST}. In the titles how many estimates are drawn: those at a "
        "bound or without a standard error are not.",
    )


def _box(rows: pd.DataFrame, scale: float) -> dict[str, Any]:
    """What matplotlib wants to know of one box, by the thesis' quartiles."""
    values = scale * rows["value"].to_numpy()
    if values.size < FEWEST:
        return {}
    low, high = quartiles(values)
    outlier = rows["outlier"].to_numpy()
    inside = values[~outlier]
    return {
        "med": np.median(values), "q1": low, "q3": high, "fliers": values[outlier],
        "whislo": min(inside.min(), low), "whishi": max(inside.max(), high),
    }  # fmt: skip
