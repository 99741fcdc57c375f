"""What may be wrong with a recording before any model is chosen: spikes, drift, feedback, an input of a few steps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, stats
from scipy.signal import lfilter

from fasbody.exceptions import SettingError
from fasbody.presentation import counted
from identification.blackbox import pem
from identification.blackbox.data import Series
from identification.blackbox.filters import as_columns, largest_root, shifted
from identification.blackbox.polynomial import Orders

ANSWER = 0.02  # share of the input's news that errors must foretell: a nonlinear plant in open loop reaches 0.013
LAGS = 25  # of the long ARX model whose errors stand for e(t)
SPIKE = 6.0  # robust standard deviations from which a sample is no noise: 1e-5 of a Gaussian recording has one
MOST = 0.1  # of all samples that may be spikes; more are the signal
LIMIT, OFTEN = 1e-4, 0.01  # of its range from its end, and share of samples there: an output that overflows
FAINT = 1e-6  # of the output's standard deviation: smaller errors are those of rounding
CERTAIN = 1e-6  # p-value below which drift or feedback is reported: both tests are led astray by a nonlinear plant
LOOKED_AT = 20_000  # samples of a recording that are examined
SHORT = 3  # errors in which a weak loop stands out
SUSPECT = 1e-3  # p-value below which a loop is possible; a nonlinear plant gives such values, too
MOSTLY = 0.5  # share of one's news from which one signal drives the other, and does not depend on it
FLAT = 0.02  # of the input's reach that a change must exceed to count as a step
STEPS = 6  # changes of level up to which an input is a step record


@dataclass(frozen=True)
class Condition:
    """The condition of one recording.

    Attributes:
        spikes: samples of the output (from 0) that no noise explains.
        drift: change of the output over the record that the input does not explain, share of its standard deviation.
        feedback: whether the input depends on past disturbances of the output.
        steps: whether the input is a few steps or pulses and constant otherwise.
        unstable: whether the plant is unstable, held by a loop.
        suspect: whether a loop is possible, too weak to be certain of.
        limited: share of samples at which the output stands at an end of its range.
        leads: whether the output foretells most of the input's news, as of shifted or swapped channels.
    """

    spikes: tuple[int, ...] = ()
    drift: float = 0.0
    feedback: bool = False
    steps: bool = False
    unstable: bool = False
    suspect: bool = False
    limited: float = 0.0
    leads: bool = False

    @property
    def by_prediction(self) -> str:
        """Why models are compared by one-step errors, not by free simulation; empty where simulation serves."""
        if self.leads:
            return "the output comes before the input"
        if self.unstable:
            return "the plant is unstable in a closed loop"
        if self.feedback:
            return "the input answers the output (feedback)"
        return "the input is constant but for a few steps" if self.steps else ""

    @property
    def no_intervals(self) -> list[str]:
        """Why no structure has intervals."""
        reasons = []
        if self.suspect:
            reasons.append("the input may answer the output, which biases every structure a little")
        if self.leads:
            reasons.append("the output comes before the input")
        if self.spikes:
            reasons.append("outliers are no noise that a standard error describes")
        if self.limited:
            reasons.append("the output stands at an end of its range")
        return reasons

    def warnings(self) -> list[str]:
        """Sentences on the condition."""
        sentences = []
        if self.spikes:
            where = ", ".join(str(k + 1) for k in self.spikes[:5]) + (", ..." if len(self.spikes) > 5 else "")
            some = f"{counted(len(self.spikes), 'outlier')} in the output (at sample {where})"
            sentences.append(f"{some}: --robust (one input, one output) replaces faults of the sensor")
        if self.limited:
            sentences.append(
                f"the output stands at an end of its range for {self.limited:.1%} of the samples (overflow, a sensor "
                "that saturates): no linear model holds there"
            )
        if self.drift:
            sentences.append(f"the output drifts by {self.drift:.2g} of its standard deviation: --detrend 1 removes it")
        if self.leads:
            cause = "are the channels shifted or swapped, or does only a controller move the input?"
            sentences.append(f"the output foretells the input: {cause}")
        if self.by_prediction:
            sentences.append(f"{self.by_prediction}: orders are chosen by one-step prediction errors and BIC")
        if self.suspect:
            sentences.append("the input may answer the output (weak feedback, or a nonlinear plant): no intervals")
        return sentences


def examine(series: Series) -> Condition:
    """The condition of one recording, means removed; empty for one too short for a long ARX model."""
    if series.y.ndim > 1:
        outputs = zip(series.y.T, series.outputs, strict=True)
        return _either([examine(replace(series, y=y, channels=(series.channels[0], name))) for y, name in outputs])
    lags, u = _lags(series), as_columns(series.u).T
    if lags < 3 or not np.ptp(u, axis=1).all():
        return Condition()
    limit = limited(series.y)
    repaired, spikes = (series, ()) if limit else mend(series)
    phi, y = _regression(repaired, lags)
    theta = pem.solve([(phi, y)])
    tests = [_feedback(u, one, y - phi @ theta, theta[:lags]) for one in u]
    feedback, unstable = any(p < CERTAIN and share > ANSWER for share, p, _ in tests), False
    if feedback:  # a controller's u(t) depends on y(t): n_k is 1
        theta = pem.solve([pem.regressors(repaired, Orders(na=lags, nb=lags, nk=1))])
        unstable = largest_root(np.concatenate([[1.0], theta[:lags]])) > 1.0
    at_once = any(_at_once(phi, y, k) for k in range(lags, phi.shape[1] - 1, lags + 1))
    return Condition(
        spikes, _drift(repaired, phi, y, lags), feedback, all(map(few_steps, u)), unstable,
        not feedback and (at_once or any(p < SUSPECT for *_, p in tests)), limit, feedback and max(tests)[0] > MOSTLY,
    )  # fmt: skip


def limited(y: np.ndarray) -> float:
    """Share of an output (N,) at an end of its range, where jumps to and from it are no outliers; 0 for few."""
    share = max(float(np.mean(np.abs(y - end) <= LIMIT * np.ptp(y))) for end in (y.min(), y.max()))
    return share if share >= OFTEN else 0.0


def few_steps(u: np.ndarray) -> bool:
    """Whether an input (N,) changes in only a few places."""
    changes = np.flatnonzero(np.abs(np.diff(u)) > FLAT * np.ptp(u))
    places = 1 + int(np.sum(np.diff(changes) > 5)) if len(changes) else 0
    return 0 < places <= STEPS and len(changes) < len(u) / 20


def _lags(series: Series) -> int:
    return min(LAGS, len(series) // (20 * len(series.inputs)))


def _regression(series: Series, lags: int) -> tuple[np.ndarray, np.ndarray]:
    phi, y = pem.regressors(series, Orders(na=lags, nb=lags + 1, nk=0))
    return np.column_stack([phi, np.ones(len(y))]), y


def mend(series: Series) -> tuple[Series, tuple[int, ...]]:
    """The recording with single wrong samples of its output replaced, and where they were (from 0).

    A spike of size s at t leaves s, a_1 s, a_2 s, ... in the errors of a long ARX model; the matched filter finds it,
    the largest first, and what it measures is taken off (Chen and Liu 1993). Coefficients come from least squares with
    Huber's weights, so that spikes do not shape the model that detects them.
    """
    lags = _lags(series)
    if lags < 3:
        return series, ()
    y, spikes = series.y.copy(), set[int]()
    for _ in range(12):
        phi, out = _regression(replace(series, y=y, part=True), lags)
        weight = np.ones(len(out))
        for _ in range(4):
            root = np.sqrt(weight)
            theta = pem.solve([(phi * root[:, None], out * root)])
            errors = out - phi @ theta
            sigma = 1.4826 * float(np.median(np.abs(errors - np.median(errors))))
            sigma = max(sigma, FAINT * float(np.std(series.y)))
            weight = np.minimum(1.0, 2.0 * sigma / np.maximum(np.abs(errors), 1e-300))
        first = len(y) - len(out)
        a = np.concatenate([[1.0], theta[:lags]])
        padded = np.concatenate([errors, np.zeros(lags)])
        power = np.convolve(np.concatenate([np.ones(len(out)), np.zeros(lags)]), (a**2)[::-1])[lags : lags + len(out)]
        size = np.convolve(padded, a[::-1])[lags : lags + len(out)] / power
        strength = np.abs(size) * np.sqrt(power) / sigma
        reach = np.lib.stride_tricks.sliding_window_view(np.pad(strength, lags), 2 * lags + 1).max(axis=1)
        at = np.flatnonzero((strength > SPIKE) & (strength >= reach))
        if not len(at):
            break
        y[first + at] -= size[at]
        spikes |= {int(first + k) for k in at}
    nonlinear = float(np.std(errors)) > 1.5 * sigma  # far from Gaussian without the spikes as well: no wild sensor
    if not spikes or len(spikes) > MOST * len(y) or nonlinear:
        return series, ()
    return replace(series, y=y), tuple(sorted(spikes))


def _drift(series: Series, past: np.ndarray, y: np.ndarray, lags: int) -> float:
    """Size of a line or bow in the output that the input leaves unexplained, where it is certain."""
    time = np.linspace(-1.0, 1.0, len(y))
    bow = np.column_stack([time, time**2])
    if _gain(y, past, bow)[1] > CERTAIN:
        return 0.0
    theta = pem.solve([(np.column_stack([past, bow]), y)])
    filtered, a = bow @ theta[-2:], np.concatenate([[1.0], theta[:lags]])
    line = filtered / a.sum() if abs(a.sum()) > 1e-6 else lfilter([1.0], a, filtered)
    size = float(np.ptp(line) / np.std(series.y))
    return size if size > 0.2 else 0.0


def _feedback(inputs: np.ndarray, u: np.ndarray, errors: np.ndarray, past_y: np.ndarray) -> tuple[float, float, float]:
    """Share of the news of an input (N,) that errors of the long model predict, and its p-value: a way back to it.

    Both sides are freed of past inputs (m, N) first. An input that its past predicts to a hundredth (sines, smooth
    signals) cannot show it. A weak loop stands out in the last `SHORT` errors, a slow one in more. The last number is
    the least of these p-values and of that of the disturbance itself, the errors through 1/A of the coefficients
    `past_y` (lags,): under coloured noise it shows loops that single errors do not.
    """
    lags = len(past_y)
    lead = min(10, lags)
    past = np.column_stack([*(shifted(one, 2 * lags, 1)[2 * lags :] for one in inputs), np.ones(len(u) - 2 * lags)])
    new = u[2 * lags :] - past @ pem.solve([(past, u[2 * lags :])])
    if np.std(new) < 0.01 * np.std(u):
        return 0.0, 1.0, 1.0
    a, first = np.concatenate([[1.0], past_y]), len(errors) - len(new)
    e = errors[first:]
    ahead = np.column_stack([e[k : len(e) - lead + k] for k in range(lead)])  # e(t - lead) ... e(t - 1)
    share, p = _gain(new[lead:], past[lead:], ahead)
    p = min(p, _gain(new[lead:], past[lead:], ahead[:, -SHORT:])[1])
    if largest_root(a) >= 1.0:
        return share, p, p
    disturbance = lfilter([1.0], a, errors)[first:-1, None]
    return share, p, min(p, _gain(new[1:], past[1:], disturbance)[1])


def _at_once(phi: np.ndarray, y: np.ndarray, k: int) -> bool:
    """Whether u(t), column k, explains a little of y(t) beyond the past: a feedthrough or a fast controller."""
    share, p = _gain(y, np.delete(phi, k, axis=1), phi[:, k : k + 1])
    return p < SUSPECT and share < MOSTLY


def _gain(y: np.ndarray, phi: np.ndarray, more: np.ndarray) -> tuple[float, float]:
    """Share of what `phi` leaves of y that `more` columns explain, and the p-value of the F test."""
    rest = y - phi @ pem.solve([(phi, y)])
    joint = np.column_stack([phi, more])
    less = y - joint @ pem.solve([(joint, y)])
    freedom = len(y) - joint.shape[1]
    top, bottom = float(rest @ rest - less @ less), float(less @ less)
    if bottom <= 1e-20 * max(float(y @ y), 1e-300) or freedom < 10:
        return 0.0, 1.0
    statistic = top / more.shape[1] / (bottom / freedom)
    return top / max(top + bottom, 1e-300), float(stats.f.sf(max(statistic, 0.0), more.shape[1], freedom))


def detrend(series: Series, degree: int) -> Series:
    """The recording less polynomials of `degree` in time, one fitted to its input and one to its output.

    Raises:
        SettingError: a degree that is no small whole number.
    """
    if not 0 <= degree <= 5:
        problem = f"detrend degree {degree} is not between 0 (the mean) and 5."
        raise SettingError(problem, setting="detrend")
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(series)), degree)
    u, y = (signal - basis @ linalg.lstsq(basis, signal)[0] for signal in (series.u, series.y))
    return replace(series, u=u, y=y)


def of(recordings: Sequence[Series]) -> Condition:
    """One condition of the beginnings of several recordings: feedback or steps in any count for all."""
    return _either([examine(series.cut(0, min(len(series), LOOKED_AT)).centred()) for series in recordings])


def _either(conditions: Sequence[Condition]) -> Condition:
    return Condition(
        tuple(k for one in conditions for k in one.spikes), max(one.drift for one in conditions),
        any(one.feedback for one in conditions), any(one.steps for one in conditions),
        any(one.unstable for one in conditions), any(one.suspect for one in conditions),
        max(one.limited for one in conditions), any(one.leads for one in conditions),
    )  # fmt: skip
