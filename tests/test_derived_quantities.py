"""What a fit says besides its parameters, against MuJoCo's linear model, a tight integration, draws, and sums."""

import csv
import hashlib
import io
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fasbody.foot.hysteresis import cycle
from fasbody.foot.linear import Linear
from fasbody.foot.model import Foot
from fasbody.foot.shaker import harmonics
from fasbody.foot.two_dof import TwoDof
from fasbody.foot.two_mass import PARAMETERS, parameters, resolved
from fasbody.presentation import csv_table
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.study import BUNDLED
from identification import report
from identification.derived_quantities import _views, derived, modes_of, small_motion, work_slopes
from identification.estimates import IF_TRUE, WHATEVER
from identification.harmonics import Line
from identification.replay import relaxing
from identification.result import FitResult

HZ = 20.0
#: Draws so near the estimate that what follows from them is linear.
_NEAR = 1e-3


def values(fitted: FitResult) -> dict[str, float]:
    """Constants and masses of the foot by name, the model assumed exact."""
    view = next(view for view in _views(fitted, fitted.evidence) if view.basis == IF_TRUE)
    return view.foot(0, view.q)


def test_modes_are_the_eigenvalues_of_the_linearised_mjcf(fitted: FitResult, foot: Foot) -> None:
    own = {name: value for name, value in values(fitted).items() if name in foot.parameters}
    s = Linear(foot.with_values(own)).eigenvalues()
    modes = [m for m in derived(fitted).modes if m["basis"] == IF_TRUE and m["branch"] == fitted.best.name]
    assert len(modes) == 2
    product = np.ones_like(s)
    for m in modes:
        w, zeta = 2 * np.pi * m["natural_frequency_hz"], m["damping_ratio"]
        product *= (s**2 + 2 * zeta * w * s + w**2) / w**2
    assert np.abs(product).max() < 1e-5


def test_modes_that_do_not_swing_are_a_pair_of_real_eigenvalues() -> None:
    A = np.zeros((4, 4))
    A[:2, 2:], A[2:, :2], A[2:, 2:] = np.eye(2), -np.diag([100.0, 1e4]), -np.diag([4.0, 500.0])
    f, zeta = modes_of(np.linalg.eigvals(A))
    assert 2 * np.pi * f == pytest.approx([10, 100])
    assert zeta == pytest.approx([0.2, 2.5])


@pytest.mark.parametrize(("r", "tau"), [(0.1, 5e-3), (0.6, 4e-3), (1.5, 2e-2)])
def test_modes_of_springs_that_relax_make_the_dynamic_stiffness_singular(foot: Foot, r: float, tau: float) -> None:
    p = {**foot.values(), "r_T": r, "r_F": 0.5 * r, "tau": tau}
    f, zeta = small_motion(p)
    assert f.size == 2 and (zeta < 1).any()
    for w, z in zip(2 * np.pi * f, zeta, strict=True):
        s = w * (-z + np.emath.sqrt(z * z - 1))
        K_T, K_F = (
            p[f"k_{j}"] * (1 + p[f"r_{j}"] * s * tau / (1 + s * tau)) + s * p[c]
            for j, c in (("T", "c_11"), ("F", "c_21"))
        )
        D = np.array([[p["m_S"] * s * s + K_T, -K_T], [-K_T, p["m_F"] * s * s + K_T + K_F]])
        if z < 1:  # of a pair of real eigenvalues only sum and product are given
            assert abs(np.linalg.det(D)) < 1e-9 * abs(D[0, 0] * D[1, 1])


def test_what_relaxes_in_mujoco_is_in_the_slopes_of_the_energies(foot: Foot) -> None:
    """Exact derivatives of the works against differences of the loops that MuJoCo's own forces make."""
    base = np.array([-8.95j, 0.13 + 0.05j])
    p = {**foot.values(), "c_12": 90.0, "c_23": 150.0, "r_T": 0.4, "r_F": 0.7, "tau": 4e-3}
    moved = relaxing(foot)

    def works(values: dict[str, float]) -> np.ndarray:
        made = {f"relaxing_{j}": values[f"k_{j}"] * values[f"r_{j}"] for j in ("T", "F")}
        made |= {"tau_T": values["tau"], "tau_F": values["tau"]}
        found = cycle(moved, HZ, base, values | made, False)
        return np.array([found.ankle.dissipated_j, found.fat_pad.dissipated_j])

    motion = resolved(parameters(p)[None], np.array([2 * np.pi * HZ]), base[None], slopes=True)
    (slopes,) = work_slopes(motion)
    for name, size in (("k_T", 30.0), ("c_12", 0.05), ("m_S", 1e-3), ("m_F", 1e-3), ("r_F", 1e-3), ("tau", 1e-6)):
        up, down = (works(p | {name: p[name] + sign * size}) for sign in (1, -1))
        want = (up - down) / (2 * size)
        assert slopes[:, PARAMETERS.index(name)] == pytest.approx(want, rel=1e-4, abs=1e-5 * np.abs(want).max())


