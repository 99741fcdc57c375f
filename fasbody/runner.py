"""Long work: on all cores with one progress bar, and kept in whole files, so that it goes on where it was stopped.

A result is found again by its key. That holds what went into the result and the sources that computed it, so an edited
program computes anew. Ctrl-C ends the processes at once; what was written stays.
"""

import ast
import hashlib
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import TypeVar

import fasbody
from fasbody.console import heeded, held, make_folder, progress_bar, write_whole
from fasbody.exceptions import FasError

Task = TypeVar("Task")
Result = TypeVar("Result")
#: Fewer jobs than this are done here: starting processes takes longer.
_FEW = 40
#: Tasks a process that are taken ahead, so that none waits for its next one.
_AHEAD = 2
#: Environment of a process whose linear algebra has one thread: small matrices only wait for more.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
#: Our packages: what a result's module imports of them is part of its key.
OURS = ("fasbody", "identification", "mjcf", "reproduction")
ROOT = Path(fasbody.__file__).parent.parent
#: Print, spread and keep, and change no result.
_ASIDE = {ROOT / "fasbody" / name for name in ("console.py", "presentation.py", "runner.py")}
#: Age from which an unfinished file is left over from a process that ended [s].
_STALE_S = 3600.0


def run(
    function: Callable[[Task], Result], tasks: Sequence[Task], description: str, processes: int = 0
) -> Iterator[tuple[int, Result]]:
    """Yield (index, result) of each task as it ends; results are not kept. Ctrl-C ends the processes at once.

    Args:
        function: importable, of one argument.
        tasks: its arguments.
        description: for the progress bar.
        processes: 0 for all cores; 1, or few tasks, stay in this process.

    Raises:
        FasError: what `function` raises; or the machine ended a process.
    """
    count = processes or cores()
    alone = count == 1 or (len(tasks) < _FEW and not processes)
    done = in_turn(function, tasks) if alone else spread(function, tasks, count)
    with progress_bar() as progress:
        bar = progress.add_task(description, total=len(tasks))
        for index, result in done:
            yield index, result
            progress.advance(bar)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_turn(function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
    """Run the tasks one after another in this process; Ctrl-C ends the current one."""
    for index, task in enumerate(tasks):
        with heeded():
            result = function(task)
        yield index, result


def spread(function: Callable[[Task], Result], tasks: Iterable[Task], count: int) -> Iterator[tuple[int, Result]]:
    """Run the tasks on so many processes; a task is taken when its turn comes, and results come as they are ready.

    Raises:
        FasError: what `function` raises; or the machine ended a process.
    """
    waiting, jobs = enumerate(tasks), dict[Future[Result], int]()
    with _pool(count) as pool:
        try:
            while True:
                for index, task in islice(waiting, _AHEAD * count - len(jobs)):
                    with held():  # processes are started here, as tasks come in
                        jobs[pool.submit(function, task)] = index
                if not jobs:
                    return
                for job in wait(jobs, return_when=FIRST_COMPLETED).done:
                    yield jobs.pop(job), job.result()
        except BrokenProcessPool:
            raise FasError("a worker process was ended by the system; memory may be short.") from None


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes whose linear algebra has one thread; after an exception they are not waited for."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    others = set(multiprocessing.active_children())
    os.environ.update(ONE_THREAD)  # processes times threads must not exceed the cores
    # spawn, not fork: the progress bar runs a thread
    pool = ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@dataclass(frozen=True)
class Store:
    """A folder of results, one file each, there whole or not at all."""

    folder: Path

    def make(self) -> None:
        """Make the folder, and clear away what a killed run left half written.

        Raises:
            InputFileError: it cannot be made or written.
        """
        make_folder(self.folder)
        for left in self.folder.glob(".*.*.????????"):  # the temporary names of `write_whole`
            if time.time() - left.stat().st_mtime > _STALE_S:
                left.unlink(missing_ok=True)

    def load(self, name: str, decode: Callable[[bytes], Result]) -> tuple[Result | None, str]:
        """What a file holds, None if there is none; and a sentence if it is there but cannot be decoded."""
        file = self.folder / name
        try:
            return decode(file.read_bytes()), ""
        except (FileNotFoundError, NotADirectoryError):
            return None, ""
        except Exception:  # a damaged file may raise anything in its reader
            return None, f"{file}: is broken and is computed again."

    def save(self, name: str, content: str | bytes) -> Path:
        """Keep a result under its name.

        Raises:
            InputFileError: the folder cannot be written.
        """
        return write_whole(self.folder / name, content)


def key(*parts: object) -> str:
    """What a kept result must carry to count: a digest of what went into it, such as inputs and `program`."""
    digest = hashlib.sha256()
    for part in parts:
        text = part if isinstance(part, bytes) else str(part).encode()
        digest.update(len(text).to_bytes(8, "little") + text)
    return digest.hexdigest()[:24]


@cache
def program(module: str) -> str:
    """Digest of the sources that compute what a module computes, which is more than a version says."""
    return key(*(part for file in sources(module) for part in (_place(file), file.read_bytes())))


def sources(module: str) -> list[Path]:
    """The files that compute a result: a module of ours, what it imports of ours, and what that imports in turn."""
    files: set[Path] = set()
    waiting = _files(module)
    while waiting:
        file = waiting.pop()
        if file not in files:
            files.add(file)
            waiting += _imported(file)
    return sorted(files - _ASIDE)


@cache
def _imported(file: Path) -> tuple[Path, ...]:
    """Files of ours that a file imports, for types alone not; of one that imports by name all that lie beside it."""
    text, names = file.read_text(encoding="utf-8"), set()
    waiting: list[ast.AST] = [ast.parse(text)]
    while waiting:  # statements alone: expressions are most of a file, and import nothing
        node = waiting.pop()
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        typed = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for block in ("orelse", "finalbody", "handlers", "cases", *(() if typed else ("body",))):
            waiting += getattr(node, block, ())
    beside = file.parent.glob("*.py") if "importlib.import_module(" in text else ()
    return (*(path for name in sorted(names) for path in _files(name)), *beside)


def _files(module: str) -> list[Path]:
    place = ROOT.joinpath(*module.split("."))
    files = (place.with_suffix(".py"), place / "__init__.py") if module.split(".")[0] in OURS else ()
    return [file for file in files if file.is_file()]


def _place(file: Path) -> str:
    return file.relative_to(ROOT).as_posix()


@cache
def versions(*libraries: str) -> str:
    """Name and version of each library."""
    return ", ".join(f"{name} {version(name)}" for name in libraries)
