"""The study folder that recordings are put into: its names, its tables, and captures made into recordings.

`convert` is the one way for a session that ends well and for one that crashed.
"""

import csv
import io
import itertools
import json
import math
import shlex
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from fasbody.acquire import capture
from fasbody.acquire.monitor import Drive, faults, named
from fasbody.acquire.timeline import LIMITS, Quality, Timeline
from fasbody.acquire.wire import Decoder, Hello
from fasbody.console import to_json, write_whole
from fasbody.exceptions import AcquisitionError, InputFileError, RecordingError
from fasbody.presentation import counted
from fasbody.recording.checks import checked
from fasbody.recording.harmonics import find_frequency
from fasbody.recording.recording import Condition, Recording
from fasbody.recording.study_toml import read_toml

CAPTURES, RECORDINGS, TRUTH = "captures", "recordings", "truth.json"
#: Excitation begins here [Hz]; slower motion is drift and leaning.
_SLOWEST_HZ = 3.0
#: A sine that is set by hand has the stated frequency within this share.
_AS_STATED = 0.05
#: A base that moves by less [m/s^2 rms] is at rest: simple sensors have 0.03 to 0.1 of noise, the thesis shakes at 6.3.
_AT_REST = 0.2


@dataclass(frozen=True)
class Converted:
    """One recording made from captured bytes.

    Attributes:
        file: the CSV file.
        recording: its content.
        quality: what happened on the line.
        problems: why it is not listed in recordings.csv; empty if it is.
        remarks: what else should be known.
    """

    file: Path
    recording: Recording
    quality: Quality
    problems: tuple[str, ...]
    remarks: tuple[str, ...]

    def __str__(self) -> str:
        state = "unusable: " + "; ".join(self.problems) if self.problems else "good"
        notes = f" ({'; '.join(self.remarks)})" if self.remarks else ""
        return f"{self.file.name}: {counted(self.recording.time_s.size, 'sample')}, {self.quality}, {state}{notes}"

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "file": f"{RECORDINGS}/{self.file.name}",
            "samples": self.recording.time_s.size, "rate_hz": self.recording.rate_hz,
            "usable": not self.problems, "problems": list(self.problems), "remarks": list(self.remarks),
            "quality": asdict(self.quality),
        }  # fmt: skip


def convert(file: Path, study: Path, longest: bool = False, stopped: str = "") -> Converted:
    """Write the recording of a capture into a study: CSV, JSON beside it, and a row in recordings.csv if it is usable.

    Missing samples have no row in the CSV: its time column jumps there, the JSON lists the gaps, and identification
    refuses the file. Nothing is interpolated. Nor is a recording listed that is shorter than planned.

    A recording of the same name that another capture gave stays: this one gets a number.

    Args:
        file: the capture.
        study: folder, made if needed.
        longest: keep only the longest stretch without a gap, however short it is.
        stopped: why the recording ended early, if it did.

    Raises:
        InputFileError: a file cannot be read or written.
        AcquisitionError: too few samples to make a file of.
    """
    about, timeline, events = replay(file)
    known = _planned(file, about)
    origin = str(about.get("origin", "measured"))
    if about:
        _check_origin(study, origin)
    hello = timeline.hello
    planned = round(known.seconds * hello.rate_hz) if known.seconds else None
    index, values = timeline.samples()
    quality = timeline.quality(planned)
    kept = index < planned if planned else np.ones(index.size, bool)
    index, values = index[kept], values[kept]
    condition = known.condition
    pair, drive = [hello.roles.index(role) for role in ("base", "malleolus")], drive_of(about, index, values, hello)
    all_faults = faults(index, values[:, pair], hello.rate_hz, drive)
    broken = np.zeros(index.size, bool)
    for fault in all_faults:
        broken |= (index >= fault.start) & (index < fault.end)
    if longest and index.size:
        kept = _longest(index, broken)
        index, values, broken = index[kept], values[kept], broken[kept]
        all_faults = faults(index, values[:, pair], hello.rate_hz, drive)
        quality = replace(quality, gaps=())
    quality = replace(quality, faults=named(all_faults))
    if index.size < 2:
        many = "one sample" if index.size else "no samples"
        raise AcquisitionError(f"{file}: the board's description is there, but {many}; no recording can be made.")
    column = {role: values[:, i] for i, role in reversed(list(enumerate(hello.roles)))}
    recording = Recording(
        time_s=(index - index[0]) / hello.rate_hz,
        base_m_s2=column["base"],
        malleolus_m_s2=column["malleolus"],
        tuberosity_m_s2=column.get("tuberosity"),
        condition=condition,
        origin=origin,
    )
    problems, remarks = quality.problems(), quality.remarks()
    length_s = recording.time_s[-1]
    if condition.frequency_hz and length_s * condition.frequency_hz < LIMITS["periods"]:
        few = f"fewer than {LIMITS['periods']:g} periods of {condition.frequency_hz:g} Hz"
        problems.append(f"{length_s:.3g} s hold {few}")
    if not about:
        problems.append("the record of what was to be recorded is damaged: condition, origin and length are unknown")
    mass = body_mass(study, condition.subject)
    if _differ(mass, condition.body_mass_kg):
        problems.append(f"its body mass is {condition.body_mass_kg:g} kg and subjects.csv says {mass:g} kg")
    if not problems:
        problems += _refused(recording, f"{file.name.removesuffix(capture.SUFFIX)}.csv")
    unread = sum(event["bytes"] for event in events if event.get("event") == "unreadable")
    if unread:
        remarks.append(f"{counted(unread, 'unreadable byte')} in the capture")
    if planned and index[-1] < planned - 1 - hello.frame_samples:
        (remarks if longest else problems).append(f"{length_s:.3g} s are there of {about['seconds']:g} s")
        remarks += [f"ended early: {stopped.rstrip('.')}"] if stopped else []
    if problems and not longest:
        remarks += _usable(index, broken, hello.rate_hz, condition.frequency_hz)
    if longest:
        remarks.append("the longest stretch without a gap")
    table = _table_of(study, stem_of(study, file, about.get("started_utc")))
    recording.write(table)
    made = Converted(table, recording, quality, tuple(problems), tuple(remarks))
    details = {
        **{key: value for key, value in about.items() if key != "preamble"},
        "board": asdict(hello), "first_sample": int(index[0]), "events": events,
        "captures": [str(file.relative_to(study) if file.is_relative_to(study) else file)],
        "limits": LIMITS, **made.document(),
        "warnings": [f"{table.name}: {text}." for text in remarks],
    }  # fmt: skip
    write_whole(table.with_suffix(".json"), to_json(details) + "\n")
    if about:
        _enter(study, f"{RECORDINGS}/{table.name}", condition, origin, usable=not problems)
    return made


