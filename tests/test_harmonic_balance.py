"""The core alone, on oscillators that are written down here, against closed forms and SciPy's DOP853."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fasbody.exceptions import NotSmoothError, PeriodicMotionError
from fasbody.foot import harmonic_balance
from fasbody.foot.harmonic_balance import SMALL, Fourier, highest, newton, periodic

Array = np.ndarray


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


@pytest.mark.parametrize(("cubic", "force"), [(1.0, 1.0), (200.0, 100.0), (3000.0, 300.0), (-40.0, 20.0)])
def test_duffings_oscillator_comes_back(cubic: float, force: float) -> None:
    """Weak, strong, so strong that Newton's method has to follow the amplitude, and softening."""
    system = duffing(cubic, force)
    found = periodic(system)
    begin = start(found.series, found.x)
    np.testing.assert_allclose(system.after(begin), begin, rtol=1e-9, atol=1e-10)


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
