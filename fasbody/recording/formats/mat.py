"""MATLAB files: version 5 (and 4, 6, 7) by scipy, version 7.3, which is HDF5, by h5py."""

from io import BytesIO
from pathlib import Path

from fasbody.recording.channels import Channels
from fasbody.recording.formats import hdf5
from fasbody.recording.formats.series import FormatError, Series, check_size, columns_of, passed_over, with_rate

LIBRARY = "scipy"
_NUMERIC = {
    "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical",
}  # fmt: skip

_KINDS = {
    "struct": "a structure (save its fields: save('file.mat', '-struct', 'name'))", "cell": "a cell array",
    "char": "text", "sparse": "a sparse matrix", "function": "a function", "object": "an object",
    "opaque": "an object (a table? save its columns)",
}  # fmt: skip


def decode(file: Path) -> list[Series]:
    """Numeric vectors and the columns of numeric matrices; a scalar named fs or rate_hz gives the rate.

    Structures, cells, text, objects and complex numbers are passed over, the former never built.
    """
    from scipy.io import loadmat, whosmat

    with file.open("rb") as start:
        head = start.read(520)
    if head[512:520] == hdf5.MAGIC or head[:8] == hdf5.MAGIC:
        return hdf5.decode(file)
    if head.lstrip()[:1] in (b"{", b"<") or not head:
        raise FormatError("is not a MATLAB file")
    chosen: list[str] = []
    found: list[Series] = []
    total = 0.0
    for name, shape, kind in whosmat(str(file)):
        size = 1.0
        for n in shape:
            size *= max(n, 0)
        if kind in _NUMERIC and len(shape) == 2 and not name.startswith("__"):
            total += size
            check_size(total)
            chosen.append(name)
        elif not name.startswith("__"):
            found.append(
                passed_over(name, _KINDS.get(kind, f"of the class {kind}" if kind not in _NUMERIC else "no matrix"))
            )
    if not chosen:
        return found
    loaded = loadmat(str(file), variable_names=chosen, chars_as_strings=False, struct_as_record=True)
    for name in chosen:
        values = loaded.get(name)
        kind = getattr(getattr(values, "dtype", None), "kind", "")
        if kind in ("f", "i", "u", "b"):
            found += columns_of(name, values)
        elif kind == "c":
            found.append(passed_over(name, "complex"))
    return with_rate(found)


def encode(channels: Channels) -> bytes:
    """A version 5 file with one column vector a channel."""
    from scipy.io import savemat

    file = BytesIO()
    savemat(file, channels, oned_as="column", do_compression=True)
    return file.getvalue()
