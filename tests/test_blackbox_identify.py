"""The whole way from files to report: command, JSON, figures, sentences."""

import csv
import io
import json
import subprocess
from pathlib import Path

import linear_foot as foot
import numpy as np
import pytest
from recorded_foot import record
from rich.console import Console
from scipy.signal import lfilter
from typer.testing import CliRunner

from fasbody.console import command_line
from fasbody.exceptions import FasError, SettingError
from identification.blackbox import figures, keep, pem, report
from identification.blackbox.__main__ import app, parse_orders
from identification.blackbox.data import Series
from identification.blackbox.identify import identify
from identification.blackbox.polynomial import Orders

GOOD = "".join(f"{k},{k % 5},{k % 7}\n" for k in range(60))
ORDERS = "arx=4,4,1;armax=4,4,4,1;oe=4,4,1;bj=4,1,1,4,1;ss=4;hw=4,4,1,3,1"


def write(path: Path, one: Series) -> Path:
    header = "time_s,base_m_s2,malleolus_m_s2"
    np.savetxt(path, np.column_stack([one.time, one.u, one.y]), delimiter=",", header=header, comments="")
    return path


def invoke(*arguments: str) -> subprocess.CompletedProcess[str]:
    """`python -m identification.blackbox` without the start of a new interpreter."""
    result = CliRunner().invoke(app, list(arguments))
    return subprocess.CompletedProcess(arguments, result.exit_code, result.stdout, result.stderr)


@pytest.mark.long
def test_command_prints_one_json_document_and_writes_figures(tmp_path: Path) -> None:
    file = write(tmp_path / "prbs.csv", record(foot.prbs(1600)))
    done = invoke(str(file), "--orders", ORDERS, "--json", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["excitation_rank"] == 200
    by_name = {m["structure"]: m for m in document["models"]}
    assert set(by_name) == {"arx", "armax", "oe", "bj", "ss", "hw"}
    oe = by_name["oe"]
    assert oe["orders"] == {"nb": 4, "nf": 4, "nk": 1}
    assert 95 < oe["fit_percent"] < 99.5
    poles = np.sort_complex([complex(*p) for p in oe["poles"]])
    slow = np.sort_complex(np.roots(foot.transfer()[1]))[2:]
    np.testing.assert_allclose(poles[2:], slow, atol=0.02)
    assert oe["aic"] < oe["bic"] < by_name["arx"]["bic"]
    assert oe["fpe"] == pytest.approx(np.exp(oe["aic"]), rel=1e-4)
    assert isinstance(oe["warnings"], list)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    pictures = {f"prbs_{kind}.png" for kind in ("output", "bode", "residuals", "poles_zeros")}
    kept = {f"prbs_{name}.json" for name in by_name}
    assert names == pictures | kept | {"result.json", "models.csv", "report.html"}
    loaded = keep.load(tmp_path / "out" / "prbs_oe.json")
    np.testing.assert_allclose(np.sort_complex(loaded.poles()), poles, rtol=1e-9)
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("<svg") == 4 and "OE (4, 4, 1)" in page and "http://" not in page.split("</style>")[0]
    for picture in pictures:
        assert (tmp_path / "out" / picture).read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "out" / "result.json").read_text()) == document
    assert len((tmp_path / "out" / "models.csv").read_text().splitlines()) == 7
    assert "OE (4, 4, 1)" in done.stderr
    assert "input base_m_s2, output malleolus_m_s2, sample time 0.001 s" in done.stderr
    assert document["recordings"][0]["output"] == "malleolus_m_s2"


def test_single_sine_says_what_it_identifies(tmp_path: Path) -> None:
    file = write(tmp_path / "sine.csv", record(foot.sine(20.0, 2000)))
    done = invoke(str(file), "--structures", "oe,ss", "--orders", "oe=4,4,1;ss=4", "--json")
    document = json.loads(done.stdout)
    assert document["excitation_rank"] == 2
    for model in document["models"]:
        assert any("excites rank 2" in text for text in model["warnings"])
        assert model["response"]["frequency_hz"] == pytest.approx([20.0], abs=0.01)
        assert model["response"]["gain"][0] == pytest.approx(abs(foot.response(np.array([20.0]))[0]), rel=5e-3)
    assert "a single sine of 20 Hz" in done.stderr


