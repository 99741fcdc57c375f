"""Files of measuring instruments: MATLAB 5 and 7.3, HDF5, UFF 58 and TDMS.

Each module turns a file into `Series`, named columns with a unit and a rate, and writes channels. Files are read in a
child process of limited memory and time (reader.py), so that a broken or hostile file ends in a sentence.
"""

#: Endings of the binary formats, and the module that reads and writes each.
ENDINGS = {
    ".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".uff": "uff", ".unv": "uff", ".tdms": "tdms",
}  # fmt: skip
