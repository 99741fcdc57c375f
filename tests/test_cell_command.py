"""The command from outside: one JSON document, one sentence and exit code 2, whole result files."""

import json
import subprocess
from pathlib import Path

import in_process
import numpy as np
import pytest
from typer.testing import CliRunner

from fasbody.cell.__main__ import app
from fasbody.exceptions import SettingError
from simulator.bodies import CACHE


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(CACHE))


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return in_process.command("fasbody.cell", *arguments)


@pytest.mark.long
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


@pytest.mark.long
def test_shaking_in_json(tmp_path: Path) -> None:
    done = command("shake", "--size", "8", "--modes", "12", "--json", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert np.allclose(np.array(document["response"]["top_transmissibility_xyz"])[:, 0], 1, atol=1e-4)
    assert document["response"]["resonance_hz_xyz"][0] > 5000
    assert 0 < document["damped_modes"]["damping_ratio"][0] < 0.3
    assert _is_drawn(tmp_path / "shake.png")


@pytest.mark.parametrize(
    ("arguments", "setting"),
    [
        (["--modulus", "0"], "modulus"),
        (["--nucleus-modulus", "-3"], "nucleus_modulus"),
        (["--poisson", "0.5"], "poisson"),
        (["--density", "0"], "density"),
        (["--size", "0"], "size"),
        (["--size", "0.05"], "size"),
        (["--filaments", "-1"], "filaments"),
        (["--shape", "40x100"], "shape"),
        (["--profile", "cone"], "profile"),
        (["--height", "-1"], "height"),
        (["--nucleus-centre", "8"], "nucleus_centre"),
        (["--mesh", "absent.stl", "--um-per-unit", "0"], "um_per_unit"),
        (["--nucleus-surface", "n.stl"], "nucleus_surface"),
        (["--mesh", "absent.stl", "--height", "9"], "height"),
        (["--mesh", "absent.stl", "--shape", "67x60"], "shape"),
        (["--mesh", "absent.vtu", "--size", "3"], "size"),
        (["--modulus", "0", "sweep"], "modulus"),
        (["--preset", "si", "shake"], "preset"),
        (["--preset", "real"], "preset"),
        (["shake", "--tau", "0"], "tau"),
        (["shake", "--nucleus-g", "-1"], "nucleus_g"),
    ],
)
def test_bad_input_names_its_option(arguments: list[str], setting: str) -> None:
    found = CliRunner().invoke(app, arguments)
    assert isinstance(found.exception, SettingError) and found.exception.setting == setting
    assert found.output == ""


def test_a_missing_option_is_described_with_its_units() -> None:
    r"""Rich took `[kg/m^3]` for a style, and the refusal read "density \\; of one region"."""
    done = command("modes", "sesamoid_medial")
    assert done.returncode == 2
    assert "modulus [Pa], Poisson's ratio, density [kg/m^3]; of one region" in " ".join(done.stderr.split())


def test_few_modes_are_not_filled_up(tmp_path: Path) -> None:
    found = CliRunner(env={"XDG_CACHE_HOME": str(CACHE)}).invoke(app, ["shake", "--size", "8", "--modes", "3"])
    assert found.exit_code == 0, found.exception
    assert found.output.count("residual") == 3
    assert "mode  4" not in found.output


def _is_drawn(file: Path) -> bool:
    """Not an empty page: many colours."""
    from matplotlib.image import imread

    pixels = imread(file)
    return len(np.unique((pixels.reshape(-1, pixels.shape[2]) * 255).astype(int) @ [1, 256, 65536, 0])) > 100
