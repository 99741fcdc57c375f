"""Misprints that change a number, outside of the equations of motion: printed against right, each from its formula.

Those of Appendix B and of Eq. 4.12 are in test_errata_appendix_b.py and test_errata_linear.py.
"""

import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


# --- Section 4.4 and 4.5 ----------------------------------------------------------------------------------------------


def sampled(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One period of x = a sin(t) + b cos(t) at n instants that avoid its zeros, and dx/da, dx/db at a = b = 1."""
    t = 2 * np.pi * (np.arange(n) + 0.3) / n
    return np.sin(t) + np.cos(t), np.sin(t), np.cos(t)


def test_4_18_second_column_is_the_second_parameter() -> None:
    _, by_a, by_b = sampled(50)
    assert np.linalg.matrix_rank(np.column_stack([by_a, by_a])) == 1  # s_11 s_11
    assert np.linalg.matrix_rank(np.column_stack([by_a, by_b])) == 2  # s_11 s_12


def test_4_20_mean_falls_with_the_number_of_samples_as_printed() -> None:
    as_printed, right = [], []
    for n in (100, 10_000):
        s = sampled(n)[1]
        as_printed.append(np.sqrt(np.sum(s**2)) / n)
        right.append(np.sqrt(np.sum(s**2) / n))
    assert as_printed[0] / as_printed[1] == pytest.approx(10)
    assert right[0] == pytest.approx(right[1])


def test_4_21_quotient_of_samples_diverges_where_the_state_crosses_zero() -> None:
    quotients, norms = [], []
    for n in (101, 10_001, 1_000_001):
        x, by_a, _ = sampled(n)
        quotients.append(np.sqrt(np.mean((by_a / x) ** 2)))
        norms.append(np.linalg.norm(by_a) / np.linalg.norm(x))
    assert quotients[2] > 5 * quotients[1] > 25 * quotients[0]
    np.testing.assert_allclose(norms, 1 / np.sqrt(2), rtol=1e-3)


def test_4_23_reuses_the_exponent_k_and_never_its_n() -> None:
    strain, rate = 0.2, 0.5

    def force(j: float, k: float, m: float, n: float, l: float) -> float:  # noqa: E741
        return j * strain**k + l * strain**m * abs(rate) ** n

    j, k, m, n, l = 2.0, 3.0, 1.0, 0.5, 4.0  # noqa: E741
    as_printed = force(j, k, m, k, l)
    assert force(j, k, m, n, l) / as_printed > 4


# --- Chapter 2 --------------------------------------------------------------------------------------------------------


def test_2_5_transmissibility_with_omega_squared() -> None:
    m, c, k, omega = 4.3, 400.0, 6e4, 2 * np.pi * 20
    top = k**2 + (omega * c) ** 2
    as_printed = np.sqrt(top / ((k - m * omega) ** 2 + (omega * c) ** 2))
    right = np.sqrt(top / ((k - m * omega**2) ** 2 + (omega * c) ** 2))
    direct = abs((k + 1j * omega * c) / (k - m * omega**2 + 1j * omega * c))
    assert right == pytest.approx(direct)
    assert as_printed == pytest.approx(1.005, abs=5e-4)
    assert right == pytest.approx(1.538, abs=5e-4)


def test_2_2_exponent_needs_the_fundamental_frequency() -> None:
    """With omega_0 = 2 pi / (N dt) the sum is the discrete Fourier transform, at n the n-th harmonic."""
    N, dt, n = 64, 1e-3, 5
    covariance = np.cos(2 * np.pi * n * np.arange(1, N + 1) / N)
    omega_0 = 2 * np.pi / (N * dt)
    kernel = np.exp(-1j * n * omega_0 * np.arange(1, N + 1) * dt)
    assert abs(np.sum(covariance * kernel) / N) == pytest.approx(0.5)
    assert np.sum(covariance * kernel) == pytest.approx(np.fft.fft(np.roll(covariance, 1))[n])


def test_2_3_sum_runs_one_sample_too_far() -> None:
    """X(0) to X(N - 1) are N samples; i = N - k asks for Y(N)."""
    N, k = 8, 3
    last_index = (N - k) + k
    with pytest.raises(IndexError):
        np.zeros(N)[last_index]
    assert (N - 1 - k) + k == N - 1


# --- Chapter 3 --------------------------------------------------------------------------------------------------------


def test_3_4_against_3_5_delay_convention() -> None:
    """B = b_0 + b_1 q^-1 + b_2 q^-2 on u(t - 1) has three taps where Eq. 3.5 with n_b = 2 has two."""
    u, b = np.eye(8)[0], np.array([0.5, 0.3, 0.2])
    shifted = np.convolve(b, np.roll(u, 1))[:8]  # 3.4 in 3.3 with k = 1
    as_3_5 = np.convolve(np.r_[0, b[1:]], u)[:8]  # b_1 u(t-1) + b_2 u(t-2)
    assert np.abs(shifted - as_3_5).max() > 0.1
    nk = 1  # one convention: sum over k = 1 .. n_b of b_k u(t - nk - k + 1)
    ours = sum(b[k] * np.roll(u, nk + k - 1) for k in (1, 2))
    np.testing.assert_allclose(ours, as_3_5)


def test_3_8_noise_filter_ends_in_d() -> None:
    """Box-Jenkins has no A polynomial: a_nd = 0 would cut the noise filter short."""
    d = np.array([0.5, 0.3])

    def impulse(last: float) -> np.ndarray:
        w = np.zeros(6)
        for t in range(6):
            w[t] = float(t == 0) - sum(c * w[t - i - 1] for i, c in enumerate((d[0], last)) if t > i)
        return w

    expected = np.array([1, -0.5, -0.05])  # 1 / (1 + 0.5 q^-1 + 0.3 q^-2)
    np.testing.assert_allclose(impulse(d[1])[:3], expected)
    assert np.abs(impulse(0.0)[:3] - expected).max() > 0.2


def test_3_12_prediction_is_one_step_ahead() -> None:
    """y-hat(t | t-1) leaves white errors of the noise's variance; a simulation from the model alone does not."""
    rng = np.random.default_rng(0)
    e, a = rng.normal(size=20_000), 0.9
    y = np.zeros_like(e)
    for t in range(1, len(e)):
        y[t] = a * y[t - 1] + e[t]
    assert np.var(y[1:] - a * y[:-1]) == pytest.approx(1, rel=0.03)
    assert np.var(y) == pytest.approx(1 / (1 - a**2), rel=0.15)


def test_3_19_printed_criterion_depends_on_the_unit_of_the_output() -> None:
    N, parameters, loss = 1000, np.array([2, 6, 12]), np.array([1.2e-4, 1.0e-4, 0.995e-4])

    def chosen(criterion: np.ndarray) -> int:
        return int(parameters[criterion.argmin()])

    for scale in (1.0, 9.81**2, 1e6):  # squared unit of y
        assert chosen(np.log(scale * loss) + 2 * parameters / N) == 6
    picks = {chosen(np.log(scale * loss + 2 * parameters / N)) for scale in (1.0, 9.81**2, 1e6)}
    assert len(picks) > 1


def test_3_20_fit_needs_norms() -> None:
    rng = np.random.default_rng(1)
    y = np.sin(2 * np.pi * np.arange(5000) / 50)
    estimate = y + 0.1 * rng.normal(size=y.size)
    right = 100 * (1 - np.linalg.norm(y - estimate) / np.linalg.norm(y - y.mean()))
    assert right == pytest.approx(100 * (1 - 0.1 * np.sqrt(2)), abs=0.5)
    with np.errstate(divide="ignore"):
        sample_by_sample = 100 * (1 - np.abs(y - estimate) / np.abs(y - y.mean()))
    assert not np.isfinite(sample_by_sample.min()) or sample_by_sample.min() < -1e3  # neither one number nor bounded


# --- Chapter 5 --------------------------------------------------------------------------------------------------------


def test_5_2_density_is_per_cubic_millimetre_and_lengths_too() -> None:
    """Frequency scales as sqrt(E / rho) / L: 18.1 Hz is 18.1 kHz at 125 kg/m^3, millimetres read for micrometres."""

    def scale(rho: float, L: float) -> float:
        return np.sqrt(100 / rho) / L

    printed_density = 1.25e-7 / (1e-3) ** 3
    assert printed_density == pytest.approx(125)
    assert scale(125, 10e-6) / scale(125, 10e-3) == pytest.approx(1000)
    assert scale(1.25e-7, 10e-6) / scale(125, 10e-6) == pytest.approx(3.16e4, rel=0.01)  # taken at its word: 570 MHz


def test_5_2_stated_height_misses_the_stated_volume() -> None:
    """Half ellipsoids of the four printed bases: 1.9e-14 m^3 needs 9 um; 10 um gives 2.1e-14."""
    bases = [(135, 30), (100, 40), (80, 50), (67, 60)]
    volume = {h: np.array([2 / 3 * np.pi * a / 2 * b / 2 * h * 1e-18 for a, b in bases]) for h in (9, 10)}
    np.testing.assert_allclose(volume[9], 1.9e-14, rtol=0.02)
    assert np.all(volume[10] > 2.08e-14)


def test_5_2_moduli_in_text_and_table_differ() -> None:
    text, table = {30, 100, 500, 1000, 5000, 15000}, {30, 100, 1000, 5000, 10000}
    assert text ^ table == {500, 15000, 10000}


# --- the page itself --------------------------------------------------------------------------------------------------


def place(file: str) -> Path:
    """Where a test of the page lies: here, or among those of the project."""
    rooms = [ROOT / "tests", *(ROOT / "reproduction").iterdir()]
    return next((room / file for room in rooms if (room / file).exists()), ROOT / "tests" / file)


def test_every_row_of_the_page_names_an_existing_test() -> None:
    rows = [
        [cell.strip() for cell in line.strip().strip("|").split(" | ")]
        for line in (ROOT / "docs" / "errata.md").read_text().splitlines()
        if line.startswith("| ") and not line.startswith("| where")
    ]
    assert len(rows) > 30
    for row in rows:
        assert len(row) == 5, row
        for file, test in re.findall(r"`(test_\w+\.py)::(test_\w+)`", row[4]):
            assert f"def {test}(" in place(file).read_text(), row
        assert all(place(file).exists() for file in re.findall(r"`(test_\w+\.py)`", row[4])), row
        assert "`test_" in row[4] or row[4] == "wording only", row
