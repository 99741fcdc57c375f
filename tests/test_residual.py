"""The whitened residual: derivatives against differences, weights against a Monte Carlo, priors and what is held."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from scipy.stats import chi2
from steady_cases import BENT, BOTH, problem, recorded, session

from identification.residual import NO_MOTION, Problem, Scatter

Array = np.ndarray
LINEAR = BENT | dict.fromkeys(("c_12", "c_13", "c_22", "c_23"), 0.0)


@pytest.fixture(scope="module")
def everything() -> Problem:
    """Two people, two loads, two sensors: every kind of nuisance there is."""
    data = [
        recorded(BENT, hz, added=added, person=person, body_kg=kg, second=True)
        for person, kg in (("ann", 60.0), ("bo", 80.0))
        for added, hz in ((0.0, 12.0), (2.3, 20.0), (4.5, 31.0))
    ]
    return problem(data, sensors=BOTH)


def away(problem: Problem, seed: int = 0) -> Array:
    """A place off the priors' means and off all bounds."""
    v, (_, high) = problem.variables, problem.bounds()
    q, std = v.start(v.model_values), v.prior[1]
    step = 0.3 * np.random.default_rng(seed).uniform(0.3, 1, q.size) * np.where(np.isfinite(std), std, 0.1)
    return np.where(q + step < high, q + step, q - step)


def test_derivatives_to_every_variable_are_those_of_differences(everything: Problem) -> None:
    v, q = everything.variables, away(everything)
    assert {item.kind for item in v.nuisances} == {
        "shank mass", "foot mass", "load share", "gain", "delay", "drift", "mount", "mount damping", "rocking",
        "rocking frequency", "rocking damping", "relaxing", "relaxation time", "under load",
    }  # fmt: skip
    names = [*v.constants, *(item.name for item in v.nuisances)]
    assert len(names) == q.size == 8 + 2 * 3 + 2 * 6 + 2 + 3 + 2 * 4
    J = everything.evaluate(q[None]).jacobian[0]
    for i, name in enumerate(names):
        d = 1e-5 * np.eye(q.size)[i]
        up, down = (everything.evaluate((q + s * d)[None]).residual[0] for s in (1, -1))
        want = (up - down) / 2e-5
        assert np.abs(J[:, i] - want).max() < 1e-5 * np.abs(want).max(), name


def test_candidates_together_are_each_alone(everything: Problem) -> None:
    """To the tolerance of a screening, from the linear motion and from the motions of neighbours."""
    Q = np.stack([away(everything, seed) for seed in range(3)])
    together = everything.evaluate(Q)
    near = everything.evaluate(Q + 1e-3, together)
    for q, r, follows in zip(Q, together.residual, near.residual, strict=True):
        alone = everything.evaluate(q[None]).residual[0]
        assert np.abs(r - alone).max() < 1e-3 * np.abs(alone).max()
        beside = everything.evaluate(q[None] + 1e-3).residual[0]
        assert np.abs(follows - beside).max() < 1e-3 * np.abs(beside).max()


def test_a_prior_is_a_row_and_the_image_of_the_image_is_where_it_was(everything: Problem) -> None:
    v, q = everything.variables, away(everything)
    mean, std = v.prior
    known = np.isfinite(std)
    rows = everything.evaluate(q[None]).residual[0, everything.size :]
    np.testing.assert_allclose(rows, [*((q - mean) / std)[known], 0.0, 0.0])  # the last two are zero within bounds
    np.testing.assert_allclose(v.image(v.image(q)), q, rtol=1e-12)
    other = v.dynamic(v.image(q))
    assert (other["k_T"] > v.ratio * other["k_F"]) is not (v.dynamic(q)["k_T"] > v.ratio * v.dynamic(q)["k_F"])


def test_the_image_of_a_linear_foot_has_its_residual() -> None:
    """Under one load, with springs that relax; the priors' rows are of other constants."""
    made = problem(session(LINEAR, (12.0, 20.0, 31.0)), LINEAR)
    q = made.variables.start(LINEAR)
    q[made.variables.of_kind("relaxing", "k_T")] = 0.4
    q[made.variables.of_kind("relaxing", "k_F")] = 0.2
    one, other = (made.evaluate(x[None]).residual[0, : made.size] for x in (q, made.variables.image(q)))
    assert np.abs(one).max() > 1 and np.abs(one - other).max() < 1e-4 * np.abs(one).max()


