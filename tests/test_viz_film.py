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

from fasbody.exceptions import SettingError  # noqa: E402
from viz import export  # noqa: E402
from viz.show import Show  # noqa: E402


@pytest.fixture(scope="module")
def show() -> Show:
    if export.chromium() is None:
        pytest.skip("no Chromium on this machine (apt-get install chromium)")
    return Show(["two_dof"])


def test_gif_is_one_period_that_moves(show: Show, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export, "GIF", replace(export.GIF, frames=4, size=0.25))
    film = Image.open(BytesIO(export.gif(show)))
    assert (film.format, film.n_frames, film.size) == ("GIF", 4, (export.WIDTH // 4, export.HEIGHT // 4))
    frames = []
    for k in range(4):
        film.seek(k)
        assert film.info["duration"] == pytest.approx(1000 / export.GIF.rate, abs=10)
        frames.append(film.convert("RGB").tobytes())
    assert len(set(frames)) == 4


def test_mp4_is_played_by_ffmpeg(show: Show, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Decoded to the end: as many frames as were drawn, of the size that was drawn."""
    monkeypatch.setattr(export, "MP4", replace(export.MP4, frames=6, size=0.25))
    try:
        tool = export.ffmpeg()
    except SettingError:
        pytest.skip("no ffmpeg (pip install 'fasbody[film]')")
    film = tmp_path / "foot.mp4"
    export.export_to(show, film)
    probe = subprocess.run(
        [tool, "-hide_banner", "-i", str(film), "-f", "null", "-"], capture_output=True, text=True, check=True
    ).stderr
    assert "Video: h264" in probe
    assert "yuv420p" in probe
    assert f"{export.WIDTH // 4}x{export.HEIGHT // 4}" in probe
    assert int(re.findall(r"frame=\s*(\d+)", probe)[-1]) == 6 * export.MP4.repeats


@pytest.mark.parametrize(("hz", "frames"), [(10.0, 120), (25.0, 300)])
def test_film_of_a_transient_has_twelve_frames_a_cycle(hz: float, frames: int) -> None:
    times = np.arange(1250) / 1250
    foot = {"periodic": False, "duration": 1.0, "base": list(np.sin(2 * np.pi * hz * times))}
    documents = {"motion": {"feet": {"a": foot}}, "model": {"look": {"slow": 12.0}}}
    film = export.paced(documents, export.GIF)
    assert film.frames == frames
    assert film.frames / film.rate == pytest.approx(12.0)  # seconds, as --slow says
    assert film.repeats == 1
    foot["base"] = list(np.sin(2 * np.pi * 50 * times))
    with pytest.raises(SettingError, match=r"up to 50 Hz, 12 times slower, are 600 frames, but 300 .* --seconds 0\.4"):
        export.paced(documents, export.GIF)
    foot["periodic"] = True
    assert export.paced(documents, export.GIF) == export.GIF


def test_ending_in_capitals(tmp_path: Path) -> None:
    export.export_to(Show(["two_dof"]), tmp_path / "foot.HTML")
    assert (tmp_path / "foot.HTML").read_text().startswith("<!DOCTYPE html>")


def test_without_ffmpeg_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(SettingError, match=r"pip install 'fasbody\[film\]', or export a \.gif\.$"):
        export.ffmpeg()


def test_system_ffmpeg_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    assert export.ffmpeg() == "/usr/bin/ffmpeg"
