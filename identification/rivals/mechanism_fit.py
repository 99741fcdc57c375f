"""Which mechanism made a person's sines: least squares of each, named by evidence.

Each mechanism is fitted to the complex responses of a plan (loads, frequencies, amplitudes,
sensors) over the scatter of a recording, with body mass, gains and the softness of both sensors'
seats free within their stated uncertainty. The one with the largest evidence within its bounds
(Laplace's approximation) is named; below odds of 1000 to 1 the answer is "undecided", and where
none fits it is "none of these".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from identification.branches import DECISIVE_ODDS
from identification.rivals import pad_balance
from identification.rivals.mechanisms import BODY_KG, MASSES, MECHANISMS, Mechanism, pressed
from identification.rivals.motion import hung

Array = np.ndarray
#: Scatter of a response and of a second harmonic, of a sensor's gain, of the stated body mass [1].
NOISE, GAIN, MASS = 0.02, 0.015, 0.05
#: How far a foot's response may depart from every mechanism [1].
DEPARTURE = 0.08
#: Richer mechanisms that contain one: it is named before them unless they fit better.
RICHER = {"constant": ("stiffening",), "second mode": ("both",)}
#: Difference of the criterion that decides: odds of 1000 to 1.
DECIDED = 2 * np.log(DECISIVE_ODDS)
#: Sum of squares per degree of freedom above which no mechanism fits.
FITS = 1.5
#: Damping ratio that is taken for a sensor's seat, and the softest seat that is allowed [Hz].
SEAT_ZETA, SEAT_HZ = 0.2, 70.0
#: Even draws that a fit may start from, of linear mechanisms and of others.
BANK, PRESSED_BANK = 8000, 400
#: Starts of a fit, of linear mechanisms and of others, and its steps.
STARTS, PRESSED_STARTS, STEPS = 2, 1, 25
#: Least share of the time in the air of a foot that leaves the plate.
AIR = 0.05
#: What is left of the static force where a motion counts as balanced.
LEFT = 1e-3
#: How many times larger the table's amplitude is where it counts as another one.
HIGHER = 1.2
#: Times as many starts where no mechanism fits.
MORE = 6
#: A fit whose sum of squares lies so far above another's, and creeps, is given up.
FAR = 100.0
UNDECIDED, NONE = "undecided", "none of these"


@dataclass(frozen=True)
class Plan:
    """Responses to be made, or that were.

    Attributes:
        name: short.
        frequency_hz: (n,).
        added_kg: (n,).
        table: amplitude of the table [m/s^2], (n,).
        tuberosity: whether it is measured.
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
        """The one of the same load and frequency at a greater amplitude, -1 if none, (n,)."""
        hz, kg = self.frequency_hz, self.added_kg
        same = (hz[:, None] == hz) & (kg[:, None] == kg)
        more = same & (self.table > HIGHER * self.table[:, None])
        return np.where(more.any(axis=1), more.argmax(axis=1), -1)

    def only(self, rows: Array) -> "Plan":
        """Some of the recordings, (n,) bool."""
        some = {k: getattr(self, k)[rows] for k in ("frequency_hz", "added_kg", "table")}
        return replace(self, **some)


@dataclass(frozen=True)
class Responses:
    """Responses at a plan's recordings, (n,), or of several draws, (d, n), complex unless stated.

    Attributes:
        MB: malleolus over the table.
        TB: tuberosity over the table.
        second: second harmonic of the malleolus over its first.
        repeats: whether each motion repeats after one period, bool.
        air: share of the time without contact, real; None where it is not known.
        x: balanced motions (d n, u); None where none were sought.
    """

    MB: Array
    TB: Array
    second: Array
    repeats: Array
    air: Array | None = None
    x: Array | None = None

    def only(self, rows: Array) -> "Responses":
        """Some of the recordings, (n,) bool or places."""
        air = None if self.air is None else self.air[..., rows]
        MB, TB, second, repeats = (x[..., rows] for x in (self.MB, self.TB, self.second, self.repeats))
        return Responses(MB, TB, second, repeats, air)


