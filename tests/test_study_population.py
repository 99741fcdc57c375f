"""Populations of persons: closed forms where all errors are equal, shrinking, and which branch is told."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_fits import failed, plain
from scipy.optimize import brentq
from scipy.stats import t as student

from fasbody.console import make_folder
from fasbody.exceptions import InputFileError, RecordingError
from identification.study import figures, report, tables
from identification.study.findings import Findings
from identification.study.population import constant, populations
from identification.study.posterior import MIDDLE, TAILS, Posterior
from identification.study.store import Store, pooled_fits

LOGS = np.array([0.0, 0.1, 0.3, 0.5, 0.9])
NAMES = list("abcde")
posterior_of = Posterior.of
KEYS = {"k_T_n_per_m": 1e5, "k_F_n_per_m": 9e4, "c_11_n_s_per_m": 300.0, "c_21_n_s_per_m": 700.0}


@pytest.fixture(autouse=True)
def once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers that this process has made a posterior of are given the same one, whose sums take long."""
    monkeypatch.setattr(Posterior, "of", lambda y, s: kept(tuple(y), tuple(s)))


@cache
def kept(values: tuple[float, ...], errors: tuple[float, ...]) -> Posterior:
    made = posterior_of(np.array(values), np.array(errors))
    for name in ("spread", "persons", "chances"):
        object.__setattr__(made, name, cache(getattr(made, name)))
    return made


def test_equal_errors_have_closed_forms() -> None:
    """Then the mean is the arithmetic one with Student's interval."""
    c = constant("k_T", NAMES, LOGS, np.full(5, 0.1))
    half = student.ppf(0.975, 4) * LOGS.std(ddof=1) / np.sqrt(5)
    assert np.log([c.mean, c.lower, c.upper]) == pytest.approx([0.36, 0.36 - half, 0.36 + half], rel=1e-3)


def test_the_posterior_is_that_of_plain_sums() -> None:
    """Spread, a person and a chance by sums over even grids of mu and tau, and a person's value drawn from them."""
    s, y = np.array([0.1, 0.05, 0.1, 0.2, 0.1]), LOGS
    mu, tau = np.linspace(-3.0, 4.0, 281), np.linspace(0.005, 5.0, 500)[:, None]
    known, likely = 1 / np.sqrt(np.mean(1 / s**2)), []
    for nu in TAILS.ravel():
        likely.append([student.logpdf(v, nu, mu, np.hypot(tau, e)) for v, e in zip(y, s, strict=True)])
    weight = np.exp(np.sum(likely, axis=1)) / np.hypot(tau, known)
    weight /= weight.sum()
    half = np.array([tau[:, 0] * student.ppf(0.5 + MIDDLE / 2, nu) for nu in TAILS.ravel()])
    order, mass = np.argsort(half, axis=None), weight.sum(axis=2).ravel()
    spread = np.interp((0.5, 0.975), np.cumsum(mass[order]), half.ravel()[order])
    posterior = Posterior.of(y, s)
    assert posterior.spread(0.95)[::2] == pytest.approx(spread, rel=0.03)

    rng = np.random.default_rng(0)
    cell = np.unravel_index(rng.choice(weight.size, 40_000, p=weight.ravel()), weight.shape)
    nu, t, m = TAILS.ravel()[cell[0]], tau[cell[1], 0], mu[cell[2]]
    lam = (nu + (y[4] - m) ** 2 / (t**2 + s[4] ** 2)) / rng.chisquare(nu + 1)  # of the variance, given the estimate
    share = t**2 / (t**2 + s[4] ** 2)
    own = m + share * (y[4] - m) + np.sqrt(lam * share) * s[4] * rng.standard_normal(nu.size)
    assert posterior.persons(0.95)[4] == pytest.approx(np.quantile(own, (0.5, 0.025, 0.975)), abs=0.02)

    others = np.exp(np.sum(likely, axis=1) - np.array(likely)[:, 4]) / np.hypot(tau, known)
    above = [student.sf(y[4], v, mu, np.hypot(tau, s[4])) for v in TAILS.ravel()]
    assert posterior.chances()[4] == pytest.approx(5 * 2 * np.sum(others * above) / others.sum(), rel=0.03)


