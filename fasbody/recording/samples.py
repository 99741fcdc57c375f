"""Signs of how samples came about: held values, interpolation, spikes, jumps, converter steps.

Each finding has its place and its size: what it does to the amplitude and phase of the channel's sine.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from fasbody.recording.harmonics import columns, least_squares

#: Share of the places that must lie a slow channel's interval apart.
_REGULAR = 0.9
#: Samples that repeat the one before while the channel moves, beyond this share.
_REPEATED = 0.02
#: A bend is none below this share of the largest: numbers have digits.
_STRAIGHT = 3e-5
#: Fewest changes of a slow channel.
_FEWEST = 10
#: The longest interval of a slow channel that is looked for in noise, and the power between its samples over theirs.
_SLOWEST, _SMALL = 25, 0.05
#: Samples of a slow channel after which its interval is whole again, at most.
_PARTS = 12
#: Samples that show it.
_ENOUGH = 200_000
#: Values that differ by less than this share of their range are one value.
_ROUNDING = 1e-9
#: Steps of a slow channel are larger than so many of a converter.
_COARSE = 8.0
#: A sample stands out where its neighbours miss it by this times what they usually do.
_BEYOND = 12.0
#: And by this share of the channel's standard deviation.
_SHARE = 0.02
#: How neighbours of a single spike are missed, over the spike: -2/3, as far as motion lets it.
_BESIDE = (-0.95, -0.4)
#: A sample of a sine is foreign beyond this times the usual range.
_FOREIGN = 3.0
#: More jumps than in every tenth period belong to the motion.
_RARE = 0.1
#: Real part of base over malleolus where phase contradicts amplitude; a mass on a spring has at most 1.
_LITTLE = 2.0
#: A resonance so large and so little damped is none of flesh.
_MUCH, _LOSSLESS = 4.0, 0.1


@dataclass(frozen=True)
class Slow:
    """A channel that was sampled more slowly than its file is.

    Attributes:
        interval: samples of the file from one measured sample to the next.
        held: steps, else joined by straight lines.
        age: of a held sample in the mean, in samples of the file.
    """

    interval: float
    held: bool
    age: float = 0.0

    def effect(self, frequency_hz: float, rate_hz: float) -> tuple[float, float]:
        """Relative change of a sine's amplitude, and its delay [s]: those of a hold, or of two in a row."""
        turn = np.pi * frequency_hz / rate_hz
        size = float(np.sin(turn * self.interval) / (self.interval * np.sin(turn)))
        return (size - 1, self.age / rate_hz) if self.held else (size**2 - 1, 0.0)


def slow(values: np.ndarray, grid: float | None = None) -> Slow | None:
    """Whether a channel (n,) is one of fewer samples, each held, or joined by lines, up to the next.

    Args:
        values: (n,).
        grid: the `step` of its converter, if that is known already.
    """
    change, bend = np.abs(np.diff(values)), np.abs(np.diff(values, 2))
    grid = step(values) if grid is None else grid
    changes = np.flatnonzero(change > 0)
    interval = _regular(changes) or _uneven(change, grid)
    if interval:
        return Slow(interval, True, _age(interval))
    before, after = np.diff(values)[:-2], np.diff(values)[2:]
    repeated = (change[1:-1] == 0) & (before * after > 0) & (change[:-2] + change[2:] > 8 * grid)
    if repeated.mean() > _REPEATED:  # filled where samples are missing
        interval = change.size / max(1, changes.size)
        if np.ptp(np.diff(changes)) <= 1:  # evenly
            return Slow(interval, True, _age(interval))
        age = np.arange(values.size - 1) - np.maximum.accumulate(np.where(change > 0, np.arange(change.size), 0))
        return Slow(interval, True, float(age.mean()))
    bends = np.flatnonzero(bend > max(4 * grid, _STRAIGHT * float(bend.max())))
    starts = bends[np.diff(bends, prepend=-9) > 1]  # a line that bends between two samples bends at both
    straight = bends.size <= 2.2 * starts.size and bend.max() > 80 * grid
    interval = (_regular(starts) if straight else 0.0) or _uneven(bend, grid)
    return Slow(interval, False) if interval else None


def _age(interval: float) -> float:
    """Mean age of samples that are held for an interval which is counted in samples of the file."""
    # ages are multiples of 1 / q where the interval is p / q: a sample of each of p is taken when it is measured
    near = Fraction(interval).limit_denominator(_PARTS)
    return 0.5 * (interval - (1 / near.denominator if abs(near - interval) < 2e-3 else 0.0))


