"""NetCDF: version 4 is HDF5 and read as that; version 3 is read by scipy."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from fasbody.exceptions import pip_install
from fasbody.recording.formats import hdf5
from fasbody.recording.formats.series import FormatError, Series, check_size, columns_of, passed_over, with_rate

LIBRARY = "scipy"


def decode(file: Path) -> list[Series]:
    """Numeric variables of one or two dimensions, with their `units`, `scale_factor` and `add_offset`."""
    with file.open("rb") as start:
        head = start.read(8)
    if head == hdf5.MAGIC:
        if find_spec(hdf5.LIBRARY) is None:
            raise FormatError(f"is NetCDF 4, which needs h5py: {pip_install('formats')}")
        return hdf5.decode(file)
    if head[:3] != b"CDF":
        raise FormatError("is not a NetCDF file: it begins neither with CDF nor as HDF5 does")
    from scipy.io import netcdf_file

    series, total = list[Series](), 0
    with netcdf_file(file, mmap=False, maskandscale=False) as source:
        check_size(0, len(source.variables))
        for name, variable in source.variables.items():
            values = np.asarray(variable.data)
            if values.dtype.kind not in "fiu" or values.ndim > 2:
                series.append(passed_over(name, "no vector or matrix of numbers"))
                continue
            total += values.size
            check_size(total)
            attributes = {key: getattr(variable, key, None) for key in ("scale_factor", "add_offset", "_FillValue")}
            empty = (
                np.full(values.shape, False) if attributes["_FillValue"] is None else values == attributes["_FillValue"]
            )
            factor = 1.0 if attributes["scale_factor"] is None else float(attributes["scale_factor"])
            offset = 0.0 if attributes["add_offset"] is None else float(attributes["add_offset"])
            unit = getattr(variable, "units", b"")
            text = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else str(unit)
            scaled = f"scale_factor = {factor:g}" if factor != 1.0 else ""
            columns = columns_of(name, np.where(empty, np.nan, values * factor + offset), text)
            series += [replace(s, scaled=scaled) for s in columns]
    return with_rate(series)
