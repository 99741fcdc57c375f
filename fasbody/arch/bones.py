"""The five-body arch as numbers: geometry and masses (Table 4.1), constants, random draws (Table 4.2).

Angles are measured from the vertical as in Figure 4.2: theta_1 of the calcaneus-talus leans towards the heel, theta_2
(navicular), theta_3 (cuneiforms) and theta_4 (metatarsals) lean towards the toes. The stated pose is the one in which
every spring is at rest.
"""

from dataclasses import dataclass, fields, replace
from functools import cache
from math import acos, cos, degrees, sin
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from fasbody.exceptions import ModelError
from fasbody.presentation import Tabled

if TYPE_CHECKING:
    import mujoco

#: The 13 constants that the thesis leaves unknown, in the order of Table 4.2.
SPRINGS = ("k_11", "k_12", "k_2", "k_3", "k_4", "k_T", "k_F")
DAMPERS = ("c_1", "c_2", "c_3", "c_4", "c_T", "c_F")
PARAMETERS = SPRINGS + DAMPERS

#: The rotational ones; Table 4.2 gives their range together with the N/m ones, without a unit of its own.
ROTATIONAL = ("k_2", "k_3", "k_4", "c_2", "c_3", "c_4")

#: Table 4.2, with the unit of the translational constants: N/m and N s/m.
SPRING_RANGE = (1e4, 3e6)
DAMPER_RANGE = (1e2, 3e3)

#: The geometric middle of both ranges.
_MIDDLE = dict.fromkeys(SPRINGS, float(np.sqrt(np.prod(SPRING_RANGE))))
_MIDDLE |= dict.fromkeys(DAMPERS, float(np.sqrt(np.prod(DAMPER_RANGE))))

Inertias = Literal["thesis", "centroidal"]


