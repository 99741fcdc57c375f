"""A simulated sound card: a private PulseAudio with two null sinks, and a foot between playback and capture.

    programs play --> sink "shaker" --> [foot] --> sink "sensors" --> programs record its monitor

`python -m simulator.pulse WAY` is the process between: `foot` shakes the virtual foot, `cable` is a loopback cable
with the gains and the couplings of an interface, `calibrator` a hand calibrator under both sensors. `silence-off` and
`silence-close` play on the card and end in one of two ways. They report when the sound ends, and how abruptly.
The daemon has a temporary folder, is not the user's, and ends with the bench.
"""

import functools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
import typer

from fasbody.exceptions import AcquisitionError
from fasbody.foot.shaker import BaseMotion

CARD_HZ = 48_000
#: Acceleration at full scale of both inputs [m/s^2].
SCALE_M_S2 = (100.0, 80.0)
#: Gains and first-order high-passes [Hz] of a cheap interface: output, base, malleolus.
GAINS, CORNERS_HZ = (0.8, 0.72), (1.2, 2.1, 2.6)
#: Base acceleration at full scale of the output [m/s^2], and of the foot's steps [Hz].
SHAKER_M_S2, FOOT_HZ = 14.0, 4000
#: Of both sensors [m/s^2 rms], several times that of an IEPE sensor on a cheap interface.
NOISE_M_S2 = 0.02
PACKAGES = "pulseaudio, pulseaudio-utils, libasound2-plugins and libportaudio2"
_BLOCK = 480
#: Where a player is cut off, the wave jumps, and no cubic goes through it: MuJoCo takes no control beyond 1e10.
_SHARP = 1e9
_STARTS_WITHIN_S, _SETTLES_S = 20.0, 1.5


def missing() -> str:
    """What this computer lacks; empty if nothing."""
    absent = [name for name in ("pulseaudio", "pactl", "parec", "pacat") if shutil.which(name) is None]
    try:
        import sounddevice  # noqa: F401
    except (ImportError, OSError):
        absent.append("sounddevice with PortAudio")
    return f"{', '.join(absent)} missing; apt install {PACKAGES}" if absent else ""


@functools.cache
def _allowed() -> bool:
    """Whether programs may be given real-time priority, as docs/acquisition.md advises."""
    if shutil.which("chrt") is None:
        return False
    return subprocess.run(["chrt", "--rr", "5", "true"], capture_output=True).returncode == 0


def ahead(words: Sequence[str]) -> list[str]:
    """A command that runs before what else the machine does, where that is allowed."""
    return ["chrt", "--rr", "5", *words] if _allowed() else [*words]


