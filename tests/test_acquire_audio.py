"""A sound card as board and generator: its calibration by arrays, the whole way through PulseAudio and PortAudio."""

import io
import json
import re
import subprocess
import sys
import threading
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
import typer
from scipy.signal import cont2discrete, lfilter

from fasbody.acquire.bench.foot import BODY_MASS_KG
from fasbody.acquire.board import Board
from fasbody.acquire.commands import app
from fasbody.acquire.plan import Plan
from fasbody.acquire.session import Session
from fasbody.acquire.timeline import Timeline
from fasbody.acquire.wire import Block, Decoder
from fasbody.exceptions import AcquisitionError, InputFileError, SettingError
from fasbody.foot.shaker import sine
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.foot import TRUTH, exact
from fasbody.laboratory.instrument import Instrument
from fasbody.recording.condition import foot_mass, shank_mass
from fasbody.recording.recording import Condition
from fasbody.recording.study import Study
from simulator import pulse

if lacks := pulse.missing():
    pytest.skip(f"no sound card is tested: {lacks}", allow_module_level=True)

from fasbody.acquire import audio, devices
from fasbody.acquire.audio import CARD_HZ, RATE_HZ, Calibration
from fasbody.acquire.calibrate import calibrator, flip


def high_pass(values: np.ndarray, corner_hz: float) -> np.ndarray:
    """First order, of what is constant between two samples: scipy's own discretisation."""
    w = 2 * np.pi * corner_hz
    b, a, _ = cont2discrete(([1.0, 0.0], [1.0, w]), 1 / CARD_HZ, "bilinear")
    return np.asarray(lfilter(b.ravel(), a, values))


def test_loopback_gives_gain_delay_and_couplings() -> None:
    signal, late = audio.loop_signal(), 12_345
    played = high_pass(np.tile(signal, 4), 0.9)
    heard = np.column_stack([0.5 * high_pass(played, 3.1), -0.7 * high_pass(played, 1.7)])
    heard = np.roll(heard, late, axis=0)
    heard[:, 1] *= -1
    found = audio.analyse_loop("made", heard + np.random.default_rng(2).normal(0, 1e-5, heard.shape), signal)
    np.testing.assert_allclose(found.loop_gain, (0.5, 0.7), rtol=1e-4)
    np.testing.assert_allclose([*found.corner_hz, found.output_corner_hz], [3.1, 1.7, 0.9], rtol=0.01)
    assert found.delay_s == pytest.approx(late / CARD_HZ, abs=1e-6) and abs(found.skew_s) < 1e-8
    direct = audio.analyse_loop("direct", np.column_stack(2 * [np.tile(signal, 2)]), signal)
    assert direct.corner_hz == (0.0, 0.0) and "is direct" in str(direct)
    with pytest.raises(AcquisitionError, match="does not hear the output"):
        audio.analyse_loop("open", 1e-6 * heard, signal)


@pytest.mark.parametrize("corner", [0.0, 2.3])
def test_sensitivity_from_a_flip_and_from_a_calibrator(corner: float) -> None:
    rng, t = np.random.default_rng(4), np.arange(9 * CARD_HZ) / CARD_HZ
    held = 9.80665 * np.cos(np.pi * np.clip((t - 4.2) / 0.4, 0, 1)) + rng.normal(0, 0.02, t.size)
    tone = 10 * np.sqrt(2) * np.sin(2 * np.pi * 159.4 * t) * (np.abs(t - 2.03) > 0.01)  # with a knock
    if corner:
        settled = high_pass(np.concatenate([np.full(3 * CARD_HZ, 9.80665), held]), corner)[3 * CARD_HZ :]
        held, tone = settled, high_pass(tone, corner)
    assert flip(held / 80, corner, CARD_HZ) == pytest.approx(80, rel=2e-3)
    assert calibrator(tone[: 4 * CARD_HZ] / 80, corner, CARD_HZ) == pytest.approx(80, rel=2e-4)
    with pytest.raises(AcquisitionError, match=r"no step|too near"):
        flip(rng.normal(0, 0.1, t.size), corner, CARD_HZ)
    with pytest.raises(AcquisitionError, match=r"no tone of 159\.155 Hz"):
        calibrator(rng.normal(0, 0.1, CARD_HZ), corner, CARD_HZ)


