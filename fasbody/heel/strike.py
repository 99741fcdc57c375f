"""One heel strike: force over compression and rate, each correction of the procedure a named step.

The procedure is that of Baines, Schwab and van Soest (2018), doi 10.1371/journal.pone.0197428, as
their public scripts do it. The compression is the fall of a heel point fixed to the shank, so
everything between the skin of the heel and the shank is in it: fat pad, bones, arch and ankle.
"""

from dataclasses import dataclass

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.heel import shank
from fasbody.heel.plate import Plate
from fasbody.presentation import Tabled

#: Cut-off of the filter over the Nyquist frequency, and its order.
CUTOFF, ORDER = 0.15, 2
#: Frames and order of the gentle smoothing (Savitzky-Golay) of the path that the laws see.
GENTLE = (17, 5)
#: Force that only a foot makes [N].
THRESHOLD_N = 100.0
#: Share of the peak from which the point of application is trusted.
TRUSTED = 0.25
#: How far the markers' distance may be from that of the standing person, relative.
RIGID = 0.1
#: Frames around the contact that the filter needs.
_FEWEST = 20


@dataclass(frozen=True, eq=False)
class Trial:
    """What was recorded of one strike.

    Attributes:
        subject: the person.
        speed: of walking.
        number: of the trial.
        force_volts: (n, 8).
        offset_volts: (8,) of the empty plate.
        first_sample: index of the first row in the whole trial.
        markers_m: (m, 2, 3), the lower marker first, NaN where hidden.
        first_frame: index of the first frame in the whole trial; both clocks start together.
    """

    subject: str
    speed: str
    number: str
    force_volts: np.ndarray
    offset_volts: np.ndarray
    first_sample: int
    markers_m: np.ndarray
    first_frame: int

    def __str__(self) -> str:
        return f"subject {self.subject}, {self.speed}, trial {self.number}"


@dataclass(frozen=True)
class Published:
    """The numbers of the published analysis of one strike, from contact on.

    Attributes:
        compression_at_peak_m: fall of the heel point to the first force peak.
        deepest_m: to standstill.
        work_to_peak_j: of the vertical force.
        work_to_standstill_j: likewise.
        contact_speed_m_s: downward, at contact.
        time_to_peak_s: of the first force peak.
        time_to_standstill_s: of the end.
        peak_n: force there.
        turned: whether the heel point came to a stand; else the end is where its acceleration
            turns, as in the authors' scripts.
    """

    compression_at_peak_m: float
    deepest_m: float
    work_to_peak_j: float
    work_to_standstill_j: float
    contact_speed_m_s: float
    time_to_peak_s: float
    time_to_standstill_s: float
    peak_n: float
    turned: bool


@dataclass(frozen=True, eq=False)
class Strike(Tabled):
    """Force over compression of one strike, from contact on.

    Attributes:
        subject: the person.
        speed: of walking.
        number: of the trial.
        time_s: (n,).
        force_n: (n,).
        compression_m: (n,).
        rate_m_s: (n,), positive while the heel is pressed.
        peak: sample of the first force peak.
        standstill: sample at the end of the contact that the laws are held against.
        origin: "measured" or "synthetic".
        published: the numbers of the published analysis.

    Example:
        >>> read_csv("drop.csv").work_j
    """

    subject: str
    speed: str
    number: str
    time_s: np.ndarray
    force_n: np.ndarray
    compression_m: np.ndarray
    rate_m_s: np.ndarray
    peak: int
    standstill: int
    origin: str
    published: Published

    __str__ = Trial.__str__

    @property
    def whole(self) -> slice:
        """The samples from contact to standstill: loading, and the fall of the force while the heel still sinks."""
        return slice(0, self.standstill + 1)

    @property
    def loading(self) -> slice:
        """The samples from contact to the first force peak."""
        return slice(0, self.peak + 1)

    @property
    def work_j(self) -> float:
        """Work done on everything between skin and shank from contact to standstill [J]."""
        return float(np.trapezoid(self.force_n[self.whole], self.compression_m[self.whole]))

    @property
    def returned_j(self) -> float:
        """Work that comes back [J] while the heel point rises again after standstill, at most as long as it sank.

        The foot rolls over the heel meanwhile, so this bounds what the pad returns from above.
        """
        stop = min(2 * self.standstill, self.time_s.size - 1) + 1
        x, F = self.compression_m[self.standstill : stop], self.force_n[self.standstill : stop]
        sinking = np.flatnonzero(np.diff(x) > 0.0)
        first = int(np.argmax(np.diff(x) < 0.0)) if x.size > 1 else 0
        later = sinking[sinking > first]
        end = int(later[0]) if later.size else x.size - 1
        return max(0.0, -float(np.trapezoid(F[first : end + 1], x[first : end + 1])))


