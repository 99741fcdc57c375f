"""Declared parameters: keys, places, shares, and what they write."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import thesis
from arch_copies import edited as edited_arch

import mjcf
from fasbody.arch.bones import Arch
from fasbody.exceptions import ModelError, SettingError
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import sine
from fasbody.foot.simulate import simulate
from simulator.arch import with_constants

KEYS = (
    "k_T_n_per_m", "k_F_n_per_m", "c_11_n_s_per_m", "c_12_per_m", "c_13_per_m", "c_21_n_s_per_m", "c_22_per_m",
    "c_23_per_m", "m_S_kg", "m_F_kg",
)  # fmt: skip


def test_keys_and_bounds_of_the_two_mass_foot(foot: Foot) -> None:
    assert tuple(item.key for item in foot.parameters.values()) == KEYS
    k_F = foot.parameters["k_F"]
    assert (k_F.lower, k_F.upper) == thesis.K_F_BOUNDS
    assert all(item.source for item in foot.parameters.values())
    logarithmic = [name for name, item in foot.parameters.items() if item.logarithmic]
    assert logarithmic == ["k_T", "k_F", "c_11", "c_21", "m_S", "m_F"]
    assert all(item.lower < foot.values()[name] < item.upper for name, item in foot.parameters.items())


def test_each_parameter_reads_what_it_wrote_and_touches_nothing_else(foot: Foot) -> None:
    before = foot.values()
    for i, (name, item) in enumerate(foot.parameters.items()):
        fields = {f: getattr(foot.model, f).reshape(1, -1).copy() for f in foot.parameters.fields}
        original = {f: a.copy() for f, a in fields.items()}
        item.write(fields, np.array([1.25 + i]))
        changed = {(f, int(j)) for f in fields for j in np.flatnonzero(fields[f] != original[f])}
        assert changed == {(place.field, place.index) for place in item.places}
        assert foot.with_values({name: 1.25 + i}).values() == {**before, name: 1.25 + i}


def test_a_shared_parameter_stands_in_several_places(edited: Callable[..., Path]) -> None:
    """`0.5 joint a stiffness, 0.25 joint b stiffness`: each place takes its share."""
    (declared,) = [line for line in mjcf.text("two_dof").splitlines() if '<text name="k_F"' in line]
    shared = "0.5 joint talocrural stiffness, 0.25 joint fat_pad stiffness"
    pad = ('name="fat_pad" stiffness="1.0e5"', 'name="fat_pad" stiffness="0.75e5"')  # a quarter of k_T, as is said
    file = edited((declared, ""), ("joint talocrural stiffness", shared), pad)
    model = load(file).with_values({"k_T": 4e5}).model
    assert model.jnt_stiffness[model.joint("talocrural").id] == 2e5
    assert model.jnt_stiffness[model.joint("fat_pad").id] == 1e5


def test_an_unknown_name_lists_the_valid_ones(foot: Foot) -> None:
    with pytest.raises(SettingError, match=r"unknown parameter 'kF', did you mean 'k_F'\? \(valid: k_T, k_F.*two_dof"):
        foot.parameters["kF"]
    assert "kF" not in foot.parameters
    assert len(foot.parameters) == 10


def test_branch_of_the_aponeurosis_in_a_batch() -> None:
    """Each simulation has its own constants, equal to a model with those constants written by another route."""
    arch, motion = load("foot_arch"), sine(30.0, 0.05)
    k_12, c_1 = np.array([155e3, 4e4, 4e5]), np.array([300.0, 900.0, 100.0])
    together = simulate(arch, motion, values={"c_1": c_1, "k_12": k_12}).malleolus
    for i in range(3):
        constants = replace(Arch.from_model(arch.model), k_12=float(k_12[i]), c_1=float(c_1[i]))
        alone = simulate(with_constants(arch, constants), motion).malleolus[0]
        np.testing.assert_allclose(together[i], alone, atol=1e-6 * np.abs(alone).max())
    assert np.abs(together[1] - together[0]).max() > 1e-2 * np.abs(together[0]).max()


@pytest.mark.parametrize("wrong", ["dynprm 0 with gainprm 0", "dynprm 0 times gainprm", "dynprm 0 times gainprm 10"])
def test_a_second_column_that_is_none(tmp_path: Path, wrong: str) -> None:
    file = tmp_path / "copy.xml"
    file.write_text(edited_arch(("dynprm 0 times gainprm 0", wrong)))
    with pytest.raises(ModelError, match="parameter 'k_12' stands"):
        load(file)
