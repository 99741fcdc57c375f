"""The live view in the terminal: level, peak to peak, clipping, lost frames, and a line of the spectrum."""

import time
from itertools import pairwise
from typing import Self

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from fasbody.acquire.board import Board
from fasbody.console import console

_REFRESH_S = 0.15
_BAR, _SPECTRUM = 24, 60
_HIGHEST_HZ = 120.0
_BLOCKS = " ▁▂▃▄▅▆▇█"


class Display:
    """Draws a board while it is in use; on anything but a terminal it draws nothing.

    Args:
        board: to watch.
    """

    def __init__(self, board: Board) -> None:
        self.board = board
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        self._last = 0.0

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
            self.board.listener = self.update
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self.board.listener = None
            self._live.stop()

    def update(self, board: Board) -> None:
        """Draw again if it is time to."""
        now = time.monotonic()
        if self._live is not None and now - self._last > _REFRESH_S:
            self._last = now
            self._live.update(render(board), refresh=True)


def render(board: Board) -> Group:
    """The view as Rich draws it."""
    hello = board.decoder.hello
    recent = board.recent()
    if hello is None or recent.shape[0] < 8:
        return Group(Text("waiting for samples"))
    table = Table(box=None, pad_edge=False)
    for name in ("channel", "level", "rms", "peak to peak", "over range"):
        table.add_column(name, justify="left" if name in ("channel", "level") else "right")
    over = board.timeline.over_range if board.timeline else dict.fromkeys(hello.roles, 0)
    for i, channel in enumerate(hello.channels):
        x = recent[:, i]
        share = float(np.abs(x).max() / channel.range_m_s2)
        colour = "red" if share > 0.95 else "yellow" if share > 0.7 else "green"
        span = np.ptp(x[-round(min(x.size, hello.rate_hz)) :])
        table.add_row(
            channel.role, Text(bar(share), style=colour), f"{x.std():.2f} m/s²", f"{span:.2f} m/s²",
            Text(str(over[channel.role]), style="red" if over[channel.role] else ""),
        )  # fmt: skip
    lines: list[Text | Table] = [Text(board.doing, style="bold"), table]
    spectrum = sparkline(recent[:, board.base], hello.rate_hz)
    top = min(_HIGHEST_HZ, hello.rate_hz / 2)
    lines.append(Text(f"base, 0 to {top:g} Hz, 60 dB  |{spectrum}|"))
    if board.timeline is not None:
        done = board.timeline.length / hello.rate_hz
        lines.append(Text(f"{done:.1f} s   {board.timeline}", style="red" if board.timeline.gaps else ""))
    if board.unplugs:
        lines.append(Text(f"unplugged {board.unplugs} times", style="red"))
    return Group(*lines)


def bar(share: float) -> str:
    """A bar of the share of the range that is used."""
    filled = round(_BAR * min(1.0, share))
    return "█" * filled + "·" * (_BAR - filled)


def sparkline(x: np.ndarray, rate_hz: float) -> str:
    """Spectrum of a signal (n,) as one line of blocks: linear in frequency, 60 dB high, largest in each bin."""
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size))) ** 2
    frequency = np.fft.rfftfreq(x.size, 1 / rate_hz)
    edges = np.linspace(0, min(_HIGHEST_HZ, rate_hz / 2), _SPECTRUM + 1)
    peak = power.max() or 1.0
    heights = []
    for low, high in pairwise(edges):
        inside = power[(frequency >= low) & (frequency < high)]
        decibel = 10 * np.log10(max(1e-12, inside.max() / peak)) if inside.size else -120.0
        heights.append(round((len(_BLOCKS) - 1) * max(0.0, 1 + decibel / 60)))
    return "".join(_BLOCKS[height] for height in heights)
