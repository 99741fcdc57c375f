"""Is a recording fit for identification? Each problem gets one sentence: the file, the place and the remedy."""

import functools
from collections.abc import Iterable, Mapping, Sequence
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
from fasbody.recording.quality import Quality, quality, still
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
#: Codes of warnings of a unit that may be wrong: of a base between a fifth of a m/s^2 and two, and of other values.
_IN_G, UNIT_IN_DOUBT = "in g", "unit in doubt"
_CHECK_UNIT = "check its unit."
#: A passive foot lags behind its base; it may seem to lead by so much where loggers take channels one by one [deg].
_LEAD_DEG = 1.0
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

    Raises:
        RecordingError: it cannot serve: too short, time not uniform, NaN, dead, clipped, wrong units, excitation not
            found, sampled too slowly, or channels not aligned. A further accelerometer that cannot serve is left out.
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
    """The same of all channels alike."""
    with by_name(recording.file):
        return _all_alike(recording)


def _all_alike(recording: Recording) -> Recording:
    warnings = list(recording.warnings)
    for name in recording.channels:
        if name != "time_s":
            _possible(recording, name)
    recording, remark = uniform(recording)
    warnings += [remark] if remark else []
    _time(recording)
    channels = {name: values for name, values in recording.channels.items() if name != "time_s"}
    for name, values in channels.items():
        _channel(recording, name, values)
        peak = float(np.abs(values).max())
        if peak > _UNLIKELY:
            size = f"{recording.file}: {name} reaches {peak:.3g} m/s^2, more than a foot on a shaker does; "
            warnings.append(Sentence(size, _CHECK_UNIT, code=UNIT_IN_DOUBT))
        if abs(values.mean()) > 0.5:
            kind = "gravity" if abs(abs(values.mean()) - 9.81) < 1 else "an offset"
            warnings.append(f"{recording.file}: {name} has {kind} of {values.mean():.3g} m/s^2, which is taken out.")
        channels[name] = values - values.mean()
    offsets = {name: float(recording.channels[name].mean()) for name in channels}
    recording = recording.with_channels(channels)
    base_hz = find_frequency(recording.time_s, recording.base_m_s2)
    share = narrow_share(recording.time_s, recording.base_m_s2, base_hz)
    _moving(recording, channels, base_hz if share > 0.5 else None)
    frequency = _excitation(recording, base_hz, share, warnings)
    for name in channels:
        interval = _slow(recording, name, frequency, warnings)
        _clipping(recording, name, frequency, interval)
        if interval == 1:
            _odd(recording, name, frequency, offsets[name], warnings)
    if frequency is not None:
        _level(recording, frequency, warnings)
    about = quality_of(recording, frequency)
    _quality(recording, about, frequency, warnings)
    if frequency is not None:
        _cost(recording, about, frequency, warnings)
    condition = replace(recording.condition, frequency_hz=frequency)
    return replace(recording, condition=condition, warnings=tuple(warnings))


def gathered(texts: Sequence[str]) -> list[str]:
    """Warnings of several recordings; that of values like g stands there once."""
    like_g = [text for text in texts if code_of(text) == _IN_G]
    if len(like_g) < 2:
        return list(texts)
    first = Sentence(like_g[0], f" The same in {len(like_g) - 1} more recordings.", code=_IN_G)
    return [first if text == like_g[0] else text for text in texts if text == like_g[0] or text not in like_g]


def unit_in_doubt(warnings: Iterable[Sequence[str]]) -> str:
    """That the values of recordings seem to have another unit, in a sentence; nothing where they do not.

    Args:
        warnings: of the checks, for each recording.
    """
    doubts = [[text for text in texts if code_of(text) in (_IN_G, UNIT_IN_DOUBT)] for texts in warnings]
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


def quality_of(recording: Recording, frequency_hz: float | None) -> Quality:
    """Coherence, distortion, drift and level by segment of a recording without offsets."""
    channels = {name.removesuffix("_m_s2"): x for name, x in recording.channels.items() if name != "time_s"}
    return quality(recording.time_s, channels, frequency_hz)


