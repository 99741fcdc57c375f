"""Which recordings of a study a run takes."""

from collections.abc import Sequence
from dataclasses import dataclass

from fasbody.exceptions import SettingError, unknown
from fasbody.recording.trials import Trial

#: Which recordings one fit takes together.
MODES = ("per-recording", "pooled")
#: What is done with such a group: the fit itself, or a check of it (checks.py).
KINDS = ("fit", "profile", "validation", "agreement")


@dataclass(frozen=True)
class Filters:
    """Which recordings of a study to take; an empty one takes all."""

    subjects: tuple[str, ...] = ()
    postures: tuple[str, ...] = ()
    added_masses_kg: tuple[float, ...] = ()
    frequencies_hz: tuple[float, ...] = ()

    def choose(self, trials: Sequence[Trial]) -> list[Trial]:
        """The trials that pass.

        Raises:
            SettingError: a value that no recording has, or nothing passes.
        """
        wanted = (
            ("subject", "subject", self.subjects), ("posture", "posture", self.postures),
            ("added mass", "added_mass_kg", self.added_masses_kg), ("frequency", "frequency_hz", self.frequencies_hz),
        )  # fmt: skip
        chosen = list(trials)
        for kind, field, values in wanted:
            there = list(dict.fromkeys(_text(getattr(trial.condition, field)) for trial in trials))
            for value in values:
                if _text(value) not in there:
                    raise SettingError(f"{unknown(kind, _text(value), there)} in this study.")
            if values:
                asked = {_text(value) for value in values}
                chosen = [trial for trial in chosen if _text(getattr(trial.condition, field)) in asked]
        if not chosen:
            raise SettingError("no recording of the study passes all the filters together.")
        return chosen


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
