"""What a file states of a channel's time or scale beside its numbers: refused where it is not applied.

Attributes, properties, metadata, scalars and lines above the numbers are matched alike, by the words of their names.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from fasbody.exceptions import InputFileError, shown
from fasbody.recording import text
from fasbody.recording.channels import Channel, Layout
from fasbody.sentences import Sentence, called

#: A number, a date or time of the day, or one number for each channel.
Value = float | str | list[float | str]
Statements = dict[str, Value]
_TIMES = frozenset((
    "start", "started", "t0", "x0", "xstart", "tstart", "delay", "delayed", "lag", "lags",
    "latency", "late", "early", "shift", "shifted", "skew", "trigger", "timestamp",
))  # fmt: skip
_OF_TIME = frozenset((
    "time", "t", "s", "ms", "us", "ns", "sec", "seconds", "samples",
))  # fmt: skip
_SCALES = frozenset((
    "gain", "scale", "scaled", "scaling", "factor", "slope", "multiplier", "multiply",
    "multiplied", "divide", "divided", "amplification", "attenuation", "cal", "calibration",
    "sens", "sensitivity", "conversion", "lsb", "resolution",
))  # fmt: skip
#: Of those the ones that say nothing where they are alike for all channels.
_OF_CONVERTER = frozenset(("lsb", "resolution"))
#: With these words it is about something else.
_NEITHER = frozenset((
    "date", "unit", "units", "type", "mode", "id", "serial", "level", "std", "name", "range",
))  # fmt: skip
_CLOCK = re.compile(r"(?:\d{4}-\d\d-\d\d[T ]?|[\d./]{8,10}[T ]+)?\d{1,2}:\d\d(?::\d\d(?:[.,]\d+)?)?Z?|\d{4}-\d\d-\d\d")
#: A longer line is no name and number, and would take the pattern long.
_LONGEST = 160
_LINE = re.compile(
    r"\W*(?P<name>(?:[^\d=]|(?<=[A-Za-z])\d)*?[^\W\d]\d?\W*?)[\s:=,;]+"
    r"(?P<value>[-+]?\d[\d:.,]*(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d]*)"
)


def kind(name: str) -> str:
    """The key of study.toml that answers a statement, "delay_s" or "sensitivity"; empty for any other."""
    words = _words(name)
    if words & _NEITHER:
        return ""
    if words & _TIMES or ("offset" in words and words & _OF_TIME):
        return "delay_s"
    return "sensitivity" if words & _SCALES else ""


def _words(name: str) -> set[str]:
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+\d*|[A-Z]+\d*", name)}


def statements_of(pairs: Mapping[str, object], applied: Sequence[str] = ()) -> Statements:
    """The statements among names and values that are numbers or times, without those that are applied."""
    made: Statements = {}
    for name, value in pairs.items():
        if name.lower() in applied or not kind(name):
            continue
        plain = value.item() if getattr(value, "size", 0) == 1 else value  # type: ignore[attr-defined]
        plain = plain.decode("utf-8", "replace") if isinstance(plain, bytes) else plain
        if isinstance(plain, str) and text.numeric(plain):
            plain = text.number(plain)
        if isinstance(plain, int | float):
            made[name] = float(plain)
        elif _CLOCK.match(str(plain)) and kind(name) == "delay_s":
            made[name] = str(plain)
    return made


def of_lines(
    lines: Sequence[str], separator: str, names: Mapping[str, str]
) -> tuple[dict[str, Statements], list[str]]:  # fmt: skip
    """Statements by channel, and the lines that seem to be some and are not understood.

    Args:
        lines: beside the headings.
        separator: of cells.
        names: headings by channel.
    """
    made: dict[str, Statements] = {channel: {} for channel in names}
    vague = []
    for line in lines:
        cells = text.split(line, separator)
        name, *cells = cells if len(cells) > 2 else line.split() or [""]
        values = [text.number(cell) if text.numeric(cell) else cell for cell in cells if cell]
        clocks = [value for value in values if isinstance(value, str) and ":" in value and _CLOCK.fullmatch(value)]
        words = [value for value in values if isinstance(value, str)]
        if kind(name) and len(values) > 1 and (not words or len(clocks) == len(values)):
            for statements in made.values():
                statements[name] = values
            continue
        mentioned = re.findall(r"[^\W_]+", line.lower())
        about = [name for name, heading in names.items() if {name, heading.strip().lower()} & {*mentioned}]
        if not about or not kind(line) or not re.search(r"\d", line) or re.search(r"\d ?m?V/", line):
            continue
        match = _LINE.fullmatch(line) if len(line) <= _LONGEST else None
        if len(about) == 1 and match and kind(match["name"]):
            value = match["value"].rstrip(".,:")
            plain = re.sub(rf"\b{about[0]}\b|{re.escape(names[about[0]])}", "", match["name"], flags=re.IGNORECASE)
            made[about[0]][" ".join(plain.split())] = text.number(value) if text.numeric(value) else value
        else:
            vague.append(f"a line says {shown(line)!r}, which is not applied")
    return made, vague


def refuse_unapplied(
    file: Path, stated: Mapping[str, Statements], names: Mapping[str, str], layout: Layout, alike: bool = False
) -> None:  # fmt: skip
    """Refuse a statement that is not alike for all channels, unless study.toml answers it.

    Args:
        stated: by channel.
        names: of their columns.
        layout: of study.toml.
        alike: allow a scale other than 1 that is alike for all channels.
    """
    keys = {channel: set(layout.channels.get(channel, Channel()).stated) for channel in stated}
    for name in dict.fromkeys(name for statements in stated.values() for name in statements):
        key, neutral = kind(name), 0.0 if kind(name) == "delay_s" else 1.0
        values = {channel: statements.get(name, neutral) for channel, statements in stated.items()}
        lists = [set(v) for v in values.values() if isinstance(v, list)]
        weak = bool(lists) or alike or key == "delay_s" or bool(_words(name) & _OF_CONVERTER)
        odd = {c: v for c, v in values.items() if isinstance(v, list) or (v != neutral and name in stated[c])}
        unlike = len({str(v) for v in values.values()}) > 1 or any(len(several) > 1 for several in lists)
        answers = {key, "clock"} if key == "delay_s" else {key}
        if not odd or (weak and not unlike) or any(keys[channel] & answers for channel in (values if weak else odd)):
            continue
        channel = list(odd)[-1 if weak else 0]
        example, none = ("100 mV/g", 1) if key == "sensitivity" else ("0.002", 0)
        setting = called(f"channels.{channel}.{key}", example)
        hint = Sentence("give ", setting, f" ({none} if they do), or delete the statement")
        raise InputFileError(file, _problem(name, key, odd[channel], names[channel]), hint)


def _problem(name: str, key: str, value: Value, column: str) -> str:
    listed = ", ".join(map(_shown, value)) if isinstance(value, list) else _shown(value)
    of = "for its channels" if isinstance(value, list) else f"with {column!r}"
    doubt = "its numbers contain it" if key == "sensitivity" else "its times contain it, and with which sign"
    return f"says {shown(name)} = {listed} {of}, and not whether {doubt}"


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
