"""The models in MuJoCo alone, as its own viewer runs them: what is seen, and how the foot moves without fasbody."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjcf
from fasbody.foot.model import load
from fasbody.foot.steady_state import Balance
from viz.load import load_foot


@pytest.mark.parametrize("name", mjcf.names())
def test_the_viewer_begins_with_the_whole_model_upright(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(mjcf.scene(name)))
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    assert camera.distance < 2 and 0 < camera.lookat[1] < 0.5
    turn, tilt = np.radians([camera.azimuth, camera.elevation])
    up = np.array([-np.sin(tilt) * np.cos(turn), -np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    assert up[1] > 0.9


@pytest.mark.parametrize("name", ["two_dof", "leg", "mounted_arch", "foot_arch"])
def test_old_places_are_the_models(name: str) -> None:
    folder = mjcf.path(name).parents[1]
    for old, new in ((folder / f"{name}.xml", mjcf.path(name)), (folder / "scene" / f"{name}.xml", mjcf.scene(name))):
        one, other = (mujoco.MjModel.from_xml_path(str(file)) for file in (old, new))
        assert one.names == other.names and np.array_equal(one.body_mass, other.body_mass)
    assert load(folder / f"{name}.xml").values() == load(name).values()


def test_the_shaker_stands_once(tmp_path: Path) -> None:
    """Every model includes it; a copy may leave it behind, or be whole."""
    assert '"shaker' in mjcf.SHAKER.read_text()
    for name in mjcf.names():
        assert '"shaker' not in mjcf.path(name).read_text() and "<include" not in mjcf.text(name)
        one = mujoco.MjModel.from_xml_path(str(mjcf.path(name)))
        other = mujoco.MjModel.from_xml_string(mjcf.text(name))
        assert one.names == other.names and np.array_equal(one.actuator_gear, other.actuator_gear)
        copy = tmp_path / "copy.xml"
        copy.write_text(mjcf.path(name).read_text())
        for foot in (load(copy), load(copy.read_text())):
            assert foot.values() == load(name).values() and foot.model.names[-20:] == one.names[-20:]
    copy.write_text(mjcf.path("foot_arch").read_text())
    assert load_foot(f"{copy}@41").values() == load("foot_arch").values()


def alone(name: str, frequency_hz: float, peak: float) -> float:
    """Malleolus over table by MuJoCo without a callback, table on the spring of shaken.xml."""
    model = mujoco.MjModel.from_xml_path(str(mjcf.scene(name)))
    data, w, settled, periods = mujoco.MjData(model), 2 * np.pi * frequency_hz, 0.6, 4
    spring = model.tendon("spring_of_the_table").id
    model.tendon_stiffness[spring] *= (frequency_hz / 20) ** 2
    mujoco.mj_resetDataKeyframe(model, data, model.key("shaken").id)
    data.qpos[0] = -peak / w**2
    n = round((settled + periods / frequency_hz) / model.opt.timestep)
    places = np.empty((n, 2))
    sites = [model.site("base").id, model.site("malleolus").id]
    for i in range(n):
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        places[i] = data.site_xpos[sites, 1]
    last = round(periods / frequency_hz / model.opt.timestep)
    carrier = np.exp(-1j * w * model.opt.timestep * np.arange(last))
    base, malleolus = carrier @ places[-last:] - carrier.sum() * places[-last:].mean(axis=0)
    return float(abs(malleolus / base))


@pytest.mark.parametrize("frequency_hz", [10.0, 30.0, 50.0])
@pytest.mark.parametrize("name", mjcf.names())
def test_alone_the_foot_moves_within_three_percent(name: str, frequency_hz: float) -> None:
    full = abs(Balance(load(name)).orbit(frequency_hz, [1.0]).harmonics()[0])
    assert alone(name, frequency_hz, 1.0) == pytest.approx(full, rel=0.03)
