"""Jobs and their keys: what is fitted together, and what makes a new key."""

import dataclasses
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from study_runs import small

from fasbody import runner
from fasbody.exceptions import SettingError
from fasbody.foot.model import Foot
from fasbody.recording.study import Study, StudyFolder
from identification.fitting import Settings
from identification.study import plan
from identification.study.plan import Model, Plan, select


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small(tmp_path_factory.mktemp("plan") / "study", subjects=2)


def planned(folder: Path, foot: Foot, mode: str = "per-recording", **settings: object) -> list[str]:
    opened = StudyFolder.open(folder)
    plan = Plan(opened, opened.trials, dataclasses.replace(Settings(departures=False), **settings), Model.of(foot))  # type: ignore[arg-type]
    return [job.key for job in plan.jobs(mode)]


def test_modes_take_together_what_they_say(study: Path, foot: Foot) -> None:
    opened = StudyFolder.open(study)
    plan = Plan(opened, opened.trials, Settings(departures=False), Model.of(foot))
    each, pooled = (plan.jobs(mode) for mode in ("per-recording", "pooled"))
    assert [len(job.trials) for job in each] == [1] * 8
    assert [(j.subject, j.added_mass_kg, len(j.trials)) for j in pooled] == [
        (s, m, 2) for s in ("1", "2") for m in (0.0, 2.3)
    ]
    assert each[0].frequency_hz == 20.0 and pooled[0].frequency_hz is None
    assert len({job.key for jobs in (each, pooled) for job in jobs}) == 8 + 4
    with pytest.raises(SettingError, match="unknown mode 'polled', did you mean 'pooled'"):
        plan.jobs("polled")


def test_keys_follow_content_and_settings_only(study: Path, foot: Foot, tmp_path: Path) -> None:
    first = planned(study, foot)
    assert planned(study, foot) == first
    for file in (study / "recordings").iterdir():
        os.utime(file, (1, 1))
    assert planned(study, foot) == first
    assert planned(study, foot, threads=3) == first
    for changed in (
        {"starts": 3},
        {"seed": 1},
        {"domain": "time"},
        {"free": ("k_T",)},
        {"bounds": {"k_T": (1e4, 1e6)}},
    ):
        assert not set(planned(study, foot, **changed)) & set(first), changed
    assert not set(planned(study, foot.with_values({"k_T": 2e5}))) & set(first)

    table = (study / "recordings.csv").read_text()
    other = tmp_path / "renamed"
    (other / "recordings").mkdir(parents=True)
    for name in ("study.toml", "subjects.csv"):
        (other / name).write_text((study / name).read_text())
    for file in (study / "recordings").iterdir():
        (other / "recordings" / f"new_{file.name}").write_bytes(file.read_bytes())
    (other / "recordings.csv").write_text(table.replace("recordings/", "recordings/new_"))
    assert planned(other, foot) == first

    file = next((other / "recordings").glob("*_20hz.csv"))
    lines = file.read_text().splitlines()
    lines[-1] = lines[-1][:-1] + str((int(lines[-1][-1]) + 1) % 10)  # the last digit of one sample
    file.write_text("\n".join(lines) + "\n")
    assert len(set(planned(other, foot)) - set(first)) == 1
    (other / "subjects.csv").write_text((study / "subjects.csv").read_text().replace("\n2,22,1.75,", "\n2,22,1.75,1"))
    assert len(set(planned(other, foot)) & set(first)) <= 4  # another body mass: that subject's keys are new


def test_seatings_are_read_where_the_table_has_them(study: Path, foot: Foot, tmp_path: Path) -> None:
    """An optional column; a cell that is empty says nothing, and only what it changes is computed again."""
    shutil.copytree(study, tmp_path, dirs_exist_ok=True)
    header, first, second, *others = (study / "recordings.csv").read_text().splitlines()
    rows = [f"{header},seating", f"{first}, first  morning ", f"{second},first morning", *(f"{row}," for row in others)]
    (tmp_path / "recordings.csv").write_text("\n".join(rows))
    seatings = [trial.condition.seating for trial in StudyFolder.open(tmp_path).trials]
    assert seatings == ["first morning"] * 2 + [""] * 6
    assert Study.read(tmp_path).recordings[0].condition.seating == "first morning"
    assert [a == b for a, b in zip(planned(study, foot), planned(tmp_path, foot), strict=True)] == [False] * 2 + [
        True
    ] * 6
    assert {trial.condition.seating for trial in StudyFolder.open(study).trials} == {""}


def test_a_model_travels_whole(foot: Foot) -> None:
    again = Model.of(foot).foot()
    assert again.values() == foot.values()
    assert again.name == foot.name
    assert (again.model.body_mass == foot.model.body_mass).all()


def test_filters(study: Path) -> None:
    trials = StudyFolder.open(study).trials
    chosen = select(trials, subject=("2",), posture=None, frequency_hz=(30.0,))
    assert [(t.condition.subject, t.condition.frequency_hz) for t in chosen] == [("2", 30.0)] * 2
    with pytest.raises(SettingError, match=r"unknown subject '9' \(valid: 1, 2\) in this study"):
        select(trials, subject=("9",))
    assert len(select(trials)) == 8


def test_what_cannot_be_meant(study: Path, foot: Foot) -> None:
    opened = StudyFolder.open(study)
    for settings, said in (
        (Settings(departures=False, starts=0), "starts is 0"),
        (Settings(departures=False, domain="tme"), "did you mean 'time'"),
    ):
        with pytest.raises(SettingError, match=said):
            Plan(opened, opened.trials, settings, Model.of(foot))


def test_all_that_a_job_runs_is_part_of_its_key() -> None:
    """What Python itself loads for a job is keyed, and what only shows a result is not."""
    names = "getattr(module, '__file__', '') for module in sys.modules.values()"
    code = f"import sys, identification.study.job\nprint(*({names}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    root = Path(plan.__file__).parents[2]
    ours = {Path(f) for f in loaded if any(Path(f).is_relative_to(root / p) for p in ("fasbody", "identification"))}
    keyed = set(runner.sources(plan.COMPUTES))
    assert len(ours) > 40
    assert {file.name for file in ours - keyed} <= {
        "console.py",
        "presentation.py",
        "runner.py",
        "__init__.py",
    }  # they compute nothing
    names = {file.relative_to(root / "identification").as_posix() for file in keyed if "identification" in file.parts}
    assert {"study/validation.py", "study/profile.py", "optimiser.py"} <= names
    assert not {"study/report.py", "study/figures.py", "study/summary.py", "fit.py", "report.py", "figures.py"} & names
