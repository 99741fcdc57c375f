"""Is a recording fit for identification? Each problem gets one sentence: the file, the place and the remedy."""

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from fasbody.constants import Z95
from fasbody.exceptions import RecordingError, by_name
from fasbody.presentation import Presented, Sheet, counted
from fasbody.recording import samples
from fasbody.recording.clock import uniform
from fasbody.recording.harmonics import find_frequency, fit_harmonics, narrow_share, sine_share
from fasbody.recording.quality import ChannelQuality, Quality, quality, still
from fasbody.recording.recording import Recording, gain_and_delay
from fasbody.sentences import Sentence, called, code_of, reason_of

#: Sampling rate needed, as a multiple of the excitation frequency, and the one from which harmonics are distinguished.
OVERSAMPLING, COMFORTABLE = 2.5, 10.0
#: No foot is recorded more slowly than this.
SLOWEST_HZ = 50.0
#: None is shaken faster: gloves are tried up to 1250 Hz (ISO 10819).
_FASTEST_HZ = 1250.0
#: A sine has this share of its power near one frequency and its harmonics, drift and white noise not counted.
PERIODIC_SHARE = 0.9
#: Less than this share by one frequency gives a warning with its effect.
_CLEAN = 0.97
#: A first part that differs by more than this share of the amplitude.
_ONSET = 0.02
#: Runs of this many samples at the extreme value mean clipping in broadband recordings.
_CLIPPED_RUN = 4
#: Nothing that is strapped to a foot accelerates like that [m/s^2]; shocks of a hammer do not reach a tenth of it.
_IMPOSSIBLE = 1e6
#: The largest range of the accelerometers that are strapped to people, 50 g [m/s^2].
_UNLIKELY = 500.0
#: Standard deviation of an amplitude by the converter's steps from which a warning is given.
_COARSE = 5e-3
#: Codes of warnings of a unit that may be wrong: of a base of 0.2 to 2 m/s^2, and of other values.
_IN_G, UNIT_IN_DOUBT = "in g", "unit in doubt"
_CHECK_UNIT = "check its unit."
_LIKE_G = Sentence(
    "is it in g? Then name the column base_g.", on_page="is it in g? Then type g as its unit in the table."
)
#: A passive foot lags behind its base; it may seem to lead by so much where loggers take channels one by one [deg].
_LEAD_DEG = 1.0
#: By how much more a sine of a person who repeats to 5 % may seem to lead, two standard deviations [deg].
_REPEATS_DEG = 5.7
#: Where the malleolus moves by less than this share of the base, a foot is above its resonance.
_ABOVE = 0.6
#: The third harmonic, over the fundamental, of tops that a saturated sensor flattens, and over the base's.
_FLAT_TOPS, _MORE_THAN_BASE = 0.025, 3.0
_SUSPECT_TOPS = 0.01
#: Share of all harmonics that the third one has where both sides are flattened; less is one side, which gravity and a
#: pad that cannot pull make, too.
_TWO_SIDED = 0.8
#: Limits of distortion, drift, uneven level and coherence (of a sine, and broadband) for a warning.
_DISTORTED, _DRIFTS, _UNSTEADY = 0.1, 0.3, 0.1
_COHERENT = {True: 0.95, False: 0.5}


@functools.lru_cache(maxsize=32)  # a study's job checks once, and its fit again
def checked(recording: Recording) -> Recording:
    """The recording with its excitation frequency found, offsets removed and warnings listed.

    A further accelerometer that cannot serve is left out.

    Raises:
        RecordingError: it cannot serve: too short, not uniform, dead, clipped, sampled too slowly, or the like.
    """
    try:
        return _checked(recording)
    except RecordingError:
        if not recording.others:
            raise
    alone = _checked(replace(recording, others={}))
    kept, notes = {}, []
    for name, values in recording.others.items():
        try:
            _checked(replace(recording, others={name: values}))
            kept[name] = values
        except RecordingError as error:
            notes.append(Sentence(error.sentence, f" The channel {name} is left out."))
    good = _checked(replace(recording, others=kept)) if kept else alone
    return replace(good, warnings=(*good.warnings, *notes))


