"""What others published about feet, and what an arch under a leg has to say of each number."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array, arms, deformations, gradients
from fasbody.arch.load import ARANGIO_CUT, ARANGIO_LOAD, ARANGIO_SAG, MEASURED_HZ, tangent
from fasbody.constants import MODEL_GRAVITY
from identification.rivals.mechanisms import Constant
from reproduction.arch_validation.drop import LOW, LOW_M_S, MEASURED, SPEED_M_S, falls
from simulator.mounted import PAD_POWER, SEATED_N, STANDING_N, Mounted, Stance, pad, poses, stance
from simulator.tissue import Tissue


def _stiffness_at(tension: float) -> float:
    """Of the aponeurosis by itself [N/m], where it pulls with a tension [N]."""
    tissue, low, high = Tissue(arm=1.0, slack=0.0), 0.0, 0.05
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if tissue.tension(np.array(middle)) < tension else (low, middle)
    return float(tissue.tangent(np.array(high)))


#: Ker 1987, foot of a man of 85 kg without its heel pad: elongation [m] -> load [N], whole and with the fascia cut.
#: Read off the published figure, to about 20 N.
KER_ELONGATION = np.arange(1, 9) * 1e-3
KER_WHOLE = np.array([50.0, 170, 370, 630, 1000, 1500, 2100, 3000])
KER_CUT = np.array([10.0, 130, 270, 500, 770, 1150, 1650, 2350])
#: Which of its points are fitted and asked for: 4, 6 and 8 mm.
KER_POINTS = np.array([3, 5, 7])
#: Arangio 1998 also gives elongations [m], by arch height: with and without fascia.
ARANGIO_ELONGATION = {0.020: (8.6e-3, 9.8e-3), 0.060: (8.4e-3, 11.7e-3)}

#: Baines 2018, heels of eleven walkers: slope of force over compression [kN/m] for a new person, 95 %, at loads [N].
#: `python -m identification.heel` prints them; with all that lies between skin and shank.
HEEL_N = (43.0, 66.0, 88.0)
HEEL_SLOPES = (23.4, 36.6, 49.4), (47.2, 75.4, 103.3)
#: Rate at which these heels are pressed there, mean of the persons [m/s]: a pad with a damper is stiffer then.
HEEL_M_S = 0.59
#: Huang 1993: load [N] under which 12 feet lost 25 % of their stiffness, load over sag, with the fascia.
HUANG_N = 690.0
#: Stiffness of the tissue's aponeurosis at half the load at which Kitaoka's 1189 N tore them [N/m]: no free constant.
KITAOKA = float(_stiffness_at(1189.0 / 2))

#: Frequencies at which highest responses are sought, seated (the thesis' range) and standing [Hz].
SEATED_HZ, STANDING_HZ = np.arange(10.0, 50.5, 1.0), np.arange(10.0, 110.5, 1.0)

#: Of `Mounted`, in its order. None of these ranges was set by the numbers below.
BOUNDS = (
    Constant("arm", "m", 0.015, 0.060, "nominal: between a joint and the sole, arches of 20 to 60 mm"),
    Constant("slack", "m", 0.0, 6e-3, "nominal: up to 4 % of the aponeurosis", even=True),
    Constant("k_F", "N/m", 1e4, 3e6, "Table 4.2"),
    Constant("c_F", "N s/m", 30, 3e3, "nominal; Table 4.2 ends there"),
    Constant("k_T", "N/m", 1e3, 3e6, "Table 4.2, and a decade below"),
    Constant("c_T", "N s/m", 30, 3e3, "nominal; Table 4.2 ends there"),
    Constant("k_H", "N/m", 1e3, 2e5, "nominal"),
    Constant("c_H", "N s/m", 20, 1e3, "nominal"),
    Constant("k_A", "N/m", 1e3, 2e5, "nominal"),
    Constant("c_A", "N s/m", 20, 1e3, "nominal"),
    Constant("lag", "s", 1e-4, 1e-2, "nominal; 2 N m s/rad over 230 N m/rad is 9 ms"),
    Constant("share", "", 0.05, 0.35, "nominal: part of the shank that moves with the malleolus", even=True),
    Constant("up", "", 0.0, 1.0, "nominal: anywhere between sole and apex", even=True),
    Constant("eta", "s/m", 0.1, 10.0, "nominal; a drop that absorbs 79 % needs 2"),
)


@dataclass(frozen=True)
class Number:
    """A published number, or a few that stand together.

    Attributes:
        name: what it is. source: whose. unit: as shown.
        low, high: limits between which a prediction meets it, shape (n,); in the likelihood two standard deviations.
        limits: where the limits come from, in words.
        predict: values of the legs, shape (d, n), from what `Feet` computes.
        fitted: legs are fitted to it when it is not left out. Not to other people's models, not to people who stand,
            as the leg above the ankle is a seated one, and not to a second drop.
    """

    name: str
    source: str
    unit: str
    low: tuple[float, ...]
    high: tuple[float, ...]
    limits: str
    predict: Callable[["Feet"], Array]
    fitted: bool = True

    def misfit(self, values: Array) -> Array:
        """Half chi-square of values (d, n), shape (d,); infinite where there is none."""
        low, high = np.array(self.low), np.array(self.high)
        z = (values - (low + high) / 2) / ((high - low) / 4)
        return np.nan_to_num(0.5 * (z**2).sum(axis=-1), nan=np.inf, posinf=np.inf)

    def holds(self, values: Array) -> Array:
        """Which rows (..., n) lie within the limits, shape (...)."""
        return np.all((values >= self.low) & (values <= self.high), axis=-1)


class Statics:
    """What depends on the tissue's two free constants alone, on a grid of them; nine tenths of the work, done once.

    Args:
        arch: the bones.
        points: of the grid, each way.
        legs: about whose constants alone the grid is made, to be exact there; None for all within the bounds.
    """

    def __init__(self, arch: Arch, points: int = 36, legs: Mounted | None = None) -> None:
        from scipy.interpolate import RegularGridInterpolator

        arm = BOUNDS[0].value(np.linspace(0, 1, points))
        slack = BOUNDS[1].value(np.linspace(0, 1, points))
        if legs is not None:
            arm, slack = (float(x) * np.array([0.9999, 1.0001]) for x in (legs.arm, legs.slack))
            points = 2
        tissue = Tissue(arm=arm[:, None, None], slack=slack[None, :, None])
        shape = (points, points)
        self.loads = np.array([SEATED_N + MODEL_GRAVITY * added for added in MEASURED_HZ] + [STANDING_N])
        stood = self._stances(arch, tissue, shape)
        parts = [part.reshape(*shape, -1) for part in (stood.rate, stood.apex, stood.bones, stood.joint)]
        parts += [elongation(arch, KER_WHOLE[KER_POINTS], tissue, shape)]
        parts += [elongation(arch, KER_CUT[KER_POINTS], tissue.cut(), shape)]
        parts += [_fascia(arch, tissue, shape)]
        parts += [1 - _sag_and_elongation(arch, tissue, shape, HUANG_N)[..., :1]
                  / _sag_and_elongation(arch, tissue.cut(), shape, HUANG_N)[..., :1]]  # fmt: skip
        for height in ARANGIO_SAG:
            spread = arch.with_height(height)
            for springs in (tissue, tissue.cut()):
                parts += [_sag_and_elongation(spread, springs, shape)]
        self.mass = arch.m_F
        sizes = np.cumsum([part.shape[-1] for part in parts])
        self._places = np.split(np.arange(sizes[-1]), sizes[:-1])
        self._table = RegularGridInterpolator((np.log(arm), slack), np.concatenate(parts, axis=-1))

    def _stances(self, arch: Arch, tissue: Tissue, shape: tuple[int, int]) -> Stance:
        load = np.broadcast_to(self.loads, (*shape, len(self.loads)))
        stood = stance(arch, load, tissue)
        sign = np.where(stood.apex < 0, -1.0, 1.0)  # eigenvectors of either sign, or the grid would not be smooth
        return stood._replace(apex=sign * stood.apex, bones=sign * stood.bones, joint=sign[..., None, :] * stood.joint)

    def __call__(self, arm: Array, slack: Array) -> tuple[Stance, list[Array]]:
        """Stance, leading shape (d, 4), and the static numbers, each (d, n), of feet (d,)."""
        found = self._table(np.stack([np.log(arm), slack], axis=-1))
        rate, apex, bones, joint, *numbers = (found[:, place] for place in self._places)
        d = len(found)
        three = (d, len(self.loads), 3)
        rate, apex, bones = (part.reshape(three) for part in (rate, apex, bones))
        stood = Stance(rate, apex, bones, self.mass, joint.reshape(*three[:2], 2, 3))
        return stood, numbers


def elongation(arch: Arch, load: Array, tissue: Tissue, shape: tuple[int, ...] = ()) -> Array:
    """Of the sole [m] under loads [N] (n,), shape (*shape, n); NaN past collapse."""
    q, stands = poses(arch, np.broadcast_to(load, (*shape, len(load))), tissue)
    return np.where(stands, deformations(arch, q).e, np.nan)


def _sag_and_elongation(arch: Arch, tissue: Tissue, shape: tuple[int, ...], load: float = ARANGIO_LOAD) -> Array:
    """Sag and elongation [m] under a load [N], shape (*shape, 2)."""
    q, stands = poses(arch, np.full((*shape, 1), load), tissue)
    both = np.concatenate([arch.height_0 - arms(arch, q).E_2, deformations(arch, q).e], axis=-1)
    return np.where(stands, both, np.nan)


def _fascia(arch: Arch, tissue: Tissue, shape: tuple[int, ...]) -> Array:
    """Its share of 683 N, its stiffness there [N/m], and the heel's share, shape (*shape, 3)."""
    load = np.full((*shape, 1), ARANGIO_LOAD)
    q, stands = poses(arch, load, tissue)
    a, e = arms(arch, q), deformations(arch, q).e
    fall = np.stack([a.l_2, a.l_3, a.l_4], axis=-1)
    give = np.linalg.solve(-tangent(arch, q, load, tissue), fall[..., None])[..., 0]
    lengthening = (gradients(arch, q).e[..., 2:5] * give).sum(axis=-1) / (fall * give).sum(axis=-1)
    front, behind = fall.sum(axis=-1), np.sqrt(a.E_1)
    three = (tissue.tension(e) * lengthening / load, tissue.tangent(e), front / (front + behind))
    return np.where(stands, np.concatenate(three, axis=-1), np.nan)


