"""Legs in worlds that depart from the model, what their sensors record, and what a fit may say.

The simulator is leg.py with departure.py (what moves) and instrument.py (what is written down);
none shares code with what it judges. A world is departures and instruments, drawn by a seed.

A fit reports the dynamic stiffness Re K(iw) and damping Im K(iw) / w of ankle and pad, at the
geometric mean w of the recorded angular frequencies and under the smallest load. What an interval
of k_T, k_F, c_11, c_21 must hold, K_0 = k + iw c being the leg's springs and dampers at rest:

| worlds | K(iw) |
|---|---|
| clean; mass; in g; gain and drift; sensor on tissue; rocking; load share; heavier leg | K_0 |
| springs relax; near the axis | K_0 + k r iw tau / (1 + iw tau), Maxwell elements beside springs |
| stiffer under load | K_0, as it is without load |
| scatter, posture drift | K_0 of the median recording |
| scatter by load | K_0 from the median seating to the unloaded one: any value between |
| everything at once | as springs relax, of the median recording |
| exponential, cubic springs; quadratic pad; thixotropy | K_0: the tangent at rest, unbroken |
| dampers of 0.6 | K_0 with c of a sine as large as the linear leg's at w |
| thigh, reflex, friction, lifting heel, tremor | K_0: what else pulls is neither spring nor damper |
| hum, cross axis, 8 bit, clock, clipping | K_0 |

The constant itself, at rest and without load, is kept beside it. Legs are nearly linear to strongly
nonlinear; where recordings scatter from one to the next they are strongly nonlinear, as two loads
decide between a nearly linear leg and its mirror image not even where nothing departs.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.condition import Condition
from fasbody.recording.recording import Recording
from simulator import departure, instrument
from simulator.departure import GRAVITY, Maxwell, Scatter
from simulator.instrument import Instrument, Traces
from simulator.leg import SENSORS, STEP_S, Departure, Leg, Shaking, motion, under

FREQUENCIES_HZ = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)
#: Segments' share of the body mass, and what the thesis laid on the knee [kg].
SHANK, FOOT, LOADS_KG = 0.0465, 0.0145, (0.0, 2.3, 4.5)
#: Amplitude of the table [m/s^2], and its harmonics over it.
AMPLITUDE, TABLE = 8.95, (1.0, 0.015, 0.008)
#: Strength of bends from which a leg is strongly nonlinear; the laboratory's foot has 1.
STRONG = 0.7
#: Sampling rate [Hz] and length of a recording [s].
RATE_HZ, SECONDS = 1000.0, 1.5
#: Files on which a recording depends.
_FILES = ("leg", "departure", "instrument", "worlds")
SOURCES = tuple(Path(__file__).with_name(f"{name}.py") for name in _FILES)


@dataclass(frozen=True)
class Member:
    """One leg in one world, its session and its seed.

    Attributes:
        world: its name.
        seed: of everything drawn.
        leg: the truth.
        departures: what else the leg does.
        loads_kg: recorded loads, the smallest first.
        noise: standard deviation in a sample over the amplitude of the table.
        strength: of the dampers' bends, 1: as strong as those of the laboratory's foot.
        body_kg: body mass as stated.
        instruments: what traces pass, from the first.
        frequencies_hz: recorded under each load.
        seconds: length of a recording [s].
        table: amplitudes of the table's harmonics over that of the first.
        clock: error of the logger's clock, as a share.
    """

    world: str
    seed: int
    leg: Leg
    departures: tuple[Departure, ...]
    loads_kg: tuple[float, ...]
    noise: float
    strength: float
    body_kg: float
    instruments: tuple[Instrument, ...] = ()
    frequencies_hz: tuple[float, ...] = FREQUENCIES_HZ
    seconds: float = SECONDS
    table: tuple[float, ...] = TABLE
    clock: float = 0.0

    @cached_property
    def shaking(self) -> Shaking:
        """The session: all frequencies under one load, then under the next."""
        loads = np.repeat(self.loads_kg, len(self.frequencies_hz))
        hz = np.tile(self.frequencies_hz, len(self.loads_kg))
        seed = (self.seed, zlib.crc32(self.world.encode()))
        phases = np.random.default_rng([*seed, 1]).uniform(0, 2 * np.pi, (hz.size, len(self.table)))
        base = AMPLITUDE * np.array(self.table) * np.exp(1j * phases)
        return Shaking(loads, hz, base, seed)

    @property
    def s(self) -> complex:
        """I times the geometric mean of the recorded angular frequencies [rad/s]."""
        return 2j * np.pi * float(np.exp(np.log(self.frequencies_hz).mean()))

    @cached_property
    def dynamic(self) -> Mapping[str, float]:
        """Dynamic stiffness [N/m], damping [N s/m] at `s`, of the median seating without load."""
        leg = self.leg
        k, c = np.array([leg.k_T, leg.k_F]), np.array([leg.c_11, leg.c_21])
        relaxing = [d.stiffness(self.s) for d in self.departures if isinstance(d, Maxwell)]
        K = k * (1 + sum(relaxing)) + self.s * c
        values = [*K.real, *(K.imag / self.s.imag)]
        return dict(zip(("k_T", "k_F", "c_11", "c_21"), map(float, values), strict=True))

    @cached_property
    def truth(self) -> Mapping[str, tuple[float, float]]:
        """Least and largest value that a right interval may hold; see the table of this module."""
        by_load = [d for d in self.departures if isinstance(d, Scatter) and d.by_load]
        median, seated = (under(self.leg, d, self.shaking) for d in ((), by_load))
        factors = [*(seated.k / median.k)[:, 0], *(seated.c1 / median.c1)[:, 0]]
        return {
            name: (value * min(1.0, factor), value * max(1.0, factor))
            for (name, value), factor in zip(self.dynamic.items(), factors, strict=True)
        }

    @property
    def stiff_ankle(self) -> bool:
        """Whether the ankle is stiffer than where leg and mirror image are the same, at `s`."""
        return self.dynamic["k_T"] > self.leg.a * self.dynamic["k_F"]


def traces(member: Member) -> Traces:
    """What is written down of a member's session."""
    shaking, rng = member.shaking, np.random.default_rng([*member.shaking.seed, 2])
    parts, steps = round(1 / RATE_HZ / STEP_S), round(member.seconds * RATE_HZ)
    h = (1 + member.clock) / RATE_HZ / parts
    felt = motion(member.leg, member.departures, shaking, h, parts * (steps - 1) + 1)[:, :, ::parts]
    t = parts * h * np.arange(steps)
    exact = {"base": shaking.at(t[:, None]).T, "malleolus": felt[0], "foot": felt[1]}
    result = Traces(t, shaking, exact).mapped(lambda y: rng.normal(y, member.noise * AMPLITUDE))
    for change in member.instruments:
        result = change(result)
    return result


