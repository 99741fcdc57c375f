"""What an analysis keeps on disk to be resumed: one JSON document a law and window, found again by its key."""

import json
from pathlib import Path

from fasbody.console import to_json, write_whole
from identification.heel.study import Document

#: What a document must hold to be believed.
_NEEDED = {"key", "law", "window", "persons", "misfit", "other_speed", "other_person"}


def write(folder: Path, document: Document) -> None:
    """Keep a document."""
    write_whole(folder / f"{document['key']}.json", to_json(document) + "\n")


def read(folder: Path, key: str) -> Document | None:
    """The document of a key; None if it is not there or is broken, and then is computed again."""
    try:
        found = json.loads((folder / f"{key}.json").read_bytes())
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and found.keys() >= _NEEDED and found["key"] == key else None