def contact_and_peak(force_n: np.ndarray, threshold_n: float = THRESHOLD_N) -> tuple[int, int]:
    """Samples of contact and of the first force peak in a force (n,) [N].

    Raises:
        RecordingError: the force never passes the threshold, begins above zero, or never falls.
    """
    above = np.flatnonzero(force_n > threshold_n)
    if above.size == 0:
        raise RecordingError(f"the force never passes {threshold_n:g} N, so there is no heel strike in it.")
    slope = int(above[0])
    below = np.flatnonzero(force_n[: slope + 1] < 0.0)
    if below.size == 0:
        raise RecordingError("the force is never below zero before the strike, so the contact cannot be found.")
    falling = np.flatnonzero(np.gradient(force_n)[slope:] < 0.0)
    if falling.size == 0:
        raise RecordingError("the force never falls after the strike, so it has no first peak.")
    return int(below[-1]), slope + int(falling[0]) - 1


@dataclass(frozen=True, eq=False)
class Steps:
    """What each correction of a trial made, for the figure and for the strike.

    Attributes:
        time_s: (n,) clock of the whole trial.
        raw_n: (n,) force with the plate's offset still in it.
        force_n: (n,) without.
        contact: sample.
        peak: sample.
        application_m: (k, 3) points of application in the shank's frame.
        heel_point_m: (3,) their mean.
        frame_time_s: (m,) clock of the stretch without gaps.
        raw_path_m: (m,) height of the heel point before the filter.
        path_m: (m,) after it.
        velocity_m_s: (m,) upwards.
        frames: those of contact, peak and standstill.
        turned: whether the heel point stands there.
    """

    time_s: np.ndarray
    raw_n: np.ndarray
    force_n: np.ndarray
    contact: int
    peak: int
    application_m: np.ndarray
    heel_point_m: np.ndarray
    frame_time_s: np.ndarray
    raw_path_m: np.ndarray
    path_m: np.ndarray
    velocity_m_s: np.ndarray
    frames: tuple[int, int, int]
    turned: bool


def heel_strike(trial: Trial, plate: Plate, gain: float, distance_m: float, rate_hz: float) -> Strike:
    """Force over compression of a trial.

    Args:
        trial: what was recorded.
        plate: its geometry.
        gain: newtons a volt.
        distance_m: between the markers of the standing person, NaN if that is not known.
        rate_hz: frames of the markers a second.

    Raises:
        RecordingError: no markers, hidden or exchanged markers, or no strike; it names the trial.
    """
    from scipy.interpolate import CubicSpline
    from scipy.signal import savgol_filter

    try:
        steps = corrected(trial, plate, gain, distance_m, rate_hz)
    except RecordingError as error:
        raise RecordingError(f"{trial}: {error}") from None
    frame_0, frame_peak, stand = steps.frames
    time, frame_time = steps.time_s, steps.frame_time_s
    part = slice(steps.contact, int(np.searchsorted(time, frame_time[-1], side="right")))
    filtered, F = np.interp(time[part], frame_time, steps.path_m), steps.force_n[part]
    smooth, rise = (savgol_filter(steps.raw_path_m, *GENTLE, deriv=k, delta=1.0 / rate_hz) for k in (0, 1))
    travel = CubicSpline(frame_time, smooth)(time[part])
    x, v = travel[0] - travel, -CubicSpline(frame_time, rise)(time[part])
    k = steps.peak - steps.contact
    end = _nearest(frame_time[stand] * plate.rate_hz) - 1 - trial.first_sample - steps.contact
    end = min(end, x.size - 1)
    loading, whole = (float(np.trapezoid(F[: last + 1], filtered[0] - filtered[: last + 1])) for last in (k, end))
    published = Published(
        compression_at_peak_m=float(steps.path_m[frame_0] - steps.path_m[frame_peak]),
        deepest_m=float(steps.path_m[frame_0] - steps.path_m[stand]),
        work_to_peak_j=loading,
        work_to_standstill_j=whole,
        contact_speed_m_s=float(-steps.velocity_m_s[frame_0]),
        time_to_peak_s=float(time[steps.peak] - time[steps.contact]),
        time_to_standstill_s=float(frame_time[stand] - time[steps.contact]),
        peak_n=float(steps.force_n[steps.peak]),
        turned=steps.turned,
    )
    name = trial.subject, trial.speed, trial.number
    return Strike(*name, time[part] - time[part.start], F, x, v, k, end, "measured", published)


