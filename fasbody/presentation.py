"""How a result shows itself: at a prompt, in a notebook, as a table of numbers, as a figure, as files."""

import csv
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from html import escape
from importlib import import_module
from io import BytesIO, StringIO
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, ClassVar, ParamSpec, TypeVar, cast

from fasbody.console import make_folder, to_json, write_whole
from fasbody.exceptions import InputFileError, SettingError, shown, unknown

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from matplotlib.figure import Figure

#: What a screen has: characters a line, rows of a table, and notes below it.
WIDTH, ROWS, NOTES = 80, 20, 6
#: Colours and marks of loads and other series, in this order in every figure; apart for the colour-blind and in grey.
COLOURS, MARKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"), ("o", "s", "^", "D", "v", "P")
#: Dashes of a line, in the same order.
LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)))
#: Widths of a printed figure [inches]: a page of a journal, and one of its two columns (180 and 85 mm).
PAGE, COLUMN = 7.08, 3.35
#: How every figure is drawn: nothing is smaller than 7 points when it is printed as wide as it is drawn.
STYLE: Any = {
    "axes.prop_cycle": f"cycler(color={list(COLOURS)})",
    "font.size": 8, "axes.labelsize": 8, "axes.titlesize": 8, "figure.titlesize": 8.5, "figure.labelsize": 7.5,
    "xtick.labelsize": 7.5, "ytick.labelsize": 7.5, "legend.fontsize": 7.5, "legend.title_fontsize": 7.5,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True,
    "grid.alpha": 0.25, "grid.linewidth": 0.5, "axes.linewidth": 0.7, "xtick.major.width": 0.7,
    "ytick.major.width": 0.7, "lines.linewidth": 1.2, "lines.markersize": 4.5,
    "hatch.linewidth": 0.6, "svg.fonttype": "path", "legend.frameon": False,
}  # fmt: skip
_Arguments = ParamSpec("_Arguments")
_Drawn = TypeVar("_Drawn")

#: What the ends of names say of units.
_UNITS = {
    "_hz": "Hz", "_kg": "kg", "_deg": "degree", "_n_per_m": "N/m", "_ns_per_m": "N s/m", "_per_m": "1/m",
    "_n_s_per_m": "N s/m",
    "_s_per_m": "s/m", "_n_m_per_rad": "N m/rad", "_n_m_s_per_rad": "N m s/rad",
    "_m_s2": "m/s^2", "_m": "m",
    "_s": "s", "_yr": "yr", "_percent": "%", "_n": "N", "_rad": "rad",
}  # fmt: skip
#: Integer parts of five digits and more.
_LONG = re.compile(r"(?<![\w.])\d{5,}(?![\de])")


def unit_of(name: str) -> str:
    """The unit that a column's name ends with, empty where it has none."""
    ends = sorted((end for end in _UNITS if name.removesuffix("_std").endswith(end)), key=len)
    return _UNITS[ends[-1]] if ends else ""


def grouped(text: str) -> str:
    """Digits before the point in groups of three where there are five or more, as SI writes them: 131 160."""
    return _LONG.sub(lambda digits: f"{int(digits[0]):,}".replace(",", "\u202f"), text)


def counted(count: int, one: str, more: str = "") -> str:
    """A count with its noun: 1 foot, 12 feet."""
    return f"{count} {one if count == 1 else more or one + 's'}"


def listed(words: Sequence[str], last: str = "and") -> str:
    """Words with commas and an `and`, or another last word."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def readable(value: float, digits: int = 3) -> str:
    """A number for people: so many significant digits, no exponent from a ten thousandth to a billion, grouped."""
    if not math.isfinite(value) or value == 0 or not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits}g}"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    text = f"{round(value, places):.{max(0, places)}f}"
    return grouped(text.rstrip("0").rstrip(".") if "." in text else text)


def printed(draw: Callable[_Arguments, _Drawn]) -> Callable[_Arguments, _Drawn]:
    """Draw in `STYLE`, and leave matplotlib's own as it is."""

    @wraps(draw)
    def styled(*args: _Arguments.args, **options: _Arguments.kwargs) -> _Drawn:
        import matplotlib

        with matplotlib.rc_context(STYLE):
            return draw(*args, **options)

    return styled