def replay(file: Path) -> tuple[dict[str, Any], Timeline, list[dict[str, Any]]]:
    """What a capture holds: its plan, its samples on a timeline, and its events."""
    about: dict[str, Any] = {}
    events: list[dict[str, Any]] = []
    decoder, timeline = Decoder(), None
    records = list(capture.read(file))
    whole = sum(len(record.content) + capture.AROUND for record in records)
    if unread := file.stat().st_size - len(capture.MAGIC) - whole:
        events.append({"event": "unreadable", "file": file.name, "bytes": unread})
    for record in records:
        if record.kind == "M" and not about:
            about = record.json()
            try:
                decoder = Decoder(bytes.fromhex(str(about.get("preamble", ""))))
            except ValueError:
                raise InputFileError(file, "its first record has no readable hello of the board") from None
        elif record.kind == "E":
            event = record.json()
            events.append({"host_s": record.host, **event})
            decoder.fresh()
            if timeline is not None:
                events[-1]["after_s"] = timeline.length / timeline.hello.rate_hz
                timeline.note(str(event.get("event")))
        elif record.kind == "B":
            messages = decoder.feed(record.content)
            if timeline is None and decoder.hello is not None:
                timeline = Timeline(decoder.hello)
            if timeline is not None:
                timeline.add(messages, record.host)
    if timeline is None and decoder.hello is not None:
        timeline = Timeline(decoder.hello)
    if timeline is None:
        raise InputFileError(file, "holds no hello of a board", "nothing in it can be read as samples")
    return about, timeline, events


def drive_of(about: Mapping[str, Any], index: np.ndarray, values: np.ndarray, hello: Hello) -> Drive:
    """What the shaker was to do, by a capture's first record; a sine set by hand is as it is, if about as stated."""
    frequency, level = about.get("condition", {}).get("frequency_hz"), (about.get("level") or {}).get("peak_to_peak")
    one_mass = bool(about.get("one_mass"))
    if frequency and level:
        return Drive(frequency, 0.5 * level, one_mass)
    if frequency and index.size * frequency > 3 * hello.rate_hz:
        base = values[:, hello.roles.index("base")]
        shaken = find_frequency(index / hello.rate_hz, base - base.mean())
        if abs(shaken / frequency - 1) < _AS_STATED:
            return Drive(shaken, None, one_mass)
    return Drive(one_mass=one_mass)


@dataclass(frozen=True)
class _Planned:
    condition: Condition = field(default_factory=Condition)
    seconds: float | None = None


