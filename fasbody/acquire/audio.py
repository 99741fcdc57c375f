"""A sound card as board and generator on one clock: its output drives the shaker, two inputs take the accelerometers.

The card is played and read in one stream, 48 kHz, channels in step. What comes in is brought down to 4 kHz by one
filter with linear phase, freed of the inputs' coupling, and put into the frames of docs/acquisition.md: from there on
it is a board like any other, with captures, gaps and recovery. Only this file imports sounddevice.

Between amplifier and converter, most interfaces have a capacitor, and fall off below some hertz. A loopback cable shows
how: `measure_loop`. Sensitivities come from a hand calibrator (`calibrator`) or a turn in gravity (`flip`).
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, NonNegativeFloat
from scipy.signal import (  # here: on a busy computer it takes seconds, and later the card plays and records
    bilinear,
    firwin,
    lfilter,
)

from fasbody.acquire.calibrate import FULL, STRAY, within
from fasbody.acquire.documents import SettingsFile
from fasbody.acquire.frames import SAMPLES, Frames
from fasbody.acquire.generator import Refused
from fasbody.acquire.port import WAIT_S, Unplugged
from fasbody.acquire.wire import over_range
from fasbody.exceptions import AcquisitionError, MissingPackageError, SettingError
from fasbody.presentation import counted

try:
    import sounddevice
except ImportError:  # the extra is not installed
    raise MissingPackageError("sounddevice", "audio") from None
except OSError:
    raise AcquisitionError("sounddevice finds no PortAudio library; on Debian: apt install libportaudio2.") from None

#: Of the card and of the recording [Hz].
CARD_HZ, RATE_HZ = 48_000, 4_000
ROLES = ("base", "malleolus")
_DOWN = CARD_HZ // RATE_HZ
_TAPS = 32 * _DOWN + 1
_BLOCK = 960
#: After the coupling is undone, all inputs fall off here [Hz]: far below every excitation, and drift stays bounded.
_COMMON_HZ = 0.1
#: The output changes by full scale in so long [s]; without a sign of life it goes off after so long.
_SLEW_S, _DEAD_S = 0.1, 1.0
#: A stream without a callback for so long is not waited for at its end [s].
_LATE_S = 1.0
#: No block for so long means that the card is gone [s].
_GONE_S = 3.0
#: And so much longer at the start [s].
_STARTS_S = 7.0
#: The input's buffer is no longer [s].
_INPUT_S = 0.25
#: What a card gives in so long after its start counts for nothing [s].
_BEGINS_S = 1.0
#: Of the loopback signal [s], and its peak (share of full scale): an amplifier that was left on shakes nobody hard.
PERIOD_S, PEAK = 4.0, 0.1
#: It is faded in and out for so long [s]; whole periods that are played.
_FADE_S, PERIODS = 0.5, 4
#: And out by Ctrl-C [s].
_CUT_S = 0.05
_TRIES, _LINES = 3, 600
#: Two periods differ by so much of their size if a sample is lost between them; noise makes less.
_ALIKE = 0.05
#: Inputs that are apart by more [s] are not in step: 0.04 degrees at 50 Hz.
_IN_STEP_S = 2e-6


_Number = Annotated[float, Field(description="a number")]
_Positive = Annotated[float, Field(gt=0, description="a number, positive")]
_Pair = Annotated[tuple[float, float], Field(description="two numbers")]


@dataclass(frozen=True)
class Calibration(SettingsFile):
    """What a card does to a signal.

    Attributes:
        device: its name.
        scale_m_s2: acceleration at full scale of base and malleolus; 0 where it is not known yet.
        corner_hz: of the two inputs' high-pass, undone in recordings; 0 if direct.
        output_corner_hz: of the output's.
        loop_gain: input over output, of base and malleolus.
        delay_s: from output to input.
        skew_s: malleolus behind base.
        full_scale_v: peak to peak at the output.
        latency_s: of the output, what it keeps for a late computer; more where the sine breaks.
        output: that plays, 1 or 2; the other one stays silent.
    """

    device: Annotated[str, Field(pattern=r"\S", description="the card's name")]
    scale_m_s2: _Pair = (0.0, 0.0)
    corner_hz: Annotated[
        tuple[NonNegativeFloat, NonNegativeFloat], Field(description="two numbers, not negative")
    ] = (0.0, 0.0)
    output_corner_hz: Annotated[float, Field(ge=0, description="a number, not negative")] = 0.0
    loop_gain: _Pair = (0.0, 0.0)
    delay_s: _Number = 0.5
    skew_s: _Number = 0.0
    full_scale_v: _Positive = 2.0
    latency_s: _Positive = 0.5
    output: Annotated[int, Field(ge=1, le=2, description="1 or 2")] = 1

    TITLE = "calibration of a sound card"
    VALID = "fasbody calibrate writes it"

    def at_corner(self, channel: int) -> float:
        """Of an input's high-pass [Hz]."""
        return self.corner_hz[channel]

    def with_scale(self, channel: int, scale_m_s2: float) -> Self:
        """The same with a sensor for which full scale is this acceleration [m/s^2]."""
        scales = list(self.scale_m_s2)
        scales[channel] = scale_m_s2
        return replace(self, scale_m_s2=(scales[0], scales[1]))

    def check(self) -> None:
        """Raise SettingError if nothing can be recorded with it."""
        for role, scale in zip(ROLES, self.scale_m_s2, strict=True):
            if not abs(scale) > 0:
                raise SettingError(
                    f"the sensitivity of {role} is not known: fasbody calibrate flip {role}, or "
                    f"calibrator {role}."
                )
        if abs(self.skew_s) > _IN_STEP_S:
            raise SettingError(
                f"the inputs of {self.device} are {1e6 * self.skew_s:.3g} us apart and not in step (at most "
                f"{1e6 * _IN_STEP_S:g}); use two inputs of one converter."
            )

    def __str__(self) -> str:
        text = f"{self.device}: gain {self.loop_gain[0]:.5g} and {self.loop_gain[1]:.5g}"
        text += f", delay {1e3 * self.delay_s:.1f} ms, malleolus {1e6 * self.skew_s:+.2f} us behind base"
        for name, corner in zip((*ROLES, "output"), (*self.corner_hz, self.output_corner_hz), strict=True):
            text += f"; {name} " + (f"falls off below {corner:.3g} Hz" if corner > 0 else "is direct")
        return f"{text}; full scale {self.scale_m_s2[0]:.5g} and {self.scale_m_s2[1]:.5g} m/s^2"


