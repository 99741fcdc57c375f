"""Weightings against the standards' tables, doses against closed forms, and the limit that stops."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from feeder import CONDITION, Feeder

from fasbody.acquire import person
from fasbody.acquire.board import Board, Watch
from fasbody.acquire.level import Safety
from fasbody.acquire.person import Dose, Meter, w_k
from fasbody.acquire.plan import Plan
from fasbody.exceptions import AcquisitionError, InputFileError, SettingError

#: One-third-octave bands of ISO 2631-1:1997, table 3 (times 1000).
BANDS = (0.5, 0.63, 0.8, 1, 1.25, 1.6, 2, 2.5, 3.15, 4, 5, 6.3, 8, 10, 12.5, 16, 20, 25, 31.5, 40, 50, 63, 80)
TABLE_K = (418, 459, 477, 482, 484, 494, 531, 631, 804, 967, 1039, 1054, 1036, 988, 902, 768, 636, 513, 405, 314, 246,
           186, 132)  # fmt: skip


def test_the_weighting_is_that_of_the_standards_table() -> None:
    np.testing.assert_allclose(w_k(np.array(BANDS, float)), 1e-3 * np.array(TABLE_K), rtol=0.004)


def test_dose_of_a_sine_is_that_of_its_samples_and_doses_add() -> None:
    rate, t = 1000.0, np.arange(10_000) / 1000
    for hz in (10.0, 20.0, 50.0):
        exact = Dose.of_sine(hz, 8.95, 10.0)
        sampled = Dose.of(9.81 + 8.95 * np.sin(2 * np.pi * hz * t), rate)
        for name in ("square", "fourth", "seconds", "a_w", "a8", "vdv"):
            assert getattr(sampled, name) == pytest.approx(getattr(exact, name), rel=1e-6)
        twice = exact + exact
        assert twice.a8 == pytest.approx(np.sqrt(2) * exact.a8) and twice.vdv == pytest.approx(2**0.25 * exact.vdv)
        assert twice.a_w == pytest.approx(exact.a_w)
    eight_hours = Dose.of_sine(5.0, 1.0, 8 * 3600.0)
    assert eight_hours.a8 == pytest.approx(float(w_k(5.0)) / np.sqrt(2))
    assert Dose().a_w == Dose().a8 == 0


def test_noise_has_the_dose_of_its_spectrum() -> None:
    rate, n = 1000.0, 60_000
    values = np.random.default_rng(1).normal(0, 3, n)
    hz = np.linspace(0, 500, 5001)
    a_w = 3 * np.sqrt(np.mean(w_k(hz) ** 2))
    assert Dose.of(values, rate).a_w == pytest.approx(a_w, rel=0.04)


@pytest.mark.parametrize("option", ["max_exposure", "max_vdv"])
@pytest.mark.parametrize(("seconds", "stops"), [(9, False), (11, True)])
def test_the_limit_of_the_day_stops(seconds: int, stops: bool, option: str) -> None:
    """Ten seconds of this sine are the limit; what was before counts."""
    rate, wave = 500.0, 8.0 * np.sin(2 * np.pi * 20 * np.arange(16 * 500) / 500)
    most = Dose.of_sine(20.0, 8.0, 5.0) + Dose.of_sine(20.0, 8.0, 10.0)
    limits = {"max_exposure": (most.a8, 1e9), "max_vdv": (1e9, most.vdv)}[option]
    meter = Meter(Dose.of_sine(20.0, 8.0, 5.0), limits[0] * (1 + 1e-6), rate, limits[1] * (1 + 1e-6))
    pieces = np.split(wave[: seconds * 500], seconds * 20)
    if stops:
        with pytest.raises(AcquisitionError, match="; output off") as caught:
            for piece in pieces:
                meter.add(piece)
        assert caught.value.setting == option
        most = Dose.of_sine(20.0, 8.0, 5.0 + seconds)
        assert caught.value.value == pytest.approx(most.a8 if option == "max_exposure" else most.vdv)
        return
    for piece in pieces:
        meter.add(piece)
    assert meter.dose.seconds == pytest.approx(5 + seconds)


def test_the_thesis_protocol_stands_near_the_limit_and_the_sentence_tells() -> None:
    """Three loads of 10:50:5, ten seconds and the finding of the level each."""
    steps = [Dose.of_sine(float(hz), 8.95, 10.0 + person.LEVEL_S) for hz in 3 * list(range(10, 51, 5))]
    text = sum(steps, Dose()).sentence()
    assert "These are 35 % and 97 % of the daily limits" in text and "The VDV exceeds its action value" in text
    assert "Neither exceeds" in Dose.of_sine(20.0, 1.0, 10.0).sentence()


def test_days_and_subjects_stay_beside_what_else_a_session_says(tmp_path: Path) -> None:
    one = Dose.of_sine(20.0, 8.0, 10.0)
    (tmp_path / person.SESSION).write_text('{"ended": "met", "exposure": {"16": {"2001-01-01": {"square": 1}}}}')
    assert person.dose_of(tmp_path, "16") == Dose()
    person.keep(tmp_path, "16", one)
    person.keep(tmp_path, "2", one)
    person.note(tmp_path, checklist=["a"])
    known = json.loads((tmp_path / person.SESSION).read_text())
    assert known["ended"] == "met" and set(known["exposure"]) == {"16", "2"} and known["checklist"] == ["a"]
    assert set(known["exposure"]["16"]) == {"2001-01-01", person.today()}
    assert person.dose_of(tmp_path, "16").a8 == pytest.approx(one.a8)
    (tmp_path / person.SESSION).write_text("[")
    assert person.noted(tmp_path) == {}
    much = {"16": {person.today(): {"square": "much", "fourth": 1, "seconds": 2}}}
    for spoilt in ("[1]", '{"16": 3}', json.dumps(much)):
        (tmp_path / person.SESSION).write_text(f'{{"exposure": {spoilt}}}')
        with pytest.raises(InputFileError, match="as numbers"):
            person.dose_of(tmp_path, "16")


def test_a_board_adds_up_what_the_base_does_while_the_shaker_is_on(feeder: Feeder, board: Board) -> None:
    board.collect(0.1)
    board.meter = Meter(Dose(), 1e9, 1000.0)
    board.collect(0.2)
    assert board.meter.dose == Dose()  # off
    board.watch = Watch(peak=100.0, offset=0.0)
    board.collect(0.4)
    board.watch = None
    assert board.meter.dose.seconds >= 0.39 and board.meter.dose.a_w > 0.5


def plan(tmp_path: Path, **others: Any) -> Plan:
    return Plan(tmp_path / "study", (10.0, 20.0), CONDITION, seconds=10.0, **others)


def test_a_plan_says_its_dose_and_is_refused_beyond_the_limit(tmp_path: Path) -> None:
    each = [Dose.of_sine(hz, plan(tmp_path).peak_to_peak / 2, 10.0 + person.LEVEL_S) for hz in (10.0, 20.0)]
    assert plan(tmp_path).dose.a8 == pytest.approx((each[0] + each[1]).a8)
    plan(tmp_path, safety=Safety(daily_a8=1.01 * plan(tmp_path).dose.a8)).check(True)
    dose = plan(tmp_path).dose
    for low, option in ((Safety(daily_a8=0.99 * dose.a8), "exposure"), (Safety(daily_vdv=0.99 * dose.vdv), "vdv")):
        with pytest.raises(SettingError) as caught:
            plan(tmp_path, safety=low).check(True)
        assert caught.value.setting == f"max_{option}" and f"--max-{option}" in caught.value.valid
    person.keep(tmp_path / "study", CONDITION.subject, Dose.of_sine(10.0, 9.0, 300.0))
    with pytest.raises(SettingError, match="had today"):
        plan(tmp_path).check(True)
