"""The fits of a study on disk: one JSON document each, written whole or not at all, by its key."""

import json
import re
from collections import Counter
from collections.abc import Iterable
from typing import Any

from fasbody import runner
from fasbody.console import plain

#: Consequence of a document of this study that cannot be used.
AGAIN = " and is computed again."
#: Entries that a valid document has.
_NEEDED = {"digest", "key", "mode", "subject", "posture", "files", "status", "error", "result", "cycles"}
#: What the name of a document looks like.
_KEY = re.compile("[0-9a-f]{24}")


def _digest(document: dict[str, Any]) -> str:
    """What a plain document's digest must be: of all that it says besides, but for the time that it took."""
    content = {**document, "result": _timeless(document["result"] or {})}
    return runner.key(json.dumps(_timeless(content), sort_keys=True))


def _timeless(content: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in content.items() if name not in ("digest", "seconds")}


class Store(runner.Store):
    """The folder `fits` of a study's results, or `checks`."""

    def write(self, document: dict[str, Any]) -> None:
        """Keep a document under its key, a line for each thing that it says."""
        content = plain(document)
        content["digest"] = _digest(content)
        lines = ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in content.items())
        self.save(f"{document['key']}.json", f"{{\n{lines}\n}}\n")

    def read(self, key: str) -> tuple[dict[str, Any] | None, str]:
        """The document of a key, None if there is none; and a sentence if a file is there that is not it."""
        file = self.folder / f"{key}.json"
        document, problem = self.load(file.name, json.loads)
        if problem or not file.exists():
            return None, problem
        if not isinstance(document, dict) or not document.keys() >= _NEEDED or document["key"] != key:
            return None, f"{file}: is not the fit that its name says{AGAIN}"
        kind = dict if document["status"] == "done" else type(None)
        if document["status"] not in ("done", "failed") or not isinstance(document["result"], kind):
            return None, f"{file}: has no result{AGAIN}"
        if document["digest"] != _digest(document):
            return None, f"{file}: was changed after it was written{AGAIN}"
        return document, ""

    def others(self, keys: Iterable[str]) -> Counter[str]:
        """Modes of the documents that are not of these keys, made with other settings, recordings or program."""
        known, modes = set(keys), Counter[str]()
        for file in sorted(self.folder.glob("*.json")):
            if _KEY.fullmatch(file.stem) and file.stem not in known:
                document = self.load(file.name, json.loads)[0]
                modes[str(document.get("mode")) if isinstance(document, dict) else "unknown"] += 1
        return modes

    def documents(self, keys: Iterable[str]) -> dict[str, dict[str, Any]]:
        """The documents of those keys that are there, by key."""
        return {key: document for key in keys if (document := self.read(key)[0]) is not None}