@dataclass(frozen=True)
class CardInfo:
    """A sound card of this computer, as PortAudio lists it.

    Attributes:
        device: its name, for --device.
        system: what leads to it, such as ALSA or Core Audio.
        inputs: how many.
        outputs: how many.
        fits: whether it plays two channels and records two at 48 kHz.
    """

    device: str
    system: str
    inputs: int
    outputs: int
    fits: bool

    def __str__(self) -> str:
        channels = f"{counted(self.inputs, 'input')}, {counted(self.outputs, 'output')}"
        fits = f"48 kHz in step: {'yes' if self.fits else 'no'}"
        return f"{self.device}  {self.system}  {channels}  {fits}"


def listed() -> list[CardInfo]:
    """All sound cards of this computer; one that another program uses does not fit until that ends."""
    systems = sounddevice.query_hostapis()
    infos = []
    for number, one in enumerate(sounddevice.query_devices()):
        fits = one["max_input_channels"] > 1 and one["max_output_channels"] > 1
        try:
            if fits:
                sounddevice.check_input_settings(number, channels=2, samplerate=CARD_HZ, dtype="float32")
                sounddevice.check_output_settings(number, channels=2, samplerate=CARD_HZ, dtype="float32")
        except (sounddevice.PortAudioError, ValueError):
            fits = False
        system = systems[one["hostapi"]]["name"]
        infos.append(CardInfo(one["name"], system, one["max_input_channels"], one["max_output_channels"], fits))
    return infos


def cards() -> str:
    """The cards of this computer that play and record, in words."""
    devices = [card.device for card in listed() if card.fits]
    return f"cards of this computer: {', '.join(devices) or 'none'}"


