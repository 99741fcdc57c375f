"""How far a fit is: steps only grow, the share of the bar never falls, and the time left comes from the pace."""

from itertools import pairwise

import pytest

from fasbody.foot.model import Foot
from fasbody.progress import Pace, Work
from fasbody.recording.study import BUNDLED, read_file
from identification.fitting import fit_foot


@pytest.mark.parametrize("domain", ["periodic", "time"])
def test_a_fit_reports_its_steps_in_all_stages(foot: Foot, domain: str) -> None:
    told: list[tuple[str, int, int]] = []
    one = read_file(BUNDLED / "recordings" / "20hz_0kg.csv")
    fit_foot(one, foot, starts=1, domain=domain, free=["k_T", "k_F"], advance=lambda *step: told.append(step))
    stages = list(dict.fromkeys(stage for stage, _, _ in told))
    last = ["fitting the model assumed exact", "computing intervals"] if domain == "periodic" else []
    last = last or ["converging in MuJoCo"]
    assert stages[:2] == ["searching", "replaying in MuJoCo"] and stages[-len(last) :] == last
    assert sum(stage == "searching" for stage, _, _ in told) > 20  # each step, not each round
    pace, shares = Pace(), [0.0]
    for _, done, total in told:
        pace.at(done, total)
        shares.append(pace.share)
    assert all(now[1] >= before[1] for before, now in pairwise(told))
    assert all(done < total for _, done, total in told)
    assert shares == sorted(shares) and 0.3 < shares[-1] < 1


def test_time_left_comes_from_the_time_so_far() -> None:
    now = 100.0
    pace = Pace(lambda: now)
    pace.at(1, 100)
    assert pace.left_s is None
    now = 110.0
    pace.at(20, 100)
    assert (pace.share, pace.left_s) == (0.2, pytest.approx(40.0))
    pace.at(20, 200)  # more turns out to be needed: the bar stays, the time does not
    assert (pace.share, pace.left_s) == (0.2, pytest.approx(90.0))
    now = 140.0
    pace.at(110, 200)
    assert (pace.share, pace.left_s) == (pytest.approx(0.6), pytest.approx(40 * 90 / 110))
    pace.at(0, 0)
    assert pace.share == pytest.approx(0.6) and pace.left_s is None


def test_what_may_come_is_counted_at_the_share_that_was_needed() -> None:
    told: list[tuple[str, int, int]] = []
    work = Work(lambda *step: told.append(step), after=0.5)
    work.stage = "a"
    work.expect(100)
    work.might(40)
    work.did(10)
    work.expect(60)
    work.did(15)
    assert told == [("a", 0, 200), ("a", 10, 200), ("a", 10, 50), ("a", 25, 51)]
    work.after("b", 0.5)
    work.after("c", 0.2)  # of another part: steps do not fall
    assert told[-2:] == [("b", 38, 50), ("c", 38, 50)]
