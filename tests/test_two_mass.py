"""The two-mass foot's harmonic balance against SciPy's DOP853, differences, and MuJoCo's own stepping."""

import numpy as np
import oracle
import pytest
from scipy.integrate import solve_ivp

from fasbody.foot.model import load
from fasbody.foot.shaker import harmonics
from fasbody.foot.simulate import Batch
from fasbody.foot.two_dof import TwoDof
from fasbody.foot.two_mass import PARAMETERS, Orbits, orbits, parameters, resolved
from identification.engines.mujoco import Coordinates
from identification.replay import relaxing

Array = np.ndarray
#: A table with some distortion [m/s^2].
BASE = np.array([-8.95j, 0.13 + 0.05j, 0.07j])
RELAXING = {"r_T": 0.4, "r_F": 0.25, "tau": 6e-3}
FEET = {name: {**oracle.MASSES, **foot} for name, foot in oracle.FEET.items()}
FEET["relaxing"] = FEET["truth"] | RELAXING


def orbit(p: dict[str, float], hz: float, base: Array = BASE, **options: bool) -> Orbits:
    return resolved(parameters(p)[None], np.array([2 * np.pi * hz]), base[None], **options)


def rates(p: dict[str, float], hz: float, base: Array):  # type: ignore[no-untyped-def]
    """Of the stretches, their rates and the Maxwell forces, and what the two sensors feel."""
    p = {"r_T": 0.0, "r_F": 0.0, "tau": 5e-3, **p}
    turn = 2j * np.pi * hz * np.arange(1, base.size + 1)
    ankle, pad = oracle.ankle_of(p), oracle.pad_of(p)

    def felt(x: Array) -> tuple[float, float]:
        T, F = ankle(x[0], x[2]) + x[4], pad(x[1], x[3]) + x[5]
        return -T / p["m_S"], (T - F) / p["m_F"]

    def rate(t: float, x: Array) -> list[float]:
        shank, foot = felt(x)
        table = float((base @ np.exp(turn * t)).real)
        memory = [p["r_T"] * p["k_T"] * x[2] - x[4] / p["tau"], p["r_F"] * p["k_F"] * x[3] - x[5] / p["tau"]]
        return [x[2], x[3], shank - foot, foot - table, *memory]

    return rate, felt


def stepped(
    p: dict[str, float], hz: float, x: Array, t: Array, base: Array = BASE, rtol: float = 1e-13,
    most: float = np.inf,
) -> Array:  # fmt: skip
    """States (6, n) at times t (n,) [s] from x (6,), while |z_1| is below `most`; steps as t at most."""
    size, (rate, _) = np.maximum(np.abs(x), 1e-12), rates(p, hz, base)

    def end(t: float, x: Array) -> float:
        return float(most - abs(x[0])) if np.isfinite(most) else 1.0

    end.terminal = True  # type: ignore[attr-defined]
    options = {"t_eval": t, "rtol": rtol, "atol": rtol * size, "max_step": t[1] - t[0], "events": end}
    return np.asarray(solve_ivp(rate, (0, t[-1]), x, "DOP853", **options).y)


def state(found: Orbits) -> Array:
    return np.concatenate([found.states()[0], found.memories()[0]])


