"""Several layouts of columns in one study, one study.toml for several files, and what a study's tables tell."""

import json
import shutil
from pathlib import Path

import in_process
import numpy as np
import pytest

from fasbody.exceptions import InputFileError, SettingError
from fasbody.recording.proposal import propose
from fasbody.recording.recording import Recording
from fasbody.recording.sources import gather
from fasbody.recording.study import Study, StudyFolder
from fasbody.recording.trials import describe
from fasbody.transmissibility.table import Table

G = 9.80665
TIME = np.arange(2000) / 1000
LAYOUTS = """
[study]
sampling_rate_hz = 1000
[channels.base]
column = "AI0"
unit = "V"
sensitivity = "100 mV/g"
[channels.malleolus]
column = "AI1"
unit = "V"
sensitivity = "100 mV/g"
gain_std = 0.01

[layouts.telephones]
files = ["*_phone.csv", "old/*.csv"]
[layouts.telephones.channels.base]
column = "table"
unit = "g"
[layouts.telephones.channels.malleolus]
column = "ankle"
unit = "g"
delay_std_s = 1e-3
"""


def sines(ratio: float, frequency: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Base and malleolus [m/s^2], the second so many times the first, 20 degrees behind."""
    turn = 2 * np.pi * frequency * TIME
    return 9 * np.sin(turn), 9 * ratio * np.sin(turn - np.radians(20))


def table(file: Path, names: str, scale: float, ratio: float, frequency: float = 20.0) -> Path:
    """A text file without time."""
    file.parent.mkdir(parents=True, exist_ok=True)
    both = np.column_stack(sines(ratio, frequency)) * scale
    np.savetxt(file, both, delimiter=",", header=names, comments="")
    return file


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two subjects: one recorded by a logger in volts, one by telephones in g, and one file of these elsewhere."""
    folder = tmp_path_factory.mktemp("mixed")
    table(folder / "raw" / "a.csv", "AI0,AI1", 0.1 / G, 1.1)
    table(folder / "raw" / "b_phone.csv", "table,ankle", 1 / G, 1.2)
    table(folder / "old" / "c.csv", "table,ankle", 1 / G, 1.3, 25.0)
    (folder / "study.toml").write_text(LAYOUTS)
    (folder / "subjects.csv").write_text("subject,mass_kg\n1,70\n2,80\n")
    rows = ["raw/a.csv,1,0,20", "raw/b_phone.csv,2,0,20", "old/c.csv,2,0,25"]
    (folder / "recordings.csv").write_text("\n".join(["file,subject,added_mass_kg,frequency_hz", *rows, ""]))
    return folder


def test_each_file_is_read_by_the_layout_that_its_name_fits(study: Path) -> None:
    found = Table.of(StudyFolder.open(study), processes=1)
    told = found.frame.set_index("file")["transmissibility"].to_dict()
    assert told == pytest.approx({"raw/a.csv": 1.1, "raw/b_phone.csv": 1.2, "old/c.csv": 1.3}, rel=1e-6)
    assert found.covers.endswith("(malleolus)")
    one, two, _ = Study.read(study).recordings
    assert (one.calibration["malleolus"].gain_std, two.calibration["malleolus"].gain_std) == (0.01, 0.0)
    assert two.calibration["malleolus"].delay_std_s == 1e-3


@pytest.mark.parametrize(
    "text, words",
    [
        ("[layouts.a]\nsampling_rate_hz = 10\n", r"layouts\.a\.files = None; valid: a pattern of file names"),
        ('[layouts.a]\nfiles = "*.csv"\nrate = 10\n', r"unknown key of \[layouts\.a\] 'rate'"),
        ("layouts = 3\n", r"layouts is 3; it must be a table"),
        ("[layouts]\na = 3\n", r"layouts\.a is 3; it must be a table, \[layouts\.a\]"),
    ],
)
def test_a_layout_that_is_none_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(InputFileError, match=words):
        describe(tmp_path / "study.toml")


def test_a_file_that_fits_two_layouts_is_refused(study: Path, tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(LAYOUTS + '\n[layouts.other]\nfiles = "b*"\n')
    layout = describe(tmp_path / "study.toml")[1]
    with pytest.raises(InputFileError, match=r"fits two layouts of study\.toml \(\*_phone\.csv and b\*\)"):
        Recording.read(study / "raw" / "b_phone.csv", layout=layout)
    assert Recording.read(study / "raw" / "a.csv", layout=layout).time_s.size == 2000


def test_a_fit_takes_several_files_and_one_study(study: Path, tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(LAYOUTS)
    files = [
        table(tmp_path / "x.csv", "AI0,AI1", 0.1 / G, 1.4),
        table(tmp_path / "y_phone.csv", "table,ankle", 1 / G, 1.5),
    ]
    _, recordings, _ = gather(files, [70.0], [0.0, 2.3], tmp_path / "study.toml")
    ratios = [r.malleolus_m_s2.std() / r.base_m_s2.std() for r in recordings]
    assert ratios == pytest.approx([1.4, 1.5], rel=1e-3)
    assert [r.condition.added_mass_kg for r in recordings] == [0.0, 2.3]
    with pytest.raises(SettingError, match=r"a study folder has a study\.toml of its own"):
        gather([study], None, None, tmp_path / "study.toml")


def test_transmissibility_takes_several_files_and_one_study(study: Path) -> None:
    words = ["fasbody.transmissibility", "--json", "--study", str(study / "study.toml")]
    files = [str(study / "raw" / "a.csv"), str(study / "raw" / "b_phone.csv")]
    done = in_process.command(*words, *files)
    assert [row["transmissibility"] for row in json.loads(done.stdout)] == pytest.approx([1.1, 1.2], rel=1e-6)
    again = in_process.command(*words, str(study))
    assert again.returncode == 2 and "has a study.toml of its own, or recordings" in again.stderr.replace("\n", " ")


def test_check_tells_the_quality_by_subject(study: Path) -> None:
    done = in_process.command("fasbody.recording", "check", str(study), "--jobs", "1")
    assert done.returncode == 0, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    by_subject = {row[0]: row[1:4] for row in lines if row and row[0] in ("1", "2")}
    assert by_subject == {"1": ["1", "1", "0"], "2": ["2", "2", "0"]}
    heads = [row[:4] for row in lines if row[:1] == ["subject"]]
    assert heads == [["subject", "recordings", "sound", "unusable"]] and "worst" in done.stdout


def test_numbers_say_their_units(study: Path) -> None:
    units = Table.of(StudyFolder.open(study), processes=1).to_dataframe().attrs["units"]
    wanted = {"added_mass_kg": "kg", "frequency_hz": "Hz", "phase_deg": "degree", "phase_std_deg": "degree"}
    assert units == wanted
    checked = Study.read(study).check().to_dataframe()
    assert checked.attrs["units"]["rms_base_m_s2"] == "m/s^2"
    assert checked["rms_base_m_s2"].to_list() == pytest.approx(3 * [9 / np.sqrt(2)], rel=1e-3)


def test_a_folder_of_two_kinds_is_proposed_with_a_layout_each(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    table(tmp_path / "S1_20Hz_0kg.csv", "base [m/s^2],malleolus [m/s^2]", 1.0, 1.1)
    text = (tmp_path / "S1_20Hz_0kg.csv").read_text().splitlines()
    rows = [f"{t:.3f},{row}" for t, row in zip(TIME, text[1:], strict=True)]
    (tmp_path / "S1_20Hz_0kg.csv").write_text("\n".join([f"time_s,{text[0]}", *rows, ""]))
    about = {"wf_increment": 1e-3, "unit_string": "g"}
    pairs = zip(("Shaker table", "Ankle"), sines(1.2), strict=True)
    with nptdms.TdmsWriter(tmp_path / "S2_20Hz_0kg.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("g", name, x / G, properties=about) for name, x in pairs])
    found = propose(tmp_path)
    assert found.missing == ("subjects.csv: mass_kg of 2 subjects",)
    assert 'files = ["*.tdms", "*.tdms.gz"]' in found.tables["study.toml"]
    found.write()
    people = (tmp_path / "subjects.csv").read_text().replace(",,,\n", ",,,70\n")
    (tmp_path / "subjects.csv").write_text(people)
    ratios = [r.malleolus_m_s2.std() / r.base_m_s2.std() for r in Study.read(tmp_path)]
    assert ratios == pytest.approx([1.1, 1.2], rel=1e-3)


def test_a_recording_of_a_whole_table() -> None:
    pd, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    base, malleolus = sines(1.3)
    stamps = pd.Timestamp("2026-03-04") + pd.to_timedelta(TIME, "s")
    frame = pd.DataFrame({"base [g]": base / G, "malleolus": malleolus}, pd.Index(stamps, name="time"))
    frame.attrs["units"] = {"malleolus": "m/s^2"}
    data = {"base": ("time", base, {"units": "m/s^2"}), "malleolus": ("time", malleolus / G, {"units": "g"})}
    dataset = xarray.Dataset(data, {"time": ("time", TIME, {"units": "s"})})
    plain = {"time_ms": 1e3 * TIME, "base_m_s2": base, "malleolus_m_s2": malleolus, "foot_m_s2": base}
    for whole in (frame, dataset, plain):
        made = Recording.from_table(whole, body_mass_kg=70.0)
        assert made.time_s == pytest.approx(TIME)
        assert made.base_m_s2 == pytest.approx(base) and made.malleolus_m_s2 == pytest.approx(malleolus)
        assert made.condition.body_mass_kg == 70.0
    assert list(made.others) == ["foot"]
    sentence = r"mine: has no column 'malleolus_m_s2' \(found: time_s, base_g\); rename the column"
    with pytest.raises(InputFileError, match=sentence):
        Recording.from_table({"time_s": TIME, "base_g": base}, name="mine")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('[channels.instep]\ncolumn = "x"\n', r"describes the channel 'instep', and no recording has a column 'x'"),
        ("[known]\ngain_std = 0.02\n", r"gain_std in \[known\] and in \[channels\.malleolus\]; keep one"),
    ],
)
def test_what_would_be_ignored_is_refused(study: Path, tmp_path: Path, more: str, words: str) -> None:
    copy = shutil.copytree(study, tmp_path / "copy")
    toml = copy / "study.toml"
    toml.write_text(toml.read_text() + more)
    with pytest.raises(InputFileError, match=words):
        Study.read(copy)
