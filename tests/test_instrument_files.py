"""Files as instruments and programs write them, each by an independent writer, of a signal whose answer is known.

Every function writes one file. Most are read at once; some need a study.toml, which stands with them; what is refused
says why. benchmarks/instrument_files.md lists them, and a test keeps list and page equal.
"""

import csv
import gzip
import json
import re
import wave
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from fasbody.exceptions import FasError
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from fasbody.recording.trials import describe
from fasbody.transmissibility.estimate import rows

T, PHASE_DEG, HZ, RATE = 1.3, -25.0, 20.0, 1000
TIME = np.arange(1000) / RATE
BASE = 8.95 * np.sin(2 * np.pi * HZ * TIME + 0.3)
MALLEOLUS = T * 8.95 * np.sin(2 * np.pi * HZ * TIME + 0.3 + np.radians(PHASE_DEG))
TABLE = list(zip(TIME.tolist(), BASE.tolist(), MALLEOLUS.tolist(), strict=True))
G = 9.80665

Writer = Callable[[Path], None]


@dataclass(frozen=True)
class Case:
    """One file: what writes it, and what reading it takes: a study.toml, or the words of its refusal."""

    what: str
    name: str
    needs: str
    write: Writer
    toml: str = ""
    refused: str = ""


CASES: list[Case] = []


def made(what: str, name: str, needs: str = "", toml: str = "", refused: str = "") -> Callable[[Writer], Writer]:
    """Add a file to the list."""

    def add(write: Writer) -> Writer:
        CASES.append(Case(what, name, needs, write, toml, refused))
        return write

    return add


def columns(base: str, malleolus: str, more: str = "") -> str:
    """A study.toml that names two columns and says the same of both."""
    return f'[channels.base]\ncolumn = "{base}"\n{more}\n[channels.malleolus]\ncolumn = "{malleolus}"\n{more}\n'


def cells(
    time: float = 1.0, scale: float = 1.0, decimal: str = ".", digits: int = 7, places: int = 6
) -> list[list[str]]:
    """The table as text, time and accelerations in other units."""
    return [
        [f"{t * time:.{places}f}".replace(".", decimal), *(f"{a * scale:.{digits}g}".replace(".", decimal) for a in ab)]
        for t, *ab in TABLE
    ]


def text(file: Path, head: str, body: list[list[str]], mark: str, encoding: str = "utf-8", end: str = "\n") -> None:
    file.write_bytes((head + "".join(mark.join(row) + "\n" for row in body)).replace("\n", end).encode(encoding))


# ---- tables


@made("CSV by Python's csv", "plain.csv")
def _(file: Path) -> None:
    with file.open("w", newline="") as out:
        csv.writer(out).writerows([("time_s", "base_m_s2", "malleolus_m_s2"), *TABLE])


@made("CSV with every cell quoted", "quoted.csv")
def _(file: Path) -> None:
    with file.open("w", newline="") as out:
        csv.writer(out, quoting=csv.QUOTE_ALL).writerows([("time_s", "base_m_s2", "malleolus_m_s2"), *TABLE])


@made("CSV by pandas, its index in front", "pandas.csv")
def _(file: Path) -> None:
    import pandas as pd

    pd.DataFrame(TABLE, columns=["time_s", "base_m_s2", "malleolus_m_s2"]).to_csv(file)


@made("CSV by pandas, indexed by date and time", "dates.csv")
def _(file: Path) -> None:
    import pandas as pd

    stamps = pd.Timestamp("2026-03-04 10:00:00.25") + pd.to_timedelta(TIME, "s")
    pd.DataFrame({"base_m_s2": BASE, "malleolus_m_s2": MALLEOLUS}, pd.Index(stamps, name="time")).to_csv(file)


@made("CSV with the time of the day", "clock.csv")
def _(file: Path) -> None:
    start = datetime(2026, 3, 4, 23, 59, 59, 500_000)
    body = [
        [(start + timedelta(seconds=t)).strftime("%H:%M:%S.%f"), *row[1:]] for t, row in zip(TIME, cells(), strict=True)
    ]
    text(file, "Time,base [m/s^2],malleolus [m/s^2]\n", body, ",")


