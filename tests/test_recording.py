"""Recordings and studies: exact round trips, corrections of channels, and sentences for broken folders."""

from pathlib import Path

import numpy as np
import pytest

from fasbody.exceptions import InputFileError, RecordingError
from fasbody.recording.recording import Condition, Recording, with_masses
from fasbody.recording.study import Study, StudyFolder, read_file
from fasbody.recording.trials import posture_remarks

T = np.arange(300) / 1000


def make(**more: object) -> Recording:
    rng = np.random.default_rng(1)
    return Recording(T, np.round(rng.normal(0, 5, 300), 6), np.round(rng.normal(0, 5, 300), 6), **more)  # type: ignore[arg-type]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sound study of two recordings."""
    make().write(tmp_path / "recordings" / "a.csv")
    make(tuberosity_m_s2=np.ones(300)).write(tmp_path / "recordings" / "b.csv")
    (tmp_path / "study.toml").write_text('[study]\nname = "two"\norigin = "measured"\ndescription = "d"\n')
    (tmp_path / "subjects.csv").write_text("subject,mass_kg\n7,54.43\n")
    (tmp_path / "recordings.csv").write_text(
        "file,subject,posture,added_mass_kg,frequency_hz\nrecordings/a.csv,7,midstance,0,10\nrecordings/b.csv,7,,2.3,\n"
    )
    return tmp_path


def test_rate_and_print() -> None:
    assert make().rate_hz == pytest.approx(1000)
    assert str(make()) == "recording: of unstated origin, frequency not stated, 300 samples at 1000 Hz"
    assert "20 Hz" in str(make(condition=Condition(frequency_hz=20)))


def test_study(folder: Path) -> None:
    study = Study.read(folder)
    assert str(study) == "two: 2 measured recordings"
    one, two = study
    assert one.condition == Condition("7", "midstance", 0.0, 54.43, 10.0)
    assert two.condition.frequency_hz is None
    shank = 0.0465 * 54.43 + 2.3
    assert two.condition.masses == {
        "m_S": shank,
        "m_T": shank,
        "m_F": 0.0145 * 54.43,
        "added_mass": two.condition.added_mass_kg,
    }
    assert two.tuberosity_m_s2 is not None
    assert one.file == f"{folder.name}/recordings/a.csv"


def test_channel_corrections(folder: Path) -> None:
    """Sign, sensitivity and a delay that is undone: a late 20 Hz sine comes back on time."""
    late = 3e-4
    sine = lambda t: 7 * np.sin(2 * np.pi * 20 * t)  # noqa: E731
    Recording(T, sine(T), -0.5 * sine(T - late)).write(folder / "recordings" / "a.csv")
    with (folder / "study.toml").open("a") as file:
        file.write(f'[channels.malleolus]\nunit = "V"\nsign = -1\nsensitivity = 0.5\ndelay_s = {late}\n')
    read = Study.read(folder).recordings[0]
    assert read.time_s.size == 299  # the malleolus' last sample is not there yet
    np.testing.assert_allclose(read.malleolus_m_s2[5:-5], sine(T)[5:-6], atol=1e-4)
    np.testing.assert_allclose(read.base_m_s2, sine(T)[:-1], atol=1e-6)


@pytest.mark.parametrize(("base", "malleolus", "kept"), [(0.0, 0.02, 280), (-0.01, 0.01, 280), (0.0, -0.02, 280)])
def test_delays_are_undone_over_the_common_time_and_nowhere_else(
    folder: Path, base: float, malleolus: float, kept: int
) -> None:
    sine = lambda t: 7 * np.sin(2 * np.pi * 20 * t)  # noqa: E731
    Recording(T, sine(T - base), sine(T - malleolus)).write(folder / "recordings" / "a.csv")
    tables = f"[channels.base]\ndelay_s = {base}\n[channels.malleolus]\ndelay_s = {malleolus}\n"
    (folder / "study.toml").write_text(tables)
    study = StudyFolder.open(folder)
    read = study.read(study.trials[0])
    assert read.time_s.size == kept
    for values in (read.base_m_s2, read.malleolus_m_s2):  # the ends included, where a spline is extrapolated no more
        np.testing.assert_allclose(values, sine(read.time_s), atol=5e-3)


def test_a_folder_of_bare_recordings_gets_a_way_out(tmp_path: Path) -> None:
    (tmp_path / "my feet").mkdir()
    (tmp_path / "my feet" / "a.csv").write_text("time_s,base_m_s2,malleolus_m_s2\n")
    with pytest.raises(InputFileError) as told:
        StudyFolder.open(tmp_path / "my feet")
    here = f"'{tmp_path / 'my feet'}'"
    assert f"init {here} makes them); or name the files, {here}/*.csv." in str(told.value)
    with pytest.raises(InputFileError, match=r"and recordings\.csv\.$"):
        StudyFolder.open(tmp_path)  # which holds none


