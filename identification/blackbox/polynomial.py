"""The general linear polynomial model A y = B/F u + C/D e: response, poles, simulation, prediction, conversions."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from fasbody.exceptions import SettingError, required, unknown
from fasbody.presentation import Tabled
from identification.blackbox.data import Series
from identification.blackbox.filters import free_run, largest_root, lfilter, pulse_response, shifted
from identification.blackbox.frequency import Response
from identification.blackbox.least_squares import Linearisation, project_states

#: Orders of each structure in the sequence of Table 3.2.
STRUCTURES = {
    "arx": ("na", "nb", "nk"),
    "armax": ("na", "nb", "nc", "nk"),
    "bj": ("nb", "nc", "nd", "nf", "nk"),
    "oe": ("nb", "nf", "nk"),
}

RADIUS = 0.99995  # of the roots of C, D, F: beyond it a free motion outlasts any recording


@dataclass(frozen=True)
class Orders(Tabled):
    """Numbers of coefficients of A, B, C, D, F and the delay n_k in samples, Eq. (3.4).

    B holds n_b coefficients, the first at lag n_k: sum of b_k u(t - n_k - k + 1), k = 1..n_b (one convention for the
    two that the thesis prints).
    """

    na: int = 0
    nb: int = 1
    nc: int = 0
    nd: int = 0
    nf: int = 0
    nk: int = 1

    def __post_init__(self) -> None:
        """Refuse invalid counts."""
        if self.nb < 1 or min(self.na, self.nc, self.nd, self.nf, self.nk) < 0:
            raise SettingError(f"orders {self} make no model; n_b is at least 1 and no other is negative.")

    @classmethod
    def of(cls, structure: str, numbers: tuple[int, ...]) -> Self:
        """Orders from the numbers in the sequence of Table 3.2, e.g. `of("oe", (4, 4, 1))`."""
        if structure not in STRUCTURES:
            raise SettingError(unknown("structure", structure, STRUCTURES) + ".")
        names = STRUCTURES[structure]
        if len(names) != len(numbers):
            raise SettingError(f"{structure} takes {len(names)} orders ({', '.join(names)}), not {len(numbers)}.")
        if any(number < (name == "nb") for name, number in zip(names, numbers, strict=True)):
            valid = ", ".join(f"{name} {int(name == 'nb')} or more" for name in names)
            raise SettingError(f"{structure}={','.join(map(str, numbers))} makes no model; valid: {valid}.")
        return cls(**{"nb": 1, **dict(zip(names, numbers, strict=True))})

    def as_tuple(self, structure: str) -> tuple[int, ...]:
        """The numbers in the sequence of Table 3.2."""
        return tuple(getattr(self, name) for name in STRUCTURES[structure])

    @property
    def parameters(self) -> int:
        """Number of estimated coefficients d."""
        return self.na + self.nb + self.nc + self.nd + self.nf

    def within(self, larger: "Orders") -> bool:
        """Whether models of the `larger` orders hold all of these."""
        counts = all(getattr(self, name) <= getattr(larger, name) for name in ("na", "nc", "nd", "nf"))
        return counts and larger.nk <= self.nk and self.nk + self.nb <= larger.nk + larger.nb

    @property
    def first_row(self) -> int:
        """First sample whose regressors are all measured."""
        return max(self.na, self.nk + self.nb - 1)


def unpack(theta: np.ndarray, orders: Orders) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Polynomials A, B, C, D, F of Eq. (3.4) from the coefficient vector (d,)."""
    counts = (orders.na, orders.nb, orders.nc, orders.nd, orders.nf)
    a, b, c, d, f = np.split(theta, np.cumsum(counts)[:-1])
    monic = [np.concatenate([[1.0], p]) for p in (a, c, d, f)]
    return monic[0], np.concatenate([np.zeros(orders.nk), b]), monic[1], monic[2], monic[3]


def pack(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray, f: np.ndarray) -> np.ndarray:
    """The coefficient vector (d,) of the polynomials; `b` without its leading zeros, the others monic."""
    return np.concatenate([a[1:], b, c[1:], d[1:], f[1:]])


