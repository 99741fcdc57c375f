"""The public face: names that are imported when they are asked for, and results that show themselves."""

import ast
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pytest

import fasbody as fb
import identification
import viz
from fasbody.exceptions import InputFileError, RecordingError, SettingError
from fasbody.foot.model import Foot
from fasbody.presentation import NOTES, ROWS, WIDTH, Presented, Sheet, Tabled, cell, unit_of

ROOT = Path(__file__).parent.parent
FACES = [fb, identification, viz]
HEAVY = {"numpy", "scipy", "pandas", "matplotlib", "mujoco", "numba", "typer", "rich", "tornado"}


def python(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()


def test_importing_the_packages_imports_nothing_else() -> None:
    loaded = python("import sys, fasbody, identification, viz; print(*sys.modules)").split()
    assert not HEAVY & set(loaded)
    assert {name for name in loaded if name.split(".")[0] in ("fasbody", "identification", "viz", "mjcf")} == {
        "fasbody", "identification", "viz",
    }  # fmt: skip


@pytest.mark.parametrize("package", FACES, ids=lambda package: package.__name__)
def test_every_name_is_there_and_a_type_checker_sees_the_same(package: Any) -> None:
    if package is viz:
        pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")
    assert set(package.__all__) <= set(dir(package))
    tree = ast.parse(Path(package.__file__).read_text())
    guard = next(node for node in tree.body if isinstance(node, ast.If))
    namespace: dict[str, Any] = {}
    exec(compile(ast.Module(guard.body, []), package.__file__, "exec"), namespace)
    for node in guard.body:
        if isinstance(node, ast.Assign):  # another name
            del namespace[ast.unparse(node.value)]
    assert package.__all__ == sorted({*namespace} - {"__builtins__", "__annotations__"})
    for name in package.__all__:
        assert getattr(package, name) is namespace[name], name
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_the_version_is_that_of_the_distribution() -> None:
    written = next(line for line in (ROOT / "pyproject.toml").read_text().splitlines() if line.startswith("version"))
    assert written == f'version = "{fb.__version__}"'


def test_functions_and_rooms_of_like_names_stand_side_by_side() -> None:
    """Whichever is imported first: `fb.simulate` stays callable, and `fasbody.recording.study` importable."""
    lines = (
        "import fasbody.recording.study, fasbody.foot.simulate, fasbody.arch.load",
        "assert callable(fb.simulate) and callable(fb.load) and callable(fb.sine) and fb.Study.read",
        "import viz.feet, viz.foot; assert callable(viz.show) and callable(viz.export)",
    )
    code = ["import sys"]
    for order in (lines, lines[::-1]):
        code.append("for name in [n for n in sys.modules if n.split('.')[0] in ('fasbody', 'identification', 'viz')]:")
        code += ["    del sys.modules[name]", "import fasbody as fb, viz", *order, "print(fb.simulate.__name__)"]
    assert python("\n".join(code)).split() == ["simulate"] * 2


@dataclass(frozen=True, repr=False)
class Lines(Presented):
    count: int
    figures: ClassVar[str] = "nothing.at.all"
    plots: ClassVar[tuple[str, ...]] = ("curve",)

    def sheet(self) -> Sheet:
        rows = [(str(i), "<b>") for i in range(self.count)]
        return Sheet("many", ("number", "text"), rows, ["a note " * 40] * self.count)

    def records(self) -> list[dict[str, Any]]:
        return [{"number": i, "half": i / 2} for i in range(self.count)]


def test_a_result_of_any_length_is_a_screen() -> None:
    text = repr(Lines(500))
    assert max(map(len, text.splitlines())) <= WIDTH
    assert f"... {500 - ROWS} more" in text and f"... and {500 - NOTES} more." in text
    assert len(text.splitlines()) < 50
    assert repr(Lines(2)).splitlines()[:3] == ["many", "number  text", "0       <b>"]
    assert " more" not in repr(Lines(NOTES + 1)) and " more" not in repr(Lines(ROWS + 1)).split("a note")[0]
    html = Lines(2)._repr_html_()
    assert "&lt;b&gt;" in html and "<td><b>" not in html


def test_units_stand_at_the_end_of_a_name_as_it_is_written() -> None:
    names = ("m_S", "m_S_kg", "c_12_per_m", "k_T_n_per_m", "c_21_n_s_per_m", "frequency_hz_std", "delay_s", "k_T")
    assert [unit_of(name) for name in names] == ["", "kg", "1/m", "N/m", "N s/m", "Hz", "s", ""]


def test_a_cell_of_an_array_passes_over_holes() -> None:
    assert cell(np.array([2.0, np.nan, 1.0])) == "3, 1 to 2, 1 without a number"
    assert cell(np.full(2, np.nan)) == "2" and cell(np.array([[1, 3]])) == "1x2, 1 to 3"


@dataclass(frozen=True)
class Piece(Tabled):
    name: str
    time_s: np.ndarray
    mass_kg: float = 72.5
    inside: "Piece | None" = None
    made: Callable[[], None] = lambda: None


def test_a_data_class_is_a_table_of_its_fields() -> None:
    html = Piece("<i>", np.array([0.0, 0.5]), inside=Piece("b", np.zeros((2, 3))))._repr_html_()
    assert "&lt;i&gt;" in html and "<i>" not in html
    assert "<td>time_s</td><td>2, 0 to 0.5</td><td>s</td>" in html
    assert "<td>mass_kg</td><td>72.5</td><td>kg</td>" in html
    assert "<td>inside</td><td>Piece</td>" in html and "made" not in html


def test_whatever_is_public_shows_itself_in_a_notebook(fitted: identification.FitResult, foot: Foot) -> None:
    """Every class of the three packages, and each as it is met; what a command or a server needs is none of them."""
    pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")
    for package in FACES:
        for name in package.__all__:
            thing = getattr(package, name)
            if isinstance(thing, type) and thing not in (fb.FasError, viz.Show, viz.ModeShow):
                assert callable(getattr(thing, "_repr_html_", None)), name
    study = fb.bundled()
    recording = study.recordings[0]
    series = [identification.series_of(study.recordings[i]) for i in (2, 4)]
    report = identification.identify(series, ["oe"], {"oe": (2, 2, 1)})
    for thing, told in (
        (foot, "k_T"), (study, "10hz_0kg.csv"), (recording, "malleolus_m_s2"), (recording.condition, "midstance"),
        (fb.sine(20, 1), "sine 20 Hz"), (fb.Arch.nominal(), "theta_20"), (fitted, "k_T [N/m]"), (fitted["k_T"], "95 %"),
        (fitted.recordings[0], "fit_percent"), (identification.Settings(), "starts"), (report, "held-out"),
        (report.models["oe"], "selection"), (report.models["oe"].best.model, "theta"), (viz.Settings(), "frequency"),
    ):  # fmt: skip
        html = thing._repr_html_()
        assert told in html and html.count("<table>") == html.count("</table>") == 1, type(thing).__name__


def test_numbers_of_a_result_come_back_from_its_files(tmp_path: Path) -> None:
    one, two = Lines(3).write(tmp_path / "new")
    assert pd.read_csv(one).to_dict("records") == Lines(3).records()
    assert pd.read_json(two).to_dict("records") == Lines(3).records()
    with pytest.raises(SettingError, match=r"unknown plot 'curves', did you mean 'curve'\? \(valid: curve\)"):
        Lines(3).plot("curves")


def arrays() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A mass on a spring and a damper, shaken at 20 Hz: the closed form."""
    t = np.arange(0, 2, 1e-3)
    w = 2 * np.pi * 20
    m, c, k = 4.0, 300.0, 1.2e5
    H = (k + 1j * w * c) / (k - m * w**2 + 1j * w * c)
    base = 8.95 * np.exp(1j * w * t)
    return t, base.real, (H * base).real


def test_recordings_of_numpy_pandas_and_xarray_are_the_same() -> None:
    t, base, malleolus = arrays()
    plain = fb.Recording.from_arrays(t, base, malleolus, body_mass_kg=72.5)
    stamps = pd.date_range("2026-01-01", periods=t.size, freq="ms")
    frame = pd.DataFrame({"base": base, "malleolus": malleolus}, index=stamps)
    forms = [fb.Recording.from_arrays(frame.index, frame["base"], frame["malleolus"], body_mass_kg=72.5)]
    if xarray := pytest.importorskip("xarray", reason="pip install 'fasbody[statistics]'"):
        labelled = xarray.Dataset({name: ("time", frame[name].to_numpy()) for name in frame}, {"time": t})
        forms.append(
            fb.Recording.from_arrays(labelled["time"], labelled["base"], labelled["malleolus"], body_mass_kg=72.5)
        )
    for other in forms:
        np.testing.assert_allclose(other.time_s, plain.time_s, atol=1e-9)
        np.testing.assert_array_equal(other.malleolus_m_s2, plain.malleolus_m_s2)
        assert other.condition == plain.condition
    base[:] = 0
    assert np.ptp(plain.base_m_s2) > 17  # what the caller does to his arrays changes nothing


def test_the_index_of_a_series_is_not_looked_at() -> None:
    """Rows that were filtered, sorted or counted from elsewhere: sample by sample, as numpy would."""
    t, base, malleolus = arrays()
    plain = fb.Recording.from_arrays(t, base, malleolus, others={"foot": base})
    odd = pd.Index(np.arange(t.size)[::-1] + 7)
    time, b, m = (pd.Series(values, index=odd) for values in (t, base, malleolus))
    made = [
        fb.Recording.from_arrays(time, b, m, others={"foot": b}),
        fb.Recording.from_arrays(pd.Series(base, index=t).index, b, m, others={"foot": b}),
        fb.Recording(time, b, m, others={"foot": b}),
        fb.Recording.from_table(pd.DataFrame({"time_s": time, "base_m_s2": b, "malleolus_m_s2": m, "foot_m_s2": b})),
    ]
    for other in made:
        for name, values in plain.channels.items():
            assert type(other.channels[name]) is np.ndarray
            np.testing.assert_array_equal(other.channels[name], values)


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_an_index_of_datetimes_is_the_time(zone: str | None) -> None:
    t, base, malleolus = arrays()
    stamps = pd.date_range("2026-01-01", periods=t.size, freq="ms", tz=zone)
    frame = pd.DataFrame({"base_m_s2": base, "malleolus_m_s2": malleolus}, index=stamps)
    for index in (stamps, stamps.rename("clock"), stamps - stamps[0]):
        np.testing.assert_allclose(fb.Recording.from_table(frame.set_index(index)).time_s, t, atol=1e-9)
    np.testing.assert_allclose(fb.Recording.from_arrays(stamps, base, malleolus).time_s, t, atol=1e-9)
    assert fb.samples(stamps, frame["base_m_s2"]).duration == pytest.approx(t[-1])
    with pytest.raises(InputFileError, match="neither a time nor a sampling rate"):
        fb.Recording.from_table(frame.set_index(pd.Index(t)))  # numbers without a name may be anything


def test_a_simulation_takes_series(foot: Foot) -> None:
    t, base, _ = arrays()
    shown = slice(100, 200)
    motions = [fb.samples(t[shown], base[shown]), fb.samples(pd.Series(t)[shown], pd.Series(base)[shown])]
    values = [{"k_F": np.array([1e5, 2e5])}, pd.Series({"k_F_n_per_m": pd.Series([1e5, 2e5], index=["a", "b"])})]
    one, other = (fb.simulate(foot, m, values=v).malleolus for m, v in zip(motions, values, strict=True))
    np.testing.assert_array_equal(one, other)
    row = pd.DataFrame({"k_T_n_per_m": [1e5], "c_11_n_s_per_m": [300.0]}).iloc[0]
    assert foot.with_values(row).values() == foot.with_values({"k_T": 1e5, "c_11": 300.0}).values()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"base": np.zeros((3, 2))}, r"base has the shape \(3, 2\)"),
        ({"malleolus": np.zeros(5)}, "malleolus has 5 samples and time_s has 2000"),
        ({"base": ["a", "b"]}, "base holds something other than numbers"),
        ({"body_mass_kg": 7.2}, "the body mass is 7.2 kg"),
        (
            {"body_mass_kg": "72.5 kg"},
            "recording: the body mass is '72.5 kg'; give a number of kilograms, such as 72.5.",
        ),
        ({"added_mass_kg": [2.3]}, r"the added mass is \[2.3\]; give a number of kilograms"),
        ({"frequency_hz": "20 Hz"}, "the frequency is '20 Hz'; give a number of hertz"),
    ],
)
def test_arrays_that_are_no_recording_are_refused(change: dict[str, Any], sentence: str) -> None:
    t, base, malleolus = arrays()
    with pytest.raises(RecordingError, match=sentence):
        fb.Recording.from_arrays(**{"time_s": t, "base": base, "malleolus": malleolus, **change})
