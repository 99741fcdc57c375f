"""Constants of the arch: Table 4.1, Table 4.2, and errors a user can read."""

from dataclasses import replace

import numpy as np
import pytest

from fasbody.arch.bones import DAMPERS, PARAMETERS, ROTATIONAL, SPRINGS, Arch
from fasbody.exceptions import ModelError


def test_table_4_1() -> None:
    arch = Arch.thesis()
    assert (arch.m_T, arch.m_1, arch.m_2, arch.m_3, arch.m_4) == (2.36, 0.133, 0.014, 0.025, 0.043)
    lengths, inertias = ([getattr(arch, f"{x}_{i}") for i in range(1, 5)] for x in "LI")
    np.testing.assert_allclose(lengths, [79.29e-3, 14.74e-3, 26.06e-3, 65.27e-3], rtol=1e-13)
    np.testing.assert_allclose(inertias, [28.00e-5, 10.12e-7, 14.13e-7, 15.19e-6], rtol=1e-13)
    np.testing.assert_allclose(np.degrees([arch.theta_20, arch.theta_30, arch.theta_40]), [69.7, 65.1, 68.5])
    assert arch.m_F == pytest.approx(0.215)


def test_theta_1_closes_the_arch_where_the_table_does_not() -> None:
    arch = Arch.thesis()
    assert np.degrees(arch.theta_10) == pytest.approx(59.6970, abs=5e-5)
    gap = arch.L_1 * np.cos(np.radians(59.7)) - arch.height_0
    assert abs(gap) == pytest.approx(3.6e-6, abs=0.1e-6)


def test_inertias_of_the_table_mix_two_conventions() -> None:
    """Bodies 1 and 2: rod about its end; bodies 3 and 4: rod about its centre."""
    table, rods = Arch.thesis(), Arch.thesis("centroidal")
    ratios = [getattr(table, f"I_{i}") / getattr(rods, f"I_{i}") for i in range(1, 5)]
    np.testing.assert_allclose(ratios, [4, 4, 1, 1], rtol=0.01)


def test_draws_fill_table_4_2_uniformly() -> None:
    rng = np.random.default_rng(0)
    draws = [Arch.draw(rng) for _ in range(400)]
    for names, (low, high) in ((SPRINGS, (1e4, 3e6)), (DAMPERS, (1e2, 3e3))):
        for name in names:
            values = np.array([getattr(arch, name) for arch in draws])
            assert low <= values.min() and values.max() <= high
            assert values.mean() == pytest.approx((low + high) / 2, rel=0.1)


def test_lever_arm_scales_only_the_rotational_constants() -> None:
    literal, scaled = Arch.draw(np.random.default_rng(1)), Arch.draw(np.random.default_rng(1), lever_arm_m=0.015)
    for name in PARAMETERS:
        factor = 0.015**2 if name in ROTATIONAL else 1
        assert getattr(scaled, name) == pytest.approx(getattr(literal, name) * factor)


@pytest.mark.parametrize("height", [0.02, 0.04, 0.06])
def test_height_keeps_the_bones(height: float) -> None:
    arch = Arch.nominal().with_height(height)
    assert arch.height_0 == pytest.approx(height, rel=1e-12)
    assert arch.theta_30 - arch.theta_20 == pytest.approx(np.radians(65.1 - 69.7))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"k_11": -1.0}, "k_11 is -1, but must be a finite number zero or more"),
        ({"m_2": 0.0}, "m_2 is 0, but must be a finite number above zero"),
        ({"c_F": float("nan")}, "c_F is nan"),
        ({"L_1": 0.03}, "cannot reach its top"),
    ],
)
def test_impossible_constants(change: dict, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        replace(Arch.nominal(), **change)


def test_impossible_height_and_arm() -> None:
    with pytest.raises(ModelError, match="reach more than 0 and less than 79 mm"):
        Arch.nominal().with_height(0.2)
    with pytest.raises(ModelError, match="above zero"):
        Arch.draw(np.random.default_rng(0), lever_arm_m=0.0)


def test_prints_itself() -> None:
    assert "40.0 mm high" in str(Arch.nominal())