def _buffers(latency_s: float) -> tuple[float, float]:
    """Of input and output [s].

    What comes in comes in lumps of half the input's buffer, and the watch on the base must not wait for it. With both
    alike, 0.8 s, the lumps of 0.44 s left the output too little: it ran dry seven times in twenty minutes.
    """
    return min(latency_s, _INPUT_S), latency_s


def _why(error: Exception) -> str:
    return f"cannot be opened ({str(error).splitlines()[0].rstrip('.')})"


class AudioGenerator:
    """The card's output as the generator of a session.

    Should this process be killed or stopped, the card falls silent by itself: nobody feeds it any more. If nobody has
    watched the base for a second, the stream fades out.

    Args:
        card: gives the one that is open; after an unplug, another one.

    Attributes:
        identity: of the card.
        volts: amplitude [V peak to peak].
        is_on: whether the output is.
        latency_s: from a change to what the inputs show of it.
    """

    def __init__(self, calibration: Calibration, card: "Callable[[], SoundCard]") -> None:
        self._full, self._card = calibration.full_scale_v, card
        self.identity = f"output of sound card {calibration.device}"
        self.volts = 0.0
        self.is_on = False
        self.latency_s = max(0.0, calibration.delay_s) + 2 * _SLEW_S

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.off()

    def alive(self) -> None:
        """Keep the output on: the base is watched."""
        self._card().alive()

    def sine(self, frequency_hz: float, volts: float) -> None:
        """Set a sine: frequency [Hz], amplitude [V peak to peak]; the output stays as it is."""
        self._card().drive(frequency_hz=frequency_hz)
        self.set_volts(volts)

    def set_volts(self, volts: float) -> None:
        """Amplitude [V peak to peak].

        Raises:
            Refused: beyond full scale.
        """
        if not 0 <= volts <= self._full:
            raise Refused(f"{self.identity}: {volts:.3g} V exceed its {self._full:g} V; raise the amplifier's gain.")
        self.volts = volts
        if self.is_on:
            self._card().drive(share=volts / self._full)

    def on(self) -> None:
        """Switch the output on."""
        self.is_on = True
        self.set_volts(self.volts)

    def ramp_down(self) -> None:
        """Switch off: the stream fades by itself."""
        self.off()

    def off(self) -> None:
        """Switch the output off."""
        self.is_on = False
        self._card().drive(share=0.0)


def capture(
    device: str, seconds: float, latency_s: float, play: np.ndarray | None = None, output: int = 1
) -> np.ndarray:
    """Samples of both inputs (n, 2) while `play` (m,) is repeated on one output, faded in before and out behind.

    Ctrl-C fades it out, too.
    """
    count, first, fade, ahead = (round(s * CARD_HZ) for s in (seconds, _BEGINS_S, _FADE_S, latency_s + _SLEW_S))
    out = np.zeros((first + count + fade + ahead, 2), np.float32)  # what is ahead at the end is never played
    recorded = np.zeros_like(out)
    if play is not None:
        rise = np.sin(np.pi / 2 * np.arange(fade) / fade) ** 2
        shape = np.concatenate([np.zeros(first - fade), rise, np.ones(count), rise[::-1], np.zeros(ahead)])
        out[:, output - 1] = shape * play[(np.arange(len(out)) - first) % play.size]
    at, trouble, ended = 0, "", threading.Event()

    def serve(inputs: np.ndarray, outputs: np.ndarray, frames: int, when: object, status: Any) -> None:
        nonlocal at, trouble
        n = min(frames, len(out) - at)
        recorded[at : at + n], outputs[:n], outputs[n:] = inputs[:n], out[at : at + n], 0.0
        at += n
        if status.input_overflow or status.output_underflow:
            trouble = str(status)
        if at == len(out):
            raise sounddevice.CallbackStop

    try:
        with sounddevice.Stream(
            samplerate=CARD_HZ, device=device, channels=2, dtype="float32", latency=_buffers(latency_s),
            callback=serve, finished_callback=ended.set,
        ) as stream:  # fmt: skip
            try:
                while stream.active and not ended.wait(0.1):
                    pass
            except KeyboardInterrupt:
                rest = out[at:]  # not yet played
                rest *= np.maximum(0.0, 1.0 - np.arange(len(rest)) / (_CUT_S * CARD_HZ))[:, None].astype(np.float32)
                time.sleep(_CUT_S + latency_s + _SLEW_S)
                raise
    except (sounddevice.PortAudioError, ValueError) as error:
        raise Unplugged(f"{device}: {_why(error)}; {cards()}.") from None
    if at < len(out):
        raise Unplugged(f"{device}: the card went away.")
    if trouble:
        raise AcquisitionError(f"{device}: samples were lost ({trouble}); close other programs and try again.")
    return recorded[first : first + count].astype(float)


