"""Two loggers that ran side by side, made one recording: by a knock in both, or by their correlation.

A sine does not give the delay between two loggers, for it repeats itself. A knock on the table reaches both at once;
one before and one after also give the ratio of the clocks. Without a knock, motion that does not repeat itself gives
the delay by cross-correlation. That includes the lag of the foot, and its standard deviation is larger.
"""

from dataclasses import dataclass, replace

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.recording.channels import Channel
from fasbody.recording.clock import rate_of
from fasbody.recording.recording import Recording

#: A knock stands out of what is fast by so many times its median size, and lasts so long [s].
_KNOCK, _LASTS_S = 12.0, 0.05
#: What stands out less than by this share of the loudest is no knock, but the shaker that starts or stops.
_LOUD = 0.2
#: The lag of a foot behind its base that a correlation takes for delay [s], as a standard deviation.
_FOOT_S = 3e-3
#: Clocks of loggers differ by less than this share.
_CLOCKS = 2e-3
#: And by this, as a standard deviation, if nothing else is known: two quartz crystals of 20 ppm each.
_CRYSTALS = 3e-5
WAYS = ("knock", "correlation")


@dataclass(frozen=True, eq=False)
class Merged:
    """One recording of two loggers.

    Attributes:
        recording: on the clock of the first; its calibration holds the uncertainty of the delay.
        way: one of `WAYS`.
        delay_s: how much later the second started.
        delay_std_s: its standard deviation.
        clock: by how much the second's seconds are longer, as a share (0 with a single knock).
    """

    recording: Recording
    way: str
    delay_s: float
    delay_std_s: float
    clock: float

    def __str__(self) -> str:
        ppm = round(1e6 * self.clock)
        faster = f", its clock is {abs(ppm)} ppm {'slower' if ppm > 0 else 'faster'}" if ppm else ""
        delay = round(self.delay_s, 5)
        started = f"{abs(delay):.5f} s {'after' if delay > 0 else 'before'}" if delay else "at the same time as"
        return (
            f"merged by {self.way}: the second logger started {started} the first (standard deviation "
            f"{1e3 * self.delay_std_s:.2g} ms){faster}"
        )


def merge(
    time_s: np.ndarray,
    base: np.ndarray,
    other_time_s: np.ndarray,
    other: np.ndarray,
    way: str = "",
    name: str = "merged",
) -> Merged:
    """One recording of a logger on the table and one on the foot.

    Args:
        time_s: (n,) times of the logger on the table [s].
        base: (n,) its acceleration [m/s^2].
        other_time_s: (m,) times of the logger on the malleolus [s].
        other: (m,) its acceleration [m/s^2].
        way: "knock" or "correlation"; by default a knock if there is one.
        name: for messages.

    Raises:
        RecordingError: no knock in both, nothing that correlates, or less than a second in common.
    """
    t, u = time_s - time_s[0], other_time_s - other_time_s[0]
    base, other = base - np.median(base), other - np.median(other)
    knocks = None if way == "correlation" else _by_knocks(t, base, u, other)
    if knocks is None and way == "knock":
        raise RecordingError(
            f"{name}: no knock stands out in both recordings; knock on the table before and after, or merge by "
            "correlation."
        )
    way = "correlation" if knocks is None else "knock"
    delay, std, clock = _by_correlation(t, base, u, other, name) if knocks is None else knocks
    placed = u * (1 + clock) + delay  # on the first logger's clock
    inside = (t >= placed[0]) & (t <= placed[-1])
    if inside.sum() < 2 or np.ptp(t[inside]) < 1.0:
        raise RecordingError(f"{name}: the two recordings have less than a second in common; merge those of one trial.")
    from scipy.interpolate import CubicSpline

    kept = inside & _between_knocks(t, base, way)
    recording = Recording(t[kept] - t[kept][0], base[kept], CubicSpline(placed, other)(t[kept]), file=name)
    recording = replace(recording, calibration={"malleolus": Channel(delay_std_s=std)})
    return Merged(recording, way, delay, std, clock)


def _fast(x: np.ndarray) -> np.ndarray:
    """What is faster than the excitation of a foot: the signal above a quarter of the Nyquist frequency."""
    from scipy.signal import butter, sosfiltfilt

    return sosfiltfilt(butter(3, 0.25, "high", output="sos"), x)


