"""Which mechanism made a recording: virtual subjects of each, an analysis that names one, and how often it is right.

Each rival is fitted to the complex responses of a plan (loads, frequencies, amplitudes, sensors) by least squares over
the scatter of a recording, with the body mass, the gains and the softness of both sensors' seats free within what is
stated of them. The rival with the largest evidence within its bounds (Laplace's approximation) is named; below odds of
1000 to 1 the answer is "undecided", and where none fits it is "none of these".
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.console import to_json
from fasbody.leg import balance
from fasbody.leg.lift_off import TABLE_M_S2
from fasbody.leg.mechanisms import BODY_KG, MASSES, MECHANISMS, Mechanism, above, pressed
from fasbody.leg.statements import ADDED_KG, Curves, judge, ranges_met
from fasbody.leg.virtual import GAIN, MASS, NOISE, Recordings, Subject, mount
from fasbody.runner import Store, key, versions
from fasbody.transmissibility.findings import FREQUENCIES_HZ

Array = np.ndarray
#: How far a foot's response may depart from every rival [1]: stated of the subjects, allowed by the analysis.
DEPARTURE = 0.08
#: Width of a departure's bumps, in the logarithm of the frequency.
WIDTH = 0.35
#: Richer rivals of which a rival is a special case: it is named before them unless they fit better.
RICHER = {"constant": ("stiffening",), "second mode": ("both",)}
#: Difference of the criterion that decides: odds of 1000 to 1.
DECIDED = 2 * np.log(1000.0)
#: Sum of squares per degree of freedom above which no rival fits.
FITS = 1.5
#: Damping ratio that the analysis takes for a sensor's seat, and the softest seat that it allows [Hz].
SEAT_ZETA, SEAT_HZ = 0.2, 70.0
#: Even draws of a rival's space that a fit may start from; starts; steps of a fit.
BANK, PRESSED_BANK, STARTS, PRESSED_STARTS, STEPS = 8000, 400, 2, 1, 25
#: Draws of which a virtual subject is the one that looks most like the thesis, and the least share of time in the air.
CHOICE, AIR = 40, 0.05
#: Share of the thesis' recordings of a subject that a balanced motion must be found for, and what counts as one.
BALANCED, LEFT = 0.9, 1e-3
#: How many times larger the table's amplitude is where it counts as another one.
HIGHER = 1.2
#: Times as many starts where no rival fits.
MORE = 6
#: A fit whose sum of squares lies so far above another rival's, and creeps, is given up.
FAR = 100.0
RIVALS = ("constant", "stiffening", "second mode", "lift-off", "both")
UNDECIDED, NONE = "undecided", "none of these"
#: What computes a verdict: a kept one counts only if these are as they were.
_OWN = ("decide", "balance", "lift_off", "mechanisms", "statements", "virtual")
_SOURCES = (*_OWN, "../foot/harmonic_balance")


@dataclass(frozen=True)
class Plan:
    """Recordings to be made.

    Attributes:
        name: short. frequency_hz, added_kg, table: of each recording (n,). tuberosity: whether it is measured.
        harmonics: whether the malleolus' second harmonic is used.
    """

    name: str
    frequency_hz: Array
    added_kg: Array
    table: Array
    tuberosity: bool = True
    harmonics: bool = False

    @cached_property
    def partner(self) -> Array:
        """For each recording the one of the same load and frequency at a greater amplitude, -1 if there is none."""
        same = (self.frequency_hz[:, None] == self.frequency_hz) & (self.added_kg[:, None] == self.added_kg)
        more = same & (self.table > HIGHER * self.table[:, None])
        return np.where(more.any(axis=1), more.argmax(axis=1), -1)

    def only(self, rows: Array) -> "Plan":
        """Those recordings alone, (n,) bool."""
        some = {k: getattr(self, k)[rows] for k in ("frequency_hz", "added_kg", "table")}
        return replace(self, **some)


def _plan(name: str, *parts: tuple[Sequence[float], Sequence[float], float], tuberosity: bool = True,
          harmonics: bool = False) -> Plan:  # fmt: skip
    rows = [(f, kg, a) for hz, loads, a in parts for kg in loads for f in hz]
    f, kg, a = (np.array(column) for column in zip(*rows, strict=True))
    return Plan(name, f, kg, a, tuberosity, harmonics)


_THESIS = (FREQUENCIES_HZ, ADDED_KG, TABLE_M_S2)
_SLOW = ((5.0, 7.0), ADDED_KG, TABLE_M_S2 / 2)
_HALF = ((15.0, 20.0, 25.0, 30.0, 35.0), (ADDED_KG[0], ADDED_KG[2]), TABLE_M_S2 / 2)
#: The thesis' protocol with one sensor, with each addition alone, as it was, and the better one.
PLANS: tuple[Plan, ...] = (
    _plan("malleolus alone", _THESIS, tuberosity=False),
    _plan("and the tuberosity (the thesis)", _THESIS),
    _plan("and 5, 7 Hz", _THESIS, _SLOW, tuberosity=False),
    _plan("and half the amplitude", _THESIS, _HALF, tuberosity=False),
    _plan("and second harmonics", _THESIS, tuberosity=False, harmonics=True),
    _plan("all of these", _THESIS, _SLOW, _HALF, harmonics=True),
)
THESIS, ALL = PLANS[1], PLANS[-1]


def named(name: str) -> Mechanism:
    """The mechanism of a rival: wide ankles for those that need them."""
    wide = {"constant": "constant, any ankle", "lift-off": "lift-off, load moves along"}
    return next(m for m in MECHANISMS if m.name == wide.get(name, name))


def is_pressed(mechanism: Mechanism) -> bool:
    """Whether it stands on a pad that cannot pull."""
    return any(c.name == "rest" for c in mechanism.constants)


@dataclass(frozen=True)
class Predicted:
    """MB, TB and the malleolus' second harmonic over its first, each (d, n), and the balanced motions (d n, u)."""

    MB: Array
    TB: Array
    second: Array
    x: Array | None = None
    air: Array | None = None
    balanced: Array | None = None


