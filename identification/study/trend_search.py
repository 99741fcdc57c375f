"""The search of a trend: rough descents from many starts, down to the noise, grown to the order that is wanted."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count, islice
from typing import Any

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD, mirrored
from identification.estimate import Settings
from identification.search import Descent
from identification.space import Space
from identification.study.curves import CurveSpace, Order
from identification.study.levenberg import descend_fast
from identification.study.scatter import TrendDomain, TrendProblem

#: Errors assumed in turn while the search comes nearer, as shares of the fundamental.
_TEMPERS = (0.1, 0.03, 0.01)
#: Order from which the search starts: power laws of frequency, and of the load if there are several.
_FIRST_ORDER = Order(2, 1, 1)
#: Tolerance of the search far from the answer.
_ROUGH = 1e-4
#: Rough ends of a branch that are followed to the noise: with a tenth of the fundamental as its error the second best
#: is often the better one in truth. Each takes two seconds.
_FOLLOWED = 2


@dataclass(frozen=True, eq=False)
class Candidate:
    """One end of the search for a branch: where the coefficients came to rest, and with which weights and scatter."""

    domain: TrendDomain
    problem: TrendProblem
    descent: Descent

    @property
    def deviance(self) -> float:
        """-2 log likelihood up to a constant."""
        return self.problem.deviance(self.descent.z)

    @property
    def space(self) -> CurveSpace:
        """The curves that are searched."""
        return self.problem.curves


@dataclass(frozen=True, eq=False)
class Frame:
    """What all steps need: the foot and its recordings, which parameters are curves, and whether recordings lie off."""

    foot: Foot
    data: list[Recording]
    feet: Space
    curves: tuple[str, ...]
    scatter: bool
    twin: bool
    threads: int

    @property
    def _f(self) -> np.ndarray:
        return np.array([r.condition.frequency_hz for r in self.data])

    @property
    def _loads(self) -> np.ndarray:
        return np.array([r.condition.added_mass_kg for r in self.data])

    @property
    def frequencies(self) -> int:
        """How many different excitation frequencies there are."""
        return len(set(self._f.round(2)))

    @property
    def loads(self) -> int:
        """How many different added masses there are."""
        return len(set(self._loads))

    def ratios(self) -> np.ndarray:
        """a = m_S / (m_S + m_F) of each recording."""
        masses = [{**self.foot.values(), **r.condition.masses} for r in self.data]
        return np.array([m["m_S"] / (m["m_S"] + m["m_F"]) for m in masses])

    def domain(self, order: Order, tau: np.ndarray | None = None) -> TrendDomain:
        """The domain of a fit with curves of this order."""
        space = CurveSpace(self.feet, self.curves, order, self._f, self._loads, self.scatter)
        return TrendDomain(self.foot, self.data, space, self.twin, self.threads, tau=tau)

    def first_order(self) -> Order:
        """The order to begin with."""
        return replace(_FIRST_ORDER, load=min(_FIRST_ORDER.load, self.loads - 1))

    def side(self, space: CurveSpace, z: np.ndarray) -> str:
        """Branch by the mean of log k_T / (a k_F) over the recordings' places on the curves."""
        return STIFF_ANKLE if self.margins(space, z).mean() > 0 else STIFF_PAD

    def margins(self, space: CurveSpace, z: np.ndarray) -> np.ndarray:
        """Log k_T / (a k_F) at each recording."""
        feet = [space.values(space.foot(B[:, : space.size], z[: space.size])[0]) for B in space.weights]
        return np.log([v["k_T"] / (a * v["k_F"]) for v, a in zip(feet, self.ratios(), strict=True)])

    def image(self, space: CurveSpace, z: np.ndarray) -> np.ndarray:
        """Mirror image, point by point, as near as the curves can come to it."""
        feet = space.feet_of(z)
        images = [mirrored(v, a) for v, a in zip(feet, self.ratios(), strict=True)]
        return space.project([self.feet.to_q(self.feet.theta(v)) for v in images])


