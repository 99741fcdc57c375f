"""The fits of a study on disk: one JSON document each, there whole or not at all, found again by its key."""

import json
import re
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fasbody.console import make_folder, to_json, write_whole

#: What a document must hold to be believed.
_NEEDED = {"key", "mode", "subject", "posture", "files", "status", "error", "result", "cycles"}
#: Age of an unfinished file that no running study can still be writing [s].
_STALE = 3600.0
#: What the name of a document looks like.
_KEY = re.compile("[0-9a-f]{24}")


@dataclass(frozen=True)
class Store:
    """The folder `fits` of a study's results, or `checks`."""

    folder: Path

    def make(self) -> None:
        """Make the folder, and clear away what a killed run left half written.

        Raises:
            InputFileError: it cannot be made or written.
        """
        make_folder(self.folder)
        for left in self.folder.glob(".*.json.*"):
            if time.time() - left.stat().st_mtime > _STALE:
                left.unlink(missing_ok=True)

    def path(self, key: str) -> Path:
        """Where the document of a key is or will be."""
        return self.folder / f"{key}.json"

    def write(self, document: dict[str, Any]) -> None:
        """Keep a document under its key."""
        write_whole(self.path(document["key"]), to_json(document) + "\n")

    def read(self, key: str) -> tuple[dict[str, Any] | None, str]:
        """The document of a key, None if there is none; and a sentence if a file is there that is not it."""
        file = self.path(key)
        try:
            found = json.loads(file.read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            return None, ""
        except (ValueError, OSError):
            return None, f"{file}: is broken and is computed again."
        if not isinstance(found, dict) or not found.keys() >= _NEEDED or found["key"] != key:
            return None, f"{file}: is not the fit that its name says and is computed again."
        if found["status"] not in ("done", "failed") or (found["result"] is None) == (found["status"] == "done"):
            return None, f"{file}: has no result and is computed again."
        return found, ""

    def others(self, keys: Iterable[str]) -> int:
        """How many documents are there that are not of these keys: made with other settings, recordings or program."""
        known = set(keys)
        return sum(bool(_KEY.fullmatch(file.stem)) and file.stem not in known for file in self.folder.glob("*.json"))

    def documents(self, keys: Iterable[str]) -> list[dict[str, Any]]:
        """The documents of those keys that are there."""
        found = (self.read(key)[0] for key in keys)
        return [document for document in found if document is not None]
