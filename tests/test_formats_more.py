"""Formats that are only read, each written by a library of its own or as its maker prints it."""

import gzip
import importlib.util
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
            files.reading(file)
        assert str(caught.value).count("\n") == 0
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    if ending == "xlsx":
        with pytest.raises(MissingPackageError, match=r"^openpyxl is not installed: .*, or save the sheet as CSV\.$"):
            files.reading(file)
        (tmp_path / "r.xls").write_bytes(b"\xd0\xcf")
        with pytest.raises(InputFileError, match=r"no format has the ending '\.xls'; save the sheet as \.xlsx or as"):
            files.reading(tmp_path / "r.xls")
    with pytest.raises(MissingPackageError, match=r"pip install 'fasbody\[formats\]' \(in a clone: pip"):
        files.reading(file)
