"""One search: starts that fill the space on both sides of the mirror, and bounded least squares.

Many starts go down together by damped Gauss-Newton steps between bounds (Levenberg and Marquardt), which costs little
more than one. What is half normal rests at its bound in most worlds; there a method that keeps inside its bounds, such
as SciPy's trust region, crawls. Then other starts begin beside the ends, of which they keep what is nearly linear.
Those go on of which a few steps promise most, and new ones begin for as long as they lead to better ends. The search
of a side goes on until its best end was found twice, or says that it is not exhausted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.special import ndtri

from fasbody.progress import Work
from identification.repeatability import repeatability
from identification.residual import Evaluation, Problem, Scatter

#: Starts of a side in one round, and rounds at most.
STARTS, ROUNDS = 12, 6
#: Steps of a round, and the decrease of the sum of squares that is worth no further step.
STEPS, _PROMISED = 40, 0.02
#: That decrease on the way down, and the factor by which the scatter falls there.
_ON_THE_WAY, FALL = 0.2, 5.0
#: Two descents came to the same end where their sums of squares, and their places, differ by less.
SAME, _CLOSE = 0.3, 1.0
#: On the way down two that are nearer than this, in all variables, go on as one.
_ONE = 0.3
#: A side is out of the question where so many starts all ended so far above the other side's end.
_OUT_AFTER, _OUT = 24, 30.0
#: Distances of a start: from the axis of the mirror (rho), of stiffness and damping (logarithm), and bends [1/m].
_APART, _SPREAD, _BENDS = (0.05, 1.5), 0.5, (10.0, 200.0)
#: What is not linear: the dampers' bends, and these groups of nuisances.
_BENT, _NONLINEAR = ("c_12", "c_13", "c_22", "c_23"), ("mount", "rocking", "relaxation")
#: Nuisances on which a residual depends so little linearly that each place has a minimum of its own: each combination
#: of so many places over `_REACH` standard deviations of their priors is tried beside the best ends of a side. What
#: depends on them linearly follows in one step.
_LATTICES, _REACH = ({"rocking frequency": 12, "rocking damping": 3}, {"relaxation time": 8}, {"mount": 6}), 2.0
_ENDS, _ONE_STEP = 2, 1
#: Share of starts of which one of them is drawn anew; of others, each is with these odds.
_ALONE, _REDRAWN = 0.6, 0.6
#: Starts beside ends over random ones, the steps after which as many as these go on, and batches at most.
BESIDE, _SCREENING, _BATCHES = 8, 3, 6
#: Scatters of harmonics where starts begin.
SMOOTH = (0.5, 0.1, 0.02)
#: Scatter below which there is none, ends of a side that are kept, and descents of a side that go on to less scatter.
_LEVEL, _KEPT, _GO_ON = 1e-4, 6, 4
#: How near the scatter is to what its best end leaves over, and rounds of that at most.
_SETTLED, _LEVELS = 0.05, 16
#: Share of its steps that a descent usually takes which begins beside its end.
_NEAR_END = 0.2
#: Steps of the last descent over those of others, and the decrease that is worth no further step there.
_LONGER, _EXACTLY = 5.0, 1e-5
#: Least and largest damping of a step.
LEAST_DAMPING, MOST_DAMPING = 1e-7, 1e12
#: Least element of a diagonal: of a candidate that does not move, all others are zero.
_SOLVABLE = 1e-200
#: Passes to the active set of a step's bounds at most; in the second half none is left again.
_PASSES = 12
#: Cosine between a step and the change of the slope below which a secant says nothing.
_SECANT = 1e-6


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best place of one side of the mirror.

    Attributes:
        sign: 1 for a stiff ankle, -1 for a stiff pad, 0 where there is no mirror.
        q: (n,) search variable.
        objective: sum of squares of the residual and of the priors' rows.
        converged: a step more promises next to nothing.
        hits: how many descents came to it.
        starts: how many random ones were tried.
        behind: how far it is above the best end of all.
        others: (n,) each, other ends of this side, where constants may be just as likely.
    """

    sign: int
    q: np.ndarray
    objective: float
    converged: bool
    hits: int
    starts: int
    behind: float = 0.0
    others: tuple[np.ndarray, ...] = ()

    @property
    def exhausted(self) -> bool:
        """Whether the search of this side came to its end more than once, or only far above the best one."""
        return self.converged and (self.hits > 1 or out_of_the_question(self.starts, self.behind))


