"""Steady state against time domain: signals with known transients, drift and beating; both routes on one study."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_fits import plain
from study_cases import power_laws, record, study

from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification.fitting import Settings, fit_foot
from identification.result import FitResult
from identification.study import report, tables
from identification.study.agreement import agreement, steadiness
from identification.study.findings import Findings


def shaped(envelope, seconds: float = 10.0) -> Recording:  # type: ignore[no-untyped-def]
    """A recording whose malleolus has a known envelope, in noise."""
    r = record(power_laws, 20.0, seconds=seconds)
    t = r.time_s - r.time_s[0]
    rng = np.random.default_rng(0)
    base = 8.95 * np.sin(2 * np.pi * 20 * t) + rng.normal(0, 0.03, t.size)
    return replace(r, base_m_s2=base, malleolus_m_s2=envelope(t) * 12 * np.cos(2 * np.pi * 20 * t) + base * 0)


def test_a_steady_recording_has_no_reasons() -> None:
    found = steadiness(record(power_laws, 20.0, seconds=10.0))
    assert not found.reasons
    assert max(found.onset, abs(found.drift), found.beating) < 4 * found.noise


def test_drift_is_measured() -> None:
    found = steadiness(shaped(lambda t: 1 + 0.05 * t / 10))
    assert found.drift == pytest.approx(0.05 / 1.025, rel=0.03)
    assert "drift" in found.reasons


def test_beating_is_measured() -> None:
    found = steadiness(shaped(lambda t: 1 + 0.04 * np.sin(2 * np.pi * 0.4 * t)))
    assert found.beat_hz == pytest.approx(0.4, abs=0.03)
    assert found.beating == pytest.approx(0.04, rel=0.05)
    assert "beating" in found.reasons


def test_a_transient_is_measured() -> None:
    found = steadiness(shaped(lambda t: 1 + 0.3 * np.exp(-t / 0.2)))
    first = 1.0
    assert found.onset == pytest.approx(0.3 * 0.2 / first * (1 - np.exp(-first / 0.2)), rel=0.1)
    assert "transient" in found.reasons


@pytest.fixture(scope="module")
def both(foot: Foot) -> tuple[list[Recording], tuple[FitResult, FitResult], dict[str, Any]]:
    data = study(lambda f, m: power_laws(20.0, m), (12.5, 20.0, 40.0), (0.0,), seed=4, seconds=1.2)
    held = foot.with_values({n: power_laws(20.0, 0.0)[n] for n in ("c_11", "c_12", "c_13", "c_22", "c_23")})
    settings = Settings(departures=False, free=("k_T", "k_F", "c_21"), starts=1, threads=1, delay=False)
    results = tuple(fit_foot(data, held, replace(settings, domain=d)) for d in ("periodic", "time"))
    return data, results, agreement(data, held, settings, results=results)  # type: ignore[arg-type]


def test_both_routes_agree_on_a_steady_study(both) -> None:  # type: ignore[no-untyped-def]
    _, (steady, timed), found = both
    assert found["agrees"] is True
    assert found["same_branch"]
    for d in found["differences"]:
        a, b = steady.best.parameters[d["key"]], timed.best.parameters[d["key"]]
        assert d["z"] == pytest.approx((a.value - b.value) / np.hypot(a.std_error, b.std_error))
        assert abs(a.value - b.value) < 0.05 * a.value
    assert found["sentence"].startswith("Steady state and time domain agree: 3 parameters")


def biased(result: FitResult, by: float) -> FitResult:
    """The same result with k_T moved by so many standard errors."""
    branches = []
    for b in result.branches:
        e = b.parameters["k_T_n_per_m"]
        moved = replace(e, value=e.value + by * e.std_error)
        branches.append(replace(b, parameters={**b.parameters, "k_T_n_per_m": moved}))
    return replace(result, branches=tuple(branches))


def test_a_disagreement_is_explained_by_the_data(both, foot: Foot) -> None:  # type: ignore[no-untyped-def]
    data, (steady, timed), _ = both
    apart = (steady, biased(timed, 20.0))
    unexplained = agreement(data, foot, results=apart)
    assert not unexplained["agrees"]
    assert "disagree in 1 of 3" in unexplained["sentence"]
    assert "The recordings are steady" in unexplained["sentence"] and "a resonating strap" in unexplained["sentence"]
    t = data[1].time_s - data[1].time_s[0]
    drifting = [data[0], replace(data[1], malleolus_m_s2=data[1].malleolus_m_s2 * (1 + 0.04 * t / t[-1])), data[2]]
    explained = agreement(drifting, foot, results=apart)
    assert "20hz_0kg.csv shows drift: its amplitude changes by" in explained["sentence"]
    assert explained["sentence"].endswith("Trust the time domain.")


def test_nothing_to_compare_is_no_agreement(  # type: ignore[no-untyped-def]
    both, foot: Foot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither route knows a standard error: the third answer, on the page as in the document."""
    data, (steady, timed), _ = both
    found = agreement(data, foot, results=(steady, blind(timed)))
    assert found["agrees"] is None
    assert found["sentence"].startswith("Nothing to compare") and "nan" not in found["sentence"]
    one = {"mode": "per-recording", "subject": "1", "posture": "midstance", "added_mass_kg": 0.0, "frequency_hz": 30.0}
    one |= {"kind": "agreement", "status": "done", "files": ["a.csv"]}
    results = [found, agreement(data, foot, results=(steady, timed))]
    checks = [{**one, "result": r} for r in results]
    assert tables.agreement(Findings(checks=checks))["agrees"].tolist() == ["yes", "nothing to compare"]
    monkeypatch.setattr(report, "pictures", lambda *_: {})
    fits = [plain("per-recording", "1", 0.0, 30.0, {"best": {}})]
    report.write(tmp_path, Findings(fits, checks), "one", "synthetic")
    page = (tmp_path / "report.html").read_text()
    assert "<p>1 of 1 fits agree within three joint standard errors in all parameters.</p>" in page
    assert "<p>In 1 more there is nothing to compare.</p>" in page


def blind(result: FitResult) -> FitResult:
    """The same result without any standard error."""
    branches = [
        replace(b, parameters={key: replace(e, std_error=float("nan")) for key, e in b.parameters.items()})
        for b in result.branches
    ]
    return replace(result, branches=tuple(branches))
