"""The amplitude loop: raise the voltage step by step to a peak-to-peak acceleration of the base, within the limits."""

from dataclasses import asdict, dataclass

import numpy as np

from fasbody.acquire.board import Board, Stalled, Watch
from fasbody.acquire.generator import Excitation
from fasbody.acquire.person import ACTION, VDV_LIMIT
from fasbody.exceptions import AcquisitionError, SettingError
from fasbody.recording.harmonics import columns


@dataclass(frozen=True)
class Safety:
    """Limits of the excitation.

    Attributes:
        volts: highest amplitude [V peak to peak].
        start_volts: where the first ramp begins.
        peak_m_s2: highest base acceleration, either sign.
        displacement_m: largest peak-to-peak motion of the base.
        growth: the amplitude rises by at most this factor a step.
        daily_a8: largest daily exposure A(8) of a person [m/s^2].
        daily_vdv: and their largest vibration dose value [m/s^1.75].
    """

    volts: float = 5.0
    start_volts: float = 0.02
    peak_m_s2: float = 15.0
    displacement_m: float = 0.008
    growth: float = 2.0
    daily_a8: float = ACTION
    daily_vdv: float = VDV_LIMIT

    def check(self, frequency_hz: float, peak_to_peak: float) -> None:
        """Refuse an excitation before anything moves.

        Raises:
            SettingError: it would exceed a limit, or a limit is none.
        """
        for name, limit in asdict(self).items():
            if not 0 < limit < np.inf:
                raise SettingError(f"the safety limit {name} is {limit:g}; it must be a positive number.")
        travel = peak_to_peak / (2 * np.pi * frequency_hz) ** 2
        if not travel <= COMMANDED * self.displacement_m:
            most = f"{1e3 * COMMANDED * self.displacement_m:.3g} mm"
            raise SettingError(
                f"{peak_to_peak:g} m/s^2 peak to peak at {frequency_hz:g} Hz move the base by {1e3 * travel:.3g} mm, "
                f"more than {most}, which leave room to the limit of {1e3 * self.displacement_m:g} mm; choose a higher "
                "frequency or a lower acceleration."
            )
        if not 0.5 * peak_to_peak <= COMMANDED * self.peak_m_s2:
            raise SettingError(
                f"{peak_to_peak:g} m/s^2 peak to peak are more than +-{COMMANDED * self.peak_m_s2:.4g} m/s^2, which "
                f"leave room to the limit of +-{self.peak_m_s2:g} m/s^2; choose less."
            )

    def peak(self, frequency_hz: float, noise: float = 0.0) -> float:
        """Acceleration sample [m/s^2] beyond which the output goes off at a frequency, below both limits.

        A sine of the largest displacement d peaks at d/2 w^2. The room below that is for what a shaker whose gain grows
        still adds until its next peak is seen and it is at rest. The sensor's noise moves no base.

        Args:
            frequency_hz: of the sine.
            noise: of the base at rest [m/s^2 rms].
        """
        moving = 0.5 * self.displacement_m * (2 * np.pi * frequency_hz) ** 2
        return float(min(TRIPPED * self.peak_m_s2, moving, TRIPPED * moving + _NOISE_PEAK * noise))


@dataclass(frozen=True)
class Level:
    """What the loop reached.

    Attributes:
        peak_to_peak: of the base [m/s^2].
        volts: amplitude that does it [V peak to peak].
        steps: after how many.
    """

    peak_to_peak: float
    volts: float
    steps: int


#: The output goes off at this share of a limit: a gain that grows by a fifth a second grows by 1.5 % from one peak of
#: a sine of 10 Hz to the next one, the end of the block that shows it, and the shaker's rest.
TRIPPED = 0.97
#: How close is close enough (share), how many steps at most, harmonics of the shaker that count for peak to peak.
TOLERANCE, _STEPS, _HARMONICS = 0.02, 30, 3
#: Second harmonic that a sound shaker stays below (share), and how many standard deviations noise reaches: 5.5 once in
#: 2.6e7 samples, seven hours at 1 kHz.
_DISTORTION, _NOISE_PEAK = 0.10, 5.5
#: Largest level that is commanded, as a share of a limit: its tolerance and a sound shaker's harmonic trip nothing.
COMMANDED = TRIPPED / (1 + TOLERANCE) / (1 + _DISTORTION)
#: A base that moves by more before the output is on [m/s^2 rms] has another source, or a bad sensor.
_REST = 0.5
#: A shaker rings down after the last frequency: so often is the rest measured at most, for so long [s], until it falls
#: by less than this share.
_RESTS, _REST_S, _FALLS = 20, 0.25, 0.05
#: The level counts for the gain when it is so many times the noise at rest; a gain that sinks below this share of its
#: largest is a sensor or an amplifier that clips.
_ABOVE_NOISE, _LINEAR = 4.0, 0.8
#: So long is waited after a change of the voltage, and then measured: seconds, periods. Below a share of
#: the level only what is about there is needed, and a person is shaken meanwhile.
_TRANSIENT, _MEASURE = (0.2, 4.0), (0.2, 5.0)
_QUICKLY, _QUICK = 0.4, (0.1, 2.0)
#: At a tenth of the largest voltage the base must move by more than this [m/s^2].
_ANSWER = 0.2


