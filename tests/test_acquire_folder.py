"""From captured bytes to a study: gaps stay gaps, and identification refuses them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from feeder import CONDITION, hello

from fasbody.acquire import folder
from fasbody.acquire.capture import Capture
from fasbody.acquire.conversion import convert
from fasbody.acquire.plan import Plan
from fasbody.acquire.wire import FrameReader, encode_data, encode_hello
from fasbody.exceptions import InputFileError, RecordingError
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording
from fasbody.recording.study import Study


def capture_of(
    study: Path, stem: str, wire: bytes, seconds: float | None = None, rate: float = 1000.0,
    condition: Condition = CONDITION, started: str | None = None,
) -> Path:  # fmt: skip
    """A capture file of a stream of frames, arriving evenly."""
    duration = 16 / rate * wire.count(b"\0") / 2
    reader = FrameReader()
    reader.feed(encode_hello(hello(rate)))
    capture = Capture(study / "captures" / f"{stem}.fascap")
    about = {"seconds": seconds, "preamble": reader.preamble.hex(), "condition": vars(condition), "origin": "measured"}
    capture.add("M", 0.0, about | ({"started_utc": started} if started else {}))
    for start in range(0, len(wire), 500):
        capture.add("B", duration * start / len(wire), wire[start : start + 500])
    capture.close()
    return capture.file


def sine_frames(count: int, missing: tuple[int, ...] = (), rate: float = 1000.0) -> bytes:
    """Frames of a 20 Hz sine on both channels, the malleolus a little late."""
    t = np.arange(count * 16) / rate
    noise = np.random.default_rng(0).normal(0, 20, (t.size, 2))
    wave = 8000 * np.column_stack([np.sin(40 * np.pi * t), 1.2 * np.sin(40 * np.pi * t - 0.4)]) + noise
    parts = np.round(wave).astype(int).reshape(count, 16, 2)
    stamps = np.round(np.arange(count) * 16 / rate * 1e6)
    frames = [encode_data(i, int(stamps[i]), parts[i], 16) for i in range(count) if i not in missing]
    return b"".join(frames)


def test_gap_is_marked_never_filled_and_refused_by_identification(tmp_path: Path) -> None:
    study = tmp_path / "study"
    made = convert([capture_of(study, "gap", sine_frames(120, missing=(40, 41, 90)))], study)
    assert made.quality.lost_samples == 48 and len(made.quality.gaps) == 2 and made.problems
    table = np.loadtxt(made.file, delimiter=",", skiprows=1)
    assert len(table) == 117 * 16
    steps = np.round(np.diff(table[:, 0]) * 1000).astype(int)
    assert sorted(steps[steps != 1]) == [17, 33] and np.flatnonzero(steps == 33)[0] == 40 * 16 - 1
    details = json.loads(made.file.with_suffix(".json").read_text())
    assert [gap["lost_samples"] for gap in details["quality"]["gaps"]] == [32, 16]
    assert details["usable"] is False and details["board"]["board"] == "feeder"
    with pytest.raises(RecordingError, match=r"samples are missing .*\(places: 2\)"):
        checked(Recording.read(made.file))
    with pytest.raises(InputFileError, match="lists no recording"):
        Study.read(study)
    again = convert([study / "captures" / "gap.fascap"], study, longest=True)
    assert again.problems == () and again.recording.time_s.size == 48 * 16
    (listed,) = Study.read(study).recordings
    assert checked(listed).condition.frequency_hz == pytest.approx(20, abs=0.01)
    assert any("longest stretch" in text for text in listed.warnings)


def test_conversion_is_cut_to_length_and_repeatable_and_times_are_exact_at_4_khz(tmp_path: Path) -> None:
    file = capture_of(tmp_path, "one", sine_frames(400, rate=4000.0), seconds=1.5, rate=4000.0)
    first, second = convert([file], tmp_path), convert([file], tmp_path)
    assert first.recording.time_s.size == 6000 and first.document() == second.document()
    read = Study.read(tmp_path).recordings
    assert len(read) == 1
    np.testing.assert_allclose(read[0].time_s, np.arange(6000) / 4000, atol=1e-9)
    assert (tmp_path / "subjects.csv").read_text() == "subject,mass_kg\n16,72.57\n"


def test_measured_and_synthetic_are_not_mixed_and_names_do_not_collide(tmp_path: Path) -> None:
    convert([capture_of(tmp_path, "20hz_0kg", sine_frames(60))], tmp_path)
    with pytest.raises(InputFileError, match="is not synthetic data"):
        Plan(tmp_path, (20.0,), CONDITION, origin="synthetic").check(True)
    assert folder.free_stem(tmp_path, "20hz_0kg") == "20hz_0kg_2"
    assert folder.body_mass(tmp_path, "16") == 72.57 and folder.body_mass(tmp_path, "17") is None


def test_capture_without_its_plan_is_not_listed(tmp_path: Path) -> None:
    file = capture_of(tmp_path, "torn", encode_hello(hello()) + sine_frames(100))
    raw = bytearray(file.read_bytes())
    raw[40] ^= 1
    file.write_bytes(raw)
    made = convert([file], tmp_path)
    assert any("what was to be recorded is damaged" in text for text in made.problems)
    assert any("unreadable bytes in the capture" in text for text in made.remarks)
    assert not (tmp_path / "recordings.csv").exists() and not (tmp_path / "study.toml").exists()


def test_contradicting_body_mass_is_refused(tmp_path: Path) -> None:
    convert([capture_of(tmp_path, "one", sine_frames(60))], tmp_path)
    other = replace(CONDITION, body_mass_kg=80.0)
    with pytest.raises(InputFileError, match=r"subjects\.csv: subject '16' has 72\.57 kg, and 80 kg are given"):
        Plan(tmp_path, (20.0,), other).check(False)
    made = convert([capture_of(tmp_path, "two", sine_frames(60), condition=other)], tmp_path)
    assert made.problems == ("its body mass is 80 kg and subjects.csv says 72.57 kg",)


@pytest.mark.parametrize(("nominal", "match"), [(20.0, None), (35.0, "vibrates at 20 Hz")])
def test_excitation_set_by_hand_is_judged(tmp_path: Path, nominal: float, match: str | None) -> None:
    condition = replace(CONDITION, frequency_hz=nominal)
    made = convert([capture_of(tmp_path, "hand", sine_frames(100), condition=condition)], tmp_path)
    assert (made.problems == ()) if match is None else (match in made.problems[0])
    assert (tmp_path / "recordings.csv").read_text().count("hand.csv") == (match is None)


@pytest.mark.parametrize(
    "wrong",
    [{"seconds": "abc"}, {"condition": None}, {"condition": {"frequency_hz": "20"}}, {"condition": {"subject": 3}}],
)
def test_senseless_plan_is_one_sentence(tmp_path: Path, wrong: dict[str, object]) -> None:
    capture = Capture(tmp_path / "captures" / "odd.fascap")
    capture.add("M", 0.0, wrong)
    capture.add("B", 0.0, encode_hello(hello()) + sine_frames(60))
    capture.close()
    with pytest.raises(InputFileError, match=r"odd\.fascap: its plan has"):
        convert([capture.file], tmp_path)
