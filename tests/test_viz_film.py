"""Pictures and films that other programs play, drawn small; and the sentence where a tool is missing."""

import re
import subprocess
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("meshcat", reason="needs the extra: pip install 'fasbody[view]'")
pytest.importorskip("playwright", reason="pip install 'fasbody[dev]'")
Image = pytest.importorskip("PIL.Image", reason="pip install 'fasbody[dev]'")

from fasbody.exceptions import MissingPackageError, SettingError  # noqa: E402
from viz import exported  # noqa: E402
from viz.feet import Show  # noqa: E402


@pytest.fixture(scope="module")
def show() -> Show:
    if exported.chromium() is None:
        pytest.skip("no Chromium on this machine (apt-get install chromium)")
    return Show(["two_dof"])


@pytest.mark.long
def test_gif_is_one_period_that_moves(show: Show, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exported, "GIF", replace(exported.GIF, frames=4, size=0.25))
    film = Image.open(BytesIO(exported.gif(show)))
    assert (film.format, film.n_frames, film.size) == ("GIF", 4, (exported.WIDTH // 4, exported.HEIGHT // 4))
    frames = []
    for k in range(4):
        film.seek(k)
        assert film.info["duration"] == pytest.approx(1000 / exported.GIF.rate, abs=10)
        frames.append(film.convert("RGB").tobytes())
    assert len(set(frames)) == 4


@pytest.mark.long
def test_mp4_is_played_by_ffmpeg(show: Show, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Decoded to the end: as many frames as were drawn, of the size that was drawn."""
    monkeypatch.setattr(exported, "MP4", replace(exported.MP4, frames=6, size=0.25))
    try:
        tool = exported.ffmpeg()
    except SettingError:
        pytest.skip("no ffmpeg (pip install 'fasbody[film]')")
    film = tmp_path / "foot.mp4"
    exported.export_to(show, film)
    probe = subprocess.run(
        [tool, "-hide_banner", "-i", str(film), "-f", "null", "-"], capture_output=True, text=True, check=True
    ).stderr
    assert "Video: h264" in probe
    assert "yuv420p" in probe
    assert f"{exported.WIDTH // 4}x{exported.HEIGHT // 4}" in probe
    assert int(re.findall(r"frame=\s*(\d+)", probe)[-1]) == 6 * exported.MP4.repeats


@pytest.mark.parametrize(("hz", "frames"), [(10.0, 120), (25.0, 300)])
def test_film_of_a_transient_has_twelve_frames_a_cycle(hz: float, frames: int) -> None:
    times = np.arange(1250) / 1250
    foot = {"periodic": False, "duration": 1.0, "base": list(np.sin(2 * np.pi * hz * times))}
    documents = {"motion": {"feet": {"a": foot}}, "model": {"look": {"slow": 12.0}}}
    film = exported.paced(documents, exported.GIF)
    assert film.frames == frames
    assert film.frames / film.rate == pytest.approx(12.0)  # seconds, as --slow says
    assert film.repeats == 1
    foot["base"] = list(np.sin(2 * np.pi * 50 * times))
    with pytest.raises(SettingError, match=r"up to 50 Hz, 12 times slower, are 600 frames, but 300 .* --seconds 0\.4"):
        exported.paced(documents, exported.GIF)
    foot["periodic"] = True
    assert exported.paced(documents, exported.GIF) == exported.GIF


def test_ending_in_capitals(tmp_path: Path) -> None:
    exported.export_to(Show(["two_dof"]), tmp_path / "foot.HTML")
    assert (tmp_path / "foot.HTML").read_text().startswith("<!DOCTYPE html>")


def test_without_ffmpeg_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingPackageError, match=r"pip install 'fasbody\[film\]' .*, or export a \.gif\.$"):
        exported.ffmpeg()


def test_system_ffmpeg_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    assert exported.ffmpeg() == "/usr/bin/ffmpeg"