def predict(mechanism: Mechanism, values: dict[str, Array], plan: Plan, start: Array | None = None,
            nearby: bool = False, seen: Recordings | None = None) -> Predicted:  # fmt: skip
    """What a mechanism with constants (d,) gives at the recordings of a plan.

    Args:
        mechanism: which. values: constants. plan: recordings.
        start: balanced motions to begin at, (d n, u) or (n, u) of one draw close by.
        seen: of one draw, begin where these were measured; what is not balanced from there begins at rest.
        nearby: take one step of Newton's method from `start` with the slope there: exact to first order.
    """
    if not is_pressed(mechanism):
        hz, at = np.unique(plan.frequency_hz, return_inverse=True)
        added, load = np.unique(plan.added_kg, return_inverse=True)
        MB, TM = mechanism.response(hz, values, added)
        return Predicted(MB[:, load, at], (MB * TM)[:, load, at], np.zeros((len(MB), load.size), complex))
    f, added = plan.frequency_hz, plan.added_kg[None]
    if mechanism.response is named("both").response:
        M, MF, TM = above(f, values, added)
    else:
        mass = values["m"][:, None] + values["share"][:, None] * added
        M = np.repeat(mass[..., None].astype(complex), balance.HARMONICS, axis=-1)
        MF = TM = np.ones_like(M)
    systems = pressed(f, values, M, added, plan.table)
    draws, every = len(M), np.arange(systems.omega.size)
    if nearby:
        assert start is not None
        slope = systems.jacobian(start, np.arange(f.size))  # the first draw is the one at `start`
        try:
            inverse = np.linalg.inv(slope)
        except np.linalg.LinAlgError:  # a motion that bifurcates: the shortest of its steps
            inverse = np.linalg.pinv(slope)
        x = np.tile(start, (draws, 1))
        x -= (np.tile(inverse, (draws, 1, 1)) @ systems.residual(x, every)[..., None])[..., 0]
    elif seen is not None:
        first = (seen.MB * plan.table / MF[0, :, 0]).ravel()
        second = seen.second * seen.MB * plan.table / MF[0, :, 1] * 1j if plan.harmonics else 0.0
        x, found = balance.solve(systems, balance.begin(systems, first, second))
        again = np.flatnonzero(~found)
        if again.size:
            x[again], _ = balance.solve(systems[again])
    else:
        x, _ = balance.solve(systems, start)
    a = systems.acceleration(x).reshape(draws, f.size, -1) * MF
    first = a[..., 0]
    air = systems.air(x).reshape(draws, -1)
    left = np.linalg.norm(systems.residual(x, every), axis=1) / systems.static < LEFT
    return Predicted(first / plan.table, first * TM[..., 0] / plan.table, -1j * a[..., 1] / first, x, air,
                     left.reshape(draws, -1))  # fmt: skip


