"""Universal File Format, data set 58 (functions at nodal degrees of freedom), by pyuff."""

import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from fasbody.channels import Channels
from fasbody.formats.series import FormatError, Series, check_size, step_of

LIBRARY = "pyuff"
_TIME_RESPONSE, _ACCELERATION, _TIME, _REAL = 1, 12, 17, 4


def decode(file: Path) -> list[Series]:
    """Every time response of the file, named by its first identification line."""
    import pyuff

    with file.open("rb") as start:
        if b"    -1" not in start.read(200):
            raise FormatError("is not a universal file: it does not begin with the delimiter -1")
    source = pyuff.UFF(str(file))
    kinds = list(source.get_set_types())
    check_size(0, len(kinds))
    found, total = [], 0
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
        step = float(data.get("abscissa_inc") or 0.0)
        if not step and values.size > 1 and np.size(data["x"]) == values.size:
            step = float(data["x"][1] - data["x"][0])
        name = str(data.get("id1", "")).strip() or f"{data.get('rsp_node', 0)}:{data.get('rsp_dir', 0)}"
        unit = str(data.get("ordinate_axis_units_lab", "")).strip()
        rate = 1 / step if np.isfinite(step) and step > 0 else None
        found.append(Series(name, "" if unit in ("NONE", "*") else unit, values.astype(float), rate))
    again = {name for name, count in Counter(s.name for s in found).items() if count > 1}
    return [
        Series(f"{s.name}_{i + 1}" if s.name in again else s.name, s.unit, s.values, s.rate_hz)
        for i, s in enumerate(found)
    ]


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