def test_what_is_cut_off_calibrates_nothing() -> None:
    """Beyond full scale, in the converter or in an amplifier before it; a single click is none."""
    t = np.arange(3 * CARD_HZ) / CARD_HZ
    tone = np.sin(2 * np.pi * 159.155 * t)
    for size, cut in ((1.2, 1.0), (0.6, 0.5)):
        with pytest.raises(AcquisitionError, match=r"full scale in|third harmonic is"):
            calibrator(np.clip(size * tone, -cut, cut), 0.0, CARD_HZ)
    clicked = 0.5 * tone
    clicked[70_000] = 1.0
    assert calibrator(clicked, 0.0, CARD_HZ) == pytest.approx(np.sqrt(2) * 10 / 0.5, rel=1e-3)
    held = np.clip(1.1 * np.cos(np.pi * np.clip((t - 1.3) / 0.4, 0, 1)), -1, 1)
    with pytest.raises(AcquisitionError, match=r"turned over is at full scale in \d+ of 144000 samples"):
        flip(held, 0.0, CARD_HZ)
    signal = audio.loop_signal()
    heard = np.column_stack([np.tile(signal, 2), np.clip(12 * np.tile(signal, 2), -1, 1)])
    with pytest.raises(AcquisitionError, match="the input of malleolus is at full scale"):
        audio.analyse_loop("hot", heard, signal)


def test_what_is_recorded_is_what_came_in() -> None:
    """From 48 to 4 kHz in pieces: amplitude and phase of a line, and the coupling undone."""
    t = np.arange(3 * CARD_HZ) / CARD_HZ
    wave = np.sin(2 * np.pi * 12 * t)
    down, undo, out = audio.Decimator(), audio.Uncoupler(2.6), []
    for start in range(0, t.size, 1001):
        out.append(down.feed(np.column_stack([wave, high_pass(wave, 2.6)])[start : start + 1001])[0])
    y = np.concatenate(out)
    y = np.column_stack([y[:, 0], undo.feed(y[:, 1])])[-RATE_HZ:]
    line = 2 * np.mean(y * np.exp(-2j * np.pi * 12 * np.arange(RATE_HZ) / RATE_HZ)[:, None], axis=0)
    assert abs(line[0]) == pytest.approx(1, abs=1e-5)
    common = 12j / (12j + audio._COMMON_HZ)  # what is left, of every input alike
    assert abs(line[1] / line[0] - common) < 2e-4


def test_calibrations_are_read_back_and_checked(tmp_path: Path) -> None:
    file = tmp_path / "card.json"
    card = Calibration("usb", (100.0, 80.0), (2.1, 2.6), skew_s=1e-7)
    card.write(file)
    assert Calibration.read(file) == card
    card.check()
    with pytest.raises(SettingError, match="sensitivity of malleolus is not known"):
        replace(card, scale_m_s2=(100.0, 0.0)).check()
    with pytest.raises(SettingError, match="not in step"):
        replace(card, skew_s=1e-4).check()
    for text, problem in (("[]", "is no table"), ("{}", "names no device"), ("no JSON", "no JSON document")):
        file.write_text(text)
        with pytest.raises(InputFileError, match=f"{file}: is no calibration of a sound card: .*{problem}"):
            Calibration.read(file)
    for name, value, valid in (
        ("device", 5, "the card's name"), ("delay_s", "late", "a number"),
        ("more", 1, ", ".join(field.name for field in fields(Calibration))),
        ("latency_s", 0, "a number, positive"), ("skew_s", None, "a number"), ("delay_s", [1, 2], "a number"),
        ("corner_hz", [-1, 2], "two numbers, not negative"), ("loop_gain", [1], "two numbers"), ("output", 3, "1 or 2"),
    ):  # fmt: skip
        file.write_text(json.dumps({"device": "x", name: value}))
        with pytest.raises(InputFileError, match=f"{file}: is no calibration of a sound card") as caught:
            Calibration.read(file)
        assert (caught.value.quantity, caught.value.value, caught.value.valid) == (name, value, valid)
    file.write_text('{"device": "x", "skew_s": NaN}')
    with pytest.raises(InputFileError, match="skew_s is NaN"):
        Calibration.read(file)
    with pytest.raises(InputFileError, match="cannot be read"):
        Calibration.read(tmp_path / "none.json")


