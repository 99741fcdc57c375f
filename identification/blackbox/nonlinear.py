"""Hammerstein-Wiener models: polynomial in, linear OE, polynomial out, by prediction error."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from fasbody.exceptions import SettingError
from identification.blackbox import pem
from identification.blackbox.data import Series, listed
from identification.blackbox.filters import largest_root, lfilter, pulse_response, shifted
from identification.blackbox.frequency import Response
from identification.blackbox.least_squares import Linearisation, minimise, project_states, spread
from identification.blackbox.polynomial import RADIUS, Orders, PolynomialModel


@dataclass(frozen=True, eq=False)
class HammersteinWiener:
    """Polynomial h at the input, a linear block, polynomial g at the output.

    y = g(w), w = B/F h(u), h(u) = u + sum a_k s_u (u/s_u)^k,
    g(w) = w + c_0 s_w + sum c_k s_w (w/s_w)^k, k >= 2.

    The linear terms of h and g are one, so the gain is the linear block's alone and the model is
    unique up to what the input leaves open. At small amplitude it is the linear block.

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
    def _errors(self) -> "Errors":
        return Errors(self.linear.orders, self.degrees, self.input_scale, self.output_scale)

    @property
    def _theta(self) -> np.ndarray:
        return np.concatenate([self.linear.theta, self.input_terms, self.output_terms])

    def simulate(self, u: Series | ArrayLike, x0: ArrayLike = 0.0) -> np.ndarray:
        """Free simulation, shape (N,); of a recording with the initial state that fits best.

        Args:
            u: input (N,), or a recording.
            x0: state of the linear block before an input alone, in observer form, shape (n,).
        """
        if isinstance(u, Series):
            simulated = u.y.copy()
            first = self.linear.orders.first_row
            simulated[first:] -= self._errors.of(u, self._theta, False)[0]
            return simulated
        bent = self._errors.bent(np.asarray(u, dtype=float), self.input_terms)
        return self._errors.output(self.linear.simulate(bent, x0), self.output_terms)

    def extend(self, series: Series, u: np.ndarray) -> np.ndarray:
        """Output (M,) after the end of a recording for the input `u` (M,) there."""
        num, den = self.linear.plant
        state, first = self._errors.state(series, self._theta), self.linear.orders.first_row
        bent = self._errors.bent(np.concatenate([series.u, u]), self.input_terms)
        pulses = np.zeros(len(bent))
        pulses[first : first + len(state)] = state
        w = lfilter(num, den, bent) + lfilter([1.0], den, pulses)
        return self._errors.output(w, self.output_terms)[len(series) :]

    def residuals(self, series: Series) -> np.ndarray:
        """Simulation errors (N,): the prediction errors of a model without noise dynamics."""
        return self._errors.of(series, self._theta, False)[0]

    def __str__(self) -> str:
        terms = f"input {self.input_terms}, output {self.output_terms}"
        return f"{self.label}, loss {self.loss:.5g}, {terms}"