def _checked(recording: Recording) -> Recording:
    """The recording after the checks, which all channels pass alike."""
    with by_name(recording.file):
        frequency, good, remarks = _judged(recording)
    named = [Sentence(f"{recording.file}: ", text, code=code_of(text)) for text in remarks]
    condition = replace(recording.condition, frequency_hz=frequency)
    return replace(good, condition=condition, warnings=(*recording.warnings, *named))


def _judged(recording: Recording) -> tuple[float | None, Recording, list[str]]:
    """Its excitation [Hz], None for broadband; the recording without offsets; and remarks."""
    for name, values in recording.accelerations.items():
        _possible(recording.time_s, f"{name}_m_s2", values)
    time_s, channels, remark = uniform(recording.time_s, recording.accelerations)
    remarks = [remark] if remark else []
    _time(time_s)
    offsets = {name: float(x.mean()) for name, x in channels.items()}
    for name, values in channels.items():
        remarks += _channel(f"{name}_m_s2", values)
    centred = {name: x - offsets[name] for name, x in channels.items()}
    named = {f"{name}_m_s2": x for name, x in centred.items()}
    recording = recording.with_channels({"time_s": time_s, **named})
    _no_copy(centred)
    base_hz = find_frequency(recording.time_s, recording.base_m_s2)
    share = narrow_share(recording.time_s, recording.base_m_s2, base_hz)
    try:
        _moving(recording, base_hz if share > 0.5 else None)
        is_sine = _is_sine(recording, base_hz, share)
    except RecordingError:  # codes for missing samples can be why
        for name, values in centred.items():
            _no_code(recording.time_s, name, samples.odd(values, None), offsets[name])
        raise
    frequency = base_hz if is_sine else None
    if is_sine:
        remarks += _excitation(recording, base_hz)
    for name, values in centred.items():
        grid = samples.step(values)
        slow = samples.slow(values, grid)
        if slow and frequency and recording.rate_hz / slow.interval < OVERSAMPLING * frequency:
            slow = None  # four samples a period can be equal in pairs by themselves
        remarks += _sampling(recording, name, grid, slow, frequency)
        _clipping(recording, name, frequency, slow.interval if slow else 1.0)
        if slow is None:
            remarks += _odd(recording, name, frequency, offsets[name])
    if frequency is not None:
        remarks += _level(recording, frequency)
    measures = quality(recording.time_s, centred, frequency)
    remarks += _quality(recording, measures, frequency)
    if frequency is not None:
        remarks += _cost(recording, measures, frequency)
    return frequency, recording, remarks


#: Two sensors differ at least by this share of their motion.
_COPY = 1e-5


def _no_copy(channels: Mapping[str, np.ndarray]) -> None:
    """Refuse a malleolus (n,) that is a multiple of the base, sample by sample."""
    base, malleolus = channels["base"], channels["malleolus"]
    power = float(base @ base)
    times = float(base @ malleolus) / power if power > 0 else 0.0
    if times and np.abs(malleolus - times * base).max() < _COPY * np.abs(malleolus).max():
        raise RecordingError(
            f"malleolus_m_s2 is {times:.4g} times base_m_s2, sample by sample: one sensor, written "
            "twice; no two move so."
        )


def _possible(time_s: np.ndarray, name: str, values: np.ndarray) -> None:
    """Refuse samples that are none, before anything is computed with them."""
    if values.shape != time_s.shape:
        raise RecordingError(f"{name} has {values.size} samples and time has {time_s.size}.")
    if not np.isfinite(values).all():
        place = int(np.argmin(np.isfinite(values)))
        raise RecordingError(
            f"{name} is {values[place]} at {time_s[place]:g} s; every sample must be finite."
        )
    peak = float(np.abs(values).max())
    if peak > _IMPOSSIBLE:
        raise RecordingError(
            f"{name} reaches {peak:.3g} m/s^2 at {time_s[np.abs(values).argmax()]:g} s, which no "
            f"body does (at most {_IMPOSSIBLE:.0e} is read); check its unit and sensitivity."
        )


