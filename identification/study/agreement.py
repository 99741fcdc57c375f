"""Steady state against time domain on the same recordings: whether they agree, and if not, what in the data is why."""

from collections.abc import Sequence
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
#: Parts of a recording whose amplitudes are followed, and share of them (one in so many) that is the onset.
_PARTS, _ONSET = 40, 10


@dataclass(frozen=True)
class Difference:
    """One parameter in both domains: estimates, standard errors, and z = difference over the joint standard error."""

    key: str
    steady: float
    steady_error: float
    time: float
    time_error: float
    z: float

    @property
    def agrees(self) -> bool:
        """Within three joint standard errors, or unknown in one of them."""
        return not abs(self.z) > BEYOND


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
    def reasons(self) -> tuple[str, ...]:
        """Departures from a steady sine, as a sentence with numbers."""
        limit = max(_NOTABLE, 4 * self.noise)
        reasons = (
            (self.onset, f"a transient: its first part differs by {100 * self.onset:.1f} %"),
            (abs(self.drift), f"drift: its amplitude changes by {100 * self.drift:.1f} % from end to end"),
            (self.beating, f"beating: its amplitude swings by {100 * self.beating:.1f} % at {self.beat_hz:.2g} Hz"),
        )
        return tuple(text for size, text in reasons if size > limit)


@dataclass(frozen=True)
class Agreement:
    """Both routes on the same recordings.

    Attributes:
        branch: which was compared.
        differences: one a parameter.
        steadiness: one a recording.
        same_branch: both routes find the same branch likelier.
        sentence: for people.
    """

    branch: str
    differences: tuple[Difference, ...]
    steadiness: tuple[Steadiness, ...]
    same_branch: bool
    sentence: str

    @property
    def agrees(self) -> bool | None:
        """Every parameter that both estimate within three joint standard errors; None without one to compare."""
        known = [d for d in self.differences if np.isfinite(d.z)]
        return all(d.agrees for d in known) if known else None

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "branch": self.branch, "agrees": self.agrees, "same_branch": self.same_branch,
            "differences": [{**asdict(d), "agrees": d.agrees} for d in self.differences],
            "steadiness": [{**asdict(s), "reasons": list(s.reasons)} for s in self.steadiness],
            "sentence": self.sentence,
        }  # fmt: skip


def steadiness(recording: Recording) -> Steadiness:
    """Follow the fundamental of both channels through a checked recording; the worse channel counts.

    Raises:
        RecordingError: it has no excitation frequency.
    """
    line = Line.of(recording)
    t = recording.time_s - recording.time_s[0]
    frequency = line.base.frequency_hz
    channels = [_followed(t, c, frequency) for c in (recording.base_m_s2, recording.malleolus_m_s2)]
    onset, drift, beating, noise = (max((f[i] for f in channels), key=abs) for i in (0, 1, 2, 4))
    beat = max(channels, key=lambda f: f[2])[3]
    return Steadiness(recording.file, float(onset), float(drift), float(beating), float(beat), float(noise))


