"""JSON files that people or other programs write, read as dataclasses; what is wrong is named with its value."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from fasbody.console import to_json, write_whole
from fasbody.exceptions import InputFileError

_Kind = TypeVar("_Kind")


def read_json(kind: type[_Kind], file: Path, what: str, remedy: str = "") -> _Kind:
    """A JSON file as a dataclass.

    Args:
        kind: the dataclass; the descriptions of its fields say what is valid.
        file: to read.
        what: the file is to be, such as "calibration of a sound card".
        remedy: what to do about one that is none.

    Raises:
        InputFileError: it cannot be read, or a value is none of its field.
    """
    adapter = TypeAdapter(kind)
    try:
        text = file.read_bytes()
        return adapter.validate_json(text, strict=True)
    except OSError as error:
        raise InputFileError(file, f"cannot be read ({error.strerror})", remedy) from None
    except ValidationError as error:
        first = error.errors()[0]
    if not first["loc"]:
        problem = "it is no JSON document" if first["type"] == "json_invalid" else "it is no table"
        raise InputFileError(file, f"is no {what}: {problem}", remedy)
    key, *below = first["loc"]
    if first["type"] == "missing" and not below:
        raise InputFileError(file, f"is no {what}: it names no {key}", remedy)
    fields = adapter.json_schema()["properties"]
    if key not in fields:
        problem, valid, value = f"it knows no {key}", ", ".join(fields), first["input"]
    else:
        value = json.loads(text)[key]
        problem, valid = f"{key} is {json.dumps(value)}", fields[key].get("description", first["msg"])
    facts: dict[str, Any] = {"quantity": key, "value": value, "valid": valid}
    raise InputFileError(file, f"is no {what}: {problem}", f"valid: {valid}", **facts)


class SettingsFile:
    """A frozen dataclass that is kept as a JSON file.

    Attributes:
        TITLE: what the file is.
        VALID: what to do about one that is none.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)
    TITLE: ClassVar[str]
    VALID: ClassVar[str]

    @classmethod
    def read(cls, file: Path) -> Self:
        """From a file that `write`, or a person, wrote."""
        return read_json(cls, file, cls.TITLE, cls.VALID)

    def write(self, file: Path) -> None:
        """As JSON."""
        write_whole(file, to_json(asdict(self)) + "\n")  # type: ignore[call-overload]