@dataclass(frozen=True, kw_only=True)
class Arch(Tabled):
    """All constants of the five-body arch; SI units, angles in rad.

    Attributes:
        m_T: mass of the tibia [kg].
        m_1: mass of calcaneus and talus [kg]; m_2 navicular, m_3 cuneiforms, m_4 metatarsals.
        L_1: length of calcaneus and talus, heel to apex [m]; L_2, L_3, L_4 from the apex to the metatarsal heads.
        I_1: moment of inertia about the centre of mass [kg m^2]; likewise I_2, I_3, I_4.
        theta_20: rest angle of the navicular from the vertical [rad]; likewise theta_30, theta_40.
        k_11: relaxed stiffness of the plantar aponeurosis [N/m]; k_12 in series with c_1 beside it.
        k_2: rotational stiffness at the apex [N m/rad] (spring ligament); k_3, k_4 at the next two joints.
        k_T: stiffness of the talocrural joint [N/m]; k_F of the fat pad under heel and forefoot together.
        c_1: dashpot of the aponeurosis [N s/m]; c_2, c_3, c_4 [N m s/rad]; c_T, c_F [N s/m].
    """

    m_T: float
    m_1: float
    m_2: float
    m_3: float
    m_4: float
    L_1: float
    L_2: float
    L_3: float
    L_4: float
    I_1: float
    I_2: float
    I_3: float
    I_4: float
    theta_20: float
    theta_30: float
    theta_40: float
    k_11: float
    k_12: float
    k_2: float
    k_3: float
    k_4: float
    k_T: float
    k_F: float
    c_1: float
    c_2: float
    c_3: float
    c_4: float
    c_T: float
    c_F: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            # c_1 and k_12 may vanish only together with their branch, whose rate is k_12 / c_1
            must_be_positive = field.name[0] in "mLI" or field.name == "c_1"
            if not np.isfinite(value) or value < 0 or (must_be_positive and value == 0):
                valid = "above zero" if must_be_positive else "zero or more"
                raise ModelError(f"arch: {field.name} is {value:g}, but must be a finite number {valid}.")
        if not self.height_0 < self.L_1:
            raise ModelError(
                f"arch: the forefoot rises {self.height_0 * 1e3:.1f} mm, but a hindfoot of L_1 = "
                f"{self.L_1 * 1e3:.1f} mm cannot reach its top; lengthen L_1 or increase theta_20 to theta_40."
            )

    @property
    def height_0(self) -> float:
        """Rest height of the apex over heel and metatarsal heads [m], E_20 of Eq. (4.12)."""
        return self.L_2 * cos(self.theta_20) + self.L_3 * cos(self.theta_30) + self.L_4 * cos(self.theta_40)

    @property
    def theta_10(self) -> float:
        """Rest angle of calcaneus and talus [rad] from Eq. (4.7), not from the rounded 59.7 deg of Table 4.1.

        The rounded angle would leave the arch open by 3.6 um and the aponeurosis with a false preload.
        """
        return acos(self.height_0 / self.L_1)

    @property
    def l_0(self) -> float:
        """Rest length of the plantar aponeurosis, heel to metatarsal heads [m]."""
        front = self.L_2 * sin(self.theta_20) + self.L_3 * sin(self.theta_30) + self.L_4 * sin(self.theta_40)
        return self.L_1 * sin(self.theta_10) + front

    @property
    def m_F(self) -> float:
        """Mass of the four foot segments [kg]; section 4.5 uses 0.0145 of the body mass instead, four times as much."""
        return self.m_1 + self.m_2 + self.m_3 + self.m_4

    @classmethod
    def nominal(cls) -> Self:
        """The shipped foot_arch.xml: Table 4.1 with constants that meet several measurements (docs/load.md).

        The file is compiled as every edited copy is, not parsed a second way: classes, nested angles and halves of
        pads are then resolved by MuJoCo, and there is one reader.
        """
        return cls(**_shipped())

    @classmethod
    def thesis(cls, inertias: Inertias = "thesis") -> Self:
        """Table 4.1 with the constants in the (geometric) middle of Table 4.2.

        Args:
            inertias: "thesis" keeps Table 4.1, whose bodies 1 and 2 have the value of a rod about its end, m L^2 / 3;
                "centroidal" gives all four m L^2 / 12.
        """
        arch = cls.nominal().middle()
        if inertias == "thesis":
            return arch
        return replace(arch, **{f"I_{i}": m * L**2 / 12 for i, (m, L) in enumerate(arch.links, 1)})

    @classmethod
    def from_model(cls, model: "mujoco.MjModel", name: str = "model") -> Self:
        """The constants of a compiled foot_arch model or an edited copy, so that one XML feeds all routes.

        Args:
            model: the compiled model, such as `load("foot_arch").model`.
            name: what to call it in messages.

        Raises:
            ModelError: the model is no five-body arch, or departs from it, or has gravity; the message names the
                element.
        """
        from fasbody.arch.mjcf import numbers  # the equations alone need no MuJoCo

        if model.opt.gravity.any():
            raise ModelError(
                f"{name}: <option> has gravity, and these equations are about the state in which it is balanced "
                '(Eq. 4.29); write gravity="0 0 0" (crosscheck alone follows it).'
            )
        return cls(**numbers(model, name))

    @classmethod
    def read(cls, model: str | Path) -> Self:
        """The constants of a shipped model or an MJCF file.

        Args:
            model: as for `fasbody.foot.model.load`.

        Raises:
            InputFileError: no such model, or MuJoCo cannot compile it.
            ModelError: see `from_model`.
        """
        from fasbody.foot.model import load

        foot = load(model)
        return cls.from_model(foot.model, foot.name)

    @property
    def links(self) -> tuple[tuple[float, float], ...]:
        """Mass [kg] and length [m] of the four bones of the foot."""
        return tuple((getattr(self, f"m_{i}"), getattr(self, f"L_{i}")) for i in range(1, 5))

    def tension(self, e: NDArray[Any]) -> NDArray[Any]:
        """Of the relaxed aponeurosis [N] at its elongation e [m], any shape, real or complex."""
        return self.k_11 * e

    def moment(self, joint: int, d: NDArray[Any]) -> NDArray[Any]:
        """Of the ligaments [N m] at the turn d [rad] of joint 2, 3 or 4, any shape, real or complex."""
        return getattr(self, f"k_{joint}") * d

    def middle(self) -> Self:
        """The same bones with the constants of `thesis`."""
        return replace(self, **_MIDDLE)

    @classmethod
    def draw(cls, rng: np.random.Generator, lever_arm_m: float | None = None, inertias: Inertias = "thesis") -> Self:
        """Table 4.1 with the 13 constants drawn uniformly from Table 4.2.

        Args:
            rng: source of the random numbers.
            lever_arm_m: reads the range of the rotational constants as N/m and N s/m acting at this arm, so that they
                become k r^2 [N m/rad]; None takes the printed range literally for N m/rad and N m s/rad.
            inertias: see `thesis`.

        Raises:
            ModelError: the lever arm is not positive.
        """
        return cls.thesis(inertias).drawn(rng, lever_arm_m)

    def drawn(self, rng: np.random.Generator, lever_arm_m: float | None = None) -> Self:
        """The same bones with the 13 constants drawn as in `draw`."""
        if lever_arm_m is not None and not lever_arm_m > 0:
            raise ModelError(f"lever arm is {lever_arm_m:g} m, but must be above zero.")
        constants = {name: float(rng.uniform(*SPRING_RANGE)) for name in SPRINGS}
        constants |= {name: float(rng.uniform(*DAMPER_RANGE)) for name in DAMPERS}
        if lever_arm_m is not None:
            constants |= {name: constants[name] * lever_arm_m**2 for name in ROTATIONAL}
        return replace(self, **constants)

    def with_height(self, height: float) -> Self:
        """The same bones spread so that the apex rests at `height` [m]; Arangio's family of arches.

        The three forefoot links keep their angles to each other and turn as one about the metatarsal heads.

        Raises:
            ModelError: no such pose exists.
        """
        up, along = self.height_0, self.l_0 - self.L_1 * sin(self.theta_10)
        reach = np.hypot(up, along)
        highest = min(reach, self.L_1)
        if not 0 < height < highest:
            raise ModelError(
                f"arch: height is {height * 1e3:g} mm, but these bones reach more than 0 and less than "
                f"{highest * 1e3:.0f} mm."
            )
        turn = float(np.arccos(height / reach) - np.arccos(up / reach))
        angles = {name: getattr(self, name) + turn for name in ("theta_20", "theta_30", "theta_40")}
        return replace(self, **angles)

    def __str__(self) -> str:
        return (
            f"five-body arch: {self.height_0 * 1e3:.1f} mm high, {self.l_0 * 1e3:.1f} mm long, foot {self.m_F:.3f} kg, "
            f"tibia {self.m_T:.2f} kg, theta_1 {degrees(self.theta_10):.3f} deg\n"
            + "\n".join(f"  {name:5} {getattr(self, name):12.6g}" for name in PARAMETERS)
        )


@cache
def _shipped() -> dict[str, float]:
    return vars(Arch.read("foot_arch"))
