"""Blocks put on the grid of samples: what is missing, and how the clocks run."""

from collections import deque
from collections.abc import Iterable

import numpy as np

from fasbody.acquire.messages import Block, Damage, Hello, Message
from fasbody.acquire.quality import Gap, Quality

_TURN = 2**32
#: Sections of a recording for the comparison of clocks.
_SECTIONS = 10
#: Steps of the device's clock that give its own rate, how many are enough for it, and over how many it must hold.
_TRACKED, _ENOUGH, _HELD = 31, 8, 8
#: So many samples between the device's clock and the grid are a gap: a skipped sample is one; stamps that jitter by
#: more than a tenth of a sample can raise false ones.
_SLIP = 0.75


class Timeline:
    """Collects blocks and knows where each sample belongs; nothing is ever filled in.

    Args:
        hello: the board's description.
    """

    def __init__(self, hello: Hello) -> None:
        self.hello = hello
        self._starts: list[int] = []
        self._samples: list[np.ndarray] = []
        self._gaps: list[tuple[int, int, str]] = []
        self._clock: list[tuple[float, float]] = []
        self._next = 0  # index of the next sample
        self._sequence = self._time_us = 0
        self._device_us = 0
        self._host = 0.0
        self._ticks = self._tick_samples = 0  # device time and samples between consecutive frames, for the rate
        self._steps: deque[float] = deque(maxlen=_TRACKED)  # device time a sample [us]
        self._recent: deque[int] = deque(maxlen=_HELD)  # latest steps not yet accounted for by a gap [us]
        self._frames = self._lost = self._damaged = 0
        self._over = np.zeros(len(hello.channels), int)
        self._changed = self._restarted = False
        self._boot = hello.boot

    @property
    def length(self) -> int:
        """Samples so far, missing ones included."""
        return self._next

    @property
    def has_gaps(self) -> bool:
        """Whether samples are missing so far."""
        return bool(self._gaps)

    def __str__(self) -> str:
        return f"{self._frames} frames, {self._lost} lost, {self._damaged} damaged, {len(self._gaps)} gaps"

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
            else:
                self._greet(message)
        if block is not None:
            self._clock.append((self._device_us * 1e-6, host))
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
        if self._frames:
            missed = (block.sequence - self._sequence - 1) % _TURN
            passed = (block.time_us - self._time_us) % _TURN
            # Back by more than a frame, unless so many frames are missing that the clock may have turned over.
            back = (-passed) % _TURN
            backward = n / rate * 1e6 < back < _TURN // 2 and missed * n / rate * 1e6 < _TURN // 4
            if self._restarted or missed >= _TURN // 2 or backward:
                lost = max(1, round((host - self._host) * rate) - n)
                self._gaps.append((self._next, lost, "restart"))
                self._next += lost
                self._clock.clear()  # another clock from here on
                self._recent.clear()
            else:
                passed = passed if passed < _TURN // 2 or missed else passed - _TURN
                self._device_us += passed
                lost = missed * n
                if lost:
                    self._gaps.append((self._next, lost, "lost frames"))
                    self._lost += missed
                    self._next += lost
                    self._recent.clear()
                elif self.hello.bits:
                    self._lapse(passed, n)
        self._restarted = False
        self._starts.append(self._next)
        self._samples.append(block.samples)
        self._next += n
        self._over += block.over
        self._sequence, self._time_us = block.sequence, block.time_us
        self._frames += 1

    def _lapse(self, passed_us: int, n: int) -> None:
        """A step of the device's clock between frames that follow each other by number."""
        late = passed_us * 1e-6 * self.hello.rate_hz - n
        slipped = abs(late) > 0.5 + 0.01 * n  # all that can be said before the clock's own rate is known
        self._steps.append(passed_us / n)
        self._recent.append(passed_us)
        if len(self._steps) >= _ENOUGH:
            late = sum(self._recent) / float(np.median(self._steps)) - n * len(self._recent)
            slipped = abs(late) >= _SLIP
        if slipped:
            self._recent.clear()
            lost = max(1, min(round(late), 1_000_000_000))
            self._gaps.append((self._next, lost, "skipped"))
            self._next += lost
        else:
            self._ticks += passed_us
            self._tick_samples += n

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Index (n,) of each received sample on the grid of samples, and its values (n, channels) [m/s^2]."""
        if not self._samples:
            return np.zeros(0, int), np.zeros((0, len(self.hello.channels)))
        index = [np.arange(start, start + len(s)) for start, s in zip(self._starts, self._samples, strict=True)]
        return np.concatenate(index), np.concatenate(self._samples)

    def quality(self, length: int | None = None) -> Quality:
        """What happened so far, with the gaps of the first `length` samples."""
        rate = self.hello.rate_hz
        rate_ppm = 0.0
        if self._ticks:
            rate_ppm = 1e6 * (self._tick_samples / (self._ticks * 1e-6) / rate - 1)
        drift, std = _slope(self._clock)
        gaps = tuple(
            Gap((at - 1) / rate, lost, cause) for at, lost, cause in self._gaps if length is None or at < length
        )
        return Quality(
            self._frames, self._lost, self._damaged, gaps, self.over_range, rate_ppm, drift, std, self._changed
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
