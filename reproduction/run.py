"""Running rows in processes, keeping each result in a file, and finding it again as long as the code is the same."""

import hashlib
import json
import platform
import re
import time
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mjcf
import reproduction
from fasbody.console import heeded, to_json, write_whole
from fasbody.parallel import run
from reproduction.book import ROWS
from reproduction.row import Outcome, Row, Verdict

ROOT = Path(reproduction.__file__).parent.parent
#: What a result depends on besides the rows of its own file.
PACKAGES = ("fasbody", "identification", "mjcf")
LIBRARIES = ("mujoco", "numba", "numpy", "scipy", "pandas")
_SUFFIXES = {".py", ".xml", ".csv", ".toml", ".json"}


@cache
def code_key() -> str:
    """Hash of the packages' sources and data, and of the versions of Python and the libraries."""
    digest = hashlib.sha256(f"{platform.python_version()} {versions()}".encode())
    for package in PACKAGES:
        for file in sorted((Path(mjcf.__file__).parent.parent / package).rglob("*")):
            if file.suffix in _SUFFIXES:
                digest.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


def versions() -> str:
    """Libraries whose version may move a number."""
    return ", ".join(f"{name} {version(name)}" for name in LIBRARIES)


def key(row: Row) -> str:
    """What a kept result of `row` must carry to count: hash of the code, the row's texts, its file and its imports."""
    digest = hashlib.sha256(f"{code_key()} {row.id} {row.what} {row.command}".encode())
    for file in sorted(_sources(getattr(row.run, "func", row.run).__module__)):  # a partial's own module is functools
        digest.update(file.read_bytes())
    return digest.hexdigest()


@cache
def _sources(module: str) -> frozenset[Path]:
    """The file of a module of this package and those of its modules that it imports, and so on."""
    found, waiting = set(), {module}
    while waiting:
        file = ROOT / (waiting.pop().replace(".", "/") + ".py")
        if file not in found:
            found.add(file)
            waiting |= set(re.findall(r"^from (reproduction\.\w+) import", file.read_text(), re.MULTILINE))
    return frozenset(found)


def execute(row: Row) -> dict[str, Any]:
    """Run one row; what it raises makes it failed, in a sentence."""
    about = {"id": row.id, "what": row.what, "command": row.command}
    began = time.process_time()
    try:
        with heeded():
            outcome = row.run().document() | {"error": None}
    except Exception as error:  # a row that raises is a result, too
        outcome = Outcome().document() | {"error": f"{type(error).__name__}: {error}"}
    return about | outcome | {"cpu_seconds": time.process_time() - began}


def kept(row: Row, folder: Path) -> dict[str, Any] | None:
    """The result of an earlier run by the same code, if there is one; failures are run again."""
    try:
        document = json.loads((folder / row.file).read_text())
    except (OSError, ValueError):
        return None
    same = isinstance(document, dict) and document.get("key") == key(row)
    return document if same and document.get("verdict") != str(Verdict.FAILED) else None


def run_rows(rows: Sequence[Row], folder: Path, fresh: bool = False, processes: int = 2) -> Iterator[dict[str, Any]]:
    """Results as they come, those kept from earlier runs first; each is written to `folder` the moment it is there.

    Args:
        rows: which. folder: where results are kept. fresh: run all again. processes: how many; 1 stays in this one.

    Raises:
        InputFileError: the folder cannot be written. FasError: a process was ended by the system.
    """
    groups: dict[str, dict[str, str]] = {}
    for row in rows:
        document = None if fresh else kept(row, folder)
        if document is not None:
            yield document
        else:
            groups.setdefault(row.group, {})[row.id] = key(row)
    tasks = [(keys, folder) for keys in sorted(groups.values(), key=len, reverse=True)]
    if tasks:
        for _, documents in run(_run_group, tasks, "rows", processes):
            yield from documents


def _run_group(task: tuple[dict[str, str], Path]) -> list[dict[str, Any]]:
    keys, folder = task  # of the code as it was when the run began, whatever is edited meanwhile
    documents = []
    for row in (row for row in ROWS if row.id in keys):
        document = execute(row) | {"key": keys[row.id]}
        write_whole(folder / row.file, to_json(document) + "\n")
        documents.append(document)
    return documents
