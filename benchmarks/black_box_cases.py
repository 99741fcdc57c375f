"""Systems of known truth that are hard for estimators: chosen orders, fit on fresh data, coverage of intervals.

Each is 2000 samples of a known plant; the gain is compared at 20 frequencies. SIPPY and nfoursid see the same arrays.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks import black_box_peers
from fasbody.console import console
from identification import criteria
from identification.blackbox import mimo
from identification.blackbox.condition import detrend
from identification.blackbox.data import Series
from identification.blackbox.identify import identify
from reproduction.check import Check, at_most, told

SAMPLES = 2000
FAILED = -999.0  # "fit" of a package that found no model or an unstable one
FREQUENCY = np.linspace(0.01, 0.45, 20)


@dataclass(frozen=True)
class Case:
    """A plant B/F with its disturbance.

    Attributes:
        name: for the table.
        structure: estimated.
        orders: the true ones, in the sequence of Table 3.2.
        b: of rising powers of q^-1, its zeros included.
        f: monic; of A where the structure is ARX.
        noise: standard deviation of e over that of the undisturbed output.
        colour: of the disturbance, C and D.
        gain: of a controller from y to u; 0 for none.
        options: of `identify`.
        spoil: what happens to the output (N,) in the end.
        step: whether the input is a step.
    """

    name: str
    structure: str
    orders: tuple[int, ...]
    b: np.ndarray
    f: np.ndarray
    noise: float
    colour: tuple[list[float], list[float]] = ([1.0], [1.0])
    gain: float = 0.0
    options: dict[str, Any] = field(default_factory=dict)
    spoil: Callable[[np.ndarray, np.random.Generator], np.ndarray] = lambda y, rng: y
    step: bool = False

    def record(self, seed: int) -> Series:
        """One recording."""
        rng = np.random.default_rng(seed)
        u, e = rng.standard_normal((2, SAMPLES))
        if self.gain:
            return self._loop(u, self.noise * e)
        if self.step:
            u = np.r_[np.zeros(200), np.ones(SAMPLES - 200)]
        w, v = lfilter(self.b, self.f, u), lfilter(*self.colour, e)
        y = self.spoil(w + self.noise * np.std(w) / np.std(v) * v, rng)
        return Series(u, y, 1.0, self.name)

    def _loop(self, reference: np.ndarray, e: np.ndarray) -> Series:
        y, u, e = np.zeros(SAMPLES), np.zeros(SAMPLES), lfilter(*self.colour, e)
        for t in range(SAMPLES):
            past = range(1, min(t, len(self.f) - 1) + 1)
            y[t] = e[t] - sum(self.f[k] * y[t - k] for k in past)
            y[t] += sum(self.b[k] * u[t - k] for k in range(min(t + 1, len(self.b))))
            u[t] = reference[t] - self.gain * y[t]
        return Series(u, y, 1.0, self.name)

    def truth(self) -> np.ndarray:
        """Gain (20,) of the plant."""
        shift = np.exp(-2j * np.pi * FREQUENCY)
        polyval = np.polynomial.polynomial.polyval
        return np.abs(polyval(shift, self.b) / polyval(shift, self.f))


def _poly(*half: complex) -> np.ndarray:
    roots = [p for pole in half for p in ([pole, np.conj(pole)] if np.imag(pole) else [pole])]
    return np.poly(roots).real


def _spikes(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    where = rng.choice(len(y), len(y) // 100, replace=False)
    y = y.copy()
    y[where] += 4 * np.std(y) * rng.choice([-1.0, 1.0], len(where))
    return y


def _drift(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return y + 3 * np.std(y) * np.linspace(0, 1, len(y))


SIXTH = _poly(0.95 * np.exp(0.2j), 0.97 * np.exp(0.7j), 0.96 * np.exp(1.6j))
SECOND = _poly(0.9 * np.exp(0.5j))
B2 = np.array([0.0, 1.0, 0.5])
CASES = (
    Case("lightly damped (poles 0.9995)", "oe", (2, 2, 1), B2, _poly(0.9995 * np.exp(0.3j)), 0.04),
    Case(
        "coloured (AR 0.95), delay 7", "bj", (3, 0, 1, 3, 7), np.r_[np.zeros(7), 1, 0.5, 0.25],
        _poly(0.8, 0.7 * np.exp(0.9j)), 0.5, ([1.0], [1.0, -0.95]),
    ),
    Case("unstable in closed loop", "arx", (2, 2, 1), np.array([0, 0.5, 0.2]), _poly(1.1, 0.4), 0.3, gain=0.8),
    Case(
        "ARMAX in a strong loop", "armax", (2, 2, 1, 1), B2, SECOND, 0.5, ([1.0, 0.5], [1.0]), gain=0.25,
    ),
    Case("step", "oe", (2, 2, 1), B2, SECOND, 0.1, step=True),
    Case("1 % outliers", "oe", (2, 2, 1), B2, SECOND, 0.1, spoil=_spikes, options={"robust": True}),
    Case("trend", "oe", (2, 2, 1), B2, SECOND, 0.1, spoil=_drift, options={"detrend": 1}),
    Case("sixth order", "oe", (6, 6, 1), np.array([0, 0.1, -0.2, 0.3, 0.1, 0.2, 0.05]), SIXTH, 0.1),
)  # fmt: skip


def fresh_fit(case: Case, model: Any) -> float:
    """Fit [%] of the undisturbed answer to a fresh input from rest; of one-step predictions in a loop."""
    if case.gain:
        other = case.record(999)
        errors = model.residuals(other.centred())
        return criteria.fit_percent(other.y[len(other) - len(errors) :], other.y[len(other) - len(errors) :] - errors)
    u = np.random.default_rng(999).standard_normal(SAMPLES)
    return criteria.fit_percent(lfilter(case.b, case.f, u), model.simulate(u))


def one(case: Case, seed: int, orders_known: bool) -> tuple[str, float, float, float]:
    """Label, fit [%], share of 95 % intervals of the gain that hold the truth (NaN: withheld), processor time [s]."""
    begin = time.process_time()
    orders = {case.structure: case.orders} if orders_known else {}
    choice = identify(case.record(seed), (case.structure,), orders, 0.5, **case.options).models[case.structure]
    seconds = time.process_time() - begin
    response = choice.selection.curve(FREQUENCY)
    inside = np.abs(np.abs(response.value) - case.truth()) < 1.96 * response.gain_std
    held = float(np.mean(inside)) if np.isfinite(response.gain_std).all() else np.nan
    return choice.best.model.label, fresh_fit(case, choice.best.model), held, seconds


def rows(seeds: int) -> Iterator[Check]:
    """Every case with the true orders and without."""
    for case in CASES:
        for orders_known in (True, False):
            trials = [one(case, seed, orders_known) for seed in range(seeds)]
            labels = [label for label, *_ in trials]
            fit, seconds = (float(np.median([item[k] for item in trials])) for k in (1, 3))
            worst = min(item[1] for item in trials)
            held = np.array([item[2] for item in trials])
            finite = held[np.isfinite(held)]
            coverage = 100 * float(np.mean(finite)) if len(finite) else np.nan
            text = "withheld" if not len(finite) else f"{coverage:.1f} % ({len(held) - len(finite)} withheld)"
            what = f"{case.name}, orders {'given' if orders_known else 'not given'}, {seeds} seeds: fit on fresh data"
            usual = max(set(labels), key=labels.count)
            measured = f"{fit:.2f} % (worst {worst:.2f} %), {usual} {labels.count(usual)} times, {seconds:.2f} s"
            yield told(what, measured)
            orders = "given" if orders_known else "not given"
            what = f"{case.name}, orders {orders}: 95 % intervals of the gain with the truth"
            yield Check(what, coverage, 90, 98, said=text, beside="90 to 98 %", asked=seeds >= 20 and len(finite) > 0)


def _roots(rng: np.random.Generator, count: int, largest: float) -> np.ndarray:
    """A monic polynomial (count + 1,) with roots up to `largest`, most of them in pairs."""
    roots: list[complex] = []
    while len(roots) < count:
        size = rng.uniform(0.3, largest)
        if count - len(roots) > 1 and rng.random() < 0.7:
            pole = size * np.exp(1j * rng.uniform(0.1, 2.8))
            roots += [pole, np.conj(pole)]
        else:
            roots.append(size * rng.choice([-1, 1], p=[0.25, 0.75]))
    return np.poly(roots).real


def random_plant(seed: int) -> tuple[Series, np.ndarray]:
    """A plant of order 1 to 4 with delay 0 to 3 and noise of one of four kinds, and its gain (20,)."""
    rng = np.random.default_rng(1000 + seed)
    order, delay = int(rng.integers(1, 5)), int(rng.integers(0, 4))
    f = _roots(rng, order, 0.97)
    b = np.r_[np.zeros(delay), rng.standard_normal(int(rng.integers(1, order + 1)))]
    c, d = _roots(rng, int(rng.integers(1, 3)), 0.9), _roots(rng, int(rng.integers(1, 3)), 0.95)
    noise, one = rng.uniform(0.05, 0.5), [1.0]
    u, e = rng.standard_normal((2, SAMPLES))
    u = (u, lfilter(one, [1, -0.7], u), np.sign(u))[seed % 3]
    w, v = lfilter(b, f, u), lfilter(*((one, one), (one, f), (c, f), (c, d))[seed % 4], e)
    plant = Case("random", "", (), b, f, noise)
    return Series(u, w + noise * np.std(w) / np.std(v) * v, 1.0, f"plant {seed}"), plant.truth()


def random_plants(count: int = 60, structures: tuple[str, ...] = ("arx", "armax", "oe", "bj", "ss")) -> Iterator[Check]:
    """Coverage of the gain's intervals, and its error, for each structure on random plants, orders not given."""
    held: dict[str, list[float]] = {name: [] for name in structures}
    missed: dict[str, list[float]] = {name: [] for name in structures}
    for series, truth in map(random_plant, range(count)):
        for name, chosen in identify(series, structures).models.items():
            at = chosen.selection.curve(FREQUENCY)
            missed[name].append(float(np.linalg.norm(np.abs(at.value) - truth) / np.linalg.norm(truth)))
            if np.isfinite(at.gain_std).all():
                held[name].append(float(np.mean(np.abs(np.abs(at.value) - truth) < 1.96 * at.gain_std)))
    for name in structures:
        share, known = 100 * float(np.mean(held[name])), len(held[name])
        error = 100 * float(np.median(missed[name]))
        said = f"{share:.1f} % ({count - known} withheld), median error of the gain {error:.2f} %"
        what = f"{count} random plants, {name}, orders not given: 95 % intervals of the gain with the truth"
        yield Check(what, share, 90, 98, said=said, beside="90 to 98 %", asked=count >= 60)


