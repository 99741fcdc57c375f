"""A two-mass foot on a shaker as test data: the linear one sampled exactly, the nonlinear one by Runge-Kutta steps.

The base acceleration is held between samples, so the linear foot is an exact output-error system of order four.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter, max_len_seq, ss2tf

from fasbody.foot import shaker
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.condition import foot_mass, shank_mass

BODY_MASS = 70.7  # kg, mean of Table 2.1
FOOT = TwoDof(
    k_T=1.31e5, k_F=9.4e4, c_11=165.0, c_12=90.0, c_13=140.0, c_21=310.0, c_22=-120.0, c_23=180.0,
    m_S=shank_mass(BODY_MASS), m_F=foot_mass(BODY_MASS),
)  # fmt: skip
SAMPLE_TIME = 1e-3  # s
AMPLITUDE = 8.95  # m/s^2, half the thesis' 17.9 peak to peak


def transfer() -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator in rising powers of q^-1 under a held input; the numerator begins with its delay."""
    A, B, C = FOOT.state_space()
    block = np.zeros((5, 5))
    block[:4, :4], block[:4, 4] = A, B
    held = expm(block * SAMPLE_TIME)
    num, den = ss2tf(held[:4, :4], held[:4, 4:], C[None], np.zeros((1, 1)))
    return num[0], den


def response(frequency_hz: np.ndarray) -> np.ndarray:
    """Exact frequency response of the sampled linear foot."""
    num, den = transfer()
    shift = np.exp(-2j * np.pi * np.asarray(frequency_hz) * SAMPLE_TIME)
    return np.polynomial.polynomial.polyval(shift, num) / np.polynomial.polynomial.polyval(shift, den)


def linear_output(base: np.ndarray) -> np.ndarray:
    """Malleolus acceleration from rest, free of noise."""
    num, den = transfer()
    return lfilter(num, den, base)


def nonlinear_output(frequency_hz: float, samples: int, added_mass: float = 0.0) -> np.ndarray:
    """Malleolus acceleration on a sine with the damping laws of Eq. (4.32), two Runge-Kutta steps a sample."""
    motion = shaker.sine(frequency_hz, samples * SAMPLE_TIME, 2 * AMPLITUDE)
    step = SAMPLE_TIME / 2
    u = motion.half_steps(step, 2 * samples)
    return trajectory(np.zeros(4), FOOT.theta, FOOT.m_S + added_mass, FOOT.m_F, u, step, 2, 0)[0]


def sine(frequency_hz: float, samples: int) -> np.ndarray:
    """Base acceleration of one sine."""
    return AMPLITUDE * np.sin(2 * np.pi * frequency_hz * SAMPLE_TIME * np.arange(samples))


def prbs(samples: int, hold: int = 6) -> np.ndarray:
    """Pseudo-random binary base acceleration, each value held for `hold` samples."""
    return AMPLITUDE * np.repeat(2.0 * max_len_seq(13)[0] - 1.0, hold)[:samples]


def multisine(samples: int, spacing_hz: float = 2.5, lines: int = 32) -> np.ndarray:
    """Schroeder multisine with the same root mean square as the binary signal."""
    k, t = np.arange(1, lines + 1), np.arange(samples) * SAMPLE_TIME
    phase = -np.pi * k * (k - 1) / lines
    total = np.cos(2 * np.pi * spacing_hz * np.outer(k, t) + phase[:, None]).sum(axis=0)
    return AMPLITUDE * total / total.std()
