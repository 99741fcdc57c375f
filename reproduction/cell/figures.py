"""Figures 5.9 to 5.11 anew."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fasbody.presentation import COLOURS, COLUMN, panels, printed
from reproduction.cell.sweep import YEAST_PA, PowerLaw, Sweep

MARKERS = "osD^v<>pPX*hdH"


@printed
def shapes(sweep: Sweep) -> Figure:
    """Figure 5.9: frequencies over the mode number for each base shape."""
    figure, ((axes,),) = panels(1, 1, 1.3 * COLUMN, 3.2)
    numbers = np.arange(1, sweep.frequencies_hz.shape[1] + 1)
    for i, (a, f) in enumerate(zip(sweep.analyses, sweep.frequencies_hz, strict=True)):
        label = f"{a.dome.length:g} × {a.dome.width:g} µm" if a.dome else "own mesh"
        axes.plot(numbers, f, marker=MARKERS[i], label=label)
    axes.set(xlabel="mode number", ylabel="natural frequency [Hz]", xticks=numbers)
    axes.legend(title=f"base axes ({sweep.analyses[0].preset.name})")
    return figure


@printed
def moduli(sweep: Sweep) -> Figure:
    """Figure 5.10: frequencies over the mode number for each modulus of the cytoplasm."""
    figure, ((axes,),) = panels(1, 1, 1.3 * COLUMN, 3.2)
    numbers = np.arange(1, sweep.frequencies_hz.shape[1] + 1)
    for i, (a, f) in enumerate(zip(sweep.analyses, sweep.frequencies_hz, strict=True)):
        axes.semilogy(numbers, f, marker=MARKERS[i], label=f"{a.model.materials[0].E:g} Pa")
    axes.set(xlabel="mode number", ylabel="natural frequency [Hz]", xticks=numbers)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], title="Young's modulus", loc="outside right center")
    return figure


@printed
def power_law(sweep: Sweep, laws: Sequence[PowerLaw], direct_hz: float) -> Figure:
    """Figure 5.11: first frequency over the modulus, both fits, and what the model itself gives at their far end."""
    figure, ((axes,),) = panels(1, 1, 1.3 * COLUMN, 3.2)
    E = np.array([a.model.materials[0].E for a in sweep.analyses])
    fine = np.geomspace(E.min(), YEAST_PA, 100)
    for law, style in zip(laws, ("-", "--"), strict=True):
        text = f"$f_1 = {law.a:.3g}\\,E^{{{law.b:.3f}}}$ ({law.way}): {law(YEAST_PA):.0f} Hz at {YEAST_PA / 1e6:g} MPa"
        axes.loglog(fine, law.a * fine**law.b, style, color="0.4", label=text)
    axes.loglog(E, sweep.frequencies_hz[:, 0], "o", label="model, nucleus 400 Pa")
    axes.loglog(
        [YEAST_PA],
        [direct_hz],
        "s",
        color=COLOURS[1],
        label=f"model at {YEAST_PA / 1e6:g} MPa: {direct_hz:.0f} Hz",
    )
    axes.set(xlabel="Young's modulus of the cytoplasm [Pa]", ylabel="first natural frequency [Hz]")
    figure.legend(loc="outside upper center")
    return figure
