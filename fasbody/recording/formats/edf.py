"""EDF, EDF+ and BDF of biosignals by edfio: every signal with its label, physical dimension and rate."""

from pathlib import Path

import numpy as np

from fasbody.recording.formats.series import FormatError, Series, check_size, passed_over, remarks

LIBRARY = "edfio"


def decode(file: Path) -> list[Series]:
    """The signals; annotations are none."""
    import edfio

    with file.open("rb") as start:
        head = start.read(8)
    read = {b"0       ": edfio.read_edf, b"\xffBIOSEMI": edfio.read_bdf}.get(head)
    if read is None:
        raise FormatError("is neither an EDF nor a BDF file: it does not begin as they do")
    check_size(file.stat().st_size / 2)
    source = read(file)
    signals = [
        Series(s.label, s.physical_dimension, np.array(s.data, float), float(s.sampling_frequency),
               about={"prefiltering": s.prefiltering, "transducer_type": s.transducer_type})
        for s in source.signals
    ]  # fmt: skip
    if source.annotations:
        notes = "; ".join(f"{a.text} (at {a.onset:g})" for a in source.annotations if a.text)
        signals.append(passed_over("EDF Annotations", f"{len(source.annotations)} annotations", notes))
    return signals + remarks({"recording": source.local_recording_identification.replace("_", " ")})
