"""From capture files to a recording: the one way for a session that ends well and for one that crashed."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.acquire import capture, folder
from fasbody.acquire.excitation import absent
from fasbody.acquire.timeline import Limits, Quality, Timeline, counted
from fasbody.acquire.wire import Decoder, Hello
from fasbody.console import to_json, write_whole
from fasbody.exceptions import AcquisitionError, InputFileError, RecordingError
from fasbody.recording.checks import checked
from fasbody.recording.recording import Condition, Recording


@dataclass(frozen=True)
class Converted:
    """One recording made from captured bytes.

    Attributes:
        file: the CSV file. recording: its content. quality: what happened on the line.
        problems: why it is not listed in recordings.csv; empty if it is. remarks: what else should be known.
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
            "file": f"{folder.RECORDINGS}/{self.file.name}",
            "samples": self.recording.time_s.size, "rate_hz": self.recording.rate_hz,
            "usable": not self.problems, "problems": list(self.problems), "remarks": list(self.remarks),
            "quality": self.quality.document(),
        }  # fmt: skip


def replay(files: Sequence[Path]) -> tuple[dict[str, Any], Timeline, list[dict[str, Any]]]:
    """What a capture holds: its plan, its samples on a timeline, and its events.

    Raises:
        InputFileError: no capture file, one without a plan and a hello, one given twice, or two recordings.
    """
    about: dict[str, Any] = {}
    events: list[dict[str, Any]] = []
    decoder, timeline = Decoder(), None
    if len({file.resolve() for file in files}) < len(files):
        raise InputFileError(files[0], "is given twice", "name each capture file once")
    for number, file in enumerate(files):
        records = list(capture.read(file))
        if number and any(record.kind == "M" for record in records):
            raise InputFileError(file, f"is a recording of its own, not the rest of {files[0]}", "convert it by itself")
        whole = sum(len(record.content) + capture.AROUND for record in records)
        lost = file.stat().st_size - len(capture.MAGIC) - whole
        if lost:
            events.append({"event": "unreadable", "file": file.name, "bytes": lost})
        for record in records:
            if record.kind == "M" and not about:
                about = record.json()
                try:
                    decoder = Decoder(bytes.fromhex(str(about.get("preamble", ""))))
                except ValueError:
                    raise InputFileError(file, "its first record has no readable hello of the board") from None
            elif record.kind == "E":
                events.append({"host_s": record.host, **record.json()})
                decoder.fresh()
            elif record.kind == "B":
                messages = decoder.feed(record.content)
                if timeline is None and decoder.hello is not None:
                    timeline = Timeline(decoder.hello)
                if timeline is not None:
                    timeline.add(messages, record.host)
    if timeline is None and decoder.hello is not None:
        timeline = Timeline(decoder.hello)
    if timeline is None:
        raise InputFileError(files[0], "holds no hello of a board", "nothing in it can be read as samples")
    return about, timeline, events


