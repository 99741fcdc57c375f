"""What the device's time stamps tell about samples that it skipped, however much they jitter.

A stamp is the time of a sample plus jitter: y = a + b x + (samples skipped so far) + jitter, all in samples, with x the
number of samples received and b the clock's own rate. Where the jitter is small, each step of y shows by itself. Where
it is not, as on boards that take the time in software, a step is what a straight line cannot explain.
"""

from dataclasses import dataclass

import numpy as np

#: Stamps that jitter by less (rms, in samples) show each skipped sample by themselves.
_CLEAR = 0.08
#: So large a step [samples] is a skipped sample.
_SLIP = 0.75
#: And a step that the jitter explains by chance less often than once in 10^8 places is none of its doing.
_CERTAIN = 6.0
#: So many steps give the clock's own rate; with fewer, the declared one holds within _OFF.
_ENOUGH, _OFF = 8, 0.01
#: Neighbours that are so far off may be stamps in steps of several samples: then those farther apart are compared.
_COARSE, _LAG = 0.05, 64
#: Lone late stamps between punctual ones mean nothing: half the width of the running median that drops them, narrow
#: where they are rare (then a step near an end shows), wide where not; and how many make the stamps unclear.
_NARROW, _WIDE, _RARE, _FEW = 2, 8, 0.001, 0.02
#: No stamp counts as farther off than so many times the jitter.
_CLIP = 3.0


@dataclass(frozen=True)
class Stamps:
    """What the stamps of a recording tell.

    Attributes:
        steps: (n,) samples skipped before each block; negative where the stamps allow fewer than arrived.
        jitter: of the stamps [samples, rms].
        slope: the declared rate over the one by the device's clock; slope_std: its standard error.
        advance: whether the stamps advance at all; if not, nothing else is told.
    """

    steps: np.ndarray
    jitter: float
    slope: float
    slope_std: float
    advance: bool = True


def judge(x: np.ndarray, y: np.ndarray) -> Stamps:
    """Find the samples that a device skipped.

    Args:
        x: (n,) index of the first sample of each block, by its number. y: (n,) its time stamp times the declared rate.
    """
    steps = np.zeros(x.size, int)
    if x.size < 3:
        return Stamps(steps, 0.0, 1.0, float("inf"))
    x, y = x - x[0], y - y[0]
    b = _slope(x, y, 1)
    if abs(b - 1) > _COARSE:
        b = _slope(x, y, min(_LAG, x.size // 2))
    if not b > 0:
        return Stamps(steps, 0.0, 1.0, float("inf"), advance=False)
    if x.size <= _ENOUGH:
        b = min(max(b, 1 - _OFF), 1 + _OFF)
    late = np.diff(y) / b - np.diff(x)
    jitter = _jitter(late)
    early = float(np.mean(late < -0.5))
    raw = np.concatenate([[0.0], np.cumsum(late)])
    half = _NARROW if early < _RARE else _WIDE
    level = _median(raw, half)
    each = np.diff(level)
    if jitter < _CLEAR and np.mean(each < -0.5) < _FEW:
        steps[1:] = np.where(np.abs(each) >= _SLIP, np.round(each), 0)
        steps += _at_the_ends(raw - level, half, jitter)
    else:
        jitter = max(jitter, _CLEAR)
        centre = _median(raw, _WIDE)
        off = raw - centre
        steps = _beyond_jitter(x, x + centre + np.clip(off, -_CLIP * jitter, _CLIP * jitter), jitter)
        steps += _at_the_ends(off, _WIDE, jitter)
    slope, std = _line(x + np.cumsum(steps), y)
    return Stamps(steps, jitter, slope, std)


def _slope(x: np.ndarray, y: np.ndarray, lag: int) -> float:
    """The clock's own rate by the median over pairs of stamps."""
    return float(np.median((y[lag:] - y[:-lag]) / (x[lag:] - x[:-lag])))


def _jitter(late: np.ndarray) -> float:
    """Rms of the stamps' jitter from their steps, without the few that are far off or tell of skipped samples."""
    typical = 1.4826 * float(np.median(np.abs(late)))
    return float(np.sqrt(np.mean(np.clip(late, -_CLIP * typical, _CLIP * typical) ** 2) / 2))


def _median(values: np.ndarray, half: int) -> np.ndarray:
    """Running median: keeps steps, drops lone outliers; the ends see themselves in a mirror."""
    if values.size <= 2 * half + 1:
        return values
    mirrored = np.pad(values, half, mode="symmetric")
    return np.median(np.lib.stride_tricks.sliding_window_view(mirrored, 2 * half + 1), axis=1)


def _at_the_ends(off: np.ndarray, half: int, jitter: float) -> np.ndarray:
    """Steps so near an end that the mirrored median took the few blocks outside for outliers.

    Those before such a step are all too early, those behind it all too late, by more than anything between the ends.
    """
    steps = np.zeros(off.size, int)
    if off.size <= 2 * half + 1:
        return steps
    limit = max(_SLIP, _CERTAIN * jitter, float(np.abs(off[half:-half]).max()) + 0.5)
    first = int(np.argmin(off[:half] < -limit)) if not (off[:half] < -limit).all() else half
    last = int(np.argmin(off[: -half - 1 : -1] > limit)) if not (off[-half:] > limit).all() else half
    if first:
        steps[first] += round(-float(np.median(off[:first])))
    if last:
        steps[-last] += round(float(np.median(off[-last:])))
    return steps


def _beyond_jitter(x: np.ndarray, y: np.ndarray, jitter: float) -> np.ndarray:
    """Steps of y that its jitter cannot explain, section by section, so that a slowly wandering clock makes none."""
    steps = np.zeros(x.size, int)
    # A step in the middle of a section has a standard error of 4 jitter / sqrt(length): a ninth of a sample.
    length = max(32, int(np.ceil((4 * 9 * jitter) ** 2)))
    for begin in range(0, max(1, x.size - length // 2), length // 2):
        part = slice(begin, min(begin + length, x.size))
        for _ in range(length):
            at, size = _largest_step(x[part], y[part] - np.cumsum(steps[part]), jitter)
            if not size:
                break
            steps[begin + at] += size
    return steps


def _largest_step(x: np.ndarray, y: np.ndarray, jitter: float) -> tuple[int, int]:
    """Where a straight line with one step fits best, and the step's size; 0 if it is not certain.

    The step H_k (0 before k, 1 from k on) has the least-squares size <r, H_k> / |H_k|^2, r being what a line leaves of
    y, and H_k what a line leaves of the step.
    """
    if x.size < 8:
        return 0, 0
    x = x - x.mean()
    r = y - y.mean()
    r = r - (x @ r) / (x @ x) * x
    after = np.arange(x.size, 0, -1)
    tail_x = np.cumsum(x[::-1])[::-1]
    power = after - after**2 / x.size - tail_x**2 / (x @ x)
    inside = slice(3, x.size - 2)
    size = np.cumsum(r[::-1])[::-1][inside] / power[inside]
    best = int(np.argmax(size**2 * power[inside]))
    certain = abs(size[best]) * np.sqrt(power[inside][best]) > _CERTAIN * jitter
    return best + inside.start, round(float(size[best])) if certain and abs(size[best]) >= _SLIP else 0


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope of a line and its standard error."""
    x, y = x - x.mean(), y - y.mean()
    spread = float(x @ x)
    slope = float(x @ y) / spread
    left = y - slope * x
    return slope, float(np.sqrt(left @ left / (x.size - 2) / spread))
