"""Branches of a subject's fits: exact odds against enumeration, continuity, prior."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from study_cases import power_laws

from fasbody.exceptions import SettingError
from identification.branches import STIFF_ANKLE, STIFF_PAD, mirrored
from identification.study.tracking import (
    BELIEVED,
    BETWEEN_TRIALS,
    CURVES,
    PER_KG,
    PER_LOG_FREQUENCY,
    BranchFit,
    Fit,
    Prior,
    track,
)  # fmt: skip

A = 3.4 / 4.4
SIZES = dict.fromkeys(CURVES, 0.03)


def fits(frequencies=(10.0, 15.0, 20.0, 30.0), loads=(0.0, 4.5), deviance=lambda f, m: (0.0, 0.0)) -> list[Fit]:  # type: ignore[no-untyped-def]
    found = []
    for m in loads:
        for f in frequencies:
            values = power_laws(f, m)
            d = deviance(f, m)
            both = (
                BranchFit(STIFF_ANKLE, values, SIZES, d[0]),
                BranchFit(STIFF_PAD, mirrored(values, A), SIZES, d[1]),
            )
            found.append(Fit(f, m, both if d[0] <= d[1] else both[::-1], f"{f:g}-{m:g}"))
    return found


def test_odds_are_those_of_all_assignments() -> None:
    """Two trials under one load here, three there, a load without partner: 9 fits against all 512 assignments."""
    rng = np.random.default_rng(4)
    places = [(10.0, 0.0), (10.0, 2.3), (10.0, 2.3), (20.0, 4.5), (20.0, 2.3), (20.0, 2.3), (20.0, 2.3), (30.0, 4.5),
              (30.0, 0.0)]  # fmt: skip
    some = []
    for f, m in places:
        ankle, pad = fits((f,), (m,), lambda f, m: (0.0, 0.0))[0].branches
        scale = {n: v * float(np.exp(rng.normal(0, 0.4))) for n, v in ankle.values.items()}
        some.append(Fit(f, m, (BranchFit(STIFF_ANKLE, scale, SIZES, rng.normal(0, 4)), replace(pad, deviance=0.0))))
    # neighbours: loads of one frequency in ascending order, then equal loads of the next frequency, trial by trial
    near = [(0, 1), (1, 2), (4, 5), (5, 6), (6, 3), (8, 7), (1, 4), (2, 5), (3, 7)]

    def smooth(p: Fit, i: int, q: Fit, j: int) -> float:
        u, w = p.branches[i].values, q.branches[j].values
        v = (PER_LOG_FREQUENCY * np.log(p.frequency_hz / q.frequency_hz)) ** 2 + 2 * BETWEEN_TRIALS**2
        v += (PER_KG * (p.added_mass_kg - q.added_mass_kg)) ** 2 + 2 * 0.03**2
        return -0.5 * sum(np.log(u[n] / w[n]) ** 2 / v + np.log(v) for n in CURVES)

    states = np.array(list(product((0, 1), repeat=9)))
    weights = np.zeros(len(states))
    for i, fit in enumerate(some):
        weights -= 0.5 * np.array([b.deviance for b in fit.branches])[states[:, i]]
    for a, b in near:
        each = np.array([[smooth(some[a], i, some[b], j) for j in (0, 1)] for i in (0, 1)])
        weights += 0.5 * (each + each[::-1, ::-1])[states[:, a], states[:, b]]
    told = track(some)
    for i, choice in enumerate(told.choices):
        p = [np.logaddexp.reduce(weights[states[:, i] == k]) for k in (0, 1)]
        assert np.log(choice.odds) == pytest.approx(abs(p[0] - p[1]), rel=1e-9)
        assert choice.likelier == some[i].branches[int(p[1] > p[0])].name
    assert np.log(told.overall[STIFF_ANKLE]) == pytest.approx(weights[0] - weights[-1], rel=1e-9)


def test_sixteen_fits_at_one_frequency_are_a_chain_of_loads() -> None:
    """One frequency alone is a chain: products of 2 x 2 matrices, where tables of pairs of states would be 4^16."""
    rng = np.random.default_rng(5)
    loads = tuple(np.linspace(0, 4.5, 16))
    deviances = {m: tuple(rng.normal(0, 3, 2)) for m in loads}
    some = fits((20.0,), loads, lambda f, m: deviances[m])
    some = [fit if fit.branches[0].name == STIFF_ANKLE else replace(fit, branches=fit.branches[::-1]) for fit in some]
    alone = [np.exp([-0.5 * b.deviance for b in fit.branches]) for fit in some]
    usual = 2 * BETWEEN_TRIALS**2 + (PER_KG * (loads[1] - loads[0])) ** 2 + 2 * 0.03**2

    def near(p: Fit, q: Fit) -> np.ndarray:
        log = np.array([
            [sum(np.log(u.values[n] / w.values[n]) ** 2 for n in CURVES) for w in q.branches] for u in p.branches
        ])  # fmt: skip
        return np.exp(-0.25 * (log + log[::-1, ::-1]) / usual)

    T = [near(p, q) for p, q in pairwise(some)]
    twice = [replace(fit, frequency_hz=f) for f in (20.0, 40.0) for fit in some]
    assert len(track(twice).choices) == 32
    for i, choice in enumerate(track(some).choices):
        left, right = np.ones(2), np.ones(2)
        for k in range(i):
            left = (left * alone[k]) @ T[k]
        for k in range(15, i, -1):
            right = T[k - 1] @ (right * alone[k])
        p = left * alone[i] * right
        assert np.log(choice.odds) == pytest.approx(abs(np.log(p[0] / p[1])), rel=1e-8)


def test_one_clear_fit_carries_the_others() -> None:
    """Only 20 Hz unloaded decides by itself; continuity carries its branch to the neighbours, with falling odds."""
    clear = track(fits(deviance=lambda f, m: (0.0, 60.0) if (f, m) == (20.0, 0.0) else (0.0, 0.0)))
    by = {c.key: c for c in clear.choices}
    assert by["20-0"].branch == STIFF_ANKLE
    assert all(c.likelier == STIFF_ANKLE for c in clear.choices)
    assert by["20-0"].odds > by["30-0"].odds > 1
    assert clear.overall[STIFF_ANKLE] > 1e6


def test_smoothness_alone_decides_nothing_overall() -> None:
    nothing = track(fits())
    assert {c.branch for c in nothing.choices} == {"undecided"}
    assert nothing.overall[STIFF_ANKLE] < 10
    assert "undecided" in nothing.sentence
    assert all(c.odds < 10 for c in nothing.choices)


def test_a_misled_fit_is_put_right() -> None:
    """One fit prefers the mirror by 6; the others prefer the truth by 15 each."""
    both = fits((10.0, 12.0, 15.0, 18.0), (0.0,), lambda f, m: (6.0, 0.0) if f == 15.0 else (0.0, 15.0))
    assert both[2].branches[0].name == STIFF_PAD
    told = track(both)
    assert [c.likelier for c in told.choices] == [STIFF_ANKLE] * 4


@pytest.mark.parametrize(
    ("prior", "wanted"),
    [
        (Prior(stiff_ankle_odds=1e4), STIFF_ANKLE),
        (Prior(stiff_ankle_odds=1e-4), STIFF_PAD),
        (Prior(ranges={"k_F": (7e4, 1.4e5)}), STIFF_ANKLE),
    ],
)
def test_a_prior_decides(prior: Prior, wanted: str) -> None:
    told = track(fits(), prior=prior)
    assert {c.likelier for c in told.choices} == {wanted}
    assert max(told.overall, key=lambda n: told.overall[n]) == wanted


def test_documents_are_read() -> None:
    e = {"value": 1e5, "std_error": 1e3, "lower": 0, "upper": 0, "at_bound": False, "identifiability": "identified"}
    branch = {"name": STIFF_ANKLE, "deviance": 20.0, "parameters": {"k_T_n_per_m": e, "delay_s": {**e, "value": 0.0}}}
    document = {
        "key": "a", "frequency_hz": 20.0, "added_mass_kg": 0.0,
        "result": {"goodness_of_fit": {"chi_square": 40.0, "dof": 10}, "branches": [branch]},
    }  # fmt: skip
    found = Fit.from_document(document)
    assert found.branches[0].values["k_T"] == 1e5
    assert found.branches[0].relative_errors == {"k_T": 0.01}
    assert found.branches[0].deviance == 5.0  # 20 over the reduced chi-square of 4


def test_what_cannot_be_tracked() -> None:
    with pytest.raises(SettingError, match="needs a fit"):
        track([])
    with pytest.raises(SettingError, match="valid: up to 16"):
        track(fits((20.0,), tuple(np.linspace(0, 4.5, 17))))


def test_pooled_fits_are_chained_over_the_load() -> None:
    """No frequency: neighbours differ by their load alone, and the odds are those of that chain."""
    known = fits((20.0,), (0.0, 2.3, 4.5), lambda f, m: (0.0, 9.0 * (m == 0)))
    some = [replace(fit, frequency_hz=None) for fit in known]
    told = track(some)
    assert [c.likelier for c in told.choices] == [STIFF_ANKLE] * 3
    assert told.choices[0].odds > told.choices[1].odds > 1
    assert told.choices[0].frequency_hz is None


def test_repeats_at_one_place_add_up() -> None:
    """Two trials under each load that each say 10 decide what one cannot; a repeat is linked to a repeat."""
    one = fits((20.0, 30.0), (0.0,), lambda f, m: (0.0, 10.0 if f == 20 else 0.0))
    once, twice = track(one[:1]), track([one[0], one[0], one[1], one[1]])
    assert np.log(once.choices[0].odds) == pytest.approx(5.0)
    assert np.log(twice.choices[0].odds) > 9
    assert twice.choices[0].branch == STIFF_ANKLE
    assert once.choices[0].branch == "undecided"


def test_a_prior_is_read() -> None:
    assert Prior.read([]) is None
    assert Prior.read(["k_T > k_F"]) == Prior({}, BELIEVED)
    assert Prior.read(["k_T<k_F", "k_F=5e4:2e5"]) == Prior({"k_F": (5e4, 2e5)}, 1 / BELIEVED)
    for text, said in (
        ("k_T=k_F", "--prior 'k_T=k_F' is not NAME=LOWER:UPPER"),
        ("k_X=1:2", "unknown parameter with a prior 'k_X'"),
        ("c_13=1:2", "unknown parameter with a prior 'c_13'"),
        ("k_F=2e5:5e4", "give 0 < lower < upper"),
    ):
        with pytest.raises(SettingError, match=said):
            Prior.read([text])


def test_images_that_are_not_exact_decide_nothing() -> None:
    """At bounds one branch jumps about while the other is smooth: that is no evidence for the smooth one."""
    rng = np.random.default_rng(2)
    spoilt = []
    for fit in fits():
        ankle, pad = fit.branches
        jumps = {n: v * float(np.exp(rng.normal(0, 1.5))) for n, v in pad.values.items() if n in CURVES}
        spoilt.append(replace(fit, branches=(ankle, replace(pad, values={**pad.values, **jumps}))))
    told = track(spoilt)
    assert told.overall[STIFF_ANKLE] == pytest.approx(1.0)
    assert [c.odds for c in told.choices] == pytest.approx([1.0] * len(spoilt))


def test_a_branch_on_its_bound_has_nothing_against_it() -> None:
    def estimate(value: float, rests: bool = False) -> dict[str, object]:
        return {"value": value, "std_error": None if rests else 0.03 * value, "at_bound": rests}

    def document(rests: bool) -> dict[str, object]:
        near = {f"{n}_unit": estimate(v) for n, v in power_laws(20.0, 0.0).items()}
        far = {f"{n}_unit": estimate(v) for n, v in mirrored(power_laws(20.0, 0.0), A).items()}
        far["k_F_unit"] = estimate(1e6, rests)
        branches = [{"name": STIFF_ANKLE, "parameters": near, "deviance": 3.0},
                    {"name": STIFF_PAD, "parameters": far, "deviance": 90.0}]  # fmt: skip
        result = {"branches": branches, "goodness_of_fit": {"chi_square": 2.0, "dof": 4}}
        return {"frequency_hz": 20.0, "added_mass_kg": 0.0, "key": "a", "result": result}

    (free,), (held,) = (track([Fit.from_document(document(rests))]).choices for rests in (False, True))
    assert free.branch == STIFF_ANKLE and np.log(free.odds) == pytest.approx(43.5)
    assert held.branch == "undecided" and held.odds == pytest.approx(1.0)
