"""A study proposed from a folder: completed by what it says is missing, it reads; nothing is overwritten."""

import json
from pathlib import Path

import in_process
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.proposal import TABLES, propose
from fasbody.recording.study import Study

T = np.arange(2000) / 1000


def logger(file: Path, unit: str = "g", frequency: float = 20.0) -> None:
    """A TDMS file as a logger names its columns."""
    base = np.sin(2 * np.pi * frequency * T)
    later = 0.9 * np.sin(2 * np.pi * frequency * T - 0.2)
    file.parent.mkdir(parents=True, exist_ok=True)
    with TdmsWriter(file) as writer:
        about = {"wf_increment": 1e-3, "unit_string": unit}
        pairs = (("Shaker table", base), ("Ankle med", later))
        writer.write_segment([ChannelObject("g", name, x, properties=about) for name, x in pairs])


def test_names_say_subject_frequency_and_load(tmp_path: Path) -> None:
    for name, f in (("S1_20Hz_0kg", 20), ("S1_20Hz_2.3kg", 20), ("S12_30Hz_4p5kg", 30)):
        logger(tmp_path / "raw" / f"{name}.tdms", frequency=f)
    (tmp_path / "readme.txt").write_text("notes")
    (tmp_path / "lunch.csv").write_text("a,b\n1,2\n")
    found = propose(tmp_path)
    assert found.pattern == "raw/S{subject}_{frequency}Hz_{load}kg"
    assert found.count == 3 and found.left_out == ("lunch.csv",)
    assert found.missing == ("subjects.csv: mass_kg of 2 subjects",)
    found.write()
    people = tmp_path / "subjects.csv"
    people.write_text(
        people.read_text().replace("1,,,", "1,,,70").replace("12,,,70", "12,,,80").replace("12,,,\n", "12,,,80\n")
    )
    study = Study.read(tmp_path)
    told = [(r.condition.subject, r.condition.frequency_hz, r.condition.added_mass_kg) for r in study.recordings]
    assert told == [("1", 20, 0), ("1", 20, 2.3), ("12", 30, 4.5)]
    assert np.sqrt(2) * study.recordings[0].base_m_s2.std() == pytest.approx(9.80665)
    assert not study.check().problems


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    logger(tmp_path / "a1.tdms", unit="V")
    logger(tmp_path / "a2.tdms", unit="V")
    (tmp_path / "b.log").write_text("1 2\n3 4\n")
    found = propose(tmp_path)
    assert found.pattern == "a{any}" and found.left_out == ("b.log",)
    text = " ".join(found.missing)
    for what in ("channels.base.sensitivity", "added_mass_kg", "recordings.csv: subject", "frequency_hz of sines"):
        assert what in text
    bare = propose(tmp_path, "b")
    assert "study.toml: columns, for b.log has no header" in bare.missing


def test_names_without_a_subject_are_of_one_person(tmp_path: Path) -> None:
    """And of two schemes that are as frequent, neither is left out."""
    for name in ("run_10_bare", "run_20_bare", "run_10_knee", "run_20_knee"):
        logger(tmp_path / f"{name}.tdms")
    found = propose(tmp_path)
    assert found.left_out == () and "run_20_knee.tdms,1,,," in found.tables["recordings.csv"].splitlines()
    assert "\n1,,," in found.tables["subjects.csv"]
    assert "recordings.csv: subject, if these are not all of one person, who is called 1" in found.missing


def test_patterns(tmp_path: Path) -> None:
    logger(tmp_path / "left-7-at-25.tdms")
    found = propose(tmp_path, "{any}-{subject}-at-{frequency}")
    assert "left-7-at-25.tdms,7,,,25" in found.tables["recordings.csv"]
    with pytest.raises(SettingError, match=r"unknown field 'hz' \(valid: subject, posture, load, mass"):
        propose(tmp_path, "{hz}")
    with pytest.raises(InputFileError, match=r"no file is named S\{subject\}; the first is left-7-at-25"):
        propose(tmp_path, "S{subject}")


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    logger(tmp_path / "S1_20Hz_0kg.tdms")
    for name in TABLES:
        (tmp_path / name).write_text("mine")
        with pytest.raises(InputFileError, match=rf"{name}: exists, and nothing is overwritten"):
            propose(tmp_path)
        assert (tmp_path / name).read_text() == "mine"
        (tmp_path / name).unlink()


