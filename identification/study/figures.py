"""Figures of a whole study; every function returns a matplotlib Figure.

Of the feet: constants over frequency (4.18 to 4.25), their distributions (D.1 to D.3), and the persons behind them. Of
the motion: transmissibility (in place of the traces 4.6 to 4.14), hysteresis loops (4.15 to 4.17) and energies.
"""

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from fasbody.presentation import PAGE, counted, picture, printed
from identification.advice import POOR_FIT, follows
from identification.branches import EXCHANGED
from identification.figures import label_of, of_loads, panels
from identification.study.means import BAND, FEWEST, POSITIVE, mean_curve
from identification.study.summary import FEWEST as FEWEST_OF_A_BOX
from identification.study.summary import OPEN, measured, nominal, quartiles
from identification.study.tables import circled, left_out

if TYPE_CHECKING:
    from identification.study.population import Population

MODEL, GREY = "#d1495b", "#555555"  #: The constants in the order of Figures 4.18 to 4.25.
CONSTANTS = ("k_T", "c_11", "c_12", "c_13", "k_F", "c_21", "c_22", "c_23")
#: Letters of a remark to an inch of the figure's width.
_LETTERS = 17
#: Constants that differ by powers of ten, and get such an axis.
_WIDE = ("k_T", "k_F", "c_11", "c_21")
#: How dark an estimate is whose branch is decided, and one whose branch is not.
_DECIDED, _OPEN, _FAINT = 0.8, 0.65, 0.35
#: Line of a model, and of one that does not follow its recordings.
_LINE, _POOR = "-", ":"
_SCALE = {"N/m": (1e-3, "kN/m"), "s": (1e3, "ms")}


def save(figure: Figure, ending: str) -> bytes:
    """The figure as the content of an .svg or .png file, the same bytes whenever it is drawn."""
    if figure.get_layout_engine() is not None:  # laid out once, however often it is saved
        printed(figure.draw_without_rendering)()
        figure.set_layout_engine("none")
    return picture(figure, ending)


def noted(figure: Figure, text: str) -> Figure:
    """Write a remark below a figure, in as many lines as its width asks for."""
    figure.supxlabel(fill(text, int(_LETTERS * figure.get_figwidth())), color=GREY)
    return figure


def distinct(values: Iterable[float]) -> list[float]:
    """Each value once, ascending."""
    return sorted(set(values))


