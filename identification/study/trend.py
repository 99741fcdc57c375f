"""The trend: all recordings of one subject and posture as smooth functions of frequency and load, estimated jointly.

The search makes rough descents from many starts, brings the best down to the noise, and grows them to the order that is
wanted; both mirror branches are certified in MuJoCo and reported with standard errors.
"""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import count, islice
from typing import Any

import numpy as np
from scipy.stats import chi2

from fasbody.exceptions import SettingError, SimulationError
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.branches import EXCHANGED, STIFF_ANKLE, STIFF_PAD, Verdict, has_mirror, judge, mirrored
from identification.certification import Replay, replay, size_that_matters
from identification.domains import choose_domain
from identification.engines.twin import twin_applies
from identification.estimate import Settings
from identification.result import Estimate, RecordingFit, identifiability
from identification.search import Descent
from identification.space import Space, space_of
from identification.study.curves import CurveSpace, Order
from identification.study.levenberg import descend_fast
from identification.study.orders import choose
from identification.study.scatter import TrendDomain, TrendProblem

#: Parameters that are functions of frequency and load; the others are constants of the subject.
CURVES = EXCHANGED
_ROUNDS = 3
#: Scatter about a curve (of the logarithm) beyond which it does not describe the recordings.
_POOR = 0.3
#: Evaluations in MuJoCo at most: the twin is already there, and differs by rounding.
_CERTIFYING = 8
#: Errors assumed in turn while the search comes nearer, as shares of the fundamental.
_TEMPERS = (0.1, 0.03, 0.01)
#: Order from which the search starts: power laws of frequency, and of the load if there are several.
_FIRST_ORDER = Order(2, 1, 1)
#: Tolerance of the search far from the answer.
_ROUGH = 1e-4
#: Rough ends of a branch that are followed to the noise: with a tenth of the fundamental as its error the second best
#: is often the better one in truth. Each takes two seconds.
_FOLLOWED = 2
_Z95 = 1.959963984540054


