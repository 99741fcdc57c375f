"""Rival mechanisms of the load effect: each response against something independent, the search, the commands."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from fasbody.foot.model import load
from fasbody.foot.two_dof import TwoDof
from fasbody.leg import __main__ as leg_command
from fasbody.leg.chain import Leg
from fasbody.leg.peaks import peaks
from fasbody.leg.statements import ADDED_KG, RANGES_HZ, STATEMENTS, Curves, judge
from fasbody.load_effect import app
from identification.rivals.mechanisms import second_mode, two_masses
from identification.rivals.pad_balance import TABLE_M_S2
from reproduction.load_effect import search as searching
from reproduction.load_effect.amplitude import halved
from reproduction.load_effect.lift_off import force, steady
from reproduction.load_effect.search import EXPLANATIONS, search

F = np.array([10.0, 22.0, 37.0, 50.0])


def test_folded_chain_is_the_chain_of_the_model() -> None:
    foot = load("leg")
    v = {k: np.array([x]) for k, x in foot.values().items()}
    v |= {"m_S": v["m_M"] + v["m_K"], "share": v["m_M"] / (v["m_M"] + v["m_K"])}
    MB, TM = second_mode(F, v, np.array(ADDED_KG)[:, None])
    for i, added in enumerate(ADDED_KG):
        leg = Leg.from_model(foot.model).with_added(added)
        np.testing.assert_allclose(MB[i], leg.at("malleolus", F), rtol=1e-12)
        np.testing.assert_allclose((MB * TM)[i], leg.at("tuberosity", F), rtol=1e-12)


def test_two_masses_are_the_linear_foot_of_chapter_4() -> None:
    v = {"m_F": 1.0, "m_S": 3.3, "k_F": 1e5, "c_F": 400.0, "k_T": 2e5, "c_T": 500.0}
    MB, _ = two_masses(F, v, np.array(2.3))
    two = TwoDof(k_T=2e5, k_F=1e5, c_11=500.0, c_12=0, c_13=0, c_21=400.0, c_22=0, c_23=0, m_S=3.3 + 2.3, m_F=1.0)
    A, b, c = two.state_space()
    s = 2j * np.pi * F
    want = [c @ np.linalg.solve(x * np.eye(4) - A, b) for x in s]
    np.testing.assert_allclose(MB, want, rtol=1e-10)


def one(k: float, n: float, c: float, static: float, table: float, f: np.ndarray):  # type: ignore[no-untyped-def]
    return steady(f, *(np.array([x]) for x in (4.3, static, k, n, c)), table=table)


def test_a_small_motion_is_that_of_the_tangent() -> None:
    k, n, c, static = 2e5, 2.0, 600.0, 80.0
    found = one(k, n, c, static, 1e-3, F)
    ratio = (static / 43.0) ** (1 - 1 / n)
    s = 2j * np.pi * F
    z = ratio * (k + s * c)
    np.testing.assert_allclose(found.response[0], z / (z + 4.3 * s**2), rtol=2e-3)
    assert not found.air.any()
    assert (found.period == 1).all()


def test_lift_off_against_an_independent_integration() -> None:
    k, n, c, static, f = 2e5, 1.9, 600.0, 32.0, 30.0
    found = one(k, n, c, static, TABLE_M_S2, np.array([f]))
    A = (k / (n * 43.0 ** (1 - 1 / n))) ** n
    omega = 2 * np.pi * f

    def rates(t: float, x: np.ndarray) -> list[float]:
        pad = max(0.0, A * x[0] ** n + c / k * n * A * x[0] ** (n - 1) * x[1]) if x[0] > 0 else 0.0
        return [x[1], TABLE_M_S2 * np.sin(omega * t) - (pad - static) / 4.3]

    t = np.linspace(24 / f, 28 / f, 4001)[:-1]
    out = solve_ivp(rates, (0, t[-1]), [(static / A) ** (1 / n), 0], t_eval=t, rtol=1e-8, atol=1e-12, max_step=1e-4)
    a = np.array([(force.py_func(d, v, A, n, k, c) - static) / 4.3 for d, v in out.y.T])
    first, second = (abs(np.mean(a * np.exp(-1j * m * omega * t))) for m in (1, 2))
    assert found.period[0, 0] == 1
    assert found.air[0, 0] > 0.1
    assert abs(found.response[0, 0]) == pytest.approx(2 * first / TABLE_M_S2, rel=5e-3)
    assert found.second[0, 0] == pytest.approx(second / first, rel=2e-2)


def test_light_damping_is_no_doubled_period() -> None:
    f, k, c, static = np.array([10.0, 20, 25, 30, 35, 40, 50]), 2e5, 30.0, 100.0
    found, s = one(k, 1.0, c, static, 0.1, f), 2j * np.pi * f
    exact = (k + s * c) / (k + s * c + 4.3 * s**2)  # it never leaves the pad
    np.testing.assert_allclose(found.response[0], exact, rtol=1e-5)
    assert (found.period == 1).all()
    np.testing.assert_allclose(found.multiplier[0], np.exp(-c / 2 / 4.3 / f), rtol=1e-4)


def pad_rates(k: float, n: float, c: float, static: float, f: float):  # type: ignore[no-untyped-def]
    A = (k / (n * 43.0 ** (1 - 1 / n))) ** n

    def rates(t: float, x: np.ndarray) -> list[float]:
        pad = max(0.0, A * x[0] ** n + c / k * n * A * x[0] ** (n - 1) * x[1]) if x[0] > 0 else 0.0
        return [x[1], TABLE_M_S2 * np.sin(2 * np.pi * f * t) - (pad - static) / 4.3]

    return rates, (static / A) ** (1 / n)


def strobed(x: list[float], c: float, static: float, f: float, grown: int) -> np.ndarray:
    """Compressions (9,) a period apart after 120 periods from x, by scipy; the table grows over the first ones."""
    rates, _ = pad_rates(2e5, 1.9, c, static, f)
    share = lambda t: min(1.0, (np.floor(t * f) + 1) / grown)  # noqa: E731
    swept = lambda t, x: [x[1], rates(t, x)[1] + (share(t) - 1) * TABLE_M_S2 * np.sin(2 * np.pi * f * t)]  # noqa: E731
    out = solve_ivp(swept, (0, 120 / f), x, t_eval=np.arange(112, 121) / f, rtol=1e-7, atol=1e-11, max_step=1 / 30 / f)
    return np.asarray(out.y[0])


def test_a_doubled_period_is_told_and_depends_on_the_start_where_two_motions_are_stable() -> None:
    _, still = pad_rates(2e5, 1.9, 600.0, 20.0, 30.0)
    doubled, single = strobed([still, 0.0], 600.0, 20.0, 30.0, 4), strobed([still, 0.0], 300.0, 20.0, 45.0, 4)
    assert np.abs(doubled[1:] - doubled[:-1]).max() > 1e-5 > 10 * np.abs(doubled[2:] - doubled[:-2]).max()
    assert np.abs(single[1:] - single[:-1]).max() < 1e-6
    assert one(2e5, 1.9, 600.0, 20.0, TABLE_M_S2, np.array([30.0])).period[0, 0] == 2
    assert one(2e5, 1.9, 300.0, 20.0, TABLE_M_S2, np.array([45.0])).period[0, 0] == 1
    abrupt = strobed([still, 0.0], 300.0, 20.0, 45.0, 1)  # the same foot, shaken at once: another motion, as stable
    assert np.abs(abrupt[1:] - abrupt[:-1]).max() > 1e-5 > 10 * np.abs(abrupt[2:] - abrupt[:-2]).max()


def test_halving_the_amplitude_moves_the_unloaded_peak_of_lift_off() -> None:
    rows = halved({"m": 4.3, "rest": 32.0, "k": 2e5, "exponent": 1.9, "c": 600.0})
    full, half = rows[0], rows[3]
    assert (full.added_kg, half.table) == (0.0, TABLE_M_S2 / 2)
    assert half.peak_hz > full.peak_hz + 5
    assert full.air > 0.5
    assert full.second > 3 * half.second
    assert rows[5].peak_hz == pytest.approx(rows[2].peak_hz, abs=1)


def test_the_shipped_leg_meets_most_statements_on_mb_and_all_three_ranges() -> None:
    result = peaks(Leg.from_model(load("leg").model), "leg")
    met = [held for s, held in zip(STATEMENTS, result.held, strict=True) if s.pair == "MB"]
    assert (sum(met), len(met), sum(result.held)) == (13, 14, 25)
    for load_, (low, high) in enumerate(RANGES_HZ):
        assert low < result.highest("MB", load_)[0] < high


def test_statements_tell_a_curve_made_to_order_from_a_flat_one() -> None:
    flat = np.ones((3, 9), complex)
    shaped = flat.copy()
    shaped[0] = [1.3, 1.28, 1.27, 1.27, 1.2, 1.1, 1.05, 1.0, 1.0]
    shaped[1] = [1.1, 1.1, 1.2, 1.3, 1.4, 1.4, 1.3, 1.2, 1.1]
    names = [s.says for s in STATEMENTS]
    of = lambda MB: dict(zip(names, judge(Curves(MB, flat)), strict=True))  # noqa: E731
    for says in ("unloaded: plateau 15-25 Hz", "2.3 kg: resonance 30-35 Hz", "unloaded: above 1 below 40 Hz"):
        assert of(shaped)[says]
        assert not of(flat)[says]


def test_search_orders_the_linear_mechanisms() -> None:
    found = {name: search(name, 2000, rounds=15) for name, (m, _) in EXPLANATIONS.items() if m.response}
    assert found["constant, any ankle"].best_judged.ranges[0] < 2
    assert found["second mode"].best_judged.ranges[0] == 3
    assert found["second mode"].best_judged.count[0] > found["constant"].best_judged.count[0]


def test_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "FINE_HZ", np.arange(10.0, 51.0, 10.0))
    monkeypatch.setattr(searching, "search", lambda m, draws, seed, *_: search(m, draws, seed, rounds=2))
    run = CliRunner().invoke(leg_command.app, ["peaks", "--json"])
    assert run.exit_code == 0
    assert sum(s["holds"] for s in json.loads(run.stdout)["statements"]) == 25
    run = CliRunner().invoke(app, ["--draws", "20", "--lift-off-draws", "20", "--json"])
    assert run.exit_code == 0
    assert [m["name"] for m in json.loads(run.stdout)["mechanisms"]] == list(EXPLANATIONS)