def _planned(file: Path, about: Mapping[str, Any]) -> _Planned:
    """Refuse a plan of senseless content, which acquisition never writes."""
    try:
        return TypeAdapter(_Planned).validate_json(json.dumps(about), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        place = " ".join(map(str, first["loc"]))
        raise InputFileError(file, f"its plan has {place} {first['input']!r}", first["msg"].lower()) from None


def _longest(index: np.ndarray, broken: np.ndarray) -> np.ndarray:
    """Mask of the longest run of consecutive indices without a break; all, if there is none."""
    if broken.all():
        broken = np.zeros_like(broken)
    runs = np.concatenate([[0], np.cumsum((np.diff(index) != 1) | np.diff(broken))])
    return runs == np.argmax(np.bincount(runs, weights=~broken))


def _usable(
    index: np.ndarray, broken: np.ndarray, rate_hz: float, frequency_hz: float | None
) -> list[str]:
    """How much of a recording with gaps or breaks, or of one that ended early, `recover --longest` would keep."""
    run = index[_longest(index, broken)]
    seconds = (run[-1] - run[0]) / rate_hz
    if frequency_hz and seconds * frequency_hz < LIMITS["periods"]:
        return [f"usable: nothing, its longest stretch without a gap has {seconds:.3g} s"]
    return [f"usable: {seconds:.3g} s without a gap from {run[0] / rate_hz:.3g} s on; recover --longest keeps them"]


def _refused(recording: Recording, name: str) -> list[str]:
    """Reasons why identification would refuse a recording at a known frequency; without one, whether it was shaken."""
    if recording.condition.frequency_hz is None:
        return [text] if (text := at_rest(recording)) else []
    try:
        checked(replace(recording, file=name))
    except RecordingError as error:
        return [error.reason.removesuffix(".")]
    return []


def at_rest(recording: Recording) -> str:
    """Why a recording without a stated frequency (broadband, or by hand) shows no excitation, or nothing."""
    base = recording.base_m_s2 - recording.base_m_s2.mean()
    spectrum = np.fft.rfft(base)
    frequency = np.fft.rfftfreq(base.size, 1 / recording.rate_hz)
    rms = float(np.sqrt(2 * np.sum(np.abs(spectrum[frequency >= _SLOWEST_HZ]) ** 2)) / base.size)
    if rms >= _AT_REST:
        return ""
    return f"the base is at rest ({rms:.2g} m/s^2 rms above {_SLOWEST_HZ:g} Hz); was the shaker on"


def recovery(files: Sequence[Path]) -> str:
    """The command that makes recordings of captures."""
    return f"fasbody recover {shlex.join(map(str, files))}"


def left_behind(study: Path) -> list[Path]:
    """Captures of a study of which no recording was made, as after a crash."""
    made = {_source(study, file)[0] for file in study.glob(f"{RECORDINGS}/*.json")}
    files = study.glob(f"{CAPTURES}/*{capture.SUFFIX}")
    return sorted(file for file in files if file.resolve() not in made)


def _source(study: Path, details: Path) -> tuple[Path | None, str | None]:
    """The capture that a recording was made of, by the JSON beside it, and when that began."""
    try:
        document = json.loads(details.read_text())
        return (study / str(document["captures"][0])).resolve(), document.get("started_utc")
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return None, None


def free_stem(study: Path, stem: str) -> str:
    """A name that neither captures nor recordings have yet: stem, stem_2, stem_3 ..."""
    taken = (_capture_of, _table_of)
    return next(n for n in _numbered(stem) if not any(file(study, n).exists() for file in taken))


def stem_of(study: Path, file: Path, started: str | None) -> str:
    """Name for the recording of a capture: the one it has already, else the first that is nobody else's.

    Args:
        study: folder.
        file: the capture.
        started: when it began, by its first record; distinguishes two captures of one name.
    """
    stem = file.name.removesuffix(capture.SUFFIX)
    return next(name for name in _numbered(stem) if _is_of(study, name, file, started))


def _numbered(stem: str) -> Iterator[str]:
    return itertools.chain([stem], (f"{stem}_{number}" for number in itertools.count(2)))


def _capture_of(study: Path, stem: str) -> Path:
    return study / CAPTURES / f"{stem}{capture.SUFFIX}"


def _table_of(study: Path, stem: str) -> Path:
    return study / RECORDINGS / f"{stem}.csv"


def _is_of(study: Path, stem: str, file: Path, started: str | None) -> bool:
    """Whether a name is, or can become, that of this capture's recording: by the JSON of the one that there is."""
    table, capture_file = _table_of(study, stem), _capture_of(study, stem)
    if not table.exists():
        return not capture_file.exists() or capture_file.resolve() == file.resolve()
    source, began = _source(study, table.with_suffix(".json"))
    if source is None or began is not None or started is not None:
        return source is not None and began == started
    return source == file.resolve()


def check(study: Path, condition: Condition, origin: str, truth: Mapping[str, Any] | None) -> None:
    """Refuse a study that cannot take recordings of this condition, origin and (if synthetic) truth."""
    if study.exists() and not study.is_dir():
        raise InputFileError(study, "is a file where the study cannot be written", "name a folder")
    if truth is not None:
        _check_truth(study, truth)
    _check_origin(study, origin)
    known = body_mass(study, condition.subject)
    if _differ(known, condition.body_mass_kg):
        problem = f"subject {condition.subject!r} has {known:g} kg, and {condition.body_mass_kg:g} kg are given"
        raise InputFileError(study / "subjects.csv", problem, "give the same, or correct the table")


def _check_truth(study: Path, truth: Mapping[str, Any]) -> None:
    file = study / TRUTH
    if not file.is_file():
        return
    try:
        same = json.loads(file.read_text()) == json.loads(to_json(truth))
    except (OSError, ValueError):
        same = False
    if not same:
        problem = "is the truth of another study than the virtual bench's"
        raise InputFileError(file, problem, "name another folder")


def _check_origin(study: Path, origin: str) -> None:
    file = study / "study.toml"
    if not file.is_file():
        return
    stated = read_toml(file).get("study", {}).get("origin", "measured")
    if stated != origin:
        raise InputFileError(file, f"is not {origin} data", f"name another folder for {origin} recordings")


def check_writable(study: Path) -> None:
    """Make the folders of a study, and write to each."""
    for place in (study / CAPTURES, study / RECORDINGS):
        try:
            place.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=place) as trial:
                trial.write(b"\0" * 4096)
        except OSError as error:
            raise InputFileError(place, f"cannot be written ({error.strerror})", "name a writable folder") from None


