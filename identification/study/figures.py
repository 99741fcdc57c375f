"""Figures of a whole study; every function returns a matplotlib Figure.

Of the feet: constants over frequency (4.18 to 4.25), and the persons behind them. Of the motion:
transmissibility (in place of the traces 4.6 to 4.14), hysteresis loops (4.15 to 4.17), energies.
"""

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import YAxis
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from fasbody.presentation import PAGE, counted, panels, printed
from identification.branches import EXCHANGED
from identification.figures import label_of, of_loads
from identification.recommendations import LEAST_FIT, follows
from identification.study.means import BAND, FEWEST, POSITIVE, mean_curve
from identification.study.summary import FEWEST as FEWEST_OF_A_BOX
from identification.study.summary import OPEN, measured, nominal
from identification.study.tables import circled, left_out

if TYPE_CHECKING:
    from identification.study.population import Population

MODEL, GREY = "#d1495b", "#555555"
#: The constants in the order of Figures 4.18 to 4.25.
CONSTANTS = ("k_T", "c_11", "c_12", "c_13", "k_F", "c_21", "c_22", "c_23")
#: Letters of a remark to an inch of the figure's width.
_LETTERS = 17
#: Constants that differ by powers of ten, and get such an axis.
_LOGARITHMIC = ("k_T", "k_F", "c_11", "c_21")
#: Opacity of an estimate whose branch is decided, and of one whose branch is not.
_DECIDED, _OPEN, _FAINT = 0.8, 0.65, 0.35
#: Line of a model, and of one that does not follow its recordings.
_SOLID, _DOTTED = "-", ":"
#: An estimate without an interval.
_BARE: dict[str, Any] = {"ms": 2.6, "mew": 0.6, "mfc": "none", "alpha": _OPEN}
_TRUTH: dict[str, Any] = {"lw": 1.3, "ls": (0, (4, 2))}
_SCALE = {"N/m": (1e-3, "kN/m"), "s": (1e3, "ms")}


def noted(figure: Figure, text: str, handles: Sequence[Any] = (), columns: int = 0) -> Figure:
    """Write a remark below a figure, wrapped to its width, and a legend above it."""
    if handles:
        how: dict[str, Any] = {"handletextpad": 0.4, "columnspacing": 1.0}
        columns = columns or len(handles)
        figure.legend(handles=handles, loc="outside upper center", ncols=columns, **how)
    figure.supxlabel(fill(text, int(_LETTERS * figure.get_figwidth())), color=GREY)
    return figure


def distinct(values: Iterable[float]) -> list[float]:
    """The values ascending, each once."""
    return sorted(set(values))


def _key(label: str, **style: Any) -> Line2D:
    return Line2D([], [], **{"color": GREY, "ls": "", **style}, label=label)


def _load_keys(loads: Mapping[float, tuple[str, str]], **style: Any) -> list[Line2D]:
    return [
        _key(f"{load:g} kg added", marker=mark, ms=4, mew=0, color=colour, **style)
        for load, (colour, mark) in loads.items()
    ]


def _decimal_ticks(axis: YAxis, *steps: float) -> None:
    """Ticks of a logarithmic axis at some multiples of powers of ten, as plain numbers."""
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _people(origin: str, rows: pd.DataFrame) -> str:
    return f"{origin.capitalize()} data of {counted(rows['subject'].nunique(), 'subject')}."


