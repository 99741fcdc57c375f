"""Writing MATLAB 7.3, which is HDF5 with a block of text in front and MATLAB's class on every variable."""

from io import BytesIO

import numpy as np

from fasbody.recording.channels import Channels

LIBRARY = "h5py"
#: What MATLAB writes into the first 128 bytes: text, no subsystem, version 2.0, little-endian.
_HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, written by fasbody, HDF5 schema 1.00 .".ljust(116)
_HEADER += b" " * 8 + b"\x00\x02IM"


def encode(channels: Channels) -> bytes:
    """A version 7.3 file with one column vector a channel; the axes of an HDF5 dataset are reversed in MATLAB."""
    import h5py

    file = BytesIO()
    with h5py.File(file, "w", userblock_size=512) as out:
        for name, values in channels.items():
            column = np.asarray(values, float)[None, :]  # (1, n) here is n by 1 in MATLAB
            dataset = out.create_dataset(name, data=column, compression="gzip", shuffle=True)
            dataset.attrs["MATLAB_class"] = np.bytes_("double")
    return _HEADER + file.getvalue()[len(_HEADER) :]