@made("CSV by numpy.savetxt, header behind #", "savetxt.csv")
def _(file: Path) -> None:
    np.savetxt(file, TABLE, delimiter=",", header="time_s,base_m_s2,malleolus_m_s2")


@made("CSV with a mark of byte order, CRLF", "bom.csv")
def _(file: Path) -> None:
    text(file, "time_s,base_m_s2,malleolus_m_s2\n", cells(), ",", "utf-8-sig", "\r\n")


@made("CSV with carriage returns alone", "old_mac.csv")
def _(file: Path) -> None:
    text(file, "time_s,base_m_s2,malleolus_m_s2\n", cells(), ",", end="\r")


@made("CSV of a German Excel: semicolons, decimal commas, g", "deutsch.csv")
def _(file: Path) -> None:
    text(file, "sep=;\nZeit;base [g];malleolus [g]\n".replace("Zeit", "time [s]"), cells(1, 1 / G, ","), ";", "cp1252")


@made("CSV with decimal commas in quotes", "quoted_comma.csv")
def _(file: Path) -> None:
    body = [[f'"{cell}"' for cell in row] for row in cells(decimal=",")]
    text(file, "time_s,base_m_s2,malleolus_m_s2\n", body, ",")


@made("Excel's Unicode text: UTF-16, tabs", "unicode.txt")
def _(file: Path) -> None:
    text(file, "time [ms]\tbase [m/s²]\tmalleolus [m/s²]\n", cells(1e3), "\t", "utf-16", "\r\n")


@made("preamble in Latin-1, a row of units, decimal commas (as catman)", "catman.asc")
def _(file: Path) -> None:
    head = "Prüfstand 3\nDatum:\t04.03.2026\nKanäle:\t3\nMessrate:\t1000 Hz\n\n"
    head += "time\tbase\tmalleolus\ns\tm/s²\tm/s²\n"
    text(file, head, cells(decimal=","), "\t", "latin-1", "\r\n")


@made("blanks between columns", "blanks.txt")
def _(file: Path) -> None:
    text(file, "   time_ms    base_g  malleolus_g\n", cells(1e3, 1 / G), "   ")


@made("bars between columns, comments", "bars.dat")
def _(file: Path) -> None:
    text(file, "// logger 7\n# left foot\ntime_us|base_mg|malleolus_mg\n", cells(1e6, 1e3 / G), "|")


@made("CSV in µs and mm/s²", "micro.csv")
def _(file: Path) -> None:
    text(file, "time (µs),base (mm/s²),malleolus (mm/s²)\n", cells(1e6, 1e3), ",")


@made("DEWESoft's text", "dewesoft.txt")
def _(file: Path) -> None:
    head = "File name: run_007.dxd\nSample rate: 1000 Hz\n\nData1\nTime (s)\tbase (m/s2)\tmalleolus (m/s2)\n"
    text(file, head, cells(), "\t")


@made("CSV packed by gzip", "packed.csv.gz")
def _(file: Path) -> None:
    body = "\n".join(",".join(row) for row in cells())
    file.write_bytes(gzip.compress(f"time_s,base_m_s2,malleolus_m_s2\n{body}\n".encode()))


@made("stamps rounded to ms at 800 Hz", "rounded.csv")
def _(file: Path) -> None:
    t = np.arange(800) / 800
    base, malleolus = (a * np.sin(2 * np.pi * HZ * t + p) for a, p in ((9, 0.0), (9 * T, np.radians(PHASE_DEG))))
    body = [[f"{x:.3f}", f"{b:.6f}", f"{m:.6f}"] for x, b, m in zip(t, base, malleolus, strict=True)]
    text(file, "time_s,base_m_s2,malleolus_m_s2\n", body, ",")