def _uneven(steps: np.ndarray, grid: float) -> float:
    """Every how many samples steps (n,) are large and small between, noise on all of them; else 0."""
    # a sine has as much in each class of samples up to a third of its period, and noise in any
    power = steps[:_ENOUGH] ** 2
    for count in range(min(_SLOWEST, power.size // _FEWEST), 1, -1):
        by_class = power[: power.size // count * count].reshape(-1, count)
        means = by_class.mean(axis=0)
        order = np.argsort(means)[::-1]
        several = [q for q in range(1, count // 2 + 1) if means[order[q]] < _SMALL * means[order[q - 1]]]
        if not several:
            continue
        places = np.sort(order[: several[0]])
        gaps = np.diff(places, append=places[0] + count)
        least, usual = means[places].min(), np.median(by_class[:, places], axis=0)
        even = gaps.min() > 1 and np.ptp(gaps) <= 1
        if even and (usual > 0.1 * means[places]).all() and least > (_COARSE * grid) ** 2:
            return count / places.size
    return 0.0


def _regular(places: np.ndarray) -> float:
    """The mean distance of places that lie evenly two or more samples apart, else 0."""
    if places.size < _FEWEST:
        return 0.0
    gaps = np.diff(places)
    usual = int(np.median(gaps))
    near = np.abs(gaps - usual) <= 1
    return float(gaps[near].mean()) if usual >= 2 and np.mean(near & (gaps > 1)) > _REGULAR else 0.0


@dataclass(frozen=True, eq=False)
class Odd:
    """Samples that their neighbours do not explain.

    Attributes:
        spikes: places of single samples that stand out.
        jumps: places where samples are missing and the motion continues elsewhere.
        size: of the largest [m/s^2].
        mark: the number that all spikes are, None where they differ, or are one in each period.
    """

    spikes: np.ndarray
    jumps: np.ndarray
    size: float = 0.0
    mark: float | None = None


def odd(values: np.ndarray, periods: float | None) -> Odd:
    """The samples of a channel (n,) that stand out of their neighbours.

    Args:
        values: (n,).
        periods: of its sine, None for broadband.
    """
    missed = np.zeros(values.size)
    middle = values[2:-2] - (4 * (values[1:-3] + values[3:-1]) - values[:-4] - values[4:]) / 6
    missed[2:-2] = middle
    usual = 1.4826 * float(np.median(np.abs(middle)))
    out = np.flatnonzero(np.abs(missed) > max(_BEYOND * usual, _SHARE * float(values.std())))
    if not out.size:
        return Odd(out, out)
    beside = np.stack([missed[out - 1], missed[out + 1]]) / missed[out]
    spikes = out[np.all((beside > _BESIDE[0]) & (beside < _BESIDE[1]), axis=0)]
    if periods is not None:
        around = np.abs(values - np.median(values))
        spikes = np.union1d(spikes, np.flatnonzero(around > _FOREIGN * np.quantile(around, 0.98)))
    rest = np.array([i for i in out if not spikes.size or np.abs(spikes - i).min() > 2], int)
    jumps = rest[np.diff(rest, prepend=-10) > 4]
    if periods is None or jumps.size > max(3, _RARE * periods):
        jumps = jumps[:0]
    outliers = np.concatenate([spikes, jumps])
    size = float(np.abs(missed[outliers]).max()) if outliers.size else 0.0
    same = spikes.size > 1 and np.unique(values[spikes]).size == 1
    if same and periods is not None and spikes.size >= int(periods):  # an impact of each period, without noise
        same = np.abs(np.diff(spikes) - values.size / periods).max() > 1
    return Odd(spikes, jumps, size, float(values[spikes[0]]) if same else None)


def cost(time_s: np.ndarray, values: np.ndarray, frequency_hz: float, spikes: np.ndarray) -> complex:
    """What spikes do to the sine of a channel (n,): its amplitude with them over that without."""
    basis = columns(2 * np.pi * frequency_hz * time_s, 1)
    kept = np.delete(np.arange(values.size), spikes)
    fits = [least_squares(basis[use], values[use]) for use in (slice(None), kept)]
    with_spikes, clean = (c[1] - 1j * c[2] for c in fits)
    return complex(with_spikes / clean)


def step(values: np.ndarray) -> float:
    """The step of the converter that made a channel (n,), 0 where its values lie on no grid."""
    apart = np.diff(np.unique(values))
    apart = apart[apart > _ROUNDING * float(np.ptp(values))]
    if apart.size < 2:
        return 0.0
    counts = apart / apart.min()
    return float(apart.min()) if np.abs(counts - np.round(counts)).max() < 0.02 else 0.0


def by_steps(values: np.ndarray, grid: float, frequency_hz: float, rate_hz: float) -> float:
    """Relative standard deviation of a sine's amplitude (and of its phase, in rad) by the steps of its converter.

    Rounding that repeats itself every period does not average out: the samples of one period count, unless noise makes
    the periods differ.
    """
    per_period, count = rate_hz / frequency_hz, values.size
    if abs(per_period - round(per_period)) < 1e-3 * per_period and count > 2 * per_period:
        periods = values[: count // round(per_period) * round(per_period)].reshape(-1, round(per_period))
        count = round(per_period) if float(np.median(periods.std(axis=0))) < 0.3 * grid else count
    return grid / np.sqrt(12) * np.sqrt(2 / count) / (np.sqrt(2) * float(values.std()))


def impossible(ratio: complex) -> str:
    """What is odd about malleolus over base of a sine, for a passive foot; empty where nothing is.

    A mass on any spring that stores and loses energy has 1 / H = 1 - x exp(-i d), d from 0 to 90 degrees: what
    moves much less than its base lags far behind it, and what moves much more is in resonance, a quarter turn behind.
    """
    inverse = 1 / ratio
    loss = inverse.imag / max(1e-9, 1 - inverse.real)
    if inverse.real > _LITTLE:
        return "a foot that moves so little lags by 90 degrees or more"
    if abs(ratio) > _MUCH and loss < _LOSSLESS:
        return (
            "a foot that moves so much is in resonance, and this one would have no damping (a loss factor of "
            f"{loss:.2g})"
        )
    return ""
