"""Parquet by pyarrow: its numeric columns, dates as time, units and rate from the metadata of columns and file."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.formats.series import (
    FormatError,
    Series,
    check_size,
    named_by,
    passed_over,
    remarks,
    stated_rate,
)
from fasbody.recording.statements import statements_of, texts_of
from fasbody.recording.text import number, numeric

LIBRARY = "pyarrow"
#: What libraries keep there for themselves.
_OF_LIBRARIES = ("pandas", "ARROW:schema")


def decode(file: Path) -> list[Series]:
    """Every column of numbers or dates; an empty cell is NaN."""
    with file.open("rb") as start:
        if start.read(4) != b"PAR1":
            raise FormatError("is not a Parquet file: it does not begin with PAR1")
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # the others reserve more than this process may have
    from pyarrow import parquet

    source = parquet.ParquetFile(file)
    about = source.metadata
    check_size(float(about.num_rows) * about.num_columns, about.num_columns)
    metadata = _texts(source.schema_arrow.metadata)
    rate = stated_rate((key, number(value)) for key, value in metadata.items() if numeric(value))
    table = source.read(use_threads=False)
    series = [_series(field, table.column(place), rate, metadata) for place, field in enumerate(table.schema)]
    return series + remarks({key: text for key, text in metadata.items() if key not in _OF_LIBRARIES})


def _series(field: Any, column: Any, rate_hz: float | None, notes: dict[str, str]) -> Series:
    from pyarrow import types

    metadata = _texts(field.metadata)
    unit = metadata.get("unit", metadata.get("units", ""))
    if types.is_temporal(field.type):
        stamps = column.cast("timestamp[ns]" if types.is_timestamp(field.type) else field.type).to_numpy()
        if stamps.dtype.kind in "mM" and stamps.size and not np.isnat(stamps).any():
            return Series(field.name, "s", (stamps - stamps[0]) / np.timedelta64(1, "ns") * 1e-9, rate_hz)
    if not (types.is_integer(field.type) or types.is_floating(field.type) or types.is_decimal(field.type)):
        return passed_over(field.name, "no column of numbers")
    values = column.cast("float64").to_numpy().astype(float)
    stated = named_by(field.name, notes.items()) | statements_of(metadata)
    return Series(field.name, unit, values, rate_hz, stated=stated, about=texts_of(metadata))


def _texts(metadata: Any) -> dict[str, str]:
    pairs = (metadata or {}).items()
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in pairs}
