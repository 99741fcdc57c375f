"""From recordings to a judged model of each structure: examine, select, test, and say what the data cannot tell."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fasbody.exceptions import FasError, SettingError, unknown
from identification.blackbox import excitation, frequency, narx, nonlinear, pem, selection, subspace
from identification.blackbox.data import ALL, DEFAULT, Series
from identification.blackbox.excitation import Excitation
from identification.blackbox.frequency import Rational, Response
from identification.blackbox.polynomial import STRUCTURES, Orders, PolynomialModel
from identification.blackbox.selection import Candidate, Selection
from identification.blackbox.validation import ALARM, ResidualTest, residual_test

DEGREES = ((3, 1), (1, 3), (3, 3), (5, 3))  # of the Hammerstein-Wiener polynomials tried
WHITE = ("arx", "armax", "bj")  # their standard errors assume that e(t) is white; those of OE do not
FEW = 20  # excitation rank up to which a pulse response cannot be seen
HEAVY = 30_000  # estimation samples above which the grid of n_b is cut from 15 to 6

#: Structure -> orders in the sequence of Table 3.2; structures not named are selected automatically.
Wanted = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Found:
    """The chosen model of one structure.

    Attributes:
        selection: what was tried.
        test: of its residuals on held-out data.
        response: at the excited frequencies.
        warnings: everything the user should know before believing it.
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
class Report:
    """All structures on one recording, or on several pooled.

    Attributes:
        name: of the recording or the pool.
        estimation: data behind the estimates, means removed.
        validation: held-out data, the estimation means removed.
        excitation: what the estimation input excites.
        models: by structure.
        left_out: leave-one-frequency-out errors of the rational fit, for pools of single sines; else None.
        rational: rational function through the points of such a pool; else None.
        failures: sentences on structures that could not be estimated.
    """

    name: str
    estimation: tuple[Series, ...]
    validation: tuple[Series, ...]
    excitation: Excitation
    models: Mapping[str, Found]
    left_out: frequency.LeftOut | None
    rational: Rational | None
    failures: tuple[str, ...]

    def __str__(self) -> str:
        rows = [f"{self.name}: {self.excitation}"]
        for found in self.models.values():
            rows += [f"  {found.best}", *(f"    {text}" for text in found.warnings)]
        return "\n".join([*rows, *(str(extra) for extra in (self.rational, self.left_out) if extra), *self.failures])


def identify(
    recordings: Series | Sequence[Series], structures: Sequence[str] = DEFAULT, wanted: Wanted | None = None,
    split: float = 0.5, step: Callable[[str], Any] = lambda text: None,
) -> Report:  # fmt: skip
    """Estimate, select and judge models of all `structures` from one recording or from several pooled.

    Args:
        recordings: whole recordings; each is split into an estimation and a held-out part.
        structures: of "arx", "armax", "oe", "bj", "ss", "hw", "narx".
        wanted: orders to use instead of selecting them.
        split: fraction used for estimation.
        step: called with what is about to begin.

    Raises:
        FasError: the recordings cannot be used, or no structure could be estimated.
    """
    for name in structures:
        if name not in ALL:
            raise SettingError(unknown("structure", name, ALL) + ".")
    pooled = [recordings] if isinstance(recordings, Series) else list(recordings)
    parts = [series.split(split) for series in pooled]
    step("excitation")
    seen = excitation.examine([first for first, _ in parts])
    chooser = _Chooser([first for first, _ in parts], [second for _, second in parts], wanted or {}, step, seen)
    models, failures = {}, []
    for name in structures:
        try:
            models[name] = _judge(chooser.select(name), chooser, seen)
        except FasError as error:
            if len(structures) == 1:
                raise
            failures.append(f"{name}: {error}")
    if not models:
        raise SettingError("; ".join(failures))
    rational, left_out = _through_points(pooled)
    title = pooled[0].name if len(pooled) == 1 else f"{len(pooled)} recordings pooled"
    return Report(
        title, tuple(chooser.estimation), tuple(chooser.validation), seen, models, left_out, rational, tuple(failures)
    )


