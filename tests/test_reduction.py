"""What the reduction to two masses costs, against a direct solution of both models."""

import json

import numpy as np
from arch_copies import high_arch, high_arch_xml
from typer.testing import CliRunner

from fasbody.arch.__main__ import app
from fasbody.arch.bones import Arch
from fasbody.arch.linear import state_space, two_mass_state_space
from fasbody.arch.reduction import reduce


def test_differences_against_state_space_responses() -> None:
    result = reduce(draws=2, lever_arms_m=(0.015,))
    rng = np.random.default_rng(0)
    for draw in result.differences[0.015]:
        arch = Arch.draw(rng, 0.015)
        for i in (0, 60, 150):
            s = 2j * np.pi * result.frequency_hz[i]
            A, b, c, d = state_space(arch)
            five = abs(c @ np.linalg.solve(s * np.eye(11) - A, b) + d)
            A, b, c = two_mass_state_space(arch.m_T, arch.m_F, arch.k_T, arch.k_F, arch.c_T, arch.c_F)
            two = abs(c @ np.linalg.solve(s * np.eye(4) - A, b))
            np.testing.assert_allclose(draw[i], abs(five - two) / two, rtol=1e-4, atol=1e-9)


def test_reduction_hangs_on_the_reading_of_the_rotational_constants() -> None:
    result = reduce(draws=30)
    medians = {arm: 100 * np.median(difference) for arm, difference in result.differences.items()}
    assert medians[None] < 0.1
    assert 7 < medians[0.015] < 25


def test_another_model_keeps_its_bones(tmp_path) -> None:
    file = tmp_path / "high.xml"
    file.write_text(high_arch_xml())
    result = CliRunner().invoke(app, ["reduction", "--draws", "2", "--json", "--model", str(file)])
    rows = json.loads(result.stdout)["rows"]
    expected = reduce(draws=2, arch=Arch.from_model(high_arch()))
    assert rows[-2]["arch"] == "high.xml"
    np.testing.assert_allclose(rows[0]["median"], np.median(expected.differences[None]), rtol=1e-9)
    assert abs(rows[0]["median"] / np.median(reduce(draws=2).differences[None]) - 1) > 0.01


def test_command(tmp_path) -> None:
    picture = tmp_path / "reduction.png"
    result = CliRunner().invoke(app, ["reduction", "--draws", "3", "--json", "--figure", str(picture)])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["rows"][0]["lever_arm_m"] is None
    assert picture.read_bytes().startswith(b"\x89PNG")
