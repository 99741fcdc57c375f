"""Where MuJoCo 4.0 keeps each field of mjModel and mjData, found by searching a probe model's structs.

The addresses of the arrays are known to Python; the words of the C struct that hold them are their offsets. A count is
found as the word that follows it through several models.
"""

import ctypes
from typing import Any

import mujoco
import numpy as np

from fasbody.exceptions import EngineError

_MODEL_ARRAYS = (
    "jnt_user", "jnt_qposadr", "jnt_dofadr", "dof_damping", "qpos_spring", "tendon_user", "tendon_damping",
    "tendon_length0", "ten_J_rownnz", "ten_J_rowadr", "ten_J_colind", "actuator_biasprm", "actuator_ctrladr",
    "actuator_actadr", "actuator_outadr", "actuator_length0",
)  # fmt: skip
_DATA_ARRAYS = (
    "qpos", "qvel", "act", "act_dot", "ctrl", "qfrc_passive", "ten_J", "ten_length", "ten_velocity", "actuator_length",
    "actuator_velocity",
)  # fmt: skip
# The structs are at least this many 8-byte words long in MuJoCo 4.0; only these are searched.
MODEL_WORDS = 700
DATA_WORDS = 20_180

# Every array above is non-empty here, and the counts are unlike any other number in the structs.
_PROBE = """
<mujoco>
  <size nuser_jnt="{nuser_jnt}" nuser_tendon="{nuser_tendon}"/>
  <option gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="base"><joint name="base" type="slide" axis="0 1 0" armature="1e9"/><geom size="0.1" mass="1"/>
      <body><joint name="a" type="slide" axis="0 1 0" stiffness="3e4" damping="7" user="4.25 310 -120 180"/>
        <geom size="0.1" mass="2"/><site name="a"/>
        <body><joint name="b" type="slide" axis="0 1 0" user="4.24 900 30 0.02 0.2"/><geom size="0.1" mass="3"/>
          <site name="b"/>
          <body><joint name="c" type="slide" axis="0 1 0" stiffness="2e4"
            user="4.23 900 1.5 30 0.9 0.8 0.02 0.2"/><geom size="0.1" mass="1"/>{more}</body>
        </body>
      </body>
    </body>
    <body pos="0 1 0"><site name="ceiling"/></body>
  </worldbody>
  <tendon>
    <spatial name="t" user="4.25 200 50 90" damping="11"><site site="a"/><site site="ceiling"/></spatial>
    {tendons}
  </tendon>
  <actuator>
    <general name="shaker" joint="base" gear="1e9" biastype="user" biasprm="1"/>
    <general joint="base" gainprm="0"/><general joint="base" gainprm="0"/>
    <general joint="base" gainprm="0"/><general joint="base" gainprm="0"/>
    <general name="pad" joint="b" dyntype="user" actdim="8" gainprm="0" biastype="user"
      biasprm="4.22 40 5 0.8 0.004 1.5 0.02 0.2"/>
  </actuator>
</mujoco>
"""
# two joints a body, one of them a ball, so that joints, bodies, positions and velocities are counted differently
_MORE_JOINT = '<body><joint type="slide"/><joint type="ball"/><geom size="0.1" mass="1"/></body>'
_MORE_TENDON = '<fixed><joint joint="a" coef="1"/></fixed>'


def probe_model(joints: int = 0, tendons: int = 0, nuser_jnt: int = 8, nuser_tendon: int = 8) -> mujoco.MjModel:
    """A small model that uses every callback, with extra joints and tendons to tell counts apart."""
    extra = {"more": _MORE_JOINT * joints, "tendons": _MORE_TENDON * tendons}
    return mujoco.MjModel.from_xml_string(_PROBE.format(nuser_jnt=nuser_jnt, nuser_tendon=nuser_tendon, **extra))


def _words(struct: Any, count: int) -> np.ndarray:
    return np.ctypeslib.as_array((ctypes.c_int64 * count).from_address(struct._address))


def find_offsets() -> dict[str, int]:
    """Word offset of each needed field in mjModel and mjData.

    Raises:
        EngineError: a field was not found, so this MuJoCo is laid out differently.
    """
    offsets = {}
    model = probe_model()
    data = mujoco.MjData(model)
    data.time = 0.7390851332151607  # a value that no other field has
    for struct, names, count in ((model, _MODEL_ARRAYS, MODEL_WORDS), (data, _DATA_ARRAYS, DATA_WORDS)):
        words = _words(struct, count)
        for name in names:
            # An empty array shares the address of the next one, so the last hit is the field itself.
            offsets[name] = _last(np.flatnonzero(words == getattr(struct, name).ctypes.data), name)
    offsets["time"] = _last(np.flatnonzero(_words(data, DATA_WORDS).view(float) == data.time), "time")
    offsets["njnt"] = _counted("njnt", (0, 0), (2, 0), (5, 0))
    offsets["ntendon"] = _counted("ntendon", (0, 0), (0, 1), (0, 3))
    offsets["nuser_jnt"] = _counted("nuser_jnt", (0, 0, 9), (0, 0, 8), (0, 0, 10))
    offsets["nuser_tendon"] = _counted("nuser_tendon", (0, 0, 8, 9), (0, 0, 8, 8), (0, 0, 8, 10))
    return offsets


def _counted(name: str, *variants: tuple[int, ...]) -> int:
    """Offset of a count: the one word that equals it in every variant of the probe model."""
    models = [probe_model(*variant) for variant in variants]
    same = [_words(model, MODEL_WORDS) == getattr(model, name) for model in models]
    hits = np.flatnonzero(np.logical_and.reduce(same))
    return _last(hits if hits.size == 1 else hits[:0], name)


def _last(hits: np.ndarray, name: str) -> int:
    if hits.size == 0:
        raise EngineError(
            f"MuJoCo {mujoco.__version__} does not have the field {name!r} where version 4.0 has it; "
            "install mujoco==4.0.* to run native callbacks."
        )
    return int(hits[-1])