@dataclass(frozen=True)
class Fitted:
    """One rival's best fit.

    Attributes:
        rival: name. chi2: sum of squares. criterion: minus twice the logarithm of the evidence, but for what all
            rivals share. values: constants by name.
        air: largest share of time in the air. MB, TB: what the sensors would read (n,), complex.
    """

    rival: str
    chi2: float
    criterion: float
    values: dict[str, float]
    air: float
    MB: Array
    TB: Array


@dataclass(frozen=True)
class Verdict:
    """What the analysis says of one subject.

    Attributes:
        named: rival, `UNDECIDED` or `NONE`. best: rival with the smallest criterion. margin: to the next one.
        per_dof: sum of squares of the best per degree of freedom. criteria: of every rival.
        lost: recordings that do not repeat after one period and are left out.
    """

    named: str
    best: str
    margin: float
    per_dof: float
    criteria: dict[str, float]
    lost: int


class Analysis:
    """Names the mechanism behind the recordings of one plan; the draws that fits start from are computed once.

    `departure` is how far the foot may be off every rival. It is assumed, not estimated: where a foot is off by more,
    the answer is "none of these"; where by less, the answer is "undecided" more often than it had to be. Masses of the
    segments are those of a person of `body_kg`.
    """

    def __init__(self, plan: Plan, rivals: Sequence[str] = RIVALS, bank: int = BANK,
                 pressed_bank: int = PRESSED_BANK, seed: int = 1, departure: float = DEPARTURE,
                 body_kg: float = BODY_KG) -> None:  # fmt: skip
        self.plan, self.rivals = plan, {name: named(name).of(body_kg) for name in rivals}
        self.departure = departure
        self.bank: dict[str, tuple[Array, Predicted]] = {}
        for name, mechanism in self.rivals.items():
            draws = pressed_bank if is_pressed(mechanism) else bank
            u = np.random.default_rng(seed).random((draws, len(mechanism.constants)))
            self.bank[name] = u, predict(mechanism, mechanism.values(u), plan)

    def verdict(self, measured: Recordings) -> Verdict:
        """Name the mechanism.

        Args:
            measured: of `plan`; recordings that do not repeat are left out, and where harmonics are recorded they
                rule out every rival that is linear.
        """
        return self.judged(measured)[0]

    def judged(self, measured: Recordings) -> tuple[Verdict, list[Fitted]]:
        """The verdict, and the fit of each rival to the recordings that repeat, the best one first."""
        kept = measured.repeats
        plan = self.plan.only(kept)
        data = measured.only(kept)
        fits: list[Fitted] = []
        for name in sorted(self.rivals, key=lambda name: name in ("lift-off", "both")):  # quick ones set the goal
            fits.append(self._fit(name, plan, data, kept, min((f.chi2 for f in fits), default=np.inf)))
        if plan.harmonics and not kept.all():
            fits = [f if is_pressed(self.rivals[f.rival]) else replace(f, criterion=np.inf) for f in fits]
        fits.sort(key=lambda f: f.criterion)
        size = _misfit(plan, data, self.departure, data.MB[None], data.TB[None], data.second[None]).shape[1]
        dof = max(1, size - len(self.rivals[fits[0].rival].constants))
        first = fits[0].rival
        others = [f.criterion for f in fits[1:] if f.rival not in RICHER.get(first, ())]
        others = others or [f.criterion for f in fits[1:]]  # only a richer one is left: it has to be beaten, too
        margin = min(others, default=np.inf) - fits[0].criterion
        per_dof = fits[0].chi2 / dof
        says = NONE if per_dof > FITS else first if margin >= DECIDED else UNDECIDED
        criteria = {f.rival: f.criterion for f in fits}
        return Verdict(says, first, margin, per_dof, criteria, int((~kept).sum())), fits

    def _fit(self, name: str, plan: Plan, data: Recordings, kept: Array, goal: float) -> Fitted:
        mechanism = self.rivals[name]
        u, known = self.bank[name]
        rough = _misfit(plan, data, self.departure, known.MB[:, kept], known.TB[:, kept], known.second[:, kept])
        order = np.argsort(np.nan_to_num((rough**2).sum(axis=1), nan=np.inf))
        best: tuple[float, Array, float, float] | None = None
        starts, size = PRESSED_STARTS if is_pressed(mechanism) else STARTS, rough.shape[1]
        for tried, at in enumerate(order[: MORE * starts]):
            if tried >= starts and (best is None or min(goal, best[0]) < FITS * size):
                break  # some rival fits
            found = _least(mechanism, plan, data, self.departure, u[at], goal)
            if best is None or found[0] < best[0]:
                best = found
        assert best is not None
        chi2, theta, air, volume = best
        free = len(mechanism.constants)
        values = {k: float(v[0]) for k, v in mechanism.values(theta[None, :free]).items()}
        read = _read(mechanism, plan, data, theta[None], None)
        return Fitted(name, chi2, chi2 + volume, values, air, read.MB[0], read.TB[0])


