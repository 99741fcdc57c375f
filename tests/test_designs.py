"""Estimators over random designs of excitation: each ends in numbers, or in a reason that a check gave."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from fasbody.exceptions import FasError, RecordingError
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study
from fasbody.transmissibility.broadband import ESTIMATES
from fasbody.transmissibility.estimate import Row, rows
from fasbody.transmissibility.local import local
from fasbody.transmissibility.table import Table

#: Share of designs that may be refused, for they are too short for a resolution that was drawn with them.
_REFUSED = 0.3


def foot(frequency_hz: np.ndarray) -> np.ndarray:
    """A mass on a spring and damper at 22 Hz: its motion over that of the base."""
    r = frequency_hz / 22
    return (1 + 0.4j * r) / (1 - r * r + 0.4j * r)


def multisine(lines: np.ndarray, period_s: float, time_s: np.ndarray, rng: np.random.Generator) -> Recording:
    """Base and malleolus driven at multiples of a period's frequency, with random phases, levels and noise."""
    f = lines / period_s
    size = np.abs(rng.normal(size=f.size)) ** rng.choice([0, 1])
    waves = size[:, None] * np.exp(1j * (2 * np.pi * np.outer(f, time_s) + rng.uniform(0, 2 * np.pi, (f.size, 1))))
    both = np.stack([waves.real.sum(axis=0), (foot(f)[:, None] * waves).real.sum(axis=0)])
    both *= rng.choice([1.0, 9.0]) / both[0].std()
    return Recording.from_arrays(time_s, *(both + rng.choice([0, 1e-3, 0.1]) * rng.normal(size=both.shape)), name="d")


