"""The figure of the validation: what legs that never saw a number say of it."""

import re
from typing import TYPE_CHECKING, Any

from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fasbody.presentation import COLOURS, PAGE, printed

if TYPE_CHECKING:
    from reproduction.arch_validation.evidence import Number
    from reproduction.arch_validation.validate import Validation

#: How a verdict is drawn: colour, mark and whether that is filled, so that neither colour alone tells it.
VERDICTS = {"predicted": (COLOURS[2], "o", True), "open": ("0.35", "o", False), "missed": (COLOURS[1], "X", True)}


#: Behind what was measured, and behind what other people's models say.
PUBLISHED: tuple[dict[str, Any], ...] = (
    {"color": "0.88", "lw": 0},
    {"facecolor": "white", "edgecolor": "0.8", "hatch": "//////", "lw": 0},
)


@printed
def validation(result: "Validation") -> Figure:
    """What legs that never saw a number say of it, on a scale on which every published range reaches from -1 to 1.

    The scale is even up to 2 and logarithmic beyond, so that nothing lies off the frame.
    """
    rows = [(p, k) for p in result.predictions for k in range(len(p.middle))]
    figure = Figure(figsize=(PAGE, 1.0 + 0.21 * len(rows)), layout="constrained")
    ax = figure.subplots()
    lowest, highest = -10.0, 10.0
    for y, (p, k) in enumerate(rows):
        centre, half = (p.number.high[k] + p.number.low[k]) / 2, (p.number.high[k] - p.number.low[k]) / 2
        low, middle, high, shipped = ((float(v[k]) - centre) / half for v in (p.low, p.middle, p.high, p.shipped))
        colour, mark, filled = VERDICTS[p.verdict]
        ax.barh(y, 2, 0.98, -1, zorder=0, **PUBLISHED["computed" in p.number.source])
        ax.plot([low, high], [y, y], color=colour, lw=1.6, solid_capstyle="butt")
        ax.plot(middle, y, mark, color=colour, mfc=colour if filled else "white", ms=5.5)
        ax.plot(shipped, y, "D", mfc="white" if p.number.fitted else COLOURS[0], mec=COLOURS[0], ms=3.6, zorder=3)
        if k == 0:
            ax.text(1.01, y, p.verdict, va="center", color=colour, transform=ax.get_yaxis_transform())
        if k == 0 and y and p.number.source != rows[y - 1][0].number.source:
            ax.axhline(y - 0.5, color="0.85", lw=0.6, zorder=0)
        lowest, highest = min(lowest, low, shipped), max(highest, high, shipped)
    ax.set_yticks(range(len(rows)), [_labelled(p.number, k) for p, k in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xscale("symlog", linthresh=2, linscale=0.8)
    ax.set_xlim(1.3 * lowest, 1.3 * highest)
    ticks = [x for x in (-100, -10, -2, -1, 0, 1, 2, 10, 100, 1000) if ax.get_xlim()[0] < x < ax.get_xlim()[1]]
    ax.set_xticks(ticks, [f"{x:g}".replace("-", "\u2212") for x in ticks])
    ax.minorticks_off()
    ax.set_xlabel("from the middle of the published range, in half ranges (beyond 2 logarithmic)")
    ax.grid(visible=False, axis="y")
    ax.tick_params(axis="y", length=0)
    shown: list[Artist] = [
        Patch(label=f"{word}, with its limits", **PUBLISHED[computed])
        for computed, word in enumerate(("measured", "computed by others"))
    ]
    shown += [
        Line2D([], [], marker="D", ls="", mfc=face, mec=COLOURS[0], ms=4, label=f"shipped set, {word}")
        for face, word in (("white", "fitted to it"), (COLOURS[0], "not fitted to it"))
    ]
    shown += [
        Line2D([], [], marker=mark, color=colour, mfc=colour if filled else "white", ms=5.5, label=f"{word}, 95 %")
        for word, (colour, mark, filled) in VERDICTS.items()
    ]
    figure.legend(handles=shown, loc="outside upper center", ncols=4)
    return figure


def _labelled(number: "Number", k: int) -> str:
    """What the k-th value of a number is: "Ker 1987: whole foot, elongation at 1.5 kN"."""
    source, name = number.source.split(",")[0], number.name
    if len(number.low) > 1:
        several = re.fullmatch(r"(.*) at ([\d., ]+) (\w+)", name)
        if several:
            name = f"{several[1]} at {several[2].split(', ')[k]} {several[3]}"
        else:
            name = f"{name.rsplit(', ', 1)[0]}, joint {k + 1}"
    return f"{source}: {name}"
