"""Polynomial NARX models: terms and coefficients chosen by the error of free simulation."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import ArrayLike

from identification.blackbox import excitation
from identification.blackbox.candidate import Candidate, judge
from identification.blackbox.data import Series, listed
from identification.blackbox.frequency import Response
from identification.blackbox.least_squares import Linearisation, minimise, spread, triangle

LARGEST_TERMS = 20
FIRST = 4  # terms chosen by one-step errors, from which simulation goes on
PATIENCE = 4  # more terms without a better simulation after which none is added
LOOKED_AT = 20_000  # samples over which the next term is chosen
LIMIT = 50.0  # times the output's scale: a simulation beyond this has diverged


@dataclass(frozen=True, eq=False)
class Narx:
    """y(t) = sum of theta_j times products of lagged y and u, both scaled to unit root mean square.

    Attributes:
        terms: tuples of variable numbers: k < lags is y(t - (k + 1) step), then u(t - n_k - (k - lags) step), of which
            there are lags + 1; the empty tuple is the constant.
        theta: coefficients, shape (terms,).
        lags: number of lags of y.
        step: samples between lags.
        nk: delay of the nearest input; 0 for the direct term u(t).
        y_scale: root mean square of the estimation output.
        u_scale: root mean square of the estimation input.
        loss: mean squared simulation error on the estimation data [output unit squared].
        samples: residuals behind `loss`.
        spread: square root of the covariance of `theta`, shape (terms, m).
        sample_time: seconds.
        warnings: sentences for the user.
    """

    terms: tuple[tuple[int, ...], ...]
    theta: np.ndarray
    lags: int
    step: int
    nk: int
    y_scale: float
    u_scale: float
    loss: float
    samples: int
    spread: np.ndarray
    sample_time: float
    warnings: tuple[str, ...] = field(default=())
    structure: str = "narx"

    @property
    def parameters(self) -> int:
        """Number of terms."""
        return len(self.theta)

    @property
    def std_error(self) -> np.ndarray:
        """Standard errors of `theta`, shape (terms,)."""
        return np.linalg.norm(self.spread, axis=1)

    @property
    def label(self) -> str:
        """Structure, lags of y, delay, step between lags and number of terms."""
        return f"NARX ({self.lags}, {self.nk}; {self.step}; {len(self.terms)} terms)"

    @property
    def first(self) -> int:
        """Samples of the measured output that a simulation begins with."""
        return self.lags * self.step + self.nk

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

    def simulate(self, u: Series | ArrayLike, x0: ArrayLike = 0.0) -> np.ndarray:
        """Free simulation, shape (N,); of a recording from its first outputs; infinite once it diverges.

        Args:
            u: input (N,), or a recording.
            x0: outputs at the first samples of an input alone, shape (first,).
        """
        if isinstance(u, Series):
            return self._run(u.u, u.y)
        values = np.asarray(u, dtype=float)
        begin = np.zeros(len(values))
        begin[: self.first] = np.broadcast_to(np.asarray(x0, dtype=float), self.first)[: len(values)]
        return self._run(values, begin)

    def extend(self, series: Series, u: np.ndarray) -> np.ndarray:
        """Output (M,) after the end of a recording for the input `u` (M,) there."""
        begin = np.concatenate([series.y[len(series) - self.first :], np.zeros(len(u))])
        return self._run(np.concatenate([series.u[len(series) - self.first :], u]), begin)[self.first :]

    def _run(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Outputs (N,) from inputs (N,), beginning with the first outputs of `y` (N,)."""
        from identification.blackbox import narx_recursion  # numba, which takes a moment to load

        out = y / self.y_scale
        place = (self.lags, self.step, self.nk, self.first, LIMIT)
        table = _table(self.terms, self.lags)
        no_columns = np.zeros((len(y), 0))
        out[narx_recursion.simulate(out, u / self.u_scale, table, self.theta, *place, no_columns) :] = np.inf
        return out * self.y_scale

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors, shape (N - first,)."""
        variables, y = _variables(series, self.lags, self.step, self.nk, self.y_scale, self.u_scale)
        return (y - _products(variables, self.terms).T @ self.theta) * self.y_scale

    def __str__(self) -> str:
        rows = zip(self.theta, self.std_error, self.names, strict=True)
        return "\n".join([self.label, *(f"  {c: .5g} +- {e:.2g} {name}" for c, e, name in rows)])

    @property
    def names(self) -> list[str]:
        """Each term as text."""
        return [" ".join(self._name(k) for k in term) or "1" for term in self.terms]

    def _name(self, k: int) -> str:
        if k < self.lags:
            return f"y(t-{(k + 1) * self.step})"
        lag = self.nk + (k - self.lags) * self.step
        return f"u(t-{lag})" if lag else "u(t)"


def _products(variables: np.ndarray, terms: Sequence[tuple[int, ...]]) -> np.ndarray:
    """Each term's product over the rows of `variables`, shape (terms, M)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.array([variables[list(term)].prod(axis=0) for term in terms])


