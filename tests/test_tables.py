"""Parquet, EDF, phyphox's archives and Rattlesnake's streams, written by their own libraries or as these write them."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from test_account import LATE, TIME, G, base, malleolus, mapped, read, right

from fasbody.exceptions import InputFileError
from fasbody.recording.files import read_one, reading
from fasbody.recording.merge import merge

B, M = base(TIME), malleolus(TIME)


def test_parquet(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is of the extra formats")
    import pandas as pd
    from pyarrow import parquet

    table = pd.DataFrame({"time_s": TIME, "base_g": B / G, "malleolus_g": M / G, "note": "x"})
    table.to_parquet(tmp_path / "a.parquet")
    recording = read(tmp_path / "a.parquet")
    right(recording)
    assert "'note' is no column of numbers" in recording.unused
    stamps = pd.Timestamp("2026-03-04 10:00") + pd.to_timedelta(TIME, "s")
    pd.DataFrame({"base_g": B / G, "malleolus_g": M / G}, pd.Index(stamps, name="when")).to_parquet(
        tmp_path / "b.parquet"
    )
    right(read(tmp_path / "b.parquet"))
    fields = [arrow.field(name, "float32", metadata={"unit": "g"}) for name in ("base", "malleolus")]
    schema = arrow.schema(fields, metadata={"sampling_rate_hz": "1000"})
    columns = [arrow.array((x / G).astype(np.float32)) for x in (B, M)]
    parquet.write_table(arrow.Table.from_arrays(columns, schema=schema), tmp_path / "c.parquet", compression="zstd")
    right(read(tmp_path / "c.parquet"))
    table.loc[700, "base_g"] = None
    table.to_parquet(tmp_path / "d.parquet")
    with pytest.raises(Exception, match=r"base_m_s2 is nan at 0\.7 s"):
        right(read(tmp_path / "d.parquet"))
    data = (tmp_path / "a.parquet").read_bytes()
    for broken in (data[:-200], b"PAR1" + bytes(500), b"nothing"):
        (tmp_path / "e.parquet").write_bytes(broken)
        with pytest.raises(InputFileError, match=r"not a sound \.parquet file|is not a Parquet file"):
            read(tmp_path / "e.parquet")


def test_edf(tmp_path: Path) -> None:
    edfio = pytest.importorskip("edfio", reason="edfio is of the extra formats")
    quick, slow = np.arange(3000) / 1000, np.arange(750) / 250

    def signal(label: str, values: np.ndarray, rate: int) -> object:
        return edfio.EdfSignal(values / G, rate, label=label, physical_dimension="g")

    notes = [edfio.EdfAnnotation(0.5, None, "start")]
    edfio.Edf([signal("base", base(quick), 1000), signal("malleolus", malleolus(quick), 1000)],
              annotations=notes).write(tmp_path / "a.edf")  # fmt: skip
    recording = read(tmp_path / "a.edf")
    right(recording)
    assert "'EDF Annotations' is 1 annotations" in recording.unused
    edfio.Edf([signal("Table", base(quick), 1000), signal("Ankle", malleolus(slow), 250)]).write(tmp_path / "b.edf")
    right(read(tmp_path / "b.edf", mapped("Table", "Ankle", "")))
    (tmp_path / "c.edf").write_bytes(b"nothing of the kind")
    with pytest.raises(InputFileError, match="neither an EDF nor a BDF file"):
        read(tmp_path / "c.edf")
    (tmp_path / "c.edf").write_bytes((tmp_path / "a.edf").read_bytes()[:300])
    with pytest.raises(InputFileError, match=r"not a sound \.edf file"):
        read(tmp_path / "c.edf")


def phone(file: Path, time_s: np.ndarray, z: np.ndarray) -> None:
    """As phyphox saves a telephone's sensors: a table each, and what it knows of the device."""
    head = '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)"\n'
    rows = "".join(f"{t:.9E},{0.1:.9E},{-0.2:.9E},{a:.9E}\n" for t, a in zip(time_s, z, strict=True))
    turns = '"Time (s)","Gyroscope x (rad/s)"\n' + "".join(f"{t:.9E},{0.01:.9E}\n" for t in time_s[::2])
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("Accelerometer.csv", head + rows)
        packed.writestr("Gyroscope.csv", turns)
        packed.writestr("meta/device.csv", '"property","value"\n"deviceModel","X"\n')