class Residuals:
    """One-step prediction errors y(t) - y(t | t-1), Eq. (3.12), of A y = B/F u + C/D e and their exact derivatives.

    The general structure Eq. (3.3) covers ARX, ARMAX, OE and BJ alike.

    Filters start from rest at the first sample. Everything before the first row with complete regressors is thus
    wrong, and wrong only by free motions of 1/F and 1/C; these and the sensor's level are fitted as nuisance columns,
    separately for each recording, and projected out (so no recorded past is needed, and recordings pool).

    Args:
        recordings: estimation data, means removed.
        orders: of the model.
        first_row: first sample whose residual counts, at least the first with complete regressors.
    """

    def __init__(self, recordings: Sequence[Series], orders: Orders, first_row: int = 0) -> None:
        self.recordings = recordings
        self.orders = orders
        self.first_row = max(first_row, orders.first_row)

    def admissible(self, theta: np.ndarray) -> bool:
        """Whether C, D, F of theta (d,) have all roots well inside the unit circle: stable predictor and noise."""
        _, _, c, d, f = unpack(theta, self.orders)
        return bool(np.isfinite(theta).all()) and max(map(largest_root, (c, d, f))) < RADIUS

    def at(self, theta: np.ndarray, *, gradient: bool = False) -> Linearisation:
        """Errors at theta (d,) with fitted initial states, and their derivatives on request."""
        return Linearisation.of((self._one(series, theta, gradient) for series in self.recordings), gradient)

    def _one(self, series: Series, theta: np.ndarray, gradient: bool) -> tuple[np.ndarray, np.ndarray]:
        o = self.orders
        a, b, c, d, f = unpack(theta, o)
        first, length = self.first_row, len(series)
        w = lfilter(b, f, series.u)  # undisturbed output, Eq. (3.7)
        v = lfilter(a, [1.0], series.y) - w
        errors = lfilter(d, c, v)  # Eq. (3.14): y - (L1 y + L2 u), L1 = 1 - A D/C, L2 = B D/(C F)

        noise_states = max(o.nc, o.nd)
        tail = length - first
        free = np.empty((tail, o.nf + noise_states + 1), order="F")
        free[:, : o.nf] = shifted(lfilter(d, c, pulse_response(f, tail)), o.nf)
        free[:, o.nf : -1] = shifted(pulse_response(c, tail), noise_states)
        free[:, -1] = lfilter(d, c, np.ones(tail))
        state, remove = project_states(-errors[first:], free)
        fitted = errors[first:] + free @ state
        if not gradient:
            return fitted, np.empty((0, 0))

        # The signals behind the fitted errors: the pulses enter w through 1/F, the level enters v.
        pulses = np.zeros(length)
        pulses[first : first + o.nf] = -state[: o.nf]
        w = w + lfilter([1.0], f, pulses)
        v = lfilter(a, [1.0], series.y) - w + state[-1]
        errors = np.concatenate([np.zeros(first), fitted])
        columns = np.empty((length, o.parameters), order="F")
        df = lfilter(d, c, lfilter([1.0], f, np.column_stack([series.u, w]), axis=0), axis=0)
        ends = np.cumsum((o.na, o.nb, o.nc, o.nd, o.nf))
        columns[:, : ends[0]] = shifted(lfilter(d, c, series.y), o.na, 1)
        columns[:, ends[0] : ends[1]] = -shifted(df[:, 0], o.nb, o.nk)
        columns[:, ends[1] : ends[2]] = -shifted(lfilter([1.0], c, errors), o.nc, 1)
        columns[:, ends[2] : ends[3]] = shifted(lfilter([1.0], c, v), o.nd, 1)
        columns[:, ends[3] :] = shifted(df[:, 1], o.nf, 1)
        return fitted, remove(columns[first:])