def _time(t: np.ndarray) -> None:
    """Refuse a time (n,) [s] that is too short, too slow, or not uniform."""
    if t.size < 50:
        raise RecordingError(
            f"has {t.size} samples, too short; record at least three periods (the thesis: 10 s)."
        )
    if not np.isfinite(t).all():
        place = int(np.argmin(np.isfinite(t)))
        raise RecordingError(f"time is not a number at sample {place}.")
    steps = np.diff(t)
    if t[-1] <= t[0] and (steps <= 0).all():
        runs = "stands still" if t[-1] == t[0] else "runs backwards"
        raise RecordingError(
            f"time {runs} ({t[0]:g} s first, {t[-1]:g} s last); sort the rows by time."
        )
    if steps.min() <= 0:
        place = int(np.argmin(steps)) + 1
        raise RecordingError(
            f"time does not increase at sample {place} ({t[place - 1]:g} s, then {t[place]:g} s)."
        )
    rate_hz = float((t.size - 1) / (t[-1] - t[0]))
    if rate_hz < SLOWEST_HZ:
        raise RecordingError(
            f"is sampled at {rate_hz:.3g} Hz over {t[-1] - t[0]:.4g} s; it needs "
            f"{SLOWEST_HZ:g} Hz or more (if the time is in ms, name the column time_ms)."
        )
    typical = float(np.median(steps))
    off = np.abs(steps - typical)
    # Printed time stamps are rounded: allow one unit of a coarse last digit, no missing sample.
    if off.max() > 0.5 * typical:
        place, count = int(np.argmax(off)), int((off > 0.5 * typical).sum())
        more = f" (and so at {counted(count - 1, 'more place')})" if count > 1 else ""
        raise RecordingError(
            f"time is not uniform: {steps[place]:g} s after {t[place]:g} s (sample {place + 1} of "
            f"{t.size}), elsewhere {typical:g} s; samples are missing or channels have different "
            f"rates{more}."
        )


def _channel(name: str, values: np.ndarray) -> Iterator[str]:
    """Refuse a dead channel; remarks on its range and offset."""
    if values.std() < 1e-3:
        raise RecordingError(
            f"{name} is dead (it varies by {np.ptp(values):.2g} m/s^2); check the cable and the "
            "units."
        )
    levels = np.unique(values).size
    if levels < 3 or (levels < 8 and samples.step(values)):
        raise RecordingError(
            f"{name} is dead or too coarse: it takes {levels} values only; check the cable, and "
            "that its numbers were saved with their decimals."
        )
    peak, mean = float(np.abs(values).max()), float(values.mean())
    if peak > _UNLIKELY:
        reach = f"{name} reaches {peak:.3g} m/s^2, more than is plausible for a foot on a shaker; "
        yield Sentence(reach, _CHECK_UNIT, code=UNIT_IN_DOUBT)
    if abs(mean) > 0.5:
        kind = "gravity" if abs(abs(mean) - 9.81) < 1 else "an offset"
        yield f"{name} has {kind} of {mean:.3g} m/s^2, which is taken out."


def _moving(recording: Recording, frequency: float | None) -> None:
    """Refuse a sensor that stands still for a part of the recording while another moves."""
    channels = {f"{name}_m_s2": values for name, values in recording.accelerations.items()}
    stands = still(recording.time_s, channels, frequency)
    if stands:
        name, start, end = stands
        raise RecordingError(
            f"{name} stands still from {start:.4g} to {end:.4g} s while another channel moves; cut "
            "this part off, or check sensor and cable."
        )


def _is_sine(recording: Recording, hz: float, share: float) -> bool:
    """Whether the base vibrates at one frequency, which must agree with the table."""
    nominal = recording.condition.frequency_hz
    if share < PERIODIC_SHARE:
        if nominal is None:
            return False
        raise RecordingError(
            f"the excitation of {nominal:g} Hz is not found in base_m_s2 (a sine explains "
            f"{100 * share:.0f} % of its power); leave frequency_hz empty for broadband excitation."
        )
    if nominal is not None and abs(hz - nominal) > frequency_tolerance(recording, nominal):
        raise RecordingError(
            f"base_m_s2 vibrates at {hz:.4g} Hz and recordings.csv says {nominal:g} Hz."
        )
    return True


def frequency_tolerance(recording: Recording, nominal_hz: float) -> float:
    """How far [Hz] the frequency of a sine may be from the one that is stated of it."""
    length = float(recording.time_s[-1] - recording.time_s[0])
    return max(0.02 * nominal_hz, 1.5 / length)


