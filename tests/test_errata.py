"""Every misprint of the thesis that changes a number, pinned: printed against right, each from a short computation.

For Chapter 4 the printed formulas (fasbody/printed.py) meet SymPy's derivation from the same deformations, entry by
entry: exactly the listed entries differ, and each differs as listed. The others are computed here from the formula.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from symbolic_arch import evaluate, poses

from fasbody import lagrange, printed
from fasbody.arch import DAMPERS, SPRINGS, Arch
from fasbody.kinematics import arms, rest

ROOT = Path(__file__).parent.parent
ARCH = Arch.draw(np.random.default_rng(0))
REST = rest(ARCH)
POSE = poses(ARCH, np.random.default_rng(1), 1)[0][0]
UNIT = np.eye(6)


def differing(ours: np.ndarray, right: np.ndarray) -> set[tuple[int, ...]]:
    """Places, from 1, at which two arrays differ by more than rounding."""
    wrong = np.abs(ours - right) > 1e-9 * np.abs(right).max()
    return {tuple(int(i) + 1 for i in place) for place in np.argwhere(wrong)}


def only(name: str) -> Arch:
    """ARCH with one of the 13 constants left (c_1 cannot be zero, so it is made negligible)."""
    others = dict.fromkeys(SPRINGS + DAMPERS, 0.0) | {"c_1": 1e-300}
    return replace(ARCH, **others | {name: getattr(ARCH, name)})


# --- Appendix B -------------------------------------------------------------------------------------------------------


def test_A_55_is_the_only_wrong_entry_of_the_mass_matrix() -> None:
    as_printed = lagrange.mass_matrix(ARCH, POSE, as_printed=True)
    right = evaluate("mass", ARCH, POSE)
    assert differing(as_printed, right) == {(5, 5)}
    assert as_printed[4, 4] - right[4, 4] == pytest.approx(ARCH.m_4 / 4 * (1 - ARCH.L_4**2), rel=1e-9)
    ratio = printed.A_55(ARCH, REST) / evaluate("mass", ARCH, REST)[4, 4]
    assert ratio == pytest.approx(2.15, abs=0.005)  # +115 %
    assert np.linalg.eigvalsh(as_printed[:5, :5]).min() > 0  # so definiteness does not find it


def velocity_products(terms) -> dict[tuple[int, int, int], float]:
    """Coefficient of theta_i' theta_j' in row r of B; (r, i, j)."""
    table = {}
    for i in (2, 3, 4):
        for j in range(i, 5):
            own = terms(UNIT[i]) if i == j else terms(UNIT[i] + UNIT[j]) - terms(UNIT[i]) - terms(UNIT[j])
            table |= {(row + 1, i, j): own[row] for row in range(5)}
    return table


def test_four_wrong_velocity_products() -> None:
    as_printed = velocity_products(lambda w: printed.velocity_terms(ARCH, POSE, w))
    right = velocity_products(lambda w: evaluate("velocity", ARCH, POSE, w))
    scale = max(map(abs, right.values()))
    wrong = {key for key in right if abs(as_printed[key] - right[key]) > 1e-12 * scale}
    assert wrong == {(3, 4, 4), (3, 3, 4), (4, 4, 4), (5, 4, 4)}
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = arms(ARCH, POSE)
    P = (ARCH.m_1 * ARCH.L_1**2 / 4 + ARCH.I_1) * E_2 / E_1**2
    half = ARCH.m_4 / 2
    error = {key: as_printed[key] - right[key] for key in wrong}
    assert error[3, 4, 4] == pytest.approx(half * l_2 * h_4 - half * h_2 * l_4)
    assert error[4, 4, 4] == pytest.approx(half * l_3 * h_4 - half * h_3 * l_4)
    assert error[3, 3, 4] == pytest.approx(2 * P * l_2 * (h_3 * h_4 - l_3 * l_4))
    assert error[5, 4, 4] == pytest.approx(P * l_4**3 * (l_2 - 1))


def test_B_1_squares_accelerations_and_multiplies_k_F_by_a_velocity() -> None:
    q_dot, q_ddot = np.array([0.3, 0, 2.0, -1.0, 1.5, 0]), np.array([0, 0, 30.0, 20.0, -10.0, 0])
    right = lagrange.right_hand_side(ARCH, POSE, q_dot, 1.0)[0]
    as_printed = printed.B_1(ARCH, POSE, q_dot, q_ddot, 1.0)
    repaired = (
        printed.B_1(ARCH, POSE, q_dot, q_dot, 1.0) + ARCH.k_F * q_dot[0] - ARCH.k_F * POSE[0]
    )  # rates for accelerations, z_F for its rate
    assert repaired == pytest.approx(right)
    assert abs(as_printed - right) > 0.5 * abs(right)


def test_printed_springs_follow_from_a_product_where_a_difference_was_meant() -> None:
    """Every printed spring force is the gradient of -sqrt(E_1) L_1 sin theta_10 + front: no slip beyond it."""
    right = evaluate("spring", ARCH, POSE, as_printed=True)
    np.testing.assert_allclose(printed.spring_forces(ARCH, POSE), right, rtol=1e-9)
    consistent = evaluate("spring", ARCH, REST)
    np.testing.assert_allclose(consistent, 0, atol=1e-7)
    assert np.all(np.abs(evaluate("spring", ARCH, REST, as_printed=True)[2:5]) > 1)  # [N m] at rest, out of nothing


def test_five_wrong_damper_terms_in_B_3() -> None:
    def matrix(name: str, force) -> np.ndarray:
        return np.stack([force(only(name), rate) for rate in UNIT], axis=-1)

    wrong, errors = {}, {}
    for name in DAMPERS:
        as_printed = matrix(name, lambda arch, rate: printed.damper_forces(arch, POSE, rate))
        right = matrix(name, lambda arch, rate: evaluate("damper", arch, POSE, rate, as_printed=True))
        wrong[name], errors[name] = differing(as_printed, right), (as_printed - right) / getattr(ARCH, name)
    none: dict[str, set] = {name: set() for name in ("c_3", "c_4", "c_T", "c_F")}
    assert wrong == none | {"c_1": {(3, 3), (3, 4), (3, 5)}, "c_2": {(3, 4), (3, 5)}}
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = arms(ARCH, POSE)
    s_10, root = ARCH.L_1 * np.sin(ARCH.theta_10), np.sqrt(E_1)
    assert errors["c_1"][2, 2] == pytest.approx(-((E_2 * l_2) ** 2) * (E_1 - s_10**2) / E_1)  # sin theta_1: theta_10
    assert errors["c_1"][2, 3] == pytest.approx(-((E_2 * s_10) ** 2) * (h_2 - l_2) * l_3 / E_1)  # cos: sin theta_2
    assert errors["c_1"][2, 4] == pytest.approx(-((E_2 * s_10) ** 2) * (h_2 - l_2) * l_4 / E_1)
    assert errors["c_2"][2, 3] == pytest.approx(-(h_3 - l_3) * (l_2 + root) / E_1)  # cos: sin theta_3
    assert errors["c_2"][2, 4] == pytest.approx(-(h_4 * (l_2 - root) - l_4 * (l_2 + root)) / E_1)


def test_third_joint_spring_is_left_out_of_the_printed_energy() -> None:
    """Eq. 4.9 sums k_i to i = 3; the printed B_4 and B_5 do contain k_4."""
    assert np.abs(printed.spring_forces(only("k_4"), POSE)[3:5]).min() > 1


# --- Eq. 4.12 ---------------------------------------------------------------------------------------------------------


def test_wrong_entries_of_the_linear_damping() -> None:
    wrong, error = {}, {}
    for name in DAMPERS:
        as_printed, right = printed.linear(only(name))[0], evaluate("damping", only(name), REST, as_printed=True)
        wrong[name], error[name] = differing(as_printed, right), (as_printed - right) / getattr(ARCH, name)
    none: dict[str, set] = {name: set() for name in ("c_3", "c_4", "c_T", "c_F")}
    assert wrong == none | {"c_1": {(6, 6)}, "c_2": {(3, 3)}}
    a = arms(ARCH, REST)
    assert error["c_1"][5, 5] == pytest.approx(2)
    assert error["c_2"][2, 2] == pytest.approx((a.l_2 / np.sqrt(a.E_1) + 1) ** 2 - (a.l_2 / a.E_1 + 1) ** 2)


def test_wrong_entries_of_the_linear_stiffness() -> None:
    stray = printed.linear(only("c_T"))[1]  # K_33's first bracket stands there without its k_11
    assert differing(stray, 0 * stray) == {(3, 3)}
    wrong, error = {}, {}
    for name in SPRINGS:
        as_printed = printed.linear(only(name))[1] - stray
        right = evaluate("stiffness", only(name), REST, as_printed=True)
        wrong[name], error[name] = differing(as_printed, right), as_printed - right
    none: dict[str, set] = {name: set() for name in ("k_3", "k_4", "k_T", "k_F")}
    symmetric = {(3, 3), (3, 4), (4, 3), (3, 5), (5, 3), (4, 4), (5, 5)}
    assert wrong == none | {"k_11": symmetric, "k_12": {(6, 6)}, "k_2": {(3, 3)}}
    l_2, l_3, l_4, h_2, h_3, h_4, E_10, E_20 = arms(ARCH, REST)
    s_10, root, k_11 = ARCH.L_1 * np.sin(ARCH.theta_10), np.sqrt(E_10), ARCH.k_11
    assert error["k_12"][5, 5] == pytest.approx(2 * ARCH.k_12)
    assert error["k_2"][2, 2] == pytest.approx(-ARCH.k_2 * (l_2 + root) ** 2 * (1 / root - 1 / E_10))
    assert error["k_11"][2, 2] == pytest.approx(-k_11 * stray[2, 2])
    right_34 = -k_11 * (-s_10 * l_2 - E_20 / root * h_2) * s_10 * l_3
    right_35 = -k_11 * (-s_10 * l_2 - E_20 / root * h_2) * s_10 * l_4
    right_44 = -k_11 * s_10**2 * (E_20 * h_3 - l_3**2)
    right_55 = -k_11 * s_10**2 * (E_20 * h_4 - l_4**2)
    derived = evaluate("stiffness", only("k_11"), REST, as_printed=True)
    np.testing.assert_allclose(derived[[2, 2, 3, 4], [3, 4, 3, 4]], [right_34, right_35, right_44, right_55], rtol=1e-9)


def test_static_constants_are_spurious_and_one_has_the_wrong_sign() -> None:
    constant, right = printed.linear(ARCH)[2], evaluate("spring", ARCH, REST, as_printed=True)
    assert constant[2] == pytest.approx(-right[2])  # Const3
    np.testing.assert_allclose(constant[3:5], right[3:5], rtol=1e-9)
    assert np.abs(constant[2:5]).min() > 1


def test_table_drives_all_rows_with_one_sign() -> None:
    """Const3 to Const5 print +M_i1 y_B''; Appendix B itself and Lagrange have -M_i1 y_B''."""
    moving, still = (lagrange.right_hand_side(ARCH, REST, np.zeros(6), table) for table in (1.0, 0.0))
    np.testing.assert_allclose(moving - still, -evaluate("mass", ARCH, REST)[0], atol=1e-7)


def test_printed_stiffness_is_indefinite_in_every_draw_and_often_unstable() -> None:
    """K_66 has the wrong sign; with it mended 40 % of the draws stay indefinite, the consistent model never is."""
    rng, literal, mended = np.random.default_rng(0), 0, 0
    for _ in range(300):
        K = -printed.linear(Arch.draw(rng))[1]
        literal += np.linalg.eigvalsh(K)[0] < 0
        mended += np.linalg.eigvalsh(K[:5, :5])[0] < 0
    assert literal == 300
    assert 90 < mended < 150


def test_table_4_1_closes_only_to_3_6_micrometres() -> None:
    gap = ARCH.L_1 * np.cos(np.radians(59.7)) - ARCH.height_0
    assert abs(gap) == pytest.approx(3.6e-6, abs=1e-7)
    preload = 1e6 * abs(ARCH.L_1 * (np.sin(np.radians(59.7)) - np.sin(ARCH.theta_10)))
    assert preload == pytest.approx(2, abs=0.5)  # [N] out of nothing at k_11 = 1e6 N/m


def test_table_4_1_inertias_mix_two_formulas() -> None:
    third, twelfth = (
        [getattr(ARCH, f"m_{i}") * getattr(ARCH, f"L_{i}") ** 2 / divisor for i in range(1, 5)] for divisor in (3, 12)
    )
    table = [getattr(ARCH, f"I_{i}") for i in range(1, 5)]
    np.testing.assert_allclose(table, [*third[:2], *twelfth[2:]], rtol=0.01)


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
            assert f"def {test}(" in (ROOT / "tests" / file).read_text(), row
        for file in re.findall(r"`(test_\w+\.py)`", row[4]):
            assert (ROOT / "tests" / file).exists(), row
        assert "`test_" in row[4] or row[4] == "wording only", row
