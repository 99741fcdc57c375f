"""Figures of the heel's laws: strikes with laws, held-out errors, and the population."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from fasbody.heel.laws import LAWS
from fasbody.presentation import COLOURS, COLUMN, MARKS, PAGE, printed
from identification.heel.shaker import beside

if TYPE_CHECKING:
    from identification.heel.analysis import Analysis


def everything(found: "Analysis") -> Mapping[str, Figure]:
    """Every figure that the analysis has data for, by name."""
    figures = {"heel-persons": persons(found), "heel-errors": errors(found)}
    if found.population is not None:
        figures["heel-population"] = population(found)
    if found.slopes:
        figures["heel-stiffness"] = stiffness(found)
    return figures


@printed
def persons(found: "Analysis") -> Figure:
    """Force over compression of each person's strikes, with the population's law of the own strikes."""
    groups = found.study.groups()
    subjects = list(dict.fromkeys(subject for subject, _ in groups))
    speeds = list(dict.fromkeys(speed for _, speed in groups))
    columns = min(4, len(subjects))
    rows = -(-len(subjects) // columns)
    document = next((d for d in found.laws if d["law"] == found.law and d["window"] == found.window), None)
    figure = Figure(figsize=(PAGE, 0.5 + 1.5 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for ax, subject in zip(axes, subjects, strict=False):
        for colour, speed in zip(COLOURS, speeds, strict=False):
            for strike in groups.get((subject, speed), ()):
                part = getattr(strike, found.window)
                ax.plot(1e3 * strike.compression_m[part], strike.force_n[part], color=colour, lw=0.5, alpha=0.55)
        for item in document["persons"] if document else ():
            if item["subject"] == subject:
                _law(ax, found, groups[subject, item["speed"]], item)
        ax.set_title(f"subject {subject}")
    for ax in axes[len(subjects) :]:
        ax.set_axis_off()
    for ax in axes[max(0, len(subjects) - columns) : len(subjects)]:
        ax.tick_params(labelbottom=True)
    handles = [ax.plot([], [], color=c, label=speed or "strikes")[0] for c, speed in zip(COLOURS, speeds, strict=False)]
    handles += ax.plot([], [], color="k", lw=1.2, label=f"{LAWS[found.law].name}, mean strike")
    if "slow" in speeds:
        handles += ax.plot([], [], color="k", lw=1.2, ls="--", label="the same, slow")
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.supxlabel("compression, skin to shank [mm]", fontsize=8)
    figure.supylabel("vertical force [N]", fontsize=8)
    return figure


def _law(ax: Any, found: "Analysis", strikes: Any, item: Mapping[str, Any]) -> None:
    """The fitted law along the mean path of a person's strikes."""
    share = np.linspace(0.0, 1.0, 80)
    resampled = [
        [np.interp(share, np.linspace(0, 1, getattr(s, found.window).stop), values[getattr(s, found.window)])
         for values in (s.time_s, s.compression_m, s.rate_m_s)] for s in strikes
    ]  # fmt: skip
    t, x, v = np.mean(resampled, axis=0)
    force = LAWS[found.law].force(t, x + 1e-3 * item["offset_mm"], v, np.asarray(item["theta"], float))
    ax.plot(1e3 * x, force, color="k", lw=1.2, ls="-" if item["speed"] != "slow" else "--")


@printed
def errors(found: "Analysis") -> Figure:
    """Errors of each law on its own strikes, on the same person's normal strikes, and on another person's.

    A mark is the mean of the persons, its line reaches from the best to the worst. The axis is logarithmic.
    """
    windows = list(dict.fromkeys(d["window"] for d in found.laws))
    most = max(sum(d["window"] == window for d in found.laws) for window in windows)
    figure = Figure(figsize=(PAGE, 0.9 + 0.32 * most), layout="constrained")
    axes = figure.subplots(1, len(windows), squeeze=False, sharey=True)[0]
    for letter, ax, window in zip("ab", axes, windows, strict=False):
        laws = [d for d in found.laws if d["window"] == window]
        for k, d in enumerate(laws):
            sets = (("own strikes, fitted", [p["misfit"] for p in d["persons"]]),
                    ("the same person, faster", d["other_speed"]),
                    ("another person", d["other_person"]))  # fmt: skip
            for i, (name, values) in enumerate(sets):
                numbers = [100 * (value if isinstance(value, float) else value["error"]) for value in values]
                if not numbers:
                    continue
                low, middle, high = min(numbers), float(np.mean(numbers)), max(numbers)
                ax.errorbar(middle, k + 0.24 * (i - 1), xerr=[[middle - low], [high - middle]], fmt=MARKS[i], ms=4,
                            color=COLOURS[i], mfc=COLOURS[i] if i else "white", elinewidth=1.0,
                            label=name if k == 0 else None)  # fmt: skip
            if k % 2:
                ax.axhspan(k - 0.5, k + 0.5, color="0.96", lw=0, zorder=0)
        names = [LAWS[d["law"]].name.replace(", ", ",\n", 1) for d in laws]
        ax.set_yticks(range(len(laws)), [f"{name} ({d['equation']})" if d["equation"] else name
                                         for name, d in zip(names, laws, strict=True)])  # fmt: skip
        ax.set_ylim(len(laws) - 0.5, -0.5)
        ax.set_xscale("log")
        ax.set_xlabel("error of the force [% of its peak]")
        ax.set_xticks([5, 10, 20, 50, 100], ["5", "10", "20", "50", "100"])
        ax.minorticks_off()
        ax.tick_params(axis="y", length=0)
        ax.grid(visible=False, axis="y")
        ax.set_title(f"{letter}  {'to the first peak' if window == 'loading' else 'whole contact'}", loc="left")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