@printed
def curves(table: pd.DataFrame, origin: str) -> Figure:
    """Figures 4.18 to 4.25: estimates over frequency by load, means and bands of the decided.

    The table has the tidy rows of one mode and posture.
    """
    rows = table[table["shown"]]
    loads = of_loads(rows["added_mass_kg"])
    figure, axes = panels(2, 4, PAGE, 4.3, sharex=True)
    for axis, name in zip(axes.flat, CONSTANTS, strict=True):
        estimates = rows[rows["parameter"] == name]
        scale = titled(axis, estimates, name)
        ends: list[float] = []
        for i, (load, (colour, mark)) in enumerate(loads.items()):
            at = estimates[estimates["added_mass_kg"] == load]
            shift = 1.2 * (i - (len(loads) - 1) / 2)  # so that loads do not hide each other,
            dashes = _TRUTH | ({"ls": (3 * i, (3, 3 * len(loads) - 3))} if len(loads) > 1 else {})  # nor equal truths
            ends += _load_curves(axis, at, scale, name, shift, {"color": colour}, mark, dashes)
        _limit(axis, np.array(ends, float), name)
    for axis in axes[-1]:
        axis.set_xlabel("frequency [Hz]")
    fits = rows.drop_duplicates("key")
    decided, known = int((~fits["decided_by"].isin(OPEN)).sum()), rows["truth"].notna().any()
    lines = [line for axis in axes.flat for line in axis.lines if len(line.get_xdata())]
    drawn, bare = (any(line.get_label() == label for line in lines) for label in ("mean", "no interval"))
    with_interval = measured(rows).any()
    keys = {
        "branch decided": (decided and with_interval, {"marker": "o", "ms": 4, "mew": 0}),
        "branch not decided": (decided < len(fits) and with_interval, {"marker": "o", "ms": 4, "mfc": "none"}),
        "no interval": (bare, {"marker": "o", **_BARE}),
        "mean of the decided": (drawn, {"lw": 2, "ls": "-"}),
        "truth": (known, _TRUTH),
    }
    handles = _load_keys(loads, ls="-", lw=0.6)
    handles += [_key(label, **style) for label, (drawn_at_all, style) in keys.items() if drawn_at_all]
    truth = "truth: the mean over all subjects drawn" if known else ""
    means = f"{truth.capitalize()}." if known else ""
    if drawn:
        means = f"Means where {FEWEST} subjects or more are decided (geometric, of c_12 and c_22 arithmetic); bands: "
        means += f"95 % of the mean, jackknife over {BAND} or more{f'; {truth}' if known else ''}."
    bars = "No estimate has an interval, because one frequency does not determine all constants."
    if with_interval:
        bars = "Bars: 95 % of each estimate, cut at the frame; in the titles how many estimates have "
        bars += f"one.{_without_interval(rows)}"
    return noted(
        figure,
        f"{_people(origin, rows)} {bars} The branch is decided in {decided} of "
        f"{len(fits)} fits; in the others ankle and pad may be exchanged, and the likelier "
        f"branch is drawn. {means}",
        handles,
        len(handles) if len(handles) < 7 else 4,
    )


def _load_curves(
    axis: Axes, rows: pd.DataFrame, scale: float, name: str, shift: float, colour: Any, mark: str, truth: Any
) -> list[float]:
    """Draw one constant under one load; returns the ordinates that the frame must hold."""
    true = rows[rows["truth"] > 0] if name in POSITIVE else rows.dropna(subset=["truth"])
    of = true.groupby("frequency_hz")["truth"]
    mean = of.agg(lambda v: np.exp(np.log(v).mean())) if name in POSITIVE else of.mean()
    axis.plot(mean.index, scale * mean, label="truth", **truth, **colour)
    bare = rows[rows["value"].notna() & rows["std_error"].isna() & ~rows["at_bound"] & follows(rows["fit_percent"])]
    axis.plot(bare["frequency_hz"] + shift, scale * bare["value"], mark, label="no interval", **_BARE, **colour)
    dots = rows[~rows["outlier"] & measured(rows)]
    decided = ~dots["decided_by"].isin(OPEN)
    c = mean_curve(dots[decided], rows["frequency_hz"])
    axis.fill_between(c.frequency_hz, scale * c.lower, scale * c.upper, alpha=0.18, lw=0, **colour)
    axis.plot(c.frequency_hz, scale * c.mean, lw=2, label="mean", **colour)
    f = dots["frequency_hz"] + shift
    value, low, high = (scale * dots[column] for column in ("value", "lower", "upper"))
    axis.vlines(f, low.fillna(value), high.fillna(value), lw=0.6, alpha=_FAINT, **colour)
    axis.plot(f[decided], value[decided], mark, ms=2.8, mew=0, alpha=_DECIDED, **colour)
    hollow = {"mfc": "white", "mec": colour["color"], "mew": 0.8, "ms": 3.2}
    axis.plot(f[~decided], value[~decided], mark, alpha=_OPEN, **hollow)
    return [*value, *(scale * bare["value"]), *(scale * mean), *(scale * c.mean)]


def _without_interval(rows: pd.DataFrame) -> str:
    """Frequencies at which no estimate has an interval, in a sentence."""
    drawn = set(rows.loc[measured(rows) & ~rows["outlier"], "frequency_hz"])
    none = [f"{f:g}" for f in distinct(rows["frequency_hz"]) if f not in drawn]
    return f" At {', '.join(none)} Hz none has one." if none else ""


