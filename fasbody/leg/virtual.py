"""Virtual subjects of each mechanism, stepped in time: what a recording of them would give.

A simulator of its own: masses with absolute forces, a step at a time (Runge-Kutta, fourth order), and no line shared
with the responses that an analysis fits. A subject's masses differ from those that body-segment tables give for the
body mass that is stated, and the sensors sit on soft tissue and are a little out of gauge.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit

from fasbody.leg.lift_off import REFERENCE_N, G
from fasbody.leg.mechanisms import MASSES, TISSUE_KG

Array = np.ndarray
#: What is assumed of a recording: scatter of a response and of a second harmonic [1], of a sensor's gain [1], of the
#: stated body mass [1]; frequencies [Hz] and damping ratios of the sensors on the skin, drawn evenly.
NOISE, GAIN, MASS, MOUNT_HZ, MOUNT_ZETA = 0.02, 0.015, 0.05, (80.0, 200.0), (0.1, 0.3)
#: Periods and seconds before the motion is read, periods read, longest step [s], what still counts as repeated.
SETTLING, SETTLED_S, READ, LONGEST, SAME = 16, 2.0, 3, 1.3e-4, 0.03


@dataclass(frozen=True)
class Recordings:
    """What a plan's recordings give, each array (n,), complex unless said otherwise.

    Attributes:
        MB, TB: malleolus and tuberosity over the table. second: second harmonic of the malleolus over its first.
        air: share of the time without contact, as the simulator knows it. repeats: whether each motion repeats after
            one period, as a recording shows.
    """

    MB: Array
    TB: Array
    second: Array
    air: Array
    repeats: Array

    def only(self, rows: Array) -> "Recordings":
        """Those recordings alone, (n,) bool or places."""
        return Recordings(self.MB[rows], self.TB[rows], self.second[rows], self.air[rows], self.repeats[rows])


@dataclass(frozen=True)
class Subject:
    """One virtual subject.

    Attributes:
        mechanism: name. values: constants as the tables have them for the stated body mass.
        body: true over stated body mass. gain: of both sensors. mount_hz, mount_zeta: of both.
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
        return cls(mechanism, dict(values), 1 + MASS * rng.standard_normal(), 1 + GAIN * rng.standard_normal(2),
                   rng.uniform(*MOUNT_HZ, 2), rng.uniform(*MOUNT_ZETA, 2))  # fmt: skip

    def shaken(self, frequency_hz: Array, added_kg: Array, table: Array) -> Recordings:
        """True motion at every frequency [Hz], load [kg] and amplitude [m/s^2], each (n,), as the sensors give it."""
        rows = [self._one(f, added, a) for f, added, a in zip(frequency_hz, added_kg, table, strict=True)]
        out = np.array(rows)
        first = out[:, 0] * mount(frequency_hz, self.mount_hz[0], self.mount_zeta[0])
        second = out[:, 1] * mount(2 * frequency_hz, self.mount_hz[0], self.mount_zeta[0])
        tibia = out[:, 2] * mount(frequency_hz, self.mount_hz[1], self.mount_zeta[1])
        return Recordings(self.gain[0] * first / table, self.gain[1] * tibia / table, second / first,
                          out[:, 3].real, out[:, 4].real < SAME)  # fmt: skip

    def _one(self, frequency_hz: float, added_kg: float, table: float) -> Array:
        v = {name: value * (self.body if name in MASSES else 1.0) for name, value in self.values.items()}
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
            mass, below, k, c, at = [v["m"] + v["share"] * added_kg], [-1], [0.0], [0.0], (0, 0)
        pad = np.zeros(4)
        if "rest" in v:
            n = v["exponent"]
            A = (v["k"] / (n * REFERENCE_N ** (1 - 1 / n))) ** n
            pad = np.array([A, n, v["c"] * n * A / v["k"], v["rest"] + G * added_kg])
        arrays = (np.array(mass), np.array(below), np.array(k), np.array(c), pad)
        return np.array(_shake(frequency_hz, table, *arrays, *at))


def mount(frequency_hz: Array, mount_hz: Array | float, zeta: Array | float) -> Array:
    """What a sensor on the skin reads over what the bone does, complex."""
    r = 1j * np.asarray(frequency_hz) / mount_hz
    return (1 + 2 * zeta * r) / (1 + 2 * zeta * r + r**2)


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
    """Harmonics 1, 2 of mass `one`, 1 of mass `two` [m/s^2], share in the air, largest gap of the foot."""
    n, omega = m.size, 2 * np.pi * frequency_hz
    count = max(120, int(np.ceil(1 / (frequency_hz * LONGEST))))
    settling = max(SETTLING, int(np.ceil(SETTLED_S * frequency_hz)))
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
                a = ramp * np.sin(angle + (0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)) * omega * h)
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
    return scale * first, scale * second, scale * other, complex(air / (count * READ), 0.0), complex(gap / size, 0.0)
