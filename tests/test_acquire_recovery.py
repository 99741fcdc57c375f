"""Recovering several captures, and studies that already hold something: nothing is mixed, nothing overwritten."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_acquire_folder import CONDITION, capture_of, sine_frames
from test_acquire_refusals import refusal

from fasbody.acquire import folder
from fasbody.acquire.capture import Capture
from fasbody.acquire.commands import app
from fasbody.acquire.conversion import convert
from fasbody.acquire.plan import Plan
from fasbody.acquire.recovery import grouped
from fasbody.exceptions import AcquisitionError, InputFileError
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study


def rest_of(file: Path, host: float, wire: bytes) -> Path:
    """What goes on when the disk of a capture became full."""
    capture = Capture(file.with_name(f"{file.stem}_rest_x.fascap"))
    capture.add("B", host, wire)
    capture.close()
    return capture.file


def test_each_capture_becomes_its_own_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = capture_of(tmp_path, "20hz_0kg", sine_frames(60))
    second = capture_of(tmp_path, "20hz_0kg_2", sine_frames(90))
    capsys.readouterr()
    app(["recover", str(first), str(second), "--json"], standalone_mode=False)
    documents = json.loads(capsys.readouterr().out)
    assert [one["samples"] for one in documents] == [960, 1440]
    assert sorted(one.time_s.size for one in Study.read(tmp_path).recordings) == [960, 1440]
    with pytest.raises(InputFileError, match=r"20hz_0kg_2\.fascap: is a recording of its own, not the rest of"):
        convert([first, second], tmp_path)


def test_bad_capture_among_good_ones_costs_only_itself(tmp_path: Path) -> None:
    first = capture_of(tmp_path, "a", sine_frames(60))
    gap = capture_of(tmp_path, "b", sine_frames(60, missing=(20,)))
    none = capture_of(tmp_path, "c", b"")
    last = capture_of(tmp_path, "d", sine_frames(60))
    with pytest.raises(AcquisitionError) as caught:
        app(["recover", *map(str, (first, gap, none, last))], standalone_mode=False)
    assert "b.csv is written and not listed" in str(caught.value) and "c.fascap: " in str(caught.value)
    assert [Path(one.file).name for one in Study.read(tmp_path).recordings] == ["a.csv", "d.csv"]


def test_rest_of_a_full_disk_joins_the_capture_that_it_continues(tmp_path: Path) -> None:
    frames = sine_frames(120)
    half = len(frames) // 2
    file = capture_of(tmp_path, "20hz_0kg", frames[:half])
    rest = rest_of(file, 0.97, frames[half:])
    other = capture_of(tmp_path, "later", sine_frames(300))
    assert grouped([rest, file]) == [(file, rest)]
    app(["recover", str(rest), str(file)], standalone_mode=False)
    assert Recording.read(tmp_path / "recordings" / "20hz_0kg.csv").time_s.size == 1920
    strange = rest_of(other, 4000.0, frames[half:])
    with pytest.raises(InputFileError, match="continues none of the other files"):
        grouped([file, strange])


def test_same_file_twice_is_refused(tmp_path: Path) -> None:
    file = capture_of(tmp_path, "20hz_0kg", sine_frames(60))
    link = tmp_path / "captures" / "link.fascap"
    link.symlink_to(file)
    assert refusal("recover", str(file), str(link)).startswith(f"{link}: is given twice")
    with pytest.raises(InputFileError, match="is given twice"):
        convert([file, file], tmp_path)


def test_recovering_into_another_study_overwrites_and_mixes_nothing(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    own = convert([capture_of(there, "20hz_0kg", sine_frames(60))], there).file
    before = own.read_bytes()
    foreign = capture_of(here, "20hz_0kg", sine_frames(90))
    for _ in range(2):  # the second time it is known again
        made = convert([foreign], there)
        assert made.file.name == "20hz_0kg_2.csv" and made.recording.time_s.size == 1440
    assert own.read_bytes() == before and len(Study.read(there).recordings) == 2
    assert folder.stem_of(there, there / "captures" / "20hz_0kg.fascap", None) == "20hz_0kg"
    waiting = capture_of(there, "25hz_0kg", sine_frames(60))  # not converted yet: its name is taken
    assert convert([capture_of(here, "25hz_0kg", sine_frames(60))], there).file.name == "25hz_0kg_2.csv"
    assert convert([waiting], there).file.name == "25hz_0kg.csv"
    toml = there / "study.toml"
    toml.write_text(toml.read_text().replace("measured", "synthetic"))
    with pytest.raises(InputFileError, match="is not measured data"):
        convert([capture_of(here, "30hz_0kg", sine_frames(60))], there)
    assert not list(there.glob("recordings/30hz*"))


def test_two_captures_of_one_name_are_told_apart_by_their_start(tmp_path: Path) -> None:
    for began in ("2026-01-01", "2026-01-02"):
        file = capture_of(tmp_path / began, "20hz", sine_frames(60), started=began)
        convert([file], tmp_path / "all")
    assert sorted(f.name for f in (tmp_path / "all" / "recordings").glob("*.csv")) == ["20hz.csv", "20hz_2.csv"]


def test_truth_of_another_study_stays(tmp_path: Path) -> None:
    file = tmp_path / "truth.json"
    file.write_text('{"origin": "synthetic", "parameters": {"k_T": 1.0}}')
    told = refusal("record", "--simulate", "--frequency", "20", "--out", str(tmp_path))
    assert told.startswith(f"{file}: is the truth of another study") and "k_T" in file.read_text()
    mine = tmp_path / "mine"
    truth = {"origin": "synthetic", "parameters": {"k": np.float64(0.1)}}
    plan = Plan(mine, (20.0,), CONDITION, origin="synthetic", truth=truth)
    plan.check(True)
    assert not mine.exists()  # nothing is recorded yet
    folder.enter_truth(mine, truth)
    plan.check(True)
    with pytest.raises(InputFileError, match="another study"):
        replace(plan, truth={"parameters": {}}).check(True)


def test_file_where_the_study_should_be_is_named(tmp_path: Path) -> None:
    file = tmp_path / "s1.json"
    file.write_text("{}")
    told = refusal("record", "--simulate", "--frequency", "20", "--out", str(file))
    assert told == f"{file}: is a file where the study cannot be written; name a folder."
