"""The core alone, on oscillators that are written down here, against closed forms and SciPy's DOP853."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fasbody.exceptions import NotSmoothError, PeriodicMotionError
from fasbody.foot import harmonic_balance
from fasbody.foot.harmonic_balance import SMALL, Fourier, highest, multipliers, newton, periodic

Array = np.ndarray


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


F = 2.0
W = 2 * np.pi * F


@dataclass(frozen=True)
class Oscillator:
    """x'' + damping x' + spring(x) = force cos(w t)."""

    spring: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    damping: float
    force: float
    name: str = "oscillator"
    frequency_hz: float = F

    @property
    def metric(self) -> Array:
        return np.eye(1)

    @property
    def rest(self) -> Array:
        return np.zeros(1)

    def residual(self, series: Fourier, x: Array, share: float) -> Array:
        z, v, a = series.at(x)
        left = W**2 * a + self.damping * W * v + self.spring(z)
        return series.project(left) - share * series.real(np.array([[self.force]]))

    def jacobian(self, series: Fourier, x: Array, share: float) -> Array:
        stiffness = self.slope(series.at(x)[0])
        one = np.ones_like(stiffness)
        return series.tangent(np.stack([stiffness, self.damping * W * one, W**2 * one]))[0]

    def changes(self, series: Fourier, x: Array) -> int:
        return 0

    def rates(self, t: float, s: Array) -> Array:
        z, v = s
        return np.array([v, self.force * np.cos(W * t) - self.damping * v - self.spring(z)])

    def after(self, s: Array) -> Array:
        return np.asarray(solve_ivp(self.rates, (0, 1 / F), s, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1])


def duffing(cubic: float, force: float, damping: float = 0.8) -> Oscillator:
    return Oscillator(lambda x: 100 * x + cubic * x**3, lambda x: 100 + 3 * cubic * x**2, damping, force)


def start(series: Fourier, x: Array) -> Array:
    z, v, _ = series.at(x)[:, 0, 0]
    return np.array([z, W * v])