def test_what_is_known_badly_is_shrunk_most() -> None:
    errors = np.array([0.01, 0.01, 0.01, 0.01, 0.6])
    people = {p.subject: p for p in constant("k_T", NAMES, LOGS, errors).persons}
    assert np.log(people["d"].shrunk) == pytest.approx(0.5, abs=0.01)
    assert np.log(people["e"].shrunk) < 0.5 < np.log(people["e"].value) == pytest.approx(0.9)
    for p in people.values():
        assert p.lower < p.shrunk < p.upper


def test_one_badly_known_person_widens_nobody_elses_interval() -> None:
    def width(worst: float) -> float:
        first = constant("k_T", NAMES, LOGS, np.array([0.05, 0.05, 0.05, 0.05, worst])).persons[0]
        return float(np.log(first.upper / first.lower))

    without = constant("k_T", NAMES[:4], LOGS[:4], np.full(4, 0.05)).persons[0]
    assert width(10.0) < 1.1 * width(1.0)
    assert width(10.0) < 1.1 * np.log(without.upper / without.lower)


def test_a_spread_lies_in_its_interval() -> None:
    logs = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
    for errors in (np.full(5, 0.02), np.full(5, 3.0), np.array([0.05, 0.05, 0.05, 0.05, 9.0])):
        c = constant("k_T", NAMES, logs, errors)
        assert c.spread_lower <= c.spread <= c.spread_upper


def test_the_spread_of_persons_alike_is_bounded_by_their_errors() -> None:
    """Four persons who happen to agree exclude no spread that their errors would hide; others exclude none."""
    logs = np.array([1.0, 1.01, 0.99, 1.0])
    c = constant("k_T", NAMES[:4], logs, np.full(4, 0.1))
    assert c.spread_lower == 0.0 and 0.1 < c.spread_upper < 0.5
    assert c.spread_text == ("not determined by 4 persons", f"at most {100 * c.spread_upper:.2g} %")
    assert constant("k_T", NAMES[:4], 40 * logs, np.full(4, 0.1)).spread_lower > 0.05
    with pytest.raises(RecordingError, match="3 persons make no population"):
        constant("k_T", NAMES[:3], LOGS[:3], np.full(3, 0.1))


def study(apart: float, follows: bool = True, persons: int = 5, paid: float = 0.0) -> list[dict[str, Any]]:
    """Pooled fits whose stiff pad is worse by `apart`, `paid` of it for masses and so on; the last may not follow."""
    made = []
    for i in range(persons):
        near = {key: (v * np.exp(LOGS[i]), 0.1 * v, "weak") for key, v in KEYS.items()}
        far = {key: (2 * v, 0.1 * v, "weak") for key, v in KEYS.items()}
        d = plain("pooled", str(i), 0.0, None, {"stiff ankle": near, "stiff pad": far})
        for branch, objective in zip(d["result"]["branches"], (10.0, 10.0 + apart), strict=True):
            good = follows or i < persons - 1
            branch["world"] = {
                "follows": good,
                "objective": objective,
                "chi_square": 10.0,
                "dof": 10,
                "repeatability": 0.0,
            }
            branch["deviance"] = objective
        branch["world"]["chi_square"] = 10.0 + apart - paid
        made.append(d)
    return made


def test_the_branch_is_decided_by_all_persons_together() -> None:
    (one,) = populations(study(6.0))[0]  # exp(3) each, exp(15) together
    assert (one.branch, one.verdict) == ("stiff ankle", "decided") and one.odds_log == pytest.approx(15.0)
    assert [c.name for c in one.constants] == ["k_T", "k_F", "c_11", "c_21"]
    assert one.constants[0].mean == pytest.approx(1e5 * np.exp(0.36), rel=0.03)
    both = populations(study(1.0))[0]
    assert [p.branch for p in both] == ["stiff ankle", "stiff pad"] and {p.verdict for p in both} == {"undecided"}
    assert both[1].odds_log == pytest.approx(-2.5)
    assert both[1].odds_text.startswith("stiff pad: 1 to 12.2 for")


def test_what_all_may_have_in_common_counts_once() -> None:
    """The other branch fits as well and needs other masses: five of one table's errors are one, and decide nothing."""
    ankle, pad = populations(study(6.0, paid=6.0))[0]
    assert (ankle.verdict, ankle.odds_log, ankle.common_odds_log) == ("undecided", 15.0, 3.0)
    assert (pad.odds_log, pad.common_odds_log) == (-15.0, -3.0)
    assert ankle.odds_text == (
        "stiff ankle: over a million to 1 for independent errors of the persons, 20.1 to 1 if all share those of gain "
        "and masses"
    )
    (half,) = populations(study(6.0, paid=2.0))[0]  # the misfit alone is 10
    assert half.verdict == "decided" and half.common_odds_log == pytest.approx(11.0)


