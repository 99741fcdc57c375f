"""What files say in words and names beside the samples: used, quoted, answered, or refused."""

import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file, savemat

from fasbody.exceptions import InputFileError
from fasbody.recording.channels import Layout
from fasbody.recording.checks import understood
from fasbody.recording.recording import Recording
from fasbody.recording.statements import is_treated
from fasbody.recording.trials import parsed

T = np.arange(3000) / 1000
BASE, MALLEOLUS = (8 * size * np.sin(40 * np.pi * T - lag) for size, lag in ((1, 0), (1.5, 0.6)))
COLUMNS = {"time_s": T, "base_m_s2": BASE, "malleolus_m_s2": MALLEOLUS}


def layout(toml: str) -> Layout:
    return parsed(Path("study.toml"), tomllib.loads(toml))[1]


def text(
    file: Path, head: str, names: str = "time_s,base_m_s2,malleolus_m_s2", factor: float = 1.0
) -> Path:
    columns = [factor * BASE, factor * MALLEOLUS]
    columns = [T, *columns] if names.startswith("time") else columns
    rows = "\n".join(",".join(f"{x:.5f}" for x in row) for row in zip(*columns, strict=True))
    file.write_text(f"{head}{names}\n{rows}\n")
    return file


def excel(
    file: Path, sheet: str = "Data", above: tuple = (), notes: dict | None = None, beside: str = ""
) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    table = book.active
    table.title = sheet
    for row in (*above, tuple(COLUMNS)):
        table.append(row)
    for place, row in enumerate(zip(*COLUMNS.values(), strict=True)):
        table.append([*map(float, row), *([None, beside] if beside and place == 4 else [])])
    for place, words in (notes or {}).items():
        table[place].comment = openpyxl.comments.Comment(words, "A. B.")
    book.save(file)
    return file


@pytest.mark.parametrize(
    ("about", "says"),
    [
        (
            {"notes": {"C1": "glued upside down"}},
            "'malleolus_m_s2: glued upside down', which is not applied",
        ),
        ({"notes": {"C900": "loose from here on"}}, "'malleolus_m_s2: loose from here on'"),
        ({"above": (("ankle sensor 4 ms behind",),)}, "'ankle sensor 4 ms behind'"),
        ({"above": (("Filter", "none", "20 Hz"),)}, "'Filter none 20 Hz'"),
        ({"beside": "amp of ankle x2"}, "x2"),
        ({"sheet": "gain 2x"}, "the name 'gain 2x' says"),
        ({"sheet": "filtered"}, "the name 'filtered' says"),
        (
            {"above": (("Sampling rate", 500),)},
            "states 500 Hz, and its time runs at 1000 Hz, which counts",
        ),
    ],
)
def test_words_of_a_workbook_are_quoted(tmp_path: Path, about: dict, says: str) -> None:
    assert says in Recording.read(excel(tmp_path / "r.xlsx", **about)).warnings[0]


@pytest.mark.parametrize(
    "about",
    [
        {"notes": {"A1": "since the start"}},
        {"notes": {"B1": "serial 4711"}},
        {"above": (("Subject", 16),)},
        {"above": (("Vibration of the foot",), (), ("Sampling rate", 1000))},
        {"beside": "tea"},
        {"sheet": "20 Hz 2.3 kg"},
        {"sheet": "unfiltered"},
        {"above": (("Gain", 2, 2),)},
    ],
)
def test_words_of_a_workbook_that_change_nothing_are_not(tmp_path: Path, about: dict) -> None:
    assert Recording.read(excel(tmp_path / "r.xlsx", **about)).warnings == ()


