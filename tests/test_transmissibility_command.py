"""`python -m fasbody.transmissibility`, `check` and `convert` as commands: what they write, print and refuse."""

import json
import subprocess
from pathlib import Path

import in_process
import pytest
from transmissibility_cases import KEYS, recording, virtual_study

from fasbody.exceptions import RecordingError
from fasbody.recording.recording import Recording
from fasbody.recording.study import StudyFolder
from fasbody.transmissibility.table import Table


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return virtual_study(tmp_path_factory.mktemp("made"), subjects=1)


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return in_process.command("fasbody.transmissibility", *arguments)


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_command_writes_tables_and_figures_and_prints_one_json_list(tmp_path: Path) -> None:
    study = virtual_study(tmp_path / "made", subjects=3)
    done = command(str(study), "--json", "--out", str(tmp_path / "out"), "--jobs", "1")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert len(document) == 3 * 5 * 9 * 3 and set(document[0]) == KEYS
    for name in ("transmissibility.csv", "transmissibility.nc", "resonances.csv", "findings.csv", "against_unity.csv"):
        assert (tmp_path / "out" / name).stat().st_size > 100
    figures = sorted(p.name for p in (tmp_path / "out").glob("*.png"))
    assert figures == sorted(
        [f"{s}_{p}.png" for s in ("loads", "postures") for p in ("MB", "TB", "TM", "mean")] + ["single_mass.png"]
    )


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(study: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    done = command(str(study), "--out", str(tmp_path / "out"), "--jobs", "1")
    assert done.returncode == 2 and "is a file; name a folder" in done.stderr.replace("\n", " ")
    assert done.stdout == ""


def test_one_recording_of_a_study_is_corrected_as_its_study_says(study: Path) -> None:
    printed = command(str(study / "recordings" / "s01_midstance_2.3kg_30hz.h5"), "--out", str(study / "one")).stdout
    assert "2.3 kg" in printed and "[deg]" in printed  # brackets are no markup
    done = command(str(study / "recordings" / "s01_midstance_2.3kg_30hz.h5"), "--json")
    document = json.loads(done.stdout)
    assert {row["added_mass_kg"] for row in document} == {2.3}
    assert "gain and delay stated in study.toml (malleolus, tuberosity)" in done.stderr


def test_one_recording_and_no_tuberosity(tmp_path: Path) -> None:
    r = recording()
    Recording(r.time_s, r.base_m_s2, r.malleolus_m_s2).write(tmp_path / "20hz.csv")
    done = command(str(tmp_path / "20hz.csv"), "--json")
    (row,) = json.loads(done.stdout)
    assert row["pair"] == "MB" and row["transmissibility"] == pytest.approx(1.3, rel=1e-3)


def test_unusable_recordings_are_named_and_the_others_used(study: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(study, tmp_path / "s")
    table = tmp_path / "s" / "recordings.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:19]))  # 18 are enough
    (tmp_path / "s" / "recordings" / "s01_midstance_0kg_10hz.h5").write_bytes(b"nothing")
    done = command(str(tmp_path / "s"), "--json", "--jobs", "1")
    assert done.returncode == 2
    assert "1 of 18 recordings could not be used" in done.stderr and "s01_midstance_0kg_10hz.h5" in done.stderr
    assert "Traceback" not in done.stderr
    assert len(json.loads(done.stdout)) == 3 * 17


def test_a_study_without_any_usable_recording(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text("")
    (tmp_path / "subjects.csv").write_text("subject,mass_kg\n1,70\n")
    (tmp_path / "recordings.csv").write_text("file,subject,added_mass_kg\nmissing.csv,1,0\n")
    with pytest.raises(RecordingError, match=r"missing.csv: no such file"):
        Table.of(StudyFolder.open(tmp_path))


def test_check_and_convert(tmp_path: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return in_process.command("fasbody.recording", *arguments)

    recording().write(tmp_path / "a.csv")
    assert run("convert", str(tmp_path / "a.csv"), str(tmp_path / "b.tdms")).returncode == 0
    told = run("check", str(tmp_path / "b.tdms"), "--json")
    (row,) = json.loads(told.stdout)["recordings"]
    assert (told.returncode, row["samples"], row["frequency_hz"]) == (0, 10_000, pytest.approx(20, abs=1e-3))
    silence = "".join(f"{i / 1000},0,0\n" for i in range(99))
    (tmp_path / "c.csv").write_text("time_s,base_m_s2,malleolus_m_s2\n" + silence)
    told = run("check", str(tmp_path / "c.csv"))
    assert told.returncode == 2 and "is dead" in told.stderr and "Traceback" not in told.stderr
    again = run("convert", str(tmp_path / "a.csv"), str(tmp_path / "b.tdms"))
    assert again.returncode == 2 and "exists" in again.stderr
    told = run("convert", str(tmp_path / "c.csv"), str(tmp_path / "c.mat"), "--matlab", "7.3")
    assert told.returncode == 0 and "warning: It cannot be used as it is. c.csv: base_m_s2 is dead" in told.stderr
    assert (tmp_path / "c.mat").read_bytes().startswith(b"MATLAB 7.3")
    told = run("convert", str(tmp_path / "c.csv"), str(tmp_path / "c2.csv"), "--matlab", "7.3")
    assert told.returncode == 2 and "--matlab 7.3 is for .mat files" in told.stderr
    assert not (tmp_path / "c2.csv").exists()
    backwards = "".join(f"{1 - i / 1000},{i % 9},{i % 7}\n" for i in range(99))
    (tmp_path / "e.csv").write_text("time_s,base_m_s2,malleolus_m_s2\n" + backwards)
    told = run("convert", str(tmp_path / "e.csv"), str(tmp_path / "e.h5"))
    assert told.returncode == 2 and "time runs backwards" in told.stderr and not (tmp_path / "e.h5").exists()
    uneven = "".join(f"{(i / 100) ** 2},{i % 9},{i % 7}\n" for i in range(99))
    (tmp_path / "d.csv").write_text("time_s,base_m_s2,malleolus_m_s2\n" + uneven)
    told = run("convert", str(tmp_path / "d.csv"), str(tmp_path / "d.tdms"))
    assert told.returncode == 2 and "this recording's time is not uniform; write .csv or .h5" in told.stderr
    told = run("convert", str(tmp_path / "d.csv"), str(tmp_path / "d.h5"))
    assert told.returncode == 0 and "warning: It cannot be used as it is." in told.stderr
