"""What the virtual bench is made of: an SCPI instrument, a shaker, and a MuJoCo foot stepped piece by piece."""

from collections import deque
from typing import Any, ClassVar

import numpy as np

from fasbody.laboratory import TRUTH
from fasbody.model import load
from fasbody.shaker import BaseMotion
from fasbody.simulate import Batch
from fasbody.subjects import SUBJECTS, foot_mass, shank_mass

#: The subject whose masses the virtual foot has.
SUBJECT = 16
BODY_MASS_KG = SUBJECTS[SUBJECT].mass_kg
#: Base acceleration a volt at the amplifier's gain [m/s^2 per V], its lag [s], harmonics of the shaker over the first.
GAIN, LAG_S, DISTORTION = 14.0, 0.03, ((2, 0.015, 0.7), (3, 0.008, 1.9))
NOISE_BASE, NOISE_MALLEOLUS = 0.03, 0.05


class Shaker:
    """State of the SCPI generator. `do` takes one command and returns the answer to a query."""

    LIMITS: ClassVar = {"FREQ": (1e-3, 1e6), "VOLT": (0.0, 20.0), "VOLT:OFFS": (-10.0, 10.0)}

    def __init__(self) -> None:
        self.errors: deque[str] = deque(maxlen=20)
        self._reset()

    def _reset(self) -> None:
        self.values = {"FREQ": 1000.0, "VOLT": 0.1, "VOLT:OFFS": 0.0}
        self.on = False

    def do(self, command: str) -> str | None:
        """Execute one line."""
        head, _, value = command.upper().partition(" ")
        if head.endswith("?"):
            return self._answer(head[:-1])
        if head in self.LIMITS:
            self._set(head, value)
        elif head == "OUTP" and value in ("ON", "1", "OFF", "0"):
            self.on = value in ("ON", "1")
        elif head == "*CLS":
            self.errors.clear()
        elif head == "*RST":
            self._reset()
        elif command and (head, value) not in (("FUNC", "SIN"), ("VOLT:UNIT", "VPP")):
            self.errors.append('-113,"Undefined header"')
        return None

    def _set(self, head: str, value: str) -> None:
        low, high = self.LIMITS[head]
        try:
            number = float(value)
        except ValueError:
            self.errors.append('-104,"Data type error"')
            return
        if low <= number <= high:
            self.values[head] = number
        else:
            self.errors.append('-222,"Data out of range"')

    def _answer(self, head: str) -> str | None:
        if head == "*IDN":
            return "FAS,virtual generator,0,1"
        if head == "SYST:ERR":
            return self.errors.popleft() if self.errors else '0,"No error"'
        if head == "OUTP":
            return "1" if self.on else "0"
        if head in self.values:
            return f"{self.values[head]:g}"
        self.errors.append('-113,"Undefined header"')
        return None

    def output(self) -> dict[str, Any]:
        """What comes out: amplitude [V peak to peak] and frequency."""
        return {"frequency_hz": self.values["FREQ"], "volts": self.values["VOLT"] if self.on else 0.0}


class Shaken:
    """A foot on the shaker, in steps of real time.

    Args:
        rate_hz: sampling rate. added_mass_kg: on the knee. rng: noise of the sensors.
    """

    def __init__(self, rate_hz: float, added_mass_kg: float, rng: np.random.Generator) -> None:
        masses = {"m_S": shank_mass(BODY_MASS_KG, added_mass_kg), "m_F": foot_mass(BODY_MASS_KG)}
        self.foot = load("two_dof").with_values({**TRUTH, **masses})
        self._stride = max(1, int(np.ceil(1 / rate_hz / self.foot.step - 1e-9)))
        self._step = 1 / rate_hz / self._stride
        self._batch = Batch(self.foot, 1, 1)
        self._qpos, self._qvel = self.foot.model.qpos0.copy(), np.zeros(self.foot.model.nv)
        self._rng = rng
        self._omega, self._phase = 2 * np.pi * 20.0, 0.0
        self._amplitude = self._wanted = 0.0  # [m/s^2], of the first harmonic
        self.advance(4)  # compiles

    def drive(self, order: dict[str, Any]) -> None:
        """The generator's output changed."""
        if "volts" in order:
            self._omega = 2 * np.pi * float(order["frequency_hz"])
            self._wanted = 0.5 * GAIN * float(order["volts"])

    def advance(self, samples: int) -> np.ndarray:
        """The next samples: (n, 3) base, malleolus and tuberosity (on the same rigid shank), with noise [m/s^2]."""
        count = samples * self._stride
        length = count * self._step
        controls = self._motion(length).controls(self._step, count)[None]
        out = self._batch.run(controls, self._step, self._qpos, self._qvel)
        self._qpos, self._qvel = out.qpos[0, -1].copy(), out.qvel[0, -1].copy()
        base = self.foot.base
        self._qpos[base] = self._qvel[base] = 0.0  # the foot does not feel them, and they would drift
        self._phase = (self._phase + self._omega * length) % (2 * np.pi)
        self._amplitude = self._wanted + (self._amplitude - self._wanted) * np.exp(-length / LAG_S)
        y = out.malleolus[0, :: self._stride]
        clean = np.column_stack([out.base[0, :: self._stride], y, y])
        return clean + self._rng.normal(size=clean.shape) * [NOISE_BASE, NOISE_MALLEOLUS, NOISE_MALLEOLUS]

    def _motion(self, length: float) -> BaseMotion:
        """Base motion from now on: the amplitude follows its set value with the amplifier's lag."""
        w, p, wanted, gap = self._omega, self._phase, self._wanted, self._amplitude - self._wanted
        lines = ((1, 1.0, 0.0), *DISTORTION)

        def acceleration(t: np.ndarray) -> np.ndarray:
            wave = sum(size * np.sin(h * (p + w * t) + late) for h, size, late in lines)
            return (wanted + gap * np.exp(-t / LAG_S)) * wave

        def jerk(t: np.ndarray) -> np.ndarray:
            wave = sum(size * np.sin(h * (p + w * t) + late) for h, size, late in lines)
            slope = sum(size * h * w * np.cos(h * (p + w * t) + late) for h, size, late in lines)
            fade = gap * np.exp(-t / LAG_S)
            return (wanted + fade) * slope - fade / LAG_S * wave

        return BaseMotion("virtual shaker", length, acceleration, jerk)
