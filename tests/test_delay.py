"""A delayed motion against the sine that it samples."""

import numpy as np
import pytest

from identification.delay import delayed

RATE, OMEGA = 1000.0, 2 * np.pi * 45
TIME = np.arange(400) / RATE


@pytest.mark.parametrize("samples", [0.0, 0.3, -0.7, 1.5, -2.0, 2.4, 40.2])
def test_a_sine_is_read_later(samples: float) -> None:
    late = OMEGA * (TIME - samples / RATE)
    x = np.column_stack([np.sin(OMEGA * TIME), np.cos(OMEGA * TIME)])
    inside = slice(8 + abs(int(samples)), -8 - abs(int(samples)))
    np.testing.assert_allclose(
        delayed(x, samples)[inside], np.column_stack([np.sin(late), np.cos(late)])[inside], atol=1e-7
    )
    slope = -OMEGA / RATE * np.cos(late)
    np.testing.assert_allclose(delayed(x[:, 0], samples, 1)[inside], slope[inside], atol=1e-6)


@pytest.mark.parametrize("samples", [0.8, -0.8, 2.0, -2.0])
def test_ends_follow_the_polynomial(samples: float) -> None:
    late = np.sin(OMEGA * (TIME - samples / RATE))
    np.testing.assert_allclose(delayed(np.sin(OMEGA * TIME), samples), late, atol=1e-3)


@pytest.mark.parametrize("samples", [3.0, 3.5, 900.0, -900.0])
def test_nothing_grows_beyond_the_ends(samples: float) -> None:
    assert np.abs(delayed(np.sin(OMEGA * TIME[:40]), samples)).max() < 1.1