def _excitation(recording: Recording, hz: float) -> Iterator[str]:
    """Whether a sine [Hz] is sampled fast and long enough."""
    rate, length = recording.rate_hz, recording.time_s[-1] - recording.time_s[0]
    if hz > _FASTEST_HZ:
        yield (
            f"base_m_s2 vibrates at {hz:.4g} Hz, faster than any foot is shaken; check the unit of "
            "its time."
        )
    if rate < OVERSAMPLING * hz * (1 - 1e-3):
        raise RecordingError(
            f"is sampled at {rate:g} Hz, less than {OVERSAMPLING} times its excitation of "
            f"{hz:.4g} Hz."
        )
    if length * hz < 3:
        raise RecordingError(
            f"is too short: {length * hz:.1f} periods of {hz:.4g} Hz, not 3 or more."
        )
    if rate < COMFORTABLE * hz * (1 - 1e-3):
        orders = np.arange(2, 11)
        alias = np.abs(orders * hz - rate * np.round(orders * hz / rate))
        folded = orders[np.abs(alias - hz) < 2 / length]
        effect = (
            f"its harmonic {folded[0]} is aliased to the excitation frequency and biases the amplitude, "
            "which the interval does not include; choose another sampling rate."
            if folded.size
            else f"the sine fit needs no more, but harmonics above {rate / 2:.4g} Hz fold and are "
            "not told apart."
        )
        times = rate / hz
        yield f"sampled at {rate:.5g} Hz, {times:.3g} times its excitation of {hz:.4g} Hz: {effect}"


def _sampling(
    recording: Recording, name: str, grid: float, slow: samples.Slow | None, frequency: float | None
) -> Iterator[str]:
    """What a slow channel, or the steps of its converter, cost."""
    values, rate, f = recording.accelerations[name], recording.rate_hz, frequency or 20.0
    if slow is not None:
        change, delay_s = slow.effect(f, rate)
        kept = "held until the next one" if slow.held else "joined by straight lines"
        late = f", {360 * f * delay_s:.3g} degrees late" if slow.held else ""
        delay = called(f"channels.{name}.delay_s", f"{delay_s:.3g}")
        yield Sentence(
            f"{name}_m_s2 was sampled at {rate / slow.interval:.4g} Hz and is {kept}: a sine of "
            f"{f:.4g} Hz is {-100 * change:.2g} % too small by that{late}; record all channels at "
            "one rate",
            *((", or (unless each is the nearest sample in time) give ", delay) if slow.held else ()),
            ".",
        )
    elif frequency and (error := samples.by_steps(values, grid, frequency, rate)) > _COARSE:
        yield (
            f"{name}_m_s2 has steps of {grid:.3g} m/s^2 (its converter, or numbers saved with few "
            f"digits), which leave its amplitude uncertain by {100 * error:.2g} %, whatever the "
            "interval says."
        )


def _clipping(recording: Recording, name: str, frequency: float | None, interval: float) -> None:
    """Refuse flat tops: longer runs at an extreme value than the converter's step gives a sine."""
    # a channel with one measured sample in several (`interval`) stays so much longer at its top
    values, t = recording.accelerations[name], recording.time_s
    levels = np.unique(values)
    step, size = float(np.diff(levels).min()), 0.5 * float(np.ptp(values))
    shortest: float = _CLIPPED_RUN
    if frequency is not None:  # how long a quantised sine stays there, one sample more at each end
        period = recording.rate_hz / frequency
        stay = 2 * np.sqrt(2 * min(step / size, 1)) / (2 * np.pi) * period
        shortest = max(3, int(np.ceil(stay)) + 2)
    shortest = shortest if interval == 1 else (shortest + 1) * interval
    periods = 10 if frequency is None else (t[-1] - t[0]) * frequency
    for extreme in (levels[-1], levels[0]):
        at_top = np.concatenate([[0], (values == extreme).view(np.int8), [0]])
        edges = np.flatnonzero(np.diff(at_top))
        runs = edges[1::2] - edges[::2]
        count = int((runs >= shortest).sum())
        if count >= max(2, 0.2 * periods):
            place = t[edges[::2][np.argmax(runs)]]
            raise RecordingError(
                f"{name}_m_s2 is clipped {count} times, for up to {runs.max()} samples near "
                f"{place:g} s; record with a larger range."
            )