@dataclass(frozen=True, eq=False)
class PolynomialModel(Tabled):
    """An estimated polynomial model with its uncertainty.

    Attributes:
        structure: arx, armax, oe, bj, or ss for the polynomial form of a state-space model.
        orders: numbers of coefficients.
        theta: coefficients a, b, c, d, f in this sequence, shape (d,).
        spread: square root S of the covariance S S' of `theta`, shape (d, m).
        loss: mean squared one-step prediction error on the estimation data [output unit squared].
        samples: number of residuals behind `loss`.
        sample_time: seconds.
        warnings: sentences for the user.
    """

    structure: str
    orders: Orders
    theta: np.ndarray
    spread: np.ndarray
    loss: float
    samples: int
    sample_time: float
    warnings: tuple[str, ...] = field(default=())

    @property
    def polynomials(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, B, C, D, F as coefficients (n,) of rising powers of q^-1; B begins with its n_k zeros."""
        return unpack(self.theta, self.orders)

    @property
    def parameters(self) -> int:
        """Number of estimated coefficients."""
        return len(self.theta)

    def without_intervals(self) -> Self:
        """The same model with NaN for every standard error, for when the assumptions behind them fail."""
        return replace(self, spread=np.full_like(self.spread, np.nan))

    @property
    def std_error(self) -> np.ndarray:
        """Standard errors of `theta`, shape (d,)."""
        return np.linalg.norm(self.spread, axis=1)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of `theta`, shape (d, d)."""
        return self.spread @ self.spread.T

    @property
    def noise_variance(self) -> float:
        """Unbiased estimate of the variance of e(t)."""
        return self.loss * self.samples / max(self.samples - self.parameters, 1)

    @property
    def plant(self) -> tuple[np.ndarray, np.ndarray]:
        """Numerator and denominator (n,) of G in rising powers of q^-1, Eq. (3.1)."""
        a, b, _, _, f = self.polynomials
        return b, np.convolve(a, f)

    @property
    def noise(self) -> tuple[np.ndarray, np.ndarray]:
        """Numerator and denominator (n,) of H in rising powers of q^-1, Eq. (3.2)."""
        a, _, c, d, _ = self.polynomials
        return c, np.convolve(a, d)

    def poles(self) -> np.ndarray:
        """Poles of G in the z plane, shape (n,)."""
        return np.roots(self.plant[1])

    def zeros(self) -> np.ndarray:
        """Zeros of G in the z plane, shape (n,), without the delay's."""
        return np.roots(np.trim_zeros(self.plant[0], "f"))

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Frequency response of G with first-order error propagation from the parameters' covariance."""
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        o = self.orders
        a, b, _, _, f = self.polynomials
        shift = np.exp(-2j * np.pi * frequency * self.sample_time)  # q^-1
        A, B, F = (np.polynomial.polynomial.polyval(shift, p) for p in (a, b, f))
        G = B / (A * F)
        lag = lambda n, first: shift[:, None] ** (first + np.arange(n))  # noqa: E731
        gradient = np.zeros((len(frequency), self.parameters), dtype=complex)
        gradient[:, : o.na] = -(G / A)[:, None] * lag(o.na, 1)
        gradient[:, o.na : o.na + o.nb] = lag(o.nb, o.nk) / (A * F)[:, None]
        gradient[:, self.parameters - o.nf :] = -(G / F)[:, None] * lag(o.nf, 1)
        parts = np.stack([gradient.real, gradient.imag], axis=1)
        return Response(frequency, G, parts @ self.spread)

    def simulate(self, u: Series | ArrayLike, x0: ArrayLike = 0.0) -> np.ndarray:
        """Free simulation from the input alone, shape (N,).

        Args:
            u: input (N,), or a recording, whose initial state and level are then fitted.
            x0: state before an input alone, in observer form, shape (n,); 0 is rest.
        """
        num, den = self.plant
        if isinstance(u, Series):
            return free_run(num, den, u.u, u.y)
        values = np.asarray(u, dtype=float)
        start = np.broadcast_to(np.asarray(x0, dtype=float), max(len(num), len(den)) - 1)
        return signal.lfilter(num, den, values, zi=start)[0] if len(start) else lfilter(num, den, values)

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors from the first sample with complete regressors on, shape (N - first,)."""
        return Residuals([series], self.orders).at(self.theta).errors[0]

    def predict(self, series: Series) -> np.ndarray:
        """One-step prediction (N,) of the output, Eq. (3.13); measured values where the past is not complete yet."""
        errors = self.residuals(series)
        prediction = series.y.copy()
        prediction[len(series) - len(errors) :] -= errors
        return prediction

    def to_transfer_function(self) -> Any:
        """G as `scipy.signal.TransferFunction` with its sample time."""
        num, den = _same_length(*self.plant)
        lead = int(np.argmax(np.abs(num) > 1e-14 * np.abs(num).max(initial=0.0))) if num.any() else 0
        return signal.TransferFunction(num[lead:], den, dt=self.sample_time)

    def to_state_space(self) -> Any:
        """G as `scipy.signal.StateSpace`."""
        return self.to_transfer_function().to_ss()

    def to_control(self, part: str = "plant") -> Any:
        """G ("plant") or H ("noise") as a python-control `TransferFunction`.

        Raises:
            SettingError: python-control is not installed, or another part.
        """
        num, den = _same_length(*model_part(part, self.plant, self.noise))
        return control_package().TransferFunction(num, den, self.sample_time)

    @property
    def label(self) -> str:
        """Structure and orders, as `OE (4, 4, 1)`."""
        return f"{self.structure.upper()} {self.orders.as_tuple(self.structure)}"

    @property
    def names(self) -> list[str]:
        """Names of `theta`: a letter and the lag."""
        return [
            f"{letter}{k}" for letter, first in zip("abcdf", (1, self.orders.nk, 1, 1, 1), strict=True)
            for k in range(first, first + getattr(self.orders, f"n{letter}"))
        ]  # fmt: skip

    def __str__(self) -> str:
        rows = [f"  {n:>4} {v: .6g} +- {s:.2g}" for n, v, s in zip(self.names, self.theta, self.std_error, strict=True)]
        head = f"{self.label}, loss {self.loss:.5g}, {self.samples} samples of {self.sample_time:g} s"
        return "\n".join([head, *rows, *(f"  warning: {text}" for text in self.warnings)])


def _same_length(num: np.ndarray, den: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both padded to one length, so that powers of q^-1 read as powers of z."""
    length = max(len(num), len(den))
    return np.pad(num, (0, length - len(num))), np.pad(den, (0, length - len(den)))


def model_part(part: str, plant: Any, noise: Any) -> Any:
    """The plant or the noise model, by its name.

    Raises:
        SettingError: there is no such part.
    """
    parts = {"plant": plant, "noise": noise}
    if part not in parts:
        raise SettingError(unknown("part", part, parts) + ".")
    return parts[part]


def control_package() -> Any:
    """The package python-control.

    Raises:
        MissingPackageError: it is not installed.
    """
    with required("python-control", "control"):
        import control
    return control
