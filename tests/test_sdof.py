"""The single mass: against integration of its equation of motion, its limits, and the misprint."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fasbody.recording.harmonics import fit_harmonics
from fasbody.transmissibility import figures, sdof


def test_response_is_the_steady_state_of_the_equation_of_motion() -> None:
    m, c, k, f = 4.3, 400.0, 6e4, 20.0
    w = 2 * np.pi * f
    t = np.arange(1.0, 1.4, 1e-3)  # the transient decays within 0.1 s

    def rates(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -(c * (x[1] - w * np.cos(w * t)) + k * (x[0] - np.sin(w * t))) / m]

    y = solve_ivp(rates, (0, 1.4), [0, 0], t_eval=t, rtol=1e-10, atol=1e-12).y[0]
    into, out = (fit_harmonics(t, v, f, 1).amplitudes[0] for v in (np.sin(w * t), y))
    assert sdof.response(np.array(w), m, c, k) == pytest.approx(out / into, abs=1e-7)
    assert sdof.transmissibility(np.array(w), m, c, k) == pytest.approx(abs(out / into), abs=1e-7)


def test_isolation_begins_at_sqrt_2_of_the_natural_frequency_for_any_damping() -> None:
    m, k = 4.3, 6e4
    w = np.sqrt(2 * k / m)
    c = np.array([10.0, 100.0, 1000.0])
    assert sdof.transmissibility(np.array(w), m, c, k) == pytest.approx(np.ones(3), abs=1e-12)
    assert np.all(sdof.transmissibility(np.array(1.01 * w), m, c, k) < 1)


def test_every_number_of_the_single_mass_plane_stands_on_its_line() -> None:
    figure = figures.single_mass(measured={10.0: (1.3, 0.1)}, origin="synthetic mean MB, midstance, 2.3 kg")
    assert "agrees with the synthetic mean MB, midstance, 2.3 kg" in figure.get_supxlabel().replace("\n", " ")
    for axis, f in zip(figure.axes, (10, 20, 30, 40), strict=True):
        assert len(axis.texts) >= 5
        assert "1" in {text.get_text() for text in axis.texts}
        for text in axis.texts:
            k, c = text.get_position()
            T = float(sdof.transmissibility(2 * np.pi * f, sdof.MASS_KG, c, 1e3 * k))
            assert pytest.approx(float(text.get_text()), rel=0.03) == T
