"""Figures of a whole study in the manner of 4.6 to 4.25 and D.1 to D.3; every function returns a matplotlib Figure."""

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from io import BytesIO
from textwrap import fill
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from identification.figures import STYLE, label_of, panels
from identification.study.means import BAND, FEWEST, POSITIVE, mean_curve
from identification.study.summary import FEWEST as FEWEST_OF_A_BOX
from identification.study.summary import OPEN, measured, quartiles

#: Colour-blind safe, and different in grey: the loads.
_LOADS = ("#1b1b1b", "#d1495b", "#2e86ab", "#66a182", "#edae49")
MARKERS = ("o", "s", "^", "D", "v")
MODEL, MEASURED, GREY = "#d1495b", "#2b2b2b", "#555555"
#: The constants in the order of Figures 4.18 to 4.25.
CONSTANTS = ("k_T", "c_11", "c_12", "c_13", "k_F", "c_21", "c_22", "c_23")
#: Letters of a remark to an inch of the figure's width.
_LETTERS = 17
#: Constants that differ by powers of ten, and get such an axis.
_WIDE = ("k_T", "k_F", "c_11", "c_21")
_SCALE = {"N/m": (1e-3, "kN/m"), "s": (1e3, "ms")}


def save(figure: Figure, ending: str) -> bytes:
    """The figure as the content of an .svg or .png file, the same bytes whenever it is drawn."""
    out = BytesIO()
    with matplotlib.rc_context(STYLE):
        if figure.get_layout_engine() is not None:  # laid out once, however often it is saved
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        figure.savefig(out, format=ending, dpi=180, metadata={"Date": None} if ending == "svg" else None)
    return out.getvalue()


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw with the reports' style, and leave matplotlib's own as it is."""

    @wraps(draw)
    def drawn(*args: Any, **options: Any) -> Figure:
        with matplotlib.rc_context({**STYLE, "axes.titlesize": 9, "axes.labelsize": 9, "grid.linewidth": 0.5}):
            return draw(*args, **options)

    return drawn


def colour_of(load: float, loads: Sequence[float]) -> str:
    """The colour of one of the loads [kg]."""
    return _LOADS[list(loads).index(load) % len(_LOADS)]


def noted(figure: Figure, text: str) -> Figure:
    """Write a remark below a figure, in as many lines as its width asks for."""
    figure.supxlabel(fill(text, int(_LETTERS * figure.get_figwidth())), fontsize=7.5, color=GREY)
    return figure


def distinct(values: Iterable[float]) -> list[float]:
    """Each value once, ascending."""
    return sorted(set(values))


@styled
def curves(table: pd.DataFrame, origin: str) -> Figure:
    """Figures 4.18 to 4.25: spline-fitted means over frequency by load with 95 % bands, estimates as dots.

    Args:
        table: tidy rows of one mode and posture. origin: of the data.
    """
    rows = table[table["shown"]]
    loads, count = distinct(rows["added_mass_kg"]), rows["subject"].nunique()
    figure, axes = panels(2, 4, 10.4, 5.4, sharex=True)
    for axis, name in zip(axes.flat, CONSTANTS, strict=True):
        own = rows[rows["parameter"] == name]
        scale = _title(axis, own, name)
        ends = []
        for i, load in enumerate(loads):
            at, colour = own[own["added_mass_kg"] == load], colour_of(load, loads)
            c = mean_curve(at)
            axis.fill_between(c.frequency_hz, scale * c.lower, scale * c.upper, color=colour, alpha=0.18, lw=0)
            axis.plot(c.frequency_hz, scale * c.mean, lw=2, color=colour)
            true = at[at["truth"] > 0] if name in POSITIVE else at.dropna(subset=["truth"])
            of = true.groupby("frequency_hz")["truth"]
            mean = of.agg(lambda v: np.exp(np.log(v).mean())) if name in POSITIVE else of.mean()
            axis.plot(mean.index, scale * mean, lw=1.1, ls=(0, (4, 2)), color=colour)
            dots = at[~at["outlier"] & measured(at)]
            f = dots["frequency_hz"] + 0.7 * (i - (len(loads) - 1) / 2)  # so that loads do not hide each other
            told = ~dots["decided_by"].isin(OPEN)
            axis.plot(f[told], scale * dots.loc[told, "value"], "o", ms=2.2, mew=0, color=colour, alpha=0.55)
            axis.plot(f[~told], scale * dots.loc[~told, "value"], "o", ms=2.4, mew=0.4, mfc="none", mec=colour,
                      alpha=0.55)  # fmt: skip
            ends += [*(scale * dots["value"]), *(scale * mean), *(scale * c.mean)]
        _limit(axis, np.array(ends, float), name)
    for axis in axes[-1]:
        axis.set_xlabel("frequency [Hz]")
    mean_ = ", mean" if count >= FEWEST else ""
    handles = [Line2D([], [], lw=2, color=colour_of(load, loads), label=f"{load:g} kg{mean_}") for load in loads]
    handles.append(Line2D([], [], marker="o", ls="", ms=3.5, mew=0, color=GREY, label="estimate"))
    handles.append(Line2D([], [], marker="o", ls="", ms=3.5, mfc="none", color=GREY, label="branch not decided"))
    if rows["truth"].notna().any():
        handles.append(Line2D([], [], lw=1.1, ls=(0, (4, 2)), color=GREY, label="truth, mean"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=8.5)
    return noted(
        figure,
        f"{origin} data, n = {count}; means (geometric, of c_12 and c_22 arithmetic) of the estimates with a standard "
        f"error within 1.5 IQR, where {FEWEST} subjects or more have one; bands: 95 % of the mean, jackknife over "
        f"{BAND} subjects or more; in the titles how many of the estimates are drawn",
    )


def _limit(axis: Axes, values: np.ndarray, name: str) -> None:
    """Ordinate over estimates and curves: a band from three subjects may be far wider and would hide them."""
    shown = values[np.isfinite(values)]
    if not shown.size:
        return
    low, high = float(shown.min()), float(shown.max())
    if name in _WIDE and low > 0:
        axis.set_yscale("log")
        axis.set_ylim(low / 1.3, high * 1.3)
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 100 * low else (1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.yaxis.set_minor_formatter(NullFormatter())
    else:
        margin = 0.06 * (high - low or abs(high) or 1.0)
        axis.set_ylim(0 if name in POSITIVE and low >= 0 else low - margin, high + margin)


def _title(axis: Axes, rows: pd.DataFrame, name: str) -> float:
    """Title of a parameter's panel with its unit and how many are drawn; returns what to multiply values by."""
    unit = rows["unit"].iloc[0] if len(rows) else ""
    scale, shown = _SCALE.get(unit, (1.0, unit))
    number = f"{int(measured(rows).sum())} of {len(rows)}" if len(rows) else "not estimated"
    axis.set_title(f"{label_of(name)} [{shown}], {number}")
    return scale