def judged(recording: Recording) -> dict[str, Any]:
    """Length, rate and excitation; the problem, if any, and the warnings."""
    row: dict[str, Any] = {"file": recording.file, "problem": "", "warnings": []}
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
    try:
        with by_name(recording.file):
            return row | _measured(recording if row["problem"] else checked(recording), bool(row["problem"]))
    except RecordingError as error:
        return row | {"problem": row["problem"] or error.sentence}


def _measured(good: Recording, unfit: bool) -> dict[str, Any]:
    levels = {name.removesuffix("_m_s2"): float(np.std(x)) for name, x in good.channels.items() if name != "time_s"}
    if unfit:
        return {"rms_m_s2": levels}
    frequency = good.condition.frequency_hz
    share = sine_share(good.time_s, good.base_m_s2, frequency or find_frequency(good.time_s, good.base_m_s2))
    about = quality_of(good, frequency)
    sine = {} if frequency is None else {"transmissibility": about.ratio, "phase_deg": about.lead_deg}
    return {"rms_m_s2": levels, "sine_share": share, "quality": about.row()} | sine


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
        rows = []
        for row in sorted(self.rows, key=lambda row: (not row["problem"], not row.get("warnings"))):
            frequency = row.get("frequency_hz")
            at = "" if row["problem"] else "broadband" if frequency is None else f"{frequency:.5g}"
            rate = f"{row['rate_hz']:.6g}" if "rate_hz" in row else ""
            rows.append((row["file"], str(row.get("samples", "")), rate, at, *quality_cells(row), verdict(row)))
        sound = sum(verdict(row) == "sound" for row in self.rows)
        notes = [
            *self.problems,
            *self.remarks,
            *gathered([text for row in self.rows for text in row.get("warnings", ())]),
        ]
        columns = ("file", "samples", "rate [Hz]", "excitation [Hz]", *QUALITIES, "verdict")
        return Sheet(f"{self.name}: {sound} of {len(self.rows)} recordings are sound", columns, rows, notes)


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


def verdict(row: Mapping[str, Any]) -> str:
    """The result of `understood` in a word or two."""
    return "unusable" if row["problem"] else "usable, see below" if row.get("warnings") else "sound"


def _time(recording: Recording) -> None:
    t = recording.time_s
    if t.size < 50:
        raise RecordingError(
            problem=f"has {t.size} samples, too short",
            remedy="record at least three periods (the thesis: 10 s)",
        )
    if not np.isfinite(t).all():
        raise RecordingError(problem=f"time is not a number at sample {int(np.argmin(np.isfinite(t)))}")
    steps = np.diff(t)
    if t[-1] <= t[0] and (steps <= 0).all():
        runs = "stands still" if t[-1] == t[0] else "runs backwards"
        raise RecordingError(
            problem=f"time {runs} ({t[0]:g} s first, {t[-1]:g} s last)",
            remedy="sort the rows by time",
        )
    if steps.min() <= 0:
        place = int(np.argmin(steps)) + 1
        raise RecordingError(
            problem=f"time does not increase at sample {place} ({t[place - 1]:g} s, then {t[place]:g} s)"
        )
    if recording.rate_hz < SLOWEST_HZ:
        raise RecordingError(
            problem=f"is sampled at {recording.rate_hz:.3g} Hz over {t[-1] - t[0]:.4g} s; needed are "
            f"{SLOWEST_HZ:g} Hz "
            "(if the time is in ms, name the column time_ms)",
        )
    typical = float(np.median(steps))
    # Printed time stamps are rounded: allow one unit of a coarse last digit, but no missing sample.
    if np.abs(steps - typical).max() > 0.5 * typical:
        place = int(np.argmax(np.abs(steps - typical)))
        count = int((np.abs(steps - typical) > 0.5 * typical).sum())
        places = "place" if count == 2 else "places"
        more = f" (and so at {count - 1} more {places})" if count > 1 else ""
        raise RecordingError(
            problem=f"time is not uniform: {steps[place]:g} s after {t[place]:g} s (sample {place + 1} of "
            f"{t.size}), elsewhere "
            f"{typical:g} s; samples are missing or channels have different rates{more}",
        )