def _odd(recording: Recording, name: str, frequency: float | None, offset: float) -> Iterator[str]:
    """Refuse marks that stand for missing samples; what spikes and jumps do."""
    t, values = recording.time_s, recording.accelerations[name]
    odd = samples.odd(values, None if frequency is None else (t[-1] - t[0]) * frequency)
    _no_code(t, name, odd, offset)
    if odd.spikes.size:
        costs = ""
        if frequency is not None:
            changed = samples.cost(t, values, frequency, odd.spikes)
            costs = (
                f", which change the amplitude of its sine by {100 * abs(changed) - 100:+.2g} % "
                f"and its phase by {np.degrees(np.angle(changed)):+.2g} degrees"
            )
        spikes = "a spike" if odd.spikes.size == 1 else f"{odd.spikes.size} spikes"
        yield (
            f"{name}_m_s2 has {spikes} of up to {odd.size:.3g} m/s^2, the first at "
            f"{t[odd.spikes[0]]:.4g} s{costs}."
        )
    elif odd.jumps.size:
        more = f" and at {odd.jumps.size - 1} more places" if odd.jumps.size > 1 else ""
        yield (
            f"{name}_m_s2 jumps by {odd.size:.3g} m/s^2 at {t[odd.jumps[0]]:.4g} s{more}; "
            "if samples are missing there, all later ones come too early."
        )


def _no_code(time_s: np.ndarray, name: str, odd: samples.Odd, offset: float) -> None:
    """Refuse a number that stands for missing samples."""
    if odd.mark is not None:
        raise RecordingError(
            f"{name}_m_s2 is {odd.mark + offset:.6g} m/s^2 at {odd.spikes.size} places, first at "
            f"{time_s[odd.spikes[0]]:.4g} s, and near it nowhere else, like a code for missing "
            "samples; remove or fill them first."
        )


def _level(recording: Recording, frequency: float) -> Iterator[str]:
    """Amplitudes and phase that a foot on a shaker can have."""
    t = recording.time_s
    fits = [
        fit_harmonics(t, channel, frequency, 1)
        for channel in (recording.base_m_s2, recording.malleolus_m_s2)
    ]
    base, malleolus = (fitted.amplitudes[0] for fitted in fits)
    onset = max(fitted.onset for fitted in fits)
    if onset > _ONSET:
        yield Sentence(
            f"its first tenth differs from the rest by {100 * onset:.0f} % (a start-up "
            "transient?); cut it off, or use ",
            called("domain", "time"),
            ".",
        )
    ratio = malleolus / base
    if not 0.02 < abs(ratio) < 20:
        raise RecordingError(
            f"the malleolus moves {abs(ratio):.3g} times as much as the base at {frequency:.4g} "
            "Hz; check units and sensitivities (m/s^2 are expected, or g with the header "
            "malleolus_g)."
        )
    if not 2 < abs(base) < 40:
        like_g = 0.2 < abs(base) <= 2
        yield Sentence(
            f"the base amplitude is {abs(base):.3g} m/s^2 at {frequency:.4g} Hz (the thesis: 8.95); ",
            _LIKE_G if like_g else _CHECK_UNIT,
            code=_IN_G if like_g else UNIT_IN_DOUBT,
        )
    lead = np.degrees(np.angle(ratio))
    if why := samples.impossible(ratio):
        motion = (
            f"the malleolus moves {abs(ratio):.3g} times as much as the base and lags it by "
            f"{-lead:.3g} degrees at {frequency:.4g} Hz: {why}; "
        )
        yield Sentence(motion, _CHECK_UNIT, code=UNIT_IN_DOUBT)
    if _late(abs(ratio), lead):
        yield Sentence(
            f"the malleolus lags the base by {360 - lead:.0f} degrees at {frequency:.4g} Hz, more "
            "than 180 degrees. A foot well above its resonance can do so; a wrong sign does, too (",
            called("channels.sign"),
            ").",
        )
    elif lead > 10:
        early_ms = 1e3 * lead / 360 / frequency
        lead_of = f"leads the base by {lead:.0f} degrees ({early_ms:.3g} ms) at {frequency:.4g} Hz"
        cause = "the channels are swapped, misaligned or one has the wrong sign ("
        raise RecordingError(
            problem=f"the malleolus {lead_of}, which no passive foot does",
            remedy=Sentence(cause, called("channels.sign, channels.delay_s"), ")"),
        )


def _late(size: float, lead_deg: float) -> bool:
    """Whether a lead is a lag of 180 to 270 degrees, of two masses above both resonances."""
    return lead_deg > 90 and size < _ABOVE


