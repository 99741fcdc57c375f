"""What drives the base of the shown foot."""

from dataclasses import dataclass, replace
from pathlib import Path

from fasbody.exceptions import InputFileError
from fasbody.foot.shaker import BaseMotion, samples, sweep
from fasbody.recording.recording import Recording

#: Length of the swept sine and of what is shown of a recording [s], unless asked for; ends of the sweep [Hz].
SWEEP_S, RECORDED_S, SWEEP_HZ = 4.0, 1.0, (5.0, 50.0)
#: Fewest samples of a recording that make a motion: the cubic spline through them.
LEAST_SAMPLES = 4


@dataclass(frozen=True, eq=False)
class Excitation:
    """What drives the base: a sine (base None), or a motion of its own, with what was measured beside it."""

    base: BaseMotion | None = None
    recording: Recording | None = None

    @classmethod
    def swept(cls, seconds: float = SWEEP_S) -> "Excitation":
        """A swept sine of `seconds`."""
        return cls(sweep(*SWEEP_HZ, seconds))

    @classmethod
    def recorded(cls, file: Path, seconds: float) -> "Excitation":
        """The first `seconds` of a recording; its mean is taken out.

        Raises:
            InputFileError: no such file, or too few samples within `seconds`.
        """
        if not file.is_file():
            valid = "give a recording, such as a CSV file with the columns time_s, base_m_s2 and malleolus_m_s2"
            raise InputFileError(file, "there is no such file", valid)
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
