"""From a study folder to Figure 2.5: `python examples/transmissibility_figure.py [STUDY] [FIGURE.png]`.

Without a study, a small virtual one is made first.
"""

import sys
import tempfile
from pathlib import Path

from fasbody.laboratory.study import Plan, make
from fasbody.recording.study import StudyFolder
from fasbody.transmissibility import figures
from fasbody.transmissibility.table import Table


def main(study: Path | None = None, figure: Path = Path("loads_mean.png")) -> Table:
    """Draw the means under the loads of the study; return its table."""
    with tempfile.TemporaryDirectory() as folder:
        if study is None:
            loads = tuple(("midstance", mass) for mass in (0.0, 2.3, 4.5))
            study = make(Path(folder) / "study", Plan(subjects=6, seconds=1.0, conditions=loads), processes=1)
        table = Table.of(StudyFolder.open(study))
    print(table)
    for curves in table.each():
        print(f"{curves.title}: {curves.resonance}")
    figure.write_bytes(figures.save(figures.means(table, table.conditions), figure.suffix[1:]))
    return table


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