def several(seeds: int = 5) -> Iterator[Check]:
    """Two inputs and two outputs, third order: orders not given; ARX intervals are valid for ARX systems only."""
    A, B = np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.1], [0.0, 0.0, 0.6]]), np.array([[1, 0], [0.3, 0.5], [0, 1.0]])
    C = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -1.0]])
    fits, labels, begin = [], [], time.process_time()

    def plant(u: np.ndarray) -> np.ndarray:
        x, y = np.zeros(3), np.empty((len(u), 2))
        for t, value in enumerate(u):
            y[t], x = C @ x, A @ x + B @ value
        return y

    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        u, fresh = rng.standard_normal((2, SAMPLES, 2))
        y = plant(u)
        y += 0.1 * y.std(axis=0) * rng.standard_normal(y.shape)
        series = Series(u, y, 1.0, "plant", (("u1", "u2"), ("y1", "y2")))
        model = mimo.identify(series, ("ss",)).models["ss"].model
        exact = plant(fresh)
        fits.append(criteria.fit_percent(exact.ravel(), model.simulate(fresh).ravel()))
        labels.append(model.label)
    usual = max(set(labels), key=labels.count)
    text = f"{np.median(fits):.2f} % (worst {min(fits):.2f} %), {usual} {labels.count(usual)} times"
    seconds = (time.process_time() - begin) / seeds
    yield told(f"2 inputs, 2 outputs, orders not given, {seeds} seeds: fit on fresh data", f"{text}, {seconds:.2f} s")


