"""A foot stands on the shaker: sensors that clip or show too little, and a base that is not at rest yet."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from feeder import Feeder, hello

from fasbody.acquire.board import Board, Watch
from fasbody.acquire.lateness import Lateness
from fasbody.acquire.level import Safety, peak_to_peak, reach
from fasbody.exceptions import AcquisitionError

NOISE = 0.03


class Rig:
    """Board and generator in one, in its own time: `volts` shake the base, a sensor shows at most `clip` of it.

    Args:
        gain: base acceleration, peak to peak [m/s^2 per V]. offset: of the sensor. ringing: of the base before [m/s^2],
            which fades within `fades` [s]. lag: of its amplitude [s].
    """

    def __init__(
        self, gain: float = 14.0, clip: float = np.inf, offset: float = 0.0, ringing: float = 0.0, fades: float = 0.4,
        lag: float = 1e-3,
    ) -> None:  # fmt: skip
        self.gain, self.clip, self.offset, self.ringing, self.fades = gain, clip, offset, ringing, fades
        self.decoder, self.base = SimpleNamespace(hello=hello()), 0
        self.watch: Watch | None = None
        self.is_on, self.was_on, self.volts, self.frequency_hz = False, False, 0.0, 20.0
        self.highest = self.now = self._amplitude = 0.0
        self.lag = lag
        self._rng = np.random.default_rng(1)

    def sine(self, frequency_hz: float, volts: float) -> None:
        self.frequency_hz, self.volts = frequency_hz, volts

    def set_volts(self, volts: float) -> None:
        self.volts = volts

    def on(self) -> None:
        self.is_on = self.was_on = True

    def alive(self) -> None:
        """A living driver."""

    def collect(self, seconds: float) -> np.ndarray:
        passed = np.arange(round(1000 * seconds)) / 1000
        t = self.now + passed
        self.now = t[-1] + 1e-3
        wanted = 0.5 * self.gain * self.volts * self.is_on
        size = wanted + (self._amplitude - wanted) * np.exp(-passed / self.lag)
        self._amplitude = float(size[-1])
        true = size * np.sin(2 * np.pi * self.frequency_hz * t)
        true = true + self.ringing * np.exp(-t / self.fades) * np.sin(2 * np.pi * 11 * t)
        self.highest = max(self.highest, float(np.abs(true).max()))
        shown = np.clip(true + self._rng.normal(0, NOISE, t.size), -self.clip, self.clip) + self.offset
        if self.watch is not None:
            self.watch.check(shown)
        return np.column_stack([shown, shown])

    def reach(self, wanted: float = 17.9, safety: Safety | None = None, guess: float = 0.0) -> Any:
        return reach(self, self, 20.0, wanted, safety or Safety(), guess)  # type: ignore[arg-type]


@pytest.mark.parametrize("clip", [1.0, 3.0, 5.0, 7.0, 8.0])
@pytest.mark.parametrize(("gain", "guess"), [(14.0, 0.0), (14.0, 1.28), (40.0, 1.28), (4.5, 0.0)])
def test_sensor_that_clips_unsaid_drives_the_shaker_nowhere(clip: float, gain: float, guess: float) -> None:
    """At the next frequency the shaker may answer three times as strongly as expected; 15 m/s^2 are the limit."""
    rig = Rig(gain, clip)
    with pytest.raises(AcquisitionError, match=r"does its sensor clip, or the amplifier\? Output off"):
        rig.reach(guess=guess)
    assert rig.highest <= 15.0


@pytest.mark.parametrize("gain", [4.5, 14.0, 200.0])
@pytest.mark.parametrize("guess", [0.0, 1.28])
@pytest.mark.parametrize("lag", [0.001, 0.1, 0.2])
def test_sound_sensor_reaches_the_level(gain: float, guess: float, lag: float) -> None:
    if gain * guess > 50:
        guess = 0.0  # ten times as strong as expected is a case for the watch
    rig = Rig(gain, lag=lag)
    level = rig.reach(guess=guess)
    assert level.peak_to_peak == pytest.approx(17.9, rel=0.02)
    slow = 0.025 if lag < 0.05 else 0.15  # the loop takes a slow shaker at its word
    assert gain * level.volts == pytest.approx(17.9, rel=slow)
    assert peak_to_peak(rig.collect(1.0)[:, 0], 1000, 20) == pytest.approx(17.9, rel=slow)


@pytest.mark.parametrize(
    ("span", "counts", "offset"), [(19.6, 1024.0, 9.81), (14.0, 1024.0, 0.0), (39.2, 32768 / 14.0, 0.0)]
)
def test_range_too_small_for_the_watch_is_refused_before_the_output_is_on(
    span: float, counts: float, offset: float
) -> None:
    """Gravity takes half of +-2 g; and a converter may end before the range that is said."""
    rig = Rig(offset=offset)
    known = rig.decoder.hello
    channels = tuple(replace(channel, range_m_s2=span, counts_per_m_s2=counts) for channel in known.channels)
    rig.decoder.hello = replace(known, channels=channels)
    with pytest.raises(AcquisitionError, match=r"less than the safety limit of 15, .* larger range on the board"):
        rig.reach()
    assert not rig.was_on
    rig.reach(10.0, replace(Safety(), peak_m_s2=9.0))


def test_shaker_rings_down_before_it_is_blamed_and_the_watch_knows_its_real_rest() -> None:
    rig = Rig(ringing=9.0, fades=0.5)
    rig.reach(10.0, Safety(displacement_m=0.001))
    assert rig.watch is not None
    assert rig.watch.peak == pytest.approx(Safety(displacement_m=0.001).peak(20.0, NOISE), rel=0.05)
    other = Rig(ringing=3.0, fades=1e9)
    with pytest.raises(AcquisitionError, match="is another source driving the shaker"):
        other.reach()
    assert not other.was_on and 4.0 < other.now < 6.0


def test_any_sensor_over_range_while_the_shaker_is_on_ends_it(feeder: Feeder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fasbody.acquire.board.BLIND_S", 20.0)
    looked: list[int] = []
    board = Board(feeder.port, 921600)
    board.wait_for_hello()
    board.watch = Watch(1e9, 0.0, lambda: looked.append(1))
    board.collect(0.1)
    assert looked
    feeder.amplitude = 40_000
    with pytest.raises(AcquisitionError, match="base, malleolus went over range while the shaker was on; output off"):
        board.collect(1.0)
    board.close()


def test_stamps_that_stand_still_are_said_at_once(feeder: Feeder) -> None:
    board = Board(feeder.port, 921600)
    board.wait_for_hello()
    real = Lateness.of
    board._lateness.of = lambda us, host: real(board._lateness, 0, host)  # type: ignore[method-assign]
    with pytest.raises(AcquisitionError, match="its time stamps do not advance"):
        board.collect(5.0)
    board.close()
