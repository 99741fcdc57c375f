"""What a fit, or a comparison of rivals, is of: the recordings as they were read, the model and its text, settings.

A result is kept with its question. It is shown only with its model, and is out of date as soon as a recording or the
model has changed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fasbody.recording.sources import together
from viz.source import Source, script
from viz.worker import job


@dataclass(frozen=True)
class Question:
    """The inputs of a fit or a comparison.

    Attributes:
        sources: the recordings, by their ids.
        model: by name or file.
        text: digest of its MJCF with what it includes.
        values: in place of those of the model.
        settings: of `fit_foot`.
        rivals: whether rivals are compared.
    """

    sources: Mapping[int, Source]
    model: str
    text: str
    values: Mapping[str, float]
    settings: Mapping[str, Any] = field(default_factory=dict)
    rivals: bool = False

    @property
    def job(self) -> dict[str, Any]:
        """As the worker takes it."""
        asked = job(list(self.sources.values()), self.model, self.values, self.settings)
        return asked | ({"do": "rivals"} if self.rivals else {})

    @property
    def script(self) -> str:
        """The lines of Python that repeat it."""
        return script(list(self.sources.values()), self.model, self.values, self.settings, rivals=self.rivals)

    def stale(self, sources: Mapping[int, Source], text: str) -> str:
        """Why its result is out of date, in a sentence; empty where it is not."""
        gone = [s.file for number, s in self.sources.items() if number not in sources]
        other = [s.file for number, s in self.sources.items() if sources.get(number, s) != s]
        changed = [_clause(gone, "removed")] if gone else []
        changed += [_clause(other, "read in another way")] if other else []
        changed += ["the model's file was changed"] if text != self.text else []
        return f"Out of date: since this fit {' and '.join(changed)}; fit again." if changed else ""


def _clause(files: list[str], what: str) -> str:
    """A clause on what was done with some files."""
    return f"{together(files)} {'was' if len(files) == 1 else 'were'} {what}"
