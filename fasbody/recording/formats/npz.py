"""numpy's .npz: its numeric arrays of one or two dimensions, by their names; Python objects are not loaded."""

import zipfile
from pathlib import Path

import numpy as np

from fasbody.recording.formats.series import (
    FormatError,
    Series,
    check_size,
    numeric_columns,
    passed_over,
    text_of,
    with_rate,
)

LIBRARY = "numpy"
#: Lines of a text that is read.
_WORDS = 10_000


def decode(file: Path) -> list[Series]:
    """Numeric arrays; a scalar named fs or rate_hz gives the rate."""
    if not zipfile.is_zipfile(file):
        raise FormatError("is not an archive of numpy's: it is no .zip file")
    with zipfile.ZipFile(file) as packed:
        check_size(sum(entry.file_size for entry in packed.infolist()) / 8, len(packed.infolist()))
    series = list[Series]()
    with np.load(file, allow_pickle=False) as source:
        for name in source.files:
            try:
                values = source[name]
            except ValueError:  # an array of Python objects
                series.append(passed_over(name, "no numbers"))
                continue
            if values.dtype.kind in "US" and values.size <= _WORDS:
                series.append(passed_over(name, "text", "\n".join(map(text_of, values.ravel().tolist()))))
                continue
            series += numeric_columns(name, values)
    return with_rate(series)