@pytest.mark.parametrize("hz", [9.0, 24.0, 50.0])
@pytest.mark.parametrize("name", FEET)
def test_harmonics_are_those_of_an_ode_solver(name: str, hz: float) -> None:
    """A period from the orbit's state, with and without springs that relax: back to where it began."""
    found, p, n = orbit(FEET[name], hz), FEET[name], 256
    t = np.arange(n + 1) / (n * hz)
    x = stepped(p, hz, state(found), t)
    size = np.abs(x).max(axis=1).clip(1e-12)
    assert (np.abs(x[:, -1] - x[:, 0]) < 1e-12 * size).all()
    _, felt = rates(p, hz, BASE)
    Y = 2 / n * np.fft.rfft([felt(each) for each in x.T[:-1]], axis=0)[1:].T
    have, H = np.stack([found.shank[0], found.foot[0]]), found.shank.shape[1]
    assert np.abs(Y[:, :H] - have).max() < 1e-12 * np.abs(have).max()
    assert np.abs(Y[:, H : n // 4]).max() < 1e-11 * np.abs(have).max()  # what harmonics beyond those would be


def test_a_linear_foot_is_its_closed_form() -> None:
    p = FEET["truth"] | dict.fromkeys(("c_12", "c_13", "c_22", "c_23"), 0.0)
    for hz in (10.0, 45.0):
        H = oracle.linear_response(p, hz * np.arange(1, 4))
        np.testing.assert_allclose(orbit(p, hz).shank[0, :3], BASE * H, rtol=1e-9)


def test_derivatives_are_those_of_differences() -> None:
    """Of both sensors and both stretches to all thirteen, of a bent foot whose springs relax."""
    theta, hz = parameters(FEET["relaxing"]), 17.0
    exact = orbit(FEET["relaxing"], hz, slopes=True)
    assert exact.slopes is not None and exact.stretch_slopes is not None

    def moved(theta: Array) -> Array:
        found = resolved(theta[None], exact.omega, BASE[None])
        return np.stack([found.shank[0], found.foot[0], *found.stretch[0]])

    have = np.concatenate([exact.slopes[0], exact.stretch_slopes[0]])
    for i, name in enumerate(PARAMETERS):
        d = 1e-4 * abs(theta[i]) * np.eye(theta.size)[i]
        want = (moved(theta + d) - moved(theta - d)) / (2 * d[i])
        size = np.abs(want).max(axis=1, keepdims=True)
        assert (np.abs(have[..., i] - want) < 1e-6 * size).all(), name


def test_derivatives_to_the_base_are_those_of_differences() -> None:
    exact = orbit(FEET["relaxing"], 17.0)
    H, G = exact.shank.shape[1], exact.by_base()[0]
    base = np.zeros(H, complex)
    base[:3] = BASE
    split = lambda found: np.stack([[*x[0].real, *x[0].imag] for x in (found.shank, found.foot)])  # noqa: E731
    for i in range(2 * H):
        step = 1e-4 * (1 if i < H else 1j) * np.eye(H)[i % H]
        up, down = (
            split(orbits(exact.theta, exact.omega, (base + s * step)[None], exact.stretch, tolerance=1e-9))
            for s in (1, -1)
        )
        np.testing.assert_allclose(G[..., i], (up - down) / 2e-4, atol=1e-7 * np.abs(G).max())


def strong(seed: int, count: int = 200) -> tuple[Array, Array, Array]:
    """Feet, soft and weakly damped ones among them, at 8.95 m/s^2 from 8 to 50 Hz: theta, omega, base."""
    rng, theta = np.random.default_rng(seed), np.empty((count, len(PARAMETERS)))
    theta[:] = parameters({**oracle.MASSES, **dict.fromkeys(PARAMETERS[:8], 0.0)})
    theta[:, :2] = np.exp(rng.uniform(*np.log([3e4, 4e5]), (2, count))).T
    theta[:, [2, 5]] = np.exp(rng.uniform(*np.log([90.0, 1100.0]), (2, count))).T
    theta[:, [3, 6]] = rng.uniform(-400, 400, (2, count)).T
    theta[:, [4, 7]] = rng.uniform(0, 400, (2, count)).T
    return theta, 2 * np.pi * rng.uniform(8, 50, count), np.tile(-8.95j * np.eye(1, 6), (count, 1))


@pytest.mark.parametrize(("seed", "count"), [(0, 0), (54, 1)])
def test_a_strong_foot_moves_or_its_damper_gives_way(seed: int, count: int) -> None:
    """Of 200 feet each has a motion, or its branch ends at a fold below the full base: a damper past its strongest.

    There two motions meet, so that a multiplier is 1. Below it the motion attracts; at the full base a foot that moves
    as at the fold runs away, as the ODE solver says.
    """
    theta, omega, base = strong(seed)
    found = orbits(theta, omega, base)
    without = np.flatnonzero(~found.converged)
    assert without.size == count
    for i in without:
        foot = theta[i : i + 1], omega[i : i + 1]
        low, high = 0.0, 1.0
        while high - low > 1e-5:  # the last share of the base that has a motion
            share = 0.5 * (low + high)
            last = orbits(*foot, share * base[i : i + 1])
            low, high = (share, high) if last.converged[0] else (low, share)
        fold = orbits(*foot, low * base[i : i + 1])
        before = orbits(*foot, 0.98 * low * base[i : i + 1])
        assert before.multipliers()[0] < 0.98 < fold.multipliers()[0] < 1.001
        p, hz = dict(zip(PARAMETERS, theta[i], strict=True)), omega[i] / (2 * np.pi)
        t, most = np.linspace(0, 60 / hz, 1200), np.abs(fold.stretch[0, 0]).sum()
        stays = stepped(p, hz, state(before), t, 0.98 * low * base[i, :1], 1e-8, most)
        runs = stepped(p, hz, state(fold), t, base[i, :1], 1e-8, 2 * most)
        assert stays.shape[1] == t.size > runs.shape[1]


@pytest.mark.parametrize(("name", "hz"), [("truth", 12.0), ("soft", 9.0), ("relaxing", 30.0)])
def test_multipliers_are_those_of_a_stepped_period(name: str, hz: float) -> None:
    """The monodromy matrix by differences of states after one period."""
    p, found = FEET[name], orbit(FEET[name], hz)
    x, t = state(found), np.array([0.0, 1 / hz])
    M = np.empty((6, 6))
    for i, d in enumerate(1e-4 * np.array([1e-3, 1e-3, 0.1, 0.1, 50.0, 50.0])):
        step = d * np.eye(6)[i]
        M[:, i] = (stepped(p, hz, x + step, t)[:, -1] - stepped(p, hz, x - step, t)[:, -1]) / (2 * d)
    assert found.multipliers()[0] == pytest.approx(np.abs(np.linalg.eigvals(M)).max(), rel=1e-3)


def test_a_foot_that_feeds_itself_has_a_motion_that_does_not_last() -> None:
    """An ankle whose damper drives: there is an orbit, and every multiplier beyond 1 says that no foot stays on it."""
    p = FEET["truth"] | {"c_11": -300.0, "c_12": 0.0, "c_13": 0.1, "c_21": 60.0}
    found = orbit(p, 20.0)
    assert found.converged[0] and found.multipliers()[0] > 1.5
    assert orbit(p | {"c_11": 300.0}, 20.0).multipliers()[0] < 1


def test_the_mirror_image_of_a_linear_foot_moves_alike_and_of_a_bent_one_does_not() -> None:
    linear = FEET["truth"] | dict.fromkeys(("c_12", "c_13", "c_22", "c_23"), 0.0)
    for p, alike in ((linear, True), (FEET["truth"], False)):
        image = vars(TwoDof.from_values(p).mirror())
        one, other = orbit(p, 20.0), orbit(image, 20.0)
        size = np.abs(one.shank).max()
        assert bool(np.abs(one.shank - other.shank).max() < 1e-11 * size) is alike
        assert np.abs(one.foot - other.foot).max() > 1e-3 * size  # a sensor there tells them apart


def test_motions_of_many_are_those_of_each_and_a_start_nearby_leads_there() -> None:
    theta, omega, base = strong(0, 20)
    together = orbits(theta, omega, base, tolerance=1e-9)
    for i in range(20):
        alone = orbits(theta[i : i + 1], omega[i : i + 1], base[i : i + 1], tolerance=1e-9)
        np.testing.assert_allclose(alone.shank[0], together.shank[i], rtol=1e-9, atol=1e-12)
    loose = orbits(theta, omega, base, 1.02 * together.stretch, tolerance=1e-3, passes=8)
    error = np.abs(loose.shank - together.shank).max(axis=1) / np.abs(together.shank).max(axis=1)
    assert loose.converged.all() and error.max() < 1e-4  # about the square of what was tolerated


@pytest.mark.parametrize("name", ["truth", "relaxing"])
def test_mujoco_stays_on_the_orbit(name: str) -> None:
    """Ankle and pad with Eq. (4.25), and Maxwell elements beside them: Runge-Kutta comes nearer with its fourth power.

    The error after three periods is of the states, and 16 times smaller for half the step.
    """
    p, hz, foot = FEET[name], 20.0, relaxing(load("two_dof"))
    found = orbit(p, hz)
    share = {"r_T": 0.0, "r_F": 0.0, "tau": 5e-3, **p}
    values = {n: v for n, v in p.items() if n in foot.parameters} | {
        f"relaxing_{j}": p[f"k_{j}"] * share[f"r_{j}"] for j in "TF"
    }
    batch, coordinates = Batch(foot, 1, 1), Coordinates(foot)
    batch.set(values | {f"tau_{j}": share["tau"] for j in "TF"})
    pad_first = state(found)[[1, 0, 3, 2, 4, 5]]
    errors = []
    for n in (100, 200):
        h = 1 / (hz * n)
        out = batch.run(harmonics(hz, BASE, 3 / hz).controls(h, 3 * n)[None], h, *coordinates.unpack(pad_first[None]))
        last = np.stack([out.outputs["malleolus"][0, -n:], out.outputs["foot"][0, -n:]])
        Y = 2 / n * np.fft.rfft(last)[:, 1:7]
        want = np.stack([found.shank[0, :6], found.foot[0, :6]])
        errors.append(np.abs(Y - want).max() / np.abs(want).max())
    assert errors[1] < 1e-6 and errors[0] / errors[1] > 10


def test_slopes_know_that_one_factor_common_to_all_constants_changes_no_motion() -> None:
    """Stiffness, damping and mass times one factor: what a plan of endless recordings rests on."""
    rng = np.random.default_rng(0)
    usual = {"k_T": 1.3e5, "k_F": 9.4e4, "c_11": 380, "c_12": 90, "c_13": 140, "c_21": 700, "c_22": -120, "c_23": 120}
    theta = np.tile(parameters(usual | {"m_S": 3.4, "m_F": 1.05, "r_T": 0.1, "r_F": 0.2}), (40, 1))
    theta *= np.exp(0.2 * rng.normal(size=theta.shape))
    moved = orbits(theta, 2 * np.pi * rng.uniform(10, 50, 40), 8.95 * np.eye(1, 6, dtype=complex).repeat(40, 0))
    assert moved.converged.all() and moved.slopes is not None
    scaled = [PARAMETERS.index(name) for name in ("k_T", "k_F", "c_11", "c_21", "m_S", "m_F")]
    along = (moved.slopes[..., scaled] * theta[:, None, None, scaled]).sum(-1)
    assert np.abs(along).max() < 1e-7 * np.abs(moved.shank).max()
