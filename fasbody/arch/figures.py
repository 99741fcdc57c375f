"""Figures of the arch: sensitivity, reduction to two masses, load. Every function returns a matplotlib Figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fasbody.arch.bones import PARAMETERS
from fasbody.arch.kinematics import Array
from fasbody.arch.load import ARANGIO_LOAD, ARANGIO_SAG, MEASURED_HZ
from fasbody.arch.sensitivity import CLAIMED, OUTPUTS, Study

if TYPE_CHECKING:
    from fasbody.arch.load import LoadStudy, SagStudy
    from fasbody.arch.reduction import Reduction
    from fasbody.arch.validate import Validation

KEPT, DROPPED, THIRD = "#c44e52", "#4c72b0", "#55a868"
#: The 13 constants as the thesis sets them.
SYMBOLS = [f"${name[0]}_{{{name[2:]}}}$" for name in PARAMETERS]


def sensitivity(study: Study) -> Figure:
    """`sensitivity_bars` of one study."""
    return sensitivity_bars([study])


def sensitivity_bars(studies: Sequence[Study]) -> Figure:
    """Relative sensitivity of the malleolus' acceleration, one panel a study (Figure 4.3).

    Args:
        studies: random draws are drawn as median and quartiles, an arch's own constants as they are.
    """
    figure = Figure(figsize=(7, 0.6 + 2.3 * len(studies)), layout="constrained")
    axes = figure.subplots(len(studies), squeeze=False, sharex=True, sharey=True)[:, 0]
    colours = [KEPT if name in CLAIMED else DROPPED for name in PARAMETERS]
    for ax, study in zip(axes, studies, strict=True):
        low, median, high = np.percentile(study.values[:, OUTPUTS.index("malleolus")], [25, 50, 75], axis=0)
        spread = None if study.own else [median - low, high - median]
        ax.bar(SYMBOLS, median, color=colours, yerr=spread, capsize=3, ecolor="0.3")
        ax.set_yscale("log")
        ax.set_ylabel("relative sensitivity")
        ax.set_axisbelow(True)
        ax.grid(axis="y", color="0.9")
        ax.set_title(_title(study), fontsize=9, loc="left")
    figure.suptitle("Acceleration of the malleolus: the four constants the thesis keeps are red", fontsize=10)
    return figure


def sensitivity_cases(studies: Sequence[Study]) -> Figure:
    """Relative sensitivity of the malleolus' acceleration draw by draw (Figure C.1), the four largest dotted."""
    height = max(2.5, 0.11 * len(studies[0].values))
    figure = Figure(figsize=(7, 0.6 + (height + 0.5) * len(studies)), layout="constrained")
    axes = figure.subplots(len(studies), squeeze=False, sharex=True)[:, 0]
    for ax, study in zip(axes, studies, strict=True):
        values = study.values[:, OUTPUTS.index("malleolus")]
        image = ax.imshow(np.log10(values), aspect="auto", cmap="viridis", vmin=-6, vmax=0)
        top = np.argsort(values, axis=1)[:, -len(CLAIMED) :]
        rows = np.repeat(np.arange(len(values)), len(CLAIMED))
        claimed = np.array([PARAMETERS[j] in CLAIMED for j in top.ravel()])
        for among, colour in ((claimed, "white"), (~claimed, KEPT)):
            ax.scatter(top.ravel()[among], rows[among], s=9, color=colour, edgecolors="black", linewidths=0.4)
        ax.set_xticks(range(len(PARAMETERS)), SYMBOLS)
        ax.set_ylabel("random case")
        ax.set_title(_title(study), fontsize=9, loc="left")
        figure.colorbar(image, ax=ax, label="log$_{10}$ relative sensitivity", pad=0.01)
    dots = [
        Line2D([], [], marker="o", ls="", mfc=colour, mec="black", mew=0.4, label=label)
        for colour, label in (("white", "among the four largest, as claimed"), (KEPT, "the same, against the claim"))
    ]
    figure.legend(handles=dots, loc="outside upper center", ncols=2, frameon=False, fontsize=9)
    return figure


def _title(study: Study) -> str:
    held = int(study.holds("malleolus").sum())
    if study.own:
        return f"{study.reading}, {study.method}: claim {'holds' if held else 'does not hold'}"
    return f"{study.reading}, {study.method}: claim holds in {held} of {len(study.values)} draws"


