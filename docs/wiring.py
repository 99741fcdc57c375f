"""Wiring: `python docs/wiring.py docs/figures/wiring.svg` draws that of docs/acquisition.md.

A file whose name begins with benches gets the two benches of docs/laboratory.md.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import FancyBboxPatch

#: What is wired: title, names of the sensors' pins, and for each wire the board's pin, the sensors' pin, which of the
#: two (0 base, 1 malleolus, None both) and its colour.
Wire = tuple[str, str, int | None, str]
ANALOG: list[Wire] = [
    ("3V3", "VCC", None, "tab:red"), ("GND", "GND", None, "black"), ("D4", "ST, behind divider", None, "tab:purple"),
    ("A0", "Z", 0, "tab:blue"), ("A1", "Z", 1, "tab:orange"),
]  # fmt: skip
SPI: list[Wire] = [
    ("3V3", "VDD, VDDIO", None, "tab:red"), ("GND", "GND", None, "black"), ("D13", "SCLK", None, "tab:brown"),
    ("D12", "MISO", None, "tab:green"), ("D11", "MOSI", None, "tab:olive"), ("D9", "DRDY", None, "tab:purple"),
    ("D10", "CS", 0, "tab:blue"), ("D8", "CS", 1, "tab:orange"),
]  # fmt: skip
ROLES = ("base", "malleolus")
#: Boxes of a bench: text, and where [column, row]; arrows: from, to, and what goes along them.
Bench = tuple[list[tuple[str, float, float]], list[tuple[int, int, str]]]
_SENSORS = ("base sensor\non the table", "malleolus sensor\non the skin")
_SHAKER = [("amplifier,\nemergency stop", 2.0, 0.0), ("shaker and table", 3.0, 0.0)]
BOARD: Bench = (
    [("computer", 0, 1), ("Uno or Nano", 1, 2), (_SENSORS[0], 2, 2.5), (_SENSORS[1], 2, 1.5), *_SHAKER,
     ("SCPI generator", 1, 0)],
    [(0, 1, "USB"), (2, 1, ""), (3, 1, ""), (0, 6, "USB or LAN"), (6, 4, "BNC"), (4, 5, "")],
)  # fmt: skip
CARD: Bench = (
    [("computer", 0, 1), ("audio interface,\nNI, MCC or LabJack", 1, 1), (_SENSORS[0], 3, 2.5), (_SENSORS[1], 3, 1.5),
     *_SHAKER, ("IEPE conditioner\n(one kind for both)", 2, 2)],
    [(0, 1, "USB"), (6, 1, "in 1, in 2"), (2, 6, ""), (3, 6, ""), (1, 4, "out 1, or a generator"), (4, 5, "")],
)  # fmt: skip


def draw(ax: "Axes", title: str, wires: list[Wire], between: str = "", reference: bool = False) -> None:
    """Board on the left, both sensors on the right, a wire from pin to pin; with AREF to the supply as reference."""
    pitch = 0.9
    top = pitch * len(wires) * 2
    ax.set_title(title, loc="left", fontsize=11)
    ax.add_patch(_box(-1.2, -0.6, 3.4, top + 0.2))
    ax.text(0.5, top - 0.75, "Uno or Nano\nATmega328P", ha="center", va="top", fontsize=10)
    for sensor, role in enumerate(ROLES):
        mine = [wire for wire in wires if wire[2] in (None, sensor)]
        low = (1 - sensor) * (top / 2 + 0.2)
        ax.add_patch(_box(7.6, low - 0.6, 3.6, pitch * len(mine) + 0.2))
        ax.text(11.0, low + pitch * (len(mine) - 1) / 2, role, ha="right", va="center", fontsize=10)
        for row, (pin, name, _, colour) in enumerate(reversed(mine)):
            y = low + row * pitch
            ax.text(7.75, y, name, va="center", fontsize=9)
            column = 3.2 + 0.42 * [wire[0] for wire in wires].index(pin)
            start = _row(wires, pin) * pitch * 1.4
            ax.plot([2.2, column, column, 7.6], [start, start, y, y], color=colour, lw=1.6, solid_joinstyle="round")
            if mine[len(mine) - 1 - row][2] is None:  # goes to both
                ax.plot([column], [start], "o", color=colour, ms=4)
    if reference:
        column, start = 3.2, _row(wires, wires[0][0]) * pitch * 1.4
        ax.plot([2.2, column], [start + pitch, start + pitch], color=wires[0][3], lw=1.6)
        ax.plot([column], [start + pitch], "o", color=wires[0][3], ms=4)
        ax.text(2.05, start + pitch, "AREF", ha="right", va="center", fontsize=9)
    for pin, *_ in wires:
        ax.text(2.05, _row(wires, pin) * pitch * 1.4, pin, ha="right", va="center", fontsize=9)
    if between:
        ax.text(2.3, top + 0.1, between, fontsize=9, va="bottom")
    ax.set(xlim=(-1.4, 11.4), ylim=(-1.0, top + 1.3), aspect="equal")
    ax.axis("off")


def chain(ax: "Axes", title: str, bench: Bench) -> None:
    """Boxes and arrows of a bench."""
    boxes, arrows = bench
    ax.set_title(title, loc="left", fontsize=11)
    for text, column, row in boxes:
        ax.add_patch(_box(3.4 * column, 1.6 * row, 2.2, 1.0))
        ax.text(3.4 * column + 1.1, 1.6 * row + 0.5, text, ha="center", va="center", fontsize=9)
    for first, last, text in arrows:
        (_, x0, y0), (_, x1, y1) = boxes[first], boxes[last]
        begin = (3.4 * x0 + (2.2 if x1 > x0 else 0.0), 1.6 * y0 + 0.5)
        end = (3.4 * x1 + (0.0 if x1 > x0 else 2.2), 1.6 * y1 + 0.5)
        ax.annotate("", end, begin, arrowprops={"arrowstyle": "-|>", "color": "0.2"})
        ax.text(
            (begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2, text, ha="center", va="center", fontsize=8,
            bbox={"fc": "white", "ec": "none", "pad": 1.5} if text else None,
        )  # fmt: skip
    ax.set(xlim=(-0.3, 12.8), ylim=(-0.3, 5.4), aspect="equal")
    ax.axis("off")


def _row(wires: list[Wire], pin: str) -> int:
    return len(wires) - 1 - [wire[0] for wire in wires].index(pin)


def _box(x: float, y: float, width: float, height: float) -> "FancyBboxPatch":
    from matplotlib.patches import FancyBboxPatch

    return FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.15", fc="0.96", ec="0.3")


def main(file: Path | None = None) -> Path:
    """Draw both and write the file."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    file = file or Path(sys.argv[1] if len(sys.argv) > 1 else "wiring.svg")
    with rc_context({"svg.hashsalt": "wiring", "svg.fonttype": "none"}):
        figure = Figure(figsize=(12, 6), layout="constrained")
        if file.name.startswith("benches"):
            figure.set_size_inches(8.5, 7.2)
            above, below = figure.subplots(2, 1)
            chain(above, "A board and a generator", BOARD)
            chain(below, "One device that plays and records", CARD)
            figure.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None, dpi=110)
            return file
        left, right = figure.subplots(1, 2)
        across = "wires that cross without a dot do not touch\nST of 3.3 V sensors: 4.7 kOhm from D4, 10 kOhm to GND"
        draw(left, "Analog pair (ADXL335)", ANALOG, across, reference=True)
        note = "ADXL345: no wire to D9. 5 V board: all of D8 to D13\nbut D12 through a level shifter"
        draw(right, "SPI pair (ADXL355, ADXL345)", SPI, note)
        figure.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None, dpi=110)
    return file


if __name__ == "__main__":
    main()
