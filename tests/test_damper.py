"""The force laws against closed forms: exponential integrals, differences, quadrature of the hereditary integral."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import exp1

import mjcf
from fasbody.foot import damper
from fasbody.foot.damper import algebraic_force, damping

PAD = np.array([4.22, 40.0, 5.0, 0.8, 0.004, 1.5, 0.02, 0.2])


def exact_relaxation(t: float, c: float, tau_1: float, tau_2: float) -> float:
    """G(t) of Eq. 4.22 for the spectrum c/tau: its integral is a difference of exponential integrals."""
    spectrum = exp1(t / tau_2) - exp1(t / tau_1) if t > 0 else math.log(tau_2 / tau_1)
    return (1 + c * spectrum) / (1 + c * math.log(tau_2 / tau_1))


def test_damper_has_the_printed_values() -> None:
    assert damping(0.0, 310.0, -120.0, 180.0) == 310.0
    assert damping(1e-3, 310.0, -120.0, 180.0) == pytest.approx(310 * math.exp(0.12) * math.cos(0.18), rel=1e-15)
    assert damping(math.pi / 360, 310.0, 0.0, 180.0) == pytest.approx(0.0, abs=1e-12)  # a quarter wave: c vanishes
    assert damping(0.01, 5.0, 100.0, 0.0) == pytest.approx(5 / math.e, rel=1e-15)


@pytest.mark.parametrize("t", [0.0, 1e-4, 1e-3, 0.01, 0.1, 1.0, 10.0])
@pytest.mark.parametrize(("c", "tau_1", "tau_2"), [(0.8, 0.004, 1.5), (2.0, 0.01, 10.0)])
def test_relaxation_against_exponential_integrals(t: float, c: float, tau_1: float, tau_2: float) -> None:
    assert damper.relaxation(t, c, tau_1, tau_2) == pytest.approx(exact_relaxation(t, c, tau_1, tau_2), abs=3e-4)


def test_relaxation_starts_at_one_and_ends_at_the_relaxed_share() -> None:
    assert damper.relaxation(0.0, 0.8, 0.004, 1.5) == pytest.approx(1.0, rel=1e-14)
    assert damper.relaxation(1e9, 0.8, 0.004, 1.5) == pytest.approx(1 / (1 + 0.8 * math.log(375)), rel=1e-14)


@pytest.mark.parametrize("frequency", [2.0, 20.0])
def test_viscoelastic_pad_against_the_hereditary_integral(frequency: float) -> None:
    """Strain e0 + small sine from t = 0: exponentials stepped in time against quadrature with the exact G."""
    _, A, B, c, tau_1, tau_2, h, e0 = PAD
    w, size, end = 2 * np.pi * frequency, 4e-4, 1.3 / frequency
    stress_rate = lambda s: -A * B * math.exp(B * (e0 - size * math.sin(w * s) / h)) * size * w * math.cos(w * s) / h  # noqa: E731
    G = lambda t: exact_relaxation(t, c, tau_1, tau_2)  # noqa: E731
    want, _ = quad(lambda s: G(end - s) * stress_rate(s), 0, end, limit=200, epsabs=1e-9)
    n = 4000
    stresses = np.zeros(damper.BRANCHES)
    rate = lambda g, t: np.array([  # noqa: E731
        damper.viscoelastic_rate(PAD, g, size * math.sin(w * t), size * w * math.cos(w * t), i)
        for i in range(damper.BRANCHES)
    ])  # fmt: skip
    for k in range(n):  # midpoint rule
        t, dt = k * end / n, end / n
        stresses = stresses + dt * rate(stresses + 0.5 * dt * rate(stresses, t), t + 0.5 * dt)
    have = damper.viscoelastic_force(PAD, stresses, size * math.sin(w * end))
    scale = A * B * math.exp(B * e0) * size / h
    assert abs(have - want) < 1e-3 * scale
    assert abs(want) > 0.1 * scale


def test_power_law_and_strain_damper_values() -> None:
    e, e_dot = 0.15, -2.0
    assert damper.power_law(e, e_dot, 900, 1.5, 30, 0.9, 0.8) == pytest.approx(
        900 * 0.15**1.5 - 30 * 0.15**0.9 * 2**0.8, rel=1e-14
    )
    assert damper.strain_damper(e, e_dot, 900, 30) == pytest.approx(900 * 0.15 - 30 * 0.15 * 2, rel=1e-14)


@pytest.mark.parametrize(
    "user",
    [[4.25, 310, -120, 180], [4.24, 900, 30, 0.02, 0.2], [4.23, 900, 1.5, 30, 0.9, 0.8, 0.02, 0.2]],
    ids=["4.25", "4.24", "4.23"],
)
def test_algebraic_laws_resist_and_vanish_at_rest(user: list[float]) -> None:
    row = np.zeros(damper.USER_SIZE)
    row[: len(user)] = user
    assert algebraic_force(row, 0.0, 0.0, 0.0) == pytest.approx(0.0, abs=1e-12)
    step = 1e-7
    by_rate = (algebraic_force(row, 0.0, step, 0.0) - algebraic_force(row, 0.0, -step, 0.0)) / (2 * step)
    assert by_rate < 0  # stretching is resisted
    stiffness = -(algebraic_force(row, step, 0.0, 0.0) - algebraic_force(row, -step, 0.0, 0.0)) / (2 * step)
    expected = {4.25: 0.0, 4.24: 900 / 0.02, 4.23: 900 * 1.5 * 0.2**0.5 / 0.02}[user[0]]
    assert stiffness == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_pad_that_has_left_the_ground_pulls_with_nothing_but_its_static_force() -> None:
    power = [4.23, 900, 1.5, 30, 0.9, 0.8, 0.02, 0.2]
    for user, rest in (([4.24, 900, 30, 0.02, 0.2], 180.0), (power, 900 * 0.2**1.5)):
        row = np.zeros(damper.USER_SIZE)
        row[: len(user)] = user
        assert algebraic_force(row, 0.0041, 0.3, 0.0) == pytest.approx(-rest, rel=1e-14)  # e = 0.2 - 0.0041/0.02 < 0


def test_native_damping_is_a_share_of_the_same_damper() -> None:
    row = np.array([4.25, 310, -120, 180, 0, 0, 0, 0.0])
    whole = algebraic_force(row, 1e-3, 0.2, 0.0)
    assert algebraic_force(row, 1e-3, 0.2, 100.0) == pytest.approx(whole + 20.0, rel=1e-14)


def test_laws_say_their_equation_and_fit_the_user_field() -> None:
    assert [law.code for law in damper.LAWS] == [4.22, 3, 4.23, 4.24, 1, 2, 4.25]
    assert all(1 + len(law.parameters) <= damper.USER_SIZE for law in damper.LAWS)


def test_the_page_of_the_models_has_each_law_with_its_constants_in_their_order() -> None:
    rows = re.findall(r"^\| `([\d.]+ [^`]+)` \|", (Path(mjcf.__file__).parent / "README.md").read_text(), re.MULTILINE)
    laws = [" ".join([law.equation, *(parameter.split()[0] for parameter in law.parameters)]) for law in damper.LAWS]
    assert sorted(rows) == sorted(laws)


@pytest.mark.parametrize("user", [
    (4.25, 310, -120, 180, 0, 0, 0, 0), (4.24, 900, 30, 0.02, 0.2, 0, 0, 0), (4.23, 900, 1.5, 30, 0.9, 1, 0.02, 0.2),
])  # fmt: skip
def test_a_law_at_rest_is_its_slope(user: tuple[float, ...]) -> None:
    law, step = np.array(user, float), 1e-7
    by_position, by_rate = (
        -np.diff([algebraic_force(law, side * step * way[0], side * step * way[1], 0.0) for side in (-1, 1)])[0]
        for way in ((1, 0), (0, 1))
    )
    slopes = by_position / (2 * step), by_rate / (2 * step)
    assert damper.at_rest(law) == pytest.approx(slopes, rel=1e-6, abs=1e-6)