def _quality(recording: Recording, measures: Quality, frequency: float | None) -> Iterator[str]:
    """Flattened tops, channels swapped or uneven, by coherence, distortion, drift and level."""
    at = "over the band" if frequency is None else f"at {frequency:.4g} Hz"
    base, malleolus = measures.channels["base"], measures.channels["malleolus"]
    _, delay_std = gain_and_delay(recording, "malleolus", "base")
    sure = 3 * np.hypot(measures.lead_std_deg, 360 * (frequency or 20.0) * delay_std)
    size = malleolus.level_m_s2.mean() / base.level_m_s2.mean()
    leads = measures.lead_deg - _LEAD_DEG - sure
    late = bool(frequency) and _late(size, measures.lead_deg)
    if leads > 0 and not late and measures.coherence > _COHERENT[False]:
        lead = f"the malleolus leads the base by {measures.lead_deg:.1f} degrees {at}, which no passive foot does"
        cause = Sentence("the channels are swapped or misaligned (", called("channels.column, channels.delay_s"), ")")
        if not frequency or leads > _REPEATS_DEG:
            raise RecordingError(problem=lead, remedy=cause)
        yield Sentence(f"{lead}. Either the person moved differently during the recording, or ", cause, ".")
    for name, channel in measures.channels.items():
        if name != "base":
            yield from _tops(name, channel, base, at)
        if channel.distortion > _DISTORTED:
            share = 100 * channel.distortion
            yield f"{name}_m_s2 has harmonics of {share:.0f} % of its fundamental."
        if channel.drift > (_DRIFTS if frequency else 1.0):
            yield f"{name}_m_s2 drifts by {100 * channel.drift:.0f} % of its amplitude."
        low, high = channel.level_m_s2.min(), channel.level_m_s2.max()
        if frequency and high - low > _UNSTEADY * channel.level_m_s2.mean():
            yield (
                f"the level of {name}_m_s2 is not steady, {low:.3g} to {high:.3g} m/s^2 by segment."
            )
    if base.flat_tops > _FLAT_TOPS and malleolus.flat_tops < 0.1 * base.flat_tops:
        yield (
            f"base_m_s2 has flattened tops {at} and the malleolus none; does its sensor saturate?"
        )
    if frequency and (turned := measures.turned_deg):
        length = float(recording.time_s[-1] - recording.time_s[0])
        yield (
            f"the malleolus' phase runs evenly by {turned:.3g} degrees from start to end at a steady "
            "amplitude: its clock and the base's run apart by "
            f"{abs(turned) / 360 / frequency / length * 1e6:.0f} ppm; record both by one clock, or "
            "give each its times."
        )
    if measures.coherence < _COHERENT[frequency is not None]:
        yield (
            f"the coherence of malleolus and base is {measures.coherence:.2f} {at}; noise, "
            "or a foot whose response changes during the recording."
        )


def _tops(name: str, channel: ChannelQuality, base: ChannelQuality, at: str) -> Iterator[str]:
    """Refuse a sensor that saturates; a remark on tops that are a little flat, on one side, or of friction."""
    flat, one_sided = channel.flat_tops, channel.flat_tops < _TWO_SIDED * channel.distortion
    share = f"a third harmonic of {100 * flat:.1f} % in phase with them"
    least = _MORE_THAN_BASE * base.distortion
    if flat > max(_FLAT_TOPS, least) and not one_sided and channel.alternates:
        raise RecordingError(
            f"{name}_m_s2 has flattened tops {at} ({share}, base {100 * base.distortion:.1f} %): "
            "its sensor saturates; record with a larger range."
        )
    if flat > max(_SUSPECT_TOPS, least):
        yield (
            f"{name}_m_s2 has flattened tops on one side {at} ({share}); a foot that leaves the "
            "plate makes them, and so does a sensor that saturates on one side."
            if one_sided and flat > _FLAT_TOPS
            else f"{name}_m_s2 has flattened tops {at} ({share}); dry friction in the foot or a sensor "
            "that saturates can cause this. Friction causes less of it at a larger amplitude."
            if flat > _FLAT_TOPS
            else f"{name}_m_s2 has slightly flattened tops {at} ({share}); a sensor that begins to "
            "saturate reads too little."
        )