class _Chooser:
    """Selections of all structures on the same data; the later ones build on the orders of ARX and OE."""

    def __init__(
        self,
        estimation: list[Series],
        validation: list[Series],
        wanted: Wanted,
        step: Callable[[str], Any],
        seen: Excitation,
    ) -> None:
        self.estimation, self.validation = estimation, validation
        self.wanted, self.step = wanted, step
        self.done: dict[str, Selection] = {}
        self.sines = seen.rank <= FEW
        self.heavy = sum(len(series) for series in estimation) > HEAVY

    def select(self, name: str) -> Selection:
        """The selection of one structure, made once."""
        if name not in self.done:
            self.step(name)
            self.done[name] = self._select(name)
        return self.done[name]

    @cached_property
    def delay(self) -> int:
        """The plant's delay n_k in samples."""
        return selection.delay(self.estimation, far=not self.sines)

    def _orders(self, name: str) -> Orders:
        return self.select(name).best.model.orders  # type: ignore[attr-defined]  # arx and oe are polynomial

    def _select(self, name: str) -> Selection:
        estimation, validation = self.estimation, self.validation
        if name in self.wanted:
            return selection.rank([self._given(name, self.wanted[name])], validation, 1, ())
        if name == "arx":
            return selection.select_arx(estimation, validation, nk=self.delay)
        if name == "oe":
            trials = selection.oe_trials(self.delay, 6 if self.heavy else 15)
            return selection.select_polynomial("oe", trials, estimation, validation)
        if name == "armax":
            trials = selection.armax_trials(self._orders("arx"), self._orders("oe"))
            return selection.select_polynomial("armax", trials, estimation, validation)
        if name == "bj":
            return selection.select_polynomial("bj", selection.bj_trials(self._orders("oe")), estimation, validation)
        if name == "ss":
            return selection.select_state_space(estimation, validation)
        if name == "hw":
            linear = self.select("oe").best.model
            levels = min(nonlinear.levels(series.u) for series in estimation)
            degrees = [(p, q) for p, q in DEGREES if p < levels]
            models = [nonlinear.estimate(estimation, self._orders("oe"), d, linear) for d in degrees]  # type: ignore[arg-type]
            skipped = len(degrees) < len(DEGREES)
            said = [f"the input has {levels:g} levels: no input polynomial of that degree or more is tried"] * skipped
            return selection.rank(models, validation, len(models), said)
        best = narx.estimate(estimation, validation)
        return Selection((best,), narx.LARGEST_TERMS, (best.model.label,), ())

    def _given(self, name: str, numbers: tuple[int, ...]) -> selection.Model:
        if name in STRUCTURES:
            return pem.estimate(name, self.estimation, Orders.of(name, numbers))
        if name == "ss" and len(numbers) == 1:
            return subspace.estimate(self.estimation, numbers[0], refine=True)
        if name == "hw" and len(numbers) == 5:
            return nonlinear.estimate(self.estimation, Orders.of("oe", numbers[:3]), (numbers[3], numbers[4]))
        valid = {"ss": "1 order", "hw": "5 orders (nb, nf, nk, input degree, output degree)", "narx": "no orders"}
        raise SettingError(f"{name} takes {valid.get(name, 'no orders')}, not {len(numbers)}.")


def _judge(chosen: Selection, chooser: _Chooser, seen: Excitation) -> Found:
    model = chosen.best.model
    noise = sum(getattr(getattr(model, "orders", None), key, 0) for key in ("na", "nc", "nd"))
    tests = [residual_test(model.residuals(series), series, noise) for series in chooser.validation]
    test = max(tests, key=lambda t: -min(t.cross_p, t.white_p))
    warnings = [*model.warnings, *chosen.warnings]
    if test.white_p < ALARM and isinstance(model, PolynomialModel) and model.structure in WHITE:
        name = model.structure.upper()
        warnings.append(f"no standard errors or band: those of {name} are valid for white residuals only")
        model = model.without_intervals()
        chosen = replace(chosen, candidates=(replace(chosen.best, model=model), *chosen.candidates[1:]))
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
    return Found(chosen, test, model.response(shown_frequencies(seen)), tuple(warnings) + test.warnings)


def shown_frequencies(seen: Excitation, count: int = 60) -> np.ndarray:
    """Frequencies [Hz] at which a response may be shown: the excited ones."""
    if seen.single_sine:
        return seen.frequency_hz * np.array(seen.harmonics)
    if len(seen.band_hz) <= count:
        return seen.band_hz
    grid = np.geomspace(seen.band_hz[0], seen.band_hz[-1], count)
    nearest = np.searchsorted(seen.band_hz, np.sqrt(grid[1:] * grid[:-1]))
    return seen.band_hz[np.unique(np.clip(nearest, 0, len(seen.band_hz) - 1))]


def _through_points(pooled: Sequence[Series]) -> tuple[Rational | None, frequency.LeftOut | None]:
    """The rational fit and its leave-one-frequency-out errors when there are enough single sines."""
    sines = [series for series in pooled if excitation.single_sine(series)[1]]
    if len(sines) < 5:
        return None, None
    data = frequency.points([series.centred() for series in sines])
    if len(data) < 5:
        return None, None
    return frequency.rational(data), frequency.leave_one_out(data)