def _misfit(plan: Plan, data: Recordings, departure: float, MB: Array, TB: Array, second: Array) -> Array:
    """Residuals over their scatter, real, (d, m). What two amplitudes share, their ratio does not contain."""
    parts, whole = [], float(np.hypot(NOISE, departure / np.sqrt(2)))
    for told, found in ((MB, data.MB), (TB, data.TB))[: 2 if plan.tuberosity else 1]:
        pair = plan.partner
        scale = np.where(pair >= 0, found[pair], 1.0), np.where(pair >= 0, told[..., pair], 1.0)
        over = found / scale[0]
        parts.append((told / scale[1] - over) / (np.where(pair >= 0, NOISE * np.sqrt(2), whole) * np.abs(over)))
    if plan.harmonics:
        parts.append((second - data.second) / (NOISE + whole * np.abs(data.second)))
    z = np.concatenate(parts, axis=-1)
    return np.concatenate([z.real, z.imag], axis=-1)


def _read(mechanism: Mechanism, plan: Plan, data: Recordings, theta: Array, start: Array | None,
          nearby: bool = False) -> Predicted:  # fmt: skip
    """What the sensors read for shares and nuisances theta (d, p): mass, gains and seats."""
    free = len(mechanism.constants)
    values, z = mechanism.values(theta[:, :free]), theta[:, free:]
    values = {k: v * (1 + MASS * z[:, 0]) if k in MASSES else v for k, v in values.items()}
    told = predict(mechanism, values, plan, start, nearby, data if start is None else None)
    with np.errstate(divide="ignore"):
        seat_m, seat_t = (SEAT_HZ / np.sqrt(np.maximum(z[:, i], 1e-12))[:, None] for i in (3, 4))
    f = plan.frequency_hz
    seat = mount(f, seat_m, SEAT_ZETA)
    MB = told.MB * seat * (1 + GAIN * z[:, 1:2])
    TB = told.TB * mount(f, seat_t, SEAT_ZETA) * (1 + GAIN * z[:, 2:3])
    return replace(told, MB=MB, TB=TB, second=told.second * mount(2 * f, seat_m, SEAT_ZETA) / seat)


def _residuals(mechanism: Mechanism, plan: Plan, data: Recordings, departure: float, theta: Array, start: Array | None,
               nearby: bool = False) -> tuple[Array, Predicted]:  # fmt: skip
    """Misfit and what is stated beforehand, (d, m), for shares and nuisances theta (d, p)."""
    read = _read(mechanism, plan, data, theta, start, nearby)
    free = len(mechanism.constants)
    misfit = _misfit(plan, data, departure, read.MB, read.TB, read.second)
    return np.concatenate([misfit, theta[:, free : free + 3]], axis=1), read


