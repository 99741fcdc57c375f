"""The fit of the bundled study, run once as a user runs it: numbers against the truth, one JSON document, the files."""

import json
import re
import subprocess
from html import unescape
from pathlib import Path

import in_process
import numpy as np
import oracle
import pandas as pd
import pytest
from test_report import Balanced

from fasbody.constants import Z95
from fasbody.foot.parameters import symbol_and_unit
from identification.branches import ratio
from identification.estimates import RULE

TRUTH = {name: float(value) for name, value in oracle.TRUTH.items()}
KEYS = {"k_T_n_per_m": "k_T", "k_F_n_per_m": "k_F", "c_11_n_s_per_m": "c_11", "c_21_n_s_per_m": "c_21"}
PARAMETERS = {
    "k_T_n_per_m", "k_F_n_per_m", "c_11_n_s_per_m", "c_12_per_m", "c_13_per_m", "c_21_n_s_per_m", "c_22_per_m",
    "c_23_per_m",
}  # fmt: skip


@pytest.fixture(scope="module")
def bundled(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, Path, subprocess.CompletedProcess[str]]:
    """The fit's document, the folder of its files, and the finished command; test_report.py draws its figures."""
    folder = tmp_path_factory.mktemp("bundled")
    with pytest.MonkeyPatch.context() as patch:
        in_process.draw_nothing(patch)
        done = in_process.command("identification.fit", "--json", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), folder, done


def test_one_branch_is_the_truth(bundled: tuple) -> None:
    """Stiffness and damping within 3 % if the model is true, which it is here, and within three standard errors."""
    document, *_ = bundled
    branches = {b["name"]: b["parameters"] for b in document["branches"]}
    for key, name in KEYS.items():
        e = branches["stiff ankle"][key]
        assert abs(e["if_model_true"]["value"] / TRUTH[name] - 1) < 0.03, key
        assert abs(e["value"] - TRUTH[name]) < 3 * e["std_error"], key
    for key, name in {"c_12_per_m": "c_12", "c_22_per_m": "c_22", "c_23_per_m": "c_23"}.items():
        e = branches["stiff ankle"][key]
        assert abs(e["value"] - TRUTH[name]) < 3 * e["std_error"], key
    delay = branches["stiff ankle"]["delay_s"]
    assert abs(delay["value"] - 2e-4) < 3 * delay["std_error"] < 3e-5


def test_the_mirror_is_reported_and_is_worse(bundled: tuple) -> None:
    document, *_ = bundled
    true, mirror = document["branches"]
    assert (true["name"], mirror["name"]) == ("stiff ankle", "stiff pad")
    a = ratio([oracle.MASSES], {})
    p = mirror["parameters"]
    assert p["k_T_n_per_m"]["if_model_true"]["value"] == pytest.approx(a * TRUTH["k_F"], rel=0.2)  # two loads pull it
    assert p["k_F_n_per_m"]["if_model_true"]["value"] == pytest.approx(TRUTH["k_T"] / a, rel=0.2)
    assert mirror["cost"] > 100 * true["cost"]
    assert document["verdict"] == "decided"
    assert document["log_likelihood_ratio"] > np.log(1000)


def test_two_loads_weigh_the_leg(bundled: tuple) -> None:
    """Masses as stated are the truth. What the recordings take away is that of the interval which is printed."""
    document, folder, _ = bundled
    for mass, name in zip(document["masses"], ("m_S", "m_F"), strict=True):
        assert mass["name"] == name and mass["stated"] == pytest.approx(document["truth"][name])
        assert mass["lower"] < document["truth"][name] < mass["upper"]
        assert mass["weighed"] is (mass["learned"] > 0.3)
        half = 0.5 * np.log(mass["upper"] / mass["lower"]) / Z95
        assert 1 - mass["learned"] == pytest.approx(half / mass["prior_std"], rel=1e-6)
    assert sum(text.startswith("The recordings narrow m_S") for text in document["warnings"]) == 1
    scale = pd.read_csv(folder / "figures" / "scale.csv")  # of each interval, and not of that per kilogram
    assert len(scale) == 4 and (scale.per_kg_half_width_percent < 0.8 * scale.half_width_percent).all()
    assert "Two or more loads narrow the leg" in (folder / "report.html").read_text()


def test_goodness_of_fit_and_certificates(bundled: tuple) -> None:
    document, *_ = bundled
    goodness = document["goodness_of_fit"]
    assert goodness["dof"] == 2 * (6 + 6 + 5 + 4 + 3 + 2 + 2 + 2 + 2) + 2 * (6 + 4 + 2) - 9
    assert 1e-3 < goodness["p_value"] < 1 - 1e-3
    assert document["twin_mujoco_difference"] <= 1e-4  # of orbit and rollout, whose step is 5e-4 s
    assert document["base_acceleration_error"] <= 1e-6
    assert document["excitation_rank"] == 2 * (15 + 8)  # distinct lines without load and with 2.3 kg
    assert document["fit_percent"] > 98