def test_statements_of_a_workbook_are_refused_until_they_are_answered(tmp_path: Path) -> None:
    file = excel(tmp_path / "r.xlsx", notes={"C1": "gain 2"})
    with pytest.raises(InputFileError, match="gain = 2 with 'malleolus_m_s2'"):
        Recording.read(file)
    assert (
        Recording.read(file, layout=layout("[channels.malleolus]\nsensitivity = 2")).warnings == ()
    )
    rated = excel(tmp_path / "b.xlsx", above=(("Gain", "base: 1", "malleolus: 2"),))
    assert "Gain base: 1 malleolus: 2" in Recording.read(rated).warnings[0]


def test_a_note_is_shown_of_a_recording_that_cannot_serve(tmp_path: Path) -> None:
    file = text(tmp_path / "r.csv", "# ankle sensor upside down\n", factor=-1.0)
    turned = Recording.read(file, layout=layout("[channels.base]\nsign = -1"))
    row = understood(turned)
    assert "leads the base" in row["problem"] and "upside down" in row["warnings"][0]


def decimated(file: Path, name: str, factor: float) -> Path:
    """A file that states 4000 Hz, and that one sample of some was kept."""
    channels = {"base_m_s2": BASE, "malleolus_m_s2": MALLEOLUS}
    if file.suffix == ".mat":
        savemat(file, channels | {"fs": 4000.0, name: factor})
    elif file.suffix == ".npz":
        np.savez(file, **channels, fs=4000.0, **{name: factor})
    elif file.suffix == ".h5":
        with h5py.File(file, "w") as out:
            out.attrs["rate_hz"] = 4000.0
            for key, values in channels.items():
                out[key] = values
                out[key].attrs[name] = factor
    elif file.suffix == ".nc":
        with netcdf_file(file, "w") as out:
            setattr(out, name, factor)
            out.createDimension("sample", T.size)
            out.createVariable("fs", "d", ())[...] = 4000.0
            for key, values in channels.items():
                out.createVariable(key, "d", ("sample",))[:] = values
    elif file.suffix == ".tdms":
        nptdms = pytest.importorskip("nptdms")
        step = {"wf_increment": 1 / 4000}
        made = [nptdms.ChannelObject("foot", key, values, step) for key, values in channels.items()]
        with nptdms.TdmsWriter(str(file)) as out:
            out.write_segment([nptdms.RootObject({name: factor}), *made])
    else:
        text(file, f"# fs = 4000 Hz\n# {name}: {factor:g}\n", "base_m_s2,malleolus_m_s2")
    return file


@pytest.mark.parametrize("name", ["decimation", "downsample_factor", "Down-sampling"])
@pytest.mark.parametrize("ending", [".mat", ".npz", ".h5", ".nc", ".tdms", ".csv"])
def test_a_rate_beside_a_decimation_is_in_doubt(tmp_path: Path, ending: str, name: str) -> None:
    name = name if ending in (".csv", ".tdms", ".h5") else name.replace("-", "_")
    file = decimated(tmp_path / f"r{ending}", name, 4.0)
    with pytest.raises(
        InputFileError, match=rf"states a rate of 4000 Hz and '.*{name}: 4'.*give sampling_rate_hz"
    ):
        Recording.read(file)
    answered = Recording.read(file, layout=Layout(rate_hz=1000.0))
    assert answered.rate_hz == pytest.approx(1000)
    assert [w.partition(": ")[2] for w in answered.warnings] == [
        "its rate is 1000 Hz as study.toml says, though the file says 4000 Hz."
    ]
    kept = Recording.read(decimated(tmp_path / f"s{ending}", name, 1.0))  # every sample
    assert kept.rate_hz == pytest.approx(4000) and kept.warnings == ()


@pytest.mark.parametrize(
    "line", ["# Dezimaltrennzeichen: .", "# decimated to 4000 Hz", "# decimal places: 5"]
)
def test_lines_that_leave_no_sample_out(tmp_path: Path, line: str) -> None:
    file = text(tmp_path / "r.csv", f"# fs = 4000 Hz\n{line}\n", "base_m_s2,malleolus_m_s2")
    assert Recording.read(file).rate_hz == pytest.approx(4000)


