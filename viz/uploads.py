"""Files that were dropped on the page, kept in a folder of the session: names, kinds and sizes are checked."""

import re
import unicodedata
from pathlib import Path, PurePosixPath

from fasbody.console import write_whole
from fasbody.exceptions import SettingError
from fasbody.recording.files import TEXTS
from fasbody.recording.formats import READ, ending
from viz.archive import unpacked
from viz.source import Source, study_files

#: Largest dropped file [bytes], and how much and how many files a session may hold.
LARGEST, MOST, FILES = 64_000_000, 512_000_000, 500
#: Parts of a dropped file's name: folders, and the file; and the longest of them [bytes].
DEEP, LONGEST = 4, 200
#: What some systems do not take in a name, and names that are devices there.
_REFUSED = re.compile(r'[<>:"|?*]|^(?=(?:con|prn|aux|nul|com\d|lpt\d)(?:\.|$))', re.IGNORECASE)
#: Folders of sessions that were opened.
_OPENED = "session-"
#: Files that belong to a study beside its recordings.
_BESIDE = {"study.toml", "subjects.csv", "recordings.csv", "truth.json"}


def keep(folder: Path, name: str, content: bytes) -> list[str]:
    """Keep a dropped file in a session's folder, or what a zip file holds; the names that are kept.

    Raises:
        SettingError: no name of a file, of no format that is read, or too large. InputFileError: no zip file.
    """
    if Path(name).suffix.lower() != ".zip":
        return [_keep(folder, name, content)]
    inside = unpacked(name[:80], content, LARGEST, MOST, FILES)
    return [_keep(folder, f"{Path(name).stem}/{file}", text) for file, text in inside if _is_read(Path(file))]


def _keep(folder: Path, name: str, content: bytes) -> str:
    kept = safe(name)
    if not kept:
        raise SettingError(f"{name[:80]!r} is no name for a file; use printable characters, with no dot in front.")
    file = PurePosixPath(kept)
    if not _is_read(Path(kept)):
        valid = ", ".join(dict.fromkeys((*TEXTS, *READ, ".zip")))
        raise SettingError(f"{file.name}: no format has the ending {ending(Path(kept))!r}; valid: {valid}.")
    if len(content) > LARGEST:
        raise SettingError(f"{file.name} is larger than {LARGEST // 1_000_000} MB; split it into recordings.")
    others = [f for f in folder.rglob("*") if f.is_file() and f != folder / kept]
    if sum(f.stat().st_size for f in others) + len(content) > MOST or len(others) >= FILES:
        raise SettingError("this session holds as many files as it may; remove some, or start another one.")
    write_whole(folder / kept, content)
    return kept


def sources(folder: Path, names: list[str]) -> list[Source]:
    """The recordings among kept files, or those of the studies among them."""
    kept = [name for name in map(safe, names) if name and (folder / name).is_file()]
    tables = [folder / name for name in kept if PurePosixPath(name).name == "recordings.csv"]
    if tables:
        return [Source(file, str(table.parent)) for table in tables for file in study_files(table.parent)]
    recordings = [n for n in kept if PurePosixPath(n).name not in _BESIDE and ending(Path(n)) in (*TEXTS, *READ)]
    return [Source.bare(name, str(folder)) for name in recordings]


def _is_read(file: Path) -> bool:
    """Whether a file is a recording by its ending, or belongs to one."""
    return ending(file) in (*TEXTS, *READ, ".json", ".toml") or file.name in _BESIDE


def safe(name: str) -> str:
    """The name that a dropped file is kept under, inside the session's folder; empty where there is none for it."""
    parts = [_REFUSED.sub("_", unicodedata.normalize("NFC", part)) for part in PurePosixPath(name).parts]
    good = all(part.isprintable() and part[0] != "." and "\\" not in part for part in parts)
    good = good and not name.startswith("/") and all(len(part.encode()) <= LONGEST for part in parts)
    return "/".join(parts) if good and 0 < len(parts) <= DEEP else ""


def fresh(folder: Path) -> Path:
    """Where the files of a session that is opened are to lie."""
    return next(place for k in range(1, 10_000) if not (place := folder / f"{_OPENED}{k}").exists())


def places(folder: Path, used: set[Path]) -> dict[str, str]:
    """Folders of recordings -> where they lie in a session's file: as they were dropped, each for itself."""
    inside: dict[str, str] = {}
    for place in sorted(used):
        parts = place.relative_to(folder).parts
        name = "/".join(parts[1:] if parts and parts[0].startswith(_OPENED) else parts)
        names = (name, *(f"{name}_{k}".lstrip("/") for k in range(2, 1000)))
        inside[str(place)] = next(free for free in names if free not in inside.values())
    return inside


def inside(place: Path, folder: Path) -> list[Path]:
    """The files of a folder of recordings; of the session's own those that were dropped as they are."""
    files = [file for file in place.rglob("*") if file.is_file() and _is_read(file) and file.name[0] != "."]
    within = [file.relative_to(folder).parts[0] for file in files]
    other = place != folder
    return [f for f, first in zip(files, within, strict=True) if other or not first.startswith((_OPENED, "results"))]