def test_a_delay_longer_than_a_tenth_of_the_recording_is_refused(folder: Path) -> None:
    (folder / "study.toml").write_text("[channels.base]\ndelay_s = -0.02\n[channels.malleolus]\ndelay_s = 0.02\n")
    study = StudyFolder.open(folder)
    says = r"a\.csv: lasts 0\.299 s, too short for delay_s of study\.toml \(base -0\.02 s, malleolus 0\.02 s\); .*90 %"
    with pytest.raises(InputFileError, match=says):
        study.read(study.trials[0])


@pytest.mark.parametrize(
    ("file", "text", "sentence"),
    [
        ("study.toml", None, "no such file; a study folder needs study.toml, subjects.csv and recordings.csv"),
        ("study.toml", "[study\n", r"study.toml: is not TOML \("),
        ("study.toml", '[study]\norigin = "guessed"\n', 'origin = \'guessed\'; valid: "measured", "synthetic"'),
        ("study.toml", "[channels.maleolus]\nsign = 1\n", "the channel 'maleolus'; valid: base, malleolus, tuberosity"),
        ("study.toml", "[channels.base]\ngain = 1\n", r"key of \[channels\.base\] 'gain'"),
        ("study.toml", '[channels.base]\nsign = "minus"\n', "channels.base.sign = 'minus'; valid: 1, -1"),
        (
            "study.toml",
            "[channels.base]\nsign = 2\n",
            r"channels.base.sign = 2; valid: 1, -1 \(a gain is a sensitivity",
        ),
        ("study.toml", "[channels.base]\nsign = true\n", r"channels.base.sign = True; valid: 1, -1"),
        ("study.toml", "[channels.base]\nsensitivity = true\n", r"channels.base.sensitivity = True; valid"),
        ("study.toml", "[study]\nsampling_rate_hz = true\n", r"sampling_rate_hz = True; valid: a positive number"),
        (
            "study.toml",
            "[chanels.base]\nsign = 1\n",
            r"unknown table 'chanels', did you mean 'channels'\? \(valid: study, c",
        ),
        ("study.toml", "name = 'x'\n", r"unknown table 'name' \(valid: study, channels, known, layouts\)"),
        (
            "study.toml",
            "[study]\nsampling_rat_hz = 9\n",
            r"key of \[study\] 'sampling_rat_hz', did you mean 'sampling_rate_",
        ),
        (
            "study.toml",
            "[study]\nnmae = 'x'\n",
            r"'nmae', did you mean 'name'\? \(valid: .*name, origin, description",
        ),
        ("study.toml", "[channels.base]\nsensitivity = 0\n", r"sensitivity = 0; valid: a number .*, not 0"),
        ("study.toml", "[channels.base]\nsensitivity = nan\n", "channels.base.sensitivity = nan; valid: a number"),
        ("study.toml", "[channels.base]\ndelay_s = inf\n", "channels.base.delay_s = inf; valid: a number"),
        ("study.toml", "study = 3\n", r"study is 3; it must be a table, \[study\]"),
        ("study.toml", "channels = 3\n", r"channels is 3; it must be a table, \[channels\]"),
        ("study.toml", "[channels]\nbase = 3\n", r"base is 3; it must be a table, \[.*base\]"),
        ("subjects.csv", None, "subjects.csv: no such file"),
        ("subjects.csv", "subject\n7\n", "subjects.csv, line 1: has no column 'mass_kg'"),
        ("subjects.csv", "subject,mass_kg\n7,heavy\n", "subjects.csv, line 2: mass_kg is 'heavy', not a number"),
        ("recordings.csv", "file,subject\na,7\n", "recordings.csv, line 1: has no column 'added_mass_kg'"),
        ("recordings.csv", "file,subject,added_mass_kg\n", "lists no recording; one row a recording is needed"),
        ("recordings.csv", "file,subject,added_mass_kg\nx.csv,8,0\n", "line 2: subject '8' is not in subjects.csv"),
        (
            "recordings.csv",
            "file,subject,added_mass_kg\nx.csv,7,0\ny.csv,7,0\n./x.csv,7,2.3\n",
            r"recordings\.csv, line 4: './x\.csv' is listed in line 2 already; keep one row",
        ),
        ("recordings.csv", "file,subject,added_mass_kg\n,7,0\n", "recordings.csv, line 2: names no file"),
        ("subjects.csv", "subject,mass_kg\n7,70\n8,60\n7,71\n", "line 4: subject '7' is listed in line 2 already"),
        ("study.toml", "[channels.base]\ngain_std = -0.1\n", "base.gain_std = -0.1; valid: a standard deviation, 0"),
        ("recordings.csv", "file,subject,added_mass_kg\n../x.csv,7,0\n", "'../x.csv' lies outside the study's folder"),
        ("recordings.csv", "file,subject,added_mass_kg\nx.csv,7,0\n", r"x\.csv: no such file"),
        ("recordings/a.csv", "time_s,base_m_s2,malleolus_m_s2\n0,1,z\n", r"a\.csv, line 2: malleolus_m_s2 is 'z'"),
    ],
)
def test_broken_studies_get_one_sentence(folder: Path, file: str, text: str | None, sentence: str) -> None:
    place = folder / file
    place.unlink()
    if text is not None:
        place.write_text(text)
    with pytest.raises(InputFileError, match=sentence):
        Study.read(folder)


