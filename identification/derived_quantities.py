"""What a fit says besides its parameters: natural frequencies, damper laws, energies, and where chi-square comes from.

Each is computed from the fit with model and sensor errors included and, where there is one, with the model assumed
exact. Errors are propagated linearly (delta method) from the covariance that the intervals of the parameters come from.
"""

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fasbody.constants import Z95
from fasbody.exceptions import FasError, SimulationError
from fasbody.foot.damper import damping
from fasbody.foot.hysteresis import Cycle, cycle, of_orbits
from fasbody.foot.linear import Linear
from fasbody.foot.model import Foot
from fasbody.foot.steady_state import Balance
from fasbody.foot.two_dof import TwoDof
from fasbody.foot.two_mass import PARAMETERS, Orbits, parameters, resolved
from identification.certification import Certified, standard_errors
from identification.criteria import fit_percent
from identification.estimates import IF_TRUE, WHATEVER
from identification.harmonics import Line
from identification.intervals import Solution
from identification.parameters import DELAY
from identification.replay import residual
from identification.replay import traces as replayed
from identification.result import FitResult
from identification.sensors import MALLEOLUS

if TYPE_CHECKING:
    from identification.evidence import Evidence

Row = dict[str, Any]

#: Step of a search variable for a slope.
_STEP = 1e-4
#: Frequencies of a curve, fewer where the engine computes it, and displacements of a damper's law.
_POINTS, _FEW, _PLACES = 81, 31, 61
#: Modes listed at most; a model may have many.
_MODES = 6
#: The dampers of the two-mass foot: joint -> parameters of its law, and the name of its loop.
DAMPERS: Mapping[str, tuple[str, str, str, str]] = {
    "ankle": ("c_11", "c_12", "c_13", "ankle"),
    "fat pad": ("c_21", "c_22", "c_23", "fat_pad"),
}