def recordings(member: Member, foot: bool = False) -> list[Recording]:
    """What the laboratory writes, with the body mass as stated.

    Args:
        member: leg and world.
        foot: a second sensor sits on the foot; the others read the same with it and without.
    """
    measured, session = traces(member), f"{member.world} {member.seed}"
    t, made = np.arange(measured.t.size) / RATE_HZ, []
    for i, (load, hz) in enumerate(zip(measured.shaking.load_kg, measured.shaking.hz, strict=True)):
        condition = Condition("made", "midstance", float(load), member.body_kg, float(hz))
        base, malleolus, second = (measured.channels[name][i] for name in ("base", *SENSORS))
        recording = Recording(
            t, base, malleolus, condition=condition, file=f"{session}: {load:g} kg, {hz:g} Hz",
            origin="synthetic", others={"foot": second} if foot else {},
        )  # fmt: skip
        made.append(recording)
    return made


def leg_of(rng: np.random.Generator, body_kg: float, strength: float) -> Leg:
    """A leg of either branch, with resonances where the thesis found them."""
    m_S, m_F = SHANK * body_kg, FOOT * body_kg
    a = m_S / (m_S + m_F)
    # sqrt(k_T a k_F) is the same on both branches; their ratio says which
    stiffness = (m_S + m_F) * (2 * np.pi * rng.uniform(23.0, 32.0)) ** 2
    apart = np.exp(rng.uniform(0.25, 1.1) * rng.choice([-1.0, 1.0]))
    size = stiffness / (m_S + m_F) * m_F / (2 * np.pi * 30)  # of a damper that leaves resonances visible
    c_11, c_21 = (float(c) for c in 1.8 * size * np.exp(rng.uniform(-0.6, 0.6, 2)))
    signs = rng.choice([-1.0, 1.0], 2)
    c_13, c_23 = (float(strength * rng.uniform(40, 180)) for _ in range(2))
    c_12, c_22 = (float(strength * bend) for bend in signs * (90, 120))
    k_T, k_F = float(stiffness * np.sqrt(apart * a)), float(stiffness / np.sqrt(apart * a))
    return Leg(k_T, k_F, c_11, c_12, c_13, c_21, c_22, c_23, m_S, m_F)


