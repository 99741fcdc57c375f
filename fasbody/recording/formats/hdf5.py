"""HDF5 by h5py: every numeric dataset of one or two dimensions, with its `units` and `rate_hz` attributes."""

import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.channels import Channels
from fasbody.recording.formats import series
from fasbody.recording.formats.series import FormatError, Series, check_size, passed_over

LIBRARY = "h5py"
#: Letters or lines of a text that is read.
_WORDS = 10_000
MAGIC = b"\x89HDF\r\n\x1a\n"


def decode(file: Path) -> list[Series]:
    """Numeric datasets, named by their path. Links to other files are not followed, external data are refused."""
    import h5py

    columns: list[Series] = []
    total = 0
    with h5py.File(file, "r", locking=False) as source:
        datasets: list[tuple[str, Any]] = []
        groups: list[Any] = []

        def visit(name: str, item: Any) -> bool | None:
            if isinstance(item, h5py.Dataset):
                datasets.append((name, item))
            else:
                groups.append(item)
            return True if len(datasets) > series.MOST_SERIES else None

        source.visititems(visit)  # visits hard links only
        check_size(0, len(datasets))
        axes = {_axis(item) for _, item in datasets} - {""}
        for name, item in datasets:
            if _is_table(item):
                total += item.size * len(item.dtype.names)
                check_size(total)
                rows = item[()]
                numeric = [field for field in item.dtype.names if item.dtype[field].kind in "fiub"]
                rate = _rate(source, name)
                columns += [s for field in numeric for s in series.columns_of(f"{name}/{field}", rows[field], "", rate)]
                continue
            what = _no_numbers(item)
            if what or name.startswith("#"):
                columns += [] if name.startswith("#") else [passed_over(name, what, _text(item))]
                continue
            if item.external or item.is_virtual:
                raise FormatError(f"keeps the data of {name!r} in other files; save them in the file itself")
            total += int(np.prod([float(n) for n in item.shape]))
            check_size(total)
            axis = _axis(item) if len(axes) > 1 else ""
            about = {key: value for folder in _folders(source, name) for key, value in folder.attrs.items()}
            columns += series.of_variable(name, item[()], about, _rate(source, name), axis)
        columns, notes = _named(source, columns), dict(source.attrs)
        remarked = [remark for group in groups for remark in series.remarks(dict(group.attrs))]
    return series.with_rate(columns, notes) + remarked


def _text(item: Any) -> str:
    """The text of a dataset, "" of any other or a long one."""
    import h5py

    if item.attrs.get("MATLAB_class", b"") == b"char" and item.dtype.kind == "u" and item.size <= _WORDS:
        return "".join(map(chr, item[()].ravel(order="F")))
    if h5py.check_string_dtype(item.dtype) is None or item.shape is None or item.size > _WORDS:
        return ""
    return "\n".join(map(str, np.ravel(item.asstr(errors="replace")[()])))


def _axis(item: Any) -> str:
    """The dimension of a variable of NetCDF, which has a time of its own where there are several."""
    scale = item if item.is_scale else next(iter(item.dims[0].values()), None) if item.ndim == 1 else None
    return "" if scale is None or scale.name is None else str(scale.name).strip("/")


#: What Rattlesnake, a controller of shakers, calls the matrices of its streams.
_STREAM = re.compile(r"(time_data(?:_\d+)?)_(\d+)")


def _named(source: Any, columns: list[Series]) -> list[Series]:
    """Series under the names and units of Rattlesnake's table of channels, a group for each of its streams."""
    table = source.get("channels/node_number"), source.get("channels/node_direction"), source.get("channels/comment")
    if "time_data" not in source or None in table or "channels/unit" not in source:
        return columns
    nodes, ways, comments = ([str(x) for x in column.asstr()[()]] for column in table)
    units = [str(x) for x in source["channels/unit"].asstr()[()]]
    apart = all(comments) and len(set(comments)) == len(comments)
    names = comments if apart else [node + way for node, way in zip(nodes, ways, strict=True)]
    made = []
    for one in columns:
        match = _STREAM.fullmatch(one.name)
        if match and match[1] in source and source[match[1]].ndim == 2 and int(match[2]) <= len(names):
            place = int(match[2]) - 1
            made.append(replace(one, name=f"{match[1]}/{names[place]}", unit=units[place]))
        elif not one.name.startswith(("channels/", "environment_")):
            made.append(one)
    return made


def _is_table(item: Any) -> bool:
    """Whether a dataset has rows with named columns, no complex numbers."""
    named = item.dtype.names is not None and item.dtype.names != ("real", "imag") and item.shape is not None
    return named and item.ndim == 1 and not item.external and not item.is_virtual


def _no_numbers(item: Any) -> str:
    """What a dataset is if it is no vector or matrix of real numbers, else nothing."""
    kind = item.attrs.get("MATLAB_class", b"")
    if kind == b"char":
        return "text"
    if item.dtype.kind == "c" or item.dtype.names == ("real", "imag"):
        return "complex"
    if item.dtype.kind not in "fiub":
        return "a cell array" if kind == b"cell" else "no numbers"
    return "" if item.shape is not None and item.ndim <= 2 else "no vector or matrix"


def _folders(source: Any, name: str) -> list[Any]:
    """The file, the folders above a dataset, and it."""
    parts = name.split("/")
    return [source, *(source["/".join(parts[:count])] for count in range(1, len(parts) + 1))]


def _rate(source: Any, name: str) -> float | None:
    """The rate [Hz] that a dataset states, or a folder above it."""
    above = _folders(source, name)
    stated = ((f"{item.name}/{key}".strip("/"), value) for item in above for key, value in item.attrs.items())
    return series.stated_rate((key, series.number_of(value)) for key, value in stated)


#: What MATLAB writes into the first 128 bytes of version 7.3: text, no subsystem, version 2.0, little-endian.
_MATLAB = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, written by fasbody, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM"


def encode(channels: Channels, matlab: bool = False) -> bytes:
    """One dataset a channel, its unit as attribute.

    Args:
        channels: (n,) each.
        matlab: as version 7.3 of MATLAB's files, with its class on each variable; its axes are those reversed.
    """
    import h5py

    file = BytesIO()
    with h5py.File(file, "w", userblock_size=512 if matlab else 0) as out:
        for name, values in channels.items():
            data = np.asarray(values, float)[None, :] if matlab else values  # (1, n) here is n by 1 there
            dataset = out.create_dataset(name, data=data, compression="gzip", shuffle=True)
            dataset.attrs["units"] = "s" if name == "time_s" else "m/s^2"
            if matlab:
                dataset.attrs["MATLAB_class"] = np.bytes_("double")
    whole = file.getvalue()
    return _MATLAB + whole[len(_MATLAB) :] if matlab else whole