def test_archives_of_phyphox(tmp_path: Path) -> None:
    phone(tmp_path / "a.zip", TIME, B)
    column = "Acceleration z (m/s^2)"
    time_s, z, _ = read_one(tmp_path / "a.zip", "base", named=column)
    assert time_s == pytest.approx(TIME) and z == pytest.approx(B)
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as packed:
        for name, at, move in (("Table", TIME, base), ("Ankle", TIME + LATE, malleolus)):
            rows = "".join(f"{t:.9g},{a:.9g}\n" for t, a in zip(at, move(at), strict=True))
            packed.writestr(f"{name}.csv", f"Time (s),Acc z (m/s^2)\n{rows}")
    right(read(tmp_path / "two.zip", mapped("Table/Acc z (m/s^2)", "Ankle/Acc z (m/s^2)", "")))
    (tmp_path / "b.zip").write_bytes(b"PK no archive")
    with pytest.raises(InputFileError, match=r"is no \.zip file"):
        read(tmp_path / "b.zip")
    with zipfile.ZipFile(tmp_path / "c.zip", "w") as packed:
        packed.writestr("a.csv", "time_s,base_g,malleolus_g\n0,1,2\n0.001,x,2\n")
    with pytest.raises(InputFileError, match=r"'a\.csv' is no table of numbers \(1 is 'x', not a number\)"):
        read(tmp_path / "c.zip")


def test_two_telephones_are_merged_from_their_archives(tmp_path: Path) -> None:
    rng, t = np.random.default_rng(3), np.arange(4000) / 400
    shake = np.convolve(rng.standard_normal(t.size + 40), np.hanning(41) / 20, "valid")
    phone(tmp_path / "table.zip", t, shake)
    phone(tmp_path / "foot.zip", t, np.roll(shake, -30))
    pair = [read_one(tmp_path / f"{name}.zip", which, named="Acceleration z (m/s^2)")[:2]
            for name, which in (("table", "base"), ("foot", "malleolus"))]  # fmt: skip
    assert merge(*pair[0], *pair[1]).delay_s == pytest.approx(30 / 400, abs=1e-3)


