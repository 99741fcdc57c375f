"""Every quarter second of a recording against the motion that the drive predicts: a fault is reported at once.

One mechanism for all faults. A window of both sensors is put into a few features: the line at the drive's frequency,
what its harmonics leave, the largest sample of that, the mean, the longest run of one value. Each rule compares one
feature with what the drive, the first sound window, or the window before lets expect. Windows overlap by half, so that
a fault fills one within 0.375 s, wherever it begins. `Session` checks samples as they come. `folder.convert` checks the
whole recording again, so that recovered captures are checked in the same way.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fasbody.recording.harmonics import columns

_NAMES = ("base", "malleolus")
SENSORS = _BASE, _MALLEOLUS = 0, 1
#: Length of a window [s], and fewest periods of the drive in it: from 5 Hz on, the length.
WINDOW_S, _PERIODS = 0.25, 1.25
#: Harmonics of the drive that are no noise: a foot that lifts makes many; and samples for each.
_HARMONICS, _SAMPLES_PER_TERM = 20, 6
#: The same value for so long [s]: a coarse converter at the crest of a slow sine shows it for a quarter of that.
FLAT_S = 0.1
#: The base's line is off what the amplitude loop reached by this share; a body that leans makes 0.05.
LEVEL = 0.2
#: Below this share of the expected amplitude the base sensor has failed.
LEAST_SHARE = 0.5
#: The base turns by more from one window to the next [rad]: 0.4 ms of a sine of 20 Hz. A body that sways makes 0.01.
TURN = 0.05
#: And by more within a window, from one sample to the next [rad]: 0.2 ms of a sine of 20 Hz. It is
#: looked for at so many places of a window, beside what leans and drifts.
STEP, _PLACES = 0.03, 12
#: A clock is off by this share at most (`timeline.LIMITS` refuse more).
CLOCK = 5e-3
#: The malleolus' line over the base's changes by this share, and by this one from a window to the next.
RATIO, RATIO_STEP = 0.6, 0.3
#: What harmonics leave, over the malleolus' line; a skin-mounted sensor far above resonance has 1.
FOLLOWS = 3.0
#: What they leave of the base, over its line, and beside it [m/s^2 rms]: simple sensors have 0.1.
WAVEFORM, _NOISE = 0.1, 0.15
#: It grows by this factor, and by this share of the base's line.
GROWS, _GROWS_BY = 2.0, 0.03
#: Share of it that is within a bin of the mains' frequency or a multiple [Hz], and its size over the base's line.
HUM, _HUM_SIZE, _MAINS = 0.6, 0.02, (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)
#: A tone so near to a harmonic of the drive is one of the foot [Hz].
_APART_HZ = 1.0
#: Largest sample of it, in robust standard deviations of it: normal noise reaches 5.5 once in 2.6e7 samples; and over
#: the base's line.
SPIKE, _SPIKE_SIZE = 8.0, 0.1
#: A blow on the base has this share of a spike's crest at least.
_BLOW = 0.6
#: The mean moves by so much [m/s^2]: a sensor that turns by 9 degrees in gravity.
OFFSET = 1.5
#: The sensors' difference over the base: a foot of 35 Hz shaken at 5 Hz has 0.02.
EQUAL = 0.01
#: Without a stated frequency: the one sensor over the other, and what counts as motion [m/s^2 rms].
SILENT, _MOVES = 0.02, 0.5
#: A line is as uncertain as so many of its standard deviations.
_SURE = 6.0
#: The drift of the clocks is known after so many turns.
_KNOWN = 3
#: No line is smaller [m/s^2].
_TINY = 1e-12


@dataclass(frozen=True)
class Drive:
    """What the shaker is to do.

    Attributes:
        frequency_hz: of its sine; None if nobody stated one.
        amplitude_m_s2: of the base; None if nobody brought it to a level.
        one_mass: both sensors are on one mass, so that they are alike.
    """

    frequency_hz: float | None = None
    amplitude_m_s2: float | None = None
    one_mass: bool = False


@dataclass(frozen=True)
class Window:
    """Features of a window; arrays (2,) of base and malleolus.

    Attributes:
        start: index of its first sample.
        seconds: its length.
        line: complex amplitude at the drive's frequency, its phase from sample 0; without one, the rms [m/s^2].
        std: standard deviation of the line [m/s^2].
        rest: rms of what harmonics leave [m/s^2].
        peak: largest sample of that in the window's middle half [m/s^2].
        crest: the same over its robust standard deviation.
        hum: share of its power at the mains.
        mean: [m/s^2].
        flat: longest run of one value [s].
        unlike: rms of the sensors' difference over that of the base.
        step: of the base's phase from one sample to the next, less its uncertainty [rad].
    """

    start: int
    seconds: float
    line: np.ndarray
    std: np.ndarray
    rest: np.ndarray
    peak: np.ndarray
    crest: np.ndarray
    hum: np.ndarray
    mean: np.ndarray
    flat: np.ndarray
    unlike: float
    step: float = 0.0

    @property
    def size(self) -> float:
        """Of the base's line [m/s^2]."""
        return float(abs(self.line[_BASE]))

    @property
    def ratio(self) -> complex:
        """Malleolus over base."""
        return complex(self.line[_MALLEOLUS] / max(self.size, _TINY) * np.exp(-1j * np.angle(self.line[_BASE])))

    @property
    def ratio_std(self) -> float:
        """Its standard deviation, by the malleolus' noise."""
        return float(self.std[_MALLEOLUS] / max(self.size, _TINY))