def test_the_command(tmp_path: Path) -> None:
    logger(tmp_path / "S1_20Hz_0kg.tdms")
    words = ["fasbody.recording", "init", str(tmp_path), "--json"]
    done = in_process.command(*words)
    assert json.loads(done.stdout)["pattern"] == "S{subject}_{frequency}Hz_{load}kg"
    again = in_process.command(*words[:-1])
    assert again.returncode == 0 and "lists them all; nothing is added" in again.stdout.replace("\n", " ")


@pytest.mark.parametrize(
    ("name", "factor", "missing"),
    [("Elapsed (ms)", 1e3, ""), ("Zeit (ms)", 1e3, ""), ("Uhr", 1.0, "channels.time.unit")],
)
def test_a_column_that_rises_evenly_is_the_time_under_any_name(
    tmp_path: Path, name: str, factor: float, missing: str
) -> None:
    """At 2000 Hz, as it was sampled, and with decimal commas."""
    t = np.arange(4000) / 2000
    base, later = (a * np.sin(40 * np.pi * t - lag) for a, lag in ((1.0, 0.0), (0.9, 0.2)))
    rows = [";".join(f"{x:.6f}".replace(".", ",") for x in row) for row in zip(t * factor, base, later, strict=True)]
    (tmp_path / "S1_20Hz_0kg.csv").write_text(f"{name};Base [g];Ankle [g]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    found = propose(tmp_path)
    assert f'[channels.time]\ncolumn = "{name}"' in found.tables["study.toml"]
    assert "sampling_rate_hz" not in found.tables["study.toml"]
    assert any(missing in text for text in found.missing) == bool(found.missing)
    assert any("channels.time.unit" in text for text in found.missing) == bool(missing)
    if not missing:
        found.write()
        (tmp_path / "subjects.csv").write_text("subject,mass_kg\n1,70\n")
        assert Study.read(tmp_path).recordings[0].rate_hz == pytest.approx(2000)


def test_several_schemes_of_names_persons_by_word_and_masses(tmp_path: Path) -> None:
    for name in ("S1_20Hz_0kg", "S2_30Hz_0kg", "P3 at 25 Hz", "anna_61kg_20Hz_2.3kg", "bert_80kg_20Hz_0kg"):
        logger(tmp_path / f"{name}.tdms")
    (tmp_path / "lunch.csv").write_text("a,b\n1,2\n")
    found = propose(tmp_path)
    table = found.tables["recordings.csv"]
    for line in ("S1_20Hz_0kg.tdms,1,,0,20", "P3 at 25 Hz.tdms,3,,,25", "anna_61kg_20Hz_2.3kg.tdms,anna,,2.3,20",
                 "bert_80kg_20Hz_0kg.tdms,bert,,0,20"):  # fmt: skip
        assert line in table.splitlines()
    assert found.pattern.count(" or ") == 2 and found.left_out == ("lunch.csv",)
    assert "anna,,,61" in found.tables["subjects.csv"] and "bert,,,80" in found.tables["subjects.csv"]
    assert found.missing == (
        "recordings.csv: added_mass_kg, which the names do not say", "subjects.csv: mass_kg of 3 subjects"
    )  # fmt: skip


def test_a_growing_folder_gets_a_line_for_each_new_recording(tmp_path: Path) -> None:
    logger(tmp_path / "S1_20Hz_0kg.tdms")
    propose(tmp_path).write()
    people, toml = tmp_path / "subjects.csv", (tmp_path / "study.toml").read_text()
    people.write_text("sex,subject,mass_kg\nf,1,70\n")
    logger(tmp_path / "S1_30Hz_0kg.tdms", frequency=30.0)
    logger(tmp_path / "S2_20Hz_2.3kg.tdms")
    grown = propose(tmp_path)
    assert (grown.count, sorted(grown.tables)) == (2, ["recordings.csv", "subjects.csv"])
    grown.write()
    assert people.read_text() == "sex,subject,mass_kg\nf,1,70\n,2,\n" and (tmp_path / "study.toml").read_text() == toml
    people.write_text(people.read_text().replace(",2,", "m,2,80"))
    assert len(Study.read(tmp_path).recordings) == 3 and not propose(tmp_path).tables
    people.write_text(people.read_text().replace(",", ";"))
    logger(tmp_path / "S3_20Hz_2.3kg.tdms")
    with pytest.raises(InputFileError, match="is not separated by commas"):
        propose(tmp_path)
