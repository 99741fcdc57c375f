"""How fits are judged: outcomes, intervals, and what is required of them."""

from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import reality
from benchmarks.kept import Kept
from benchmarks.reality import COUNTED, ENOUGH, WITHHELD, Interval, Judged, rows_of
from fasbody.exceptions import SettingError
from reproduction.check import Check
from simulator import worlds
from simulator.worlds import CLEAN, SCATTER_3, WORLDS

HOLDS, MISSES = Interval("identified", True, True), Interval("identified", False, False)


def judged(*intervals: Interval, **changes: object) -> Judged:
    held = dict(zip(COUNTED, intervals or 4 * (HOLDS,), strict=True))
    plain = Judged(CLEAN, 0, 1.0, 2, "decided", True, True, held, 1.0, 2.0)
    return replace(plain, **changes)  # type: ignore[arg-type]


def row(found: list[Judged], begins: str) -> Check:
    return next(check for check in rows_of(found) if check.what.startswith(begins))


WIDE = Interval("weak", True, True)
NOTHING = Interval(WITHHELD, False, False)


@pytest.mark.parametrize(
    ("intervals", "verdict", "true_first", "outcome"),
    [
        (4 * (HOLDS,), "decided", True, "right"),
        (4 * (MISSES,), "decided", True, "right"),  # of the side, not of intervals
        (4 * (HOLDS,), "decided", False, "right"),  # near the axis both sides are one foot
        ((HOLDS, WIDE, NOTHING, NOTHING), "decided", False, "right"),
        ((HOLDS, HOLDS, HOLDS, MISSES), "decided", False, "wrong"),
        (4 * (NOTHING,), "decided", False, "wrong"),
        (4 * (HOLDS,), "undecided", False, "undecided"),
        ((WIDE, NOTHING, NOTHING, NOTHING), "undecided", True, "undecided"),
        (4 * (NOTHING,), "undecided", True, "nothing offered"),
    ],
)
def test_outcome(intervals: tuple[Interval, ...], verdict: str, true_first: bool, outcome: str) -> None:
    assert judged(*intervals, verdict=verdict, true_first=true_first).outcome == outcome


def test_rows_count_outcomes_and_intervals() -> None:
    found = [
        *(judged(seed=seed) for seed in range(20)),
        judged(*4 * (MISSES,), seed=20, true_first=False, true_shown=False),
        judged(seed=21, true_first=False),
        judged(*4 * (replace(MISSES, word="weak"),), seed=22, verdict="undecided"),
        judged(*4 * (NOTHING,), seed=23, verdict="undecided"),
        replace(judged(seed=24), verdict="none", true_first=False, true_shown=False, intervals={}),
    ]
    wrong = row(found, "wrong and decided, of 25 legs")
    assert wrong.measured == "1" and wrong.met is False
    assert row(found, "decided for the other side, and all intervals hold").measured == "1"
    assert row(found, "no result, legs").measured == "1"
    holding = row(found, '"identified" holds the truth, clean')
    assert holding.measured == "95.5 %" and holding.met is True
    assert "25 legs: 21 right, 1 wrong, 1 undecided, 2 nothing offered" in holding.beside
    assert "84 of 92 intervals offered hold" in holding.beside and "at least 85 of 88" in holding.beside
    assert row(found, "decided, clean").measured == "22"


def held(count: int, of: int, world: str = CLEAN) -> list[Judged]:
    """Legs with one interval each."""
    return [judged(HOLDS if i < count else MISSES, *3 * (NOTHING,), seed=i, world=world) for i in range(of)]


def test_requirements_have_two_sides() -> None:
    each = '"identified" holds the truth, clean'
    assert row(held(17, 20), each).met is True and row(held(16, 20), each).met is False
    assert row(held(ENOUGH, ENOUGH), each).met is True and row(held(ENOUGH - 1, ENOUGH - 1), each).met is None
    everywhere = '"identified" holds the truth, all worlds'
    many = ENOUGH * len(WORLDS)
    least = int(np.ceil(0.93 * many))
    assert row(held(least, many), everywhere).met is True and row(held(least - 1, many), everywhere).met is False
    assert row(held(many - 1, many - 1), everywhere).met is None
    for wrong, met in ((2, True), (3, False)):
        legs = [judged(*4 * (MISSES,), seed=i, true_first=i >= wrong) for i in range(400)]
        assert row(legs, "wrong and decided").met is met
    for undecided, met in ((4, True), (5, False)):
        legs = [judged(world=SCATTER_3, seed=i, verdict="undecided" if i < undecided else "decided") for i in range(20)]
        assert row(legs, "decided, scatter 3 %").met is met
    assert row(legs[: ENOUGH - 1], "decided, scatter 3 %").met is None


def test_an_interval_is_compared_with_the_dynamic_value_and_withheld_where_it_is_none() -> None:
    made = worlds.member("springs relax", 0)
    dynamic, rest = made.truth["k_T"][0], made.leg.k_T
    ends = {"k_T": (0.99 * dynamic, 1.01 * dynamic), "k_F": (0.99 * made.leg.k_F, 1.01 * made.leg.k_F)}
    ends |= {"c_11": (np.nan, np.nan), "c_21": (0.0, 1e9)}
    parameters = {
        f"{name}_n": SimpleNamespace(lower=low, upper=high, identifiability="identified")
        for name, (low, high) in ends.items()
    }
    found = reality.intervals_of(SimpleNamespace(parameters=parameters), made)  # type: ignore[arg-type]
    assert rest < 0.99 * dynamic
    assert found["k_T"] == Interval("identified", True, False) and found["k_F"] == Interval("identified", False, True)
    assert found["c_11"].word == WITHHELD and found["c_21"] == Interval("identified", True, True)


def test_a_fit_is_judged_on_the_true_branch_and_kept(tmp_path: Path) -> None:
    """A real fit of a strongly nonlinear leg in the model's own world, kept, read back and forgotten by other code."""
    clean = worlds.member(CLEAN, 2)
    leg = replace(clean.leg, c_12=90.0, c_22=-120.0, c_13=140.0, c_23=170.0)
    made = replace(clean, leg=leg, loads_kg=(0.0,), noise=0.002, frequencies_hz=(10.0, 20.0, 30.0, 40.0))
    found = reality.judged(made, reality.fitted(worlds.recordings(made)), 1.0)
    assert found.true_shown and set(found.intervals) == set(COUNTED)
    assert sum(interval.holds for interval in found.intervals.values()) >= 3
    file = tmp_path / "done.jsonl"
    Kept(file, "now").add(asdict(found))
    with file.open("a") as cut:
        cut.write('{"cut off')
    assert reality.read(Kept(file, "now")) == [found] and reality.read(Kept(file, "later")) == []


def test_unknown_worlds_and_no_seeds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="--world is 'mars'; there are clean, mass"):
        reality.measure(1, 1, tmp_path / "x", ["mars"])
    with pytest.raises(SettingError, match="--seeds is 0; at least 1 is needed"):
        reality.measure(0, 1, tmp_path / "x")
