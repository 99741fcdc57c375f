"""The pictures of the pages that explain the fit, and those of the paper.

    python docs/draw.py                     # all of them as SVG into docs/figures
    python docs/draw.py docs/paper mirror-feet.png fit-intervals.png leg-peaks.png

Models, harmonics and fits are the project's own, so a picture shows what the code does. It takes about a minute.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.optimize import least_squares

import fasbody as fb
import identification as idn
from fasbody.console import write_whole
from fasbody.foot.two_dof import TwoDof
from fasbody.leg.chain import Leg
from fasbody.leg.peaks import peaks as leg_peaks
from fasbody.presentation import COLOURS, PAGE, picture, printed
from fasbody.recording.condition import foot_mass, shank_mass
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.study import BUNDLED, read_truth
from identification.figures import label_of

BLUE, RED, GREY = *COLOURS[:2], "#8a8a8a"
#: A linear foot of a person of 70.7 kg.
FOOT = TwoDof(
    k_T=1.31e5, k_F=9.4e4, c_11=165.0, c_12=0.0, c_13=0.0, c_21=310.0, c_22=0.0, c_23=0.0,
    m_S=shank_mass(70.7), m_F=foot_mass(70.7),
)  # fmt: skip
F = np.arange(10.0, 51.0, 5.0)  # Hz
NOISE = 0.003  # of the table's acceleration
LOAD = 2.3  # kg
ODDS = 2 * np.log(1000)  # difference of chi-square that makes odds of 1000 to 1


def chain(ax: Axes, x: float, names: tuple[str, ...], widths: tuple[float, float] = (1.6, 1.6)) -> None:
    """Table, foot and shank above one another at x, with spring and damper between; names from the table up."""
    for bottom, height, name, face in (
        (0.0, 0.1, names[0], "0.8"),
        (0.9, 0.35, names[3], "0.93"),
        (2.05, 0.6, names[6], "0.93"),
    ):
        ax.add_patch(Rectangle((x - 0.55, bottom), 1.1, height, facecolor=face, edgecolor="k", lw=1))
        ax.text(x, bottom + height / 2 - (0.2 if bottom == 0 else 0), name, ha="center", va="center")
    for low, high, spring, damper, width in (
        (0.1, 0.9, names[1], names[2], widths[0]),
        (1.25, 2.05, names[4], names[5], widths[1]),
    ):
        turns = low + (high - low) * np.concatenate([[0, 0.15], np.linspace(0.2, 0.8, 9), [0.85, 1]])
        ax.plot(x - 0.3 + 0.1 * np.array([0, 0, *(-1.0, 1) * 4, -1.0, 0, 0]), turns, color="k", lw=width)
        middle = (low + high) / 2
        ax.plot([x + 0.3] * 2, [low, middle - 0.08], color="k", lw=1.2)
        ax.plot(
            [x + 0.18, x + 0.18, x + 0.42, x + 0.42],
            [middle + 0.1, middle - 0.08, middle - 0.08, middle + 0.1],
            color="k",
            lw=1.2,
        )
        ax.plot([x + 0.21, x + 0.39], [middle + 0.03] * 2, color="k", lw=1.2)
        ax.plot([x + 0.3] * 2, [middle + 0.03, high], color="k", lw=1.2)
        ax.text(x - 0.45 - 0.02 * width, middle, spring, ha="right", va="center")
        ax.text(x + 0.5, middle, damper, ha="left", va="center")


def model() -> Figure:
    """The two-mass foot with its coordinates."""
    figure = Figure(figsize=(3.35, 2.9), layout="constrained")
    ax = figure.subplots()
    chain(ax, 0.0, ("table", "$k_F$", "$c_F$", "foot  $m_F$", "$k_T$", "$c_T$", "shank  $m_S$"))
    for y, name in ((0.1, "$y_0$"), (1.07, "$y_2$"), (2.35, "$y_1$")):
        ax.annotate("", (1.3, y + 0.28), (1.3, y), arrowprops={"arrowstyle": "->", "color": BLUE})
        ax.plot([0.6, 1.36], [y] * 2, color=BLUE, lw=0.8)
        ax.text(1.38, y + 0.2, name, color=BLUE)
    for y, name, what in ((0.5, "$z_2 = y_2 - y_0$", "fat pad"), (1.65, "$z_1 = y_1 - y_2$", "ankle")):
        ax.text(-1.05, y, f"{what}\n{name}", ha="right", va="center", linespacing=1.6)
    ax.set(xlim=(-2.5, 1.75), ylim=(-0.25, 2.75), aspect="equal")
    ax.axis("off")
    return figure


def harmonics() -> Figure:
    """A bundled recording at 20 Hz: its samples over one period, and what is kept of them."""
    recording = next(r for r in fb.bundled() if r.condition.frequency_hz == 20 and not r.condition.added_mass_kg)
    figure = Figure(figsize=(PAGE, 2.7), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    phase = np.linspace(0, 1, 400)
    for channel, color, name in ((recording.base_m_s2, GREY, "table"), (recording.malleolus_m_s2, BLUE, "malleolus")):
        found = fit_harmonics(recording.time_s, channel, 20.0, 5)
        order = np.arange(1, 6)
        curve = found.offset + (found.amplitudes * np.exp(2j * np.pi * phase[:, None] * order)).sum(axis=1).real
        folded = recording.time_s * 20 % 1
        left.plot(folded[::23], channel[::23], ".", color=color, ms=5, alpha=0.5, mew=0)
        left.plot(phase, curve, color=color, lw=1, label=name)
        shift = 0.16 if color == BLUE else -0.16
        mark = "o" if color == BLUE else "s"
        right.plot(order + shift, np.abs(found.amplitudes), mark, color=color, ms=5)
        right.hlines(
            found.std,
            order + shift - 0.15,
            order + shift + 0.15,
            color="k",
            lw=1.6,
            label="noise" if color == BLUE else None,
        )
    left.set(
        xlabel="part of the period",
        ylabel="acceleration [m/s²]",
        title="samples of four seconds, folded into one period",
    )
    left.legend(loc="lower left", bbox_to_anchor=(0.12, 0))
    right.set(
        yscale="log",
        ylim=(1e-4, 200),
        xlabel="harmonic of 20 Hz",
        ylabel="amplitude [m/s²]",
        title="what is kept: five harmonics a channel",
    )
    right.legend(loc="upper right")
    return figure


def measured(feet: tuple[TwoDof, ...]) -> list[np.ndarray]:
    """Transmissibility of each foot with noise."""
    rng = np.random.default_rng(3)
    return [
        foot.transmissibility(F) + NOISE * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size))
        for foot in feet
    ]


def profile(feet: tuple[TwoDof, ...], k_T: np.ndarray) -> np.ndarray:
    """Chi-square over k_T (n,), the other constants at their best; the feet share them and differ in their masses."""
    data = measured(feet)

    def residual(z: np.ndarray, stiffness: float) -> np.ndarray:
        k_F, c_11, c_21 = np.exp(z)
        models = [replace(foot, k_T=stiffness, k_F=k_F, c_11=c_11, c_21=c_21).transmissibility(F) for foot in feet]
        r = np.concatenate([model - y for model, y in zip(models, data, strict=True)]) / NOISE
        return np.concatenate([r.real, r.imag])

    starts = [np.log([foot.k_F, foot.c_11, foot.c_21]) for foot in (FOOT, FOOT.mirror())]
    return np.array([min(2 * least_squares(residual, z, args=(k,)).cost for z in starts) for k in k_T])


def residual() -> Figure:
    """The residual of a foot that is a little too stiff, and the sum of its squares over that stiffness."""
    figure = Figure(figsize=(PAGE, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    (data,), wrong = measured((FOOT,)), replace(FOOT, k_T=1.4 * FOOT.k_T)
    fine, there = np.linspace(9, 51, 400), wrong.transmissibility(F)
    left.plot(*_parts(wrong.transmissibility(fine)), color=RED, lw=1, label="model, ankle 40 % too stiff")
    left.quiver(
        *_parts(data), *_parts(there - data), angles="xy", scale_units="xy", scale=1, width=0.008, color="k", zorder=3
    )
    left.plot(*_parts(data), "o", color=BLUE, ms=4, label="measured")
    for f, y in zip(F, data, strict=True):
        if f in (10, 15, 20, 25, 50):
            left.annotate(
                f"{f:g} Hz", _parts(y), xytext=(6, -10 if f == 20 else 4), textcoords="offset points", fontsize=7
            )
    left.set(
        xlabel="real part",
        ylabel="imaginary part",
        title="residual $r = Y_\\mathrm{model} - Y_\\mathrm{measured}$",
        aspect="equal",
        ylim=(-3.85, 0.2),
    )
    left.legend(loc="center", fontsize=7)
    k = np.linspace(0.94, 1.07, 41) * FOOT.k_T
    chi = profile((FOOT,), k)
    low = chi.min()
    right.plot(k / 1e3, chi, color=BLUE)
    right.axhline(low + 3.84, color=GREY, lw=0.8, ls="--")
    inside = k[chi < low + 3.84] / 1e3
    right.axvspan(inside[0], inside[-1], color=BLUE, alpha=0.12, lw=0)
    right.text(inside[0], chi.max(), " 95 %", va="top", color=BLUE)
    right.axvline(FOOT.k_T / 1e3, color="k", lw=0.8)
    right.text(FOOT.k_T / 1e3, chi.max(), " truth", va="top")
    right.set(xlabel="$k_T$ [kN/m]", ylabel="$\\chi^2$", title="its whitened sum of squares")
    return figure


def likelihood() -> Figure:
    """Both valleys of chi-square over k_T: as deep with one load, and not with two."""
    figure = Figure(figsize=(PAGE, 2.9), layout="constrained")
    k = np.geomspace(0.4 * FOOT.k_T, 1.6 * FOOT.k_T, 61)
    k = np.sort(np.concatenate([k, [FOOT.k_T, FOOT.mirror().k_T]]))
    heavy = replace(FOOT, m_S=FOOT.m_S + LOAD)
    for ax, feet, title in zip(
        figure.subplots(1, 2, sharey=True),
        ((FOOT,), (FOOT, heavy)),
        ("one load: undecided", "two loads: decided"),
        strict=True,
    ):
        chi = profile(feet, k)
        chi = chi - chi.min()
        ax.plot(k / 1e3, chi + 0.1, color=BLUE)
        ax.axhline(ODDS, color=GREY, lw=0.8, ls="--")
        for stiffness, name in ((FOOT.k_T, "truth"), (FOOT.mirror().k_T, "mirror")):
            ax.axvline(stiffness / 1e3, color="k", lw=0.8, ls=":")
            ax.text(stiffness / 1e3, 5e5, f" {name}", va="top")
        ax.set(yscale="log", ylim=(0.08, 8e5), xlabel="$k_T$ [kN/m]", title=title)
    figure.axes[0].set_ylabel("$\\chi^2$ above its lowest")
    figure.axes[0].text(150, ODDS * 1.3, "1000 to 1", color=GREY, fontsize=8)
    return figure


def mirror() -> Figure:
    """Two feet, and what each does to malleolus and foot bones."""
    figure = Figure(figsize=(PAGE, 3.3), layout="constrained")
    drawing, *axes = figure.subplots(1, 3, width_ratios=(2.2, 1.5, 1.5))
    feet = {"a foot": FOOT, "its mirror": FOOT.mirror()}
    for x, (name, foot) in zip((0.0, 2.5), feet.items(), strict=True):
        thick = (foot.k_F / 4e4, foot.k_T / 4e4)
        chain(drawing, x, ("table", f"{foot.k_F / 1e3:.0f}", "", "$m_F$", f"{foot.k_T / 1e3:.0f}", "", "$m_S$"), thick)
        drawing.text(x, 2.85, name, ha="center", weight="bold")
    drawing.text(1.2, -0.55, "stiffness [kN/m]", ha="center")
    drawing.set(xlim=(-1.1, 3.4), ylim=(-0.7, 3.1), aspect="equal")
    drawing.axis("off")
    f = np.linspace(2, 60, 300)
    s = 2j * np.pi * f
    for (name, foot), color, style, width in zip(feet.items(), (BLUE, RED), ("-", "--"), (3.0, 1.5), strict=True):
        shank = foot.transmissibility(f)
        bones = shank * (foot.m_S * s**2 + foot.k_T + foot.c_11 * s) / (foot.k_T + foot.c_11 * s)
        for ax, response in zip(axes, (shank, bones), strict=True):
            ax.plot(f, np.abs(response), style, color=color, lw=width, label=name)
    for ax, title in zip(axes, ("malleolus: one curve", "foot bones: two"), strict=True):
        ax.set(xlabel="frequency [Hz]", title=title, ylim=(0, None))
    axes[0].set_ylabel("transmissibility")
    axes[0].legend(loc="upper right")
    return figure


def wide() -> Figure:
    """Both intervals of each constant of the bundled foot, beside the truth."""
    result = idn.fit_foot(fb.bundled(), fb.load("two_dof"), starts=4).with_source("bundled", read_truth(BUNDLED))
    figure = Figure(figsize=(PAGE, 3.0), layout="constrained")
    ax = figure.subplots()
    names = [name for name in result.parameters if result.truth_of(name)]
    for row, name in enumerate(reversed(names)):
        estimate, true = result.parameters[name], result.truth_of(name)
        for its, color, shift, label in (
            (estimate, BLUE, 0.14, "model and sensor errors included"),
            (estimate.if_model_true, RED, -0.14, "model assumed exact"),
        ):
            ax.plot(its.value / true, row + shift, "o", color=color, mfc="white", ms=3.2, mew=0.8, zorder=3)
            ends = np.array([its.lower, its.upper]) / true
            ax.plot(
                np.sort(ends),
                [row + shift] * 2,
                color=color,
                lw=4,
                solid_capstyle="butt",
                label=label if row == 0 else None,
            )
    ax.axvline(1, color="k", lw=0.8)
    ax.set(xlabel="95 % interval divided by the true value", yticks=range(len(names)), xlim=(0, 1.8))
    ax.set_yticklabels([label_of(name).split("\n")[0] for name in reversed(names)])
    ax.legend(loc="lower right")
    return figure


def peaks() -> Figure:
    """Where the malleolus of the shipped leg peaks under three loads that change none of its constants."""
    foot = fb.load("leg")
    return leg_peaks(Leg.from_model(foot.model, foot.name), foot.name).plot()


def _parts(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.real(z), np.imag(z)


PICTURES = {
    "fit-model": model, "fit-harmonics": harmonics, "fit-residual": residual, "fit-intervals": wide,
    "mirror-feet": mirror, "mirror-likelihood": likelihood, "leg-peaks": peaks,
}  # fmt: skip


def main(folder: Path = Path(__file__).parent / "figures", *names: str) -> None:
    """Draw pictures into a folder, each as its ending says: all of them as SVG unless some are named."""
    for name in names or [f"{name}.svg" for name in PICTURES]:
        stem, _, kind = name.partition(".")
        write_whole(folder / name, picture(printed(PICTURES[stem])(), kind, dpi=300))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]), *sys.argv[2:])
