"""The single-sine example shows what it says."""

import numpy as np
import single_sine


def test_all_models_tie_agree_at_the_sine_and_are_wrong_elsewhere() -> None:
    rows = single_sine.single()
    fits = np.array([fit for _, fit, *_ in rows])
    assert fits.min() > 98.5 and np.ptp(fits) < 0.4
    at_sine = np.array([here for _, _, here, *_ in rows])
    assert np.median(at_sine) < 0.05
    elsewhere = np.array([everywhere for _, _, _, everywhere, _ in rows])
    assert elsewhere.min() > 5 and np.median(elsewhere) > 30
    assert all("excites rank 2" in warning for *_, warning in rows)


def test_pooling_gives_the_response() -> None:
    assert all(error < 0.5 for _, error in single_sine.pooled())