@printed
def population(found: "Analysis") -> Figure:
    """The population's law along the mean strike of each speed, with the band of a new person, over all strikes."""
    assert found.population is not None
    groups = found.study.groups()
    law = LAWS[found.law]
    speeds = found.population.speeds
    figure = Figure(figsize=(min(PAGE, 3.4 * len(speeds) + 0.3), 2.9), layout="constrained")
    axes = figure.subplots(1, len(speeds), squeeze=False, sharey=True)[0]
    for ax, speed, colour in zip(axes, speeds, COLOURS, strict=False):
        strikes = [s for (_, which), group in groups.items() if which == speed for s in group]
        for strike in strikes:
            part = getattr(strike, found.window)
            ax.plot(1e3 * strike.compression_m[part], strike.force_n[part], color="0.6", lw=0.3, alpha=0.6)
        share = np.linspace(0, 1, 80)
        resampled = []
        for s in strikes:
            part = getattr(s, found.window)
            own = np.linspace(0, 1, part.stop)
            resampled.append(
                [np.interp(share, own, values[part]) for values in (s.time_s, s.compression_m, s.rate_m_s)]
            )
        t, x, v = np.mean(resampled, axis=0)
        deepest = max(s.compression_m[getattr(s, found.window)].max() for s in strikes) / x.max()
        x, v = deepest * x, deepest * v  # the mean strike, as deep as the deepest
        curves = np.array([law.force(t, x, v, theta) for theta in found.population.draws(speed, 1000)])
        low, high = np.percentile(curves, [2.5, 97.5], axis=0)
        middle = law.force(t, x, v, np.exp(found.population.mu[speeds.index(speed)]))
        ax.fill_between(1e3 * x, low, high, color=colour, alpha=0.25, lw=0, label="a new person, 95 %")
        ax.plot(1e3 * x, middle, color=colour, lw=1.8, label=f"population, {law.name}")
        ax.plot([], [], color="0.6", lw=0.8, label=f"{len(strikes)} strikes")
        ax.set(
            title=f"{speed} speed" if speed else "all strikes", xlabel="compression, skin to shank [mm]", xlim=(0, None)
        )
        ax.legend(loc="upper left")
    axes[0].set_ylabel("vertical force [N]")
    axes[0].set_ylim(0, 1.1 * max(s.published.peak_n for s in found.study.strikes))
    return figure


@printed
def stiffness(found: "Analysis") -> Figure:
    """Slope of the loading at the loads of the shaker: people, population, and the model's nominal pad."""
    from identification.heel.stiffness import slopes

    numbers = beside()
    loads = [float(p.names[0].removesuffix(" N")) for p in found.slopes]
    groups = found.study.groups()
    figure = Figure(figsize=(COLUMN, 2.9), layout="constrained")
    ax = figure.subplots()
    speeds = found.slopes[0].speeds
    for i, (speed, colour, mark) in enumerate(zip(speeds, COLOURS, MARKS, strict=False)):
        shift = 3.0 * (i - 0.5 * (len(speeds) - 1))
        for (_, which), strikes in groups.items():
            if which == speed:
                own = 1e-3 * np.nanmedian([slopes(s, loads) for s in strikes], axis=0)
                ax.plot(np.add(loads, shift - 0.8), own, "_", color=colour, ms=4, alpha=0.8)
        for load, slope in zip(loads, found.slopes, strict=True):
            if speed in slope.speeds:
                value, lower, upper = (1e-3 * x for x in slope.interval(speed, slope.names[0]))
                ax.errorbar(load + shift + 0.8, value, [[value - lower], [upper - value]], fmt=mark, color=colour, ms=5,
                            mfc="white" if i else colour, capsize=2.5,
                            label=f"{speed or 'all'}, mean of persons, 95 %" if load == loads[0] else None)  # fmt: skip
    ax.plot([], [], "_", color="0.4", ms=5, label="each person")
    for key, line, name in (("nominal_n_per_m", "-", "nominal"), ("bundled_n_per_m", ":", "bundled, synthetic")):
        ax.axhline(1e-3 * numbers[key], color="k", lw=1, ls=line, label=f"$k_F$ of the model: {name}")
    ax.set(xlabel="load on the heel [N]", ylabel="stiffness of the heel [kN/m]", xticks=loads, ylim=(0, None))
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside upper center", ncols=1)
    return figure