class SoundCard:
    """The stream that is played and read; a port for `Board`, and a generator's output.

    Args:
        calibration: of the card.

    Raises:
        Unplugged: there is no such card, or it cannot do this.
    """

    known = staticmethod(Calibration.read)
    output = AudioGenerator
    listed = staticmethod(listed)

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self._blocks: deque[tuple[np.ndarray, str]] = deque()
        self._arrived = threading.Event()
        self._last = time.monotonic()
        self._amplitude = self._target = self._phase = 0.0  # amplitude: share of full scale
        self._omega = 0.0  # a sample
        self._beat = self._sounded = -math.inf
        self._decimator = Decimator()
        self._uncouplers = [Uncoupler(corner) for corner in calibration.corner_hz]
        self._rest = np.zeros((0, 2))
        self._full = np.zeros((0, 2), int)  # how many raw samples of each were at full scale
        name = f"sound card {calibration.device}"
        self._frames = Frames(name, RATE_HZ, calibration.scale_m_s2)
        self.events = self._frames.events
        try:
            self._stream = sounddevice.Stream(
                samplerate=CARD_HZ, blocksize=_BLOCK, device=calibration.device, channels=2, dtype="float32",
                latency=_buffers(calibration.latency_s), callback=self._serve,
            )  # fmt: skip
            self._stream.start()
            self._last = time.monotonic() + _STARTS_S
        except (sounddevice.PortAudioError, ValueError) as error:
            raise Unplugged(f"{calibration.device}: {_why(error)}; {cards()}.") from None

    @staticmethod
    def settings(file: Path) -> Calibration:
        """A calibration that allows a recording."""
        calibration = Calibration.read(file)
        calibration.check()
        return calibration

    @staticmethod
    def listen(calibration: Calibration, seconds: float) -> tuple[np.ndarray, float]:
        """Both inputs in shares of full scale (n, 2), and their rate [Hz]."""
        return capture(calibration.device, seconds, calibration.latency_s), CARD_HZ

    def _serve(self, inputs: np.ndarray, outputs: np.ndarray, frames: int, when: object, status: Any) -> None:
        """In PortAudio's thread: take a block, give a block."""
        now = time.monotonic()
        event = "input overrun" if status.input_overflow else "input underrun" if status.input_underflow else ""
        event = event or ("output underrun" if status.output_underflow else "")
        self._blocks.append((inputs.copy(), event))
        target = self._target if now - self._beat < _DEAD_S else 0.0
        most = frames / (_SLEW_S * CARD_HZ)
        end = self._amplitude + min(max(target - self._amplitude, -most), most)
        steps = np.arange(1, frames + 1)
        wave = np.sin(self._phase + self._omega * steps)
        outputs[:] = 0.0
        outputs[:, self.calibration.output - 1] = (self._amplitude + (end - self._amplitude) / frames * steps) * wave
        if self._amplitude or end:
            self._sounded = now
        self._amplitude, self._phase = end, (self._phase + self._omega * frames) % (2 * np.pi)
        self._last = now
        self._arrived.set()

    def drive(self, frequency_hz: float | None = None, share: float | None = None) -> None:
        """What the output is to give from now on: frequency, amplitude as a share of full scale."""
        if frequency_hz is not None:
            self._omega = 2 * np.pi * frequency_hz / CARD_HZ
        if share is not None:
            self._target = share
        self.alive()

    def alive(self) -> None:
        """The base is watched: the output may go on for another second."""
        self._beat = time.monotonic()

    def read(self) -> bytes:
        """Frames of what has come in, after at most WAIT_S.

        Raises:
            Unplugged: the card gives no more.
        """
        self._arrived.wait(WAIT_S)
        self._arrived.clear()
        try:
            active = self._stream.active
        except sounddevice.PortAudioError:  # closed meanwhile
            active = False
        if time.monotonic() - self._last > _GONE_S or not active:
            raise Unplugged(f"{self.calibration.device}: the card went away.")
        out = b""
        while self._blocks:
            block, event = self._blocks.popleft()
            if event:  # samples are missing before this block; PortAudio does not state how many: at least a frame
                self._frames.skip(event)
            values, full = self._decimator.feed(block.astype(float))
            self._rest, self._full = np.concatenate([self._rest, values]), np.concatenate([self._full, full])
            out += self._whole()
        return out

    def _whole(self) -> bytes:
        whole = len(self._rest) // SAMPLES * SAMPLES
        ready, self._rest = self._rest[:whole], self._rest[whole:]
        full, self._full = self._full[:whole], self._full[whole:]
        columns = zip(self._uncouplers, ready.T, strict=True)
        ready = np.column_stack([uncoupler.feed(column) for uncoupler, column in columns])
        out = b""
        for start in range(0, whole, SAMPLES):
            part = slice(start, start + SAMPLES)
            out += self._frames.frame(ready[part], over_range(full[part].sum(axis=0) > STRAY))
        return out

    def write(self, data: bytes) -> None:
        """A query of the computer: a hello replies to it."""
        self._frames.greet()

    def close(self) -> None:
        """Output faded and played to its end, then the stream closed; that of a card that is gone, at once.

        PortAudio throws away what is in the card's buffers, on stop and on abort.
        """
        self._target = 0.0
        ahead = self.calibration.latency_s + _SLEW_S  # and a little, as a sound server has buffers of its own
        while self._lives() and time.monotonic() - self._sounded < ahead:
            time.sleep(WAIT_S)
        self._stream.close(ignore_errors=True)

    def _lives(self) -> bool:
        try:
            return bool(self._stream.active) and time.monotonic() - self._last < _LATE_S
        except sounddevice.PortAudioError:  # closed already
            return False


