"""From a shaker to a study without hardware: `python examples/acquire_virtual_bench.py [FIGURE.png]`.

A virtual board and generator (processes on pseudo-terminals) shake the MuJoCo foot in real time; the acquisition drives
them as it would real ones, and writes a study. Needs `pip install 'fasbody[acquire]'`.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from matplotlib.figure import Figure

from fasbody.presentation import PAGE, printed, write_figure
from fasbody.recording.study import Study


@printed
def main(picture: Path = Path("acquire_virtual_bench.png"), seconds: float = 2.0) -> Study:
    """Record at 15 and 30 Hz, draw a quarter of a second of each; return the study."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["--simulate", "--sweep", "15:30:15", "--seconds", f"{seconds:g}"]
        subprocess.run([sys.executable, "-m", "fasbody.acquire", *words, "--out", f"{folder}/study"], check=True)
        study = Study.read(Path(folder) / "study")
    figure = Figure(figsize=(PAGE, 4), layout="constrained")
    for ax, recording in zip(figure.subplots(len(study.recordings), sharex=True), study.recordings, strict=True):
        shown = recording.time_s < 0.25
        ax.plot(1e3 * recording.time_s[shown], recording.base_m_s2[shown], ".-", ms=3, color="0.5", label="base")
        ax.plot(1e3 * recording.time_s[shown], recording.malleolus_m_s2[shown], ".-", ms=3, label="malleolus")
        ax.set_title(f"{recording.condition.frequency_hz:g} Hz, as recorded", loc="left")
        ax.set_ylabel("m/s$^2$")
    ax.set_xlabel("time [ms]")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper right", ncols=2)
    write_figure(figure, picture)
    return study


if __name__ == "__main__":
    print(main(*map(Path, sys.argv[1:2])))
