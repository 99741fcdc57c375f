"""Estimates, held-out errors and populations of the heel's laws: known truth, brute force, closed forms."""

import json
from pathlib import Path

import in_process
import numpy as np
import pytest
from scipy.stats import norm

from fasbody.exceptions import RecordingError
from fasbody.heel.analysis import analyse
from fasbody.heel.comparison import Task, judge
from fasbody.heel.estimate import Paths, fit, pooled
from fasbody.heel.laws import LAWS
from fasbody.heel.population import Observed, estimate, sampled
from fasbody.heel.stiffness import measured, slopes
from fasbody.heel.strike import Published, Strike
from simulator.strike import TRUTH, strike


def drawn(law: str, theta: tuple[float, ...], subject: str = "1", speed: str = "normal", number: int = 0) -> Strike:
    """A strike along a half sine of 12 mm, 30 ms, without noise: what a law says of it."""
    t = np.arange(91) / 3000
    depth = 0.010 + 2e-4 * number
    x, v = depth * np.sin(np.pi * t / 0.06), depth * np.pi / 0.06 * np.cos(np.pi * t / 0.06)
    F = LAWS[law].force(t, x, v, np.array(theta))
    k = int(F.argmax())
    published = Published(x[k], x[-1], 1.0, 1.0, v[0], t[k], t[-1], F[k], True)
    return Strike(subject, speed, str(number), t, F, x, v, k, 90, "synthetic", published)


@pytest.fixture(scope="module")
def people() -> dict[tuple[str, str], tuple[Strike, ...]]:
    """Six people at two speeds, four strikes each, of power pads that differ."""
    rng = np.random.default_rng(3)
    groups = {}
    for subject in "abcdef":
        F_5, n = 60 * np.exp(0.3 * rng.standard_normal()), 3 * np.exp(0.1 * rng.standard_normal())
        for speed in ("slow", "normal"):
            groups[subject, speed] = tuple(
                drawn("power", (F_5 * np.exp(0.05 * rng.standard_normal()), n), subject, speed, k) for k in range(4)
            )
    return groups


@pytest.mark.parametrize("key", ["power", "hunt_crossley", "qlv"])
def test_a_known_law_comes_back_through_volts_and_markers(key: str) -> None:
    law, theta = LAWS[key], np.array(TRUTH[key])
    rng = np.random.default_rng(1)
    found = fit(law, [strike(law, theta, rng, k) for k in range(5)])
    assert found.misfit < 0.01
    for item, true in zip(found.parameters.values(), theta, strict=True):
        assert item.value == pytest.approx(true, rel=0.3 if key == "qlv" else 0.1)
        assert item.lower < item.value < item.upper


@pytest.mark.parametrize("key", LAWS)
def test_an_exact_strike_leaves_nothing(key: str) -> None:
    strikes = [drawn(key, TRUTH[key], number=k) for k in range(4)]
    found = fit(LAWS[key], strikes)
    assert found.misfit < 2e-3
    theta = pooled(LAWS[key], strikes, "whole", np.array(TRUTH[key]) * 1.05)
    assert Paths.of(strikes).misfits(LAWS[key], theta).max() < 2e-3


def test_intervals_are_those_of_leaving_each_strike_out() -> None:
    rng = np.random.default_rng(0)
    strikes = [strike(LAWS["power"], np.array(TRUTH["power"]), rng, k) for k in range(8)]
    whole = fit(LAWS["power"], strikes)
    left = np.log([fit(LAWS["power"], [s for s in strikes if s is not out]).theta for out in strikes])
    brute = 7 / 8 * (left - left.mean(axis=0)).T @ (left - left.mean(axis=0))
    np.testing.assert_allclose(np.sqrt(np.diag(whole.covariance)), np.sqrt(np.diag(brute)), rtol=0.3)


