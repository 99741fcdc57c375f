"""The fits of a study on disk: one JSON document each, there whole or not at all, by its key."""

import json
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fasbody import runner
from fasbody.console import plain
from fasbody.exceptions import InputFileError

Document = dict[str, Any]
#: Entries that a valid document has.
_NEEDED = {
    *("digest", "key", "mode", "subject", "posture", "files"),
    *("status", "error", "result", "cycles"),
}
#: What the name of a document looks like.
_KEY = re.compile("[0-9a-f]{24}")


def _digest(document: Document) -> str:
    """What a plain document's digest must be: of all that it says but the time that it took."""

    def timeless(content: Document) -> Document:
        return {name: v for name, v in content.items() if name not in ("digest", "seconds")}

    content = {**timeless(document), "result": timeless(document["result"] or {})}
    return runner.key(json.dumps(content, sort_keys=True))


class Store(runner.Store):
    """The folder `fits` of a study's results, or `checks`."""

    def write(self, document: Document) -> None:
        """Keep a document under its key, a line for each of its entries."""
        content = plain(document)
        content["digest"] = _digest(content)
        lines = ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in content.items())
        self.save(f"{document['key']}.json", f"{{\n{lines}\n}}\n")

    def read(self, key: str) -> tuple[Document | None, str]:
        """The document of a key, None if there is none; and what is wrong with the file, if any."""
        document, problem = self.load(f"{key}.json", json.loads)
        if document is None:
            return None, "is broken" if problem else ""
        if not isinstance(document, dict) or not document.keys() >= _NEEDED or document["key"] != key:
            return None, "is not the fit that its name says"
        kind = dict if document["status"] == "done" else type(None)
        if document["status"] not in ("done", "failed") or not isinstance(document["result"], kind):
            return None, "has no result"
        if document["digest"] != _digest(document):
            return None, "was changed after it was written"
        return document, ""

    def others(self, keys: Iterable[str]) -> Counter[str]:
        """Modes of the documents of other settings, recordings or program than these keys'."""
        known, modes = set(keys), Counter[str]()
        for file in sorted(self.folder.glob("*.json")):
            if _KEY.fullmatch(file.stem) and file.stem not in known:
                document = self.load(file.name, json.loads)[0]
                mode = document.get("mode") if isinstance(document, dict) else "unknown"
                modes[str(mode)] += 1
        return modes

    def documents(self, keys: Iterable[str]) -> dict[str, Document]:
        """The documents of those keys that are there, by key."""
        return {key: document for key in keys if (document := self.read(key)[0]) is not None}


def pooled_fits(results: Path) -> list[Document]:
    """The pooled fits of the results of another study, each subject named with their folder.

    Every laboratory has a subject 1, and a folder of one person has no other.

    Raises:
        InputFileError: there is none, one was altered, or one person has two under the same load.
    """
    store = Store(results / "fits")
    if not store.folder.is_dir():
        raise InputFileError(results, "is no folder of results", "name the --out of another study")
    fits: dict[tuple[Any, ...], Document] = {}
    for file in sorted(store.folder.glob("*.json")):
        document, problem = store.read(file.stem)
        if document is None:
            raise InputFileError(file, problem, "run its study again")
        if document["mode"] != "pooled":
            continue
        who = document["subject"], document["posture"], document["added_mass_kg"]
        if who in fits:
            twice = f"subject {who[0]}, {who[1]}, {who[2]:g} kg"
            problem = f"holds two fits of {twice}, of other settings or recordings"
            raise InputFileError(results, problem, "run its study with one --out for each")
        fits[who] = document
    if not fits:
        command = "fasbody study STUDY --mode pooled --out there"
        raise InputFileError(results, "holds no pooled fits", f"run {command} first")
    name = results.resolve().name
    return [{**fit, "subject": f"{fit['subject']} of {name}"} for fit in fits.values()]
