"""What drives the base: a sine, a sweep, or a recording, with what was measured beside it.

A steady recording is shown as its mean period: its harmonics are fitted as the identification fits them, and both
model and measurement are displaced by the integral of those harmonics, which needs no start and no end.
Of any other recording a piece from its inside is shown, so that the filter that takes the drift out has what it needs
on both sides.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fasbody.exceptions import InputFileError, RecordingError
from fasbody.foot.shaker import BaseMotion, samples, sweep
from fasbody.presentation import Tabled
from fasbody.recording.checks import checked
from fasbody.recording.harmonics import fit_harmonics, harmonic_count
from fasbody.recording.recording import Recording
from fasbody.recording.study import read_file

Array = np.ndarray

#: Length of the swept sine and of the displayed part of a recording [s] by default; ends of the sweep [Hz].
SWEEP_S, RECORDED_S, SWEEP_HZ = 4.0, 1.0, (5.0, 50.0)
#: What a recording that is not steady has before and behind the piece that is shown: at most so many seconds, and at
#: most this share of it.
MARGIN_S, MARGIN = 1.0, 0.25
#: Fewest samples of a recording that make a motion: the cubic spline through them.
LEAST_SAMPLES = 4
#: Most samples of a period that the page draws as points.
POINTS = 600


@dataclass(frozen=True, eq=False)
class Steady:
    """The periodic part of a recording, signal = sum over h of Re(amplitude_h exp(i 2 pi h f t)), t from its start.

    Attributes:
        frequency_hz: of the sine.
        base, malleolus: (H,) complex amplitudes [m/s^2].
        periods: how many were averaged.
        noise: share of the malleolus' standard deviation that is not periodic.
    """

    frequency_hz: float
    base: Array
    malleolus: Array
    periods: float
    noise: float

    @classmethod
    def of(cls, recording: Recording) -> "Steady | None":
        """The periodic part of a recording that the checks find steady; None of any other."""
        try:
            good = checked(recording)
        except RecordingError:
            return None
        f = good.condition.frequency_hz
        if f is None:
            return None
        time = good.time_s - good.time_s[0]
        count = harmonic_count(f, good.rate_hz)
        base, malleolus = (fit_harmonics(time, x, f, count) for x in (good.base_m_s2, good.malleolus_m_s2))
        spread = float(np.std(good.malleolus_m_s2)) or 1.0
        return cls(f, base.amplitudes, malleolus.amplitudes, float(time[-1] * f), malleolus.sigma / spread)

    def ratio(self, delay_s: float = 0.0) -> complex:
        """Malleolus over base at the fundamental, for a malleolus whose channel is late by `delay_s` [s]."""
        return complex(self.malleolus[0] / self.base[0] * np.exp(2j * np.pi * self.frequency_hz * delay_s))

    def period(self, amplitudes: Array, count: int, order: int = 0, delay_s: float = 0.0) -> Array:
        """(count,) values of a period of one channel; `order` -2 is its displacement [m], 0 its acceleration [m/s^2].

        Args:
            amplitudes: (H,) complex [m/s^2].
            count: of the values.
            order: of the derivative.
            delay_s: how late the channel is [s].
        """
        rate = 2j * np.pi * self.frequency_hz * np.arange(1, amplitudes.size + 1)
        turns = np.exp(2j * np.pi * np.outer(np.arange(count) / count, np.arange(1, amplitudes.size + 1)))
        return np.asarray((turns @ (amplitudes * rate**order * np.exp(rate * delay_s))).real)


@dataclass(frozen=True, eq=False)
class Excitation(Tabled):
    """What drives the base: a sine (neither base nor steady), another motion, or a recording.

    Attributes:
        base: motion of a sweep, or of a recording that is not steady.
        recording: what was measured.
        steady: its periodic part, if it has one.
        window: first and last second of `base` that are shown.
        doubt: why no motion is to be made of it, in a sentence.
        refused: no fit takes the recording, and so none is compared with it.
    """

    base: BaseMotion | None = None
    recording: Recording | None = None
    steady: Steady | None = None
    window: tuple[float, float] = field(default=(0.0, np.inf))
    doubt: str = ""
    refused: bool = False

    @property
    def periodic(self) -> bool:
        """Whether one period is shown."""
        return self.base is None

    @property
    def title(self) -> str:
        """What it is called on the page."""
        if self.recording is not None:
            return self.recording.file
        return self.base.name if self.base is not None else "sine"

    @classmethod
    def swept(cls, seconds: float = SWEEP_S) -> "Excitation":
        """A swept sine of `seconds`."""
        return cls(sweep(*SWEEP_HZ, seconds))

    @classmethod
    def recorded(cls, file: Path | Recording, seconds: float | None = None, study: Path | None = None) -> "Excitation":
        """A recording, by file or as read: its mean period, or a piece of it.

        Args:
            file: the recording.
            seconds: how much of it counts; None for all of a steady one and a second of others.
            study: study.toml that says what its columns are.

        Raises:
            InputFileError: no such file, or too few samples within `seconds`.
        """
        if not isinstance(file, Recording):
            if not file.is_file():
                valid = "give a recording, such as a CSV file with the columns time_s, base_m_s2 and malleolus_m_s2"
                raise InputFileError(file, "there is no such file", valid)
            file = read_file(file, study)
        return cls._of(file, seconds)

    @classmethod
    def _of(cls, whole: Recording, seconds: float | None) -> "Excitation":
        passed = whole.time_s - whole.time_s[0]
        keep = passed <= (np.inf if seconds is None else seconds)
        if keep.sum() < LEAST_SAMPLES:
            problem = f"has {keep.sum()} of its {len(keep)} samples within --seconds {seconds:g}"
            raise InputFileError(Path(whole.file), problem, f"at least {LEAST_SAMPLES} are needed")
        cut = whole  # the very same is checked once
        if not keep.all():
            cut = whole.with_channels({name: values[keep] for name, values in whole.channels.items()})
        steady = Steady.of(cut)
        if steady is not None:
            return cls(None, whole, steady)
        total = float(passed[-1])
        margin = min(MARGIN_S, MARGIN * total)
        length = min(RECORDED_S if seconds is None else seconds, total - 2 * margin)
        keep = passed <= length + 2 * margin
        cut = whole.with_channels({
            name: values[keep] - (values[0] if name == "time_s" else values[keep].mean())
            for name, values in whole.channels.items()
        })  # fmt: skip
        return cls(samples(cut.time_s, cut.base_m_s2, cut.file), cut, None, (margin, margin + length))

    def folded(self) -> tuple[Array, Array]:
        """Times within the period [s] and malleolus [m/s^2], (n,) each, of the samples of a steady recording."""
        assert self.recording is not None and self.steady is not None
        time = (self.recording.time_s - self.recording.time_s[0]) % (1 / self.steady.frequency_hz)
        values = self.recording.malleolus_m_s2 - self.recording.malleolus_m_s2.mean()
        every = max(1, values.size // POINTS)
        order = np.argsort(time[::every])
        return time[::every][order], values[::every][order]
