r"""Both sensors on one mass: what the chain makes of a ratio that must be 1.

At rest: noise of each channel, its largest tone at the mains, and what both have in common. Shaken at some frequencies:
the ratio of the two lines, from which gain g and delay tau of the malleolus' channel come,

    y_m / y_b = g exp(-i omega tau).

Then the watch's limit is lowered below the level, and the output must go off. `fasbody record check` writes
check.json, and puts gain and delay with their standard deviations into study.toml, where every fit finds them.
"""

import math
import time
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.acquire import folder
from fasbody.acquire.board import Board, Watch
from fasbody.acquire.generator import Excitation
from fasbody.acquire.level import reach
from fasbody.acquire.plan import Plan
from fasbody.acquire.session import Session
from fasbody.console import to_json, write_whole
from fasbody.exceptions import AcquisitionError, SettingError
from fasbody.recording.harmonics import fit_harmonics
from fasbody.recording.recording import Recording

#: The rest is listened to for so long [s].
_REST_S = 1.5
#: Mains [Hz].
_MAINS = (50.0, 60.0)
#: A ratio that scatters by more from one frequency to the next (share) is not one mass.
SCATTER = 0.03
#: A gain that is off by more is a sensitivity that is not as stated, rather than its tolerance.
OFF = 0.10
#: Of the level, the limit that must trip the watch; the base is quiet below this share of it, within so long [s].
_TRIP, _QUIET, _LONGEST_S = 0.7, 0.1, 3.0
_BEGIN, _END = "# Measured by fasbody record check, both sensors on one mass:", "# end of what it measured"


@dataclass(frozen=True)
class OneMass:
    """What was measured.

    Attributes:
        gain: of the malleolus' channel against the base's.
        gain_std: its standard deviation.
        delay_s: of the malleolus behind the base.
        delay_std_s: its standard deviation.
        frequencies_hz: of the sines.
        noise_m_s2: of base and malleolus at rest [rms].
        hum_m_s2: amplitude of the larger line at the mains.
        common: correlation of both at rest.
        off_s: from the watch's trip until the base was quiet; None if nothing could be tripped.
    """

    gain: float
    gain_std: float
    delay_s: float
    delay_std_s: float
    frequencies_hz: tuple[float, ...]
    noise_m_s2: tuple[float, float] = (0.0, 0.0)
    hum_m_s2: tuple[float, float] = (0.0, 0.0)
    common: float = 0.0
    off_s: float | None = None

    @classmethod
    def of(cls, recordings: Sequence[Recording]) -> "OneMass":
        """Gain and delay from recordings of sines."""
        hz = np.array([float(r.condition.frequency_hz or 0.0) for r in recordings])
        lines = [[fit_harmonics(r.time_s, x, f, 1) for x in (r.base_m_s2, r.malleolus_m_s2)]
                 for r, f in zip(recordings, hz, strict=True)]  # fmt: skip
        ratio = np.array([m.amplitudes[0] / b.amplitudes[0] for b, m in lines])
        noise = np.array([math.hypot(*(float(x.std[0] / abs(x.amplitudes[0])) for x in pair)) for pair in lines])
        gain, off = float(np.mean(np.abs(ratio))), np.abs(ratio) / np.mean(np.abs(ratio)) - 1
        if len(hz) < 2 or np.abs(off).max() > SCATTER:
            listed = ", ".join(f"{abs(r):.3f} at {f:g} Hz" for r, f in zip(ratio, hz, strict=True))
            raise AcquisitionError(f"malleolus over base is {listed}; are both sensors tight on one stiff mass?")
        w, phase = 2 * np.pi * hz, -np.angle(ratio)
        delay = float(w @ phase / (w @ w))
        left = phase - w * delay
        scatter = [float(np.sqrt(np.sum(x**2) / (hz.size - 1) + np.mean(noise**2))) for x in (off, left)]
        return cls(
            gain, gain * scatter[0] / math.sqrt(hz.size), delay, scatter[1] / float(np.sqrt(w @ w)),
            tuple(float(f) for f in hz),
        )  # fmt: skip

    def remarks(self) -> list[str]:
        """What should be mended first."""
        texts = []
        if abs(self.gain - 1) > OFF:
            texts.append(f"the gain is {self.gain:.3f}: check sensitivities and directions of both sensors")
        if self.off_s is not None and self.off_s > 1.0:
            texts.append(f"the base came to rest only {self.off_s:.2g} s after the limit had switched the output off")
        return texts

    def __str__(self) -> str:
        off = f"; base at rest {self.off_s:.2g} s after the limit switched the output off"
        return (
            f"malleolus relative to base: gain {self.gain:.4f} +- {self.gain_std:.4f}, delay "
            f"{1e6 * self.delay_s:z.0f} +- {1e6 * self.delay_std_s:.0f} us; base and malleolus at rest: noise "
            f"{self.noise_m_s2[0]:.2g} and {self.noise_m_s2[1]:.2g}, hum {self.hum_m_s2[0]:.2g} and "
            f"{self.hum_m_s2[1]:.2g} m/s^2, correlation {self.common:+.2f}{'' if self.off_s is None else off}"
        )

    def write(self, study: Path, origin: str) -> list[Path]:
        """check.json, and the malleolus' channel in study.toml."""
        files = [write_whole(study / "check.json", to_json(asdict(self) | {"remarks": self.remarks()}) + "\n")]
        folder.begin(study, origin)
        file = study / "study.toml"
        before, _, rest = file.read_text().partition(f"\n{_BEGIN}")
        text = before + rest.partition(f"{_END}\n")[2]
        if "malleolus" in tomllib.loads(text).get("channels", {}):
            raise SettingError(
                f"{file} describes [channels.malleolus] already: put sensitivity = {self.gain:.6g}, delay_s = "
                f"{self.delay_s:.6g}, gain_std = {self.gain_std:.3g} and delay_std_s = {self.delay_std_s:.3g} there."
            )
        text += (
            f"\n{_BEGIN}\n[channels.malleolus]\nsensitivity = {self.gain:.6g}\ndelay_s = {self.delay_s:.6g}\n"
            f"gain_std = {self.gain_std:.3g}\ndelay_std_s = {self.delay_std_s:.3g}\n{_END}\n"
        )
        return [*files, write_whole(file, text)]


