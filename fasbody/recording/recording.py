"""Recordings: the accelerations of one trial, and under which condition it was made."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import file_digest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fasbody.exceptions import InputFileError, RecordingError, by_name
from fasbody.foot.shaker import plain, seconds
from fasbody.presentation import Sheet, Tabled
from fasbody.recording import files
from fasbody.recording.channels import Channel, Channels, Layout
from fasbody.recording.clock import rate_of
from fasbody.recording.columns import Columns, assign
from fasbody.recording.condition import Condition, plausible
from fasbody.recording.formats.series import Series
from fasbody.recording.known import Known
from fasbody.sentences import Sentence

#: The three columns that a recording needs, and one that it may have.
HEADER = ("time_s", "base_m_s2", "malleolus_m_s2", "tuberosity_m_s2")
#: Origin of a bare file, which states none.
UNSTATED = "of unstated origin"


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Tabled):
    """Accelerations of one trial, uniformly sampled.

    Attributes:
        time_s: (n,) sample times [s].
        base_m_s2: (n,) base acceleration.
        malleolus_m_s2: (n,) medial malleolus [m/s^2].
        tuberosity_m_s2: (n,) tibial tuberosity [m/s^2], if recorded.
        condition: how it was made.
        file: where it came from, for messages.
        origin: "measured", "synthetic" or "of unstated origin" (a bare file).
        warnings: of the checks, which do not forbid its use.
        calibration: of the channels by study.toml, by name; uncertainties are taken from
            there.
        known: measured or excluded by the laboratory beyond the recording.
        digest: sha256 of the file that it was read from, in hexadecimal; "" where there was none.
        others: (n,) of further accelerometers by name, such as ``foot`` [m/s^2].
        used: on each channel the column, unit and clock that it was made of, in words.
        unused: what else the file holds.
        part_s: first and last second that are used, counted from the start of the file; None for all.
    """

    time_s: np.ndarray
    base_m_s2: np.ndarray
    malleolus_m_s2: np.ndarray
    tuberosity_m_s2: np.ndarray | None = None
    condition: Condition = field(default_factory=Condition)
    file: str = "recording"
    origin: str = UNSTATED
    warnings: tuple[str, ...] = ()
    calibration: Mapping[str, Channel] = field(default_factory=dict)
    known: Known = field(default_factory=Known)
    digest: str = ""
    others: Mapping[str, np.ndarray] = field(default_factory=dict)
    used: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    part_s: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Arrays of any kind are kept as numpy's, and the index of a pandas Series is not looked at."""
        for name in HEADER:
            values = getattr(self, name)
            if values is not None and not isinstance(values, np.ndarray):
                object.__setattr__(self, name, np.asarray(values))
        if not all(isinstance(values, np.ndarray) for values in self.others.values()):
            object.__setattr__(self, "others", {name: np.asarray(values) for name, values in self.others.items()})

    @property
    def time(self) -> np.ndarray:
        """Short for `time_s`, as of a `Simulation`."""
        return self.time_s

    @property
    def base(self) -> np.ndarray:
        """Short for `base_m_s2`."""
        return self.base_m_s2

    @property
    def malleolus(self) -> np.ndarray:
        """Short for `malleolus_m_s2`."""
        return self.malleolus_m_s2

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return rate_of(self.time_s)

    def __str__(self) -> str:
        at = "frequency not stated" if self.condition.frequency_hz is None else f"{self.condition.frequency_hz:g} Hz"
        return f"{self.file}: {self.origin}, {at}, {self.time_s.size} samples at {self.rate_hz:g} Hz"

    def __repr__(self) -> str:
        return str(self)

    def sheet(self) -> Sheet:
        """Range and scatter of each channel, and under what it was recorded."""
        c = self.condition
        rows = [
            (name, *(f"{x:.5g}" for x in (v.min(), v.max(), v.std())))
            for name, v in self.channels.items() if name != "time_s"
        ]  # fmt: skip
        known = [f"body mass {c.body_mass_kg:g} kg"] if c.body_mass_kg else []
        known += [f"{c.added_mass_kg:g} kg on the knee"] if c.added_mass_kg else []
        notes = [", ".join([*([f"subject {c.subject}"] if c.subject else []), f"posture {c.posture}", *known])]
        return Sheet(str(self), ("channel", "least", "most", "standard deviation"), rows, [*notes, *self.warnings])

    @classmethod
    def from_arrays(
        cls,
        time_s: ArrayLike,
        base: ArrayLike,
        malleolus: ArrayLike,
        tuberosity: ArrayLike | None = None,
        *,
        others: Mapping[str, ArrayLike] | None = None,
        body_mass_kg: float | None = None,
        added_mass_kg: float = 0.0,
        frequency_hz: float | None = None,
        subject: str = "",
        posture: str = "midstance",
        name: str = "recording",
        origin: str = UNSTATED,
    ) -> "Recording":
        """A recording of arrays, numpy's, pandas' or xarray's; time may also be datetimes or time differences.

        Of a pandas Series the values count, sample by sample. Its index is not looked at, so give it as the time if it
        is that: ``Recording.from_arrays(base.index, base, malleolus, body_mass_kg=72.5, added_mass_kg=2.3)``.

        Args:
            time_s: (n,) sample times [s].
            base: (n,) acceleration of the base [m/s^2].
            malleolus: (n,) that of the malleolus [m/s^2].
            tuberosity: (n,) that of the tuberosity [m/s^2].
            others: (n,) accelerations of further sensors by name [m/s^2].
            body_mass_kg: body mass of the subject [kg].
            added_mass_kg: mass of the load on the knee [kg].
            frequency_hz: of a sine [Hz]; None lets the checks find it.
            subject: name or number of the subject.
            posture: of the foot.
            name: of the recording in messages.
            origin: "measured" or "synthetic".

        Raises:
            RecordingError: an array is no row of numbers, their lengths differ, or a mass is not plausible.
        """
        time = _seconds(time_s, name)
        if not np.all(np.diff(time) > 0):
            raise RecordingError(f"{name}: time_s does not increase from sample to sample; give the times in order.")
        inputs = {"base": base, "malleolus": malleolus, "tuberosity": tuberosity} | dict(others or {})
        rows = {channel: _row(values, channel, name) for channel, values in inputs.items() if values is not None}
        for channel, values in rows.items():
            if values.size != time.size:
                raise RecordingError(f"{name}: {channel} has {values.size} samples and time_s has {time.size}.")
        if body_mass_kg is not None:
            plausible(body_mass_kg, "body", name)
        plausible(added_mass_kg, "added", name)
        if isinstance(frequency_hz, str):
            raise RecordingError(f"{name}: the frequency is {frequency_hz!r}; give a number of hertz, such as 20.")
        condition = Condition(subject, posture, added_mass_kg, body_mass_kg, frequency_hz)
        rest = {channel: rows[channel] for channel in others or {}}
        columns = (time, rows["base"], rows["malleolus"], rows.get("tuberosity"))
        return cls(*columns, condition=condition, file=name, origin=origin, others=rest)

    @classmethod
    def from_table(cls, table: Any, layout: Layout | None = None, **about: Any) -> "Recording":
        """A recording of a whole table: pandas' DataFrame, xarray's Dataset, or a mapping of names to arrays.

        Columns are found as in a file: ``time_s``, ``base_m_s2``, ``malleolus [g]``. A unit may also stand in
        ``attrs["units"]``, of a DataFrame by column. An index that has a name, or a coordinate, is a column, too, and
        an index of datetimes or time differences is the time. Any other index is not looked at.

            Recording.from_table(frame, body_mass_kg=72.5, added_mass_kg=2.3)

        Args:
            table: the table.
            layout: the channels of its columns, where their names do not state them.
            **about: keywords of `from_arrays`: body_mass_kg, added_mass_kg, frequency_hz, subject, posture,
                name, origin.

        Raises:
            InputFileError: a channel or its unit is missing.
            RecordingError: as `from_arrays`.
        """
        name = str(about.setdefault("name", "table"))
        index = getattr(table, "index", None)
        dated = getattr(getattr(index, "dtype", None), "kind", "") in ("m", "M")
        if dated and not any(str(column).lower().startswith("time") for column in table):
            table = table.rename_axis("time_s").reset_index()
        elif getattr(index, "name", None) is not None:
            table = table.reset_index()
        units, series = getattr(table, "attrs", {}).get("units", {}), []
        for column in (*getattr(table, "coords", ()), *table):
            array = plain(table[column])
            unit = getattr(table[column], "attrs", {}).get("units")
            if not isinstance(unit, str):
                unit = units.get(column, "") if isinstance(units, dict) else ""
            if array.dtype.kind in "mM":
                array, unit = _seconds(array, name), "s"
            series.append(Series(str(column), str(unit), array))
        layout, file = layout or Layout(), Path(name)
        try:
            uses, _ = assign(file, Columns(series), layout)
        except InputFileError as error:
            if not error.code.startswith("no "):
                raise
            column = error.code.removeprefix("no ")
            remedy = (
                f"rename the column, frame.rename(columns={{'...': {column!r}}}), or name it in layout; body_mass_kg "
                "and added_mass_kg are keywords of from_table"
            )
            raise InputFileError(name, error.problem, remedy, code=error.code) from None
        rows = {key: use.factor * series[use.index].values for key, use in uses.items()}
        rows, _ = layout.aligned(file, layout.timed(file, rows))
        others = {key.removesuffix("_m_s2"): x for key, x in rows.items() if key not in HEADER}
        time, base, malleolus = (rows[key] for key in HEADER[:3])
        made = cls.from_arrays(time, base, malleolus, rows.get(HEADER[3]), others=others, **about)
        return replace(made, calibration=layout.channels, known=layout.beyond)

    @classmethod
    def read(
        cls,
        file: Path | str,
        condition: Condition | None = None,
        label: str = "",
        origin: str = UNSTATED,
        layout: Layout | None = None,
    ) -> "Recording":
        """Read a file: CSV with the header ``time_s,base_m_s2,malleolus_m_s2[,tuberosity_m_s2]``, MAT, HDF5, UFF, TDMS.

        Args:
            file: the file.
            condition: what is known of the trial.
            label: what to call it in messages, default the file's name.
            origin: "measured" or "synthetic", if that is known.
            layout: where in the file the channels are, and their units, if the file does not state them.

        Raises:
            InputFileError: no such file, or it is not such a table; the message names line and column.
        """
        path = Path(file)
        layout = (layout or Layout()).of(path)
        with by_name(label or str(file)):
            reading = files.reading(path, layout)
        channels, name = reading.channels, label or path.name
        calibration = dict(layout.channels)
        remarks, delays = _beside(path)
        for channel, std in delays.items():  # of a recording that was merged of two loggers
            stated = calibration.get(channel, Channel())
            calibration[channel] = replace(stated, delay_std_s=math.hypot(stated.delay_std_s, std))
        with path.open("rb") as raw:
            digest = file_digest(raw, "sha256").hexdigest()
        return cls(
            time_s=channels[HEADER[0]],
            base_m_s2=channels[HEADER[1]],
            malleolus_m_s2=channels[HEADER[2]],
            tuberosity_m_s2=channels.get(HEADER[3]),
            condition=condition or Condition(),
            file=name,
            origin=origin,
            warnings=(*remarks, *(Sentence(f"{name}: ", w, ".") for w in reading.warnings)),
            calibration=calibration,
            known=layout.beyond,
            digest=digest,
            others={name.removesuffix("_m_s2"): values for name, values in channels.items() if name not in HEADER},
            used=reading.used,
            unused=reading.unused,
        )

    @property
    def channels(self) -> Channels:
        """Time and accelerations by their names in `HEADER`, then those of further sensors."""
        named = {name: getattr(self, name) for name in HEADER if getattr(self, name) is not None}
        return named | {f"{name}_m_s2": values for name, values in self.others.items()}

    @property
    def accelerations(self) -> dict[str, np.ndarray]:
        """(n,) of every accelerometer by name [m/s^2]: base, malleolus, and what else there is."""
        named = self.channels.items()
        return {name.removesuffix("_m_s2"): x for name, x in named if name != "time_s"}

    @property
    def sensors(self) -> dict[str, np.ndarray]:
        """(n,) of every accelerometer but the base's by name [m/s^2], the malleolus first."""
        return {name: values for name, values in self.accelerations.items() if name != "base"}

    def with_channels(self, channels: Channels) -> "Recording":
        """The recording with other channels: by their names in `channels`, and no others than the two that it needs."""
        further = {name.removesuffix("_m_s2"): v for name, v in channels.items() if name not in HEADER}
        named = {name: channels.get(name, getattr(self, name)) for name in HEADER[:3]}
        return replace(self, **named, tuberosity_m_s2=channels.get(HEADER[3]), others=further)

    def between(self, start_s: float | None = None, end_s: float | None = None) -> "Recording":
        """The part between two times, which are counted from the first sample.

        Args:
            start_s: None for the first sample [s].
            end_s: None for the last sample [s].

        Raises:
            RecordingError: fewer than two samples lie between them.
        """
        if start_s is None and end_s is None:
            return self
        passed = self.time_s - self.time_s[0]
        first, last = start_s or 0.0, float(passed[-1]) if end_s is None else end_s
        keep = (passed >= first) & (passed <= last)
        if keep.sum() < 2:
            problem = f"{keep.sum()} samples lie between {first:g} and {last:g} s"
            raise RecordingError(f"{self.file}: {problem}; give two times between 0 and {passed[-1]:g} s.")
        part = self.with_channels({name: values[keep] for name, values in self.channels.items()})
        return replace(part, part_s=(max(first, 0.0), min(last, float(passed[-1]))))

    def write(self, file: Path, matlab: str = "5") -> None:
        """Write in the format of the file's ending; as CSV numbers are as short as they are exact to 1e-6.

        Args:
            file: to write.
            matlab: version of a .mat file, "5" or "7.3".
        """
        import pandas as pd

        from fasbody.console import write_whole

        columns = self.channels
        if file.suffix.lower() != ".csv":
            return files.write(file, columns, matlab)
        duration = abs(self.time_s[-1] - self.time_s[0])
        rate = self.time_s.size / duration if duration > 0 else 1e6  # what no analysis would use can be written, too
        digits = 3 + math.ceil(math.log10(max(1.0, rate)))  # a sample's time to a thousandth of the interval
        frame = pd.DataFrame({k: np.round(v, digits if k == "time_s" else 6) for k, v in columns.items()})
        write_whole(file, frame.to_csv(index=False))
        return None


