"""Several inputs and outputs: state space and ARX against a plant of known truth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from typer.testing import CliRunner

from fasbody.exceptions import FasError, InputFileError, RecordingError, SettingError
from identification.blackbox import mimo
from identification.blackbox.__main__ import app
from identification.blackbox.data import Series, read_csv

A = np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.1], [0.0, 0.0, 0.6]])
B = np.array([[1.0, 0.0], [0.3, 0.5], [0.0, 1.0]])
C = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -1.0]])
NAMES = (("u1", "u2"), ("y1", "y2"))
FREQUENCY = np.array([0.02, 0.1, 0.3])


def plant(n: int, noise: float, seed: int = 0) -> Series:
    rng = np.random.default_rng(seed)
    u, x, y = rng.standard_normal((n, 2)), np.zeros(3), np.empty((n, 2))
    for t in range(n):
        y[t] = C @ x
        x = A @ x + B @ u[t]
    y += noise * y.std(axis=0) * rng.standard_normal((n, 2))
    return Series(u, y, 1.0, "plant", NAMES)


def exact() -> np.ndarray:
    z = np.exp(2j * np.pi * FREQUENCY)
    return np.array([C @ np.linalg.solve(x * np.eye(3) - A, B) for x in z])


@pytest.fixture(scope="module")
def report() -> mimo.MimoReport:
    return mimo.identify(plant(1200, 0.03))


def test_orders_and_responses_are_found(report: mimo.MimoReport) -> None:
    ss, arx = report.models["ss"], report.models["arx"]
    assert ss.model.label == "SS (3)"
    for found, tolerance in ((ss, 0.03), (arx, 0.08)):
        error = np.abs(found.model.response(FREQUENCY) - exact()).max() / np.abs(exact()).max()  # type: ignore[operator]
        assert error < tolerance
        assert found.fit_percent > 94
    assert "y1 9" in str(report) and "u1, u2 to y1, y2" in str(report)


def test_intervals_of_arx_hold_the_truth() -> None:
    """y(t) = -A1 y(t-1) + B1 u(t-1) + e(t), 60 recordings."""
    a1, b1 = np.array([[-0.7, 0.2], [-0.1, -0.5]]), np.array([[1.0, 0.3], [0.0, -0.8]])
    truth = np.vstack([a1.T, b1.T])
    exact_gain = np.abs([
        np.linalg.solve(np.eye(2) + a1 * shift, b1 * shift)
        for shift in np.exp(-2j * np.pi * FREQUENCY)
    ])  # fmt: skip
    inside, gains = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u, e, y = rng.standard_normal((300, 2)), rng.standard_normal((300, 2)), np.zeros((300, 2))
        for t in range(1, 300):
            y[t] = -a1 @ y[t - 1] + b1 @ u[t - 1] + e[t]
        found = mimo.arx(Series(u, y, 1.0, "a", NAMES), 1, 1, 1)
        inside.append(np.abs(found.theta - truth) < 1.96 * found.std_error)
        apart = np.abs(np.abs(found.response(FREQUENCY)) - exact_gain)
        gains.append(apart < 1.96 * found.gain_std(FREQUENCY))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    assert np.mean(gains) == pytest.approx(0.95, abs=0.03)


def test_inputs_that_follow_from_one_another_are_refused_or_named() -> None:
    """A copy or a filtered copy leaves nothing to tell effects apart; a mostly equal input little."""
    rng = np.random.default_rng(0)
    u, other = rng.standard_normal((2, 800))
    for copy in (2 * u, signal.lfilter([0.0, 0.5, 0.3], [1.0], u)):
        series = Series(np.column_stack([u, copy]), plant(800, 0.1).y, 1.0, "pair", NAMES)
        with pytest.raises(RecordingError, match=r"'u1' follows from 'u2'|'u2' follows from 'u1'"):
            mimo.identify(series)
    near = Series(np.column_stack([u, u + 0.2 * other]), plant(800, 0.1).y, 1.0, "near", NAMES)
    warnings = mimo.identify(near, ("arx",), {"arx": (1, 1, 1)}).warnings["arx"]
    assert any("% of the input 'u2' follow from 'u1'" in text for text in warnings)


def test_residuals_name_the_signals_and_withhold_intervals() -> None:
    """A model without the second input leaves its effect on the first output alone."""
    rng = np.random.default_rng(1)
    u, e = rng.standard_normal((2, 1500, 2))
    y = np.vstack([np.zeros(2), u[:-1]]) + 0.3 * e
    y[3:, 0] += u[:-3, 1]  # later than the model's lags
    report = mimo.identify(Series(u, y, 1.0, "late", NAMES), ("arx",), {"arx": (1, 1, 1)})
    assert report.independent_p["arx"][0, 1] < 1e-6 < 1e-3 < report.independent_p["arx"][1].min()
    assert any("residuals of y1 depend on past u2" in text for text in report.warnings["arx"])
    assert np.isnan(report.models["arx"].model.gain_std(0.1)).all()


def answered(gain: float, delay: int, n: int = 1500) -> Series:
    """An ARX plant of two inputs, the first of which a controller moves where `gain` is not zero."""
    rng = np.random.default_rng(0)
    (u1, u2), e, y = rng.standard_normal((2, n)), 0.5 * rng.standard_normal(n), np.zeros(n)
    for t in range(n):
        y[t] = e[t] + (0.8 * y[t - 1] if t else 0.0) + (u1[t - delay] + 0.7 * u2[t - delay] if t >= delay else 0.0)
        u1[t] -= gain * y[t]
    return Series(np.column_stack([u1, u2]), y[:, None], 1.0, "answered", (("u1", "u2"), ("y",)))


@pytest.mark.parametrize(("gain", "delay"), [(0.0, 1), (0.4, 1), (0.0, 6)])
def test_feedback_and_delays_of_several_inputs(gain: float, delay: int) -> None:
    """In the loop the delay 0 would fit the controller: its intervals held a fifth."""
    report = mimo.identify(answered(gain, delay), ("arx", "ss"))
    arx, f = report.models["arx"].model, np.linspace(0.02, 0.45, 20)
    shift = np.exp(-2j * np.pi * f)
    gains = np.abs(np.outer(1 / (1 - 0.8 * shift), [1.0, 0.7]))
    assert delay - 1 <= arx.numbers[2] <= delay
    assert np.all(np.abs(np.abs(arx.response(f))[:, 0] - gains) < 3 * arx.gain_std(f)[:, 0])
    assert any("(feedback)" in text for text in report.warnings["arx"]) == (gain > 0)
    assert ("feedback biases this model" in report.warnings["ss"]) == (gain > 0)


@pytest.mark.parametrize("end", [np.inf, 1.5])
def test_an_output_at_the_end_of_its_range_has_no_intervals_with_several_inputs(end: float) -> None:
    series = answered(0.0, 1)
    one = mimo.identify(replace(series, y=np.clip(series.y, -end, end)), ("arx",), {"arx": (1, 1, 1)})
    assert np.isnan(one.models["arx"].model.gain_std(0.1)).all() == (end < np.inf)
    assert any("no intervals" in t and "an end of its range" in t for t in one.warnings["arx"]) == (end < np.inf)


def test_files_with_several_signals_are_never_guessed(tmp_path: Path) -> None:
    """u1 is not identified to u2 unasked; named, the command estimates the whole."""
    record = plant(400, 0.05)
    file = tmp_path / "plant.csv"
    table = np.column_stack([np.arange(400) * 0.1, record.u, record.y])
    np.savetxt(file, table, delimiter=",", header="time_s,u1,u2,y1,y2", comments="")
    with pytest.raises(InputFileError, match=r"4 signals.*--input u1,u2 --output y1,y2"):
        read_csv(file)
    done = CliRunner().invoke(
        app, [str(file), "--input", "u1,u2", "--output", "y1,y2", "--json", "--out", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["outputs"] == ["y1", "y2"] and {m["structure"] for m in document["models"]} == {"arx", "ss"}
    assert min(document["models"][1]["output_fit_percent"].values()) > 90
    assert json.loads((tmp_path / "result.json").read_text()) == document
    wrong = CliRunner().invoke(app, [str(file), "--input", "u1,u2", "--output", "y1", "--structures", "bj"])
    assert isinstance(wrong.exception, FasError) and "several inputs" in str(wrong.exception)
    with pytest.raises(SettingError, match="3 orders"):
        mimo.identify(record, ("arx",), {"arx": (2, 2)})


def test_what_serves_one_input_and_one_output_alone_is_refused(tmp_path: Path) -> None:
    whole = plant(200, 0.1)
    path = tmp_path / "plant.csv"
    np.savetxt(path, np.hstack([whole.u, whole.y]), delimiter=",", header="u1,u2,y1,y2", comments="")
    both = [str(path), "--sample-time", "1", "--input", "u1,u2", "--output"]
    for options in (
        ["y1,y2", "--robust"], ["y1,y2", "--input-noise", "1"],
        ["y1,y2", "--pool"], ["y1,y1"], ["y1,y2", "--split", "2"], ["y1,y2", "--detrend", "9"],
    ):  # fmt: skip
        assert isinstance(CliRunner().invoke(app, [*both, *options]).exception, FasError)


def test_a_trend_is_taken_off_several_outputs(tmp_path: Path) -> None:
    whole = plant(800, 0.05)
    drifting = whole.y + 3 * whole.y.std(axis=0) * np.linspace(0, 1, 800)[:, None]
    path = tmp_path / "plant.csv"
    np.savetxt(path, np.hstack([whole.u, drifting]), delimiter=",", header="u1,u2,y1,y2", comments="")
    options = ["--sample-time", "1", "--input", "u1,u2", "--output", "y1,y2", "--structures", "ss", "--json"]
    result = CliRunner().invoke(app, [str(path), *options, "--orders", "ss=3", "--detrend", "1"])
    assert json.loads(result.stdout)["models"][0]["fit_percent"] > 93
