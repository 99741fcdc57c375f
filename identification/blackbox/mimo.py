"""Several inputs and outputs: state-space models by the subspace method, and ARX."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from fasbody.exceptions import RecordingError, SettingError, unknown
from identification import criteria
from identification.blackbox import condition, pem, search, subspace
from identification.blackbox.candidate import Candidate, judge
from identification.blackbox.condition import Condition
from identification.blackbox.data import Series
from identification.blackbox.filters import as_columns, shifted
from identification.blackbox.frequency import with_interval
from identification.blackbox.polynomial import Orders
from identification.blackbox.selection import Referee
from identification.blackbox.state_space import StateSpace
from identification.blackbox.validation import ResidualTest, failed, residual_test

STRUCTURES = ("arx", "ss")
LARGEST = 10  # order up to which models are tried
FOLLOWS = 1e-6  # share of an input's power that others leave from which it is none of its own
MOSTLY = 0.1  # the same from which a sentence says so
REACH = 10  # samples before and after over which an input may follow from others
NONE = np.zeros((0, 0))
ROWS = 12  # block rows of the subspace method; more than the largest order over one output


@dataclass(frozen=True, eq=False)
class MimoModel(StateSpace):
    """A model with m inputs and p outputs, besides its matrices.

    Attributes:
        noise: covariance of e, shape (p, p).
        loss: mean squared one-step error over the outputs, each over its variance.
        samples: rows behind it.
        structure: ss or arx.
        numbers: order of ss; n_a, n_b, n_k of arx.
        theta: ARX coefficients, one column an output: n_a p of past outputs (with a minus), then
            n_b m of inputs. It is empty for ss, whose basis is arbitrary.
        std_error: of `theta`, the same shape.
        warnings: sentences for the user.
        spread: root S of the covariance S S' of one output's `theta` for noise of variance 1; it is
            empty where there are no intervals.
    """

    D: np.ndarray
    noise: np.ndarray
    loss: float
    samples: int
    structure: str
    numbers: tuple[int, ...]
    theta: np.ndarray
    std_error: np.ndarray
    warnings: tuple[str, ...] = field(default=())
    spread: np.ndarray = field(default_factory=lambda: NONE)

    @property
    def label(self) -> str:
        """Structure and orders."""
        return f"{self.structure.upper()} ({', '.join(map(str, self.numbers))})"

    @property
    def parameters(self) -> int:
        """Independent coefficients."""
        (p, n), m = self.C.shape, self.B.shape[1]
        return self.theta.size or n * (2 * p + m) + p * m

    def response(self, frequency_hz: ArrayLike) -> np.ndarray:
        """Frequency response, complex, shape (M, p, m)."""
        return self.plant_response(frequency_hz)

    def gain_std(self, frequency_hz: ArrayLike) -> np.ndarray:
        """Standard deviations of the gains, first order, shape (M, p, m); NaN without intervals."""
        G = self.plant_response(frequency_hz)
        std = np.full(G.shape, np.nan)
        if not self.spread.size:
            return std
        (na, nb, nk), (p, m) = self.numbers, G.shape[1:]
        shift = np.exp(-2j * np.pi * np.atleast_1d(frequency_hz) * self.sample_time)
        power, directions = np.linalg.eigh(self.noise)
        root = directions * np.sqrt(np.maximum(power, 0.0))
        for k, z in enumerate(shift):
            lags_y, lags_u = z ** np.arange(1, na + 1), z ** np.arange(nk, nk + nb)
            a = self.theta[: na * p].reshape(p, na, p)  # [of output, lag, equation]
            inverse = np.linalg.inv(np.eye(p) + np.einsum("qlr,l->rq", a, lags_y))
            for j in range(m):
                drive = np.concatenate([
                    np.kron(-G[k, :, j], lags_y), np.kron(np.eye(m)[j], lags_u),
                ])  # fmt: skip
                for i in range(p):
                    turn = np.conj(G[k, i, j]) / max(abs(G[k, i, j]), 1e-300)
                    slope = np.real(turn * np.outer(inverse[i], drive))  # by equation and term
                    std[k, i, j] = np.linalg.norm(root.T @ slope @ self.spread)
        return std


def _loss(errors: np.ndarray, y: np.ndarray) -> float:
    return float(np.mean(errors**2 / y.var(axis=0)))


def arx(recording: Series, na: int, nb: int, nk: int) -> MimoModel:
    """ARX by least squares, one regression an output, all with the same regressors.

    Raises:
        SettingError: more coefficients than samples.
    """
    p, m = len(recording.outputs), len(recording.inputs)
    size, count = max(na, nk + nb - 1, 1), na * p + nb * m
    if min(na, nb - 1, nk) < 0 or len(recording) - size < 2 * (count + 1):
        raise SettingError(
            f"arx={na},{nb},{nk} with {m} inputs and {p} outputs cannot be estimated from "
            f"{len(recording)} samples; n_b is at least 1, and a model has at most half as many "
            "coefficients as there are samples."
        )
    phi, y = pem.regressors(recording, Orders(na=na, nb=nb, nk=nk))
    phi = np.column_stack([phi, np.ones(len(phi))])
    theta = pem.solve([(phi, y)])
    errors = y - phi @ theta
    noise = errors.T @ errors / (len(phi) - phi.shape[1])
    scale = np.linalg.norm(phi, axis=0)
    inverse = np.linalg.pinv(linalg.qr(phi / scale, mode="r")[0][: phi.shape[1]])
    root = (inverse / scale[:, None])[:count]
    theta = theta[:count]
    std_error = np.linalg.norm(root, axis=1)[:, None] * np.sqrt(np.diag(noise))
    past_y = theta[: na * p].reshape(p, na, p).transpose(1, 2, 0)  # [lag, output, from output]
    past_u = theta[na * p :].reshape(m, nb, p).transpose(1, 2, 0)
    a = np.concatenate([past_y, np.zeros((size - na, p, p))])
    late = max(size + 1 - nk - nb, 0)
    b = np.concatenate([np.zeros((nk, p, m)), past_u, np.zeros((late, p, m))])
    A = np.eye(size * p, k=p)
    A[:, :p] -= a.reshape(size * p, p)
    B, K = (b[1:] - a @ b[0]).reshape(size * p, m), -a.reshape(size * p, p)
    return MimoModel(
        A, B, np.eye(p, size * p), b[0], K, recording.sample_time, noise,
        _loss(errors, recording.y), len(phi), "arx", (na, nb, nk), theta, std_error, spread=root,
    )  # fmt: skip


def space(factors: subspace.Subspace, order: int) -> MimoModel:
    """The state-space model of `order` states from a factorisation of one recording."""
    recording = factors.recordings[0]
    A, C, warnings = factors.observed(order)
    B, D, K = factors.driven_by(A, C)
    model = MimoModel(
        A, B, C, D, K, recording.sample_time, np.eye(len(C)), np.nan, len(recording), "ss", (order,), NONE, NONE,
        tuple(warnings),
    )  # fmt: skip
    errors = model.residuals(recording)
    return replace(model, noise=errors.T @ errors / len(errors), loss=_loss(errors, recording.y))


@dataclass(frozen=True, eq=False)
class MimoReport:
    """Models of several inputs and outputs.

    Attributes:
        estimation: data behind the estimates and the choice of orders.
        validation: held out.
        models: structure -> model, with its fits over all outputs of the held-out data.
        output_fits: structure -> fit [%] of each output in free simulation.
        white_p: structure -> p-value of white residuals of each output.
        independent_p: structure -> p-values that the residual of an output (row) does not depend on
            past values of an input (column), shape (p, m).
        warnings: structure -> sentences for the user.
        frequency_hz: where the inputs are strongest, for the gains.
    """

    estimation: Series
    validation: Series
    models: dict[str, Candidate]
    output_fits: dict[str, tuple[float, ...]]
    white_p: dict[str, np.ndarray]
    independent_p: dict[str, np.ndarray]
    warnings: dict[str, tuple[str, ...]]
    frequency_hz: float

    def __str__(self) -> str:
        inputs, outputs = self.estimation.inputs, self.estimation.outputs
        rows = [f"{self.estimation.name}: {', '.join(inputs)} to {', '.join(outputs)}"]
        for name, candidate in self.models.items():
            parts = zip(outputs, self.output_fits[name], strict=True)
            fits = ", ".join(f"{output} {fit:.2f} %" for output, fit in parts)
            rows += [f"  {candidate.model.label}: {fits}"]
            gain = np.abs(candidate.model.response(self.frequency_hz)[0])
            std = candidate.model.gain_std(self.frequency_hz)[0]
            for i, output in enumerate(outputs):
                gains = [f"{u} {with_interval(gain[i, j], std[i, j])}" for j, u in enumerate(inputs)]
                rows.append(f"    {output}, gain at {self.frequency_hz:.4g} Hz: {', '.join(gains)}")
            rows += [f"    {text}" for text in self.warnings[name]]
        return "\n".join(rows)

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        series = self.estimation
        return {
            "recording": series.name, "inputs": series.inputs, "outputs": series.outputs,
            "sample_time_s": series.sample_time,
            "models": [
                {
                    "structure": name, "label": c.model.label, "fit_percent": c.fit_percent,
                    "one_step_percent": c.one_step_percent, "parameters": c.model.parameters,
                    "output_fit_percent": dict(zip(series.outputs, self.output_fits[name], strict=True)),
                    "poles": [[p.real, p.imag] for p in c.model.poles().astype(complex)],
                    "frequency_hz": self.frequency_hz,
                    "gain": np.abs(c.model.response(self.frequency_hz)[0]),
                    "gain_std": c.model.gain_std(self.frequency_hz)[0],
                    "residual_whiteness_p": self.white_p[name],
                    "residual_input_independence_p": self.independent_p[name],
                    "warnings": self.warnings[name],
                }
                for name, c in self.models.items()
            ],
        }  # fmt: skip


def identify(
    recording: Series, structures: Sequence[str] = STRUCTURES,
    orders: dict[str, tuple[int, ...]] | None = None, split: float = 0.5,
) -> MimoReport:  # fmt: skip
    """Estimate, choose and validate.

    Orders are chosen on the last third of the estimation part; the fits in percent are of the held-out data.

    Raises:
        SettingError: a structure that has no several outputs here, or invalid orders.
        RecordingError: an input follows from the others.
    """
    for name in structures:
        if name not in STRUCTURES:
            what = "structure for several inputs or outputs"
            raise SettingError(unknown(what, name, STRUCTURES) + ".", setting="structures")
    whole = replace(recording, u=as_columns(recording.u), y=as_columns(recording.y))
    estimation, validation = whole.split(split)
    state = condition.of([whole])
    notes = (*whole.remarks, *dependent(estimation), *state.warnings())
    models: dict[str, Candidate] = {}
    fits: dict[str, tuple[float, ...]] = {}
    white, independent, warnings = {}, {}, {}
    for name in structures:
        numbers = (orders or {}).get(name) or _chosen(name, estimation, state)
        if len(numbers) != (3 if name == "arx" else 1):
            valid = "3 orders (na, nb, nk)" if name == "arx" else "1 order"
            raise SettingError(f"{name} takes {valid}.", setting="orders")
        is_arx = name == "arx"
        model = arx(estimation, *numbers) if is_arx else space(_factors(estimation, numbers[0]), numbers[0])
        tests, texts = _tested(model, validation, int(state.feedback))
        shape = len(model.C), model.B.shape[1]
        white[name] = np.min(np.reshape([test.white_p for test in tests], shape), axis=1)
        independent[name] = np.reshape([test.cross_p for test in tests], shape)
        reasons = [*failed(tests, "ARX"), *state.no_intervals]
        if is_arx and reasons:
            texts.append(f"no intervals: {'; '.join(reasons)}")
            model = replace(model, std_error=np.full_like(model.std_error, np.nan), spread=NONE)
        if not is_arx and state.feedback:
            texts.append("feedback biases this model")
        models[name], warnings[name] = judge(model, [validation]), (*notes, *model.warnings, *texts)
        pairs = zip(validation.y.T, model.simulate(validation).T, strict=True)
        fits[name] = tuple(criteria.fit_percent(y, s) for y, s in pairs)
    power = np.sum(np.abs(np.fft.rfft(whole.u / whole.u.std(axis=0), axis=0))[1:] ** 2, axis=1)
    strongest = (int(np.argmax(power)) + 1) / (len(whole) * recording.sample_time)
    return MimoReport(estimation, validation, models, fits, white, independent, warnings, strongest)


def dependent(recording: Series) -> list[str]:
    """A sentence on each input that mostly follows from the others, their past and their future.

    Raises:
        RecordingError: it follows entirely, so nothing tells their effects apart.
    """
    notes, reach = [], min(REACH, len(recording) // (20 * len(recording.inputs)))
    for j, name in enumerate(recording.inputs):
        others = np.delete(recording.u, j, axis=1)
        lags = [shifted(u, 2 * reach + 1)[2 * reach :] for u in others.T]
        if not lags:
            break
        phi, target = np.hstack(lags), recording.u[reach : len(recording) - reach, j]
        left = float(np.var(target - phi @ pem.solve([(phi, target)])) / np.var(target))
        rest = ", ".join(repr(other) for other in recording.inputs if other != name)
        if left < FOLLOWS:
            raise RecordingError(
                f"{recording.name}: the input {name!r} follows from {rest}, so their effects cannot "
                "be told apart; leave one out, or move them independently."
            )
        if left < MOSTLY:
            notes.append(
                f"{1 - left:.0%} of the input {name!r} follow from {rest}: their effects are told "
                "apart by the rest alone"
            )
    return notes


def _tested(model: MimoModel, validation: Series, nearest: int) -> tuple[list[ResidualTest], list[str]]:
    """Residual tests of each output with each input on held-out data, and sentences on them."""
    errors, texts, tests = model.residuals(validation), dict[str, None](), []
    noise = model.numbers[0] * (len(model.C) if model.structure == "arx" else 1)
    for pair, error in zip(validation.pairs(), np.repeat(errors, len(validation.inputs), axis=1).T, strict=True):
        u, y = pair.channels
        tests.append(residual_test(error, pair, noise, nearest))
        texts |= dict.fromkeys(tests[-1].warnings(f"residuals of {y}", f"past {u}"))
    return tests, list(texts)


def _factors(recording: Series, order: int) -> subspace.Subspace:
    return subspace.decompose(recording, max(ROWS, order // len(recording.outputs) + 2))


def _chosen(name: str, estimation: Series, state: Condition) -> tuple[int, ...]:
    """Orders of the fewest coefficients among the models that simulate no worse than the best.

    Where simulation cannot serve, those of the least BIC. The delays are the least that any pair of signals has, and
    its neighbours.
    """
    referee = Referee([estimation], state.by_prediction, steps=state.steps, least_delay=int(state.feedback))
    (fitted,), (check,) = referee.fitted, referee.check
    sizes = range(1, LARGEST + 1)
    if name == "arx":
        first = min(search.delay([pair]) for pair in estimation.pairs())
        delays = {max(nk, referee.least_delay) for nk in (first - 1, first, first + 1)}
        trials = [arx(fitted, n, n, nk) for n in sizes for nk in sorted(delays)]
    else:
        factors = _factors(fitted, LARGEST)
        trials = [space(factors, n) for n in sizes]
    if not referee.simulates:
        return min(trials, key=lambda m: float(criteria.bic(m.loss, m.parameters, m.samples))).numbers
    candidates = [judge(model, [check]) for model in trials]
    best = max(candidates, key=lambda c: c.fit_percent)
    near = [c for c in candidates if c is best or c.no_worse_than(best)]
    return min(near, key=lambda c: c.model.parameters).model.numbers