@printed
def curves(table: pd.DataFrame, origin: str) -> Figure:
    """Figures 4.18 to 4.25: estimates over frequency by load; means and bands of those whose branch is decided.

    Args:
        table: tidy rows of one mode and posture. origin: of the data.
    """
    rows = table[table["shown"]]
    loads = of_loads(rows["added_mass_kg"])
    figure, axes = panels(2, 4, PAGE, 4.3, sharex=True)
    for axis, name in zip(axes.flat, CONSTANTS, strict=True):
        own = rows[rows["parameter"] == name]
        scale = _title(axis, own, name)
        ends: list[float] = []
        for i, (load, (colour, mark)) in enumerate(loads.items()):
            at = own[own["added_mass_kg"] == load]
            true = at[at["truth"] > 0] if name in POSITIVE else at.dropna(subset=["truth"])
            of = true.groupby("frequency_hz")["truth"]
            mean = of.agg(lambda v: np.exp(np.log(v).mean())) if name in POSITIVE else of.mean()
            axis.plot(mean.index, scale * mean, lw=1.3, ls=(0, (4, 2)), color=colour, label="truth")
            dots = at[~at["outlier"] & measured(at)]
            told = ~dots["decided_by"].isin(OPEN)
            c = mean_curve(dots[told], at["frequency_hz"])
            axis.fill_between(c.frequency_hz, scale * c.lower, scale * c.upper, color=colour, alpha=0.18, lw=0)
            axis.plot(c.frequency_hz, scale * c.mean, lw=2, color=colour, label="mean")
            f = dots["frequency_hz"] + 0.7 * (i - (len(loads) - 1) / 2)  # so that loads do not hide each other
            value, low, high = (scale * dots[name] for name in ("value", "lower", "upper"))
            ends_of = (low.fillna(value), high.fillna(value))
            axis.vlines(f, *ends_of, color=colour, lw=0.6, alpha=_FAINT)
            axis.plot(f[told], value[told], mark, ms=2.8, mew=0, color=colour, alpha=_DECIDED)
            axis.plot(f[~told], value[~told], mark, ms=3.2, mew=0.8, mfc="white", mec=colour, alpha=_OPEN)
            ends += [*value, *(scale * mean), *(scale * c.mean)]
        _limit(axis, np.array(ends, float), name)
    for axis in axes[-1]:
        axis.set_xlabel("frequency [Hz]")
    handles = [Line2D([], [], marker=mark, ls="-", lw=0.6, ms=4, mew=0, color=colour, label=f"{load:g} kg added")
               for load, (colour, mark) in loads.items()]  # fmt: skip
    fits = rows.drop_duplicates("key")
    decided = int((~fits["decided_by"].isin(OPEN)).sum())
    drawn = any(line.get_label() == "mean" and len(line.get_xdata()) for axis in axes.flat for line in axis.lines)
    if decided:
        handles.append(Line2D([], [], marker="o", ls="", ms=4, mew=0, color=GREY, label="branch decided"))
    if decided < len(fits):
        handles.append(Line2D([], [], marker="o", ls="", ms=4, mfc="none", color=GREY, label="branch not decided"))
    if drawn:
        handles.append(Line2D([], [], lw=2, color=GREY, label="mean of the decided"))
    if rows["truth"].notna().any():
        handles.append(Line2D([], [], lw=1.3, ls=(0, (4, 2)), color=GREY, label="truth"))
    figure.legend(handles=handles, loc="outside upper center", handletextpad=0.4, columnspacing=1.0,
                  ncols=len(handles) if len(handles) < 7 else 4)  # fmt: skip
    truth = "; truth: the mean over these subjects" if rows["truth"].notna().any() else ""
    means = (
        f" Means where {FEWEST} subjects or more are decided (geometric, of c_12 and c_22 arithmetic); bands: 95 % of "
        f"the mean, jackknife over {BAND} or more{truth}."
        if drawn
        else f" No mean is drawn of fewer than three decided subjects{truth}."
    )
    return noted(
        figure,
        f"{origin.capitalize()} data of {counted(rows['subject'].nunique(), 'subject')}. Bars: 95 % of each estimate, "
        "cut at the frame; in the titles how many estimates have one, and are drawn. The branch is decided in "
        f"{decided} of {len(fits)} fits; elsewhere ankle and pad may have changed places, and the likelier branch is "
        f"drawn.{means}{_nowhere(rows)}",
    )


def _nowhere(rows: pd.DataFrame) -> str:
    """Frequencies at which nothing could be drawn, in a clause."""
    there = set(rows.loc[measured(rows) & ~rows["outlier"], "frequency_hz"])
    none = [f for f in distinct(rows["frequency_hz"]) if f not in there]
    return f" At {', '.join(f'{f:g}' for f in none)} Hz none has one." if none else ""


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


