"""The schema of study.toml: its tables, their keys, and which values are valid."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from fasbody.exceptions import InputFileError, unknown

#: Largest standard deviations that are stated of a relative mass, a relative gain and a delay [s].
LARGEST_STD = {"mass_std": 0.5, "gain_std": 0.5, "delay_std_s": 0.01}
#: Limits of the share of the load that the leg carries.
SHARES = (0.3, 1.2)
#: What a sensitivity can be.
SENSITIVITIES = 'a number (unit per m/s^2), not 0, "100 mV/g" or "10.2 mV/(m/s^2)"'
_FORCES = 'a force in N, above 0 and below 10000, or one for each load in kg: { "0" = 43.0, "2.3" = 62.5 }'


def _is_sign(value: float) -> float:
    if abs(value) != 1:
        raise ValueError
    return value


def _is_not_zero(value: float | str) -> float | str:
    if not value:
        raise ValueError
    return value


def _by_load(stated: Any) -> dict[float | None, float]:
    """Static forces [N] by load [kg]; one for all loads is under None."""
    forces = stated if isinstance(stated, Mapping) else {None: stated}
    return {None if kg is None else float(kg): force for kg, force in forces.items()}


def _std(largest: float) -> Any:
    return Field(None, ge=0, le=largest, description=f"a standard deviation, 0 to {largest:g}")


_Text = Annotated[str, BeforeValidator(str)]
_Patterns = BeforeValidator(lambda files: [files] if isinstance(files, str) else files)
_Force = Annotated[float, Field(gt=0, lt=1e4)]
_Reason = Annotated[str, Field(pattern=r"\S")]
_EXCLUDED = Field(None, description='how it was excluded, for example mount = "tapped"')


class Table(BaseModel):
    """A table of study.toml: no key that it does not have, and no number written as text."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class FileTable(Table):
    """What [study] and [layouts.NAME] have in common."""

    sampling_rate_hz: float | None = Field(None, gt=0, lt=1e7, description="a positive number")
    columns: list[str] = Field([], description='a list of names, ["time_s", "base_g"]')
    take: int | None = Field(None, gt=0, description="the number of a take, from 1")


class StudyTable(FileTable):
    """[study]."""

    name: _Text = ""
    origin: Literal["measured", "synthetic"] = Field("measured", description='"measured", "synthetic"')
    description: _Text = ""


class LayoutTable(FileTable):
    """[layouts.NAME]: the files that are laid out otherwise, and how."""

    files: Annotated[list[_Reason], _Patterns] = Field(
        [], min_length=1, validate_default=True,
        description='a pattern of file names, or several: files = ["*_phone.csv"]',
    )  # fmt: skip
    channels: dict[str, Any] = {}


class ChannelTable(Table):
    """[channels.NAME]."""

    column: str | Annotated[int, Field(gt=0)] = Field("", description="a name, or a number from 1")
    unit: str = Field("", description="a unit")
    clock: str = Field("", description="the name of a column of times")
    sign: Annotated[float, AfterValidator(_is_sign)] = Field(1.0, description="1, -1 (a gain is a sensitivity)")
    sensitivity: Annotated[float | str, AfterValidator(_is_not_zero)] = Field(1.0, description=SENSITIVITIES)
    delay_s: float = Field(0.0, description="a number of seconds")
    gain_std: float | None = _std(1)
    delay_std_s: float | None = _std(1)


class KnownTable(Table):
    """[known]."""

    mass_std: float | None = _std(LARGEST_STD["mass_std"])
    gain_std: float | None = _std(LARGEST_STD["gain_std"])
    delay_std_s: float | None = _std(LARGEST_STD["delay_std_s"])
    static_force_n: Annotated[dict[float | None, _Force], BeforeValidator(_by_load)] = Field({}, description=_FORCES)
    load_share: float | None = Field(None, ge=SHARES[0], le=SHARES[1], description="a share from 0.3 to 1.2")
    mount: _Reason | None = _EXCLUDED
    relaxation: _Reason | None = _EXCLUDED
    load: _Reason | None = _EXCLUDED
    rocking: _Reason | None = _EXCLUDED
    drift: _Reason | None = _EXCLUDED
    share: _Reason | None = _EXCLUDED
    seating: _Reason | None = _EXCLUDED


class Document(Table):
    """The tables of a study.toml; what is in them is validated table by table."""

    study: dict[str, Any] = {}
    channels: dict[str, Any] = {}
    known: dict[str, Any] = {}
    layouts: dict[str, Any] = {}


def read_toml(file: Path) -> dict[str, Any]:
    """A file of TOML.

    Raises:
        InputFileError: it is none.
    """
    try:
        return tomllib.loads(file.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputFileError(file, f"is not TOML ({error})") from None


_Kind = TypeVar("_Kind", bound=Table)


def validated(kind: type[_Kind], file: Path, table: object, place: str = "") -> _Kind:
    """A table of a file, once it is valid.

    Args:
        kind: what it must be.
        table: as TOML has it.
        place: the table's name, empty for the document.
    """
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
    key = str(first["loc"][0]) if first["loc"] else ""
    value = table.get(key) if isinstance(table, Mapping) else table
    name = key if place in ("study", "") else f"{place}.{key}".rstrip(".")
    if first["type"] == "extra_forbidden":
        what = f"key of [{place}]" if place else "table"
        raise InputFileError(file, unknown(what, key, kind.model_fields))
    if first["type"] in ("dict_type", "model_type"):
        raise InputFileError(file, f"{name} is {value!r}", f"it must be a table, [{name}]")
    valid = f"valid: {kind.model_fields[key].description}"
    problem = f"{name} is missing" if first["type"] == "missing" else f"{name} = {value!r}"
    raise InputFileError(file, problem, valid, setting=name, value=value)