def convert(
    files: Sequence[Path], study: Path, limits: Limits | None = None, longest: bool = False, stopped: str = ""
) -> Converted:
    """Write the recording of a capture into a study: CSV, JSON beside it, and a row in recordings.csv if it is usable.

    Lost samples have no row in the CSV: its time column jumps there, the JSON lists the gaps, and identification
    refuses the file. Nothing is interpolated. Nor is a recording listed that is shorter than planned.

    A recording of the same name that another capture gave stays: this one gets a number.

    Args:
        files: the capture file, and the one that took over when a disk was full. study: folder, made if needed.
        limits: what is acceptable. longest: keep only the longest stretch without a gap, however
            short it is.
        stopped: why the recording ended early, if it did.

    Raises:
        InputFileError: a file cannot be read or written. AcquisitionError: too few samples to make a file of.
    """
    limits = limits or Limits()
    about, timeline, events = replay(files)
    _check_plan(files[0], about)
    hello = timeline.hello
    index, values = timeline.samples()
    wanted = round(float(about.get("seconds", np.inf)) * hello.rate_hz) if about.get("seconds") else None
    kept = index < wanted if wanted else np.ones(index.size, bool)
    if about:
        folder.check_origin(study, str(about.get("origin", "measured")))
    quality = timeline.quality(wanted)
    if longest and index.size:
        kept &= _longest(index)
        quality = replace(quality, gaps=())
    index, values = index[kept], values[kept]
    if index.size < 2:
        many = "one sample" if index.size else "no samples"
        raise AcquisitionError(f"{files[0]}: the board's description is there, but {many}; no recording can be made.")
    condition = _condition(about)
    recording = _recording(index - index[0], values, hello, condition, about)
    problems, remarks = quality.problems(limits), quality.remarks(limits)
    length_s = recording.time_s[-1]
    if condition.frequency_hz and length_s * condition.frequency_hz < limits.periods:
        problems.append(f"{length_s:.3g} s hold fewer than {limits.periods:g} periods of {condition.frequency_hz:g} Hz")
    if not about:
        problems.append("the record of what was to be recorded is damaged: condition, origin and length are unknown")
    known = folder.body_mass(study, condition.subject)
    if folder.differ(known, condition.body_mass_kg):
        problems.append(f"its body mass is {condition.body_mass_kg:g} kg and subjects.csv says {known:g} kg")
    if not problems:
        problems += _refused(recording, f"{files[0].name.removesuffix(capture.SUFFIX)}.csv")
    unread = sum(event["bytes"] for event in events if event.get("event") == "unreadable")
    if unread:
        remarks.append(f"{counted(unread, 'unreadable byte')} in the capture")
    if wanted and index[-1] < wanted - 1 - hello.frame_samples:
        (remarks if longest else problems).append(f"{length_s:.3g} s are there of {about['seconds']:g} s")
        remarks += [f"ended early: {stopped.rstrip('.')}"] if stopped else []
    if longest:
        remarks.append("the longest stretch without a gap")
    stem = folder.stem_of(study, files[0], about.get("started_utc"))
    file = study / folder.RECORDINGS / f"{stem}.csv"
    recording.write(file)
    made = Converted(file, recording, quality, tuple(problems), tuple(remarks))
    details = {
        **{key: value for key, value in about.items() if key != "preamble"},
        "board": asdict(hello), "first_sample": int(index[0]), "events": events,
        "captures": [str(f.relative_to(study)) if f.is_relative_to(study) else str(f) for f in files],
        "limits": asdict(limits), **made.document(),
        "warnings": [f"{file.name}: {text}." for text in remarks],
    }  # fmt: skip
    write_whole(file.with_suffix(".json"), to_json(details) + "\n")
    if about:
        origin = str(about.get("origin", "measured"))
        folder.enter(study, f"{folder.RECORDINGS}/{file.name}", condition, origin, usable=not problems)
    return made


def _longest(index: np.ndarray) -> np.ndarray:
    """Mask of the longest run of consecutive indices."""
    runs = np.concatenate([[0], np.cumsum(np.diff(index) != 1)])
    return runs == np.argmax(np.bincount(runs))


def _refused(recording: Recording, name: str) -> list[str]:
    """What identification would say against a recording at a known frequency; with none, whether it was shaken."""
    if recording.condition.frequency_hz is None:
        return [text] if (text := absent(recording)) else []
    try:
        checked(replace(recording, file=name))
    except RecordingError as error:
        return [str(error).removeprefix(f"{name}: ").removesuffix(".")]
    return []


def _check_plan(file: Path, about: dict[str, Any]) -> None:
    """Refuse a plan of senseless content, which acquisition never writes."""
    condition = about.get("condition", {})
    if not isinstance(condition, dict):
        raise InputFileError(file, f"its plan has the condition {condition!r}", "a table of the recording's condition")
    numbers = {"seconds": about.get("seconds")}
    numbers |= {name: condition.get(name) for name in ("frequency_hz", "body_mass_kg", "added_mass_kg")}
    for name, value in numbers.items():
        sound = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf
        if value is not None and not sound:
            raise InputFileError(file, f"its plan has {name} {value!r}", "a number is needed")
    for name in ("subject", "posture"):
        if not isinstance(condition.get(name, ""), str):
            raise InputFileError(file, f"its plan has {name} {condition[name]!r}", "a text is needed")


def _condition(about: dict[str, Any]) -> Condition:
    known = about.get("condition", {})
    return Condition(**{key: known[key] for key in asdict(Condition()) if key in known})


def _recording(
    index: np.ndarray, values: np.ndarray, hello: Hello, condition: Condition, about: dict[str, Any]
) -> Recording:
    column = {role: values[:, i] for i, role in reversed(list(enumerate(hello.roles)))}
    return Recording(
        time_s=index / hello.rate_hz,
        base_m_s2=column["base"],
        malleolus_m_s2=column["malleolus"],
        tuberosity_m_s2=column.get("tuberosity"),
        condition=condition,
        origin=str(about.get("origin", "measured")),
    )