def predict(
    mechanism: Mechanism,
    values: Mapping[str, Array],
    plan: Plan,
    start: Array | None = None,
    nearby: bool = False,
    data: Responses | None = None,
) -> Responses:
    """What a mechanism with constants (d,) gives at the recordings of a plan.

    Args:
        mechanism: which.
        values: constants by name.
        plan: recordings.
        start: balanced motions to begin at, (d n, u), or (n, u) of one draw close by.
        nearby: take one Newton step from `start` with the slope there: exact to first order.
        data: of one draw, begin where these were measured, then at rest.
    """
    f, columns = plan.frequency_hz, {name: value[:, None] for name, value in values.items()}
    if mechanism.response is not None:
        MB, TM = mechanism.response(f, columns, plan.added_kg)
        return Responses(MB, MB * TM, np.zeros_like(MB), np.ones(MB.shape, bool))
    assert mechanism.standing is not None
    M, MF, TM = mechanism.standing(f, columns, plan.added_kg)
    systems = pressed(f, columns, M, plan.added_kg, plan.table)
    if nearby:
        assert start is not None
        x = _one_step(systems, start, len(M))
    elif data is not None:
        first = (data.MB * plan.table / MF[0, :, 0]).ravel()
        second = data.second * data.MB * plan.table / MF[0, :, 1] * 1j if plan.harmonics else 0.0
        x, balanced = pad_balance.solve(systems, pad_balance.begin(systems, first, second))
        if (again := np.flatnonzero(~balanced)).size:
            x[again], _ = pad_balance.solve(systems[again])
    else:
        x, _ = pad_balance.solve(systems, start)
    shape = len(M), f.size
    a = systems.acceleration(x).reshape(*shape, -1) * MF
    left = np.linalg.norm(systems.residual(x, np.arange(systems.omega.size)), axis=1)
    balanced = (left / systems.static < LEFT).reshape(shape)
    MB = a[..., 0] / plan.table
    second = -1j * a[..., 1] / a[..., 0]
    return Responses(MB, MB * TM[..., 0], second, balanced, systems.air(x).reshape(shape), x)


def _one_step(systems: pad_balance.Pressed, start: Array, draws: int) -> Array:
    """Newton's step for all draws with the slope of the first, which is the one at `start`."""
    slope = systems.jacobian(start, np.arange(len(start)))
    try:
        inverse = np.linalg.inv(slope)
    except np.linalg.LinAlgError:  # a motion that bifurcates: the shortest of its steps
        inverse = np.linalg.pinv(slope)
    x = np.tile(start, (draws, 1))
    residual = systems.residual(x, np.arange(systems.omega.size))
    return x - (np.tile(inverse, (draws, 1, 1)) @ residual[..., None])[..., 0]


