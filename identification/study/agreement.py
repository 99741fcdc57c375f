"""Steady state against time domain on the same recordings: do they agree, and if not, why."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fasbody.foot.model import Foot
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.fitting import Settings, fit_foot
from identification.harmonics import Line
from identification.result import FitResult
from identification.setup import STEADY

#: A difference beyond this many joint standard errors is a disagreement.
BEYOND = 3.0
#: Amplitude changes below this share are noise, whatever their significance.
_NOTABLE = 0.005
#: Parts of a recording whose amplitudes are followed, and share of them that is the onset.
_PARTS, _ONSET = 40, 10
#: Unsteady recordings that are named.
_NAMED = 3


@dataclass(frozen=True)
class Steadiness:
    """How the base's and the malleolus' fundamental behave through one recording.

    Attributes:
        file: of the recording.
        onset: relative difference of the first tenth from the rest, a transient.
        drift: relative change of the amplitude from end to end, along a straight line.
        beating: relative amplitude of the strongest slow modulation.
        beat_hz: its frequency.
        noise: the relative amplitude that noise alone gives each of them.
    """

    file: str
    onset: float
    drift: float
    beating: float
    beat_hz: float
    noise: float

    @property
    def reasons(self) -> dict[str, str]:
        """Kind of each departure from a steady sine -> it with its numbers."""
        limit = max(_NOTABLE, 4 * self.noise)
        onset, drift, beating = (100 * x for x in (self.onset, self.drift, self.beating))
        kinds = {
            "transient": (self.onset, f"a transient: its first part differs by {onset:.1f} %"),
            "drift": (abs(self.drift), f"drift: its amplitude changes by {drift:.1f} % from end to end"),
            "beating": (self.beating, f"beating: its amplitude swings by {beating:.1f} % at {self.beat_hz:.2g} Hz"),
        }  # fmt: skip
        return {kind: text for kind, (size, text) in kinds.items() if size > limit}


def steadiness(recording: Recording) -> Steadiness:
    """Follow the fundamental of both channels of a checked recording; the worse one counts.

    Raises:
        RecordingError: it has no excitation frequency.
    """
    t, f = recording.time_s - recording.time_s[0], Line.of(recording).base.frequency_hz
    channels = (recording.base_m_s2, recording.malleolus_m_s2)
    base, malleolus = (_followed(t, channel, f) for channel in channels)
    worse = {name: max(base[name], malleolus[name], key=abs) for name in base}
    worse["beat_hz"] = max(base, malleolus, key=lambda channel: channel["beating"])["beat_hz"]
    return Steadiness(recording.file, **worse)


def _followed(t: np.ndarray, signal: np.ndarray, frequency_hz: float) -> dict[str, float]:
    """What `Steadiness` has of one channel, from the amplitude in parts of whole periods."""
    length = max(1, int(t[-1] * frequency_hz / _PARTS)) / frequency_hz  # harmonics leave no trace
    parts = int((t[-1] + t[1]) / length)
    amplitude, noise = np.empty(parts), np.empty(parts)
    for i in range(parts):
        part = (t >= i * length) & (t < (i + 1) * length)
        w = 2 * np.pi * frequency_hz * t[part]
        P = np.column_stack([np.ones(w.size), *(g(h * w) for h in (1, 2, 3) for g in (np.cos, np.sin))])
        c, *_ = np.linalg.lstsq(P, signal[part], rcond=None)
        amplitude[i] = np.hypot(c[1], c[2])
        noise[i] = np.std(signal[part] - P @ c) * np.sqrt(2 / w.size)
    middle, first = (np.arange(parts) + 0.5) * length, max(1, parts // _ONSET)
    rest = amplitude[first:]
    mean, line = rest.mean(), np.polyfit(middle[first:], rest, 1)
    off = amplitude - np.polyval(line, middle)
    error, swing = float(np.median(noise)), off[first:]
    spectrum = np.abs(np.fft.rfft(swing, 16 * swing.size))
    beat = (np.argmax(spectrum[1:]) + 1) / (16 * swing.size * length)
    amplitude_of_beat = np.sqrt(2 * max(0.0, float(np.var(swing)) - error**2))
    relative = {
        "onset": abs(off[:first].mean()),
        "drift": line[0] * t[-1],
        "beating": amplitude_of_beat / np.sinc(beat * length),  # a part averages
        "noise": error,
    }
    return {name: float(value / mean) for name, value in relative.items()} | {"beat_hz": float(beat)}


def agreement(
    recordings: Sequence[Recording],
    foot: Foot,
    settings: Settings = Settings(),
    *,
    results: tuple[FitResult, FitResult] | None = None,
) -> dict[str, Any]:
    """Fit recordings in the steady state and in the time domain, and compare.

    Both routes see the same noise, so their difference scatters less than their joint standard
    error says: the test is the lenient one, and a difference beyond it is real.

    Args:
        recordings: with known excitation frequencies.
        foot: the model.
        settings: of both fits; its domain is ignored.
        results: (steady state, time domain) where they are known already.

    Returns:
        As plain data the likelier `branch` of the steady state and whether both routes find the
        `same_branch`; `differences` of its parameters, with z over the joint standard error;
        whether all with a z are within three (`agrees`, None without any); the `steadiness` of
        each recording with its reasons; and a `sentence`.
    """
    domains = [replace(settings, domain=domain) for domain in ("periodic", "time")]
    steady, timed = results or (fit_foot(recordings, foot, s, interruptible=False) for s in domains)
    name = steady.best.name
    other = next((b for b in timed.branches if b.name == name), timed.best)
    differences = []
    for key, a in steady.best.parameters.items():
        if (b := other.parameters.get(key)) is not None:
            joint = np.hypot(a.std_error, b.std_error)
            z = float((a.value - b.value) / joint) if np.isfinite(joint) and joint > 0 else np.nan
            row: dict[str, Any] = {"key": key, "steady": a.value, "steady_error": a.std_error, "time": b.value}
            row |= {"time_error": b.std_error, "z": z, "agrees": not abs(z) > BEYOND}
            differences.append(row)
    behaviour = [steadiness(checked(recording)) for recording in recordings]
    known = [row for row in differences if np.isfinite(row["z"])]
    return {
        "branch": name,
        "agrees": all(row["agrees"] for row in known) if known else None,
        "same_branch": timed.best.name == name,
        "differences": differences,
        "steadiness": [{**asdict(s), "reasons": list(s.reasons.values())} for s in behaviour],
        "sentence": _sentence(known, behaviour, steady),
    }


def _sentence(known: Sequence[Mapping[str, Any]], behaviour: Sequence[Steadiness], steady: FitResult) -> str:
    if not known:
        return "Nothing to compare: no parameter has a standard error both in steady state and in the time domain."
    routes, count = "Steady state and time domain", len(known)
    apart = ", ".join(f"{d['key']} by {abs(d['z']):.1f}" for d in known if not d["agrees"])
    if not apart:
        worst = max(abs(d["z"]) for d in known)
        return f"{routes} agree: {count} parameters, largest difference {worst:.2g} joint errors."
    number = sum(not d["agrees"] for d in known)
    text = f"{routes} disagree in {number} of {count} parameters ({apart} joint errors). The recordings are"
    why = [f"{s.file} shows {'; '.join(s.reasons.values())}" for s in behaviour if s.reasons]
    if why:
        more = f", and {len(why) - _NAMED} more are unsteady" if len(why) > _NAMED else ""
        return f"{text} not steady: {'. '.join(why[:_NAMED])}{more}. Trust the time domain."
    excess = steady.best.chi_square / max(1, steady.best.dof)
    if steady.best.dof and excess > 2:
        return (
            f"{text} steady within {100 * STEADY:.0f} % and more, but the model does not fit them "
            f"(chi-square {excess:.3g} per degree of freedom), and both methods weight this differently."
        )
    return (
        f"{text} steady, and the model fits. The time domain also includes signals between and above the "
        "harmonics (a resonating strap, coloured noise). If the minimum is flat, the two methods may "
        "end at different points. In measured data, check for an offset, a drift or a wrong clock, too."
    )
