"""Files that no study lists: what their names state counts, and `check` compares them with each other."""

import json
from pathlib import Path

import in_process
import numpy as np
import pytest

from fasbody.exceptions import SettingError
from fasbody.foot.model import load
from fasbody.recording.checks import checked
from fasbody.recording.file_names import condition_in_name
from fasbody.recording.recording import Recording
from fasbody.recording.sources import gather
from fasbody.recording.study import BUNDLED, Study, StudyFolder, read_file
from fasbody.transmissibility.table import Table
from identification.fitting import Settings
from identification.study.plan import Model, Plan

T = np.arange(2000) / 1000


def mass_on_a_spring(frequency_hz: float, resonance_hz: float = 30.0, loss: float = 0.3) -> complex:
    """Its motion over that of its base, by the equation of motion."""
    stiffness = 1 + 1j * loss
    return stiffness / (stiffness - (frequency_hz / resonance_hz) ** 2)


def write(file: Path, frequency_hz: float, H: complex) -> Path:
    turn = 9 * np.exp(2j * np.pi * frequency_hz * T)
    Recording(T, turn.real, (H * turn).real).write(file)
    return file


@pytest.mark.parametrize(
    ("name", "subject", "posture", "load", "frequency"),
    [
        ("S16_20Hz_2.3kg.csv", "16", "midstance", 2.3, 20.0),
        ("subject 3 dorsiflexion 12,5 Hz.uff", "3", "dorsiflexion", 0.0, 12.5),
        ("vp04_sweep.mat", "04", "midstance", 0.0, None),
        ("rec_10s_2.csv", "", "midstance", 0.0, None),  # seconds are no subject
        ("S1_S2_10Hz_20Hz.csv", "", "midstance", 0.0, None),  # two of each are none
        ("anna_61kg_4p5kg.csv", "", "midstance", 4.5, None),
    ],
)
def test_what_a_name_states(
    name: str, subject: str, posture: str, load: float, frequency: float | None
) -> None:
    c = condition_in_name(name)
    assert (c.subject, c.posture, c.added_mass_kg, c.frequency_hz) == (subject, posture, load, frequency)


def test_a_file_has_the_conditions_of_its_name(tmp_path: Path) -> None:
    read = read_file(write(tmp_path / "S16_20Hz_2.3kg.csv", 20.003, 1.2 - 0.5j))
    assert (read.condition.subject, read.condition.added_mass_kg) == ("16", 2.3)
    assert read.condition.frequency_hz == 20.0 and read.condition.body_mass_kg is None
    assert checked(read).condition.frequency_hz == pytest.approx(20.003, abs=1e-3)
    wrong = read_file(write(tmp_path / "S16_25Hz.csv", 20.0, 1.2 - 0.5j))
    assert wrong.condition.frequency_hz is None
    assert wrong.warnings == ("S16_25Hz.csv: its name states 25 Hz, and its base vibrates at 20 Hz.",)
    assert read_file(write(tmp_path / "log_1000Hz.csv", 20.0, 1.2 - 0.5j)).warnings == ()


def test_files_of_two_people_are_two_subjects_at_one_frequency(tmp_path: Path) -> None:
    """Their frequencies differ by a thousandth, and their names by the subject."""
    files = [
        write(tmp_path / f"S{who}_{f}Hz.csv", f + 1e-2 * who, size * mass_on_a_spring(f))
        for who, size in ((1, 1.0), (2, 1.1)) for f in (10, 20)
    ]  # fmt: skip
    curves = Table.of_recordings([read_file(file) for file in files]).curves("MB", "midstance", 0.0)
    assert curves.subjects == ("1", "2") and list(curves.frequency_hz) == [10.0, 20.0]
    np.testing.assert_allclose(curves.T[1] / curves.T[0], 1.1, rtol=2e-3)


def test_a_body_mass_in_a_name_counts(tmp_path: Path) -> None:
    file = write(tmp_path / "anna_61kg_20Hz.csv", 20.0, 1.2 - 0.5j)
    assert gather([file], None, None)[1][0].condition.body_mass_kg == 61.0
    assert gather([file], [61.0], None)[1][0].condition.body_mass_kg == 61.0
    with pytest.raises(SettingError, match=r"its name says 61 kg, and --body-mass says 70 kg"):
        gather([file], [70.0], None)


@pytest.mark.parametrize("named", [True, False])
def test_check_compares_bare_files(tmp_path: Path, named: bool) -> None:
    """Six sines of a mass on a spring, one of them with its malleolus twice as large."""
    who = "S4_" if named else "run_"
    for f in (10, 15, 20, 25, 35, 45):
        write(tmp_path / f"{who}{f}Hz.csv", f, (2.0 if f == 25 else 1.0) * mass_on_a_spring(f))
    done = in_process.command("fasbody.recording", "check", *map(str, sorted(tmp_path.glob("*.csv"))))
    warned = [line for line in done.stderr.splitlines() if "as expected from" in line]
    assert len(warned) == 1 and f"{who}25Hz.csv: the malleolus moves 2" in warned[0]
    assert ("if of one person" in warned[0]) != named


def test_a_subject_without_a_mass_is_checked_and_can_be_given_one(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", 20.0, 1.2 - 0.5j)
    (tmp_path / "study.toml").write_text("")
    (tmp_path / "subjects.csv").write_text("subject,mass_kg\n1,\n2,\n")
    (tmp_path / "recordings.csv").write_text("file,subject,added_mass_kg\na.csv,1,2.3\n")
    assert not Study.read(tmp_path).check().problems
    done = in_process.command("fasbody.recording", "check", str(tmp_path), "--json", "--jobs", "1")
    assert done.returncode == 0 and json.loads(done.stdout)["recordings"][0]["subject"] == "1"
    folder = StudyFolder.open(tmp_path)
    plan = Plan(folder, folder.trials, Settings(), Model.of(load("two_dof")))
    work = plan.work(plan.jobs("pooled")[0])
    assert not work.recordings and "no mass_kg of subject '1'" in work.unread[0]
    for data in (tmp_path, tmp_path / "a.csv"):
        condition = gather([data], [70.0], None)[1][0].condition
        assert (condition.body_mass_kg, condition.added_mass_kg) == (70.0, 2.3)


@pytest.mark.parametrize(("columns", "left_out"), [("", 0), ("200", 0), ("80", 4), ("60", 7)])
def test_numbers_of_a_narrow_table_are_whole(columns: str, left_out: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In 80 columns it read "excitat...", "1..." and had no drift."""
    monkeypatch.setenv("COLUMNS", columns)
    done = in_process.command("fasbody.recording", "check", str(BUNDLED), "--jobs", "1")
    lines = done.stdout.splitlines()
    row = next(line for line in lines if line.startswith("10hz_2.3kg.csv"))
    numbers = ["4000", "1000", "10", "1.585", "-13.6", "6.33", "10", "1.0000", "3.4", "0.055", "0.14"]
    every = ["10hz_2.3kg.csv", "sound", *numbers]
    note = "".join(line for line in lines if line.startswith("columns that this terminal"))
    assert len(row) <= int(columns or 120) and "…" not in done.stdout
    assert set(row.split()) <= set(every) and {"1.0000", "3.4", "0.055"} <= set(row.split())
    assert len(every) - len(row.split()) == left_out == (note.count(",") + 1 if note else 0)
