"""How well recordings repeat, as a fit estimates it: sessions whose constants scatter, or do not."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from steady_cases import BENT, problem, recorded, session

from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.fitting import fit_foot
from identification.optimiser import Effort, search
from identification.repeatability import _Linear
from identification.residual import Problem, Scatter

FREQUENCIES = (10.0, 15.0, 20.0, 30.0, 50.0)


def scattering(percent: float, seed: int) -> list[Recording]:
    """A session in which springs and dampers of every recording are a little different."""
    rng, data = np.random.default_rng(seed), []
    for added in (0.0, 2.3):
        for hz in (*FREQUENCIES, 25.0, 40.0):
            off = {n: BENT[n] * np.exp(0.01 * percent * rng.normal()) for n in ("k_T", "k_F", "c_11", "c_21")}
            data.append(recorded(BENT | off, hz, added=added))
    return data


def estimated(problem: Problem) -> Problem:
    found = search(problem, (1,), Effort(starts=2, rounds=1), first=problem.variables.start(BENT)[None])
    return found.problem


def test_constants_that_scatter_are_told_from_harmonics_that_do() -> None:
    found = [estimated(problem(scattering(3.0, seed))).scatter for seed in range(2)]
    assert np.mean([s.constants for s in found]) == pytest.approx(0.03, rel=0.2)
    assert max(s.harmonics for s in found) < 0.006


@pytest.mark.parametrize("scatter", [0.01, pytest.param(0.05, marks=pytest.mark.long)])
def test_harmonics_that_scatter_are_measured_as_such(scatter: float) -> None:
    """What every harmonic was multiplied by, in a session with a sensor on the foot bones, too."""
    data = session(BENT, FREQUENCIES, (0.0, 2.3), scatter=scatter, second=True)
    found = estimated(problem(data, sensors=["malleolus", "foot"]))
    assert found.scatter.harmonics == pytest.approx(scatter, rel=0.25)
    assert found.repeatability == pytest.approx(scatter, rel=0.3)


@pytest.mark.parametrize("seed", [0, pytest.param(5, marks=pytest.mark.long)])
def test_where_noise_suffices_there_is_none(seed: int) -> None:
    """Sessions whose chi-square is above its mean: of 0.2 % of harmonics, and of constants, but for what is chance."""
    assert estimated(problem(session(BENT, FREQUENCIES, (0.0, 2.3), seed=seed, noise=0.5))).scatter == Scatter()


def test_its_size_is_that_of_the_first_harmonic() -> None:
    """Recordings of one condition, made with constants that scatter, beside what is said of them."""
    rng, made = np.random.default_rng(2), problem([recorded(BENT, 22.0)])
    names = ("k_T", "k_F", "c_11", "c_21")
    moved = []
    for _ in range(400):
        off = {name: BENT[name] * np.exp(0.02 * rng.normal()) for name in names}
        moved.append(made.predicted(made.variables.start(BENT | off))[0, 0, 0])
    std = np.sqrt(0.5 * np.var(moved)) / abs(np.mean(moved))
    made = made.weighed(made.variables.start(BENT)).with_scatter(Scatter(constants=0.02))
    assert made.repeatability == pytest.approx(std, rel=0.1)


def test_it_is_likeliest_by_what_no_variable_explains() -> None:
    """Restricted likelihood of a finished search, by a dense covariance and contrasts that no variable moves."""
    made = problem(session(BENT, FREQUENCIES, (0.0, 2.3), scatter=0.03))
    found = search(made, (1,), Effort(starts=2, rounds=1), first=made.variables.start(BENT)[None])
    made, linear = found.problem, _Linear.of(found.problem, found.optima[0].q)
    rows, mean = made.measured.rows, made.variables.prior[0]
    e, J = linear.e[rows], linear.J[rows]
    free = np.isin(np.arange(mean.size), linear.free)
    offset, vague = (found.optima[0].q - mean)[free], linear.weight == 0
    rank = np.linalg.matrix_rank(J[:, vague])
    contrasts = np.linalg.svd(J[:, vague])[0][:, rank:].T
    prior = J[:, ~vague] / linear.weight[~vague] @ J[:, ~vague].T
    moved = contrasts @ (e - J[:, ~vague] @ offset[~vague])

    def dense(scatter: Scatter) -> float:
        W = [W[np.ix_(at, at)] for W, at in zip(made.whitener(scatter), rows, strict=True)]
        V = contrasts @ (block_diag(*(np.linalg.inv(w.T @ w) for w in W)) + prior) @ contrasts.T
        return float(moved @ np.linalg.solve(V, moved) + np.linalg.slogdet(V)[1])

    h, c = made.scatter.harmonics, made.scatter.constants
    assert 0.02 < h < 0.04
    for other in (Scatter(0.85 * h, c), Scatter(1.15 * h, c), Scatter(h, c + 0.01), Scatter(0.7 * h, c + 0.01)):
        assert dense(made.scatter) < dense(other)


@pytest.mark.parametrize(("wrong", "follows"), [(1.0, True), (1.6, False)])
def test_beyond_what_people_repeat_to_nothing_is_offered(foot: Foot, wrong: float, follows: bool) -> None:
    """Every other recording of another size: a gain that no calibration has, from one to the next."""
    data = session(BENT, FREQUENCIES)
    data = [
        r.with_channels({"malleolus_m_s2": r.malleolus_m_s2 * (wrong if i % 2 else 1.0)}) for i, r in enumerate(data)
    ]
    result = fit_foot(data, foot.with_values(BENT), starts=1)
    assert result.departures is not None and result.departures.follows is follows
    words = {e.identifiability for b in result.branches for e in b.parameters.values()}
    assert (words == {"not identifiable"}) is not follows
    assert result.sentence().startswith("The model does not follow the recordings") is not follows
    assert follows or (result.verdict != "decided" and not [t for t in result.warnings if "A sign of" in t])
    assert {row[2] == "–" for row in result.sheet().rows if row[0].startswith(("k", "c"))} == {not follows}
