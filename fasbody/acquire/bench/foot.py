"""The shaken foot: a MuJoCo foot on a shaker, stepped piece by piece in real time."""

from typing import Any

import numpy as np

from fasbody.foot.shaker import BaseMotion
from fasbody.recording.condition import SUBJECTS, foot_mass, shank_mass

#: The subject whose masses the virtual foot has.
SUBJECT = 16
BODY_MASS_KG = SUBJECTS[SUBJECT].mass_kg
#: Base acceleration a volt at the amplifier's gain [m/s^2 per V], its lag [s], harmonics of the shaker over the first.
GAIN, LAG_S, DISTORTION = 14.0, 0.03, ((2, 0.015, 0.7), (3, 0.008, 1.9))
NOISE_BASE, NOISE_MALLEOLUS = 0.03, 0.05


class ShakenFoot:
    """A foot on the shaker, in steps of real time.

    Args:
        rate_hz: sampling rate.
        added_mass_kg: on the knee.
        rng: noise of the sensors.
        one_mass: both sensors are on the base, the malleolus' with this gain; 0 for a foot.
    """

    def __init__(self, rate_hz: float, added_mass_kg: float, rng: np.random.Generator, one_mass: float = 0.0) -> None:
        from fasbody.foot.model import load
        from fasbody.foot.simulate import Batch
        from fasbody.laboratory.foot import TRUTH

        masses = {"m_S": shank_mass(BODY_MASS_KG, added_mass_kg), "m_F": foot_mass(BODY_MASS_KG)}
        self.foot = load("two_dof").with_values({**TRUTH, **masses})
        self._stride = max(1, int(np.ceil(1 / rate_hz / self.foot.step - 1e-9)))
        self._step = 1 / rate_hz / self._stride
        self._batch = Batch(self.foot, 1, 1)
        self._qpos, self._qvel = self.foot.model.qpos0.copy(), np.zeros(self.foot.model.nv)
        self._rng, self._one_mass = rng, one_mass
        self._omega, self._phase = 2 * np.pi * 20.0, 0.0
        self._amplitude = self._target = 0.0  # [m/s^2], of the first harmonic
        self.advance(4)  # compiles

    def drive(self, order: dict[str, Any]) -> None:
        """The generator's output changed."""
        if "volts" in order:
            self._omega = 2 * np.pi * float(order["frequency_hz"])
            self._target = 0.5 * GAIN * float(order["volts"])

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
        self._amplitude = self._target + (self._amplitude - self._target) * np.exp(-length / LAG_S)
        y = (self._one_mass * out.base if self._one_mass else out.malleolus)[0, :: self._stride]
        clean = np.column_stack([out.base[0, :: self._stride], y, y])
        return clean + self._rng.normal(size=clean.shape) * [NOISE_BASE, NOISE_MALLEOLUS, NOISE_MALLEOLUS]

    def _motion(self, length: float) -> BaseMotion:
        """Base motion from now on: the amplitude follows its set value with the amplifier's lag."""
        w, p, target, gap = self._omega, self._phase, self._target, self._amplitude - self._target
        lines = ((1, 1.0, 0.0), *DISTORTION)

        def wave(t: np.ndarray) -> np.ndarray:
            return np.asarray(sum(size * np.sin(h * (p + w * t) + late) for h, size, late in lines))

        def acceleration(t: np.ndarray) -> np.ndarray:
            return (target + gap * np.exp(-t / LAG_S)) * wave(t)

        def jerk(t: np.ndarray) -> np.ndarray:
            slope = sum(size * h * w * np.cos(h * (p + w * t) + late) for h, size, late in lines)
            fade = gap * np.exp(-t / LAG_S)
            return (target + fade) * slope - fade / LAG_S * wave(t)

        return BaseMotion("virtual shaker", length, acceleration, jerk)
