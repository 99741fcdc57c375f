"""Laws of the heel pad: force over compression and its rate, in closed form.

The three of the thesis (Eqs. (4.22) to (4.24), functions of strain) and four beside them (power,
exponential, Hunt-Crossley, Ogden). Forces are compressive [N], compressions x [m] and rates v [m/s]
positive while the heel is pressed. The strain is x/h with a nominal thickness h, which was not
measured on these people; only products with h are identifiable. Where a law gives tension (the
damper exceeds the spring) the force is zero, as a heel does not stick to a plate.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from fasbody.exceptions import SettingError, unknown
from fasbody.foot import damper

Array = np.ndarray
#: Thickness of an unloaded heel pad [m]: nominal, as ultrasound finds it in adults.
THICKNESS_M = 0.018
#: Relaxation times of Eq. (4.22) [s], held: a strike of 40 ms at 3 kHz does not identify others.
TAU_S = (1e-3, 1.0)
_BRANCH_S = np.array([damper.branch_time(i, *TAU_S) for i in range(damper.BRANCHES)])
_BRANCH_WEIGHTS = np.array([damper.branch_weight(i, *TAU_S) for i in range(damper.BRANCHES)])
#: Compression at which the power laws' force is quoted [m]: force and exponent are then nearly
#: uncorrelated.
REFERENCE_M = 5e-3


@dataclass(frozen=True)
class Parameter:
    """A parameter of a law, which is positive.

    Attributes:
        name: symbol.
        unit: empty where it has none.
        start: of the search.
        lower: end of the search.
        upper: the other end.
    """

    name: str
    unit: str
    start: float
    lower: float
    upper: float


@dataclass(frozen=True)
class HeelLaw:
    """A law of the heel pad.

    Example:
        >>> LAWS["power"].static_force(np.array([5e-3]), np.array([60.0, 2.5]))

    Attributes:
        key: short name.
        name: in words.
        equation: of the thesis, "" if it has none.
        formula: as one writes it.
        parameters: what is estimated.
        force: of time [s], compression [m], rate [m/s] (n,) and parameters (p,), [N].
    """

    key: str
    name: str
    equation: str
    formula: str
    parameters: tuple[Parameter, ...]
    force: Callable[[Array, Array, Array, Array], Array]

    @property
    def bounds(self) -> Array:
        """Of the parameters' logarithms (2, p)."""
        return np.log([[item.lower, item.upper] for item in self.parameters]).T

    @property
    def start(self) -> Array:
        """Of the search: the parameters' logarithms (p,)."""
        return np.log([item.start for item in self.parameters])

    def static_force(self, compression_m: Array, theta: Array) -> Array:
        """Force (n,) [N] of a pad held at each compression (n,) [m]: fully relaxed."""
        x = np.atleast_1d(np.asarray(compression_m, float))
        if self.key == "qlv":
            relaxed = 1.0 + theta[2] * np.log(TAU_S[1] / TAU_S[0])
            return damper.elastic(x / THICKNESS_M, theta[0], theta[1]) / relaxed
        return self.force(np.arange(x.size, dtype=float), x, np.zeros_like(x), theta)


def _quasilinear(t: Array, x: Array, v: Array, theta: Array) -> Array:
    A, B, c = theta
    sigma = damper.elastic(np.maximum(x, 0.0) / THICKNESS_M, A, B)
    return np.maximum(_relaxed(np.asarray(t, float), sigma, c, _BRANCH_S, _BRANCH_WEIGHTS), 0.0)


@njit(cache=True)
def _relaxed(t: Array, sigma: Array, c: float, taus: Array, weights: Array) -> Array:
    """Eq. (4.22): the convolution of each exponential, exact for a stress linear between samples.

    A clock that does not rise begins another strike, so that many can stand in one array (n,).
    """
    total = sigma.copy()
    for i in range(taus.size):
        tau, weight, h = taus[i], weights[i], 0.0
        for k in range(1, t.size):
            if t[k] <= t[k - 1]:  # another strike begins
                h = 0.0
                continue
            decay = np.exp(-(t[k] - t[k - 1]) / tau)
            rate = (sigma[k] - sigma[k - 1]) / (t[k] - t[k - 1])
            h = h * decay + rate * tau * (1.0 - decay)
            total[k] += c * weight * h
    return total / (1.0 + c * np.log(TAU_S[1] / TAU_S[0]))