@made("gravity in both channels, gaps between channels' names", "gravity.csv")
def _(file: Path) -> None:
    body = [[f"{t:.4f}", f"{b / G + 1:.7f}", f"{m / G + 1:.7f}"] for t, b, m in TABLE]
    text(file, "Time [s] , Base [g] , Malleolus [g]\n", body, " , ")


@made("BIDS: .tsv with a .json beside it", "sub-01_task-20Hz_motion.tsv")
def _(file: Path) -> None:
    text(file, "", [row[1:] for row in cells()], "\t")
    about = {"SamplingFrequency": RATE, "Columns": ["base", "malleolus"]}
    units = {name: {"Units": "m/s^2"} for name in ("base", "malleolus")}
    file.with_suffix(".json").write_text(json.dumps(about | units))


@made("BIDS: .tsv.gz with _channels.tsv", "sub-01_task-20Hz_physio.tsv.gz")
def _(file: Path) -> None:
    body = "".join("\t".join(row[1:]) + "\n" for row in cells(scale=1 / G))
    file.write_bytes(gzip.compress(body.encode()))
    file.with_name("sub-01_task-20Hz_physio.json").write_text(json.dumps({"SamplingFrequency": RATE}))
    file.with_name("sub-01_task-20Hz_channels.tsv").write_text("name\ttype\tunits\nbase\tACC\tg\nmalleolus\tACC\tg\n")


@made("numbers alone", "bare.log", toml='[study]\ncolumns = ["time_s", "base_m_s2", "malleolus_m_s2"]\n')
def _(file: Path) -> None:
    text(file, "", cells(), " ")


@made(
    "an oscilloscope's CSV (as PicoScope): volts in a row of units, ms", "pico.csv",
    toml=columns("Channel A", "Channel B", 'sensitivity = "100 mV/g"'),
)  # fmt: skip
def _(file: Path) -> None:
    text(file, "Time,Channel A,Channel B\n(ms),(V),(V)\n\n", cells(1e3, 0.1 / G), ",")


@made(
    "an oscilloscope's CSV (as Tektronix): preamble, no unit in the header", "tek.csv",
    toml=columns("CH1", "CH2", 'unit = "V"\nsensitivity = "10.2 mV/(m/s^2)"') + '[channels.time]\nunit = "s"\n',
)  # fmt: skip
def _(file: Path) -> None:
    head = "Model,MSO24\nFirmware Version,1.28\n\nPoint Format,Y\nHorizontal Units,s\nSample Interval,1e-3\n"
    text(file, head + "Record Length,1000\nLabel,,\nTIME,CH1,CH2\n", cells(scale=0.0102), ",")


@made(
    "an oscilloscope's CSV (as Keysight): units written out", "keysight.csv",
    toml=columns("1", "2", 'sensitivity = "100 mV/g"') + '[channels.time]\ncolumn = "x-axis"\n',
)  # fmt: skip
def _(file: Path) -> None:
    text(file, "x-axis,1,2\nsecond,Volt,Volt\n", cells(scale=0.1 / G), ",")