def test_a_series_gives_back_what_it_was_made_of(rng: np.random.Generator) -> None:
    series = Fourier.of(5)
    x = rng.normal(size=(3, series.size))
    np.testing.assert_allclose(series.project(series.at(x)[0]), x, atol=1e-14)
    np.testing.assert_allclose(series.real(series.complex(x), x[:, 0]), x)
    fine = np.arange(4096) / 4096
    k = np.arange(1, 6)
    value = x[0, 0] + (series.complex(x[0]) @ np.exp(2j * np.pi * np.outer(k, fine))).real
    np.testing.assert_allclose(series.at(x)[0, 0], value[:: 4096 // series.samples], atol=1e-12)
    slope = np.gradient(np.tile(value, 3), fine[1] * 2 * np.pi)[4096:8192]
    np.testing.assert_allclose(series.at(x)[1, 0], slope[:: 4096 // series.samples], atol=1e-3)


def test_a_dynamic_stiffness_turns_harmonics(rng: np.random.Generator) -> None:
    series = Fourier.of(4)
    x, Z = rng.normal(size=series.size), rng.normal(size=5) + 1j * rng.normal(size=5)
    force = series.dynamic(Z) @ x
    np.testing.assert_allclose(series.complex(force), Z[1:] * series.complex(x), rtol=1e-13)
    assert force[0] == pytest.approx(Z[0].real * x[0])


@pytest.mark.parametrize("force", [3.0, 40.0])
def test_the_tangent_is_the_derivative(rng: np.random.Generator, force: float) -> None:
    series, system = Fourier.of(6), duffing(60.0, force)
    x, by = rng.normal(size=(1, series.size)), np.empty((13, 13))
    for k, unit in enumerate(1e-6 * np.eye(13)):
        by[:, k] = ((system.residual(series, x + unit, 1) - system.residual(series, x - unit, 1)) / 2e-6)[0]
    np.testing.assert_allclose(system.jacobian(series, x, 1), by, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize(("cubic", "force"), [(1.0, 1.0), (200.0, 100.0), (3000.0, 300.0), (-40.0, 20.0)])
def test_duffings_oscillator_comes_back(cubic: float, force: float) -> None:
    """Weak, strong, so strong that Newton's method has to follow the amplitude, and softening."""
    system = duffing(cubic, force)
    found = periodic(system)
    begin = start(found.series, found.x)
    np.testing.assert_allclose(system.after(begin), begin, rtol=1e-9, atol=1e-10)


def test_the_linear_oscillator_is_exact() -> None:
    found = periodic(duffing(0.0, 5.0))
    assert found.series.complex(found.x)[0, 0] == pytest.approx(5 / (100 - W**2 + 0.8j * W), rel=1e-13)


def test_harmonics_are_doubled_until_the_highest_are_small() -> None:
    """The last number of harmonics meets the bound, and half as many, solved alike, do not."""
    system = duffing(3000.0, 300.0)
    found = periodic(system)
    assert highest(system, found.series, found.x) < SMALL
    half = Fourier.of(found.series.harmonics // 2)
    begin = half.real(found.series.complex(found.x)[:, : half.harmonics])
    x, _, solved = newton(harmonic_balance._Single(system, half, 1.0), begin.reshape(1, -1))
    assert solved.all()
    assert highest(system, half, x) >= SMALL
    assert periodic(duffing(1.0, 1.0)).series.harmonics == harmonic_balance.HARMONICS < found.series.harmonics


def test_a_symmetric_motion_is_not_small_for_its_missing_even_harmonics() -> None:
    system, series = duffing(1.0, 1.0), Fourier.of(6)
    odd = series.real(np.array([[1.0, 0, 0.1, 0, 1e-3, 0]]))
    assert highest(system, series, odd) == pytest.approx(25e-3 / np.sqrt(1 + 0.9**2 + 25e-3**2))


def test_a_spring_with_a_kink_is_refused() -> None:
    system = Oscillator(lambda x: np.where(x > 0, 30 * x, 10 * x), lambda x: np.where(x > 0, 30.0, 10.0), 1.0, 5.0)
    with pytest.raises(NotSmoothError, match="oscillator: the motion at 2 Hz is not smooth enough") as caught:
        periodic(system)
    assert caught.value.harmonics == harmonic_balance.MOST_HARMONICS
    assert caught.value.left >= SMALL
    assert caught.value.changes == 0


def test_a_mass_that_is_shaken_out_of_its_well_has_no_motion() -> None:
    """The mean of x + x^2 must vanish, which no x_0 + a cos(w t) with a above 1/sqrt(2) can."""
    system = Oscillator(lambda x: 5 * (x + x**2), lambda x: 5 + 10 * x, 1.0, np.sqrt(2) * W**2)
    with pytest.raises(PeriodicMotionError, match="at 2 Hz a periodic motion was found only up to") as caught:
        periodic(system)
    assert 0.45 < caught.value.share < 0.55
    assert not isinstance(caught.value, NotSmoothError)


def test_a_start_nearby_needs_no_new_jacobian() -> None:
    system = duffing(20.0, 10.0, 3.0)
    found, asked = periodic(system), []

    class Counted(Oscillator):
        def jacobian(self, series: Fourier, x: Array, share: float) -> Array:
            asked.append(share)
            return super().jacobian(series, x, share)

    near = Counted(system.spring, system.slope, system.damping, 10.1)
    again = periodic(near, found)
    assert not asked
    np.testing.assert_allclose(again.x, periodic(near).x, atol=1e-11)


def test_many_systems_are_solved_at_once_and_a_lost_one_says_so() -> None:
    """x^2 = c for several c, the last of which has no root."""

    class Roots:
        c = np.array([1.0, 4.0, 1e6, -1.0])

        def residual(self, x: Array, rows: Array) -> Array:
            return x**2 - self.c[rows, None]

        def jacobian(self, x: Array, rows: Array) -> Array:
            return 2 * x[..., None]

        def size(self, x: Array) -> Array:
            return np.abs(x[:, 0])

    x, _, solved = newton(Roots(), np.full((4, 1), 3.0))
    assert solved.tolist() == [True, True, True, False]
    np.testing.assert_allclose(x[:3, 0], [1, 2, 1000], rtol=1e-12)


def mathieu(q: float, count: int) -> Array:
    """Slopes (3, count, 1, 1) of x'' + 0.1 x' + (a - 2 q cos(w t)) x = 0 with a on the first tongue."""
    angle = 2 * np.pi * np.arange(count) / count
    stiffness = (W / 2) ** 2 * (1 - q * np.cos(angle))
    return np.stack([stiffness, np.full(count, 0.1), np.ones(count)])[..., None, None]


@pytest.mark.parametrize(("q", "stable"), [(0.0, True), (0.02, True), (0.1, False)])
def test_multipliers_of_mathieus_equation(q: float, stable: bool) -> None:
    """On the first tongue small damping loses to 0.1 and beats 0.02; against DOP853."""

    def rates(t: float, s: Array) -> Array:
        return np.array([s[1], -0.1 * s[1] - (W / 2) ** 2 * (1 - q * np.cos(W * t)) * s[0]])

    columns = [solve_ivp(rates, (0, 1 / F), unit, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
               for unit in np.eye(2)]  # fmt: skip
    want = np.linalg.eigvals(np.column_stack(columns))
    have = multipliers(mathieu(q, 32), 1 / F)
    np.testing.assert_allclose(np.sort_complex(have), np.sort_complex(want), atol=1e-7)
    assert (np.abs(have[0]) < 1) == stable


def test_multipliers_of_a_stiff_element_without_inertia() -> None:
    """A spring in series with a dashpot beside a mass, exact at whatever stiffness: exp(lambda T)."""
    k, c, m, T = 1e9, 40.0, 2.0, 0.05
    K, C, M = np.array([[k, -k], [-k, k]]), np.diag([0.0, c]), np.diag([m, 0.0])
    slopes = np.repeat(np.stack([K, C, M])[:, None], 16, axis=1)
    A = np.array([[0, 0, 1], [k / c, -k / c, 0], [-k / m, k / m, 0]])
    want = np.exp(T * np.linalg.eigvals(A))
    have = multipliers(slopes, T, first_order=1)
    assert np.abs(have[0]) == pytest.approx(np.abs(want).max(), rel=1e-6)