@pytest.mark.parametrize("basis", [WHATEVER, IF_TRUE])
def test_intervals_are_those_of_draws(fitted: FitResult, basis: str) -> None:
    view = next(view for view in _views(fitted, fitted.evidence) if view.basis == basis)
    C = view.solution.covariance
    free = np.isfinite(np.diag(C)) & (np.diag(C) > 0)
    rng = np.random.default_rng(0)
    root = np.linalg.cholesky(C[np.ix_(free, free)])
    drawn = []
    for _ in range(400):
        q = view.q.copy()
        q[free] += _NEAR * root @ rng.normal(size=free.sum())
        drawn.append(np.log(small_motion(view.foot(0, q))[0][0]))
    (mode,) = (m for m in derived(fitted).modes
               if (m["basis"], m["branch"], m["mode"]) == (basis, view.branch, 1))  # fmt: skip
    std = np.log(mode["upper_hz"] / mode["natural_frequency_hz"]) / view.quantile
    assert np.std(drawn) / _NEAR == pytest.approx(std, rel=0.15)
    assert mode["lower_hz"] < np.exp(np.mean(drawn)) < mode["upper_hz"]


def test_energies_are_those_of_an_integration_in_time(fitted: FitResult) -> None:
    line = next(Line.of(r) for r in fitted.evidence.recordings if round(r.condition.frequency_hz) == HZ)
    f = line.base.frequency_hz
    foot, base = TwoDof.from_values(values(fitted)), harmonics(f, line.base.amplitudes, 1.0)

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        u = float(base.acceleration(np.array([t % (1 / f)]))[0])
        F_T, F_F = foot.forces(x[:4])
        power = (F_T - foot.k_T * x[0]) * x[2], (F_F - foot.k_F * x[1]) * x[3]
        return np.array([*foot.rates(t, x[:4], u), *power])

    settled = 20 / f
    run = solve_ivp(
        rates, (0, settled + 1 / f), np.zeros(6), "DOP853", [settled, settled + 1 / f], rtol=1e-9, atol=1e-12
    )
    work = run.y[4:, 1] - run.y[4:, 0]
    mine = [e for e in derived(fitted).energies
            if (e["basis"], e["branch"], e["frequency_hz"]) == (IF_TRUE, fitted.best.name, f)]  # fmt: skip
    assert [e["damper"] for e in mine] == ["ankle", "fat pad"]
    assert [e["dissipated_j"] for e in mine] == pytest.approx(work, rel=1e-5)
    assert all(e["lower_j"] < e["dissipated_j"] < e["upper_j"] for e in mine)
    assert sum(e["share"] for e in mine) == pytest.approx(1)


def test_the_legs_mass_is_the_part_that_all_intervals_share(fitted: FitResult) -> None:
    """A constant's logarithm is that of the constant per kilogram and that of the mass, so the widths are sides."""
    view = next(view for view in _views(fitted, fitted.evidence) if view.basis == WHATEVER)
    rows = [row for row in derived(fitted).scale if row["branch"] == view.branch]
    assert [row["parameter"] for row in rows] == list(fitted.parameters)[:4]
    leg = sum(mass.value for mass in fitted.departures.masses)
    (mass,) = {row["of_it_mass_percent"] for row in rows}
    assert mass == pytest.approx(100 * view.quantile * fitted.departures.scale_std)
    for row in rows:
        e = fitted[row["parameter"]]
        assert row["half_width_percent"] == pytest.approx(50 * np.log(e.upper / e.lower), rel=1e-3)
        assert row["per_kg"] == pytest.approx(e.value / leg, rel=1e-6)
        whole, per_kg = row["half_width_percent"], row["per_kg_half_width_percent"]
        assert abs(whole - mass) <= per_kg * (1 + 1e-2) and per_kg <= (whole + mass) * (1 + 1e-2)
    # natural frequencies do not know the mass
    (mode,) = (m for m in derived(fitted).modes if (m["basis"], m["branch"], m["mode"]) == (WHATEVER, view.branch, 1))
    assert 100 * np.log(mode["upper_hz"] / mode["natural_frequency_hz"]) < 0.3 * mass


