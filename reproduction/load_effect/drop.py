"""A mass dropped on a heel pad, stepped by MuJoCo with gravity: Kinoshita's 5 kg at 0.93 m/s.

The pad is any law that a joint's `user` field can carry (fasbody/foot/damper.py), or a spring and a damper.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from fasbody.constants import MODEL_GRAVITY
from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot import damper
from fasbody.foot.engine import callbacks
from fasbody.presentation import Tabled
from identification.rivals.pad_balance import REFERENCE_N
from reproduction.arch_validation.drop import MASS_KG, MEASURED, SPEED_M_S, absorbed

#: Laws 2 and 1 fitted to the three numbers of the drop (three constants each), so no evidence for either.
DROPPED = "2 4884.3 281.74 2.0158 0 -1"
DROPPED_POWER = "1 22845.7 43 2.50122 1.97333 0 -1"
#: Power laws of the heels of eleven walkers (docs/heel_pad.md; mean of the population) as F_5 [N] and n. They saw no
#: drop. Their damper was not decided; `WALKED_ETA` [s/m] is that of the drop's power law, so the energy is no evidence.
WALKED, WALKED_ETA = {"slow walkers": (61.9, 2.87), "normal walkers": (57.8, 3.48)}, 1.97333
#: Step of the simulation and how long it may take [s].
STEP, LONGEST = 2e-5, 0.5

_MODEL = """
<mujoco>
  <option timestep="{step}" integrator="RK4" gravity="0 -9.81 0"/>
  <size nuser_jnt="8"/>
  <worldbody>
    <body><joint name="pad" type="slide" axis="0 1 0" stiffness="{k}" damping="{c}" user="{user}"/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/></body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class Drop(Tabled):
    """What the mass did.

    Attributes:
        peak_g: highest force of the pad over the weight. depth_mm: deepest compression.
        absorbed_percent: of the energy at the deepest place, what does not come back.
        tangent_kn_m: stiffness of the resting pad at `REFERENCE_N`.
    """

    peak_g: float
    depth_mm: float
    absorbed_percent: float
    tangent_kn_m: float

    @property
    def met(self) -> dict[str, bool]:
        """Which measured ranges hold it."""
        return {name: low <= getattr(self, name) <= high for name, (low, _, high) in MEASURED.items()}


def drop(user: str = DROPPED, stiffness: float | str = 0.0, damping: float = 0.0, mass_kg: float = MASS_KG,
         speed_m_s: float = SPEED_M_S, step: float = STEP) -> Drop:  # fmt: skip
    """Drop a mass on a pad whose law, beside spring and damper, is `user`, as MJCF writes it ("" for none).

    Args:
        user: law and parameters; with W = 0, as the pad begins unloaded. stiffness: [N/m], or MJCF's polynomial.
        damping: [N s/m]. mass_kg: [kg]. speed_m_s: at touch. step: of the simulation [s].

    Raises:
        SimulationError: the mass does not come back.
    """
    text = _MODEL.format(step=step, k=stiffness, c=damping, user=user or "0", mass=mass_kg)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[0] = -speed_m_s
    down, rate, push = [0.0], [-speed_m_s], [0.0]
    with callbacks():
        for _ in range(int(LONGEST / step)):
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)
            down.append(-float(data.qpos[0]))
            rate.append(float(data.qvel[0]))
            push.append(float(data.qfrc_passive[0]))
            left, turned = push[-1] <= 0 < rate[-1], rate[-1] <= 0 < max(rate)
            if left or turned:
                break
        else:
            raise SimulationError(f"the mass does not come back within {LONGEST:g} s.")
    F, x = np.array(push), np.array(down)
    lost = 100 * float(absorbed(speed_m_s, x.max(), x[-1], rate[-1]))
    return Drop(float(F.max() / (mass_kg * MODEL_GRAVITY)), 1e3 * float(x.max()), lost, _tangent(model) / 1e3)


def walked(F_5: float, n: float, eta: float = WALKED_ETA) -> str:
    """Law 1 as MJCF writes it, of a pad with F = F_5 (x/5 mm)^n."""
    d = 5e-3 * (REFERENCE_N / F_5) ** (1 / n)
    return f"1 {n * REFERENCE_N / d:.8g} {REFERENCE_N:g} {n:g} {eta:g} 0 -1"


def checked(law: str) -> str:
    """A law of a pad as it is typed.

    Raises:
        SettingError: it is none that begins unloaded.
    """
    laws = [each for each in damper.LAWS if each.code in damper.ONE_SIDED]
    try:
        numbers = [float(word) for word in law.split()]
    except ValueError:
        numbers = []
    one = next((each for each in laws if numbers and each.code == numbers[0]), None)
    good = one is not None and len(numbers) == len(one.parameters) + 1 and np.isfinite(numbers).all()
    if not (good and min(numbers[1:-3]) > 0 and numbers[-3] >= 0 and numbers[-2:] == [0, -1]):
        valid = "; ".join(f"{each.equation} {' '.join(each.parameters[:-2])} 0 -1" for each in laws)
        raise SettingError(f"the law of a dropped pad is {law!r}, but must be one of: {valid}, all positive.")
    return law


def drops() -> dict[str, Drop]:
    """The drop on every pad of docs/load.md: by what it was fitted to."""
    found = {
        "exponential, fitted to the drop": drop(DROPPED),
        "power, fitted to the drop": drop(DROPPED_POWER),
    }
    found |= {f"power of {who}": drop(walked(*law)) for who, law in WALKED.items()}
    return found | {
        "power, for the vibration (lift-off)": drop("1 200000 43 1.9 0.3 0 -1"),
        "nominal k_F, c_21 of two_dof.xml": drop("", 1e5, 800),
    }


def _tangent(model: mujoco.MjModel) -> float:
    """Stiffness [N/m] of the resting pad where it carries `REFERENCE_N`."""
    data, grid = mujoco.MjData(model), np.linspace(0, 0.02, 4001)
    F = np.zeros_like(grid)
    with callbacks():
        for i, x in enumerate(grid):
            data.qpos[0], data.qvel[0] = -x, 0.0
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_passive(model, data)
            F[i] = data.qfrc_passive[0]
    return float(np.interp(REFERENCE_N, F, np.gradient(F, grid)))
