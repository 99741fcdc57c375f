"""Several inputs and outputs: state-space models by the subspace method, and ARX."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from fasbody.exceptions import SettingError, unknown
from identification.blackbox import criteria, pem, subspace
from identification.blackbox.data import Series
from identification.blackbox.filters import as_columns
from identification.blackbox.polynomial import Orders
from identification.blackbox.selection import FITTED, Candidate, judge
from identification.blackbox.state_space import StateSpace

STRUCTURES = ("arx", "ss")
LARGEST = 10  # order up to which models are tried
ROWS = 12  # block rows of the subspace method; more than the largest order over one output


@dataclass(frozen=True, eq=False)
class MimoModel(StateSpace):
    """A model with m inputs and p outputs.

    Attributes:
        A: (n, n).
        B: (n, m).
        C: (p, n).
        D: (p, m).
        K: (n, p).
        noise: covariance of e, shape (p, p).
        loss: mean squared one-step error over the outputs, each over its variance.
        samples: rows behind it.
        sample_time: seconds.
        structure: ss or arx.
        numbers: order of ss; n_a, n_b, n_k of arx.
        theta: ARX coefficients, one column an output: n_a p of past outputs (with a minus), then
            n_b m of inputs. It is empty for ss, whose basis is arbitrary.
        std_error: of `theta`, the same shape.
        warnings: sentences for the user.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    K: np.ndarray
    noise: np.ndarray
    loss: float
    samples: int
    sample_time: float
    structure: str
    numbers: tuple[int, ...]
    theta: np.ndarray
    std_error: np.ndarray
    warnings: tuple[str, ...] = field(default=())

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
    root = np.linalg.norm(inverse, axis=1) / scale
    theta, std_error = theta[:count], root[:count, None] * np.sqrt(np.diag(noise))
    past_y = theta[: na * p].reshape(p, na, p).transpose(1, 2, 0)  # [lag, output, from output]
    past_u = theta[na * p :].reshape(m, nb, p).transpose(1, 2, 0)
    a = np.concatenate([past_y, np.zeros((size - na, p, p))])
    late = max(size + 1 - nk - nb, 0)
    b = np.concatenate([np.zeros((nk, p, m)), past_u, np.zeros((late, p, m))])
    A = np.eye(size * p, k=p)
    A[:, :p] -= a.reshape(size * p, p)
    B, K = (b[1:] - a @ b[0]).reshape(size * p, m), -a.reshape(size * p, p)
    return MimoModel(
        A, B, np.eye(p, size * p), b[0], K, noise, _loss(errors, recording.y), len(phi),
        recording.sample_time, "arx", (na, nb, nk), theta, std_error,
    )  # fmt: skip


def space(factors: subspace.Subspace, order: int) -> MimoModel:
    """The state-space model of `order` states from a factorisation of one recording."""
    recording = factors.recordings[0]
    A, C, warnings = factors.observed(order)
    B, D, K = factors.driven_by(A, C)
    blank, p = np.zeros((0, 0)), len(C)

    def model(noise: np.ndarray, loss: float) -> MimoModel:
        return MimoModel(
            A, B, C, D, K, noise, loss, len(recording), recording.sample_time, "ss", (order,),
            blank, blank, tuple(warnings),
        )  # fmt: skip

    errors = model(np.eye(p), np.nan).residuals(recording)
    return model(errors.T @ errors / len(errors), _loss(errors, recording.y))


@dataclass(frozen=True, eq=False)
class MimoReport:
    """Models of several inputs and outputs.

    Attributes:
        estimation: data behind the estimates and the choice of orders.
        validation: held out.
        models: structure -> model, with its fits over all outputs of the held-out data.
        output_fits: structure -> fit [%] of each output in free simulation.
    """

    estimation: Series
    validation: Series
    models: dict[str, Candidate]
    output_fits: dict[str, tuple[float, ...]]

    def __str__(self) -> str:
        inputs, outputs = self.estimation.inputs, self.estimation.outputs
        rows = [f"{self.estimation.name}: {', '.join(inputs)} to {', '.join(outputs)}"]
        for name, candidate in self.models.items():
            parts = zip(outputs, self.output_fits[name], strict=True)
            fits = ", ".join(f"{output} {fit:.2f} %" for output, fit in parts)
            rows += [f"  {candidate.model.label}: {fits}"]
            rows += [f"    {text}" for text in candidate.model.warnings]
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
                    "output_fit_percent": dict(
                        zip(series.outputs, self.output_fits[name], strict=True)
                    ),
                    "poles": [[p.real, p.imag] for p in c.model.poles().astype(complex)],
                    "warnings": c.model.warnings,
                }
                for name, c in self.models.items()
            ],
        }  # fmt: skip


def identify(
    recording: Series, structures: Sequence[str] = STRUCTURES,
    orders: dict[str, tuple[int, ...]] | None = None, split: float = 0.5,
) -> MimoReport:  # fmt: skip
    """Estimate, choose and validate.

    Orders are chosen on the last third of the estimation part; the fits in percent are of the
    held-out data.

    Raises:
        SettingError: a structure that has no several outputs here, or invalid orders.
    """
    for name in structures:
        if name not in STRUCTURES:
            what = "structure for several inputs or outputs"
            raise SettingError(unknown(what, name, STRUCTURES) + ".")
    u, y = as_columns(recording.u), as_columns(recording.y)
    estimation, validation = replace(recording, u=u, y=y).split(split)
    models: dict[str, Candidate] = {}
    fits: dict[str, tuple[float, ...]] = {}
    for name in structures:
        numbers = (orders or {}).get(name) or _chosen(name, estimation)
        if len(numbers) != (3 if name == "arx" else 1):
            valid = "3 orders (na, nb, nk)" if name == "arx" else "1 order"
            raise SettingError(f"{name} takes {valid}.")
        model = arx(estimation, *numbers) if name == "arx" else _space(estimation, *numbers)
        models[name] = judge(model, [validation])
        simulated = model.simulate(validation)
        pairs = zip(validation.y.T, simulated.T, strict=True)
        fits[name] = tuple(criteria.fit_percent(y, s) for y, s in pairs)
    return MimoReport(estimation, validation, models, fits)


def _factors(recording: Series, order: int) -> subspace.Subspace:
    return subspace.decompose(recording, max(ROWS, order // len(recording.outputs) + 2))


def _space(recording: Series, order: int) -> MimoModel:
    if not 1 <= order <= 40:
        raise SettingError(f"state-space order {order} is not between 1 and 40.")
    return space(_factors(recording, order), order)


def _chosen(name: str, estimation: Series) -> tuple[int, ...]:
    """Orders of the fewest coefficients among the models that simulate no worse than the best."""
    middle = round(FITTED * len(estimation))
    fitted, check = estimation.cut(0, middle), estimation.cut(middle, len(estimation))
    sizes = range(1, LARGEST + 1)
    if name == "arx":
        trials = [arx(fitted, n, n, nk) for n in sizes for nk in (0, 1)]
    else:
        factors = _factors(fitted, LARGEST)
        trials = [space(factors, n) for n in sizes]
    candidates = [judge(model, [check]) for model in trials]
    best = max(candidates, key=lambda c: c.fit_percent)
    near = [c for c in candidates if c is best or c.no_worse_than(best)]
    return min(near, key=lambda c: c.model.parameters).model.numbers