def _least(mechanism: Mechanism, plan: Plan, data: Recordings, departure: float, share: Array,
           goal: float) -> tuple[float, Array, float, float]:  # fmt: skip
    """Least squares by Levenberg's and Marquardt's steps within bounds.

    It is given up where it creeps far above the sum of squares of another rival, `goal`.

    Returns:
        sum of squares; theta (p,); largest share of the time in the air; what the data leave of the bounds, minus twice
        the logarithm of a volume. A constant that the data do not touch costs nothing: counting constants instead
        (the Bayesian information criterion) named simple rivals for their simplicity alone.
    """
    free = share.size
    low = np.r_[np.zeros(free), np.full(3, -4.0), np.zeros(2)]
    high = np.r_[np.ones(free), np.full(3, 4.0), np.ones(2)]
    theta = np.r_[share, np.zeros(3), np.full(2, 0.2)]
    rest, told = _residuals(mechanism, plan, data, departure, theta[None], None)
    best, damp, small = float((rest**2).sum()), 1e-2, 0

    def slope() -> Array:
        inward = np.where(theta > 0.5 * (low + high), -1e-6, 1e-6)
        near = np.vstack([theta, theta + np.diag(inward)])
        rows, _ = _residuals(mechanism, plan, data, departure, near, told.x, nearby=told.x is not None)
        return (rows[1:] - rows[0]).T / inward

    for _ in range(STEPS):
        J = slope()
        gradient = J.T @ rest[0]
        at_edge = ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
        J[:, at_edge], gradient[at_edge] = 0.0, 0.0
        N = J.T @ J
        for _ in range(6):
            step = np.linalg.solve(N + np.diag(damp * (N.diagonal() + 1e-3)), gradient)
            new = np.clip(theta - step, low, high)
            tried, told_there = _residuals(mechanism, plan, data, departure, new[None], told.x)
            sum_there = float((tried**2).sum())
            if sum_there < best:
                break
            damp *= 5
        else:
            break
        gain = best - sum_there
        far = best - goal > FAR
        small = small + 1 if gain < (0.15 * (best - goal) if far else 0.1) else 0
        theta, rest, told, best, damp = new, tried, told_there, sum_there, max(damp / 8, 1e-6)
        if small >= 2:
            break
    J = slope()
    volume = float(np.linalg.slogdet(np.eye(theta.size) + J.T @ J / (2 * np.pi))[1])
    return best, theta, 0.0 if told.air is None else float(told.air.max()), volume


def _bumps(plan: Plan, rng: np.random.Generator) -> Array:
    """A smooth complex random function of the frequency, one a load, of mean square 1, at a plan's recordings (n,)."""
    hz, at = np.unique(plan.frequency_hz, return_inverse=True)
    apart = np.log(hz)[:, None] - np.log(hz)
    root = np.linalg.cholesky(np.exp(-0.5 * (apart / WIDTH) ** 2) + 1e-9 * np.eye(hz.size))
    loads, load = np.unique(plan.added_kg, return_inverse=True)
    z = rng.standard_normal((2, hz.size, loads.size))
    return (root @ (z[0] + 1j * z[1]))[at, load] / np.sqrt(2)


def measured(subject: Subject, plan: Plan, rng: np.random.Generator, departure: float = DEPARTURE) -> Recordings:
    """A subject's recordings with the scatter that is stated, its responses off every rival by a smooth share.

    The share is the same at every amplitude: what moves in the foot is.
    """
    true = subject.shaken(plan.frequency_hz, plan.added_kg, plan.table)
    own = [departure * _bumps(plan, rng) for _ in range(2)]
    true = replace(true, MB=true.MB * (1 + own[0]), TB=true.TB * (1 + own[1]))

    def noisy(value: Array, scatter: Array) -> Array:
        return value + scatter * (rng.standard_normal(value.size) + 1j * rng.standard_normal(value.size))

    return Recordings(noisy(true.MB, NOISE * np.abs(true.MB)), noisy(true.TB, NOISE * np.abs(true.TB)),
                      noisy(true.second, NOISE + NOISE * np.abs(true.second)), true.air, true.repeats)  # fmt: skip


def draw(rival: str, rng: np.random.Generator, choice: int = CHOICE, body_kg: float = BODY_KG) -> Subject:
    """A virtual subject of some body mass: of some draws of the rival's space the one that looks most like the thesis.

    Rivals with a pad that cannot pull must lose contact in some recording of the thesis.
    """
    mechanism = named(rival).of(body_kg)
    u = rng.random((choice, len(mechanism.constants)))
    values = mechanism.values(u)
    told = predict(mechanism, values, THESIS)
    MB, TB = (T.reshape(choice, len(ADDED_KG), -1) for T in (told.MB, told.TB))
    peak = np.array(FREQUENCIES_HZ)[np.abs(MB).argmax(axis=-1)]
    score = 3.0 * ranges_met(peak).sum(axis=-1) + judge(Curves(MB, TB / MB)).sum(axis=-1)
    if told.air is not None and told.balanced is not None:
        good = told.balanced.mean(axis=1) >= BALANCED
        score = np.where((told.air.max(axis=1) >= AIR) & good, score, -1.0)
    at = int(score.argmax())
    return Subject.drawn(rival, {k: float(v[at]) for k, v in values.items()}, rng)