class Status(NamedTuple):
    """What PortAudio says of a block."""

    input_overflow: bool = False
    input_underflow: bool = False
    output_underflow: bool = False


class Stream:
    """PortAudio's, played by the test."""

    active = True

    def __init__(self, **options: Any) -> None:
        self.serve = options["callback"]
        self.closed = False

    def start(self) -> None: ...

    def close(self, ignore_errors: bool = True) -> None:
        self.closed = True


def opened(monkeypatch: pytest.MonkeyPatch) -> tuple[audio.SoundCard, Stream]:
    monkeypatch.setattr(audio.sounddevice, "Stream", Stream)
    card = audio.SoundCard(Calibration("made", (100.0, 80.0)))
    stream = card._stream
    assert isinstance(stream, Stream)
    return card, stream


def test_every_overrun_is_a_gap_named_with_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """What PortAudio says of block 30, 60 and 90 of 20 ms is at its time, in a capture's words and in a sentence."""
    sound, stream = opened(monkeypatch)
    said = {30: Status(input_overflow=True), 60: Status(output_underflow=True), 90: Status(input_underflow=True)}
    decoder, timeline = Decoder(), None
    quiet = np.full((960, 2), 0.1, np.float32)
    for number in range(150):
        stream.serve(quiet, np.zeros((960, 2), np.float32), 960, None, said.get(number, Status()))
        data = sound.read()
        messages = decoder.feed(data)
        if timeline is None and decoder.hello is not None:
            timeline = Timeline(decoder.hello)
        assert timeline is not None
        for event in sound.events():
            timeline.note(event)
        timeline.add(messages, 0.02 * number)
    assert timeline is not None
    gaps = timeline.quality().gaps
    causes = ["input overrun", "output underrun", "input underrun"]
    assert [gap.cause for gap in gaps] == [f"lost frames, {cause}" for cause in causes]
    # 384 samples fill the filter once, which is 5 frames of 4 ms; each gap is one frame
    np.testing.assert_allclose([gap.after_s for gap in gaps], [0.6, 1.204, 1.808], atol=0.025)
    (problem,) = timeline.quality().problems()
    assert all(f"after {gap.after_s:.6g} s, {gap.cause}" in problem for gap in gaps)
    _, values = timeline.samples()
    np.testing.assert_allclose(values[-100:], [[10.0, 8.0]] * 100, rtol=1e-6)


