"""Criteria, residual tests and the choice of orders."""

from dataclasses import replace
from types import SimpleNamespace

import linear_foot as foot
import numpy as np
import pytest
from recorded_foot import record
from scipy import signal

from identification import criteria
from identification.blackbox import pem, search, selection
from identification.blackbox.data import Series
from identification.blackbox.identify import identify
from identification.blackbox.polynomial import Orders
from identification.blackbox.selection import Referee
from identification.blackbox.validation import residual_test


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
    """White errors independent of the input: about 1 % of 200 whiteness tests reject at 0.01."""
    rejected, dependent = 0, []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        series = Series(rng.standard_normal(600), rng.standard_normal(600), 1.0)
        test = residual_test(series.y, series)
        rejected += test.white_p < 0.01
        dependent.append(test.cross_p < 0.05)
    assert rejected <= 7
    assert np.mean(dependent) <= 0.05  # halved, so safe rather than exact


def test_coefficients_do_not_make_right_models_look_coloured() -> None:
    """ARX (8, 8, 1) of an ARX plant, judged on a part as long as the one that it comes from."""
    rejected = 0
    for seed in range(80):
        u, e = np.random.default_rng(seed).standard_normal((2, 1200))
        y = signal.lfilter([0, 1, 0.5], [1, -1.2, 0.6], u) + signal.lfilter([0.5], [1, -1.2, 0.6], e)
        first, second = Series(u, y, 1.0).split()
        model = pem.estimate("arx", first, Orders.of("arx", (8, 8, 1)))
        rejected += residual_test(model.residuals(second), second, 8).white_p < 0.05
    assert rejected <= 10


def test_residual_tests_find_colour_and_a_missing_plant() -> None:
    rng = np.random.default_rng(1)
    u, e = rng.standard_normal(2000), rng.standard_normal(2000)
    coloured = e + 0.3 * np.roll(e, 1)
    assert residual_test(coloured, Series(u, coloured, 1.0)).white_p < 1e-6
    late = e + 0.5 * np.roll(u, 3)
    test = residual_test(late, Series(u, late, 1.0))
    assert test.cross_p < 1e-6 and "depend on past inputs" in test.warnings()[-1]
    assert test.cross_lags[np.argmax(np.abs(test.cross))] == 3
    only = residual_test(e, Series(u, e + 1e-9 * u, 1.0))
    assert only.warnings() == ()


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
    estimation, _ = record(foot.prbs(3000)).split()
    chosen = search.select_arx(Referee([estimation]))
    assert chosen.tried == 3375
    assert any("selects the largest order" in text for text in chosen.warnings)
    fits = [c.fit_percent for c in chosen.candidates]
    assert chosen.best.fit_percent >= max(fits) - 0.5


def test_sine_leaves_arx_orders_undecided() -> None:
    estimation, _ = record(foot.sine(20.0, 4000)).split()
    chosen = search.select_arx(Referee([estimation], weak=True))
    assert any("orders are not determined" in text for text in chosen.warnings)
    spread = [c.fit_percent for c in chosen.candidates if c.model.parameters >= 8]
    assert np.ptp(spread[:20]) < 0.5


def test_state_space_selection() -> None:
    estimation, _ = record(foot.prbs(4000)).split()
    chosen = search.select_state_space(Referee([estimation]), range(2, 9))
    assert 4 <= chosen.best.model.order <= 5  # type: ignore[attr-defined]
    assert chosen.best.fit_percent > 97


def test_a_neighbour_of_the_order_chosen_wins_on_all_data_or_widens_the_intervals() -> None:
    u, e = np.random.default_rng(1).standard_normal((2, 1500))
    y = signal.lfilter([0, 1.0], [1, -0.8], u) + 0.12 * signal.lfilter([0, 1.0], [1, 0.6], u) + 0.5 * e
    first = search.select_state_space(Referee([Series(u, y, 1.0, "plant")]), range(1, 6))
    assert first.best.model.order == 2
    assert {model.order for _, model in first.rivals} <= {1, 3}
    gain = first.curve([0.1, 0.3]).gain_std
    assert (gain >= first.best.model.response([0.1, 0.3]).gain_std).all()


