"""Figures of heel strikes: strikes with laws, errors, population."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from fasbody.heel.laws import LAWS
from fasbody.presentation import COLOURS, COLUMN, MARKS, PAGE, panels, printed

if TYPE_CHECKING:
    from fasbody.heel.analysis import Analysis
    from fasbody.heel.strike import Strike


def everything(result: "Analysis") -> Mapping[str, Figure]:
    """Every figure that the analysis has data for, by name."""
    figures = {"heel-persons": persons(result), "heel-errors": errors(result)}
    if result.population is not None:
        figures["heel-population"] = population(result)
    if result.slopes:
        figures["heel-stiffness"] = stiffness(result)
    return figures


def _curve(strike: "Strike", window: str) -> tuple[np.ndarray, np.ndarray]:
    part = getattr(strike, window)
    return 1e3 * strike.compression_m[part], strike.force_n[part]


def _mean_path(strikes: "Sequence[Strike]", window: str) -> np.ndarray:
    """Time [s], compression [m] and rate [m/s] of the mean strike, (3, 80)."""
    share, paths = np.linspace(0.0, 1.0, 80), []
    for s in strikes:
        part = getattr(s, window)
        place = np.linspace(0, 1, part.stop)
        columns = s.time_s, s.compression_m, s.rate_m_s
        paths.append([np.interp(share, place, values[part]) for values in columns])
    return np.mean(paths, axis=0)


@printed
def persons(result: "Analysis") -> Figure:
    """Force over compression of each person's strikes, with the population's law of these."""
    groups = result.study.groups()
    subjects = list(dict.fromkeys(subject for subject, _ in groups))
    speeds = list(dict.fromkeys(speed for _, speed in groups))
    columns = min(4, len(subjects))
    rows = -(-len(subjects) // columns)
    documents = (d for d in result.laws if (d["law"], d["window"]) == (result.law, result.window))
    fits = next(documents, {"persons": ()})["persons"]
    figure, axes = panels(rows, columns, PAGE, 0.5 + 1.5 * rows, sharex=True, sharey=True)
    axes = axes.ravel()
    for ax, subject in zip(axes, subjects, strict=False):
        for colour, speed in zip(COLOURS, speeds, strict=False):
            for strike in groups.get((subject, speed), ()):
                ax.plot(*_curve(strike, result.window), color=colour, lw=0.5, alpha=0.55)
        for item in (item for item in fits if item["subject"] == subject):
            t, x, v = _mean_path(groups[subject, item["speed"]], result.window)
            theta = np.asarray(item["theta"], float)
            force = LAWS[result.law].force(t, x + 1e-3 * item["offset_mm"], v, theta)
            ax.plot(1e3 * x, force, "k", lw=1.2, ls="--" if item["speed"] == "slow" else "-")
        ax.set_title(f"subject {subject}")
    for ax in axes[len(subjects) :]:
        ax.set_axis_off()
    for ax in axes[max(0, len(subjects) - columns) : len(subjects)]:
        ax.tick_params(labelbottom=True)
    handles = [
        ax.plot([], [], color=colour, label=speed or "strikes")[0]
        for colour, speed in zip(COLOURS, speeds, strict=False)
    ]
    handles += ax.plot([], [], "k", lw=1.2, label=f"{LAWS[result.law].name}, mean strike")
    if "slow" in speeds:
        handles += ax.plot([], [], "k", lw=1.2, ls="--", label="the same, slow")
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.supxlabel("compression, skin to shank [mm]", fontsize=8)
    figure.supylabel("vertical force [N]", fontsize=8)
    return figure


@printed
def errors(result: "Analysis") -> Figure:
    """Errors of each law on the strikes it was fitted to, on faster ones, and on another person's.

    A mark is the mean of the persons, its line reaches from the best to the worst.
    """
    windows = list(dict.fromkeys(d["window"] for d in result.laws))
    laws = {window: [d for d in result.laws if d["window"] == window] for window in windows}
    height = 0.9 + 0.32 * max(map(len, laws.values()))
    figure, (axes,) = panels(1, len(windows), PAGE, height, sharey=True)
    for letter, ax, window in zip("ab", axes, windows, strict=False):
        for k, d in enumerate(laws[window]):
            _errors(ax, k, d)
        names = [LAWS[d["law"]].name.replace(", ", ",\n", 1) for d in laws[window]]
        numbers = [f" ({d['equation']})" if d["equation"] else "" for d in laws[window]]
        labels = [name + number for name, number in zip(names, numbers, strict=True)]
        ax.set_yticks(range(len(labels)), labels)
        ax.set(ylim=(len(labels) - 0.5, -0.5), xscale="log")
        ax.set_xlabel("error of the force [% of its peak]")
        ax.set_xticks([5, 10, 20, 50, 100], ["5", "10", "20", "50", "100"])
        ax.minorticks_off()
        ax.tick_params(axis="y", length=0)
        ax.grid(visible=False, axis="y")
        contact = "to the first peak" if window == "loading" else "whole contact"
        ax.set_title(f"{letter}  {contact}", loc="left")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=3)
    return figure


def _errors(ax: Any, k: int, document: Mapping[str, Any]) -> None:
    sets = {
        "own strikes, fitted": [item["misfit"] for item in document["persons"]],
        "the same person, faster": [item["error"] for item in document["other_speed"]],
        "another person": [item["error"] for item in document["other_person"]],
    }
    for i, (name, shares) in enumerate(sets.items()):
        if not shares:
            continue
        low, middle, high = (100 * f(shares) for f in (min, np.mean, max))
        ax.errorbar(middle, k + 0.24 * (i - 1), xerr=[[middle - low], [high - middle]], ms=4,
                    fmt=MARKS[i], color=COLOURS[i], mfc=COLOURS[i] if i else "white",
                    elinewidth=1.0, label=name if k == 0 else None)  # fmt: skip
    if k % 2:
        ax.axhspan(k - 0.5, k + 0.5, color="0.96", lw=0, zorder=0)


@printed
def population(result: "Analysis") -> Figure:
    """The population's law along the mean strike of each speed, with a new person's band."""
    people, law = result.population, LAWS[result.law]
    assert people is not None
    groups = result.study.groups()
    figure, (axes,) = panels(1, len(people.speeds), 3.4 * len(people.speeds) + 0.3, 2.9, sharey=True)
    for ax, speed, mu, colour in zip(axes, people.speeds, people.mu, COLOURS, strict=False):
        strikes = [s for (_, which), group in groups.items() if which == speed for s in group]
        curves = [_curve(strike, result.window) for strike in strikes]
        for curve in curves:
            ax.plot(*curve, color="0.6", lw=0.3, alpha=0.6)
        t, x, v = _mean_path(strikes, result.window)
        deepest = max(mm.max() for mm, _ in curves) / (1e3 * x.max())
        x, v = deepest * x, deepest * v  # the mean strike, as deep as the deepest
        forces = [law.force(t, x, v, theta) for theta in people.draws(speed, 1000)]
        band = np.percentile(forces, [2.5, 97.5], axis=0)
        label = "a new person, 95 %"
        ax.fill_between(1e3 * x, *band, color=colour, alpha=0.25, lw=0, label=label)
        middle = law.force(t, x, v, np.exp(mu))
        ax.plot(1e3 * x, middle, color=colour, lw=1.8, label=f"population, {law.name}")
        ax.plot([], [], color="0.6", lw=0.8, label=f"{len(strikes)} strikes")
        ax.set(title=f"{speed} speed" if speed else "all strikes", xlim=(0, None),
               xlabel="compression, skin to shank [mm]")  # fmt: skip
        ax.legend(loc="upper left")
    axes[0].set_ylabel("vertical force [N]")
    axes[0].set_ylim(0, 1.1 * max(s.published.peak_n for s in result.study.strikes))
    return figure


@printed
def stiffness(result: "Analysis") -> Figure:
    """Slope of the loading at the loads of the shaker: people, population, and the nominal pad."""
    from fasbody.heel.stiffness import of_model, slopes

    loads = [float(p.names[0].removesuffix(" N")) for p in result.slopes]
    figure, ((ax,),) = panels(1, 1, COLUMN, 2.9)
    speeds = result.slopes[0].speeds
    for i, (speed, colour, mark) in enumerate(zip(speeds, COLOURS, MARKS, strict=False)):
        places = np.add(loads, 3.0 * (i - 0.5 * (len(speeds) - 1)))
        for (_, which), strikes in result.study.groups().items():
            if which == speed:
                median = 1e-3 * np.nanmedian([slopes(s, loads) for s in strikes], axis=0)
                ax.plot(places - 0.8, median, "_", color=colour, ms=4, alpha=0.8)
        label = f"{speed or 'all'}, mean of persons, 95 %"
        for place, slope in zip(places, result.slopes, strict=True):
            if speed in slope.speeds:
                value, low, high = (1e-3 * x for x in slope.interval(speed, slope.names[0]))
                ax.errorbar(place + 0.8, value, [[value - low], [high - value]], fmt=mark, ms=5,
                            color=colour, mfc="white" if i else colour, capsize=2.5,
                            label=label if place == places[0] else None)  # fmt: skip
    ax.plot([], [], "_", color="0.4", ms=5, label="each person")
    pads = of_model()
    for key, line in (("nominal", "-"), ("bundled", ":")):
        label = f"$k_F$ of the model: {key}{', synthetic' if key == 'bundled' else ''}"
        ax.axhline(1e-3 * pads[f"{key}_n_per_m"], color="k", lw=1, ls=line, label=label)
    ax.set(xlabel="load on the heel [N]", ylabel="stiffness of the heel [kN/m]", xticks=loads,
           ylim=(0, None))  # fmt: skip
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside upper center", ncols=1)
    return figure
