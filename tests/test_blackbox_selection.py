"""Criteria, residual tests and the choice of orders."""

import linear_foot as foot
import numpy as np
import pytest

from identification.blackbox import criteria, pem, selection
from identification.blackbox.data import Series
from identification.blackbox.polynomial import Orders
from identification.blackbox.validation import residual_test


def halves(base: np.ndarray, seed: int = 0) -> tuple[Series, Series]:
    y = foot.linear_output(base) + 0.25 * np.random.default_rng(seed).standard_normal(len(base))
    return Series(base, y, foot.SAMPLE_TIME).split()


def test_criteria_agree_where_they_must() -> None:
    """Log FPE and AIC differ by terms of third order in d / N; the short form of FPE by second order."""
    loss, n = 0.3, 5000
    for d in (5, 20):
        assert np.log(criteria.fpe(loss, d, n)) == pytest.approx(criteria.aic(loss, d, n), abs=(d / n) ** 3)
        short = criteria.fpe_of_few_parameters(loss, d, n)
        assert short == pytest.approx(criteria.fpe(loss, d, n), rel=3 * (d / n) ** 2)
    assert criteria.bic(loss, 7, n) == pytest.approx(np.log(loss) + 7 * np.log(n) / n)


def test_the_printed_criterion_depends_on_the_unit() -> None:
    """Losses in m/s^2 and in g: the corrected choice is the same, the printed one is not."""
    loss, d = np.array([1.0, 0.97, 0.969]), np.array([4, 8, 30])

    def printed(values: np.ndarray) -> int:
        return int(np.argmin(np.log(values + 2 * d / 500)))

    g = 9.81**2
    assert np.argmin(criteria.aic(loss, d, 500)) == np.argmin(criteria.aic(loss / g, d, 500))
    assert printed(loss * g) != printed(loss / g)


def test_fit_percent_by_hand() -> None:
    y = np.array([1.0, 2.0, 3.0, 4.0])
    assert criteria.fit_percent(y, y) == 100.0
    assert criteria.fit_percent(y, np.full(4, 2.5)) == 0.0
    assert criteria.fit_percent(y, y + 0.5) == pytest.approx(100 * (1 - 1.0 / np.sqrt(5.0)))
    assert criteria.fit_percent(y, np.full(4, np.inf)) == -np.inf


def test_residual_tests_have_their_size() -> None:
    """White errors independent of the input: about 1 % of 300 whiteness tests reject at 0.01."""
    rejected, dependent = 0, []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        series = Series(rng.standard_normal(600), rng.standard_normal(600), 1.0)
        test = residual_test(series.y, series)
        rejected += test.white_p < 0.01
        dependent.append(test.cross_p < 0.05)
    assert rejected <= 10
    assert np.mean(dependent) <= 0.05  # halved, so safe rather than exact


def test_residual_tests_find_colour_and_a_missing_plant() -> None:
    rng = np.random.default_rng(1)
    u, e = rng.standard_normal(2000), rng.standard_normal(2000)
    coloured = e + 0.3 * np.roll(e, 1)
    assert residual_test(coloured, Series(u, coloured, 1.0)).white_p < 1e-6
    late = e + 0.5 * np.roll(u, 3)
    test = residual_test(late, Series(u, late, 1.0))
    assert test.cross_p < 1e-6 and "depend on past inputs" in test.warnings[-1]
    assert test.cross_lags[np.argmax(np.abs(test.cross))] == 3
    only = residual_test(e, Series(u, e + 1e-9 * u, 1.0))
    assert only.warnings == ()


def test_independence_test_on_sines() -> None:
    """A right model of pooled sines is not blamed: 200 recordings, the same error in gain as in the data."""
    blamed = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        u = foot.sine(20.0, 2000)
        slip = 0.25 * np.sqrt(2 / 2000) / foot.AMPLITUDE * rng.standard_normal(2)  # of gain and quadrature
        e = 0.25 * rng.standard_normal(2000) + slip[0] * u + slip[1] * np.roll(u, 12)
        blamed += residual_test(e, Series(u, e + u, 1e-3)).cross_p < 0.01
    assert blamed <= 6
    wrong = e + 0.01 * u
    assert residual_test(wrong, Series(u, wrong + u, 1e-3)).cross_p < 1e-6


def test_arx_selection_warns_at_the_edge_and_lists_what_is_alike() -> None:
    estimation, validation = halves(foot.prbs(3000))
    chosen = selection.select_arx([estimation], [validation])
    assert chosen.tried == 3375
    assert any("edge of the grid" in text for text in chosen.warnings)
    fits = [c.fit_percent for c in chosen.candidates]
    assert chosen.best.fit_percent >= max(fits) - 0.5


