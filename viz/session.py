"""A session as a file: recordings with their corrections, the model's text, fit and rivals, and what the page shows.

A zip of `session.json` and the files themselves, so that it opens on another machine. Recordings of the bundled study
are named, not copied. Nothing of it is run, and no file is written outside the session's folder.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from fasbody.console import to_json
from fasbody.exceptions import InputFileError
from fasbody.recording.study import BUNDLED
from viz.archive import packed, unpacked
from viz.job import Job
from viz.source import Source
from viz.uploads import FILES, LARGEST, MOST

#: Form of the file; another number is of another version.
FORM = 1
NAME = "session.json"
_BUNDLED = "bundled study"
_VALID = "give a file that this page saved"

Answer = tuple[Job, dict[str, Any]]


@dataclass(frozen=True)
class Session:
    """What is kept of a session.

    Attributes:
        sources: the recordings, by their ids; folders are relative to the session's, or absolute when it is open.
        current: id of the one that shakes the foot, -1 for none.
        model: shown, by name or by its file in the session.
        fit: the last fit with its job, None where there is none.
        rivals: the same of a comparison.
        page: ticks, sliders and what a fit may change, which only the page reads.
        files: contents by name.
    """

    sources: Mapping[int, Source]
    current: int
    model: str
    fit: Answer | None
    rivals: Answer | None
    page: Mapping[str, Any]
    files: Mapping[str, bytes]

    def pack(self, folders: Mapping[str, str]) -> bytes:
        """The file.

        Args:
            folders: of recordings, by their place now -> place among the files.
        """

        def relative(source: Source) -> Source:
            inside = _BUNDLED if source.folder == str(BUNDLED) else folders.get(source.folder, "")
            return replace(source, folder=inside)

        def answer(kept: Answer | None) -> dict[str, Any] | None:
            if kept is None:
                return None
            job = replace(kept[0], sources={n: relative(s) for n, s in kept[0].sources.items()})
            return {"job": job.document(), "document": kept[1]}

        document = {
            "fasbody_session": FORM,
            "sources": {number: asdict(relative(source)) for number, source in self.sources.items()},
            "current": self.current, "model": self.model, "page": dict(self.page),
            "fit": answer(self.fit), "rivals": answer(self.rivals),
        }  # fmt: skip
        return packed({NAME: to_json(document).encode()} | {f"files/{name}": text for name, text in self.files.items()})

    @classmethod
    def unpack(cls, name: str, content: bytes, folder: Path) -> "Session | None":
        """A session of a dropped zip, whose files are to lie in a folder; None where it holds none.

        Raises:
            InputFileError: it is no zip file, is damaged, or is of a later version.
        """
        inside = dict(unpacked(name, content, LARGEST, MOST, FILES))
        if NAME not in inside:
            return None

        def placed(source: Source) -> Source:
            where = BUNDLED if source.folder == _BUNDLED else (folder / source.folder).resolve()
            if where != BUNDLED and not where.is_relative_to(folder.resolve()):
                raise ValueError(source.folder)
            if not (where / source.file).resolve().is_relative_to(where):
                raise ValueError(source.file)
            return replace(source, folder=str(where))

        def answer(kept: Any) -> Answer | None:
            if kept is None:
                return None
            job = Job.of(kept["job"])
            job = replace(job, sources={n: placed(s) for n, s in job.sources.items()})
            return job, dict(kept["document"])

        try:
            document = json.loads(inside[NAME])
            form = document["fasbody_session"]
            if form == FORM:
                sources = {int(n): placed(Source(**source)) for n, source in document["sources"].items()}
                files = {file.removeprefix("files/"): text for file, text in inside.items() if file != NAME}
                fit, rivals = answer(document["fit"]), answer(document["rivals"])
                current, page = int(document["current"]), dict(document["page"])
                return cls(sources, current, str(document["model"]), fit, rivals, page, files)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            raise InputFileError(name, "is not a whole session", _VALID) from None
        raise InputFileError(name, f"is a session of form {form}, not {FORM}", "update fasbody, or save it again")
