"""Search for orders: each model starts from the smaller ones it nests, and the search goes where the fit improves."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fasbody.exceptions import FasError
from identification import criteria
from identification.blackbox import pem, subspace
from identification.blackbox.candidate import Candidate
from identification.blackbox.data import Series
from identification.blackbox.filters import shifted
from identification.blackbox.least_squares import triangle
from identification.blackbox.polynomial import Orders, PolynomialModel
from identification.blackbox.selection import ALIKE, NEARLY, Referee, Selection, coloured, rank, with_rivals

NEAR = range(1, 6)  # n_k compared for sines, whose pulse response is periodic
DECISIVE = 10.0  # N times the difference of log losses that the delay read may lose by
LONGEST = 1000  # samples searched for the peak
LARGEST = 12  # n_f up to here
RACED = 3  # n_b = n_f up to which every delay is tried
PATIENCE = 3  # growing orders without a better one after which growth ends
NOISE = 5  # n_c, n_d up to here, as in the thesis
MOVES = 12  # to neighbouring orders
#: Changes of orders that a search tries, in this sequence: B may shrink or grow at either end.
PLANT_STEPS = (
    {"nb": -1}, {"nb": -1, "nk": 1}, {"nf": -1}, {"nb": 1}, {"nf": 1}, {"nb": 1, "nk": -1},
    {"nb": 1, "nf": 1}, {"nk": -1}, {"nk": 1},
)  # fmt: skip
ARMAX_STEPS = (
    {"nc": -1}, {"nc": 1}, {"na": -1}, {"na": -1, "nb": -1}, {"nb": -1}, {"nb": -1, "nk": 1},
    {"na": 1}, {"nb": 1}, {"nb": 1, "nk": -1}, {"nk": -1}, {"nk": 1},
)  # fmt: skip
HEAVY = 30_000  # samples above which growth ends sooner


class Search:
    """Models of one structure on the same rows, each estimated once.

    A model starts from all that `pem.estimate` tries and from the models estimated before that it nests, so its loss is
    never above theirs.

    Args:
        structure: arx, armax, oe or bj.
        recordings: estimation data, means removed.
        last_lag: largest n_k + n_b to be estimated; residuals count from there on.
    """

    def __init__(self, structure: str, recordings: Sequence[Series], last_lag: int = 0) -> None:
        self.structure, self.recordings = structure, list(recordings)
        shortest = min(len(series) for series in recordings)
        self.first_row = min(last_lag, shortest // 4)
        self.models: dict[Orders, PolynomialModel | None] = {}

    def at(self, orders: Orders, *starts: PolynomialModel) -> PolynomialModel | None:
        """The model of these orders, or None where it cannot be estimated."""
        if orders not in self.models:
            nested = [m for o, m in self.models.items() if m is not None and o.within(orders)]
            nested = sorted(nested, key=lambda model: model.loss)[:2]
            fitting = [model for model in starts if model.orders.within(orders)]
            try:
                self.models[orders] = pem.estimate(
                    self.structure, self.recordings, orders, starts=[*fitting, *nested], first_row=self.first_row,
                    quick=True,
                )  # fmt: skip
            except FasError:
                self.models[orders] = None
        return self.models[orders]

    def judged(self, some: Iterable[Orders], referee: Referee) -> dict[Orders, Candidate]:
        """Those of some orders that can be estimated, as a referee judges them."""
        models = (self.at(orders) for orders in some)
        return {model.orders: referee.judge(model) for model in models if model is not None}

    @property
    def failed(self) -> list[str]:
        """A sentence on the orders that could not be estimated, if there are any."""
        count = sum(model is None for model in self.models.values())
        return [f"{count} of {len(self.models)} orders had no stable start"] if count else []


def best_of(begun: dict[Orders, Candidate], referee: Referee) -> Orders:
    """Orders of the preferred model."""
    return rank(list(begun.values()), referee).best.model.orders


def climb(
    search: Search, referee: Referee, begun: dict[Orders, Candidate], steps: Sequence[dict[str, int]]
) -> Selection:
    """From the best of the models begun with to the first preferred neighbour, until none is."""
    chosen = rank(list(begun.values()), referee)
    for _ in range(MOVES):
        start = chosen.best.model.orders
        for orders in neighbours(start, steps, referee.least_delay):
            model = None if orders in begun else search.at(orders)
            if model is None:
                continue
            begun[orders] = referee.judge(model)
            chosen = rank(list(begun.values()), referee)
            if chosen.best.model.orders != start:
                break
        else:
            break
    return replace(chosen, warnings=(*chosen.warnings, *search.failed))


def neighbours(o: Orders, steps: Sequence[dict[str, int]], least_delay: int) -> Iterator[Orders]:
    """Orders one step away that make a model whose noise orders are not above the largest."""
    for step in steps:
        counts = {name: getattr(o, name) + change for name, change in step.items()}
        few = counts.get("nb", 1) < 1 or min(counts.values()) < 0
        late = counts.get("nk", least_delay) >= least_delay
        if not few and late and max(counts.get("nc", 0), counts.get("nd", 0)) <= NOISE:
            yield replace(o, **counts)


def edge(chosen: Selection, **largest: int) -> Selection:
    """The selection with a sentence when an order of its best model is the largest that may be tried."""
    orders = chosen.best.model.orders
    reached = [f"n_{name[1]} = {size}" for name, size in largest.items() if getattr(orders, name) >= size]
    if not reached:
        return chosen
    text = f"the chosen {', '.join(reached)} is the largest tried: a larger one may fit better"
    return replace(chosen, warnings=(*chosen.warnings, text))


def select_oe(referee: Referee, delays: Sequence[int], largest: int = LARGEST) -> Selection:
    """Output-error orders: n_b = n_f grow while that helps, then neighbours of the preferred model are tried.

    Each of the delays n_k runs as far as `RACED`; from there on the one that leads.
    """
    heavy = sum(len(series) for series in referee.fitted) > HEAVY
    search = Search("oe", referee.fitted, max(delays) + largest + 2)
    begun: dict[Orders, Candidate] = {}
    better = 0
    for n in range(1, largest + 1):
        leading = {best_of(begun, referee).nk} if n > RACED and begun else delays
        begun |= search.judged((Orders(nb=n, nf=n, nk=nk) for nk in leading), referee)
        if not begun:
            if n > PATIENCE:
                break
            continue
        best = best_of(begun, referee).nf
        better = n if best == n or not better else better
        if n - better >= (2 if heavy else PATIENCE):
            break
    chosen = climb(search, referee, begun, PLANT_STEPS)
    return edge(with_rivals(_on_the_whole(chosen, referee, search.first_row)), nf=largest)


def _on_the_whole(chosen: Selection, referee: Referee, first_row: int) -> Selection:
    """Output-error orders once more, from the preferred ones, on all data for the choice."""
    # output errors follow coloured noise, and only simulation keeps them from it
    if not referee.simulates or coloured(chosen.best.model, referee.fitted):
        return _again(chosen, "oe", referee)
    whole = replace(referee, reason="orders that simulate alike are compared by one-step errors")
    search = Search("oe", whole.estimation, first_row)
    best = sorted(chosen.candidates[1:], key=lambda c: c.score)[:2]
    begun: dict[Orders, Candidate] = {}
    best.append(max(chosen.candidates, key=lambda c: c.fit_percent))
    for one in (chosen.best, *(c for c in best if c.missed <= NEARLY * chosen.best.missed)):
        model = search.at(one.model.orders, one.model)
        if model is not None:
            begun[model.orders] = whole.judge(model)
    again = climb(search, whole, begun, PLANT_STEPS)
    again = replace(again, tried=chosen.tried + again.tried, warnings=(*chosen.warnings, *again.warnings))
    return _again(again, "oe", referee)


def _again(chosen: Selection, structure: str, referee: Referee) -> Selection:
    """The best model estimated once more, from all data that orders were chosen on."""
    model: PolynomialModel = chosen.best.model
    whole = pem.estimate(structure, referee.estimation, model.orders, starts=[model])
    return replace(chosen, candidates=(replace(chosen.best, model=whole), *chosen.candidates[1:]))


def select_arx(referee: Referee, delays: Sequence[int] = (1,), largest: int = 15) -> Selection:
    """ARX over n_a, n_b, n_k = 1..largest: criteria on the grid, then free simulation among a shortlist.

    The shortlist holds the model of least loss for each number of parameters and those alike by AIC (40 at most). A
    plant's `delays` beyond the grid, 0 or late, join with the n_a and n_b of the former.
    """
    shortest = min(len(series) for series in referee.fitted)
    largest = min(largest, max((shortest - 2) // 8, 1))
    grid = pem.grid(referee.fitted, largest, largest, largest)
    count = grid.parameters
    loss = np.maximum(grid.loss, 1e-300)
    aic, bic = (of(loss, count, grid.samples) for of in (criteria.aic, criteria.bic))
    leading = {int(np.argmin(np.where(count == d, loss, np.inf))) for d in np.unique(count)}
    by_aic = np.argsort(aic, axis=None)
    alike = by_aic[(aic.ravel()[by_aic] - aic.min()) * grid.samples < ALIKE]
    warnings = []
    for name, values in (("AIC", aic), ("BIC", bic)):
        best = np.unravel_index(int(values.argmin()), values.shape)
        at_edge = [n for n, k in zip(("n_a", "n_b", "n_k"), best, strict=True) if k == largest - 1]
        if at_edge:
            warnings.append(
                f"{name} selects the largest order ({', '.join(at_edge)} = {largest}): the last lags may fit noise"
            )
    if len(alike) > 1:
        warnings.append(f"{len(alike)} of {aic.size} ARX models lie within 10 in N x AIC: orders are not determined")
    shortlist = leading | {int(k) for k in alike[:40]} | {int(bic.argmin())}
    trials = {_numbers(flat, loss.shape) for flat in shortlist}
    beyond = [nk for nk in delays if not 1 <= nk <= largest]
    trials |= {(*_numbers(flat, loss.shape)[:2], nk) for flat in leading for nk in beyond}
    search = Search("arx", referee.fitted, 2 * largest)
    tried = search.judged((Orders.of("arx", numbers) for numbers in sorted(trials)), referee)
    chosen = with_rivals(rank(list(tried.values()), referee, grid.loss.size, warnings))
    chosen = replace(
        _again(chosen, "arx", referee),
        rivals=tuple((w, pem.estimate("arx", referee.estimation, m.orders)) for w, m in chosen.rivals),
    )
    return edge(chosen, na=largest, nb=largest, nk=max(largest, *(nk + 1 for nk in delays)))


def _numbers(flat: int, shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(int(k) + 1 for k in np.unravel_index(flat, shape))


def select_armax(referee: Referee, from_arx: Orders, from_oe: Orders | None) -> Selection:
    """ARMAX by BIC, from the orders of the ARX model and from n_a = n_f of the OE model, to their neighbours.

    Free simulation does not depend on C, so one-step errors decide.
    """
    whole = replace(referee, reason=referee.reason or "noise models are compared by one-step errors")
    search = Search("armax", whole.estimation, from_arx.nk + from_arx.nb + 4)
    plants = [Orders(na=from_arx.na, nb=from_arx.nb, nk=from_arx.nk)]
    plants += [Orders(na=from_oe.nf, nb=from_oe.nb, nk=from_oe.nk)] if from_oe else []
    noisy = (replace(o, nc=nc) for o in plants for nc in (1, min(max(o.na, 1), NOISE)))
    begun = search.judged(noisy, whole)
    return edge(with_rivals(climb(search, whole, begun, ARMAX_STEPS)), nc=NOISE)


def select_bj(referee: Referee, from_oe: PolynomialModel, delays: Sequence[int]) -> Selection:
    """Box-Jenkins by BIC: noise orders from what the OE model leaves, then neighbours of plant and noise.

    Where the noise is coloured, plant orders are searched once more on data that a model of it has whitened.
    """
    whole = replace(referee, reason=referee.reason or "noise models are compared by one-step errors")
    o = from_oe.orders
    noises = [from_oe.residuals(series) for series in whole.estimation]
    nc, nd = pem.noise_orders(noises, NOISE)
    plants = [o]
    if nc + nd:
        white = pem.whitened(whole.estimation, noises, NOISE)
        again: PolynomialModel = select_oe(replace(whole, estimation=white), delays, NOISE + 3).best.model
        plants = [again.orders]
    search = Search("bj", whole.estimation, max(plant.nk + plant.nb for plant in plants) + 3)
    noisy = {replace(plant, nc=c, nd=d) for plant in plants for c, d in ((nc, nd), (1, 1))}
    begun = search.judged(noisy, whole)
    steps = ({"nc": -1}, {"nd": -1}, {"nc": 1}, {"nd": 1}, *PLANT_STEPS)
    return edge(with_rivals(climb(search, whole, begun, steps)), nc=NOISE, nd=NOISE)


def select_state_space(referee: Referee, orders: Sequence[int] = tuple(range(1, 16))) -> Selection:
    """State-space models of all orders from one factorisation; the best is refined unless that spoils its fit."""
    shortest = min(len(series) for series in referee.fitted)
    rows = max(min(max(subspace.BLOCK_ROWS, max(orders) + 1), shortest // 7), 3)
    fitted = subspace.decompose(referee.fitted, rows)
    trials = [n for n in orders if n < fitted.block_rows]
    chosen = rank([referee.judge(fitted.model(n)) for n in trials], referee)
    order = chosen.best.model.order
    refined = referee.judge(fitted.model(order, refine=True))
    better = refined.no_worse_than(chosen.best) if referee.simulates else refined.score <= chosen.best.score
    whole = subspace.decompose(referee.estimation, rows)
    models = [whole.model(order, refine=refine) for refine in ((False, True) if better else (False,))]
    best = min((replace(referee.judge(m), model=m) for m in models), key=lambda c: c.score)
    chosen = replace(chosen, candidates=(best, *chosen.candidates[1:]))
    if not best.model.warnings:
        chosen = _among_orders(chosen, [n for n in (order, order - 1, order + 1) if n in trials], whole, referee)
    order = chosen.best.model.order
    warnings = list(chosen.warnings)
    if order == max(trials):
        warnings.append(f"the chosen order {order} is the largest tried")
    standing_out = fitted.order()
    if standing_out != order:
        warnings.append(f"{standing_out} singular values exceed the noise; order {order} was chosen")
    return replace(chosen, warnings=tuple(warnings))


def _among_orders(chosen: Selection, orders: list[int], whole: subspace.Subspace, referee: Referee) -> Selection:
    """The best refined model of these orders on all data for the choice, the others as its rivals."""
    entire = replace(referee, reason="orders that simulate alike are compared on all data")
    models = [whole.model(n, refine=True) for n in orders]
    by_plant = {model.transfer: model for model in models if not model.warnings}
    ranked = with_rivals(rank([entire.judge(plant) for plant in by_plant], entire))
    best = replace(chosen.best, model=by_plant[ranked.best.model])
    rivals = tuple((weight, by_plant[plant]) for weight, plant in ranked.rivals)
    return replace(chosen, candidates=(best, *chosen.candidates[1:]), rivals=rivals)


def delay(recordings: Sequence[Series], *, far: bool = True) -> int:
    """The delay n_k of a plant, about which those that compete lie.

    A long ARX model separates it from the zeros of B: its input coefficients before the delay are
    zero whatever the noise, and BIC gives how many. An output-error model of order four must agree,
    as a nonlinear plant leads the former astray.

    Args:
        recordings: estimation data, means removed.
        far: whether the input is rich enough for a long ARX model; for sines 1 to 5 are compared by output error alone.
    """
    read = _leading_zeros(recordings) if far else 0
    if far and read < 2:
        return read
    losses = {}
    for nk in (1, read) if far else NEAR:
        with suppress(FasError):
            at = pem.estimate("oe", recordings, Orders(nb=4, nf=4, nk=nk), quick=True)
            losses[nk] = round(float(np.log(max(at.loss, 1e-300))), 4)
    best = min(losses, key=lambda nk: (losses[nk], nk), default=1)
    agrees = losses.get(read, np.inf) < losses.get(best, 0.0) + DECISIVE / sum(map(len, recordings))
    return read if agrees else best


def _leading_zeros(recordings: Sequence[Series], lags: int = 20) -> int:
    """How many input coefficients from lag 0 on a long ARX model can do without, by BIC.

    One QR with the nearest input lag last: what each adds to the fit of those farther away is read off its triangle.
    """
    lags = min(lags, min(len(series) for series in recordings) // 10)
    peak = pulse_peak(recordings)
    first = max(peak - 2 * lags, 0)
    while True:
        width = peak + lags + 1 - first
        row = max(lags, peak + lags)
        if min(len(series) for series in recordings) < row + 4 * (lags + width):
            return 1
        r = triangle(
            np.column_stack([shifted(s.y, lags, 1), np.ones(len(s)), shifted(s.u, width, first)[:, ::-1], s.y])[row:]
            for s in recordings
        )
        squares = r[lags + 1 : lags + width + 2, -1] ** 2  # of each input lag, the nearest last; then what is left
        samples = sum(len(series) - row for series in recordings)
        rest = np.maximum(np.cumsum(squares[::-1])[:-1], 1e-300)  # entry k: with the lags from first + k on
        score = samples * np.log(rest) - np.log(samples) * np.arange(len(rest))
        zeros = first + int(np.argmin(score))
        if zeros > first or first == 0:
            return zeros
        first = max(first - 2 * lags, 0)


def pulse_peak(recordings: Sequence[Series]) -> int:
    """Lag of the largest response to a pulse, from spectra divided where the input is strong."""
    length = min(len(series) for series in recordings)
    size = 2 * max(len(series) for series in recordings)  # padded, so that no end meets the beginning
    spectra = [(np.fft.rfft(series.u, size), np.fft.rfft(series.y, size)) for series in recordings]
    power = np.sum([np.abs(u) ** 2 for u, _ in spectra], axis=0)
    cross = np.sum([y * np.conj(u) for u, y in spectra], axis=0)
    pulse = np.fft.irfft(cross / (power + 0.01 * power.max()), size)
    return int(np.argmax(np.abs(pulse[: min(LONGEST, length // 4)])))
