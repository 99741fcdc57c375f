"""Hammerstein-Wiener models: polynomial in, linear OE, polynomial out, by exact-gradient prediction error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from fasbody.exceptions import SettingError
from identification.blackbox import pem
from identification.blackbox.data import Series
from identification.blackbox.filters import largest_root, lfilter, pulse_response, shifted
from identification.blackbox.frequency import Response
from identification.blackbox.least_squares import Linearisation, minimise, project_states, spread
from identification.blackbox.polynomial import RADIUS, Orders, PolynomialModel


@dataclass(frozen=True, eq=False)
class HammersteinWiener:
    """y = g(w), w = B/F h(u), h(u) = u + sum a_k s_u (u/s_u)^k, g(w) = w + c_0 s_w + sum c_k s_w (w/s_w)^k, k >= 2.

    The linear terms of h and g are one, so the gain is the linear block's alone and the model is unique up to what the
    input leaves open. At small amplitude it is the linear block.

    Attributes:
        linear: the block B/F; its spread is that of the joint estimate.
        input_terms: a_2, a_3, ..., shape (p - 1,).
        output_terms: c_0, c_2, c_3, ..., shape (q,).
        input_scale: s_u, root mean square of the estimation input.
        output_scale: s_w, root mean square of the estimation output.
        loss: mean squared simulation error.
        samples: residuals behind `loss`.
        warnings: sentences for the user.
    """

    linear: PolynomialModel
    input_terms: np.ndarray
    output_terms: np.ndarray
    input_scale: float
    output_scale: float
    loss: float
    samples: int
    warnings: tuple[str, ...] = field(default=())
    structure: str = "hw"

    @property
    def parameters(self) -> int:
        """Number of estimated coefficients."""
        return self.linear.parameters + len(self.input_terms) + len(self.output_terms)

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees p and q of the polynomials at the input and the output."""
        return len(self.input_terms) + 1, max(len(self.output_terms), 1)

    @property
    def label(self) -> str:
        """Structure, linear orders and degrees."""
        nb, nf, nk = self.linear.orders.as_tuple("oe")
        return f"HW ({nb}, {nf}, {nk}; {self.degrees[0]}, {self.degrees[1]})"

    def poles(self) -> np.ndarray:
        """Poles of the linear block, shape (n,)."""
        return self.linear.poles()

    def zeros(self) -> np.ndarray:
        """Zeros of the linear block, shape (n,)."""
        return self.linear.zeros()

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Response of the linear block: the limit for small amplitudes."""
        return self.linear.response(frequency_hz)

    @property
    def _theta(self) -> np.ndarray:
        return np.concatenate([self.linear.theta, self.input_terms, self.output_terms])

    def _problem(self, series: Series) -> "_Problem":
        return _Problem([series], self.linear.orders, *self.degrees, self.input_scale, self.output_scale)

    def simulate(self, u: Series | ArrayLike, x0: ArrayLike = 0.0) -> np.ndarray:
        """Free simulation, shape (N,); of a recording with the initial state of the linear block that fits best.

        Args:
            u: input (N,), or a recording.
            x0: state of the linear block before an input alone, in observer form, shape (n,).
        """
        if not isinstance(u, Series):
            values = np.asarray(u, dtype=float)
            still = Series(values, values, self.linear.sample_time, part=True)
            return self._problem(still).run(self._theta, still.u, lambda bent: self.linear.simulate(bent, x0))
        errors = self._problem(u).at(self._theta).errors[0]
        simulated = u.y.copy()
        simulated[len(u) - len(errors) :] -= errors
        return simulated

    def extend(self, series: Series, u: np.ndarray) -> np.ndarray:
        """Output (M,) after the end of a recording for the input `u` (M,) there."""
        num, den = self.linear.plant
        first = self.linear.orders.first_row
        state = self._problem(series).state(series, self._theta)

        def linear(bent: np.ndarray) -> np.ndarray:
            pulses = np.zeros(len(bent))
            pulses[first : first + len(state)] = state
            return lfilter(num, den, bent) + lfilter([1.0], den, pulses)

        return self._problem(series).run(self._theta, np.concatenate([series.u, u]), linear)[len(series) :]

    def residuals(self, series: Series) -> np.ndarray:
        """Simulation errors (N,), which are the prediction errors of a model without noise dynamics."""
        return (series.y - self.simulate(series))[self.linear.orders.first_row :]

    def __str__(self) -> str:
        return f"{self.label}, loss {self.loss:.5g}, input {self.input_terms}, output {self.output_terms}"


class _Problem:
    """Errors and exact derivatives; the initial state of 1/F is refitted by Gauss-Newton at every parameter vector."""

    def __init__(
        self, recordings: Sequence[Series], orders: Orders, p: int, q: int, input_scale: float, output_scale: float
    ) -> None:
        self.recordings, self.orders = recordings, orders
        self.p, self.q = p, q
        self.input_scale, self.output_scale = input_scale, output_scale

    def admissible(self, theta: np.ndarray) -> bool:
        _, f, _, _ = self._split(theta)
        return bool(np.isfinite(theta).all()) and largest_root(f) < RADIUS

    def _split(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        o = self.orders
        b, f, a, c = np.split(theta, np.cumsum([o.nb, o.nf, self.p - 1]))
        return np.concatenate([np.zeros(o.nk), b]), np.concatenate([[1.0], f]), a, c

    def at(self, theta: np.ndarray, *, gradient: bool = False) -> Linearisation:
        return Linearisation.of((self._one(series, theta, gradient) for series in self.recordings), gradient)

    def _one(self, series: Series, theta: np.ndarray, gradient: bool) -> tuple[np.ndarray, np.ndarray]:
        o = self.orders
        b, f, a, c = self._split(theta)
        first, length = o.first_row, len(series)
        terms = self._terms(series.u)
        bent = series.u + terms @ a
        pulses = self._pulses(f, length)
        w = lfilter(b, f, bent) + pulses @ self.state(series, theta)
        errors = (series.y - self._output(w, c))[first:]
        if not gradient:
            return errors, np.empty((0, 0))
        slope = self._slope(w, c)
        _, remove = project_states(errors, (pulses * slope[:, None])[first:])
        through_f = lfilter([1.0], f, np.column_stack([bent, w]), axis=0)
        dw = np.hstack([
            shifted(through_f[:, 0], o.nb, o.nk), -shifted(through_f[:, 1], o.nf, 1), lfilter(b, f, terms, axis=0),
        ])  # fmt: skip
        powers = self._powers(w)
        return errors, remove(-np.hstack([dw * slope[:, None], powers])[first:])

    def _terms(self, u: np.ndarray) -> np.ndarray:
        return self.input_scale * (u / self.input_scale)[:, None] ** np.arange(2, self.p + 1)

    def _pulses(self, f: np.ndarray, length: int) -> np.ndarray:
        first, count = self.orders.first_row, self.orders.nf
        pulses = np.zeros((length, count), order="F")
        pulses[first:] = shifted(pulse_response(f, length - first), count)
        return pulses

    def state(self, series: Series, theta: np.ndarray) -> np.ndarray:
        """Initial state (n_f,) of the linear block that fits a recording best."""
        b, f, a, c = self._split(theta)
        first = self.orders.first_row
        forced, pulses = lfilter(b, f, series.u + self._terms(series.u) @ a), self._pulses(f, len(series))
        state = np.zeros(self.orders.nf)
        for _ in range(3):  # mildly nonlinear: three steps reach rounding for a foot's amplitudes
            w = forced + pulses @ state
            slope = self._slope(w, c)
            step, _ = project_states((series.y - self._output(w, c))[first:], (pulses * slope[:, None])[first:])
            state = state + step
        return state

    def run(self, theta: np.ndarray, u: np.ndarray, linear: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Output (N,) to the input (N,) through a `linear` block with a separate state."""
        _, _, a, c = self._split(theta)
        return self._output(linear(u + self._terms(u) @ a), c)

    def _powers(self, w: np.ndarray) -> np.ndarray:
        exponents = np.array([0, *range(2, self.q + 1)])[: self.q if self.q > 1 else 1]
        return self.output_scale * (w / self.output_scale)[:, None] ** exponents

    def _output(self, w: np.ndarray, c: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):
            return w + self._powers(w) @ c

    def _slope(self, w: np.ndarray, c: np.ndarray) -> np.ndarray:
        slope = np.ones(len(w))
        for k, coefficient in enumerate(c[1:], start=2):
            slope = slope + coefficient * k * (w / self.output_scale) ** (k - 1)
        return slope


