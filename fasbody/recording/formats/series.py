"""What every format is read into, and the sizes beyond which a file is refused before anything is allocated."""

import importlib.util
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fasbody.exceptions import MissingPackageError
from fasbody.recording.statements import Statements, counts_kept, kind, statements_of, texts_of

#: Most samples of all channels of a file together: 160 MB of floats, an hour of five channels at 1 kHz.
MOST_SAMPLES = 20_000_000
#: Most channels of a file.
MOST_SERIES = 1000


class FormatError(Exception):
    """What is wrong with a file, continuing the sentence after its name."""


@dataclass(frozen=True, eq=False)
class Series:
    """One column of a file.

    Attributes:
        name: as in the file.
        unit: as in the file, "" if it states none.
        values: (n,).
        rate_hz: if the file states it.
        what: empty, or what this is instead of a column of real numbers; it then has no values.
        start_s: when the first sample was taken [s], on one clock for the whole file, if stated.
        scaled: by which statement of the file its values were scaled.
        stated: of its time or scale, and not applied.
        about: what else the file says of it, by name.
        group: its sheet, structure or folder.
    """

    name: str
    unit: str
    values: np.ndarray
    rate_hz: float | None = None
    what: str = ""
    start_s: float | None = None
    scaled: str = ""
    stated: Statements = field(default_factory=dict)
    about: dict[str, str] = field(default_factory=dict)
    group: str = ""


def passed_over(name: str, what: str, text: str = "") -> Series:
    """Something in a file that is no column of real numbers, to be named in messages, and what it says."""
    return Series(name, "", np.empty(0), None, what, about={"text": text} if text else {})


#: What words beside the columns are.
REMARK = "a remark"


def remarks(pairs: Mapping[str, Any]) -> list[Series]:
    """What a file says in words of itself, to be quoted where it is of a sensor or an amount.

    Args:
        pairs: names and values; a number is of interest if it is how many samples one was kept of.
    """
    texts = (
        (name, text)
        for name, text in texts_of(pairs).items()
        if re.search(r"[^\W\d]", text) or counts_kept(name)
    )
    return [passed_over(name, REMARK, f"{name}: {text}") for name, text in texts]


def check_size(samples: float, series: int = 1) -> None:
    """Refuse what a header announces before it is allocated."""
    if not 0 <= samples <= MOST_SAMPLES:
        raise FormatError(f"announces {samples:.4g} samples, more than the {MOST_SAMPLES:.0e} that are read")
    if series > MOST_SERIES:
        raise FormatError(f"holds more than {MOST_SERIES} channels")


def columns_of(name: str, values: np.ndarray, unit: str = "", rate_hz: float | None = None) -> list[Series]:
    """Series of an array: itself if it is a vector, else its columns, named ``name_1``, ``name_2`` ..."""
    array = np.asarray(values, float)
    if array.ndim > 2 or array.size == 0:
        return []
    if array.ndim < 2 or 1 in array.shape:
        return [Series(name, unit, array.reshape(-1), rate_hz)]
    tall = array if array.shape[0] >= array.shape[1] else array.T
    check_size(tall.size, tall.shape[1])
    return [Series(f"{name}_{i + 1}", unit, tall[:, i].copy(), rate_hz) for i in range(tall.shape[1])]


def numeric_columns(name: str, values: np.ndarray, unit: str = "", rate_hz: float | None = None) -> list[Series]:
    """The columns of an array of real numbers; of any other array its name."""
    if values.dtype.kind in "fiub" and values.ndim <= 2:
        return columns_of(name, values, unit, rate_hz)
    return [passed_over(name, "no vector or matrix of numbers")]