def out_of_the_question(starts: int, behind: float) -> bool:
    """Whether enough starts of a side all ended far above the best end: the next would not come near it either."""
    return starts >= _OUT_AFTER and behind > _OUT


@dataclass(frozen=True, eq=False)
class Descended:
    """Where candidates (C, n) ended.

    Attributes:
        Q: (C, n) places.
        objective: (C,) sums of squares there.
        rests: (C,) whether no step is worth while.
        left: (C,) by how much a further step promises to fall; less than zero where several bounds cut it at once,
            infinite where nothing moves.
    """

    Q: np.ndarray
    objective: np.ndarray
    rests: np.ndarray
    left: np.ndarray


def descend(
    problem: Problem, Q: np.ndarray, signs: np.ndarray, steps: int = STEPS, promised: float = _PROMISED,
    work: Work | None = None,
) -> Descended:  # fmt: skip
    """Damped Gauss-Newton steps of many candidates at once, between bounds, along valleys that bend (`bent`).

    Args:
        problem: whose sum of squares falls.
        Q: (C, n) starts.
        signs: (C,) side of each.
        steps: at most.
        promised: decrease of the sum of squares that is worth no further step.
        work: counts each candidate's steps.
    """
    low, high = (np.stack(limit) for limit in zip(*(problem.bounds(s) for s in signs), strict=True))
    Q = np.clip(Q, low, high)
    at, rests = np.arange(len(Q)), np.zeros(len(Q), bool)  # the candidates that still move; those at rest
    now = problem.evaluate(Q)
    work = work or Work()
    work.might((steps + 1) * len(Q))
    work.did(len(Q))
    objective = now.objective
    damping, factor, promise = np.full(len(Q), 1e-2), np.full(len(Q), 2.0), np.full(len(Q), np.inf)
    bend = np.zeros((len(Q), Q.shape[1], Q.shape[1]))
    for number in range(steps + 1):
        A, g = now.normal
        trial, foretold = bounded_step(A + bend[at], g, Q[at], low[at], high[at], damping)
        doubt = (foretold < promised) | (number == steps)  # without damping and bend it would fall by more
        least = np.full(int(doubt.sum()), LEAST_DAMPING)
        left = foretold.copy()
        left[doubt] = bounded_step(A[doubt], g[doubt], Q[at[doubt]], low[at[doubt]], high[at[doubt]], least)[1]
        promise[at] = np.where(now.moves, left, np.inf)
        rests[at] = np.abs(promise[at]) < promised
        go = ~rests[at] & (damping < MOST_DAMPING)
        if not go.any() or number == steps:
            break
        at, damping, factor, now = at[go], damping[go], factor[go], now.rows(go)
        trial, foretold = trial[go], foretold[go]
        after = problem.evaluate(trial, now)
        work.did(len(at))
        gain = np.where(after.moves, objective[at] - after.objective, -1.0)
        better = gain > 0
        bend[at[better]] = bent(bend[at], trial - Q[at], now.jacobian, after)[better]
        good = np.clip(gain / np.maximum(foretold, 1e-9), 0.0, 1.5)
        damping, factor = damped(damping, factor, better, good)
        Q[at] = np.where(better[:, None], trial, Q[at])
        now = now.replaced(after, better)
        objective[at] = now.objective
    return Descended(Q, objective, rests, promise)


