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
        filters = {
            "subject": self.subjects, "posture": self.postures, "added_mass_kg": self.added_masses_kg,
            "frequency_hz": self.frequencies_hz,
        }  # fmt: skip
        chosen = list(trials)
        for field, values in filters.items():
            of = {trial: _text(getattr(trial.condition, field)) for trial in trials}
            texts = [_text(value) for value in values]
            for text in texts:
                if text not in of.values():
                    kind = field.removesuffix("_kg").removesuffix("_hz").replace("_", " ")
                    raise SettingError(f"{unknown(kind, text, list(dict.fromkeys(of.values())))} in this study.")
            if texts:
                chosen = [trial for trial in chosen if of[trial] in texts]
        if not chosen:
            raise SettingError("no recording of the study passes all the filters together.")
        return chosen


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
