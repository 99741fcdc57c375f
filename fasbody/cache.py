"""Where the user keeps what takes long to make."""

import os
from pathlib import Path


def folder(kind: str) -> Path:
    """``$XDG_CACHE_HOME/fasbody/<kind>``, else in ``~/.cache``."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "fasbody" / kind