def corrected(trial: Trial, plate: Plate, gain: float, distance_m: float, rate_hz: float) -> Steps:
    """What each correction makes, in the published order; arguments and errors as in `heel_strike`.

    The heel point is the mean point of application in the shank's frame, from a quarter of the peak to as long after.
    """
    if trial.markers_m.shape[0] == 0:
        raise RecordingError("no markers were recorded, so there is a force but no compression.")
    if not np.isfinite(trial.force_volts).all():
        raise RecordingError("the force has samples that are not numbers.")
    forces = plate.newtons(trial.force_volts, trial.offset_volts, gain)
    force = forces.sum(axis=1)
    contact, peak = contact_and_peak(force)
    time = (trial.first_sample + np.arange(force.size) + 1) / plate.rate_hz
    frame_time = (trial.first_frame + np.arange(len(trial.markers_m)) + 1) / rate_hz
    frame_0, frame_peak = (
        _nearest((trial.first_sample + i + 1) * rate_hz / plate.rate_hz) - 1 - trial.first_frame
        for i in (contact, peak)
    )
    lower, upper = trial.markers_m[:, 0], trial.markers_m[:, 1]
    strike = trial.markers_m[max(frame_0, 0) : frame_peak + 1]
    if not 0 < frame_0 < frame_peak < len(lower) or not np.isfinite(strike).all():
        raise RecordingError("a marker is hidden between contact and the first force peak.")
    _check_markers(lower[frame_0], upper[frame_0], distance_m)
    first = int(np.flatnonzero(force[: peak + 1] > TRUSTED * force[peak])[0])
    trusted = np.arange(first, min(2 * peak - first, force.size - 1) + 1)
    floor = plate.application(forces)[trusted]
    application = _in_the_shank(floor, time[trusted], frame_time, lower, upper)
    heel = application.mean(axis=0)
    height = shank.out_of(heel, lower, shank.frames(lower, upper))[:, 2]
    known, path = _filtered(height, frame_0)
    frame_0, frame_peak = frame_0 - known.start, frame_peak - known.start
    velocity = np.gradient(path) * rate_hz
    stand, turned = _standstill(velocity, frame_0, frame_peak)
    raw = gain * np.asarray(trial.force_volts, float)[:, 4:].sum(axis=1)
    return Steps(
        time, raw, force, contact, peak, application, heel, frame_time[known], height[known], path,
        velocity, (frame_0, frame_peak, stand), turned,
    )  # fmt: skip


def _check_markers(lower: np.ndarray, upper: np.ndarray, distance_m: float) -> None:
    """At contact the lower marker is lower, and both are as far apart as on the standing person."""
    if lower[2] >= upper[2]:
        raise RecordingError("the markers are exchanged: the one that is lower on the standing person is higher here.")
    gap_m = float(np.linalg.norm(upper - lower))
    if abs(gap_m - distance_m) > RIGID * distance_m:
        raise RecordingError(
            f"the markers are {1e3 * gap_m:.0f} mm apart and {1e3 * distance_m:.0f} mm on the "
            "standing person, so they are not on one rigid shank."
        )


def _in_the_shank(
    application: np.ndarray, time: np.ndarray, frame_time: np.ndarray, lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Points of application (k, 3) [m] in the shank's frame, the floor being at z = 0."""
    a, b = np.searchsorted(frame_time, [time[0], time[-1]])
    near = slice(max(a - 1, 0), b + 1)
    markers = np.concatenate([lower, upper], axis=1)[near]
    seen = np.column_stack([np.interp(time, frame_time[near], column) for column in markers.T])
    floor = np.column_stack([application, np.zeros(len(application))])
    local = shank.into(floor, seen[:, :3], shank.frames(seen[:, :3], seen[:, 3:]))
    if not np.isfinite(local).all():
        raise RecordingError("a marker is hidden where the heel point is computed.")
    return local


def _filtered(path: np.ndarray, contact: int) -> tuple[slice, np.ndarray]:
    """The stretch without gaps around the contact, and the path over it, filtered both ways."""
    from scipy.signal import butter, filtfilt

    hidden = np.flatnonzero(~np.isfinite(path))
    first = int(max(hidden[hidden < contact], default=-1)) + 1
    known = slice(first, int(min(hidden[hidden > contact], default=path.size)))
    if known.stop - known.start < _FEWEST:
        raise RecordingError("the markers are seen for too few frames around the contact to be filtered.")
    return known, filtfilt(*butter(ORDER, CUTOFF), path[known])


def _standstill(velocity: np.ndarray, contact: int, peak: int) -> tuple[int, bool]:
    """Frame where the heel point stands, True; else where its acceleration turns, as published."""
    window = slice(peak, peak + 2 * (peak - contact) + 1)
    for values, turned in ((velocity, True), (-np.gradient(velocity), False)):
        crossings = np.flatnonzero(values[window] >= 0.0)
        if crossings.size:
            return peak + int(crossings[0]), turned
    raise RecordingError("the heel point never comes to a stand, nor does its acceleration turn.")


def _nearest(value: float) -> int:
    """Rounded, halves upwards (as the authors' language does)."""
    return int(np.floor(value + 0.5))
