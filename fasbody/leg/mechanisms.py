"""Rival explanations of the resonance that rises with the load, each as a space of constants and a response.

Bounds are those of the sources named; where there is none they are wide and called nominal. Each mechanism answers
for many draws at once. MB and TM are the fundamentals of malleolus and of tuberosity over malleolus.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.leg import balance
from fasbody.leg.lift_off import TABLE_M_S2, G, steady
from fasbody.leg.statements import ADDED_KG, RANGES_HZ, STATEMENTS, Curves, judge, ranges_met
from fasbody.transmissibility.findings import FREQUENCIES_HZ

Array = np.ndarray
#: Mean body mass of Chapter 2 [kg].
BODY_KG = 70.7
#: Constants that are masses: the body mass scales them.
MASSES = ("m", "m_F", "m_S", "m_H")
#: Soft tissue that moves with the added mass [kg], nominal, as in mjcf/leg.xml.
TISSUE_KG = 0.2
#: Grid on which the highest MB is sought [Hz].
FINE_HZ = np.arange(10.0, 51.0, 1.0)
_F = np.array(FREQUENCIES_HZ)
#: Feet that are judged between two ticks of a progress bar.
_AT_ONCE = 20


@dataclass(frozen=True)
class Constant:
    """One drawn constant: bounds in its unit, drawn evenly in its logarithm (or in itself), and their source."""

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
    """One explanation.

    Attributes:
        name: a word. says: a sentence. constants: what is drawn.
        response: frequencies [Hz], constants (d,) by name and added masses [kg] (l,), those of Chapter 2 by default
            -> MB and TM, complex, (d, l, f); NaN TM if it has no tibia.
    """

    name: str
    says: str
    constants: tuple[Constant, ...]
    response: Callable[..., tuple[Array, Array]]

    def of(self, body_kg: float) -> "Mechanism":
        """The same for a person of another body mass than the mean of Chapter 2: segments in proportion."""
        scale = body_kg / BODY_KG
        own = (replace(c, lower=c.lower * scale, upper=c.upper * scale) if c.name in MASSES else c
               for c in self.constants)  # fmt: skip
        return replace(self, constants=tuple(own))

    def values(self, shares: Array) -> dict[str, Array]:
        """Constants by name, each (d,), from shares (d, c)."""
        return {c.name: c.value(shares[:, i]) for i, c in enumerate(self.constants)}

    def judged(self, shares: Array) -> "Judged":
        """Hold draws against the statements."""
        values = self.values(shares)
        MB, TM = self.response(np.concatenate([_F, FINE_HZ]), values)
        held = judge(Curves(MB[..., : _F.size], TM[..., : _F.size]))
        peaks = FINE_HZ[np.nan_to_num(np.abs(MB[..., _F.size :])).argmax(axis=-1)]
        return Judged(held, peaks)


@dataclass(frozen=True)
class Judged:
    """Draws against the statements: held (d, statements), and where MB is highest, peak_hz (d, 3)."""

    held: Array
    peak_hz: Array

    @property
    def ranges(self) -> Array:
        """How many of the three ranges each draw meets, (d,)."""
        return ranges_met(self.peak_hz).sum(axis=-1)

    @property
    def count(self) -> Array:
        """How many statements each draw meets, (d,)."""
        return self.held.sum(axis=-1)


def _w(frequency_hz: Array) -> Array:
    return 2j * np.pi * frequency_hz[None, None, :]


def _column(values: dict[str, Array]) -> dict[str, Array]:
    return {name: value[:, None, None] for name, value in values.items()}


def _loads(added_kg: Sequence[float] | Array) -> Array:
    return np.asarray(added_kg)[None, :, None]


def two_masses(
    frequency_hz: Array, values: dict[str, Array], added_kg: Sequence[float] | Array = ADDED_KG
) -> tuple[Array, Array]:
    """Foot and shank on two springs (Eq. 4.29, linear), the added mass on the shank, springs times (1 + M/m)^p."""
    v, s, added = _column(values), _w(frequency_hz), _loads(added_kg)
    stiffer = ((v["m_F"] + v["m_S"] + added) / (v["m_F"] + v["m_S"])) ** v.get("p", 0.0)
    z_F, z_T = stiffer * v["k_F"] + s * v["c_F"], stiffer * v["k_T"] + s * v["c_T"]
    top = s**2 * (v["m_S"] + added)
    to_shank = z_T / (z_T + top)
    hung = z_T * top / (z_T + top)
    MB = z_F / (z_F + s**2 * v["m_F"] + hung) * to_shank
    return MB, np.ones_like(MB)  # one rigid shank carries malleolus and tuberosity


def chain(frequency_hz: Array, values: Mapping[str, Array], added_kg: Array) -> tuple[Array, Array, Array]:
    """The chain of mjcf/leg.xml above its fat pad, folded from its top: each link by its dynamic stiffness.

    Args:
        frequency_hz: [Hz]. values: constants. added_kg: [kg]. All broadcast against one another.

    Returns:
        dynamic mass at the pad, force over acceleration [kg]; malleolus over foot; tuberosity over malleolus; complex.
    """
    v, s = values, 2j * np.pi * frequency_hz

    def hung(mass: Array, z: Array) -> Array:
        return z * s**2 * mass / (z + s**2 * mass)

    shank = v["m_S"] * (1 - v["share"])
    top = s**2 * shank + hung(v["m_H"], v["k_H"] + s * v["c_H"]) + hung(TISSUE_KG + added_kg, v["k_A"] + s * v["c_A"])
    z_T, z_M = (v[f"k_{i}"] + s * v[f"c_{i}"] for i in "TM")
    TM = z_T / (z_T + top)
    malleolus = s**2 * v["m_S"] * v["share"] + TM * top
    MF = z_M / (z_M + malleolus)
    return v["m_F"] + MF * malleolus / s**2, MF, TM


def second_mode(
    frequency_hz: Array, values: dict[str, Array], added_kg: Sequence[float] | Array = ADDED_KG
) -> tuple[Array, Array]:
    """The chain on a fat pad with one stiffness and one damper."""
    v, s = _column(values), _w(frequency_hz)
    mass, MF, TM = chain(frequency_hz, v, _loads(added_kg))
    z_F = v["k_F"] + s * v["c_F"]
    return z_F / (z_F + s**2 * mass) * MF, TM + 0 * MF


def both(
    frequency_hz: Array, values: dict[str, Array], added_kg: Sequence[float] | Array = ADDED_KG,
    table: float = TABLE_M_S2,
) -> tuple[Array, Array]:  # fmt: skip
    """The chain on a pad that cannot pull, pressed by its weight and the load; motions that repeat every period.

    MB is NaN where no such motion was found.
    """
    added = _loads(added_kg)
    mass, MF, TM = above(frequency_hz, values, added)
    systems = pressed(frequency_hz, values, mass, added, table)
    x, found = balance.solve(systems)
    a = np.where(found, systems.acceleration(x)[:, 0], np.nan).reshape(MF.shape[:-1])
    return a / table * MF[..., 0], TM[..., 0]


def above(frequency_hz: Array, values: dict[str, Array], added_kg: Array) -> tuple[Array, Array, Array]:
    """`chain` at each harmonic of the table, (d, ..., f, balance.HARMONICS), for constants (d,)."""
    f = np.asarray(frequency_hz)[..., None] * (1 + np.arange(balance.HARMONICS))
    shape = np.broadcast_shapes(np.shape(added_kg), np.shape(frequency_hz))
    v = {name: value.reshape(-1, *[1] * len(shape)) for name, value in values.items()}
    M, MF, TM = chain(f, v, np.asarray(added_kg)[..., None])
    full = (*np.broadcast_shapes(M.shape[:-1], shape), balance.HARMONICS)
    return np.broadcast_to(M, full), np.broadcast_to(MF, full), np.broadcast_to(TM, full)


def pressed(
    frequency_hz: Array, values: dict[str, Array], mass: Array, added_kg: Array, table: float | Array
) -> balance.Pressed:
    """Systems on a pad that cannot pull, for constants (d,) and dynamic masses (d, ..., f, HARMONICS), flattened."""
    shape = mass.shape[:-1]

    def flat(value: Array | float) -> Array:
        return np.ascontiguousarray(np.broadcast_to(value, shape)).ravel()

    def drawn(name: str) -> Array:
        return values[name].reshape(-1, *[1] * (len(shape) - 1))

    static = drawn("rest") + G * added_kg
    return balance.Pressed(flat(2 * np.pi * frequency_hz), mass.reshape(-1, mass.shape[-1]), flat(static),
                           flat(drawn("k")), flat(drawn("exponent")), flat(drawn("c")), flat(table))  # fmt: skip


def lift_off(
    frequency_hz: Array, values: dict[str, Array], added_kg: Sequence[float] | Array = ADDED_KG
) -> tuple[Array, Array]:
    """One mass on a pad that cannot pull; the load presses and does not move with it, but for a share of it."""
    share = values.get("share", np.zeros_like(values["m"]))
    added = np.asarray(added_kg)
    static = values["rest"][:, None] + G * added  # its weight presses in either case
    mass = values["m"][:, None] + share[:, None] * added
    k, exponent, c = (np.broadcast_to(values[n][:, None], static.shape).ravel() for n in ("k", "exponent", "c"))
    found = steady(frequency_hz, mass.ravel(), static.ravel(), k, exponent, c)
    MB = found.response.reshape(*static.shape, -1)
    return MB, np.full_like(MB, np.nan)


_FOOT = Constant("m_F", "kg", 0.0129 * BODY_KG, 0.0145 * BODY_KG, "de Leva, female, to Winter", even=True)
_SHANK = Constant("m_S", "kg", 0.0433 * BODY_KG, 0.0481 * BODY_KG, "de Leva, male to female", even=True)
_PAD = (
    Constant("k_F", "N/m", 1.5e4, 4e5, "fat pad: tangent of Kinoshita's drop 19 kN/m, in vivo about 150 kN/m"),
    Constant("c_F", "N s/m", 30, 3000, "nominal; Table 4.2 ends there"),
)
_ANKLE = (
    Constant("k_T", "N/m", 7.9e3, 2.19e4, "Aruin and Zatsiorsky, vibration, two deviations", even=True),
    Constant("c_T", "N s/m", 358, 502, "Aruin and Zatsiorsky, vibration, two deviations", even=True),
)
_WIDE_ANKLE = (
    Constant("k_T", "N/m", 7.9e3, 1e6, "from Aruin's to the thesis' decade"),
    Constant("c_T", "N s/m", 100, 3000, "nominal; Table 4.2 ends there"),
)
_POWER = Constant("p", "", 0, 1.5, "heel law of walkers 0.6, ankle against torque 1 (Weiss 1988)", even=True)
_REST = (
    Constant("share", "", 0.05, 0.35, "nominal: part of the shank that moves with the malleolus", even=True),
    Constant("k_M", "N/m", 5e4, 1e6, "nominal"),
    Constant("c_M", "N s/m", 10, 2000, "nominal"),
    Constant("m_H", "kg", 1.6, 3.1, "thigh 0.10 to 0.148 body mass, 0.54^2 of it at the knee", even=True),
    Constant("k_H", "N/m", 2e3, 2e5, "nominal"),
    Constant("c_H", "N s/m", 20, 1000, "nominal"),
    Constant("k_A", "N/m", 2e3, 2e5, "nominal"),
    Constant("c_A", "N s/m", 20, 1000, "nominal"),
)
_PRESSED = (
    Constant("m", "kg", 3.9, 4.5, "foot and shank, body-segment tables", even=True),
    Constant("rest", "N", 10, 120, "nominal: shank, foot and a part of the thigh's weight", even=True),
    Constant("k", "N/m", 1.5e4, 4e5, "pad's tangent at 43 N; as above"),
    Constant("exponent", "", 1, 3.5, "F ~ x^exponent; 2.6 measured on walkers", even=True),
    Constant("c", "N s/m", 30, 1500, "pad's damper at 43 N, as its stiffness; nominal"),
)
_PARTLY = Constant("share", "", 0, 1, "from a load that presses to one that moves along", even=True)

MECHANISMS: tuple[Mechanism, ...] = (
    Mechanism("constant", "Two masses, constants that no load changes.", (_FOOT, _SHANK, *_PAD, *_ANKLE), two_masses),
    Mechanism("constant, any ankle", "The same, ankle as stiff as it likes.",
              (_FOOT, _SHANK, *_PAD, *_WIDE_ANKLE), two_masses),
    Mechanism("stiffening", "Two masses, springs that grow with the load's power p, any ankle.",
              (_FOOT, _SHANK, *_PAD, *_WIDE_ANKLE, _POWER), two_masses),
    Mechanism("second mode", "The leg chain, constants that no load changes, Aruin's ankle.",
              (_FOOT, _SHANK, *_PAD, *_ANKLE, *_REST), second_mode),
    Mechanism("second mode, any ankle", "The same, ankle as stiff as it likes.",
              (_FOOT, _SHANK, *_PAD, *_WIDE_ANKLE, *_REST), second_mode),
    Mechanism("lift-off", "A pad that cannot pull, a load that presses and does not move.", _PRESSED, lift_off),
    Mechanism("lift-off, load moves along", "The same, any share of the load moves along.",
              (*_PRESSED, _PARTLY), lift_off),
    Mechanism("both", "The leg chain on a pad that cannot pull, under a load that presses; Aruin's ankle.",
              (_FOOT, _SHANK, *_PRESSED[1:], *_ANKLE, *_REST), both),
)  # fmt: skip


@dataclass(frozen=True)
class Searched:
    """One mechanism's space: even draws, and the best set of a search that starts from them.

    Attributes:
        mechanism: which. drawn: how many. judged: the draws. best: constants of the best set, by name.
        best_judged: that one set, as one draw.
    """

    mechanism: Mechanism
    drawn: int
    judged: Judged
    best: dict[str, float]
    best_judged: Judged

    def share(self, ranges: int) -> float:
        """Share of the space that meets at least so many of the three ranges."""
        return float((self.judged.ranges >= ranges).mean())


def feet(draws: int, rounds: int) -> int:
    """How many feet `search` judges."""
    return draws + rounds * max(20, draws // 10)


def search(
    mechanism: Mechanism, draws: int, seed: int = 0, rounds: int = 20, tick: Callable[[int], object] = lambda _: None
) -> Searched:
    """Draw a mechanism's space evenly, then look for its best set: most ranges, then most statements.

    Args:
        mechanism: what to search.
        draws: even draws; each later round has a tenth of them.
        seed: of the random numbers.
        rounds: of normal steps about the best so far, half as wide where one brings nothing.
        tick: is told how many feet were judged since.
    """

    def in_parts(shares: Array) -> Judged:
        found = []
        for part in np.split(shares, range(_AT_ONCE, len(shares), _AT_ONCE)):
            found.append(mechanism.judged(part))
            tick(len(part))
        return Judged(*(np.concatenate([getattr(each, name) for each in found]) for name in ("held", "peak_hz")))

    rng, n = np.random.default_rng(seed), len(mechanism.constants)
    shares = rng.random((draws, n))
    judged = in_parts(shares)
    best, spread = _best(judged), 0.2
    top, held = shares[best], Judged(judged.held[best : best + 1], judged.peak_hz[best : best + 1])
    for _ in range(rounds):
        near = np.clip(top + spread * rng.standard_normal((max(20, draws // 10), n)), 0, 1)
        tried = in_parts(near)
        at = _best(tried)
        if _score(tried)[at] > _score(held)[0]:
            top, held = near[at], Judged(tried.held[at : at + 1], tried.peak_hz[at : at + 1])
        else:
            spread = max(0.6 * spread, 0.01)
    values = {name: float(value[0]) for name, value in mechanism.values(top[None]).items()}
    return Searched(mechanism, draws, judged, values, held)


def _score(judged: Judged) -> Array:
    """What the best set has most of: ranges count as three statements each, distance from them breaks ties."""
    low, high = np.array(RANGES_HZ).T
    off = np.maximum(low - judged.peak_hz, 0) + np.maximum(judged.peak_hz - high, 0)
    return 3 * judged.ranges + judged.count - 0.02 * off.sum(axis=-1)


def _best(judged: Judged) -> int:
    return int(_score(judged).argmax())


def spoken(mechanism: Mechanism) -> int:
    """How many statements a mechanism says anything about: one mass has no tibia."""
    return sum(s.pair == "MB" for s in STATEMENTS) if mechanism.response is lift_off else len(STATEMENTS)