def _nonlinear(t: Array, x: Array, v: Array, theta: Array) -> Array:
    e = np.maximum(x, 1e-9) / THICKNESS_M
    force = damper.power_law(e, v / THICKNESS_M, *theta)  # Eq. (4.23), exponents corrected
    return np.maximum(force, 0.0)


def _strain_damper(t: Array, x: Array, v: Array, theta: Array) -> Array:
    e = np.maximum(x, 0.0) / THICKNESS_M
    return np.maximum(damper.strain_damper(e, v / THICKNESS_M, *theta), 0.0)  # Eq. (4.24)


def _power(t: Array, x: Array, v: Array, theta: Array) -> Array:
    F_5, n = theta
    return F_5 * (np.maximum(x, 0.0) / REFERENCE_M) ** n


def _exponential(t: Array, x: Array, v: Array, theta: Array) -> Array:
    A, b = theta
    return A * np.expm1(b * np.maximum(x, 0.0))


def _hunt_crossley(t: Array, x: Array, v: Array, theta: Array) -> Array:
    return np.maximum(_power(t, x, v, theta[:2]) * (1.0 + theta[2] * v), 0.0)


def _ogden(t: Array, x: Array, v: Array, theta: Array) -> Array:
    P, alpha = theta
    stretch = np.maximum(1.0 - np.maximum(x, 0.0) / THICKNESS_M, 0.01)
    return 2.0 * P / alpha * (stretch ** (-0.5 * alpha - 1.0) - stretch ** (alpha - 1.0))


_F5, _EXPONENT = Parameter("F_5", "N", 60.0, 1e-2, 5e3), Parameter("n", "", 2.5, 0.5, 12.0)
_A = Parameter("A", "N", 20.0, 1e-3, 5e3)
_QUASILINEAR = _A, Parameter("B", "", 6.0, 0.1, 40.0), Parameter("c", "", 0.1, 1e-4, 20.0)
_NONLINEAR = (
    Parameter("j", "N", 1500.0, 1e-1, 1e7),
    Parameter("k", "", 2.5, 0.5, 12.0),
    Parameter("l", "N s^n", 50.0, 1e-4, 1e6),
    Parameter("m", "", 2.5, 0.1, 12.0),
    Parameter("n", "", 1.0, 0.1, 3.0),
)
_STRAIN = Parameter("E", "N", 600.0, 1e-2, 1e5), Parameter("eta", "N s", 5.0, 1e-4, 1e4)
_OGDEN = Parameter("P", "N", 30.0, 1e-2, 1e4), Parameter("alpha", "", 4.0, 0.1, 40.0)

LAWS: dict[str, HeelLaw] = {law.key: law for law in (
    HeelLaw("qlv", "quasi-linear viscoelastic pad", "4.22", "G(t) * A (exp(B x/h) - 1)",
            _QUASILINEAR, _quasilinear),
    HeelLaw("nonlinear", "nonlinear spring and damper", "4.23",
            "j (x/h)^k + l (x/h)^m |v/h|^n sign(v)", _NONLINEAR, _nonlinear),
    HeelLaw("strain_damper", "linear spring, strain-proportional damper", "4.24",
            "E x/h + eta (x/h) v/h", _STRAIN, _strain_damper),
    HeelLaw("power", "power law", "", "F_5 (x/5 mm)^n", (_F5, _EXPONENT), _power),
    HeelLaw("exponential", "exponential", "", "A (exp(b x) - 1)",
            (_A, Parameter("b", "1/m", 350.0, 5.0, 3e3)), _exponential),
    HeelLaw("hunt_crossley", "Hunt-Crossley", "", "F_5 (x/5 mm)^n (1 + c v)",
            (_F5, _EXPONENT, Parameter("c", "s/m", 0.5, 1e-4, 20.0)), _hunt_crossley),
    HeelLaw("ogden", "Ogden, one term, incompressible", "",
            "2 P/alpha (s^(-alpha/2 - 1) - s^(alpha - 1)), s = 1 - x/h", _OGDEN, _ogden),
)}  # fmt: skip


def law(key: str) -> HeelLaw:
    """The law of a key.

    Raises:
        SettingError: there is none; the message lists those that exist.
    """
    if key not in LAWS:
        raise SettingError(f"{unknown('law of the heel', key, LAWS)}.", "law")
    return LAWS[key]
