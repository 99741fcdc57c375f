"""Rows of a study that takes hours: kept in a file as they come, and not computed again while their sources stay."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def digest(files: Iterable[Path], more: str = "") -> str:
    """Digest of everything that a row depends on: files, and further text."""
    sha = hashlib.sha256(more.encode())
    for file in sorted(files):
        sha.update(file.read_bytes())
    return sha.hexdigest()[:16]


def fit_sources() -> list[Path]:
    """Files on which the result of a fit depends: fit, models and readers."""
    rooms = ("identification", "fasbody/foot", "fasbody/recording", "mjcf")
    return [file for room in rooms for file in (ROOT / room).rglob("*") if file.suffix in (".py", ".xml")]


@dataclass(frozen=True)
class Kept:
    """A file with a JSON document a line, each with the digest of its sources."""

    file: Path
    digest: str

    def rows(self) -> list[dict[str, Any]]:
        """What was computed from these sources; a line cut off by an interruption is left out."""
        kept = []
        for line in self.file.read_text().splitlines() if self.file.is_file() else []:
            try:
                row = json.loads(line)
            except ValueError:
                continue
            if row.pop("digest", None) == self.digest:
                kept.append(row)
        return kept

    def add(self, row: Mapping[str, Any]) -> None:
        """Append one row."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        with self.file.open("a") as file:
            file.write(json.dumps({**row, "digest": self.digest}) + "\n")