def test_sine_leaves_arx_orders_undecided() -> None:
    estimation, validation = halves(foot.sine(20.0, 4000))
    chosen = selection.select_arx([estimation], [validation])
    assert any("orders are not decided" in text for text in chosen.warnings)
    spread = [c.fit_percent for c in chosen.candidates if c.model.parameters >= 8]
    assert np.ptp(spread[:20]) < 0.5


def test_output_error_orders_are_found_with_few_parameters() -> None:
    estimation, validation = halves(foot.prbs(4000))
    trials = [Orders(nb=nb, nf=nf, nk=1) for nb in (1, 2, 4, 8) for nf in (1, 2, 3, 4, 5)]
    chosen = selection.select_polynomial("oe", trials, [estimation], [validation])
    best = chosen.best.model
    assert len(best.poles()) == 4
    band = np.linspace(5, 60, 30)
    assert np.abs(best.response(band).value / foot.response(band) - 1).max() < 0.03
    assert chosen.tried == 20
    assert best.label in chosen.alike or len(chosen.alike) >= 1


def test_delay_of_a_delayed_foot() -> None:
    base = foot.prbs(2000)
    y = np.concatenate([np.zeros(3), foot.linear_output(base)[:-3]])
    late = Series(base, y + 0.05 * np.random.default_rng(0).standard_normal(2000), 1e-3).centred()
    assert selection.delay([late]) == 4


def test_state_space_selection() -> None:
    estimation, validation = halves(foot.prbs(4000))
    chosen = selection.select_state_space([estimation], [validation], range(2, 9))
    assert 4 <= chosen.best.model.order <= 5  # type: ignore[attr-defined]
    assert chosen.best.fit_percent > 97


def test_a_free_motion_that_outlasts_the_record_ranks_last() -> None:
    """A model that only rings at the input's frequency simulates any sine from its start, and proves nothing."""
    estimation, validation = halves(foot.sine(20.0, 4000))
    angle = 2 * np.pi * 20.0 * foot.SAMPLE_TIME
    honest = pem.estimate("oe", estimation, Orders.of("oe", (2, 2, 1)))
    ringing = pem.PolynomialModel(
        "oe", Orders.of("oe", (2, 2, 1)), np.array([1e-9, 0.0, -2 * 0.99999 * np.cos(angle), 0.99999**2]), np.eye(4),
        honest.loss, honest.samples, honest.sample_time,
    )  # fmt: skip
    assert selection.judge(ringing, [validation]).fit_percent > 95
    assert selection.rank([ringing, honest], [validation], 2, ()).best.model is honest


def lag(wait: int, n: int = 800) -> Series:
    """First-order lag after `wait` samples, 0 for direct feedthrough."""
    rng = np.random.default_rng(wait)
    u, y = rng.standard_normal(n), np.zeros(n)
    for t in range(1, n):
        y[t] = 0.8 * y[t - 1] + (0.5 * u[t - wait] if t >= wait else 0.0)
    return Series(u, y + 0.1 * rng.standard_normal(n), 1.0, f"lag {wait}").centred()


@pytest.mark.parametrize("wait", [0, 1, 41])
def test_delays_from_none_to_long(wait: int) -> None:
    """Direct feedthrough and a delay far beyond the grid are found, by OE and by ARX."""
    series = lag(wait)
    assert selection.delay([series]) == wait
    first, second = series.split()
    best = selection.select_arx([first], [second], largest=6, nk=wait).best
    assert best.model.orders.nk == wait  # type: ignore[attr-defined]
    assert best.fit_percent > 80


def test_the_edge_of_every_order_is_named() -> None:
    estimation, validation = halves(foot.prbs(1500))
    trials = [Orders(nb=nb, nf=nf, nk=1) for nb in (1, 2) for nf in (1, 2)]
    chosen = selection.select_polynomial("oe", trials, [estimation], [validation])
    assert any("n_f = 2 is the largest tried" in text or "n_b = 2" in text for text in chosen.warnings)
    inner = selection.edge(chosen, {"nb": 15, "nf": 5})
    assert inner is chosen
    noise = pem.estimate("bj", estimation, Orders.of("bj", (2, 5, 3, 2, 1)))
    ranked = selection.rank([noise], [validation], 1, ())
    assert "n_c = 5 is the largest" in selection.edge(ranked, {"nc": 5, "nd": 5}).warnings[0]
