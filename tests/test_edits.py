"""docs/edit_model.md: edit the file and everything follows, or says which element it cannot follow."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from arch_copies import compiled, edited, reshaped
from typer.testing import CliRunner

from fasbody.arch.__main__ import app
from fasbody.arch.bones import Arch
from fasbody.arch.linear import transmissibility
from fasbody.exceptions import ModelError
from fasbody.foot import shaker
from fasbody.foot.model import check, load
from fasbody.foot.simulate import simulate
from viz.load import load_foot

#: Each command with little work; its answer hangs on what the file says.
COMMANDS = {
    "sensitivity": ["--this"],
    "reduction": ["--draws", "1"],
    "load": [],
    "crosscheck": ["--samples", "2"],
}
#: One edit of each kind of constant, and the constant that a fit then starts from, if it is declared.
EDITS = {
    "k_2": (edited(('<joint name="spring_ligament"/>', '<joint name="spring_ligament" stiffness="9000"/>')), 9000.0),
    "k_F": (edited(('stiffness="5e4"', 'stiffness="8e4"')), 1.6e5),
    "c_T": (edited(('user="4.25 430 0 0"', 'user="4.25 900 0 0"')), 900.0),
    "c_1": (edited(('resistance="3.3333333333333333e-3"', 'resistance="1e-3"')), 1000.0),
    "m_T": (edited(('mass="2.36"', 'mass="4.36"')), 4.36),
    "m_3": (edited(('mass="0.025"', 'mass="0.25"')), None),
    "I_1": (edited(('diaginertia="28.00e-5 28.00e-6 28.00e-5"', 'diaginertia="9e-4 28.00e-6 9e-4"')), None),
    "L_4": (reshaped(L_4=0.075), None),
    "theta_40": (reshaped(theta_4=60.0), None),
}


def written(folder: Path, text: str) -> Path:
    file = folder / "copy.xml"
    file.write_text(text)
    return file


def answer(command: str, file: Path) -> dict:
    run = CliRunner().invoke(app, [command, "--json", "--model", str(file), *COMMANDS[command]])
    assert run.exit_code == 0, run.exception
    document = json.loads(run.stdout)
    if command == "crosscheck":  # agreement is rounding; what changes is the constants that it compared
        return document["constants"]
    return document


@pytest.fixture(scope="session")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict]:
    """What a command says of an unedited copy."""
    file = written(tmp_path_factory.mktemp("shipped"), edited())
    return cache(lambda command: answer(command, file))


def numbers(document: object) -> list[float]:
    if isinstance(document, dict | list):
        return [x for item in (document.values() if isinstance(document, dict) else document) for x in numbers(item)]
    return [document] if isinstance(document, float) else []


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", EDITS)
def test_every_command_follows(shipped: Callable[[str], dict], tmp_path: Path, kind: str, command: str) -> None:
    before = np.array(numbers(shipped(command)))
    after = np.array(numbers(answer(command, written(tmp_path, EDITS[kind][0]))))
    assert (np.abs(after - before) > 1e-3 * np.abs(before)).any()


@pytest.mark.parametrize("kind", EDITS)
def test_motion_and_the_start_of_a_fit_follow(tmp_path: Path, kind: str) -> None:
    text, value = EDITS[kind]
    foot, motion = load_foot(str(written(tmp_path, text))), shaker.sine(20.0, 0.05)
    before = simulate(load("foot_arch"), motion).malleolus
    assert np.abs(simulate(foot, motion).malleolus - before).max() > 1e-4 * np.abs(before).max()
    if value is not None:
        assert foot.values()[kind] == pytest.approx(value)
    else:
        assert kind not in foot.values()


@pytest.mark.parametrize("command", COMMANDS)
def test_an_open_arch_is_refused_by_its_name(tmp_path: Path, command: str) -> None:
    """A forgotten theta_1: the closure would keep the gap that it finds."""
    file = written(tmp_path, edited(("-0.06527 ", "-0.075 "), ("-0.032635 ", "-0.0375 ")))
    run = CliRunner().invoke(app, [command, "--model", str(file), *COMMANDS[command]])
    assert isinstance(run.exception, ModelError)
    assert "'closure' ties the tendons 'heel_pad' and 'forefoot_pad', whose lengths at rest are" in str(run.exception)
    with pytest.raises(ModelError, match=r"3\.566 mm apart"):
        load_foot(str(file))


def test_the_draws_of_the_thesis_keep_only_the_bones(shipped: Callable[[str], dict], tmp_path: Path) -> None:
    documents = []
    for text in (edited(), EDITS["k_2"][0]):
        options = ["sensitivity", "--json", "--draws", "2", "--model", str(written(tmp_path, text))]
        documents.append(json.loads(CliRunner().invoke(app, options).stdout))
    assert documents[0]["studies"] == documents[1]["studies"]
    assert documents[0]["own"] != documents[1]["own"]


#: Both pads by Eq. 4.24, in place of spring and damper; their declarations go, since the numbers do.
STRAIN_PADS = (
    ('stiffness="5e4" damping="750" user="4.25 1500 0 0"', 'user="4.24 2000 80 0.02 0.3"'),
    *((line + "\n", "") for line in edited().splitlines() if '<text name="k_F"' in line or '<text name="c_F"' in line),
)


def test_pads_of_another_law_are_linear_for_small_motion() -> None:
    foot = check(compiled(*STRAIN_PADS), "pads")
    arch, f, seconds, step = Arch.from_model(foot.model), 25.0, 0.4, 2.5e-5  # no native share, so a finer step
    assert (arch.k_F, arch.c_F) == pytest.approx((2 * 2000 / 0.02, 2 * 80 * 0.3 / 0.02))
    run = simulate(foot, shaker.sine(f, seconds, 1e-3), step=step)
    late = run.time[0] > seconds - 2 / f - step / 2
    carrier = np.exp(-2j * np.pi * f * run.time[0, late])
    measured = np.abs(np.mean(run.malleolus[0, late] * carrier) / np.mean(run.base[0, late] * carrier))
    assert measured == pytest.approx(float(np.abs(transmissibility(arch, np.array(f)))), rel=1e-3)
