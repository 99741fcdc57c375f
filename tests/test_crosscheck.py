"""The three engines agree on the shipped arch and on edited copies, and the command notices when they do not."""

import json
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import pytest
from arch_copies import compiled, edited, high_arch_xml
from typer.testing import CliRunner

from fasbody.arch import crosscheck as module
from fasbody.arch.__main__ import app
from fasbody.arch.bones import Arch
from fasbody.arch.crosscheck import ENGINES, build_pinocchio, crosscheck
from fasbody.exceptions import FasError, ModelError
from fasbody.foot.model import load


@pytest.fixture
def model(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    texts = {
        "high arch": high_arch_xml(),
        "gravity": edited(('gravity="0 0 0"', 'gravity="0 -9.81 0"'), ('mass="2.36"', 'mass="6.86"')),
    }
    if request.param == "shipped":
        return "foot_arch"
    file = tmp_path / "copy.xml"
    file.write_text(texts[request.param])
    return str(file)


@pytest.mark.parametrize("model", ["shipped", "high arch", "gravity"], indirect=True)
def test_three_engines_agree(model: str) -> None:
    result = crosscheck(model, samples=1000, seed=3)
    for quantity in (result.mass_matrix, result.bias, result.linear_mass_matrix):
        assert set(quantity) == {f"{one}-{other}" for one, other in combinations(ENGINES, 2)}
        assert max(quantity.values()) < 1e-12
    assert result.agrees


def test_command_prints_one_json_document() -> None:
    run = CliRunner().invoke(app, ["crosscheck", "--samples", "20", "--seed", "4", "--json"])
    assert run.exit_code == 0
    document = json.loads(run.stdout)
    assert (document["model"], document["samples"], document["seed"]) == ("foot_arch", 20, 4)
    assert set(document["bias"]) == {"analytic-pinocchio", "analytic-mujoco", "pinocchio-mujoco"}


def test_other_joints_are_refused() -> None:
    ball = compiled(('<joint name="base"', '<joint name="tilt" type="hinge" axis="1 0 0"/><joint name="base"'))
    with pytest.raises(ModelError, match="'base' has several joints"):
        build_pinocchio(ball)


def test_missing_pinocchio_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(FasError, match=r"pip install 'fasbody\[crosscheck\]'"):
        crosscheck(samples=1)


@pytest.mark.long
def test_dynamics_agree_and_a_nonlinear_ankle_does_not(tmp_path: Path) -> None:
    """The equations are linear in the dampers, so a strongly nonlinear ankle must be noted and must show."""
    run = CliRunner().invoke(app, ["crosscheck", "--samples", "5", "--dynamics", "--json"])
    assert run.exit_code == 0
    motions = json.loads(run.stdout)["dynamics"]
    assert [motion["frequency_hz"] for motion in motions] == [10, 20, 30, 40, 50]
    assert all(0 < motion["difference"] < 1e-3 and 0 < motion["accurate"] < 2e-4 for motion in motions)
    file = tmp_path / "nonlinear.xml"
    file.write_text(edited(('user="4.25 1500 0 0"', 'user="4.25 1500 -400 0"')))
    result, foot = crosscheck(file, samples=5), load(file)
    assert max(result.mass_matrix.values()) < 1e-12
    assert "tendon 'heel_pad' (law 4.25)" in result.note
    motion = module.compare_motion(foot, Arch.from_model(foot.model), [20.0])
    assert motion[0].difference > 1e-3
    assert result.agrees
    assert not replace(result, dynamics=motion).agrees