def _possible(recording: Recording, name: str) -> None:
    """Refuse samples that are none, before anything is computed with them."""
    values = recording.channels[name]
    if values.shape != recording.time_s.shape:
        raise RecordingError(problem=f"{name} has {values.size} samples and time has {recording.time_s.size}")
    if not np.isfinite(values).all():
        place = int(np.argmin(np.isfinite(values)))
        raise RecordingError(
            problem=f"{name} is {values[place]} at {recording.time_s[place]:g} s; every sample must be finite"
        )
    peak = float(np.abs(values).max())
    if peak > _IMPOSSIBLE:
        raise RecordingError(
            problem=f"{name} reaches {peak:.3g} m/s^2 at {recording.time_s[np.abs(values).argmax()]:g} s, which "
            f"no body does "
            f"(at most {_IMPOSSIBLE:.0e} is read); check its unit and sensitivity",
        )


def _channel(recording: Recording, name: str, values: np.ndarray) -> None:
    spread = values.std()
    if spread < 1e-3:
        raise RecordingError(
            problem=f"{name} is dead (it varies by {np.ptp(values):.2g} m/s^2); check the cable and the units"
        )
    if (levels := np.unique(values).size) < 3 or (levels < 8 and samples.step(values)):
        raise RecordingError(
            problem=f"{name} is dead or too coarse: it takes {levels} values only; check the cable, and that "
            f"its numbers "
            "were saved with their decimals",
        )


def _clipping(recording: Recording, name: str, frequency: float | None, interval: float) -> None:
    """Refuse flat tops: longer runs at an extreme value than the converter's step gives a sine, in many periods.

    A channel with one measured sample in several (`interval`) stays so much longer at its top.
    """
    values, t = recording.channels[name], recording.time_s
    levels = np.unique(values)
    step, size = float(np.diff(levels).min()), 0.5 * float(np.ptp(values))
    shortest: float = _CLIPPED_RUN
    if frequency is not None:  # how long a quantised sine stays at its top, and one sample more at each end
        shortest = int(np.ceil(2 * np.sqrt(2 * min(step / size, 1)) / (2 * np.pi * frequency) * recording.rate_hz)) + 2
        shortest = max(3, shortest)
    shortest = shortest if interval == 1 else (shortest + 1) * interval
    periods = 10 if frequency is None else (t[-1] - t[0]) * frequency
    for extreme in (levels[-1], levels[0]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], (values == extreme).view(np.int8), [0]])))
        runs = edges[1::2] - edges[::2]
        count = int((runs >= shortest).sum())
        if count >= max(2, 0.2 * periods):
            place = t[edges[::2][np.argmax(runs)]]
            raise RecordingError(
                problem=f"{name} is clipped {count} times, for up to {runs.max()} samples near {place:g} s; "
                "record with a larger range",
            )


def _odd(recording: Recording, name: str, frequency: float | None, offset: float, warnings: list[str]) -> None:
    """Marks that stand for missing samples are refused; spikes and jumps give warnings with their effect."""
    t, values = recording.time_s, recording.channels[name]
    odd = samples.odd(values, None if frequency is None else (t[-1] - t[0]) * frequency)
    if odd.mark is not None:
        raise RecordingError(
            problem=f"{name} is {odd.mark + offset:.6g} m/s^2 at {odd.spikes.size} places, first at "
            f"{t[odd.spikes[0]]:.4g} s, and near it nowhere else: a mark for missing samples; cut them off, or fill "
            "them before",
        )
    if odd.spikes.size:
        changed = 1.0 if frequency is None else samples.cost(t, values, frequency, odd.spikes)
        costs = "" if frequency is None else (
            f", which change the amplitude of its sine by {100 * abs(changed) - 100:+.2g} % and its phase by "
            f"{np.degrees(np.angle(changed)):+.2g} degrees"
        )  # fmt: skip
        spikes = "a spike" if odd.spikes.size == 1 else f"{odd.spikes.size} spikes"
        warnings.append(
            f"{recording.file}: {name} has {spikes} of up to {odd.size:.3g} m/s^2, the first at "
            f"{t[odd.spikes[0]]:.4g} s{costs}."
        )
    elif odd.jumps.size:
        more = f" and at {odd.jumps.size - 1} more places" * (odd.jumps.size > 1)
        warnings.append(
            f"{recording.file}: {name} jumps by {odd.size:.3g} m/s^2 at {t[odd.jumps[0]]:.4g} s{more}; are samples "
            "missing there? Then what is behind them comes early, and its phase leads."
        )


