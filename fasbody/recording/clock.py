"""Sample times as loggers write them: rounded stamps and exact ones that jitter, made uniform where that is right."""

from collections.abc import Mapping

import numpy as np

#: Steps that stay within this share of the typical one are uniform as they are.
_UNIFORM = 0.5
#: Rounding makes odd steps again and again; fewer could be missing samples.
_REPEATED = 3
#: A missing sample is detected where it would jump by this times the scatter of the third differences.
_SEEN = 8.0
#: A column whose steps are one number in this share of the rows counts them.
_COUNTED = 0.9
#: A step of this many typical ones is a gap, which nothing can fill.
_GAP = 1.9


def rate_of(time_s: np.ndarray) -> float:
    """Sampling rate [Hz] of times (n,) [s]."""
    return float((time_s.size - 1) / (time_s[-1] - time_s[0]))


def rounded(time_s: np.ndarray) -> float | None:
    """What the stamps (n,) are rounded to [s], None if they are not those of a uniform clock.

    Rounded stamps of a uniform clock lie within half a unit of a straight line; a missing sample leaves it.
    """
    span = float(time_s[-1] - time_s[0])
    if time_s.size < 3 or not np.isfinite(time_s).all() or span <= 0:
        return None
    steps = np.diff(time_s)
    step = span / (time_s.size - 1)
    for unit in (1e-6, 1e-5, 1e-4, 1e-3, 5e-3, 1e-2):
        counts = steps / unit
        if np.abs(counts - np.round(counts)).max() < 1e-2 and unit <= 2 * step:
            off = time_s - _line(time_s)
            regular = np.mean(np.abs(off) > 0.1 * unit) > 0.05  # one stamp twice on a whole grid is no rounding
            if np.ptp(off) <= 1.05 * unit and steps.min() >= 0 and regular:
                return unit
    return None


def _line(time_s: np.ndarray) -> np.ndarray:
    """The uniform clock nearest to times (n,) [s]."""
    index = np.arange(time_s.size)
    return np.polynomial.Polynomial.fit(index, time_s, 1)(index)


def counter_fault(counts: np.ndarray, counted: bool) -> str:
    """What a counter of samples (n,) says against a uniform clock; it may begin anew at a limit.

    Args:
        counts: (n,).
        counted: whether the clock's rate is that of the counts, not of the rows.
    """
    steps = np.diff(counts)
    up = steps[steps >= 0]
    usual = float(np.median(up)) if up.size else 0.0
    if up.size < _COUNTED * steps.size or up.min() < 1 or (counts % 1).any():
        return ""
    if (up == usual).mean() < _COUNTED:  # no counter
        return ""
    if usual != 1 and counted:
        return f"counts by {usual:g} from row to row"
    places = np.flatnonzero(steps > usual)
    if not places.size:
        return ""
    more = f", and more at {places.size - 1} later places" if places.size > 1 else ""
    return f"goes from {counts[places[0]]:g} to {counts[places[0] + 1]:g}: samples are missing there{more}"


def straightened(time_s: np.ndarray) -> np.ndarray:
    """Times (n,) [s] that increase, or the uniform clock that they were rounded from; others as they are."""
    if time_s.size < 3 or np.diff(time_s).min() > 0 or rounded(time_s) is None:
        return time_s
    return _line(time_s)


def uniform(
    time_s: np.ndarray, channels: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, Mapping[str, np.ndarray], str]:
    """Uniform times, the channels at these, and a sentence on what that costs.

    Rounded stamps are replaced by the clock that they were rounded from. Exact stamps that jitter are kept: the
    channels are brought to uniform times by a spline. Gaps stay, for the checks to refuse.

    Args:
        time_s: (n,) [s].
        channels: (n,) each.
    """
    t, unchanged = time_s, (time_s, channels, "")
    if t.size < 50 or not np.isfinite(t).all() or t[-1] <= t[0]:
        return unchanged
    steps = np.diff(t)
    typical = float((t[-1] - t[0]) / (t.size - 1))
    median = float(np.median(steps))
    if steps.min() > 0 and np.abs(steps - median).max() <= _UNIFORM * median:
        return unchanged
    unit = rounded(t)
    if unit is not None:
        if not _gapless(t, channels, unit):
            return unchanged
        return _line(t), channels, (
            f"its times are rounded to {1e3 * unit:g} ms; a uniform clock of {1 / typical:.6g} Hz is "
            "assumed. Transmissibility and phase are not affected; the frequency is uncertain by "
            f"{100 * unit / (t[-1] - t[0]):.1g} %."
        )
    if steps.min() <= 0 or steps.max() > _GAP * typical:
        return unchanged
    from scipy.interpolate import CubicSpline

    clock = np.linspace(t[0], t[-1], t.size)
    made = {name: CubicSpline(t, x)(clock) for name, x in channels.items()}
    return clock, made, (
        f"its times jitter (steps of {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms); assumed "
        f"exact, they were used to resample the channels at {1 / typical:.6g} Hz by a spline, with an error of less "
        f"than 0.1 % below {0.1 / typical:.3g} Hz."
    )


def _gapless(time_s: np.ndarray, channels: Mapping[str, np.ndarray], unit: float) -> bool:
    """Whether stamps rounded to a unit [s] are those of a uniform clock."""
    # odd steps come again and again, or samples go on evenly over the few there are: not so if one were missing
    counts = np.round(np.diff(time_s) / unit)
    odd = np.flatnonzero(counts != np.median(counts))
    if odd.size >= _REPEATED:
        return True
    for place in odd:
        seen = would = 0.0
        for values in channels.values():
            bends = np.diff(values, 3)
            scale = 1.4826 * float(np.median(np.abs(bends))) or 1e-12
            near = slice(max(0, place - 2), place + 1)
            jump = np.median(np.abs(np.diff(values[max(0, place - 3) : place + 5])))
            seen, would = np.hypot(seen, np.abs(bends[near]).max() / scale), np.hypot(would, 2 * jump / scale)
        if would < _SEEN or seen > 0.5 * would:
            return False
    return True
