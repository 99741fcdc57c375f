"""What names of files state: person, posture, load, body mass and frequency, as S16_20Hz_2.3kg.csv."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache

from fasbody.exceptions import SettingError, unknown
from fasbody.recording.condition import POSTURES, Condition

#: What a pattern of file names may hold; {any} is any other text.
FIELDS = ("subject", "posture", "load", "mass", "frequency", "any")
_NUMBER = r"\d+(?:[.,p]\d+)?"
_MATCHES = {
    "load": _NUMBER,
    "mass": _NUMBER,
    "frequency": _NUMBER,
    "subject": r"[^\W_]+",  # names with accents, too
    "posture": r"[A-Za-z]+",
    "any": r"[^/]*?",
}
#: How file names state conditions, in the order of the search.
_SIGNS = {
    field: re.compile(pattern, re.IGNORECASE)
    for field, pattern in (
        ("frequency", rf"({_NUMBER})(?=[ _-]?hz)"),
        ("load", rf"({_NUMBER})(?=[ _-]?kg)"),
        ("posture", rf"({'|'.join(POSTURES)})"),
        ("subject", r"(?<![A-Za-z0-9])(?:subject|subj|sub|s|p|vp|id)[ _-]?(\d+)(?![\d.]*[ _-]?(?:hz|kg))"),
    )
}
#: More than this in a name is a body mass [kg].
_MOST_LOAD_KG = 25.0


def condition_in_name(name: str) -> Condition:
    """Subject, posture, load and frequency that a file's name states; the rest as for any file.

    What a name states twice, it does not state.

    Example:
        >>> condition_in_name("S16_midstance_20Hz_2.3kg.csv").added_mass_kg
        2.3
    """
    texts = {field: {m[1].lower() for m in sign.finditer(name)} for field, sign in _SIGNS.items()}
    only = {field: values.pop() for field, values in texts.items() if len(values) == 1}
    frequency = float(plain_number(only["frequency"])) if "frequency" in only else None
    posture, load = only.get("posture", "midstance"), load_in_name(name) or 0.0
    return Condition(only.get("subject", ""), posture, load, None, frequency)


def load_in_name(name: str) -> float | None:
    """The load [kg] that a file's name states, "rec_20hz_2.3kg.csv" for example; None where it states none.

    A name with several states none, and one above what a knee carries is a body mass.
    """
    return common_value(mass for mass in _masses(name) if mass <= _MOST_LOAD_KG)


def body_mass_in_name(name: str) -> float | None:
    """The body mass [kg] that a file's name states, "anna_61kg.csv" for example; None where it states none."""
    return common_value(mass for mass in _masses(name) if mass > _MOST_LOAD_KG)


def _masses(name: str) -> list[float]:
    return [float(plain_number(match[1].lower())) for match in _SIGNS["load"].finditer(name)]


def common_value(values: Iterable[float]) -> float | None:
    """The value of all, None where they differ or there is none."""
    distinct = set(values)
    return distinct.pop() if len(distinct) == 1 else None


def patterns_of(stems: Sequence[str]) -> list[str]:
    """The patterns of names that hold a condition, most first; the most frequent ones where none does."""
    named = _with_people(list(map(_template, stems)))
    every = Counter(named).most_common()
    most = [pattern for pattern, count in every if count == every[0][1]]
    return [pattern for pattern, _ in every if _says(pattern)] or most


def _says(pattern: str) -> bool:
    return any(f"{{{field}}}" in pattern for field in FIELDS[:-1])


def _with_people(templates: list[str]) -> list[str]:
    """Templates with {subject} for the only word in which those of several persons differ: anna_20Hz, bert_20Hz."""
    some = [template for template in templates if _says(template) and "{subject}" not in template]
    split = {template: re.split(r"([_ /-]+)", template) for template in some}
    shapes = Counter(len(parts) for parts in split.values()).most_common(1)
    like = {template: parts for template, parts in split.items() if shapes and len(parts) == shapes[0][0]}
    columns = list(zip(*like.values(), strict=True))
    apart = [i for i, words in enumerate(columns) if len(set(words)) > 1 and all(word.isalpha() for word in words)]
    if len(apart) != 1:
        return templates
    made = {t: "".join("{subject}" if i == apart[0] else x for i, x in enumerate(parts)) for t, parts in like.items()}
    return [made.get(template, template) for template in templates]


def stated(patterns: Sequence[str], stem: str) -> dict[str, str] | None:
    """The conditions in a name, by the first pattern that it follows."""
    for pattern in patterns:
        if match := _compiled(pattern).fullmatch(stem if "/" in pattern else stem.split("/")[-1]):
            return {name: value for name, value in match.groupdict().items() if value}
    return None


def _template(stem: str) -> str:
    """The pattern that a name follows: what is known by its sign, and any other number as {any}."""
    for field, sign in _SIGNS.items():
        for m in reversed(list(sign.finditer(stem))):
            heavy = field == "load" and float(plain_number(m[1].lower())) > _MOST_LOAD_KG
            sort = "mass" if heavy else field
            if f"{{{sort}}}" not in stem:
                stem = f"{stem[: m.start(1)]}{{{sort}}}{stem[m.end(1) :]}"
    return re.sub(r"\d+", "{any}", stem)


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    parts = re.split(r"\{(\w*)\}", pattern)
    for field in parts[1::2]:
        if field not in FIELDS:
            raise SettingError(f"--pattern {pattern}: {unknown('field', field, FIELDS)}.")
        if field != "any" and parts[1::2].count(field) > 1:
            raise SettingError(f"--pattern {pattern} names {{{field}}} twice; valid: once, and {{any}} for the rest.")
    text = "".join(
        re.escape(part) if i % 2 == 0 else f"(?:{_MATCHES[part]})" if part == "any" else f"(?P<{part}>{_MATCHES[part]})"
        for i, part in enumerate(parts)
    )
    return re.compile(text, re.IGNORECASE)


def plain_number(number: str) -> str:
    """A number of a name with a decimal point: 2p3 and 2,3 are 2.3."""
    return f"{float(re.sub('[,p]', '.', number)):g}" if number else ""