@dataclass(frozen=True)
class Rule:
    """One comparison.

    Attributes:
        name: of what is wrong.
        sensor: 0 base, 1 malleolus.
        feature: of the sensor, one of `Judged.excesses`.
        text: what to do.
        steady: applied with a stated frequency (True), without (False), or in both cases (None).
        final: the base is no longer measured, so that the recording is not repeated.
        vague: half of another fault may look like this one; it is reported with the next window, which holds all of it.
    """

    name: str
    sensor: int
    feature: str
    text: str
    steady: bool | None = True
    final: bool = False
    vague: bool = False


@dataclass(frozen=True)
class Fault:
    """A window that breaks a rule.

    Attributes:
        rule: which.
        start: index of the window's first sample.
        end: behind its last sample.
        rate_hz: of the samples.
    """

    rule: Rule
    start: int
    end: int
    rate_hz: float

    def __str__(self) -> str:
        return f"{_NAMES[self.rule.sensor]} {self.rule.name} at {self.end / self.rate_hz:.3g} s: {self.rule.text}"


@dataclass(frozen=True)
class Judged:
    """A window and what it is compared with.

    Attributes:
        now: the window.
        before: the one that ends where it begins, if there is one.
        first: the first sound one, or this.
        drive: of the shaker.
        turn: of the base since the window before, without the clocks' drift [rad].
        drift: of the clocks over a window [rad]; 0 until it is known.
        known: whether it is.
    """

    now: Window
    before: Window | None
    first: Window
    drive: Drive
    turn: float = 0.0
    drift: float = 0.0
    known: bool = False

    def excesses(self, sensor: int) -> dict[str, float]:
        """Features of a sensor over their limits: a fault from 1 on."""
        now, first = self.now, self.first
        expected = max(self.drive.amplitude_m_s2 or first.size, _TINY)  # amplitude of the base [m/s^2]
        level, line, rest = now.size, abs(now.line[sensor]), now.rest[sensor]
        other, unsure, moved = abs(now.line[1 - sensor]), _SURE * now.std[_BASE], level >= _MOVES
        spikes = now.crest[sensor] / SPIKE
        if self.drive.frequency_hz is not None:
            spikes = min(spikes, now.peak[sensor] / max(_SPIKE_SIZE * level, _TINY))
        elif not sensor or now.crest[_BASE] >= _BLOW * SPIKE:  # what the base does too (a hammer's blow) is no spike
            spikes = 0.0
        features = {
            "flat": now.flat[sensor] / FLAT_S,
            "lost": LEAST_SHARE * expected / max(level + unsure, _TINY),
            "silent": SILENT * other / max(line, _TINY) if other > _MOVES else 0.0,
            "waveform": rest / (WAVEFORM * level + _NOISE),
            "level": (abs(level - expected) - unsure) / (LEVEL * expected),
            "breaks": self._breaks(),
            "equal": EQUAL / max(now.unlike, _TINY) if moved and not self.drive.one_mass else 0.0,
            "follows": rest / max(FOLLOWS * line, _TINY),
            "changed": _ratio(now, first, RATIO),
            "jumps": _ratio(now, self.before, RATIO_STEP) if self.before else 0.0,
            "hums": min(now.hum[sensor] / HUM, rest / max(_HUM_SIZE * level, _TINY)),
            "mean": abs(now.mean[sensor] - first.mean[sensor]) / OFFSET,
            "spikes": spikes,
            "noisy": rest / (GROWS * first.rest[sensor] + _GROWS_BY * level + _TINY),
        }
        return {name: float(excess) for name, excess in features.items()}

    def _breaks(self) -> float:
        """Of the phase; until the clocks' drift is known, it may be any that a recording may have."""
        if self.before is None:
            return self.now.step / STEP
        clock = CLOCK * 2 * math.pi * (self.drive.frequency_hz or 0.0) * self.now.seconds
        std = math.hypot(self.now.std[_BASE], self.before.std[_BASE])
        noise = _SURE * std / max(min(self.now.size, self.before.size), _TINY)
        turned = abs(self.turn) / (TURN + noise + (0.0 if self.known else clock))
        return max(turned, self.now.step / STEP, (abs(self.drift) - noise) / max(clock, _TINY))


