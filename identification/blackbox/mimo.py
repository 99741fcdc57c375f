"""Several inputs and outputs: state-space models by the subspace method, and ARX, both in innovations form."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, signal

from fasbody.exceptions import RecordingError, SettingError, unknown
from identification.blackbox import criteria, subspace
from identification.blackbox.data import SHORTEST, Series, not_finite, split_point
from identification.blackbox.filters import shifted
from identification.blackbox.polynomial import control_package
from identification.blackbox.selection import BLOCKS, FITTED, Candidate

STRUCTURES = ("arx", "ss")
LARGEST = 10  # order up to which models are tried
ROWS = 12  # block rows of the subspace method; more than the largest order over one output
LONG = 15  # lags of the ARX model whose errors stand for e(t)


@dataclass(frozen=True, eq=False)
class Channels:
    """One recording of several inputs and outputs.

    Attributes:
        u: inputs, shape (N, m).
        y: outputs, shape (N, p).
        sample_time: seconds.
        name: what to call it.
        inputs: names of the inputs.
        outputs: names of the outputs.

    Raises:
        RecordingError: a signal is not finite or does nothing; lengths differ.
    """

    u: np.ndarray
    y: np.ndarray
    sample_time: float
    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check the whole through its pairs: each first input with each output, and the other inputs."""
        if len(self.u) < SHORTEST:
            raise RecordingError(f"{self.name}: {len(self.u)} samples are too few; at least {SHORTEST} are needed.")
        names = (*self.inputs, *self.outputs)
        if len({*names}) < len(names):
            raise RecordingError(f"{self.name}: a signal is named twice in {', '.join(names)}; name each once.")
        for label, values in zip(names, (*self.u.T, *self.y.T), strict=True):
            if problem := not_finite(label, values):
                raise RecordingError(f"{self.name}: {problem}.")
            if np.ptp(values) <= 1e-12 * np.abs(values).max(initial=1e-300):
                raise RecordingError(f"{self.name}: {label} is constant; leave it out.")

    def __len__(self) -> int:
        return len(self.u)

    @classmethod
    def of(cls, pairs: Sequence[Sequence[Series]]) -> Self:
        """From series of each output (rows) to each input (columns) of one file."""
        first = pairs[0][0]
        return cls(
            np.column_stack([one.u for one in pairs[0]]), np.column_stack([row[0].y for row in pairs]),
            first.sample_time, first.name, tuple(one.channels[0] for one in pairs[0]),
            tuple(row[0].channels[1] for row in pairs),
        )  # fmt: skip

    def cut(self, start: int, stop: int) -> Self:
        """The samples from `start` up to, not including, `stop`."""
        return replace(self, u=self.u[start:stop], y=self.y[start:stop])

    def split(self, fraction: float) -> tuple[Self, Self]:
        """The first `fraction` and the rest, both less the means of the first.

        Raises:
            SettingError: `fraction` leaves one part shorter than any model needs.
        """
        middle = split_point(len(self), fraction)
        centred = replace(self, u=self.u - self.u[:middle].mean(axis=0), y=self.y - self.y[:middle].mean(axis=0))
        return centred.cut(0, middle), centred.cut(middle, len(self))


