"""Blocks put on the grid of samples: what is missing, and how the clocks run."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fasbody.acquire import stamps
from fasbody.acquire.messages import Block, Damage, Hello, Message
from fasbody.acquire.quality import Gap, Quality, counted

_TURN = 2**32
#: No gap is longer [samples]; a time stamp may say anything.
_MOST = 1_000_000_000
#: Sections of a recording for the comparison of clocks.
_SECTIONS = 10
#: The device's time going back by more [samples] is a restart, by less it is jitter.
_BACK = 16


class Timeline:
    """Collects blocks and knows where each sample belongs; nothing is ever filled in.

    What is missing by number, or after a restart, is known at once. What the board skipped shows in its time stamps,
    which are judged together when asked for `samples` or `quality`.

    Args:
        hello: the board's description.
    """

    def __init__(self, hello: Hello) -> None:
        self.hello = hello
        self._samples: list[np.ndarray] = []
        self._jumps: list[int] = []  # samples missing before each block
        self._causes: list[str] = []
        self._stamps: list[int] = []  # device time of each block since the last restart's, without its turns [us]
        self._clock: list[tuple[float, float]] = []
        self._next = 0  # index of the next sample
        self._sequence = self._time_us = 0
        self._host = 0.0
        self._damaged_lines = 0  # since the last block
        self._lost = self._damaged = 0
        self._over = np.zeros(len(hello.channels), int)
        self._changed = self._restarted = False
        self._boot = hello.boot

    @property
    def length(self) -> int:
        """Samples so far; missing ones included, but for those that the board skipped."""
        return self._next

    @property
    def has_gaps(self) -> bool:
        """Whether samples are missing so far."""
        return any(self._jumps)

    def __str__(self) -> str:
        gaps = counted(sum(jump > 0 for jump in self._jumps), "gap")
        return f"{counted(len(self._jumps), 'frame')}, {self._lost} lost, {self._damaged} damaged, {gaps}"

    @property
    def over_range(self) -> dict[str, int]:
        """Samples over range, by channel."""
        return dict(zip(self.hello.roles, map(int, self._over), strict=True))

    def add(self, messages: Iterable[Message], host: float) -> None:
        """Add messages that arrived together at `host` [s]."""
        block = None
        for message in messages:
            if isinstance(message, Block):
                self._add(message, host)
                block = message
            elif isinstance(message, Damage):
                self._damaged += 1
                self._damaged_lines += not self.hello.bits
            else:
                self._greet(message)
        if block is not None:
            self._clock.append((self._stamps[-1] * 1e-6, host))
            self._host = host

    def _greet(self, hello: Hello) -> None:
        if (hello.rate_hz, hello.channels, hello.bits, hello.frame_samples) != (
            self.hello.rate_hz, self.hello.channels, self.hello.bits, self.hello.frame_samples
        ):  # fmt: skip
            self._changed = True
        if hello.boot != self._boot:
            self._restarted = True
        self._boot = hello.boot

    def _add(self, block: Block, host: float) -> None:
        if block.samples.shape[1] != len(self.hello.channels):
            self._changed = True
            return
        n, rate = block.samples.shape[0], self.hello.rate_hz
        jump, cause, stamp = 0, "", 0
        if self._samples:
            missed = (block.sequence - self._sequence - 1) % _TURN
            passed = (block.time_us - self._time_us) % _TURN
            # Back by more than a frame, unless so many frames are missing that the clock may have turned over.
            back = (-passed) % _TURN
            backward = max(n, _BACK) / rate * 1e6 < back < _TURN // 2 and missed * n / rate * 1e6 < _TURN // 4
            if self._restarted or missed >= _TURN // 2 or backward:
                jump, cause = max(1, round((host - self._host) * rate) - n), "restart"
                self._clock.clear()  # another clock from here on
            else:
                stamp = self._stamps[-1] + (passed if passed < _TURN // 2 or missed else passed - _TURN)
                jump, cause = missed * n, "lost frames"
                self._lost += missed
                if self._damaged_lines:  # each was probably a sample; the time stamps will tell
                    jump, cause = self._damaged_lines, "damaged lines"
        self._restarted, self._damaged_lines = False, 0
        self._jumps.append(jump)
        self._causes.append(cause)
        self._stamps.append(stamp)
        self._samples.append(block.samples)
        self._next += jump + n
        self._over += block.over
        self._sequence, self._time_us = block.sequence, block.time_us

    def _placed(self) -> tuple[np.ndarray, np.ndarray, list[str], stamps.Stamps | None]:
        """Start of each block, samples missing before it, why, and what the stamps since the last restart tell."""
        sizes = np.array([len(block) for block in self._samples])
        jumps, causes, told = np.array(self._jumps), list(self._causes), None
        restarts = [i for i, cause in enumerate(causes) if cause == "restart"]
        for first, last in pairwise([0, *restarts, sizes.size]):
            part = slice(first, last)
            own = np.cumsum(sizes[part] + jumps[part]) - sizes[part]
            told = stamps.judge(own, np.array(self._stamps[part]) * 1e-6 * self.hello.rate_hz)
            for at in np.flatnonzero(told.steps):
                i = first + at
                found = jumps[i] + min(int(told.steps[at]), _MOST)
                causes[i] = causes[i] if jumps[i] else "skipped"
                jumps[i] = max(found, 0 if causes[i] == "damaged lines" else 1)
        return np.cumsum(sizes + jumps) - sizes, jumps, causes, told

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Index (n,) of each received sample on the grid of samples, and its values (n, channels) [m/s^2]."""
        if not self._samples:
            return np.zeros(0, int), np.zeros((0, len(self.hello.channels)))
        starts, *_ = self._placed()
        index = [np.arange(start, start + len(s)) for start, s in zip(starts, self._samples, strict=True)]
        return np.concatenate(index), np.concatenate(self._samples)

    def quality(self, length: int | None = None) -> Quality:
        """What happened so far, with the gaps of the first `length` samples."""
        rate = self.hello.rate_hz
        kept = Quality(
            frames=len(self._samples), lost_frames=self._lost, damaged=self._damaged, over_range=self.over_range,
            changed=self._changed,
        )  # fmt: skip
        if not self._samples:
            return kept
        starts, jumps, causes, told = self._placed()
        assert told is not None
        gaps = []
        for i in np.flatnonzero(jumps):
            at = int(starts[i] - jumps[i])
            if length is None or at < length:
                gaps.append(Gap((at - 1) / rate, int(jumps[i]), causes[i]))
        drift, drift_std = _slope(self._clock)
        return replace(
            kept, gaps=tuple(gaps), stamps_advance=told.advance, jitter=told.jitter,
            rate_ppm=1e6 * (1 / told.slope - 1), rate_std_ppm=1e6 * told.slope_std,
            drift_ppm=drift, drift_std_ppm=drift_std,
        )  # fmt: skip


def _slope(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """Device clock against host clock [ppm] and its standard error.

    Bytes may come late by chance, never early: a line through the least late arrival of each section is used.
    """
    if len(pairs) < 4 * _SECTIONS:
        return 0.0, float("inf")
    device, host = np.array(pairs).T
    late = host - device
    first = [part[np.argmin(late[part])] for part in np.array_split(np.arange(late.size), _SECTIONS)]
    x, y = host[first] - host[first].mean(), -late[first]
    spread = x @ x
    if spread <= 0:
        return 0.0, float("inf")
    slope = x @ y / spread
    residual = y - y.mean() - slope * x
    return 1e6 * float(slope), 1e6 * float(np.sqrt(residual @ residual / (_SECTIONS - 2) / spread))
