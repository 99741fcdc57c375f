"""A session as a file: recordings with their corrections, the model's text, fits and rivals, and what the page shows.

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
from viz.history import History
from viz.job import Answer, Job
from viz.model_text import is_shipped
from viz.source import Source
from viz.uploads import FILES, LARGEST, MOST

#: Form of the file; form 1 holds one fit. Another number is of another version.
FORM = 2
NAME = "session.json"
_BUNDLED = "bundled study"
_VALID = "give a file that this page saved"


@dataclass(frozen=True)
class Session:
    """What is kept of a session.

    Attributes:
        sources: the recordings, by their ids; folders are relative to the session's, or absolute when it is open.
        current: id of the one that shakes the foot, -1 for none.
        model: shown, by name or by its file in the session.
        fits: with their jobs, in order.
        chosen: which of them is shown, -1 for none.
        rivals: a comparison with its job, None where there is none.
        page: ticks, sliders and what a fit may change, which only the page reads.
        files: contents by name.
    """

    sources: Mapping[int, Source]
    current: int
    model: str
    fits: tuple[Answer, ...]
    chosen: int
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

        def answer(kept: Answer) -> dict[str, Any]:
            job = replace(kept[0], sources={n: relative(s) for n, s in kept[0].sources.items()})
            return {"job": job.document(), "document": kept[1]}

        document = {
            "fasbody_session": FORM,
            "sources": {number: asdict(relative(source)) for number, source in self.sources.items()},
            "current": self.current, "model": self.model, "page": dict(self.page),
            "fits": list(map(answer, self.fits)), "chosen": self.chosen,
            "rivals": answer(self.rivals) if self.rivals else None,
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

        def answer(kept: Any) -> Answer:
            job = Job.of(kept["job"])
            if job.model != document["model"] and not is_shipped(job.model):
                raise ValueError(job.model)
            job = replace(job, sources={n: placed(s) for n, s in job.sources.items()})
            return job, dict(kept["document"])

        try:
            document = json.loads(inside[NAME])
            form = document["fasbody_session"]
            if form in (1, FORM):
                sources = {int(n): placed(Source(**source)) for n, source in document["sources"].items()}
                files = {file.removeprefix("files/"): text for file, text in inside.items() if file != NAME}
                kept = [document["fit"]] if form == 1 else document["fits"]
                fits = tuple(answer(fit) for fit in kept if fit)
                History(fits)  # refuses what is no result
                chosen = len(fits) - 1 if form == 1 else int(document["chosen"])
                rivals = answer(document["rivals"]) if document["rivals"] else None
                current, page = int(document["current"]), dict(document["page"])
                return cls(sources, current, str(document["model"]), fits, chosen, rivals, page, files)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            raise InputFileError(name, "is not a whole session", _VALID) from None
        raise InputFileError(name, f"is a session of form {form}, not {FORM}", "update fasbody, or save it again")