def test_output_fades_in_and_out_without_a_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sine of the wanted amplitude, full scale in 0.1 s at most; silence a second after the last look."""
    clock = [100.0]
    monkeypatch.setattr(audio.time, "monotonic", lambda: clock[0])
    sound, stream = opened(monkeypatch)
    out = []
    sound.drive(frequency_hz=50.0, share=0.5)
    for number in range(200):
        clock[0] += 0.02
        if number < 50:
            sound.alive()
        block = np.zeros((960, 2), np.float32)
        stream.serve(np.zeros((960, 2), np.float32), block, 960, None, Status())
        out.append(block[:, 0])
        assert not block[:, 1].any()  # the other output plays nothing
    wave = np.concatenate(out)
    t = np.arange(1, wave.size + 1) / CARD_HZ
    steady = (t > 0.1) & (t < 1.9)
    np.testing.assert_allclose(wave[steady], 0.5 * np.sin(2 * np.pi * 50 * t[steady]), atol=1e-5)
    assert np.abs(np.diff(wave)).max() <= 0.5 * 2 * np.pi * 50 / CARD_HZ + 1.05 / (0.1 * CARD_HZ)
    assert not wave[t > 2.2].any()


@pytest.mark.parametrize("alive", [True, False])
def test_card_is_closed_when_its_output_has_faded_and_was_heard(monkeypatch: pytest.MonkeyPatch, alive: bool) -> None:
    """What is in the card's buffers when it is closed is thrown away; a card that is gone is not waited for."""
    clock, out = [100.0], []
    monkeypatch.setattr(audio.time, "monotonic", lambda: clock[0])
    sound, stream = opened(monkeypatch)

    def asks(seconds: float = 0.0) -> None:
        clock[0] += 0.02
        block = np.zeros((960, 2), np.float32)
        stream.serve(np.zeros((960, 2), np.float32), block, 960, None, Status())
        out.append(block[:, 0])

    sound.drive(frequency_hz=37.0, share=0.5)
    for _ in range(20):
        asks()
    before = len(out)
    monkeypatch.setattr(audio.time, "sleep", asks)
    monkeypatch.setattr(Stream, "active", alive)
    sound.close()
    assert stream.closed and (len(out) > before) == alive
    if alive:
        wave = np.concatenate(out)
        assert np.abs(np.diff(wave)).max() <= 0.5 * 2 * np.pi * 37 / CARD_HZ + 1.05 / (0.1 * CARD_HZ)
        silent = (wave.size - 1 - np.flatnonzero(wave)[-1]) / CARD_HZ
        assert silent >= sound.calibration.latency_s


def test_peak_that_the_filter_hides_is_over_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """3 kHz in the malleolus at full scale, of which the recording shows nothing; a click in the base is let be."""
    sound, stream = opened(monkeypatch)
    t = np.arange(CARD_HZ) / CARD_HZ
    raw = np.column_stack([0.3 * np.sin(2 * np.pi * 20 * t), 0.1 + np.sin(2 * np.pi * 3000 * t) * (t > 0.5)])
    raw = np.clip(raw, -1.0, 1.0).astype(np.float32)
    raw[30_000, 0] = 1.0
    decoder, over, highest = Decoder(), np.zeros(2, int), 0.0
    for start in range(0, CARD_HZ, 960):
        stream.serve(raw[start : start + 960], np.zeros((960, 2), np.float32), 960, None, Status())
        for message in decoder.feed(sound.read()):
            if isinstance(message, Block):
                over += message.over
                if message.over.any() and 0.55 < message.time_us * 1e-6 < 0.9:
                    highest = max(highest, float(np.abs(message.samples[:, 1]).max()))
                assert message.time_us * 1e-6 > 0.48 or not message.over.any()
    assert over[0] == 0 and over[1] > 90 and 0 < highest < 0.2 * 80


class Player:
    """PortAudio's stream, which asks for all that is to be played, and hears it at once on both inputs."""

    made: ClassVar[list["Player"]] = []

    def __init__(self, **options: Any) -> None:
        self.serve, self.finished = options["callback"], options["finished_callback"]
        self.active, self.out = True, np.zeros((0, 2), np.float32)
        self.made.append(self)

    def __enter__(self) -> "Player":
        while self.active:
            block = np.zeros((960, 2), np.float32)
            try:
                self.serve(block[:, [0, 0]] if not self.out.size else self.out[-960:], block, 960, None, Status())
            except audio.sounddevice.CallbackStop:
                self.active = False
            self.out = np.concatenate([self.out, block])
        self.finished()
        return self

    def __exit__(self, *error: object) -> None: ...


