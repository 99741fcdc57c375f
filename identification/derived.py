"""What a fit says besides its parameters: natural frequencies, damper laws, energies, and where chi-square comes from.

Each is computed from the certified fit ("if the model is true") and, where there is one, from the fit with whatever
else may be true. Errors are propagated linearly (delta method) from the covariance that the intervals of the parameters
come from.
"""

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from fasbody.exceptions import FasError
from fasbody.foot.damper import damping
from fasbody.foot.engine import callbacks
from fasbody.foot.model import Foot
from fasbody.foot.rest import standing
from fasbody.foot.two_dof import TwoDof, periodic
from identification.certification import Certified, standard_errors
from identification.engines.engine import LONGEST_STEP, Excitation
from identification.periodic import Line, PeriodicProblem
from identification.result import IF_TRUE, WHATEVER, FitResult
from identification.search import inverse_of_gram
from identification.space import DELAY
from identification.study.loops import Cycle, cycle

if TYPE_CHECKING:
    from identification.evidence import Evidence
    from identification.wide import End

Row = dict[str, Any]

_Z95 = 1.959963984540054
#: Steps of differences: in standard errors of a search variable, and as a share of a constant.
_STEP, _SHARE = 1e-3, 1e-4
#: Frequencies of a curve, and displacements of a damper's law.
_POINTS, _PLACES = 81, 61
#: Relative gap of the orbits of a curve.
_GAP = 1e-6
#: Modes listed at most; a model may have many.
_MODES = 6
#: The dampers of the two-mass foot: joint -> parameters of its law, and the name of its loop.
DAMPERS: Mapping[str, tuple[str, str, str, str]] = {
    "ankle": ("c_11", "c_12", "c_13", "ankle"),
    "fat pad": ("c_21", "c_22", "c_23", "fat_pad"),
}