def _ratio(now: Window, then: Window, share: float) -> float:
    """Change of malleolus over base, in units of what is allowed."""
    allowed = share * max(abs(now.ratio), abs(then.ratio)) + _SURE * math.hypot(now.ratio_std, then.ratio_std)
    return abs(now.ratio - then.ratio) / max(allowed, _TINY)


#: All of them; a loss of the base, after which nobody watches it, comes first.
RULES = (
    Rule("flat", _BASE, "flat", "check its cable and supply", None, final=True),
    Rule("lost", _BASE, "lost", "it shows less than half of what drives it; check its cable and the amplifier",
         final=True),
    Rule("lost", _BASE, "silent", "the malleolus moves and it does not; check its cable", False, final=True),
    Rule("not as driven", _BASE, "waveform", "it is not the drive's sine; is it connected, does it float?", final=True),
    Rule("off its level", _BASE, "level", "did its gain, or the shaker's, change?", vague=True),
    Rule("breaks", _BASE, "breaks",
         "the excitation jumped or has another frequency, or samples are missing that nobody counted"),
    Rule("flat", _MALLEOLUS, "flat", "check its cable and supply", None),
    Rule("equal to the base", _MALLEOLUS, "equal", "both inputs see one sensor, or both sensors are on one mass", None),
    Rule("does not follow", _MALLEOLUS, "follows", "its sensor is loose, floats or is not connected"),
    Rule("does not follow", _MALLEOLUS, "silent", "it hardly moves while the base does; is it connected?", False),
    Rule("changed", _MALLEOLUS, "changed", "did its sensor loosen, or the foot move?", vague=True),
    Rule("jumps", _MALLEOLUS, "jumps", "is its sensor loose, or did its channel lose samples?", vague=True),
    *(Rule("hums", i, "hums", "a tone at the mains' frequency; check grounding and shield") for i in SENSORS),
    *(Rule("off its mean", i, "mean", "did its sensor turn, or its connection open?", vague=True) for i in SENSORS),
    *(Rule("spikes", i, "spikes", "check cable and connector, and whether the foot lifts", None, vague=True)
      for i in SENSORS),
    *(Rule("noisy", i, "noisy", "noise or a tone has come up; check cable and mounting", vague=True) for i in SENSORS),
)  # fmt: skip