@dataclass(frozen=True)
class Fitted:
    """One mechanism's best fit.

    Attributes:
        rival: name of the mechanism.
        chi2: sum of squares.
        criterion: -2 log of the evidence, up to what all mechanisms share.
        values: constants by name.
        air: largest share of time in the air.
        MB: what the sensor would read, complex, (n,).
        TB: the same at the tuberosity.
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
    """The verdict for one subject.

    Attributes:
        named: mechanism, `UNDECIDED` or `NONE`.
        best: mechanism with the smallest criterion.
        margin: to the next one.
        per_dof: sum of squares of the best per degree of freedom.
        criteria: of every mechanism.
        left_out: number of recordings left out, as they do not repeat after one period.
    """

    named: str
    best: str
    margin: float
    per_dof: float
    criteria: dict[str, float]
    left_out: int


class Analysis:
    """Names the mechanism behind the recordings of one plan.

    Args:
        plan: the recordings.
        rivals: names of mechanisms.
        bank: draws of linear mechanisms, computed once, that fits start from.
        pressed_bank: of the others.
        departure: how far the foot may be off every mechanism, assumed, not estimated: where it
            is off by more, the answer is "none of these"; where by less, it is "undecided" more
            often than it had to be.
        body_kg: of the person, for the segments' masses.
    """

    def __init__(
        self,
        plan: Plan,
        rivals: Sequence[str] = tuple(MECHANISMS),
        bank: int = BANK,
        pressed_bank: int = PRESSED_BANK,
        departure: float = DEPARTURE,
        body_kg: float = BODY_KG,
    ) -> None:
        self.plan, self.departure = plan, departure
        self.rivals = {name: MECHANISMS[name].of(body_kg) for name in rivals}
        self.bank: dict[str, tuple[Array, Responses]] = {}
        for name, mechanism in self.rivals.items():
            size = pressed_bank if mechanism.pressed else bank, len(mechanism.constants)
            u = np.random.default_rng(1).random(size)
            self.bank[name] = u, predict(mechanism, mechanism.values(u), plan)

    def verdict(self, measured: Responses) -> Verdict:
        """Name the mechanism behind recordings of the plan.

        Those that do not repeat are left out, and where harmonics are recorded they rule out every
        linear mechanism.
        """
        return self.judged(measured)[0]

    def judged(self, measured: Responses) -> tuple[Verdict, list[Fitted]]:
        """The verdict, and the fit of each mechanism, the best one first."""
        kept = measured.repeats
        plan, data = self.plan.only(kept), measured.only(kept)
        fits: list[Fitted] = []
        for name in sorted(self.rivals, key=lambda name: self.rivals[name].pressed):  # quick first
            goal = min((f.chi2 for f in fits), default=np.inf)
            fits.append(self._fit(name, plan, data, kept, goal))
        if plan.harmonics and not kept.all():
            fits = [f if self.rivals[f.rival].pressed else replace(f, criterion=np.inf) for f in fits]
        fits.sort(key=lambda f: f.criterion)
        first, rest = fits[0], fits[1:]
        numbers = _misfit(plan, data, self.departure, data).size
        dof = max(1, numbers - len(self.rivals[first.rival].constants))
        others = [f for f in rest if f.rival not in RICHER.get(first.rival, ())]
        # where only a richer one is left it has to be beaten, too
        margin = min((f.criterion for f in others or rest), default=np.inf) - first.criterion
        per_dof = first.chi2 / dof
        named = NONE if per_dof > FITS else first.rival if margin >= DECIDED else UNDECIDED
        criteria = {f.rival: f.criterion for f in fits}
        return Verdict(named, first.rival, margin, per_dof, criteria, int((~kept).sum())), fits

    def _fit(self, name: str, plan: Plan, data: Responses, kept: Array, goal: float) -> Fitted:
        search = _Search(self.rivals[name], plan, data, self.departure, goal)
        u, drawn = self.bank[name]
        rough = _misfit(plan, data, self.departure, drawn.only(kept))
        order = np.argsort(np.nan_to_num((rough**2).sum(axis=1), nan=np.inf))
        starts = PRESSED_STARTS if self.rivals[name].pressed else STARTS
        best = search.least(u[order[0]])
        for number, at in enumerate(order[1 : MORE * starts], 1):
            if number >= starts and min(goal, best[0]) < FITS * rough.shape[1]:
                break
            best = min(best, search.least(u[at]), key=lambda end: end[0])
        chi2, theta, air, volume = best
        read = search.read(theta[None], None)
        values = search.mechanism.values(theta[None, : search.free])
        constants = {k: float(v[0]) for k, v in values.items()}
        return Fitted(name, chi2, chi2 + volume, constants, air, read.MB[0], read.TB[0])


def _misfit(plan: Plan, data: Responses, departure: float, read: Responses) -> Array:
    """Residuals over their scatter, real, (d, m). What two amplitudes share cancels in a ratio."""
    parts, whole = [], float(np.hypot(NOISE, departure / np.sqrt(2)))
    pair = plan.partner
    paired = pair >= 0
    for pairing in ("MB", "TB")[: 2 if plan.tuberosity else 1]:
        model, measured = getattr(read, pairing), getattr(data, pairing)
        ratio = measured / np.where(paired, measured[pair], 1.0)
        scatter = np.where(paired, NOISE * np.sqrt(2), whole) * np.abs(ratio)
        parts.append((model / np.where(paired, model[..., pair], 1.0) - ratio) / scatter)
    if plan.harmonics:
        parts.append((read.second - data.second) / (NOISE + whole * np.abs(data.second)))
    z = np.concatenate(parts, axis=-1)
    return np.concatenate([z.real, z.imag], axis=-1)


@dataclass(frozen=True)
class _Search:
    """Least squares of one mechanism in theta (p,): shares of its bounds, then the nuisances.

    Nuisances are mass and two gains in standard deviations, and how soft the two seats are.
    `goal` is the sum of squares of another mechanism: a fit that creeps far above it is given up.
    """

    mechanism: Mechanism
    plan: Plan
    data: Responses
    departure: float
    goal: float

    @property
    def free(self) -> int:
        """How many constants the mechanism has."""
        return len(self.mechanism.constants)

    def read(self, theta: Array, start: Array | None, nearby: bool = False) -> Responses:
        """What the sensors read, for theta (d, p)."""
        f, z = self.plan.frequency_hz, theta[:, self.free :]
        values = self.mechanism.values(theta[:, : self.free])
        values = {k: v * (1 + MASS * z[:, 0]) if k in MASSES else v for k, v in values.items()}
        data = self.data if start is None else None
        bone = predict(self.mechanism, values, self.plan, start, nearby, data)
        seats = [SEAT_HZ / np.sqrt(np.maximum(z[:, i], 1e-12))[:, None] for i in (3, 4)]
        s = 2j * np.pi * f
        malleolus, tuberosity = (hung(s, hz, SEAT_ZETA) for hz in seats)
        return replace(
            bone,
            MB=bone.MB * malleolus * (1 + GAIN * z[:, 1:2]),
            TB=bone.TB * tuberosity * (1 + GAIN * z[:, 2:3]),
            second=bone.second * hung(2 * s, seats[0], SEAT_ZETA) / malleolus,
        )

    def residuals(self, theta: Array, start: Array | None, nearby: bool = False) -> tuple[Array, Responses]:
        """Whitened residuals and prior rows, (d, m), for theta (d, p)."""
        read = self.read(theta, start, nearby)
        misfit = _misfit(self.plan, self.data, self.departure, read)
        return np.concatenate([misfit, theta[:, self.free : self.free + 3]], axis=1), read

    def slope(self, theta: Array, middle: Array, start: Array | None) -> Array:
        """Derivatives of the residuals (m, p), taken towards the middle of the bounds."""
        inward = np.where(theta > middle, -1e-6, 1e-6)
        near = np.vstack([theta, theta + np.diag(inward)])
        rows, _ = self.residuals(near, start, nearby=start is not None)
        return (rows[1:] - rows[0]).T / inward

    def least(self, share: Array) -> tuple[float, Array, float, float]:
        """Levenberg's and Marquardt's steps within bounds, from shares (c,).

        Returns:
            Sum of squares; theta (p,); largest share of the time in the air; what the data leave of
            the bounds, -2 log of a volume. A constant that the data do not touch costs nothing:
            counting constants (the Bayesian information criterion) named simple mechanisms for
            their simplicity alone.
        """
        low = np.r_[np.zeros(self.free), np.full(3, -4.0), np.zeros(2)]
        high = np.r_[np.ones(self.free), np.full(3, 4.0), np.ones(2)]
        theta = np.r_[share, np.zeros(3), np.full(2, 0.2)]
        rest, now = self.residuals(theta[None], None)
        best, damp, small = float((rest**2).sum()), 1e-2, 0
        for _ in range(STEPS):
            J = self.slope(theta, 0.5 * (low + high), now.x)
            gradient = J.T @ rest[0]
            out = ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
            J[:, out], gradient[out] = 0.0, 0.0
            N = J.T @ J
            for _ in range(6):
                step = np.linalg.solve(N + np.diag(damp * (N.diagonal() + 1e-3)), gradient)
                new = np.clip(theta - step, low, high)
                later, reached = self.residuals(new[None], now.x)
                total = float((later**2).sum())
                if total < best:
                    break
                damp *= 5
            else:
                break
            ahead = best - self.goal
            enough = 0.15 * ahead if ahead > FAR else 0.1
            small = small + 1 if best - total < enough else 0
            theta, rest, now, best, damp = new, later, reached, total, max(damp / 8, 1e-6)
            if small >= 2:
                break
        J = self.slope(theta, 0.5 * (low + high), now.x)
        volume = float(np.linalg.slogdet(np.eye(theta.size) + J.T @ J / (2 * np.pi))[1])
        return best, theta, 0.0 if now.air is None else float(now.air.max()), volume


@dataclass(frozen=True)
class Confusion:
    """How often each truth was given each name under one plan.

    Attributes:
        plan: name.
        verdicts: truth -> verdicts of its subjects.
    """

    plan: str
    verdicts: Mapping[str, Sequence[Verdict]]

    def count(self, truth: str, name: str) -> int:
        """Subjects of a truth that were given a name."""
        return sum(v.named == name for v in self.verdicts[truth])

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
        names = [(truth, v.named) for truth, some in self.verdicts.items() for v in some]
        return sum(name in MECHANISMS and name != truth for truth, name in names)

    def separated(self, one: str, other: str) -> float:
        """Share of both mechanisms' subjects whose truth beats the other of the pair.

        At 1000 to 1, or by being simpler.
        """
        wins = []
        for truth, rival in ((one, other), (other, one)):
            needed = 0.0 if rival in RICHER.get(truth, ()) else DECIDED
            margins = (v.criteria[rival] - v.criteria[truth] for v in self.verdicts[truth])
            wins += [margin >= needed for margin in margins]
        return sum(wins) / max(1, len(wins))

    def record(self) -> dict[str, Any]:
        """As a document: counts, and the share of each pair that is distinguished."""
        names, truths = (*MECHANISMS, UNDECIDED, NONE), list(self.verdicts)
        pairs = {f"{a} | {b}": self.separated(a, b) for a, b in combinations(truths, 2)}
        named = {truth: {name: self.count(truth, name) for name in names} for truth in truths}
        counts = {"subjects": self.subjects, "right": self.right, "wrong": self.wrong}
        return {"plan": self.plan, **counts, "named": named, "told_apart": pairs}
