"""The search of a trend: rough descents from many starts, down to the noise, grown to the order that is wanted."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fasbody.exceptions import SimulationError
from fasbody.model import Foot
from fasbody.recording import Recording
from identification.branches import STIFF_ANKLE, STIFF_PAD, mirrored
from identification.estimate import Settings
from identification.search import Descent
from identification.space import Space
from identification.study.curves import CurveSpace, Order
from identification.study.levenberg import descend_fast
from identification.study.scatter import TrendProblem, TrendRoute

#: Errors assumed in turn while the search comes nearer, as shares of the fundamental.
_TEMPERS = (0.1, 0.03, 0.01)
#: Order from which the search starts: power laws of frequency, and of the load if there are several.
_FIRST_ORDER = Order(2, 1, 1)
#: Tolerance of the search far from the answer.
_ROUGH = 1e-4
#: Rough ends a branch that are followed to the noise.
_CANDIDATES = 2


@dataclass
class State:
    """A branch while it is sought."""

    route: TrendRoute
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
    """What all steps need."""

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

    def route(self, order: Order, scatter: bool | None = None, tau: np.ndarray | None = None) -> TrendRoute:
        """The route of a fit with curves of this order."""
        on = self.scatter if scatter is None else scatter
        space = CurveSpace(self.feet, self.curves, order, self._f, self._loads, on)
        return TrendRoute(self.foot, self.data, space, self.twin, self.threads, tau)

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
) -> tuple[dict[str, State], list[dict[str, Any]]]:
    """Rough descents without offsets from all starts; the best of each branch is brought down to the noise."""
    rough = frame.route(frame.first_order(), scatter=False)
    space = rough.explorer().curves
    model = space.project([frame.feet.to_q(frame.feet.theta(frame.foot.values()))] * len(frame.data))
    starts = [("model", model)] + ([("mirror of the model", frame.image(space, model))] if mirror else [])
    rng = np.random.default_rng(settings.seed)
    for i in range(settings.starts):
        starts.append((f"random {i + 1}", space.project([frame.feet.random(rng)] * len(frame.data))))
    ends, rows = [], []
    wanted = starts[: max(settings.starts, 2 if mirror else 1)]
    for number, (label, z0) in enumerate(wanted):
        problem = rough.explorer()
        problem.temper(_TEMPERS[0], model)
        problem.start(z0)
        d = descend_fast(problem, z0, label, _ROUGH)
        name = frame.side(space, d.z) if mirror else "best"
        ends.append((d.cost, name, d))
        rows.append({"start": label, "cost": d.cost, "evaluations": d.evaluations, "converged": d.converged,
                     "branch": name})  # fmt: skip
        advance("exploring starts", number + 1, len(wanted))
    ends.sort(key=lambda e: e[0])
    states: dict[str, State] = {}
    for name in (STIFF_ANKLE, STIFF_PAD) if mirror else ("best",):
        for d in [d for _, n, d in ends if n == name][:_CANDIDATES]:
            keep(states, frame, _down(frame, frame.route(frame.first_order()), d.z, model), mirror)
    if not states:
        raise SimulationError(f"{frame.foot.name}: no start of the trend led to a stable motion; check the bounds.")
    return (both_ways(frame, states) if mirror else states), sorted(rows, key=lambda row: float(row["cost"]))


def keep(states: dict[str, State], frame: Frame, state: State | None, mirror: bool = True) -> None:
    """Put a state among those of each branch, if it is the best of its own."""
    if state is None:
        return
    name = frame.side(state.space, state.descent.z) if mirror else "best"
    if name not in states or state.deviance < states[name].deviance:
        states[name] = state


def _down(frame: Frame, route: TrendRoute, z: np.ndarray, anchor: np.ndarray) -> State | None:
    """From coefficients of a rough descent to the noise, with offsets."""
    problem = route.explorer()
    n = problem.curves.weights.shape[2]
    z, anchor = np.append(z, np.zeros(n - z.size)), np.append(anchor, np.zeros(n - anchor.size))
    problem.start(z)
    for share in _TEMPERS:
        problem.temper(share, anchor)
        z = descend_fast(problem, z, "tempered", _ROUGH).z
    return settled(route, z)


def settled(route: TrendRoute, z: np.ndarray) -> State | None:
    """The descent from z to its end, None if the motion becomes unstable."""
    try:
        problem, descent = route.settle(z)
    except SimulationError:
        return None
    state = State(route, problem, descent)
    return state if np.isfinite(state.deviance) else None


def grown(
    frame: Frame, states: Mapping[str, State], order: Order, advance: Callable[[str, int, int], None]
) -> dict[str, State]:
    """The same branches with other curves: each recording's foot stays, and the curves go through what they can."""
    found = {}
    for number, (name, state) in enumerate(states.items()):
        advance(f"curves with {order}", number, len(states))
        route = frame.route(order, tau=state.problem.tau)
        space, old = route.explorer().curves, state.space
        on_curve = [B[:, : old.size] @ state.descent.z[: old.size] for B in old.weights]
        z = space.project(on_curve)
        z[space.size :] = state.descent.z[old.size :]
        grown = settled(route, z)
        if grown is not None:
            found[name] = grown
    return found or dict(states)


def both_ways(frame: Frame, states: dict[str, State]) -> dict[str, State]:
    """Enter each branch from the mirror image of the other too, and keep the better end."""
    found = dict(states)
    for state in states.values():
        image = frame.image(state.space, state.descent.z)[: state.space.size]
        keep(found, frame, _down(frame, frame.route(state.space.order), image, image))
    return found
