"""A long CSV: seconds and memory to read it and to check it, each in a process of its own."""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, make_folder
from reproduction.check import Check, at_most, told

#: Sampling rate [Hz], bytes of a row, and rows written at a time.
_RATE_HZ, _ROW, _ROWS = 4000, 30, 500_000
#: Less than this is wanted [GB].
_MOST_GB = 1.0


def written(file: Path, megabytes: int) -> int:
    """Write a recording of a sine of 20 Hz with noise; the number of its samples."""
    rng, count = np.random.default_rng(0), round(megabytes * 1e6 / _ROW)
    with file.open("w") as out:
        out.write("time_s,base_m_s2,malleolus_m_s2\n")
        for first in range(0, count, _ROWS):
            t = np.arange(first, min(count, first + _ROWS)) / _RATE_HZ
            turn = np.exp(40j * np.pi * t)
            moves = [(8.95 * H * turn).real + 0.05 * rng.standard_normal(t.size) for H in (1.0, 1.3 * np.exp(-0.44j))]
            np.savetxt(out, np.column_stack([t, *moves]), fmt=("%.5f", "%.6f", "%.6f"), delimiter=",")
    return count


def cost(file: Path, checked: bool) -> None:
    """Read a file, perhaps check it, and print seconds and the largest memory [GB]; in a process of its own."""
    from fasbody.recording.checks import understood
    from fasbody.recording.recording import Recording

    start = time.perf_counter()
    recording = Recording.read(file)
    if checked:
        assert not understood(recording)["problem"]
    seconds = time.perf_counter() - start
    print(seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)


def measure(megabytes: int) -> list[Check]:
    """Both costs, and how many samples there are."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        file = make_folder(Path(folder) / "long") / "long.csv"
        count = written(file, megabytes)
        size = f"{file.stat().st_size / 1e6:.0f} MB of CSV, {count:,} samples"
        for what, checked in (("read", False), ("read and checked", True)):
            words = f"from benchmarks.long_file import *; cost(Path({str(file)!r}), {checked})"
            done = subprocess.run([sys.executable, "-c", words], check=True, capture_output=True, text=True)
            seconds, memory = map(float, done.stdout.split())
            rows.append(told(f"{size}: {what}", f"{seconds:.1f} s"))
            largest = f"{size}: largest memory, {what}"
            rows.append(told(largest, f"{memory:.2f} GB") if checked else at_most(largest, memory, _MOST_GB, "GB"))
    return rows


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    megabytes: Annotated[int, typer.Option(min=1, max=480, help="size of the file")] = 380, json_: JsonOption = False
) -> None:
    """Seconds and memory that a long CSV takes.

    Examples:
      python -m benchmarks.long_file --megabytes 380
    """
    report("A long CSV", measure(megabytes), json_)


if __name__ == "__main__":
    command_line(app)