class PulseBench:
    """The daemon, and what lies between its two sinks.

    Attributes:
        environment: in which programs find them as the card `pulse`.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="fas_pulse_", ignore_cleanup_errors=True)
        root = Path(self._folder.name)
        self._log = root / "between.log"
        root.chmod(0o700)
        socket = root / "native"
        paths = [str(Path(__file__).parent.parent), os.environ.get("PYTHONPATH")]
        self.environment = {
            **os.environ, "HOME": str(root), "XDG_RUNTIME_DIR": str(root), "PULSE_RUNTIME_PATH": str(root),
            "PULSE_STATE_PATH": str(root), "PULSE_SERVER": f"unix:{socket}", "PULSE_SINK": "shaker",
            "PULSE_SOURCE": "sensors.monitor", "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        }  # fmt: skip
        sinks = [
            word
            for name in ("shaker", "sensors")
            for word in ("-L", f"module-null-sink sink_name={name} rate={CARD_HZ} format=float32le channels=2")
        ]
        self._between: subprocess.Popen[bytes] | None = None
        self._daemon = subprocess.Popen(
            ahead(["pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no",
                   "--disable-shm=yes", "-L", f"module-native-protocol-unix socket={socket} auth-anonymous=1", *sinks]),
            env=self.environment, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip

    def __enter__(self) -> Self:
        deadline = time.monotonic() + _STARTS_WITHIN_S
        while True:
            asked = subprocess.run(
                ["pactl", "list", "short", "sources"], env=self.environment, capture_output=True, text=True
            )
            if "sensors.monitor" in asked.stdout:
                return self
            if self._daemon.poll() is not None or time.monotonic() > deadline:
                self.close()
                raise AcquisitionError("PulseAudio did not start.")
            time.sleep(0.05)

    def __exit__(self, *error: object) -> None:
        self.close()

    def put(self, way: str) -> None:
        """Put this between the two sinks, in place of what was there; returns once it runs."""
        self._remove()
        with self._log.open("ab") as log:
            self._between = subprocess.Popen(
                ahead([sys.executable, "-m", "simulator.pulse", way]), env=self.environment, stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=log,
            )  # fmt: skip
        assert self._between.stdout is not None
        if not self._between.stdout.readline():
            raise AcquisitionError(f"what should lie between the sinks did not start: {way}: {self._log.read_text()}")

    def losses(self) -> list[str]:
        """Over- and underruns that PulseAudio's programs between the sinks reported, as on busy cores."""
        log = self._log.read_text(errors="replace") if self._log.is_file() else ""
        return re.findall(r"[Ss]tream (?:over|under)run", log)

    def play(self, motion: BaseMotion) -> None:
        """Let another program play, so that the shaker moves so; returns when it has played."""
        t = np.arange(round(motion.duration * CARD_HZ)) / CARD_HZ
        still = np.zeros(CARD_HZ)
        wave = np.concatenate([still, motion.acceleration(t) / SHAKER_M_S2, still]).astype("<f4")
        words = ["--raw", "--format=float32le", f"--rate={CARD_HZ}", "--channels=1", "--latency-msec=1000"]
        subprocess.run(
            ahead(["pacat", "-d", "shaker", *words]),
            env=self.environment,
            input=wave.tobytes(),
            timeout=motion.duration + 60,
        )

    def silence(self, way: str, latency_s: float) -> dict[str, float]:
        """What `silence` finds, in a program that has this daemon's card."""
        words = [sys.executable, "-m", "simulator.pulse", f"silence-{way}", "--latency", f"{latency_s:g}"]
        done = subprocess.run(ahead(words), env=self.environment, capture_output=True, text=True)
        if done.returncode:
            raise AcquisitionError(f"the card did not play: {done.stderr}")
        result: dict[str, float] = json.loads(done.stdout)
        return result

    def _remove(self) -> None:
        if self._between is not None:
            self._between.communicate(b"")
            self._between = None

    def close(self) -> None:
        """End both processes."""
        self._remove()
        self._daemon.terminate()
        self._daemon.wait()
        self._folder.cleanup()


class HighPass:
    """A first-order high-pass, exact for what is constant between two samples."""

    def __init__(self, corner_hz: float) -> None:
        self._keep = np.exp(-2 * np.pi * corner_hz / CARD_HZ)
        self._state = np.zeros(1)

    def feed(self, values: np.ndarray) -> np.ndarray:
        """The next samples (n,)."""
        from scipy.signal import lfilter

        half = 0.5 * (1 + self._keep)
        out, self._state = lfilter([half, -half], [1.0, -self._keep], values, zi=self._state)
        return np.asarray(out)


class Cable:
    """The output on both inputs."""

    def __init__(self) -> None:
        self._filters = [HighPass(corner) for corner in CORNERS_HZ]

    def feed(self, played: np.ndarray) -> np.ndarray:
        """What both inputs have, (n, 2), of what is played (n,)."""
        out, base, malleolus = self._filters
        output = out.feed(played)
        return np.column_stack([GAINS[0] * base.feed(output), GAINS[1] * malleolus.feed(output)])