def _cost(recording: Recording, measures: Quality, frequency: float) -> Iterator[str]:
    """What noise, drift and a wandering shaker cost, in the interval of the ratio."""
    share = sine_share(recording.time_s, recording.base_m_s2, frequency)
    if share < _CLEAN:
        half = Z95 * measures.lead_std_deg
        yield (
            f"{100 * (1 - share):.0f} % of the power of base_m_s2 is neither the excitation nor "
            "its harmonics (noise, drift, or an unsteady shaker): the malleolus over the base "
            f"is known to {100 * np.radians(half):.2g} % and {half:.2g} degrees, or better if "
            "both channels share the disturbance."
        )


def gathered(texts: Sequence[str]) -> list[str]:
    """Warnings of several recordings; that of values like g stands there once."""
    like_g = [text for text in texts if code_of(text) == _IN_G]
    if len(like_g) < 2:
        return list(texts)
    first = Sentence(like_g[0], f" The same in {len(like_g) - 1} more recordings.", code=_IN_G)
    return [first if text == like_g[0] else text for text in texts if text == like_g[0] or text not in like_g]


def unit_in_doubt(warnings: Iterable[Sequence[str]], stated: bool = False) -> str:
    """That the values of recordings seem to have another unit, in a sentence; nothing where they do not.

    Args:
        warnings: of the checks, for each recording.
        stated: a person gave the unit, who is believed that a motion is weak, and not that it is impossible.
    """
    codes = [UNIT_IN_DOUBT] if stated else [_IN_G, UNIT_IN_DOUBT]
    doubts = [[text for text in texts if code_of(text) in codes] for texts in warnings]
    first, *others = [texts[-1] for texts in doubts if texts] or [""]
    more = f" The same in {len(others)} more recordings." if len(others) > 1 else ""
    return Sentence(first, more, code=UNIT_IN_DOUBT)


def apart(recordings: Sequence[Recording]) -> None:
    """Refuse the same recording twice, under whatever name: counted twice, it would seem twice as sure.

    Raises:
        RecordingError: two of them hold the same base and malleolus.
    """
    seen: dict[str, str] = {}
    for recording in recordings:
        digest = sha256(recording.base_m_s2.tobytes() + recording.malleolus_m_s2.tobytes()).hexdigest()
        if digest in seen:
            raise RecordingError(
                f"{seen[digest]} and {recording.file} are the same recording (sha256 of the samples {digest[:12]}); "
                "leave one of them out."
            )
        seen[digest] = recording.file


def judged(recording: Recording) -> dict[str, Any]:
    """Length, rate and excitation; the problem, if any, and the warnings."""
    row: dict[str, Any] = {"file": recording.file, "problem": "", "warnings": [*recording.warnings]}
    try:
        good = checked(recording)
        row["warnings"] = list(good.warnings)
        row["frequency_hz"] = good.condition.frequency_hz
    except RecordingError as error:
        row["problem"] = error.sentence
    t = recording.time_s
    row |= {"samples": t.size, "origin": recording.origin, "used": recording.used, "unused": recording.unused}
    if t.size > 1 and np.isfinite(t).all() and t[-1] > t[0]:
        row |= {"rate_hz": recording.rate_hz, "seconds": float(t[-1] - t[0])}
    return row


def understood(recording: Recording) -> dict[str, Any]:
    """The same, with level and quality of each channel, and amplitude and phase of a sine."""
    condition = recording.condition
    row = judged(recording) | {key: getattr(condition, key) for key in ("subject", "posture", "added_mass_kg")}
    good = recording if row["problem"] else checked(recording)
    row["rms_m_s2"] = {name: float(np.std(x)) for name, x in good.accelerations.items()}
    if row["problem"]:
        return row
    t, f = good.time_s, good.condition.frequency_hz
    try:
        with by_name(recording.file):
            measures = quality(t, good.accelerations, f)
            row["sine_share"] = sine_share(t, good.base_m_s2, f or find_frequency(t, good.base_m_s2))
    except RecordingError as error:
        return row | {"problem": error.sentence}
    row["quality"] = measures.row()
    return row if f is None else row | {"transmissibility": measures.ratio, "phase_deg": measures.lead_deg}


