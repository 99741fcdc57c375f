"""Files that are broken, hostile or cut off, and readers that hang: one sentence, and nothing else happens."""

import os
import pickle
import signal
import subprocess
import sys
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from fasbody.exceptions import InputFileError
from fasbody.recording.formats import reader
from fasbody.recording.recording import Recording

T = np.arange(300) / 1000
BASE = 8.95 * np.sin(2 * np.pi * 20 * T)
CHANNELS = {"time_s": T, "base_m_s2": BASE, "malleolus_m_s2": 1.3 * BASE}


def sound(folder: Path, ending: str) -> bytes:
    """A whole file."""
    Recording(**CHANNELS).write(folder / f"sound.{ending}")
    return (folder / f"sound.{ending}").read_bytes()


class Danger:
    """Unpickled, it would leave a file behind."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return os.mkdir, (str(self.mark),)


@pytest.mark.parametrize("ending", ["mat", "h5", "uff", "tdms", "csv"])
def test_pickles_are_never_loaded(tmp_path: Path, ending: str) -> None:
    mark = tmp_path / "executed"
    poison = pickle.dumps(Danger(mark))
    file = tmp_path / f"r.{ending}"
    if ending == "mat":
        savemat(file, {"base_m_s2": np.frombuffer(poison, np.uint8), "malleolus_m_s2": np.array(["x"], object)})
    elif ending == "h5":
        with h5py.File(file, "w") as out:
            out["base_m_s2"] = np.void(poison)
            out["malleolus_m_s2"] = BASE
            out["malleolus_m_s2"].attrs["units"] = np.void(poison)
    else:
        file.write_bytes(poison)
    with pytest.raises(InputFileError):
        Recording.read(file)
    assert not mark.exists()


def test_declared_sizes_are_checked_before_they_are_allocated(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "r.h5", "w") as out:  # 8 TB announced, nothing stored
        out.create_dataset("base_m_s2", (10**12,), "f8", chunks=(10**6,))
        out.create_dataset("malleolus_m_s2", (10**12,), "f8", chunks=(10**6,))
    with pytest.raises(InputFileError, match=r"announces 1e\+12 samples"):
        Recording.read(tmp_path / "r.h5")


def test_a_decompression_bomb_ends_in_a_sentence(tmp_path: Path) -> None:
    """A version 5 file whose one compressed variable unpacks to 400 MB."""
    savemat(tmp_path / "r.mat", {"base_m_s2": BASE}, do_compression=False)
    whole = bytearray((tmp_path / "r.mat").read_bytes())
    body = whole[128:]
    size = 4 * 10**8
    body[4:8] = (size + 60).to_bytes(4, "little")
    at = body.index((2400).to_bytes(4, "little"), 40)  # bytes of the real part
    body[at : at + 4] = size.to_bytes(4, "little")
    place = body.index((300).to_bytes(4, "little"))
    body[place : place + 4] = (size // 8).to_bytes(4, "little")
    packer = zlib.compressobj(1)
    packed = packer.compress(bytes(body))
    zeros = bytes(1 << 24)
    for _ in range(size >> 24):
        packed += packer.compress(zeros)
    packed += packer.flush()
    (tmp_path / "r.mat").write_bytes(
        whole[:128] + (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed
    )
    with pytest.raises(InputFileError, match="announces 5e"):
        Recording.read(tmp_path / "r.mat")


def test_external_data_are_refused(tmp_path: Path) -> None:
    """HDF5 can say that a dataset's bytes lie in another file: any file of the reader's machine."""
    (tmp_path / "secret").write_bytes(b"password" * 300)
    with h5py.File(tmp_path / "r.h5", "w") as out:
        for name in ("base_m_s2", "malleolus_m_s2"):
            out.create_dataset(name, (300,), "f8", external=[(str(tmp_path / "secret"), 0, 2400)])
    with pytest.raises(InputFileError, match="other files"):
        Recording.read(tmp_path / "r.h5")
    with h5py.File(tmp_path / "l.h5", "w") as out:
        out["base_m_s2"] = h5py.ExternalLink("secret.h5", "/x")
    with pytest.raises(InputFileError, match="no numeric channel"):
        Recording.read(tmp_path / "l.h5")


@pytest.mark.parametrize("ending", ["mat", "h5", "uff", "tdms", "csv"])
def test_truncated_and_mislabelled(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"r.{ending}"
    other = "tdms" if ending != "tdms" else "h5"
    for content in (b"", sound(tmp_path, ending)[:40], sound(tmp_path, other)):
        file.write_bytes(content)
        with pytest.raises(InputFileError, match=f"r.{ending}"):
            Recording.read(file)


def test_a_reader_that_hangs_or_dies_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "r.h5").write_bytes(sound(tmp_path, "h5"))
    assert Recording.read(tmp_path / "r.h5").time_s.size == 300
    assert reader._child is not None
    reader._child.process.send_signal(signal.SIGSTOP)
    with pytest.raises(InputFileError, match="within 0 s"):
        reader.read_series(tmp_path / "r.h5", patience_s=0.0)
    assert Recording.read(tmp_path / "r.h5").time_s.size == 300
    reader._child.process.kill()
    reader._child.process.wait()
    assert Recording.read(tmp_path / "r.h5").time_s.size == 300


def test_a_reader_that_computes_too_long_is_ended() -> None:
    """The system ends it, whatever loop of a library it is in; how it ended can be told from a crash."""
    loop = "from fasbody.recording.formats.reader import allow; allow(0)\nwhile True: pass"
    ended = subprocess.run([sys.executable, "-c", loop], timeout=600)
    assert ended.returncode == -signal.SIGXCPU


def test_other_endings_are_refused_and_the_known_ones_listed(tmp_path: Path) -> None:
    (tmp_path / "r.docx").write_bytes(b"PK\x03\x04 text")
    with pytest.raises(InputFileError, match=r"no format has the ending '\.docx'; valid: \.csv, \.txt, .*, \.tdms"):
        Recording.read(tmp_path / "r.docx")
