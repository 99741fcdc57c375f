"""Time and memory of a virtual study from generation to figures: `python -m benchmarks.study_end_to_end`.

5 and 20 subjects, three loads, nine frequencies, 10 s at 1 kHz: 135 and 540 recordings. Memory is that of the largest
process; it must not grow with the number of recordings. Each command runs in a separate process on all cores. The
processes that read binary files outlive their makers by a moment and are not counted; fuzz_readers.py measures them.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.table import report
from fasbody.console import command_line, console
from reproduction.check import Check, at_most, told

_SUBJECTS = (5, 20)
_PER_SUBJECT = 27  # three loads, nine frequencies


#: A small process between: the peak memory of a forked process begins with that of its parent.
_BETWEEN = """
import resource, subprocess, sys, time
start = time.monotonic()
quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
code = subprocess.run([sys.executable, "-m", *sys.argv[1:]], **quiet).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(code, time.monotonic() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


def measured(*command: str) -> tuple[float, float, float]:
    """Wall time and CPU time [s] of a command with its processes, and the largest of these [MB].

    Raises:
        RuntimeError: it fails.
    """
    done = subprocess.run([sys.executable, "-c", _BETWEEN, *command], capture_output=True, text=True, check=True)
    code, wall, cpu, memory = map(float, done.stdout.split())
    if code:
        raise RuntimeError(f"{' '.join(command)} ended with {code:g}")
    return wall, cpu, memory


def measure(file_format: str = "h5", subjects: tuple[int, int] = _SUBJECTS, seconds: float = 10.0) -> list[Check]:
    """Generation and analysis of two studies of different size."""
    rows, largest = [], []
    for count in subjects:
        with tempfile.TemporaryDirectory() as folder:
            study, out = str(Path(folder) / "study"), str(Path(folder) / "out")
            options = ("--subjects", str(count), "--format", file_format, "--seconds", f"{seconds:g}")
            made = measured("fasbody.laboratory", study, *options, "--posture", "midstance")
            used = measured("fasbody.transmissibility", study, "--out", out)
        largest.append(max(made[2], used[2]))
        for what, (wall, cpu, memory) in (("made", made), ("analysed to tables and figures", used)):
            load = os.getloadavg()[0]
            text = (
                f"{cpu:.0f} s of CPU time, {wall:.0f} s on the clock (load {load:.0f}), largest process {memory:.0f} MB"
            )
            rows.append(told(f"{count * _PER_SUBJECT} recordings of {seconds:g} s ({file_format}) {what}", text))
    what = f"largest process with {subjects[1] * _PER_SUBJECT} recordings over that with {subjects[0] * _PER_SUBJECT}"
    return [*rows, at_most(what, largest[1] / largest[0], 1.1, "times")]


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    file_format: Annotated[str, typer.Option("--format", help="csv, mat, h5, uff or tdms")] = "h5",
    json_: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """540 recordings from the laboratory to the figures: time and memory.

    Examples:
      python -m benchmarks.study_end_to_end --format csv
    """
    with console.status("making and analysing two studies"):
        rows = measure(file_format)
    report("Studies end to end", rows, json_)


if __name__ == "__main__":
    command_line(app)