@made(
    "a motion laboratory's CSV (as Vicon Nexus): frames, no time", "nexus.csv",
    toml="[study]\nsampling_rate_hz = 1000\n" + columns("Acc base", "Acc ankle"),
)  # fmt: skip
def _(file: Path) -> None:
    body = [[str(i // 10 + 1), str(i % 10), *row[1:]] for i, row in enumerate(cells(scale=1e3))]
    text(file, "Devices\n1000\nFrame,Sub Frame,Acc base,Acc ankle\n,,mm/s^2,mm/s^2\n", body, ",")


@made(
    "a time for each sensor (as Delsys)", "delsys.csv",
    toml=columns("Table: ACC.Y 1 [g]", "Ankle: ACC.Y 2 [g]") + '[channels.time]\ncolumn = "X [s]"\n',
)  # fmt: skip
def _(file: Path) -> None:
    body = [[t, b, t, m] for t, b, m in cells(scale=1 / G)]
    text(file, "X [s],Table: ACC.Y 1 [g],X.1 [s],Ankle: ACC.Y 2 [g]\n", body, ",")


@made("a microcontroller's log in counts", "counts.csv",
      toml=columns("a0", "a1", 'unit = "V"\nsensitivity = 20.0')
      + '[channels.time]\ncolumn = "micros"\nunit = "us"\n')  # fmt: skip
def _(file: Path) -> None:
    body = [[f"{1e6 * t:.0f}", f"{20 * b + 512:.4f}", f"{20 * m + 512:.4f}"] for t, b, m in TABLE]
    text(file, "micros;a0;a1\n", body, ";")


@made("a logger with ; before its head (as GCDC)", "gcdc.csv",
      toml=columns("Ay1", "Ay2", 'unit = "g"') + '[channels.time]\ncolumn = "Time"\nunit = "s"\n')  # fmt: skip
def _(file: Path) -> None:
    head = ";Title, http://www.gcdataconcepts.com, X16-1D\n;Version, 1126\n;SampleRate, 1000,Hz\n;Deadband, 0\n"
    text(file, head + ";Headers,,\nTime,Ay1,Ay2\n", cells(scale=1 / G), ",")


@made("columns in another language", "kolonnen.csv",
      toml=columns("Tisch", "Knöchel", 'unit = "m/s^2"')
      + '[channels.time]\ncolumn = "Zeit"\nunit = "s"\n')  # fmt: skip
def _(file: Path) -> None:
    text(file, "Zeit;Tisch;Knöchel\n", cells(decimal=","), ";", "cp1252")


@made("decimal commas between commas", "both.csv", refused="if its decimals have commas, separate the columns by ;")
def _(file: Path) -> None:
    text(file, "time_s,base_m_s2,malleolus_m_s2\n", cells(decimal=","), ",")


@made("a time without a unit", "unitless.csv", refused="'time' has no unit")
def _(file: Path) -> None:
    text(file, "time,base_m_s2,malleolus_m_s2\n", cells(), ",")


@made("a header that names no channel", "strange.csv", refused="names no channel")
def _(file: Path) -> None:
    text(file, "t,x,y\n", cells(), ",")


# ---- LabVIEW


def labview(file: Path, x: str, mark: str = "\t", decimal: str = ".", second: bool = False) -> None:
    """As LabVIEW's Write To Measurement File writes it."""
    name = {"\t": "Tab", ",": "Comma"}[mark]
    about = {
        "Writer_Version": "2", "Reader_Version": "2", "Separator": name, "Decimal_Separator": decimal,
        "Multi_Headings": "No", "X_Columns": x, "Time_Pref": "Relative", "Operator": "lab",
        "Date": "2026/03/04", "Time": "10:11:12.5", "***End_of_Header***": "",
    }  # fmt: skip
    segment = {
        "Channels": ["2"], "Samples": ["1000"] * 2, "Date": ["2026/03/04"] * 2, "Time": ["10:11:12.5"] * 2,
        "Y_Unit_Label": ["m/s^2"] * 2, "X_Dimension": ["Time"] * 2, "X0": ["0.0E+0"] * 2, "Delta_X": ["0.001"] * 2,
    }  # fmt: skip
    lines = ["LabVIEW Measurement" + mark, *(f"{key}{mark}{value}" for key, value in about.items()), mark]
    body = [*(mark.join([key, *value]).replace(".", decimal) for key, value in segment.items()), "***End_of_Header***"]
    body[-1] += 2 * mark
    body.append(mark.join(["X_Value", "base", "malleolus", "Comment"]))
    body += [mark.join([t if x == "One" else "", b, m]) for t, b, m in cells(decimal=decimal)]
    file.write_text("\n".join([*lines, *body, *(body if second else []), ""]), newline="\r\n")


@made("LabVIEW's .lvm with time", "one.lvm")
def _(file: Path) -> None:
    labview(file, "One")


@made("LabVIEW's .lvm without time, decimal commas", "none.lvm")
def _(file: Path) -> None:
    labview(file, "No", decimal=",")


@made("LabVIEW's .lvm with commas", "comma.lvm")
def _(file: Path) -> None:
    labview(file, "One", ",")


@made("LabVIEW's .lvm of two segments", "segments.lvm", toml="[study]\ntake = 1\n")
def _(file: Path) -> None:
    labview(file, "One", second=True)


# ---- Excel


def sheet(file: Path, head: list[list[object]], body: list[list[object]], other: str = "") -> None:
    from openpyxl import Workbook

    book = Workbook()
    page = book.active
    if other:
        page.title = other
        page.append(["subject 7, left foot"])
        page = book.create_sheet("data")
    for row in [*head, *body]:
        page.append(row)
    book.save(file)


@made("Excel by openpyxl", "plain.xlsx", "openpyxl")
def _(file: Path) -> None:
    sheet(file, [["time_s", "base_m_s2", "malleolus_m_s2"]], [list(row) for row in TABLE])


@made("Excel with notes above, a row of units, a sheet of words before it", "notes.xlsx", "openpyxl")
def _(file: Path) -> None:
    head: list[list[object]] = [["Logger 4711", None, "left"], [], ["time", "Base", "Malleolus"], ["ms", "g", "g"]]
    sheet(file, head, [[1e3 * t, b / G, m / G] for t, b, m in TABLE], "about")


@made("Excel with dates as time", "dates.xlsx", "openpyxl")
def _(file: Path) -> None:
    start = datetime(2026, 3, 4, 10)
    body: list[list[object]] = [[start + timedelta(milliseconds=round(1e3 * t)), b, m] for t, b, m in TABLE]
    sheet(file, [["time", "base [m/s^2]", "malleolus [m/s^2]"]], body)


@made("Excel by pandas, columns of their own", "pandas.xlsx", "openpyxl", columns("AI0 [g]", "AI1 [g]"))
def _(file: Path) -> None:
    import pandas as pd

    pd.DataFrame({"time_s": TIME, "AI0 [g]": BASE / G, "AI1 [g]": MALLEOLUS / G}).to_excel(file)


# ---- MATLAB


@made("MATLAB 5 by scipy: vectors and fs", "vectors.mat", toml=columns("base", "malleolus", 'unit = "m/s^2"'))
def _(file: Path) -> None:
    from scipy.io import savemat

    savemat(file, {"base": BASE, "malleolus": MALLEOLUS, "fs": float(RATE)})


@made("MATLAB 4 by scipy", "four.mat")
def _(file: Path) -> None:
    from scipy.io import savemat

    savemat(file, {"time_s": TIME, "base_m_s2": BASE, "malleolus_m_s2": MALLEOLUS}, format="4")


@made("MATLAB 5 by scipy: a structure of a table", "structure.mat")
def _(file: Path) -> None:
    from scipy.io import savemat

    table = {"time_ms": TIME[:, None] * 1e3, "base_g": BASE[:, None] / G, "malleolus_g": MALLEOLUS[:, None] / G}
    savemat(file, {"s": table, "note": "left foot"}, do_compression=True)


@made("MATLAB 5 by scipy: one matrix", "matrix.mat",
      toml=columns("data_2", "data_3", 'unit = "g"') + '[channels.time]\ncolumn = "data_1"\nunit = "s"\n')  # fmt: skip
def _(file: Path) -> None:
    from scipy.io import savemat

    savemat(file, {"data": np.column_stack([TIME, BASE / G, MALLEOLUS / G])})


@made("MATLAB 5 by scipy: integers of a converter", "integers.mat",
      toml="[study]\nsampling_rate_hz = 1000\n"
      + columns("ch1", "ch2", 'unit = "m/s^2"\nsensitivity = 1000'))  # fmt: skip
def _(file: Path) -> None:
    from scipy.io import savemat

    savemat(file, {"ch1": np.round(1000 * BASE).astype(np.int16), "ch2": np.round(1000 * MALLEOLUS).astype(np.int16)})


@made("MATLAB 7.3 by h5py", "seven.mat", "h5py")
def _(file: Path) -> None:
    import h5py

    with h5py.File(file, "w", userblock_size=512) as out:
        for name, values in {"time_s": TIME, "base_m_s2": BASE, "malleolus_m_s2": MALLEOLUS}.items():
            out.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with file.open("r+b") as out:
        out.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


@made("MATLAB's cell array", "cells.mat", refused="'data' is a cell array")
def _(file: Path) -> None:
    from scipy.io import savemat

    cell = np.empty((1, 2), object)
    cell[0, 0], cell[0, 1] = BASE, MALLEOLUS
    savemat(file, {"data": cell})


# ---- HDF5, NetCDF, numpy


@made("HDF5 by h5py: a group, units and rate as attributes", "group.h5", "h5py")
def _(file: Path) -> None:
    import h5py

    with h5py.File(file, "w") as out:
        out.attrs["fs"] = RATE
        for name, values in {"base": BASE, "malleolus": MALLEOLUS}.items():
            out.create_dataset(f"run1/{name}", data=values / G, compression="gzip").attrs["units"] = "g"


@made("HDF5 by h5py: packed integers with scale_factor", "packed.hdf5", "h5py")
def _(file: Path) -> None:
    import h5py

    with h5py.File(file, "w") as out:
        out["time"] = TIME
        out["time"].attrs["units"] = "s"
        for name, values in {"base": BASE, "malleolus": MALLEOLUS}.items():
            out[name] = np.round((values - 1) / 1e-3).astype(np.int32)
            out[name].attrs.update({"units": "m/s^2", "scale_factor": 1e-3, "add_offset": 1.0})


@made("HDF5 by h5py: a table with named columns", "table.h5", "h5py", columns("Table", "Ankle", 'unit = "m/s^2"'))
def _(file: Path) -> None:
    import h5py

    table = np.array(TABLE, [("time_s", "f8"), ("Table", "f8"), ("Ankle", "f4")])
    with h5py.File(file, "w") as out:
        out["run"] = table


@made("NetCDF 4 by xarray", "labelled.nc", "h5netcdf")
def _(file: Path) -> None:
    xarray = pytest.importorskip("xarray")
    about = {"units": "m/s^2"}
    data = {"base": ("time", BASE, about), "malleolus": ("time", MALLEOLUS, about)}
    xarray.Dataset(data, {"time": ("time", TIME, {"units": "s"})}).to_netcdf(file, engine="h5netcdf")


@made("NetCDF 3 by scipy", "classic.nc")
def _(file: Path) -> None:
    from scipy.io import netcdf_file

    with netcdf_file(file, "w") as out:
        out.createDimension("time", TIME.size)
        for name, values, unit in (("time", TIME, "s"), ("base", BASE / G, "g"), ("malleolus", MALLEOLUS / G, "g")):
            variable = out.createVariable(name, "f8", ("time",))
            variable[:], variable.units = values, unit


@made("numpy's .npz", "arrays.npz")
def _(file: Path) -> None:
    np.savez_compressed(file, time_s=TIME, base_m_s2=BASE, malleolus_m_s2=MALLEOLUS)


@made("numpy's .npz of Python objects", "objects.npz", refused="'base' is no numbers")
def _(file: Path) -> None:
    np.savez(file, base=np.array([{"a": 1}, None], object))


# ---- universal files, TDMS


@made("universal file 58, text, by pyuff", "text.uff", "pyuff")
def _(file: Path) -> None:
    import pyuff

    records = [
        pyuff.prepare_58(
            binary=0, id1=name, func_type=1, rsp_node=node, rsp_dir=3, ref_node=0, ref_dir=0, rsp_ent_name="foot",
            ref_ent_name="NONE", ord_data_type=4, num_pts=TIME.size, abscissa_spacing=1, abscissa_min=0.0,
            abscissa_inc=1 / RATE, abscissa_spec_data_type=17, abscissa_axis_units_lab="s", x=TIME, data=values,
            ordinate_spec_data_type=12, ordinate_axis_units_lab="m/s^2", ver_num=0, load_case_id=0,
            orddenom_spec_data_type=0, z_axis_value=0.0, z_axis_spec_data_type=0,
        )
        for node, (name, values) in enumerate({"base": BASE, "malleolus": MALLEOLUS}.items(), 1)
    ]  # fmt: skip
    pyuff.UFF(str(file)).write_sets(records, "overwrite")


@made("universal file 58b, binary, by its description, both channels from 5 s on", "binary.unv", "pyuff")
def _(file: Path) -> None:
    whole = b""
    for node, (name, values) in enumerate({"base": BASE, "malleolus": MALLEOLUS}.items(), 1):
        axes = ((17, "Time", "s"), (12, "Acc", "m/s^2"), (0, "NONE", "NONE"), (0, "NONE", "NONE"))
        lines = [
            f"{58:6}b{1:6}{2:6}{11:12}{8 * values.size:12}{0:6}{0:6}{0:12}{0:12}",
            *(f"{word:<80}" for word in (name, "NONE", "04-Mar-26 10:11:12", "NONE", "NONE")),
            f"{1:5}{0:10}{0:5}{0:10} {'foot':>10}{node:10}{3:4} {'NONE':>10}{0:10}{0:4}",
            f"{4:10}{values.size:10}{1:10}{5.0:13.5e}{1 / RATE:13.5e}{0.0:13.5e}",
            *(f"{kind:10}{0:5}{0:5}{0:5} {label:>20} {unit:>20}" for kind, label, unit in axes),
        ]
        whole += "\n".join(["    -1", *lines, ""]).encode() + values.astype("<f8").tobytes() + b"\n    -1\n"
    file.write_bytes(whole)


def tdms(file: Path, names: tuple[str, str], unit: str, scale: float, offsets: tuple[float, float] = (0, 0)) -> None:
    """Two channels whose samples begin when their offsets say."""
    from nptdms import ChannelObject, TdmsWriter

    made, waves = [], ((8.95, 0.3), (8.95 * T, 0.3 + np.radians(PHASE_DEG)))
    for name, offset, (size, turn) in zip(names, offsets, waves, strict=True):
        values = scale * size * np.sin(2 * np.pi * HZ * (TIME + offset) + turn)
        about = {"wf_increment": 1 / RATE, "unit_string": unit, "wf_start_offset": offset}
        made.append(ChannelObject("run", name, values, properties=about))
    with TdmsWriter(file) as writer:
        writer.write_segment(made)


@made("TDMS by npTDMS", "plain.tdms", "nptdms")
def _(file: Path) -> None:
    tdms(file, ("base", "malleolus"), "g", 1 / G)


@made("TDMS whose second channel begins 2 ms later", "late.tdms", "nptdms")
def _(file: Path) -> None:
    tdms(file, ("base", "malleolus"), "m/s^2", 1.0, (0.0, 2e-3))


@made("TDMS in volts", "volts.tdms", "nptdms", columns("cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1", 'sensitivity = "100 mV/g"'))
def _(file: Path) -> None:
    tdms(file, ("cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1"), "V", 0.1 / G)


# ---- sound, motion capture

SOUND = columns("channel_1", "channel_2", 'unit = "m/s^2"\nsensitivity = 0.05')


@made("sound by Python's wave: 16 bits", "sixteen.wav", "soundfile", SOUND)
def _(file: Path) -> None:
    both = np.round(32767 * 0.05 * np.column_stack([BASE, MALLEOLUS])).astype("<i2")
    with wave.open(str(file), "wb") as out:
        out.setnchannels(2)
        out.setsampwidth(2)
        out.setframerate(RATE)
        out.writeframes(both.tobytes())


@made("sound by scipy: 32-bit floats in m/s²", "floats.wav", "soundfile",
      columns("channel_1", "channel_2", 'unit = "m/s^2"'))  # fmt: skip
def _(file: Path) -> None:
    from scipy.io import wavfile

    wavfile.write(file, RATE, np.column_stack([BASE, MALLEOLUS]).astype(np.float32))


@made("sound by soundfile: FLAC of 24 bits", "packed.flac", "soundfile", SOUND)
def _(file: Path) -> None:
    import soundfile

    soundfile.write(file, 0.05 * np.column_stack([BASE, MALLEOLUS]), RATE, subtype="PCM_24")


@made("motion capture by ezc3d", "walk.c3d", "ezc3d")
def _(file: Path) -> None:
    import ezc3d

    out = ezc3d.c3d()
    out["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    analog = out["parameters"]["ANALOG"]
    analog["RATE"]["value"], analog["LABELS"]["value"] = [float(RATE)], ["base", "malleolus"]
    analog["UNITS"]["value"] = ["g", "g"]
    out["data"]["points"] = np.zeros((4, 0, 100))
    out["data"]["analogs"] = np.stack([BASE, MALLEOLUS])[None] / G
    out.write(str(file))


@made("Parquet by pandas", "columns.parquet", "pyarrow")
def _(file: Path) -> None:
    import pandas as pd

    pd.DataFrame(TABLE, columns=["time_s", "base_m_s2", "malleolus_m_s2"]).to_parquet(file)


@made("EDF of biosignals by edfio, the foot at half the rate", "foot.edf", "edfio")
def _(file: Path) -> None:
    import edfio

    signals = [edfio.EdfSignal(x / G, rate, label=name, physical_dimension="g")
               for name, x, rate in (("base", BASE, RATE), ("malleolus", MALLEOLUS[::2], RATE // 2))]  # fmt: skip
    edfio.Edf(signals, data_record_duration=0.5).write(file)


@made("two telephones' CSV in one .zip (as phyphox)", "phones.zip",
      toml=columns("table/Acceleration z (m/s^2)", "foot/Acceleration z (m/s^2)"))  # fmt: skip
def _(file: Path) -> None:
    with zipfile.ZipFile(file, "w") as packed:
        for name, values in (("table", BASE), ("foot", MALLEOLUS)):
            body = "".join(f"{t:.9E},{a:.9E}\n" for t, a in zip(TIME, values, strict=True))
            packed.writestr(f"{name}.csv", f'"Time (s)","Acceleration z (m/s^2)"\n{body}')
        packed.writestr("meta/device.csv", '"property","value"\n')


# ---- what nobody reads


@made("a spreadsheet of Excel 97", "old.xls", refused="save the sheet as .xlsx or as .csv")
def _(file: Path) -> None:
    file.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(504))


def told(case: Case) -> str:
    """The row of a file on the page."""
    how = f"refused: {case.refused}" if case.refused else "with a study.toml" if case.toml else "at once"
    return f"| `{case.name}` | {case.what} | {how} |"


def test_the_page_lists_every_file() -> None:
    page = (Path(__file__).parents[1] / "benchmarks" / "instrument_files.md").read_text()
    assert [line for line in page.splitlines() if line.startswith("| `")] == [told(case) for case in CASES]
    read = [case for case in CASES if not case.refused]
    alone = sum(not case.toml for case in read)
    assert f"{len(CASES)} files: {alone} are read at once, {len(read) - alone} with a study.toml" in page


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_the_answer_is_the_known_one(tmp_path: Path, case: Case) -> None:
    if case.needs:
        pytest.importorskip(case.needs)
    case.write(tmp_path / case.name)
    layout = None
    if case.toml:
        (tmp_path / "study.toml").write_text(case.toml)
        layout = describe(tmp_path / "study.toml")[1]
    if case.refused:
        with pytest.raises(FasError, match=re.escape(case.refused)) as error:
            Recording.read(tmp_path / case.name, layout=layout)
        assert "\n" not in str(error.value)
        return
    recording = Recording.read(tmp_path / case.name, layout=layout)
    fair = "gravity|an offset|rounded to|resampled to the highest"
    assert not [text for text in checked(recording).warnings if not re.search(fair, text)]
    (row,) = [r for r in rows(recording) if r.pair == "MB"]
    assert row.frequency_hz == pytest.approx(HZ, abs=0.02)
    assert row.transmissibility == pytest.approx(T, rel=1e-3)
    assert row.phase_deg == pytest.approx(PHASE_DEG, abs=0.1)