@dataclass(frozen=True, eq=False)
class Errors:
    """Simulation errors and their derivatives; the initial state of 1/F is fitted at every theta.

    Attributes:
        orders: of the linear block.
        degrees: of the polynomials at input and output.
        input_scale: s_u.
        output_scale: s_w.
        recordings: estimation data.
    """

    orders: Orders
    degrees: tuple[int, int]
    input_scale: float
    output_scale: float
    recordings: Sequence[Series] = ()

    def admissible(self, theta: np.ndarray) -> bool:
        """Whether the roots of F lie well inside the unit circle."""
        _, f, _, _ = self.parts(theta)
        return bool(np.isfinite(theta).all()) and largest_root(f) < RADIUS

    def parts(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """B with its delay, F, and the terms at input and output of theta (d,)."""
        o = self.orders
        b, f, a, c = np.split(theta, np.cumsum([o.nb, o.nf, self.degrees[0] - 1]))
        return np.concatenate([np.zeros(o.nk), b]), np.concatenate([[1.0], f]), a, c

    def at(self, theta: np.ndarray, *, gradient: bool = False) -> Linearisation:
        """Errors at theta (d,), and their derivatives on request."""
        return Linearisation.of((self.of(s, theta, gradient) for s in self.recordings), gradient)

    def of(self, series: Series, theta: np.ndarray, gradient: bool) -> tuple[np.ndarray, np.ndarray]:
        """Errors (N - first,) of one recording, and their derivatives (N - first, d)."""
        o = self.orders
        b, f, a, c = self.parts(theta)
        bent, pulses = self.bent(series.u, a), self._pulses(f, len(series))
        w = lfilter(b, f, bent) + pulses @ self.state(series, theta)
        errors = (series.y - self.output(w, c))[o.first_row :]
        if not gradient:
            return errors, np.empty((0, 0))
        slope = self._slope(w, c)[:, None]
        _, remove = project_states(errors, (pulses * slope)[o.first_row :])
        through_f = lfilter([1.0], f, np.column_stack([bent, w]), axis=0)
        exponents = np.arange(2, self.degrees[0] + 1)
        terms = self.input_scale * (series.u / self.input_scale)[:, None] ** exponents
        dw = np.hstack([
            shifted(through_f[:, 0], o.nb, o.nk), -shifted(through_f[:, 1], o.nf, 1),
            lfilter(b, f, terms, axis=0),
        ])  # fmt: skip
        exponents = np.array([0, *range(2, self.degrees[1] + 1)])
        powers = self.output_scale * (w / self.output_scale)[:, None] ** exponents
        return errors, remove(-np.hstack([dw * slope, powers])[o.first_row :])

    def bent(self, u: np.ndarray, a: np.ndarray) -> np.ndarray:
        """h(u), shape (N,)."""
        return self.input_scale * polynomial.polyval(u / self.input_scale, [0.0, 1.0, *a])

    def output(self, w: np.ndarray, c: np.ndarray) -> np.ndarray:
        """g(w), shape (N,)."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self.output_scale * polynomial.polyval(w / self.output_scale, [c[0], 1.0, *c[1:]])

    def _slope(self, w: np.ndarray, c: np.ndarray) -> np.ndarray:
        return polynomial.polyval(w / self.output_scale, polynomial.polyder([c[0], 1.0, *c[1:]]))

    def _pulses(self, f: np.ndarray, length: int) -> np.ndarray:
        """Answers of 1/F to the initial state, one column each, from the first row on."""
        first, count = self.orders.first_row, self.orders.nf
        pulses = np.zeros((length, count), order="F")
        pulses[first:] = shifted(pulse_response(f, length - first), count)
        return pulses

    def state(self, series: Series, theta: np.ndarray) -> np.ndarray:
        """Initial state (n_f,) of the linear block that fits a recording best."""
        b, f, a, c = self.parts(theta)
        first = self.orders.first_row
        forced, pulses = lfilter(b, f, self.bent(series.u, a)), self._pulses(f, len(series))
        state = np.zeros(self.orders.nf)
        for _ in range(3):  # mildly nonlinear: three steps reach rounding for a foot's amplitudes
            w = forced + pulses @ state
            free = (pulses * self._slope(w, c)[:, None])[first:]
            state = state + project_states((series.y - self.output(w, c))[first:], free)[0]
        return state


def levels(u: np.ndarray) -> float:
    """Number of distinct values of an input (N,), noise apart; infinite when not a few levels.

    Powers from this number on are combinations of the lower ones.
    """
    gaps, reach = np.diff(np.sort(u)), max(float(np.ptp(u)), 1e-300)
    jumps = gaps > 0.02 * reach
    return int(jumps.sum()) + 1 if gaps[jumps].sum() > 0.8 * reach else np.inf


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
    if min(degrees) < 1:
        raise SettingError(f"degrees {degrees} make no model; a polynomial has degree 1 or more.")
    pooled = listed(recordings)
    start = linear or pem.estimate("oe", pooled, orders)
    u_scale, y_scale = (
        float(np.sqrt(np.mean(np.concatenate(signals) ** 2)))
        for signals in ([s.u for s in pooled], [s.y for s in pooled])
    )
    terms = np.zeros(degrees[0] - 1 + degrees[1])
    theta, at, converged = minimise(
        Errors(orders, degrees, u_scale, y_scale, pooled), np.concatenate([start.theta, terms]),
        evaluations=100,
    )  # fmt: skip
    block, bends, out = np.split(theta, np.cumsum([orders.nb + orders.nf, degrees[0] - 1]))
    root, seconds = spread(at, coloured=True)[: len(block)], pooled[0].sample_time
    warnings = [] if converged else ["the iterations ended before the loss had converged"]
    count = min(levels(series.u) for series in pooled)
    if degrees[0] >= count:
        warnings.append(f"an input of {count:g} levels cannot identify an input polynomial of degree {degrees[0]}")
    linear = PolynomialModel("oe", orders, block, root, at.loss, at.samples, seconds)
    return HammersteinWiener(linear, bends, out, u_scale, y_scale, at.loss, at.samples, tuple(warnings))
