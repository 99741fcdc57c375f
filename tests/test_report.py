"""report.html: self-contained, escaped, and showing the numbers of the result."""

import shlex
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import pytest
from test_result import estimate, result

import mjcf
from fasbody.foot.model import load
from fasbody.presentation import COLOURS, readable
from identification import figures, report
from identification.derived_quantities import derived
from identification.result import FitResult
from viz.fitted import read


class Balanced(HTMLParser):
    """Collects outside addresses and checks that tags close."""

    VOID = ("meta", "link", "br", "img", "hr")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        local = ("#", "data:")
        self.outside += [v for n, v in attrs if n in ("src", "href", "xlink:href") and v and not v.startswith(local)]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


STARTS = tuple({"start": f"{i}", "cost": 10.0 * (i + 1), "evaluations": 9, "branch": "stiff ankle"} for i in range(3))


@pytest.fixture(scope="module")
def text() -> str:
    return report.html(result(starts=STARTS, source="<script>alert(1)</script>", warnings=("a < b",)))


def test_page_is_whole_self_contained_and_has_its_pictures(text: str) -> None:
    page = Balanced()
    page.feed(text)
    assert page.open == []
    assert page.outside == []
    assert text.count("<svg") == text.count("</svg>") == 4  # what a result shows without the fits behind it
    assert "synthetic data: nobody was measured" in text
    assert "131\u202f160" in text
    assert "<script" not in text


def test_names_from_files_are_escaped(text: str) -> None:
    assert "<script>" not in text
    assert "&lt;script&gt;" in text
    assert "a &lt; b" in text


@pytest.fixture(scope="module")
def whole(fitted: FitResult) -> str:
    """The page of a real fit."""
    return report.html(fitted)


def test_the_misfit_comes_before_all_numbers(whole: str, fitted: FitResult) -> None:
    """Four constants of a linear foot do not follow a nonlinear one."""
    assert fitted.best.p_value < 1e-16
    page = unescape(whole)
    assert "<td>< 1e-16</td>" in page and "e-17" not in page
    places = [page.index(text) for text in (fitted.misfit(), "Does the model follow", "<h2>Parameters", "<h2>Masses")]
    assert places == sorted(places)
    notes = [page.index(f"{text}</p>") for text in fitted.warnings]
    assert min(notes) == next(
        at for at, text in zip(notes, fitted.warnings, strict=True) if "larger than the noise" in text
    )


def test_a_page_has_every_figure_with_a_caption_that_counts(whole: str, fitted: FitResult) -> None:
    texts = report.captions(fitted)
    assert set(texts) == set(fitted.plots) - {"sensors", "waterfall"}  # one sensor; two ends are no cascade
    assert f"<td>{fitted.starts[0]['hits']}</td>" in whole
    assert whole.count("<figure") == whole.count("<svg") == len(texts)
    counted = set(texts) - {"correlation"}
    assert all("n = 3 recordings" in texts[name] for name in counted)
    assert COLOURS[0].lower() in whole.lower() and COLOURS[1].lower() not in whole.lower()  # one load


def test_a_page_says_what_the_legs_mass_costs_and_at_which_frequency_values_hold(fitted: FitResult, whole: str) -> None:
    page, rows = unescape(whole), derived(fitted).scale
    assert f"known to\n± {rows[0]['of_it_mass_percent']:.2g} % here" in page
    for row in rows:
        assert (
            f"<td>{row['half_width_percent']:.3g} %</td>" in page and f"<td>{readable(row['per_kg'], 3)}</td>" in page
        )
    assert "<th>value, at 18.2 Hz</th>" in page
    at_rest = report.rests(fitted)
    assert at_rest and set(at_rest) <= {"k_T_n_per_m", "k_F_n_per_m", "c_11_n_s_per_m", "c_21_n_s_per_m"}
    assert all(f"<td>{text}</td>" in page for text in at_rest.values())
    assert f"{fitted.departures.repeats[1:]}" in page