def _followed(t: np.ndarray, signal: np.ndarray, frequency_hz: float) -> tuple[float, float, float, float, float]:
    """Onset, drift, beating, its frequency [Hz], and noise of the amplitude in whole periods' parts."""
    length = max(1, int(t[-1] * frequency_hz / _PARTS)) / frequency_hz  # whole periods: harmonics leave no trace
    parts = int((t[-1] + t[1]) / length)
    middle, amplitude, noise = np.empty(parts), np.empty(parts), np.empty(parts)
    for i in range(parts):
        part = (t >= i * length) & (t < (i + 1) * length)
        w = 2 * np.pi * frequency_hz * t[part]
        P = np.column_stack([np.ones(w.size), *(g(h * w) for h in (1, 2, 3) for g in (np.cos, np.sin))])
        c, *_ = np.linalg.lstsq(P, signal[part], rcond=None)
        middle[i], amplitude[i] = (i + 0.5) * length, np.hypot(c[1], c[2])
        noise[i] = np.std(signal[part] - P @ c) * np.sqrt(2 / w.size)
    first = max(1, parts // _ONSET)
    x, rest = middle[first:], amplitude[first:]
    mean, line = rest.mean(), np.polyfit(x, rest, 1)
    swing = rest - np.polyval(line, x)
    error = float(np.median(noise))
    padded = np.abs(np.fft.rfft(swing, 16 * swing.size))
    beat = (np.argmax(padded[1:]) + 1) / (16 * swing.size * length)
    beating = np.sqrt(2 * max(0.0, float(np.var(swing)) - error**2)) / np.sinc(beat * length)  # a part averages
    onset = abs(np.mean(amplitude[:first] - np.polyval(line, middle[:first])))
    return onset / mean, line[0] * t[-1] / mean, beating / mean, beat, error / mean


def agreement(
    recordings: Sequence[Recording],
    foot: Foot,
    settings: Settings | None = None,
    *,
    results: tuple[FitResult, FitResult] | None = None,
) -> Agreement:
    """Fit recordings in the steady state and in the time domain, and compare.

    Both routes see the same noise, so their difference scatters less than their joint standard error says: the test is
    the lenient one, and a difference beyond it is real.

    Args:
        recordings: with known excitation frequencies.
        foot: the model.
        settings: of both fits; its domain is ignored.
        results: (steady state, time domain) where they are known already.
    """
    settings = settings or Settings()
    steady, timed = results or (
        fit_foot(recordings, foot, replace(settings, domain=domain), interruptible=False)
        for domain in ("periodic", "time")
    )
    name = steady.best.name
    other = next((b for b in timed.branches if b.name == name), timed.best)
    differences = []
    for key, a in steady.best.parameters.items():
        b = other.parameters.get(key)
        if b is not None:
            joint = np.hypot(a.std_error, b.std_error)
            z = float((a.value - b.value) / joint) if np.isfinite(joint) and joint > 0 else float("nan")
            differences.append(Difference(key, a.value, a.std_error, b.value, b.std_error, z))
    behaviour = tuple(steadiness(checked(r)) for r in recordings)
    return Agreement(
        name, tuple(differences), behaviour, timed.best.name == name, _sentence(differences, behaviour, steady)
    )


def _sentence(differences: Sequence[Difference], behaviour: Sequence[Steadiness], steady: FitResult) -> str:
    known = [d for d in differences if np.isfinite(d.z)]
    if not known:
        return "Nothing to compare: no parameter has a standard error in both the steady state and the time domain."
    apart = [d for d in known if not d.agrees]
    if not apart:
        worst = max(abs(d.z) for d in known)
        return (
            f"Steady state and time domain agree: {len(known)} parameters, largest difference {worst:.2g} joint errors."
        )
    listed = ", ".join(f"{d.key} by {abs(d.z):.1f}" for d in apart)
    text = f"Steady state and time domain disagree in {len(apart)} of {len(known)} parameters ({listed} joint errors)."
    why = [f"{s.file} shows {'; '.join(s.reasons)}" for s in behaviour if s.reasons]
    if why:
        more = f", and {len(why) - 3} more are unsteady" if len(why) > 3 else ""
        return f"{text} The recordings are not steady: {'. '.join(why[:3])}{more}. Trust the time domain."
    best = steady.best
    if best.dof and best.chi_square > 2 * best.dof:
        return (
            f"{text} The recordings are steady within {100 * STEADY:.0f} % and more, but the model misfits them "
            f"(chi-square {best.chi_square / best.dof:.3g} per degree of freedom), which both weigh differently."
        )
    return (
        f"{text} The recordings are steady and the model fits. The time domain also sees what lies between and above "
        "the harmonics compared (a strap's resonance, the colour of the noise), and in a flat valley each route stops "
        "elsewhere; in measured data look for an offset, a drifting mean or a wrong clock, too."
    )