def _knocks(t: np.ndarray, x: np.ndarray) -> list[float]:
    """When something stood out [s], at least half a second apart, the first and the last."""
    size = np.abs(_fast(x))
    loud = np.flatnonzero(size > max(_KNOCK * np.median(size), _LOUD * size.max()))
    if not loud.size:
        return []
    groups = np.split(loud, np.flatnonzero(np.diff(t[loud]) > 0.5) + 1)
    if len(groups) > 6:
        return []  # so many are no knocks
    return [float(t[g[np.argmax(size[g])]]) for g in (groups[0], groups[-1])][: len(groups)]


def _between_knocks(t: np.ndarray, base: np.ndarray, way: str) -> np.ndarray:
    """What is left without the knocks themselves."""
    knocks = _knocks(t, base) if way == "knock" else []
    kept = np.ones(t.size, bool)
    for at in knocks:
        kept &= (t > at + 6 * _LASTS_S) if at < 0.5 * t[-1] else (t < at - 2 * _LASTS_S)
    return kept


def _by_knocks(t: np.ndarray, x: np.ndarray, u: np.ndarray, y: np.ndarray) -> tuple[float, float, float] | None:
    """Delay, its standard deviation [s], by how much the second's seconds are longer; None without knocks in both."""
    first, second = _knocks(t, x), _knocks(u, y)
    if not first or len(first) != len(second):
        return None
    step = 1 / min(rate_of(t), rate_of(u))
    late, spread = zip(*(_onset_lag(t, x, a, u, y, b, step) for a, b in zip(first, second, strict=True)), strict=True)
    if len(first) == 1:
        drift = _CRYSTALS * float(np.sqrt(np.mean((u - second[0]) ** 2)))  # one knock gives no ratio of clocks
        return late[0], float(np.hypot(spread[0], drift)), 0.0
    clock = (late[1] - late[0]) / (second[1] - second[0])
    if abs(clock) > _CLOCKS:
        return None  # not the same knocks
    return late[0] - clock * second[0], float(np.hypot(*spread) / np.sqrt(2)), float(clock)


def _onset_lag(
    t: np.ndarray, x: np.ndarray, a: float, u: np.ndarray, y: np.ndarray, b: float, step: float
) -> tuple[float, float]:
    """How much later a knock stands on the first clock than on the second [s], and its standard deviation."""
    # sensors need not feel the knock alike: nothing is claimed below a third of a sample
    from scipy.interpolate import CubicSpline

    fine = np.arange(-_LASTS_S, _LASTS_S, step / 5)
    p = np.abs(CubicSpline(t, _fast(x), extrapolate=False)(a + fine))
    q = np.abs(CubicSpline(u, _fast(y), extrapolate=False)(b + fine))
    p, q = np.nan_to_num(p), np.nan_to_num(q)
    correlation = np.correlate(p, q, "full")
    top = int(np.argmax(correlation))
    lag = (top - (fine.size - 1)) * step / 5
    return a + lag - b, step / 3


def _by_correlation(
    t: np.ndarray, x: np.ndarray, u: np.ndarray, y: np.ndarray, name: str
) -> tuple[float, float, float]:
    """Delay by the highest correlation; motion that repeats itself has several, and is refused."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import correlate

    step = 1 / min(rate_of(t), rate_of(u))
    p = CubicSpline(t, x)(np.arange(0, t[-1], step))
    q = CubicSpline(u, y)(np.arange(0, u[-1], step))
    alike = correlate(p - p.mean(), q - q.mean(), "full", "fft")
    alike /= max(1e-300, np.linalg.norm(p - p.mean()) * np.linalg.norm(q - q.mean()))
    top = int(np.argmax(alike))
    near = round(0.02 / step)
    others = np.delete(alike, np.arange(max(0, top - near), min(alike.size, top + near + 1)))
    if alike[top] < 0.2 or others.max() > 0.9 * alike[top]:
        raise RecordingError(
            f"{name}: the delay is ambiguous, because the recordings repeat themselves as a sine does; knock on the "
            "table before and after, so that both loggers register it."
        )
    return (top - (q.size - 1)) * step, float(np.hypot(_FOOT_S, step / 3)), 0.0