def test_per_kilogram_is_of_profiles_where_the_constant_is(fitted: FitResult) -> None:
    """At the end of its profile a constant per kilogram costs as much as the constant at its own."""
    solution = next(v.solution for v in _views(fitted, fitted.evidence) if v.basis == WHATEVER)
    assert solution is not None and solution.profiles
    v, found = solution.problem.variables, solution.per_kilogram()

    def per_kg(q: np.ndarray) -> np.ndarray:
        return np.array([np.log(v.dynamic(q)[name]) - solution._scale(q) for name, *_ in found])

    curved = solution.quantile * solution.spread(solution.slopes(per_kg))
    profiled = np.array([bare for *_, bare in found])
    assert (np.abs(profiled / curved - 1) > 0.02).any(), "the curvature would do, so this tests nothing"
    for name, _, whole, _ in found:
        assert whole == pytest.approx(solution.profiles[name].mean())


def test_the_scale_is_that_of_the_smallest_load_whatever_comes_first(fitted: FitResult) -> None:
    solution = next(v.solution for v in _views(fitted, fitted.evidence) if v.basis == WHATEVER)
    v = solution.problem.variables
    order = [0, *range(len(v.recordings))]
    loaded = replace(v.recordings[0], condition=replace(v.recordings[0].condition, added_mass_kg=4.5))
    recordings = [loaded, *(v.recordings[i] for i in order[1:])]
    more = replace(solution, problem=replace(solution.problem, variables=replace(v, recordings=recordings)))
    assert more._scale(solution.q) == pytest.approx(solution._scale(solution.q))


def test_parts_of_chi_square_add_up(fitted: FitResult) -> None:
    parts = derived(fitted).chi_square
    assert sum(row["chi_square_if_model_true"] for row in parts) == pytest.approx(fitted.best.chi_square, rel=1e-6)
    assert sum(row["chi_square"] for row in parts) == pytest.approx(fitted.departures.chi_square, rel=1e-6)
    assert 2 * len(parts) == fitted.best.dof + len(fitted.parameters)
    assert {(r["harmonic"], round(r["frequency_hz"])) for r in parts} >= {(1, 10), (6, 10), (3, 30)}


def test_curves_go_through_the_motion_in_mujoco(fitted: FitResult) -> None:
    found = derived(fitted)
    for r in fitted.recordings:
        out, into = (fit_harmonics(r.time_s, x, r.frequency_hz, 1).amplitudes[0] for x in (r.model, r.base))
        (curve,) = (row for row in found.curves
                    if (row["branch"], row["frequency_hz"]) == (fitted.best.name, r.frequency_hz))  # fmt: skip
        assert curve["transmissibility"] == pytest.approx(abs(out / into), rel=2e-3)
        assert curve["phase_lag_deg"] == pytest.approx(-np.degrees(np.angle(out / into)), abs=0.3)
        (data,) = (row for row in found.data if row["frequency_hz"] == r.frequency_hz)
        assert data["lower"] < data["transmissibility"] < data["upper"]


def test_laws_of_the_dampers_hold_their_constant_at_rest(fitted: FitResult) -> None:
    rows = [row for row in derived(fitted).dampers if row["basis"] == IF_TRUE and row["branch"] == fitted.best.name]
    for damper, name in (("ankle", "c_11"), ("fat pad", "c_21")):
        mine = [row for row in rows if row["damper"] == damper]
        x = [row["displacement_m"] for row in mine]
        assert min(x) < 0 < max(x)
        e = fitted[name].if_model_true
        for key, want in (("damping_n_s_per_m", e.value), ("lower", e.lower), ("upper", e.upper)):
            assert np.interp(0.0, x, [row[key] for row in mine]) == pytest.approx(want, rel=2e-3)
        (reached,) = (row for row in derived(fitted).reached if row["damper"] == damper)
        assert reached["lower_m"] < 0 < reached["upper_m"]


def test_tables_are_what_is_drawn(fitted: FitResult) -> None:
    found = report.tables(fitted)
    rows = list(csv.DictReader(io.StringIO(csv_table(found["modes"]))))
    assert [float(row["natural_frequency_hz"]) for row in rows] == pytest.approx(
        [m["natural_frequency_hz"] for m in derived(fitted).modes], rel=1e-7
    )
    assert set(report.captions(fitted)) <= {name.split("_data")[0] for name in found}
    assert all(rows for rows in found.values())


def test_a_result_says_how_to_make_it_again(fitted: FitResult) -> None:
    told = fitted.document()["provenance"]
    assert told["seed"] == 0 and told["settings"]["starts"] == 2
    assert told["bounds"]["k_T_n_per_m"] == [1e4, 1e7]
    assert {"mujoco", "numpy", "python"} <= set(told["versions"])
    for file, digest in told["sha256"].items():
        assert digest == hashlib.sha256((BUNDLED.parent / file).read_bytes()).hexdigest()
    assert len(told["sha256"]) == 3
