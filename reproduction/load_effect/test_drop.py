"""A mass dropped on a pad: the closed form of its energy, the walkers' heels, laws that are refused."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from fasbody.constants import MODEL_GRAVITY
from fasbody.exceptions import SettingError
from fasbody.foot import damper
from fasbody.leg import __main__ as leg_command
from reproduction.load_effect.drop import DROPPED, DROPPED_POWER, checked, drop, drops, walked


def test_the_drop_is_met_and_its_energy_is_that_of_the_closed_form() -> None:
    """Without gravity v - ln(1 + eta v)/eta is the same before and after, whatever the spring."""
    for law in (DROPPED, DROPPED_POWER):
        found = drop(law, step=1e-4)
        assert (found.peak_g, found.depth_mm, found.absorbed_percent) == pytest.approx((11.6, 11.3, 79), rel=2e-3)
        assert all(found.met.values())
    eta, v = 0.8, 0.93
    left = v - np.log1p(eta * v) / eta
    grid = np.linspace(0.01, 0.93, 100_000)
    back = np.interp(left, -grid - np.log1p(-eta * grid) / eta, grid)
    assert drop(f"2 9000 230 {eta} 0 -1", step=1e-4).absorbed_percent == pytest.approx(
        100 * (1 - (back / v) ** 2), abs=1
    )
    k, m = 1e5, 5.0  # a plain spring gives everything back, and the depth of a falling mass
    plain = drop("", k, 0.0)
    depth = (m * MODEL_GRAVITY + np.sqrt((m * MODEL_GRAVITY) ** 2 + k * m * v**2)) / k
    assert plain.depth_mm == pytest.approx(1e3 * depth, rel=1e-4)
    assert plain.absorbed_percent == pytest.approx(0, abs=0.2)


def test_heels_of_walkers_foresee_the_depth_and_no_law_of_the_vibration_does() -> None:
    found = drops()
    assert found["power of slow walkers"].met["depth_mm"]
    assert not any(found["power, for the vibration (lift-off)"].met.values())
    law = np.pad([float(word) for word in walked(57.8, 3.48).split()], (0, 2))
    spring = damper.algebraic_force(law, -5e-3, 0.0, 0.0)
    assert spring == pytest.approx(57.8, rel=1e-6)


def test_command() -> None:
    run = CliRunner().invoke(leg_command.app, ["drop", "--law", DROPPED, "--json"])
    assert run.exit_code == 0
    assert all(json.loads(run.stdout)[DROPPED]["met"].values())
    for law in ("", "2 1 2", "4.24 1 2 3 4", "2 5e3 280 1 10 -1", "1 a b"):
        with pytest.raises(SettingError, match="the law of a dropped pad"):
            checked(law)