@pytest.mark.parametrize(("pole", "fewest"), [(0.65, False), (0.75, True)])
def test_behind_coloured_output_errors_a_score_must_be_seen_in_simulation(pole: float, fewest: bool) -> None:
    """Half of the errors can be foretold at a pole of 0.71; beyond it the check data alone justify coefficients."""
    e = signal.lfilter([1], [1, -pole], np.random.default_rng(0).standard_normal(20_000))

    def candidate(count: int, errors: np.ndarray, score: float) -> selection.Candidate:
        model = SimpleNamespace(
            structure="oe", parameters=count, samples=100, loss=1.0, label=str(count), residuals=lambda s: e,
            poles=lambda: np.zeros(0),
        )
        return selection.Candidate(model, 100 - 100 * float(np.sqrt(errors.mean())), errors, 0.0, score)

    noise = 1e-5 + 1e-4 * np.tile([1.0, -1.0], 10)
    same, worse = np.full(20, 0.0144), np.full(20, 0.0148)
    tried = [candidate(9, same, -900.0), candidate(5, same + noise, -500.0), candidate(3, worse, -300.0)]
    u = np.random.default_rng(2).standard_normal(300)
    assert selection.rank(tried, Referee([Series(u, np.roll(u, 1), 1.0)])).best is tried[1 if fewest else 0]


def test_a_free_motion_that_outlasts_the_record_ranks_last() -> None:
    """A model that only rings at the input's frequency simulates any sine from its start, and proves nothing.

    Under a rich input the same pole is no reason to demote anything.
    """
    estimation, validation = record(foot.sine(20.0, 4000)).split()
    angle = 2 * np.pi * 20.0 * foot.SAMPLE_TIME
    honest = pem.estimate("oe", estimation, Orders.of("oe", (2, 2, 1)))
    ringing = pem.PolynomialModel(
        "oe", Orders.of("oe", (2, 2, 1)), np.array([1e-9, 0.0, -2 * 0.99999 * np.cos(angle), 0.99999**2]), np.eye(4),
        honest.loss, honest.samples, honest.sample_time,
    )  # fmt: skip
    assert selection.judge(ringing, [validation]).fit_percent > 95
    referee = Referee([validation], weak=True)
    ranked = selection.rank([referee.judge(ringing), referee.judge(honest)], referee)
    assert ranked.best.model is honest
    assert "OE (2, 2, 1): ranked last, because their free response is longer" in ranked.warnings[0]


def lag(wait: int, n: int = 800) -> Series:
    """First-order lag after `wait` samples, 0 for direct feedthrough."""
    rng = np.random.default_rng(wait)
    u, y = rng.standard_normal(n), np.zeros(n)
    for t in range(1, n):
        y[t] = 0.8 * y[t - 1] + (0.5 * u[t - wait] if t >= wait else 0.0)
    return Series(u, y + 0.1 * rng.standard_normal(n), 1.0, f"lag {wait}").centred()


@pytest.mark.long
@pytest.mark.parametrize(("read", "wait"), [((0, 1), 0), ((1, 2, 3), 1), ((1, 2, 3), 3)])
def test_neighbours_of_the_delay_compete(read: tuple[int, ...], wait: int) -> None:
    """Whatever was read off a long ARX model, the plant's own delay is chosen, and is the only one."""
    chosen = search.select_oe(Referee([lag(wait)]), read)
    assert selection.begins(chosen.best.model) == wait and chosen.delays == (wait,)