@printed
def panels(rows: int, columns: int, width: float, height: float, **options: Any) -> "tuple[Figure, np.ndarray]":
    """A figure of width x height [inches], no wider than a page, and its axes, shape (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(min(width, PAGE), height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def picture(figure: "Figure", kind: str, dpi: int = 200) -> bytes:
    """A figure as the content of an .svg, .png or .pdf file: the same bytes whenever it is drawn.

    Args:
        figure: to write; its ticks are only made now, in `STYLE`.
        kind: ending of the file, without its dot.
        dpi: dots an inch of a PNG.
    """
    import matplotlib

    out, dateless = BytesIO(), {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": "fasbody"}):
        figure.savefig(out, format=kind, dpi=dpi, metadata=dateless)
    return out.getvalue()


def named_lines(axis: Any, x: Any, curves: Sequence[Any], names: Sequence[str], colours: Sequence[str]) -> None:
    """Write each curve's name on it, all where flat pieces of the curves are farthest apart.

    Args:
        axis: with its limits set.
        x: (n,), evenly spaced.
        curves: (n,) each.
        names, colours: of each.
    """
    import numpy as np

    (left, right), (_, top) = axis.get_xlim(), axis.get_ylim()
    half = max(1, round(0.05 * (right - left) / (x[1] - x[0])))
    pieces = np.lib.stride_tricks.sliding_window_view(np.array(curves), 2 * half + 1, axis=1)
    at = np.arange(half, x.size - half)
    low, high = pieces.min(axis=2), pieces.max(axis=2)
    order = np.argsort(low + high, axis=0)
    above = np.vstack([np.take_along_axis(low, order, 0)[1:], np.full((1, at.size), top)])
    gap = (above - np.take_along_axis(high, order, 0)).min(axis=0)
    gap[(x[at] < left + 0.1 * (right - left)) | (x[at] > right - 0.1 * (right - left))] = -np.inf
    place = at[gap.argmax()]
    for curve, name, colour in zip(curves, names, colours, strict=True):
        axis.text(x[place], curve[place], name, color=colour, ha="center", va="center", fontsize=7.5,
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8})  # fmt: skip


def inline(content: bytes) -> str:
    """An SVG file's content without its declaration, to be put into a page."""
    text = content.decode()
    return text[text.index("<svg") :]


def ready(figure: Path) -> None:
    """Make the folder of a figure before the work that it shows; refuse a folder in its place."""
    make_folder(figure.parent)
    if figure.is_dir():
        raise InputFileError(figure, "is a folder", "name an SVG or PNG file")


def write_figure(figure: "Figure", *files: Path) -> list[Path]:
    """Write a figure as the ending of each file says (.svg, .png, .pdf), whole or not at all, without a date."""
    written = []
    for file in files:
        kind = file.suffix.lstrip(".").lower() or "png"
        if kind not in figure.canvas.get_supported_filetypes():
            raise SettingError(f"{file} ends in .{kind}, but a figure is written as .svg, .png or .pdf.")
        written.append(write_whole(file, picture(figure, kind)))
    return written


