"""Choice of orders: criteria over the thesis' ranges, ranked by free simulation of data not used for estimation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fasbody.exceptions import FasError, SettingError

from . import arx, criteria, pem, subspace
from .data import Series
from .filters import outlasting
from .polynomial import Orders, Response

NEGLIGIBLE = 2e-3  # of the output's amplitude left unexplained justifies no further parameter
BLOCKS = 20  # of the held-out data, over which two models' squared errors are compared
ALIKE = 10.0  # difference of N times AIC below which data hardly tell models apart
POLYNOMIAL_STATES = 5  # n_f, n_c, n_d up to here, as in the thesis


class Model(Protocol):
    """What every estimated model offers."""

    @property
    def structure(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def parameters(self) -> int: ...
    @property
    def loss(self) -> float: ...
    @property
    def samples(self) -> int: ...
    @property
    def warnings(self) -> tuple[str, ...]: ...
    def poles(self) -> np.ndarray: ...
    def zeros(self) -> np.ndarray: ...
    def response(self, frequency_hz: ArrayLike) -> Response: ...
    def simulate(self, series: Series) -> np.ndarray: ...
    def residuals(self, series: Series) -> np.ndarray: ...


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

    def no_worse_than(self, other: Candidate) -> bool:
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


def judge(model: Model, validation: Sequence[Series]) -> Candidate:
    """The model with its fit over all held-out parts together, in free simulation."""
    measured = np.concatenate([series.y - series.y.mean() for series in validation])
    simulated = np.concatenate([model.simulate(series) - series.y.mean() for series in validation])
    blocks = np.array([np.mean(part**2) for part in np.array_split(measured - simulated, BLOCKS)])
    return Candidate(model, criteria.fit_percent(measured, simulated), blocks)


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
    driven = [c for c in candidates if not outlasting(np.poly(c.model.poles()), shortest)] or candidates
    candidates.sort(key=lambda c: (c not in driven, -c.fit_percent))
    near = [c for c in driven if c is candidates[0] or c.no_worse_than(candidates[0])]
    first = min(near, key=lambda c: (c.model.parameters, -c.fit_percent))
    ordered = [first, *(c for c in candidates if c is not first)]
    least = min(c.aic for c in candidates)
    alike = tuple(c.model.label for c in ordered if (c.aic - least) * c.model.samples < ALIKE)
    return Selection(tuple(ordered), tried, alike, tuple(warnings))


def select_arx(estimation: Sequence[Series], validation: Sequence[Series], largest: int = 15) -> Selection:
    """ARX over n_a, n_b, n_k = 1..largest: criteria from the grid, then held-out fit of a shortlist.

    The shortlist holds the model of least loss for each number of parameters and those alike by AIC (100 at most).
    """
    shortest = min(len(series) for series in estimation)
    largest = min(largest, max((shortest - 2) // 8, 1))
    grid = arx.grid(estimation, largest, largest, largest)
    count = grid.parameters
    loss = np.maximum(grid.loss, 1e-300)
    aic = criteria.aic(loss, count, grid.samples)
    bic = criteria.bic(loss, count, grid.samples)
    shortlist = {int(np.argmin(np.where(count == d, loss, np.inf))) for d in np.unique(count)}
    by_aic = np.argsort(aic, axis=None)
    alike = by_aic[(aic.ravel()[by_aic] - aic.min()) * grid.samples < ALIKE]
    shortlist |= {int(k) for k in alike[:100]} | {int(bic.argmin())}
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
    models = []
    for flat in sorted(shortlist):
        na, nb, nk = (int(k) + 1 for k in np.unravel_index(flat, loss.shape))
        models.append(arx.estimate(estimation, Orders(na=na, nb=nb, nk=nk)))
    return rank(models, validation, grid.loss.size, warnings)


def select_polynomial(
    structure: str, trials: Iterable[Orders], estimation: Sequence[Series], validation: Sequence[Series]
) -> Selection:
    """Prediction-error models of all `trials`; those that cannot be estimated are left out and counted."""
    models, failed, tried = [], 0, 0
    for orders in trials:
        tried += 1
        try:
            models.append(pem.estimate(structure, estimation, orders))
        except FasError:
            failed += 1
    warnings = [f"{failed} of {tried} orders had no stable start"] if failed else []
    return rank(models, validation, tried, warnings)


def delay(estimation: Sequence[Series], others: Sequence[int] = ()) -> int:
    """Delay n_k whose output-error model of order 4 has the least loss, from 1..5 and `others`."""
    losses = {}
    for nk in sorted({1, 2, 3, 4, 5, *others}):
        try:
            losses[nk] = pem.estimate("oe", estimation, Orders(nb=4, nf=4, nk=nk)).loss
        except FasError:
            continue
    return min(losses, key=lambda nk: (round(np.log(losses[nk]), 4), nk)) if losses else 1


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
    """State-space models of all orders from one factorisation; the best is refined when that helps its fit."""
    wanted = list(orders)
    rows = min(max(subspace.BLOCK_ROWS, max(wanted) + 1), min(len(series) for series in estimation) // 7)
    found = subspace.decompose(estimation, max(rows, 3))
    wanted = [n for n in wanted if n < found.block_rows]
    selection = rank([found.model(n) for n in wanted], validation, len(wanted), ())
    order = (selection.best.model.parameters - 1) // 3
    refined = judge(found.model(order, refine=True), validation)
    warnings = []
    if order == max(wanted):
        warnings.append(f"the chosen order {order} is the largest tried")
    standing_out = found.order()
    if standing_out != order:
        warnings.append(f"{standing_out} singular values stand out of the noise, free simulation prefers order {order}")
    candidates = selection.candidates
    if refined.fit_percent >= selection.best.fit_percent:
        candidates = (refined, *candidates[1:])
    return Selection(candidates, selection.tried, selection.alike, tuple(warnings))
