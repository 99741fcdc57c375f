"""NetCDF: version 4 is HDF5 and read as that; version 3 is read by scipy."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from fasbody.exceptions import pip_install
from fasbody.recording.formats import hdf5
from fasbody.recording.formats.series import FormatError, Series, check_size, of_variable, with_rate

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
        notes = dict(source._attributes)
        axes = {variable.dimensions[0] for variable in source.variables.values() if variable.dimensions}
        for name, variable in source.variables.items():
            values = np.asarray(variable.data)
            total += values.size
            check_size(total)
            axis = variable.dimensions[0] if len(axes) > 1 and variable.dimensions else ""
            series += of_variable(name, values, variable._attributes, group=axis)
    return with_rate(series, notes)
