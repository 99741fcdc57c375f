"""Polynomial NARX models: terms chosen by forward orthogonal least squares, judged in free simulation."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import ArrayLike

from identification.blackbox import excitation
from identification.blackbox.data import Series
from identification.blackbox.frequency import Response
from identification.blackbox.selection import Candidate, judge

LARGEST_TERMS = 14
LIMIT = 50.0  # times the output's scale: a simulation beyond this has diverged


@dataclass(frozen=True, eq=False)
class Narx:
    """y(t) = sum of theta_j times products of lagged y and u, both scaled to unit root mean square.

    Attributes:
        terms: tuples of variable numbers: k < n_lags is y(t - (k + 1) step), then u(t - (k - n_lags + 1) step);
            the empty tuple is the constant.
        theta: coefficients, shape (terms,).
        lags: number of lags of y and of u.
        step: samples between lags.
        y_scale: root mean square of the estimation output.
        u_scale: root mean square of the estimation input.
        loss: mean squared one-step prediction error.
        samples: residuals behind `loss`.
        warnings: sentences for the user.
    """

    terms: tuple[tuple[int, ...], ...]
    theta: np.ndarray
    lags: int
    step: int
    y_scale: float
    u_scale: float
    loss: float
    samples: int
    warnings: tuple[str, ...] = field(default=())
    structure: str = "narx"

    @property
    def parameters(self) -> int:
        """Number of terms."""
        return len(self.theta)

    @property
    def label(self) -> str:
        """Structure, lags, their step and number of terms."""
        return f"NARX ({self.lags}, {self.lags}; {self.step}; {len(self.terms)} terms)"

    def poles(self) -> np.ndarray:
        """None, shape (0,): a nonlinear recursion has no poles."""
        return np.zeros(0)

    def zeros(self) -> np.ndarray:
        """None, shape (0,)."""
        return np.zeros(0)

    def response(self, frequency_hz: ArrayLike) -> Response:
        """NaN: a nonlinear recursion has no frequency response."""
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        empty = np.full((len(frequency), 2, 1), np.nan)
        return Response(frequency, np.full(len(frequency), np.nan + 0j), empty)

    def simulate(self, series: Series) -> np.ndarray:
        """Free simulation from the measured first `lags * step` outputs, shape (N,); infinite once it diverges.

        Samples whose indices agree modulo `step` recur on their own; each pass advances all of them by one.
        """
        step, lags = self.step, self.lags
        passes = -(-len(series) // step)
        y, u = np.zeros((passes, step)), np.zeros((passes, step))
        y.flat[: len(series)], u.flat[: len(series)] = series.y / self.y_scale, series.u / self.u_scale
        for row in range(lags, passes):
            variables = np.concatenate([y[row - lags : row][::-1], u[row - lags : row][::-1]])
            y[row] = _products(variables, self.terms).T @ self.theta
            if not np.abs(y[row]).max() < LIMIT:
                y[row:] = np.inf
                break
        return y.ravel()[: len(series)] * self.y_scale

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors, shape (N - first,)."""
        variables, y = _variables(series, self.lags, self.step, self.y_scale, self.u_scale)
        return (y - _products(variables, self.terms).T @ self.theta) * self.y_scale

    def __str__(self) -> str:
        names = [_name(term, self.lags, self.step) for term in self.terms]
        return "\n".join([self.label, *(f"  {c: .5g} {name}" for c, name in zip(self.theta, names, strict=True))])


def _name(term: tuple[int, ...], lags: int, step: int) -> str:
    factors = [f"y(t-{(k + 1) * step})" if k < lags else f"u(t-{(k - lags + 1) * step})" for k in term]
    return " ".join(factors) or "1"


def _products(variables: np.ndarray, terms: Sequence[tuple[int, ...]]) -> np.ndarray:
    """Each term's product over the rows of `variables`, shape (terms, M)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.array([variables[list(term)].prod(axis=0) for term in terms])


def _variables(series: Series, lags: int, step: int, y_scale: float, u_scale: float) -> tuple[np.ndarray, np.ndarray]:
    first, length = lags * step, len(series)
    y, u = series.y / y_scale, series.u / u_scale
    past = [signal[first - k * step : length - k * step] for signal in (y, u) for k in range(1, lags + 1)]
    return np.array(past), y[first:]


def estimate(
    recordings: Series | Sequence[Series], validation: Sequence[Series], lags: int = 3, degree: int = 3,
    step: int | None = None,
) -> Candidate:  # fmt: skip
    """NARX model with the number of terms that simulates the held-out data best.

    Terms enter one at a time, each time the one that explains most of the output's remaining variance after
    orthogonalisation to those already in.

    Args:
        recordings: one or many, means removed.
        validation: held-out parts, on which the number of terms is decided.
        lags: lags of y and of u.
        degree: largest degree of a product.
        step: samples between lags; default: about 25 lags in a period of the strongest input line.
    """
    pooled = [recordings] if isinstance(recordings, Series) else list(recordings)
    if step is None:
        lines = [excitation.fundamental(s.u - s.u.mean(), s.sample_time) for s in pooled]
        step = max(round(1.0 / (25 * max(lines) * pooled[0].sample_time)), 1)
        step = min(step, min(len(series) for series in pooled) // (4 * lags))
    y_scale = float(np.sqrt(np.mean(np.concatenate([s.y for s in pooled]) ** 2)))
    u_scale = float(np.sqrt(np.mean(np.concatenate([s.u for s in pooled]) ** 2)))
    terms: list[tuple[int, ...]] = [
        term for d in range(degree + 1) for term in combinations_with_replacement(range(2 * lags), d)
    ]
    pairs = [_variables(series, lags, step, y_scale, u_scale) for series in pooled]
    phi = np.vstack([_products(variables, terms).T for variables, _ in pairs])
    y = np.concatenate([out for _, out in pairs])
    best: Candidate | None = None
    chosen: list[int] = []
    for column in _forward(phi, y):
        chosen.append(column)
        theta = np.linalg.lstsq(phi[:, chosen], y, rcond=None)[0]
        loss = float(np.mean((y - phi[:, chosen] @ theta) ** 2)) * y_scale**2
        model = Narx(tuple(terms[k] for k in chosen), theta, lags, step, y_scale, u_scale, loss, len(y))
        trial = judge(model, validation)
        if best is None or trial.fit_percent > best.fit_percent:
            best = trial
    assert best is not None
    return best


def _forward(phi: np.ndarray, y: np.ndarray) -> list[int]:
    """Column numbers in the order in which forward orthogonal least squares takes them."""
    left, rest = phi.copy(), y.copy()
    begin = np.sum(phi**2, axis=0)
    taken: list[int] = []
    for _ in range(min(LARGEST_TERMS, phi.shape[1])):
        power = np.sum(left**2, axis=0)
        usable = power > 1e-10 * begin
        usable[taken] = False
        if not usable.any():
            break
        gain = np.where(usable, (left.T @ rest) ** 2 / np.where(usable, power, 1.0), -1.0)
        best = int(np.argmax(gain))
        direction = left[:, best] / np.sqrt(power[best])
        taken.append(best)
        rest = rest - direction * (direction @ rest)
        left = left - np.outer(direction, direction @ left)
    return taken
