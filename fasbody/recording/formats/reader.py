"""Binary files are read by a child process with limited memory and time, whatever their header makes a library do.

The parsers of these formats are large C or Python libraries; a mutated file makes some of them crash, loop or allocate.
The child (`python -m fasbody.recording.formats.reader`) stays alive between files, takes a path, and returns JSON and
the raw samples: nothing is pickled, and nothing in a file is executed.
"""

import atexit
import contextlib
import gzip
import importlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import fields
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.formats import READ, ending
from fasbody.recording.formats.series import MOST_SAMPLES, FormatError, Series, check_size, need, told_apart

#: Address space of the child [bytes], and the time on the clock that it may take for one file [s]: only a library that
#: waits for something takes so long, as its computing is limited too, and a busy machine takes a minute to start it.
MEMORY = 1_000_000_000
PATIENCE_S = 300.0
#: Its time of computing for one file [s], and more for each megabyte; a damaged file loops, and a busy machine is slow.
COMPUTING_S, COMPUTING_S_PER_MB = 5.0, 4.0
_LARGEST_FILE = 500_000_000
_child: "_Child | None" = None
_lock = threading.Lock()


def read_series(file: Path, patience_s: float | None = None) -> list[Series]:
    """All numeric columns of a binary file, and by name what else there is.

    Args:
        file: to read.
        patience_s: on the clock, None for five minutes and more for a large file.

    Raises:
        InputFileError: no such file, too large, or not of the format of its ending.
        SettingError: the format's library is not installed.
    """
    if not file.is_file():
        raise InputFileError(file, "no such file" if not file.is_dir() else "is a folder, not a file")
    if file.stat().st_size > _LARGEST_FILE:
        raise InputFileError(file, f"is larger than {_LARGEST_FILE // 1_000_000} MB", "split it into recordings")
    need(_format(file).LIBRARY)
    longest = max(PATIENCE_S, 2 * computing_s(file)) if patience_s is None else patience_s
    with _lock:
        child = _reader()
        try:
            header, values = child.ask(file, longest)
        except TimeoutError:
            end_child()
            raise InputFileError(file, f"could not be read within {longest:g} s", "the file is broken") from None
        except (EOFError, OSError, ValueError):
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.process.wait(1.0)  # it has ended; its return code states why
            end_child()
            if child.process.returncode == -getattr(signal, "SIGXCPU", 0):
                what = f"could not be read within {computing_s(file)} s of computing"
                raise InputFileError(file, what, "the file is broken") from None
            raise InputFileError(file, "breaks its reader (it is damaged, or made to do so)") from None
    if "problem" in header:
        raise InputFileError(file, header["problem"])
    return [Series(values=x, **about) for about, x in zip(header["series"], values, strict=True)]


def computing_s(file: Path) -> int:
    """Seconds of computing that a file may take."""
    return round(COMPUTING_S + COMPUTING_S_PER_MB * file.stat().st_size / 1e6)


def _reader() -> "_Child":
    global _child
    if _child is None or not _child.usable():
        end_child()
        _child = _Child()
    return _child


@atexit.register
def end_child() -> None:
    """End the reading process, if there is one; the next file starts another."""
    global _child
    if _child is not None:
        _child.stop()
        _child = None


def _format(file: Path):  # type: ignore[no-untyped-def]
    end = ending(file)
    if end not in READ:
        raise SettingError(f"{file}: no format has the ending {end!r} (valid: {', '.join(READ)}).")
    return importlib.import_module(f"fasbody.recording.formats.{READ[end]}")


@contextlib.contextmanager
def _unpacked(file: Path) -> Iterator[Path]:
    """The file, or for a time what is packed in it as `.gz`."""
    if file.suffix.lower() != ".gz":
        yield file
        return
    with tempfile.TemporaryDirectory() as folder:
        plain, size = Path(folder) / file.stem, 0
        with gzip.open(file, "rb") as packed, plain.open("wb") as out:
            while part := packed.read(1 << 20):
                size += len(part)
                if size > _LARGEST_FILE:
                    raise FormatError(f"unpacks to more than {_LARGEST_FILE // 1_000_000} MB; split it into recordings")
                out.write(part)
        yield plain


class _Child:
    def __init__(self) -> None:
        threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
        paths = os.pathsep.join([str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")])
        self.owner = os.getpid()
        self.pipe, other = multiprocessing.Pipe()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "fasbody.recording.formats.reader", str(other.fileno())], pass_fds=[other.fileno()],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env={**os.environ, **threads, "PYTHONPATH": paths, "HDF5_PLUGIN_PRELOAD": "::"},  # no HDF5 plug-ins
        )  # fmt: skip
        other.close()

    def usable(self) -> bool:
        """Alive, and ours: after a fork the pipe belongs to the parent."""
        return self.owner == os.getpid() and self.process.poll() is None

    def stop(self) -> None:
        """End it; after a fork only the pipe is closed, for the process is the parent's."""
        if self.owner == os.getpid():
            self.process.kill()
            self.process.wait()
        self.pipe.close()

    def ask(self, file: Path, patience_s: float) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Header and samples of a file; TimeoutError or EOFError if the child does not reply."""
        self.pipe.send_bytes(os.fsencode(file.resolve()))
        if not self.pipe.poll(patience_s):
            raise TimeoutError
        header = json.loads(self.pipe.recv_bytes(_LARGEST_FILE))
        values = [np.frombuffer(self.pipe.recv_bytes(8 * MOST_SAMPLES)).copy() for _ in header.get("series", ())]
        return header, values


def serve(pipe: Connection) -> None:
    """The child: read the files that are named, and return the samples of each."""
    while True:
        file, series = Path(os.fsdecode(pipe.recv_bytes())), list[Series]()
        try:
            allow(computing_s(file))
            with _unpacked(file) as plain:
                series = told_apart(_format(file).decode(plain))
            check_size(sum(s.values.size for s in series), len(series))
            if all(s.what for s in series):
                others = ", ".join(f"{s.name!r} is {s.what}" for s in series[:5])
                raise FormatError(f"holds no numeric channel{others and f' ({others})'}; save plain real vectors")
            names = [f.name for f in fields(Series) if f.name != "values"]
            header: dict[str, Any] = {"series": [{name: getattr(s, name) for name in names} for s in series]}
        except FormatError as error:
            header = {"problem": str(error)}
        except MemoryError:
            header = {"problem": "needs more memory than a recording can (its header is damaged)"}
        except Exception:
            # Any error of a parser on a file from outside is a broken file; its message would not help a user.
            what = "it is damaged, cut off, or of another format"
            header = {"problem": f"is not a sound {ending(file)} file; {what}"}
        pipe.send_bytes(json.dumps(header).encode())
        for s in series if "series" in header else ():
            pipe.send_bytes(np.ascontiguousarray(s.values, float).tobytes())


def allow(seconds: int) -> None:
    """End this process when it has computed for so many more seconds; the next file sets the limit anew."""
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    end = round(used.ru_utime + used.ru_stime + 0.5) + seconds
    resource.setrlimit(resource.RLIMIT_CPU, (end, resource.getrlimit(resource.RLIMIT_CPU)[1]))


if __name__ == "__main__":
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(EOFError):  # nobody asks any more
        serve(Connection(int(sys.argv[1])))
