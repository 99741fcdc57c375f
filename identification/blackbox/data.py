"""Input, output and sample time of one recording, checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fasbody.exceptions import RecordingError, SettingError
from fasbody.recording.recording import Recording

SHORTEST = 20  # samples; below this not even a first-order model and its initial state can be judged
#: Structures that can be estimated, and those that are unless others are named.
ALL = ("arx", "armax", "bj", "oe", "ss", "hw", "narx")
DEFAULT = ("arx", "armax", "oe", "bj", "ss", "hw")
INPUT_OUTPUT = ("base_m_s2", "malleolus_m_s2")  # of a foot's recording


@dataclass(frozen=True, eq=False)
class Series:
    """One recording of a single-input single-output system.

    Attributes:
        u: input, shape (N,).
        y: output, shape (N,).
        sample_time: seconds between samples.
        name: what to call it in tables and messages.
        channels: names of input and output.
        part: whether it was cut from a whole recording, which alone is asked for excitation: a step or a pulse
            leaves parts without any.

    Raises:
        RecordingError: the arrays cannot identify anything; one sentence says why.
    """

    u: np.ndarray
    y: np.ndarray
    sample_time: float
    name: str = "recording"
    channels: tuple[str, str] = ("input", "output")
    part: bool = False

    def __post_init__(self) -> None:
        """Keep the arrays as read-only floats and check them."""
        for field in ("u", "y"):
            values = np.array(getattr(self, field), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, field, values)
        problem = find_fault(self.u, self.y, self.sample_time)
        problem = problem or ("" if self.part else find_problem(self.u, self.y))
        if problem:
            raise RecordingError(f"{self.name}: {problem}.")

    def __len__(self) -> int:
        return len(self.u)

    @property
    def time(self) -> np.ndarray:
        """Seconds from the first sample, shape (N,)."""
        return np.arange(len(self)) * self.sample_time

    def cut(self, start: int, stop: int) -> Series:
        """The samples from `start` up to, not including, `stop`."""
        return replace(self, u=self.u[start:stop], y=self.y[start:stop], part=True)

    def split(self, fraction: float = 0.5) -> tuple[Series, Series]:
        """The first `fraction` for estimation and the rest for validation, both less the means of the first.

        Raises:
            SettingError: `fraction` leaves one part shorter than any model needs.
            RecordingError: the input does nothing in the first part, or the output nothing in one of them.
        """
        middle = round(fraction * len(self))
        if not SHORTEST <= middle <= len(self) - SHORTEST:
            raise SettingError(
                f"split {fraction:g} of {len(self)} samples leaves a part with fewer than {SHORTEST} samples; "
                "choose a fraction nearer to 0.5 or a longer recording."
            )
        u_mean, y_mean = self.u[:middle].mean(), self.y[:middle].mean()
        centred = replace(self, u=self.u - u_mean, y=self.y - y_mean)
        parts = centred.cut(0, middle), centred.cut(middle, len(self))
        for silent, label in (
            (_constant(self.u[:middle]), "input is constant in the estimation part"),
            (_constant(self.y[:middle]), "output is constant in the estimation part"),
            (_constant(self.y[middle:]), "output is constant in the held-out part"),
        ):
            if silent:
                first, last = (1, middle) if "estimation" in label else (middle + 1, len(self))
                other = "smaller" if "held-out" in label else "larger"
                raise RecordingError(
                    f"{self.name}: the {label} (samples {first} to {last} of {len(self)}), though not in the whole "
                    f"record; choose a {other} --split than {fraction:g}."
                )
        return parts

    def centred(self) -> Series:
        """The recording less its means: linear models describe motion about the mean."""
        return replace(self, u=self.u - self.u.mean(), y=self.y - self.y.mean())


def _constant(signal: np.ndarray) -> bool:
    return bool(np.ptp(signal) <= 1e-12 * np.abs(signal).max(initial=1e-300))


def find_fault(u: np.ndarray, y: np.ndarray, sample_time: float) -> str:
    """What makes these arrays (N,) no recording at all, as a clause, or an empty string."""
    if u.ndim != 1 or u.shape != y.shape:
        return f"input and output must be two columns of equal length, not of shapes {u.shape} and {y.shape}"
    if not (np.isfinite(sample_time) and sample_time > 0):
        return f"the sample time must be a positive number of seconds, not {sample_time}"
    if len(u) < SHORTEST:
        return f"{len(u)} samples are too few; at least {SHORTEST} are needed"
    for signal, label in ((u, "input"), (y, "output")):
        if not np.isfinite(signal).all():
            first = int(np.argmin(np.isfinite(signal)))
            return f"the {label} is not a finite number at sample {first + 1}; cut or mend the gap first"
    return ""


def find_problem(u: np.ndarray, y: np.ndarray) -> str:
    """What makes a sound whole recording (N,) useless for identification, as a clause, or an empty string."""
    if _constant(u):
        what = "zero throughout: an output without input" if not u.any() else "constant"
        return f"the input is {what}, so no response to it can be seen; record while the base is shaken"
    if _constant(y):
        return "the output is constant, so it shows no response; check the sensor and the column"
    if np.array_equal(u, y):
        return "input and output are the same signal; name two different columns or sensors"
    if _grows_without_bound(u, y):
        return (
            "the output grows from beginning to end while the input does not, as of an unstable system; free "
            "simulation cannot be judged on it, so cut the recording to its stationary part"
        )
    return ""


def _grows_without_bound(u: np.ndarray, y: np.ndarray) -> bool:
    """Whether the output's level rises by a fifth or more in every tenth of the record, the input's not."""
    blocks = 10
    size = len(y) // blocks
    levels = [
        np.sqrt(np.mean((signal[: blocks * size].reshape(blocks, size) - signal[:size].mean()) ** 2, axis=1))
        for signal in (y, u)
    ]
    growth = [level[1:] / np.maximum(level[:-1], 1e-300) for level in levels]
    return bool(np.all(growth[0] > 1.2) and not np.all(growth[1] > 1.1))


def from_recording(recording: Recording) -> Series:
    """A foot's recording as a system from base to malleolus acceleration."""
    name = Path(recording.file).stem
    return Series(recording.base_m_s2, recording.malleolus_m_s2, 1 / recording.rate_hz, name, INPUT_OUTPUT)
