"""Models kept: saved and loaded, run from a state, forecast, exported."""

from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from scipy.io import loadmat

from fasbody.exceptions import InputFileError, SettingError
from identification.blackbox import keep, narx, nonlinear, pem, subspace
from identification.blackbox.data import Series
from identification.blackbox.polynomial import Orders


@pytest.fixture(scope="module")
def recording() -> Series:
    """A second-order plant with coloured noise, and a slight bend."""
    rng = np.random.default_rng(3)
    u, e = rng.standard_normal((2, 900))
    w = signal.lfilter([0, 1.0, 0.4], [1, -1.5, 0.8], u)
    v = signal.lfilter([1, 0.4], [1, -0.9], 0.1 * e)
    return Series(u, w + 0.01 * w**2 + v, 0.1, "plant").centred()


@pytest.fixture(scope="module")
def models(recording: Series) -> dict[str, keep.Model]:
    linear = Orders.of("oe", (2, 2, 1))
    return {
        "arx": pem.estimate("arx", recording, Orders.of("arx", (3, 3, 1))),
        "bj": pem.estimate("bj", recording, Orders.of("bj", (2, 1, 1, 2, 1))),
        "ss": subspace.estimate(recording, 3, refine=True),
        "hw": nonlinear.estimate(recording, linear, (2, 2)),
        "narx": narx.estimate(recording.cut(0, 600), [recording.cut(600, 900)], lags=2, degree=2, step=1).model,
    }  # type: ignore[dict-item]


def test_saved_and_loaded_models_answer_alike(models: dict[str, keep.Model], recording: Series, tmp_path: Path) -> None:
    for name, model in models.items():
        again = keep.load(keep.save(model, tmp_path / f"{name}.json"))
        assert type(again) is type(model) and again.label == model.label
        np.testing.assert_array_equal(again.simulate(recording), model.simulate(recording))
        np.testing.assert_allclose(again.residuals(recording), model.residuals(recording), rtol=1e-12)
        mat = loadmat(keep.save(model, tmp_path / f"{name}.mat"), simplify_cells=True)
        assert mat["label"] == model.label and len(mat["coefficients"]) == len(keep.named(model))
    found = keep.named(models["bj"])
    assert list(found) == ["b1", "b2", "c1", "d1", "f1", "f2"]
    assert abs(found["f1"]["value"] + 1.5) < 5 * found["f1"]["std_error"] + 0.05


def test_simulation_from_rest_and_from_a_state(models: dict[str, keep.Model]) -> None:
    """An input alone, against scipy's own simulation of the exported model; superposition gives the state's part."""
    u = np.random.default_rng(0).standard_normal(60)
    for name in ("arx", "bj", "ss"):
        model = models[name]
        _, expected = signal.dlsim(model.to_state_space(), u)[:2]  # type: ignore[union-attr]
        np.testing.assert_allclose(model.simulate(u), expected[:, 0], atol=1e-9)
    ss = models["ss"]
    x0 = np.array([1.0, -0.5, 0.2])
    free = [ss.C @ np.linalg.matrix_power(ss.A, k) @ x0 for k in range(60)]  # type: ignore[union-attr]
    np.testing.assert_allclose(ss.simulate(u, x0) - ss.simulate(u), free, atol=1e-9)
    hw = models["hw"]
    assert isinstance(hw, nonlinear.HammersteinWiener)
    small = 1e-6 * u
    offset = hw.simulate(np.zeros(60))
    np.testing.assert_allclose(hw.simulate(small) - offset, hw.linear.simulate(small), rtol=2e-2, atol=2e-7)


def test_forecasts_continue_the_recording(models: dict[str, keep.Model], recording: Series) -> None:
    """One step ahead they are the predictor; further on the standard deviation is that of the errors seen."""
    for name, model in models.items():
        known, ahead = recording.cut(0, 500), recording.u[500:520]
        value, spread = keep.forecast(model, known, 20, ahead)
        one = recording.cut(0, 501)
        expected = one.y[-1] - model.residuals(one)[-1]
        scale = float(np.std(recording.y))
        if name != "hw":
            assert value[0] == pytest.approx(expected, abs=0.01 * scale)
        assert np.std(value - recording.y[500:520]) < 0.5 * scale
        assert np.isnan(spread).all() or np.all(np.diff(spread) >= 0)
    errors = []
    for start in range(200, 860, 6):
        value, spread = keep.forecast(models["bj"], recording.cut(0, start), 6, recording.u[start : start + 6])
        errors.append((value - recording.y[start : start + 6]) / spread)
    assert np.mean(np.abs(errors) < 1.96) == pytest.approx(0.95, abs=0.06)


def test_export_to_python_control(models: dict[str, keep.Model]) -> None:
    pytest.importorskip("control")
    frequency = np.array([0.3, 1.0, 2.5])
    z = np.exp(2j * np.pi * frequency * 0.1)
    for name in ("arx", "bj", "ss"):
        model = models[name]
        plant, noise = model.to_control(), model.to_control("noise")  # type: ignore[union-attr]
        np.testing.assert_allclose([complex(plant(x)) for x in z], model.response(frequency).value, rtol=1e-6)
        assert abs(complex(noise(1e9)) - 1.0) < 1e-6  # H begins with e(t) itself
    num, den = models["bj"].noise  # type: ignore[union-attr]
    assert complex(models["bj"].to_control("noise")(z[0])) == pytest.approx(  # type: ignore[union-attr]
        np.polynomial.polynomial.polyval(1 / z[0], num) / np.polynomial.polynomial.polyval(1 / z[0], den)
    )
    with pytest.raises(SettingError, match="did you mean"):
        models["bj"].to_control("nois")  # type: ignore[union-attr]


def test_bad_files_are_sentences(tmp_path: Path, models: dict[str, keep.Model]) -> None:
    path = tmp_path / "model.json"
    for text, said in (("{", "cannot be read as JSON"), ("[]", "is no saved black-box model")):
        path.write_text(text)
        with pytest.raises(InputFileError, match=said):
            keep.load(path)
    whole = keep.save(models["arx"], path).read_text()
    path.write_text(whole.replace('"loss"', '"lost"'))
    with pytest.raises(InputFileError, match="incomplete model"):
        keep.load(path)
    path.write_text(whole.replace('"PolynomialModel"', '"Polynom"'))
    with pytest.raises(InputFileError, match="kind"):
        keep.load(path)
    with pytest.raises(SettingError, match=r"as \.json or \.mat"):
        keep.save(models["arx"], tmp_path / "model.pkl")
    with pytest.raises(SettingError, match="3 steps needs"):
        keep.forecast(models["arx"], Series(np.arange(50.0), np.arange(50.0) ** 2, 1.0), 3, [1.0])
    with pytest.raises(SettingError, match="not of -1"):
        keep.forecast(models["arx"], Series(np.arange(50.0), np.arange(50.0) ** 2, 1.0), -1)
