"""MuJoCo's native callbacks: nonlinear dampers, pad laws and the shaker, without the GIL.

MuJoCo calls a C function (native.py) for user-defined forces. Callbacks are global to the process: `callbacks()`
installs them for a `with` block, and the last of such blocks to end, in whichever thread, restores what was there. They
act on marked elements only: joints and tendons whose `user` field starts with a law's number (damper.py), and actuators
whose `biasprm` starts with the number of a law or of the shaker.

The compiled code reads mjModel and mjData by word offsets, which `find_offsets` finds at start-up in the structs of a
probe model: the addresses of the arrays are known to Python, the words that hold them are their offsets, and a count is
the word that follows it through several models. A self-test against the Python twin refuses a MuJoCo that is laid out
differently.
"""

import ctypes
import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from fasbody.exceptions import EngineError
from fasbody.foot import damper
from fasbody.foot.damper import VISCOELASTIC, algebraic_force, viscoelastic_force, viscoelastic_rate
from fasbody.foot.native import SHAKER, addresses
from fasbody.foot.shaker import CLOCK

#: Controls of the actuator that drives the base: the step's start time, and the Taylor coefficients a0..a3 of the base
#: acceleration within the step, time in units of its CLOCK.
SHAKER_CONTROLS = 5

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

_PASSIVE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
_ACTUATOR = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)


@dataclass(frozen=True)
class Callbacks:
    """The native callbacks, and what silences MuJoCo's log; they keep the compiled code alive."""

    passive: Any
    act_dyn: Any
    act_bias: Any
    warning: Any


@functools.cache
def native() -> Callbacks:
    """The compiled callbacks, loaded and self-tested once a process.

    Raises:
        EngineError: the installed MuJoCo is laid out differently, or the self-test disagrees.
    """
    at = addresses(find_offsets(), mujoco.mjNBIAS)
    compiled = Callbacks(_PASSIVE(at["passive"]), _ACTUATOR(at["act_dyn"]), _ACTUATOR(at["act_bias"]), _quiet)
    difference = self_test(compiled)
    if not difference < 1e-12:
        raise EngineError(
            f"the native callbacks differ from their Python twin by {difference:.1e} (relative) on MuJoCo "
            f"{mujoco.__version__}; install mujoco==4.0.*."
        )
    return compiled


def self_test(compiled: Callbacks) -> float:
    """Largest relative difference between native and Python callbacks over short runs of two probe models."""
    return max(_difference(compiled, probe_model(joints, tendons)) for joints, tendons in ((0, 1), (2, 0)))


def _difference(compiled: Callbacks, model: mujoco.MjModel) -> float:
    runs = []
    for pair in (compiled, python_twin()):
        data = mujoco.MjData(model)
        rng = np.random.default_rng(0)
        rows = []
        with callbacks(pair):
            data.qpos[:], data.qvel[:] = rng.normal(0, 1e-3, model.nq), rng.normal(0, 0.1, model.nv)
            for _ in range(5):
                data.ctrl[:SHAKER_CONTROLS] = [data.time, *rng.normal(0, 5, 4)]
                mujoco.mj_step(model, data)
                rows.append(np.concatenate([data.qacc, data.act_dot, data.qfrc_passive]))
        runs.append(np.array(rows))
    return float(np.max(np.abs(runs[0] - runs[1]) / (1e-9 + np.abs(runs[1]).max(axis=0))))


def python_twin() -> Callbacks:
    """The same callbacks in Python: slow, readable, for tests."""

    def passive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if model.nuser_jnt == damper.USER_SIZE:
            for j in range(model.njnt):
                q, v = model.jnt_qposadr[j], model.jnt_dofadr[j]
                x = data.qpos[q] - model.qpos_spring[q]
                data.qfrc_passive[v] += algebraic_force(model.jnt_user[j], x, data.qvel[v], model.dof_damping[v])
        if model.nuser_tendon == damper.USER_SIZE:
            for t in range(model.ntendon):
                x = data.ten_length[t] - model.tendon_length0[t]
                pull = algebraic_force(model.tendon_user[t], x, data.ten_velocity[t], model.tendon_damping[t])
                row = slice(model.ten_J_rowadr[t], model.ten_J_rowadr[t] + model.ten_J_rownnz[t])
                data.qfrc_passive[model.ten_J_colind[row]] += data.ten_J.ravel()[row] * pull

    def act_bias(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
        p = model.actuator_biasprm[actuator]
        if p[0] == SHAKER:
            c = data.ctrl[model.actuator_ctrladr[actuator] :][:SHAKER_CONTROLS]
            return float(np.polyval(c[:0:-1], (data.time - c[0]) / CLOCK))
        if p[0] == VISCOELASTIC:
            h = data.act[model.actuator_actadr[actuator] :][: damper.BRANCHES]
            return viscoelastic_force(p, h, data.actuator_length[actuator] - model.actuator_length0[actuator])
        if p[0] == damper.MAXWELL:
            return float(-data.act[model.actuator_actadr[actuator]])
        return 0.0

    def act_dyn(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
        p = model.actuator_biasprm[actuator]
        if p[0] == VISCOELASTIC:
            first = model.actuator_actadr[actuator]
            h = data.act[first : first + damper.BRANCHES].copy()
            x, x_dot = (
                data.actuator_length[actuator] - model.actuator_length0[actuator],
                data.actuator_velocity[actuator],
            )
            for i in range(damper.BRANCHES):
                data.act_dot[first + i] = viscoelastic_rate(p, h, x, x_dot, i)
        if p[0] == damper.MAXWELL:
            return float(p[1] * data.actuator_velocity[actuator] - data.act[model.actuator_actadr[actuator]] / p[2])
        return 0.0

    return Callbacks(passive, act_dyn, act_bias, _quiet)


#: Discards MuJoCo's printed warnings; simulate.py reads their counters and raises an error.
_quiet = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda message: None)

_SLOTS: dict[str, tuple[Callable[[], Any], Callable[[Any], None]]] = {
    name: (getattr(mujoco, f"get_mjcb_{name}"), getattr(mujoco, f"set_mjcb_{name}"))
    for name in ("passive", "act_dyn", "act_bias")
}
_SLOTS["warning"] = (mujoco.get_mju_user_warning, mujoco.set_mju_user_warning)


#: What blocks have installed, the latest last, above what was there before; and what guards it.
_installed: list[Callbacks] = []
_LOCK = threading.Lock()


@contextmanager
def callbacks(chosen: Callbacks | None = None) -> Iterator[Callbacks]:
    """Install the callbacks (native by default) for the block; what was installed before is restored."""
    chosen = chosen or native()
    with _LOCK:
        if not _installed:
            _installed.append(Callbacks(**{name: get() for name, (get, _) in _SLOTS.items()}))
        _install(chosen)
    try:
        yield chosen
    finally:
        with _LOCK:
            del _installed[max(i for i, one in enumerate(_installed) if one is chosen)]  # threads end in any order
            _install(_installed.pop())
            if len(_installed) == 1:
                _installed.clear()


def _install(chosen: Callbacks) -> None:
    """Put callbacks in place, above those of other blocks."""
    for name, (_, put) in _SLOTS.items():
        put(getattr(chosen, name))
    _installed.append(chosen)


@contextmanager
def quiet() -> Iterator[None]:
    """No warning of MuJoCo on the screen or in a MUJOCO_LOG.TXT for the block."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_quiet)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


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
    <general name="maxwell" joint="a" dyntype="user" actdim="1" gainprm="0" biastype="user" biasprm="3 7e4 0.006"/>
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
