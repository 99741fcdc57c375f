"""Virtual subjects of each mechanism, stepped in time: what a recording of them would give.

A separate simulator: masses with absolute forces, a step at a time (Runge-Kutta, fourth order), and no
line shared with the responses that an analysis fits. A subject's masses differ from those that
body-segment tables give for the body mass that is stated, and the sensors sit on soft tissue and
are a little out of gauge.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from fasbody.constants import MODEL_GRAVITY
from fasbody.leg.statements import ADDED_KG, Curves, judge, ranges_met
from fasbody.transmissibility.findings import FREQUENCIES_HZ
from identification.rivals.mechanism_fit import (
    AIR,
    DEPARTURE,
    GAIN,
    MASS,
    NOISE,
    Plan,
    Responses,
    predict,
)
from identification.rivals.mechanisms import BODY_KG, MASSES, MECHANISMS, TISSUE_KG
from identification.rivals.motion import hung
from identification.rivals.pad_balance import REFERENCE_N, TABLE_M_S2

Array = np.ndarray
#: Frequencies [Hz] and damping ratios of the sensors on the skin, drawn evenly.
MOUNT_HZ, MOUNT_ZETA = (80.0, 200.0), (0.1, 0.3)
#: Periods and seconds before the motion is read, periods read.
SETTLING, SETTLING_S, READ = 16, 2.0, 3
#: Longest step [s]; what still counts as repeated.
LONGEST, SAME = 1.3e-4, 0.03
#: Width of a departure's bumps, in the logarithm of the frequency.
WIDTH = 0.35
#: Draws of which a subject is the one that looks most like the thesis.
CHOICE = 40
#: Share of the thesis' recordings for which a balanced motion must be known.
BALANCED = 0.9
#: The recordings of the thesis.
THESIS = Plan(
    "and the tuberosity (the thesis)",
    np.tile(np.array(FREQUENCIES_HZ, float), len(ADDED_KG)),
    np.repeat(ADDED_KG, len(FREQUENCIES_HZ)),
    np.full(len(ADDED_KG) * len(FREQUENCIES_HZ), TABLE_M_S2),
)


@dataclass(frozen=True)
class Subject:
    """One virtual subject.

    Attributes:
        mechanism: name.
        values: constants as the tables have them for the stated body mass.
        body: true over stated body mass.
        gain: of both sensors, (2,).
        mount_hz: of both sensors' seats, (2,).
        mount_zeta: of both sensors' seats, (2,).
    """

    mechanism: str
    values: Mapping[str, float]
    body: float
    gain: Array
    mount_hz: Array
    mount_zeta: Array

    @classmethod
    def drawn(cls, mechanism: str, values: Mapping[str, float], rng: np.random.Generator) -> "Subject":
        """A subject with these constants, its masses and sensors drawn."""
        body, gain = 1 + MASS * rng.standard_normal(), 1 + GAIN * rng.standard_normal(2)
        seats = rng.uniform(*MOUNT_HZ, 2), rng.uniform(*MOUNT_ZETA, 2)
        return cls(mechanism, dict(values), body, gain, *seats)

    def shaken(self, frequency_hz: Array, added_kg: Array, table: Array) -> Responses:
        """True motion at frequencies [Hz], loads [kg] and amplitudes [m/s^2] (n,), as sensed."""
        shakings = zip(frequency_hz, added_kg, table, strict=True)
        out = np.array([self._shaken_once(*shaking) for shaking in shakings])
        s = 2j * np.pi * frequency_hz
        first = out[:, 0] * hung(s, self.mount_hz[0], self.mount_zeta[0])
        second = out[:, 1] * hung(2 * s, self.mount_hz[0], self.mount_zeta[0])
        tibia = out[:, 2] * hung(s, self.mount_hz[1], self.mount_zeta[1])
        MB, TB = self.gain[0] * first / table, self.gain[1] * tibia / table
        return Responses(MB, TB, second / first, out[:, 4].real < SAME, out[:, 3].real)

    def _shaken_once(self, frequency_hz: float, added_kg: float, table: float) -> Array:
        v = {k: x * (self.body if k in MASSES else 1.0) for k, x in self.values.items()}
        if "k_M" in v:
            m_M = v["share"] * v["m_S"]
            mass = [v["m_F"], m_M, v["m_S"] - m_M, v["m_H"], TISSUE_KG + added_kg]
            below = [-1, 0, 1, 2, 2]
            k = [v.get("k_F", 0.0), *(v[f"k_{i}"] for i in "MTHA")]
            c = [v.get("c_F", 0.0), *(v[f"c_{i}"] for i in "MTHA")]
            at = (1, 2)
        elif "k_F" in v:
            mass, below, at = [v["m_F"], v["m_S"] + added_kg], [-1, 0], (1, 1)
            stiffer = (sum(mass) / (sum(mass) - added_kg)) ** v.get("p", 0.0)
            k, c = [stiffer * v["k_F"], stiffer * v["k_T"]], [v["c_F"], v["c_T"]]
        else:
            mass, below, at = [v["m"] + v["share"] * added_kg], [-1], (0, 0)
            k, c = [0.0], [0.0]
        pad = np.zeros(4)
        if "rest" in v:
            n = v["exponent"]
            A = (v["k"] / (n * REFERENCE_N ** (1 - 1 / n))) ** n
            pad = np.array([A, n, v["c"] * n * A / v["k"], v["rest"] + MODEL_GRAVITY * added_kg])
        arrays = (np.array(mass), np.array(below), np.array(k), np.array(c), pad)
        return np.array(_shake(frequency_hz, table, *arrays, *at))


@njit(cache=True)
def _forces(u, v, k, c, below, pad, F):  # type: ignore[no-untyped-def]
    """Forces [N] on each mass, for displacements u and rates v relative to the table."""
    for i in range(u.size):
        F[i] = 0.0
    for i in range(u.size):
        j = below[i]
        if j >= 0:
            pull = k[i] * (u[i] - u[j]) + c[i] * (v[i] - v[j])
            F[j] += pull
        elif pad[0] > 0.0:  # about the static state, pressed by pad[3]
            d = (pad[3] / pad[0]) ** (1.0 / pad[1]) - u[i]
            pull = pad[3]
            if d > 0.0:
                pull -= max(0.0, pad[0] * d ** pad[1] - pad[2] * d ** (pad[1] - 1.0) * v[i])
        else:
            pull = k[i] * u[i] + c[i] * v[i]
        F[i] -= pull


@njit(cache=True)
def _shake(frequency_hz, table, m, below, k, c, pad, one, two):  # type: ignore[no-untyped-def]
    """Harmonics 1, 2 of mass `one`, 1 of mass `two` [m/s^2], share in the air, gap of the foot."""
    n, omega = m.size, 2 * np.pi * frequency_hz
    count = max(120, int(np.ceil(1 / (frequency_hz * LONGEST))))
    settling = max(SETTLING, int(np.ceil(SETTLING_S * frequency_hz)))
    h = 1 / (frequency_hz * count)
    u, v, F = np.zeros(n), np.zeros(n), np.zeros(n)
    x, y, du, dv = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    u_0, v_0, gap, size, air = 0.0, 0.0, 0.0, 1e-12, 0.0
    first, second, other = 0j, 0j, 0j
    for period in range(settling + READ + 1):
        if period > settling:  # of the foot: slow masses above it may still settle
            gap = max(gap, abs(u[0] - u_0), abs(v[0] - v_0) / omega)
        u_0, v_0 = u[0], v[0]
        if period == settling + READ:
            break
        ramp = table * min(1.0, (period + 1) / 4)
        for step in range(count):
            angle = omega * h * step
            for i in range(n):
                x[i], y[i], du[i], dv[i] = u[i], v[i], 0.0, 0.0
            for stage in range(4):
                _forces(x, y, k, c, below, pad, F)
                if stage == 0 and period >= settling:
                    turn = complex(np.cos(angle), -np.sin(angle))
                    first += F[one] / m[one] * turn
                    second += F[one] / m[one] * turn * turn
                    other += F[two] / m[two] * turn
                    size = max(size, abs(u[0]))
                    if pad[0] > 0.0:
                        d = (pad[3] / pad[0]) ** (1.0 / pad[1]) - u[0]
                        air += 1.0 if d <= 0.0 or pad[0] * d - pad[2] * v[0] <= 0.0 else 0.0
                ahead = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                a = ramp * np.sin(angle + ahead * omega * h)
                weight = h / 6 if stage in (0, 3) else h / 3
                ahead = h if stage == 2 else 0.5 * h
                for i in range(n):
                    rate = F[i] / m[i] - a
                    du[i] += weight * y[i]
                    dv[i] += weight * rate
                    x[i], y[i] = u[i] + ahead * y[i], v[i] + ahead * rate
            for i in range(n):
                u[i] += du[i]
                v[i] += dv[i]
    scale = 2j / (count * READ)  # so that the table, a sin(w t), is a itself
    sizes = complex(air / (count * READ), 0.0), complex(gap / size, 0.0)
    return scale * first, scale * second, scale * other, *sizes


def draw(name: str, rng: np.random.Generator, choice: int = CHOICE, body_kg: float = BODY_KG) -> Subject:
    """A subject of a mechanism: of some draws the one that looks most like the thesis.

    On a pad that cannot pull it must lose contact in some recording of the thesis.
    """
    mechanism = MECHANISMS[name].of(body_kg)
    values = mechanism.values(rng.random((choice, len(mechanism.constants))))
    response = predict(mechanism, values, THESIS)
    MB, TB = (T.reshape(choice, len(ADDED_KG), -1) for T in (response.MB, response.TB))
    peak = np.array(FREQUENCIES_HZ)[np.abs(MB).argmax(axis=-1)]
    score = 3.0 * ranges_met(peak).sum(axis=-1) + judge(Curves(MB, TB / MB)).sum(axis=-1)
    if response.air is not None:
        good = response.repeats.mean(axis=1) >= BALANCED
        score = np.where((response.air.max(axis=1) >= AIR) & good, score, -1.0)
    at = int(score.argmax())
    return Subject.drawn(name, {k: float(v[at]) for k, v in values.items()}, rng)


def measured(subject: Subject, plan: Plan, rng: np.random.Generator, departure: float = DEPARTURE) -> Responses:
    """A subject's recordings with scatter, its responses off every mechanism by a smooth share.

    The share, of size `departure`, is the same at every amplitude: what moves in the foot is.
    """
    true = subject.shaken(plan.frequency_hz, plan.added_kg, plan.table)
    off = [1 + departure * _bumps(plan, rng) for _ in range(2)]

    def noisy(value: Array, floor: float = 0.0) -> Array:
        noise = rng.standard_normal(value.size) + 1j * rng.standard_normal(value.size)
        return value + (floor + NOISE * np.abs(value)) * noise

    MB, TB = noisy(true.MB * off[0]), noisy(true.TB * off[1])
    return replace(true, MB=MB, TB=TB, second=noisy(true.second, NOISE))


def _bumps(plan: Plan, rng: np.random.Generator) -> Array:
    """A smooth complex random function of the frequency, one a load, of mean square 1, (n,)."""
    hz, at = np.unique(plan.frequency_hz, return_inverse=True)
    apart = np.log(hz)[:, None] - np.log(hz)
    root = np.linalg.cholesky(np.exp(-0.5 * (apart / WIDTH) ** 2) + 1e-9 * np.eye(hz.size))
    loads, load = np.unique(plan.added_kg, return_inverse=True)
    z = rng.standard_normal((2, hz.size, loads.size))
    return (root @ (z[0] + 1j * z[1]))[at, load] / np.sqrt(2)