def test_rates_of_several_channels_are_not_overruled_by_one(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    channels = [("base", BASE, 1e-3), ("malleolus", MALLEOLUS[::2].copy(), 2e-3)]
    with nptdms.TdmsWriter(str(tmp_path / "r.tdms")) as out:
        out.write_segment(
            [
                nptdms.ChannelObject(
                    "foot", name, values, {"wf_increment": step, "unit_string": "m/s^2"}
                )
                for name, values, step in channels
            ]
        )
    with pytest.raises(
        InputFileError, match=r"states rates of its channels.*study.toml 500 Hz"
    ):
        Recording.read(tmp_path / "r.tdms", layout=Layout(rate_hz=500.0))


@pytest.mark.parametrize(("values", "quoted"), [(("AC", "DC"), True), (("DC", "DC"), False)])
def test_coupling_counts_where_it_differs(
    tmp_path: Path, values: tuple[str, str], quoted: bool
) -> None:
    nptdms = pytest.importorskip("nptdms")
    about = [
        {"wf_increment": 1e-3, "unit_string": "m/s^2", "AI.Coupling": value} for value in values
    ]
    channels = zip(("base", "malleolus"), (BASE, MALLEOLUS), about, strict=True)
    with nptdms.TdmsWriter(str(tmp_path / "r.tdms")) as out:
        out.write_segment([nptdms.ChannelObject("foot", *channel) for channel in channels])
    says = "says AI.Coupling = 'AC' with base and 'DC' with malleolus, which is not applied"
    assert any(says in text for text in Recording.read(tmp_path / "r.tdms").warnings) is quoted
    warnings = Recording.read(text(tmp_path / "r.csv", f"Coupling,{','.join(values)}\n")).warnings
    assert bool(warnings) is quoted


SOUND = '[channels]\nbase = {column = "channel_1", unit = "V", sensitivity = "100 mV/g"}\n' + (
    'malleolus = {column = "channel_2", unit = "V", sensitivity = "100 mV/g"}\n'
)


@pytest.mark.parametrize(
    ("comment", "quoted"), [("channel 2 through a 20 Hz filter", True), ("made in room 4", False)]
)
def test_comments_of_sound_files(tmp_path: Path, comment: str, quoted: bool) -> None:
    soundfile = pytest.importorskip("soundfile")
    file = tmp_path / "r.wav"
    with soundfile.SoundFile(file, "w", 1000, 2, "FLOAT") as out:
        out.comment = comment
        out.write(np.column_stack([BASE, MALLEOLUS]) / 98)
    warnings = Recording.read(file, layout=layout(SOUND)).warnings
    assert any(f"'comment: {comment}', which is not applied" in text for text in warnings) is quoted


def test_a_sensitivity_that_is_alike_for_both_sensors_answers_no_gain(tmp_path: Path) -> None:
    soundfile = pytest.importorskip("soundfile")
    with soundfile.SoundFile(tmp_path / "r.wav", "w", 1000, 2, "FLOAT") as out:
        out.comment = "ankle: preamp +6 dB"
        out.write(np.column_stack([BASE, MALLEOLUS]) / 98)
    assert "+6 dB" in Recording.read(tmp_path / "r.wav", layout=layout(SOUND)).warnings[0]
    twice = "200 mV/g".join(SOUND.rsplit("100 mV/g", 1))
    assert Recording.read(tmp_path / "r.wav", layout=layout(twice)).warnings == ()


@pytest.mark.parametrize(
    "name",
    [
        "run3_gain_x2",
        "rec_20hz_filtered",
        "S16_LP20",
        "20Hz-highpass",
        "ankle delayed",
        "rec_20Hz_inverted",
    ],
)
def test_names_that_state_a_change_are_quoted(tmp_path: Path, name: str) -> None:
    says = f"the name {name!r} says that its numbers were changed, and nothing is undone"
    assert any(says in text for text in Recording.read(text(tmp_path / f"{name}.csv", "")).warnings)


@pytest.mark.parametrize(
    "name",
    [
        "S16_midstance_20Hz_2.3kg",
        "again",
        "unfiltered",
        "late_stance",
        "raw_20Hz",
        "bpm",
        "anna_61kg_x1",
        "20Hz_30s",
    ],
)
def test_other_names_are_not(name: str) -> None:
    assert not is_treated(name)


def test_a_group_that_is_named_so_is_quoted(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "r.h5", "w") as out:
        for key, values in COLUMNS.items():
            out[f"filtered/{key}"] = values
    assert "the name 'filtered' says" in Recording.read(tmp_path / "r.h5").warnings[0]


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("# ankle amplifier x2, not corrected", "sensitivity = 2"),
        ("# CH2 lags CH1 by 7 samples", "delay_s = 0.007"),
        ("# malleolus upside down", "sign = -1"),
        ("# Verstärkung Kanal 3 = 2", "sensitivity = 2"),
    ],
)
def test_what_study_toml_answers_is_not_quoted(tmp_path: Path, line: str, answer: str) -> None:
    file = text(tmp_path / "r.csv", f"{line}\n")
    assert "which is not applied" in Recording.read(file).warnings[0]
    assert Recording.read(file, layout=layout(f"[channels.malleolus]\n{answer}")).warnings == ()
    of_another = next(key for key in ("sign = 1", "delay_s = 0.0") if key[:4] != answer[:4])
    assert Recording.read(file, layout=layout(f"[channels.malleolus]\n{of_another}")).warnings