def _slow(recording: Recording, name: str, frequency: float | None, warnings: list[str]) -> float:
    """Warn of a channel with one measured sample in several of the file (returned), and of coarse steps."""
    values, rate, f = recording.channels[name], recording.rate_hz, frequency or 20.0
    grid = samples.step(values)
    slow = samples.slow(values, grid)
    if slow is not None and frequency and rate / slow.interval < OVERSAMPLING * frequency:
        slow = None  # four samples a period can be equal in pairs by themselves
    if slow is not None:
        change, delay_s = slow.effect(f, rate)
        kept = "held until the next one" if slow.held else "joined by straight lines"
        late = f", {360 * f * delay_s:.3g} degrees late" * slow.held
        delay = called(f"channels.{name.removesuffix('_m_s2')}.delay_s", f"{delay_s:.3g}")
        hint = [", or give ", delay] if slow.held else []
        size = (
            f"{recording.file}: {name} was sampled at {rate / slow.interval:.4g} Hz and is {kept}: a sine of "
            f"{f:.4g} Hz is {-100 * change:.2g} % too small by that{late}; record all channels at one rate"
        )
        warnings.append(Sentence(size, *hint, "."))
    elif frequency and (error := samples.by_steps(values, grid, frequency, rate)) > _COARSE:
        warnings.append(
            f"{recording.file}: {name} has steps of {grid:.3g} m/s^2 (its converter, or numbers saved "
            f"with few digits), which leave its amplitude uncertain by {100 * error:.2g} %, whatever the interval says."
        )
    return 1.0 if slow is None else slow.interval


def _moving(recording: Recording, channels: Mapping[str, np.ndarray], frequency: float | None) -> None:
    """Refuse a sensor that stands still for a part of the recording while another moves."""
    stands = still(recording.time_s, dict(channels), frequency)
    if stands:
        name, start, end = stands
        raise RecordingError(
            problem=f"{name} stands still from {start:.4g} to {end:.4g} s while another channel moves; cut this "
            f"part off, or "
            "check sensor and cable",
        )