def test_stdout_is_one_json_document_with_the_promised_keys(bundled: tuple) -> None:
    document, _, done = bundled
    assert json.loads(done.stdout) == document  # json.loads refuses anything before or after
    wanted = {"fit_percent", "recordings", "parameters", "branches", "verdict", "excitation_rank"}
    assert wanted | {"twin_mujoco_difference", "base_acceleration_error", "warnings"} <= set(document)
    assert set(document["parameters"]) >= PARAMETERS
    for e in document["parameters"].values():
        assert set(e) >= {"value", "std_error", "lower", "upper", "at_bound"}
    assert len(document["recordings"]) == 12
    for r in document["recordings"]:
        assert {"file", "frequency_hz", "fit_percent"} <= set(r)
        assert r["fit_percent"] > 95
    for b in document["branches"]:
        assert {"name", "cost", "fit_percent", "parameters"} <= set(b)
        assert set(b["parameters"]) >= PARAMETERS
    assert document["origin"] == "synthetic"
    assert document["truth"]["k_T"] == oracle.TRUTH["k_T"]
    assert "Traceback" not in done.stderr


def test_files_hold_the_same_numbers(bundled: tuple) -> None:
    document, folder, _ = bundled
    assert json.loads((folder / "result.json").read_text()) == document
    table = pd.read_csv(folder / "parameters.csv")
    assert len(table) == 2 * len(document["parameters"])
    best = table[table.branch == document["branches"][0]["name"]].set_index("parameter")
    for key, e in document["parameters"].items():
        assert best.loc[key, "value"] == pytest.approx(e["value"], rel=1e-6)
    assert sorted(f.name for f in folder.iterdir()) == ["figures", "parameters.csv", "report.html", "result.json"]


def test_bundled_report_shows_the_fit(bundled: tuple) -> None:
    document, folder, _ = bundled
    text = (folder / "report.html").read_text()
    page = Balanced()
    page.feed(text)
    assert page.outside == []
    for name in ("stiff ankle", "stiff pad", "50hz_0kg.csv", "truth"):
        assert name in text
    assert len(re.findall("<figure", text)) == 10  # no cascade of starts: descents that came to each end are counted
    for _, digest in document["provenance"]["sha256"].items():
        assert digest in text
    assert "fasbody fit --json --out" in document["provenance"]["command"] in unescape(text)
    assert document["source"] in text
    assert RULE in unescape(text)


def test_table_of_the_readme_is_what_the_fit_finds(bundled: tuple) -> None:
    """The README shows the end of `make fit`, which is this fit."""
    document, *_ = bundled
    readme = (Path(__file__).parent.parent / "README.md").read_text()
    number = r"([-\d.]+(?:[ \u202f]\d{3})*)"
    rows = re.findall(rf"^(\w+) \[[^]]*\] +{number} (±|to) {number}", readme, re.MULTILINE)
    shown = {name: (re.sub(r"[ \u202f]", "", a), word, re.sub(r"[ \u202f]", "", b)) for name, a, word, b in rows}
    assert set(shown) >= {"k_T", "k_F", "c_11", "c_21"}
    for key, found in document["parameters"].items():
        symbol, _ = symbol_and_unit(key)
        if symbol in shown:
            first, word, last = shown[symbol]
            assert abs(found["value" if word == "±" else "lower"] - float(first)) < 0.2 * found["std_error"], key
            assert word == "±" or abs(found["upper"] - float(last)) < 0.2 * found["std_error"], key
    assert f"recordings repeat within sensor noise; {document['verdict']}." in " ".join(readme.split())


def test_numbers_of_the_paper_are_those_of_the_fit(bundled: tuple) -> None:
    """Its two intervals of k_T are the README's, which the test above compares; the fit is that of both feet."""
    document, *_ = bundled
    root = Path(__file__).parent.parent
    paper = (root / "docs" / "paper" / "paper.md").read_text()
    row = next(line for line in (root / "README.md").read_text().splitlines() if line.startswith("k_T ["))
    whole, exact = re.search(r"(\d[\d ]* (?:to|±) \d+ \d+) .*?(± \d+)", row).groups()  # type: ignore[union-attr]
    assert f"is {exact} N/m with the model assumed exact, and {whole} N/m with model" in " ".join(paper.split())
    (percent,) = re.findall(r"both feet reach a fit of ([\d.]+) %", paper)
    assert {f"{branch['fit_percent']:.1f}" for branch in document["branches"]} == {percent}