def bounded_step(
    A: np.ndarray,
    g: np.ndarray,
    Q: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    damping: np.ndarray,
    along: np.ndarray | None = None,
    room: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """One damped Gauss-Newton step of each candidate, between bounds.

    Args:
        A: (C, n, n) J^T J.
        g: (C, n) J^T r.
        Q: (C, n) places.
        low: (C, n) bounds.
        high: (C, n) bounds.
        damping: (C,) of Levenberg and Marquardt, as a share of the diagonal of A.
        along: (C, n) gradient of a quantity that shall become as large as it can; nothing shall by default.
        room: (C,) by how much the sum of squares may rise for it.

    Returns:
        trial places (C, n) inside the bounds, and by how much the quadratic foretells that the sum of squares falls
        (C,).
    """
    n = Q.shape[1]
    diagonal = np.einsum("cnn->cn", A)
    extra = damping[:, None] * diagonal + np.maximum(1e-12 * diagonal.max(1, keepdims=True), _SOLVABLE)
    B = A.copy()
    B[:, np.arange(n), np.arange(n)] += extra
    least, most, fixed = low - Q, high - Q, high <= low
    towards = np.zeros((*g.shape, 1)) if along is None else along[..., None]
    pushed = g if along is None else 0 * g
    side = np.where((least >= 0) & (pushed > 0), -1, np.where((most <= 0) & (pushed < 0), 1, 0))
    for number in range(_PASSES):  # the active set of bounds, by what runs into them and what they hold back
        held = fixed | (side != 0)
        p = np.where(held, np.where(side < 0, least, np.where(side > 0, most, 0.0)), 0.0)
        rest = g + np.einsum("cnm,cm->cn", B, p)
        free = np.where(held[:, :, None] | held[:, None, :], 0.0, B)
        free[:, np.arange(n), np.arange(n)] += held
        right = np.where(held[..., None], 0.0, np.concatenate([-rest[..., None], towards], 2))
        down, up = np.moveaxis(np.linalg.solve(free, right), -1, 0)
        p = p + down
        force = np.zeros(len(Q))
        if room is not None:  # the damped quadratic is least at p, and rises with the square of the way along `up`
            gain = np.maximum(np.einsum("cn,cn->c", right[..., 1], up), 1e-300)
            force = np.sqrt(np.maximum(room + _falls(B, g, p), 0.0) / gain)
            p = p + force[:, None] * up
        pull = g + np.einsum("cnm,cm->cn", B, p) - force[:, None] * towards[..., 0]
        back = held & (side * pull > 1e-9 * np.abs(g).max(1, keepdims=True)) & (number < _PASSES // 2)
        after = np.where(fixed | back, 0, np.where(held, side, (p > most + 1e-12) - 1 * (p < least - 1e-12)))
        if (after == side).all():
            break
        side = after
    trial = np.clip(Q + p, low, high)
    return trial, _falls(A, g, trial - Q)


def _falls(A: np.ndarray, g: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(C,) by how much the quadratic falls with a step p (C, n)."""
    return np.asarray(-(2 * np.einsum("cn,cn->c", g, p) + np.einsum("cn,cnm,cm->c", p, A, p)))


def damped(
    damping: np.ndarray, factor: np.ndarray, taken: np.ndarray, good: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Damping (C,) of the next step, and its factor (C,) should that fail, as Nielsen (1999) has them.

    Args:
        damping: (C,) of the last step.
        factor: (C,) by which it grows after a failure.
        taken: (C,) whether that step was good enough to be taken.
        good: (C,) how well the quadratic foretold it, 1 where exactly.
    """
    damping = damping * np.where(taken, np.maximum(0.1, 1 - (2 * good - 1) ** 3), factor)
    return np.maximum(LEAST_DAMPING, damping), np.where(taken, 2.0, 2 * factor)


def bent(bend: np.ndarray, step: np.ndarray, jacobian: np.ndarray, after: Evaluation) -> np.ndarray:
    """What the residual's second derivatives add to J^T J (C, n, n), as the last step (C, n) shows it.

    The secant of Dennis, Gay and Welsch (1981), sized as there, but of rank one and never negative.
    """
    change = np.einsum("cmn,cm->cn", after.jacobian - jacobian, after.residual)
    along, already = np.einsum("cn,cn->c", step, change), np.einsum("cn,cnm,cm->c", step, bend, step)
    share = np.where(already > 0, np.clip(along, 0.0, already) / np.maximum(already, 1e-300), 1.0)
    bend = share[:, None, None] * bend
    missing = change - np.einsum("cnm,cm->cn", bend, step)
    size = np.einsum("cn,cn->c", missing, step)
    use = size > _SECANT * np.linalg.norm(missing, axis=1) * np.linalg.norm(step, axis=1)
    update = missing[:, :, None] * missing[:, None, :] / np.where(use, size, 1.0)[:, None, None]
    return bend + np.where(use[:, None, None], update, 0.0)


def finished(
    problem: Problem, q: np.ndarray, sign: int, steps: int = round(_LONGER * STEPS), work: Work | None = None
) -> tuple[np.ndarray, float, bool]:
    """The end of a descent from q (n,), far below a standard error.

    Returns:
        the place (n,), its sum of squares, and whether a further step promises next to nothing: a valley whose floor is
        flat need not be followed to its end.
    """
    down = descend(problem, q[None], np.array([sign]), steps, _EXACTLY, work)
    return down.Q[0], float(down.objective[0]), bool(abs(down.left[0]) < _PROMISED)


def random_starts(problem: Problem, sign: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, n) places that fill one side of the mirror: stiffness, damping and bends; nuisances at their priors."""
    v = problem.variables
    low, high = problem.bounds(sign)
    Q = np.tile(v.start(v.model_values), (count, 1))
    for name, i in v.index.items():
        item = v.space.free[v._item[name]]
        if v.two_mass and name in _BENT[::2]:
            Q[:, i] = rng.choice([-1, 1], count) * rng.uniform(*_BENDS, count) / v.scale[i]
        elif v.two_mass and name in _BENT[1::2]:
            Q[:, i] = rng.uniform(*_BENDS, count) ** 2 / v.scale[i]
        elif item.logarithmic:
            Q[:, i] += rng.normal(0, _SPREAD, count)
        else:
            Q[:, i] = low[i] + (high[i] - low[i]) * rng.uniform(0.3, 0.7, count)
    if sign:
        Q[:, v.index["k_F"]] = sign * rng.uniform(*_APART, count)
    return np.clip(Q, low, high)


@dataclass(frozen=True, eq=False)
class Population:
    """Candidates on their way: places (C, n), side (C,) of each, and how many starts came there (C,)."""

    Q: np.ndarray
    sign: np.ndarray
    hits: np.ndarray
    objective: np.ndarray

    def joined(self, other: "Population") -> "Population":
        """Both together."""
        arrays = ("Q", "sign", "hits", "objective")
        return Population(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in arrays))

    def rows(self, which: Sequence[int] | np.ndarray) -> "Population":
        """Some of them."""
        return Population(self.Q[which], self.sign[which], self.hits[which], self.objective[which])

    def distinct(self, close: float = _CLOSE, most: int | None = None) -> "Population":
        """The best ends of each side; those that came to the same one are counted together."""
        kept: list[int] = []
        hits = np.zeros(len(self.Q), int)
        for i in np.argsort(self.objective):
            same = [k for k in kept if self.sign[k] == self.sign[i]]
            near = [
                k for k in same if self.objective[i] - self.objective[k] < SAME and _near(self.Q[i], self.Q[k], close)
            ]
            if near:
                hits[near[0]] += self.hits[i]
            elif most is None or len(same) < most:
                kept.append(int(i))
                hits[i] = self.hits[i]
        return replace(self, hits=hits).rows(kept)

    def behind(self, sign: int) -> float:
        """How far the best end of a side is above the best of all."""
        return self.least(sign) - float(self.objective.min())

    def least(self, sign: int) -> float:
        """Sum of squares at the best end of a side."""
        return float(self.objective[self.best(sign)])

    def best(self, sign: int | None = None) -> int:
        """Where the best end is, of one side or of all."""
        mine = np.ones(len(self.Q), bool) if sign is None else self.sign == sign
        return int(np.flatnonzero(mine)[np.argmin(self.objective[mine])])


def _near(q: np.ndarray, other: np.ndarray, close: float) -> bool:
    """Whether two places (n,) are one, in the units of the variables."""
    return bool(np.abs(q - other).max() < close)


@dataclass(frozen=True, eq=False)
class Searched:
    """What a search found.

    Attributes:
        problem: with the weights that were settled on.
        optima: the best end of each side, best first.
    """

    problem: Problem
    optima: tuple[Optimum, ...]


@dataclass(frozen=True)
class Effort:
    """How much a search does.

    Attributes:
        starts: of a side in a round.
        rounds: at most.
        beside: starts beside ends, over these.
        smooth: scatters at which starts begin in turn, the largest first.
        fall: factor by which the scatter falls from one descent to the next.
        steps: of a descent at most; the last one may take five times as many.
    """

    starts: int = STARTS
    rounds: int = ROUNDS
    beside: int = BESIDE
    smooth: tuple[float, ...] = SMOOTH
    fall: float = FALL
    steps: int = STEPS


def search(
    problem: Problem,
    signs: tuple[int, ...],
    effort: Effort | None = None,
    *,
    seed: int = 0,
    estimate: bool = True,
    first: np.ndarray | None = None,
    work: Work | None = None,
) -> Searched:
    """The best end of each side, and how well recordings repeat.

    Where recordings repeat to some ten per cent only, the landscape is smooth. Starts go down there, then where they
    repeat better, until the scatter is what the best end leaves over (`repeatability`), or none. Some begin where it is
    smoothest, others later: ends that the former pass by, the latter find.

    Args:
        problem: what to minimise.
        signs: sides of the mirror, (1, -1), or (0,) where there is none.
        effort: how much is done for it.
        seed: of the starts.
        estimate: the scatter from recording to recording; else it is none.
        first: (k, n) places to begin with besides, at the smallest of the scatters.
        work: counts the steps of each candidate, and about how many may still come.
    """
    effort, rng = effort or Effort(), np.random.default_rng(seed)
    descents = _Descents(effort.steps, work or Work(), _NEAR_END * effort.steps * len(signs))
    population: Population | None = None
    tried = dict.fromkeys(signs, 0)
    images: set[bytes] = set()
    open_ = list(signs)
    for number in range(effort.rounds):
        fresh = [_fresh(problem, open_, count, rng) for count in _shares(effort.starts, effort.smooth)]
        if first is not None and number == 0:
            fresh[-1] = fresh[-1].joined(_everywhere(first, signs))
        for sign in open_:
            tried[sign] += sum(int(np.sum(group.sign == sign)) for group in fresh)
        last = None if estimate and population is None else problem.scatter
        a_start = effort.beside * (_SCREENING + 1) + effort.steps + 1
        descents.after = descents.last + len(open_) * effort.starts * a_start
        problem, ends = _annealed(problem, dict(zip(effort.smooth, fresh, strict=True)), last, effort.fall, descents)
        population = ends if population is None else population.joined(ends).distinct(most=_KEPT)
        population = _with_images(problem, population, signs, images, descents)
        population, restless = _improved(problem, population, open_, effort, rng, descents)
        if estimate:
            problem, population = _settled(problem, population, descents)
        open_ = [
            sign
            for sign in signs
            if (sign in restless or population.hits[population.best(sign)] < 2)
            and not out_of_the_question(tried[sign], population.behind(sign))
        ]
        if not open_:
            break
    assert population is not None
    descents.expect(_NEAR_END * len(signs), 0.0)
    optima = [_optimum(problem, population, sign, tried[sign], descents) for sign in signs]
    return Searched(problem, tuple(sorted(optima, key=lambda o: o.objective)))


def _shares(starts: int, smooth: tuple[float, ...]) -> list[int]:
    """How many of the starts begin at each smoothness."""
    return [len(range(i, starts, len(smooth))) for i in range(len(smooth))]


def _fresh(problem: Problem, signs: list[int], starts: int, rng: np.random.Generator) -> Population:
    """Random starts of each side."""
    Q = [random_starts(problem, sign, starts, rng) for sign in signs]
    return _starting(np.concatenate(Q), np.repeat(signs, starts))


def _redrawn(
    problem: Problem, population: Population, signs: list[int], count: int, rng: np.random.Generator
) -> Population:
    """Ends of each side, the best one half of the time, of which something that is not linear is drawn anew.

    Ends differ most in the dampers' bends, a resonance and the time in which a spring relaxes: often in one of these,
    sometimes in several. An end of which nothing is drawn is no start: to come back to it is no second find.
    """
    kinds = np.stack(_kinds(problem)) & ~problem.held
    kinds, groups, sides = kinds[kinds.any(1)], [], []
    for sign in signs:
        ends = np.flatnonzero(population.sign == sign)
        Q = population.Q[np.where(rng.random(count) < 0.5, population.best(sign), rng.choice(ends, count))]
        alone = np.arange(len(kinds)) == rng.integers(max(1, len(kinds)), size=(count, 1))
        several = rng.random((count, len(kinds))) < _REDRAWN
        anew = np.where(rng.random((count, 1)) < _ALONE, alone, several) @ kinds
        drawn = np.where(anew, _drawn(problem, sign, count, rng), Q)[anew.any(1)]
        groups.append(drawn)
        sides += len(drawn) * [sign]
    return _starting(np.concatenate(groups), np.array(sides, int))


def _on_lattices(problem: Problem, population: Population, signs: list[int]) -> Population:
    """The best ends of each side that may be the better one, with all places of each of `_LATTICES`."""
    v, (mean, _) = problem.variables, problem.variables.prior
    groups, sides = [np.zeros((0, v.size))], []
    for sign in (sign for sign in signs if population.behind(sign) < _OUT):
        low, high = problem.bounds(sign)
        ends = population.rows(population.sign == sign)
        ends = ends.rows(np.argsort(ends.objective)[:_ENDS])
        for end, lattice in product(ends.Q, _LATTICES):
            places = [
                [v.place(item) for item in v.nuisances if item.kind == kind and not problem.held[v.place(item)]]
                for kind in lattice
            ]
            for at in map(list, product(*places)):
                steps = np.meshgrid(*(np.linspace(-_REACH, _REACH, count) for count in lattice.values()))
                Q = np.tile(end, (steps[0].size, 1))
                Q[:, at] = mean[at] + np.stack([step.ravel() for step in steps], 1)
                groups.append(np.clip(Q, low, high))
                sides += len(Q) * [sign]
    return _starting(np.concatenate(groups), np.array(sides, int))


def _kinds(problem: Problem) -> list[np.ndarray]:
    """Masks (n,) of variables that are drawn together."""
    v = problem.variables
    names = [*v.constants, *(item.group for item in v.nuisances)]
    return [np.isin(names, kind) for kind in (_BENT if v.two_mass else (), *_NONLINEAR)]


def _drawn(problem: Problem, sign: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, n) random starts whose nuisances are drawn from their priors, each spread evenly over its own."""
    Q, first = random_starts(problem, sign, count, rng), len(problem.variables.constants)
    mean, std = problem.variables.prior
    rank = rng.permuted(np.tile(np.arange(count)[:, None], mean.size - first), axis=0)
    Q[:, first:] = mean[first:] + std[first:] * ndtri((rank + rng.random(rank.shape)) / count)
    return np.clip(Q, *problem.bounds(sign))


def _everywhere(places: np.ndarray, signs: tuple[int, ...]) -> Population:
    """Places (k, n) to begin with on every side."""
    return _starting(np.tile(places, (len(signs), 1)), np.repeat(signs, len(places)))


def _starting(Q: np.ndarray, signs: np.ndarray) -> Population:
    return Population(Q, signs, np.ones(len(Q), int), np.full(len(Q), np.inf))


def _annealed(
    problem: Problem, groups: Mapping[float, Population], last: Scatter | None, fall: float, descents: "_Descents"
) -> tuple[Problem, Population]:
    """Starts followed down to a scatter, each group from its own, to the distinct ends there.

    Args:
        problem: what to minimise.
        groups: starts by the scatter at which they begin.
        last: scatter at which they end; None where it is what the best of them leaves over.
        fall: factor by which it falls.
        descents: of the search.
    """
    rest = sorted(groups.items(), key=lambda item: -item[0])
    goal = problem.with_scatter(last or Scatter())
    level, population = max(rest[0][0], goal.repeatability), rest[0][1]
    rest, arrived = rest[1:], False
    for _ in range(_LEVELS):
        while rest and (arrived or rest[0][0] > 0.99 * level):
            population = population.joined(rest.pop(0)[1])
        problem = goal if arrived else goal.with_repeatability(level)
        waiting = sum(len(group.Q) for _, group in rest)
        levels = max(0.0, np.log(max(level, _LEVEL) / max(goal.repeatability, _LEVEL)) / np.log(fall))
        full = 0.0 if arrived else 1 + np.ceil(levels)
        descents.expect(len(population.Q) * (full + _NEAR_END) + waiting, descents.after)
        population = descents.down(problem, population, _PROMISED if arrived else _ON_THE_WAY)
        population = population.distinct(_ONE, _GO_ON)
        if last is None:
            goal = _reweighed(problem, population)
        if arrived and not rest and problem.scatter.near(goal.scatter, _SETTLED):
            break
        size = goal.repeatability
        arrived = level <= fall * size or level < fall * _LEVEL
        level = size if arrived else level / fall
    return problem, population.distinct(most=_KEPT)


def _reweighed(problem: Problem, population: Population) -> Problem:
    """With the weights that the best end makes likely."""
    best = population.Q[population.best()]
    problem = problem.weighed(best)
    return problem.with_scatter(repeatability(problem, best))


def _settled(problem: Problem, population: Population, descents: "_Descents") -> tuple[Problem, Population]:
    """Ends where the scatter is what the best of them leaves over."""
    for _ in range(_LEVELS):
        after = _reweighed(problem, population)
        if problem.scatter.near(after.scatter, _SETTLED):
            break
        problem = after
        descents.expect(_NEAR_END * len(population.Q), descents.last)
        population = descents.down(problem, population).distinct()
    return problem, population


@dataclass(eq=False)
class _Descents:
    """How the descents of a search go.

    Attributes:
        steps: of each at most.
        work: counts the steps of each candidate.
        last: steps that come when the ends of all rounds are known.
        after: steps that come after the first descents of a round.
    """

    steps: int
    work: Work
    last: float
    after: float = 0.0

    def expect(self, count: float, after: float) -> None:
        """So many descents of a candidate may still come, and after them so many steps."""
        self.work.expect(count * (self.steps + 1) + after)

    def down(self, problem: Problem, population: Population, promised: float = _PROMISED) -> Population:
        """Where candidates come to."""
        down = descend(problem, population.Q, population.sign, self.steps, promised, self.work)
        return replace(population, Q=down.Q, objective=down.objective)


def _with_images(
    problem: Problem, population: Population, signs: tuple[int, ...], done: set[bytes], descents: _Descents
) -> Population:
    """Ends, with those below the mirror images of each side's best one, where that is new."""
    best = [population.best(sign) for sign in signs if sign]
    best = [i for i in best if population.Q[i].tobytes() not in done]
    done |= {population.Q[i].tobytes() for i in best}
    if not best:
        return population
    images = _starting(problem.variables.image(population.Q[best]), -population.sign[best])
    images = replace(images, hits=0 * images.hits)  # of an end that is there already, its own image is no second find
    descents.expect(len(images.Q), descents.after)
    joined = population.joined(descents.down(problem, images)).distinct(most=_KEPT)
    return replace(joined, hits=np.maximum(joined.hits, 1))


def _improved(
    problem: Problem,
    population: Population,
    signs: list[int],
    effort: Effort,
    rng: np.random.Generator,
    descents: _Descents,
) -> tuple[Population, list[int]]:
    """Ends, with better ones that lie near them, and the sides whose best end may not be the last.

    Args:
        problem: what to minimise.
        population: ends.
        signs: sides that are searched.
        effort: of the search.
        rng: for the starts.
        descents: of the search.
    """
    followed = effort.starts
    for _ in range(_BATCHES):
        near = _redrawn(problem, population, signs, effort.beside * followed, rng)
        if not len(near.Q):
            return population, []
        beyond = _on_lattices(problem, population, signs)
        screening = (_SCREENING + 1) * len(near.Q) + (_ONE_STEP + 1) * len(beyond.Q)
        descents.expect(followed * len(signs), descents.last + screening)
        before = {sign: population.least(sign) for sign in signs}
        near = _promising(problem, near, followed, descents.work)
        if len(beyond.Q):
            near = near.joined(_promising(problem, beyond, followed, descents.work, before, _ONE_STEP))
        population = population.joined(descents.down(problem, near)).distinct(most=_KEPT)
        signs = [sign for sign in signs if population.least(sign) < before[sign] - SAME]
        if not signs:
            break
    return population, signs


def _promising(
    problem: Problem, population: Population, count: int, work: Work | None = None,
    above: Mapping[int, float] | None = None, steps: int = _SCREENING,
) -> Population:  # fmt: skip
    """So many of each side that a few steps bring, or promise to bring, farthest down.

    Args:
        problem: what to minimise.
        population: starts.
        count: of a side at most.
        work: counts the steps.
        above: of each side the sum of squares that they must promise to fall below, any if there is none.
        steps: before they are compared.
    """
    down = descend(problem, population.Q, population.sign, steps, work=work)
    promised = np.where(np.isfinite(down.left), down.objective - down.left, np.inf)
    least = np.array([(above or {}).get(sign, np.inf) for sign in population.sign.tolist()])
    order = [i for i in np.argsort(promised) if promised[i] < least[i] - SAME]
    sides = [[i for i in order if population.sign[i] == sign][:count] for sign in np.unique(population.sign)]
    return replace(population, Q=down.Q, objective=down.objective).rows(np.concatenate(sides).astype(int))


def _optimum(problem: Problem, population: Population, sign: int, tried: int, descents: _Descents) -> Optimum:
    """The best of a side's ends, finished."""
    best, side = population.best(sign), population.sign == sign
    longer = round(_LONGER * descents.steps)
    q, objective, converged = finished(problem, population.Q[best], sign, longer, descents.work)
    near = side & (population.objective < max(population.objective[best], objective) + SAME)
    hits, others = int(population.hits[near].sum()), side & (np.arange(side.size) != best)
    behind = population.behind(sign)
    return Optimum(sign, q, objective, converged, hits, tried, behind, tuple(population.Q[others]))
