"""What all commands share: the sentence on bad input, JSON on stdout, progress on stderr, whole files only."""

import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from fasbody.exceptions import FasError, InputFileError, Stopped
from fasbody.interrupt import once

#: Everything for people goes to stderr, so that ``--json`` leaves one clean document on stdout.
console = Console(stderr=True, highlight=False)
#: Results for people go to stdout, unless ``--json`` has it.
results = Console(highlight=False, width=None if sys.stdout.isatty() else 120)


def command_line(app: Callable[[], object]) -> None:
    """Run a Typer app (any callable): exit 0 done, 2 bad input (one sentence, no traceback), 130 interrupted, 1 bug."""
    with once():
        try:
            app()
        except FasError as error:
            console.print(f"[bold red]error:[/] {_escape(str(error))}", soft_wrap=True)
            sys.exit(2)
        except Stopped as stop:
            console.print(str(stop), markup=False, soft_wrap=True)
            sys.exit(130)
        except KeyboardInterrupt:
            console.print("interrupted")
            sys.exit(130)
        except SystemExit as stop:
            if stop.code == 130:  # what Typer makes of Ctrl-C
                console.print("interrupted")
            raise


def print_json(document: Any) -> None:
    """Write `document` to stdout as one JSON document (NaN and infinity become null)."""
    print(to_json(document))


def to_json(document: Any) -> str:
    """JSON text of `document`; numpy scalars and arrays become numbers and lists, non-finite numbers null."""
    return json.dumps(_plain(document), indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy scalar or array
        return _plain(value.tolist())
    if isinstance(value, float) and not (-float("inf") < value < float("inf")):
        return None
    return value if isinstance(value, str | int | float | bool | None) else str(value)


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


def make_folder(path: Path) -> Path:
    """Make a folder for results before the work that fills it, so that a wrong name costs no time.

    Raises:
        InputFileError: it is a file, or cannot be made or written.
    """
    if path.is_file():
        raise InputFileError(path, "is a file", "name a folder")
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise InputFileError(path, f"cannot be written ({error.strerror})", "name a writable folder") from error
    return path


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A progress bar on stderr, drawn only on a terminal."""
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress


def _escape(text: str) -> str:
    return text.replace("[", r"\[")
