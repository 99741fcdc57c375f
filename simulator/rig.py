"""Feet that a plan has no data of, their recordings, and a faulty shaker.

Legs of both branches, segment masses off by 10 % from what the scale and the table say, a gain that is off by 1 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from scipy.signal import cont2discrete, lfilter

from fasbody.acquire.board import Watch
from fasbody.acquire.level import Safety, reach
from fasbody.acquire.wire import Channel as WireChannel
from fasbody.acquire.wire import Hello
from fasbody.recording.condition import Condition
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Recording
from identification.plan.candidates import Step
from simulator.leg import Leg, Shaking, harmonics, sample
from simulator.worlds import FOOT, RATE_HZ, SHANK, leg_of

#: Standard deviations of the segment masses and of the gain (shares); of the noise in a sample [m/s^2], drawn between.
MASS_STD, GAIN_STD, NOISE = 0.10, 0.01, (0.25, 1.0)
#: Recordings are written so many times shorter, with less noise by the root of that: the same information about a
#: settled sine, for a fifth of the computing.
SHORTER = 5


@dataclass(frozen=True)
class Virtual:
    """A foot that is recorded.

    Attributes:
        leg: the truth. body_kg: as the scale says. gain: error of the malleolus' channel. noise_m_s2: of a sample.
        strength: of the dampers' nonlinearity.
    """

    seed: int
    leg: Leg
    body_kg: float
    gain: float
    noise_m_s2: float
    strength: float


def virtual(seed: int, stiffer: float = 1.0) -> Virtual:
    """A foot of a population that is not the plan's: neither its springs, nor its dampers, nor its noise.

    Args:
        seed: of the foot.
        stiffer: factor of the springs, and of the dampers by its root; for a population that is shifted.
    """
    rng = np.random.default_rng([seed, 2020])
    body, strength = float(rng.uniform(45, 110)), float(np.exp(rng.uniform(np.log(0.03), np.log(1.3))))
    true = np.exp(MASS_STD * rng.standard_normal(2))
    leg = leg_of(rng, body, strength)
    root = float(np.sqrt(stiffer))
    leg = replace(
        leg, k_T=stiffer * leg.k_T, k_F=stiffer * leg.k_F, c_11=root * leg.c_11, c_21=root * leg.c_21,
        m_S=SHANK * body * true[0], m_F=FOOT * body * true[1],
    )  # fmt: skip
    noise = float(np.exp(rng.uniform(*np.log(NOISE))))
    return Virtual(seed, leg, body, float(GAIN_STD * rng.standard_normal()), noise, strength)


def malleolus(leg: Leg, steps: Sequence[Step], bases: np.ndarray) -> np.ndarray:
    """Harmonics (n, H) of the malleolus [m/s^2] under those of the base (n, 3), step by step."""
    loads, hz = np.array([(step.added_mass_kg, step.frequency_hz) for step in steps]).T
    return harmonics(leg, (), Shaking(loads, hz, bases))[0]


def recorded(foot: Virtual, steps: Sequence[Step], session: int, scatter: float = 0.0) -> list[Recording]:
    """What the laboratory writes of these steps.

    Args:
        foot: who is shaken.
        steps: recordings.
        session: of the random numbers.
        scatter: standard deviation of real and imaginary part of a harmonic of the malleolus from one
            recording to the next, as a share of it.
    """
    rng = np.random.default_rng([foot.seed, session])
    made, bases, noises = [], [], []
    for step in steps:
        phases = rng.uniform(0, 2 * np.pi, 3)
        bases.append(step.amplitude_m_s2 * np.array([1.0, 0.015, 0.008]) * np.exp(1j * phases))
        noises.append(rng.standard_normal((2, round(step.seconds / SHORTER * RATE_HZ))))
    moved = (1 + foot.gain) * malleolus(foot.leg, steps, np.array(bases))
    moved = moved * (1 + scatter * (rng.standard_normal(moved.shape) + 1j * rng.standard_normal(moved.shape)))
    size = foot.noise_m_s2 / np.sqrt(SHORTER)
    for step, base, felt, noise in zip(steps, bases, moved, noises, strict=True):
        t, hz = np.arange(noise.shape[1]) / RATE_HZ, step.frequency_hz
        a, b = size * noise + [sample(t, hz, x) for x in (base, felt)]
        condition = Condition("made", "midstance", step.added_mass_kg, foot.body_kg, hz)
        made.append(Recording(t, a, b, condition=condition, file=str(step), origin="synthetic"))
    return made


class Rig:
    """A faulty shaker with its sensors, in simulated time: board and generator in one.

    `reach` (acquire's amplitude loop) drives it and its watch looks at every block, as acquire's board does. The
    malleolus follows the base as it would if it were settled at every instant. What the base really does is measured
    by the rig itself, acceleration and travel, and compared with the laboratory's limits as they are written here: no
    number of the guard's goes into that.

    Args:
        foot: on it. rng: of what goes wrong.

    Attributes:
        peak_m_s2, travel_m: largest acceleration, and travel peak to peak within a period, that the base had.
        beyond_s: longest time from the first to the last sample beyond the acceleration. jumps: of the gain, while it
            was on. ran_away: blocks in which the gain ran away. crept: it was beyond a limit in a step in which no gain
            had jumped.
    """

    rate_hz, block = 1000.0, 16
    identity, latency_s = "rig", 0.0
    base = unplugs = 0
    #: The laboratory's limits: acceleration [m/s^2], travel peak to peak [m].
    most_m_s2, most_m = 15.0, 0.008
    #: Time constant with which the shaker follows its amplifier [s], and its suspension [Hz, damping ratio].
    lag_s, suspension = 0.01, (3.0, 0.7)

    def __init__(self, foot: Virtual, rng: np.random.Generator) -> None:
        self._foot, self._rng = foot, rng
        self.volts, self.is_on = 0.0, False
        self.watch: Watch | None = None
        kinds = tuple(WireChannel(role, 39.2, 1000.0) for role in ("base", "malleolus"))
        self.decoder = SimpleNamespace(hello=Hello("rig", self.rate_hz, kinds, 16, self.block, 1))
        self._hz, self._t = 20.0, 0.0
        self._gain = 14.0 * float(np.exp(0.5 * rng.standard_normal()))
        self._drift = float(rng.choice([0.0, 0.002, -0.004]))  # of the gain, a second
        self._second = float(rng.choice([0.015, 0.05, 0.09]))
        self._jumps = float(rng.choice([0.0, 0.004, 0.02]))  # a second
        self._runs = float(rng.choice([0.0, 0.0, 0.02]))  # away, a second: by a fifth each second until it is off
        self._dead = float(rng.choice([0.0, 15.0, 40.0]))  # it does not answer near this frequency [Hz]
        self._clips = float(
            rng.choice([np.inf, np.inf, np.inf, np.inf, np.inf, 12.0, 11.0, 7.0])
        )  # amplitude of the amplifier's rail [m/s^2]
        self.safety = Safety()
        self.peak_m_s2 = self.travel_m = self.beyond_s = 0.0
        self.jumps, self.ran_away, self.crept = 0, 0, False
        self._jump = self._grown = 1.0  # what the gain is multiplied by
        self._size, self._jumped, self._away, self._first, self._last = 0.0, False, False, -np.inf, -np.inf
        w, zeta = 2 * np.pi * self.suspension[0], self.suspension[1]
        self._mount = cont2discrete(([1.0], [1.0, 2 * zeta * w, w * w]), 1 / self.rate_hz, "bilinear")[:2]
        self._held, self._travel = np.zeros(2), np.zeros(0)

    def sine(self, frequency_hz: float, volts: float) -> None:
        """See acquire's generator."""
        self._hz = frequency_hz
        self.set_volts(volts)

    def set_volts(self, volts: float) -> None:
        """See acquire's generator."""
        self.volts = volts

    def on(self) -> None:
        """See acquire's generator."""
        self.is_on, self._jumped = True, False

    def off(self) -> None:
        """See acquire's generator; the shaker comes to rest."""
        self.is_on, self.watch = False, None
        for _ in range(round(10 * self.lag_s * self.rate_hz / self.block)):
            self._next()

    def ramp_down(self) -> None:
        """See acquire's generator."""
        self.off()

    def alive(self) -> None:
        """See acquire's generator: this one has no guard to tell."""

    def watch_for(self, seconds: float) -> None:
        """See acquire's board."""
        self.collect(seconds)

    def collect(self, seconds: float) -> np.ndarray:
        """(n, 1) of the base [m/s^2], block by block, each of which the watch sees."""
        blocks = []
        for _ in range(max(1, round(seconds * self.rate_hz / self.block))):
            blocks.append(self._next())
            if self.watch is not None:
                self.watch.check(blocks[-1])
        return np.concatenate(blocks)[:, None]

    def _next(self) -> np.ndarray:
        t = self._t + np.arange(self.block) / self.rate_hz
        self._t += self.block / self.rate_hz
        self._away = self.is_on and (self._away or self._rng.random() < self._runs * self.block / self.rate_hz)
        self.ran_away += self._away
        self._gain *= 1 + self._drift * self.block / self.rate_hz
        self._grown = self._grown * (1 + 0.2 * self.block / self.rate_hz) if self._away else 1.0
        if self.is_on and self._rng.random() < self._jumps * self.block / self.rate_hz:
            self._jump = float(self._rng.choice([0.6, 1.3, 2.0, 4.0]))
            self.jumps, self._jumped = self.jumps + 1, True
        gain = self._gain * self._jump * self._grown if abs(self._hz - self._dead) > 1 else 0.0
        target = 0.5 * gain * self.volts if self.is_on else 0.0
        size = target + (self._size - target) * np.exp(-np.arange(1, self.block + 1) / self.rate_hz / self.lag_s)
        self._size = float(size[-1])
        wave = size * (np.sin(2 * np.pi * self._hz * t) + self._second * np.sin(4 * np.pi * self._hz * t + 0.7))
        wave = np.clip(wave, -self._clips, self._clips)
        self._measure(t, wave)
        return np.asarray(wave + 0.03 * self._rng.standard_normal(self.block))

    def _measure(self, t: np.ndarray, wave: np.ndarray) -> None:
        """What the base really does in a block: acceleration (n,) at times t (n,)."""
        (above,), below = self._mount
        moved, self._held = lfilter(above, below, wave, zi=self._held)
        self._travel = np.concatenate([self._travel, moved])[-round(self.rate_hz / self._hz) - self.block :]
        period = round(self.rate_hz / self._hz)
        travel = np.array([np.ptp(self._travel[max(0, i - period) : i + 1]) for i in range(self._travel.size)])[
            -t.size :
        ]
        self.peak_m_s2, self.travel_m = max(self.peak_m_s2, abs(wave).max()), max(self.travel_m, travel.max())
        for now in t[abs(wave) > self.most_m_s2]:
            self._first = now if now - self._last > 1 / self._hz else self._first
            self._last = now
            self.beyond_s = max(self.beyond_s, now - self._first)
        far = abs(wave).max() > self.most_m_s2 or travel.max() > self.most_m
        self.crept |= bool(far and not self._jumped)

    def record(self, step: Step) -> Recording:
        """Level, record, off: what acquire's session does, with the same amplitude loop and watch."""
        try:
            reach(self, self, step.frequency_hz, 2 * step.amplitude_m_s2, self.safety)  # type: ignore[arg-type]
            self.collect(0.5)
            base = np.concatenate([self.collect(0.25) for _ in range(round(step.seconds / 0.25))])[:, 0]
        finally:
            self.off()
        t = np.arange(base.size) / self.rate_hz
        hz = step.frequency_hz
        parts = max(1, int(t[-1] * hz / 10))  # ten periods at a time
        cuts = [slice(i * base.size // parts, (i + 1) * base.size // parts) for i in range(parts)]
        bases = np.array([fit_harmonics(t[cut], base[cut], hz, 3).amplitudes for cut in cuts])
        felt = malleolus(self._foot.leg, parts * [step], bases)
        y = np.concatenate([sample(t[cut], hz, Y) for cut, Y in zip(cuts, felt, strict=True)])
        noise = self._foot.noise_m_s2 * self._rng.standard_normal((2, base.size))
        condition = Condition("made", "midstance", step.added_mass_kg, self._foot.body_kg, step.frequency_hz)
        a, b = base + noise[0], (1 + self._foot.gain) * y + noise[1]
        return Recording(t, a, b, condition=condition, file=str(step), origin="synthetic")