def one(rival: str, number: int, analyses: Sequence[Analysis], seed: int = 0,
        departure: float = DEPARTURE) -> dict[str, Verdict]:  # fmt: skip
    """One virtual subject through several plans: plan's name -> verdict. Each plan sees the same recordings.

    Args:
        rival: what the subject is. number: of the subject. analyses: plans that are parts of `ALL`. seed: of all.
        departure: how far the responses are off every rival [1].
    """
    rng = np.random.default_rng([seed, RIVALS.index(rival), number])
    subject = draw(rival, rng)
    whole = measured(subject, ALL, rng, departure)
    place = {row: i for i, row in enumerate(zip(ALL.frequency_hz, ALL.added_kg, ALL.table, strict=True))}
    found = {}
    for analysis in analyses:
        plan = analysis.plan
        rows = np.array([place[row] for row in zip(plan.frequency_hz, plan.added_kg, plan.table, strict=True)])
        found[plan.name] = analysis.verdict(whole.only(rows))
    return found


@dataclass(frozen=True)
class Confusion:
    """How often each truth was given each name under one plan.

    Attributes:
        plan: name. verdicts: truth -> verdicts of its subjects.
    """

    plan: str
    verdicts: Mapping[str, Sequence[Verdict]]

    def count(self, truth: str, says: str) -> int:
        """Subjects of a truth that were called so."""
        return sum(v.named == says for v in self.verdicts[truth])

    @property
    def subjects(self) -> int:
        """How many there are in all."""
        return sum(map(len, self.verdicts.values()))

    @property
    def right(self) -> int:
        """Subjects whose mechanism was named."""
        return sum(self.count(truth, truth) for truth in self.verdicts)

    @property
    def wrong(self) -> int:
        """Subjects for whom another mechanism was named."""
        return sum(v.named in RIVALS and v.named != truth for truth, each in self.verdicts.items() for v in each)

    def told_apart(self, one: str, other: str) -> float:
        """Share of both rivals' subjects whose truth beats the other of the pair: at 1000 to 1, or by being simpler."""
        wins = []
        for truth, rival in ((one, other), (other, one)):
            needed = 0.0 if rival in RICHER.get(truth, ()) else DECIDED
            wins += [v.criteria[rival] - v.criteria[truth] >= needed for v in self.verdicts[truth]]
        return sum(wins) / max(1, len(wins))

    def record(self) -> dict[str, Any]:
        """As a document: counts, and what share of each pair is told apart."""
        names = (*RIVALS, UNDECIDED, NONE)
        pairs = list(combinations(self.verdicts, 2))
        return {
            "plan": self.plan, "subjects": self.subjects, "right": self.right, "wrong": self.wrong,
            "named": {truth: {says: self.count(truth, says) for says in names} for truth in self.verdicts},
            "told_apart": {f"{a} | {b}": self.told_apart(a, b) for a, b in pairs},
        }  # fmt: skip


def study(plans: Sequence[Plan], subjects: int, folder: Path, seed: int = 0,
          departure: float = DEPARTURE) -> Iterator[list[Confusion]]:  # fmt: skip
    """Confusion of each plan after every subject; what a folder holds is not computed again.

    Args:
        plans: parts of `ALL`. subjects: of each rival. folder: of results. seed: of all subjects.
        departure: how far their responses are off every rival [1].

    Raises:
        InputFileError: the folder cannot be written.
    """
    own = [(Path(__file__).parent / f"{name}.py").read_bytes() for name in _SOURCES]
    store, of = Store(folder), key(seed, departure, *own, versions("numpy", "numba"))
    store.make()
    made: dict[str, Analysis] = {}
    found: dict[str, dict[str, list[Verdict]]] = {plan.name: {rival: [] for rival in RIVALS} for plan in plans}
    for number in range(subjects):
        for rival in RIVALS:
            file = f"{rival}-{number}.json".replace(" ", "-")
            document, _ = store.load(file, json.loads)
            kept = document.get("plans", {}) if document and document.get("key") == of else {}
            missing = [plan for plan in plans if plan.name not in kept]
            for plan in missing:
                made.setdefault(plan.name, Analysis(plan, departure=departure))
            if missing:
                new = one(rival, number, [made[plan.name] for plan in missing], seed, departure)
                kept |= {name: vars(verdict) for name, verdict in new.items()}
                store.save(file, to_json({"key": of, "plans": kept}))
            for plan in plans:
                v = dict(kept[plan.name])
                v["criteria"] = {k: np.inf if x is None else x for k, x in v["criteria"].items()}
                found[plan.name][rival].append(Verdict(**v))
            yield [Confusion(name, each) for name, each in found.items()]