def _quality(recording: Recording, measures: Quality, frequency: float | None, warnings: list[str]) -> None:
    """Warnings by coherence, distortion, drift and level: flattened tops, channels swapped or uneven."""
    at = "over the band" if frequency is None else f"at {frequency:.4g} Hz"
    base, malleolus = measures.channels["base"], measures.channels["malleolus"]
    _, delay_std = gain_and_delay(recording, "malleolus", "base")
    sure = 3 * np.hypot(measures.lead_std_deg, 360 * (frequency or 20.0) * delay_std)
    size = malleolus.level_m_s2.mean() / base.level_m_s2.mean() if base.level_m_s2.size else 1.0
    leads = measures.lead_deg > _LEAD_DEG + sure and not (frequency and _late(size, measures.lead_deg))
    if leads and measures.coherence > _COHERENT[False]:
        raise RecordingError(
            problem=f"the malleolus leads the base by {measures.lead_deg:.1f} degrees {at}, which no passive foot does",
            remedy=Sentence(
                "the channels are swapped or misaligned (", called("channels.column, channels.delay_s"), ")"
            ),
        )
    for name, channel in measures.channels.items():
        flat, base_distortion = channel.flat_tops, base.distortion
        one_sided = flat < _TWO_SIDED * channel.distortion
        if name != "base" and flat > max(_FLAT_TOPS, _MORE_THAN_BASE * base_distortion) and not one_sided:
            raise RecordingError(
                problem=f"{name}_m_s2 has flattened tops {at} (a third harmonic of {100 * flat:.1f} % in phase with "
                f"them, base "
                f"{100 * base_distortion:.1f} %): its sensor saturates; record with a larger range",
            )
        if name != "base" and flat > max(_SUSPECT_TOPS, _MORE_THAN_BASE * base_distortion):
            tops = f"(a third harmonic of {100 * flat:.1f} % in phase with them)"
            warnings.append(
                f"{recording.file}: {name}_m_s2 has flattened tops on one side {at} {tops}; a foot that leaves the "
                "plate makes them, and so does a sensor that saturates on one side."
                if one_sided and flat > _FLAT_TOPS
                else f"{recording.file}: {name}_m_s2 has slightly flattened tops {at} {tops}; a sensor that begins to "
                "saturate reads too little."
            )
        if channel.distortion > _DISTORTED:
            warnings.append(
                f"{recording.file}: {name}_m_s2 has harmonics of {100 * channel.distortion:.0f} % of its fundamental."
            )
        if channel.drift > (_DRIFTS if frequency else 1.0):
            warnings.append(f"{recording.file}: {name}_m_s2 drifts by {100 * channel.drift:.0f} % of its amplitude.")
        if frequency and channel.unsteady > _UNSTEADY and channel.level_m_s2.size > 1:
            low, high = channel.level_m_s2.min(), channel.level_m_s2.max()
            warnings.append(
                f"{recording.file}: the level of {name}_m_s2 is not steady, {low:.3g} to {high:.3g} m/s^2 by segment."
            )
    if base.flat_tops > _FLAT_TOPS and malleolus.flat_tops < 0.1 * base.flat_tops:
        warnings.append(
            f"{recording.file}: base_m_s2 has flattened tops {at} and the malleolus none; does its sensor saturate?"
        )
    if measures.coherence < _COHERENT[frequency is not None]:
        warnings.append(
            f"{recording.file}: the coherence of malleolus and base is {measures.coherence:.2f} {at}; noise, or a foot "
            "that does not answer its base alike."
        )


def _excitation(recording: Recording, hz: float, share: float, warnings: list[str]) -> float | None:
    """Excitation frequency [Hz] found in the base channel, None for broadband; it must agree with the table."""
    t = recording.time_s
    nominal = recording.condition.frequency_hz
    if share < PERIODIC_SHARE:
        if nominal is None:
            return None
        raise RecordingError(
            problem=f"the excitation of {nominal:g} Hz is not found in base_m_s2 (a sine explains "
            f"{100 * share:.0f} % of its "
            f"power); leave frequency_hz empty for broadband excitation",
        )
    if nominal is not None and abs(hz - nominal) > max(0.02 * nominal, 1.5 / (t[-1] - t[0])):
        raise RecordingError(problem=f"base_m_s2 vibrates at {hz:.4g} Hz and recordings.csv says {nominal:g} Hz")
    if hz > _FASTEST_HZ:
        warnings.append(
            f"{recording.file}: base_m_s2 vibrates at {hz:.4g} Hz, faster than any foot is shaken; check the unit "
            "of its time."
        )
    if recording.rate_hz < OVERSAMPLING * hz * (1 - 1e-3):
        raise RecordingError(
            problem=f"is sampled at {recording.rate_hz:g} Hz, less than {OVERSAMPLING} times its excitation of "
            f"{hz:.4g} Hz",
        )
    if recording.rate_hz < COMFORTABLE * hz * (1 - 1e-3):
        warnings.append(_folded(recording, hz))
    if (t[-1] - t[0]) * hz < 3:
        raise RecordingError(problem=f"is too short: {(t[-1] - t[0]) * hz:.1f} periods of {hz:.4g} Hz, needed are 3")
    return hz


