"""Acquisition, measured: a fast board for a minute, a bad line, a pulled plug, killed sessions, a fuzz run, the chain.

Each is printed beside what is required; everything but the fuzz run goes through a pseudo-terminal and pyserial.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.fuzz_parsers import HELLO, counts_of, fuzz
from benchmarks.table import report
from fasbody.acquire.bench import Bench
from fasbody.acquire.bench.foot import BODY_MASS_KG
from fasbody.acquire.bench.line import Line, corrupt
from fasbody.acquire.board import Board
from fasbody.acquire.capture import Capture, read
from fasbody.acquire.folder import convert, replay
from fasbody.acquire.plan import Plan
from fasbody.acquire.port import Port
from fasbody.acquire.session import Session
from fasbody.acquire.timeline import Timeline
from fasbody.acquire.wire import Block, FrameReader, encode_data, encode_hello
from fasbody.console import command_line, console
from fasbody.exceptions import AcquisitionError, FasError
from fasbody.foot.shaker import BaseMotion, samples, sine, sweep
from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.foot import TRUTH, exact
from fasbody.laboratory.instrument import Instrument
from fasbody.recording.condition import foot_mass, shank_mass
from fasbody.recording.recording import Condition, Recording
from fasbody.recording.study import Study
from reproduction.check import Check, at_most, exactly, told
from simulator import pulse, simavr
from simulator.simavr import SimulatedBoard

BAUD = 921600
#: Played to the sound card by another program than ours: base acceleration at the shaker [m/s^2].
_SWEEP = sweep(10.0, 50.0, 20.0, 15.0)
#: Of the output's buffer in the measurement of silence [s].
_LATENCY_S = 0.5
#: Sensors and rates [Hz] through which the virtual foot is felt, and its excitations [Hz].
_BOARDS = (("ANALOG", 1000), ("ANALOG", 2000), ("ADXL355", 1000), ("ADXL345", 1000))
_FELT_HZ = (10.0, 20.0, 30.0, 40.0, 50.0)
#: Upper limit of the excitation and its harmonics [Hz].
_BAND_LIMIT_HZ = 200.0


def transfer(seconds: float) -> list[Check]:
    """Three channels at 4 kHz from the virtual bench, recorded as a session records them."""
    with tempfile.TemporaryDirectory() as name, Bench(rate=4000.0, channels=3) as bench:
        bench.shake(20.0, 1.2)
        board = Board(bench.board_port, BAUD)
        board.wait_for_hello()
        condition = Condition("16", body_mass_kg=BODY_MASS_KG)
        plan = Plan(Path(name), (None,), condition, seconds=seconds, retries=0)
        before = os.times()
        (made,) = Session(plan, board).run()
        used = os.times()
        board.close()
    share = (used.user + used.system - before.user - before.system) / seconds
    q = made.quality
    losses = q.lost_frames + q.damaged + q.lost_samples
    text = f"{q.frames} frames, {q.lost_frames} lost, {q.damaged} damaged"
    return [
        Check(f"3 channels at 4 kHz for {seconds:g} s", losses, 0, 0, said=text, beside="none lost"),
        told("CPU share of the recording process, conversion included", f"{100 * share:.1f} % of a core"),
    ]


def noisy_line(accepted: int) -> list[Check]:
    """A line that damages 1 % of the bytes, until so many samples have been accepted."""
    with tempfile.TemporaryDirectory() as name:
        line = Line(Path(name) / "board")
        line.plug()
        os.set_blocking(line.master, True)
        port = Port(str(line.link), BAUD)
        done, injected, sent = threading.Event(), 0, 0

        def send() -> None:
            nonlocal injected, sent
            rng = np.random.default_rng(9)
            os.write(line.master, encode_hello(HELLO) + encode_data(0, 0, counts_of(0), 16))
            frame = 1
            while not done.is_set():
                out = b""
                for _ in range(16):
                    clean = encode_data(frame, frame * 4000, counts_of(frame), 16)
                    dirty = corrupt(clean, 0.01, rng)
                    injected += dirty != clean
                    frame += 1
                    out += dirty
                os.write(line.master, out)
            last = encode_data(frame, frame * 4000, counts_of(frame), 16)  # an undamaged end, to count up to
            os.write(line.master, last + b"\0" * 2000)
            sent = frame + 1

        thread = threading.Thread(target=send)
        thread.start()
        reader, timeline, right, wrong, last = FrameReader(), Timeline(HELLO), 0, 0, -1
        while not done.is_set() or last < sent - 1 or sent == 0:
            messages = reader.feed(port.read())
            timeline.add(messages, time.monotonic())
            for message in messages:
                if isinstance(message, Block):
                    equal = np.array_equal(message.samples * 1024, counts_of(message.sequence))
                    right, wrong = right + equal * message.samples.size, wrong + (not equal) * message.samples.size
                    last = message.sequence
            if right >= accepted:
                done.set()
        thread.join()
        port.close()
        line.unplug()
    missing = timeline.quality().lost_frames
    return [
        Check(
            "1 % damaged bytes: frames found missing",
            missing,
            injected,
            injected,
            "",
            f"{missing} of {injected}",
            "all",
        ),
        Check("wrong samples accepted", wrong, 0, 0, "", f"{wrong} of {right + wrong}", f"none in {accepted:g}"),
    ]


def plug(times: int) -> list[Check]:
    """The plug is pulled and put back during a recording; what came before and after is kept, the gap marked."""
    with tempfile.TemporaryDirectory() as name, Bench() as bench:
        board = Board(bench.board_port, BAUD)
        board.wait_for_hello()
        capture = Capture(Path(name) / "captures" / "plug.fascap")
        capture.add("M", 0.0, {"preamble": board.decoder.preamble.hex(), "condition": {"subject": "16"}})
        timeline = board.start(capture)
        for pulls in range(1, times + 1):
            target = timeline.length + 600
            while timeline.length < target:
                board.pump()
            bench.fault("unplug")
            time.sleep(0.3)
            bench.fault("plug")
            deadline = time.monotonic() + 20.0  # on busy cores, what came before the pull is read long after it
            while board.unplugs < pulls and time.monotonic() < deadline:
                board.pump()
            target = timeline.length + 600
            while timeline.length < target:
                board.pump()
        board.stop()
        board.close()
        capture.close()
        quality = replay(capture.file)[1].quality()
    text = f"{len(quality.gaps)} gaps for {board.unplugs} pulls"
    wrong = max(abs(count - times) for count in (len(quality.gaps), board.unplugs))
    return [Check("unplugged and replugged", wrong, 0, 0, said=text, beside="one each")]


def killed(times: int) -> list[Check]:
    """Sessions killed by SIGKILL; how long before the kill the last recovered byte arrived."""
    worst, usable = 0.0, 0
    with tempfile.TemporaryDirectory() as name, Bench() as bench:
        bench.shake(20.0, 1.2)
        for number in range(times):
            study = Path(name) / str(number)
            words = ["--port", bench.board_port, "--out", str(study), "--body-mass", "72.57", "--seconds", "60"]
            victim = subprocess.Popen([sys.executable, "-m", "fasbody.acquire", *words], stderr=subprocess.DEVNULL)
            file = study / "captures" / "broadband_0kg.fascap"
            while victim.poll() is None and not (file.is_file() and file.stat().st_size > 10_000 + 1000 * number):
                time.sleep(0.01)
            at = time.monotonic()
            victim.send_signal(signal.SIGKILL)
            victim.wait()
            worst = max(worst, at - max(record.host for record in read(file)))
            with contextlib.suppress(Exception):
                usable += not convert(file, study, longest=True).problems
    return [
        at_most(f"kill -9 of {times} sessions: longest missing end", 1e3 * worst, 100, "ms"),
        Check("recordings recovered from them, usable", usable, times, times, "", f"{usable} of {times}", "all"),
    ]


def chain(seconds: float) -> list[Check]:
    """Sweep on the virtual bench, fit, and how many parameters lie in their 95 % intervals."""
    with tempfile.TemporaryDirectory() as name:
        study = str(Path(name) / "study")
        words = ["--simulate", "--sweep", "10:50:5", "--seconds", f"{seconds:g}", "--out", study]
        subprocess.run([sys.executable, "-m", "fasbody.acquire", *words], check=True, stdout=subprocess.DEVNULL)
        return [_fitted(f"sweep 10:50:5 of {seconds:g} s", Path(study), "--starts", "4")]


def firmware(samples: int) -> list[Check]:
    """The firmware on simavr at its highest rate: every sample known beforehand, then the same with damaged bytes."""
    if lacks := simavr.missing():
        return [told("firmware on simavr", f"not run: {lacks}")]
    rate, rng = 2000, np.random.default_rng(9)
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        host, elf = simavr.compile_host(root), simavr.compile_firmware(root, "ANALOG", rate)
        clean, dirty, frames, injected, missed, wrong, bad = FrameReader(), FrameReader(), 0, 0, 0, 0, 0
        with SimulatedBoard(host, elf, root, seconds=samples / 2 / rate + 2.0, real=False) as board:
            want, rest, seen = simavr.readings(samples // 2 + 4 * rate, rate), b"", 0
            for data in board.bytes():
                *pieces, rest = (rest + data).split(b"\0")
                for piece in filter(None, pieces):
                    message = next(iter(clean.feed(b"\0" + piece + b"\0")), None)
                    if not isinstance(message, Block):
                        dirty.feed(b"\0" + piece + b"\0")
                        continue
                    scale = message.samples.dtype.type(clean.hello.channels[0].counts_per_m_s2)  # type: ignore[union-attr]
                    truth = want[16 * message.sequence : 16 * (message.sequence + 1)]
                    missed += message.sequence - frames
                    wrong += 32 - int(np.sum(np.abs(message.samples * scale - truth) < 1e-6))
                    frames = message.sequence + 1
                    spoilt = corrupt(b"\0" + piece + b"\0", 0.01, rng)
                    injected += spoilt != b"\0" + piece + b"\0"
                    for one in dirty.feed(spoilt):
                        if isinstance(one, Block):
                            seen += 1
                            bad += not np.array_equal(one.samples, message.samples)
        felt = [row for sensor, hz in _BOARDS for row in _through_the_converter(host, root, sensor, hz)]
    span = board.report["longest_cycles"], board.report["shortest_cycles"]
    return [
        Check(f"firmware at {rate} Hz on simavr: frames missing", missed, 0, 0, "", f"{missed} of {frames}", "none"),
        Check("its samples that are wrong", wrong, 0, 0, "", f"{wrong} of {32 * frames}", f"none in {samples:g}"),
        told("cycles between two conversions, 2000 by the timer", f"{span[1]} to {span[0]}, simavr's instructions"),
        Check("1 % damaged bytes: frames found", frames - seen, injected, injected, "",
              f"{frames - seen} of {injected}", "all"),
        Check("wrong ones accepted", bad, 0, 0, "", f"{bad} of {seen}", "none"),
        *felt,
    ]  # fmt: skip


def _through_the_converter(host: Path, root: Path, sensor: str, rate: int) -> list[Check]:
    """The virtual foot felt by the sensors, converted and sent by the firmware: transmissibility against DOP853."""
    elf = simavr.compile_firmware(root, sensor, rate)
    off = []
    for hz in _FELT_HZ:
        signal, truth = simavr.foot(hz)
        _, values, _ = simavr.sent(host, elf, root, signal, 3.0)
        base, malleolus = simavr.lines(values, rate, hz)
        off.append(malleolus / base / truth)
    ratios = np.array(off)
    what = f"virtual foot through the firmware, {sensor} at {rate} Hz, {_FELT_HZ[0]:g} to {_FELT_HZ[-1]:g} Hz"
    return [
        at_most(f"{what}: transmissibility, worst", 100 * np.abs(np.abs(ratios) - 1).max(), 1.0, "%"),
        at_most("its phase", np.abs(np.angle(ratios, deg=True)).max(), 1.0, "deg"),
    ]


class Card:
    """A sound card with the virtual foot, or a cable, between its output and its inputs; the command uses it.

    Args:
        folder: of its calibration and of the study.
        bench: of the sound server.
    """

    def __init__(self, folder: Path, bench: pulse.PulseBench) -> None:
        self.file, self.study, self.bench = folder / "card.json", folder / "study", bench
        self.common = ["--board", "audio", "--body-mass", f"{BODY_MASS_KG}", "--subject", "16"]
        self.common += ["--out", str(self.study)]

    def loopback(self) -> float:
        """Calibrate with the cable; returns by which share the worst of what is found is off."""
        self.bench.put("cable")
        done = self.command("calibrate", "loopback", "--device", "pulse", "--latency", "0.8", "--yes")
        if done.returncode:
            raise AcquisitionError(f"the loopback did not end well: {done.stderr}")
        result = json.loads(done.stdout)
        values = np.array([*result["loop_gain"], result["output_corner_hz"], *result["corner_hz"]])
        return float(np.max(np.abs(values / [*pulse.GAINS, *pulse.CORNERS_HZ] - 1)))

    def foot(self) -> None:
        """Put the foot in place of the cable: its sensors' sensitivities are known, and its delay is another one."""
        from fasbody.acquire.audio import Calibration

        self.bench.put("foot")
        known = Calibration("pulse", corner_hz=pulse.CORNERS_HZ[1:], latency_s=0.8)
        known = Calibration.read(self.file) if self.file.is_file() else known
        replace(known, scale_m_s2=pulse.SCALE_M_S2, delay_s=3.5).write(self.file)

    def command(self, *words: str) -> subprocess.CompletedProcess[str]:
        """The command as a user gives it."""
        whole = [sys.executable, "-m", "fasbody.acquire", *words, "--calibration", str(self.file), "--json"]
        done = subprocess.run(pulse.ahead(whole), env=self.bench.environment, capture_output=True, text=True)
        console.print(done.stderr, markup=False)
        return done

    def record(self, *words: str, played: BaseMotion | None = None) -> tuple[Recording, dict[str, Any]]:
        """One recording, complete or not, and its metadata; another program plays once it runs."""

        def play() -> None:
            deadline = time.monotonic() + 120.0
            while not list(self.study.glob("captures/*")) and time.monotonic() < deadline:
                time.sleep(0.05)
            if played is not None:
                self.bench.play(played)

        player = threading.Thread(target=play)
        player.start()
        self.command(*self.common, *words, "--retries", "0")
        player.join()
        (file,) = self.study.glob("recordings/*.csv")
        return Recording.read(file), json.loads(file.with_suffix(".json").read_text())