def test_what_an_answer_leaves_open_is_quoted(tmp_path: Path) -> None:
    file = text(tmp_path / "r.csv", "# ankle: x2, and 5 ms late by radio\n")
    assert Recording.read(file, layout=layout("[channels.malleolus]\nsensitivity = 2")).warnings
    both = layout("[channels.malleolus]\nsensitivity = 2\ndelay_s = 0.005")
    assert Recording.read(file, layout=both).warnings == ()


def test_lines_that_are_alike_for_both_sensors_are_not_quoted(tmp_path: Path) -> None:
    head = "CH1,base,DC,5V,Off,damped\nCH2,malleolus,DC,5V,{},damped\n"
    assert Recording.read(text(tmp_path / "a.csv", head.format("Off"))).warnings == ()
    assert "30Hz" in Recording.read(text(tmp_path / "b.csv", head.format("30Hz"))).warnings[0]


@pytest.mark.parametrize("unit", ["counts", "raw", "LSB", "%", "%FS", "percent"])
def test_numbers_without_a_unit_need_a_sensitivity(tmp_path: Path, unit: str) -> None:
    names = f"time_s,base [{unit}],malleolus [{unit}]"
    file = text(tmp_path / "r.csv", "", names, factor=500)
    way = rf"base is in {unit}, no unit of acceleration; give how many of them make 1 m/s\^2, a number"
    with pytest.raises(
        InputFileError, match=rf"(?i){way}, in study.toml \(\[channels.base\] sensitivity = "
    ):
        Recording.read(file)
    with pytest.raises(InputFileError, match=r"(?i)no unit of acceleration"):  # volts of what?
        Recording.read(file, layout=layout('[channels.base]\nsensitivity = "100 mV/g"'))
    answered = "[channels]\nbase = {sensitivity = 500}\nmalleolus = {sensitivity = 500}"
    good = Recording.read(file, layout=layout(answered))
    assert good.base_m_s2 == pytest.approx(BASE, abs=1e-4) and good.warnings == ()
    mapped = f'[channels]\nbase = {{column = 2, unit = "{unit}", sensitivity = 500}}\nmalleolus = {{sensitivity = 500}}'
    assert Recording.read(file, layout=layout(mapped)).base_m_s2 == pytest.approx(BASE, abs=1e-4)
