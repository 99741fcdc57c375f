"""study.toml: what a study says of itself and of its channels."""

import tomllib
from pathlib import Path
from typing import Any

from fasbody.channels import Layout
from fasbody.exceptions import InputFileError, unknown


def describe(file: Path) -> tuple[dict[str, str], Layout]:
    """The [study] table of a study.toml with defaults, and the layout of its [channels.*] tables.

    Raises:
        InputFileError: no such file, not TOML, or a table, key or value that does not exist.
    """
    if not file.is_file():
        raise InputFileError(file, "no such file", "a study folder needs study.toml, subjects.csv and recordings.csv")
    try:
        document = tomllib.loads(file.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputFileError(file, f"is not TOML ({error})") from None
    _known(file, document, "table", ("study", "channels"))
    given, channels = _table(file, document, "study"), _table(file, document, "channels")
    _known(file, given, "key of [study]", _KEYS)
    about = {"name": file.parent.resolve().name, "origin": "measured", "description": ""}
    about |= {key: str(value) for key, value in given.items() if key in about}
    if about["origin"] not in ("measured", "synthetic"):
        raise InputFileError(file, f"origin is {about['origin']!r}", 'valid: "measured", "synthetic"')
    return about, Layout.from_toml(file, channels, given.get("sampling_rate_hz"))


_KEYS = ("name", "origin", "description", "sampling_rate_hz")


def _known(file: Path, table: dict[str, Any], kind: str, valid: tuple[str, ...]) -> None:
    """Refuse what would be ignored: a misspelt table or key."""
    for name in table:
        if name not in valid:
            raise InputFileError(file, unknown(kind, name, valid))


def _table(file: Path, document: dict[str, Any], name: str) -> dict[str, Any]:
    """A table of a TOML document, empty if it is not there."""
    table = document.get(name, {})
    if not isinstance(table, dict):
        raise InputFileError(file, f"{name} is {table!r}", f"it must be a table, [{name}]")
    return table