@dataclass(frozen=True)
class Design:
    """What was drawn."""

    recording: Recording
    resolution_hz: float
    estimate: str

    @classmethod
    def drawn(cls, seed: int) -> "Design":
        rng = np.random.default_rng(seed)
        rate, period = float(rng.choice([250, 400, 512])), float(rng.choice([0.5, 1, 2, 3.3, 4]))
        seconds = min(16.0, period * rng.choice([2, 3, 6, 10, 16, 20]) + rng.choice([0, 0.3]))
        time = np.arange(int(seconds * rate)) / rate
        low = rng.uniform(3, 60)
        every = np.arange(np.ceil(low * period), np.floor((low + rng.choice([4, 10, 40])) * period) + 1)
        kept = {"all": every > 0, "odd": every % 2 == 1, "random": rng.random(every.size) < 0.6}
        kept["without five"] = ~np.isin(every, rng.choice(every, min(5, every.size // 2), replace=False))
        lines = every[kept[str(rng.choice(list(kept)))]]
        made = multisine(lines if lines.size else every[:1], period, time, rng)
        return cls(made, float(rng.choice([0.5, 1, 2])), str(rng.choice(ESTIMATES)))

    def rows(self) -> list[Row]:
        return rows(self.recording, self.resolution_hz, self.estimate)


@pytest.mark.long
def test_every_random_design_has_an_answer_or_a_reason() -> None:
    refused = 0
    for seed in range(30):
        try:
            found = Design.drawn(seed).rows()
        except FasError as reason:
            assert "unforeseen" not in str(reason), (seed, reason)
            refused += 1
            continue
        assert found
        assert np.isfinite([(row.transmissibility, row.phase_deg, row.transmissibility_std) for row in found]).all()
    assert refused < 30 * _REFUSED


@pytest.mark.parametrize("estimate", ESTIMATES)
def test_lines_that_nearly_repeat_themselves_have_a_response(estimate: str) -> None:
    """Of 3.3 s, within 4 Hz: after 1.98 s they look much alike, and no line of that period is driven."""
    found = rows(Design.drawn(1014).recording, 2.0, estimate)
    assert found and np.isfinite([row.transmissibility_std for row in found]).all()


@pytest.mark.parametrize("left_out", [0, 5])
def test_a_multisine_of_every_line_is_read_by_its_periods(left_out: int) -> None:
    """Every line of 5 to 50 Hz, or five left out: few silent lines tell little of distortion, and no more."""
    rng, period = np.random.default_rng(3), 2.0
    every = np.arange(10, 101)
    lines = np.delete(every, rng.choice(np.arange(1, 90), left_out, replace=False))
    recording = multisine(lines, period, np.arange(20_000) / 1000, rng)
    found = rows(recording)
    assert {row.method for row in found} == {"10 periods of 2 s"}
    for row in found:
        H = row.transmissibility * np.exp(1j * np.radians(row.phase_deg))
        assert abs(H - foot(np.array(row.frequency_hz))) < 5 * np.hypot(row.transmissibility_std, 1e-6)


def test_two_periods_of_two_lines_are_refused_with_a_reason() -> None:
    """Two lines alone in a window do not determine a response that bends."""
    time, f = np.arange(3200) / 400, np.array([10.0, 12.0])
    waves = np.exp(2j * np.pi * np.outer(f, time))
    channels = {"base": waves.real.sum(axis=0), "malleolus": (foot(f) @ waves).real}
    with pytest.raises(RecordingError, match=r"too few lines within 2 Hz .* three periods or more"):
        local(time, channels, np.array([11.0]), (10.0, 12.0), 2.0)


def test_an_unforeseen_error_is_named_and_the_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """One recording of two makes an estimator fail: the table has the other, and says which and why."""
    from fasbody.transmissibility import estimate

    def broken(time_s: np.ndarray, *rest: object) -> None:
        if time_s.size == 3000:
            raise ZeroDivisionError("by nothing")
        return original(time_s, *rest)  # type: ignore[arg-type]

    original = estimate.broadband
    monkeypatch.setattr(estimate, "broadband", broken)
    lines, rng = np.arange(10, 80), np.random.default_rng(0)
    good, bad = (multisine(lines, 1.0, np.arange(n) / 500, rng) for n in (4000, 3000))
    table = Table.of_recordings([bad, good])
    (problem,) = table.problems
    assert problem.startswith("d: cannot be used, for an unforeseen ZeroDivisionError (by nothing)")
    assert table.frame["file"].nunique() == 1


def test_a_late_channel_of_impossible_numbers_is_refused_not_splined(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    base = 9 * np.sin(40 * np.pi * np.arange(1000) / 1000)
    spoiled = np.where(np.arange(1000) == 500, 1e308, base)
    channels = [
        nptdms.ChannelObject(
            "run", name, values, {"wf_increment": 1e-3, "wf_start_offset": late, "unit_string": "m/s^2"}
        )
        for name, values, late in (("base", base, 0.0), ("malleolus", spoiled, 2e-3))
    ]
    with nptdms.TdmsWriter(tmp_path / "x.tdms") as writer:
        writer.write_segment(channels)
    with pytest.raises(RecordingError, match="which no body does"):
        checked(Recording.read(tmp_path / "x.tdms"))


def test_a_check_of_a_study_goes_on_after_an_unforeseen_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recording is called unusable, by its name and the error; the others are sound."""
    from fasbody.recording import checks

    def broken(time_s: np.ndarray, channels: dict[str, np.ndarray], frequency_hz: float | None) -> object:
        if time_s.size == 3000:
            raise FloatingPointError("underflow")
        return original(time_s, channels, frequency_hz)

    original = checks.quality
    monkeypatch.setattr(checks, "quality", broken)
    t = np.arange(4000) / 1000
    base, malleolus = 9 * np.sin(40 * np.pi * t), 11 * np.sin(40 * np.pi * t - 0.4)
    made = [Recording.from_arrays(t[:n], base[:n], malleolus[:n], name=f"{n}") for n in (3000, 4000)]
    checks.checked.cache_clear()
    first, second = Study("two", "synthetic", "", tuple(made)).check().rows
    assert first["problem"].startswith("3000: cannot be used, for an unforeseen FloatingPointError (underflow)")
    assert second["problem"] == "" and second["transmissibility"] == pytest.approx(11 / 9)
