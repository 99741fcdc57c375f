"""The force on the table, against the closed form of a linear foot on a sine."""

from dataclasses import replace

import numpy as np
import pytest
from test_sensors import linear, linear_motion, recorded  # noqa: F401

from fasbody.constants import GRAVITY
from fasbody.foot.model import Foot
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.known import Known
from identification import figures
from identification.contact import Contact, summary
from identification.fitting import fit_foot
from identification.lifting import lifting
from identification.result import FitResult

HZ = (20.0, 45.0)


@pytest.fixture(scope="module")
def fitted(linear: Foot) -> FitResult:  # noqa: F811
    p = TwoDof.from_values(linear.values())
    data = [recorded(p, f, noise=1e-3) for f in HZ]
    data[1] = replace(data[1], known=Known(static_forces=((None, 300.0),)))
    return fit_foot(data, linear, free=["k_T", "k_F"], starts=1, threads=1, departures=False)


def test_the_force_of_a_linear_foot_is_its_closed_form(fitted: FitResult, linear: Foot) -> None:  # noqa: F811
    p = TwoDof.from_values(linear.values())
    weight = GRAVITY * (p.m_S + p.m_F)
    for each, hz, held in zip(fitted.contact, HZ, (weight, 300.0), strict=True):
        shank, bone = linear_motion(p, hz)
        A = 8.95 * abs(p.m_S * shank + p.m_F * bone)
        assert each.static_force_n == pytest.approx(held) and each.stated == (held == 300.0)
        assert each.force_n.max() == pytest.approx(held + A, rel=2e-3)
        share = np.arccos(np.clip(held / A, -1, 1)) / np.pi
        assert each.share == pytest.approx(share, abs=1.5 / each.force_n.size)
        assert each.missing_n == pytest.approx(max(0.0, A - held), rel=3e-3)
    lifted, pressed = fitted.contact
    assert lifted.share > 0.2 and pressed.share == 0.0 and pressed.sentence() == ""


def test_what_cannot_be_is_said_and_shown(fitted: FitResult) -> None:
    (text,) = fitted.impossible
    lifted = fitted.contact[0]
    for part in (
        "At 20 Hz", f"fat pad pulls on the table for {100 * lifted.share:.0f} % of the cycle",
        f"at least {lifted.missing_n:.3g} N", "the weight of leg and load", "so the foot probably did not lift off",
            "1 of 2 recordings are affected",
    ):  # fmt: skip
        assert part in text
    assert text in fitted.sheet().notes
    row = fitted.document()["contact"][0]
    assert row["share"] == lifted.share and len(row["force_n"]) == len(row["time_s"]) == lifted.force_n.size
    axis = figures.contact(fitted).axes[0]
    np.testing.assert_allclose(axis.lines[0].get_ydata()[:-1], lifted.force_n)


def test_harmonics_speak_for_or_against_lifting() -> None:
    t = np.linspace(0, 1, 100, endpoint=False)
    about = ("x.csv", 20.0, 0.0, "fat_pad", 40.0, True, t, 40 + 80 * np.cos(2 * np.pi * t))
    words = [Contact(*about, added=0.1, measured=found).harmonics for found in (0.09, 0.04, 0.01)]
    assert words == ["for", "neither", "against"] and Contact(*about).harmonics == ""
    assert "the static force (known.static_force_n in study.toml)" in summary([Contact(*about)]) and summary([]) == ""


def test_a_force_on_the_foot_moves_the_malleolus_as_the_matrices_say(linear: Foot) -> None:  # noqa: F811
    p, n = TwoDof.from_values(linear.values()), 64
    force = np.maximum(0.0, np.cos(2 * np.pi * np.arange(n) / n) - 0.4)
    found = lifting(linear.values(), 15.0, force, 3)
    for h, have in enumerate(found, 1):
        s, F = 2j * np.pi * 15.0 * h, 2 / n * np.sum(force * np.exp(-2j * np.pi * h * np.arange(n) / n))
        ankle, pad = p.k_T + s * p.c_11, p.k_F + s * p.c_21
        K = np.array([[ankle, -ankle], [-ankle, ankle + pad]]) + s**2 * np.diag([p.m_S, p.m_F])
        assert have == pytest.approx(s**2 * np.linalg.solve(K, [0.0, F])[0])