def test_what_is_held_stays_at_its_prior_and_has_no_row(everything: Problem) -> None:
    held = everything.variables.held(["gain", "shank mass"])
    assert held.sum() == 4
    fixed, q = everything.with_held(held), away(everything)
    mean, _ = everything.variables.prior
    for sign in (0, 1, -1):
        low, high = fixed.bounds(sign)
        np.testing.assert_array_equal(low == high, held)
        np.testing.assert_array_equal(low[held], mean[held])
    q[held] = mean[held]
    whole, part = everything.evaluate(q[None]), fixed.evaluate(q[None])
    assert part.residual.shape[1] == whole.residual.shape[1] - held.sum()
    np.testing.assert_allclose(part.residual[0, : fixed.size], whole.residual[0, : fixed.size], rtol=1e-9)
    assert not part.jacobian[..., held].any() and np.abs(part.jacobian[..., ~held]).max(axis=1).all()


def test_channels_are_delays_gains_mounts_and_a_rocking_leg() -> None:
    """Against the physics that each stands for, at the harmonics of both recordings."""
    made = problem(session(BENT, (12.0, 31.0)))
    v, q = made.variables, made.variables.start(BENT)
    f = v.omega[:, None] / (2 * np.pi) * np.arange(1, 4)
    for kind, value in (("gain", 0.02), ("drift", 0.03), ("delay", 4e-4), ("mount", 90.0**-2), ("rocking", 0.05)):
        i = v.of_kind(kind, sensor="malleolus")
        assert i is not None
        q[i] = value / v.scale[i]
    T, rock = made.channel(q[None], 3)
    sensor = 1 / (1 - (f / 90) ** 2 / (1 + 2j * 0.2 * f / 90))  # a mass on tissue, its ground moving
    gain = 1 + 0.02 + 0.03 * np.array([[-0.5], [0.5]])
    np.testing.assert_allclose(T[0, :, 0], gain * np.exp(-2j * np.pi * f * 4e-4) * sensor, rtol=1e-12)
    s, w = 2j * np.pi * f, 2 * np.pi * 60
    leg = s**2 / (s**2 + 2 * 0.1 * w * s + w**2)
    np.testing.assert_allclose(rock[0, :, 0], 0.05 * leg * made.measured.base[:, :3], rtol=1e-12)


def test_a_spring_that_relaxes_is_its_dynamic_stiffness() -> None:
    """Two masses on K(s) = k (1 + r s tau / (1 + s tau)) + s c; what is searched is K at the reference frequency."""
    made = problem(session(LINEAR, (20.0, 40.0)), LINEAR)
    v, q, tau = made.variables, made.variables.start(LINEAR), 6e-3
    relaxes = {("relaxing", "k_T"): 0.3, ("relaxing", "k_F"): 0.2, ("relaxation time", ""): np.log(tau)}
    for each, value in relaxes.items():
        i = v.of_kind(*each)
        assert i is not None
        q[i] = value / v.scale[i]
    rest, dynamic = v.at_rest(q), v.dynamic(q)
    s = 2j * np.pi * v.reference_hz
    assert v.reference_hz == pytest.approx(np.sqrt(20 * 40), rel=1e-4)

    def stiffness(s: complex, k: str, c: str, r: float) -> complex:
        return complex(rest[k] * (1 + r * s * tau / (1 + s * tau)) + rest[c] * s)

    for k, c, r in (("k_T", "c_11", 0.3), ("k_F", "c_21", 0.2)):
        K = stiffness(s, k, c, r)
        assert (dynamic[k], dynamic[c]) == pytest.approx((K.real, K.imag / s.imag))
        assert rest[k] < 0.95 * LINEAR[k] and dynamic[k] == pytest.approx(LINEAR[k]) and rest[c] < dynamic[c]
    for r, Y in enumerate(made.predicted(q)[:, 0, 0]):
        s, m = 1j * v.omega[r], v.recordings[r].condition.masses
        T, F = (stiffness(s, *each) for each in (("k_T", "c_11", 0.3), ("k_F", "c_21", 0.2)))
        want = T * F / ((m["m_S"] * s**2 + T) * (m["m_F"] * s**2 + T + F) - T**2)
        assert made.measured.base[r, 0] * want == pytest.approx(Y, rel=1e-9)