def reasons(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Why recordings cannot be used, once for all that share a reason, most first: how many, which, and why.

    Args:
        rows: of `understood`.
    """
    groups: dict[str, list[tuple[str, str]]] = {}
    for row in rows:
        if row["problem"]:
            why = reason_of(row["problem"])
            groups.setdefault(code_of(row["problem"]) or why, []).append((row["file"], why))
    return [
        f"{counted(len(group), 'recording')} ({', '.join(name for name, _ in group[:5])}"
        f"{' ...' if len(group) > 5 else ''}): {group[0][1]}"
        for group in sorted(groups.values(), key=len, reverse=True)
    ]


@dataclass(frozen=True, eq=False, repr=False)
class Checked(Presented):
    """Results of the checks of a study.

    Attributes:
        name: of the study.
        rows: of each recording, as `understood` gives them.
        remarks: on the whole.
    """

    name: str
    rows: tuple[Mapping[str, Any], ...]
    remarks: tuple[str, ...] = ()

    @property
    def problems(self) -> tuple[str, ...]:
        """A sentence on each recording that cannot serve."""
        return tuple(row["problem"] for row in self.rows if row["problem"])

    def records(self) -> list[dict[str, Any]]:
        """One row a recording."""
        flat = []
        for row in self.rows:
            plain = {key: value for key, value in row.items() if key not in ("rms_m_s2", "quality")}
            for name, value in row.get("quality", {}).items():
                plain |= {f"{key}_{name}": v for key, v in value.items()} if isinstance(value, dict) else {name: value}
            rms = {f"rms_{name}_m_s2": value for name, value in row.get("rms_m_s2", {}).items()}
            joined = {"used": "; ", "unused": "; ", "warnings": " "}
            flat.append(plain | rms | {key: mark.join(row.get(key, ())) for key, mark in joined.items()})
        return flat

    def sheet(self) -> Sheet:
        """One row a recording, those with a problem first."""
        columns, rows = ("file", "samples", "rate [Hz]", "excitation [Hz]", *QUALITIES, "verdict"), []
        for row in sorted(self.rows, key=lambda row: (not row["problem"], not row.get("warnings"))):
            line = cells(row)
            rows.append([line[name] for name in columns])
        sound = sum(verdict(row) == "sound" for row in self.rows)
        notes = [
            *self.problems,
            *self.remarks,
            *gathered([text for row in self.rows for text in row.get("warnings", ())]),
        ]
        return Sheet(f"{self.name}: {sound} of {len(self.rows)} recordings are sound", columns, rows, notes)


#: Heading, key and digits of numbers in tables.
_NUMBERS = (
    ("samples", "samples", "0f"), ("rate [Hz]", "rate_hz", "6g"),
    ("T", "transmissibility", "3f"), ("phase [deg]", "phase_deg", "3g"),
)  # fmt: skip
#: Columns of the tables of quality: coherence, and the worst channel's distortion, drift and range of levels.
QUALITIES = ("coherence", "distortion [%]", "drift [%]", "level range [%]")


def quality_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """What stands below `QUALITIES` for a row of `understood`, empty where there is none."""
    measures = row.get("quality")
    if not measures:
        return "", "", "", ""
    channels = [value for value in measures.values() if isinstance(value, dict)]
    coherence = "" if measures["coherence"] is None else f"{measures['coherence']:.4f}"
    distortion = [c["distortion"] for c in channels if c["distortion"] is not None]
    ranges = [float(np.ptp(c["level_m_s2"]) / np.mean(c["level_m_s2"])) for c in channels]
    drift = [c["drift"] for c in channels if c["drift"] is not None]
    return coherence, *(f"{100 * max(x):.2g}" if x else "" for x in (distortion, drift, ranges))


def cells(row: Mapping[str, Any]) -> dict[str, str]:
    """What tables show of a row of `understood`, by heading."""
    hz = row.get("frequency_hz")
    stated = {name: f"{row[key]:.{digits}}" if key in row else "" for name, key, digits in _NUMBERS}
    levels = {f"{name} rms [m/s²]": f"{value:.3g}" for name, value in row.get("rms_m_s2", {}).items()}
    excitation = "" if row["problem"] else "broadband" if hz is None else f"{hz:.5g}"
    named = {"file": row["file"], "verdict": verdict(row), "excitation [Hz]": excitation}
    return named | stated | levels | dict(zip(QUALITIES, quality_cells(row), strict=True))


def verdict(row: Mapping[str, Any]) -> str:
    """The result of `understood` in a word or two."""
    return "unusable" if row["problem"] else "usable, see below" if row.get("warnings") else "sound"