def search_time() -> Iterator[Check]:
    """Processor time of the choice of orders of five structures, mean over three plants."""
    seconds = []
    for case in (CASES[0], CASES[1], CASES[-1]):
        series = case.record(0)
        begin = time.process_time()
        identify(series, ("arx", "armax", "oe", "bj", "ss"))
        seconds.append(time.process_time() - begin)
    yield at_most("choice of orders, five structures, 2000 samples, processor time", float(np.mean(seconds)), 2.5, "s")


def peers(timeout: float, seeds: int = 5) -> Iterator[Check]:
    """Subspace models of other packages on the estimation halves of the same records, free simulation only.

    They have no trend taken off by themselves, so theirs is taken off before; outliers stay.
    """
    arrays: dict[str, np.ndarray] = {}
    fresh = np.random.default_rng(999).standard_normal(SAMPLES)
    for case in CASES:
        if case.gain:
            continue  # an unstable plant is not simulated freely
        order = max(len(case.b), len(case.f)) - 1
        arrays |= {f"{case.name}|order": np.array(order), f"{case.name}|seeds": np.array(seeds)}
        arrays |= {f"{case.name}|fresh": fresh, f"{case.name}|exact": lfilter(case.b, case.f, fresh)}
        for seed in range(seeds):
            first, _ = detrend(case.record(seed), case.options.get("detrend", 0)).split()
            arrays |= {f"{case.name}|u{seed}": first.u, f"{case.name}|y{seed}": first.y}
    for title, results in black_box_peers.run_cases(arrays, timeout).items():
        if isinstance(results, str):
            console.print(f"{title} is {results}", soft_wrap=True)
            continue
        for key, (fit, seconds) in results.items():
            name, orders = key.split("|")
            text = f"{fit:.2f} %" if fit > FAILED else "no model"
            yield told(f"{name}, orders {orders}: {title} N4SID, fit on fresh data", f"{text} in {seconds:.2f} s")
