"""Published numbers that exclude each other in an arch of rigid bones, whatever its springs: bounds, no failed search.

Every joint and the aponeurosis may have any law that pulls only when stretched and never less when stretched more.
Poses are searched on a grid whose step, times the longest lever, is added to the bound.
"""

from dataclasses import dataclass

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array
from fasbody.arch.load import ARANGIO_LOAD, ARANGIO_SAG
from reproduction.arch_validation.drop import MASS_KG, MEASURED, RANGE, SPEED_M_S, fall
from reproduction.arch_validation.evidence import ARANGIO_ELONGATION, HEEL_N, HEEL_SLOPES, KER_CUT, KER_ELONGATION
from simulator.mounted import pad

#: How well Ker's curves can be read off the figure [N].
READING_N = 20.0
#: Joints of the forefoot bend by no more than this [rad], 34 degrees, in any pose considered.
BEND = 0.6
#: Grid of those bends [rad].
STEP = 0.0025
#: Limits that Arangio's numbers are given: 10 %.
LOWEST = 0.9
#: Damping of the ankle, Aruin & Zatsiorsky [N s/m]: under vibration with its deviation; under impact, 20 % chosen here.
ARUIN_VIBRATION, ARUIN_IMPACT = (430.0, 36.0), 811.0


@dataclass(frozen=True)
class Proof:
    """Why a number cannot be met.

    Attributes:
        number: which. against: what excludes it.
        bound: the largest (or smallest) value that is possible. needed: the nearest value within its limits.
        unit: of both. holds: for which models, in words. above: the bound is a smallest value.
    """

    number: str
    against: str
    bound: float
    needed: float
    unit: str
    holds: str
    above: bool = False

    @property
    def excluded(self) -> bool:
        """The nearest value within the limits is out of reach."""
        return self.bound > self.needed if self.above else self.bound < self.needed


@dataclass(frozen=True)
class Pose:
    """An arch turned at its joints; arrays of one shape, lengths in m.

    Attributes:
        sag, elongation: of the arch.
        arms: of the moments at the three joints per newton on the apex, shape (..., 3), without aponeurosis.
    """

    sag: Array
    elongation: Array
    arms: Array


def turned(arch: Arch, d_2: Array, d_3: Array, d_4: Array) -> Pose:
    """The pose whose joints have turned by d_2, d_3, d_4 [rad] from rest, arrays of one shape; a closed form."""
    opening = arch.theta_10 + arch.theta_20 + d_2
    b_3 = arch.theta_30 - arch.theta_20 + d_3
    b_4 = arch.theta_40 - arch.theta_30 + d_4 + b_3
    along = arch.L_2 + arch.L_3 * np.cos(b_3) + arch.L_4 * np.cos(b_4)
    across = arch.L_3 * np.sin(b_3) + arch.L_4 * np.sin(b_4)
    theta_2 = np.arctan2(along - arch.L_1 * np.cos(opening), arch.L_1 * np.sin(opening) + across)
    theta = [theta_2, theta_2 + b_3, theta_2 + b_4]
    l_2, l_3, l_4 = (L * np.sin(t) for L, t in zip((arch.L_2, arch.L_3, arch.L_4), theta, strict=True))
    height = arch.L_1 * np.cos(opening - theta_2)
    behind, front = arch.L_1 * np.sin(opening - theta_2), l_2 + l_3 + l_4
    heads = behind / (behind + front)  # share of the load on the metatarsal heads
    arms = heads[..., None] * np.stack([front, l_3 + l_4, l_4], axis=-1)
    return Pose(arch.height_0 - height, behind + front - arch.l_0, arms)


def longest(arch: Arch, height: float) -> float:
    """Largest elongation of an arch of a height [m], all bones in one line [m]."""
    low = arch.with_height(height)
    return low.L_1 + low.L_2 + low.L_3 + low.L_4 - low.l_0


def _bends(arch: Arch, elongation: float, truss: bool) -> tuple[Array, Array, Array]:
    """Turns (n,) of the three joints, none negative, that lengthen the sole by `elongation` [m]."""
    d_3, d_4 = (x.ravel() for x in np.meshgrid(*[[0.0] if truss else np.arange(0, BEND + STEP, STEP)] * 2))
    low, high = np.zeros_like(d_3), np.full_like(d_3, np.pi - arch.theta_10 - arch.theta_20)
    possible = turned(arch, low, d_3, d_4).elongation <= elongation
    low, high, d_3, d_4 = (x[possible] for x in (low, high, d_3, d_4))
    for _ in range(30):
        d_2 = (low + high) / 2
        short = turned(arch, d_2, d_3, d_4).elongation < elongation
        low, high = np.where(short, d_2, low), np.where(short, high, d_2)
    reached = turned(arch, high, d_3, d_4)
    there = (np.abs(reached.elongation - elongation) < 1e-7) & (reached.sag < arch.height_0)
    return high[there], d_3[there], d_4[there]


