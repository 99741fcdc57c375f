"""Figures of the heel's laws: strikes with laws, held-out errors, and the population."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from fasbody.heel.figures import STYLE
from fasbody.heel.laws import LAWS
from fasbody.presentation import COLOURS
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


def persons(found: "Analysis") -> Figure:
    """Force over compression of each person's strikes, with the population's law of the own strikes."""
    groups = found.study.groups()
    subjects = list(dict.fromkeys(subject for subject, _ in groups))
    speeds = list(dict.fromkeys(speed for _, speed in groups))
    columns = min(4, len(subjects))
    rows = -(-len(subjects) // columns)
    document = next((d for d in found.laws if d["law"] == found.law and d["window"] == found.window), None)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 0.5 + 1.75 * rows), layout="constrained")
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
        handles = [
            ax.plot([], [], color=c, label=speed or "strikes")[0] for c, speed in zip(COLOURS, speeds, strict=False)
        ]
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


def errors(found: "Analysis") -> Figure:
    """Errors of each law on its own strikes, on the same person's normal strikes, and on another person's."""
    with matplotlib.rc_context(STYLE):
        windows = list(dict.fromkeys(d["window"] for d in found.laws))
        figure = Figure(figsize=(7.0, 2.9), layout="constrained")
        axes = figure.subplots(1, len(windows), squeeze=False, sharey=True)[0]
        for ax, window in zip(axes, windows, strict=True):
            laws = [d for d in found.laws if d["window"] == window]
            for k, d in enumerate(laws):
                sets = (("own strikes", [p["misfit"] for p in d["persons"]]),
                        ("slow predicts normal", d["other_speed"]),
                        ("others predict a person", d["other_person"]))  # fmt: skip
                for i, (name, values) in enumerate(sets):
                    numbers = [100 * (value if isinstance(value, float) else value["error"]) for value in values]
                    if not numbers:
                        continue
                    y = k + 0.22 * (i - 1)
                    ax.plot(np.clip(numbers, 0, 100), np.full(len(numbers), y), ".", color=COLOURS[i], ms=3, alpha=0.5,
                            clip_on=False)  # fmt: skip
                    ax.plot(min(float(np.mean(numbers)), 100), y, "|", color=COLOURS[i], ms=11, mew=2,
                            label=name if k == 0 else None)  # fmt: skip
            ax.set_yticks(range(len(laws)), [f"{LAWS[d['law']].name}" + (f" ({d['equation']})" if d["equation"] else "")
                                             for d in laws])  # fmt: skip
            ax.set(xlim=(0, 100), title="to the first peak" if window == "loading" else "whole contact",
                   xlabel="error of the force over its peak [%]\n(larger than 100 drawn at 100)")  # fmt: skip
            ax.grid(axis="x", color="0.9", lw=0.5)
        axes[0].invert_yaxis()
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def population(found: "Analysis") -> Figure:
    """The population's law along the mean strike of each speed, with the band of a new person, over all strikes."""
    assert found.population is not None
    groups = found.study.groups()
    law = LAWS[found.law]
    speeds = found.population.speeds
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4 * len(speeds) + 0.2, 2.9), layout="constrained")
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
            ax.set(title=f"{speed or 'all'}", xlabel="compression, skin to shank [mm]", xlim=(0, None))
            ax.legend(loc="upper left", fontsize=7)
        axes[0].set_ylabel("vertical force [N]")
        axes[0].set_ylim(0, 1.1 * max(s.published.peak_n for s in found.study.strikes))
    return figure


def stiffness(found: "Analysis") -> Figure:
    """Slope of the loading at the loads of the shaker: people, population, and the model's nominal pad."""
    from identification.heel.stiffness import slopes

    numbers = beside()
    loads = [float(p.names[0].removesuffix(" N")) for p in found.slopes]
    groups = found.study.groups()
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.0, 3.0), layout="constrained")
        ax = figure.subplots()
        for i, (speed, colour) in enumerate(zip(found.slopes[0].speeds, COLOURS, strict=False)):
            shift = 3.0 * (i - 0.5)
            for (_, which), strikes in groups.items():
                if which == speed:
                    own = 1e-3 * np.nanmedian([slopes(s, loads) for s in strikes], axis=0)
                    ax.plot(np.add(loads, shift), own, ".", color=colour, ms=4, alpha=0.5)
            for load, slope in zip(loads, found.slopes, strict=True):
                if speed in slope.speeds:
                    value, lower, upper = (1e-3 * x for x in slope.interval(speed, slope.names[0]))
                    ax.errorbar(load + shift, value, [[value - lower], [upper - value]], fmt="s", color=colour, ms=5,
                                capsize=3,
                                label=f"{speed}: population, 95 %" if load == loads[0] else None)  # fmt: skip
        ax.axhline(1e-3 * numbers["nominal_n_per_m"], color="k", lw=1, label="nominal $k_F$ of two_dof.xml")
        ax.axhline(1e-3 * numbers["bundled_n_per_m"], color="k", lw=1, ls=":", label="bundled synthetic subject")
        ax.set(
            xlabel="load on the heel [N]", ylabel="slope of force over compression [kN/m]", xticks=loads, ylim=(0, None)
        )
        ax.legend(loc="lower right", fontsize=7)
    return figure
