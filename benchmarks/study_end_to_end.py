"""Time and memory of a virtual study from generation to figures: `python benchmarks/study_end_to_end.py [FORMAT]`.

5 and 20 subjects, three loads, nine frequencies, 10 s at 1 kHz: 135 and 540 recordings. Memory is that of the largest
process; it must not grow with the number of recordings.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

LOADS = ["--posture", "midstance"]


def measured(*command: str) -> tuple[float, float]:
    """Seconds and largest process [MB] so far of a command and its processes."""
    start = time.monotonic()
    subprocess.run([sys.executable, "-m", *command], check=True, capture_output=True)
    return time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def main() -> None:
    """Print time and memory of both sizes."""
    file_format = sys.argv[1] if len(sys.argv) > 1 else "csv"
    print(f"{'recordings':>10} {'command':32} {'s':>6} {'largest process so far, MB':>27}")
    for subjects in (5, 20):
        with tempfile.TemporaryDirectory() as folder:
            study, out = str(Path(folder) / "study"), str(Path(folder) / "out")
            made = ("fasbody.laboratory", study, "--subjects", str(subjects), "--format", file_format, *LOADS)
            for command in (made, ("fasbody.transmissibility", study, "--out", out)):
                seconds, memory = measured(*command)
                name = f"{command[0]} ({file_format})"
                print(f"{subjects * 27:10} {name:32} {seconds:6.0f} {memory:27.0f}", flush=True)


if __name__ == "__main__":
    main()
