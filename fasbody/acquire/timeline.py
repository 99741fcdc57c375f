"""Blocks put on the grid of samples: what is missing, how the clocks run, and what of it makes a recording unusable.

What a board skipped shows in its time stamps, however much they jitter. A stamp is the time of a sample plus jitter:
y = a + b x + (samples skipped so far) + jitter, all in samples, with x the number of samples received and b the clock's
rate. Where the jitter is small, each step of y shows by itself. Where it is not, as on boards that take the time in
software, a step is what a straight line cannot explain.

How late samples reach the host is measured as they come (`Lateness`): with a busy computer, the amplitude loop would
take samples of an earlier amplitude for those of the present one.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from fasbody.acquire.wire import Block, Damage, Hello, Message
from fasbody.presentation import counted

#: A number is sure within so many standard errors.
_SURE = 3.0
_TURN = 2**32
#: No gap is longer [samples]; a time stamp may hold any number.
_MOST = 1_000_000_000
#: Sections of a recording for the comparison of clocks.
_SECTIONS = 10
#: The device's time going back by more [samples] is a restart, by less it is jitter.
_BACK = 16
#: Stamps that jitter by less (rms, in samples) show each skipped sample by themselves.
_CLEAR = 0.08
#: So large a step [samples] is a skipped sample.
_SLIP = 0.75
#: And a step that the jitter explains by chance less often than once in 10^8 places is none of its doing.
_CERTAIN = 6.0
#: So many steps give the rate of the clock; with fewer, the declared one holds within _OFF.
_ENOUGH, _OFF = 8, 0.01
#: Neighbours that are so far off may be stamps in steps of several samples: then those farther apart are compared.
_COARSE, _LAG = 0.05, 64
#: Lone late stamps between punctual ones mean nothing: half the width of the running median that drops them, narrow
#: where they are rare (then a step near an end shows), wide where not; and how many make the stamps unclear.
_NARROW, _BROAD, _RARE, _FEW = 2, 8, 0.001, 0.02
#: No stamp counts as farther off than so many times the jitter.
_CLIP = 3.0
#: Device time that goes back by more [us] is another clock: the board has restarted.
_BACK_US = 1_000_000
#: The two clocks may drift apart by this share: twice what a recording is refused for. A lateness that lasts is so
#: forgotten, 0.1 s in ten seconds.
_DRIFT = 1e-2
#: A block that the next one follows within this share of the time between them came late.
_HURRY = 0.5
#: Stamps that stay the same for longer [s] do not advance.
_STILL_S = 1.0
#: So many gaps are named in a sentence.
_NAMED = 5


#: A sampling rate or a device clock that is off by more is mentioned, or refused [parts per million]; fewest excitation
#: periods without a gap; and time stamps that jitter by more are mentioned [samples, rms].
LIMITS = {"clock_ppm": 200.0, "clock_refused_ppm": 5000.0, "periods": 3.0, "jitter": 0.25}


@dataclass(frozen=True)
class Gap:
    """Samples that were taken and did not arrive.

    Attributes:
        after_s: time of the last sample before it [s].
        lost_samples: how many a channel are missing.
        cause: "lost frames"; "damaged lines"; "skipped" (the device's time stamps jump); "restart" (length by the
            host's clock). Behind it, events of the port meanwhile: "lost frames, unplugged".
    """

    after_s: float
    lost_samples: int
    cause: str


@dataclass(frozen=True)
class Quality:
    """What happened on the line during a recording.

    Attributes:
        frames: frames (or lines) received.
        lost_frames: missing by their numbers.
        damaged: pieces that were no message.
        gaps: where samples are missing.
        over_range: samples over range, by channel.
        stamps_advance: whether the device's time stamps do.
        jitter: theirs [samples, rms].
        rate_ppm: sampling rate by the device's time stamps against the declared one.
        rate_std_ppm: its standard error.
        drift_ppm: device clock against the host's.
        drift_std_ppm: its standard error.
        changed: the board described itself differently during the recording.
        faults: of the sensors and the drive (`fasbody.acquire.monitor`): when each was detected [s], and the sentence.
    """

    frames: int = 0
    lost_frames: int = 0
    damaged: int = 0
    gaps: tuple[Gap, ...] = ()
    over_range: dict[str, int] = field(default_factory=dict)
    stamps_advance: bool = True
    jitter: float = 0.0
    rate_ppm: float = 0.0
    rate_std_ppm: float = float("inf")
    drift_ppm: float = 0.0
    drift_std_ppm: float = float("inf")
    changed: bool = False
    faults: tuple[tuple[float, str], ...] = ()

    @property
    def lost_samples(self) -> int:
        """Missing samples a channel."""
        return sum(gap.lost_samples for gap in self.gaps)

    def problems(self) -> list[str]:
        """Why this is no recording to identify from; empty if it is."""
        texts = []
        if self.frames == 0:
            texts.append("no samples arrived")
        if self.gaps:
            named = "; ".join(f"after {gap.after_s:.6g} s, {gap.cause}" for gap in self.gaps[:_NAMED])
            more = f"; and {len(self.gaps) - _NAMED} more, in the JSON" if len(self.gaps) > _NAMED else ""
            many = "is" if self.lost_samples == 1 else "are"
            gaps = counted(len(self.gaps), "gap")
            texts.append(f"{counted(self.lost_samples, 'sample')} {many} missing in {gaps} ({named}{more})")
        texts += [text for _, text in self.faults]
        over = {name: count for name, count in self.over_range.items() if count}
        if over:
            texts.append("over range: " + ", ".join(f"{name} {counted(n, 'sample')}" for name, n in over.items()))
        if self.changed:
            texts.append("the board changed its description in the middle")
        if not self.stamps_advance:
            texts.append("the board's time stamps do not advance, so that samples which it skipped stay unseen")
        texts += [text for off, text in self._clocks() if off > LIMITS["clock_refused_ppm"]]
        return texts

    def remarks(self) -> list[str]:
        """What does not forbid using it, but should be known."""
        texts = []
        if self.damaged:
            texts.append(f"{counted(self.damaged, 'damaged piece')} on the line")
        if self.jitter > LIMITS["jitter"]:
            texts.append(
                f"the board's time stamps jitter by {self.jitter:.2g} samples rms, so that a single sample which it "
                "skipped may stay unseen"
            )
        least, most = LIMITS["clock_ppm"], LIMITS["clock_refused_ppm"]
        return texts + [text for off, text in self._clocks() if least < off <= most]

    def _clocks(self) -> list[tuple[float, str]]:
        """By how much the two clocks are off for certain [ppm], and the sentence."""
        if not self.stamps_advance:
            return []
        rate, drift = _SURE * self.rate_std_ppm, _SURE * self.drift_std_ppm
        return [
            (
                abs(self.rate_ppm) - rate,
                f"the board's sampling rate differs from the declared one by {self.rate_ppm:+.0f} +- {rate:.0f} ppm",
            ),
            (
                abs(self.drift_ppm) - drift,
                f"the board's clock differs from the computer's by {self.drift_ppm:+.0f} +- {drift:.0f} ppm",
            ),
        ]

    def __str__(self) -> str:
        clock = ""
        if self.stamps_advance and _SURE * self.drift_std_ppm <= LIMITS["clock_ppm"]:  # else it says nothing
            clock = f", clock {self.drift_ppm:+.0f} +- {_SURE * self.drift_std_ppm:.0f} ppm"
        lines = f"{counted(self.frames, 'frame')}, {self.lost_frames} lost, {self.damaged} damaged"
        faults = f", {counted(len(self.faults), 'fault')}" if self.faults else ""
        return f"{lines}, {counted(len(self.gaps), 'gap')}{faults}{clock}"


@dataclass(frozen=True)
class Stamps:
    """Result of the time stamps of a recording.

    Attributes:
        steps: (n,) samples skipped before each block; negative where the stamps allow fewer than arrived.
        jitter: of the stamps [samples, rms].
        slope: the declared rate over the one by the device's clock.
        slope_std: its standard error.
        advance: whether the stamps advance at all; if not, nothing else is known.
    """

    steps: np.ndarray
    jitter: float
    slope: float
    slope_std: float
    advance: bool = True


class Timeline:
    """Collects blocks and the place of each sample; nothing is ever filled in.

    What is missing by number, or after a restart, is known at once. What the board skipped shows in its time stamps,
    which are evaluated together by `samples` and `quality`.

    Args:
        hello: the board's description.
    """

    def __init__(self, hello: Hello) -> None:
        self.hello = hello
        self._samples: list[np.ndarray] = []
        self._starts: list[int] = []  # of each block, by its number
        self._jumps: list[int] = []  # samples missing before each block
        self._causes: list[str] = []
        self._note = ""  # events of the port since the last blocks
        self._noted: dict[int, str] = {}  # and those before a block
        self.gaps = 0
        self._stamps: list[int] = []  # device time of each block since the last restart's, without its turns [us]
        self._clock: list[tuple[float, float]] = []
        self._next = 0  # index of the next sample
        self._sequence = self._time_us = 0
        self._host = 0.0
        self._damaged_lines = 0  # since the last block
        self._missed = self._damaged = 0
        self._over = np.zeros(len(hello.channels), int)
        self._changed = self._restarted = False
        self._boot = hello.boot

    @property
    def length(self) -> int:
        """Samples so far; missing ones included, but for those that the board skipped."""
        return self._next

    def __str__(self) -> str:
        frames, gaps = counted(len(self._jumps), "frame"), counted(self.gaps, "gap")
        return f"{frames}, {self._missed} lost, {self._damaged} damaged, {gaps}"

    def blocks(self, first: int) -> list[tuple[int, np.ndarray]]:
        """Index of the first sample by its block's number, and samples (n, channels) of block `first` and on."""
        return list(zip(self._starts[first:], self._samples[first:], strict=True))

    @property
    def over_range(self) -> dict[str, int]:
        """Samples over range, by channel."""
        return dict(zip(self.hello.roles, map(int, self._over), strict=True))

    def add(self, messages: Iterable[Message], host: float) -> None:
        """Add messages that arrived together at `host` [s]."""
        blocks = len(self._stamps)
        for message in messages:
            if isinstance(message, Block):
                self._add(message, host)
            elif isinstance(message, Damage):
                self._damaged += 1
                self._damaged_lines += not self.hello.bits
            else:
                self._greet(message)
        if len(self._stamps) > blocks:
            self._note = ""
            self._clock.append((self._stamps[-1] * 1e-6, host))
            self._host = host

    def note(self, event: str) -> None:
        """What happened to the port just now: why samples are missing in what comes next, if they are."""
        if event != "replugged":
            self._note = event

    def _greet(self, hello: Hello) -> None:
        self._changed |= replace(hello, board=self.hello.board, boot=self.hello.boot) != self.hello
        self._restarted |= hello.boot != self._boot
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
                self._missed += missed
                if self._damaged_lines:  # each was probably a sample; the time stamps will show it
                    jump, cause = self._damaged_lines, "damaged lines"
        self._restarted, self._damaged_lines = False, 0
        self._jumps.append(jump)
        self.gaps += jump > 0
        if jump and self._note:
            self._noted[len(self._jumps) - 1] = self._note
        self._causes.append(cause)
        self._stamps.append(stamp)
        self._samples.append(block.samples)
        self._starts.append(self._next + jump)
        self._next += jump + n
        self._over += block.over
        self._sequence, self._time_us = block.sequence, block.time_us

    def _placed(self) -> tuple[np.ndarray, np.ndarray, list[str], Stamps | None]:
        """Start of each block, samples missing before it, why, and the result of the stamps since the last restart."""
        sizes = np.array([len(block) for block in self._samples])
        jumps, causes, stamps = np.array(self._jumps), list(self._causes), None
        restarts = [i for i, cause in enumerate(causes) if cause == "restart"]
        for first, last in pairwise([0, *restarts, sizes.size]):
            part = slice(first, last)
            starts = np.cumsum(sizes[part] + jumps[part]) - sizes[part]
            stamps = judge(starts, np.array(self._stamps[part]) * 1e-6 * self.hello.rate_hz)
            for at in np.flatnonzero(stamps.steps):
                i = first + at
                missing = jumps[i] + min(int(stamps.steps[at]), _MOST)
                causes[i] = causes[i] if jumps[i] else "skipped"
                jumps[i] = max(missing, 0 if causes[i] == "damaged lines" else 1)
        return np.cumsum(sizes + jumps) - sizes, jumps, causes, stamps

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
            frames=len(self._samples), lost_frames=self._missed, damaged=self._damaged, over_range=self.over_range,
            changed=self._changed,
        )  # fmt: skip
        if not self._samples:
            return kept
        starts, jumps, causes, stamps = self._placed()
        assert stamps is not None
        gaps = []
        for i in np.flatnonzero(jumps):
            at = int(starts[i] - jumps[i])
            if length is None or at < length:
                cause = ", ".join(filter(None, [causes[i], self._noted.get(int(i))]))
                gaps.append(Gap((at - 1) / rate, int(jumps[i]), cause))
        drift, drift_std = _drift(self._clock)
        return replace(
            kept, gaps=tuple(gaps), stamps_advance=stamps.advance, jitter=stamps.jitter,
            rate_ppm=1e6 * (1 / stamps.slope - 1), rate_std_ppm=1e6 * stamps.slope_std,
            drift_ppm=drift, drift_std_ppm=drift_std,
        )  # fmt: skip