def _limit(axis: Axes, values: np.ndarray, name: str) -> None:
    """Ordinate over estimates and curves: a band from three subjects would hide them."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    low, high = float(finite.min()), float(finite.max())
    if name in _LOGARITHMIC and low > 0:
        axis.set_yscale("log")
        axis.set_ylim(low / 1.3, high * 1.3)
        _decimal_ticks(axis.yaxis, *((1.0,) if high > 100 * low else (1.0, 2.0, 5.0)))
    else:
        margin = 0.06 * (high - low or abs(high) or 1.0)
        axis.set_ylim(0 if name in POSITIVE and low >= 0 else low - margin, high + margin)


def titled(axis: Axes, rows: pd.DataFrame, name: str) -> float:
    """Title of a panel with unit and number of intervals; returns the scale of values."""
    unit = rows["unit"].iloc[0] if len(rows) else ""
    scale, label = _SCALE.get(unit, (1.0, unit))
    count = int(measured(rows).sum())
    number = f", {count} of {len(rows)}" if count else "" if len(rows) else ", not estimated"
    axis.set_title(f"{label_of(name)} [{label}]{number}")
    return scale


def _by_load(cycles: Sequence[Mapping[str, Any]], load: float) -> list[Mapping[str, Any]]:
    under = (c for c in cycles if c["added_mass_kg"] == load)
    return sorted(under, key=lambda c: c["frequency_hz"])


@printed
def transmissibility(cycles: Sequence[Mapping[str, Any]], origin: str) -> Figure:
    """Malleolus over base of one subject, measured and modelled: all that a steady sine says."""
    loads = of_loads(c["added_mass_kg"] for c in cycles)
    figure, axes = panels(1, 2, PAGE, 2.9, sharex=True)
    size, phase = axes[0]
    for load, (colour, mark) in loads.items():
        under = _by_load(cycles, load)
        f = [nominal(c["frequency_hz"]) for c in under]
        good = [c.get("follows", True) for c in under]
        dots: dict[str, Any] = {"ls": "", "marker": mark, "ms": 4.5, "mfc": "none"}
        styles = {"measured": dots, "model": {"ls": _SOLID if any(good) else _DOTTED}}
        for kind, style in styles.items():
            H = np.array([complex(*c["transmissibility"][kind]) for c in under])
            label = f"{load:g} kg added" if kind == "measured" else None
            for axis, y in ((size, np.abs(H)), (phase, -np.degrees(np.unwrap(np.angle(H))))):
                axis.plot(f, y, color=colour, label=label, **style)
                if kind == "model" and any(good):
                    axis.plot(f, np.where(good, y, np.nan), ".", ms=3.5, color=colour)
    size.set_ylabel("malleolus over base")
    phase.set_ylabel("phase lag [deg]")
    for axis in axes[0]:
        axis.set_xlabel("frequency [Hz]")
    handles, _ = size.get_legend_handles_labels()
    if any(line.get_linestyle() == _SOLID for line in size.lines):
        handles.append(_key("model", ls="-", marker=".", ms=3.5))
    if any(line.get_linestyle() == _DOTTED for line in size.lines):
        handles.append(_key("model that does not follow", ls=_DOTTED))
    mode = str(cycles[0].get("mode", "")) if cycles else ""
    fitted = {
        "per-recording": ", fitted to each recording alone",
        "pooled": ", fitted to all frequencies of a load",
    }
    text = f"Marks: {origin} data{_whose(cycles)}. Lines: the model{fitted.get(mode, '')}."
    good_count = sum(c.get("follows", True) for c in cycles)
    if good_count < len(cycles):
        text += " A dot: it" if good_count else " It"
        text += f" follows to {LEAST_FIT:g} % or more in the mean, {good_count} of {len(cycles)} recordings."
    return noted(figure, text, handles)


def _whose(cycles: Sequence[Mapping[str, Any]]) -> str:
    """Of which subject cycles are, of how many, and how many of its fits failed, if known."""
    if not cycles or "subject" not in cycles[0]:
        return ""
    first = cycles[0]
    alone = f", one of {first['subjects']}" if first.get("subjects", 1) > 1 else ""
    failed = f" ({counted(first['failed'], 'fit')} failed, not drawn)" if first.get("failed") else ""
    return f" of subject {first['subject']}{alone}{failed}"


def _shades(colour: str) -> LinearSegmentedColormap:
    middle = np.array(to_rgb(colour))
    return LinearSegmentedColormap.from_list("shades", [0.35 * middle + 0.65, middle, 0.4 * middle])


@printed
def loops(cycles: Sequence[Mapping[str, Any]], origin: str) -> Figure:
    """Figures 4.15 to 4.17: force against displacement of ankle and pad, a column a load.

    A loop is dashed where its branch is not decided, dotted where it does not follow.
    """
    loads = of_loads(c["added_mass_kg"] for c in cycles)
    width = 2.3 * len(loads) + 1.0
    figure, axes = panels(2, len(loads), width, 4.6, sharex="row", sharey="row")
    f = [nominal(c["frequency_hz"]) for c in cycles]
    norm = Normalize(min(f), max(f))
    for column, (load, (colour, _)) in zip(axes.T, loads.items(), strict=True):
        under = _by_load(cycles, load)
        shades = ScalarMappable(norm, _shades(colour))
        for c in under:
            style = "-" if c.get("decided", True) else (0, (2.5, 1.5))
            style = style if c.get("follows", True) else _DOTTED
            shade = shades.to_rgba(np.array(nominal(c["frequency_hz"])))
            for axis, part in zip(column, ("ankle", "fat_pad"), strict=True):
                x, F = (np.append(c[part][k], c[part][k][0]) for k in ("displacement_m", "force_n"))
                axis.plot(1e3 * x, F, lw=1.1, ls=style, color=shade)
        decided = sum(c.get("decided", True) for c in under)
        which = f"branch decided in {decided} of {len(under)}"
        which = which if decided else "no branch decided by the data"
        column[0].set_title(f"talocrural joint, {load:g} kg added\n{which}")
        column[1].set_title(f"fat pad, {load:g} kg added")
        for axis in column:  # the rows have different scales
            axis.set_xlabel("relative displacement [mm]")
    for row in axes:
        row[0].set_ylabel("force [N]")
        row[0].xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))  # shared by the row
    grey = ScalarMappable(norm, _shades(GREY))
    bar = figure.colorbar(grey, ax=axes, label="frequency [Hz]", shrink=0.7, pad=0.02)
    bar.set_ticks(distinct(f) if len(set(f)) < 12 else [])
    text = (
        f"The model driven by the base of {origin} recordings{_whose(cycles)}, a loop a frequency. "
        "The area of a loop is the energy dissipated in a cycle."
    )
    if not all(c.get("decided", True) for c in cycles):
        text += " Dashed: the branch is not decided, ankle and pad may be exchanged, and the "
        text += "likelier branch is drawn."
    if not all(c.get("follows", True) for c in cycles):
        text += f" Dotted: the fit follows its recordings to less than {LEAST_FIT:g} % in the mean."
    return noted(figure, text)


@printed
def energies(table: pd.DataFrame, origin: str) -> Figure:
    """What the foot takes from the shaker in a cycle, and the fat pad's part of it.

    Both branches share the energy. The part is drawn as a median only of fits whose branch is
    decided: on the other branch it is another one. The table is `summary.cycle_table` of one mode.
    """
    rows = table[table["shown"] & follows(table["fit_percent"])]
    loads = of_loads(rows["added_mass_kg"])
    whole = 1e3 * (rows["fat_pad_j"] + rows["ankle_j"])
    share = 1e5 * rows["fat_pad_j"] / whole
    decided = ~rows["decided_by"].isin(OPEN)
    group = [rows["added_mass_kg"], rows["frequency_hz"]]
    figure, axes = panels(1, 2, PAGE, 3.1, sharex=True)
    left, right = axes[0]
    medians = False
    for i, (load, (colour, mark)) in enumerate(loads.items()):
        at, shift = rows["added_mass_kg"] == load, 0.8 * (i - (len(loads) - 1) / 2)
        for axis, values, known in ((left, whole, decided | True), (right, share, decided)):
            enough = at & known & (known.groupby(group).transform("sum") >= FEWEST_OF_A_BOX)
            grouped = values[enough].groupby(rows.loc[enough, "frequency_hz"])
            low, middle, high = (grouped.quantile(q) for q in (0.25, 0.5, 0.75))
            axis.errorbar(
                middle.index + shift, middle, yerr=[middle - low, high - middle], fmt=f"{mark}-",
                ms=3.8, lw=1.2, elinewidth=0.8, capsize=1.5, color=colour,
            )  # fmt: skip
            medians = medians or bool(enough.any())
            dark = _FAINT if enough.any() else _DECIDED  # behind a median, or alone
            for part, face, alpha in ((at & known, colour, dark), (at & ~known, "none", _OPEN)):
                axis.plot(
                    rows.loc[part, "frequency_hz"] + shift, values[part], mark, ms=3.0, mfc=face,
                    mew=0.7, mec=colour, alpha=alpha,
                )  # fmt: skip
    left.set_yscale("log")
    _decimal_ticks(left.yaxis, 1.0, 2.0, 5.0)
    right.set_ylim(-4, 104)
    for axis, title in ((left, "energy a cycle [mJ]"), (right, "fat pad's share [%]")):
        axis.set_ylabel(title)
        axis.set_xlabel("frequency [Hz]")
    handles = [*_load_keys(loads, ls=""), _key("one cycle", marker="o", ms=3.5, mew=0)]
    if not decided.all():
        handles.append(_key("branch not decided", marker="o", ms=3.5, mew=0.6, mfc="none"))
    if medians:
        handles.append(_key("median and quartiles", marker="o", ls="-", lw=1.2, ms=3.8))
    drawn = f"There is no median of fewer than {FEWEST_OF_A_BOX}."
    drawn = f"Lines: medians and quartiles of {FEWEST_OF_A_BOX} or more." if medians else drawn
    return noted(
        figure,
        f"{_people(origin, rows)} A mark is one cycle of one subject; loads stand side by side at "
        f"each frequency. {drawn} The energy is the same on both branches. The pad's share is not, "
        f"and its branch is decided in {int(decided.sum())} of {len(rows)} cycles.",
        handles,
    )


@printed
def persons(populations: Sequence["Population"], origin: str) -> Figure:
    """Each person's constants with 95 %, faint, and the population's mean with its interval.

    The populations are of one posture; each constant has a column a load and branch.
    """
    loads = of_loads(p.added_mass_kg for p in populations)
    figure, axes = panels(2, 2, PAGE, 4.8)
    ticks = [
        f"{p.added_mass_kg:g} kg, n = {max(len(c.persons) for c in p.constants)}\n{p.branch}\n{p.verdict}"
        for p in populations
    ]
    for axis, name in zip(axes.flat, EXCHANGED, strict=True):
        scale, unit = (1e-3, "kN/m") if name.startswith("k_") else (1.0, "N s/m")
        for place, p in enumerate(populations):
            _people_of(axis, p, name, place, scale, *loads[p.added_mass_kg])
        axis.set_yscale("log")
        axis.set_title(f"{label_of(name)} [{unit}]")
        axis.set_xticks(range(len(ticks)), ticks, fontsize=7)
        axis.set_xlim(-0.6, len(ticks) - 0.4)
        _decimal_ticks(axis.yaxis, 1.0, 2.0, 3.0, 5.0)
    return noted(
        figure,
        f"{origin.capitalize()} data. Faint: each person, shrunk, with 95 %; dashes: as the fit "
        "alone has it; large: geometric mean with 95 %, open where the branch is not decided. "
        f"{circled(populations)}{left_out(populations)}",
    )


def _people_of(axis: Axes, p: "Population", name: str, place: int, scale: float, colour: str, mark: str) -> None:
    """Draw the persons of one population in one constant, and their mean beside them."""
    for c in (c for c in p.constants if c.name == name):
        x = place + np.linspace(-0.3, 0.15, len(c.persons))
        value, low, high = (
            scale * np.array([getattr(q, field) for q in c.persons]) for field in ("shrunk", "lower", "upper")
        )
        style: dict[str, Any] = {"fmt": mark, "color": colour}
        errors = [value - low, high - value]
        axis.errorbar(x, value, yerr=errors, ms=3, elinewidth=0.8, alpha=_FAINT, **style)
        alone = [scale * q.value for q in c.persons]
        axis.plot(x, alone, "_", ms=5, color=GREY)
        for q, at, y in zip(c.persons, x, alone, strict=True):
            if q in c.odd:
                axis.plot(at, y, "o", ms=9, mfc="none", color=MODEL)
                beside: dict[str, Any] = {"xytext": (7, -2), "textcoords": "offset points", "fontsize": 8}
                axis.annotate(q.subject, (at, y), color=MODEL, **beside)
        weight: dict[str, Any] = {"elinewidth": 2, "mfc": colour, "alpha": 1.0}
        if p.verdict != "decided":
            weight = {"elinewidth": 1, "mfc": "none", "alpha": 0.5}
        ends = [[scale * (c.mean - c.lower)], [scale * (c.upper - c.mean)]]
        mean = [scale * c.mean]
        axis.errorbar([place + 0.3], mean, yerr=ends, ms=6, capsize=3, **style, **weight)