def audio() -> list[Check]:
    """A virtual foot between playback and capture of a sound card: loopback, steps of frequency, a sweep, and fits."""
    if lacks := pulse.missing():
        return [told("sound card", f"not run: {lacks}")]
    with tempfile.TemporaryDirectory() as name, pulse.PulseBench() as bench:
        card = Card(Path(name), bench)
        tripped, closed = (bench.silence(way, _LATENCY_S) for way in ("off", "close"))
        off = card.loopback()
        card.foot()
        card.command(*card.common, "--sweep", "10:50:5", "--seconds", "4")
        study = Study.read(card.study)
        ratios = np.array([_against_the_foot(one) for one in study.recordings])
        fit = _fitted(f"{len(ratios)} steps of 4 s", card.study, "--starts", "2")
        card.study = card.study.with_name("swept")
        card.common[-1] = str(card.study)
        swept, made = card.record("--seconds", f"{_SWEEP.duration + 12:g}", played=_SWEEP)
        ratio = _sweep_against_the_foot(swept)
    what = f"sound card, {len(ratios)} steps 10:50:5"
    swept_so = f"sound card, sweep 10 to 50 Hz in {_SWEEP.duration:g} s"
    return [
        at_most(f"sound card: heard after a guard trips, {_LATENCY_S:g} s of buffer", tripped["heard_s"],
                _LATENCY_S + 0.2, "s"),
        at_most("its largest step from sample to sample then and at the end of a session, over the sine's own",
                max(tripped["step"], closed["step"]), 1.1),
        at_most("sound card: gains and high-passes by loopback", 100 * off, 0.1, "%"),
        exactly("sound card: steps 10:50:5 recorded without a loss", len(ratios), 9),
        at_most(f"{what}: transmissibility against DOP853, worst", 100 * np.abs(np.abs(ratios) - 1).max(), 0.1, "%"),
        at_most(f"{what}: its phase", np.abs(np.angle(ratios, deg=True)).max(), 0.1, "deg"),
        fit,
        exactly(f"{swept_so}: gaps", len(made["quality"]["gaps"]), 0),
        at_most(f"{swept_so}: transmissibility, worst of 18 bands", 100 * np.abs(np.abs(ratio) - 1).max(), 0.1, "%"),
        at_most(f"{swept_so}: its phase", np.abs(np.angle(ratio, deg=True)).max(), 0.1, "deg"),
    ]  # fmt: skip


