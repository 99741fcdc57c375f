"""What drives the base of the shown foot."""

from dataclasses import dataclass, replace
from pathlib import Path

from fasbody.exceptions import InputFileError
from fasbody.recording import Recording
from fasbody.shaker import BaseMotion, samples, sweep

#: Length of the swept sine [s] and its ends [Hz].
SWEEP_S, SWEEP_HZ = 4.0, (5.0, 50.0)
#: Fewest samples of a recording that make a motion: the cubic spline through them.
LEAST_SAMPLES = 4


@dataclass(frozen=True, eq=False)
class Excitation:
    """What drives the base: a sine (base None), or a motion of its own, with what was measured beside it."""

    base: BaseMotion | None = None
    recording: Recording | None = None

    @classmethod
    def swept(cls) -> "Excitation":
        """A swept sine."""
        return cls(sweep(*SWEEP_HZ, SWEEP_S))

    @classmethod
    def recorded(cls, file: Path, seconds: float) -> "Excitation":
        """The first `seconds` of a recording; its mean is taken out.

        Raises:
            InputFileError: too few samples within `seconds`.
        """
        whole = Recording.read(file)
        keep = whole.time_s - whole.time_s[0] <= seconds
        if keep.sum() < LEAST_SAMPLES:
            problem = f"has {keep.sum()} of its {len(keep)} samples within --seconds {seconds:g}"
            raise InputFileError(file, problem, f"at least {LEAST_SAMPLES} are needed")
        cut = replace(whole, **{
            name: getattr(whole, name)[keep] - (0 if name == "time_s" else getattr(whole, name).mean())
            for name in ("time_s", "base_m_s2", "malleolus_m_s2")
        })  # fmt: skip
        time = cut.time_s - cut.time_s[0]
        return cls(samples(time, cut.base_m_s2, cut.file), cut)