def after_ker(
    arch: Arch, height: float, other: float, least: float, truss: bool = False, longer: float = 0.0
) -> tuple[float, float]:
    """How far Arangio's arch without fascia can sag and lengthen [m], if its tissue is that of Ker's foot.

    At rest Ker's arch is `height` high [m], Arangio's `other`. At some elongation of Ker's cut foot the moment at every
    joint is at least what 683 N make in Arangio's arch. As no law gives way, every joint there has turned at least as
    far. So Arangio's arch sags by no more than turns do that fit to Ker's elongation.

    Args:
        arch: the bones.
        height: of Ker's arch [m]. other: of Arangio's [m].
        least: sag [m] that is to be excluded, with all larger ones that leave the arch off the floor.
        truss: only the joint at the apex turns.
        longer: share by which Ker's elongations may be longer than read.

    Returns:
        Largest sag and elongation [m], infinite if Ker's curve ends before.
    """
    foot, spread = arch.with_height(height), arch.with_height(other)
    forefoot = np.zeros(1) if truss else np.linspace(0, BEND, 41)
    d = np.stack(np.meshgrid(np.linspace(0, 1.2, 121), forefoot, forefoot)).reshape(3, -1)
    pose = turned(spread, *d)
    inside = (pose.sag >= least - 1e-3) & (pose.sag < other)
    asked = 1.01 * ARANGIO_LOAD * pose.arms[inside].max(axis=0)  # 1 %: between the poses of this grid
    curve = (1 + longer) * np.array([0, *KER_ELONGATION])
    low, high = 0.0, min(float(curve[-1]), longest(arch, height) - 1e-6)
    found = (np.inf, np.inf)
    for _ in range(9):  # the smallest elongation that serves; whatever it is, it proves
        elongation = (low + high) / 2
        load = np.interp(elongation, curve, [0, *KER_CUT]) - READING_N
        bends = _bends(foot, elongation, truss)
        moment = load * turned(foot, *bends).arms.min(axis=0, initial=np.inf)
        if load > 0 and (moment >= asked)[: 1 if truss else 3].all():
            reached, high = turned(spread, *bends), elongation
            margin = STEP * (spread.L_2 + spread.L_3 + spread.L_4)
            found = float(reached.sag.max() + margin), float(reached.elongation.max() + margin)
        else:
            low = elongation
    return found


def drop(k: Array, zeta: Array, mass: float = MASS_KG, speed: float = SPEED_M_S) -> tuple[Array, Array, Array]:
    """A mass [kg] falling at a speed [m/s] on a linear pad of k [N/m] and any damping ratio zeta but 1, arrays (n,).

    Returns:
        Peak force [weights], depth [m] and share of the energy at the deepest place that does not come back, each (n,):
        until the mass leaves the pad, turns down again or creeps to rest, as in `reproduction.arch_validation.drop`.
    """
    g = 9.81
    w = np.sqrt(k / mass)
    turn, sink = w * np.emath.sqrt(1 - zeta**2 + 0j), mass * g / k
    slowest = np.where(zeta < 1, np.abs(turn), w / (2 * zeta + 1))  # at critical damping and above nothing turns
    t = np.linspace(0, 1, 401)[:, None] ** 2 * np.minimum(2.2 * np.pi / slowest, 8 * (2 * zeta + 1) / w)
    b = (speed - zeta * w * sink) / turn
    decay, c, s = np.exp(-zeta * w * t), np.cos(turn * t), np.sin(turn * t)
    x = (sink + decay * (b * s - sink * c)).real
    v = (decay * ((b * turn + zeta * w * sink) * c + (sink * turn - zeta * w * b) * s)).real
    force = k * x + 2 * zeta * w * mass * v
    again = np.logical_or.accumulate(v < 0) & (v >= 0)
    once = np.logical_and.accumulate(((force > 0) & ~again) | (t == 0))
    last = once.sum(axis=0)[None] - 1
    peak, depth = (np.where(once, each, 0).max(axis=0) for each in (force / (mass * g), x))
    left, high = (np.take_along_axis(each, last, 0)[0] for each in (v, depth - x))
    return peak, depth, 1 - (left**2 / 2 + g * high) / (speed**2 / 2 + g * depth)