def test_what_rests_on_a_bound_says_so() -> None:
    found = fit(LAWS["hunt_crossley"], [drawn("power", (60.0, 3.0), number=k) for k in range(4)])
    assert found.at_bound == ("c",) and found.parameters["c"].bound and not found.parameters["n"].bound
    with pytest.raises(RecordingError, match="fewer than three strikes"):
        fit(LAWS["power"], [drawn("power", (60.0, 3.0))])


def test_held_out_errors_are_those_of_the_other_law(people: dict) -> None:
    found = judge(Task("power", "whole", people, "x"))
    assert len(found["persons"]) == 12 and len(found["other_speed"]) == 6 and len(found["other_person"]) == 6
    errors = {item["subject"]: item["error"] for item in found["other_person"]}
    theta = pooled(LAWS["power"], [s for key, group in people.items() if key[0] != "a" for s in group], "whole")
    own = [s for key, group in people.items() if key[0] == "a" for s in group]
    by_hand = []
    for s in own:
        chosen = np.linspace(0, 90, 40).round().astype(int)
        F = LAWS["power"].force(s.time_s, s.compression_m, s.rate_m_s, theta)
        by_hand.append(np.sqrt(np.mean((F - s.force_n)[chosen] ** 2)) / s.published.peak_n)
    assert errors["a"] == pytest.approx(np.mean(by_hand), rel=1e-3)
    assert np.mean([item["error"] for item in found["other_speed"]]) < np.mean(list(errors.values()))


def test_population_of_one_speed_is_analysis_of_variance() -> None:
    """Balanced, one parameter: mean, and variance between persons less that of an estimate."""
    rng = np.random.default_rng(5)
    logs, own = rng.normal(1.0, 0.4, 12), 0.02
    found = estimate(["k"], [Observed(f"{i}", "", np.array([y]), np.array([[own]])) for i, y in enumerate(logs)])
    assert found.mu[0, 0] == pytest.approx(logs.mean(), rel=1e-6)
    assert found.between[0, 0] == pytest.approx(logs.var(ddof=1) - own, rel=1e-3)
    assert found.covariance[0, 0] == pytest.approx(logs.var(ddof=1) / 12, rel=1e-3)
    assert found.converged and found.inside is not None and found.inside > 0.8
    with pytest.raises(RecordingError, match="at least 4"):
        estimate(["k"], [Observed("1", "", np.array([1.0]), np.array([[own]]))])


@pytest.mark.long
def test_population_tells_persons_from_speeds() -> None:
    """Many people at two speeds: both covariances and the difference of the speeds come back."""
    rng = np.random.default_rng(2)
    B, W, V = np.array([[0.2, 0.05], [0.05, 0.1]]), np.diag([0.03, 0.02]), np.diag([0.01, 0.01])
    observed = []
    for i in range(150):
        u = rng.multivariate_normal([0, 0], B)
        for speed, mean in (("normal", [4.0, 1.0]), ("slow", [3.8, 1.1])):
            observed.append(Observed(f"{i}", speed, mean + u + rng.multivariate_normal([0, 0], W + V), V))
    found = estimate(["F", "n"], observed)
    np.testing.assert_allclose(found.mu, [[4.0, 1.0], [3.8, 1.1]], atol=0.1)
    np.testing.assert_allclose(found.between, B, atol=0.06)
    np.testing.assert_allclose(found.within, W, atol=0.012)
    draws = np.log(found.draws("slow", 20000))
    np.testing.assert_allclose(np.cov(draws.T), B + W, rtol=0.35, atol=0.02)


