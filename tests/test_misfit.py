"""Where a fit misses its recordings, and how well these repeat without a model."""

from dataclasses import replace

import pytest
from steady_cases import BENT, problem, recorded, session

from identification.misfit import STANDS_OUT, Misfit, repeats
from identification.recommendations import about_departures
from identification.residual import Problem
from identification.result import Departures

FREQUENCIES = (10.0, 20.0, 30.0, 40.0)


@pytest.fixture(scope="module")
def made() -> Problem:
    return problem(session(BENT, FREQUENCIES, (0.0, 2.3), second=True), sensors=["malleolus", "foot"])


def test_shares_are_those_of_chi_square(made: Problem) -> None:
    """Three views of one sum, and what was changed in one harmonic of one recording shows in all of them."""
    read = made.measured.output.copy()
    read[3, 1, 1] *= 1.5
    misfit = Misfit.of(made, read)
    for shares in (misfit.recordings, misfit.harmonics, misfit.sensors):
        assert sum(shares.values()) == pytest.approx(1.0)
    file = made.measured.lines[3].recording.file
    assert misfit.recordings[file] == misfit.harmonics[2] == misfit.sensors["foot"] == pytest.approx(1.0)
    r = made.whitened(read)
    assert made.squares(read).sum() == pytest.approx(float(r @ r), rel=1e-12)


@pytest.mark.parametrize(("factor", "named"), [(0.99, False), (1.01, True)])
def test_what_has_twice_its_share_stands_out(factor: float, named: bool) -> None:
    share = factor * STANDS_OUT / 8
    rest = {f"{i}.csv": (1 - share) / 7 for i in range(7)}
    misfit = Misfit({"a.csv": share, **rest}, {1: 1.0}, {"malleolus": 1.0})
    assert misfit.standing_out() == ({"recordings": {"a.csv": share}} if named else {})


def of_a_fit(follows: bool, misfit: Misfit | None = None, itself: float | None = None) -> Departures:
    return Departures(
        90.0, 95.0, 80, follows, (), (), repeatability=0.2, misfit=misfit, repeats_by_itself=itself
    )  # fmt: skip


def test_a_fit_that_does_not_follow_names_the_recording() -> None:
    misfit = Misfit({"a.csv": 0.9, "b.csv": 0.05, "c.csv": 0.05}, {1: 0.5, 2: 0.5}, {"malleolus": 1.0})
    (text,) = about_departures(of_a_fit(False, misfit))
    assert "a.csv (90 %)" in text and "b.csv" not in text and "harmonic" not in text
    even = Misfit({"a.csv": 0.5, "b.csv": 0.5}, {1: 0.5, 2: 0.5}, {"malleolus": 1.0})
    (text,) = about_departures(of_a_fit(False, even))
    assert "spread over all" in text
    assert "a.csv" not in " ".join(about_departures(of_a_fit(True, misfit)))


@pytest.mark.parametrize(("itself", "model"), [(0.099, True), (0.101, False), (None, False)])
def test_a_scatter_twice_that_of_a_repeated_condition_is_the_models(itself: float | None, model: bool) -> None:
    texts = about_departures(of_a_fit(False, itself=itself))
    assert any("a stated condition is wrong" in text for text in texts) is model


@pytest.mark.parametrize("scatter", [0.0, 0.05])
def test_repeated_conditions_say_how_well_they_repeat(scatter: float) -> None:
    """Two conditions, twenty times each; of noise alone next to nothing is left."""
    data = [recorded(BENT, hz, seed=seed, scatter=scatter) for hz in (20.0, 30.0) for seed in range(20)]
    found = repeats(problem(data).measured)
    assert found is not None
    assert found == pytest.approx(scatter, rel=0.25, abs=2e-4)


def test_no_condition_twice_says_nothing() -> None:
    data = session(BENT, FREQUENCIES, (0.0, 2.3))
    assert repeats(problem(data).measured) is None
    again = recorded(BENT, FREQUENCIES[0], seed=1)
    other = replace(again, condition=replace(again.condition, posture="toe off"))
    assert repeats(problem([*data, other]).measured) is None
    assert repeats(problem([*data, again]).measured) is not None
