"""The force laws of a model: a mistyped number is refused, never a silent zero force."""

import mujoco
import numpy as np

from fasbody.exceptions import ModelError
from fasbody.foot import damper
from fasbody.foot.parameters import names


def check_laws(model: mujoco.MjModel, name: str) -> None:
    """Refuse a law that is unknown or lacks a parameter, so that a mistyped number is never a silent zero force."""
    memory = [law for law in damper.LAWS if law.code in damper.MEMORY]
    algebraic = [law for law in damper.LAWS if law.code not in damper.MEMORY]
    for kind, user in (("joint", model.jnt_user), ("tendon", model.tendon_user)):
        if user.size and user.shape[1] != damper.USER_SIZE and np.any(user):
            size = f'nuser_{"jnt" if kind == "joint" else "tendon"}="{damper.USER_SIZE}"'
            raise ModelError(f"{name}: {kind} user fields have {user.shape[1]} numbers; laws need <size {size}/>.")
        for element, row in zip(names(model, kind), user, strict=False):
            if row.any():
                _check_law(row, algebraic, f"{name}: the user field of {kind} {element!r}")
    _check_dampers(model, name)
    for actuator in range(model.nactuator):
        row, user = model.actuator_biasprm[actuator], model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_USER
        if user and row[0] in damper.MEMORY:
            where = f"{name}: the biasprm of actuator {model.actuator(actuator).name!r}"
            _check_law(row[: damper.USER_SIZE], memory, where)
            if model.actuator_actnum[actuator] != damper.MEMORY[row[0]]:
                raise ModelError(f'{where} names the law {row[0]:g}, which needs actdim="{damper.MEMORY[row[0]]}".')


def _check_dampers(model: mujoco.MjModel, name: str) -> None:
    """A damper that stands in the law 4.25 and in `damping`, for MuJoCo alone, must be the same in both."""
    kinds = (
        ("joint", model.jnt_user, model.dof_damping[model.jnt_dofadr]),
        ("tendon", model.tendon_user, model.tendon_damping),
    )
    for kind, laws, native in kinds:
        for i in np.flatnonzero(laws[:, :1] == damper.DAMPER):
            if native[i] and abs(native[i] - laws[i, 1]) > 1e-6 * laws[i, 1]:
                raise ModelError(
                    f"{name}: {kind} {getattr(model, kind)(i).name!r} has damping={native[i]:g} beside "
                    f"c_1 = {laws[i, 1]:g} of its law 4.25; write the same number in both, or no damping."
                )


def _check_law(row: np.ndarray, laws: list[damper.Law], where: str) -> None:
    """One law's parameters: pads need positive stiffness, thickness and static strain."""
    law = next((law for law in laws if law.code == row[0]), None)
    if law is None:
        valid = "; ".join(f"{law.equation} {' '.join(law.parameters)}" for law in laws)
        raise ModelError(f"{where} names the law {row[0]:g} (valid: {valid}).")
    if not np.isfinite(row).all():
        raise ModelError(f"{where} gives a parameter that is no number to the law {law.equation}.")
    if row[1 + len(law.parameters) :].any():
        needs = f"{law.equation} {' '.join(law.parameters)}"
        raise ModelError(f"{where} has more numbers than its law has ({needs}); remove those behind.")
    if law.code == damper.DAMPER and row[1] == 0:
        raise ModelError(f"{where} names the law 4.25 with c1 = 0, no damper; write 4.25 c1 c2 c3, or no user field.")
    if law.code in damper.ONE_SIDED and row[len(law.parameters)] not in (-1, 1):
        raise ModelError(f"{where} gives side = {row[len(law.parameters)]:g} to the law {law.equation}; write 1 for an "
                         "element that is pulled, -1 for one that is pressed.")  # fmt: skip
    free = ("eta", "W", "side") if law.code in damper.ONE_SIDED else ("l", "eta", "c", "m", "n")
    if law.code != damper.DAMPER:
        for parameter, value in zip(law.parameters, row[1:], strict=False):
            short = parameter.split()[0]
            if (value <= 0 and short not in free) or (value < 0 and short in ("eta", "W")):
                form = f"{law.equation} {' '.join(law.parameters)}"
                raise ModelError(
                    f"{where} gives {short} = {value:g} to the law {law.equation}; write {form}, all positive."
                )
