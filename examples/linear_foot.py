"""A two-mass foot on a shaker as test data: the linear one sampled exactly, the nonlinear one by Runge-Kutta steps.

The base acceleration is held between samples, so the linear foot is an exact output-error system of order four.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter, max_len_seq, ss2tf

BODY_MASS = 70.7  # kg, mean of Table 2.1
M_S, M_F = 0.0465 * BODY_MASS, 0.0145 * BODY_MASS  # kg
K_T, K_F, C_T, C_F = 1.31e5, 9.4e4, 165.0, 310.0  # N/m, N/m, N s/m, N s/m
SAMPLE_TIME = 1e-3  # s
AMPLITUDE = 8.95  # m/s^2, half the thesis' 17.9 peak to peak


def matrices(added_mass: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C of Eq. (4.30) and of the malleolus acceleration, Eq. (4.31)."""
    m_S = M_S + added_mass
    both = (m_S + M_F) / (m_S * M_F)
    A = np.array([
        [0, 0, 1, 0], [0, 0, 0, 1],
        [-both * K_T, K_F / M_F, -both * C_T, C_F / M_F], [K_T / M_F, -K_F / M_F, C_T / M_F, -C_F / M_F],
    ])  # fmt: skip
    return A, np.array([0.0, 0.0, 0.0, -1.0]), -np.array([K_T, 0.0, C_T, 0.0]) / m_S


def transfer() -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator in rising powers of q^-1 under a held input; the numerator begins with its delay."""
    A, B, C = matrices()
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
    m_S = M_S + added_mass
    w, h = 2 * np.pi * frequency_hz, SAMPLE_TIME / 2

    def slope(x: np.ndarray, t: float) -> tuple[np.ndarray, float]:
        c_T = 165.0 * np.exp(-90.0 * x[0]) * np.cos(140.0 * x[0])
        c_F = 310.0 * np.exp(120.0 * x[1]) * np.cos(180.0 * x[1])
        ankle, pad = c_T * x[2] + K_T * x[0], c_F * x[3] + K_F * x[1]
        base = AMPLITUDE * np.sin(w * t)
        return np.array([x[2], x[3], (pad - ankle) / M_F - ankle / m_S, (ankle - pad) / M_F - base]), -ankle / m_S

    x, out = np.zeros(4), np.zeros(samples)
    for k in range(2 * samples):
        t = k * h
        k1, acceleration = slope(x, t)
        if k % 2 == 0:
            out[k // 2] = acceleration
        k2 = slope(x + h / 2 * k1, t + h / 2)[0]
        k3 = slope(x + h / 2 * k2, t + h / 2)[0]
        k4 = slope(x + h * k3, t + h)[0]
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return out


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