@pytest.mark.parametrize("output", [1, 2])
def test_loopback_plays_softly_on_one_output(monkeypatch: pytest.MonkeyPatch, output: int) -> None:
    monkeypatch.setattr(audio.sounddevice, "Stream", Player)
    audio.capture("made", 8.0, 0.5, audio.loop_signal(), output)
    out = Player.made[-1].out
    wave = out[:, output - 1]
    assert not out[:, 2 - output].any() and np.abs(wave).max() == pytest.approx(audio.PEAK) == pytest.approx(0.1)
    rms = np.sqrt(np.mean(wave.reshape(-1, 2400)[: wave.size // 2400] ** 2, axis=1))  # in pieces of 50 ms
    first, last = np.flatnonzero(rms)[[0, -1]]
    assert (np.diff(rms[first : first + 9]) > 0).mean() > 0.8 and rms[first] < 0.1 * rms.max() > rms[last]
    assert not wave[-CARD_HZ // 2 :].any()  # the end of what is played is in no buffer that is thrown away


def test_loopback_is_faded_by_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pressed after two seconds: silent 50 ms later, without a jump, and the stream goes on until that was heard."""
    out: list[np.ndarray] = []

    class Interrupted(Stream):
        def __enter__(self) -> "Interrupted":
            self.ask(2.0)
            return self

        def __exit__(self, *error: object) -> None: ...

        @property
        def active(self) -> bool:  # type: ignore[override]
            raise KeyboardInterrupt

        def ask(self, seconds: float) -> None:
            for _ in range(round(seconds / 0.02)):
                block = np.zeros((960, 2), np.float32)
                self.serve(np.zeros((960, 2), np.float32), block, 960, None, Status())
                out.append(block[:, 0])

    streams: list[Interrupted] = []
    monkeypatch.setattr(
        audio.sounddevice, "Stream", lambda **options: streams.append(Interrupted(**options)) or streams[0]
    )
    monkeypatch.setattr(audio.time, "sleep", lambda seconds: streams[0].ask(seconds))
    t = np.arange(CARD_HZ) / CARD_HZ
    with pytest.raises(KeyboardInterrupt):
        audio.capture("made", 8.0, 0.5, 0.1 * np.sin(2 * np.pi * 37 * t))
    wave = np.concatenate(out)
    cut = 2 * CARD_HZ
    assert np.abs(wave[cut - 4800 : cut]).max() > 0.09 and not wave[cut + round(0.05 * CARD_HZ) :].any()
    assert np.abs(np.diff(wave)).max() < 1.1 * 0.1 * 2 * np.pi * 37 / CARD_HZ and wave.size > cut + 0.5 * CARD_HZ


def test_loopback_asks_whether_the_amplifier_is_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(audio, "measure_loop", lambda device, latency, output: Calibration(device, output=output))
    file = tmp_path / "card.json"
    words = ["calibrate", "loopback", "--device", "usb", "--output", "2", "--calibration", str(file)]
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    with pytest.raises(SettingError, match="add --yes"):
        app(words, standalone_mode=False)
    told = " ".join(capsys.readouterr().err.split())
    assert "plays noise on output 2 for 16 s, at most 10 % of full scale (0.2 V peak to peak)" in told
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    with pytest.raises(typer.Abort):
        app(words, standalone_mode=False)
    assert not file.exists()
    app([*words, "--yes"], standalone_mode=False)
    assert Calibration.read(file).output == 2


class Live(Stream):
    """PortAudio's, which hears a sine about in real time, until it is `unplugged`; while `silent` nothing."""

    unplugged: ClassVar[threading.Event] = threading.Event()
    silent: ClassVar[bool] = False

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._unplugged = Live.unplugged
        if self._unplugged.is_set():
            raise ValueError("No input device matching 'made'")

    @property
    def active(self) -> bool:  # type: ignore[override]
        return not self._unplugged.is_set()

    def start(self) -> None:
        threading.Thread(target=self._hear, daemon=True).start()

    def _hear(self) -> None:
        number = 0
        while not (self.closed or self._unplugged.is_set()):
            time.sleep(0.02)  # on a busy machine more: it makes up for nothing, or a recording were whole at once
            t = (960 * number + np.arange(960)) / CARD_HZ
            wave = 0.2 * np.column_stack([np.sin(40 * np.pi * t), np.sin(40 * np.pi * t - 0.3)]).astype(np.float32)
            if not Live.silent:
                self.serve(wave, np.zeros((960, 2), np.float32), 960, None, Status())
            number += 1


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("fault", ["unplugged", "stalled", "unplugged for good"])
def test_card_that_goes_away_or_falls_silent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], fault: str
) -> None:
    """An unplug is called one, what came before it is told as usable, and the recording is repeated if samples come."""
    monkeypatch.setattr(audio.sounddevice, "Stream", Live)
    monkeypatch.setattr(audio, "cards", lambda: "cards of this computer: none")
    monkeypatch.setattr(audio, "_GONE_S", 60.0)
    monkeypatch.setattr(Live, "unplugged", threading.Event())
    monkeypatch.setattr(Live, "silent", False)
    board, _ = devices.opened(audio.SoundCard, Calibration("made", (100.0, 80.0), latency_s=0.1))
    board.reader.patience = 0.5 if fault == "unplugged for good" else 20.0
    struck: list[float] = []

    def strike(b: Board) -> None:
        if b.timeline is not None and b.timeline.length > 2000 and not struck:
            struck.append(time.monotonic())
            Live.silent = fault == "stalled"
            if not Live.silent:
                Live.unplugged.set()
            monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 0.5 if fault == "stalled" else 20.0)
        back = b.unplugs if fault == "unplugged" else struck and b.timeline is None
        if back and fault != "unplugged for good":
            Live.silent = False
            if Live.unplugged.is_set():
                Live.unplugged = threading.Event()
            monkeypatch.setattr("fasbody.acquire.board.STALLED_S", 20.0)

    board.listener = strike
    run = Session(Plan(tmp_path / "study", (20.0,), Condition("16", body_mass_kg=72.5), seconds=0.8), board)
    if fault == "unplugged for good":
        with pytest.raises(AcquisitionError, match="unplugged, and not back after"):
            run.run()
    else:
        run.run()
        assert not run.made[-1].problems and run.made[-1].recording.time_s.size == 3200
    board.close()
    first = run.made[0]
    assert first.problems and any(text.startswith("usable: 0.") for text in first.remarks)
    told = " ".join(capsys.readouterr().err.split())
    if fault == "stalled":
        assert "the board is silent for" in told and "repeated as soon as samples come" in told
    elif fault == "unplugged":
        assert first.quality.gaps[0].cause == "restart, unplugged" and len(run.made) == 2


def test_cards_are_listed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A card that fits, one whose rate does not, a microphone; and a computer without any."""
    devices = [
        {"name": name, "hostapi": 0, "max_input_channels": inputs, "max_output_channels": outputs}
        for name, inputs, outputs in (("usb", 2, 2), ("slow", 2, 2), ("microphone", 1, 0))
    ]

    def rate(number: int, **asked: Any) -> None:
        if number == 1:
            raise audio.sounddevice.PortAudioError("Invalid sample rate")

    monkeypatch.setattr(audio.sounddevice, "query_hostapis", lambda: [{"name": "ALSA"}])
    monkeypatch.setattr(audio.sounddevice, "query_devices", lambda: devices)
    monkeypatch.setattr(audio.sounddevice, "check_input_settings", rate)
    monkeypatch.setattr(audio.sounddevice, "check_output_settings", rate)
    app(["record", "--board", "audio", "--list"], standalone_mode=False)
    first, *others = capsys.readouterr().out.splitlines()
    assert first == "usb  ALSA  2 inputs, 2 outputs  48 kHz in step: yes"
    assert [line.endswith("no") for line in others] == [True, True] and "1 input, 0 outputs" in others[1]
    assert audio.cards() == "cards of this computer: usb"
    devices.clear()
    app(["record", "--board", "audio", "--list", "--json"], standalone_mode=False)
    out, err = capsys.readouterr()
    assert json.loads(out) == [] and "--board audio lists nothing" in err


@pytest.mark.long
def test_virtual_foot_between_playback_and_capture(tmp_path: Path) -> None:
    """Command, PortAudio, PulseAudio: a recording whose transmissibility is the foot's own.

    On busy cores PulseAudio drops samples, ALSA recovers from it, or the base is unseen for a second; each is said.
    A few samples may also go without a word: then a steady sine leaves more than the sensors' noise.
    Such an attempt tells nothing of the code, and another is made.
    """
    lost = []
    for attempt in range(4):
        (folder := tmp_path / str(attempt)).mkdir()
        with pulse.PulseBench() as bench:
            done, ratio, rest = through_the_card(folder, bench)
            said = bench.losses()
        made = json.loads(done.stdout)["recordings"] if done.stdout else []
        said += [gap["cause"] for one in made for gap in one["quality"]["gaps"] if "run" in gap["cause"]]
        said += re.findall(
            r"(?:ALSA.*|no samples for 1 s|gave no sample|\d+ samples in [\d.]+ s|base (?:breaks|lost|not|off|noisy))",
            done.stderr,
        )
        if rest > 1.5 * pulse.NOISE_M_S2:
            said.append(f"a sine that leaves {rest:.2g} m/s²")
        if said:
            lost.append(f"{len(said)} times {said[0]}")
            continue
        assert done.returncode == 0, done.stderr
        assert abs(abs(ratio) - 1) < 1e-3 and abs(np.degrees(np.angle(ratio))) < 0.1
        return
    pytest.skip(f"PulseAudio lost samples in each of {len(lost)} attempts: {'; '.join(lost)}")


class Heard(NamedTuple):
    """What the command said, the recorded transmissibility over the foot's own, and what a steady sine leaves [m/s^2].

    nan and 0 if nothing is listed.
    """

    done: subprocess.CompletedProcess[str]
    ratio: complex = complex(np.nan)
    rest: float = 0.0


def through_the_card(tmp_path: Path, bench: pulse.PulseBench) -> Heard:
    """Record the virtual foot at 20 Hz by the command."""
    card, study, hz = tmp_path / "card.json", tmp_path / "study", 20.0
    bench.put("foot")
    # the loopback that finds these is in benchmarks/acquire.py; the way through the foot has its own buffers
    Calibration("pulse", pulse.SCALE_M_S2, pulse.CORNERS_HZ[1:], delay_s=3.5, latency_s=0.8).write(card)
    words = ["--board", "audio", "--frequency", f"{hz:g}", "--seconds", "2", "--peak-to-peak", "4", "--retries", "0"]
    words += ["--body-mass", f"{BODY_MASS_KG}", "--out", str(study), "--calibration", str(card), "--json"]
    done = subprocess.run(
        pulse.ahead([sys.executable, "-m", "fasbody.acquire", *words]), env=bench.environment, capture_output=True,
        text=True,
    )  # fmt: skip
    if done.returncode:
        return Heard(done)
    (one,) = Study.read(study).recordings
    assert one.rate_hz == RATE_HZ and one.time_s.size == 2 * RATE_HZ
    t, both = one.time_s, np.column_stack([one.base_m_s2, one.malleolus_m_s2])
    basis = np.column_stack([f(2 * np.pi * hz * k * t) for k in (1, 2, 3, 4, 5) for f in (np.cos, np.sin)] + [t**0])
    c, *_ = np.linalg.lstsq(basis, both, rcond=None)
    base, malleolus = c[0] - 1j * c[1]
    masses = {"m_S": shank_mass(BODY_MASS_KG, 0.0), "m_F": foot_mass(BODY_MASS_KG)}
    foot = TwoDof.from_values({**TRUTH, **masses})
    true = exact(foot, sine(hz, 5.0, 2 * abs(base)), 1.0, Instrument(delay_s=0.0), settle=2.0)
    wave = np.exp(-2j * np.pi * hz * true.time_s)
    own = np.mean(true.malleolus_m_s2 * wave) / np.mean(true.base_m_s2 * wave)
    return Heard(done, complex(malleolus / base / own), float((both - basis @ c).std(axis=0).max()))