def long(minutes: float) -> list[Check]:
    """So many minutes of one sine by the sound card: every loss is named with its time.

    Output and inputs are on one clock, so the phase of the base stands still. Where it jumps and no gap is named,
    samples were lost without a report.
    """
    if lacks := pulse.missing():
        return [told("sound card", f"not run: {lacks}")]
    with tempfile.TemporaryDirectory() as name, pulse.PulseBench() as bench:
        card = Card(Path(name), bench)
        card.foot()
        one, made = card.record("--frequency", "20", "--seconds", f"{60 * minutes:g}")
    losses = [(gap["after_s"], gap["cause"]) for gap in made["quality"]["gaps"]]
    losses += [(after, text) for after, text in made["quality"]["faults"]]
    jumps = phase_jumps(one.time_s, one.base_m_s2, 20.0)
    unnamed = [t for t in jumps if not any(-2.0 <= t - after <= 15.0 for after, _ in losses)]
    named = ", ".join(f"{cause} after {after:.2f} s" for after, cause in sorted(losses))
    named += f"; {why}" if (why := "; ".join(text for text in made["remarks"] if "ended early" in text)) else ""
    what = f"sound card, {minutes:g} minutes at 20 Hz"
    named_jumps = f"{len(unnamed)}: {', '.join(f'{t:.0f} s' for t in unnamed[:9])}" if unnamed else "none"
    whole = made["samples"] + sum(gap["lost_samples"] for gap in made["quality"]["gaps"])
    return [
        exactly(f"{what}: samples a channel, those of gaps included", whole, round(240_000 * minutes)),
        told(f"{what}: over- and underruns, each with its time", named or "none"),
        Check(f"{what}: jumps of a sample's phase beside them", len(unnamed), 0, 0, said=named_jumps, beside="none"),
    ]  # fmt: skip


