"""A foot by name, file or arch height, and the files behind it."""

from math import degrees
from pathlib import Path

import mujoco
import numpy as np

import mjcf
from fasbody.arch.bones import Arch
from fasbody.exceptions import ModelError, SettingError
from fasbody.foot.model import Foot, check, load, read_spec

#: The way that the stage shows as up.
_UP = (0.0, 1.0, 0.0)


def load_foot(name: str, called: str = "") -> Foot:
    """A model by name or file; ``foot_arch@25`` is the arch with its bones spread to a rest height of 25 mm.

    Args:
        name: of the model, or its file.
        called: what to call a file's model, if not as the file.

    Raises:
        InputFileError: no such model. ModelError: the model has no such arch. SettingError: no name, or a height that
            is no number.
    """
    if not name.strip():
        raise SettingError(f"a model needs a name: one of {', '.join(mjcf.names())}, or an MJCF file.")
    model, at, height = name.partition("@")
    if not at:
        return _upright(load(model, called))
    try:
        metres = 1e-3 * float(height)
    except ValueError:
        raise SettingError(f"{name}: the arch height {height!r} is not a number in mm, such as foot_arch@25.") from None
    foot = load(model)
    arch = Arch.from_model(foot.model, name).with_height(metres)
    spec = read_spec(mjcf.path(model) if model in mjcf.names() else Path(model))
    turns = {
        "calcaneus_talus": -arch.theta_10, "navicular": arch.theta_10 + arch.theta_20,
        "cuneiforms": arch.theta_30 - arch.theta_20, "metatarsals": arch.theta_40 - arch.theta_30,
    }  # fmt: skip
    for body, angle in turns.items():
        spec.body(body).alt.euler = [0, 0, degrees(angle) if spec.compiler.degree else angle]
    spec.body("apex").pos = [0, arch.height_0, 0]
    heel = -arch.L_1 * np.sin(arch.theta_10)
    for site, x in (("heel_ground", heel), ("forefoot_ground", heel + arch.l_0)):
        spec.site(site).pos = [x, *spec.site(site).pos[1:]]
    return check(spec.compile(), name)


def name_and_values(foot: Foot) -> tuple[str, dict[str, float]] | None:
    """Name, or file, and values by which a loaded model can be loaded again; None where that would be another model."""
    if foot.name.partition("@")[0] not in mjcf.names() and not Path(foot.name).is_file():
        return None
    again = load_foot(foot.name)
    before = again.values()
    values = {name: value for name, value in foot.values().items() if value != before.get(name)}
    same = np.array_equal(_bytes(again.with_values(values).model), _bytes(foot.with_values(values).model))
    return (foot.name, values) if same else None


def _bytes(model: mujoco.MjModel) -> np.ndarray:
    """A compiled model as MuJoCo writes it."""
    file = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, file)
    return file


def files_of(name: str) -> set[Path]:
    """The MJCF file of a model with every file that it includes, absolute; of a shipped model none."""
    model = name.partition("@")[0]
    return set() if model in mjcf.names() else set(mjcf.parts(Path(model)))


def _upright(foot: Foot) -> Foot:
    if np.abs(np.subtract(foot.up, _UP)).max() > 1e-6:
        x, y, z = foot.up
        raise ModelError(
            f"{foot.name}: is drawn with y up, and its base moves along {x:g} {y:g} {z:g}; turn the model to see it."
        )
    return foot
