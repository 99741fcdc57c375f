"""MATLAB files: version 5 (and 4, 6, 7) by scipy, version 7.3, which is HDF5, by h5py."""

import math
from io import BytesIO
from pathlib import Path
from typing import Any

from fasbody.recording.channels import Channels
from fasbody.recording.formats import hdf5
from fasbody.recording.formats.series import FormatError, Series, check_size, columns_of, passed_over, with_rate

LIBRARY = "scipy"
_NUMERIC = {
    "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical",
}  # fmt: skip

_KINDS = {
    "cell": "a cell array",
    "char": "text", "sparse": "a sparse matrix", "function": "a function", "object": "an object",
    "opaque": "an object (a timetable? save s = table2struct(timetable2table(T), 'ToScalar', true))",
}  # fmt: skip


def decode(file: Path) -> list[Series]:
    """Numeric vectors and the columns of numeric matrices; a scalar named fs or rate_hz gives the rate.

    Fields of single structures are named ``structure/field``. Cells, text, objects and complex numbers are passed over.
    """
    from scipy.io import loadmat, whosmat

    with file.open("rb") as start:
        head = start.read(520)
    if head[512:520] == hdf5.MAGIC or head[:8] == hdf5.MAGIC:
        return hdf5.decode(file)
    if head.lstrip()[:1] in (b"{", b"<") or not head:
        raise FormatError("is not a MATLAB file")
    chosen: list[str] = []
    series: list[Series] = []
    total = 0.0
    for name, shape, kind in whosmat(str(file)):
        if name.startswith("__"):
            continue
        size = math.prod(map(float, shape))
        if (kind in _NUMERIC and len(shape) == 2) or kind == "char" or (kind == "struct" and size == 1):
            total += size
            check_size(total)
            chosen.append(name)
        else:
            what = "no matrix" if kind in _NUMERIC else f"of the class {kind}"
            series.append(passed_over(name, _KINDS.get(kind, what)))
    if not chosen:
        return series
    loaded = loadmat(str(file), variable_names=chosen, chars_as_strings=False, struct_as_record=True)
    for name in chosen:
        series += _fields(name, loaded.get(name))
    check_size(sum(s.values.size for s in series), len(series))
    return with_rate(series)


def _fields(name: str, values: Any, depth: int = 0) -> list[Series]:
    """Series of a variable, for a structure those of its fields."""
    kind = getattr(getattr(values, "dtype", None), "kind", "")
    if kind in ("f", "i", "u", "b") and values.ndim <= 2:
        return columns_of(name, values)
    if kind == "c":
        return [passed_over(name, "complex")]
    if kind == "V" and values.dtype.names and values.size == 1 and depth < _DEEPEST:
        record = values.reshape(-1)[0]
        return [s for field in values.dtype.names for s in _fields(f"{name}/{field}", record[field], depth + 1)]
    if kind in ("U", "S"):
        rows = values.reshape(-1, values.shape[-1]) if values.ndim else values.reshape(1, 1)
        return [passed_over(name, "text", "\n".join("".join(map(str, row)).strip() for row in rows))]
    what = {"O": "a cell array", "V": "a structure of several"}.get(kind, "no vector")
    return [passed_over(name, what)]


#: Structures in structures are read so deep.
_DEEPEST = 8


def encode(channels: Channels) -> bytes:
    """A version 5 file with one column vector a channel."""
    from scipy.io import savemat

    file = BytesIO()
    savemat(file, channels, oned_as="column", do_compression=True)
    return file.getvalue()
