"""The truth of synthetic studies, and how much of it was found: against the recordings and against counting."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pandas as pd
import pytest
from made_fits import plain

from fasbody.exceptions import InputFileError
from fasbody.foot.two_dof import NAMES
from fasbody.laboratory.study import STUDY_INSTRUMENT, Plan, make
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.study import Study
from identification.study import summary
from identification.study.truth import Truth, recovery

CLEAN = replace(
    STUDY_INSTRUMENT, gain_scatter=0.0, noise_base=1e-4, noise_malleolus=1e-4, strap_hz=0.0, delay_s=0.0, bits=24
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plan = Plan(
        subjects=2, conditions=(("midstance", 0.0), ("midstance", 2.3)), frequencies_hz=(10.0, 30.0), seconds=1.0,
        instrument=CLEAN,
    )  # fmt: skip
    return make(tmp_path_factory.mktemp("study"), plan, processes=1)


def test_stored_constants_are_those_of_the_recordings(study: Path) -> None:
    """DOP853 with the constants of each file, driven by its base, gives its malleolus."""
    truth = Truth.read(study)
    assert truth is not None
    for recording in Study.read(study).recordings[::3]:
        c = recording.condition
        known = truth.of([recording.file])
        U, Y = (
            fit_harmonics(recording.time_s, x, c.frequency_hz, 3).amplitudes
            for x in (recording.base_m_s2, recording.malleolus_m_s2)
        )
        p = {**known, **c.masses}
        omega = 2j * np.pi * c.frequency_hz * np.arange(1, 4)
        t = np.arange(400) / 400 / c.frequency_hz
        many = 12 / c.frequency_hz
        out = oracle.malleolus(
            p, lambda s, U=U, w=omega: float((np.exp(w * s) @ U).real), np.append(0, many + t), rtol=1e-9
        )[1:]
        assert 2 * np.mean(out * np.exp(-omega[0] * t)) == pytest.approx(Y[0], abs=2e-3 * abs(Y[0]))


def test_a_pooled_fit_is_compared_with_the_mean_over_its_frequencies(study: Path) -> None:
    truth = Truth.read(study)
    assert truth is not None
    files = [f"recordings/s02_midstance_2.3kg_{f}hz.csv" for f in (10, 30)]
    each = [truth.of([file]) for file in files]
    assert each[0]["k_T"] != pytest.approx(each[1]["k_T"], rel=0.1)
    pooled = truth.of([f"study/{x}" for x in files])
    assert pooled["k_T"] == pytest.approx(np.mean([own["k_T"] for own in each]))
    assert set(pooled) == {*NAMES, "delay"}
    assert set(truth.of(["unheard of.csv"])) == {"delay"}


def test_one_foot_has_one_truth_and_measured_data_none(tmp_path: Path) -> None:
    assert Truth.read(tmp_path) is None
    known = {"parameters": {"k_T": 1.3e5}, "instrument": {"delay_s": 2e-4}}
    (tmp_path / "truth.json").write_text(json.dumps(known))
    truth = Truth.read(tmp_path)
    assert truth is not None
    assert truth.of(["a.csv", "b.csv"]) == {"k_T": 1.3e5, "delay": 2e-4}
    (tmp_path / "truth.json").write_text("[]")
    with pytest.raises(InputFileError, match="not the truth"):
        Truth.read(tmp_path)


def at(k_T: float, k_F: float, word: str = "identified", error: float | None = 1.0) -> dict[str, tuple]:
    return {"k_T_n_per_m": (k_T, error, word), "k_F_n_per_m": (k_F, error, "weak")}


def test_recovery_counts_the_own_the_tracked_and_the_nearer_branch() -> None:
    """Truth 100 and 50. Right; within 3 errors only; the mirror, but tracked; the mirror, undecided; at a bound."""
    truth = Truth({}, {"k_T": 100.0, "k_F": 50.0})
    mirror = at(43.0, 116.0)
    fits = [
        plain("pooled", "1", 0.0, None, {"stiff ankle": at(101, 50), "stiff pad": mirror}),
        plain("pooled", "2", 0.0, None, {"stiff ankle": at(102, 46), "stiff pad": mirror}),
        plain("pooled", "3", 0.0, None, {"stiff pad": mirror, "stiff ankle": at(98, 51)}),
        plain("pooled", "4", 0.0, None, {"stiff pad": mirror, "stiff ankle": at(99, 52)}),
        plain("pooled", "5", 0.0, None, {"stiff ankle": at(100, 50, "not identifiable", None)}),
    ]
    for branch in (b for d in fits for b in d["result"]["branches"]):
        branch["world"] = {"follows": True}  # only such fits may say identified
    tracked = {fits[0]["key"]: "stiff ankle", fits[2]["key"]: "stiff ankle", fits[3]["key"]: "undecided"}
    rows = recovery(summary.tidy(fits, truth, tracked)).set_index("parameter")
    k_T, k_F, total = rows.loc["k_T"], rows.loc["k_F"], rows.loc["all"]
    assert (k_T["estimates"], total["estimates"]) == (5, 10)
    assert [(k_T[way], k_T[f"{way}_of"]) for way in ("chosen", "tracked", "either")] == [(2, 4), (3, 4), (4, 4)]
    assert [k_F[way] for way in ("chosen", "tracked", "either")] == [1, 2, 3]  # 46 is four standard errors off
    assert (k_T["identified"], k_T["identified_of"]) == (3, 4)
    assert [(total[way], total[f"{way}_of"]) for way in ("chosen", "tracked", "either")] == [(3, 8), (5, 8), (7, 8)]
    assert k_T["chosen_error"] == pytest.approx(np.median([0.01, 0.02, 0.57, 0.57, 0.0]))
    assert k_T["tracked_error"] == pytest.approx(np.median([0.01, 0.02, 0.02, 0.57, 0.0]))
    assert k_F["either_error"] == pytest.approx(np.median([0, 0.08, 0.02, 0.04, 0]))
    assert k_T["std_error"] == pytest.approx(np.median([1 / 101, 1 / 102, 1 / 98, 1 / 43]))


def test_recovery_of_honest_errors_is_19_in_20() -> None:
    rng = np.random.default_rng(0)
    truth = Truth({}, {"k_T": 100.0, "k_F": 50.0})
    fits = [
        plain("pooled", str(i), 0.0, None, {"best": at(100 + e, 50 + g)})
        for i, (e, g) in enumerate(rng.normal(size=(1500, 2)))
    ]
    rows = recovery(summary.tidy(fits, truth)).set_index("parameter")
    assert rows.loc["all", "chosen"] / rows.loc["all", "chosen_of"] == pytest.approx(0.9545, abs=0.012)


def test_without_a_truth_there_is_nothing_to_recover() -> None:
    found = recovery(summary.tidy([plain("pooled", "1", 0.0, None, {"best": at(1, 2)})]))
    assert isinstance(found, pd.DataFrame)
    assert found.empty
