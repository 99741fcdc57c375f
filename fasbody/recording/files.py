"""A recording's channels from a file and into one, whatever its format: CSV here, instruments' files in formats/."""

import importlib
from pathlib import Path

import numpy as np

from fasbody.console import write_whole
from fasbody.exceptions import InputFileError
from fasbody.recording.channels import Channels, Layout
from fasbody.recording.csv import read_csv
from fasbody.recording.formats import ENDINGS
from fasbody.recording.formats.reader import read_series
from fasbody.recording.formats.series import FormatError, need

#: Endings of text files, which are read as CSV.
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")


def read(file: Path, layout: Layout | None = None) -> Channels:
    """The channels of a recording in any format, by the file's ending.

    Args:
        file: the file. layout: what study.toml says of its channels.

    Returns:
        ``time_s``, ``base_m_s2``, ``malleolus_m_s2`` and perhaps ``tuberosity_m_s2``, each (n,), delays undone.

    Raises:
        InputFileError: what is wrong with the file, in one sentence.
    """
    layout = layout or Layout()
    ending = file.suffix.lower()
    if ending in TEXTS:
        return _long_enough(file, layout.aligned(file, read_csv(file, layout)))
    if ending not in ENDINGS:
        raise InputFileError(file, f"no format has the ending {ending!r}", f"valid: {', '.join((*TEXTS, *ENDINGS))}")
    found = read_series(file)
    series = [s for s in found if not s.what]
    passed = [f"{s.name!r} is {s.what}" for s in found if s.what]
    wanted = layout.find(
        file, [s.name for s in series], [s.unit for s in series], None, passed, [s.values.size for s in series]
    )
    channels = {name: series[index].values * factor for name, (index, factor) in wanted.items()}
    if "time_s" not in channels:
        rates = {series[index].rate_hz for index, _ in wanted.values()} - {None}
        rates = rates or {next((s.rate_hz for s in series if s.rate_hz), None)} - {None}
        if len(rates) > 1:
            listed = ", ".join(f"{rate:g}" for rate in sorted(r for r in rates if r))
            raise InputFileError(file, f"its channels have different rates ({listed} Hz)", "resample them to one rate")
        rate = layout.rate_hz or next(iter(rates), None)
        if not rate:
            raise InputFileError(file, "has neither a time nor a sampling rate", "give sampling_rate_hz in study.toml")
        channels["time_s"] = np.arange(channels["base_m_s2"].size) / rate
    return _long_enough(file, layout.aligned(file, channels))


def _long_enough(file: Path, channels: Channels) -> Channels:
    if channels["time_s"].size < 2:
        raise InputFileError(file, f"holds {channels['time_s'].size} samples", "a recording needs at least two")
    return channels


def write(file: Path, channels: Channels, matlab: str = "5") -> None:
    """Write channels in the format of the file's ending.

    Args:
        file: to write. channels: as `read` gives them. matlab: version of a .mat file, "5" or "7.3".

    Raises:
        InputFileError: no such format, or the folder cannot be written.
    """
    ending = file.suffix.lower()
    if ending not in ENDINGS:
        raise InputFileError(file, f"no format has the ending {ending!r}", f"valid: .csv, {', '.join(ENDINGS)}")
    name = "mat73" if ending == ".mat" and matlab == "7.3" else ENDINGS[ending]
    module = importlib.import_module(f"fasbody.recording.formats.{name}")
    need(module.LIBRARY)
    try:
        content = module.encode(channels)
    except FormatError as error:
        raise InputFileError(file, str(error)) from None
    write_whole(file, content)