def test_samples_are_those_of_a_quadrature() -> None:
    """One parameter, one speed: the mean's posterior is a mixture over the scatter, on a grid."""
    rng = np.random.default_rng(5)
    logs, own = rng.normal(1.0, 0.4, 12), 0.02
    observed = [Observed(f"{i}", "", np.array([y]), np.array([[own]])) for i, y in enumerate(logs)]
    (row,) = sampled(["k"], observed)["parameters"]
    scale, tau = logs.std() + 1e-9, np.exp(np.linspace(-6, 3, 2001))
    v = own + (tau * scale) ** 2
    density = -(((logs - logs.mean()) ** 2).sum() / v + 11 * np.log(v) + np.log(tau / 0.5) ** 2) / 2
    mu = np.linspace(-1, 3, 4001)
    mixture = np.exp(density - density.max()) @ norm.pdf(mu, logs.mean(), np.sqrt(v / 12)[:, None])
    quantiles = np.interp([0.5, 0.025, 0.975], mixture.cumsum() / mixture.sum(), mu)
    shown = np.log([row[key] for key in ("median", "lower", "upper")])
    np.testing.assert_allclose(shown, quantiles, atol=0.02 * np.ptp(quantiles))


def test_slopes_are_the_tangents_of_the_pad(people: dict) -> None:
    one = drawn("exponential", (9.0, 430.0))
    np.testing.assert_allclose(slopes(one), [430.0 * (F + 9.0) for F in (43.0, 66.0, 88.0)], rtol=0.03)
    populations = measured(people)
    assert [p.names for p in populations] == [("43 N",), ("66 N",), ("88 N",)]
    assert populations[0].interval("normal", "43 N")[0] < populations[2].interval("normal", "88 N")[0]


@pytest.mark.usefixtures("undrawn")
def test_command_says_everything_and_goes_on_where_it_stopped(people: dict, tmp_path: Path) -> None:
    folder, out = tmp_path / "study", tmp_path / "out"
    folder.mkdir()
    lines = ["file,subject,speed"]
    for (subject, speed), strikes in people.items():
        for s in strikes:
            name = f"{subject}_{speed}_{s.number}.csv"
            F, t = np.concatenate([np.full(5, -0.1), s.force_n, s.force_n[::-1][1:]]), np.arange(186) / 3000
            x = np.concatenate([np.zeros(5), s.compression_m, s.compression_m[::-1][1:]])
            np.savetxt(
                folder / name,
                np.column_stack([t, F, x]),
                delimiter=",",
                header="time_s,force_n,compression_m",
                comments="",
            )
            lines.append(f"{name},{subject},{speed}")
    (folder / "study.toml").write_text('[study]\nname = "six"\nkind = "heel strikes"\norigin = "synthetic"\n')
    (folder / "strikes.csv").write_text("\n".join(lines))
    arguments = ["identification.heel", str(folder), "--law", "power", "--out", str(out), "--workers", "1", "--json"]
    done = in_process.command(*arguments)
    assert done.returncode == 0, done.stderr
    first = json.loads(done.stdout)
    assert first["origin"] == "synthetic" and first["computed"] == 2 and len(first["persons"]) == 12
    for name in (
        "subject",
        "speed",
        "strikes",
        "compression_at_peak_mm",
        "work_to_peak_j",
        "contact_speed_m_s",
        "time_to_peak_ms",
    ):
        assert name in first["persons"][0]
    assert {row["parameter"] for row in first["population"]["parameters"]} == {"F_5", "n"}
    assert "between the skin" in first["compression_includes"]
    assert {file.name for file in out.glob("*.png")} == {
        f"heel-{n}.png" for n in ("persons", "errors", "population", "stiffness")
    }
    next((out / "laws").glob("*.json")).write_text("{torn")
    second = json.loads(in_process.command(*arguments).stdout)
    assert second["computed"] == 1 and second["laws"] == first["laws"]
    assert in_process.command("identification.heel", str(folder), "--law", "powr").returncode == 2


def test_too_few_people_make_no_population(people: dict) -> None:
    from fasbody.heel.study import HeelStudy

    some = tuple(s for key, group in people.items() if key[0] in "ab" for s in group)
    study = HeelStudy("two", "synthetic", "", "", "", some, (), {}, "d")
    found = analyse(study, laws=["power"], processes=1)
    assert found.population is None and not found.slopes and "at least 4" in found.remarks[-1]