def test_an_empty_posture_is_midstance_and_line_numbers_count_comments(folder: Path) -> None:
    text = "# who, what\n\nfile;subject;posture;added_mass_kg\n# first\nrecordings/a.csv;7;;2,3\n"
    (folder / "recordings.csv").write_text(text)
    assert [(t.condition.posture, t.condition.added_mass_kg) for t in StudyFolder.open(folder).trials] == [
        ("midstance", 2.3)
    ]
    (folder / "recordings.csv").write_text(text.replace("2,3", "much"))
    with pytest.raises(InputFileError, match="line 5: added_mass_kg is 'much', not a number"):
        StudyFolder.open(folder)


@pytest.mark.parametrize(
    ("file", "text", "sentence"),
    [
        ("subjects.csv", "subject,mass_kg\n7,7257\n", r"subjects\.csv: subject 7: the body mass is 7257 kg"),
        ("recordings.csv", "file,subject,added_mass_kg\na,7,0\nb,7,-1\n", "line 3: the added mass is -1 kg"),
    ],
)
def test_implausible_masses_name_their_place(folder: Path, file: str, text: str, sentence: str) -> None:
    (folder / file).write_text(text)
    with pytest.raises(RecordingError, match=sentence):
        Study.read(folder)


def test_postures_are_read_in_any_case_and_slips_are_told(folder: Path) -> None:
    rows = ["file,subject,posture,added_mass_kg", "1.csv,7,Midstance,0", "2.csv,7, MIDSTANCE ,0", "3.csv,7,midstanse,0"]
    rows += ["4.csv,7,tiptoe,0", "5.csv,7,squat,0", "6.csv,7,Squat,0", "7.csv,7,Dorsiflexion,0"]
    (folder / "recordings.csv").write_text("\n".join(rows) + "\n")
    trials = StudyFolder.open(folder).trials
    assert [t.condition.posture for t in trials[:3]] == ["midstance", "midstance", "midstanse"]
    assert posture_remarks(trials) == [
        "recordings.csv: the posture 'midstanse' stands in 1 row, was 'midstance' meant?",
        "recordings.csv: the posture 'tiptoe' stands in 1 row only.",
    ]


def test_one_file_of_a_study_has_its_conditions(folder: Path) -> None:
    """The other recording is not even opened; a warning beside the file comes along."""
    (folder / "recordings" / "b.csv").unlink()
    (folder / "recordings" / "a.json").write_text('{"warnings": ["one gap", 3]}')
    read = read_file(folder / "recordings" / "a.csv")
    assert (read.condition.body_mass_kg, read.origin, read.warnings) == (54.43, "measured", ("one gap",))
    with pytest.raises(InputFileError, match=r"does not list c\.csv"):
        Study.read(folder, only=folder / "c.csv")


def test_masses_from_the_command_line() -> None:
    given = with_masses(make(), 72.57, 4.5)
    shank = 0.0465 * 72.57 + 4.5
    assert given.condition.masses == {
        "m_S": shank,
        "m_T": shank,
        "m_F": 0.0145 * 72.57,
        "added_mass": given.condition.added_mass_kg,
    }
    assert with_masses(given, None, None).condition == given.condition
    assert with_masses(given, None, 0.0).condition.masses["m_S"] == 0.0465 * 72.57
    for body, added, sentence in ((2.0, None, "body mass is 2 kg"), (70.0, -1.0, "added mass is -1 kg")):
        with pytest.raises(RecordingError, match=sentence):
            with_masses(make(), body, added)
    with pytest.raises(RecordingError, match="body mass is nan kg"):
        with_masses(make(), float("nan"), None)


def test_a_write_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no(self: Path, target: Path) -> None:
        raise PermissionError(13, "no")

    monkeypatch.setattr(Path, "replace", no)
    with pytest.raises(InputFileError, match=r"cannot be written \(no\); name a writable folder"):
        make().write(tmp_path / "r.csv")
    assert list(tmp_path.iterdir()) == []


def test_bundled_study_is_plainly_synthetic() -> None:
    from fasbody.recording.study import BUNDLED

    study = Study.read(BUNDLED)
    assert study.origin == "synthetic"
    assert all(r.origin == "synthetic" for r in study)
    assert "Nobody was measured" in study.description
    assert [r.condition.frequency_hz for r in study.under(0.0)] == list(range(10, 55, 5))
    assert [r.condition.frequency_hz for r in study.under(2.3)] == [10, 25, 40]
    assert len(study.recordings) == 12
    assert {r.condition.body_mass_kg for r in study} == {72.57}
    assert sum(f.stat().st_size for f in BUNDLED.rglob("*") if f.is_file()) < 2_000_000