class View(ABC):
    """A branch's foot with what is uncertain of it.

    Attributes:
        branch: its name. basis: what its intervals allow for. q, C: search variable (n,) and its covariance (n, n),
            with zeros for what has no standard error. bounds: of q.
    """

    branch: str
    basis: str
    q: np.ndarray
    C: np.ndarray
    bounds: tuple[np.ndarray, np.ndarray]

    @abstractmethod
    def foot(self, q: np.ndarray, number: int) -> dict[str, float]:
        """Constants and masses by name under the conditions of a recording."""

    def moving(self, q: np.ndarray, number: int) -> dict[str, float]:
        """Constants and masses of the foot that moves as recorded, at the frequency of a recording."""
        return self.foot(q, number)

    def slopes(self, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Derivatives (m, n) of a function (m,) of the search variable, by differences inside its bounds."""
        std = np.sqrt(np.diag(self.C))
        low, high = self.bounds
        columns = []
        for i, s in enumerate(std):
            if not (np.isfinite(s) and s > 0):
                columns.append(np.zeros_like(function(self.q)) if s == 0 else np.full_like(function(self.q), np.inf))
                continue
            ends = [float(np.clip(self.q[i] + sign * _STEP * s, low[i], high[i])) for sign in (-1, 1)]
            below, above = (function(np.where(np.arange(std.size) == i, end, self.q)) for end in ends)
            columns.append((above - below) / (ends[1] - ends[0]))
        return np.column_stack(columns)

    def spread(self, J: np.ndarray) -> np.ndarray:
        """Standard errors (m,) of what has the derivatives J (m, n); infinite where the recordings set no limit."""
        blind = ~np.isfinite(np.diag(self.C))
        known = np.where(np.outer(blind, blind) | ~np.isfinite(self.C), 0.0, self.C)
        J_known = np.where(blind, 0.0, J)
        std = np.sqrt(np.maximum(np.einsum("mi,ij,mj->m", J_known, known, J_known), 0.0))
        return np.where((J[:, blind] != 0).any(axis=1), np.inf, std)


class _Narrow(View):
    """If the model is true."""

    def __init__(self, evidence: "Evidence", certified: Certified, dof: int) -> None:
        problem, descent, space = certified.problem, certified.descent, evidence.space
        self.branch, self.basis, self.space, self.evidence = certified.name, IF_TRUE, space, evidence
        self.q, self.bounds = space.to_q(descent.theta), space.bounds
        _, C = standard_errors(problem, descent, dof)
        excess = max(1.0, descent.cost / max(1, dof)) if problem.chi_square else 1.0
        self.C = np.nan_to_num(C, nan=0.0, posinf=np.inf) * excess

    def foot(self, q: np.ndarray, number: int) -> dict[str, float]:
        """See `View`."""
        domain = self.evidence.domain
        values = self.space.values(self.space.to_theta(q))
        return {**domain.foot.values(), **values, **domain.recordings[number].condition.masses}


class _Wide(View):
    """Whatever else may be true."""

    def __init__(self, end: "End", dof: int) -> None:
        self.branch, self.basis, self.q, self.world = end.name, WHATEVER, end.q, end.problem.world
        self.bounds = self.world.bounds
        self.C = inverse_of_gram(end.problem.jacobian(end.q)) * max(1.0, end.problem.chi(end.q) / max(1, dof))

    def _masses(self, q: np.ndarray, number: int) -> dict[str, float]:
        world = self.world
        return {name: float(mass[number]) for name, (mass, _) in world.weights(q).items()}

    def foot(self, q: np.ndarray, number: int) -> dict[str, float]:
        """See `View`: without what relaxes, which adds stiffness and damping to a motion, and none at rest."""
        condition = self.world.recordings[number].condition
        constants = {name: float(each[number]) for name, each in self.world.constants(q)[0].items()}
        return {**self.world.own, **self.world.feet.fixed, **condition.masses, **constants, **self._masses(q, number)}

    def moving(self, q: np.ndarray, number: int) -> dict[str, float]:
        """See `View`: with what relaxes, as constants that move alike at the recording's frequency."""
        theta, _ = self.world.at(number, q)
        return {**self.foot(q, number), **dict(zip(self.world.names, map(float, theta), strict=True))}


@dataclass(frozen=True, eq=False)
class Derived:
    """Rows of each table, empty where a fit cannot fill it; a row's keys are the columns of its CSV file.

    Attributes:
        data: measured transmissibility and phase lag at the excited frequencies, with 95 % limits of their noise.
        curves: the same of each branch over frequency. modes: natural frequencies and damping ratios, of small motion.
        dampers: laws over the displacement that was reached. reached: from where to where, by load. energies:
            dissipated a cycle.
        chi_square: parts by recording and harmonic, which add up to the total.
    """

    data: list[Row]
    curves: list[Row]
    modes: list[Row]
    dampers: list[Row]
    reached: list[Row]
    energies: list[Row]
    chi_square: list[Row]


@functools.lru_cache(maxsize=4)
def derived(result: FitResult) -> Derived:
    """Everything that figures and tables of a result need beyond its parameters.

    Where no parameter has an interval, nothing that follows from them is there either.
    """
    evidence = result.evidence
    if evidence is None:
        return Derived([], [], [], [], [], [], [])
    views = _views(result, evidence) if result.offered else []
    cycles = {(id(view), i): found for view in views for i, found in _cycles(evidence, view)}
    return Derived(
        _data(evidence),
        _curves(result, evidence),
        [row for view in views for row in _modes(evidence, view)],
        [row for view in views for row in _dampers(evidence, view, cycles)],
        _reached(evidence, views[:1], cycles),
        [row for view in views for row in _energies(evidence, view, cycles)],
        _chi_square(evidence, result.best.name),
    )


def at_a_glance(result: FitResult) -> tuple[list[Row], list[Row], list[Row]]:
    """What is drawn first, without the seconds of the rest: data and curves, and chi-square of every branch by name."""
    evidence = result.evidence
    if evidence is None:
        return [], [], []
    parts = [{"branch": b.name, **row} for b in result.branches for row in _chi_square(evidence, b.name)]
    return _data(evidence), _curves(result, evidence), parts


def _views(result: FitResult, evidence: "Evidence") -> list[View]:
    """The branches that the data leave open, on each basis that there is, the wider first."""
    found: list[View] = []
    for branch in result.open:
        found += [_Wide(end, branch.dof) for end in evidence.ends if end.name == branch.name]
        found += [_Narrow(evidence, each, branch.dof) for each in evidence.certified if each.name == branch.name]
    return found


def _data(evidence: "Evidence") -> list[Row]:
    """Measured fundamental of the malleolus over that of the base; the scatter of the noise alone."""
    rows = []
    for r in evidence.domain.recordings:
        if r.condition.frequency_hz is None:
            continue
        line = Line.of(r)
        out, into = line.malleolus, line.base
        H = out.amplitudes[0] / into.amplitudes[0]
        std = float(np.hypot(out.std[0] / abs(out.amplitudes[0]), into.std[0] / abs(into.amplitudes[0])))
        size, lag, half = float(abs(H)), float(-np.degrees(np.angle(H))), _Z95 * std
        rows.append(
            {
                "file": r.file, "added_mass_kg": r.condition.added_mass_kg, "frequency_hz": into.frequency_hz,
                "transmissibility": size, "lower": size * (1 - half), "upper": size * (1 + half),
                "phase_lag_deg": lag, "phase_lower_deg": float(lag - np.degrees(half)),
                "phase_upper_deg": float(lag + np.degrees(half)),
            }
        )  # fmt: skip
    return rows


def _curves(result: FitResult, evidence: "Evidence") -> list[Row]:
    """Response of each branch over frequency and load, if the model is true, to a sine as large as the recorded ones.

    Other models than the two-mass foot are known at the excited frequencies only.
    """
    rows: list[Row] = []
    order = {branch.name: i for i, branch in enumerate(result.branches)}
    for certified in sorted(evidence.certified, key=lambda c: order.get(c.name, len(order))):
        view = _Narrow(evidence, certified, 1)
        for load, numbers in _by_load(evidence).items():
            lines = [Line.of(evidence.domain.recordings[i]) for i in numbers]
            f = np.array([line.base.frequency_hz for line in lines])
            size = np.array([abs(line.base.amplitudes[0]) for line in lines])
            values = view.foot(view.q, numbers[0])
            if evidence.domain.twin:
                found = _twin_curve(values, f, size)
            elif isinstance(certified.problem, PeriodicProblem):
                Y = [certified.problem.response(i, certified.descent.z)[0][0] for i in numbers]
                found = [
                    (x, y / line.base.amplitudes[0] * np.exp(2j * np.pi * x * values.get(DELAY.name, 0.0)))
                    for x, y, line in sorted(zip(f, Y, lines, strict=True), key=lambda each: each[0])
                ]
            else:
                continue
            for x, H in found:
                H = H * np.exp(-2j * np.pi * x * values.get(DELAY.name, 0.0))
                rows.append(
                    {
                        "branch": certified.name, "added_mass_kg": load, "frequency_hz": float(x),
                        "transmissibility": float(abs(H)), "phase_lag_deg": float(-np.degrees(np.angle(H))),
                    }
                )  # fmt: skip
    return rows


def _by_load(evidence: "Evidence") -> dict[float, list[int]]:
    """Numbers of the periodic recordings by their added mass [kg]."""
    found: dict[float, list[int]] = {}
    for i, recording in enumerate(evidence.domain.recordings):
        if recording.condition.frequency_hz is not None:
            found.setdefault(recording.condition.added_mass_kg, []).append(i)
    return dict(sorted(found.items()))


def _twin_curve(values: Mapping[str, float], f: np.ndarray, size: np.ndarray) -> list[tuple[float, complex]]:
    """Fundamental over that of the base of the two-mass foot, from one recorded frequency to the other."""
    foot, order, start = TwoDof.from_values(values), np.argsort(f), np.zeros(4)
    grid = np.unique(np.concatenate([f, np.linspace(f.min(), f.max(), _POINTS)]))
    found = []
    for x in grid:
        U = float(np.interp(x, f[order], size[order]))
        e = Excitation(float(x), np.array([U + 0j]), {}, LONGEST_STEP)
        Y, _, start, _, gap = periodic(start, foot.theta, foot.m_S, foot.m_F, e.half_steps, e.step, _GAP, 30)
        if gap < _GAP:
            found.append((float(x), complex(2 / Y.size * np.fft.rfft(Y)[1] / U)))
        else:
            start = np.zeros(4)
    return found


def poles(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Natural frequencies (k,) [Hz] and damping ratios (k,) of the pairs of eigenvalues of A (n, n), lowest first.

    A pair p is a factor s^2 + 2 zeta w s + w^2 of the characteristic polynomial, so that w = |p| and
    zeta = -Re p / |p|. Two real eigenvalues, of a mode that does not swing, are such a factor with zeta above one.
    """
    found = np.linalg.eigvals(A)
    swinging = found[found.imag > 0]
    real = np.sort(np.abs(found[found.imag == 0].real))
    pairs = [(abs(p), -p.real / abs(p)) for p in swinging]
    pairs += [
        (np.sqrt(a * b), 0.5 * (a + b) / np.sqrt(a * b)) for a, b in zip(real[::2], real[1::2], strict=False) if a
    ]
    pairs.sort()
    w, zeta = (np.array(each, float) for each in zip(*pairs, strict=True)) if pairs else (np.zeros(0), np.zeros(0))
    return w / (2 * np.pi), zeta


def linearised(foot: Foot, step: float = 1e-6) -> np.ndarray:
    """A (2 n, 2 n) of small motion of a model about rest, its base held: positions [m, rad] first, then their rates.

    Central differences of the accelerations that MuJoCo computes, laws included.
    """
    model, rest = foot.with_values({}).model, standing(foot)
    model.opt.tolerance = 0.0  # the solver of constraints would stop before it has seen a nudge
    data = mujoco.MjData(model)
    own = [i for i in range(model.nv) if model.dof_armature[i] < 1e6]  # the base is the shaker's
    n = len(own)

    def acceleration(x: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:] = rest, 0.0
        move = np.zeros(model.nv)
        move[own] = x[:n]
        mujoco.mj_integratePos(model, data.qpos, move, 1.0)
        data.qvel[own] = x[n:]
        mujoco.mj_forward(model, data)
        return data.qacc[own].copy()

    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    with callbacks():
        for i, nudge in enumerate(step * np.eye(2 * n)):
            A[n:, i] = (acceleration(nudge) - acceleration(-nudge)) / (2 * step)
    return A


#: Limits that are further apart than this factor from the value say nothing: then there are none.
_UNKNOWN = 1e6


def _limits(values: np.ndarray, half: np.ndarray) -> list[tuple[float, float]]:
    """95 % limits: symmetric in the logarithm, as of the constants, where the value is positive."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        grown = np.exp(half / np.abs(values))
        grown = np.where(grown > _UNKNOWN, np.inf, grown)
        low = np.where(values > 0, values / grown, values - half)
        high = np.where(values > 0, values * grown, values + half)
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _modes(evidence: "Evidence", view: View) -> Iterator[Row]:
    """Natural frequencies and damping ratios of small motion under each load, with 95 % limits."""
    domain = evidence.domain
    if not domain.twin and domain.foot.model.na:
        return  # a pad with a memory has more states than these
    loads = {r.condition.added_mass_kg: i for i, r in reversed(list(enumerate(domain.recordings)))}
    for load, number in sorted(loads.items()):

        def logarithms(q: np.ndarray, number: int = number) -> np.ndarray:
            values = view.foot(q, number)
            if domain.twin:
                A = TwoDof.from_values(values).state_space()[0]
            else:
                A = linearised(
                    domain.foot.with_values({k: v for k, v in values.items() if k in domain.foot.parameters})
                )
            f, zeta = poles(A)
            return np.log(np.concatenate([f[:_MODES], np.maximum(zeta[:_MODES], 1e-12)]))

        centre = logarithms(view.q)
        half = _Z95 * view.spread(view.slopes(logarithms))
        with np.errstate(over="ignore"):  # a mode of which nothing is known reaches to infinity
            value, low, high = np.exp(centre), np.exp(centre - half), np.exp(centre + half)
        count = centre.size // 2
        for mode in range(count):
            z = mode + count
            yield {
                "branch": view.branch, "basis": view.basis, "added_mass_kg": load, "mode": mode + 1,
                "natural_frequency_hz": float(value[mode]), "lower_hz": float(low[mode]), "upper_hz": float(high[mode]),
                "damping_ratio": float(value[z]), "damping_lower": float(low[z]), "damping_upper": float(high[z]),
            }  # fmt: skip


def _excitation(evidence: "Evidence", number: int) -> Excitation:
    """What drives a recording's foot; the masses come with the foot."""
    line, foot = Line.of(evidence.domain.recordings[number]), evidence.domain.foot
    return Excitation(line.base.frequency_hz, line.base.amplitudes, {}, min(LONGEST_STEP, foot.step))


def _cycles(evidence: "Evidence", view: View) -> Iterator[tuple[int, Cycle]]:
    """One cycle of each periodic recording, where the model has an ankle and a fat pad."""
    for numbers in _by_load(evidence).values():
        for i in numbers:
            try:
                values = view.moving(view.q, i)
                yield i, cycle(evidence.domain.foot, _excitation(evidence, i), values, evidence.domain.twin)
            except FasError:  # a model without these joints, or a motion that the wide fit's foot does not have
                continue


def _dampers(evidence: "Evidence", view: View, cycles: Mapping[tuple[int, int], Cycle]) -> Iterator[Row]:
    """Damping over the relative displacement that the recordings reached; a band of 95 % at each place."""
    mine = {i: found for (key, i), found in cycles.items() if key == id(view)}
    if not (evidence.domain.twin and mine):
        return
    for joint, (*constants, part) in DAMPERS.items():
        reached = np.concatenate([getattr(found, part).displacement_m for found in mine.values()])
        x = np.linspace(reached.min(), reached.max(), _PLACES)
        number = min(mine)

        def law(q: np.ndarray, x: np.ndarray = x, names: Sequence[str] = constants, number: int = number) -> np.ndarray:
            values = view.foot(q, number)
            return np.array([damping(place, *(values[name] for name in names)) for place in x])

        centre, half = law(view.q), _Z95 * view.spread(view.slopes(law))
        for place, c, (low, high) in zip(x, centre, _limits(centre, half), strict=True):
            yield {
                "branch": view.branch, "basis": view.basis, "damper": joint, "displacement_m": float(place),
                "damping_n_s_per_m": float(c), "lower": low, "upper": high,
            }  # fmt: skip


def _reached(evidence: "Evidence", views: Sequence[View], cycles: Mapping[tuple[int, int], Cycle]) -> list[Row]:
    """Relative displacements of ankle and pad under each load, over its recordings, of the first view."""
    rows = []
    for joint, (*_, part) in DAMPERS.items() if views else ():
        for load, numbers in _by_load(evidence).items():
            mine = [cycles[id(views[0]), i] for i in numbers if (id(views[0]), i) in cycles]
            if mine:
                x = np.concatenate([getattr(found, part).displacement_m for found in mine])
                row = {"damper": joint, "added_mass_kg": load, "lower_m": float(x.min()), "upper_m": float(x.max())}
                rows.append(row)
    return rows


def _energies(evidence: "Evidence", view: View, cycles: Mapping[tuple[int, int], Cycle]) -> Iterator[Row]:
    """Energy that each damper dissipates in a cycle of each recording, with 95 % limits for the two-mass foot."""
    for (key, i), found in cycles.items():
        if key != id(view):
            continue
        r = evidence.domain.recordings[i]
        energies = np.array([found.ankle.dissipated_j, found.fat_pad.dissipated_j])
        half = _Z95 * _energy_spread(evidence, view, i, energies) if evidence.domain.twin else np.full(2, np.nan)
        for joint, value, (low, high) in zip(DAMPERS, energies, _limits(energies, half), strict=True):
            yield {
                "branch": view.branch, "basis": view.basis, "file": r.file,
                "added_mass_kg": r.condition.added_mass_kg, "frequency_hz": r.condition.frequency_hz, "damper": joint,
                "dissipated_j": float(value), "lower_j": low, "upper_j": high,
                "share": float(value / found.dissipated_j), "imbalance": found.imbalance,
            }  # fmt: skip


def _energy_spread(evidence: "Evidence", view: View, number: int, energies: np.ndarray) -> np.ndarray:
    """Standard errors (2,) of the energies of ankle and pad: through the constants and masses of the foot."""
    base, e = view.moving(view.q, number), _excitation(evidence, number)
    names = [name for name in (*TwoDof.__dataclass_fields__,) if name in base]

    def values(q: np.ndarray) -> np.ndarray:
        found = view.moving(q, number)
        return np.array([found[name] for name in names])

    by_q = view.slopes(values)
    by_value = np.zeros((2, len(names)))
    for j, name in enumerate(names):
        if not by_q[j].any():
            continue
        nudge = _SHARE * max(abs(base[name]), 1.0)
        other = cycle(evidence.domain.foot, e, {**base, name: base[name] + nudge}, True)
        by_value[:, j] = (np.array([other.ankle.dissipated_j, other.fat_pad.dissipated_j]) - energies) / nudge
    with np.errstate(invalid="ignore"):
        return view.spread(np.nan_to_num(by_value @ by_q, nan=np.inf))


def _chi_square(evidence: "Evidence", branch: str) -> list[Row]:
    """Chi-square of a branch by recording and harmonic: squares of the whitened real and imaginary part.

    The whitening takes harmonics one after the other, each less what those before it foretell, so the parts add up.
    """
    residuals: dict[str, np.ndarray] = {}
    lines: Sequence[Line] = ()
    for end in evidence.ends:
        if end.name == branch:
            lines, residuals[WHATEVER] = end.problem.lines, end.problem.residual(end.q)[: end.problem.size]
    for each in evidence.certified:
        if each.name == branch and isinstance(each.problem, PeriodicProblem):
            lines, residuals[IF_TRUE] = each.problem.lines, each.problem.residual(each.descent.z)
    rows, first = [], 0
    for line in lines:
        condition = line.recording.condition
        for h in range(line.count):
            # real parts of all sensors, then imaginary ones; a harmonic's part is the sum over sensors
            at = first + h + line.count * np.arange(2 * len(line.sensors))
            parts = {name: float(r[at] @ r[at]) for name, r in residuals.items()}
            rows.append(
                {
                    "file": line.recording.file, "added_mass_kg": condition.added_mass_kg,
                    "frequency_hz": line.base.frequency_hz, "harmonic": h + 1,
                    "chi_square": parts.get(WHATEVER), "chi_square_if_model_true": parts.get(IF_TRUE),
                }
            )  # fmt: skip
        first += 2 * line.size
    return rows
