"""Explanations of the resonance that rises with the load: spaces of constants, and responses.

Bounds are those of the sources named; where there is none they are broad and called nominal. Every
mechanism answers for many draws at once. MB and TM are the fundamentals of malleolus and of
tuberosity over malleolus.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fasbody.constants import MODEL_GRAVITY
from identification.rivals.pad_balance import HARMONICS, Pressed

Array = np.ndarray
#: Mean body mass of Chapter 2 [kg].
BODY_KG = 70.7
#: Constants that are masses: the body mass scales them.
MASSES = ("m", "m_F", "m_S", "m_H")
#: Soft tissue that moves with the added mass [kg], nominal, as in mjcf/leg.xml.
TISSUE_KG = 0.2


@dataclass(frozen=True)
class Constant:
    """A constant with its bounds.

    Attributes:
        name: symbol.
        unit: of the bounds.
        lower: bound.
        upper: bound.
        source: of the bounds.
        even: drawn evenly in itself, not in its logarithm.
    """

    name: str
    unit: str
    lower: float
    upper: float
    source: str
    even: bool = False

    def value(self, share: Array) -> Array:
        """From a share (...) of the way between the bounds."""
        if self.even:
            return self.lower + share * (self.upper - self.lower)
        return self.lower * (self.upper / self.lower) ** share


@dataclass(frozen=True)
class Mechanism:
    """One explanation, linear or on a pad that cannot pull.

    Attributes:
        name: in a word or two.
        constants: what is drawn.
        response: of a linear one; frequencies [Hz], constants and added masses [kg], which
            broadcast, -> MB and TM, complex.
        standing: on a pad that cannot pull; the same -> dynamic mass on the pad [kg], malleolus
            over foot, and TM, at each harmonic (..., HARMONICS).
    """

    name: str
    constants: tuple[Constant, ...]
    response: Callable[..., tuple[Array, Array]] | None = None
    standing: Callable[..., tuple[Array, Array, Array]] | None = None

    @property
    def pressed(self) -> bool:
        """Whether it stands on a pad that cannot pull."""
        return self.standing is not None

    def of(self, body_kg: float) -> "Mechanism":
        """The same for a person of another body mass than the mean of Chapter 2."""
        scale = body_kg / BODY_KG
        constants = (
            replace(c, lower=c.lower * scale, upper=c.upper * scale) if c.name in MASSES else c for c in self.constants
        )
        return replace(self, constants=tuple(constants))

    def values(self, shares: Array) -> dict[str, Array]:
        """Constants by name, (d,), from shares (d, c)."""
        return {c.name: c.value(shares[:, i]) for i, c in enumerate(self.constants)}


def two_masses(frequency_hz: Array, values: Mapping[str, Array], added_kg: Array) -> tuple[Array, Array]:
    """Foot and shank on two springs (Eq. 4.29, linear) times (1 + M/m)^p, the load on the shank."""
    v, s = values, 2j * np.pi * frequency_hz
    stiffer = ((v["m_F"] + v["m_S"] + added_kg) / (v["m_F"] + v["m_S"])) ** v.get("p", 0.0)
    z_F, z_T = stiffer * v["k_F"] + s * v["c_F"], stiffer * v["k_T"] + s * v["c_T"]
    top = s**2 * (v["m_S"] + added_kg)
    MB = z_F / (z_F + s**2 * v["m_F"] + z_T * top / (z_T + top)) * z_T / (z_T + top)
    return MB, np.ones_like(MB)  # one rigid shank carries malleolus and tuberosity


def chain(frequency_hz: Array, values: Mapping[str, Array], added_kg: Array) -> tuple[Array, Array, Array]:
    """The chain of mjcf/leg.xml above its fat pad, folded from its top by dynamic stiffnesses.

    Args:
        frequency_hz: [Hz].
        values: constants by name.
        added_kg: added mass [kg]; all broadcast against one another.

    Returns:
        Dynamic mass at the pad, force over acceleration [kg]; malleolus over foot; TM; complex.
    """
    v, s = values, 2j * np.pi * frequency_hz

    def hung(mass: Array, z: Array) -> Array:
        return z * s**2 * mass / (z + s**2 * mass)

    z_M, z_T, z_H, z_A = (v[f"k_{i}"] + s * v[f"c_{i}"] for i in "MTHA")
    top = s**2 * v["m_S"] * (1 - v["share"]) + hung(v["m_H"], z_H) + hung(TISSUE_KG + added_kg, z_A)
    TM = z_T / (z_T + top)
    malleolus = s**2 * v["m_S"] * v["share"] + TM * top
    MF = z_M / (z_M + malleolus)
    return v["m_F"] + MF * malleolus / s**2, MF, TM


def second_mode(frequency_hz: Array, values: Mapping[str, Array], added_kg: Array) -> tuple[Array, Array]:
    """The chain on a fat pad with one stiffness and one damper."""
    s = 2j * np.pi * frequency_hz
    mass, MF, TM = chain(frequency_hz, values, added_kg)
    z_F = values["k_F"] + s * values["c_F"]
    return z_F / (z_F + s**2 * mass) * MF, TM + 0 * MF


def standing_chain(frequency_hz: Array, values: Mapping[str, Array], added_kg: Array) -> tuple[Array, Array, Array]:
    """`chain` at every harmonic of the table (..., HARMONICS)."""
    f = np.asarray(frequency_hz)[..., None] * (1 + np.arange(HARMONICS))
    wider = {name: value[..., None] for name, value in values.items()}
    M, MF, TM = np.broadcast_arrays(*chain(f, wider, np.asarray(added_kg)[..., None]))
    return M, MF, TM


def standing_mass(frequency_hz: Array, values: Mapping[str, Array], added_kg: Array) -> tuple[Array, Array, Array]:
    """One mass, of which a share of the load moves along, at every harmonic (..., HARMONICS)."""
    mass = values["m"] + values["share"] * added_kg + 0j * frequency_hz
    M = np.repeat(mass[..., None], HARMONICS, axis=-1)
    return M, np.ones_like(M), np.ones_like(M)


def pressed(
    frequency_hz: Array,
    values: Mapping[str, Array],
    mass: Array,
    added_kg: Array,
    table: float | Array,
) -> Pressed:
    """Systems on a pad that cannot pull, flattened from dynamic masses (..., HARMONICS)."""

    def flat(value: Array | float) -> Array:
        return np.ascontiguousarray(np.broadcast_to(value, mass.shape[:-1])).ravel()

    static = flat(values["rest"] + MODEL_GRAVITY * added_kg)  # the load's weight presses, moving or not
    k, exponent, c = (flat(values[name]) for name in ("k", "exponent", "c"))
    masses = mass.reshape(-1, mass.shape[-1])
    return Pressed(flat(2 * np.pi * frequency_hz), masses, static, k, exponent, c, flat(table))


_FAT_PAD = "fat pad: tangent of Kinoshita's drop 19 kN/m, in vivo about 150 kN/m"
_ARUIN = "Aruin and Zatsiorsky, vibration, two deviations"
FOOT = (
    Constant("m_F", "kg", 0.0129 * BODY_KG, 0.0145 * BODY_KG, "de Leva, female, to Winter", True),
    Constant("m_S", "kg", 0.0433 * BODY_KG, 0.0481 * BODY_KG, "de Leva, male to female", True),
)
LINEAR_PAD = (
    Constant("k_F", "N/m", 1.5e4, 4e5, _FAT_PAD),
    Constant("c_F", "N s/m", 30, 3000, "nominal; Table 4.2 ends there"),
)
ANKLE = (
    Constant("k_T", "N/m", 7.9e3, 2.19e4, _ARUIN, True),
    Constant("c_T", "N s/m", 358, 502, _ARUIN, True),
)
ANY_ANKLE = (
    Constant("k_T", "N/m", 7.9e3, 1e6, "from Aruin's to the thesis' decade"),
    Constant("c_T", "N s/m", 100, 3000, "nominal; Table 4.2 ends there"),
)
POWER = Constant("p", "", 0, 1.5, "heel of walkers 0.6, ankle against torque 1 (Weiss 1988)", True)
ABOVE = (
    Constant("share", "", 0.05, 0.35, "nominal: part of the shank with the malleolus", True),
    Constant("k_M", "N/m", 5e4, 1e6, "nominal"),
    Constant("c_M", "N s/m", 10, 2000, "nominal"),
    Constant("m_H", "kg", 1.6, 3.1, "thigh 0.10 to 0.148 body mass, 0.54^2 at the knee", True),
    Constant("k_H", "N/m", 2e3, 2e5, "nominal"),
    Constant("c_H", "N s/m", 20, 1000, "nominal"),
    Constant("k_A", "N/m", 2e3, 2e5, "nominal"),
    Constant("c_A", "N s/m", 20, 1000, "nominal"),
)
MASS = Constant("m", "kg", 3.9, 4.5, "foot and shank, body-segment tables", True)
PRESSED_PAD = (
    Constant("rest", "N", 10, 120, "nominal: shank, foot and a part of the thigh's weight", True),
    Constant("k", "N/m", 1.5e4, 4e5, "pad's tangent at 43 N; as above"),
    Constant("exponent", "", 1, 3.5, "F ~ x^exponent; heels of walkers 2.87 and 3.48", True),
    Constant("c", "N s/m", 30, 1500, "pad's damper at 43 N, as its stiffness; nominal"),
)
MOVING = Constant("share", "", 0, 1, "from a load that presses to one that moves along", True)

#: The mechanisms that an analysis distinguishes, the simple ones first.
MECHANISMS = {
    mechanism.name: mechanism
    for mechanism in (
        Mechanism("constant", (*FOOT, *LINEAR_PAD, *ANY_ANKLE), two_masses),
        Mechanism("stiffening", (*FOOT, *LINEAR_PAD, *ANY_ANKLE, POWER), two_masses),
        Mechanism("second mode", (*FOOT, *LINEAR_PAD, *ANKLE, *ABOVE), second_mode),
        Mechanism("lift-off", (MASS, *PRESSED_PAD, MOVING), standing=standing_mass),
        Mechanism("both", (*FOOT, *PRESSED_PAD, *ANKLE, *ABOVE), standing=standing_chain),
    )
}
