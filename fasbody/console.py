"""Ctrl-C is raised once for each key press, is never reported as a failure, and never reaches a worker.

A terminal sends it to every process of a command, `timeout -s INT` twice. Compiled code that it meets makes a
SystemError of it, and a broad `except` of that a failed result. A worker that receives it ends while it holds a lock.

What all commands share: the sentence on bad input, JSON on stdout, progress on stderr, whole files only.
"""

import json
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta
from multiprocessing import resource_tracker
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from fasbody.exceptions import FasError, InputFileError, SettingError, Stopped
from fasbody.progress import Advance, Pace
from fasbody.usage import option_of, sentence

if TYPE_CHECKING:
    from typer import Typer

#: Signals that come within this time were one key press [s].
_TOGETHER_S = 0.5
#: When Ctrl-C was pressed, on the monotonic clock; and how many blocks are to end before it is raised.
_pressed: list[float] = []
_holding = 0


def _press(number: int, frame: FrameType | None) -> None:
    again = bool(_pressed) and time.monotonic() - _pressed[-1] < _TOGETHER_S
    if not again:
        _pressed.append(time.monotonic())
        if not _holding:
            raise KeyboardInterrupt


@contextmanager
def once() -> Iterator[None]:
    """Count a doubled signal once; where Ctrl-C is ignored or handled already, nothing changes."""
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    try:
        signal.signal(signal.SIGINT, _press)
    except ValueError:  # signals are the main thread's, and this is another
        yield
        return
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is _press:
            signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def heeded() -> Iterator[None]:
    """End the block with KeyboardInterrupt if Ctrl-C was pressed in it, also if another exception replaced it."""
    with once():
        before = len(_pressed)
        try:
            yield
        except Exception:
            if len(_pressed) > before:
                raise KeyboardInterrupt from None
            raise
        if len(_pressed) > before:
            raise KeyboardInterrupt


@contextmanager
def held() -> Iterator[None]:
    """Ctrl-C comes when the block has ended; processes and threads started in it never see it."""
    global _holding
    with once():
        before, _holding = len(_pressed), _holding + 1
        try:
            with _deaf_children():
                yield
        finally:
            _holding -= 1
        if len(_pressed) > before:
            raise KeyboardInterrupt


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Block the signal in this thread: its children inherit that. Another thread may still take it for this process."""
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # by multiprocessing; it would unblock the signal when it starts later
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


#: Everything for people goes to stderr, so that ``--json`` leaves one clean document on stdout.
console = Console(stderr=True, highlight=False)
#: Results for people go to stdout, unless ``--json`` has it.
results = Console(highlight=False, width=None if sys.stdout.isatty() else 120)


@dataclass(frozen=True)
class Started:
    """How `fasbody` started a command: as `fasbody plan`, the sub-command `propose` of its module."""

    called: str
    name: str


#: None where a command's module was started.
started: Started | None = None


def run_app(app: "Typer", words: list[str] | None = None, name: str | None = None, default: str = "") -> None:
    """Run a Typer app to its exit.

    Args:
        app: the app.
        words: what follows the name of the command; what was typed unless given.
        name: the command as its help calls it; as it was started unless given.
        default: its sub-command that runs where none is named.

    Raises:
        SettingError: an option or argument does not exist, is missing or has a value that does not fit.
        SystemExit: it has ended.
    """
    import typer

    from fasbody.help import readable

    command = readable(typer.main.get_command(app))
    words, inner = list(sys.argv[1:] if words is None else words), getattr(command, "commands", {})
    renamed = ""
    if default and not (words and words[0] in inner):
        words, renamed = [default, *words], name or ""
    if started is not None:
        name, renamed = started.called, started.called if started.name else ""
    if renamed:  # click puts the two together again
        name, _, last = renamed.rpartition(" ")
        inner[last] = inner.pop(words[0])
        words[0] = last
    try:
        code = command.main(words, prog_name=name, standalone_mode=False)
    except typer.Abort:
        console.print("Aborted.", style="red")
        sys.exit(1)
    except Exception as error:
        if not hasattr(error, "format_message"):  # which all have that Typer would show, and no other
            raise
        if type(error).__name__ == "NoArgsIsHelpError":  # the help is on the screen
            sys.exit(2)
        raise SettingError(sentence(error)) from error
    sys.exit(code or 0)


def command_line(app: "Typer | Callable[[], object]") -> None:
    """Run a command: exit 0 done, 2 bad input (one sentence, no traceback), 130 interrupted, 1 bug.

    Args:
        app: a Typer app, or a function that runs one.
    """
    # small matrix products: threads of the linear algebra would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("MUJOCO_GL", "disable")  # no command draws by OpenGL, whose libraries take 0.1 s to find
    with once():
        try:
            from typer import Typer

            run_app(app) if isinstance(app, Typer) else app()
        except FasError as error:
            option = option_of(error, sys.argv[1:])
            text = f"{option}: {error}" if option else str(error)
            console.print(f"[bold red]error:[/] {escape(text)}", soft_wrap=True)
            sys.exit(2)
        except Stopped as stop:
            _leave_in_peace()
            console.print(str(stop), markup=False, soft_wrap=True)
            sys.exit(130)
        except KeyboardInterrupt:
            _leave_in_peace()
            console.print("interrupted")
            sys.exit(130)
        except SystemExit as stop:
            if stop.code == 130:  # what Typer makes of Ctrl-C
                _leave_in_peace()
                console.print("interrupted")
            raise
        finally:
            while _made:
                with suppress(OSError):  # something is in it
                    _made.pop(0).rmdir()


def _leave_in_peace() -> None:
    """Ignore Ctrl-C from here on: the second signal of a press that comes late would end the exit with another code."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def print_json(document: Any) -> None:
    """Write `document` to stdout as one JSON document (NaN and infinity become null)."""
    print(to_json(document))


