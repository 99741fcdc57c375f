"""Two loggers with clocks of their own, merged: the delay that was put in comes out, within what is stated."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fasbody.exceptions import RecordingError
from fasbody.recording.__main__ import app
from fasbody.recording.merge import Merged, merge
from fasbody.recording.recording import Recording, gain_and_delay
from fasbody.transmissibility.estimate import rows

TRUE = 1.3 * np.exp(-1j * np.radians(40))


def loggers(
    seed: int, knocks: bool = True, clock: float = 40e-6, start: float = 1.2345
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A sine of 20 Hz; the logger on the knee starts later, at another rate, and its clock is a little slow."""
    rng = np.random.default_rng(seed)
    t = np.arange(30_000) / 1000
    real = start + np.arange(20_000) / 800.0 * (1 + clock)
    u = np.arange(20_000) / 800.0

    def motion(time: np.ndarray, H: complex) -> np.ndarray:
        x = (8.95 * H * np.exp(2j * np.pi * 20 * time)).real * (((time > 4) & (time < 24)) | (not knocks))
        for at in (2.0, 25.5) if knocks else ():
            after = np.maximum(0, time - at)
            x = x + 60 * np.sin(2 * np.pi * 180 * after) * np.exp(-after / 0.004) * (time > at)
        return x + 0.02 * rng.normal(size=time.size)

    return t, motion(t, 1.0), u, motion(real, TRUE)


def test_knocks_tell_delay_and_clock() -> None:
    errors, stated = [], []
    for seed in range(8):
        start = 1.0 + 0.1 * seed / 7
        made = merge(*loggers(seed, start=start))
        assert made.way == "knock" and made.clock == pytest.approx(40e-6, abs=40e-6)
        errors.append(made.delay_s - start)
        stated.append(made.delay_std_s)
    assert np.abs(errors).max() < 3 * np.mean(stated) < 2e-3
    assert "merged by knock: the second logger started" in str(made)


def test_the_uncertain_delay_reaches_the_phase() -> None:
    made = merge(*loggers(3))
    _, delay_std_s = gain_and_delay(made.recording, "malleolus", "base")
    assert delay_std_s == made.delay_std_s
    t = made.recording.time_s
    inside = (t > 3) & (t < 20)
    r = made.recording
    cut = Recording(t[inside], r.base_m_s2[inside], r.malleolus_m_s2[inside], calibration=r.calibration)
    row = rows(cut)[0]
    assert row.transmissibility == pytest.approx(1.3, rel=2e-3)
    assert abs(row.phase_deg + 40) < 3 * row.phase_std_deg
    assert row.phase_std_deg > 0.9 * 360 * 20 * made.delay_std_s


def test_a_sine_alone_tells_no_delay() -> None:
    with pytest.raises(RecordingError, match="as a sine does"):
        t = np.arange(10_000) / 1000
        merge(t, np.sin(2 * np.pi * 20 * t), t, np.sin(2 * np.pi * 20 * t - 0.7))
    with pytest.raises(RecordingError, match="no knock stands out"):
        merge(*loggers(0, knocks=False), way="knock")


def test_correlation_serves_where_the_motion_does_not_repeat_itself() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(20_000) / 1000
    x = np.convolve(rng.normal(size=t.size), np.hanning(25), "same")
    made = merge(t, x, t[:15_000], x[2345:17_345], way="correlation")
    assert made.delay_s == pytest.approx(2.345, abs=1e-3)
    assert made.delay_std_s > 2e-3


def test_the_command_writes_a_recording_that_knows_its_delay(tmp_path: Path) -> None:
    t, base, u, other = loggers(1)
    table, knee, out = tmp_path / "table.csv", tmp_path / "knee.csv", tmp_path / "merged.csv"
    np.savetxt(table, np.column_stack([t, base]), "%.6f", ",", header="time_s,base_m_s2", comments="")
    np.savetxt(knee, np.column_stack([u, other / 9.80665]), "%.7f", ",", header="time_s,z [g]", comments="")
    told = CliRunner().invoke(app, ["merge", str(table), str(knee), str(out), "--malleolus", "z"])
    assert told.exit_code == 0, told.output
    read = Recording.read(out)
    assert gain_and_delay(read, "malleolus", "base")[1] == pytest.approx(5e-4, rel=0.5)
    assert json.loads(out.with_suffix(".json").read_text())["delay_std_s"]["malleolus"] > 0
    assert any("two loggers" in text for text in read.warnings)


