"""From captured bytes to a study: gaps stay gaps, nothing is mixed, nothing overwritten."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from feeder import CONDITION, capture_of, hello, refusal, sine_frames

from fasbody.acquire import folder
from fasbody.acquire.capture import Capture
from fasbody.acquire.commands import app
from fasbody.acquire.folder import at_rest, convert
from fasbody.acquire.plan import Plan
from fasbody.acquire.wire import Channel, Hello, encode_data, encode_hello
from fasbody.exceptions import AcquisitionError, InputFileError, RecordingError
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study


def test_gap_is_marked_never_filled_and_refused_by_identification(tmp_path: Path) -> None:
    study = tmp_path / "study"
    made = convert(capture_of(study, "gap", sine_frames(120, missing=(40, 41, 90))), study)
    assert made.quality.lost_samples == 48 and len(made.quality.gaps) == 2 and made.problems
    table = np.loadtxt(made.file, delimiter=",", skiprows=1)
    assert len(table) == 117 * 16
    steps = np.round(np.diff(table[:, 0]) * 1000).astype(int)
    assert sorted(steps[steps != 1]) == [17, 33] and np.flatnonzero(steps == 33)[0] == 40 * 16 - 1
    details = json.loads(made.file.with_suffix(".json").read_text())
    assert [gap["lost_samples"] for gap in details["quality"]["gaps"]] == [32, 16]
    assert details["usable"] is False and details["board"]["board"] == "feeder"
    with pytest.raises(RecordingError, match=r"samples are missing .*\(and so at 1 more place\)"):
        checked(Recording.read(made.file))
    with pytest.raises(InputFileError, match="lists no recording"):
        Study.read(study)
    again = convert(study / "captures" / "gap.fascap", study, longest=True)
    assert again.problems == () and again.recording.time_s.size == 48 * 16
    (listed,) = Study.read(study).recordings
    assert checked(listed).condition.frequency_hz == pytest.approx(20, abs=0.01)
    assert any("longest stretch" in text for text in listed.warnings)


def test_conversion_is_cut_to_length_and_repeatable_and_times_are_exact_at_4_khz(tmp_path: Path) -> None:
    file = capture_of(tmp_path, "one", sine_frames(400, rate=4000.0), seconds=1.5, rate=4000.0)
    first, second = convert(file, tmp_path), convert(file, tmp_path)
    assert first.recording.time_s.size == 6000 and first.document() == second.document()
    read = Study.read(tmp_path).recordings
    assert len(read) == 1
    np.testing.assert_allclose(read[0].time_s, np.arange(6000) / 4000, atol=1e-9)
    assert (tmp_path / "subjects.csv").read_text() == "subject,mass_kg\n16,72.57\n"


def test_measured_and_synthetic_are_not_mixed_and_names_do_not_collide(tmp_path: Path) -> None:
    convert(capture_of(tmp_path, "20hz_0kg", sine_frames(60)), tmp_path)
    with pytest.raises(InputFileError, match="is not synthetic data"):
        Plan(tmp_path, (20.0,), CONDITION, origin="synthetic").check(True)
    assert folder.free_stem(tmp_path, "20hz_0kg") == "20hz_0kg_2"
    assert folder.body_mass(tmp_path, "16") == 72.57 and folder.body_mass(tmp_path, "17") is None


def test_capture_without_its_plan_is_not_listed(tmp_path: Path) -> None:
    file = capture_of(tmp_path, "torn", encode_hello(hello()) + sine_frames(100))
    raw = bytearray(file.read_bytes())
    raw[40] ^= 1
    file.write_bytes(raw)
    made = convert(file, tmp_path)
    assert any("what was to be recorded is damaged" in text for text in made.problems)
    assert any("unreadable bytes in the capture" in text for text in made.remarks)
    assert not (tmp_path / "recordings.csv").exists() and not (tmp_path / "study.toml").exists()


def test_contradicting_body_mass_is_refused(tmp_path: Path) -> None:
    convert(capture_of(tmp_path, "one", sine_frames(60)), tmp_path)
    other = replace(CONDITION, body_mass_kg=80.0)
    with pytest.raises(InputFileError, match=r"subjects\.csv: subject '16' has 72\.57 kg, and 80 kg are given"):
        Plan(tmp_path, (20.0,), other).check(False)
    made = convert(capture_of(tmp_path, "two", sine_frames(60), condition=other), tmp_path)
    assert made.problems == ("its body mass is 80 kg and subjects.csv says 72.57 kg",)


@pytest.mark.parametrize(("nominal", "match"), [(20.0, None), (35.0, "vibrates at 20 Hz")])
def test_excitation_set_by_hand_is_judged(tmp_path: Path, nominal: float, match: str | None) -> None:
    condition = replace(CONDITION, frequency_hz=nominal)
    made = convert(capture_of(tmp_path, "hand", sine_frames(100), condition=condition), tmp_path)
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
        convert(capture.file, tmp_path)


def test_each_capture_becomes_its_own_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = capture_of(tmp_path, "20hz_0kg", sine_frames(60))
    second = capture_of(tmp_path, "20hz_0kg_2", sine_frames(90))
    capsys.readouterr()
    app(["recover", str(first), str(second), "--json"], standalone_mode=False)
    documents = json.loads(capsys.readouterr().out)
    assert [one["samples"] for one in documents] == [960, 1440]
    assert sorted(one.time_s.size for one in Study.read(tmp_path).recordings) == [960, 1440]


def test_bad_capture_among_good_ones_costs_only_itself(tmp_path: Path) -> None:
    first = capture_of(tmp_path, "a", sine_frames(60))
    gap = capture_of(tmp_path, "b", sine_frames(60, missing=(20,)))
    none = capture_of(tmp_path, "c", b"")
    last = capture_of(tmp_path, "d", sine_frames(60))
    with pytest.raises(AcquisitionError) as caught:
        app(["recover", *map(str, (first, gap, none, last))], standalone_mode=False)
    assert "b.csv is written and not listed" in str(caught.value) and "c.fascap: " in str(caught.value)
    assert [Path(one.file).name for one in Study.read(tmp_path).recordings] == ["a.csv", "d.csv"]


def test_same_file_twice_is_refused(tmp_path: Path) -> None:
    file = capture_of(tmp_path, "20hz_0kg", sine_frames(60))
    link = tmp_path / "captures" / "link.fascap"
    link.symlink_to(file)
    assert refusal("recover", str(file), str(link)).startswith(f"{link}: is given twice")


def test_recovering_into_another_study_overwrites_and_mixes_nothing(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    own = convert(capture_of(there, "20hz_0kg", sine_frames(60)), there).file
    before = own.read_bytes()
    foreign = capture_of(here, "20hz_0kg", sine_frames(90))
    for _ in range(2):  # the second time it is known again
        made = convert(foreign, there)
        assert made.file.name == "20hz_0kg_2.csv" and made.recording.time_s.size == 1440
    assert own.read_bytes() == before and len(Study.read(there).recordings) == 2
    assert folder.stem_of(there, there / "captures" / "20hz_0kg.fascap", None) == "20hz_0kg"
    waiting = capture_of(there, "25hz_0kg", sine_frames(60))  # not converted yet: its name is taken
    assert convert(capture_of(here, "25hz_0kg", sine_frames(60)), there).file.name == "25hz_0kg_2.csv"
    assert convert(waiting, there).file.name == "25hz_0kg.csv"
    toml = there / "study.toml"
    toml.write_text(toml.read_text().replace("measured", "synthetic"))
    with pytest.raises(InputFileError, match="is not measured data"):
        convert(capture_of(here, "30hz_0kg", sine_frames(60)), there)
    assert not list(there.glob("recordings/30hz*"))


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


def test_recover_names_the_captures_there_are(tmp_path: Path) -> None:
    study = tmp_path / "study"
    good = capture_of(study, "20hz_0kg", sine_frames(60))
    table = convert(good, study).file
    for wrong, problem in (
        (study / "captures" / "21hz_0kg.fascap", "cannot be read (No such file or directory)"),
        (table, "is not a capture file"), (study, "cannot be read (Is a directory)"),
    ):  # fmt: skip
        told = refusal("recover", str(wrong))
        assert told.startswith(f"{wrong}: {problem}; valid: ") and str(good) in told and not told.endswith("..")
    lonely = tmp_path / "lonely" / "x.csv"
    assert "acquisition writes them as STUDY/captures/NAME.fascap" in refusal("recover", str(lonely))
    elsewhere = tmp_path / "moved.fascap"
    elsewhere.write_bytes(good.read_bytes())
    assert "give --out STUDY" in refusal("recover", str(elsewhere))


@pytest.mark.parametrize(("rms", "refused"), [(0.03, True), (0.15, True), (0.3, False), (6.3, False)])
def test_rest_is_no_excitation_whatever_the_offset_and_a_slow_drift(rms: float, refused: bool) -> None:
    rng = np.random.default_rng(4)
    t = np.arange(4000) / 1000
    base = rms * rng.normal(size=t.size) + 9.81 + 1.5 * np.sin(2 * np.pi * 0.25 * t)
    text = at_rest(Recording(t, base, rng.normal(size=t.size)))
    assert ("the base is at rest" in text) == refused


def test_short_of_what_was_planned_is_not_listed_until_asked_for(tmp_path: Path) -> None:
    """A session of 3 s whose last second never came, and one that was told to begin with a hello only."""
    file = capture_of(tmp_path, "20hz", sine_frames(125), seconds=3.0)
    made = convert(file, tmp_path, stopped="the board is silent for 3 s; check its supply.")
    assert made.problems == ("2 s are there of 3 s",)
    usable = "usable: 2 s without a gap from 0 s on; recover --longest keeps them"
    assert made.remarks == ("ended early: the board is silent for 3 s; check its supply", usable)
    assert (tmp_path / "recordings.csv").read_text().count("20hz") == 0 and file.is_file()
    assert convert(file, tmp_path, longest=True).problems == ()
    assert (tmp_path / "recordings.csv").read_text().count("20hz") == 1
    with pytest.raises(AcquisitionError, match="but no samples; no recording can be made"):
        convert(capture_of(tmp_path, "none", encode_hello(hello()), condition=CONDITION), tmp_path)


def test_a_broken_sine_is_refused_and_its_longest_part_kept(tmp_path: Path) -> None:
    rate, hz = 1000.0, 20.0
    t = np.arange(10_000) / rate
    wave = 9 * np.sin(2 * np.pi * hz * (t + 0.015 * (t > 3.05)))
    kinds = (Channel("base", 39.2, 800.0), Channel("malleolus", 39.2, 800.0))
    data = encode_hello(Hello("made", rate, kinds, 16, 16, 1))
    counts = np.round(800 * np.column_stack([wave, 1.2 * wave])).astype(np.int32)
    for frame in range(t.size // 16):
        data += encode_data(frame, frame * 16_000, counts[16 * frame : 16 * (frame + 1)], 16)
    study = tmp_path / "study"
    written = Capture(study / "captures" / "20hz_0kg.fascap")
    condition = {"subject": "1", "posture": "midstance", "body_mass_kg": 70.0, "frequency_hz": hz}
    written.add("M", 0.0, {"seconds": 10.0, "condition": condition, "origin": "synthetic"})
    written.add("B", 1.0, data)
    written.close()
    whole = convert(written.file, study)
    assert all(3.05 < after < 3.55 for after, _ in whole.quality.faults)
    assert any(text.startswith("base breaks at 3.") for text in whole.problems)
    assert any(text.startswith("usable: 6.") for text in whole.remarks)
    part = convert(written.file, study, longest=True)
    assert part.problems == () and 6.0 < part.recording.time_s[-1] < 7.0
