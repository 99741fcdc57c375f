"""Formats that are only read, each written by a library of its own or as its maker prints it."""

import gzip
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from fasbody.exceptions import InputFileError, MissingPackageError, SettingError
from fasbody.recording import files
from fasbody.recording.channels import Layout
from fasbody.recording.recording import HEADER, Recording

T = np.arange(400) / 1000
BASE = 8.95 * np.sin(2 * np.pi * 20 * T)
G = 9.80665


def same(recording: Recording, tolerance: float = 1e-9) -> None:
    assert recording.time_s == pytest.approx(T, abs=1e-6)
    assert recording.base_m_s2 == pytest.approx(BASE, abs=tolerance)
    assert recording.malleolus_m_s2 == pytest.approx(1.3 * BASE, abs=1.3 * tolerance)


def rows() -> list[tuple[float, float, float]]:
    return list(zip(T.tolist(), BASE.tolist(), (1.3 * BASE).tolist(), strict=True))


def test_excel_without_a_header_or_with_words_between_numbers(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in rows():
        book.active.append(row)
    book.save(tmp_path / "r.xlsx")
    with pytest.raises(InputFileError, match="the sheet 'Sheet' has no header row; write time_s, base_m_s2"):
        Recording.read(tmp_path / "r.xlsx")
    book.active.insert_rows(1)
    for cell, name in zip("ABC", HEADER, strict=False):
        book.active[f"{cell}1"] = name
    book.active["B9"] = "overload"
    book.save(tmp_path / "r.xlsx")
    with pytest.raises(InputFileError, match=r"'base_m_s2' is no column of numbers \(row 9\)"):
        Recording.read(tmp_path / "r.xlsx")


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t,
Multi_Headings\tYes
X_Columns\t{x}
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t400\t400\t
Date\t2026/03/04\t2026/03/04\t
Y_Unit_Label\tg\tm/s^2\t
X_Dimension\tTime\tTime\t
X0\t0,0E+0\t{x0}\t
Delta_X\t0,001\t0,001\t
***End_of_Header***\t\t\t
X_Value\tbase\tmalleolus\tComment
"""


def test_lvm(tmp_path: Path) -> None:
    """As LabVIEW writes it where decimals have commas; without a time the starts of the channels count."""
    with_time = [f"{t:.6f}\t{b / G:.12f}\t{m:.12f}" for t, b, m in rows()]
    text = LVM.format(x="One", x0="0,0E+0") + "\n".join(with_time).replace(".", ",") + "\n"
    (tmp_path / "r.lvm").write_text(text)
    same(Recording.read(tmp_path / "r.lvm"))
    late = 1.3 * 8.95 * np.sin(2 * np.pi * 20 * (T + 2e-3))
    without = [f"\t{b / G:.12f}\t{m:.12f}" for b, m in zip(BASE, late, strict=True)]
    text = LVM.format(x="No", x0="2,0E-3") + "\n".join(without).replace(".", ",") + "\n"
    (tmp_path / "n.lvm").write_text(text)
    back = Recording.read(tmp_path / "n.lvm")
    assert back.malleolus_m_s2 == pytest.approx(1.3 * back.base_m_s2, abs=2e-3)
    (tmp_path / "two.lvm").write_text(text + LVM[LVM.index("Channels") :])
    with pytest.raises(InputFileError, match="holds 2 segments; save each segment as a file of its own"):
        Recording.read(tmp_path / "two.lvm")


def test_tables_of_bids(tmp_path: Path) -> None:
    """A physio recording (packed, no header, columns in its JSON) and a motion recording (channels.tsv)."""
    body = "\n".join(f"{b / G:.12f}\t{m:.12f}" for _, b, m in rows()) + "\n"
    (tmp_path / "sub-01_physio.tsv.gz").write_bytes(gzip.compress(body.encode()))
    about = {"SamplingFrequency": 1000, "StartTime": 0, "Columns": ["base", "malleolus"]}
    about |= {"base": {"Units": "g"}, "malleolus": {"Units": "m/s^2"}}
    (tmp_path / "sub-01_physio.json").write_text(json.dumps(about))
    same(Recording.read(tmp_path / "sub-01_physio.tsv.gz"))
    with pytest.raises(InputFileError, match=r"SamplingFrequency is 1000 Hz, and study\.toml says .* = 500"):
        Recording.read(tmp_path / "sub-01_physio.tsv.gz", layout=Layout(rate_hz=500))
    (tmp_path / "sub-01_motion.tsv").write_text(body)
    (tmp_path / "sub-01_motion.json").write_text('{"SamplingFrequency": 1000}')
    (tmp_path / "sub-01_channels.tsv").write_text("name\ttype\tunits\nbase\tACCEL\tg\nmalleolus\tACCEL\tm/s^2\n")
    same(Recording.read(tmp_path / "sub-01_motion.tsv"))


def test_logs_without_a_header(tmp_path: Path) -> None:
    file = tmp_path / "r.log"
    file.write_text("# logger 4711\n" + "\n".join(f"{t} {b / G:.12f} 7 {m:.12f}" for t, b, m in rows()))
    names = ("time_s", "base_g", "temperature", "malleolus_m_s2")
    same(Recording.read(file, layout=Layout(columns=names)))
    with pytest.raises(InputFileError, match=r"line 2: has 4 columns, and 2 are named \(time_s, base_g\); name every"):
        Recording.read(file, layout=Layout(columns=names[:2]))
    with pytest.raises(InputFileError, match=r"has no header line; .* --columns time_s,base_g"):
        Recording.read(file)


@pytest.mark.parametrize("ending", ["csv", "mat", "h5", "tdms"])
def test_packed_files(tmp_path: Path, ending: str) -> None:
    Recording(T, BASE, 1.3 * BASE).write(tmp_path / f"r.{ending}")
    whole = gzip.compress((tmp_path / f"r.{ending}").read_bytes())
    (tmp_path / f"p.{ending}.gz").write_bytes(whole)
    same(Recording.read(tmp_path / f"p.{ending}.gz"), 1e-6)
    (tmp_path / f"p.{ending}.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputFileError, match=rf"p\.{ending}\.gz: is not a sound .*damaged, cut off"):
        Recording.read(tmp_path / f"p.{ending}.gz")


@pytest.mark.parametrize("ending", ["xlsx", "wav", "flac", "c3d", "lvm"])
def test_broken_files_and_missing_libraries_end_in_a_sentence(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / f"r.{ending}"
    for content in (
        b"",
        b"RIFF\xff\xff\xff\x7fWAVE",
        b"PK\x03\x04" + bytes(50),
        b"LabVIEW Measurement\n\n",
        b"\x02\x50",
    ):
        file.write_bytes(content)
        with pytest.raises((InputFileError, SettingError)) as caught:
            files.read(file)
        assert str(caught.value).count("\n") == 0
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    if ending == "xlsx":
        with pytest.raises(MissingPackageError, match=r"^openpyxl is not installed: .*, or save the sheet as CSV\.$"):
            files.read(file)
        with pytest.raises(InputFileError, match=r"no format has the ending '\.xls'; save the sheet as \.xlsx or as"):
            files.read(tmp_path / "r.xls")
    with pytest.raises(MissingPackageError, match=r"pip install 'fasbody\[formats\]' \(in a clone: pip"):
        files.read(file)