def phase_jumps(time_s: np.ndarray, values: np.ndarray, hz: float) -> list[float]:
    """Times (s) at which the phase of a sine steps by a sample or more.

    Args:
        time_s: (n,) on the grid of samples.
        values: (n,) of a sine of constant amplitude and frequency.
        hz: its frequency.
    """
    second = (time_s // 1.0).astype(int)
    turned = values * np.exp(-2j * np.pi * hz * time_s)
    count = np.bincount(second)
    whole = count == round(1 / (time_s[1] - time_s[0]))  # others are torn
    phase = np.angle(np.bincount(second, turned.real) + 1j * np.bincount(second, turned.imag))
    seconds = np.flatnonzero(whole)
    steps = np.angle(np.exp(1j * np.diff(phase[seconds])))
    limit = 2 * np.pi * hz * (time_s[1] - time_s[0])
    return [float(t) for t in seconds[1:][np.abs(steps) > limit]]


def _fitted(what: str, study: Path, *options: str) -> Check:
    """identification.fit of a study, and how far its parameters are from those that made it."""
    command = [sys.executable, "-m", "identification.fit", str(study), *options, "--json"]
    result = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    inside, far, worst = 0, 0.0, ""
    bound: list[str] = []
    for symbol, truth in TRUTH.items():
        name, e = next((k, e) for k, e in result["parameters"].items() if k.startswith(f"{symbol}_"))
        if e["at_bound"]:
            bound.append(name)
            continue
        inside += e["lower"] <= truth <= e["upper"]
        away = abs(e["value"] - truth) / e["std_error"]
        if away > far:
            far, worst = away, name
    text = f"{inside} of {len(TRUTH) - len(bound)} in 95 %; farthest {worst}, {far:.1f} standard errors"
    text += f"; at a bound: {', '.join(bound)}" if bound else ""
    return Check(f"{what}, then identification.fit", far, high=4, said=text, beside="all within 4")


def _sweep_against_the_foot(one: Recording) -> np.ndarray:
    """Transmissibility of a recorded sweep over the one by DOP853, which feels the recorded base, in bands of 2 Hz."""
    second = round(one.rate_hz)
    if max(np.ptp(one.base_m_s2[:second]), np.ptp(one.base_m_s2[-second:])) > 1.0:
        raise AcquisitionError("the sweep is not whole: it does not begin and end at rest.")
    base = np.fft.rfft(one.base_m_s2)
    base[round(_BAND_LIMIT_HZ * one.base_m_s2.size / one.rate_hz) :] = 0.0  # DOP853 would follow the noise
    motion = samples(one.time_s, np.fft.irfft(base, one.base_m_s2.size))
    masses = {"m_S": shank_mass(BODY_MASS_KG, 0.0), "m_F": foot_mass(BODY_MASS_KG)}
    foot = TwoDof.from_values({**TRUTH, **masses})
    true = exact(foot, motion, one.time_s[-1], Instrument(delay_s=0.0, rate_hz=one.rate_hz), settle=0.0)
    n = true.time_s.size
    lines = np.fft.rfftfreq(n, 1 / one.rate_hz)
    measured, truth = np.fft.rfft(one.malleolus_m_s2[:n]), np.fft.rfft(true.malleolus_m_s2)
    bands = [(lines >= low) & (lines < low + 2) for low in range(12, 48, 2)]
    return np.array([np.vdot(truth[band], measured[band]) / np.vdot(truth[band], truth[band]) for band in bands])


def _against_the_foot(one: Recording) -> complex:
    """Transmissibility of a recording over the one by DOP853 at the same base acceleration."""
    hz = one.condition.frequency_hz
    assert hz is not None
    waves = [f(2 * np.pi * hz * k * one.time_s) for k in (1, 2, 3) for f in (np.cos, np.sin)]
    basis = np.column_stack([*waves, one.time_s**0])
    c, *_ = np.linalg.lstsq(basis, np.column_stack([one.base_m_s2, one.malleolus_m_s2]), rcond=None)
    base, malleolus = c[0] - 1j * c[1]
    masses = {"m_S": shank_mass(BODY_MASS_KG, 0.0), "m_F": foot_mass(BODY_MASS_KG)}
    motion = sine(hz, 5.0, 2 * abs(base))
    true = exact(TwoDof.from_values({**TRUTH, **masses}), motion, 1.0, Instrument(delay_s=0.0), settle=2.0)
    wave = np.exp(-2j * np.pi * hz * true.time_s)
    return complex(malleolus / base / (np.mean(true.malleolus_m_s2 * wave) / np.mean(true.base_m_s2 * wave)))


def _kept(name: str, work: Callable[[], list[Check]]) -> list[Check]:
    """Rows of a topic; one that fails, as where busy cores lose samples, is a row, and the others keep theirs."""
    try:
        return work()
    except FasError as error:
        console.print(str(error), markup=False)
        return [Check(f"{name}: measured", 0, 1, said=f"no: {str(error)[:90]}", beside="to its end")]


TOPICS = ("transfer", "noisy", "plug", "killed", "fuzz", "chain", "firmware", "audio", "long")
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    topic: Annotated[list[str] | None, typer.Argument(help=f"some of {', '.join(TOPICS)} (default: all)")] = None,
    seconds: Annotated[float, typer.Option(help="length of the transfer at 4 kHz")] = 60.0,
    accepted: Annotated[int, typer.Option(help="samples to accept on the bad line")] = 1_000_000,
    strings: Annotated[int, typer.Option(help="byte strings of the fuzz run")] = 1_000_000,
    conversions: Annotated[int, typer.Option("--samples", help="of the firmware on simavr")] = 1_000_000,
    minutes: Annotated[float, typer.Option(help="length of the long recording by the sound card")] = 30.0,
    json_: Annotated[bool, typer.Option("--json", help="print the rows on stdout")] = False,
) -> None:
    """Measure acquisition. Takes as long as the long recording, and at least ten minutes.

    Examples:
      python -m benchmarks.acquire --minutes 2

      python -m benchmarks.acquire fuzz --strings 100000
    """
    works = {
        "transfer": lambda: transfer(seconds), "noisy": lambda: noisy_line(accepted), "plug": lambda: plug(3),
        "killed": lambda: killed(5), "fuzz": lambda: fuzz(strings), "chain": lambda: chain(4.0),
        "firmware": lambda: firmware(conversions), "audio": audio, "long": lambda: long(minutes),
    }  # fmt: skip
    rows: list[Check] = []
    names = topic or list(TOPICS)
    for name in names:
        if name not in works:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(TOPICS)}")
    with ThreadPoolExecutor(1) as aside:
        beside: Future[list[Check]] | None = None
        for name in sorted(names, key=lambda name: name != "audio"):  # the long recording has the card to itself
            if "long" in names and name != "audio" and beside is None:
                beside = aside.submit(works["long"])
            if name == "long":
                continue
            console.print(name)
            rows += _kept(name, works[name])
        if beside is not None:
            rows += _kept("long", beside.result)
    report("acquisition", rows, json_)


if __name__ == "__main__":
    command_line(app)