@dataclass(frozen=True)
class Sheet:
    """A table that a screen holds.

    Attributes:
        title: one line.
        columns: headings.
        rows: cells as text, as many a row as there are headings.
        notes: sentences below; the first is the result.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    @property
    def first_rows(self) -> Sequence[Sequence[str]]:
        """The first rows, with one that says how many are left out."""
        spare = len(self.rows) - ROWS
        if spare <= 1:  # the last one takes no more room than the sentence on it
            return self.rows
        return [*self.rows[:ROWS], [f"... {spare} more", *[""] * (len(self.columns) - 1)]]

    @property
    def first_notes(self) -> Sequence[str]:
        """The first notes, with one that says how many are left out."""
        spare = len(self.notes) - NOTES
        return self.notes if spare <= 1 else [*self.notes[:NOTES], f"... and {spare} more."]

    def __str__(self) -> str:
        return self._text(self.first_rows, self.first_notes)

    @property
    def whole(self) -> str:
        """All of it as text."""
        return self._text(self.rows, self.notes)

    def _text(self, rows: Sequence[Sequence[str]], notes: Sequence[str]) -> str:
        lines = [self.columns, *rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        table = ["  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines]
        below = [line for note in notes for line in wrap(note, WIDTH, subsequent_indent="  ")]
        return "\n".join([self.title, *table, *below])

    def html(self) -> str:
        """The same for a notebook."""

        def row(cells: Sequence[str], tag: str) -> str:
            return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

        body = "".join(row(cells, "td") for cells in self.first_rows)
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.first_notes)
        table = f"<table><thead>{row(self.columns, 'th')}</thead><tbody>{body}</tbody></table>"
        return f"<p><b>{escape(self.title)}</b></p>{table}{notes}"


class Tabled:
    """A data class that a notebook shows as a table: its fields, unless its own `sheet` says more."""

    def sheet(self) -> Sheet:
        """What a screen shows."""
        named = [(field.name, getattr(self, field.name)) for field in fields(cast(Any, self))]
        rows = [(name, cell(value), unit_of(name)) for name, value in named if not callable(value)]
        return Sheet(type(self).__name__, ("field", "value", "unit"), rows)

    def _repr_html_(self) -> str:
        return self.sheet().html()


def cell(value: Any) -> str:
    """A value of any kind in a cell: a number with six digits, of an array its shape and range, of a table its name."""
    if value is None or isinstance(value, str):
        return "–" if value is None else shown(value)
    if isinstance(value, int | float | complex) and not isinstance(value, bool):
        return f"{value:.6g}" if isinstance(value, complex) else readable(value, 6)
    if isinstance(value, Tabled):
        return value.sheet().title
    if hasattr(value, "dtype") and value.ndim:
        shape = "x".join(map(str, value.shape))
        real = value[value == value] if value.dtype.kind in "iuf" else value[:0]  # without NaN
        holes = value.size - real.size
        without = f", {holes} without a number" if real.size and holes else ""
        return f"{shape}, {real.min():.4g} to {real.max():.4g}{without}" if real.size else shape
    if isinstance(value, Mapping | Sequence):
        entries = [f"{key}: {cell(entry)}" for key, entry in value.items()] if isinstance(value, Mapping) else value
        return shown(", ".join(map(cell, entries))) or "–"
    return shown(str(value))


class Presented(Tabled, ABC):
    """What every result can. It says its `sheet` and its `records`, and where its figures are drawn.

    A data class that has these must be made with `repr=False`.
    """

    #: The module that draws it, and its functions there, the usual one first; the module imports the result, and is
    #: imported when something is drawn.
    figures: ClassVar[str] = ""
    plots: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def sheet(self) -> Sheet:
        """What a screen shows."""

    @abstractmethod
    def records(self) -> list[dict[str, Any]]:
        """The numbers, one row each, with units in the names."""

    def __repr__(self) -> str:
        return str(self.sheet())

    def to_dataframe(self) -> "pd.DataFrame":
        """The numbers as a pandas table; `attrs["units"]` says the unit of each column or parameter with one."""
        import pandas as pd

        frame = pd.DataFrame(self.records())
        names = [str(name) for name in (*frame.columns, *frame.get("parameter", ()))]
        frame.attrs["units"] = {name: unit for name in names if (unit := unit_of(name))}
        return frame

    def plot(self, kind: str = "", **options: Any) -> Any:
        """Draw it.

        Args:
            kind: one of `plots`, the first unless given. options: of the drawing function.

        Returns:
            a matplotlib figure; a notebook shows it, `savefig` writes it.

        Raises:
            SettingError: no such plot, or none at all.
        """
        if not self.plots:
            raise SettingError(f"a {type(self).__name__} has no plot; its numbers are in to_dataframe().")
        kind = kind or next(iter(self.plots), "")
        if kind not in self.plots:
            raise SettingError(f"{unknown('plot', kind, self.plots)}.")
        figure = getattr(import_module(self.figures), kind)(self, **options)
        figure._repr_png_ = lambda: picture(figure, "png", dpi=110)  # a notebook otherwise shows only what pyplot made
        return figure

    def write(self, folder: Path | str) -> list[Path]:
        """Write the numbers into a folder, as CSV and JSON, each file whole or not at all."""
        name = type(self).__name__.lower()
        table = self.to_dataframe()
        rows = table.to_dict("records")
        texts = {f"{name}.csv": table.to_csv(index=False), f"{name}.json": to_json(rows) + "\n"}
        return [write_whole(Path(folder) / file, text) for file, text in texts.items()]


def csv_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as CSV: numbers of eight digits, nothing where there is no number."""
    out = StringIO()
    writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _csv_cell(value) for name, value in row.items()} for row in rows)
    return out.getvalue()


def _csv_cell(value: Any) -> Any:
    if isinstance(value, bool) or value is None:
        return "" if value is None else str(value).lower()
    return f"{value:.8g}" if isinstance(value, float) else value
