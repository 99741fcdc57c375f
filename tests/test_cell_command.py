"""The command from outside: one JSON document, one sentence and exit code 2, whole result files."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cell_cases import CACHE


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "fasbody.cell", *arguments], capture_output=True, text=True, check=False,
        env=os.environ | {"XDG_CACHE_HOME": str(CACHE)},
    )  # fmt: skip


def test_json_and_files(tmp_path: Path) -> None:
    done = command("--preset", "si", "--size", "7", "--modes", "3", "--json", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["preset"] == "si"
    assert len(document["frequencies_hz"]) == len(document["modes"]) == len(document["estimated_error"]) == 3
    assert document["frequencies_hz"][0] == pytest.approx(6400, rel=0.01)
    assert document["volume_m3"] == pytest.approx(1.885e-14, rel=1e-3)
    assert document["modes"][0]["label"] in ("z sway", "x sway")
    assert 0 < document["modes"][0]["nucleus_share"] < 0.1
    assert document["dof"] > 1000
    assert json.loads((tmp_path / "cell.json").read_text()) == document
    assert {file.name for file in tmp_path.iterdir()} == {"cell.json", "cell.vtu", "cell.npz", "modes.png", "mesh.png"}
    assert _is_drawn(tmp_path / "modes.png")
    assert _is_drawn(tmp_path / "mesh.png")


def test_shaking_in_json(tmp_path: Path) -> None:
    done = command("shake", "--size", "8", "--modes", "12", "--json", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert np.allclose(np.array(document["response"]["top_transmissibility_xyz"])[:, 0], 1, atol=1e-4)
    assert document["response"]["resonance_hz_xyz"][0] > 5000
    assert 0 < document["damped_modes"]["damping_ratio"][0] < 0.3
    assert _is_drawn(tmp_path / "shake.png")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--modulus", "0"], "must be a positive number of Pa"),
        (["--modulus", "-3"], "must be a positive number of Pa"),
        (["--poisson", "0.5"], "between -1 and 0.5"),
        (["--nucleus-centre", "8"], "leaves the cell"),
        (["--mesh", "absent.stl"], "absent.stl: there is no such file"),
        (["shake", "--tau", "0"], "relaxation time must be"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_two(arguments: list[str], says: str) -> None:
    done = command(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert says in " ".join(done.stderr.split())
    assert done.stderr.startswith("error:")
    assert "Traceback" not in done.stderr


def _is_drawn(file: Path) -> bool:
    """Not an empty page: many colours."""
    from matplotlib.image import imread

    pixels = imread(file)
    return len(np.unique((pixels.reshape(-1, pixels.shape[2]) * 255).astype(int) @ [1, 256, 65536, 0])) > 100
