"""Universal File Format, data set 58 (functions at nodal degrees of freedom), by pyuff."""

import re
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from fasbody.recording.channels import ACCELERATIONS, Channels
from fasbody.recording.formats.series import FormatError, Series, check_size, step_of, uniform_step
from fasbody.recording.statements import texts_of

LIBRARY = "pyuff"
_DELIMITER = re.compile(rb"^ {4}-1[ \t]*\r?$", re.MULTILINE)
_TIME_RESPONSE, _ACCELERATION, _TIME, _REAL = 1, 12, 17, 4
#: What a data set can call its ordinate, and no accelerometer measures.
_LINES = ("id2", "id3", "id4", "id5")
_MOTIONS = {8: "displacement", 11: "velocity"}


def decode(file: Path) -> list[Series]:
    """Every time response of the file, named by its first identification line."""
    import pyuff

    whole = file.read_bytes()
    if b"    -1" not in whole[:200]:
        raise FormatError("is not a universal file: it does not begin with the delimiter -1")
    if len(_DELIMITER.findall(whole)) % 2:
        raise FormatError("is cut off: its last data set has no end")
    source = pyuff.UFF(str(file))
    kinds = list(source.get_set_types())
    check_size(0, len(kinds))
    series, total = list[Series](), 0
    for index, kind in enumerate(kinds):
        if int(kind) != 58:
            continue
        data = source.read_sets(index)
        if int(data.get("func_type", _TIME_RESPONSE)) not in (0, _TIME_RESPONSE):
            continue
        values = np.atleast_1d(np.asarray(data["data"]))
        if values.dtype.kind not in "fiu":
            continue
        total += values.size
        check_size(total)
        x = np.asarray(data["x"], float)
        step: float | None = float(data.get("abscissa_inc") or 0.0)
        start = float(data.get("abscissa_min") or 0.0)
        if int(data.get("abscissa_spacing", 1)) == 0:  # uneven: a time for each sample
            step, start = uniform_step(x), float(x[0]) if x.size else 0.0
        if step is None:  # the times of the channel behind them
            series.append(Series(f"time {len(series) + 1}", "s", x))
        name = str(data.get("id1", "")).strip() or f"{data.get('rsp_node', 0)}:{data.get('rsp_dir', 0)}"
        unit = str(data.get("ordinate_axis_units_lab", "")).strip()
        kind_of = _MOTIONS.get(int(data.get("ordinate_spec_data_type") or 0))
        if kind_of and unit.lower() in ACCELERATIONS:
            raise FormatError(f"calls {name!r} a {kind_of} and gives its unit as {unit}; correct one of them")
        rate = 1 / step if step and np.isfinite(step) and step > 0 else None
        unit = "" if unit in ("NONE", "*") else unit
        about = texts_of({key: str(data.get(key, "")).strip() for key in _LINES})
        series.append(Series(name, unit, values.astype(float), rate, start_s=start if rate else None, about=about))
    names = [s.name for s in series]
    if len({s.rate_hz is None for s in series}) > 1:
        raise FormatError("has channels with a sampling rate and channels with uneven times; resample them to one rate")
    return [replace(s, name=f"{s.name}_{i + 1}") if names.count(s.name) > 1 else s for i, s in enumerate(series)]


def encode(channels: Channels) -> bytes:
    """One set 58 a channel, in double precision."""
    import pyuff

    t = channels["time_s"]
    step = step_of(t)
    sets = []
    for node, (name, values) in enumerate(((k, v) for k, v in channels.items() if k != "time_s"), 1):
        sets.append(
            pyuff.prepare_58(
                binary=0, id1=name, func_type=_TIME_RESPONSE, rsp_ent_name="foot", rsp_node=node, rsp_dir=2,
                ref_ent_name="foot", ref_node=1, ref_dir=2, ord_data_type=_REAL, num_pts=values.size,
                abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=step, abscissa_spec_data_type=_TIME,
                abscissa_axis_units_lab="s", ordinate_spec_data_type=_ACCELERATION,
                ordinate_axis_units_lab="m/s^2", data=values, x=t, ver_num=0, load_case_id=0,
                orddenom_spec_data_type=0, z_axis_value=0.0, z_axis_spec_data_type=0,
            )
        )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "out.uff"
        pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")
        return path.read_bytes()