def levels(u: np.ndarray) -> float:
    """Number of distinct values of an input (N,), noise on them apart; infinite when it is not a few levels.

    Powers from this number on are combinations of the lower ones.
    """
    ordered = np.sort(u)
    gaps = np.diff(ordered)
    reach = max(float(ordered[-1] - ordered[0]), 1e-300)
    jumps = gaps > 0.02 * reach
    between = float(gaps[jumps].sum())
    return int(jumps.sum()) + 1 if between > 0.8 * reach else np.inf


def estimate(
    recordings: Series | Sequence[Series], orders: Orders, degrees: tuple[int, int] = (3, 3),
    linear: PolynomialModel | None = None,
) -> HammersteinWiener:  # fmt: skip
    """Hammerstein-Wiener model by prediction error, started from the linear output-error model.

    Args:
        recordings: one or many, pooled with an initial state each; means removed.
        orders: n_b, n_f, n_k of the linear block.
        degrees: of the polynomials at input and output; (1, q) is a Wiener, (p, 1) a Hammerstein model.
        linear: a linear output-error model of the same orders to start from.

    Raises:
        SettingError: a degree below one, or more parameters than samples.
    """
    p, q = degrees
    if p < 1 or q < 1:
        raise SettingError(f"degrees {degrees} make no model; a polynomial has degree 1 or more.")
    pooled = [recordings] if isinstance(recordings, Series) else list(recordings)
    start = linear or pem.estimate("oe", pooled, orders)
    u_scale = float(np.sqrt(np.mean(np.concatenate([s.u for s in pooled]) ** 2)))
    y_scale = float(np.sqrt(np.mean(np.concatenate([s.y for s in pooled]) ** 2)))
    problem = _Problem(pooled, orders, p, q, u_scale, y_scale)
    theta, at, converged = minimise(problem, np.concatenate([start.theta, np.zeros(p - 1 + q)]), evaluations=100)
    root = spread(at, coloured=True)
    count = orders.nb + orders.nf
    block = PolynomialModel(
        "oe", orders, theta[:count], root[:count], at.loss, at.samples, pooled[0].sample_time
    )
    warnings: tuple[str, ...] = () if converged else ("the iterations ended before the loss stopped falling",)
    count_of = min(levels(series.u) for series in pooled)
    if p >= count_of:
        warnings += (f"an input of {count_of:g} levels cannot identify an input polynomial of degree {p}",)
    terms, out = np.split(theta[count:], [p - 1])
    return HammersteinWiener(block, terms, out, u_scale, y_scale, at.loss, at.samples, warnings)
