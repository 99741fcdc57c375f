"""Laws that stiffen on one side: closed forms, MuJoCo against an ODE, names and units of a swapped law."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mjcf
from fasbody.exceptions import ModelError
from fasbody.foot import damper
from fasbody.foot.engine import callbacks
from fasbody.foot.model import load
from fasbody.leg.chain import Leg

POWER, TOE = "1 2e4 43 2.5 2 {W} {side}", "2 4884 282 2 {W} {side}"


def row(text: str) -> np.ndarray:
    user = np.zeros(damper.USER_SIZE)
    numbers = [float(word) for word in text.split()]
    user[: len(numbers)] = numbers
    return user


@pytest.mark.parametrize("side", [-1, 1])
def test_forces_are_those_of_the_formula(side: int) -> None:
    d, v, W = 3e-3, 0.2, 30.0
    spring = 43 * (d / (2.5 * 43 / 2e4)) ** 2.5  # k = n F/d at the force F
    unloaded = damper.algebraic_force(row(POWER.format(W=0, side=side)), side * d, side * v, 0.0)
    assert unloaded == pytest.approx(-side * spring * (1 + 2 * v), rel=1e-12)
    spring = 4884 / 282 * (np.exp(282 * d) - 1)
    unloaded = damper.algebraic_force(row(TOE.format(W=0, side=side)), side * d, side * v, 0.0)
    assert unloaded == pytest.approx(-side * spring * (1 + 2 * v), rel=1e-12)
    for law in (POWER, TOE):
        loaded = row(law.format(W=W, side=side))
        assert damper.algebraic_force(loaded, 0.0, 0.0, 0.0) == pytest.approx(0, abs=1e-12)
        assert damper.algebraic_force(loaded, -side * 0.1, 0.0, 0.0) == pytest.approx(side * W)  # it lets go
        k, c = damper.at_rest(loaded)
        slope = np.diff([damper.algebraic_force(loaded, x, 0.0, 0.0) for x in (-1e-7, 1e-7)])[0] / 2e-7
        assert (k, c) == pytest.approx((-slope, 2 * W), rel=1e-5)


def test_a_law_on_a_joint_and_on_a_tendon_moves_as_an_independent_ode() -> None:
    text = """<mujoco><option timestep="5e-5" integrator="RK4" gravity="0 -9.81 0"/>
      <size nuser_jnt="8" nuser_tendon="8"/>
      <worldbody><site name="top" pos="0 0 0"/>
      <body pos="0 -0.1 0"><joint type="slide" axis="0 1 0" stiffness="1e3 2e5 3e8" {joint}/>
        <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><site name="end"/></body></worldbody>
      <tendon><spatial name="t" {tendon}><site site="top"/><site site="end"/></spatial></tendon></mujoco>"""
    law, n = row(TOE.format(W=0, side=1)), 4000  # a ligament from which a mass hangs: it falls, the law is pulled
    runs = []
    hangs = 'user="' + TOE.format(W=0, side=1) + '"'
    for joint, tendon in ((hangs.replace(' 1"', ' -1"'), ""), ("", hangs)):
        model = mujoco.MjModel.from_xml_string(text.format(joint=joint, tendon=tendon))
        data = mujoco.MjData(model)
        with callbacks():
            for _ in range(n):
                mujoco.mj_step(model, data)
        runs.append(float(data.qpos[0]))

    def rates(t: float, s: np.ndarray) -> list[float]:
        down, fast = -s[0], -s[1]
        pull = max(0.0, law[1] / law[2] * np.expm1(law[2] * down) * (1 + law[3] * fast)) if down > 0 else 0.0
        return [s[1], -9.81 + (pull - 1e3 * s[0] - 2e5 * s[0] ** 2 - 3e8 * s[0] ** 3) / 2]

    exact = solve_ivp(rates, (0, n * 5e-5), [0.0, 0.0], rtol=1e-9, atol=1e-12, max_step=1e-3).y[0, -1]
    assert runs == pytest.approx([exact, exact], rel=1e-3)


def swapped(tmp_path: Path, user: str) -> Path:
    text = mjcf.text("two_dof")
    old = 'stiffness="1.0e5" damping="800" user="4.25 800 -50 100"'
    assert old in text
    file = tmp_path / "swapped.xml"
    file.write_text(text.replace(old, f'stiffness="0" user="{user}"'))
    return file


@pytest.mark.parametrize(
    ("user", "own"),
    [
        ("4.23 900 1.5 30 0.9 1 0.02 0.2", {"j": "N", "k": "", "l": "N s^n", "m": "", "n": ""}),
        ("4.24 900 30 0.02 0.2", {"E": "N", "eta": "N s"}),
        ("1 1e5 43 2 0.5 43 -1", {"k": "N/m", "n": "", "eta": "s/m"}),
        ("2 5e3 280 0.5 43 -1", {"k_0": "N/m", "b": "1/m", "eta": "s/m"}),
    ],
)
def test_a_swapped_law_brings_its_own_names_and_units(tmp_path: Path, user: str, own: dict[str, str]) -> None:
    foot = load(swapped(tmp_path, user))
    assert not {"k_F", "c_21", "c_22", "c_23"} & set(foot.parameters)
    found = {
        name.removeprefix("fat_pad_"): p.unit for name, p in foot.parameters.items() if name.startswith("fat_pad_")
    }
    assert found == own
    name = f"fat_pad_{next(iter(own))}"
    doubled = foot.with_values({name: 2 * foot.values()[name]})
    assert doubled.model.joint("fat_pad").user[1] == 2 * float(user.split()[1])


@pytest.mark.parametrize(
    ("user", "says"),
    [
        ("1 1e5 43 2 0.5 43 0", "side = 0"), ("2 5e3 -280 0.5 43 -1", "b = -280"), ("1 1e5 43 2 0.5 -43 -1", "W = -43"),
        ("3 1 2", "names the law 3"),
    ],
)  # fmt: skip
def test_a_mistyped_law_is_refused(tmp_path: Path, user: str, says: str) -> None:
    with pytest.raises(ModelError, match=says):
        load(swapped(tmp_path, user))


def test_the_leg_takes_a_pad_as_it_is_about_its_static_state(tmp_path: Path) -> None:
    text = mjcf.text("leg")
    old = 'name="fat_pad" stiffness="1.633e5" damping="47.6"'
    assert old in text
    file = tmp_path / "pad.xml"
    file.write_text(text.replace(old, 'name="fat_pad" user="2 1e4 300 0.4 60 -1"'))
    foot = load(file)
    leg = Leg.from_model(foot.model, foot.name)
    assert (leg.stiffness[0], leg.damping[0]) == pytest.approx((1e4 + 300 * 60, 0.4 * 60))
    file.write_text(text.replace(old, 'name="fat_pad" user="2 1e4 300 0.4 0 -1"'))
    foot = load(file)
    with pytest.raises(ModelError, match="fat_pad' has the law 2 with W = 0"):
        Leg.from_model(foot.model, foot.name)