def test_a_delay_that_is_not_decided_is_said() -> None:
    """A sine of 40 samples a period, and noise: one sample more or less is a small turn of phase."""
    u = np.sin(2 * np.pi * np.arange(600) / 40)
    y = np.r_[np.zeros(2), u[:-2]] + 0.3 * np.random.default_rng(6).standard_normal(600)
    found = identify(Series(u, y, 1.0, "sine").centred(), ("oe",))
    assert any("the delay is not determined: n_k = " in text for text in found.models["oe"].warnings)


@pytest.mark.parametrize("wait", [0, 1, 41])
def test_delays_from_none_to_long(wait: int) -> None:
    """Direct feedthrough and a delay far beyond the grid are found, by OE and by ARX."""
    late = record(np.roll(foot.prbs(2000), wait), noise=0.05)  # itself one sample late
    assert search.delay([replace(late, u=foot.prbs(2000)).centred().cut(wait, 2000)]) == wait + 1
    series = lag(wait)
    assert search.delay([series]) == wait
    first, _ = series.split()
    best = search.select_arx(Referee([first]), (wait,), largest=6).best
    assert best.model.orders.nk == wait  # type: ignore[attr-defined]
    assert best.fit_percent > 80


def test_the_edge_of_every_order_is_named() -> None:
    estimation, _ = record(foot.prbs(800)).split()
    referee = Referee([estimation])
    chosen = search.select_oe(referee, (1,), largest=2)
    assert any("n_f = 2 is the largest tried" in text for text in chosen.warnings)
    assert search.edge(chosen, nb=15, nf=5) is chosen


def light(n: int = 1000, noise: float = 0.05) -> tuple[Series, np.ndarray, np.ndarray]:
    """Two resonances, poles at 0.9995 and 0.99."""
    rng = np.random.default_rng(5)
    poles = np.array([0.9995 * np.exp(0.3j), 0.99 * np.exp(0.9j)])
    b, f = np.array([0.0, 1.0, 0.5, -0.3, 0.2]), np.poly([*poles, *poles.conj()]).real
    u = rng.standard_normal(n)
    y = signal.lfilter(b, f, u)
    return Series(u, y + noise * np.std(y) * rng.standard_normal(n), 1.0, "light").centred(), b, f


def test_a_lightly_damped_plant_is_chosen_by_itself() -> None:
    """Free motion lasts longer than the record; the fit on data that no choice has seen is that of the noise."""
    series, _, f = light()
    estimation, validation = series.split()
    best = search.select_oe(Referee([estimation]), (1,)).best.model
    assert np.abs(best.poles()).max() == pytest.approx(0.9995, abs=3e-4)
    assert len(best.poles()) == len(f) - 1
    assert selection.judge(best, [validation]).fit_percent > 94


def test_a_model_that_nests_another_never_has_a_higher_loss() -> None:
    """Every pair of a grid, on the same rows; two resonances hide many minima."""
    series, _, _ = light(500, 0.1)
    grid = search.Search("oe", [series], last_lag=8)
    found = {(nb, nf): grid.at(Orders(nb=nb, nf=nf, nk=1)) for nf in range(1, 6) for nb in range(1, 6)}
    pairs = [(small, large) for small in found for large in found if small != large and small[0] <= large[0]]
    pairs = [(small, large) for small, large in pairs if small[1] <= large[1]]
    assert len(pairs) == 200
    for small, large in pairs:
        assert found[large].loss <= found[small].loss * (1 + 1e-5), (small, large)  # type: ignore[union-attr]
    wide = pem.embedded(found[2, 2], Orders(nb=4, nf=5, nk=0))  # type: ignore[arg-type]
    np.testing.assert_allclose(wide[[1, 2, 4, 5]], found[2, 2].theta)  # type: ignore[union-attr]
    assert not wide[[0, 3, 6, 7, 8]].any()


