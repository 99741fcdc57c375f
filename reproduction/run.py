"""Running rows in processes, keeping each result in a file, and finding it again as long as the code is the same."""

import json
import platform
import time
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from fasbody import runner
from fasbody.console import heeded, to_json
from fasbody.runner import Store
from reproduction.book import ROWS
from reproduction.row import Outcome, Row, Verdict

#: What a result may read of our packages besides their sources.
_DATA = {".xml", ".csv", ".toml", ".json"}
#: Libraries whose version may move a number.
LIBRARIES = ("mujoco", "numba", "numpy", "scipy", "pandas")


@cache
def _data() -> str:
    """Digest of the models, tables and settings beside our sources, which a result may read."""
    ours = (runner.ROOT / package for package in runner.OURS[:3])
    files = (file for folder in ours for file in sorted(folder.rglob("*")) if file.suffix in _DATA)
    return runner.key(*(part for file in files for part in (file.relative_to(runner.ROOT), file.read_bytes())))


def key(row: Row) -> str:
    """What a kept result of `row` must carry to count: its texts, its code with all that it imports, data, versions."""
    module = getattr(row.run, "func", row.run).__module__  # a partial's own module is functools
    versions = platform.python_version(), runner.versions(*LIBRARIES)
    return runner.key(row.id, row.what, row.command, runner.program(module), _data(), *versions)


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
    document, _ = Store(folder).load(row.file, json.loads)
    if not isinstance(document, dict) or document.get("key") != key(row):
        return None
    return document if document.get("verdict") != str(Verdict.FAILED) else None


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
        for _, documents in runner.run(_run_group, tasks, "rows", processes):
            yield from documents


def _run_group(task: tuple[dict[str, str], Path]) -> list[dict[str, Any]]:
    keys, folder = task  # of the code as it was when the run began, whatever is edited meanwhile
    documents = []
    for row in (row for row in ROWS if row.id in keys):
        document = execute(row) | {"key": keys[row.id]}
        Store(folder).save(row.file, to_json(document) + "\n")
        documents.append(document)
    return documents
