"""One synthetic recording of a virtual subject: base, malleolus and tuberosity as strapped sensors see them.

Sines are computed by harmonic balance of the two-mass model, the tuberosity and the strapped sensors as linear
filters of their harmonics; other excitations as trajectories.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from fasbody.exceptions import SimulationError
from fasbody.foot import shaker
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import TwoDof
from fasbody.foot.two_mass import parameters, resolved
from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.subject import Tuberosity
from fasbody.recording.recording import Recording

_HARMONICS = 20


def steady(
    foot: TwoDof,
    tuberosity: Tuberosity,
    frequency_hz: float,
    seconds: float,
    instrument: Instrument,
    rng: np.random.Generator,
    peak_to_peak: float = shaker.PEAK_TO_PEAK,
) -> tuple[Recording, dict[str, complex]]:
    """A recording of the steady state under a sine, and its true MB and TB (bone over base, fundamental).

    Raises:
        SimulationError: the foot has no periodic motion.
    """
    U = instrument.amplitudes(rng, peak_to_peak)
    orbits = resolved(parameters(vars(foot))[None], np.array([2 * np.pi * frequency_hz]), np.array([U]))
    if not orbits.converged.all():
        raise SimulationError(f"the virtual foot has no periodic motion at {frequency_hz:g} Hz.")
    malleolus = orbits.shank[0, :_HARMONICS]
    f = frequency_hz * np.arange(1, malleolus.size + 1)
    shank = malleolus * tuberosity.response(f)
    seen = instrument.strap(f) * np.exp(-2j * np.pi * f * instrument.delay_s)
    t = np.arange(round(seconds * instrument.rate_hz)) / instrument.rate_hz
    at = np.exp(2j * np.pi * frequency_hz * (t + rng.uniform(0, 1)))
    recording = _recording(t, [_sum(at, U), _sum(at, malleolus * seen), _sum(at, shank * seen)], instrument, rng)
    return recording, {"MB": complex(malleolus[0] / U[0]), "TB": complex(shank[0] / U[0])}


def moving(
    foot: TwoDof,
    tuberosity: Tuberosity,
    motion: shaker.BaseMotion,
    seconds: float,
    instrument: Instrument,
    rng: np.random.Generator,
    settle: float = 1.0,
) -> Recording:
    """A recording under any base motion, which must last `seconds` + `settle` + 0.1 s."""
    t = np.arange(round(seconds * instrument.rate_hz)) / instrument.rate_hz
    step = 1 / (8 * instrument.rate_hz)
    count = int(np.ceil((seconds + settle + 0.05) / step))
    u = motion.half_steps(step, count)
    Y, *_ = trajectory(np.zeros(4), foot.theta, foot.m_S, foot.m_F, u, step, 1, 0)
    if not np.isfinite(Y).all():
        raise SimulationError("the virtual foot does not stay finite under this base motion.")
    fine = step * np.arange(count)
    f = np.fft.rfftfreq(2 * count, step)  # padded to twice, so that the filters' tails do not wrap around
    spectrum = np.fft.rfft(Y, 2 * count)
    channels = []
    for response in (np.ones_like(f), tuberosity.response(f)):
        seen = np.fft.irfft(spectrum * response * instrument.strap(f), 2 * count)[:count]
        channels.append(CubicSpline(fine, seen)(t + settle - instrument.delay_s))
    return _recording(t, [motion.acceleration(t + settle), *channels], instrument, rng)


def _sum(at: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Sum over h of Re(A_h at^h): the harmonics by Horner's rule."""
    total = np.zeros_like(at)
    for A in amplitudes[::-1]:
        total = (total + A) * at
    return total.real


def _recording(
    t: np.ndarray, channels: Sequence[np.ndarray], instrument: Instrument, rng: np.random.Generator
) -> Recording:
    noises = (instrument.noise_base, instrument.noise_malleolus, instrument.noise_malleolus)
    gains = (1.0, *mounted(instrument, rng))
    base, malleolus, tuberosity = (
        instrument.measure(gain * values + instrument.offset_m_s2, noise, rng)
        for gain, values, noise in zip(gains, channels, noises, strict=True)
    )
    return Recording(t, base, malleolus, tuberosity, origin="synthetic")


def mounted(instrument: Instrument, rng: np.random.Generator) -> np.ndarray:
    """(2,) gains of the malleolus' and the tuberosity's sensor as they happen to be strapped on."""
    return 1 + instrument.gain_scatter * rng.normal(size=2)