def _variables(
    series: Series, lags: int, step: int, nk: int, y_scale: float, u_scale: float
) -> tuple[np.ndarray, np.ndarray]:
    first, length = lags * step + nk, len(series)
    y, u = series.y / y_scale, series.u / u_scale
    past = [y[first - k * step : length - k * step] for k in range(1, lags + 1)]
    past += [u[first - nk - k * step : length - nk - k * step] for k in range(lags + 1)]
    return np.array(past), y[first:]


def _table(terms: Sequence[tuple[int, ...]], lags: int) -> np.ndarray:
    """Variable numbers of each term in equal rows, shape (terms, degree); the number after the last stands for 1."""
    degree = max([1, *map(len, terms)])
    return np.array([[*term, *[2 * lags + 1] * (degree - len(term))] for term in terms], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Simulation:
    """Simulation errors of given terms and their exact derivatives."""

    recordings: Sequence[Series]
    model: Narx

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(np.isfinite(theta).all())

    def at(self, theta: np.ndarray, *, gradient: bool = False) -> Linearisation:
        return Linearisation.of((self._one(series, theta, gradient) for series in self.recordings), gradient)

    def _one(self, series: Series, theta: np.ndarray, gradient: bool) -> tuple[np.ndarray, np.ndarray]:
        from identification.blackbox import narx_recursion

        m = self.model
        y, u = series.y / m.y_scale, series.u / m.u_scale
        out, table = y.copy(), _table(m.terms, m.lags)
        columns = np.zeros((len(y), len(theta) if gradient else 0))
        reached = narx_recursion.simulate(out, u, table, theta, m.lags, m.step, m.nk, m.first, LIMIT, columns)
        if reached < len(y):
            return np.full(len(y) - m.first, np.inf), columns[m.first :]
        return (y - out)[m.first :] * m.y_scale, -columns[m.first :] * m.y_scale


def refine(model: Narx, recordings: Sequence[Series]) -> Narx:
    """The same terms with coefficients at the least simulation error near those given."""
    problem = _Simulation(recordings, model)
    if not np.isfinite(problem.at(model.theta).loss):
        return replace(model, loss=np.inf, warnings=("free simulation diverges on the estimation data",))
    theta, at, converged = minimise(problem, model.theta, evaluations=30, tolerance=1e-2)
    warnings = () if converged else ("the iterations ended before the loss had converged",)
    root = spread(at, coloured=True)
    return replace(model, theta=theta, loss=at.loss, samples=at.samples, spread=root, warnings=warnings)


def estimate(
    recordings: Series | Sequence[Series], validation: Sequence[Series], lags: int = 3, degree: int = 3,
    step: int | None = None, nk: int = 1,
) -> Candidate:  # fmt: skip
    """NARX model with the number of terms that simulates the validation data best.

    The first few terms explain most of the output one step ahead (forward orthogonal least squares). After that each
    new term is the one that lowers the simulation error most, to first order, and all coefficients are refined on the
    simulation error before the next one enters.

    Args:
        recordings: one or many, means removed.
        validation: data kept for the choice of the number of terms.
        lags: lags of y; u has one more, from the delay on.
        degree: largest degree of a product.
        step: samples between lags; default: the better of 1 and about 25 lags in a period of the strongest input line.
        nk: delay of the nearest input; 0 for the direct term.
    """
    pooled = listed(recordings)
    if step is None:
        lines = [excitation.fundamental(s.u - s.u.mean(), s.sample_time) for s in pooled]
        step = max(round(1.0 / (25 * max(lines) * pooled[0].sample_time)), 1)
        step = max(min(step, min(len(series) for series in pooled) // (4 * lags)), 1)
        tried = [estimate(pooled, validation, lags, degree, one, nk) for one in sorted({1, step})]
        return max(tried, key=lambda candidate: candidate.fit_percent)
    y_scale, u_scale = (
        float(np.sqrt(np.mean(np.concatenate(signals) ** 2)))
        for signals in ([s.y for s in pooled], [s.u for s in pooled])
    )
    terms = [term for d in range(degree + 1) for term in combinations_with_replacement(range(2 * lags + 1), d)]
    pairs = [_variables(series, lags, step, nk, y_scale, u_scale) for series in pooled]
    stacked = [np.column_stack([_products(variables, terms).T, y]) for variables, y in pairs]
    r = triangle(stacked)
    taken = _forward(r[:, :-1], r[:, -1])
    empty = np.full((1, 1), np.nan)
    blank = Narx((), np.zeros(0), lags, step, nk, y_scale, u_scale, np.inf, 1, empty, pooled[0].sample_time)
    best: Candidate | None = None
    model, since = blank, 0
    while len(model.terms) < LARGEST_TERMS and since < PATIENCE:
        count = len(model.terms)
        if count < FIRST or not np.isfinite(model.loss):
            if count >= len(taken):
                break
            chosen = taken[: max(count + 1, min(FIRST, len(taken)))]
            theta = np.linalg.lstsq(r[:, chosen], r[:, -1], rcond=None)[0]
            model = refine(replace(model, terms=tuple(terms[k] for k in chosen), theta=theta), pooled)
        else:
            more = _next_term(model, terms, pooled)
            model = refine(replace(model, terms=(*model.terms, more), theta=np.append(model.theta, 0.0)), pooled)
        trial = judge(model, validation)
        if best is None or trial.fit_percent > best.fit_percent:
            since = 0 if best is None or best.missed - trial.missed > 0.005 * best.missed else since + 1
            best = trial
        else:
            since += 1
    assert best is not None
    return best


def _next_term(model: Narx, terms: Sequence[tuple[int, ...]], recordings: Sequence[Series]) -> tuple[int, ...]:
    """The term whose coefficient, beside the others, lowers the simulation error most to first order."""
    waiting = [term for term in terms if term not in model.terms]
    longest = [series.cut(0, min(len(series), LOOKED_AT)) for series in recordings]
    larger = replace(model, terms=(*model.terms, *waiting))
    at = _Simulation(longest, larger).at(np.append(model.theta, np.zeros(len(waiting))), gradient=True)
    errors, columns = np.concatenate(at.errors), np.vstack(at.gradient)
    columns = np.where(np.isfinite(columns), columns, 0.0)
    q = np.linalg.qr(columns[:, : len(model.terms)])[0]
    size = np.sum(columns[:, len(model.terms) :] ** 2, axis=0)
    fresh = columns[:, len(model.terms) :] - q @ (q.T @ columns[:, len(model.terms) :])
    power = np.sum(fresh**2, axis=0)
    gain = np.where(power > 1e-8 * size, (fresh.T @ errors) ** 2 / np.maximum(power, 1e-300), -1.0)
    return waiting[int(np.argmax(gain))]


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
