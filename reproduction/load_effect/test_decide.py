"""Which mechanism made a recording: harmonic balance against the subjects' simulator, verdicts, resuming."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.rivals import mechanism_fit as fit
from identification.rivals import pad_balance as balance
from identification.rivals.mechanism_fit import Analysis, Confusion, Plan, Verdict, predict
from identification.rivals.mechanisms import BODY_KG, MECHANISMS
from identification.rivals.pad_balance import TABLE_M_S2
from identification.rivals.virtual import THESIS, Subject, measured
from reproduction.load_effect import decide
from reproduction.load_effect.decide import ALL, PLANS, RIVALS
from reproduction.load_effect.decide import judged as one
from reproduction.load_effect.lift_off import steady

BOTH = {
    "m_F": 1.0, "m_S": 3.2, "rest": 30.0, "k": 2e5, "exponent": 1.9, "c": 500.0, "k_T": 1.6e4, "c_T": 400.0,
    "share": 0.2, "k_M": 3e5, "c_M": 100.0, "m_H": 2.0, "k_H": 2.8e4, "c_H": 500.0, "k_A": 5e4, "c_A": 500.0,
}  # fmt: skip
STIFF = {"m_F": 1.0, "m_S": 3.2, "k_F": 9e4, "c_F": 300.0, "k_T": 2e5, "c_T": 500.0, "p": 1.2}


def exact(rival: str, values: dict[str, float]) -> Subject:
    """A subject with true masses and sensors screwed to the bone."""
    return Subject(rival, values, 1.0, np.ones(2), np.full(2, 1e9), np.full(2, 0.2))


@pytest.mark.parametrize(("rival", "values"), [("both", BOTH), ("stiffening", STIFF)])
def test_what_is_fitted_is_what_an_independent_simulator_steps(rival: str, values: dict[str, float]) -> None:
    some = ALL.only(np.isin(ALL.frequency_hz, (7, 10, 30)) & (ALL.added_kg < 4))
    true = exact(rival, values).shaken(some.frequency_hz, some.added_kg, some.table)
    told = predict(MECHANISMS[rival], {k: np.array([v]) for k, v in values.items()}, some)
    assert true.repeats.all()
    assert true.air.any() == (rival == "both")
    for name in ("MB", "TB", "second"):
        np.testing.assert_allclose(getattr(told, name)[0], getattr(true, name), rtol=5e-3, atol=2e-3)
    if told.air is not None:
        np.testing.assert_allclose(told.air[0], true.air, atol=0.04)


def test_balance_meets_the_stepped_mass_where_its_motion_repeats() -> None:
    f, rng = np.array([12.0, 30.0, 50.0]), np.random.default_rng(0)
    m, W, k = rng.uniform(4, 4.5, 8), rng.uniform(20, 120, 8), rng.uniform(5e4, 3e5, 8)
    n, c = rng.uniform(1.1, 3, 8), rng.uniform(200, 900, 8)
    found = steady(f, m, W, k, n, c)
    flat = [np.repeat(a, f.size) for a in (W, k, n, c)]
    mass = np.repeat(np.repeat(m, f.size)[:, None].astype(complex), balance.HARMONICS, axis=1)
    systems = balance.Pressed(2 * np.pi * np.tile(f, 8), mass, *flat, np.full(24, TABLE_M_S2))
    x, balanced = balance.solve(systems)
    T = systems.acceleration(x)[:, 0].reshape(8, -1) / TABLE_M_S2
    both = balanced.reshape(8, -1) & (found.period == 1)
    assert both.sum() > 12
    assert found.air[both].max() > 0.1
    far = np.abs(T / found.response - 1)
    assert far[both & (found.air < 0.7)].max() < 2e-3
    assert far[both].max() < 6e-3  # a pad that hardly touches would take more than eight harmonics
    again, _ = balance.solve(systems, balance.begin(systems, systems.acceleration(x)[:, 0]))
    kept = both.ravel()
    np.testing.assert_allclose(again[kept], x[kept], atol=1e-3 * np.abs(x[kept]).max())


def test_one_step_nearby_is_right_to_first_order() -> None:
    some = ALL.only(ALL.table < TABLE_M_S2)
    at = {k: np.array([v]) for k, v in BOTH.items()}
    told = predict(MECHANISMS["both"], at, some)
    near = {k: np.array([v, v * (1 + 1e-4 * (k == "k_T"))]) for k, v in BOTH.items()}
    quick = predict(MECHANISMS["both"], near, some, told.x, nearby=True).MB[1] - told.MB[0]
    slow = predict(MECHANISMS["both"], {k: v[1:] for k, v in near.items()}, some).MB[0] - told.MB[0]
    np.testing.assert_allclose(quick, slow, atol=0.02 * np.abs(slow).max())


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return Analysis(ALL, ("stiffening", "second mode", "lift-off"), bank=1500, pressed_bank=400)


@pytest.mark.parametrize("rival", ["stiffening", "second mode", "lift-off"])
def test_a_subject_is_called_what_it_is(analysis: Analysis, rival: str) -> None:
    verdict = one(rival, 1, [analysis])[ALL.name]
    assert verdict.named == rival
    assert verdict.per_dof < fit.FITS
    assert verdict.margin > 100


def test_a_motion_that_no_rival_makes_is_none_of_these_and_one_that_does_not_repeat_is_no_linear_one(
    analysis: Analysis,
) -> None:
    rng = np.random.default_rng(0)
    true = measured(exact("stiffening", STIFF), ALL, rng, departure=0.0)
    odd = np.where(ALL.frequency_hz > 25, 2.0, 0.5)
    quick = Analysis(ALL, ("stiffening", "second mode"), bank=300)
    wrong = replace(true, MB=true.MB * odd, TB=true.TB / odd)
    assert quick.verdict(wrong).named == fit.NONE
    lost = true.repeats.copy()
    lost[:2] = False
    verdict = quick.verdict(replace(true, repeats=lost))
    assert verdict.left_out == 2
    assert np.isinf(list(verdict.criteria.values())).all()


def test_a_half_amplitude_is_held_against_its_whole() -> None:
    partner = ALL.partner
    for i in np.flatnonzero(partner >= 0):
        j = partner[i]
        assert (ALL.frequency_hz[i], ALL.added_kg[i]) == (ALL.frequency_hz[j], ALL.added_kg[j])
        assert ALL.table[i] < ALL.table[j]
    assert (partner >= 0).sum() == 10
    assert [p.name for p in PLANS].count(THESIS.name) == 1


def test_confusion_counts() -> None:
    def says(name: str, criteria: dict[str, float]) -> Verdict:
        return Verdict(name, name, 20.0, 1.0, criteria, 0)

    far, near = {"second mode": 0.0, "both": 50.0}, {"second mode": 3.0, "both": 0.0}
    found = Confusion(
        "p", {"second mode": [says("second mode", far), says("both", near)], "both": [says("both", near)]}
    )
    assert (found.subjects, found.right, found.wrong) == (3, 2, 1)
    assert found.separated("second mode", "both") == pytest.approx(1 / 3)  # 3 is less than odds of 1000 to 1
    assert found.record()["named"]["second mode"] == dict.fromkeys([*RIVALS, "undecided", "none of these"], 0) | {
        "second mode": 1, "both": 1,
    }  # fmt: skip


def test_a_stopped_study_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    class Quick:
        def __init__(self, plan: Plan, departure: float = 0.0) -> None:
            self.plan = plan

    def quick(rival: str, number: int, analyses: list[Quick], *_: float) -> dict[str, Verdict]:
        asked.append((rival, number, [a.plan.name for a in analyses]))
        criteria = {r: float(r != rival) for r in RIVALS} | {"both": np.inf}
        return {a.plan.name: Verdict(rival, rival, 20.0, 1.0, criteria, 0) for a in analyses}

    monkeypatch.setattr(decide, "Analysis", Quick)
    monkeypatch.setattr(decide, "judged", quick)
    *_, last = decide.study([THESIS], 1, tmp_path)
    assert (last[0].right, len(asked)) == (5, 5)
    (tmp_path / "both-0.json").write_text("{")
    *_, last = decide.study([THESIS, ALL], 1, tmp_path)
    assert asked[5:9] == [(r, 0, [ALL.name]) for r in RIVALS[:4]]
    assert asked[9] == ("both", 0, [THESIS.name, ALL.name])
    assert np.isinf(last[1].verdicts["constant"][0].criteria["both"])
    json.loads((tmp_path / "both-0.json").read_text())
    *_, last = decide.study([THESIS], 1, tmp_path, seed=1)
    assert len(asked) == 15


def test_a_rival_and_its_richer_one_alone_give_a_verdict() -> None:
    quick = Analysis(ALL, ("constant", "stiffening"), bank=200)
    true = measured(exact("stiffening", STIFF), ALL, np.random.default_rng(0), departure=0.0)
    assert quick.verdict(true).best == "stiffening"
    alone = Analysis(ALL, ("stiffening",), bank=200).verdict(true)
    assert (alone.best, alone.margin) == ("stiffening", np.inf)


@pytest.mark.parametrize(("rival", "values"), [("both", BOTH), ("stiffening", STIFF)])
def test_any_load_is_foreseen(rival: str, values: dict[str, float]) -> None:
    f = np.array([10.0, 10.0, 30.0])
    plan = Plan("other loads", f, np.array([1.0, 3.7, 3.7]), np.full(3, TABLE_M_S2))
    true = exact(rival, values).shaken(plan.frequency_hz, plan.added_kg, plan.table)
    told = predict(MECHANISMS[rival], {k: np.array([v]) for k, v in values.items()}, plan)
    np.testing.assert_allclose(told.MB[0], true.MB, rtol=5e-3)


def test_segments_grow_with_the_body_and_nothing_else_does() -> None:
    light, heavy = MECHANISMS["both"], MECHANISMS["both"].of(2 * BODY_KG)
    for each, other in zip(light.constants, heavy.constants, strict=True):
        times = 2.0 if each.name in ("m_F", "m_S", "m_H") else 1.0
        assert (other.lower, other.upper) == pytest.approx((times * each.lower, times * each.upper))
