"""README.md as a registry shows it: links into the project lead to its repository."""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


def absolute(text: str, repository: str) -> str:
    """A text whose relative links and pictures lead to the repository's files."""
    return re.sub(r"(!?)(\[[^\]]*\])\((?![a-z]+:|#)([^)]+)\)", lambda m: _link(m, repository), text)


def _link(match: re.Match[str], repository: str) -> str:
    kind = "raw" if match[1] else "blob"
    return f"{match[1]}{match[2]}({repository}/{kind}/main/{match[3]})"


class ReadmeHook(MetadataHookInterface):
    """Gives the readme."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Put it into the project's metadata."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {
            "content-type": "text/markdown", "text": absolute(text, metadata["urls"]["Repository"])
        }  # fmt: skip
