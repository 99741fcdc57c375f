"""How well recordings repeat, as a fit estimates it: sessions whose constants scatter, or do not."""

import numpy as np
import pytest
from steady_cases import BENT, problem, recorded, session

from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.fitting import fit_foot
from identification.optimiser import finished, repeatability, search
from identification.residual import Problem

FREQUENCIES = (10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0)


def scattering(percent: float, seed: int) -> list[Recording]:
    """A session in which springs and dampers of every recording are a little different."""
    rng, data = np.random.default_rng(seed), []
    for added in (0.0, 2.3):
        for hz in FREQUENCIES:
            off = {n: BENT[n] * np.exp(0.01 * percent * rng.normal()) for n in ("k_T", "k_F", "c_11", "c_21")}
            data.append(recorded(BENT | off, hz, added=added))
    return data


def estimated(problem: Problem) -> float:
    found = search(problem, (1,), starts=2, rounds=1, first=problem.variables.start(BENT)[None])
    return found.problem.repeatability


def test_constants_that_scatter_by_three_per_cent_repeat_to_about_three() -> None:
    found = [estimated(problem(scattering(3.0, seed))) for seed in range(4)]
    assert np.mean(found) == pytest.approx(0.03, rel=0.4) and min(found) > 0.01


@pytest.mark.parametrize("scatter", [0.01, 0.05])
def test_harmonics_that_scatter_are_measured_as_such(scatter: float) -> None:
    """What every harmonic was multiplied by, in a session with a sensor on the foot bones, too."""
    data = session(BENT, FREQUENCIES, (0.0, 2.3), scatter=scatter, second=True)
    assert estimated(problem(data, sensors=["malleolus", "foot"])) == pytest.approx(scatter, rel=0.25)


def test_where_noise_suffices_there_is_none() -> None:
    assert estimated(problem(session(BENT, FREQUENCIES, (0.0, 2.3)))) == 0.0


def test_it_makes_chi_square_its_degrees_of_freedom() -> None:
    """At a given place and weights; a tenth of the noise that is there asks for more scatter."""
    made = problem(session(BENT, FREQUENCIES, scatter=0.03))
    q, *_ = finished(made.with_repeatability(0.03), made.variables.start(BENT), 1)
    made = made.with_repeatability(0.03).weighed(q)
    s = repeatability(made, q)
    r = made.whitened(made.predicted(q), s)
    J = made.evaluate(q[None]).jacobian[0]
    C = np.linalg.pinv(J.T @ J)
    used = np.trace(C @ J[: made.size].T @ J[: made.size])
    assert r @ r == pytest.approx(made.size - used, rel=1e-2) and 0.02 < s < 0.04


@pytest.mark.parametrize(("wrong", "follows"), [(1.0, True), (1.6, False)])
def test_beyond_what_people_repeat_to_nothing_is_offered(foot: Foot, wrong: float, follows: bool) -> None:
    """Every other recording of another size: a gain that no calibration has, from one to the next."""
    data = session(BENT, FREQUENCIES)
    data = [
        r.with_channels({"malleolus_m_s2": r.malleolus_m_s2 * (wrong if i % 2 else 1.0)}) for i, r in enumerate(data)
    ]
    result = fit_foot(data, foot.with_values(BENT), starts=2)
    assert result.departures is not None and result.departures.follows is follows
    words = {e.identifiability for b in result.branches for e in b.parameters.values()}
    assert (words == {"not identifiable"}) is not follows
    assert result.sentence().startswith("The model does not follow the recordings") is not follows
    assert follows or (result.verdict != "decided" and not [t for t in result.warnings if "A sign of" in t])
    assert {row[2] == "–" for row in result.sheet().rows if row[0].startswith(("k", "c"))} == {not follows}
