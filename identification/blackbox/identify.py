"""From recordings to a validated model of each structure: examine, select, test, and report what stays open."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fasbody.exceptions import FasError, SettingError, unknown
from fasbody.presentation import Sheet, Tabled
from identification import criteria
from identification.blackbox import condition, excitation, frequency, narx, nonlinear, pem, search, selection, subspace
from identification.blackbox.candidate import Candidate, judge
from identification.blackbox.condition import Condition
from identification.blackbox.data import ALL, DEFAULT, Series, listed
from identification.blackbox.excitation import Excitation
from identification.blackbox.filters import largest_root
from identification.blackbox.frequency import Rational, Response
from identification.blackbox.polynomial import STRUCTURES, Orders, PolynomialModel
from identification.blackbox.selection import NOISE_MODELS, Referee, Selection, Single
from identification.blackbox.validation import ResidualTest, failed, residual_test

DEGREES = ((3, 1), (1, 3), (3, 3), (5, 3))  # of the Hammerstein-Wiener polynomials tried
WORSE = 4.0  # N times the log of held-out one-step losses by which another noise model refutes one
ON_CIRCLE = 0.999  # root of C from which its errors are no Gaussian: such an interval held 20 %
STRONGLY = 5.0  # times its whitened variance that noise may have before output errors follow it
FEW = 20  # excitation rank up to which a pulse response cannot be estimated
#: Half-widths from a resonance at which its curve is drawn.
AROUND = np.array([-8.0, -4.0, -2.0, -1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0])

#: Structure -> orders in the sequence of Table 3.2; structures not named are selected automatically.
GivenOrders = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class ChosenModel(Tabled):
    """The chosen model of one structure.

    Attributes:
        selection: what was tried.
        test: of its residuals on held-out data.
        response: at the excited frequencies.
        warnings: limits of its validity, for the user.
    """

    selection: Selection
    test: ResidualTest
    response: Response
    warnings: tuple[str, ...]

    @property
    def best(self) -> Candidate:
        """The chosen model with its criteria."""
        return self.selection.best


@dataclass(frozen=True, eq=False)
class Report(Tabled):
    """All structures on one recording, or on several pooled.

    Attributes:
        name: of the recording or the pool.
        estimation: data behind the estimates, means removed.
        validation: held-out data, the estimation means removed.
        excitation: what the estimation input excites.
        condition: spikes, drift, feedback and steps, determined before any model.
        notes: sentences on the condition and on what was done about it.
        models: by structure.
        left_out: leave-one-frequency-out errors of the rational fit, for pools of single sines; else None.
        rational: rational function through the points of such a pool; else None.
        nonparametric: response without a model, where the spectrum is continuous; else None.
        failures: sentences on structures that could not be estimated.
    """

    name: str
    estimation: tuple[Series, ...]
    validation: tuple[Series, ...]
    excitation: Excitation
    condition: Condition
    notes: tuple[str, ...]
    models: Mapping[str, ChosenModel]
    left_out: frequency.LeftOut | None
    rational: Rational | None
    nonparametric: frequency.Points | None
    failures: tuple[str, ...]

    def sheet(self) -> Sheet:
        """The models in one table, and the best of them in one sentence."""
        best = max((m.best for m in self.models.values()), key=lambda c: c.fit_percent)
        label, percent = best.model.label, best.fit_percent
        answer = f"{label} simulates {percent:.1f} % of the held-out output freely."
        if not np.isfinite(best.fit_percent):
            best = max((m.best for m in self.models.values()), key=lambda c: c.one_step_percent)
            answer = (
                f"{best.model.label} predicts {best.one_step_percent:.1f} % one step ahead; none "
                "can be simulated freely."
            )
        columns = (
            "model", "free simulation [%]", "one step [%]", "AIC", "BIC", "coefficients",
            "slowest mode", "alike",
        )  # fmt: skip
        rows, notes = [], [f"{answer} Input: {self.excitation}."]
        notes += ["Fits are of the held-out part, which no choice has seen.", *self.notes]
        notes += self.failures
        for chosen in self.models.values():
            c = chosen.best
            fits = (finite(fit, ".2f", "diverges") for fit in (c.fit_percent, c.one_step_percent))
            mode = _slowest(c.model, self.estimation[0].sample_time)
            counts = str(c.model.parameters), mode, str(len(chosen.selection.alike))
            rows.append((c.model.label, *fits, f"{c.aic:.4f}", f"{c.bic:.4f}", *counts))
            notes += [f"{c.model.label}: {text}" for text in chosen.warnings]
        notes += [str(extra) for extra in (self.rational, self.left_out) if extra]
        return Sheet(self.name, columns, rows, notes)

    def __str__(self) -> str:
        return str(self.sheet())


def identify(
    recordings: Series | Sequence[Series], structures: Sequence[str] = DEFAULT, orders: GivenOrders | None = None,
    split: float = 0.5, step: Callable[[str], Any] = lambda text: None, *, detrend: int = 0, robust: bool = False,
    input_noise: float = 0.0,
) -> Report:  # fmt: skip
    """Estimate, select and validate models of all `structures` from one recording or from several pooled.

    Args:
        recordings: whole recordings; each is split into an estimation and a held-out part, which only validates.
        structures: of "arx", "armax", "oe", "bj", "ss", "hw", "narx".
        orders: of structures whose orders are not to be selected.
        split: fraction used for estimation and for the choice of orders.
        step: called with what is about to begin.
        detrend: degree of the polynomials in time that are taken off input and output; 0 for the means.
        robust: replace single wrong samples of the output.
        input_noise: RMS noise of the input's sensor, whose effect widens intervals.

    Raises:
        FasError: the recordings cannot be used, or no structure could be estimated.
    """
    for name in structures:
        if name not in ALL:
            raise SettingError(unknown("structure", name, ALL) + ".", setting="structures")
    pooled = listed(recordings)
    notes = [remark for series in pooled for remark in series.remarks]
    if robust:
        repaired = [condition.mend(series.centred()) for series in pooled]
        count = sum(len(where) for _, where in repaired)
        notes.append(f"outliers replaced in the output: {count}" if count else "no outliers were found")
        pooled = [series for series, _ in repaired]
    if detrend:
        pooled = [condition.detrend(series, detrend) for series in pooled]
    parts = [series.split(split) for series in pooled]
    step("excitation")
    seen = excitation.examine([first for first, _ in parts])
    state = condition.of(pooled)
    notes += state.warnings()
    referee = Referee(
        [first for first, _ in parts], state.by_prediction, weak=seen.rank <= FEW, steps=state.steps,
        least_delay=int(state.feedback),
    )  # fmt: skip
    chooser = _Chooser(referee, [second for _, second in parts], orders or {}, step, state)
    failures = []
    for name in structures:
        try:
            chooser.select(name)
        except FasError as error:
            if len(structures) == 1:
                raise
            failures.append(f"{name}: {error}")
    models = {name: _judge(chooser.done[name], chooser, seen) for name in structures if name in chooser.done}
    if not models:
        raise SettingError("; ".join(failures))
    places = shown_frequencies(seen, [m.best.model for m in models.values()], pooled[0].sample_time)
    if input_noise:
        taken = excitation.attenuation(referee.estimation, input_noise)
        models = {n: replace(m, selection=replace(m.selection, attenuation=taken)) for n, m in models.items()}
    models = {name: replace(m, response=m.selection.curve(places)) for name, m in models.items()}
    if not input_noise and any(np.isfinite(m.response.gain_std).all() for m in models.values()):
        notes.append("intervals take the input as measured without noise; --input-noise RMS widens them")
    rational, left_out = _through_points(pooled)
    continuous = not (seen.lines or seen.single_sine)
    band = seen.band_hz[0], seen.band_hz[-1]
    free = frequency.local(referee.estimation, shown_frequencies(seen), band) if continuous else None
    title = pooled[0].name if len(pooled) == 1 else f"{len(pooled)} recordings pooled"
    return Report(
        title, tuple(referee.estimation), tuple(chooser.validation), seen, state, tuple(notes), models, left_out,
        rational, free, tuple(failures),
    )  # fmt: skip


class _Chooser:
    """Selections of all structures on the same data; the later ones build on the orders of ARX and OE."""

    def __init__(
        self, referee: Referee, validation: list[Series], orders: GivenOrders, step: Callable[[str], Any],
        state: Condition,
    ) -> None:  # fmt: skip
        self.referee, self.validation = referee, validation
        self.orders, self.step, self.state = orders, step, state
        self.done: dict[str, Selection] = {}

    def select(self, name: str) -> Selection:
        """The selection of one structure, made once."""
        if name not in self.done:
            self.step(name)
            self.done[name] = self._select(name)
        return self.done[name]

    @cached_property
    def delays(self) -> tuple[int, ...]:
        """Delays n_k that compete: the one read off and its neighbours.

        None is below the least: a controller leaves one sample.
        """
        delay = search.delay(self.referee.estimation, far=not self.referee.weak)
        least = self.referee.least_delay
        return tuple(sorted({max(nk, least) for nk in (delay - 1, delay, delay + 1)}))

    def predicts_better(self, model: Single) -> str:
        """The noise model that predicts held-out data a step ahead decisively better than this one; empty for none."""
        losses = {
            chosen.best.model.label: _log_loss(chosen.best.model, self.validation)
            for name, chosen in self.done.items() if name in NOISE_MODELS
        }
        best = min(losses, key=lambda label: losses[label])
        return best if _log_loss(model, self.validation) - losses[best] > WORSE else ""

    def follows_noise(self, model: Single) -> bool:
        """Whether the simulation errors are so strongly coloured that the plant is partly a model of them."""
        errors = [series.y - model.simulate(series) for series in self.referee.estimation]
        return STRONGLY * criteria.whitened_variance(errors) < np.mean(np.concatenate(errors) ** 2)

    def _model(self, name: str) -> PolynomialModel:
        return self.select(name).best.model

    def _select(self, name: str) -> Selection:
        referee = self.referee
        if name in self.orders:
            return Selection((judge(self._given(name, self.orders[name]), self.validation),), 1, (), ())
        if name == "arx":
            return search.select_arx(referee, self.delays)
        if name == "oe":
            return search.select_oe(referee, self.delays)
        if name == "armax":
            from_oe = None if self.state.unstable else self._model("oe").orders
            return search.select_armax(referee, self._model("arx").orders, from_oe)
        if name == "bj":
            return search.select_bj(referee, self._model("oe"), self.delays)
        if name == "ss":
            return search.select_state_space(referee)
        if name == "hw":
            return self._hammerstein_wiener()
        return self._narx()

    def _narx(self) -> Selection:
        """The delay that simulates best; its coefficients from all data for the choice."""
        referee = self.referee
        tried = [narx.estimate(referee.fitted, referee.check, nk=nk) for nk in self.delays]
        best, *others = sorted(tried, key=lambda c: -c.fit_percent)
        whole = narx.refine(best.model, referee.estimation)
        alike = tuple((1.0, c.model) for c in others if c.no_worse_than(best))
        count = narx.LARGEST_TERMS * len(tried)
        return Selection((replace(best, model=whole), *others), count, (whole.label,), (), alike)

    def _hammerstein_wiener(self) -> Selection:
        referee, linear = self.referee, self._model("oe")
        levels = min(nonlinear.levels(series.u) for series in referee.estimation)
        degrees = [(p, q) for p, q in DEGREES if p < levels]
        models = [nonlinear.estimate(referee.fitted, linear.orders, d, linear) for d in degrees]
        fewer = [f"the input has {levels:g} levels: no input polynomial of that degree or more is tried"]
        chosen = selection.rank([referee.judge(m) for m in models], referee, 0, fewer * (len(degrees) < len(DEGREES)))
        best: nonlinear.HammersteinWiener = chosen.best.model
        whole = nonlinear.estimate(referee.estimation, linear.orders, best.degrees, linear)
        return replace(chosen, candidates=(replace(chosen.best, model=whole), *chosen.candidates[1:]))

    def _given(self, name: str, numbers: tuple[int, ...]) -> Single:
        estimation = self.referee.estimation
        if name in STRUCTURES:
            return pem.estimate(name, estimation, Orders.of(name, numbers))
        if name == "ss" and len(numbers) == 1:
            return subspace.estimate(estimation, numbers[0], refine=True)
        if name == "hw" and len(numbers) == 5:
            return nonlinear.estimate(estimation, Orders.of("oe", numbers[:3]), (numbers[3], numbers[4]))
        valid = {"ss": "1 order", "hw": "5 orders (nb, nf, nk, input degree, output degree)", "narx": "no orders"}
        takes = valid.get(name, "no orders")
        raise SettingError(f"{name} takes {takes}, not {len(numbers)}.", setting="orders")


def _judge(chosen: Selection, chooser: _Chooser, seen: Excitation) -> ChosenModel:
    """The chosen model on the held-out data, which no choice depends on."""
    model = chosen.best.model
    noise = sum(getattr(getattr(model, "orders", None), key, 0) for key in ("na", "nc", "nd"))
    least = chooser.referee.least_delay
    tests = [residual_test(model.residuals(series), series, noise, least) for series in chooser.validation]
    test = min(tests, key=lambda t: min(t.cross_p, t.white_p))
    warnings = [*model.warnings, *chosen.warnings]
    if len(chosen.delays) > 1:
        warnings.append(f"the delay is not determined: n_k = {' or '.join(map(str, chosen.delays))} fit equally well")
    why = _no_intervals(model, tests, chooser)
    if why:
        warnings.append(f"no standard errors or band: {why}")
        model = _without_intervals(model)
    judged = judge(model, chooser.validation)
    chosen = replace(chosen, candidates=(judged, *chosen.candidates[1:]))
    plant = len(model.poles()) + len(model.zeros()) + 1  # the coefficients of a proper B/F
    guard = seen.warning(plant) if model.structure != "narx" else ""
    if guard:
        warnings.insert(0, guard)
    if all(np.ptp(series.u) == 0.0 for series in chooser.validation):
        warnings.append(
            "the input is constant in the held-out part, so the fit judges a free motion and noise there; a larger "
            "--split holds out less"
        )
    if not np.isfinite(chosen.best.fit_percent):
        warnings.append("free simulation diverges, so there is no fit")
    elif chosen.best.fit_percent < 0:
        warnings.append("the mean fits the held-out part better: the plant may have changed since the first part")
    return ChosenModel(chosen, test, model.response([]), (*warnings, *test.warnings()))


def _log_loss(model: Single, recordings: Sequence[Series]) -> float:
    errors = np.concatenate([model.residuals(series) for series in recordings])
    return float(len(errors) * np.log(max(float(np.mean(errors**2)), 1e-300)))


def _no_intervals(model: Single, tests: Sequence[ResidualTest], chooser: _Chooser) -> str:
    """Every reason why the standard errors of a model would mislead, or an empty string."""
    name, state, white = model.structure.upper(), chooser.state, model.structure in NOISE_MODELS
    better = chooser.predicts_better(model) if white else ""
    reasons = failed(tests, name if white else "")
    if state.feedback and not (white or state.leads):
        reasons.insert(0, f"{name} has no noise model, so feedback biases it")
    if isinstance(model, PolynomialModel) and largest_root(model.polynomials[2]) > ON_CIRCLE:
        reasons.append("a zero of the noise model lies on the unit circle, where no linearisation holds")
    if better:
        reasons.append(f"{better} predicts the held-out part better, so the noise is not that of {name}")
    if not white and chooser.follows_noise(model):
        reasons.append(f"the errors of {name} are so strongly coloured that it follows them; BJ models them")
    return "; ".join([*reasons, *state.no_intervals])


def _without_intervals(model: Any) -> Any:
    if isinstance(model, PolynomialModel):
        return model.without_intervals()
    for part in ("transfer", "linear"):
        if hasattr(model, part):
            return replace(model, **{part: getattr(model, part).without_intervals()})
    return model


def shown_frequencies(
    seen: Excitation, models: Sequence[Single] = (), sample_time: float = 1.0, count: int = 60
) -> np.ndarray:
    """Frequencies [Hz] at which a response is drawn: the excited ones, and those around the poles of `models`.

    Without the latter a sharp resonance falls between two points and is drawn too low.
    """
    if seen.single_sine:
        return seen.frequency_hz * np.array(seen.harmonics)
    if seen.lines:
        return seen.band_hz
    low, high = seen.band_hz[0], seen.band_hz[-1]
    grid = np.geomspace(low, high, count)
    nearest = np.searchsorted(seen.band_hz, np.sqrt(grid[1:] * grid[:-1]))
    frequencies = [seen.band_hz[np.unique(np.clip(nearest, 0, len(seen.band_hz) - 1))]]
    places: list[complex] = []
    for pole in np.concatenate([[], *(model.poles() for model in models)]):
        s = np.log(complex(pole)) / (2 * np.pi * sample_time) if pole else 0j
        known = any(abs(s - other) < 0.2 * abs(other.real) for other in places)
        if low < s.imag < high and abs(s.real) < 0.3 * s.imag and not known:
            places.append(s)
            frequencies.append(s.imag + abs(s.real) * AROUND)
    every = np.unique(np.concatenate(frequencies))
    return every[(every >= low) & (every <= high)]


def _through_points(pooled: Sequence[Series]) -> tuple[Rational | None, frequency.LeftOut | None]:
    """The rational fit and its leave-one-frequency-out errors when there are enough single sines."""
    sines = [series for series in pooled if excitation.single_sine(series)[1]]
    if len(sines) < 5:
        return None, None
    data = frequency.points([series.centred() for series in sines])
    if len(data) < 5:
        return None, None
    return frequency.rational(data), frequency.leave_one_out(data)


def finite(value: float, form: str, otherwise: str) -> str:
    """A number as a format has it, or what stands for one that is not finite."""
    return format(value, form) if np.isfinite(value) else otherwise


def _slowest(model: Single, sample_time: float) -> str:
    """Frequency and damping of the mode nearest to the unit circle."""
    poles = model.poles()
    if not len(poles) or not np.abs(poles).max() > 0:
        return "–"
    s = np.log(complex(poles[np.argmax(np.abs(poles))])) / sample_time
    if abs(s.imag) * sample_time < 1e-9:
        return f"{1 / max(-s.real, 1e-300):.3g} s"
    return f"{abs(s) / 2 / np.pi:.4g} Hz, damping {100 * -s.real / abs(s):.2g} %"