def test_streams_of_rattlesnake(tmp_path: Path) -> None:
    """The layout of `rattlesnake/components/streaming.py`, version 3.0: a matrix a stream, and a table of channels."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.nc4", "w") as out:
        out.attrs["sample_rate"] = 1000
        for name, size in (("time_data", 1.0), ("time_data_1", 2.0)):
            out[name] = np.stack([B / G, size * M / G, 0 * B])
        out["environment_active_channels"] = np.ones((3, 1), np.int8)
        table = {"node_number": ["1", "2", "3"], "node_direction": ["Z+", "Z+", ""], "comment": ["", "", ""],
                 "unit": ["g", "g", "V"], "sensitivity": ["100", "100", "1000"]}  # fmt: skip
        for name, cells in table.items():
            out[f"channels/{name}"] = np.array(cells, object)
    toml = mapped("1Z+", "2Z+", "")
    with pytest.raises(InputFileError, match=r"holds 2 takes \('time_data', 'time_data_1'\)"):
        read(tmp_path / "a.nc4", toml)
    right(read(tmp_path / "a.nc4", "[study]\ntake = 1\n" + toml))
    second = read(tmp_path / "a.nc4", "[study]\ntake = 2\n" + toml)
    assert second.malleolus_m_s2 == pytest.approx(2 * M)


def test_a_text_without_a_table_in_an_archive_is_left_out(tmp_path: Path) -> None:
    rows = "".join(f"{t:.9g},{b:.9g},{m:.9g}\n" for t, b, m in zip(TIME, base(TIME), malleolus(TIME), strict=True))
    with zipfile.ZipFile(tmp_path / "r.zip", "w") as packed:
        packed.writestr("Metadata.csv", "device,rate\niPhone,x\n")
        packed.writestr("Table.csv", f"time_s,base_m_s2,malleolus_m_s2\n{rows}")
    result = reading(tmp_path / "r.zip")
    assert result.warnings == () and any("'Metadata.csv' is no table" in text for text in result.unused)


def of_edf(file: Path, filters: tuple[str, str], note: str) -> tuple[str, ...]:
    """What is remarked on an EDF file with these prefilters and an annotation."""
    edfio = pytest.importorskip("edfio", reason="edfio is of the extra formats")
    t = np.arange(2000) / 1000
    signals = [
        edfio.EdfSignal(move(t), 1000, label=name, physical_dimension="m/s2", prefiltering=text)
        for name, move, text in zip(("base", "malleolus"), (base, malleolus), filters, strict=True)
    ]
    edfio.Edf(signals, annotations=[edfio.EdfAnnotation(0.5, None, note)]).write(file)
    return reading(file).warnings


def test_prefilters_and_annotations_of_edf(tmp_path: Path) -> None:
    alike, file = ("LP:50Hz", "LP:50Hz"), tmp_path / "r.edf"
    assert of_edf(file, alike, "start") == ()
    (fallen,) = of_edf(file, alike, "malleolus sensor fell off")
    (filtered,) = of_edf(file, ("", "LP:50Hz"), "start")
    assert "malleolus sensor fell off" in fallen and "prefiltering = '' with base and 'LP:50Hz'" in filtered


@pytest.mark.parametrize(("word", "quoted"), [("factor", True), ("serial", False)])
def test_a_sheet_of_words(tmp_path: Path, word: str, quoted: bool) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["time_s", "base_m_s2", "malleolus_m_s2"])
    for row in zip(TIME.tolist(), base(TIME).tolist(), malleolus(TIME).tolist(), strict=True):
        book.active.append(row)
    sheet = book.create_sheet("calibration")
    for row in (["channel", word], ["base", 1], ["malleolus", 1.25]):
        sheet.append(row)
    book.save(tmp_path / "r.xlsx")
    result = reading(tmp_path / "r.xlsx")
    assert any("the sheet calibration" in text for text in result.unused)
    assert [word in text for text in result.warnings] == [True] * quoted


@pytest.mark.parametrize("key", ["malleolus_latency_s", "exported_by"])
def test_metadata_of_parquet_that_name_a_channel(tmp_path: Path, key: str) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = {"time_s": TIME, "base_m_s2": base(TIME), "malleolus_m_s2": malleolus(TIME)}
    parquet.write_table(pyarrow.table(columns).replace_schema_metadata({key: "0.005"}), tmp_path / "r.parquet")
    if key == "exported_by":
        assert reading(tmp_path / "r.parquet").warnings == ()
        return
    with pytest.raises(InputFileError, match=r"latency_s = 0\.005 with 'malleolus_m_s2'"):
        reading(tmp_path / "r.parquet")


@pytest.mark.parametrize("gap", ["\t", ""])
def test_blank_cells_between_channels_of_labview(tmp_path: Path, gap: str) -> None:
    head = [
        "LabVIEW Measurement\t", "X_Columns\tMulti", "***End_of_Header***\t", f"Channels\t2\t{gap}\t",
        f"Y_Unit_Label\tm/s^2\t{gap}g", f"Date\t2026/03/02\t{gap}2026/03/02", f"Time\t10:15:00\t{gap}10:15:00",
        f"X0\t0\t{gap}0", f"Delta_X\t0.001\t{gap}0.001", "***End_of_Header***\t\t", "X_Value\tbase\tX_Value\tmalleolus",
    ]  # fmt: skip
    rows = [f"{t:.6f}\t{b:.9g}\t{t:.6f}\t{m / G:.9g}"
            for t, b, m in zip(TIME, base(TIME), malleolus(TIME), strict=True)]  # fmt: skip
    (tmp_path / "r.lvm").write_text("\n".join([*head, *rows]))
    channels = reading(tmp_path / "r.lvm").channels
    assert channels["malleolus_m_s2"] == pytest.approx(malleolus(channels["time_s"]), abs=1e-4)
