"""What a fit, or a comparison of rivals, is of: the recordings as they were read, the model and its text, settings.

A result is kept with its job. It is shown only with its model, and is out of date as soon as a recording or the model
has changed.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from fasbody.recording.sources import together
from viz.source import Source


@dataclass(frozen=True)
class Job:
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
    text: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    rivals: bool = False

    def document(self) -> dict[str, Any]:
        """The job in the types of JSON, for the fitting process and a session's file."""
        return asdict(self)

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> "Job":
        """The job of a document.

        Raises:
            KeyError, TypeError, ValueError: it is no such document.
        """
        sources = {int(number): Source(**source) for number, source in document["sources"].items()}
        return cls(**{**document, "sources": sources})

    @property
    def script(self) -> str:
        """The lines of Python that repeat it."""
        reads = [source.line() for source in self.sources.values()]
        text = "\n".join(reads)
        recording = [name for name in ("Layout", "with_masses", "read_file") if name in text]
        homes = {"Layout": "channels", "with_masses": "recording", "read_file": "study"}
        bundled = "BUNDLED, " if "BUNDLED" in text else ""
        imports = [
            f"from fasbody.recording.{homes[name]} import {bundled if name == 'read_file' else ''}{name}"
            for name in recording
        ]
        at_height = "@" in self.model
        foot = f"load_foot({self.model!r})" if at_height else f"fb.load({self.model!r})"
        foot += f".with_values({dict(self.values)!r})" if self.values else ""
        options = "".join(f", {name}={value!r}" for name, value in self.settings.items())
        verb = "compare_rivals" if self.rivals else "fit_foot"
        lines = [
            *(["from pathlib import Path", ""] if "Path(" in text else []),
            "import fasbody as fb",
            "import identification as idn",
            *imports,
            *(["from viz.load import load_foot"] if at_height else []),
            "",
            "recordings = [",
            *(f"    {line}," for line in reads),
            "]",
            f"result = idn.{verb}(recordings, {foot}{options})",
            "print(result)",
            'result.write("results")',
        ]
        return "\n".join(lines) + "\n"

    def stale(self, sources: Mapping[int, Source], text: str) -> str:
        """Why its result is out of date, in a sentence; empty where it is not."""
        gone = [s.file for number, s in self.sources.items() if number not in sources]
        other = [s.file for number, s in self.sources.items() if sources.get(number, s) != s]
        changed = [
            f"{together(files)} {'was' if len(files) == 1 else 'were'} {what}"
            for files, what in ((gone, "removed"), (other, "read in another way"))
            if files
        ]
        changed += ["the model's file was changed"] if text != self.text else []
        return f"Out of date: since this fit {' and '.join(changed)}; fit again." if changed else ""


#: A result as the page has it, with what it is of.
Answer = tuple[Job, dict[str, Any]]