class Feet:
    """Legs (d,) by their constants, and everything that `Number.predict` asks of them."""

    def __init__(self, statics: Statics, values: Array) -> None:
        self.legs = Mounted.of(values)
        self.stood, static = statics(self.legs.arm, self.legs.slack)
        self.whole, self.cut, self.fascia, self.lost, *self.arangio = static
        self.loads = statics.loads

    def _stood(self, i: int) -> Stance:
        s = self.stood
        return Stance(s.rate[:, i], s.apex[:, i], s.bones[:, i], s.mass, s.joint[:, i])

    def seated(self, i: int) -> Array:
        """Highest response of the malleolus under load i [Hz], shape (d, 1)."""
        added = list(MEASURED_HZ)[i]
        r = self.legs.response(self._stood(i), self.loads[i], SEATED_HZ, added)
        return _highest(SEATED_HZ, r.malleolus)[:, None]

    def spread(self, i: int, j: int) -> Array:
        """Sag (j = 0) or elongation of Arangio's case i [mm], shape (d, 1)."""
        return 1e3 * self.arangio[i][:, j : j + 1]

    def more(self, j: int) -> Array:
        """What cutting the fascia adds to sag (j = 0) or elongation of the 60 mm arch [%], shape (d, 1)."""
        return 100 * (self.arangio[3] / self.arangio[2] - 1)[:, j : j + 1]

    @property
    def pad(self) -> Array:
        """Slope of the fat pad [N/m] at `HEEL_N`, pressed at `HEEL_M_S`, shape (d, 3)."""
        rest = np.asarray(pad(np.asarray(self.legs.k_F)[:, None], np.array(HEEL_N)))
        return rest * (1 + np.asarray(self.legs.eta)[:, None] * HEEL_M_S) ** (1 - PAD_POWER)

    def dropped(self, j: int, speed_m_s: float) -> Array:
        """Peak [g], depth [mm] or energy absorbed [%] of 5 kg dropped on the heel (j = 0, 1, 2), shape (d, 1)."""
        return falls(np.asarray(self.legs.k_F), np.asarray(self.legs.eta), j, speed_m_s)[:, None]

    @cached_property
    def _standing(self) -> Any:
        return self.legs.response(self._stood(3), self.loads[3], STANDING_HZ)

    @property
    def ankle(self) -> Array:
        """Highest response of the malleolus standing [Hz], shape (d, 1)."""
        return _highest(STANDING_HZ, self._standing.malleolus)[:, None]

    @property
    def midfoot(self) -> Array:
        """Highest response of the two joints of the midfoot standing [Hz], shape (d, 2)."""
        return np.stack([_highest(STANDING_HZ, self._standing.midfoot[..., j]) for j in (0, 1)], axis=-1)