@dataclass(frozen=True, eq=False)
class View:
    """A branch's foot with what is uncertain of it.

    Attributes:
        branch: its name.
        basis: what its intervals include.
        q: (n,) search variable.
        quantile: standard errors to each side of a 95 % interval.
        foot: constants and masses by name under the conditions of a recording, of its number and q.
        slopes: (m, n) derivatives of a function (m,) of q.
        spread: (m,) standard errors of what has such derivatives.
        solution: of steady recordings, None in the time domain.
    """

    branch: str
    basis: str
    q: np.ndarray
    quantile: float
    foot: Callable[[int, np.ndarray], dict[str, float]]
    slopes: Callable[[Callable[[np.ndarray], np.ndarray]], np.ndarray]
    spread: Callable[[np.ndarray], np.ndarray]
    solution: Solution | None = None

    @classmethod
    def of_solution(cls, solution: Solution, basis: str) -> "View":
        """Of steady recordings."""
        s = solution
        return cls(s.branch, basis, s.q, s.quantile, s.foot, s.slopes, s.spread, s)

    @classmethod
    def of_certified(cls, certified: Certified, evidence: "Evidence") -> "View":
        """Of the time domain."""
        space, descent = evidence.space, certified.descent
        assert space is not None
        _, C = standard_errors(certified.problem, descent)
        C = np.nan_to_num(C, nan=0.0, posinf=0.0)  # at a bound, or not seen

        def foot(number: int, q: np.ndarray) -> dict[str, float]:
            masses = evidence.recordings[number].condition.masses
            return {**evidence.foot.values(), **space.values(space.to_theta(q)), **masses}

        def slopes(function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
            steps = _STEP * np.eye(len(C))
            return np.stack([(function(q + d) - function(q - d)) / (2 * _STEP) for d in steps], 1)

        q = space.to_q(descent.theta)
        spread = lambda J: np.sqrt(np.einsum("mi,ij,mj->m", J, C, J))  # noqa: E731
        return cls(certified.name, IF_TRUE, q, Z95, foot, slopes, spread)

    def half_width(self, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Half of the 95 % interval (m,) of a function (m,) of q."""
        return self.quantile * self.spread(self.slopes(function))


@dataclass(frozen=True, eq=False)
class Derived:
    """Rows of each table, empty where a fit cannot fill it; a row's keys are the columns of its CSV file.

    Attributes:
        data: measured transmissibility and phase lag at the excited frequencies, with 95 % limits
            of noise and repeatability.
        curves: the same of each branch over frequency.
        modes: natural frequencies and damping ratios, of small motion.
        dampers: laws over the displacement that was reached.
        reached: from where to where, by load.
        energies: dissipated a cycle.
        chi_square: parts by recording and harmonic, which add up to the total.
        scale: what of each constant's interval is the leg's mass, common to all, and what is left
            per kilogram of leg.
    """

    data: list[Row]
    curves: list[Row]
    modes: list[Row]
    dampers: list[Row]
    reached: list[Row]
    energies: list[Row]
    chi_square: list[Row]
    scale: list[Row]


@functools.lru_cache(maxsize=4)
def derived(result: FitResult) -> Derived:
    """Everything that figures and tables of a result need beyond its parameters.

    Where no parameter has an interval, nothing that follows from them is there either.
    """
    evidence = result.evidence
    if evidence is None:
        return Derived([], [], [], [], [], [], [], [])
    views = _views(result, evidence) if result.offered else []
    moving = [(view, *_cycles(evidence, view)) for view in views]
    return Derived(
        _data(evidence),
        _curves(result, evidence),
        [row for view in views for row in _modes(evidence, view)],
        [row for view, cycles, _ in moving for row in _dampers(evidence, view, cycles)],
        _reached(evidence, moving[0][1]) if moving else [],
        [row for item in moving for row in _energies(evidence, *item)],
        _chi_square(evidence, result.best.name),
        [row for view in views if view.basis == WHATEVER for row in _scale(view)],
    )


def at_a_glance(result: FitResult) -> tuple[list[Row], list[Row], list[Row]]:
    """What is drawn first, without the seconds of the rest: data and curves, and chi-square of every branch by name."""
    evidence = result.evidence
    if evidence is None:
        return [], [], []
    parts = [{"branch": b.name, **row} for b in result.branches for row in _chi_square(evidence, b.name)]
    return _data(evidence), _curves(result, evidence), parts


def traces(evidence: "Evidence") -> dict[str, list[tuple[np.ndarray, float]]]:
    """Of each branch by name: the model's malleolus (n,) [m/s^2] in every recording, and its fit percentage."""
    runs = {c.name: list(zip(c.run.traces, c.run.fits, strict=True)) for c in evidence.certified}
    for solution in evidence.solutions:
        rows = replayed(solution.problem, solution.q, evidence.replays[solution.branch])
        runs[solution.branch] = [
            (row[MALLEOLUS[0]], fit_percent(r.malleolus_m_s2, row[MALLEOLUS[0]]))
            for r, row in zip(evidence.recordings, rows, strict=True)
        ]
    return runs


def _headline(evidence: "Evidence", name: str) -> View:
    """What the parameters of a branch are of."""
    for solution in evidence.solutions:
        if solution.branch == name:
            return View.of_solution(solution, WHATEVER if evidence.exact else IF_TRUE)
    return next(View.of_certified(c, evidence) for c in evidence.certified if c.name == name)


def _views(result: FitResult, evidence: "Evidence") -> list[View]:
    """The branches that the data leave open, on each basis that there is, the wider first."""
    views: list[View] = []
    for branch in result.open:
        views.append(_headline(evidence, branch.name))
        if branch.name in evidence.exact:
            views.append(View.of_solution(evidence.exact[branch.name], IF_TRUE))
    return views


def _data(evidence: "Evidence") -> list[Row]:
    """Measured fundamental of the malleolus over that of the base; the scatter of noise and repeatability."""
    rows = []
    scatter = evidence.solutions[0].problem.repeatability if evidence.solutions else 0.0
    for r in evidence.recordings:
        if r.condition.frequency_hz is None:
            continue
        line = Line.of(r)
        out, into = line.malleolus, line.base
        H = out.amplitudes[0] / into.amplitudes[0]
        noise = np.array([out.std[0] / abs(out.amplitudes[0]), into.std[0] / abs(into.amplitudes[0]), scatter])
        size, lag, half = float(abs(H)), float(-np.degrees(np.angle(H))), Z95 * float(np.linalg.norm(noise))
        rows.append(
            {
                "file": r.file, "added_mass_kg": r.condition.added_mass_kg, "frequency_hz": into.frequency_hz,
                "transmissibility": size, "lower": size * (1 - half), "upper": size * (1 + half),
                "phase_lag_deg": lag, "phase_lower_deg": float(lag - np.degrees(half)),
                "phase_upper_deg": float(lag + np.degrees(half)),
            }
        )  # fmt: skip
    return rows


def _by_load(evidence: "Evidence") -> dict[float, list[int]]:
    """Numbers of the periodic recordings by their added mass [kg]."""
    numbers: dict[float, list[int]] = {}
    for i, recording in enumerate(evidence.recordings):
        if recording.condition.frequency_hz is not None:
            numbers.setdefault(recording.condition.added_mass_kg, []).append(i)
    return dict(sorted(numbers.items()))


def _curves(result: FitResult, evidence: "Evidence") -> list[Row]:
    """What the malleolus' sensor reads over frequency and load, by branch, of a sine as large as the recorded ones."""
    rows: list[Row] = []
    for branch in result.branches:
        view = _headline(evidence, branch.name)
        for load, numbers in _by_load(evidence).items():
            lines = sorted((Line.of(evidence.recordings[i]).base for i in numbers), key=lambda b: b.frequency_hz)
            f = np.array([line.frequency_hz for line in lines])
            grid = np.unique(np.concatenate([f, np.linspace(f[0], f[-1], _POINTS if evidence.two_mass else _FEW)]))
            U = np.interp(grid, f, [abs(line.amplitudes[0]) for line in lines])
            values = view.foot(numbers[0], view.q)
            Y = _steady(values, grid, U) if evidence.two_mass else _steady_in_engine(evidence.foot, values, grid, U)
            H = _read(view, values, grid, U, Y) / U
            rows += [
                {
                    "branch": branch.name, "added_mass_kg": load, "frequency_hz": float(x),
                    "transmissibility": float(abs(h)), "phase_lag_deg": float(-np.degrees(np.angle(h))),
                }
                for x, h in zip(grid, H, strict=True) if np.isfinite(h)
            ]  # fmt: skip
    return rows


def _steady(values: Mapping[str, float], f: np.ndarray, U: np.ndarray) -> np.ndarray:
    """Fundamentals (n,) of the malleolus of a two-mass foot on sines of frequencies (n,) [Hz]; NaN where is none."""
    theta = np.tile(parameters(values), (f.size, 1))
    motion = resolved(theta, 2 * np.pi * f, U[:, None].astype(complex))
    return np.where(motion.converged, motion.shank[:, 0], np.nan)


def _steady_in_engine(foot: Foot, values: Mapping[str, float], f: np.ndarray, U: np.ndarray) -> np.ndarray:
    """The same of any model, each motion from the one before."""
    balance, last = Balance(foot), None
    declared = {name: value for name, value in values.items() if name in foot.parameters}
    Y = np.full(f.size, np.nan, complex)
    for i, (x, u) in enumerate(zip(f.tolist(), U.tolist(), strict=True)):
        try:
            last = balance.orbit(x, [u], declared, last)
        except SimulationError:
            last = None
        else:
            Y[i] = last.harmonics()[0]
    return Y


def _read(view: View, values: Mapping[str, float], f: np.ndarray, U: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """What the malleolus' sensor makes of its motion Y (n,) at frequencies (n,) [Hz], halfway through the session."""
    if view.solution is None:
        return np.asarray(Y * np.exp(-2j * np.pi * f * values.get(DELAY.name, 0.0)))
    problem, q = view.solution.problem, view.q.copy()
    variables, measured = problem.variables, problem.measured
    drift = variables.of_kind("drift", sensor=measured.sensors[0])
    if drift is not None:
        q[drift] = 0.0
    first = variables.recordings[0]
    made = [replace(first, condition=replace(first.condition, frequency_hz=float(x))) for x in f]
    grid = replace(measured, base=U[:, None].astype(complex), output=np.zeros((f.size, len(measured.sensors), 1)))
    problem = replace(problem, variables=replace(variables, recordings=made), measured=grid)
    T, rock = problem.channel(q[None], 1)
    return np.asarray(T[0, :, 0, 0] * (Y + rock[0, :, 0, 0]))


def modes_of(eigenvalues: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Natural frequencies (k,) [Hz] and damping ratios (k,) of the pairs of eigenvalues [1/s], lowest first.

    A pair p is a factor s^2 + 2 zeta w s + w^2 of the characteristic polynomial, so that w = |p| and
    zeta = -Re p / |p|. Two real eigenvalues, of a mode that does not swing, are such a factor with zeta above one.
    """
    swinging = eigenvalues[eigenvalues.imag > 0]
    real = np.sort(np.abs(eigenvalues[eigenvalues.imag == 0].real))
    pairs = [(abs(p), -p.real / abs(p)) for p in swinging]
    pairs += [
        (np.sqrt(a * b), 0.5 * (a + b) / np.sqrt(a * b)) for a, b in zip(real[::2], real[1::2], strict=False) if a
    ]
    pairs.sort()
    w, zeta = (np.array(column, float) for column in zip(*pairs, strict=True)) if pairs else (np.zeros(0), np.zeros(0))
    return w / (2 * np.pi), zeta


def small_motion(values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Natural frequencies (2,) [Hz] and damping ratios (2,) of the two-mass foot about rest, relaxing springs included.

    Each Maxwell element beside a spring adds a real eigenvalue near -1 / tau, which is no mode.
    """
    A = TwoDof.from_values(values).state_space()[0]
    if not (values.get("r_T") or values.get("r_F")):
        return modes_of(np.linalg.eigvals(A))
    tau = values["tau"]
    whole = np.zeros((6, 6))
    whole[:4, :4] = A
    whole[4, 2], whole[5, 3] = values["k_T"] * values["r_T"], values["k_F"] * values["r_F"]
    whole[4, 4] = whole[5, 5] = -1 / tau
    one, sum_ = 1 / values["m_F"], 1 / values["m_F"] + 1 / values["m_S"]
    whole[2:4, 4:] = [[-sum_, one], [one, -one]]
    eigenvalues = np.linalg.eigvals(whole)
    relaxes = np.lexsort([np.abs(eigenvalues + 1 / tau), np.abs(eigenvalues.imag) > 0])[:2]
    return modes_of(np.delete(eigenvalues, relaxes))


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
    foot, two_mass = evidence.foot, evidence.two_mass
    if not two_mass and foot.model.na:
        return  # a pad with a memory has more states than these
    loads = {r.condition.added_mass_kg: i for i, r in reversed(list(enumerate(evidence.recordings)))}
    for load, number in sorted(loads.items()):

        def logarithms(q: np.ndarray, number: int = number) -> np.ndarray:
            values = view.foot(number, q)
            declared = {name: value for name, value in values.items() if name in foot.parameters}
            f, zeta = small_motion(values) if two_mass else modes_of(Linear(foot.with_values(declared)).eigenvalues())
            return np.log(np.concatenate([f[:_MODES], np.maximum(zeta[:_MODES], 1e-12)]))

        try:
            centre, half = logarithms(view.q), view.half_width(logarithms)
        except SimulationError:  # what touches or stops at rest has no small motion that is linear
            return
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


def _thetas(view: View, numbers: Sequence[int], q: np.ndarray) -> np.ndarray:
    """Parameters (R, 13) of the two-mass foot in each recording."""
    return np.stack([parameters(view.foot(i, q)) for i in numbers])


def _cycles(evidence: "Evidence", view: View) -> tuple[dict[int, Cycle], Orbits | None]:
    """One cycle of each steady recording by its number, where the model has an ankle and a fat pad.

    Of the two-mass foot also the motions that they are of.
    """
    numbers = [i for group in _by_load(evidence).values() for i in group]
    lines = [Line.of(evidence.recordings[i]).base for i in numbers]
    if not (numbers and evidence.two_mass):
        return _cycles_in_engine(evidence, view, numbers), None
    base = np.zeros((len(lines), max(line.amplitudes.size for line in lines)), complex)
    for row, line in zip(base, lines, strict=True):
        row[: line.amplitudes.size] = line.amplitudes
    omega = 2 * np.pi * np.array([line.frequency_hz for line in lines])
    motion = resolved(_thetas(view, numbers, view.q), omega, base, slopes=True)
    return dict(zip(numbers, of_orbits(motion, base), strict=True)), motion


def _cycles_in_engine(evidence: "Evidence", view: View, numbers: Sequence[int]) -> dict[int, Cycle]:
    cycles = {}
    for i in numbers:
        line = Line.of(evidence.recordings[i]).base
        try:
            values = view.foot(i, view.q)
            cycles[i] = cycle(evidence.foot, line.frequency_hz, line.amplitudes, values, False)
        except FasError:  # a model without these joints, or a motion that it does not have
            continue
    return cycles


def _dampers(evidence: "Evidence", view: View, cycles: Mapping[int, Cycle]) -> Iterator[Row]:
    """Damping over the relative displacement that the recordings reached, without what the springs relax."""
    if not (evidence.two_mass and cycles):
        return
    number = min(cycles)
    for joint, (*constants, part) in DAMPERS.items():
        reached = np.concatenate([getattr(loop, part).displacement_m for loop in cycles.values()])
        x = np.linspace(reached.min(), reached.max(), _PLACES)

        def law(q: np.ndarray, x: np.ndarray = x, names: Sequence[str] = constants) -> np.ndarray:
            values = view.foot(number, q)
            return np.array([damping(place, *(values[name] for name in names)) for place in x])

        centre = law(view.q)
        for place, c, (low, high) in zip(x, centre, _limits(centre, view.half_width(law)), strict=True):
            yield {
                "branch": view.branch, "basis": view.basis, "damper": joint, "displacement_m": float(place),
                "damping_n_s_per_m": float(c), "lower": low, "upper": high,
            }  # fmt: skip


def _reached(evidence: "Evidence", cycles: Mapping[int, Cycle]) -> list[Row]:
    """Relative displacements of ankle and pad under each load, over its recordings."""
    rows = []
    for joint, (*_, part) in DAMPERS.items():
        for load, numbers in _by_load(evidence).items():
            if mine := [getattr(cycles[i], part).displacement_m for i in numbers if i in cycles]:
                x = np.concatenate(mine)
                row = {"damper": joint, "added_mass_kg": load, "lower_m": float(x.min()), "upper_m": float(x.max())}
                rows.append(row)
    return rows


def _energies(evidence: "Evidence", view: View, cycles: Mapping[int, Cycle], motion: Orbits | None) -> Iterator[Row]:
    """Energy that ankle and pad dissipate in a cycle of each recording, with 95 % limits for the two-mass foot."""
    half = np.full((len(cycles), 2), np.nan)
    if motion is not None:
        half = _energy_half_widths(view, list(cycles), motion)
    for (i, loop), reach in zip(cycles.items(), half, strict=True):
        r = evidence.recordings[i]
        energies = np.array([loop.ankle.dissipated_j, loop.fat_pad.dissipated_j])
        for joint, value, (low, high) in zip(DAMPERS, energies, _limits(energies, reach), strict=True):
            yield {
                "branch": view.branch, "basis": view.basis, "file": r.file,
                "added_mass_kg": r.condition.added_mass_kg, "frequency_hz": r.condition.frequency_hz, "damper": joint,
                "dissipated_j": float(value), "lower_j": low, "upper_j": high,
                "share": float(value / loop.dissipated_j), "imbalance": loop.imbalance,
            }  # fmt: skip


def _energy_half_widths(view: View, numbers: Sequence[int], motion: Orbits) -> np.ndarray:
    """(R, 2) of ankle and pad, through the constants and masses of each recording's foot."""
    R = len(numbers)
    by_q = view.slopes(lambda q: _thetas(view, numbers, q).ravel()).reshape(R, len(PARAMETERS), -1)
    J = (work_slopes(motion) @ by_q).reshape(2 * R, -1)
    return np.asarray(view.quantile * view.spread(J)).reshape(R, 2)


def work_slopes(motion: Orbits) -> np.ndarray:
    """(B, 2, 13) derivatives to the parameters of the work of ankle and pad a cycle, pi sum_h h Im(F_h conj Z_h)."""
    assert motion.slopes is not None and motion.stretch_slopes is not None
    S, F = PARAMETERS.index("m_S"), PARAMETERS.index("m_F")
    m_S, m_F = motion.theta[:, S, None], motion.theta[:, F, None]
    ankle, dankle = -m_S * motion.shank, -m_S[..., None] * motion.slopes[:, 0]
    dankle[..., S] -= motion.shank
    pad, dpad = ankle - m_F * motion.foot, dankle - m_F[..., None] * motion.slopes[:, 1]  # Eq. (4.29)
    dpad[..., F] -= motion.foot
    force, dforce = np.stack([ankle, pad], 1), np.stack([dankle, dpad], 1)
    h = np.arange(1, force.shape[-1] + 1)[:, None]
    change = dforce * motion.stretch[..., None].conj() + force[..., None] * motion.stretch_slopes.conj()
    return np.pi * (h * change.imag).sum(2)


def _scale(view: View) -> Iterator[Row]:
    """Relative half-widths [%] of the constants that scale with the leg's mass, and what of them is that mass alone."""
    solution = view.solution
    if solution is None or not (mass_std := solution.scale_std()):
        return
    keys = {item.name: item.key for item in solution.problem.variables.space.free}
    values = solution.problem.variables.dynamic(view.q)
    for name, per_kg, whole, bare in solution.per_kilogram():
        yield {
            "branch": view.branch, "parameter": keys[name], "value": float(values[name]),
            "half_width_percent": 100 * whole, "of_it_mass_percent": 100 * view.quantile * mass_std,
            "per_kg": per_kg, "per_kg_half_width_percent": 100 * bare,
        }  # fmt: skip


def _chi_square(evidence: "Evidence", branch: str) -> list[Row]:
    """Chi-square of a branch by recording and harmonic: squares of the whitened real and imaginary part.

    The whitening takes harmonics one after the other, each less what those before it foretell, so the parts add up.
    """
    parts = {}
    for solution in evidence.solutions:
        if solution.branch == branch:
            _, r = residual(solution.problem, solution.q, evidence.replays[branch])
            parts["chi_square" if evidence.exact else "chi_square_if_model_true"] = _by_harmonic(solution, r)
    if branch in evidence.exact:
        solution = evidence.exact[branch]
        parts["chi_square_if_model_true"] = _by_harmonic(solution, solution.evaluation.residual[0])
    return [
        {
            "file": r.file, "added_mass_kg": r.condition.added_mass_kg,
            "frequency_hz": Line.of(r).base.frequency_hz, "harmonic": h + 1,
            "chi_square": None, **{name: float(part[i, h]) for name, part in parts.items()},
        }
        for i, r in enumerate(evidence.recordings) if parts
        for h in range(Line.of(r).count)
    ]  # fmt: skip


def _by_harmonic(solution: Solution, r: np.ndarray) -> np.ndarray:
    """(R, H) sums of squares of a residual (m,) over sensors, real and imaginary parts."""
    measured = solution.problem.measured
    R, S, H = measured.output.shape
    squares = np.zeros((R, 2 * S * H))
    squares[measured.rows] = r[: measured.size] ** 2
    return squares.reshape(R, 2 * S, H).sum(1)
