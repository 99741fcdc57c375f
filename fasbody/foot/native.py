"""Machine code of MuJoCo's callbacks, from the force laws of damper.py.

MuJoCo calls a C function for user-defined forces. numba compiles it, so no C compiler is needed and rollouts run on all
cores. That takes seconds, and numba a second to load. So its LLVM IR is kept in the user's cache, and llvmlite alone,
on which numba stands, makes machine code of it.

The code reads mjModel and mjData by word offsets (engine.py), and calls nothing but the mathematics of C.
"""

import hashlib
import json
import platform
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import Any

import llvmlite.binding as llvm

from fasbody import cache
from fasbody.console import write_whole
from fasbody.exceptions import InputFileError
from fasbody.foot import damper
from fasbody.foot.shaker import CLOCK

#: `biasprm[0]` of the actuator that drives the base (shaker.py).
SHAKER = 1.0
#: Functions of C that the code may call.
_MATHEMATICS = {"exp", "expm1", "log", "log1p", "pow", "cos", "sin", "rint", "fabs"}
#: Laws that the callbacks call, and those that they call in turn.
_LAWS = (
    "damping", "power_law", "strain_damper", "elastic", "branch_time", "branch_weight", "one_sided", "algebraic_force",
    "viscoelastic_force", "viscoelastic_rate",
)  # fmt: skip
#: Machine code stays as long as what made it.
_engines: list[Any] = []


def addresses(offsets: Mapping[str, int], actuator_parameters: int) -> dict[str, int]:
    """Addresses of the compiled callbacks `passive`, `act_bias` and `act_dyn`.

    Args:
        offsets: of the fields in mjModel and mjData, in words.
        actuator_parameters: length of `biasprm`.
    """
    key = _key(offsets, actuator_parameters)
    file = cache.folder("callbacks") / f"{key}.json"
    try:
        return _loaded(json.loads(file.read_text()))
    except (OSError, ValueError, RuntimeError, TypeError, AttributeError, KeyError):
        pass  # none there, or not whole
    functions = _compiled(offsets, actuator_parameters)
    code = {name: {"symbol": made.native_name, "ir": made.inspect_llvm()} for name, made in functions.items()}
    try:
        at = _loaded(code)
    except RuntimeError:  # numba needs more than C on this machine
        _engines.append(functions)
        return {name: made.address for name, made in functions.items()}
    with suppress(InputFileError):  # a cache that cannot be written is none
        write_whole(file, json.dumps(code))
    return at


def _key(offsets: Mapping[str, int], actuator_parameters: int) -> str:
    """Digest of all that the code depends on."""
    machine = platform.machine(), llvm.get_default_triple(), llvm.get_host_cpu_name()
    versions = version("numba"), version("llvmlite")
    facts = json.dumps([machine, versions, sorted(offsets.items()), actuator_parameters, CLOCK])
    digest = hashlib.sha256(facts.encode())
    for source in (__file__, damper.__file__):
        digest.update(Path(source).read_bytes())
    return digest.hexdigest()[:32]