class Decimator:
    """From CARD_HZ to RATE_HZ, by a filter of linear phase: flat to 1.5 kHz, and 80 dB down above 2.5 kHz."""

    def __init__(self) -> None:
        self._taps = firwin(_TAPS, 1 / _DOWN, window=("kaiser", 8.0))
        self._rest = np.zeros((_TAPS - 1, 2))

    def feed(self, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Samples (n, 2) at CARD_HZ -> (m, 2) at RATE_HZ, and how many of those around each are at full scale (m, 2).

        A filter makes less of a peak that is cut off, so that it must be looked for before.
        """
        data = np.concatenate([self._rest, block])
        count = max(0, (len(data) - _TAPS) // _DOWN + 1)
        self._rest = data[count * _DOWN :]
        if not count:
            return np.zeros((0, 2)), np.zeros((0, 2), int)
        windows = np.lib.stride_tricks.sliding_window_view(data, _TAPS, axis=0)[::_DOWN][:count]
        around = windows[:, :, _TAPS // 2 - _DOWN // 2 :][:, :, :_DOWN]
        return np.asarray(windows @ self._taps), np.sum(np.abs(around) >= FULL, axis=2)


class Uncoupler:
    """Undoes a first-order high-pass down to _COMMON_HZ: (s + w) / (s + w0), by the bilinear transform.

    Args:
        corner_hz: of the high-pass; 0 if there is none.
        rate_hz: of the samples.
    """

    def __init__(self, corner_hz: float, rate_hz: float = RATE_HZ) -> None:
        low = _COMMON_HZ if corner_hz > 0 else 0.0
        self._b, self._a = bilinear([1, 2 * math.pi * corner_hz], [1, 2 * math.pi * low], rate_hz)
        self._state = np.zeros(1)

    def feed(self, values: np.ndarray) -> np.ndarray:
        """The next samples (n,)."""
        out, self._state = lfilter(self._b, self._a, values, zi=self._state)
        return np.asarray(out)


def loop_signal() -> np.ndarray:
    """One period of noise with a flat spectrum from 0.25 Hz to 4 kHz."""
    n = round(PERIOD_S * CARD_HZ)
    lines = np.zeros(n // 2 + 1, complex)
    top = round(4000 * PERIOD_S)
    lines[1:top] = np.exp(2j * np.pi * np.random.default_rng(1).random(top - 1))
    wave = np.fft.irfft(lines, n)
    return np.asarray(PEAK * wave / np.abs(wave).max())


def measure_loop(device: str, latency_s: float, output: int = 1) -> Calibration:
    """Gain, delay and high-pass of a card one of whose outputs is connected to both inputs."""
    signal = loop_signal()
    for _ in range(_TRIES):
        recorded = capture(device, PERIODS * PERIOD_S, latency_s, signal, output)
        before, last = recorded[-2 * signal.size : -signal.size], recorded[-signal.size :]
        if np.std(last - before) < _ALIKE * np.std(last):
            return replace(analyse_loop(device, recorded, signal), latency_s=latency_s, output=output)
    raise AcquisitionError(
        f"{device}: two periods of the same signal do not come back alike: samples are lost on the way, or no cable is "
        "there; close other programs, use a larger buffer."
    )


def analyse_loop(device: str, recorded: np.ndarray, signal: np.ndarray) -> Calibration:
    """The same from the recorded inputs (n, 2) of the repeated signal (m,), whose last whole period is used.

    Both channels contain the high-passes of output and input:
    L_i = g_i jw/(jw + w_o) jw/(jw + w_i) exp(-jw d_i).
    """
    from scipy.optimize import least_squares

    for role, column in zip(ROLES, recorded.T, strict=True):
        within(column, f"{device}: the input of {role}")
    n = signal.size
    whole = recorded[len(recorded) // n * n - n :][:n]
    played = np.fft.rfft(signal)
    used = np.flatnonzero(np.abs(played) > 1e-3 * np.abs(played).max())
    used = used[np.unique(np.geomspace(1, used.size, _LINES).astype(int)) - 1]  # each decade counts alike
    w = 2 * np.pi * used / (n / CARD_HZ)
    loop = np.fft.rfft(whole, axis=0)[used] / played[used, None]
    correlation = np.fft.irfft(np.fft.rfft(whole[:, 0]) * np.conj(played), n)
    late = int(np.argmax(np.abs(correlation))) / CARD_HZ
    sign = np.sign(correlation[round(late * CARD_HZ)])
    loop = loop * np.exp(1j * w * late)[:, None]
    middle = (w > 2 * np.pi * 200) & (w < 2 * np.pi * 2000)
    gain = sign * np.median(np.abs(loop[middle]), axis=0)
    if not np.abs(gain).min() > 1e-3:
        raise AcquisitionError(f"{device}: an input does not hear the output; connect the cable to both, and turn up.")

    def model(x: np.ndarray) -> np.ndarray:
        out, inputs = np.exp(x[0]), np.exp(x[1:3])
        common = 1j * w / (1j * w + out)
        ways = [
            gain[i] * x[3 + i] * common * 1j * w / (1j * w + inputs[i]) * np.exp(-1e-6j * w * x[5 + i])
            for i in range(2)
        ]
        return np.column_stack(ways)

    def misfit(x: np.ndarray) -> np.ndarray:
        off = ((model(x) - loop) / gain).ravel()
        return np.concatenate([off.real, off.imag])

    starts = [np.array([np.log(a), np.log(b), np.log(b), 1, 1, 0, 0]) for a in (1e-2, 5.0) for b in (1e-2, 5.0)]
    low, high = [-9.0] * 3 + [0.5] * 2 + [-1e3] * 2, [6.0] * 3 + [2.0] * 2 + [1e3] * 2
    best = min((least_squares(misfit, x, bounds=(low, high), x_scale="jac") for x in starts), key=lambda fit: fit.cost)
    out, base, malleolus = (float(c) if c > 0.02 else 0.0 for c in np.exp(best.x[:3]) / (2 * np.pi))
    delays = 1e-6 * best.x[5:]
    return Calibration(
        device, (0.0, 0.0), (base, malleolus), out, (float(gain[0] * best.x[3]), float(gain[1] * best.x[4])),
        float(late + delays[0]), float(delays[1] - delays[0]),
    )  # fmt: skip