@styled
def boxes(table: pd.DataFrame, origin: str) -> Figure:
    """Figures D.1 to D.3: estimates of all subjects by frequency, outliers beyond 1.5 interquartile ranges marked.

    Args:
        table: tidy rows of one mode, posture and load. origin: of the data.
    """
    rows = table[table["shown"]]
    f = distinct(rows["frequency_hz"].dropna())
    width = 0.55 * min(np.diff(f)) if len(f) > 1 else 1.0
    figure, axes = panels(2, 4, 10.4, 5.2, sharex=True)
    for axis, name in zip(axes.flat, CONSTANTS, strict=True):
        own = rows[rows["parameter"] == name]
        scale = _title(axis, own, name)
        own = own[measured(own)]
        stats = [_box(own[own["frequency_hz"] == at], scale) for at in f]
        drawn = [(s, at) for s, at in zip(stats, f, strict=True) if s]
        axis.bxp(
            [s for s, _ in drawn], positions=[at for _, at in drawn], widths=width,
            patch_artist=True, manage_ticks=False,
            boxprops={"facecolor": "#dbe7ef", "lw": 0.8}, medianprops={"color": "#1b1b1b", "lw": 1.4},
            whiskerprops={"lw": 0.8}, capprops={"lw": 0.8},
            flierprops={"marker": "o", "ms": 3.2, "mfc": MODEL, "mec": MODEL},
        )  # fmt: skip
        few = own[own.groupby("frequency_hz")["value"].transform("size") < FEWEST_OF_A_BOX]
        axis.plot(few["frequency_hz"], scale * few["value"], "o", ms=2.6, mfc="none", mew=0.7, color=GREY)
        count = int(own["outlier"].sum())
        axis.text(0.98, 0.97, f"{count} outlier{'' if count == 1 else 's'}", transform=axis.transAxes, ha="right",
                  va="top", fontsize=7, color=MODEL)  # fmt: skip
        axis.margins(y=0.12)
    for axis in axes[-1]:
        axis.set_xlabel("frequency [Hz]")
        axis.set_xticks(f if len(f) < 12 else f[::2])
    text = (
        f"boxes: quartiles as medians of the halves; whiskers: farthest within 1.5 IQR; red: beyond; grey: fewer than "
        f"{FEWEST_OF_A_BOX}; in the titles how many estimates are drawn: those at a bound or without a standard error "
        "are not"
    )
    return noted(figure, f"{origin} data, n = {rows['subject'].nunique()}; {text}")


def _box(rows: pd.DataFrame, scale: float) -> dict[str, Any]:
    """What matplotlib wants to know of one box, by the thesis' quartiles."""
    values = scale * rows["value"].to_numpy()
    if values.size < FEWEST_OF_A_BOX:
        return {}
    low, high = quartiles(values)
    inside = values[~rows["outlier"].to_numpy()]
    return {"med": np.median(values), "q1": low, "q3": high, "whislo": min(inside.min(), low),
            "whishi": max(inside.max(), high), "fliers": values[rows["outlier"].to_numpy()]}  # fmt: skip