def _loaded(code: Mapping[str, Mapping[str, str]]) -> dict[str, int]:
    """Addresses of functions by name, from the symbol and the IR of each.

    Raises:
        RuntimeError: the IR is not whole, or calls what the process does not have.
    """
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=3, jit=True
    )
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)
    for function in code.values():
        module = llvm.parse_assembly(function["ir"])
        module.verify()
        called = {f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")}
        if called - _MATHEMATICS:
            raise RuntimeError(f"the callbacks call {', '.join(sorted(called - _MATHEMATICS))}")
        engine.add_module(module)
    engine.finalize_object()
    _engines.append(engine)
    at = {name: engine.get_function_address(function["symbol"]) for name, function in code.items()}
    if not all(at.values()):
        raise RuntimeError("the callbacks lack a symbol")
    return at


def _compiled(offsets: Mapping[str, int], actuator_parameters: int) -> dict[str, Any]:
    """The callbacks as numba's `CFunc`, by name."""
    from numba import cfunc, njit, types
    from numba.extending import intrinsic

    def view(element: Any) -> Any:
        """What makes a pointer to such elements of an address."""

        @intrinsic
        def pointer(context, address):  # type: ignore[no-untyped-def]
            def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
                return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

            return types.CPointer(element)(types.int64), codegen

        return pointer

    doubles, ints, words = view(types.float64), view(types.int32), view(types.int64)
    laws: dict[str, Any] = dict(vars(damper))
    for name in _LAWS:
        law = getattr(damper, name)
        laws[name] = njit(error_model="numpy", forceinline=True)(FunctionType(law.__code__, laws, name))
    algebraic_force, viscoelastic_force = laws["algebraic_force"], laws["viscoelastic_force"]
    viscoelastic_rate = laws["viscoelastic_rate"]

    NJNT, NTENDON = offsets["njnt"], offsets["ntendon"]
    NUSER_JNT, NUSER_TENDON = offsets["nuser_jnt"], offsets["nuser_tendon"]
    JNT_USER, JNT_QPOSADR, JNT_DOFADR = offsets["jnt_user"], offsets["jnt_qposadr"], offsets["jnt_dofadr"]
    DOF_DAMPING, QPOS_SPRING = offsets["dof_damping"], offsets["qpos_spring"]
    TEN_USER, TEN_DAMPING, TEN_LENGTH0 = offsets["tendon_user"], offsets["tendon_damping"], offsets["tendon_length0"]
    ROWNNZ, ROWADR, COLIND = offsets["ten_J_rownnz"], offsets["ten_J_rowadr"], offsets["ten_J_colind"]
    BIASPRM, CTRLADR, ACTADR = offsets["actuator_biasprm"], offsets["actuator_ctrladr"], offsets["actuator_actadr"]
    OUTADR, LENGTH0 = offsets["actuator_outadr"], offsets["actuator_length0"]
    LENGTH, VELOCITY = offsets["actuator_length"], offsets["actuator_velocity"]
    QPOS, QVEL, ACT, ACT_DOT = offsets["qpos"], offsets["qvel"], offsets["act"], offsets["act_dot"]
    CTRL, QFRC, TIME = offsets["ctrl"], offsets["qfrc_passive"], offsets["time"]
    TEN_J, TEN_LENGTH, TEN_VELOCITY = offsets["ten_J"], offsets["ten_length"], offsets["ten_velocity"]
    USER, PRM, BRANCHES, UNIT = damper.USER_SIZE, actuator_parameters, damper.BRANCHES, CLOCK
    RELAX, MAXWELL, DRIVEN = damper.VISCOELASTIC, damper.MAXWELL, SHAKER

    def passive(model, data):  # type: ignore[no-untyped-def]
        m, d = words(model), words(data)
        qfrc = doubles(d[QFRC])
        if m[NUSER_JNT] == USER:
            qposadr, dofadr = ints(m[JNT_QPOSADR]), ints(m[JNT_DOFADR])
            native, rest = doubles(m[DOF_DAMPING]), doubles(m[QPOS_SPRING])
            qpos, qvel = doubles(d[QPOS]), doubles(d[QVEL])
            for j in range(m[NJNT]):
                user = doubles(m[JNT_USER] + 8 * j * USER)
                if user[0] != 0.0:
                    q, v = qposadr[j], dofadr[j]
                    qfrc[v] += algebraic_force(user, qpos[q] - rest[q], qvel[v], native[v])
        if m[NUSER_TENDON] == USER:
            native, rest = doubles(m[TEN_DAMPING]), doubles(m[TEN_LENGTH0])
            length, velocity = doubles(d[TEN_LENGTH]), doubles(d[TEN_VELOCITY])
            count, start = ints(m[ROWNNZ]), ints(m[ROWADR])
            column, J = ints(m[COLIND]), doubles(d[TEN_J])
            for t in range(m[NTENDON]):
                user = doubles(m[TEN_USER] + 8 * t * USER)
                if user[0] != 0.0:
                    pull = algebraic_force(user, length[t] - rest[t], velocity[t], native[t])
                    for k in range(start[t], start[t] + count[t]):
                        qfrc[column[k]] += J[k] * pull

    def act_bias(model, data, actuator):  # type: ignore[no-untyped-def]
        m, d = words(model), words(data)
        p = doubles(m[BIASPRM] + 8 * PRM * actuator)
        if p[0] == DRIVEN:
            c = doubles(d[CTRL] + 8 * ints(m[CTRLADR])[actuator])
            s = (doubles(data)[TIME] - c[0]) / UNIT
            return c[1] + s * (c[2] + s * (c[3] + s * c[4]))
        if p[0] == RELAX:
            h = doubles(d[ACT] + 8 * ints(m[ACTADR])[actuator])
            out = ints(m[OUTADR])[actuator]
            return viscoelastic_force(p, h, doubles(d[LENGTH])[out] - doubles(m[LENGTH0])[out])
        if p[0] == MAXWELL:
            return -doubles(d[ACT])[ints(m[ACTADR])[actuator]]
        return 0.0

    def act_dyn(model, data, actuator):  # type: ignore[no-untyped-def]
        m, d = words(model), words(data)
        p = doubles(m[BIASPRM] + 8 * PRM * actuator)
        first, out = ints(m[ACTADR])[actuator], ints(m[OUTADR])[actuator]
        if p[0] == RELAX:
            h, rate = doubles(d[ACT] + 8 * first), doubles(d[ACT_DOT] + 8 * first)
            x, x_dot = doubles(d[LENGTH])[out] - doubles(m[LENGTH0])[out], doubles(d[VELOCITY])[out]
            for i in range(BRANCHES):
                rate[i] = viscoelastic_rate(p, h, x, x_dot, i)
        if p[0] == MAXWELL:
            # MuJoCo stores what is returned where there is one activation
            return p[1] * doubles(d[VELOCITY])[out] - doubles(d[ACT])[first] / p[2]
        return 0.0

    address, index = types.int64, types.int32
    signatures = {
        passive: types.void(address, address),
        act_bias: types.float64(address, address, index),
        act_dyn: types.float64(address, address, index),
    }
    return {f.__name__: cfunc(signature, error_model="numpy")(f) for f, signature in signatures.items()}