def number_of(value: Any) -> float | None:
    """An attribute as a finite number, None where it is none."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    return float(value) if isinstance(value, int | float | np.number) and np.isfinite(value) else None


def text_of(attribute: object) -> str:
    """An attribute as text, "" where it is none."""
    if isinstance(attribute, bytes):
        return attribute.decode("utf-8", "replace")
    return attribute if isinstance(attribute, str) else ""


def told_apart(series: list[Series]) -> list[Series]:
    """With the group in front of a name that stands in several of them."""
    again = Counter(name for name, _ in {(s.name, s.group) for s in series})
    return [replace(s, name=f"{s.group}/{s.name}" if again[s.name] > 1 and s.group else s.name) for s in series]


#: Names, in small letters, under which programs store the sampling rate [Hz], and the sampling interval [s].
RATES = (
    "rate_hz", "sampling_rate_hz", "fs", "sample_rate", "samplerate", "sampling_rate", "samplingrate",
    "sampling_frequency", "samplingfrequency",
)  # fmt: skip
STEPS = (
    "dt", "dt_s", "sampling_interval", "sampling_interval_s", "increment", "time_base_s", "tinterval",
)  # fmt: skip
#: And the time of the first sample [s].
STARTS = ("start_s", "start_time_s", "start_time", "t0", "t0_s", "start_value", "tstart")
#: Two statements of a rate that differ by more than this share are two rates.
_ALIKE = 1e-3


#: Attributes that are applied by the CF conventions.
_SCALES = ("scale_factor", "add_offset")
#: And by the libraries.
_INNER = ("_fillvalue", "_netcdf4dimid", "_netcdf4coordinates", "matlab_class", "h5path")


def of_variable(
    name: str, values: np.ndarray, about: Mapping[str, Any], rate_hz: float | None = None, group: str = ""
) -> list[Series]:
    """The columns of an array with attributes: unit, scale by the CF conventions, start, and what is not applied.

    Args:
        name: of the array.
        values: as stored.
        about: its attributes.
        rate_hz: that the file states.
        group: its dimension.
    """
    numbers = {key: number_of(about.get(key)) for key in (*_SCALES, "_FillValue", *STARTS)}
    factor, offset, empty, *starts = numbers.values()
    wrong = next((key for key in _SCALES if key in about and numbers[key] is None), None)
    if wrong:
        raise FormatError(f"the attribute {wrong} of {f'/{name}'!r} is no number; give one, or delete it")
    if empty is not None and values.dtype.kind in "iuf":
        values = np.where(values == empty, np.nan, values)
    if factor is not None or offset is not None:
        values = np.asarray(values, float) * (1.0 if factor is None else factor) + (offset or 0.0)
    start = next((value for value in starts if value is not None), None)
    scaled = f"scale_factor = {factor:g}" if factor not in (None, 1.0) else ""
    applied = (*_SCALES, *(key for key in STARTS if numbers[key] is not None), *RATES, *STEPS, *_INNER)
    stated = statements_of(about, applied)
    unit = text_of(about.get("units", about.get("unit", b"")))
    columns = numeric_columns(name, values, unit, rate_hz)
    more = texts_of(about, applied)
    return [replace(s, scaled=scaled, stated=stated, start_s=start, group=group, about=more) for s in columns]


def stated_rate(statements: Iterable[tuple[str, float | None]]) -> float | None:
    """The sampling rate [Hz] of names and numbers, None if none of them states it."""
    rates: list[tuple[str, float]] = []
    for name, value in statements:
        key = name.rsplit("/")[-1].lower()
        if value is None or not 0 < value < 1e9 or key not in RATES + STEPS:
            continue
        rates.append((f"{name} = {value:g}", value if key in RATES else 1 / value))
    for text, rate in rates[1:]:
        if abs(rate - rates[0][1]) > _ALIKE * rate:
            raise FormatError(f"states two sampling rates, {rates[0][0]} and {text}; delete the wrong one")
    return rates[0][1] if rates else None


def with_rate(series: list[Series], notes: Mapping[str, Any] | None = None) -> list[Series]:
    """Without the scalars: one that is named like a rate, interval or start is that of the series below its folder.

    Simcenter writes them into ``x_values`` beside the ``y_values``. Where no scalar is above a series, those of folders
    that hold nothing else count. Of names that are paths, the folders become groups.

    Args:
        series: of the file.
        notes: of the whole file.
    """
    scalars = [s for s in series if s.values.size == 1 and not s.what]
    few = [s for s in series if 1 < s.values.size <= _FEW and kind(s.name.rpartition("/")[2])]
    listed = {s.name.rpartition("/")[2]: s.values.tolist() for s in few}
    kept = [s for s in series if s.what or (s.values.size > 1 and s not in few)]
    filled = {_folder(s) for s in kept}

    def stated_above(one: Series) -> list[tuple[str, float]]:
        above = [s for s in scalars if f"{_folder(one)}/".startswith(f"{_folder(s)}/".lstrip("/"))]
        return [(s.name, float(s.values[0])) for s in above or scalars if above or _folder(s) not in filled]

    rated = []
    for s in kept:
        stated, start = stated_above(s), s.start_s
        folder, _, name = s.name.rpartition("/")
        for key, value in stated:
            start = value if start is None and key.rpartition("/")[2].lower() in STARTS else start
        mine = named_by(name, [*(notes or {}).items(), *stated]) | listed | s.stated
        rate = s.rate_hz or stated_rate(stated)
        rated.append(replace(s, name=name, group=s.group or folder, rate_hz=rate, start_s=start, stated=mine))
    beside = {s.name.rpartition("/")[2]: float(s.values[0]) for s in scalars}
    return rated + remarks(
        {**(notes or {}), **{name: v for name, v in beside.items() if counts_kept(name)}}
    )


def named_by(name: str, pairs: Iterable[tuple[str, Any]]) -> Statements:
    """Statements whose names hold that of a channel, without it: gain_base, of base_g."""
    about, mine = dict[str, Any](), _words(name)
    for key, value in pairs:
        words = _words(key)
        if any(word in mine and not kind(word) and len(word) > 2 for word in words):
            about["_".join(word for word in words if word not in mine or kind(word))] = value
    return statements_of(about)


#: Numbers for each of so many channels are statements, not samples.
_FEW = 12


def _words(name: str) -> list[str]:
    return re.split(r"[^a-z0-9]+", name.rpartition("/")[2].lower())


def _folder(series: Series) -> str:
    return series.name.rpartition("/")[0].removesuffix("x_values").rstrip("/")


#: A uniform time has every sample within this share of an interval of its place.
_JITTER = 0.05


def uniform_step(time_s: np.ndarray) -> float | None:
    """The sampling interval [s], None if the time is not uniform."""
    count = time_s.size - 1
    step = float((time_s[-1] - time_s[0]) / count) if count > 0 else 0.0
    if not (np.isfinite(step) and step > 0):
        return None
    off = np.abs(time_s - time_s[0] - step * np.arange(count + 1)).max()
    return step if off <= _JITTER * step else None


def step_of(time_s: np.ndarray) -> float:
    """The sampling interval [s], for formats that store nothing else of the time."""
    step = uniform_step(time_s)
    if step is None:
        raise FormatError("stores a sampling rate only, and this recording's time is not uniform; write .csv or .h5")
    return step


#: Packages that are not called as they are imported.
_PACKAGES = {"nptdms": "npTDMS"}


def need(library: str) -> None:
    """Refuse a format whose library is missing, and name the extra to install."""
    if importlib.util.find_spec(library) is None:
        instead = "save the sheet as CSV" if library == "openpyxl" else ""
        raise MissingPackageError(_PACKAGES.get(library, library), "formats", otherwise=instead)