def rest(values: np.ndarray, rate_hz: float) -> dict[str, Any]:
    """Noise, hum and what is common of both sensors (n, 2) [m/s^2] at rest."""
    still = values - values.mean(axis=0)
    t = np.arange(len(still)) / rate_hz
    lines = np.abs([2 / t.size * still.T @ np.exp(-2j * np.pi * hz * t) for hz in _MAINS])
    size = float(np.prod(still.std(axis=0)))
    return {
        "noise_m_s2": tuple(map(float, still.std(axis=0))), "hum_m_s2": tuple(map(float, lines.max(axis=0))),
        "common": float(np.mean(still[:, 0] * still[:, 1])) / size if size else 0.0,
    }  # fmt: skip


def measure(plan: Plan, board: Board, generator: Excitation) -> OneMass:
    """The whole test: at rest, at each frequency of the plan, and the watch's trip."""
    hello = board.decoder.hello
    assert hello is not None
    pair = [hello.roles.index("base"), hello.roles.index("malleolus")]
    quiet = rest(board.collect(_REST_S)[:, pair], hello.rate_hz)
    session = Session(plan, board, generator)
    made = session.run()
    if bad := session.unusable():
        raise AcquisitionError(f"no attempt was usable: {', '.join(bad)}.")
    result = OneMass.of([one.recording for one in made if not one.problems])
    return replace(result, off_s=_trip(plan, board, generator), **quiet)


def _trip(plan: Plan, board: Board, generator: Excitation) -> float:
    """How long after its trip the base is quiet [s]: the watch's limit is put below the level."""
    frequency = max(f for f in plan.frequencies_hz if f is not None)
    try:
        level = reach(generator, board, frequency, plan.peak_to_peak, plan.safety)
        assert board.watch is not None
        board.watch = Watch(_TRIP * 0.5 * level.peak_to_peak, board.watch.offset, board.watch.looked)
        try:
            board.collect(3 / frequency + 0.2)
        except AcquisitionError:
            pass
        else:
            raise AcquisitionError("the watch did not trip at a base beyond its limit; do not shake anybody.")
    finally:
        board.watch = None
        generator.off()
    begin = time.monotonic()
    while time.monotonic() - begin < _LONGEST_S:
        piece = board.collect(0.1)[:, board.base]
        if np.ptp(piece) < _QUIET * level.peak_to_peak:
            return time.monotonic() - begin - 0.1
    raise AcquisitionError(
        f"the base still moved {_LONGEST_S:g} s after the output went off; switch the amplifier off."
    )
