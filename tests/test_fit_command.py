"""`python -m identification.fit` as a user meets it: files and options that work, one sentence and exit 2 otherwise."""

import json
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import oracle
import pandas as pd
import pytest

from fasbody import console
from fasbody.recording.recording import Recording
from fasbody.recording.study import BUNDLED
from identification.fit import app


@pytest.fixture
def fit(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable:
    """Run the command in this process: exit code, stdout, stderr."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["identification.fit", *map(str, arguments)])
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("COLUMNS", "300")
        with pytest.raises(SystemExit) as stop:
            console.command_line(app)
            raise SystemExit(0)
        out, err = capsys.readouterr()
        return int(stop.value.code or 0), out, err

    return run


@pytest.fixture
def bare(tmp_path: Path, trial: Callable[..., Recording]) -> Path:
    """One CSV file without any description."""
    trial(oracle.TRUTH, 20.0, seconds=1.0).write(tmp_path / "20hz.csv")
    return tmp_path / "20hz.csv"


def test_bare_file_with_masses(fit: Callable, bare: Path) -> None:
    """The frequency is found; the masses come from the command line."""
    arguments = (bare, "--body-mass", 72.57, "--added-mass", 0, "--free", "k_T,k_F", "--starts", 1, "--json")
    code, out, err = fit(*arguments)
    assert code == 0, err
    document = json.loads(out)
    assert document["recordings"][0]["frequency_hz"] == pytest.approx(20, abs=0.01)
    assert set(document["parameters"]) == {"k_T_n_per_m", "k_F_n_per_m"}
    assert not any("body mass" in text for text in document["warnings"])
    assert not (Path.cwd() / "results").exists()  # --json alone writes no files
    heavy = json.loads(fit(*arguments[:4], 4.5, *arguments[5:])[1])
    change = heavy["parameters"]["k_T_n_per_m"]["value"] / document["parameters"]["k_T_n_per_m"]["value"]
    assert change > 1.1  # more mass, more stiffness for the same motion


@pytest.mark.usefixtures("undrawn")  # test_report.py draws
def test_table_for_people_and_default_folder(fit: Callable, bare: Path) -> None:
    code, out, err = fit(bare, "--body-mass", 72.57, "--free", "k_T,c_11", "--starts", 1, "--bounds", "k_T=1e5:1.5e5")
    assert code == 0, err
    assert "k_T [N/m]" in out
    assert "95 %" in out
    assert "report.html" in err
    written = list(Path.cwd().glob("results/*/*"))
    assert sorted(file.name for file in written) == ["figures", "parameters.csv", "report.html", "result.json"]
    assert out.index("k_T [N/m]") >= 0 and "figures/ beside it" in err


BAD = {
    "twice": (("{bare}", "{copy}"), "20hz.csv and copy.csv are the same recording (sha256 of the samples "),
    "nothing there": (("none.csv",), "none.csv: no such file or folder"),
    "no study": (("{tmp}",), "study.toml: no such file"),
    "no number": (("{bad}",), r"bad.csv, line 3: base_m_s2 is 'oops', not a number"),
    "dead": (("{dead}",), "dead.csv: malleolus_m_s2 is dead"),
    "model": (("{bare}", "--model", "none.xml"), "none.xml: no such model"),
    "free": (("{bare}", "--free", "k_X"), "unknown parameter to estimate 'k_X'"),
    "bounds": (("{bare}", "--bounds", "k_T=5"), "--bounds 'k_T=5' is not NAME=LOWER:UPPER"),
    "bounds order": (("{bare}", "--bounds", "k_T=2e5:1e5"), "bounds of k_T are 200000:100000"),
    "body mass": (("{bare}", "--body-mass", "5"), "the body mass is 5 kg; it must lie between 20 and 300 kg"),
    "added mass": (("{bare}", "--added-mass", "-1"), "the added mass is -1 kg"),
    "starts": (("{bare}", "--starts", "0"), "the number of starts is 0"),
    "domain": (("{bare}", "--domain", "laplace"), "the domain is 'laplace'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gets_one_sentence_and_exit_2(fit: Callable, bare: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "bad.csv").write_text("time_s,base_m_s2,malleolus_m_s2\n0,1,2\n0.001,oops,2\n")
    frame = pd.read_csv(bare)
    frame["malleolus_m_s2"] = 0.0
    frame.to_csv(tmp_path / "dead.csv", index=False)
    shutil.copy(bare, tmp_path / "copy.csv")
    arguments, sentence = BAD[name]
    places = {
        "copy": tmp_path / "copy.csv",
        "tmp": tmp_path,
        "bad": tmp_path / "bad.csv",
        "dead": tmp_path / "dead.csv",
        "bare": bare,
    }
    for extra in ((), ("--json",)):
        code, out, err = fit(*(a.format(**places) for a in arguments), *extra)
        assert code == 2, err
        assert out == ""
        assert sentence in err
        assert "Traceback" not in err
        assert err.strip().startswith("error: ")
        assert len(err.strip().splitlines()) == 1
        assert not Path("results").exists()


def test_a_missing_element_of_a_model_gets_the_sentence(fit: Callable, bare: Path, edited: Callable[..., Path]) -> None:
    file = edited(('<framelinacc name="malleolus"', '<framelinacc name="ankle"'))
    code, _, err = fit(bare, "--model", file)
    assert code == 2
    assert "there is no sensor 'malleolus' (valid: base, ankle, foot)" in err
    assert "every foot model needs joint base, actuator shaker, sensor base and malleolus, site malleolus." in err


def test_an_edited_model_that_keeps_the_names_is_fitted(fit: Callable, bare: Path, edited: Callable[..., Path]) -> None:
    other_names = ('name="shank"', 'name="leg"'), ("| body shank mass |", "| body leg mass |")
    file = edited(*other_names, ('stiffness="1.5e5"', 'stiffness="1.2e5"'))
    code, out, err = fit(bare, "--model", file, "--body-mass", 72.57, "--free", "k_T", "--starts", 1, "--json")
    assert code == 0, err
    assert json.loads(out)["model"] == "edited.xml"


def test_interrupted_before_anything_is_130(fit: Callable, bare: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("identification.fitting.fit_foot", stop)
    code, _, err = fit(bare)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ended processes take none; this goes on
    assert code == 130
    assert "interrupted" in err
    assert not Path("results").exists()


def test_a_study_given_twice_as_files_and_folder(fit: Callable, tmp_path: Path) -> None:
    """A folder with one recording left in its table."""
    shutil.copytree(BUNDLED, tmp_path / "s")
    table = (tmp_path / "s" / "recordings.csv").read_text().splitlines()
    (tmp_path / "s" / "recordings.csv").write_text("\n".join([table[0], table[3]]) + "\n")
    code, out, err = fit(tmp_path / "s", "--free", "k_T,k_F", "--starts", 1, "--json")
    assert code == 0, err
    document = json.loads(out)
    assert [r["file"] for r in document["recordings"]] == ["s/recordings/20hz_0kg.csv"]
    assert np.isfinite(document["fit_percent"])