def test_several_files_make_a_table_and_pool(tmp_path: Path) -> None:
    files = [str(write(tmp_path / f"f{f:g}.csv", record(foot.sine(f, 1200), int(f)))) for f in (10.0, 20.0, 35.0)]
    alone = invoke(*files, "--structures", "oe", "--orders", "2,2,1")
    assert alone.returncode == 0, alone.stderr
    assert "form of Table 3.2" in alone.stderr and "--pool" in alone.stderr
    pooled = invoke(*files, "--structures", "oe", "--orders", "2,2,1", "--pool", "--json")
    document = json.loads(pooled.stdout)
    assert document["excitation_rank"] == 6
    assert len(document["models"]) == 1


@pytest.mark.parametrize(
    ("content", "options", "sentence"),
    [
        ("0,1,2\n1,2,3\n", (), "2 samples are too few"),
        (GOOD, ("--structures", "arma"), "did you mean"),
        (GOOD, ("--split", "1.5"), "not between 0 and 1"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, options: tuple[str, ...], sentence: str
) -> None:
    file = tmp_path / "bad.csv"
    file.write_text("t,u,y\n" + content)
    with pytest.raises(SystemExit) as ended:
        command_line(lambda: app([str(file), "--json", *options]))
    out, said = capsys.readouterr()
    assert (ended.value.code, out) == (2, "")
    assert said.startswith("error:") and sentence in said and "Traceback" not in said


def test_orders_option() -> None:
    assert parse_orders("auto", ("oe",)) == {}
    assert parse_orders("4,4,1", ("oe",)) == {"oe": (4, 4, 1)}
    assert parse_orders("oe=4,4,1; ss=3", ("oe", "ss")) == {"oe": (4, 4, 1), "ss": (3,)}
    for text in ("bj=1,1,1,1,1", "oe=a", "4,4,1"):
        with pytest.raises(SettingError) as caught:
            parse_orders(text, ("oe", "ss"))
        assert caught.value.setting == "orders"


def test_automatic_orders_on_a_short_record() -> None:
    """All structures selected without any order given, on 700 samples of an unrelated first-order plant."""
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal(700), np.zeros(700)
    for t in range(1, 700):
        y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1]
    one = Series(u, y + 0.05 * rng.standard_normal(700), 0.1, "lag")
    found = identify(one, ("arx", "oe", "bj", "ss", "armax"))
    assert found.failures == ()
    frequency = np.array([0.05, 0.5, 2.0])
    shift = np.exp(-2j * np.pi * frequency * 0.1)
    exact = 0.5 * shift / (1 - 0.8 * shift)
    for name in ("oe", "bj", "ss", "armax"):
        assert np.abs(found.models[name].best.model.response(frequency).value / exact - 1).max() < 0.02
    assert found.models["oe"].best.model.parameters <= 4
    text = str(found)
    assert text.startswith("lag\n") and "Input: rank" in text
    assert report.csv_text([found]).count("\n") == 6


def test_finite_impulse_response_by_output_error() -> None:
    """No poles at all: n_f = 0 is a sound model, here the exact one, and its coefficients are counted by the guard."""
    rng = np.random.default_rng(2)
    u = rng.standard_normal(600)
    y = np.convolve(u, [0.0, 1.0, -0.5, 0.25])[:600] + 0.01 * rng.standard_normal(600)
    found = identify(Series(u, y, 0.1, "fir"), ("oe",), {"oe": (3, 0, 1)})
    np.testing.assert_allclose(found.models["oe"].best.model.theta, [1.0, -0.5, 0.25], atol=0.005)  # type: ignore[attr-defined]
    wide = identify(record(foot.sine(20.0, 1000)), ("oe",), {"oe": (4, 0, 1)})
    assert "the plant has 4 coefficients" in wide.models["oe"].warnings[0]


def test_results_folder_is_tried_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("identification.blackbox.identify.identify", lambda *_: pytest.fail("estimated first"))
    recording = write(tmp_path / "a.csv", record(foot.prbs(200)))
    result = CliRunner().invoke(app, [str(recording), "--out", str(tmp_path / "file")])
    assert isinstance(result.exception, FasError) and "is a file; name a folder" in str(result.exception)


def test_intervals_are_withheld_where_residuals_are_not_white() -> None:
    """ARX of an output-error foot leaves coloured residuals, and its formal interval misses the true gain."""
    one = record(foot.prbs(3000))
    found = identify(one, ("arx", "oe"), {"arx": (4, 4, 1), "oe": (4, 4, 1)})
    plain = pem.estimate("arx", one.split()[0], Orders.of("arx", (4, 4, 1))).response(np.array([20.0]))
    assert abs(abs(plain.value[0]) - abs(foot.response(np.array([20.0]))[0])) > 5 * plain.gain_std[0]
    arx = found.models["arx"]
    assert np.isnan(arx.response.gain_std).all() and np.isnan(arx.best.model.std_error).all()  # type: ignore[attr-defined]
    assert any("valid only for white residuals" in text for text in arx.warnings)
    assert np.isfinite(found.models["oe"].response.gain_std).all()
    assert figures.bode(found).axes[0].get_legend_handles_labels()[1][0] == "ARX (4, 4, 1) (no valid band)"


@pytest.mark.parametrize(
    ("name", "small", "large"),
    [("oe", (1, 1, 1), (4, 2, 1)), ("hw", (1, 1, 1, 1, 1), (4, 2, 1, 1, 1)), ("ss", (1,), (4,))],
)
def test_residuals_that_depend_on_past_inputs_withhold_intervals_of_every_structure(
    name: str, small: tuple[int, ...], large: tuple[int, ...]
) -> None:
    """The intervals of an output-error plant too small held the truth at an eighth of the frequencies."""
    rng = np.random.default_rng(21)
    u = rng.standard_normal(2000)
    w = lfilter([0, 1, 0.5, 0.2, 0.1], [1, -0.3, 0.1], u)
    one = Series(u, w + 0.5 * np.std(w) * rng.standard_normal(2000), 1.0, "late")
    for orders, given in ((small, False), (large, True)):
        model = identify(one, (name,), {name: orders}).models[name]
        assert np.isfinite(model.response.gain_std).all() == given
        assert any("no standard errors or band: its residuals depend" in text for text in model.warnings) != given


def test_noise_of_the_input_widens_intervals_where_it_is_given() -> None:
    """A sensor with 30 % noise lowers the gain by 8 %, and no test of one recording shows it."""
    rng = np.random.default_rng(0)
    u, f = rng.standard_normal(2000), np.linspace(0.02, 0.45, 20)
    w = lfilter([0, 1, 0.5], [1, -1.5, 0.8], u)
    noisy = u + 0.3 * rng.standard_normal(2000)
    one = Series(noisy, w + 0.02 * np.std(w) * rng.standard_normal(2000), 1.0, "noisy")
    shift = np.exp(-2j * np.pi * f)
    truth = np.abs((shift + 0.5 * shift**2) / (1 - 1.5 * shift + 0.8 * shift**2))
    for noise, least, most in ((0.0, 0.0, 0.3), (0.3, 0.9, 1.0)):
        found = identify(one, ("bj",), {"bj": (2, 2, 2, 2, 1)}, input_noise=noise)
        at = found.models["bj"].selection.curve(f)
        assert least <= np.mean(np.abs(np.abs(at.value) - truth) < 1.96 * at.gain_std) <= most
        assert any("--input-noise RMS widens them" in text for text in found.notes) == (noise == 0.0)
    with pytest.raises(SettingError, match="input noise 2 is not between 0 and the standard deviation 1") as caught:
        identify(one, ("oe",), {"oe": (2, 2, 1)}, input_noise=2.0)
    assert caught.value.setting == "input_noise"


def test_table_and_csv_give_the_gain_where_the_input_is_strongest() -> None:
    """Two lines, the stronger one where the foot answers less; table, CSV and 95 % interval agree."""
    u = foot.sine(8.0, 2000) + 3.0 * foot.sine(45.0, 2000)
    found = identify(record(u), ("oe",), {"oe": (4, 4, 1)})
    row = next(csv.DictReader(io.StringIO(report.csv_text([found]))))
    assert float(row["gain_frequency_hz"]) == pytest.approx(45.0, abs=0.5)
    heading = str(report.single_table(found).columns[3].header)
    assert heading == f"gain at {float(row['gain_frequency_hz']):.4g} Hz\n(95 %)"
    gain, interval = str(next(report.single_table(found).columns[3].cells)).split(" +- ")
    assert float(gain) == pytest.approx(float(row["gain"]), rel=1e-3)
    assert float(interval) == pytest.approx(1.96 * float(row["gain_std"]), rel=0.2)


@pytest.mark.long
def test_eighty_columns_hold_the_gain_of_every_structure() -> None:
    """Whatever the labels: nothing is cut, no number broken in two."""
    rng = np.random.default_rng(1)
    found = identify(record(foot.prbs(1500) + 0.1 * rng.standard_normal(1500)), ("arx", "bj", "oe", "hw", "narx"))
    table = report.single_table(found)
    screen = Console(width=80, record=True, file=io.StringIO())
    screen.print(table)
    rows = screen.export_text().splitlines()
    assert sum(str(table.columns[3].header).splitlines()[0] in row for row in rows) == 1
    for label, gain in zip(table.columns[0].cells, table.columns[3].cells, strict=True):
        assert sum(str(label) in row and f" {gain} " in row for row in rows) == 1
