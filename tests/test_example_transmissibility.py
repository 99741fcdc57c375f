"""The example runs, and its figure is a picture."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
import transmissibility_figure


def test_figure_of_loads(tmp_path: Path) -> None:
    table = transmissibility_figure.main(figure=tmp_path / "a.png")
    assert len(table.conditions) == 3
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