def peak_to_peak(values: np.ndarray, rate_hz: float, frequency_hz: float) -> float:
    """Peak to peak of a periodic signal without its noise, from its first three harmonics.

    Args:
        values: (n,) [m/s^2], at least two periods.
        rate_hz: sampling rate.
        frequency_hz: fundamental.
    """
    wt = 2 * np.pi * frequency_hz / rate_hz * np.arange(values.size)
    count = max(1, min(_HARMONICS, int(0.45 * rate_hz // frequency_hz)))
    c, *_ = np.linalg.lstsq(columns(wt, count), values, rcond=None)
    return float(np.ptp(columns(np.linspace(0, 2 * np.pi, 400), count) @ c))


def _rest(board: Board, wait: bool) -> tuple[float, float]:
    """Offset and noise [m/s^2, rms] of the base at rest, once it has come to rest; no noise without `wait`."""
    noise = np.inf
    for _ in range(_RESTS):
        rest = board.collect(_REST_S)[:, board.base]
        before, noise = noise, float(rest.std())
        if not wait:
            return float(rest.mean()), 0.0
        if noise <= _REST and noise >= (1 - _FALLS) * before:
            break
    if not noise <= _REST:
        raise AcquisitionError(
            f"the base moves by {noise:.2g} m/s^2 rms before the output is on; is another source driving the shaker?"
        )
    return float(rest.mean()), noise


def reach(
    generator: Excitation, board: Board, frequency_hz: float, target: float, safety: Safety, guess_volts: float = 0.0
) -> Level:
    """Switch the generator on and bring the base to `target` [m/s^2] peak to peak within 2 %.

    Args:
        generator: with its output off, or on from an earlier level.
        board: that shows the base.
        frequency_hz: of the sine.
        target: level, peak to peak [m/s^2].
        safety: limits.
        guess_volts: about the voltage that will do [V], if known: the ramp begins at a quarter of it, so that a sensor
            that clips shows before the level is reached.

    Raises:
        SettingError: the limits forbid it.
        AcquisitionError: a limit is reached, or the base does not follow.
    """
    safety.check(frequency_hz, target)
    hello = board.decoder.hello
    assert hello is not None
    offset, noise = _rest(board, wait=not generator.is_on)
    peak = safety.peak(frequency_hz, noise)
    seen = hello.reach(board.base) - abs(offset)
    if not seen >= peak:
        raise AcquisitionError(
            f"the base sensor shows at most {seen:.3g} m/s^2 from its rest at {offset:.3g}, less than the safety limit "
            f"of {peak:.3g}, which could not be kept; choose a larger range on the board or a lower --max-acceleration."
        )
    board.watch = Watch(peak, offset, generator.alive)
    volts = min(max(safety.start_volts, 0.25 * guess_volts), safety.volts)
    generator.sine(frequency_hz, volts)
    generator.on()
    unplugs = board.unplugs
    gain = highest = 0.0  # largest gain [m/s^2 per V] at a new highest amplitude [V]
    doubted = False
    for step in range(1, _STEPS + 1):
        board.watch_for(generator.latency_s)
        quick = gain * volts < _QUICKLY * target and not doubted
        transient, measure = (_QUICK, _QUICK) if quick else (_TRANSIENT, _MEASURE)
        board.collect(max(transient[0], transient[1] / frequency_hz))
        values = board.collect(max(measure[0], measure[1] / frequency_hz))[:, board.base]
        if board.unplugs > unplugs:  # what it shows since then may belong to no amplitude, or to none that was set
            raise Stalled(f"{board.reader.port_name}: unplugged while the shaker was on; output off.")
        measured = peak_to_peak(values, hello.rate_hz, frequency_hz)
        if measured < _LINEAR * gain * volts:  # also one that is silent now: its voltage must not be raised
            if not doubted:  # measured once more first: a busy computer may have played late
                doubted = True
                continue
            raise AcquisitionError(
                f"the base does not follow the amplitude: {measured:.3g} m/s^2 peak to peak at {volts:.3g} V, where "
                f"lower levels predict {gain * volts:.3g}; does its sensor clip, or the amplifier? Output off."
            )
        doubted = False
        if measured >= max(_ANSWER, _ABOVE_NOISE * noise) and volts > highest:  # on the way down it shows what was
            highest, gain = volts, max(gain, measured / volts)
        if abs(measured / target - 1) <= TOLERANCE and not quick:
            return Level(measured, volts, step)
        if measured < _ANSWER and volts >= 0.1 * safety.volts:
            raise AcquisitionError(
                f"the base does not follow: {measured:.2g} m/s^2 at {volts:.3g} V; check amplifier and base sensor."
            )
        needed = volts * target / max(measured, 1e-6)
        if needed > safety.volts and volts >= safety.volts:
            raise AcquisitionError(
                f"{target:g} m/s^2 at {frequency_hz:g} Hz would need about {needed:.3g} V, beyond {safety.volts:g} V; "
                "raise the amplifier's gain or --max-volts."
            )
        volts = min(needed, safety.growth * volts, safety.volts)
        generator.set_volts(volts)
    raise AcquisitionError(
        f"the base did not settle at {target:g} m/s^2 at {frequency_hz:g} Hz ({measured:.3g} after {_STEPS} steps)."
    )