def _folded(recording: Recording, frequency: float) -> str:
    """What sampling below ten times the frequency costs."""
    rate, seconds = recording.rate_hz, recording.time_s[-1] - recording.time_s[0]
    folded = [
        h for h in range(2, 11)
        if abs(abs(h * frequency - rate * round(h * frequency / rate)) - frequency) < 2 / seconds
    ]  # fmt: skip
    text = (
        f"{recording.file}: sampled at {rate:.5g} Hz, {rate / frequency:.3g} times its excitation of {frequency:.4g} Hz"
    )
    if folded:
        return (
            f"{text}: its harmonic {folded[0]} folds onto the excitation itself and biases it by its own share, which "
            "the interval does not hold; choose another rate."
        )
    return f"{text}: the sine fit needs no more, but harmonics above {rate / 2:.4g} Hz fold and are not told apart."


def _cost(recording: Recording, measures: Quality, frequency: float, warnings: list[str]) -> None:
    """What noise, drift and a wandering shaker cost, in the interval of the ratio."""
    share = sine_share(recording.time_s, recording.base_m_s2, frequency)
    if share < _CLEAN:
        half = Z95 * measures.lead_std_deg
        warnings.append(
            f"{recording.file}: {100 * (1 - share):.0f} % of the power of base_m_s2 is neither the excitation nor its "
            f"harmonics (noise, drift, or a shaker that wanders): the malleolus over the base is known to "
            f"{100 * np.radians(half):.2g} % and {half:.2g} degrees, or better where the wander is common to both."
        )


def _late(size: float, lead_deg: float) -> bool:
    """Whether a lead is a lag of 180 to 270 degrees, as two masses have above both resonances: they move little."""
    return lead_deg > 90 and size < _ABOVE


def _level(recording: Recording, frequency: float, warnings: list[str]) -> None:
    """Amplitudes and phase that a foot on a shaker can have."""
    t = recording.time_s
    fits = [fit_harmonics(t, channel, frequency, 1) for channel in (recording.base_m_s2, recording.malleolus_m_s2)]
    base, malleolus = (fitted.amplitudes[0] for fitted in fits)
    onset = max(fitted.onset for fitted in fits)
    if onset > _ONSET:
        transient = (
            f"{recording.file}: its first tenth differs from the rest by {100 * onset:.0f} % (a start-up transient?); "
            "cut it off, or use "
        )
        warnings.append(Sentence(transient, called("domain", "time"), "."))
    ratio = malleolus / base
    if not 0.02 < abs(ratio) < 20:
        raise RecordingError(
            problem=f"the malleolus moves {abs(ratio):.3g} times as much as the base at {frequency:.4g} Hz; "
            "check units and sensitivities (m/s^2 are expected, or g with the header malleolus_g)",
        )
    if not 2 < abs(base) < 40:
        like_g = 0.2 < abs(base) <= 2
        size = (
            f"{recording.file}: the base amplitude is {abs(base):.3g} m/s^2 at {frequency:.4g} Hz (the thesis: 8.95); "
        )
        hint = "is it in g? Then name the column base_g." if like_g else _CHECK_UNIT
        warnings.append(Sentence(size, hint, code=_IN_G if like_g else UNIT_IN_DOUBT))
    lead = np.degrees(np.angle(ratio))
    if why := samples.impossible(ratio):
        motion = (
            f"{recording.file}: the malleolus moves {abs(ratio):.3g} times as much as the base and lags it by "
            f"{-lead:.3g} degrees at {frequency:.4g} Hz: {why}; "
        )
        warnings.append(Sentence(motion, _CHECK_UNIT, code=UNIT_IN_DOUBT))
    if _late(abs(ratio), lead):
        lag = (
            f"{recording.file}: the malleolus lags the base by {360 - lead:.0f} degrees at {frequency:.4g} Hz, more "
            "than half a turn: a foot well above its resonance does, and so does a wrong sign ("
        )
        warnings.append(Sentence(lag, called("channels.sign"), ")."))
    elif lead > 10:
        early = lead / 360 / frequency
        raise RecordingError(
            problem=f"the malleolus leads the base by {lead:.0f} degrees ({1e3 * early:.3g} ms) at "
            f"{frequency:.4g} Hz, "
            "which no passive foot does",
            remedy=Sentence(
                "the channels are swapped, misaligned or one has the wrong sign (",
                called("channels.sign, channels.delay_s"),
                ")",
            ),
        )
