"""Figures of the arch: sensitivity, reduction to two masses, load. Every function returns a matplotlib Figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fasbody.arch.bones import PARAMETERS
from fasbody.arch.load import ARANGIO_LOAD, ARANGIO_SAG, MEASURED_HZ
from fasbody.arch.sensitivity import CLAIMED, OUTPUTS, Study
from fasbody.presentation import COLOURS, LINES, MARKS, PAGE, named_lines, printed

if TYPE_CHECKING:
    from fasbody.arch.load import LoadStudy, SagStudy
    from fasbody.arch.reduction import Reduction

KEPT, DROPPED, THIRD = COLOURS[1], COLOURS[0], COLOURS[2]
#: What Kim & Voloshin computed of the fascia's share [%].
KIM_SHARE = 14.0
#: Behind the name of a line that is no measurement either.
ARANGIO = ", Arangio 1998 (computed)"
#: The 13 constants as the thesis sets them.
SYMBOLS = [f"${name[0]}_{{{name[2:]}}}$" for name in PARAMETERS]


def sensitivity(study: Study) -> Figure:
    """`sensitivity_bars` of one study."""
    return sensitivity_bars([study])


@printed
def sensitivity_bars(studies: Sequence[Study]) -> Figure:
    """Relative sensitivity of the malleolus' acceleration, one panel a study (Figure 4.3).

    Args:
        studies: random draws are drawn as median and quartiles, an arch's own constants as they are.
    """
    figure = Figure(figsize=(PAGE, 0.5 + 1.75 * len(studies)), layout="constrained")
    axes = figure.subplots(len(studies), squeeze=False, sharex=True, sharey=True)[:, 0]
    for ax, study in zip(axes, studies, strict=True):
        low, median, high = np.percentile(study.values[:, OUTPUTS.index("malleolus")], [25, 50, 75], axis=0)
        for i, name in enumerate(PARAMETERS):
            spread = None if study.arch_name else [[median[i] - low[i]], [high[i] - median[i]]]
            style = {"marker": "o", "mfc": KEPT} if name in CLAIMED else {"marker": "s", "mfc": "white"}
            ax.errorbar(
                [SYMBOLS[i]], [median[i]], spread, color=KEPT if name in CLAIMED else DROPPED, ms=6, capsize=3, **style
            )
        ax.set_yscale("log")
        ax.set_ylabel("relative sensitivity")
        ax.grid(visible=False, axis="x")
        ax.set_title(_title(study), loc="left")
    figure.suptitle("Acceleration of the malleolus: filled marks are the four constants that the thesis keeps")
    return figure


@printed
def sensitivity_cases(studies: Sequence[Study]) -> Figure:
    """Relative sensitivity of the malleolus' acceleration draw by draw (Figure C.1), the four largest dotted."""
    height = max(2.2, 0.1 * len(studies[0].values))
    figure = Figure(figsize=(PAGE, 0.6 + (height + 0.5) * len(studies)), layout="constrained")
    axes = figure.subplots(len(studies), squeeze=False, sharex=True)[:, 0]
    for ax, study in zip(axes, studies, strict=True):
        values = study.values[:, OUTPUTS.index("malleolus")]
        ax.grid(False)
        image = ax.imshow(np.log10(values), aspect="auto", cmap="viridis", vmin=-6, vmax=0)
        top = np.argsort(values, axis=1)[:, -len(CLAIMED) :]
        rows = np.repeat(np.arange(len(values)), len(CLAIMED))
        claimed = np.array([PARAMETERS[j] in CLAIMED for j in top.ravel()])
        for among, colour in ((claimed, "white"), (~claimed, KEPT)):
            ax.scatter(top.ravel()[among], rows[among], s=9, color=colour, edgecolors="black", linewidths=0.4)
        ax.set_xticks(range(len(PARAMETERS)), SYMBOLS)
        ax.set_ylabel("random case")
        ax.set_title(_title(study), loc="left")
        figure.colorbar(image, ax=ax, label="log$_{10}$ relative sensitivity", pad=0.01)
    dots = [
        Line2D([], [], marker="o", ls="", mfc=colour, mec="black", mew=0.4, label=label)
        for colour, label in (("white", "among the four largest, as claimed"), (KEPT, "the same, against the claim"))
    ]
    figure.legend(handles=dots, loc="outside upper center", ncols=2)
    return figure


def _title(study: Study) -> str:
    held = int(study.holds("malleolus").sum())
    if study.arch_name:
        return f"{study.reading}, {study.method}: claim {'holds' if held else 'does not hold'}"
    return f"{study.reading}, {study.method}: claim holds in {held} of {len(study.values)} draws"


