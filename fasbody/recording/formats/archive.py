"""A .zip of CSV files, as phyphox saves one for each sensor of a telephone: the columns of all of them."""

import tempfile
import zipfile
from pathlib import Path, PurePosixPath

from fasbody.exceptions import InputFileError
from fasbody.recording.channels import Layout
from fasbody.recording.csv import TextTable
from fasbody.recording.formats.series import FormatError, Series, check_size, passed_over

LIBRARY = "zipfile"


def decode(file: Path) -> list[Series]:
    """Columns by their headings."""
    if not zipfile.is_zipfile(file):
        raise FormatError("is no .zip file")
    series = list[Series]()
    with zipfile.ZipFile(file) as packed, tempfile.TemporaryDirectory() as folder:
        entries = [entry for entry in packed.infolist() if not entry.is_dir()]
        check_size(sum(entry.file_size for entry in entries) / 8, len(entries))
        for place, entry in enumerate(entries):
            path = PurePosixPath(entry.filename)
            if path.suffix.lower() not in (".csv", ".txt", ".tsv") or "meta" in path.parts:
                series.append(passed_over(entry.filename, "no table of samples"))
                continue
            plain = Path(folder) / f"{place}{path.suffix}"
            plain.write_bytes(packed.read(entry))
            series += _columns(plain, entry.filename, path.stem)
    return series


def _columns(plain: Path, name: str, group: str) -> list[Series]:
    """The columns of one text; none of one that is no table of numbers."""
    try:
        table = TextTable.open(plain, Layout(), strict=False)
        indices = {str(index): index for index in range(len(table.names))}
        columns = table.numbers(indices)
    except InputFileError as error:
        return [passed_over(name, f"no table of numbers ({str(error).partition(': ')[2].rstrip('.')})")]
    units = table.columns.units
    return [Series(table.names[int(key)], units[int(key)], values, group=group) for key, values in columns.items()]
