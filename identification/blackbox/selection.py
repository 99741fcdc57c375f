"""Choice of orders: criteria over the thesis' ranges, ranked by free simulation of data not used for estimation."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fasbody.exceptions import FasError, SettingError
from identification.blackbox import criteria, pem, subspace
from identification.blackbox.data import Series
from identification.blackbox.filters import outlasting
from identification.blackbox.frequency import Response
from identification.blackbox.polynomial import Orders, PolynomialModel

ALIKE = 10.0  # difference of N times AIC below which data hardly tell models apart
POLYNOMIAL_STATES = 5  # n_f, n_c, n_d up to here, as in the thesis
NEGLIGIBLE = 2e-3  # of the output's amplitude left unexplained justifies no further parameter
BLOCKS = 20  # of the held-out data, over which two models' squared errors are compared
NEAR = range(1, 6)  # n_k always compared
CERTAIN = 4.0  # standard errors that the coefficient of direct feedthrough must stand out by
BACK = (0, 1, 2, 4, 8, 16, 32)  # samples before the peak of the pulse response at which it may begin
DECISIVE = 10.0  # N times the difference of log losses that a late response must win by
LONGEST = 1000  # samples searched for the peak


class Model(Protocol):
    """What every estimated model offers."""

    @property
    def structure(self) -> str:
        """Arx, armax, oe, bj, ss, hw or npem."""

    @property
    def label(self) -> str:
        """Structure and orders."""

    @property
    def parameters(self) -> int:
        """Number of estimated coefficients."""

    @property
    def loss(self) -> float:
        """Mean squared residual on the estimation data."""

    @property
    def samples(self) -> int:
        """Number of residuals behind it."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences for the user."""

    def poles(self) -> np.ndarray:
        """Poles of the plant in the z plane, shape (n,)."""

    def zeros(self) -> np.ndarray:
        """Its zeros, shape (n,)."""

    def response(self, frequency_hz: ArrayLike) -> Response:
        """Frequency response at (M,) frequencies [Hz]."""

    def simulate(self, series: Series) -> np.ndarray:
        """Output (N,) in free simulation."""

    def residuals(self, series: Series) -> np.ndarray:
        """One-step prediction errors, shape (N - first,)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model with its criteria, and its fit on held-out data in free simulation.

    Attributes:
        model: the estimate.
        fit_percent: over all held-out parts together.
        block_errors: mean squared simulation error in each block of the held-out data, shape (BLOCKS,).
    """

    model: Model
    fit_percent: float
    block_errors: np.ndarray

    def no_worse_than(self, other: "Candidate") -> bool:
        """Whether held-out data do not show `other` to be better by two standard errors and more than negligibly."""
        more = self.block_errors - other.block_errors
        if not np.isfinite(more).all():
            return False
        undecided = float(more.mean()) <= 2.0 * float(more.std(ddof=1)) / np.sqrt(len(more))
        return undecided or self.missed**2 - other.missed**2 <= NEGLIGIBLE**2

    @property
    def missed(self) -> float:
        """Share of the output's amplitude that the simulation misses."""
        return 1.0 - self.fit_percent / 100.0

    @property
    def aic(self) -> float:
        """Akaike's criterion for each sample."""
        return float(criteria.aic(self.model.loss, self.model.parameters, self.model.samples))

    @property
    def bic(self) -> float:
        """Schwarz' criterion."""
        return float(criteria.bic(self.model.loss, self.model.parameters, self.model.samples))

    @property
    def fpe(self) -> float:
        """Akaike's final prediction error."""
        return criteria.fpe(self.model.loss, self.model.parameters, self.model.samples)

    def __str__(self) -> str:
        return f"{self.model.label}: fit {self.fit_percent:.2f} %, AIC {self.aic:.4f}, BIC {self.bic:.4f}"


def judge(model: Model, validation: Sequence[Series]) -> Candidate:
    """The model with its fit over all held-out parts together, in free simulation."""
    measured = np.concatenate([series.y - series.y.mean() for series in validation])
    simulated = np.concatenate([model.simulate(series) - series.y.mean() for series in validation])
    blocks = np.array([np.mean(part**2) for part in np.array_split(measured - simulated, BLOCKS)])
    return Candidate(model, criteria.fit_percent(measured, simulated), blocks)


@dataclass(frozen=True, eq=False)
class Selection:
    """The models tried for one structure, best first.

    Attributes:
        candidates: fewest parameters among those the held-out data cannot tell from the best fit, then by fit.
        tried: number of models compared, those of the ARX grid included.
        alike: labels of the models whose AIC differs by less than 10 / N from the least.
        warnings: sentences for the user.
    """

    candidates: tuple[Candidate, ...]
    tried: int
    alike: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def best(self) -> Candidate:
        """The one to report."""
        return self.candidates[0]

    def __str__(self) -> str:
        return "\n".join([f"{self.tried} models tried", *(f"  {c}" for c in self.candidates[:5]), *self.warnings])


def _largest_pole(model: Model) -> float:
    return float(np.abs(model.poles()).max(initial=0.0))