@dataclass(frozen=True, eq=False)
class MimoModel:
    """x(t+1) = A x + B u + K e, y = C x + D u + e, with m inputs and p outputs.

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
        theta: ARX coefficients, one column an output: n_a p of past outputs (with a minus), then n_b m of inputs.
            It is empty for ss, whose basis is arbitrary.
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

    def poles(self) -> np.ndarray:
        """Eigenvalues of A, shape (n,)."""
        return np.linalg.eigvals(self.A)

    def response(self, frequency_hz: ArrayLike) -> np.ndarray:
        """Frequency response, shape (M, p, m)."""
        z = np.exp(2j * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=float)) * self.sample_time)
        inside = np.linalg.solve(z[:, None, None] * np.eye(len(self.A)) - self.A, self.B.astype(complex)[None])
        return self.C @ inside + self.D

    def simulate(self, u: Channels | ArrayLike, x0: ArrayLike = 0.0) -> np.ndarray:
        """Free simulation, shape (N, p); of a recording with initial state and level that fit best.

        Args:
            u: inputs (N, m), or a recording.
            x0: state at the first sample of inputs alone, shape (n,).
        """
        if not isinstance(u, Channels):
            values = np.asarray(u, dtype=float)
            return _run(self.A, self.B, self.C, values, np.broadcast_to(x0, len(self.A))) + values @ self.D.T
        if np.abs(self.poles()).max(initial=0.0) >= 1.0:
            return np.full(u.y.shape, np.inf)
        return _fitted(self.A, self.C, u.y, _run(self.A, self.B, self.C, u.u) + u.u @ self.D.T)

    def residuals(self, recording: Channels) -> np.ndarray:
        """One-step prediction errors (N, p), initial state fitted."""
        observer = self.A - self.K @ self.C
        gain = np.hstack([self.B - self.K @ self.D, self.K])
        drive = np.hstack([recording.u, recording.y])
        seen = _run(observer, gain, self.C, drive) + recording.u @ self.D.T
        return recording.y - _fitted(observer, self.C, recording.y, seen)

    def to_state_space(self) -> Any:
        """The plant as `scipy.signal.StateSpace`."""
        return signal.StateSpace(self.A, self.B, self.C, self.D, dt=self.sample_time)

    def to_control(self, part: str = "plant") -> Any:
        """The plant, or with "noise" the way from e to y, as a python-control `StateSpace`."""
        parts = {"plant": (self.B, self.D), "noise": (self.K, np.eye(len(self.C)))}
        if part not in parts:
            raise SettingError(unknown("part", part, parts) + ".")
        return control_package().StateSpace(self.A, parts[part][0], self.C, parts[part][1], self.sample_time)


def _run(A: np.ndarray, B: np.ndarray, C: np.ndarray, u: np.ndarray, x0: np.ndarray | float = 0.0) -> np.ndarray:
    """C x(t) of x(t+1) = A x + B u, shape (N, p)."""
    out, state = np.empty((len(u), len(C))), np.broadcast_to(np.asarray(x0, dtype=float), len(A))
    for t, drive in enumerate(u @ B.T):
        out[t] = C @ state
        state = A @ state + drive
    return out


def _free(A: np.ndarray, C: np.ndarray, length: int) -> np.ndarray:
    """Outputs from unit initial states, and a level of each output, shape (length p, n + p)."""
    p, n = C.shape
    rows, power = np.empty((length, p, n + p)), C
    for t in range(length):
        rows[t, :, :n] = power
        power = power @ A
    rows[:, :, n:] = np.eye(p)
    return rows.reshape(length * p, n + p)


def _fitted(A: np.ndarray, C: np.ndarray, y: np.ndarray, forced: np.ndarray) -> np.ndarray:
    """`forced` with the free motion and levels that fit y (N, p) best."""
    free = _free(A, C, len(y))
    start = linalg.lstsq(free, (y - forced).ravel(), cond=1e-10, check_finite=False)[0]
    return forced + (free @ start).reshape(y.shape)


def arx(recording: Channels, na: int, nb: int, nk: int) -> MimoModel:
    """ARX by least squares, one regression an output, all with the same regressors.

    Raises:
        SettingError: more coefficients than samples.
    """
    p, m = recording.y.shape[1], recording.u.shape[1]
    first = max(na, nk + nb - 1)
    count = na * p + nb * m
    if min(na, nb - 1, nk) < 0 or len(recording) - first < 2 * (count + 1):
        raise SettingError(
            f"arx={na},{nb},{nk} with {m} inputs and {p} outputs cannot be estimated from {len(recording)} samples; "
            "n_b is at least 1, and a model has at most half as many coefficients as there are samples."
        )
    past = [-shifted(y, na, 1) for y in recording.y.T] + [shifted(u, nb, nk) for u in recording.u.T]
    phi = np.column_stack([*past, np.ones(len(recording))])[first:]
    scale = np.linalg.norm(phi, axis=0)
    theta, _, _, _ = linalg.lstsq(phi / scale, recording.y[first:], cond=1e-12, check_finite=False)
    errors = recording.y[first:] - phi / scale @ theta
    noise = errors.T @ errors / (len(phi) - phi.shape[1])
    inverse = np.linalg.pinv(linalg.qr(phi / scale, mode="r")[0][: phi.shape[1]])
    root = np.linalg.norm(inverse, axis=1) / scale
    std_error = root[:count, None] * np.sqrt(np.diag(noise))
    theta = (theta / scale[:, None])[:count]
    past_y = theta[: na * p].reshape(p, na, p).transpose(1, 2, 0)  # [lag, output, from output]
    past_u = theta[na * p :].reshape(m, nb, p).transpose(1, 2, 0)
    size = max(na, nk + nb - 1, 1)
    a = np.concatenate([past_y, np.zeros((size - na, p, p))])
    b = np.concatenate([np.zeros((nk, p, m)), past_u, np.zeros((max(size + 1 - nk - nb, 0), p, m))])
    A = np.eye(size * p, k=p)
    A[:, :p] -= a.reshape(size * p, p)
    D = b[0]
    B = (b[1:] - a @ D).reshape(size * p, m)
    loss = float(np.mean(errors**2 / recording.y.var(axis=0)))
    return MimoModel(
        A, B, np.eye(p, size * p), D, -a.reshape(size * p, p), noise, loss, len(phi), recording.sample_time, "arx",
        (na, nb, nk), theta, std_error,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Subspace:
    recording: Channels
    left: np.ndarray
    values: np.ndarray
    errors: np.ndarray

    @classmethod
    def of(cls, recording: Channels, rows: int) -> Self:
        """PO-MOESP: future outputs on the past, future inputs projected out."""
        columns = 2 * rows * (recording.u.shape[1] + recording.y.shape[1])
        if len(recording) - 2 * rows + 1 < columns:
            raise SettingError(f"a subspace estimate needs more than {columns + 2 * rows} samples; record longer.")
        left, values = subspace.projected([(recording.u, recording.y)], rows)
        lags = min(LONG, len(recording) // (4 * (recording.u.shape[1] + recording.y.shape[1])))
        long = arx(recording, lags, lags + 1, 0)
        return cls(recording, left, values, long.residuals(recording))

    def model(self, order: int) -> MimoModel:
        """The model of `order` states; B, D, K and the initial state by one least-squares problem in simulation."""
        recording, p, m = self.recording, self.recording.y.shape[1], self.recording.u.shape[1]
        gamma = self.left[:, :order] * np.sqrt(self.values[:order])
        C, A = gamma[:p], linalg.lstsq(gamma[:-p], gamma[p:])[0]
        inside = np.abs(np.linalg.eigvals(A)).max()
        warnings: tuple[str, ...] = ()
        if inside >= 0.9999:
            A = A * (0.999 / inside)
            warnings = (f"A was scaled to be stable: its largest pole {inside:.4f} moved to 0.999",)
        drive = np.hstack([recording.u, self.errors])
        width = order * drive.shape[1]
        state, columns = np.zeros((order, width)), np.empty((len(recording), p, width))
        for t, now in enumerate(drive):
            columns[t] = C @ state
            state = A @ state + np.kron(now, np.eye(order))
        direct = np.einsum("tm,pq->tpqm", recording.u, np.eye(p)).reshape(len(recording), p, p * m)
        phi = np.concatenate([columns, direct], axis=2).reshape(len(recording) * p, -1)
        phi = np.hstack([phi, _free(A, C, len(recording))])
        weight = np.tile(1.0 / recording.y.std(axis=0), len(recording))
        target = (recording.y - self.errors).ravel()
        theta = linalg.lstsq(phi * weight[:, None], target * weight, cond=1e-12, check_finite=False)[0]
        gains = theta[:width].reshape(drive.shape[1], order).T
        B, K, D = gains[:, :m], gains[:, m:], theta[width : width + p * m].reshape(p, m)
        if np.abs(np.linalg.eigvals(A - K @ C)).max() >= 1.0:
            K = np.zeros_like(K)
        blank = np.zeros((0, 0))
        model = MimoModel(
            A, B, C, D, K, np.eye(p), np.nan, len(recording), recording.sample_time, "ss", (order,), blank, blank,
            warnings,
        )  # fmt: skip
        errors = model.residuals(recording)
        loss = float(np.mean(errors**2 / recording.y.var(axis=0)))
        return replace(model, noise=errors.T @ errors / len(errors), loss=loss)


def judge(model: MimoModel, recording: Channels) -> Candidate:
    """The model on a recording: fits over all outputs, each in the unit of its standard deviation."""
    scale = recording.y.std(axis=0)
    measured = (recording.y - recording.y.mean(axis=0)) / scale
    error = (recording.y - model.simulate(recording)) / scale
    one_step = model.residuals(recording) / scale
    blocks = np.array([np.mean(part**2) for part in np.array_split(error, BLOCKS)])
    fits = [criteria.fit_percent(measured.ravel(), (measured - e).ravel()) for e in (error, one_step)]
    return Candidate(model, fits[0], blocks, fits[1])  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class MimoReport:
    """Models of several inputs and outputs.

    Attributes:
        estimation: data behind the estimates and the choice of orders.
        validation: held out.
        models: structure -> model, with its fits over all outputs of the held-out data.
        output_fits: structure -> fit [%] of each output in free simulation.
    """

    estimation: Channels
    validation: Channels
    models: dict[str, Candidate]
    output_fits: dict[str, tuple[float, ...]]

    def __str__(self) -> str:
        rows = [f"{self.estimation.name}: {', '.join(self.estimation.inputs)} to {', '.join(self.estimation.outputs)}"]
        for name, candidate in self.models.items():
            parts = zip(self.estimation.outputs, self.output_fits[name], strict=True)
            rows.append(f"  {candidate.model.label}: " + ", ".join(f"{output} {fit:.2f} %" for output, fit in parts))
            rows += [f"    {text}" for text in candidate.model.warnings]
        return "\n".join(rows)

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        return {
            "recording": self.estimation.name, "inputs": self.estimation.inputs, "outputs": self.estimation.outputs,
            "sample_time_s": self.estimation.sample_time,
            "models": [
                {
                    "structure": name, "label": candidate.model.label, "fit_percent": candidate.fit_percent,
                    "one_step_percent": candidate.one_step_percent, "parameters": candidate.model.parameters,
                    "output_fit_percent": dict(zip(self.estimation.outputs, self.output_fits[name], strict=True)),
                    "poles": [[pole.real, pole.imag] for pole in np.asarray(candidate.model.poles(), dtype=complex)],
                    "warnings": candidate.model.warnings,
                }
                for name, candidate in self.models.items()
            ],
        }  # fmt: skip


def identify(
    recording: Channels, structures: Sequence[str] = STRUCTURES, orders: dict[str, tuple[int, ...]] | None = None,
    split: float = 0.5,
) -> MimoReport:  # fmt: skip
    """Estimate, choose and validate.

    Orders are chosen on the last third of the estimation part; the fits in percent are of the
    held-out data.

    Raises:
        SettingError: a structure that has no several outputs here, or invalid orders.
    """
    for name in structures:
        if name not in STRUCTURES:
            raise SettingError(unknown("structure for several inputs or outputs", name, STRUCTURES) + ".")
    estimation, validation = recording.split(split)
    middle = round(FITTED * len(estimation))
    fitted, check = estimation.cut(0, middle), estimation.cut(middle, len(estimation))
    models: dict[str, Candidate] = {}
    fits: dict[str, tuple[float, ...]] = {}
    for name in structures:
        numbers = (orders or {}).get(name) or _choose(name, fitted, check)
        if len(numbers) != (3 if name == "arx" else 1):
            raise SettingError(f"{name} takes {'3 orders (na, nb, nk)' if name == 'arx' else '1 order'}.")
        model = arx(estimation, *numbers) if name == "arx" else _space(estimation, numbers[0]).model(numbers[0])
        models[name] = judge(model, validation)
        simulated = model.simulate(validation)
        fits[name] = tuple(criteria.fit_percent(y, s) for y, s in zip(validation.y.T, simulated.T, strict=True))
    return MimoReport(estimation, validation, models, fits)


def _space(recording: Channels, order: int) -> _Subspace:
    if not 1 <= order <= 40:
        raise SettingError(f"state-space order {order} is not between 1 and 40.")
    return _Subspace.of(recording, max(ROWS, order // recording.y.shape[1] + 2))


def _choose(name: str, fitted: Channels, check: Channels) -> tuple[int, ...]:
    """Orders with the fewest coefficients among those that simulate no worse than the best; n_a = n_b for ARX."""
    if name == "arx":
        trials = [arx(fitted, n, n, nk) for n in range(1, LARGEST + 1) for nk in (0, 1)]
    else:
        factors = _space(fitted, LARGEST)
        trials = [factors.model(n) for n in range(1, LARGEST + 1)]
    candidates = [judge(model, check) for model in trials]
    best = max(candidates, key=lambda c: c.fit_percent)
    near = [c for c in candidates if c is best or c.no_worse_than(best)]
    return min(near, key=lambda c: c.model.parameters).model.numbers  # type: ignore[union-attr]