def coloured(seed: int, n: int = 1200) -> tuple[Series, np.ndarray]:
    """Third order, delay 7, noise an autoregression at 0.95 half as strong as the output."""
    rng = np.random.default_rng(seed)
    b, f = np.array([1.0, 0.5, 0.25]), np.poly([0.8, 0.7 * np.exp(0.9j), 0.7 * np.exp(-0.9j)]).real
    u = rng.standard_normal(n)
    y, v = signal.lfilter(b, f, np.r_[np.zeros(7), u[:-7]]), signal.lfilter([1.0], [1, -0.95], rng.standard_normal(n))
    return Series(u, y + 0.5 * np.std(y) / np.std(v) * v, 1.0, "coloured").centred(), np.r_[b, f[1:]]


def test_coloured_noise_neither_traps_nor_hides_the_delay() -> None:
    """The estimate ends where one begun at the truth ends; the delay is 7, not the 5 of leading coefficients near 0."""
    series, truth = coloured(1)
    assert search.delay([series]) == 7
    orders = Orders.of("oe", (3, 3, 7))
    free = pem.estimate("oe", series, orders)
    told = pem.PolynomialModel("oe", orders, truth, np.eye(6), 1.0, 1, 1.0)
    assert free.loss <= pem.estimate("oe", series, orders, starts=[told]).loss * (1 + 1e-5)
    bj = search.select_bj(Referee([series]), free, (7,)).best.model
    assert (bj.orders.nf, bj.orders.nk, bj.orders.nd) == (3, 7, 1)  # type: ignore[attr-defined]


def test_whitened_score_sees_a_small_plant_behind_coloured_noise() -> None:
    """The plain loss of output errors hardly tells the orders apart, the whitened one does, and knows no overfit."""
    series, _ = coloured(1)
    models = {n: pem.estimate("oe", series, Orders(nb=3, nf=n, nk=7)) for n in (1, 3, 5)}
    scores = {n: criteria.whitened_score([model.residuals(series)], n + 3) for n, model in models.items()}
    assert scores[1] - scores[3] > 100 and scores[5] > scores[3]
    white = np.random.default_rng(0).standard_normal(5000)
    assert criteria.whitened_score([2 * white], 0) == pytest.approx(5000 * np.log(4 * np.mean(white**2)), abs=40)


def test_the_referee_keeps_data_for_the_choice_or_says_why_not() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(900)
    rich = Referee([Series(u, u + rng.standard_normal(900), 1.0)])
    assert rich.simulates and len(rich.fitted[0]) == 600 and len(rich.check[0]) == 300
    step = np.r_[np.zeros(100), np.ones(800)]
    still = Referee([Series(step, step + rng.standard_normal(900), 1.0)])
    assert not still.simulates and "still" in still.reason and len(still.fitted[0]) == 900
    assert "too few" in Referee([Series(u[:60], u[:60] + rng.standard_normal(60), 1.0)]).reason


def test_the_unit_of_the_output_chooses_no_orders() -> None:
    rng = np.random.default_rng(5)
    u = rng.standard_normal(600)
    w = signal.lfilter([0, 1, 0.5], np.poly([0.9 * np.exp(0.5j), 0.9 * np.exp(-0.5j)]).real, u)
    y = w + 0.1 * np.std(w) * rng.standard_normal(len(u))
    found = [search.select_oe(Referee([Series(u, unit * y, 1.0).centred()]), (1,)).best.model for unit in (1.0, 1e9)]
    assert found[0].label == found[1].label == "OE (2, 2, 1)"
    assert found[1].loss / 1e18 == pytest.approx(found[0].loss)


def test_samples_before_the_delay_has_passed_flatter_no_fit() -> None:
    """They answer inputs before the record, of which nothing is known: free initial states take them all."""
    u, y = np.random.default_rng(0).standard_normal((2, 400))
    late = pem.estimate("oe", Series(u, y, 1.0), Orders(nb=1, nf=0, nk=150))
    fresh = Series(*np.random.default_rng(1).standard_normal((2, 400)), 1.0)
    assert np.abs(late.simulate(fresh) - fresh.y)[:150].max() < 1e-9
    found = selection.judge(late, [fresh])
    assert abs(found.fit_percent) < 2 and found.block_errors.min() > 0.3
