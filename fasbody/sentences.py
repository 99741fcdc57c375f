"""Sentences that name settings: each setting by its option or key for a terminal, by its control for the page.

A module says which setting it means, and nobody searches a sentence for an option.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

#: A setting, a channel's without the channel -> what a terminal's reader calls it, and what the page does.
SETTINGS: Mapping[str, tuple[str, str]] = {
    "body_mass": ("--body-mass", "the body mass in the table"),
    "added_mass": ("--added-mass", "the mass on the knee"),
    "mass_std": ("--mass-std", "mass_std in Python"),
    "domain": ("--domain {value}", "domain={value!r} in Python"),
    "free": ("--free", "their boxes"),
    "bounds": ("--bounds", "the small numbers under a slider"),
    "exclude": ("--exclude, [known] in study.toml", "[known] in the study.toml of a study folder"),
    "compare_rivals": ("fasbody rivals", "the button Rivals"),
    "sampling_rate_hz": ("sampling_rate_hz in study.toml", "the rate with “…”"),
    "channels": ("study.toml ({value})", "“…”"),
    "channels.column": ("study.toml ([channels.{channel}] column = ...)", "“…”"),
    "channels.unit": ('study.toml [channels.{channel}] unit = "{value}"', "its unit with “…”"),
    "channels.sensitivity": (
        'study.toml channels.{channel}.sensitivity = "{value}"',
        "its sensitivity as its unit in the table, “{value}”",
    ),
    "channels.delay_s": ("study.toml channels.{channel}.delay_s = {value}", "its delay with “…”"),
    "channels.sign": ("study.toml: sign", "“…” changes it"),
    "channels.sign, channels.delay_s": ("study.toml: sign, delay_s", "“…” names columns and signs"),
    "channels.column, channels.delay_s": (
        "study.toml: column, delay_s; delay_std_s says how sure that is",
        "“…” names the columns",
    ),
}


class Sentence(str):
    """Words for people: as a string those of a terminal, `on_page` those of the page.

    Attributes:
        on_page: the same for a reader of the page.
        code: the kind of problem that they tell of; "" where nobody asks.
        reason: the same without the name of the file that it is about.

    Example:
        >>> text = Sentence("The body mass is unknown; give ", called("body_mass"), ".")
        >>> print(text)
        The body mass is unknown; give --body-mass.
        >>> print(text.on_page)
        The body mass is unknown; give the body mass in the table.
    """

    on_page: str
    code: str
    reason: str

    def __new__(cls, *parts: str, code: str = "", on_page: str | None = None, reason: str = "") -> "Sentence":
        """Join parts, of which some may be sentences.

        Args:
            parts: in order.
            code: kind of problem.
            on_page: in place of what the parts say on the page.
            reason: without the name of a file.
        """
        sentence = super().__new__(cls, "".join(parts))
        sentence.on_page = "".join(map(for_page, parts)) if on_page is None else on_page
        sentence.code, sentence.reason = code, reason or str(sentence)
        return sentence

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(Sentence, **vars(self)), (str(self),)


def for_page(text: str) -> str:
    """What the page says for a text."""
    return text.on_page if isinstance(text, Sentence) else text


def code_of(text: str) -> str:
    """The kind of problem that a text tells of; "" for one that does not say."""
    return text.code if isinstance(text, Sentence) else ""


def reason_of(text: str) -> str:
    """A text without the name of the file that it is about, where it knows that."""
    return text.reason if isinstance(text, Sentence) else text


def begun(text: Sentence) -> Sentence:
    """What the page begins a sentence with; a terminal writes a command as it is typed."""
    return Sentence(text, on_page=text.on_page[:1].upper() + text.on_page[1:])


def called(setting: str, value: object = "") -> Sentence:
    """What a setting is called.

    Args:
        setting: its name in Python or its place in study.toml: "body_mass", "channels.base.unit".
        value: that it should have, where that is to be said.
    """
    kind, channel = setting, ""
    if setting not in SETTINGS and setting.count(".") == 2:
        table, channel, key = setting.split(".")
        kind = f"{table}.{key}"
    terminal, page = (name.format(channel=channel, value=value) for name in SETTINGS[kind])
    return Sentence(terminal, on_page=page)