def to_json(document: Any) -> str:
    """JSON text of `document`; numpy scalars and arrays become numbers and lists, non-finite numbers null."""
    return json.dumps(plain(document), indent=2, allow_nan=False)


def plain(value: Any) -> Any:
    """A document in the types of JSON: dictionaries, lists, texts, finite numbers, True, False and None."""
    if type(value) is float:
        return value if -float("inf") < value < float("inf") else None
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy scalar or array
        return plain(value.tolist())
    return value if isinstance(value, str | int | bool | None) else str(value)


def write_whole(path: Path, content: str | bytes) -> Path:
    """Write a file so that it is either there whole or not at all: temporary name, then rename.

    Raises:
        InputFileError: the folder cannot be made or written.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            Path(name).chmod(0o644)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputFileError(path, f"cannot be written ({error.strerror})", "name a writable folder") from error
    return path


#: Folders that the command made, the inner ones first; one that is empty goes when the command ends.
_made: list[Path] = []


def make_folder(path: Path) -> Path:
    """Make a folder for results before the work that fills it, so that a wrong name costs no time.

    If the work fails, a new folder in which nothing lies is removed when the command ends.

    Raises:
        InputFileError: it is a file, or cannot be made or written.
    """
    if path.is_file():
        raise InputFileError(path, "is a file", "name a folder")
    missing = [folder.absolute() for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise InputFileError(path, f"cannot be written ({error.strerror})", "name a writable folder") from error
    _made.extend(missing)
    return path


@contextmanager
def progress_bar(*more: ProgressColumn) -> Iterator[Progress]:
    """A progress bar on stderr, with number and time left unless other columns are given.

    Into a pipe it writes nothing, even where colours are forced.
    """
    more = more or (MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    columns = (TextColumn("{task.description}"), BarColumn(), *more)
    drawn = console.is_terminal and console.file.isatty()
    with Progress(*columns, console=console, transient=True, disable=not drawn) as progress:
        yield progress


@contextmanager
def stages() -> Iterator[Advance]:
    """A progress bar of work in stages: yields a callback that takes the stage, what is done, and the total."""
    pace = Pace()
    steps, left = (TextColumn(f"{{task.fields[{field}]}}") for field in ("steps", "left"))
    with progress_bar(steps, TimeElapsedColumn(), left) as progress:
        task = progress.add_task("reading", total=None, steps="", left="")

        def advance(what: str, done: int, total: int) -> None:
            pace.at(done, total)
            left = "" if pace.left_s is None else f"about {timedelta(seconds=round(pace.left_s))} left"
            progress.update(task, description=what, completed=pace.share, total=1.0, steps=f"{done}/{total}", left=left)

        yield advance
