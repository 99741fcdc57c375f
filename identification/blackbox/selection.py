"""Validation of models: free simulation of data not used for estimation, or BIC where simulation cannot serve."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fasbody.exceptions import SettingError
from identification import criteria
from identification.blackbox.candidate import FITTED, NEGLIGIBLE, Candidate, judge
from identification.blackbox.data import Series
from identification.blackbox.filters import outlasting
from identification.blackbox.frequency import Response
from identification.blackbox.narx import Narx
from identification.blackbox.nonlinear import HammersteinWiener
from identification.blackbox.polynomial import PolynomialModel
from identification.blackbox.state_space import StateSpaceModel

#: A model of one input and one output.
Single = PolynomialModel | StateSpaceModel | HammersteinWiener | Narx

ALIKE = 10.0  # difference of N times AIC below which data hardly separate models
SHORTEST_CHECK = 40  # samples; fewer do not separate models
NOISE_MODELS = ("arx", "armax", "bj")  # whose one-step errors are to be white, for their standard errors, too
NEGLIGIBLE_WEIGHT = 0.01  # Akaike weight below which a rival is left out
UNDECIDED = 0.1  # Akaike weight from which another delay is about as likely
SLIGHTLY = 2.0  # times its whitened variance that noise may have and still count as hardly coloured
NEARLY = 1.1  # times the least miss in simulation that is as good: errors of a long free motion hang together


def charged_poles(model: Single, samples: int) -> int:
    """Poles, those twice whose motion outlasts the record: they may go to any peak of the noise."""
    sizes = np.abs(model.poles())
    return len(sizes) + sum(outlasting(float(size), samples) for size in sizes)


@dataclass(frozen=True, eq=False)
class Referee:
    """How models are compared, and on what; the held-out data that the report shows take no part.

    Attributes:
        estimation: all data that orders may be chosen on.
        reason: why one-step errors and BIC decide; empty where free simulation does.
        weak: whether the input excites too little to separate forced and free motion.
        steps: whether the input is a few steps.
        least_delay: smallest n_k; 1 where a controller responds at once, whose u(t) would explain e(t).
    """

    estimation: Sequence[Series]
    reason: str = ""
    weak: bool = False
    steps: bool = False
    least_delay: int = 0
    fitted: Sequence[Series] = field(init=False)
    check: Sequence[Series] = field(init=False)

    def __post_init__(self) -> None:
        """Split the data where simulation decides: the first two thirds are fitted, the rest simulated."""
        parts = [(series, round(len(series) * FITTED)) for series in self.estimation]
        short = min(len(series) - middle for series, middle in parts) < SHORTEST_CHECK
        still = any(np.ptp(series.u[middle:]) < 0.05 * np.ptp(series.u) for series, middle in parts)
        if not self.reason and (short or still):
            why = "too few samples to keep some for the choice" if short else "the input is still in its last third"
            object.__setattr__(self, "reason", why)
        cut = [] if self.reason else [(series.cut(0, m), series.cut(m, len(series))) for series, m in parts]
        object.__setattr__(self, "fitted", [first for first, _ in cut] or list(self.estimation))
        object.__setattr__(self, "check", [second for _, second in cut] or list(self.estimation))

    @property
    def simulates(self) -> bool:
        """Whether free simulation decides."""
        return not self.reason

    def judge(self, model: Single) -> Candidate:
        """The model on the data kept for the choice, with its score on those fitted."""
        one_step = model.structure in NOISE_MODELS or not self.simulates
        errors = [model.residuals(s) if one_step else s.y - model.simulate(s) for s in self.fitted]
        samples = sum(len(series) for series in self.fitted)
        poles = charged_poles(model, min(map(len, self.fitted)))
        score = criteria.whitened_score(errors, model.parameters, poles, samples=samples)
        if self.steps:  # they excite little, so the stricter penalty of Schwarz applies
            score += (np.log(samples) - 4.0) * (model.parameters + poles)
        return replace(judge(model, self.check), score=score)


@dataclass(frozen=True, eq=False)
class Selection:
    """The models tried for one structure, best first.

    Attributes:
        candidates: by free simulation: the best score among those that the data kept for the choice do not
            separate from the best fit (fewest parameters where the rest is negligible), then by fit; else by BIC.
        tried: number of models compared, those of the ARX grid included.
        alike: labels of the models whose AIC differs by less than 10 / N from the least.
        warnings: sentences for the user.
        rivals: other models of the same data with their Akaike weights, for the uncertainty of the choice itself.
        attenuation: frequencies [Hz] and the share of the gain that noise of the input's sensor may take there.
    """

    candidates: tuple[Candidate, ...]
    tried: int
    alike: tuple[str, ...]
    warnings: tuple[str, ...]
    rivals: tuple[tuple[float, Any], ...] = ()
    attenuation: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def best(self) -> Candidate:
        """The one to report."""
        return self.candidates[0]

    @property
    def delays(self) -> tuple[int, ...]:
        """Delays n_k of the best model and of the rivals that are about as likely, rising."""
        alike = (model for weight, model in self.rivals if weight > UNDECIDED)
        return tuple(sorted({begins(self.best.model), *map(begins, alike)}))

    def curve(self, frequency_hz: ArrayLike) -> Response:
        """Response of the best model; how far the rivals are from it widens the spread (Burnham and Anderson 2002).

        So does what noise of the input may take of it.
        """
        response = self.best.model.response(frequency_hz)
        apart = [np.sqrt(w) * (other.response(frequency_hz).value - response.value) for w, other in self.rivals]
        if self.attenuation is not None:
            apart.append(np.interp(response.frequency_hz, *self.attenuation) * response.value)
        more = [np.stack([gap.real, gap.imag], axis=-1)[:, :, None] for gap in apart]
        return replace(response, spread=np.concatenate([response.spread, *more], axis=2))


def begins(model: Single) -> int:
    """The lag at which the input of a polynomial or NARX model counts, by two standard errors of B."""
    if not isinstance(model, PolynomialModel):
        return int(getattr(model, "nk", 0))
    orders = model.orders
    of_b = slice(orders.na, orders.na + orders.nb)
    counts = np.abs(model.theta[of_b]) > 2.0 * model.std_error[of_b]
    return int(orders.nk + np.argmax(counts))


def with_rivals(selection: Selection) -> Selection:
    """The selection with those of its candidates as rivals whose weight is not negligible.

    All candidates must come from the same samples. Weights follow N log V + 2 d, with V whitened for models without
    noise dynamics.
    """
    costs = []
    for c in selection.candidates:
        d, poles = c.model.parameters, len(c.model.poles())
        whitened = c.score - 2.0 * d - 4.0 * poles
        costs.append(c.aic * c.model.samples if c.model.structure in NOISE_MODELS else whitened)
    weights = np.exp(-0.5 * (np.array(costs) - min(costs)))
    weights /= weights.sum()
    pairs = zip(weights[1:], selection.candidates[1:], strict=True)
    return replace(selection, rivals=tuple((float(w), c.model) for w, c in pairs if w > NEGLIGIBLE_WEIGHT))


def coloured(model: Single, recordings: Sequence[Series]) -> bool:
    """Whether an autoregression foretells more than half of the errors: noise with a colour, or a plant left out."""
    errors = [model.residuals(series) for series in recordings]
    return criteria.whitened_variance(errors) * SLIGHTLY < float(np.mean(np.concatenate(errors) ** 2))


def rank(
    candidates: Sequence[Candidate], referee: Referee, tried: int = 0, warnings: Sequence[str] = (),
) -> Selection:  # fmt: skip
    """Candidates in the order of `Selection`.

    Where the input excites little, models whose free motion outlasts the record come last, and a sentence names them:
    with a fitted initial state they imitate a sine. A rich input needs no such rule, which would bury light damping.

    Raises:
        SettingError: no model at all.
    """
    if not candidates:
        raise SettingError("no model could be estimated; record longer or lower the orders.")
    sentences = list(warnings)
    shortest = min(len(series) for series in referee.check)
    largest = [float(np.abs(c.model.poles()).max(initial=0.0)) for c in candidates]
    driven = [
        c for c, pole in zip(candidates, largest, strict=True) if not (referee.weak and outlasting(pole, shortest))
    ] or list(candidates)
    ordered = sorted(candidates, key=lambda c: (c not in driven, -c.fit_percent))
    if len(driven) < len(candidates):
        late = [c.model.label for c in ordered if c not in driven]
        more = f" and {len(late) - 3} more" if len(late) > 3 else ""
        sentences.append(
            f"{', '.join(late[:3])}{more}: ranked last, because their free response is longer than the recording"
        )
    if referee.simulates:
        least = ordered[0].missed * NEARLY
        near = [c for c in driven if c is ordered[0] or c.missed <= least or c.no_worse_than(ordered[0])]
        first = min(near, key=lambda c: c.score)
        if first.model.structure not in NOISE_MODELS and coloured(first.model, referee.fitted):
            same = [c for c in near if all(map(c.no_worse_than, near))]
        else:
            same = [c for c in near if c.missed**2 - first.missed**2 <= NEGLIGIBLE**2]
        first = min(same, key=lambda c: (c.model.parameters, -c.fit_percent))
    else:
        ordered.sort(key=lambda c: (c not in driven, c.bic if c.model.structure in NOISE_MODELS else c.score))
        first = ordered[0]
    ordered = [first, *(c for c in ordered if c is not first)]
    lowest = min(c.aic for c in candidates)
    alike = tuple(c.model.label for c in ordered if (c.aic - lowest) * c.model.samples < ALIKE)
    return Selection(tuple(ordered), tried or len(ordered), alike, tuple(sentences))