def reduction(result: "Reduction") -> Figure:
    """Five-body and two-mass transmissibility of the nominal arch, and the difference over random draws."""
    figure = Figure(figsize=(7, 6), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    for i, (name, five, two) in enumerate(result.examples):
        colour = (KEPT, DROPPED, THIRD)[i]
        upper.plot(result.frequency_hz, five, color=colour, label=f"{name}, five bodies")
        upper.plot(result.frequency_hz, two, "--", color=colour, label=f"{name}, two masses")
    upper.set_ylabel("transmissibility at the malleolus")
    upper.legend(fontsize=8)
    for i, (lever_arm_m, difference) in enumerate(result.differences.items()):
        colour = (KEPT, DROPPED, THIRD, "0.4")[i % 4]
        label = "literal" if lever_arm_m is None else f"lever arm {lever_arm_m * 1e3:g} mm"
        low, median, high = np.percentile(100 * difference, [10, 50, 90], axis=0)
        lower.semilogy(result.frequency_hz, median, color=colour, label=label)
        lower.fill_between(result.frequency_hz, low, high, color=colour, alpha=0.2, lw=0)
    lower.set_ylabel("difference [%], median and 10-90 %")
    lower.set_xlabel("frequency [Hz]")
    lower.legend(fontsize=8, title="rotational constants of Table 4.2", title_fontsize=8)
    for ax in (upper, lower):
        ax.set_xscale("log")
        ax.grid(color="0.9")
    lower.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
    lower.set_xlim(1, 100)
    return figure


def arch_sag(result: "SagStudy", measured: dict[float, tuple[float, float]] | None = None) -> Figure:
    """Sag under a static load against arch height, with and without fascia, and its share of the load.

    Args:
        result: the model's sag.
        measured: arch height [m] -> sag [m] with and without fascia; what is known under this load unless given.
    """
    figure = Figure(figsize=(7, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    if measured is None:
        measured = ARANGIO_SAG if result.load == ARANGIO_LOAD else {}
    height = 1e3 * result.height
    for colour, sag, i, name in ((KEPT, result.sag, 0, "with fascia"), (DROPPED, result.sag_cut, 1, "fascia cut")):
        left.plot(height, 1e3 * sag, color=colour, label=f"{name}, model")
        points = 1e3 * np.array([[h, values[i]] for h, values in measured.items()])
        left.plot(*points.T, "o", color=colour, label=f"{name}, Arangio 1998 (computed)")
    left.set_ylabel(f"sag under {result.load:.0f} N [mm]")
    left.set_ylim(0)
    left.legend(fontsize=8)
    right.plot(height, 100 * result.share, color=KEPT, label="model")
    right.axhline(14, color="0.4", ls="--", label="Kim & Voloshin")
    right.set_ylabel("load carried by the fascia [%]")
    right.set_ylim(0)
    right.legend(fontsize=8)
    for ax in (left, right):
        ax.set_xlabel("arch height [mm]")
        ax.grid(color="0.9")
    return figure


def load_resonance(result: "LoadStudy", measured_hz: Array | None = None) -> Figure:
    """Transmissibility under added mass: constant constants on the left, resonance against the measured on the right.

    Args:
        result: the model under each added mass.
        measured_hz: for each added mass the range of the resonance [Hz], low and high, shape (n, 2); the measured
            one unless given.
    """
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.3, 1])
    for i, case in enumerate(result.cases):
        colour = (KEPT, DROPPED, THIRD)[i] if i < 3 else f"C{i}"
        left.plot(result.frequency_hz, case.transmissibility, color=colour, label=f"+ {case.added_mass:g} kg")
        left.plot(case.peak_hz, case.transmissibility.max(), "o", color=colour)
    left.set_xlabel("frequency [Hz]")
    left.set_ylabel("transmissibility at the malleolus")
    left.legend(fontsize=8, title="constants unchanged", title_fontsize=8)
    added = [case.added_mass for case in result.cases]
    right.plot(added, [case.peak_hz for case in result.cases], "o-", color=KEPT, label="model, constants unchanged")
    if measured_hz is None:
        measured_hz = np.array([MEASURED_HZ.get(mass, (np.nan, np.nan)) for mass in added])
    middle = np.mean(measured_hz, axis=1)
    spread = np.abs(np.array(measured_hz).T - middle)
    right.errorbar(added, middle, yerr=spread, fmt="s", color="0.2", capsize=4, label="measured (Chapter 2)")
    right.set_xlabel("added mass [kg]")
    right.set_ylabel("resonance [Hz]")
    right.set_ylim(0, 50)
    right.legend(fontsize=8)
    for ax in (left, right):
        ax.grid(color="0.9")
    return figure


def validation(result: "Validation") -> Figure:
    """What legs that never saw a number say of it, on a scale on which every published range reaches from -1 to 1."""
    rows = [(p, k) for p in result.predictions for k in range(len(p.middle))]
    figure = Figure(figsize=(7.4, 0.9 + 0.23 * len(rows)), layout="constrained")
    ax = figure.subplots()
    ax.axvspan(-1, 1, color="0.92", lw=0, label="published, with its limits")
    colours = {"foreseen": THIRD, "open": "0.35", "missed": KEPT}
    labels, edge = [], 9.0
    for y, (p, k) in enumerate(rows):
        centre, half = (p.number.high[k] + p.number.low[k]) / 2, (p.number.high[k] - p.number.low[k]) / 2
        low, middle, high, shipped = ((float(v[k]) - centre) / half for v in (p.low, p.middle, p.high, p.shipped))
        middle, shipped = (max(-edge, min(edge, v)) for v in (middle, shipped))
        ax.plot([low, high], [y, y], color=colours[p.verdict], lw=1.6)
        ax.plot(middle, y, "o", color=colours[p.verdict], ms=5)
        ax.plot(shipped, y, "D", mfc="white" if p.number.fitted else DROPPED, mec=DROPPED, ms=4, zorder=3)
        short = p.number.source.split(",")[0]
        labels.append(f"{p.number.name} ({short})" if k == 0 else f"the same, {k + 1} of {len(p.middle)}")
    ax.set_yticks(range(len(rows)), labels, fontsize=7)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlim(-edge - 0.3, edge + 0.3)
    ax.set_xticks(range(-8, 9, 2))
    ax.set_xlabel("half ranges from the middle of what is published (at the edge: farther)", fontsize=8)
    ax.grid(axis="x", color="0.85")
    ax.set_axisbelow(True)
    shown = [Line2D([], [], marker="o", color=colour, label=f"{word}, 95 %") for word, colour in colours.items()]
    shown += [
        Line2D([], [], marker="D", ls="", mfc=face, mec=DROPPED, label=f"shipped set, {word}")
        for face, word in (("white", "fitted to it"), (DROPPED, "not fitted to it"))
    ]
    figure.legend(handles=shown, loc="outside upper center", ncols=3, fontsize=7, frameon=False)
    return figure