class Monitor:
    """Checks both sensors window by window.

    Args:
        rate_hz: of the samples.
        drive: of the shaker.

    Example:
        >>> t = np.arange(1000) / 1000
        >>> both = 9 * np.column_stack([np.sin(40 * np.pi * t), 1.3 * np.sin(40 * np.pi * t - 0.4)])
        >>> monitor = Monitor(1000.0, Drive(20.0, 9.0))
        >>> monitor.add(0, both)
        []
        >>> str(monitor.add(1000, both * [1, 0])[0])
        'malleolus flat at 1.12 s: check its cable and supply'
    """

    def __init__(self, rate_hz: float, drive: Drive) -> None:
        self.rate_hz, self.drive = rate_hz, drive
        seconds = max(WINDOW_S, _PERIODS / drive.frequency_hz if drive.frequency_hz else 0.0)
        self.hop = max(4, math.ceil(0.5 * seconds * rate_hz))
        self._first: Window | None = None
        self._waiting: list[Fault] = []
        self._turns: list[complex] = []
        f = drive.frequency_hz or math.inf
        self._mains = [hz for hz in _MAINS if abs(hz - f * round(hz / f)) > _APART_HZ] or [math.inf]
        self._basis: np.ndarray = np.zeros((0, 0))
        self._inverse = self._basis
        if drive.frequency_hz:
            self._basis = _harmonics(drive.frequency_hz / rate_hz, 2 * self.hop)
            self._inverse = np.linalg.pinv(self._basis)
            self._steps = Steps(drive.frequency_hz / rate_hz, 2 * self.hop)
        self._restart(0)

    def _restart(self, index: int) -> None:
        """Begin anew behind a gap."""
        self._at, self._samples = index, np.zeros((0, 2))
        self._windows: list[Window] = []

    def add(self, index: int, samples: np.ndarray) -> list[Fault]:
        """Faults of the windows that these samples complete.

        Args:
            index: of the first on the grid of samples; windows begin anew behind a gap.
            samples: (n, 2) base and malleolus [m/s^2].
        """
        if index != self._at + len(self._samples):
            self._restart(index)
        self._samples = np.concatenate([self._samples, samples])
        faults: list[Fault] = []
        while len(self._samples) >= 3 * self.hop or (not self._windows and len(self._samples) >= 2 * self.hop):
            if self._windows:  # the last window's first half is no longer needed
                self._at, self._samples = self._at + self.hop, self._samples[self.hop :]
            faults += self._judge(self._at, self._samples[: 2 * self.hop])
        return faults

    def end(self) -> list[Fault]:
        """Faults of a recording's last samples, for which a window begins earlier."""
        missing = len(self._samples) - 2 * self.hop
        latest = self._judge(self._at + missing, self._samples[missing:]) if self._windows and missing > 0 else []
        waiting, self._waiting = self._waiting, []
        return latest + waiting

    def _judge(self, start: int, values: np.ndarray) -> list[Fault]:
        now = self.window(start, values)
        before = next((window for window in self._windows if window.start == start - 2 * self.hop), None)
        steady = self.drive.frequency_hz is not None
        raw = now.line[_BASE] * np.conj(before.line[_BASE]) if before and steady else 0j
        known = len(self._turns) >= _KNOWN
        usual = complex(np.median(np.real(self._turns)), np.median(np.imag(self._turns))) if known else 1.0
        drift = float(np.angle(usual))
        turn = float(np.angle(raw * np.exp(-1j * drift)))
        judged = Judged(now, before, self._first or now, self.drive, turn, drift, known)
        excesses = [judged.excesses(sensor) for sensor in SENSORS]
        rules = [rule for rule in RULES if rule.steady in (None, steady)]
        broken = [rule for rule in rules if excesses[rule.sensor][rule.feature] >= 1]
        if abs(raw) > 0 and not broken:
            self._turns.append(complex(raw / abs(raw)))
        if not broken:
            self._first = self._first or now
        self._windows = [*self._windows[-1:], now]
        new = [Fault(rule, start, start + len(values), self.rate_hz) for rule in broken]
        if new and not self._waiting and all(rule.vague for rule in broken):
            self._waiting, new = new, []
        elif self._waiting:
            new, self._waiting = sorted(self._waiting + new, key=lambda fault: RULES.index(fault.rule)), []
        return new

    def window(self, start: int, values: np.ndarray) -> Window:
        """Features of samples (n, 2) [m/s^2], the first of which is number `start`."""
        mean, frequency, step = values.mean(axis=0), self.drive.frequency_hz, 0.0
        if frequency:
            c = self._inverse @ values
            rest, mean = values - self._basis @ c, c[0]
            line = c[1] - 1j * c[2]
            step = self._steps.largest(values[:, _BASE], complex(line[_BASE]))
            line = line * np.exp(-2j * np.pi * frequency / self.rate_hz * start)
        else:
            rest = values - mean
            line = rest.std(axis=0).astype(complex)
        rms = np.sqrt((rest**2).mean(axis=0))
        robust = 1.4826 * np.median(np.abs(rest), axis=0) + _TINY
        middle = rest[len(rest) // 4 : -(len(rest) // 4)]  # of two windows, one has a spike there
        peak = np.abs(middle).max(axis=0)
        unlike = float(np.std(values[:, 1] - values[:, 0]) / max(values[:, 0].std(), _TINY))
        seconds = len(values) / self.rate_hz
        return Window(
            start, seconds, line, rms * math.sqrt(2 / len(values)), rms, peak, peak / robust, self._hum(rest), mean,
            _longest_run(values) / self.rate_hz, unlike, step,
        )  # fmt: skip

    def _hum(self, rest: np.ndarray) -> np.ndarray:
        """Share (2,) of the power that is at the mains, where the drive has no harmonic."""
        power = np.abs(np.fft.rfft(rest, axis=0)) ** 2
        hz, bin_hz = np.fft.rfftfreq(len(rest), 1 / self.rate_hz), self.rate_hz / len(rest)
        near = np.min(np.abs(hz[:, None] - self._mains), axis=1) < bin_hz
        return np.asarray(power[near].sum(axis=0) / np.maximum(power.sum(axis=0), _TINY))


class Steps:
    """Looks for a step of a sine's phase inside a window.

    A step H_k (0 before sample k, 1 from k on) of the sine is what three harmonics, whose first may grow and turn
    evenly, leave of H_k cos and H_k sin.

    Args:
        turns: of the sine a sample.
        size: of a window.
    """

    def __init__(self, turns: float, size: int) -> None:
        even = np.linspace(-1, 1, size)[:, None]
        waves = _harmonics(turns, size, 3)
        first = waves[:, 1:3]
        self._smooth, _ = np.linalg.qr(np.column_stack([waves, even * first]))
        self._places = []
        for place in np.linspace(size / 8, 7 * size / 8, _PLACES):
            after = first * (np.arange(size) >= place)[:, None]
            q, r = np.linalg.qr(after - self._smooth @ (self._smooth.T @ after))
            self._places.append((q, np.linalg.inv(r)))

    def largest(self, values: np.ndarray, line: complex) -> float:
        """The most certain step [rad] of values (n,) with this amplitude, less what noise makes of none."""
        rest = values - self._smooth @ (self._smooth.T @ values)
        parts = [(q.T @ rest, q, inverse) for q, inverse in self._places]
        part, q, inverse = max(parts, key=lambda fit: float(fit[0] @ fit[0]))
        cosine, sine = inverse @ part
        turned = abs(((cosine - 1j * sine) * np.conj(line)).imag) / max(abs(line) ** 2, _TINY)
        noise = float(np.std(rest - q @ part)) * float(np.linalg.norm(inverse, 2))
        return turned - _SURE * noise / max(abs(line), _TINY)


def _harmonics(turns: float, size: int, most: int = _HARMONICS) -> np.ndarray:
    """Columns of a constant, and of cosine and sine of each harmonic of so many turns a sample."""
    count = max(1, min(most, int(0.4 / turns), size // _SAMPLES_PER_TERM // 2))
    return columns(2 * np.pi * turns * np.arange(size), count)


def _longest_run(values: np.ndarray) -> np.ndarray:
    """Samples (2,) of the longest run of one value, by column."""
    runs = []
    for column in values.T:
        edges = np.flatnonzero(np.concatenate([[True], np.diff(column) != 0, [True]]))
        runs.append(np.diff(edges).max())
    return np.array(runs)


def faults(index: np.ndarray, values: np.ndarray, rate_hz: float, drive: Drive) -> list[Fault]:
    """Faults of a whole recording.

    Args:
        index: (n,) of each sample on the grid of samples.
        values: (n, 2) base and malleolus [m/s^2].
        rate_hz: of the samples.
        drive: of the shaker.
    """
    monitor = Monitor(rate_hz, drive)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(index) != 1) + 1, [index.size]])
    all_faults: list[Fault] = []
    for first, last in pairwise(edges):
        if last > first:
            all_faults += [*monitor.add(int(index[first]), values[first:last]), *monitor.end()]
    return all_faults


def named(all_faults: Sequence[Fault]) -> tuple[tuple[float, str], ...]:
    """The first fault of each rule: when its window ends [s], and the sentence."""
    first = {fault.rule: fault for fault in reversed(all_faults)}
    return tuple(sorted((fault.end / fault.rate_hz, str(fault)) for fault in first.values()))