@pytest.mark.usefixtures("undrawn")
def test_a_value_at_its_bound_is_written_as_the_bound() -> None:
    keys = {"k_T_n_per_m": estimate(3e5, 1.0), "c_12_per_m": estimate(600.0, 1.0, True)}
    at_bound = replace(result().best, parameters=keys)
    page = report.html(result(branches=(at_bound,)))
    assert "at its bound, 600" in page
    assert "599 to" not in page and "to 601" not in page


def test_methods_have_the_numbers_of_the_fit(fitted: FitResult) -> None:
    text = " ".join(report.methods(fitted))
    for part in (
        "n = 3 recordings", "10 to 30 Hz", "sampled at 1000 Hz", "28 numbers", f"{fitted.best.dof} degrees of freedom",
        "m_S = 3.375 kg ± 15 %", "starts (seed 0)", "k_T [N/m]", "p < 1e-16", "at 18.2 Hz, the geometric mean",
        fitted.departures.repeats, "simulated in MuJoCo",
    ):  # fmt: skip
        assert part in text, part


@pytest.mark.parametrize("name", ["traces", "residuals", "parameters", "waterfall", "correlation"])
def test_every_figure_has_labelled_axes(name: str) -> None:
    figure = getattr(figures, name)(result(starts=STARTS))
    labels = [axis.get_xlabel() + axis.get_ylabel() + axis.get_title() for axis in figure.axes if axis.axison]
    assert any(labels)
    if name == "residuals":
        picture = figures.svg(figure)
        assert picture.startswith("<svg")
        assert picture == figures.svg(figures.residuals(result(starts=STARTS)))  # no date, no random names


@pytest.mark.usefixtures("undrawn")
def test_a_time_domain_result_without_mirror_twin_or_truth_has_a_page_too() -> None:
    plain = result(starts=STARTS, domain="time", branches=result().branches[:1], twin_mujoco_difference=None, truth={})
    text = report.html(plain)
    assert "equations of motion and MuJoCo, of the peak</td>\n<td>–</td>" in text
    assert "time domain" in text


@pytest.mark.usefixtures("undrawn")
def test_write(tmp_path: Path) -> None:
    files = report.write(result(starts=STARTS), tmp_path / "out")
    top = [file.name for file in (tmp_path / "out").iterdir()]
    assert sorted(top) == ["figures", "parameters.csv", "report.html", "result.json"]
    assert sorted(files) == sorted(file for file in (tmp_path / "out").rglob("*") if file.is_file())
    drawn = {file.name for file in files if file.parent.name == "figures"}
    assert drawn >= {"traces.svg", "traces.csv", "parameters.svg", "parameters.png", "parameters.csv"}


@pytest.mark.usefixtures("undrawn")
def test_the_command_to_the_moving_foot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It opens this result in the viewer as it stands, wherever model, folder and recording have their names from."""
    model, folder = tmp_path / "my foot.xml", tmp_path / "out"
    model.write_text(mjcf.text("two_dof"))
    monkeypatch.chdir(tmp_path)
    fit = result(model=model.name)
    report.write(fit, folder, Path("out"))
    page = unescape((folder / "report.html").read_text())
    command = page.partition("<code>fasbody view")[2].partition("</code>")[0]
    typed = shlex.split(command)
    assert typed == ["--model", "my foot.xml", "--result", "out/result.json"]
    values = read(Path(typed[3]), load(typed[1]).parameters)["branches"][0]["values"]
    assert values["k_T"] == fit.values()["k_T_n_per_m"]
    Path(fit.recordings[0].file).write_text("there is one")
    assert shlex.split(report.moving(fit))[-2:] == ["--recording", fit.recordings[0].file]
    odd = replace(fit, provenance={**fit.provenance, "study": "my study.toml"})
    assert shlex.split(report.moving(odd))[-2:] == ["--study", "my study.toml"]