def test_weights_of_a_linear_foot_are_sensor_noise_and_input_noise_through_its_response() -> None:
    """S = S_y + |H|^2 S_u at each harmonic, H from the dynamic stiffness."""
    made = problem(session(LINEAR, (10.0, 20.0, 30.0)), LINEAR)
    made = made.weighed(made.variables.start(LINEAR))
    W = made.whitener(Scatter())
    for r, line in enumerate(made.measured.lines):
        at = np.flatnonzero(made.measured.rows[r])
        S = np.linalg.inv(W[r][np.ix_(at, at)].T @ W[r][np.ix_(at, at)])
        H = oracle.linear_response(LINEAR, line.base.frequency_hz * np.arange(1, line.count + 1))
        want = np.tile(line.malleolus.std**2 + np.abs(H) ** 2 * line.base.std**2, 2)
        np.testing.assert_allclose(np.diag(S), want, rtol=2e-3)
        assert np.abs(S - np.diag(np.diag(S))).max() < 1e-3 * want.max()


@pytest.mark.parametrize("scatter", [pytest.param(Scatter(), marks=pytest.mark.long), Scatter(0.01, 0.005)])
def test_what_is_left_of_the_truth_is_white(scatter: Scatter) -> None:
    """A Monte Carlo over the noise of base and sensors, and over the scatter between recordings, of a bent foot."""
    made = problem([recorded(BENT, hz, second=True) for hz in (12.0, 31.0)], sensors=BOTH)
    strong = replace(made.measured, base=made.measured.base + 0.5, base_std=np.full(made.measured.base.shape, 0.03))
    made = replace(made, measured=strong, motion=type(made.motion)(strong, made.variables.omega, (False, True)))
    q = made.variables.start(BENT)
    made = replace(made, measured=replace(strong, output=made.predicted(q))).weighed(q)
    made = made.with_scatter(scatter)
    exact, rng, rows = made.measured, np.random.default_rng(3), []
    draw = lambda std: std * (rng.normal(size=std.shape) + 1j * rng.normal(size=std.shape))  # noqa: E731
    names = ("k_T", "k_F", "c_11", "c_21")

    def feet() -> list[dict[str, float]]:
        """Of each recording its own."""
        return [BENT | {n: BENT[n] * np.exp(scatter.constants * rng.normal()) for n in names} for _ in range(2)]

    for _ in range(200):
        seated = np.stack([made.predicted(made.variables.start(foot)) for foot in feet()])
        moved = exact.output + draw(exact.output_std) + draw(scatter.harmonics * np.abs(exact.output))
        moved += seated[np.arange(2), np.arange(2)] - exact.output
        noisy = replace(exact, base=exact.base + draw(exact.base_std), output=moved)
        drawn = replace(made, measured=noisy, motion=type(made.motion)(noisy, made.variables.omega, (False, True)))
        rows.append(made.whitened(drawn.predicted(q) - moved + exact.output))
    r = np.array(rows)
    assert 1e-4 < chi2.cdf((r**2).sum(), r.size) < 1 - 1e-4
    C = r.T @ r / len(r)
    assert np.abs(C - np.eye(len(C))).max() < 5 * np.sqrt(2 / len(r))


def test_what_has_no_motion_is_far_from_every_recording() -> None:
    """Among candidates that move: its residual is large, and nothing is not a number."""
    made = problem(session(BENT, (20.0,)), free=["k_T", "c_11"], delay=False, bounds={"c_11": (1e-3, 1e4)})
    q = made.variables.start(BENT)
    nothing = q.copy()
    nothing[0] = np.nan
    with np.errstate(invalid="ignore"):
        found = made.evaluate(np.stack([q, nothing]))
    np.testing.assert_array_equal(found.moves, [True, False])
    assert (found.residual[1] == NO_MOTION).all() and not found.jacobian[1].any()
    assert np.abs(found.residual[0]).max() < 10
