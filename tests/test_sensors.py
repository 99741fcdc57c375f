"""Every accelerometer: read along the file's vertical, fitted with its own errors, and what a second one decides."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjcf
from fasbody.exceptions import InputFileError, SettingError
from fasbody.foot.model import Foot, load
from fasbody.foot.shaker import sine
from fasbody.foot.simulate import simulate
from fasbody.foot.two_dof import NAMES, TwoDof
from fasbody.recording.checks import checked
from fasbody.recording.condition import Condition
from fasbody.recording.recording import Recording
from identification import branches
from identification.derived_quantities import derived
from identification.engines.certified import CertifiedRollouts
from identification.engines.engine import Whole
from identification.engines.mujoco import Rollouts
from identification.engines.twin import Twin, carriers, twin_applies
from identification.fitting import Settings, fit_foot
from identification.parameters import space_of
from identification.sensors import chosen
from identification.setup import Setup
from identification.time_problem import TimeProblem
from simulator import worlds

Edit = Callable[..., Path]
BOTH = ("malleolus", "foot")
BODY_KG = 72.57
BENT = {"c_12": 90.0, "c_13": 140.0, "c_22": -120.0, "c_23": 180.0}


def linear_motion(foot: TwoDof, hz: float) -> tuple[complex, complex]:
    """Malleolus and foot over base of two masses on springs with dampers, by their matrices."""
    s = 2j * np.pi * hz
    ankle, pad = foot.k_T + s * foot.c_11, foot.k_F + s * foot.c_21
    K = np.array([[ankle, -ankle], [-ankle, ankle + pad]]) + s**2 * np.diag([foot.m_S, foot.m_F])
    shank, bone = np.linalg.solve(K, [0.0, pad])
    return complex(shank), complex(bone)


def recorded(foot: TwoDof, hz: float, noise: float = 0.01, seed: int = 0, added: float = 0.0) -> Recording:
    """A recording of a linear foot with a sensor on each mass; of its closed form."""
    rng, t = np.random.default_rng([seed, round(hz), round(added)]), np.arange(1200) / 1000
    turn = 8.95 * np.exp(2j * np.pi * hz * t)
    shank, bone = linear_motion(replace(foot, m_S=foot.m_S + added), hz)
    a, y, z = ((turn * H).real + noise * rng.normal(size=t.size) for H in (1.0, shank, bone))
    condition = Condition("made", "midstance", added, BODY_KG, hz)
    return Recording(t, a, y, condition=condition, file=f"{hz:g} Hz", origin="synthetic", others={"foot": z})


@pytest.fixture(scope="module")
def linear(foot: Foot) -> Foot:
    masses = {"m_S": 0.0465 * BODY_KG, "m_F": 0.0145 * BODY_KG}
    return foot.with_values({"c_12": 0.0, "c_13": 0.0, "c_22": 0.0, "c_23": 0.0, "c_11": 165.0, "c_21": 310.0} | masses)


# the file's vertical


def upright(folder: Path) -> Path:
    """two_dof.xml with z up: every vector (x, y, z) as (x, -z, y)."""
    text = mjcf.text("two_dof").replace('axis="0 1 0"', 'axis="0 0 1"')
    for old, new in (("0 0.09 0.03", "0 -0.03 0.09"), ("0 0.25 0", "0 0 0.25"), ("0 0.04 0", "0 0 0.04")):
        assert old in text
        text = text.replace(old, new)
    file = folder / "z_up.xml"
    file.write_text(text)
    return file


def test_a_foot_with_z_up_gives_the_same_answers(foot: Foot, linear: Foot, tmp_path: Path) -> None:
    turned = load(upright(tmp_path))
    assert turned.up == (0.0, 0.0, 1.0) and foot.up == (0.0, 1.0, 0.0)
    one, other = (simulate(f, sine(20.0, 0.1)) for f in (foot, turned))
    for name, values in one.outputs.items():
        np.testing.assert_allclose(other.outputs[name], values, rtol=1e-9, atol=1e-9)
    data = [recorded(TwoDof.from_values(linear.values()), f) for f in (15.0, 30.0)]
    free = {"free": ["k_T", "k_F"], "starts": 1, "threads": 1, "departures": False}
    fits = [fit_foot(data, f.with_values(linear.values()), **free) for f in (foot, turned)]  # type: ignore[arg-type]
    for key, e in fits[0].parameters.items():
        assert fits[1].parameters[key].value == pytest.approx(e.value, rel=1e-9, abs=1e-12), key


def test_a_sensor_reads_along_its_own_axis_without_gravity(edited: Edit) -> None:
    leans = ('<site name="foot"', '<site name="foot" euler="0 0 0.5"')
    kind = ('<framelinacc name="foot" objtype="site" objname="foot"/>', '<accelerometer name="foot" site="foot"/>')
    tilted, plain = load(edited(leans, kind)), load(edited(leans))
    a, b = (simulate(f, sine(20.0, 0.05)).sensors["foot"] for f in (tilted, plain))
    np.testing.assert_allclose(a, np.cos(0.5) * b, rtol=1e-9, atol=1e-9)
    heavy = load(edited(leans, kind, ('gravity="0 0 0"', 'gravity="0 -9.81 0"')))
    data = mujoco.MjData(heavy.model)
    data.qacc[:] = 0.0
    mujoco.mj_fwdPosition(heavy.model, data)
    mujoco.mj_fwdVelocity(heavy.model, data)
    mujoco.mj_sensorAcc(heavy.model, data)
    assert abs(heavy.sensors["foot"].read(data.sensordata)) < 1e-9 and heavy.sensors["foot"].offset == pytest.approx(
        9.81 * np.cos(0.5)
    )


def test_simulations_show_every_sensor(foot: Foot) -> None:
    out = simulate(foot, sine(20.0, 0.02))
    assert list(out.outputs) == ["malleolus", "foot"] and out.sensors["malleolus"] is out.malleolus
    assert out.sheet().columns[-2:] == ("malleolus peak [m/s²]", "foot peak [m/s²]")
    assert list(out.records()[0])[-2:] == ["malleolus_m_s2", "foot_m_s2"]


# the engines


def test_the_twin_gives_every_sensor_on_its_masses(linear: Foot, edited: Edit) -> None:
    assert carriers(linear) == {"malleolus": "shank", "foot": "foot"} and twin_applies(linear, BOTH)
    own = load(edited(('objname="foot"/>', 'objname="foot"/><accelerometer name="own" site="foot"/>')))
    assert carriers(own)["own"] == "foot"
    data, values = checked(recorded(TwoDof.from_values(linear.values()), 20.0)), linear.values() | BENT
    drives, x0 = [Whole.of(data, linear)], np.array([1e-4, -2e-4, 0.01, 0.02])
    y, D = Twin(linear, drives, BOTH).run(0, values, NAMES, x0)
    want, mine = CertifiedRollouts(linear, drives, BOTH).run(0, values, NAMES, x0)
    np.testing.assert_allclose(want, y, atol=1e-7 * np.abs(y).max())
    assert (np.abs(D - mine).max(axis=0) < 1e-6 * np.abs(mine).max(axis=0)).all()
    other, _ = Rollouts(linear, drives, (), sensors=BOTH).run(0, values, (), x0)
    np.testing.assert_allclose(other, y, atol=1e-7 * np.abs(y).max())


def test_each_sensor_has_nuisances_of_its_own(linear: Foot) -> None:
    """Their derivatives are in test_residual.py."""
    p = TwoDof.from_values(linear.values())
    data = [recorded(p, f, added=m) for f, m in ((12.0, 0.0), (25.0, 2.3))]
    made = Setup.of(data, linear, Settings(sensors=BOTH)).problem()
    prior = {each.name: (each.mean, each.std, each.lower, each.upper) for each in made.variables.nuisances}
    for kind in ("gain", "delay", "drift", "mount", "mount damping", "rocking"):
        assert prior[f"{kind} of foot"] == prior[kind]
    assert "rocking frequency of foot" not in prior
    assert made.size == 2 * 2 * sum(line.count for line in made.measured.lines)


def test_jacobian_of_two_sensors_in_the_time_domain(linear: Foot) -> None:
    data = [checked(recorded(TwoDof.from_values(linear.values()), 20.0))]
    space = space_of(linear, ["k_T", "k_F"], sensors=BOTH)
    problem = TimeProblem(data, Twin(linear, [Whole.of(data[0], linear)], BOTH), space)
    assert space.delays == ("delay", "delay_foot") and problem.size == 2 * data[0].time_s.size
    z = problem.start(space.to_q(space.theta(linear.values()))) + 0.1
    _, r, J = problem.rows(z, 0)
    for i in range(z.size):
        d = 1e-5 * np.eye(z.size)[i]
        want = (problem.rows(z + d, 0)[1] - problem.rows(z - d, 0)[1]) / 2e-5
        np.testing.assert_allclose(J[:, i], want, atol=1e-4 * np.abs(want).max() + 1e-7)
    assert r.size == problem.size


# columns and names


def test_columns_belong_to_sensors_by_name(foot: Foot, linear: Foot, tmp_path: Path) -> None:
    made = recorded(TwoDof.from_values(linear.values()), 20.0)
    made = replace(made, others=made.others | {"knee": made.malleolus_m_s2})
    made.write(tmp_path / "r.csv")
    back = Recording.read(tmp_path / "r.csv")
    np.testing.assert_allclose(back.sensors["foot"], made.others["foot"], atol=1e-6)
    assert list(back.sensors) == ["malleolus", "foot", "knee"]
    fitted, told = chosen([back], foot, None)
    assert fitted == BOTH and told == ["Not fitted, as no accelerometer of the model two_dof has such a name: knee."]
    assert chosen([back], foot, ["malleolus"]) == (("malleolus",), [])
    for wanted, text in (
        (["malleolus", "knee"], "unknown sensor 'knee'"), (["foot"], "always fitted; give malleolus,foot"),
    ):  # fmt: skip
        with pytest.raises(SettingError, match=text):
            chosen([back], foot, wanted)
    with pytest.raises(SettingError, match="no recording has a column foot_m_s2"):
        chosen([replace(back, others={})], foot, BOTH)


def test_a_further_channel_never_stands_in_the_way(linear: Foot, tmp_path: Path) -> None:
    made = recorded(TwoDof.from_values(linear.values()), 20.0)
    dead = checked(replace(made, others=made.others | {"heel": np.zeros(made.time_s.size)}))
    assert list(dead.others) == ["foot"] and "The channel heel is left out." in dead.warnings[-1]
    each = zip(made.time_s, made.base_m_s2, made.malleolus_m_s2, strict=True)
    rows = [f"{t},{a},{y},{'x' if i == 7 else 1.0}" for i, (t, a, y) in enumerate(each)]
    (tmp_path / "odd.csv").write_text("\n".join(["time_s,base_m_s2,malleolus_m_s2,heel_m_s2", *rows]))
    assert not Recording.read(tmp_path / "odd.csv").others
    (tmp_path / "toe.csv").write_text("\n".join(["time_s,base_m_s2,malleolus_m_s2,AI7", *rows]).replace("x", "1"))
    study = tmp_path / "study.toml"
    assert not Recording.read(tmp_path / "toe.csv").others
    from fasbody.recording.channels import Layout

    told = Layout.from_toml(study, {"toe": {"column": "AI7", "unit": "g", "sign": -1}})
    assert Recording.read(tmp_path / "toe.csv", layout=told).others["toe"][0] == pytest.approx(-9.80665)
    with pytest.raises(InputFileError, match="describes the channel 'malleolu'"):
        Layout.from_toml(study, {"malleolu": {"unit": "g"}})


# what it decides


def test_a_sensor_on_the_foot_decides_the_mirror_of_a_nearly_linear_leg(foot: Foot) -> None:
    made = replace(worlds.member(worlds.CLEAN, 0), loads_kg=(0.0,), frequencies_hz=(10.0, 20.0, 30.0, 40.0))
    data = worlds.recordings(made, foot=True)
    result = fit_foot(data, foot, starts=1)
    assert made.leg.stiff_ankle and (result.verdict, result.best.name) == ("decided", branches.STIFF_ANKLE)
    for constant in ("k_T", "k_F"):
        e, exact = result[constant], getattr(made.leg, constant)
        assert e.value == pytest.approx(exact, rel=0.05) and e.lower < exact < e.upper
    row = result.document()["recordings"][0]["sensors"]
    assert [sensor["name"] for sensor in row] == list(BOTH) and row[1]["harmonics"][0]["off"] < 6
    assert any("foot: fit" in text for text in result.sheet().notes) and "delay_foot_s" in result.parameters
    total = sum(part["chi_square_if_model_true"] for part in derived(result).chi_square)
    assert total == pytest.approx(result.best.chi_square, rel=1e-6)
    assert "delay_foot_s" not in result.values() and result.plot("sensors").axes


def test_a_sensor_of_ones_own_goes_through_mujoco(edited: Edit, linear: Foot) -> None:
    """It leans by 0.4 rad on the shank, so that it reads cos(0.4) of the malleolus, which no mass of the twin does."""
    site = ('<site name="malleolus"', '<site name="shin" euler="0 0 0.4" pos="0 0.2 0"/><site name="malleolus"')
    own = load(edited(site, ("<sensor>", '<sensor><accelerometer name="shin" site="shin"/>')))
    own = own.with_values(linear.values())
    p = TwoDof.from_values(linear.values())
    data = [replace(r, others={"shin": np.cos(0.4) * r.malleolus_m_s2}) for r in [recorded(p, 15.0)]]
    assert not twin_applies(own, ("malleolus", "shin")) and twin_applies(own)
    result = fit_foot(data, own, free=["k_T", "k_F"], starts=1, threads=1, departures=False)
    assert [s.name for s in result.recordings[0].sensors][1] == "shin"
    for name in ("k_T", "k_F"):
        assert result[name].value == pytest.approx(getattr(p, name), rel=5e-3)
