"""The choice of domain."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import oracle
import pytest

from fasbody.exceptions import SettingError
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.domains import choose_domain

Trial = Callable[..., Recording]


def test_steady_recordings_are_periodic_and_broadband_ones_are_not(trial: Trial) -> None:
    steady = checked(trial(oracle.TRUTH, 20.0))
    rng = np.random.default_rng(0)
    unknown = replace(steady.condition, frequency_hz=None)
    wide = checked(replace(steady, base_m_s2=rng.normal(0, 5, 3600), condition=unknown))
    assert choose_domain([steady], "auto") == ("periodic", [])
    assert choose_domain([steady, wide], "auto") == ("time", [])
    assert choose_domain([steady], "time") == ("time", [])
    with pytest.raises(SettingError, match=r"20hz\.csv is not periodic.*use --domain time"):
        choose_domain([wide], "periodic")


def test_a_beating_recording_goes_to_the_time_domain_and_says_why(trial: Trial) -> None:
    steady = checked(trial(oracle.TRUTH, 20.0))
    beat = 1 + 0.2 * np.sin(2 * np.pi * 0.7 * steady.time_s)
    beating = replace(steady, malleolus_m_s2=steady.malleolus_m_s2 * beat)
    domain, why = choose_domain([steady, beating], "auto")
    assert domain == "time"
    assert "is not steady: its amplitude scatters by" in why[0]
    assert choose_domain([beating], "periodic")[0] == "periodic"
