"""Held-out errors by hand, leave one frequency out in all modes, linear against nonlinear damping."""

import numpy as np
import pytest
from study_cases import NONLINEAR, power_laws, record, study

from fasbody.exceptions import SettingError
from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from identification.fitting import Settings
from identification.harmonics import Line
from identification.study.validation import (
    compare,
    compare_damping,
    interpolated,
    leave_one_frequency_out,
    predicted,
    quick_fit,
    values_of,
)  # fmt: skip

F = (10.0, 15.0, 20.0, 30.0, 50.0)


def constant(f: float, load: float) -> dict[str, float]:
    return power_laws(20.0, load)


def linear(f: float, load: float) -> dict[str, float]:
    return {**constant(f, load), **dict.fromkeys(NONLINEAR, 0.0)}


def test_errors_by_hand() -> None:
    line = Line.of(record(power_laws, 20.0))
    off = line.malleolus.amplitudes + np.array([0.01, 0.02j, 0, 0, 0])
    found = compare(line, off)
    gain = abs(line.malleolus.amplitudes[0] / line.base.amplitudes[0])
    variance = line.malleolus.std**2 + (gain * line.base.std) ** 2
    assert found["chi_square"] == pytest.approx(0.01**2 / variance[0] + 0.02**2 / variance[1])
    assert found["numbers"] == 10
    size = np.sqrt(np.sum(np.abs(line.malleolus.amplitudes) ** 2))
    assert found["percent"] == pytest.approx(100 * np.hypot(0.01, 0.02) / size)


def test_mujoco_predicts_as_the_equations_do(foot: Foot) -> None:
    line = Line.of(record(power_laws, 20.0))
    values = {**foot.values(), **power_laws(20.0, 0.0)}
    equations, mujoco = (predicted(line, foot, values, use) for use in (True, False))
    np.testing.assert_allclose(equations, mujoco, atol=1e-7 * abs(equations[0]))
    assert compare(line, equations)["chi_square"] < 40
    late = predicted(line, foot, {**values, "delay": 1e-3}, True)
    np.testing.assert_allclose(late / equations, np.exp(-2j * np.pi * 20 * np.arange(1, 6) * 1e-3), rtol=1e-4)


def test_interpolation_by_hand() -> None:
    f, q = np.array([20.0, 10.0, 40.0]), np.array([[3.0, 4.0], [1.0, 5.0], [7.0, 0.0]])
    np.testing.assert_allclose(interpolated(np.sqrt(10 * 20), f, q), [2.0, 4.5])
    np.testing.assert_allclose(interpolated(50.0, f, q), q[2])


def test_estimates_that_are_power_laws_predict_what_is_left_out(foot: Foot) -> None:
    """True values at the neighbours interpolate to the truth in log f; at the ends they are held, and miss."""
    data = study(power_laws, F, (0.0,))
    found = leave_one_frequency_out(
        data, foot, "per-recording", estimates=[power_laws(f, 0.0) for f in F]
    )  # fmt: skip
    assert [row["edge"] for row in found["rows"]] == [True, False, False, False, True]
    assert all(row["chi_square"] < 3 * row["numbers"] for row in found["rows"] if not row["edge"])
    assert all(row["chi_square"] > 30 * row["numbers"] for row in found["rows"] if row["edge"])
    assert found["percent"] == pytest.approx(np.median([row["percent"] for row in found["rows"][1:-1]]))
    # by hand for 15 Hz: the estimates of 10 and 20 Hz in log f, predicted and compared
    w = np.log(15 / 10) / np.log(20 / 10)
    a, b = power_laws(10.0, 0.0), power_laws(20.0, 0.0)
    values = {n: a[n] ** (1 - w) * b[n] ** w if a[n] > 0 else a[n] for n in a}
    line = Line.of(checked(data[1]))
    by_hand = compare(line, predicted(line, foot, {**foot.values(), **values}, True))
    assert found["rows"][1]["chi_square"] == pytest.approx(by_hand["chi_square"], rel=1e-6)


def test_pooled_constants_predict_constants_and_not_a_trend(foot: Foot) -> None:
    settings = Settings(departures=False, starts=1, threads=1)
    good = leave_one_frequency_out(study(constant, F[:3], (0.0,)), foot, "pooled", settings)
    bad = leave_one_frequency_out(study(power_laws, F[:3], (0.0,)), foot, "pooled", settings)
    assert good["chi_square_per_number"] < 4
    assert bad["chi_square_per_number"] > 100
    assert bad["percent"] > 5 * good["percent"]
    assert good["mode"] == "pooled"


@pytest.mark.long
def test_criteria_know_linear_damping_from_nonlinear(foot: Foot) -> None:
    settings = Settings(departures=False, starts=1, threads=1)
    bent, _ = compare_damping(study(constant, F[:4], (0.0,)), foot, settings)
    assert set(bent["preferred"].values()) == {"nonlinear"}
    assert bent["linear"]["held_out_chi_square"] > 10 * bent["nonlinear"]["held_out_chi_square"]
    straight, _ = compare_damping(study(linear, F, (0.0,), noise=3.0), foot, settings)
    flat, curved = straight["linear"], straight["nonlinear"]
    assert straight["preferred"]["bic"] == "linear"
    assert curved["count"] == flat["count"] + 4
    assert curved["deviance"] < flat["deviance"] + 0.5  # it contains the linear law
    assert flat["aic"] - curved["aic"] == pytest.approx(flat["deviance"] - curved["deviance"] - 8)


def test_quick_fit_is_the_truth(foot: Foot) -> None:
    found = quick_fit(study(constant, F, (0.0,), noise=0.1), foot, Settings(starts=2))
    truth, values = constant(20.0, 0.0), values_of(found)
    for name in ("k_T", "k_F", "c_21"):
        assert values[name] == pytest.approx(truth[name], rel=5e-3)
    assert found.problem.size == 2 * (6 + 6 + 5 + 3 + 2)


def test_what_cannot_be_validated(foot: Foot) -> None:
    with pytest.raises(SettingError, match="unknown mode 'all'"):
        leave_one_frequency_out(study(constant, F, (0.0,)), foot, "all")
    with pytest.raises(SettingError, match="three or more frequencies"):
        leave_one_frequency_out(study(constant, F[:2], (0.0,)), foot, "pooled")