def linear_drop() -> float:
    """Greatest depth [m] of a linear pad in Kinoshita's drop that keeps to the limits of its peak and its loss.

    Depth falls with the stiffness, the peak rises, and the loss goes one way. So for each damping ratio the softest pad
    that is hard enough is the deepest; a ratio counts if the limits of the loss reach between those of this pad and of
    the hardest one that is allowed. The largest step from one ratio to the next is added.
    """
    zeta = np.linspace(0.005, 1.995, 200)  # none is 1

    def at_peak(weights: float) -> Array:
        low, high = np.full_like(zeta, 1e2), np.full_like(zeta, 1e6)
        for _ in range(20):
            k = np.sqrt(low * high)
            hard = drop(k, zeta)[0] >= weights
            low, high = np.where(hard, low, k), np.where(hard, k, high)
        return high

    (soft, _, hard), (low, _, high) = MEASURED["peak_g"], MEASURED["absorbed_percent"]
    _, depth, one = drop(at_peak(soft), zeta)
    other = drop(at_peak(hard), zeta)[2]
    possible = (100 * np.maximum(one, other) >= low - 1) & (100 * np.minimum(one, other) <= high + 1)
    return float(depth[possible].max() + np.abs(np.diff(depth[possible])).max())


def resting_drop() -> float:
    """Smallest peak [g] of a pad whose slopes at rest would be those of the walkers' heels, whatever its `eta`.

    The peak rises with the stiffness, and the least stiffness is that of the lowest slopes. The largest step from one
    `eta` to the next is taken off.
    """
    k_F = max(1e3 * low / float(pad(1.0, load)) for low, load in zip(HEEL_SLOPES[0], HEEL_N, strict=True))
    peak = fall(k_F, np.geomspace(*RANGE[1], 100))[:, 0]
    return float(peak.min() - np.abs(np.diff(peak)).max())


def proofs(arch: Arch | None = None) -> list[Proof]:
    """All of them, on the bones of the nominal arch, which Ker's foot is taken to have.

    Args:
        arch: whose bones; None is `Arch.nominal()`.
    """
    arch = arch or Arch.nominal()
    found = []
    for cut, tail in enumerate(("", ", fascia cut")):
        needed, most = 1e3 * LOWEST * ARANGIO_ELONGATION[0.02][cut], 1e3 * longest(arch, 0.02)
        name = f"Arangio: elongation, 20 mm arch{tail}"
        found.append(Proof(name, "Table 4.1", most, needed, "mm", "rigid bones, any pose"))
    for truss, cut in ((False, 1), (True, 0)):  # an aponeurosis of any law makes no truss sag more
        for height in ARANGIO_SAG:
            found += _ker_against_arangio(arch, height, truss, cut)
    found += [
        Proof("Aruin & Zatsiorsky: damping of the ankle under impact", "the same under vibration",
              ARUIN_VIBRATION[0] + 2 * ARUIN_VIBRATION[1], 0.8 * ARUIN_IMPACT, "N s/m", "one linear damper"),
        Proof("Kinoshita: depth of the drop", "its peak and its loss, 75 to 89 %", 1e3 * linear_drop(),
              MEASURED["depth_mm"][0], "mm", "one linear spring and damper under the heel"),
        Proof("Kinoshita: peak of the drop", "the heel's slopes, were they those of rest", resting_drop(),
              MEASURED["peak_g"][2], "g", "force ~ compression^2.56 (1 + eta rate)", above=True),
    ]  # fmt: skip
    return found


def _ker_against_arangio(arch: Arch, height: float, truss: bool, cut: int) -> list[Proof]:
    """Sag and elongation of one of Arangio's arches, with as much patience for Ker's curve as excludes the sag."""
    needed = LOWEST * np.array([ARANGIO_SAG[height][cut], ARANGIO_ELONGATION[height][cut]])
    for longer in (0.15, 0.10, 0.05, 0.0):
        most = np.array(after_ker(arch, arch.height_0, height, needed[0], truss, longer))
        if most[0] < needed[0]:
            break
    allowed = f"up to {100 * longer:.0f} % longer than read" if longer else "as read"
    laws = "a truss, any laws" if truss else "three joints, any laws"
    tail = ", fascia cut" if cut else ""
    found = []
    for i, what in enumerate(("sag", "elongation")):
        if what == "sag" or (cut and height > 0.05):  # of the others one has a proof of its own, one has none
            name = f"Arangio: {what}, {1e3 * height:.0f} mm arch{tail}"
            against = f"Ker, fascia cut, {allowed}, on an arch of {1e3 * arch.height_0:.0f} mm"
            found.append(Proof(name, against, 1e3 * float(most[i]), 1e3 * float(needed[i]), "mm", laws))
    return found
