"""How late samples are, against schedules whose lateness is known."""

import numpy as np
import pytest

from fasbody.acquire.lateness import Lateness

FRAME_S = 0.016


def lateness(late_s: np.ndarray, drift: float = 0.0, first_us: int = 0) -> np.ndarray:
    """What is found for frames that come 5 ms after they were taken, and so much later [s]."""
    taken = FRAME_S * np.arange(late_s.size)
    judge = Lateness()
    stamps = [(first_us + round(1e6 * (1 + drift) * t)) % 2**32 for t in taken]
    return np.array([judge.of(us, 40.0 + t + 0.005 + late) for us, t, late in zip(stamps, taken, late_s, strict=True)])


@pytest.mark.parametrize("first_us", [0, 2**32 - 3_000_000])
@pytest.mark.parametrize("drift", [-2e-4, 0.0, 2e-4])
def test_late_frames_are_told_by_how_much(drift: float, first_us: int) -> None:
    """Whatever the clocks' offset, also where the 32-bit clock turns over; a minute's drift counts for little."""
    late = np.zeros(4000)
    late[1000:1040] = np.linspace(0.64, 0.0, 40)  # a computer that looks away for 0.64 s gets all frames at once
    late[2000:] = 0.3
    found = lateness(late, drift, first_us)
    until = FRAME_S * np.arange(4000)  # drift that was allowed for and did not happen, at most
    assert (np.abs(found - late)[:2000] <= 1e-6 + 7e-4 * until[:2000]).all()
    assert found[1000] == pytest.approx(0.64, abs=0.012) and found[2000] == pytest.approx(0.3, abs=0.025)


@pytest.mark.parametrize("drift", [-4e-3, 4e-3])
def test_clock_that_is_only_just_accepted_is_not_late_after_a_quarter_of_an_hour(drift: float) -> None:
    """A recording may be 5000 ppm off; without allowing for it a frame would seem 3.6 s late here."""
    assert lateness(np.zeros(57_000), drift).max() < 1e-3


def test_stamps_that_stand_still_are_told() -> None:
    judge = Lateness()
    for n in range(100):
        judge.of(0, FRAME_S * n)
        assert judge.still == (FRAME_S * n > 1.0)
    judge.of(16_000, 2.0)
    assert not judge.still


def test_restarted_board_is_not_late_for_ever() -> None:
    judge = Lateness()
    for n in range(100):
        judge.of(round(1e6 * (50 + FRAME_S * n)), FRAME_S * n)
    found = [judge.of(round(1e6 * FRAME_S * n), 2.0 + FRAME_S * n) for n in range(100)]
    assert max(found) < 1e-3