@dataclass(frozen=True, eq=False)
class TrendBranch:
    """One of the two mirror solutions of a trend.

    Attributes:
        name: "stiff ankle", "stiff pad" or "best". deviance: -2 log likelihood, offsets integrated out.
        aic, bic: information criteria. chi_square, dof: misfit, offsets included. fit_percent: mean over recordings.
        z: coefficients and offsets. covariance: of the coefficients. scatter: of each curve between recordings.
        space: what they are coefficients of. crosses: k_T passes its mirror image k_F a somewhere.
    """

    name: str
    deviance: float
    aic: float
    bic: float
    chi_square: float
    dof: int
    fit_percent: float
    z: np.ndarray
    covariance: np.ndarray
    scatter: Mapping[str, float]
    space: CurveSpace
    crosses: bool

    @property
    def beta(self) -> np.ndarray:
        """Coefficients (n,)."""
        return self.z[: self.space.size]

    def at(self, frequency_hz: float, added_mass_kg: float) -> dict[str, Estimate]:
        """Parameters of a foot on the curves, key with unit -> estimate, with standard errors given the order."""
        feet = self.space.feet
        B = self.space.design(np.array([frequency_hz]), np.array([added_mass_kg]))[0]
        q = B @ self.beta
        std_q = np.sqrt(np.maximum(0.0, np.einsum("pn,nm,pm->p", B, np.nan_to_num(self.covariance), B)))
        known = ~np.isnan(np.diag(self.covariance))
        theta = feet.to_theta(q)
        lower, upper = feet.bounds  # limits beyond them say no more, and their exponentials outgrow all numbers
        low = feet.to_theta(np.maximum(q - _Z95 * std_q, np.minimum(q, lower)))
        high = feet.to_theta(np.minimum(q + _Z95 * std_q, np.maximum(q, upper)))
        found = {}
        for i, item in enumerate(feet.free):
            held = not known[np.abs(B[i]) > 1e-9].any()
            std = float("nan") if held else float(std_q[i] * feet.slope(theta)[i])
            size = size_that_matters(item)
            word = identifiability(theta[i], std, size, held)
            found[item.key] = Estimate(float(theta[i]), std, float(low[i]), float(high[i]), held, word)
        return found

    def document(self) -> dict[str, Any]:
        """The branch as plain data: its coefficients, and the parameters at each frequency and load recorded."""
        space = self.space
        std = np.sqrt(np.diag(self.covariance))
        where = sorted({(round(float(m), 6), round(float(f), 2)) for f, m in zip(space.frequencies_hz, space.loads_kg,
                                                                                 strict=True)})  # fmt: skip
        return {
            "name": self.name, "deviance": self.deviance, "aic": self.aic, "bic": self.bic,
            "chi_square": self.chi_square, "dof": self.dof, "fit_percent": self.fit_percent, "crosses": self.crosses,
            "scatter": dict(self.scatter),
            "coefficients": {
                label: {"value": float(v), "std_error": float(s)}
                for label, v, s in zip(space.labels, self.beta, std, strict=True)
            },
            "points": [
                {"frequency_hz": f, "added_mass_kg": m, "parameters": {k: asdict(e) for k, e in self.at(f, m).items()}}
                for m, f in where
            ],
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class TrendResult:
    """What a trend found; `document()` is its JSON."""

    source: str
    origin: str
    model: str
    order: Order
    orders: tuple[Mapping[str, Any], ...]
    branches: tuple[TrendBranch, ...]
    recordings: tuple[RecordingFit, ...]
    verdict: str
    reason: str
    log_likelihood_ratio: float
    twin_mujoco_difference: float | None
    base_acceleration_error: float
    starts: tuple[Mapping[str, Any], ...]
    warnings: tuple[str, ...]
    seconds: float

    @property
    def best(self) -> TrendBranch:
        """The likelier branch."""
        return self.branches[0]

    @property
    def p_value(self) -> float | None:
        """Chance of a misfit as large; the scatter has been learnt from the same data, so it is rarely small."""
        return float(chi2.sf(self.best.chi_square, self.best.dof)) if self.best.dof else None

    def feet(self, branch: TrendBranch | None = None) -> list[dict[str, float]]:
        """Parameters of every recording's own foot, its offsets from the curves included."""
        chosen = branch or self.best
        return chosen.space.feet_of(chosen.z)

    def document(self) -> dict[str, Any]:
        """The result as plain data."""
        best = self.best
        return {
            "source": self.source, "origin": self.origin, "model": self.model, "domain": "periodic",
            "fit_percent": best.fit_percent, "chi_square": best.chi_square, "dof": best.dof, "p_value": self.p_value,
            "aic": best.aic, "bic": best.bic,
            "order": asdict(self.order), "orders": [dict(o) for o in self.orders],
            "verdict": self.verdict, "verdict_reason": self.reason,
            "log_likelihood_ratio": self.log_likelihood_ratio,
            "recordings": [
                {"file": r.file, "frequency_hz": r.frequency_hz, "added_mass_kg": r.added_mass_kg,
                 "fit_percent": r.fit_percent, "foot": foot}
                for r, foot in zip(self.recordings, self.feet(), strict=True)
            ],
            "branches": [branch.document() for branch in self.branches],
            "twin_mujoco_difference": self.twin_mujoco_difference,
            "base_acceleration_error": self.base_acceleration_error,
            "starts": [dict(start) for start in self.starts],
            "warnings": list(self.warnings), "seconds": self.seconds,
        }  # fmt: skip

    def __str__(self) -> str:
        scatter = ", ".join(f"{name} {100 * tau:.1f} %" for name, tau in self.best.scatter.items())
        return (
            f"{self.best.name}, {self.order}; fit {self.best.fit_percent:.1f} %; recordings scatter about the curves "
            f"by {scatter}. {self.reason}"
        )


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


def fit_trend(
    recordings: Sequence[Recording],
    foot: Foot,
    settings: Settings | None = None,
    *,
    order: Order | None = None,
    curves: Sequence[str] = CURVES,
    scatter: bool = True,
    criterion: str = "bic",
    certify: bool = True,
    source: str = "",
) -> TrendResult:
    """Estimate smooth curves over frequency and load from all recordings of one subject in one posture.

    Args:
        recordings: steady ones, at two frequencies or more. foot: the model. settings: as for a fit; the domain is
            always the steady state. order: how many coefficients; None lets the criterion choose.
        curves: parameters that are functions; the other free ones are constants. scatter: recordings lie off them.
        criterion: "bic" or "aic". certify: converge on the MuJoCo rollout.
        source: what to call the data.

    Raises:
        RecordingError: a recording cannot serve. SettingError: an option cannot be meant, or there is one frequency.
        SimulationError: no start led anywhere.
    """
    began = time.perf_counter()
    settings = settings or Settings()
    data = [checked(recording) for recording in recordings]
    warnings = [text for recording in data for text in recording.warnings]
    warnings += choose_domain(data, "periodic")[1]
    feet = space_of(foot, settings.free, settings.bounds, settings.delay is not False)
    twin = twin_applies(foot)
    frame = Frame(foot, data, feet, tuple(n for n in curves if n in feet.names), scatter, twin, settings.threads)
    if frame.frequencies < 2:
        raise SettingError("a trend needs recordings at two or more frequencies; use per-recording fits.")
    why_not = has_mirror(feet.names, foot.parameters)
    states, starts = explore_trend(frame, settings, not why_not)
    tried: list[dict[str, Any]] = []
    if order is None:
        for _ in range(_ROUNDS):
            best = min(states.values(), key=lambda s: s.deviance)
            wanted, tried = choose(best.problem, best.descent.z, criterion)
            if wanted == best.space.order:
                break
            states = grown(frame, states, wanted)
    else:
        states = grown(frame, states, order)
    if not why_not:
        states = both_ways(frame, states)
    certified = []
    unstable: dict[str, SimulationError] = {}
    for name, state in sorted(states.items(), key=lambda item: item[1].deviance):
        try:
            certified.append(_certify(frame, name, state, certify))
        except SimulationError as problem:
            unstable[name] = problem
    if not certified:
        raise next(iter(unstable.values()))
    warnings += [f"The {n} branch ends where the foot is unstable in MuJoCo; it is not reported." for n in unstable]
    certified.sort(key=lambda pair: pair[0].deviance)
    branches, runs = [c[0] for c in certified], [c[1] for c in certified]
    best_branch = branches[0]
    verdict = judge([b.name for b in branches], [b.deviance for b in branches], best_branch.chi_square, best_branch.dof)
    if why_not:
        verdict = Verdict("not compared", 0.0, why_not)
    elif unstable:
        verdict = Verdict("not compared", 0.0, _lost(next(iter(unstable)), branches[0].name))
    elif verdict.word == "decided" and poor(best_branch.scatter):
        verdict = Verdict("undecided", verdict.log_likelihood_ratio, _meaningless(best_branch.scatter))
    warnings += _advice(best_branch, frame)
    return TrendResult(
        source=source or data[0].file,
        origin=next((r.origin for r in data if r.origin != "measured"), "measured"),
        model=foot.name,
        order=best_branch.space.order,
        orders=tuple(tried),
        branches=tuple(branches),
        recordings=tuple(RecordingFit.of(r, f, y) for r, f, y in zip(data, runs[0].fits, runs[0].traces, strict=True)),
        verdict=str(verdict),
        reason=verdict.sentence,
        log_likelihood_ratio=verdict.log_likelihood_ratio,
        twin_mujoco_difference=runs[0].twin_difference,
        base_acceleration_error=runs[0].base_error,
        starts=tuple(starts),
        warnings=tuple(dict.fromkeys(warnings)),
        seconds=time.perf_counter() - began,
    )


def _lost(name: str, kept: str) -> str:
    return f"The {name} branch ends where the foot is unstable in MuJoCo, so {kept} was compared with nothing."


def _certify(frame: Frame, name: str, state: Candidate, certify: bool) -> tuple[TrendBranch, Replay]:
    """Converge on the MuJoCo rollout, run the recordings, and gather what is reported."""
    domain, problem, descent = state.domain, state.problem, state.descent
    final = problem
    if certify:
        final = domain.certified(problem)
        descent = descend_fast(final, descent.z, descent.label, 1e-7, _CERTIFYING)
    space, z = state.space, descent.z
    if certify:
        states = [final.states(descent.z, i) for i in range(len(frame.data))]
        run = replay(domain.foot, frame.data, space.feet_of(z), states, frame.twin)
    else:
        run = Replay([r.malleolus_m_s2 for r in frame.data], [float("nan")] * len(frame.data), float("nan"), None)
    harmonics = sum(2 * line.count for line in problem.lines)
    dof = max(0, harmonics - space.size)
    free = ~space.at_bound(z)
    excess = max(1.0, descent.cost / max(1, dof))
    covariance = excess * final.covariance(z, free)[: space.size, : space.size]
    deviance = final.deviance(z)
    count = space.size + (len(space.places) if space.scatter else 0)
    return TrendBranch(
        name=name,
        deviance=deviance,
        aic=deviance + 2 * count,
        bic=deviance + float(np.log(harmonics)) * count,
        chi_square=descent.cost,
        dof=dof,
        fit_percent=float(np.mean(run.fits)),
        z=z,
        covariance=covariance,
        scatter={n: float(t) for n, t in zip(space.curves, final.tau, strict=True)} if space.scatter else {},
        space=space,
        crosses=bool(np.ptp(np.sign(frame.margins(space, z))) > 0) if name != "best" else False,
    ), run


def _advice(best: TrendBranch, frame: Frame) -> list[str]:
    texts = []
    if frame.loads == 1:
        texts.append(
            "One load: the mirror image of all curves is again smooth, so that only nonlinear damping tells the "
            "branches apart; record a second load."
        )
    elif best.space.order.load >= frame.loads - 1:
        texts.append(
            f"Curves with {best.space.order.load + 1} coefficients over {frame.loads} loads go through any change with "
            "load, the mirror image's too: the loads do not tell the branches apart, only nonlinear damping does."
        )
    if best.crosses:
        texts.append("k_T crosses its mirror image a k_F: near there the two branches cannot be told apart.")
    if poor(best.scatter):
        texts.append(f"{_off(best.scatter)}: the curves describe them poorly.")
    return texts


def poor(scatter: Mapping[str, float]) -> dict[str, float]:
    """Those curves that recordings lie off by more than a placement of the foot would explain."""
    return {name: tau for name, tau in scatter.items() if tau > _POOR}


def _off(scatter: Mapping[str, float]) -> str:
    by = ", ".join(f"{100 * tau:.0f} % in {name}" for name, tau in poor(scatter).items())
    return f"The recordings lie off the curves by {by}"


def _meaningless(scatter: Mapping[str, float]) -> str:
    return f"{_off(scatter)}: odds between curves that do not describe the recordings mean nothing, so it is undecided."


@dataclass(frozen=True, eq=False)
class Refit:
    """The curves of a branch fitted anew to other recordings: what `at` needs of a TrendBranch."""

    space: CurveSpace
    z: np.ndarray
    covariance: np.ndarray
    tau: np.ndarray


def refit(branch: TrendBranch, recordings: Sequence[Recording], foot: Foot, threads: int = 0) -> Refit:
    """Fit a branch's curves to other recordings of the same foot, from where it ended, on the fastest engine.

    Args:
        branch: whose order, curves and bounds are kept. recordings: checked ones. foot: the model.

    Raises:
        SimulationError: no stable motion there.
    """
    old = branch.space
    frame = Frame(foot, list(recordings), old.feet, old.curves, old.scatter, twin_applies(foot), threads)
    tau = np.array([max(branch.scatter[n], 1e-3) for n in old.curves]) if old.scatter else None
    domain = frame.domain(old.order, tau)
    space = domain.problem().curves
    B = old.design(space.frequencies_hz, space.loads_kg)
    state = settled(domain, space.project(list(B @ branch.beta)))
    if state is None:
        raise SimulationError(f"{foot.name}: the curves have no stable motion for {len(recordings)} recordings.")
    z, problem = state.descent.z, state.problem
    covariance = problem.covariance(z, ~space.at_bound(z))[: space.size, : space.size]
    return Refit(space, z, covariance, problem.tau if space.scatter else np.zeros(len(space.places)))


def explore_trend(frame: Frame, settings: Settings, mirror: bool) -> tuple[dict[str, Candidate], list[dict[str, Any]]]:
    """Rough descents without offsets from all starts; the best of each branch are brought down to the noise."""
    rough = replace(frame, scatter=False).domain(frame.first_order())
    space = rough.problem().curves
    model = space.project([frame.feet.to_q(frame.feet.theta(frame.foot.values()))] * len(frame.data))
    wanted = max(settings.starts, 2 if mirror else 1)
    ends: dict[str, list[Descent]] = {}
    rows: list[dict[str, Any]] = []
    for label, z0 in islice(_starts(frame, space, model, settings.seed, mirror), wanted):
        problem = rough.problem()
        problem.temper(_TEMPERS[0], model)
        problem.start(z0)
        end = descend_fast(problem, z0, label, _ROUGH)
        name = frame.side(space, end.z) if mirror else "best"
        ends.setdefault(name, []).append(end)
        rows.append({"start": label, "cost": end.cost, "evaluations": end.evaluations, "converged": end.converged,
                     "branch": name})  # fmt: skip
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


def grown(frame: Frame, branches: Mapping[str, Candidate], order: Order) -> dict[str, Candidate]:
    """The same branches with other curves: each recording's foot stays, and the curves go through what they can."""
    found = {}
    for name, branch in branches.items():
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