def test_odds_are_students_where_the_scatter_of_recordings_was_estimated() -> None:
    """Of ten degrees of freedom a branch worse by 6 is so by 10 ln(1 + 6 / 10)."""
    fits = study(6.0)
    for d in fits:
        for branch in d["result"]["branches"]:
            branch["world"]["repeatability"] = 0.03
    (one,) = populations(fits)[0]
    assert one.odds_log == pytest.approx(5 * 0.5 * 10 * np.log(1.6))


def test_one_person_does_not_decide_for_the_others() -> None:
    fits = study(40.0)
    for branch, size in zip(fits[-1]["result"]["branches"], (410.0, 10.0), strict=True):
        branch["world"] |= {"objective": size, "chi_square": size}
        branch["deviance"] = size
    assert {p.verdict for p in populations(fits)[0]} == {"undecided"}
    assert {p.verdict for p in populations(fits[:-1])[0]} == {"decided"}


def test_who_does_not_follow_is_left_out() -> None:
    (one,) = populations(study(20.0, follows=False))[0]
    assert [(x.subject, x.why) for x in one.left_out] == [("4", "the fit does not follow the recordings")]
    assert len(one.constants[0].persons) == 4
    assert populations(study(20.0, follows=False, persons=4))[0] == []
    alone = [plain("pooled", str(i), 0.0, None, {"stiff ankle": {}}) for i in range(5)]
    assert populations(alone)[0] == []  # of a model assumed exact


def test_who_is_left_out_is_named_with_the_reason() -> None:
    """A fit that failed, one below 85 %, one without the branch, and one constant at a bound: all are named."""
    fits = [*study(20.0, persons=5), failed("lost", "s.csv: is too short.") | {"mode": "pooled"}]
    more = [dict(d, subject=who) for d, who in zip(study(20.0, persons=2), ("poor", "one-sided"), strict=True)]
    for branch in more[0]["result"]["branches"]:
        branch |= {"world": None, "fit_percent": 60.0}
    del more[1]["result"]["branches"][0]
    fits[1]["result"]["branches"][0]["parameters"]["c_11_n_s_per_m"] |= {"at_bound": True}
    (one,) = found = populations([*fits, *more])[0]
    poor = "poor (the fit follows the recordings to less than 85 %)"
    said = f"lost (the fit failed), {poor}, one-sided (no stiff ankle was found)"
    assert one.dropped(one.constants[0]) == said
    assert [c.name for c in one.constants if c.left_out] == ["c_11"] and len(one.constants[2].persons) == 4
    assert one.dropped() == f"{said}, 1 (c_11 rests on a bound)"
    assert one.document()["left_out"][0] == {"subject": "lost", "why": "the fit failed"}
    assert "1 (c_11 rests on a bound)" in " ".join(figures.persons(found, "synthetic").get_supxlabel().split())
    table = tables.population(found)
    assert table["persons left out"].tolist().count(one.dropped()) == 1  # of c_11 alone


@pytest.mark.usefixtures("undrawn")
def test_who_does_not_belong_is_named_and_kept(tmp_path: Path) -> None:
    """One is ten times off, and makes room for the others."""
    chances = Posterior.of(np.array([0.0, 0.1, -0.1, 0.05, 2.3]), np.full(5, 0.01)).chances()
    assert chances[-1] < 0.01 and chances[:-1].min() > 0.5
    fits = study(20.0)
    for d, y in zip(fits, (0.0, 0.1, -0.1, 0.05, 2.3), strict=True):
        d["result"]["branches"][0]["parameters"]["k_T_n_per_m"] |= {"value": 1e5 * np.exp(y), "std_error": 1e3}
    found = populations(fits)[0]
    k_T, k_F, *_ = found[0].constants
    assert [p.subject for p in k_T.odd] == ["4"] and not k_F.odd and len(k_T.persons) == 5
    assert k_T.mean == pytest.approx(1e5 * np.exp(0.47), rel=0.02)  # it is in the mean
    (said,) = found[0].odd()
    assert said.startswith("midstance, 0 kg, stiff ankle: k_T of subject 4 is") and "included in the estimate" in said
    assert found[0].document()["constants"][0]["does_not_belong"] == ["4"]
    assert tables.population(found)["outliers (included)"].tolist() == ["4", *["nobody"] * 3]
    assert "included in the means (4)" in " ".join(figures.persons(found, "synthetic").get_supxlabel().split())
    report.write(tmp_path, Findings([{**d, "cycles": []} for d in fits]), "five persons", "synthetic")
    assert said.replace("'", "&#39;") in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(("chance", "odd"), [(0.009, ("e",)), (0.011, ())])