def rank(models: Iterable[Model], validation: Sequence[Series], tried: int, warnings: Sequence[str]) -> Selection:
    """Candidates in the order of `Selection`.

    Models whose free motion outlasts the record come last: with a fitted initial state they prove nothing.

    Raises:
        SettingError: no model at all.
    """
    candidates = [judge(model, validation) for model in models]
    if not candidates:
        raise SettingError("no model could be estimated; record longer or lower the orders.")
    shortest = min(len(series) for series in validation)
    driven = [c for c in candidates if not outlasting(_largest_pole(c.model), shortest)] or candidates
    candidates.sort(key=lambda c: (c not in driven, -c.fit_percent))
    near = [c for c in driven if c is candidates[0] or c.no_worse_than(candidates[0])]
    first = min(near, key=lambda c: (c.model.parameters, -c.fit_percent))
    ordered = [first, *(c for c in candidates if c is not first)]
    least = min(c.aic for c in candidates)
    alike = tuple(c.model.label for c in ordered if (c.aic - least) * c.model.samples < ALIKE)
    return Selection(tuple(ordered), tried, alike, tuple(warnings))


def select_arx(estimation: Sequence[Series], validation: Sequence[Series], largest: int = 15, nk: int = 1) -> Selection:
    """ARX over n_a, n_b, n_k = 1..largest: criteria from the grid, then held-out fit of a shortlist.

    The shortlist holds the model of least loss for each number of parameters and those alike by AIC (100 at most). A
    plant's delay `nk` beyond the grid, 0 or late, joins with the n_a and n_b of the former.
    """
    shortest = min(len(series) for series in estimation)
    largest = min(largest, max((shortest - 2) // 8, 1))
    grid = pem.grid(estimation, largest, largest, largest)
    count = grid.parameters
    loss = np.maximum(grid.loss, 1e-300)
    aic = criteria.aic(loss, count, grid.samples)
    bic = criteria.bic(loss, count, grid.samples)
    leading = {int(np.argmin(np.where(count == d, loss, np.inf))) for d in np.unique(count)}
    by_aic = np.argsort(aic, axis=None)
    alike = by_aic[(aic.ravel()[by_aic] - aic.min()) * grid.samples < ALIKE]
    shortlist = leading | {int(k) for k in alike[:100]} | {int(bic.argmin())}
    warnings = []
    for name, values in (("AIC", aic), ("BIC", bic)):
        best = np.unravel_index(int(values.argmin()), values.shape)
        at_edge = [n for n, k in zip(("n_a", "n_b", "n_k"), best, strict=True) if k == largest - 1]
        if at_edge:
            warnings.append(
                f"{name} runs to the edge of the grid ({', '.join(at_edge)} = {largest}): it fits noise with lags, so "
                "orders are ranked by held-out simulation instead"
            )
    if len(alike) > 1:
        warnings.append(f"{len(alike)} of {aic.size} ARX models lie within 10 in N x AIC: orders are not decided")
    trials = {_numbers(flat, loss.shape) for flat in shortlist}
    if not 1 <= nk <= largest:
        trials |= {(*_numbers(flat, loss.shape)[:2], nk) for flat in leading}
    wanted = [Orders.of("arx", numbers) for numbers in sorted(trials)]
    models = _possible(lambda orders: pem.estimate("arx", estimation, orders), wanted)
    selection = rank(models, validation, grid.loss.size, warnings)
    return edge(selection, {"na": largest, "nb": largest, "nk": max(largest, nk + 1)})


def select_polynomial(
    structure: str, trials: Iterable[Orders], estimation: Sequence[Series], validation: Sequence[Series]
) -> Selection:
    """Prediction-error models of all `trials`; those that cannot be estimated are left out and counted."""
    wanted = list(trials)
    models = _possible(lambda orders: pem.estimate(structure, estimation, orders), wanted)
    failed = len(wanted) - len(models)
    warnings = [f"{failed} of {len(wanted)} orders had no stable start"] if failed else []
    largest = {name: max(getattr(orders, name) for orders in wanted) for name in ("nb", "nc", "nd", "nf")}
    several = {n: size for n, size in largest.items() if len({getattr(orders, n) for orders in wanted}) > 1}
    return edge(rank(models, validation, len(wanted), warnings), several)


def _possible(estimate: Callable[[Orders], PolynomialModel], trials: Iterable[Orders]) -> list[PolynomialModel]:
    """Models of those orders that can be estimated."""
    models = []
    for orders in trials:
        try:
            models.append(estimate(orders))
        except FasError:
            continue
    return models


def edge(selection: Selection, largest: Mapping[str, int]) -> Selection:
    """The selection with a warning when an order of its best model is the largest tried."""
    orders = selection.best.model.orders  # type: ignore[attr-defined]  # polynomial models have orders
    reached = [f"n_{name[1]} = {size}" for name, size in largest.items() if getattr(orders, name) == size]
    if not reached:
        return selection
    text = f"the chosen {', '.join(reached)} is the largest tried: a larger one may fit better"
    return replace(selection, warnings=(*selection.warnings, text))


def _numbers(flat: int, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Orders n_a, n_b, n_k of a place in the ARX grid."""
    return tuple(int(k) + 1 for k in np.unravel_index(flat, shape))


def oe_trials(nk: int, nb_max: int = 15) -> list[Orders]:
    """All n_b = 1..15, n_f = 1..5 at one delay."""
    return [Orders(nb=nb, nf=nf, nk=nk) for nf in range(1, POLYNOMIAL_STATES + 1) for nb in range(1, nb_max + 1)]


def armax_trials(from_arx: Orders, from_oe: Orders) -> list[Orders]:
    """n_c = 1..5 with the orders of the ARX model, as in the thesis, and with n_a = n_f of the OE model."""
    pairs = {(from_arx.na, from_arx.nb, from_arx.nk), (from_oe.nf, from_oe.nb, from_oe.nk)}
    return [Orders(na=a, nb=b, nc=c, nk=k) for a, b, k in sorted(pairs) for c in range(1, POLYNOMIAL_STATES + 1)]


def bj_trials(from_oe: Orders) -> list[Orders]:
    """n_c = n_d = 1..5 with the plant orders of the OE model."""
    return [
        Orders(nb=from_oe.nb, nc=c, nd=c, nf=from_oe.nf, nk=from_oe.nk) for c in range(1, POLYNOMIAL_STATES + 1)
    ]  # fmt: skip


def select_state_space(
    estimation: Sequence[Series], validation: Sequence[Series], orders: Iterable[int] = range(2, 16)
) -> Selection:
    """State-space models of all orders from one factorisation; the best is refined unless that spoils its fit."""
    wanted = list(orders)
    rows = min(max(subspace.BLOCK_ROWS, max(wanted) + 1), min(len(series) for series in estimation) // 7)
    found = subspace.decompose(estimation, max(rows, 3))
    wanted = [n for n in wanted if n < found.block_rows]
    selection = rank([found.model(n) for n in wanted], validation, len(wanted), ())
    order = selection.best.model.order  # type: ignore[attr-defined]  # all are state-space models
    refined = judge(found.model(order, refine=True), validation)
    warnings = []
    if order == max(wanted):
        warnings.append(f"the chosen order {order} is the largest tried")
    standing_out = found.order()
    if standing_out != order:
        warnings.append(f"{standing_out} singular values stand out of the noise, free simulation prefers order {order}")
    candidates = selection.candidates
    if refined.no_worse_than(selection.best):
        candidates = (refined, *candidates[1:])
    return Selection(candidates, selection.tried, selection.alike, tuple(warnings))


def delay(recordings: Sequence[Series], *, far: bool = True) -> int:
    """The delay n_k of a plant: that whose output-error model of order four has the least loss.

    Compared are 1 to 5 and, with `far`, lags from the peak of the pulse response backwards, then their neighbours while
    the loss falls. Where 1 is best, it is 0 when a coefficient of direct feedthrough added to B is certain.

    Args:
        recordings: estimation data, means removed.
        far: search beyond 5; without meaning for single sines, whose pulse response is periodic.
    """
    losses: dict[int, float] = {}

    def loss(nk: int) -> float:
        if nk not in losses:
            try:
                at = pem.estimate("oe", recordings, Orders(nb=4, nf=4, nk=nk))
                losses[nk] = float(np.log(max(at.loss, 1e-300)))
            except FasError:
                losses[nk] = np.inf
        return losses[nk]

    best = min(NEAR, key=lambda nk: (round(loss(nk), 4), nk))
    samples = sum(len(series) for series in recordings)
    peak = pulse_peak(recordings) if far else 0
    late = [peak - back for back in BACK if peak - back > NEAR[-1]]
    if late:
        start = min(late, key=loss)
        while (after := min((start - 1, start, start + 1), key=loss)) != start:
            start = after
        if loss(start) < loss(best) - DECISIVE / samples:
            best = start
    if not np.isfinite(loss(best)):
        return 1
    return 0 if best == 1 and _feedthrough(recordings) else best


def _feedthrough(recordings: Sequence[Series]) -> bool:
    try:
        model = pem.estimate("oe", recordings, Orders(nb=5, nf=4, nk=0))
    except FasError:
        return False
    return bool(abs(model.theta[0]) > CERTAIN * model.std_error[0])


def pulse_peak(recordings: Sequence[Series]) -> int:
    """Lag of the largest response to a pulse, from spectra divided where the input is strong."""
    length = min(len(series) for series in recordings)
    size = 2 * max(len(series) for series in recordings)  # padded, so that no end meets the beginning
    spectra = [(np.fft.rfft(series.u, size), np.fft.rfft(series.y, size)) for series in recordings]
    power = np.sum([np.abs(u) ** 2 for u, _ in spectra], axis=0)
    cross = np.sum([y * np.conj(u) for u, y in spectra], axis=0)
    pulse = np.fft.irfft(cross / (power + 0.01 * power.max()), size)
    return int(np.argmax(np.abs(pulse[: min(LONGEST, length // 4)])))
