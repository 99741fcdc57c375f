"""C3D of motion capture by ezc3d: its analog channels, with label, unit and rate."""

from pathlib import Path
from typing import Any

import numpy as np

from fasbody.recording.formats.series import FormatError, Series, check_size, remarks

LIBRARY = "ezc3d"


def decode(file: Path) -> list[Series]:
    """The analog channels, scaled as the file states; markers are no accelerations."""
    import ezc3d

    with file.open("rb") as start:
        if start.read(2)[1:] != b"\x50":
            raise FormatError("is not a C3D file: its second byte is not 0x50")
    source = ezc3d.c3d(str(file))
    analog = source["parameters"].get("ANALOG", {})
    values = np.asarray(source["data"]["analogs"], float)
    if values.size == 0:
        raise FormatError("has no analog channels (markers are no accelerations); export the accelerometers with it")
    table = values.reshape(-1, values.shape[-1]) if values.ndim < 3 else values[0]
    check_size(table.size, table.shape[0])
    remarked = remarks({
        f"{group}:{key}": "; ".join(map(str, item["value"]))
        for group, items in source["parameters"].items() if group not in ("ANALOG", "POINT", "__METADATA__")
        for key, item in items.items() if isinstance(item, dict) and _has_words(item.get("value"))
    })  # fmt: skip
    texts = [str(x) for x in analog.get("DESCRIPTIONS", {}).get("value", [])]
    labels, units = ([str(x) for x in analog.get(key, {}).get("value", [])] for key in ("LABELS", "UNITS"))
    rate = float(source["header"]["analogs"]["frame_rate"])
    return [
        Series(
            labels[i].strip() if i < len(labels) and labels[i].strip() else f"analog_{i + 1}",
            units[i].strip() if i < len(units) else "", row.copy(), rate if 0 < rate < 1e9 else None,
            about={"description": texts[i]} if i < len(texts) else {},
        )
        for i, row in enumerate(table)
    ] + remarked  # fmt: skip


def _has_words(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0 and isinstance(value[0], str)