@printed
def boxes(table: pd.DataFrame, origin: str) -> Figure:
    """Figures D.1 to D.3: estimates of all subjects by frequency, outliers beyond 1.5 interquartile ranges marked.

    Args:
        table: tidy rows of one mode, posture and load. origin: of the data.
    """
    rows = table[table["shown"]]
    f = distinct(rows["frequency_hz"].dropna())
    width = 0.55 * min(np.diff(f)) if len(f) > 1 else 1.0
    figure, axes = panels(2, 4, PAGE, 4.2, sharex=True)
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
        axis.set_xticks(f if len(f) < 6 else f[:: -(-len(f) // 5)])
    return noted(
        figure,
        f"{origin.capitalize()} data of {counted(rows['subject'].nunique(), 'subject')}. Boxes: quartiles (medians of "
        f"the halves); whiskers: farthest within 1.5 IQR; red: beyond; grey circles: fewer than {FEWEST_OF_A_BOX}. In "
        "the titles how many estimates are drawn: those at a bound or without a standard error are not.",
    )


def _box(rows: pd.DataFrame, scale: float) -> dict[str, Any]:
    """What matplotlib wants to know of one box, by the thesis' quartiles."""
    values = scale * rows["value"].to_numpy()
    if values.size < FEWEST_OF_A_BOX:
        return {}
    low, high = quartiles(values)
    inside = values[~rows["outlier"].to_numpy()]
    return {"med": np.median(values), "q1": low, "q3": high, "whislo": min(inside.min(), low),
            "whishi": max(inside.max(), high), "fliers": values[rows["outlier"].to_numpy()]}  # fmt: skip


def _poor(cycles: Sequence[Mapping[str, Any]]) -> str:
    """What the dotted lines are, where there are any."""
    some = not all(c.get("follows", True) for c in cycles)
    return f" Dotted: the fit follows its recordings to less than {POOR_FIT:g} % in the mean." if some else ""


@printed
def transmissibility(cycles: Sequence[Mapping[str, Any]], origin: str) -> Figure:
    """Malleolus over base of one subject, measured and by the model fitted: all that a steady sine says, in one figure.

    Args:
        cycles: entries of the branch shown. origin: of the data.
    """
    loads = of_loads(c["added_mass_kg"] for c in cycles)
    figure, axes = panels(1, 2, PAGE, 2.9, sharex=True)
    size, phase = axes[0]
    for load, (colour, mark) in loads.items():
        own = sorted((c for c in cycles if c["added_mass_kg"] == load), key=lambda c: c["frequency_hz"])
        f = [nominal(c["frequency_hz"]) for c in own]
        line = _LINE if any(c.get("follows", True) for c in own) else _POOR
        for kind, style in (("measured", {"ls": "", "marker": mark, "ms": 4.5, "mfc": "none"}),
                            ("model", {"ls": line})):  # fmt: skip
            H = np.array([complex(*c["transmissibility"][kind]) for c in own])
            label = f"{load:g} kg added" if kind == "measured" else None
            for axis, y in ((size, np.abs(H)), (phase, -np.degrees(np.unwrap(np.angle(H))))):
                axis.plot(f, y, color=colour, label=label, **style)
                if kind == "model" and line == _LINE:
                    good = [c.get("follows", True) for c in own]
                    axis.plot(f, np.where(good, y, np.nan), ".", ms=3.5, color=colour)
    size.set_ylabel("malleolus over base")
    phase.set_ylabel("phase lag [deg]")
    for axis in axes[0]:
        axis.set_xlabel("frequency [Hz]")
    handles, _ = size.get_legend_handles_labels()
    handles.append(Line2D([], [], color=GREY, marker=".", ms=3.5, label="model"))
    poor = [c for c in cycles if not c.get("follows", True)]
    if any(line.get_linestyle() == _POOR for line in size.lines):
        handles.append(Line2D([], [], ls=_POOR, color=GREY, label="model that does not follow"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    fitted = {"per-recording": ", fitted to each recording alone", "pooled": ", fitted to all frequencies of a load"}
    text = f"Marks: {origin} data{_whose(cycles)}. Lines: the model{fitted.get(_mode(cycles), '')}."
    follow = f"{len(cycles) - len(poor)} of {len(cycles)} recordings"
    said = f" A dot: it follows to {POOR_FIT:g} % or more in the mean, {follow}."
    return noted(figure, text + (said if poor else ""))


def _whose(cycles: Sequence[Mapping[str, Any]]) -> str:
    """Of which subject cycles are, of how many, and how many fits of that subject failed, where they say so."""
    if not cycles or "subject" not in cycles[0]:
        return ""
    first = cycles[0]
    alone = f", one of {first['subjects']}" if first.get("subjects", 1) > 1 else ""
    failed = f" ({counted(first['failed'], 'fit')} failed, not drawn)" if first.get("failed") else ""
    return f" of subject {first['subject']}{alone}{failed}"


def _mode(cycles: Sequence[Mapping[str, Any]]) -> str:
    return str(cycles[0].get("mode", "")) if cycles else ""


def _shades(colour: str) -> LinearSegmentedColormap:
    """From a light tint of a colour to a dark shade."""
    own = np.array(to_rgb(colour))
    return LinearSegmentedColormap.from_list("shades", [0.35 * own + 0.65, own, 0.4 * own])


@printed
def loops(cycles: Sequence[Mapping[str, Any]], origin: str) -> Figure:
    """Figures 4.15 to 4.17: force against displacement of ankle and fat pad, a loop a frequency, a column a load.

    Args:
        cycles: entries with points of their loops; where `decided` is False they are dashed, where
            `follows` is dotted. origin: of the data.
    """
    loads = of_loads(c["added_mass_kg"] for c in cycles)
    figure, axes = panels(2, len(loads), 2.3 * len(loads) + 1.0, 4.6, sharex="row", sharey="row")
    f = [nominal(c["frequency_hz"]) for c in cycles]
    norm = Normalize(min(f), max(f))
    for column, (load, (colour, _)) in zip(axes.T, loads.items(), strict=True):
        own = sorted((c for c in cycles if c["added_mass_kg"] == load), key=lambda c: c["frequency_hz"])
        shades = ScalarMappable(norm, _shades(colour))
        for c in own:
            style = "-" if c.get("decided", True) else (0, (2.5, 1.5))
            style = style if c.get("follows", True) else _POOR
            for axis, part in zip(column, ("ankle", "fat_pad"), strict=True):
                x, F = (np.append(c[part][key], c[part][key][0]) for key in ("displacement_m", "force_n"))
                axis.plot(1e3 * x, F, lw=1.1, ls=style, color=shades.to_rgba(np.array(nominal(c["frequency_hz"]))))
        decided = sum(c.get("decided", True) for c in own)
        which = f"branch decided in {decided} of {len(own)}" if decided else "no branch decided by the data"
        column[0].set_title(f"talocrural joint, {load:g} kg added\n{which}")
        column[1].set_title(f"fat pad, {load:g} kg added")
        column[1].set_xlabel("relative displacement [mm]")
    for row in axes:
        row[0].set_ylabel("force [N]")
        row[0].xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))  # shared by the row
    grey = ScalarMappable(norm, _shades(GREY))
    bar = figure.colorbar(grey, ax=axes, label="frequency [Hz]", shrink=0.7, pad=0.02)
    bar.set_ticks(distinct(f) if len(set(f)) < 12 else [])
    every = all(c.get("decided", True) for c in cycles)
    dashed = "" if every else (
        " Dashed: no branch is decided, ankle and pad may have changed places, and the likelier branch is drawn."
    )  # fmt: skip
    text = f"The model driven by the base of {origin} recordings{_whose(cycles)}, a loop a frequency. The area of a "
    return noted(figure, text + "loop is the energy dissipated in a cycle." + dashed + _poor(cycles))


@printed
def energies(table: pd.DataFrame, origin: str) -> Figure:
    """What the foot takes from the shaker in a cycle, which both branches share, and the fat pad's part of it.

    The part is drawn as a median only of fits whose branch is decided: on the other branch it is another one.

    Args:
        table: `summary.cycle_table`, rows of one mode. origin: of the data.
    """
    rows = table[table["shown"] & follows(table["fit_percent"])]
    loads = of_loads(rows["added_mass_kg"])
    whole = 1e3 * (rows["fat_pad_j"] + rows["ankle_j"])
    share = 1e5 * rows["fat_pad_j"] / whole
    told = ~rows["decided_by"].isin(OPEN)
    group = [rows["added_mass_kg"], rows["frequency_hz"]]
    figure, axes = panels(1, 2, PAGE, 3.1, sharex=True)
    left, right = axes[0]
    medians = False
    for i, (load, (colour, mark)) in enumerate(loads.items()):
        at, shift = rows["added_mass_kg"] == load, 0.8 * (i - (len(loads) - 1) / 2)
        for axis, values, known in ((left, whole, told | True), (right, share, told)):
            mine = at & known & (known.groupby(group).transform("sum") >= FEWEST_OF_A_BOX)
            grouped = values[mine].groupby(rows.loc[mine, "frequency_hz"])
            low, middle, high = (grouped.quantile(q) for q in (0.25, 0.5, 0.75))
            axis.errorbar(
                middle.index + shift, middle, yerr=[middle - low, high - middle], fmt=f"{mark}-", ms=3.8, lw=1.2,
                elinewidth=0.8, capsize=1.5, color=colour,
            )  # fmt: skip
            medians = medians or bool(mine.any())
            dark = _FAINT if mine.any() else _DECIDED  # behind a median, or alone
            for each, face, alpha in ((at & known, colour, dark), (at & ~known, "none", _OPEN)):
                axis.plot(rows.loc[each, "frequency_hz"] + shift, values[each], mark, ms=3.0, mfc=face, mew=0.7,
                          mec=colour, alpha=alpha)  # fmt: skip
    left.set_yscale("log")
    left.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    left.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    left.yaxis.set_minor_formatter(NullFormatter())
    right.set_ylim(-4, 104)
    for axis, title in ((left, "energy a cycle [mJ]"), (right, "fat pad's share [%]")):
        axis.set_ylabel(title)
        axis.set_xlabel("frequency [Hz]")
    handles = [Line2D([], [], marker=mark, ls="", ms=4, mew=0, color=colour, label=f"{load:g} kg added")
               for load, (colour, mark) in loads.items()]  # fmt: skip
    handles.append(Line2D([], [], marker="o", ls="", ms=3.5, mew=0, color=GREY, label="one cycle"))
    if not told.all():
        open_ = Line2D([], [], marker="o", ls="", ms=3.5, mew=0.6, mfc="none", color=GREY, label="branch not decided")
        handles.append(open_)
    if medians:
        handles.append(Line2D([], [], marker="o", lw=1.2, ms=3.8, color=GREY, label="median and quartiles"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), columnspacing=1.0, handletextpad=0.4)
    drawn = (
        f"Lines: medians and quartiles of {FEWEST_OF_A_BOX} or more."
        if medians
        else f"There is no median of fewer than {FEWEST_OF_A_BOX}."
    )
    return noted(
        figure,
        f"{origin.capitalize()} data of {counted(rows['subject'].nunique(), 'subject')}. A mark is one cycle of one "
        f"subject; loads stand side by side at each frequency. {drawn} The energy is the same on both branches. The "
        f"pad's share is not, and its branch is decided in {int(told.sum())} of {len(rows)} cycles.",
    )


@printed
def persons(populations: Sequence["Population"], origin: str) -> Figure:
    """Each person's constants with 95 %, faint, and the population's mean with its own, a panel a constant.

    Args:
        populations: of one posture; each constant has a column a load and branch. origin: of the data.
    """
    loads = of_loads(p.added_mass_kg for p in populations)
    figure, axes = panels(2, 2, PAGE, 4.8)
    for axis, name in zip(axes.flat, EXCHANGED, strict=True):
        scale, unit = (1e-3, "kN/m") if name.startswith("k_") else (1.0, "N s/m")
        ticks = []
        for place, p in enumerate(populations):
            colour, mark = loads[p.added_mass_kg]
            n = max(len(c.persons) for c in p.constants)
            ticks.append(f"{p.added_mass_kg:g} kg, n = {n}\n{p.branch}\n{p.verdict}")
            for c in (c for c in p.constants if c.name == name):
                open_ = p.verdict != "decided"
                x = place + np.linspace(-0.3, 0.15, len(c.persons))
                value, low, high = (scale * np.array([getattr(q, n) for q in c.persons])
                                    for n in ("shrunk", "lower", "upper"))  # fmt: skip
                axis.errorbar(x, value, yerr=[value - low, high - value], fmt=mark, ms=3, elinewidth=0.8, color=colour,
                              alpha=_FAINT)  # fmt: skip
                own = [scale * q.value for q in c.persons]
                axis.plot(x, own, "_", ms=5, color=GREY)
                for q, at, y in zip(c.persons, x, own, strict=True):
                    if q in c.odd:
                        axis.plot(at, y, "o", ms=9, mfc="none", color=MODEL)
                        axis.annotate(q.subject, (at, y), (7, -2), textcoords="offset points", fontsize=8, color=MODEL)
                ends = [[scale * (c.mean - c.lower)], [scale * (c.upper - c.mean)]]
                axis.errorbar([place + 0.3], [scale * c.mean], yerr=ends, fmt=mark, ms=6, capsize=3, color=colour,
                              elinewidth=1 if open_ else 2, mfc="none" if open_ else colour,
                              alpha=0.5 if open_ else 1.0)  # fmt: skip
        axis.set_yscale("log")
        axis.set_title(f"{label_of(name)} [{unit}]")
        axis.set_xticks(range(len(ticks)), ticks, fontsize=7)
        axis.set_xlim(-0.6, len(ticks) - 0.4)
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
        axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.yaxis.set_minor_formatter(NullFormatter())
    return noted(
        figure,
        f"{origin.capitalize()} data. Faint: each person, shrunk, with 95 %; dashes: as the fit alone has it; large: "
        "geometric mean with 95 %, open where the branch is not decided. "
        f"{circled(populations)}{left_out(populations)}",
    )