def judge(x: np.ndarray, y: np.ndarray) -> Stamps:
    """Find the samples that a device skipped.

    Args:
        x: (n,) index of the first sample of each block, by its number.
        y: (n,) its time stamp times the declared rate.
    """
    steps = np.zeros(x.size, int)
    if x.size < 3:
        return Stamps(steps, 0.0, 1.0, float("inf"))
    x, y = x - x[0], y - y[0]
    b = _median_slope(x, y, 1)
    if abs(b - 1) > _COARSE:
        b = _median_slope(x, y, min(_LAG, x.size // 2))
    if not b > 0:
        return Stamps(steps, 0.0, 1.0, float("inf"), advance=False)
    if x.size <= _ENOUGH:
        b = min(max(b, 1 - _OFF), 1 + _OFF)
    late = np.diff(y) / b - np.diff(x)
    jitter = _jitter(late)
    early = float(np.mean(late < -0.5))
    raw = np.concatenate([[0.0], np.cumsum(late)])
    half = _NARROW if early < _RARE else _BROAD
    level = _median(raw, half)
    rises = np.diff(level)
    if jitter < _CLEAR and np.mean(rises < -0.5) < _FEW:
        steps[1:] = np.where(np.abs(rises) >= _SLIP, np.round(rises), 0)
        steps += _at_the_ends(raw - level, half, jitter)
    else:
        jitter = max(jitter, _CLEAR)
        centre = _median(raw, _BROAD)
        off = raw - centre
        steps = _beyond_jitter(x, x + centre + np.clip(off, -_CLIP * jitter, _CLIP * jitter), jitter)
        steps += _at_the_ends(off, _BROAD, jitter)
    slope, std = _line(x + np.cumsum(steps), y)
    return Stamps(steps, jitter, slope, std)


def _median_slope(x: np.ndarray, y: np.ndarray, lag: int) -> float:
    return float(np.median((y[lag:] - y[:-lag]) / (x[lag:] - x[:-lag])))


def _jitter(late: np.ndarray) -> float:
    """Rms of the stamps' jitter from their steps, without the few that are far off or mean skipped samples."""
    typical = 1.4826 * float(np.median(np.abs(late)))
    return float(np.sqrt(np.mean(np.clip(late, -_CLIP * typical, _CLIP * typical) ** 2) / 2))


def _median(values: np.ndarray, half: int) -> np.ndarray:
    """Running median: keeps steps, drops lone outliers; the ends are mirrored."""
    if values.size <= 2 * half + 1:
        return values
    mirrored = np.pad(values, half, mode="symmetric")
    return np.median(np.lib.stride_tricks.sliding_window_view(mirrored, 2 * half + 1), axis=1)


def _at_the_ends(off: np.ndarray, half: int, jitter: float) -> np.ndarray:
    """Steps so near an end that the mirrored median took the few blocks outside for outliers.

    Those before such a step are all too early, those behind it all too late, by more than anything between the ends.
    """
    steps = np.zeros(off.size, int)
    if off.size <= 2 * half + 1:
        return steps
    limit = max(_SLIP, _CERTAIN * jitter, float(np.abs(off[half:-half]).max()) + 0.5)
    first = int(np.argmin(off[:half] < -limit)) if not (off[:half] < -limit).all() else half
    last = int(np.argmin(off[: -half - 1 : -1] > limit)) if not (off[-half:] > limit).all() else half
    if first:
        steps[first] += round(-float(np.median(off[:first])))
    if last:
        steps[-last] += round(float(np.median(off[-last:])))
    return steps


def _beyond_jitter(x: np.ndarray, y: np.ndarray, jitter: float) -> np.ndarray:
    """Steps of y that its jitter cannot explain, section by section, so that a slowly wandering clock makes none."""
    steps = np.zeros(x.size, int)
    # A step in the middle of a section has a standard error of 4 jitter / sqrt(length): a ninth of a sample.
    length = max(32, int(np.ceil((4 * 9 * jitter) ** 2)))
    for begin in range(0, max(1, x.size - length // 2), length // 2):
        part = slice(begin, min(begin + length, x.size))
        for _ in range(length):
            at, size = _largest_step(x[part], y[part] - np.cumsum(steps[part]), jitter)
            if not size:
                break
            steps[begin + at] += size
    return steps


def _largest_step(x: np.ndarray, y: np.ndarray, jitter: float) -> tuple[int, int]:
    """Where a straight line with one step fits best, and the step's size; 0 if it is not certain.

    The step H_k (0 before k, 1 from k on) has the least-squares size <r, H_k> / |H_k|^2, r being what a line leaves of
    y, and H_k what a line leaves of the step.
    """
    if x.size < 8:
        return 0, 0
    x = x - x.mean()
    r = y - y.mean()
    r = r - (x @ r) / (x @ x) * x
    after = np.arange(x.size, 0, -1)
    tail_x = np.cumsum(x[::-1])[::-1]
    power = after - after**2 / x.size - tail_x**2 / (x @ x)
    inside = slice(3, x.size - 2)
    size = np.cumsum(r[::-1])[::-1][inside] / power[inside]
    best = int(np.argmax(size**2 * power[inside]))
    certain = abs(size[best]) * np.sqrt(power[inside][best]) > _CERTAIN * jitter
    return best + inside.start, round(float(size[best])) if certain and abs(size[best]) >= _SLIP else 0


def _drift(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """Device clock against host clock [ppm] and its standard error.

    Bytes may come late by chance, never early: a line through the least late arrival of each section is used. What a
    computer or a board that stood still makes up for comes in a hurry, and is late for certain.
    """
    if len(pairs) < 4 * _SECTIONS:
        return 0.0, float("inf")
    device, host = np.array(pairs).T
    punctual = np.append(np.diff(host) > _HURRY * np.diff(device), True)  # before the next one came
    if punctual.sum() < 2 * _SECTIONS:
        return 0.0, float("inf")
    device, host = device[punctual], host[punctual]
    late = host - device
    first = [part[np.argmin(late[part])] for part in np.array_split(np.arange(late.size), _SECTIONS)]
    if not np.ptp(host[first]):
        return 0.0, float("inf")
    slope, std = _line(host[first], -late[first])
    return 1e6 * slope, 1e6 * std


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    x, y = x - x.mean(), y - y.mean()
    spread = float(x @ x)
    slope = float(x @ y) / spread
    left = y - slope * x
    return slope, float(np.sqrt(left @ left / (x.size - 2) / spread))


class Lateness:
    """Compares the host's clock with the blocks' time stamps; the least difference is the way itself.

    No exchange of times with the board is needed: what is beyond the quickest block so far, clocks' drift allowed for,
    is lateness.
    """

    def __init__(self) -> None:
        self._host = self._device = 0.0
        self._moved = 0.0  # when a stamp was last another one
        self.forget()

    def forget(self) -> None:
        """Begin anew, after a restart or another plug."""
        self._time_us: int | None = None
        self._quickest = float("inf")

    @property
    def still(self) -> bool:
        """Whether the stamps do not advance."""
        return self._host - self._moved > _STILL_S

    def of(self, time_us: int, host: float) -> float:
        """By how much the block with this stamp [us], modulo 2^32, is late at `host` [s]."""
        if time_us != self._time_us:
            self._moved = host
        if self._time_us is not None:
            passed = (time_us - self._time_us) % _TURN
            passed -= _TURN if passed >= _TURN // 2 else 0  # stamps that jitter may go back a little
            if passed < -_BACK_US:
                self.forget()
            else:
                self._device += 1e-6 * passed
                self._quickest += _DRIFT * max(0.0, host - self._host)
        self._time_us, self._host = time_us, host
        self._quickest = min(self._quickest, host - self._device)
        return host - self._device - self._quickest