@dataclass(frozen=True)
class Draw:
    """A clean member, and what draws the size of a departure where its world leaves it open.

    Attributes:
        made: the member.
        rng: what draws.
    """

    made: Member
    rng: np.random.Generator

    def __call__(self, low: float, high: float) -> float:
        """A number between limits."""
        return self.rng.uniform(low, high)

    def log(self, low: float, high: float) -> float:
        """A number between limits, uniform on a logarithmic scale."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def sign(self) -> float:
        """1 or -1."""
        return float(self.rng.choice([-1.0, 1.0]))

    @property
    def stretch(self) -> np.ndarray:
        """(2,) typical stretches of ankle and pad under the largest load [m]."""
        leg, load = self.made.leg, self.made.loads_kg[-1]
        moved = leg.m_S + load + np.array([0.0, leg.m_F])
        return 2 * AMPLITUDE * moved / (leg.k_T, leg.k_F)

    @property
    def speed(self) -> np.ndarray:
        """(2,) rates of stretch of the linear leg at the middle of the band, without load [m/s]."""
        return AMPLITUDE * np.abs(self.made.s * self.made.leg.stretches(self.made.s))

    def bend(self, low: float, high: float, power: int, sign: float = 1.0) -> tuple[float, float]:
        """Coefficients of ankle and pad by which a power of the typical stretch bends a spring."""
        ankle, pad = sign * self.rng.uniform(low, high, 2) / self.stretch**power
        return float(ankle), float(pad)

    def of(self, *parts: Departure | Instrument, **changes: Any) -> Member:
        """The member with departures, instruments and other changes."""
        departures = tuple(part for part in parts if isinstance(part, Departure))
        instruments = tuple(part for part in parts if isinstance(part, Instrument))
        return replace(self.made, departures=departures, instruments=instruments, **changes)

    def stated(self, error: float) -> Member:
        """The body mass is stated wrongly, by a share."""
        return self.of(body_kg=self.made.body_kg * (1.0 + error))

    def loaded(self, part: Departure) -> Member:
        """A departure that shows under several loads only."""
        count = max(len(self.made.loads_kg), int(self.rng.integers(2, 4)))
        return self.of(part, loads_kg=LOADS_KG[:count])

    def scattered(self, std: float) -> Member:
        """A strongly nonlinear leg under two loads, whose constants differ between recordings."""
        made, strength = self.made, self(STRONG, 1.3)
        names = ("c_12", "c_13", "c_22", "c_23")
        bends = {name: getattr(made.leg, name) * strength / made.strength for name in names}
        leg = replace(made.leg, **bends)
        return self.of(Scatter(std), leg=leg, strength=strength, loads_kg=LOADS_KG[:2])


def _everything(d: Draw) -> Member:
    """What a laboratory may have at once, under two loads."""
    leg, off = d.made.leg, np.exp(0.08 * d.rng.standard_normal(2))
    leg = replace(leg, m_S=float(leg.m_S * off[0]), m_F=float(leg.m_F * off[1]))
    tissue = [departure.Mount(d(80, 150), d(0.1, 0.3))] if d.rng.random() < 0.6 else []
    relaxing = Maxwell(d(0, 0.5), d(0, 0.5), d.log(3e-3, 1e-2))
    scatter, share = Scatter(float(d.rng.choice([0.0, 0.01, 0.03]))), departure.LoadShare(d(0.8, 1))
    gain = instrument.Gain(d.rng.normal(0, 0.01))
    return d.of(share, scatter, relaxing, *tissue, gain, leg=leg, loads_kg=LOADS_KG[:2])


def _near_axis(d: Draw) -> Member:
    """A foot with k_T / (a k_F) = 0.93 at rest and 0.83 in the middle of the band.

    Few starts end on the wrong side of 1. Seeds vary noise and phases.
    """
    body, k_T, k_F = 76.0, 63176.0, 89559.0
    leg = Leg(k_T, k_F, 371.0, 127.1, 197.8, 670.7, -51.8, 37.5, SHANK * body, FOOT * body)
    member = d.of(Maxwell(6954.5 / k_T, 25396.2 / k_F, 9.1e-3), instrument.Noise(0.005), leg=leg)
    member = replace(member, body_kg=body, loads_kg=LOADS_KG[:2], noise=0.0, strength=1.0)
    return replace(member, frequencies_hz=FREQUENCIES_HZ[::2], seconds=1.5)


CLEAN, SCATTER_3 = "clean", "scatter 3 %"
EVERYTHING, NEAR_AXIS = "everything at once", "near the axis"
#: World -> its member; from "thigh" on, no nuisance of a fit names what departs.
WORLDS: Mapping[str, Callable[[Draw], Member]] = {
    CLEAN: lambda d: d.of(),
    "mass +10 %": lambda d: d.stated(0.10),
    "mass +5 %": lambda d: d.stated(0.05),
    "mass -5 %": lambda d: d.stated(-0.05),
    "mass -10 %": lambda d: d.stated(-0.10),
    "stiffer under load": lambda d: d.loaded(departure.Following(0.10, d.sign() > 0)),
    "springs relax": lambda d: d.of(Maxwell(d(0.15, 0.6), d(0.15, 0.6), d.log(3e-3, 1e-2))),
    "sensor on tissue": lambda d: d.of(departure.Mount(d(80, 150), d(0.1, 0.3))),
    "gain and drift": lambda d: d.of(instrument.Gain(0.03 * d.sign(), 0.02 * d.sign())),
    "rocking": lambda d: d.of(
        departure.Rocking(0.05 * d.sign(), d(50, 75), d(0.08, 0.2)), table=(1.0, 0.1, 0.008)
    ),
    "exponential springs": lambda d: d.of(departure.Exponential(*d.bend(0.1, 0.4, 1, d.sign()))),
    "cubic springs": lambda d: d.of(departure.Polynomial(cubic=d.bend(0.05, 0.25, 2))),
    "in g": lambda d: d.of(instrument.Unit(1 / GRAVITY)),
    "load share 0.9": lambda d: d.loaded(departure.LoadShare(0.9)),
    "load share 0.75": lambda d: d.loaded(departure.LoadShare(0.75)),
    "scatter 1 %": lambda d: d.scattered(0.01),
    SCATTER_3: lambda d: d.scattered(0.03),
    "scatter 5 %": lambda d: d.scattered(0.05),
    "scatter 3 % by load": lambda d: d.loaded(Scatter(0.03, by_load=True)),
    EVERYTHING: _everything,
    NEAR_AXIS: _near_axis,
    "thigh": lambda d: d.loaded(
        departure.Thigh(d.made.body_kg * d(0.03, 0.08), d.log(5, 12), d(0.2, 0.4))
    ),
    "heavier leg": lambda d: d.of(leg=replace(d.made.leg, m_S=1.5 * d.made.leg.m_S)),
    "reflex": lambda d: d.of(departure.Reflex(d(0.035, 0.045), d(0.04, 0.12), d(0.1, 0.3))),
    "friction": lambda d: d.of(
        departure.Friction(d(0.04, 0.12) * AMPLITUDE * d.made.leg.m_S, 0.05 * float(d.speed[0]))
    ),
    "dampers of 0.6": lambda d: d.of(departure.PowerLaw(0.6, tuple(d.speed))),
    "quadratic pad": lambda d: d.of(departure.Polynomial(quadratic=(0.0, d.bend(0.1, 0.3, 1)[1]))),
    "hum": lambda d: d.of(instrument.Hum(d(0.005, 0.02) * AMPLITUDE)),
    "cross axis": lambda d: d.of(instrument.CrossAxis(0.05, d(0.3, 1), d(20, 45), d(0.05, 0.15))),
    "8 bit": lambda d: d.of(instrument.Converter(8)),
    "clock": lambda d: d.of(clock=1e-3 * d.sign()),
    "clipping": lambda d: d.of(instrument.Clipping(d(0.85, 0.97))),
    "lifting heel": lambda d: d.of(departure.Lifting(d(1.2, 2))),
    "tremor": lambda d: d.of(departure.Tremor(d(0.1, 0.4), d(8, 12))),
    "thixotropy": lambda d: d.of(
        departure.Thixotropy(d(0.1, 0.3), 0.15, tuple(0.15 * d(0.5, 2) * d.speed))
    ),
    "posture drift": lambda d: d.of(departure.Posture(d.sign() * d(0.06, 0.12))),
}  # fmt: skip


def member(world: str, seed: int) -> Member:
    """One leg in one world; a seed gives the same leg and session, whatever else is drawn."""
    rng = np.random.default_rng([seed, zlib.crc32(world.encode()), 0])
    body, strength = rng.uniform(45, 110), float(np.exp(rng.uniform(np.log(0.03), np.log(1.3))))
    leg = leg_of(rng, body, strength)
    noise = float(np.exp(rng.uniform(np.log(0.002), np.log(0.01))))
    loads = LOADS_KG[: int(rng.choice([1, 2, 3], p=[0.25, 0.4, 0.35]))]
    made = Member(world, seed, leg, (), loads, noise, strength, body)
    return WORLDS[world](Draw(made, rng))