def test_a_shaker_that_starts_at_once_is_no_knock() -> None:
    for seed in range(4):
        t, base, u, foot = loggers(seed, clock=30e-6)
        early, soon = t < 3, u < 1.7  # the knock before is lost, and the sine starts and stops with a jump
        base, foot = (np.where(early, 0.0, base), np.where(soon, 0.0, foot))
        rng = np.random.default_rng(seed)
        made = merge(t, base + 0.02 * rng.normal(size=t.size), u, foot + 0.02 * rng.normal(size=u.size))
        assert made.way == "knock" and made.clock == 0
        knock = 24.2655  # on the second clock
        assert abs(made.delay_s - 1.2345 - 30e-6 * knock) < 0.5e-3
        assert made.delay_std_s > 30e-6 * (knock - 12.5)  # what the clocks gained from the middle to the knock


def test_the_sentence_says_who_started_later_and_whose_clock_is_slow() -> None:
    """Seconds of the second logger are longer by 200 ppm, so its clock is slow; nothing is said of a clock alike."""
    recording = merge(*loggers(3)).recording
    assert "1.23450 s after the first" in str(Merged(recording, "knock", 1.2345, 3e-4, 2e-4))
    assert str(Merged(recording, "knock", 1.0, 3e-4, 2e-4)).endswith("its clock is 200 ppm slower")
    alike = str(Merged(recording, "knock", -1e-9, 3e-4, 1e-9))
    assert "started at the same time as the first" in alike and "ppm" not in alike and "-0" not in alike


def written(folder: Path, heading: str) -> list[str]:
    """The files of table and foot, each with one column of the same name."""
    names = []
    for name, (t, x) in zip(("table.csv", "foot.csv"), (loggers(2)[:2], loggers(2)[2:]), strict=True):
        rows = "".join(f"{a:.5f},{b:.5f}\n" for a, b in zip(t, x, strict=True))
        (folder / name).write_text(f"time_s,{heading}\n{rows}")
        names.append(str(folder / name))
    return names


@pytest.mark.parametrize("heading", ["z_m_s2", "z [m/s^2]"])
def test_a_column_is_named_with_or_without_its_unit(tmp_path: Path, heading: str) -> None:
    table, foot = written(tmp_path, heading)
    words = ["merge", table, foot, str(tmp_path / "merged.csv"), "--base", "z", "--malleolus", "z"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    wrong = CliRunner().invoke(app, [*words[:3], str(tmp_path / "other.csv"), "--base", "y"])
    assert f"name the column as in the header: --base {heading}" in str(wrong.exception)


def test_files_the_wrong_way_round_are_noticed(tmp_path: Path) -> None:
    table, foot = written(tmp_path, "z_m_s2")
    words = ["merge", foot, table, str(tmp_path / "merged.csv"), "--base", "z", "--malleolus", "z"]
    assert "the channels are swapped" in CliRunner().invoke(app, words).output.replace("\n", " ")


def test_what_a_loggers_file_states_is_passed_on(tmp_path: Path) -> None:
    table, foot = written(tmp_path, "z_m_s2")
    Path(foot).write_text("# ankle: filtered on this logger\n" + Path(foot).read_text())
    merged = tmp_path / "merged.csv"
    out = CliRunner().invoke(app, ["merge", table, foot, str(merged), "--base", "z", "--malleolus", "z"]).output
    quote = "foot.csv: a line says '# ankle: filtered on this logger', which is not applied."
    assert quote in out.replace("\n", " ")
    assert quote in json.loads(merged.with_suffix(".json").read_text())["warnings"]
    assert any(quote in warning for warning in Recording.read(merged).warnings)