@printed
def reduction(result: "Reduction") -> Figure:
    """Five-body and two-mass transmissibility of the nominal arch, and the difference over random draws."""
    figure = Figure(figsize=(PAGE, 5), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    for i, (name, five, two) in enumerate(result.examples):
        colour = (KEPT, DROPPED, THIRD)[i]
        upper.plot(result.frequency_hz, five, color=colour, label=f"{name}, five bodies")
        upper.plot(result.frequency_hz, two, "--", color=colour, label=f"{name}, two masses")
    upper.set_ylabel("transmissibility at the malleolus")
    upper.legend()
    for i, (lever_arm_m, difference) in enumerate(result.differences.items()):
        colour = (KEPT, DROPPED, THIRD, "0.4")[i % 4]
        label = "literal" if lever_arm_m is None else f"lever arm {lever_arm_m * 1e3:g} mm"
        low, median, high = np.percentile(100 * difference, [10, 50, 90], axis=0)
        lower.semilogy(result.frequency_hz, median, color=colour, ls=LINES[i % 4], label=label)
        lower.fill_between(result.frequency_hz, low, high, color=colour, alpha=0.2, lw=0)
    lower.set_ylabel("difference [%]\nmedian and 10-90 %")
    lower.set_xlabel("frequency [Hz]")
    lower.legend(title="rotational constants of Table 4.2")
    for ax in (upper, lower):
        ax.set_xscale("log")
    lower.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
    lower.set_xlim(1, 100)
    return figure


@printed
def arch_sag(result: "SagStudy") -> Figure:
    """Sag under a static load against arch height, with and without fascia, and its share of the load.

    Values computed by other models are drawn as lines between hollow marks, as they are no measurements.

    Args:
        result: the model's sag; beside it Arangio's, if the load is his.
    """
    figure = Figure(figsize=(PAGE, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    others = ARANGIO_SAG if result.load == ARANGIO_LOAD else {}
    height = 1e3 * result.height
    for colour, sag, i, name in (
        (COLOURS[0], result.sag, 0, "with fascia"),
        (COLOURS[1], result.sag_cut, 1, "fascia cut"),
    ):
        left.plot(height, 1e3 * sag, color=colour, ls=LINES[i], lw=1.6, label=f"{name}, this arch")
        points = 1e3 * np.array([[h, values[i]] for h, values in others.items()]).reshape(-1, 2)
        left.plot(
            *points.T,
            MARKS[i + 1],
            ls=":",
            lw=0.9,
            color=colour,
            mfc="white",
            ms=6,
            label=f"{name}{ARANGIO}",
        )
    left.set_ylabel(f"sag under {result.load:.0f} N [mm]")
    left.set_ylim(0)
    left.legend(loc="lower left")
    right.plot(height, 100 * result.share, color=COLOURS[0], lw=1.6, label="this arch")
    right.axhline(KIM_SHARE, color="0.35", ls=":", lw=1.2, label="Kim & Voloshin 1995 (computed)")
    right.set_ylabel("load carried by the fascia [%]")
    right.set_ylim(0)
    right.legend()
    for letter, ax in zip("ab", (left, right), strict=True):
        ax.set_xlabel("arch height [mm]")
        _panel(ax, letter)
    return figure


def _panel(ax: Axes, letter: str) -> None:
    ax.set_title(f"({letter})", loc="left")


@printed
def load_resonance(result: "LoadStudy") -> Figure:
    """Transmissibility under added mass: constant constants on the left, resonance against the measured on the right.

    Args:
        result: the model under each added mass.
    """
    figure = Figure(figsize=(PAGE, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.3, 1])
    added = [case.added_mass for case in result.cases]
    measured_hz = np.array([MEASURED_HZ.get(mass, (np.nan, np.nan)) for mass in added])
    right.plot(added, [case.peak_hz for case in result.cases], color="0.35", lw=1, zorder=1, label="this arch")
    for i, (case, (low, high)) in enumerate(zip(result.cases, measured_hz, strict=True)):
        colour, mark = COLOURS[i % len(COLOURS)], MARKS[i % len(MARKS)]
        left.plot(result.frequency_hz, case.transmissibility, color=colour, ls=LINES[i % len(LINES)], lw=1.6)
        left.plot(case.peak_hz, case.transmissibility.max(), mark, color=colour, ms=5)
        right.plot(case.added_mass, case.peak_hz, mark, color=colour, ms=6)
        right.bar(case.added_mass, high - low, 0.55, low, color=colour, alpha=0.3, lw=0,
                  label="range measured (Chapter 2)" if i == 0 else None)  # fmt: skip
    left.set_xlabel("frequency [Hz]")
    left.set_ylabel("transmissibility at the malleolus")
    left.set_xlim(0, result.frequency_hz[-1])
    left.set_ylim(0)
    curves = [case.transmissibility for case in result.cases]
    colours = [COLOURS[i % len(COLOURS)] for i in range(len(added))]
    named_lines(left, result.frequency_hz, curves, [f"{mass:g} kg" for mass in added], colours)
    right.set_xticks(added, [f"{mass:g}" for mass in added])
    right.set_xlabel("added mass [kg]")
    right.set_ylabel("resonance [Hz]")
    right.set_ylim(0, 50)
    handles, labels = right.get_legend_handles_labels()
    legend_handles = [Patch(color="0.4", alpha=0.3, lw=0) if "range" in label else handle
             for handle, label in zip(handles, labels, strict=True)]  # fmt: skip
    right.legend(legend_handles, labels, loc="upper left")
    for letter, ax in zip("ab", (left, right), strict=True):
        _panel(ax, letter)
    return figure