class Foot:
    """The virtual foot on the shaker; it feels the played signal at FOOT_HZ, its sensors are read at CARD_HZ."""

    def __init__(self) -> None:
        from fasbody.acquire.bench.foot import BODY_MASS_KG
        from fasbody.foot.model import load
        from fasbody.foot.simulate import Batch
        from fasbody.laboratory.foot import TRUTH
        from fasbody.recording.condition import foot_mass, shank_mass

        masses = {"m_S": shank_mass(BODY_MASS_KG, 0.0), "m_F": foot_mass(BODY_MASS_KG)}
        self.foot = load("two_dof").with_values({**TRUTH, **masses})
        self._batch = Batch(self.foot, 1, 1)
        self._qpos, self._qvel = self.foot.model.qpos0.copy(), np.zeros(self.foot.model.nv)
        self._rest = np.zeros(CARD_HZ // FOOT_HZ + 2)  # of what was played, from one sample before the foot's time on
        self._edge = np.zeros((3, 2))  # the last that was felt
        self._rng = np.random.default_rng(5)
        self._couplings = [HighPass(corner) for corner in CORNERS_HZ[1:]]
        self.feed(np.zeros(_BLOCK))

    def feed(self, played: np.ndarray) -> np.ndarray:
        """What both inputs have, (n, 2) [share of full scale], of what is played (n,), a multiple of 12."""
        stride, step = CARD_HZ // FOOT_HZ, 1 / FOOT_HZ
        count = played.size // stride
        a = np.concatenate([self._rest, SHAKER_M_S2 * played])
        self._rest = a[played.size :]
        before, at, after = (a[i::stride][: count + 1] for i in range(3))
        jerk = (after - before) * CARD_HZ / 2  # a straight line between the steps would lose 0.04 % at 45 Hz
        played_so = BaseMotion(
            "played", count * step,
            lambda t: at[np.rint(t / step).astype(int)], lambda t: jerk[np.rint(t / step).astype(int)],
        )  # fmt: skip
        controls = played_so.controls(step, count)
        sharp = np.abs(controls[:, 4]) > _SHARP
        controls[sharp, 2], controls[sharp, 3:] = np.diff(at)[sharp] / step, 0.0
        out = self._batch.run(controls[None], step, self._qpos, self._qvel)
        self._qpos, self._qvel = out.qpos[0, -1].copy(), out.qvel[0, -1].copy()
        self._qpos[self.foot.base] = self._qvel[self.foot.base] = 0.0
        new = np.column_stack([out.base[0], out.malleolus[0]])
        felt = np.concatenate([self._edge, new + self._rng.normal(0, NOISE_M_S2, new.shape)])
        self._edge = felt[-3:]
        p, q, r, s = (felt[i : i + count, None] for i in range(4))  # a cubic between q and r
        u = np.arange(1, stride + 1)[:, None] / stride
        between = q + u / 2 * (r - p + u * (2 * p - 5 * q + 4 * r - s + u * (3 * (q - r) + s - p)))
        volts = between.reshape(-1, 2) / SCALE_M_S2
        return np.column_stack([one.feed(column) for one, column in zip(self._couplings, volts.T, strict=True)])


class Calibrator:
    """Both sensors on a hand calibrator, behind the inputs' coupling."""

    def __init__(self) -> None:
        self._count = 0
        self._couplings = [HighPass(corner) for corner in CORNERS_HZ[1:]]

    def feed(self, played: np.ndarray) -> np.ndarray:
        """What both inputs have, (n, 2) [share of full scale]."""
        t = (self._count + np.arange(played.size)) / CARD_HZ
        self._count += played.size
        felt = 10 * np.sqrt(2) * np.sin(2 * np.pi * 159.155 * t)
        return np.column_stack([one.feed(felt / scale) for one, scale in zip(self._couplings, SCALE_M_S2, strict=True)])


def silence(way: str, latency_s: float, share: float = 0.5, hz: float = 37.0) -> dict[str, float]:
    """How long after its end a sine still sounds [s], and its largest step between samples over that of a sine.

    Args:
        way: "off" as after a guard trips, or "close" as at the end of a session.
        latency_s: of the card's output.
        share: of full scale.
        hz: of the sine.
    """
    import threading

    from fasbody.acquire.audio import Calibration, SoundCard

    words = ["parec", "-d", "shaker.monitor", "--raw", "--format=float32le", f"--rate={CARD_HZ}", "--channels=2"]
    recorder = subprocess.Popen([*words, "--latency-msec=10"], stdout=subprocess.PIPE)
    blocks: list[tuple[float, np.ndarray]] = []

    def listen() -> None:
        assert recorder.stdout is not None
        while data := recorder.stdout.read(8 * _BLOCK):
            blocks.append((time.monotonic(), np.frombuffer(data[: len(data) // 8 * 8], "<f4").reshape(-1, 2)[:, 0]))

    listener = threading.Thread(target=listen)
    listener.start()
    card = SoundCard(Calibration("pulse", SCALE_M_S2, latency_s=latency_s))
    card.drive(frequency_hz=hz, share=share)
    deadline = time.monotonic() + _STARTS_WITHIN_S
    begun = 0
    while time.monotonic() < deadline and (not begun or len(blocks) < begun + round(_SETTLES_S * CARD_HZ / _BLOCK)):
        card.alive()
        if not begun and blocks and np.abs(blocks[-1][1]).max() > 0.99 * share:
            begun = len(blocks)
        time.sleep(0.01)
    ended = time.monotonic()
    card.drive(share=0.0) if way == "off" else card.close()
    time.sleep(latency_s + 2 * _SETTLES_S)
    recorder.terminate()
    recorder.wait()
    listener.join()
    if way == "off":
        card.close()
    loud = [at for at, block in blocks if np.abs(block).max() > 1e-3]
    wave = np.concatenate([block for _, block in blocks[begun:]])
    return {
        "heard_s": max(loud) - ended,
        "step": float(np.abs(np.diff(wave)).max() / (share * 2 * np.pi * hz / CARD_HZ)),
    }


def main(way: str, latency: float = 0.5) -> None:
    """Play, as if it were felt, what is recorded from the shaker, until the standard input closes.

    Examples:
      python -m simulator.pulse foot
    """
    import select

    if way.startswith("silence-"):
        print(json.dumps(silence(way.removeprefix("silence-"), latency)))
        return
    between: Cable | Foot | Calibrator
    between = Foot() if way == "foot" else Cable() if way == "cable" else Calibrator()
    common = ["--raw", "--format=float32le", f"--rate={CARD_HZ}", "--verbose"]
    listen = ["parec", "-d", "shaker.monitor", "--channels=2", "--latency-msec=100"]
    recorder = subprocess.Popen([*listen, *common], stdout=subprocess.PIPE)
    assert recorder.stdout is not None
    begun = time.monotonic()
    while time.monotonic() - begun < _SETTLES_S:  # an idle sink hands out seconds at once
        recorder.stdout.read(8 * _BLOCK)
    speak = ["pacat", "-d", "sensors", "--channels=2", "--latency-msec=2000"]
    spoken = subprocess.Popen([*speak, *common], stdin=subprocess.PIPE)
    assert spoken.stdin is not None
    spoken.stdin.write(np.zeros((CARD_HZ, 2), "<f4").tobytes())  # so much may the foot be late
    announced = False
    while not select.select([sys.stdin], [], [], 0)[0]:
        data = recorder.stdout.read(8 * _BLOCK)
        if len(data) < 8 * _BLOCK:  # the daemon is gone
            break
        block = np.frombuffer(data, "<f4").reshape(-1, 2)[:, 0].astype(float)  # output 1
        spoken.stdin.write(between.feed(block).astype("<f4").tobytes())
        spoken.stdin.flush()
        if not announced:
            announced = True
            print("ready", flush=True)
    for process in (recorder, spoken):
        process.terminate()
        process.wait()


if __name__ == "__main__":
    typer.run(main)
