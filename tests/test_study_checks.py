"""Checks of a study's fits: what each finds, that they are resumed, and how they reach summary, page and JSON."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from study_runs import fitted, small

from fasbody.foot.model import Foot
from fasbody.recording.study import StudyFolder
from identification.fitting import Settings
from identification.study import VERDICTS, job
from identification.study.job import ensure
from identification.study.plan import Model, Plan

ONE_LOAD = ("--workers", "1", "--added-mass", "0")
BOUNDS = ("--bounds", "k_T=1e4:1e7")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small(tmp_path_factory.mktemp("checks") / "study", frequencies=(10.0, 20.0, 40.0))


@pytest.fixture(scope="module")
def plan(study: Path, foot: Foot) -> Plan:
    opened = StudyFolder.open(study)
    trials = [trial for trial in opened.trials if trial.condition.added_mass_kg == 0.0]
    return Plan(
        opened, trials, Settings(departures=False, starts=2, threads=1, bounds={"k_T": (1e4, 1e7)}), Model.of(foot)
    )


def test_each_check_has_a_key_of_its_own_and_the_group_it_needs(plan: Plan) -> None:
    each = plan.jobs("per-recording", "validation")
    assert [len(j.trials) for j in each] == [3]  # neighbours in frequency are needed
    assert [len(j.trials) for j in plan.jobs("per-recording", "profile", "k_T")] == [1, 1, 1]
    asked = [("fit", ""), ("profile", "k_T"), ("profile", "k_F"), ("validation", ""), ("agreement", "")]
    keys = [j.key for kind, name in asked for j in plan.jobs("pooled", kind, name)]
    assert len(set(keys)) == len(asked)


def test_a_profile_starts_where_the_fit_ended(plan: Plan) -> None:
    fit = job.run(plan.work(plan.jobs("pooled")[0]))
    one = plan.jobs("pooled", "profile", "k_F")[0]
    found = job.run(plan.work(one, fit))
    assert (found["status"], found["error"], found["kind"]) == ("done", None, "profile")
    result, best = found["result"], fit["result"]["branches"][0]
    estimate = best["parameters"]["k_F_n_per_m"]
    assert (result["fit"], result["branch"], result["key"]) == (fit["key"], best["name"], "k_F_n_per_m")
    assert result["value"] == pytest.approx(estimate["value"], abs=0.05 * estimate["std_error"])
    assert result["lower"] < estimate["value"] < result["upper"]
    width = np.log(estimate["upper"] / estimate["lower"])
    assert np.log(result["wald"]) == pytest.approx(np.log([estimate["lower"], estimate["upper"]]), abs=0.05 * width)
    alone = job.run(plan.work(one))
    assert alone["status"] == "failed" and "needs a fit in the steady state" in alone["error"]


@pytest.mark.long
def test_validation_compares_damping_where_it_can(plan: Plan) -> None:
    pooled = job.run(plan.work(plan.jobs("pooled", "validation")[0]))["result"]
    assert [round(row["frequency_hz"], 2) for row in pooled["held_out"]["rows"]] == [10.0, 20.0, 40.0]
    assert [row["edge"] for row in pooled["held_out"]["rows"]] == [True, False, True]
    assert pooled["damping"]["nonlinear"]["held_out_percent"] == pooled["held_out"]["percent"]
    each = job.run(plan.work(plan.jobs("per-recording", "validation")[0]))["result"]
    assert each["damping"] is None and len(each["held_out"]["rows"]) == 3


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_checks_are_resumed_and_reach_everything(study: Path, tmp_path: Path) -> None:
    asked = (*ONE_LOAD, *BOUNDS, "--mode", "pooled", "--profile", "k_T", "--validate", "--report")
    first = fitted(study, tmp_path, *asked)
    assert (first["computed"], first["checked"], first["failed"]) == (1, 2, [])
    before = {file: file.stat().st_mtime_ns for file in tmp_path.glob("*s/*.json")}
    again = fitted(study, tmp_path, *asked, "--profile", "k_T,k_F", "--prior", "k_T>k_F")
    assert (again["computed"], again["checked"]) == (0, 1)
    assert {file: file.stat().st_mtime_ns for file in before} == before
    assert [p["key"] for p in again["profiles"]] == ["k_T_n_per_m", "k_F_n_per_m"]
    assert len(again["validation"]) == 1 and again["agreement"] == []
    (tracked,) = again["tracking"]
    assert again["prior"] == "k_T>k_F"
    assert tracked["tracking"] is None  # the constants change with frequency: a misfit has no odds

    rows = list(csv.DictReader((tmp_path / "summary.csv").read_text().splitlines()))
    assert {row["tracked"] for row in rows} == {""} == {row["std_error"] for row in rows}
    for profile in again["profiles"]:
        symbol = profile["key"].removesuffix("_n_per_m")
        mine, other = (
            [r for r in rows if r["parameter"] == symbol and r["chosen"] == is_] for is_ in ("True", "False")
        )
        assert VERDICTS.index(mine[0]["verdict"]) >= VERDICTS.index(profile["verdict"])  # the worse of fit and profile
        assert mine[0]["branch"] == profile["branch"]
        assert (mine[0]["profile_lower"] == "") == profile["open_below"]
        if not profile["open_above"]:
            assert float(mine[0]["profile_upper"]) == pytest.approx(profile["upper"])
        assert all(row["profile_lower"] == row["profile_upper"] == "" for row in other)
    page = (tmp_path / "report.html").read_text()
    for title in ("Branches over a subject", "Profile likelihood", "Leave one frequency out", "nonlinear damping"):
        assert title in page
    assert "Prior: k_T&gt;k_F." in page


@pytest.mark.long
def test_both_domains_on_one_fit(study: Path, tmp_path: Path) -> None:
    narrow = (*ONE_LOAD, "--mode", "pooled", "--frequency", "20", "--frequency", "40", "--free", "k_F,c_21")
    found = fitted(study, tmp_path, *narrow, "--agreement", "--report")
    (both,) = found["agreement"]
    assert [d["key"] for d in both["differences"]][:2] == ["k_F_n_per_m", "c_21_n_s_per_m"]
    known = [abs(d["z"]) for d in both["differences"] if d["z"] is not None]
    assert known and both["agrees"] == all(z <= 3 for z in known)
    assert both["sentence"] in (tmp_path / "report.html").read_text().replace("&#39;", "'")
    (fit,) = (json.loads(file.read_text()) for file in (tmp_path / "fits").glob("*.json"))
    assert set(fit["result"]["parameters"]) == {"k_F_n_per_m", "c_21_n_s_per_m", "delay_s"}
    (only,) = found["tracking"]
    assert only["tracking"] is None and only["said"]  # k_T is held: there is no mirror


@pytest.mark.long
def test_a_check_that_cannot_be_is_said_and_stops_nothing(study: Path, tmp_path: Path) -> None:
    two = ("--frequency", "10", "--frequency", "20")
    found = fitted(study, tmp_path, *ONE_LOAD, *two, "--validate", "--profile", "k_T,k_T")
    assert (found["computed"], found["checked"]) == (2, 3)
    (failure,) = found["failed"]
    assert failure["kind"] == "validation" and "three or more frequencies" in failure["error"]
    place = "failed: subject 1, midstance, 0 kg: "
    assert found["said"].count(place + failure["error"]) == 1
    assert fitted(study, tmp_path, *ONE_LOAD, *two, "--validate")["checked"] == 1  # failed ones are tried again


def test_bounds_are_the_space(foot: Foot) -> None:
    space = ensure("pooled", Settings(departures=False, bounds={"k_T": (2e4, 3e6)}), foot, ("k_T", "delay"))
    i = [item.name for item in space.free].index("k_T")
    np.testing.assert_allclose([space.lower[i], space.upper[i]], [2e4, 3e6])