def _highest(frequency_hz: Array, T: Array) -> Array:
    """Where |T| (d, f) is highest, by a parabola through the highest sample and its neighbours; NaN for none."""
    size = np.nan_to_num(np.abs(T))
    i = size.argmax(axis=-1)
    j = np.clip(i, 1, len(frequency_hz) - 2)
    left, middle, right = (np.take_along_axis(size, (j + k)[:, None], -1)[:, 0] for k in (-1, 0, 1))
    curve = left - 2 * middle + right
    shift = np.where((i == j) & (curve < 0), (left - right) / np.where(curve < 0, 2 * curve, 1), 0.0)
    found = frequency_hz[i] + shift * (frequency_hz[1] - frequency_hz[0])
    return np.where(np.isfinite(T).all(axis=-1), found, np.nan)


def _share(values: Sequence[float], share: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return tuple((1 - share) * v for v in values), tuple((1 + share) * v for v in values)


def _numbers() -> tuple[Number, ...]:
    ker = 1e3 * KER_ELONGATION[KER_POINTS]
    ker_limits = (*_share(ker, 0.15), "15 %, nominal: one foot, read off a figure")
    found = [
        Number("whole foot, elongation at 0.63, 1.5, 3 kN", "Ker 1987", "mm", *ker_limits, lambda f: 1e3 * f.whole),
        Number("fascia cut, elongation at 0.5, 1.15, 2.35 kN", "Ker 1987", "mm", *ker_limits, lambda f: 1e3 * f.cut),
        Number("stiffness of the fascia in stance", "Gefen 2003", "N/mm", (125.0,), (215.0,), "170 +- 45",
               lambda f: 1e-3 * f.fascia[:, 1:2]),
        Number("stiffness of the fascia at half its failure load", "Kitaoka 1994", "N/mm", (153.2,), (254.2,),
               "203.7 +- 50.5", lambda f: np.full((len(f.fascia), 1), 1e-3 * KITAOKA), fitted=False),
        Number("stiffness lost when the fascia is cut, 690 N", "Huang 1993, 12 feet", "%", (20.0,), (30.0,),
               "5 points were chosen here", lambda f: 1e2 * f.lost),
        Number("fascia's share of the load", "Kim & Voloshin 1995, computed", "%",
               (9.0,), (19.0,), "5 points were chosen here",
               lambda f: 1e2 * f.fascia[:, :1], fitted=False),
        Number("heel's share of the load", "Kim & Voloshin 1995, computed", "%",
               (56.0,), (70.0,), "7 points were chosen here",
               lambda f: 1e2 * f.fascia[:, 2:], fitted=False),
        Number("ankle, stiffness", "Aruin & Zatsiorsky 1984, vibration", "kN/m", (7.9,), (21.9,), "two deviations",
               lambda f: 1e-3 * np.asarray(f.legs.k_T)[:, None]),
        Number("ankle, damping", "Aruin & Zatsiorsky 1984, vibration", "N s/m", (358.0,), (502.0,), "two deviations",
               lambda f: np.asarray(f.legs.c_T)[:, None]),
        Number("slope of the heel at 43, 66, 88 N", "Baines 2018", "kN/m", HEEL_SLOPES[0], HEEL_SLOPES[1],
               "95 % of walkers", lambda f: 1e-3 * f.pad),
    ]  # fmt: skip
    first = ("5 kg dropped on the heel", "Kinoshita 1993", MEASURED, SPEED_M_S)
    for what, source, measured, speed in (first, ("5 kg from 30 mm", "Descente Sports Sci. 12", LOW, LOW_M_S)):
        for j, (low, _, high) in enumerate(measured.values()):
            name, unit = (("peak", "g"), ("depth", "mm"), ("energy absorbed", "%"))[j]
            found.append(Number(f"{what}, {name}", source, unit, (low,), (high,),
                                "its range" if unit == "%" else "20 % were chosen here",
                                partial(Feet.dropped, j=j, speed_m_s=speed), fitted=measured is MEASURED))  # fmt: skip
    for i, (added, (low, high)) in enumerate(MEASURED_HZ.items()):
        found.append(Number(f"resonance with {added:g} kg", "Wee & Voloshin 2013", "Hz", (low,), (high,), "its range",
                            partial(Feet.seated, i=i)))  # fmt: skip
    found += [
        Number("ankle, standing", "Goggins", "Hz", (16.0,), (39.0,), "21 people", lambda f: f.ankle, fitted=False),
        Number("midfoot, standing, two joints", "Goggins", "Hz", (51.0, 51.0), (84.0, 84.0), "21 people",
               lambda f: f.midfoot, fitted=False),
    ]  # fmt: skip
    for i, (height, cut) in enumerate((height, cut) for height in ARANGIO_SAG for cut in (0, 1)):
        tail = ", fascia cut" if cut else ""
        for j, (what, table) in enumerate((("sag", ARANGIO_SAG), ("elongation", ARANGIO_ELONGATION))):
            found.append(Number(f"{what}, {1e3 * height:.0f} mm arch{tail}", "Arangio 1998, computed", "mm",
                                *_share([1e3 * table[height][cut]], 0.1), "10 % were chosen here",
                                partial(Feet.spread, i=i, j=j), fitted=False))  # fmt: skip
    for j, more in enumerate(ARANGIO_CUT):
        what, percent = ("sag", "elongation")[j], 100 * more
        found.append(Number(f"more {what} when it is cut, 60 mm arch", "Arangio 1998, computed", "%", (percent - 5,),
                            (percent + 5,), "5 points were chosen here", partial(Feet.more, j=j),
                            fitted=False))  # fmt: skip
    return tuple(found)


NUMBERS = _numbers()


def of(shares: Array) -> Array:
    """Constants (..., 14) from shares (..., 14) of the way between the bounds."""
    return np.stack([bound.value(shares[..., i]) for i, bound in enumerate(BOUNDS)], axis=-1)
