"""Results as people and programs read them."""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fasbody import console
from fasbody.foot.parameters import symbol_and_unit
from identification.estimates import RULE, Estimate, identifiability
from identification.result import Branch, FitResult, RecordingFit, trusting


def estimate(value: float, half: float, at_bound: bool = False) -> Estimate:
    known = identifiability(value, half / 1.96, 0.0, at_bound)
    return Estimate(value, half / 1.96, value - half, value + half, at_bound, known)


def result(**changes: object) -> FitResult:
    keys = {"k_T_n_per_m": estimate(131_162.2, 302.0), "c_12_per_m": estimate(0.5, 9.0)}
    one = Branch("stiff ankle", 40.0, 10.0, 98.9, keys, [[1, 0.5], [0.5, 1]], 40.0, 49, 0.81)
    two = Branch("stiff pad", 380.0, 350.0, 98.8, keys, [[1, 0], [0, 1]], 380.0, 49, float("nan"))
    t = np.arange(3) / 10
    row = RecordingFit("a.csv", 10.0, 2.3, 98.9, t, t, t, t)
    options = {"source": "s", "origin": "synthetic", "model": "two_dof", "domain": "periodic", "branches": (one, two)}
    options |= {"recordings": (row,), "verdict": "decided", "reason": "r.", "log_likelihood_ratio": 170.0}
    options |= {"excitation_rank": 4, "twin_mujoco_difference": 1e-8, "base_acceleration_error": 1e-8, "starts": ()}
    options |= {"warnings": ("w",), "truth": {"k_T": 1.31e5}}
    return FitResult(**{**options, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "half", "text"),
    [
        (131_162.2, 302.0, "131\u202f160 ± 300"),
        (380.09, 1.0, "380.1 ± 1.0"),
        (-119.598, 0.88, "-119.60 ± 0.88"),
        (72.2, 157.0, "70 ± 160"),
    ],
)
def test_numbers_are_rounded_to_what_is_known(value: float, half: float, text: str) -> None:
    assert estimate(value, half).interval() == text


def test_the_rule_is_said_in_the_same_words_everywhere() -> None:
    """On the page as in the reports; the numbers in it are those that decide."""
    page = " ".join((Path(__file__).parent.parent / "docs" / "identification.md").read_text().split())
    assert RULE in page
    (one, other) = (float(share) / 100 for share in re.findall(r"(?:at most|up to) (\d+) %", RULE))
    words = [identifiability(1.0, std, 0.0, False) for std in (one, one + 1e-9, other, other + 1e-9)]
    assert words == ["identified", "weak", "weak", "not identifiable"]


@pytest.mark.parametrize(
    ("relative", "word"), [(0.01, "identified"), (0.099, "identified"), (0.3, "weak"), (0.6, "not identifiable")]
)
def test_identifiability_follows_the_standard_error(relative: float, word: str) -> None:
    assert identifiability(-2.0, 2 * relative, 0.0, False) == word
    assert identifiability(-2.0, 2 * relative, 0.0, True) == "not identifiable"
    assert identifiability(-2.0, float("nan"), 0.0, False) == "not identifiable"
    assert identifiability(0.0, 2 * relative, 2.0, False) == word  # a parameter that may be zero has its own size


def test_intervals_that_are_not_symmetric_or_not_there() -> None:
    assert Estimate(10.0, 3.0, 4.0, 20.0, False, "weak").interval() == "4.00 to 20.0"
    far = Estimate(2e5, 2e5, 10_432.0, 843_210.0, False, "weak").interval()
    assert far == "10\u202f400 to 843\u202f000"  # three digits, in groups
    assert Estimate(1e5, 3.0, 1e5, 2e5, True, "not identifiable").interval() == "100\u202f000 (bound)"
    assert Estimate(10.0, 3.0, 4.0, 10.0, True, "not identifiable").interval() == "10 (bound)"
    assert Estimate(10.0, float("nan"), 4.0, 20.0, False, "not identifiable").interval() == "unknown"


def test_document_has_the_promised_keys_and_survives_json() -> None:
    import json

    document = json.loads(console.to_json(result().document()))
    assert {"fit_percent", "recordings", "parameters", "branches", "verdict", "excitation_rank"} <= set(document)
    assert {"twin_mujoco_difference", "base_acceleration_error", "warnings"} <= set(document)
    assert set(document["recordings"][0]) >= {"file", "frequency_hz", "fit_percent"}
    assert set(document["parameters"]["k_T_n_per_m"]) == {
        "value", "std_error", "lower", "upper", "at_bound", "identifiability", "if_model_true", "at_rest",
    }  # fmt: skip
    assert set(document["branches"][0]) >= {"name", "cost", "fit_percent", "parameters"}
    assert document["branches"][1]["p_value"] is None  # NaN is no JSON


def test_csv_holds_every_parameter_of_every_branch() -> None:
    rows = list(csv.DictReader(io.StringIO(result().csv())))
    assert [(r["branch"], r["parameter"]) for r in rows] == [
        ("stiff ankle", "k_T_n_per_m"), ("stiff ankle", "c_12_per_m"),
        ("stiff pad", "k_T_n_per_m"), ("stiff pad", "c_12_per_m"),
    ]  # fmt: skip
    assert float(rows[0]["value"]) == pytest.approx(131_162.2)
    assert rows[0]["at_bound"] == "false"
    assert rows[1]["identifiability"] == "not identifiable"
    exact = replace(result(), branches=tuple(map(trusting, result().branches)))  # a status with a comma
    again = list(csv.DictReader(io.StringIO(exact.csv())))
    assert again[0]["identifiability"] == "identified, model assumed exact"
    assert [r["upper_if_model_true"] for r in again] == [r["upper_if_model_true"] for r in rows]


def test_sentence_and_truth() -> None:
    text = result().sentence()
    assert "k_T = 131\u202f160 ± 300" in text
    assert "fit 98.9 %" in text
    assert "chi-square 0.82 per degree of freedom; decided" in text
    assert "chi-square" not in result(domain="time").sentence()
    assert str(result()).startswith(text)
    assert result().truth_of("k_T_n_per_m") == 1.31e5
    assert result().truth_of("c_12_per_m") is None


def test_an_undecided_sentence_gives_both_branches() -> None:
    """One branch's value with its narrow interval would read as the answer, which is the other as likely as not."""
    ankle = result().best
    pad = replace(ankle, name="stiff pad", parameters={"k_T_n_per_m": estimate(71_570.0, 140.0)})
    undecided = result(branches=(ankle, pad), verdict="undecided")
    for text in (undecided.sentence(), str(undecided)):
        assert "k_T = 131\u202f160 ± 300 N/m (95 %) on the stiff ankle branch or k_T = 71\u202f570 ± 140 N/m" in text
    assert len(str(undecided).splitlines()) == 2 + 2 + len(ankle.parameters) + len(pad.parameters)
    assert "71\u202f570" not in result(branches=(ankle, pad)).sentence()


@pytest.mark.parametrize(
    ("key", "symbol", "unit"),
    [
        ("k_T_n_per_m", "k_T", "N/m"), ("c_11_n_s_per_m", "c_11", "N s/m"), ("c_12_per_m", "c_12", "1/m"),
        ("delay_s", "delay", "s"), ("m_S_kg", "m_S", "kg"), ("eta_n_s", "eta", "N s"), ("B", "B", ""),
    ],
)  # fmt: skip
def test_symbols_and_units(key: str, symbol: str, unit: str) -> None:
    assert symbol_and_unit(key) == (symbol, unit)
