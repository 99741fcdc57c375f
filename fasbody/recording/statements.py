"""What a file states of a channel's time or scale beside its numbers: refused where it is not applied.

Attributes, properties, metadata, scalars and lines above the numbers are matched alike, by the words of their names.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from fasbody.exceptions import InputFileError, shown
from fasbody.recording import text
from fasbody.recording.channels import KNOWN_UNITS, NAMES, Channel, Layout
from fasbody.sentences import Sentence, called

#: A number, a date or time of the day, or one number for each channel.
Value = float | str | list[float | str]
Statements = dict[str, Value]
_TIMES = frozenset((
    "start", "started", "t0", "x0", "xstart", "tstart", "delay", "delayed", "lag", "lags", "latency", "late",
    "early", "shift", "shifted", "skew", "trigger", "timestamp", "toffset", "begin", "pretrigger", "timedelay",
    "deskew", "verzögerung", "verzoegerung", "versatz", "laufzeit", "totzeit", "retard", "retardo", "ritardo",
    "遅延", "延迟",
))  # fmt: skip
_OF_TIME = frozenset((
    "time", "t", "s", "ms", "us", "ns", "sec", "seconds", "samples", "sync",
))  # fmt: skip
#: Words that together are about the first sample.
_PAIRS = ({"first", "sample"}, {"time", "stamp"})
_SCALES = frozenset((
    "gain", "scale", "scaled", "scaling", "factor", "slope", "multiplier", "multiply",
    "multiplied", "divide", "divided", "amplification", "attenuation", "cal", "calibration",
    "sens", "sensitivity", "conversion", "lsb", "resolution",
    "faktor", "facteur", "fattore", "verstärkung", "verstaerkung", "ganancia", "guadagno", "pga",
))  # fmt: skip
#: Of those the ones that say nothing where they are alike for all channels.
_OF_CONVERTER = frozenset(("lsb", "resolution"))
#: With these words it is about something else.
_NEITHER = frozenset((
    "date", "unit", "units", "type", "mode", "id", "serial", "level", "std", "name", "range",
))  # fmt: skip
_CLOCK = re.compile(r"(?:\d{4}-\d\d-\d\d[T ]?|[\d./]{8,10}[T ]+)?\d{1,2}:\d\d(?::\d\d(?:[.,]\d+)?)?Z?|\d{4}-\d\d-\d\d")
#: What people call the two sensors.
_CALLED = {
    "base": ("plate", "table", "shaker", "platte", "tisch", "basis", "both"),
    "malleolus": (
        "ankle", "mal", "knöchel", "knoechel", "malléole", "malleole", "maléolo", "maleolo", "malleolo", "tobillo",
        "cheville", "caviglia", "くるぶし", "both",
    ),
}  # fmt: skip
#: Beginnings of the malleolus' names in other languages, with the endings that these have, and without spaces.
_STEMS = (
    "лодыж", "щиколот", "голен", "enkel", "fotled", "boka", "bokán", "tornozelo", "kostk", "kotník", "nilk", "bilek",
    "足首", "踝", "발목", "복사뼈", "كاحل", "קרסול", "टखन", "mắt cá",
)  # fmt: skip
#: A sensor by its number.
_NUMBERED = re.compile(
    r"\b(?:ch(?:annel)?|kanal|canale?|column|spalte|sensor|signal|data|amplifier|voie|imu|accelerometer)[\s._#-]{0,2}"
    r"(?:\d\b|[ab12]\b|one\b|two\b|three\b)"
    r"|\b(?:first|second|third|other|zweite[rn]?|erste[rn]?)\s(?:channel|column|sensor|signal|kanal|spalte)",
    re.IGNORECASE,
)
#: Some samples were left out, so that a rate may be that before it; and one of so many was kept.
_THINNING = r"decimat|dezim(?!al)|(?:down|sub)[-_ ]?sampl"
_THINNED = re.compile(rf"{_THINNING}|\bevery \d+(?:st|nd|rd|th)\b|jede[rns]? \d+\.", re.IGNORECASE)
_ONE_OF = re.compile(
    rf"(?:{_THINNING})\D*(?P<factor>\d+)(?![.,]?\d|\s*k?hz)"
    r"|\bevery (?P<th>\d+)|\bjede[rns]? (?P<te>\d+)",
    re.IGNORECASE,
)
#: Words of a name of a file, sheet or folder whose numbers were changed.
_TREATED = re.compile(
    r"filt(?:er|ered|ert)?\d*$|gefiltert|(?:low|high|band|tief|hoch)pass|[lhb]p[f\d]|butterworth|"
    r"smoothed|detrend|gain|verst(?:ä|ae)rk|attenuat|(?:re|down|sub)sampl|decimat|delayed|shifted|"
    r"invert|flipped|integrat|differentiat|normali[sz]|uncalibrat"
)
_TURNED = re.compile(
    r"invert|polarit|flipp|upside|revers|\bsigns?\b|vorzeichen|umgekehrt|verpolt", re.IGNORECASE
)
#: Words that name a sensor, count, sum up or date what is in the file, and change none of its numbers.
_HARMLESS = frozenset((
    "channel", "channels", "ch", "name", "names", "label", "title", "sensor", "sensors", "accelerometer",
    "acceleration", "accel", "acc", "axis", "x", "y", "z", "serial", "sn", "s/n", "no", "nr", "number", "id",
    "uid", "index", "model", "type", "manufacturer", "min", "max", "mean", "rms", "std", "peak", "average",
    "minimum", "maximum", "unit", "units", "einheit", "kanal", "kanäle", "time", "data", "and", "of", "the",
    "at", "on", "position", "location", "node", "coupling", "trace", "sensitivity", "sens", "range", "kind", "class",
    "date", "file", "v", "ai", "column", "quantity", "dof", "direction", "header", "headers", "input", "labels",
    "string", "zeit", "temps", "tiempo", "counts", "offset", "bias", "signal", "waveform", "waveforms", "eu",
    "t", "s", "n", "physical", "long", "standard", "component", "tracked", "point", "placement", "samples",
    "count", "points", "length", "color", "colour",
))  # fmt: skip
#: An amount that moves a time or turns a phase, and one that changes a size.
_AMOUNT_OF_TIME = re.compile(
    r"\d\s*(?:[mnuµμ]?s|m?sec|seconds?|samples?|frames?|deg|degrees?|grad|°|мс\w*|毫秒|ミリ秒|밀리초)"
    r"(?![A-Za-z\d/])",
    re.IGNORECASE,
)
_AMOUNT_OF_SIZE = re.compile(
    r"\d\s*(?:db|×|fold)(?![A-Za-z\d/])|(?<![\w.])\d+x(?!\w)|(?<![\w.])(?:(?-i:x)|[×*÷])\s?\d",
    re.IGNORECASE,
)
#: Of those the ones that count where base and malleolus differ.
_OF_SENSORS = frozenset(("coupling",))
_SWITCHED = frozenset(("on", "off", "yes", "no", "ein", "aus"))
#: With these words an amount of time is how long or how often something was recorded.
_LENGTHS = frozenset((
    "duration", "length", "interval", "period", "dauer", "step", "dt", "increment", "rate", "timebase",
    "record", "total", "sampling", "average", "averaging", "window", "time", "sweep", "delta", "elapsed",
    "abtastintervall", "per", "div",
))  # fmt: skip
#: With these a row is of when and with which device it was measured.
_DATED = frozenset(("date", "datum", "serial", "id", "sn", "version", "firmware", "model"))
#: Names of remarks, whose words count.
_REMARKS = frozenset((
    "comment", "comments", "description", "note", "notes", "remark", "remarks", "bemerkung", "kommentar",
))  # fmt: skip
_DAY = re.compile(r"\d+([./-])\d+\1\d+")
#: Sensitivities of two sensors of one kind differ by less than this share, and gains by more.
_ALIKE = 0.1
#: So many lines are quoted.
_QUOTED = 6
#: A longer line is no name and number, and would take the pattern long.
_LONGEST = 160
_LINE = re.compile(
    r"\W*(?P<name>(?:[^\d=]|(?<=[A-Za-z])\d)*?[^\W\d]\d?\W*?)[\s:=,;]+"
    r"(?P<value>(?:\d{4}-\d\d-\d\d[T ])?[-+]?\d[\d:.,]*(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d]*)"
)


def kind(name: str) -> str:
    """The key of study.toml that answers a statement, "delay_s" or "sensitivity"; empty for any other."""
    words = _words(name)
    if words & _NEITHER or counts_kept(name):
        return ""
    if words & _TIMES or ("offset" in words and words & _OF_TIME) or any(pair <= words for pair in _PAIRS):
        return "delay_s"
    return "sensitivity" if words & _SCALES else ""


def _words(name: str) -> set[str]:
    return {word.lower() for word in re.findall(r"[A-Z]?[^\W\d_A-Z]+\d*|[A-Z]+\d*", name)}


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
    """Statements by channel, and the lines that may be some and are not understood.

    Args:
        lines: beside the headings.
        separator: of cells.
        names: headings by channel.
    """
    made: dict[str, Statements] = {channel: {} for channel in names}
    vague = []
    for line in _whole(lines, separator):
        cells = text.split(line, separator)
        name, *cells = cells if len(cells) > 2 else line.split() or [""]
        values = [text.number(cell) if text.numeric(cell) else cell for cell in cells if cell]
        clocks = [value for value in values if isinstance(value, str) and ":" in value and _CLOCK.fullmatch(value)]
        words = [value for value in values if isinstance(value, str)]
        if kind(name) and len(values) > 1 and (not words or len(clocks) == len(values)):
            for statements in made.values():
                statements[name] = values
            continue
        about = _about(line, names)
        by_others = _NUMBERED.search(line) is not None or any(stem in line.lower() for stem in _STEMS)
        match = _LINE.fullmatch(line) if len(line) <= _LONGEST else None
        clear = kind(line) and not re.search(r"\d ?m?V/", line) and len(about) == 1
        if clear and match and kind(match["name"]):
            value = match["value"].rstrip(".,:")
            called = "|".join(map(re.escape, (about[0], *_CALLED.get(about[0], ()))))
            mine = rf"\b(?:{called})\b|{re.escape(names[about[0]])}"
            plain = re.sub(mine, "", match["name"], flags=re.IGNORECASE)
            made[about[0]][" ".join(plain.split()).strip(" :")] = (
                text.number(value) if text.numeric(value) else value
            )
        elif _differ(line, separator) or is_amount(line) or _is_thinned(line) or (
            (about or by_others) and not _alike(line, separator) and _unclear(line, names.values())
        ):
            vague.append(" ".join(line.split()))
    return made, _without_alike(vague, names)


def _about(line: str, names: Mapping[str, str]) -> list[str]:
    """The channels that a line names."""
    mentioned = {*re.findall(r"[^\W_]+", line.lower())}
    return [name for name, heading in names.items()
            if {name, heading.strip().lower(), *_CALLED.get(name, ())} & mentioned]  # fmt: skip


def _without_alike(lines: Sequence[str], names: Mapping[str, str]) -> list[str]:
    """Lines without those that say the same of base and malleolus, one of each."""
    plain = {line: _nameless(line, names) for line in lines}
    single = {line: about[0] for line in lines if len(about := _about(line, names)) == 1}
    alike = {(plain[line], channel) for line, channel in single.items()}
    paired = {line for line in single if all((plain[line], name) in alike for name in NAMES[:2])}
    return [line for line in lines if line not in paired]


def _nameless(line: str, names: Mapping[str, str]) -> str:
    """A line without what tells its channel from another."""
    called = (*names, *names.values(), *(word for words in _CALLED.values() for word in words))
    pattern = "|".join(map(re.escape, sorted(called, key=len, reverse=True)))
    return re.sub(rf"(?<!\w)(?:{pattern})(?!\w)|{_NUMBERED.pattern}", "", line, flags=re.IGNORECASE)


def _is_thinned(line: str) -> bool:
    """Whether samples were left out, by more than every first."""
    match = _ONE_OF.search(line)
    return _THINNED.search(line) is not None and not (match and match["factor"] == "1")


def _whole(lines: Sequence[str], separator: str) -> list[str]:
    """Lines with a name that stands alone above its values in front of these."""
    made: list[str] = []
    for line in lines:
        alone = bool(made) and separator not in made[-1] and re.fullmatch(r"\W*[^\W\d].*", made[-1]) is not None
        below = line.startswith(separator) or (separator in line and made[-1:] and made[-1][-1] == ":")
        if alone and below and separator != " ":
            made[-1] += line if line.startswith(separator) else f"{separator}{line}"
        else:
            made.append(line)
    return made


def _unclear(words: str, names: Iterable[str] = ()) -> bool:
    """Whether words say more than which sensor, unit, number or sum something is."""
    for name in names:
        words = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", " ", words)
    called = {*NAMES, *(word for several in _CALLED.values() for word in several)} - {"both"}
    tokens = (token.strip("#%/:;,.\"'()[]=") for token in re.split(r"[\s;,:=\t|]+", words))
    plain = (token for token in tokens if token and token.lower() not in KNOWN_UNITS and not re.search(r"\d", token))
    left = {word for token in plain if not re.fullmatch(r"m?V/\S+", token) for word in _words(token)}
    return bool(left - _HARMLESS - _REMARKS - called)


def is_amount(line: str) -> bool:
    """Whether words say by how much a time, a phase or a size is changed."""
    is_one = _AMOUNT_OF_TIME.search(line) or _AMOUNT_OF_SIZE.search(line)
    return is_one is not None and not _words(line) & _LENGTHS


def counts_kept(name: str) -> bool:
    """Whether a number of this name is how many samples one was kept of."""
    return _THINNED.search(name) is not None


def thinned(lines: Iterable[str], rate_hz: float) -> str:
    """The first line by which one sample of several was kept, none of these at the rate [Hz]."""
    for line in lines:
        match = _ONE_OF.search(line)
        is_rate = re.search(rf"\b(?:to|auf)\s+{rate_hz:g}\s*hz", line, re.IGNORECASE)
        if match and int(match["factor"] or match["th"] or match["te"]) > 1 and not is_rate:
            return " ".join(line.split())
    return ""


def is_treated(name: str) -> bool:
    """Whether the name of a file, sheet or folder says that its numbers were changed."""
    return any(_TREATED.match(word) for word in _words(name))


def is_answered(line: str, layout: Layout, names: Mapping[str, str]) -> bool:
    """Whether study.toml states all that a line may be about, of a sensor that it names, or of any.

    Args:
        line: that is not understood.
        layout: of study.toml.
        names: headings by channel.
    """
    if counts_kept(line):
        return layout.rate_hz is not None
    words = _words(re.sub(r"\d", " ", line))
    about = (
        ({"delay_s", "clock"}, kind(line) == "delay_s" or _AMOUNT_OF_TIME.search(line)),
        ({"sensitivity"}, bool(words & _SCALES) or _AMOUNT_OF_SIZE.search(line)),
        ({"sign"}, _TURNED.search(line)),
    )
    keys = [answers for answers, is_one in about if is_one]
    channels = [layout.channels.get(name, Channel()) for name in _about(line, names) or names]
    stated = [{*channel.stated} - _not_of_gain(layout) for channel in channels]
    return bool(keys) and all(any(answers & some for some in stated) for answers in keys)


def _not_of_gain(layout: Layout) -> set[str]:
    """The key sensitivity, if it is of the sensors alone: alike for base and malleolus, and not 1."""
    base, malleolus = (layout.channels.get(name, Channel()) for name in NAMES[:2])
    ratio = abs(base.sensitivity / malleolus.sensitivity)
    is_alike = base.volts == malleolus.volts and abs(ratio - 1) < _ALIKE
    return {"sensitivity"} if is_alike and malleolus.sensitivity != 1 else set()


def _differ(line: str, separator: str) -> bool:
    """Whether a row names something and has an unlike cell for each channel."""
    name, *cells = text.split(line, separator) if separator != " " else [""]
    clocks = [cell for cell in cells if ":" in cell and _CLOCK.fullmatch(cell)]
    if len(clocks) > 1 and len(clocks) == sum(map(bool, cells)):
        return len({*clocks}) > 1
    cells = [cell for cell in cells if cell not in clocks and not _DAY.match(cell) and _says(cell)]
    while cells and not cells[-1]:
        cells.pop()
    cells = cells[1:] if len(cells) > 2 and not cells[0] else cells  # of the time
    if len(cells) > 1 and not name:
        return len({*cells}) > 1 and any(map(_unclear, cells))
    if len(cells) < 2 or len({*map(_bare, cells)}) < 2 or not re.search(r"[^\W\d]", name) or _words(line) & _DATED:
        return False
    return _unclear(name) or bool(_words(name) & _OF_SENSORS) or (
        bool(_words(name) & _REMARKS) and any(map(_unclear, cells))
    )  # fmt: skip


def _alike(line: str, separator: str) -> bool:
    """Whether a row has the same in a cell for each channel."""
    _, *cells = text.split(line, separator) if separator != " " else [""]
    filled = [_bare(cell) for cell in cells if cell]
    return len(filled) > 1 and len({*filled}) == 1


def _bare(cell: str) -> str:
    """A cell without the name of its channel, as ``CH1:0.5``."""
    return re.sub(r"^[^\W\d]\w*:(?=\S)", "", cell)


def _says(cell: str) -> bool:
    """Whether a cell is more than a name or a unit."""
    is_word = re.fullmatch(r"[^\d]*[^\W\d][^\d]*", cell) is not None
    return not is_word or cell.lower() in _SWITCHED or _unclear(cell)


def quoted(lines: Sequence[str]) -> list[str]:
    """One sentence that quotes what is not understood, the first of it where it is much."""
    distinct = list(dict.fromkeys(lines))
    if len(distinct) < 2:
        return [f"a line says {shown(line)!r}, which is not applied" for line in distinct]
    listed = "; ".join(repr(shown(line)) for line in distinct[:_QUOTED])
    more = f" and {len(distinct) - _QUOTED} more" if len(distinct) > _QUOTED else ""
    return [f"lines say {listed}{more}, which is not applied"]


def texts_of(pairs: Mapping[str, object], applied: Sequence[str] = ()) -> dict[str, str]:
    """Names and values as text, of those that are words or numbers and not applied."""
    made = {}
    for name, value in pairs.items():
        plain = value.item() if getattr(value, "size", 0) == 1 else value  # type: ignore[attr-defined]
        plain = plain.decode("utf-8", "replace") if isinstance(plain, bytes) else plain
        if isinstance(plain, str | int | float) and name.lower() not in applied:
            made[name] = plain if isinstance(plain, str) else f"{plain:.6g}"
    return made


def differing(
    about: Mapping[str, Mapping[str, str]], understood: Mapping[str, Statements], layout: Layout
) -> list[str]:  # fmt: skip
    """A sentence on what a file says of base and malleolus that is not alike, and nothing here applies.

    Args:
        about: names and values by channel.
        understood: those that are refused, or answered by study.toml.
        layout: of study.toml.
    """
    base, malleolus = (about.get(name, {}) for name in NAMES[:2])
    done = {name for statements in understood.values() for name in statements}
    lines = []
    for name in dict.fromkeys((*base, *malleolus)):
        values = [side.get(name, "").strip() for side in (base, malleolus)]
        words = _words(name)
        says = any(kind(value) or is_amount(value) or (words & _REMARKS and _unclear(value)) for value in values)
        says = says or bool(words & _OF_SENSORS) or (_unclear(name) and not words & _REMARKS)
        if values[0] != values[1] and name not in done and says:
            lines.append(f"{shown(name)} = {shown(values[0])!r} with base and {shown(values[1])!r} with malleolus")
    lines = [line for line in lines if not is_answered(line, layout, dict.fromkeys(about, ""))]
    return [f"says {', '.join(lines)}, which is not applied"] if lines else []


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
        none = 1 if key == "sensitivity" else 0
        setting = called(f"channels.{channel}.{key}", "...")
        hint = Sentence("give ", setting, f" ({none} if they do), or delete the statement")
        raise InputFileError(file, _problem(name, key, odd[channel], names[channel]), hint)


def _problem(name: str, key: str, value: Value, column: str) -> str:
    listed = ", ".join(map(_shown, value)) if isinstance(value, list) else _shown(value)
    of = "for its channels" if isinstance(value, list) else f"with {column!r}"
    doubt = "its numbers contain it" if key == "sensitivity" else "its times contain it, and with which sign"
    return f"says {shown(name)} = {listed} {of}, and not whether {doubt}"


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