def explore_trend(
    frame: Frame, settings: Settings, mirror: bool, advance: Callable[[str, int, int], None]
) -> tuple[dict[str, Candidate], list[dict[str, Any]]]:
    """Rough descents without offsets from all starts; the best of each branch are brought down to the noise."""
    rough = replace(frame, scatter=False).domain(frame.first_order())
    space = rough.problem().curves
    model = space.project([frame.feet.to_q(frame.feet.theta(frame.foot.values()))] * len(frame.data))
    wanted = max(settings.starts, 2 if mirror else 1)
    ends: dict[str, list[Descent]] = {}
    rows: list[dict[str, Any]] = []
    for number, (label, z0) in enumerate(islice(_starts(frame, space, model, settings.seed, mirror), wanted), 1):
        problem = rough.problem()
        problem.temper(_TEMPERS[0], model)
        problem.start(z0)
        end = descend_fast(problem, z0, label, _ROUGH)
        name = frame.side(space, end.z) if mirror else "best"
        ends.setdefault(name, []).append(end)
        rows.append({"start": label, "cost": end.cost, "evaluations": end.evaluations, "converged": end.converged,
                     "branch": name})  # fmt: skip
        advance("exploring starts", number, wanted)
    best = [end for near in ends.values() for end in sorted(near, key=lambda end: end.cost)[:_FOLLOWED]]
    followed = [_down(frame.domain(frame.first_order()), end.z, model) for end in best]
    found = likeliest(_named(frame, followed, mirror))
    if not found:
        raise SimulationError(f"{frame.foot.name}: no start of the trend led to a stable motion; check the bounds.")
    return (both_ways(frame, found) if mirror else found), sorted(rows, key=lambda row: float(row["cost"]))


def _starts(
    frame: Frame, space: CurveSpace, model: np.ndarray, seed: int, mirror: bool
) -> Iterator[tuple[str, np.ndarray]]:
    """Names and coefficients: the model's, their mirror image, then random ones without end."""
    yield "model", model
    if mirror:
        yield "mirror of the model", frame.image(space, model)
    rng = np.random.default_rng(seed)
    for number in count(1):
        yield f"random {number}", space.project([frame.feet.random(rng)] * len(frame.data))


def likeliest(candidates: Iterable[tuple[str, Candidate]]) -> dict[str, Candidate]:
    """The best candidate of each branch."""
    found: dict[str, Candidate] = {}
    for name, candidate in candidates:
        if name not in found or candidate.deviance < found[name].deviance:
            found[name] = candidate
    return found


def _named(
    frame: Frame, candidates: Iterable[Candidate | None], mirror: bool = True
) -> Iterator[tuple[str, Candidate]]:
    """Candidates, where there are any, with the branch on which each ended."""
    for each in candidates:
        if each is not None:
            yield (frame.side(each.space, each.descent.z) if mirror else "best"), each


def _down(domain: TrendDomain, z: np.ndarray, anchor: np.ndarray) -> Candidate | None:
    """From coefficients of a rough descent to the noise, with offsets."""
    problem = domain.problem()
    n = problem.curves.weights.shape[2]
    z, anchor = np.append(z, np.zeros(n - z.size)), np.append(anchor, np.zeros(n - anchor.size))
    problem.start(z)
    for share in _TEMPERS:
        problem.temper(share, anchor)
        z = descend_fast(problem, z, "tempered", _ROUGH).z
    return settled(domain, z)


def settled(domain: TrendDomain, z: np.ndarray) -> Candidate | None:
    """The descent from z to its end, None if the motion becomes unstable."""
    try:
        candidate = Candidate(*domain.settle(z))
    except SimulationError:
        return None
    return candidate if np.isfinite(candidate.deviance) else None


def grown(
    frame: Frame, branches: Mapping[str, Candidate], order: Order, advance: Callable[[str, int, int], None]
) -> dict[str, Candidate]:
    """The same branches with other curves: each recording's foot stays, and the curves go through what they can."""
    found = {}
    for number, (name, branch) in enumerate(branches.items()):
        advance(f"curves with {order}", number, len(branches))
        domain = frame.domain(order, branch.problem.tau)
        space, old = domain.problem().curves, branch.space
        on_curve = [B[:, : old.size] @ branch.descent.z[: old.size] for B in old.weights]
        z = space.project(on_curve)
        z[space.size :] = branch.descent.z[old.size :]
        end = settled(domain, z)
        if end is not None:
            found[name] = end
    return found or dict(branches)


def both_ways(frame: Frame, branches: Mapping[str, Candidate]) -> dict[str, Candidate]:
    """Enter each branch from the mirror image of the other too, and keep the better end."""
    entered = []
    for branch in branches.values():
        image = frame.image(branch.space, branch.descent.z)[: branch.space.size]
        entered.append(_down(frame.domain(branch.space.order), image, image))
    return likeliest([*branches.items(), *_named(frame, entered)])
