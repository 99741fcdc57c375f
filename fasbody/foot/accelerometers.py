"""The accelerometers of a model: where they sit, and how they are read along the vertical."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from fasbody.exceptions import ModelError
from fasbody.foot.parameters import names
from fasbody.presentation import Tabled

#: Sensors that read an acceleration: in the world's axes, and in those of their site.
_IN_WORLD, _IN_SITE = mujoco.mjtSensor.mjSENS_FRAMELINACC, mujoco.mjtSensor.mjSENS_ACCELEROMETER
#: Share of an acceleration that an accelerometer may miss before it counts as leaning.
_LEANS = 1e-6
#: How far [m, a unit of each coordinate] two sensors at one place may move apart.
_SAME_PLACE = 1e-6


@dataclass(frozen=True)
class Sensor(Tabled):
    """Where a sensor stands in sensordata, and which way is up in its axes.

    Attributes:
        name: of the sensor.
        first: of its three numbers.
        axis: (3,) along which it is read, positive up.
        offset: what it reads at rest because of gravity [m/s^2].
    """

    name: str
    first: int
    axis: tuple[float, float, float]
    offset: float = 0.0

    def read(self, sensordata: np.ndarray) -> np.ndarray:
        """The vertical reading (...) of sensordata (..., n)."""
        along = np.flatnonzero(self.axis)
        if along.size == 1 and self.axis[along[0]] == 1.0:
            reading: np.ndarray = sensordata[..., self.first + along[0]]
        else:
            reading = sensordata[..., self.first : self.first + 3] @ np.array(self.axis)
        return reading - self.offset if self.offset else reading


def accelerometers(model: mujoco.MjModel, up: tuple[float, float, float]) -> dict[str, Sensor]:
    """The accelerometers of a model by name, read along the vertical.

    A `framelinacc` reads in the world's axes. An `accelerometer` reads in those of its site, and is read along the one
    that is nearest to the vertical, without correcting the tilt. The contribution of gravity is subtracted.

    Args:
        model: the compiled model.
        up: (3,) the vertical.
    """
    data, sensors = reference_pose(model), {}
    for number in range(model.nsensor):
        kind, first, called = model.sensor_type[number], int(model.sensor_adr[number]), model.sensor(number).name
        if kind == _IN_WORLD:
            sensors[called] = Sensor(called, first, up, float(-model.opt.gravity @ up))
        elif kind == _IN_SITE:
            turned = _to_site(data, number)
            seen = turned @ up
            nearest = int(np.argmax(np.abs(seen)))
            axis = np.zeros(3)
            axis[nearest] = np.sign(seen[nearest])
            x, y, z = (float(part) for part in axis)
            sensors[called] = Sensor(called, first, (x, y, z), float(-(turned @ model.opt.gravity) @ axis))
    return sensors


def leans(data: mujoco.MjData, sensor: int, up: tuple[float, float, float]) -> bool:
    """Whether a sensor is an accelerometer whose site has no axis along the vertical.

    Args:
        data: of the model in its `reference_pose`.
        sensor: its number.
        up: (3,) the vertical.
    """
    in_site = data.model.sensor_type[sensor] == _IN_SITE
    return bool(in_site and np.abs(_to_site(data, sensor) @ up).max() < 1 - _LEANS)


def _to_site(data: mujoco.MjData, sensor: int) -> np.ndarray:
    """Rotation (3, 3) from the world's axes to those of a sensor's site."""
    rotation: np.ndarray = data.site_xmat[data.model.sensor_objid[sensor]].reshape(3, 3).T
    return rotation


def body_of(model: mujoco.MjModel, sensor: int) -> int:
    """Number of the body that a sensor sits on."""
    kind, number = model.sensor_objtype[sensor], int(model.sensor_objid[sensor])
    if kind == mujoco.mjtObj.mjOBJ_SITE:
        return int(model.site_bodyid[number])
    if kind == mujoco.mjtObj.mjOBJ_CAMERA:
        return int(model.cam_bodyid[number])
    return int(model.geom_bodyid[number]) if kind == mujoco.mjtObj.mjOBJ_GEOM else number


def _jacobian(data: mujoco.MjData, sensor: int) -> np.ndarray:
    """How the place of a sensor moves (3, nv) with the joints."""
    model, kinds = data.model, mujoco.mjtObj
    places = {
        int(kinds.mjOBJ_SITE): data.site_xpos, int(kinds.mjOBJ_CAMERA): data.cam_xpos,
        int(kinds.mjOBJ_GEOM): data.geom_xpos, int(kinds.mjOBJ_BODY): data.xipos, int(kinds.mjOBJ_XBODY): data.xpos,
    }  # fmt: skip
    jacobian = np.zeros((3, model.nv))
    place = places[int(model.sensor_objtype[sensor])][model.sensor_objid[sensor]]
    mujoco.mj_jac(model, data, jacobian, None, place, body_of(model, sensor))
    return jacobian


def reference_pose(model: mujoco.MjModel) -> mujoco.MjData:
    """Frames of bodies, sites and joints where the file puts them."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


def check_sensors(model: mujoco.MjModel, name: str, sensors: Mapping[str, Sensor]) -> None:
    """Base and malleolus are sensed where they are, and all by a velocity where the acceleration comes early."""
    expected = {"base": model.body_weldid[model.jnt_bodyid[model.joint("base").id]]}
    expected["malleolus"] = model.body_weldid[model.site_bodyid[model.site("malleolus").id]]
    for sensor, body in expected.items():
        on = body_of(model, model.sensor(sensor).id)
        if model.body_weldid[on] != body:
            place = "the table" if sensor == "base" else "the body of the site 'malleolus'"
            raise ModelError(f"{name}: sensor {sensor!r} sits on {model.body(on).name!r}; it belongs on {place}.")
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return
    data = reference_pose(model)
    for sensor in sensors:
        velocity = f"{sensor}_velocity"
        if sensor == "base":
            continue
        if velocity not in names(model, "sensor"):
            raise ModelError(
                f"{name}: with another integrator than RK4 accelerations are sensed half a step early; beside "
                f"{sensor!r} add the sensor {velocity!r}, a framelinvel at the same site."
            )
        one, other = model.sensor(sensor).id, model.sensor(velocity).id
        if leans(data, one, sensors["base"].axis):
            raise ModelError(
                f"{name}: sensor {sensor!r} leans, and {velocity!r} reads the vertical; turn its site, or use RK4."
            )
        if model.sensor_type[other] != mujoco.mjtSensor.mjSENS_FRAMELINVEL:
            raise ModelError(
                f"{name}: sensor {velocity!r} is read in the world's axes; make it a framelinvel at a site."
            )
        if model.body_weldid[body_of(model, one)] != model.body_weldid[body_of(model, other)]:
            on = model.body(body_of(model, other)).name
            raise ModelError(f"{name}: sensor {velocity!r} sits on {on!r}; it belongs where sensor {sensor!r} is.")
        if np.abs(_jacobian(data, one) - _jacobian(data, other)).max() > _SAME_PLACE:
            raise ModelError(
                f"{name}: sensor {velocity!r} sits at another place of {model.body(body_of(model, other)).name!r} than "
                f"sensor {sensor!r}, and the body turns; put both at one site."
            )