def _row(values: ArrayLike, channel: str, name: str) -> np.ndarray:
    try:
        row = np.array(values, float)
    except (TypeError, ValueError):
        raise RecordingError(f"{name}: {channel} holds something other than numbers.") from None
    if row.ndim != 1 or row.size < 2:
        raise RecordingError(
            f"{name}: {channel} has the shape {row.shape}; a recording needs (n,), two or more samples."
        )
    return row


def _seconds(values: ArrayLike, name: str) -> np.ndarray:
    """Sample times (n,) [s]; datetimes count from the first."""
    return _row(seconds(values), "time_s", name)


def _beside(file: Path) -> tuple[tuple[str, ...], dict[str, float]]:
    """Warnings and standard deviations of delays [s] in the .json that acquisition or a merge wrote."""
    try:
        document = json.loads(file.with_suffix(".json").read_text())
        warnings, stds = document.get("warnings", ()), document.get("delay_std_s", {})
        delays = {name: float(std) for name, std in stds.items() if 0 <= float(std) <= 1}
    except (ValueError, TypeError, AttributeError, OSError):  # there is none, or of another program
        return (), {}
    texts = warnings if isinstance(warnings, list) else ()
    return tuple(text for text in texts if isinstance(text, str)), delays


def with_masses(recording: Recording, body_mass_kg: float | None, added_mass_kg: float | None) -> Recording:
    """The recording with masses given on the command line in place of the stated ones.

    Raises:
        RecordingError: a mass is not a plausible number.
    """
    condition = recording.condition
    for name, value in (("body", body_mass_kg), ("added", added_mass_kg)):
        if value is not None:
            condition = replace(condition, **{f"{name}_mass_kg": plausible(value, name, recording.file)})  # type: ignore[arg-type]
    return replace(recording, condition=condition)


def gain_and_delay(recording: Recording, out: str, into: str) -> tuple[float, float]:
    """Standard uncertainty of one channel's gain relative to another's, and of its delay behind that [s].

    The channels are taken for independent. Repeating a recording with the same sensors does not make these smaller.

    Args:
        recording: with its calibration.
        out: name of the channel.
        into: name of the channel that it is relative to.
    """
    a, b = (recording.calibration.get(name, Channel()) for name in (out, into))
    return float(np.hypot(a.gain_std, b.gain_std)), float(np.hypot(a.delay_std_s, b.delay_std_s))
