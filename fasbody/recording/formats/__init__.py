"""Files of measuring instruments: MATLAB, HDF5, NetCDF, UFF 58, TDMS, LVM, Excel, sound, C3D, Parquet, EDF, archives.

Each module turns a file into `Series`, named columns with a unit and a rate, and writes channels. Files are read in a
child process of limited memory and time (reader.py), so that a broken or hostile file ends in a sentence.
"""

from pathlib import Path

#: Endings of the formats that are read and written, and the module of each.
ENDINGS = {
    ".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".uff": "uff", ".unv": "uff", ".tdms": "tdms",
}  # fmt: skip
#: Those, and what is only read.
READ = ENDINGS | {".xlsx": "xlsx", ".xlsm": "xlsx", ".lvm": "lvm", ".wav": "audio", ".flac": "audio", ".c3d": "c3d"}
READ |= {".nc": "netcdf", ".nc4": "netcdf", ".npz": "npz", ".parquet": "parquet", ".edf": "edf", ".bdf": "edf"}
READ |= {".zip": "archive"}


def ending(file: Path) -> str:
    """A file's ending in lower case, that of what is packed for `.gz`."""
    return Path(file.stem if file.suffix.lower() == ".gz" else file.name).suffix.lower()


def ending_removed(file: Path) -> str:
    """A file's name without its ending, and without that of what is packed for `.gz`."""
    return Path(file.stem if file.suffix.lower() == ".gz" else file.name).stem