def test_a_person_is_named_below_a_chance_of_one_in_a_hundred(chance: float, odd: tuple[str, ...]) -> None:
    errors = np.full(5, 0.02)

    def logs(last: float) -> np.ndarray:
        return np.array([0.0, 0.1, -0.1, 0.05, last])

    last = brentq(lambda far: Posterior.of(logs(far), errors).chances()[-1] - chance, 0.5, 4.0)
    assert tuple(p.subject for p in constant("k_T", NAMES, logs(last), errors).odd) == odd


def test_why_there_is_no_population_is_said() -> None:
    fits = study(20.0, persons=3)
    assert populations(fits)[1] == [
        "midstance, 0 kg: no population, as only 3 of 3 persons can be used and at least 4 are needed."
    ]
    (said,) = populations([*study(20.0, persons=4)[:3], failed("lost", "s.csv: is too short.") | {"mode": "pooled"}])[1]
    assert said.endswith("at least 4 are needed; left out: lost (the fit failed).")
    assert populations(study(20.0))[1] == populations(fits[:1])[1] == []
    twice = [*study(20.0), study(20.0)[0]]
    assert populations(twice)[0] == [] and "subject 0 occurs twice" in populations(twice)[1][0]
    with pytest.raises(RecordingError, match="subject a occurs twice"):
        constant("k_T", [*"aabcd"], LOGS, np.full(5, 0.1))


def test_an_error_of_zero_is_no_estimate() -> None:
    fits = study(20.0)
    fits[2]["result"]["branches"][0]["parameters"]["k_T_n_per_m"]["std_error"] = 0.0
    (one,) = populations(fits)[0]
    assert one.dropped(one.constants[0]) == "2 (k_T has a standard error of zero)"
    with pytest.raises(RecordingError, match="k_T of subject a has a standard error of 0"):
        constant("k_T", NAMES, LOGS, np.array([0.0, 0.1, 0.1, 0.1, 0.1]))


def test_persons_of_other_results_join_the_population(tmp_path: Path) -> None:
    """Three persons of this study and two of others are the population that one study of five persons has."""
    five = study(60.0)
    for i, d in enumerate(five):
        d["key"] = f"{i:024x}"
    mine, other = five[:3], five[3:]
    for d in (*other, plain("per-recording", "9", 0.0, 20.0, {"stiff ankle": {}})):
        Store(make_folder(tmp_path / "ben" / "fits")).write(d | {"key": d["key"] if len(d["key"]) == 24 else "f" * 24})
    joined = pooled_fits(tmp_path / "ben")
    assert [d["subject"] for d in joined] == ["3 of ben", "4 of ben"]
    (have,), (want,) = Findings(mine, others=joined).populations, populations(five)[0]
    for a, b in zip(have.constants, want.constants, strict=True):
        assert (a.mean, a.spread, len(a.persons)) == (b.mean, b.spread, 5)
    assert Findings(mine).no_population and not Findings(mine).populations
    again = Findings(five, others=joined).populations[0]  # the same fits count once
    assert [p.subject for p in again.constants[0].persons] == [p.subject for p in want.constants[0].persons]
    with pytest.raises(InputFileError, match="anna: is no folder of results; name the --out of another study"):
        pooled_fits(tmp_path / "anna")
    (tmp_path / "anna" / "fits").mkdir(parents=True)
    with pytest.raises(InputFileError, match="anna: holds no pooled fits"):
        pooled_fits(tmp_path / "anna")
    store = Store(tmp_path / "ben" / "fits")
    first = next(iter(store.documents(d["key"] for d in five[3:]).values()))
    store.write({**first, "key": "0" * 24})
    with pytest.raises(InputFileError, match=r"ben: holds two fits of subject 3, .* of other settings"):
        pooled_fits(tmp_path / "ben")
    file = store.folder / f"{first['key']}.json"
    file.write_text(file.read_text().replace('"pooled"', '"pooled "'))
    with pytest.raises(InputFileError, match=rf"{first['key']}.json: was changed after it was written; run its study"):
        pooled_fits(tmp_path / "ben")