def enter_truth(study: Path, truth: Mapping[str, Any]) -> None:
    """Write the truth of a synthetic study."""
    _check_truth(study, truth)
    write_whole(study / TRUTH, to_json(truth) + "\n")


def body_mass(study: Path, subject: str) -> float | None:
    """Body mass [kg] of a subject that the study lists already."""
    file = study / "subjects.csv"
    if file.is_file():
        for row in csv.DictReader(io.StringIO(file.read_text())):
            if row.get("subject") == subject and row.get("mass_kg"):
                try:
                    return float(row["mass_kg"])
                except ValueError:
                    raise InputFileError(file, f"mass_kg is {row['mass_kg']!r}, not a number") from None
    return None


def _differ(known: float | None, stated: float | None) -> bool:
    """Whether two body masses [kg] are not the same, one of them as the table prints it."""
    return known is not None and stated is not None and not math.isclose(known, stated, rel_tol=1e-5)


def begin(study: Path, origin: str) -> None:
    """Write study.toml, if there is none."""
    if not (study / "study.toml").is_file():
        title = json.dumps(study.resolve().name)
        text = f'[study]\nname = {title}\norigin = "{origin}"\ndescription = "Recorded by fasbody record."\n'
        write_whole(study / "study.toml", text)


def _enter(study: Path, name: str, condition: Condition, origin: str, usable: bool) -> None:
    begin(study, origin)
    subject = {"subject": condition.subject, "mass_kg": _text(condition.body_mass_kg)}
    _put(study / "subjects.csv", subject, keep=True)
    row = {
        "file": name, "subject": condition.subject, "posture": condition.posture,
        "added_mass_kg": _text(condition.added_mass_kg), "frequency_hz": _text(condition.frequency_hz),
    }  # fmt: skip
    _put(study / "recordings.csv", row, listed=usable)


def _put(file: Path, row: dict[str, str], keep: bool = False, listed: bool = True) -> None:
    """Put a row into a table in place of the one of the same first cell; other rows and columns stay as they are.

    Args:
        file: the table.
        row: its new row.
        keep: leave a row of the same first cell as it is.
        listed: put the new one in; otherwise only remove the old one.
    """
    key, columns, rows = next(iter(row)), list(row), []
    if file.is_file():
        reader = csv.DictReader(io.StringIO(file.read_text()))
        columns, rows = list(reader.fieldnames or columns), list(reader)
    others = [entry for entry in rows if entry.get(key) != row[key]]
    if not keep or len(others) == len(rows):
        rows = [*others, row] if listed else others
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(file, out.getvalue())


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
