"""The grid of samples: gaps to the sample, restarts, clocks, lateness, and the judgement."""

from dataclasses import replace

import numpy as np
import pytest
from feeder import COUNTS, counts_of, hello
from hypothesis import given
from hypothesis import strategies as st

from fasbody.acquire.timeline import Gap, Lateness, Quality, Timeline
from fasbody.acquire.wire import Block, Damage, Hello

N = 16


def block(frame: int, rate: float = 1000.0, first: int = 0, time_us: int | None = None) -> Block:
    stamp = round(frame * N / rate * 1e6) if time_us is None else time_us
    samples = counts_of(np.arange(frame * N, frame * N + N), 2) / COUNTS
    return Block((first + frame) % 2**32, stamp % 2**32, samples, np.zeros(2, int))


@given(st.sets(st.integers(1, 60)), st.sampled_from([0, 2**32 - 20]))
def test_every_received_sample_is_at_its_place_and_every_lost_one_counted(lost: set[int], first: int) -> None:
    timeline = Timeline(hello())
    for frame in range(62):
        if frame not in lost:
            timeline.add([block(frame, first=first)], 0.016 * frame)
    index, values = timeline.samples()
    np.testing.assert_array_equal(values * COUNTS, counts_of(index, 2))
    quality = timeline.quality()
    assert quality.lost_frames == len(lost) and quality.lost_samples == N * len(lost)
    runs = len([f for f in lost if f - 1 not in lost])
    assert len(quality.gaps) == runs and quality.frames == 62 - len(lost)
    assert timeline.length == 62 * N
    assert bool(quality.problems()) == bool(lost)


def test_gap_says_where() -> None:
    timeline = Timeline(hello())
    timeline.add([block(f) for f in (0, 1, 4, 5)], 0.1)
    (gap,) = timeline.quality().gaps
    assert gap.after_s == pytest.approx(0.031) and gap.lost_samples == 32 and gap.cause == "lost frames"
    assert timeline.quality(length=20).gaps == ()


def test_samples_skipped_inside_the_board_show_in_its_time_stamps() -> None:
    timeline = Timeline(hello())
    timeline.add([block(0), block(1), block(2, time_us=32_000 + 5_000), block(3, time_us=48_000 + 5_000)], 0.1)
    (gap,) = timeline.quality().gaps
    assert (gap.lost_samples, gap.cause) == (5, "skipped")


@pytest.mark.parametrize("n", [16, 64, 100, 240])
@pytest.mark.parametrize("ppm", [-4000.0, 0.0, 4000.0])
@pytest.mark.parametrize("at", [4, 20, 150])
def test_one_skipped_sample_shows_whatever_the_frame_size_and_the_clock(n: int, ppm: float, at: int) -> None:
    """The board's clock is off and rounds, stamps jitter by a twentieth of a sample: one left out is one gap."""
    jitter = np.random.default_rng(n).uniform(-50, 50, 300)
    for skipped in (0, 1):
        timeline = Timeline(replace(hello(), frame_samples=n))
        for frame in range(300):
            number = frame * n + (skipped if frame >= at else 0)
            stamp = round(number * 1e3 * (1 + ppm * 1e-6) + jitter[frame] + 50)
            timeline.add([Block(frame, stamp, np.zeros((n, 2)), np.zeros(2, int))], 0.001 * number)
        gaps = timeline.quality().gaps
        assert [(gap.lost_samples, gap.cause) for gap in gaps] == [(1, "skipped")] * skipped
        assert timeline.samples()[0][-1] + 1 == 300 * n + skipped


def jittered(
    blocks: int, n: int, jitter: np.ndarray, skips: dict[int, int], rate: float = 1000.0, ppm: float = 300.0
) -> Timeline:
    """A stream whose stamps jitter (blocks,) [samples] and that skips so many samples before some blocks."""
    timeline = Timeline(replace(hello(rate), frame_samples=n, bits=16 if n > 1 else 0))
    number = 0
    for i in range(blocks):
        number += skips.get(i, 0)
        stamp = round((number * (1 + ppm * 1e-6) + jitter[i] + 10) / rate * 1e6)
        timeline.add([Block(i, stamp % 2**32, np.zeros((n, 2)), np.zeros(2, int))], number / rate)
        number += n
    return timeline


@pytest.mark.parametrize("kind", ["uniform", "late", "milliseconds"])
@pytest.mark.parametrize(("blocks", "n", "rate"), [(94, 16, 1000.0), (625, 16, 1000.0), (3000, 1, 500.0)])
def test_stamps_that_jitter_by_two_samples_make_no_gap(kind: str, blocks: int, n: int, rate: float) -> None:
    """Taken in software: anywhere within two samples, now and then late, or in steps of four samples."""
    rng = np.random.default_rng(blocks)
    exact = np.arange(blocks) * n
    jitter = {
        "uniform": rng.uniform(-2, 2, blocks),
        "late": (rng.random(blocks) < 0.05) * rng.uniform(0, 4, blocks),
        "milliseconds": 4 * np.floor(exact / 4) - exact,
    }[kind]
    timeline = jittered(blocks, n, jitter, {}, rate)
    quality = timeline.quality()
    assert quality.gaps == () and quality.problems() == []
    np.testing.assert_array_equal(timeline.samples()[0], np.arange(blocks * n))
    assert abs(quality.rate_ppm + 300) < max(20.0, 4 * quality.rate_std_ppm)
    if kind == "uniform":
        assert quality.jitter == pytest.approx(2 / np.sqrt(3), rel=0.2)
        assert any("jitter" in text for text in quality.remarks())


@pytest.mark.parametrize(
    ("blocks", "n", "wide", "skips"),
    [
        (3750, 16, 2.0, {1900: 1}), (3750, 16, 2.0, {1000: 4, 2800: 7}), (625, 16, 2.0, {320: 4}),
        (5000, 1, 2.0, {2500: 1}), (5000, 1, 2.0, {1200: 30, 3900: 3}), (3000, 1, 0.5, {800: 1, 2000: 1}),
        (3000, 1, 0.05, {5: 1, 9: 2, 10: 1, 700: 1, 702: 6, 2990: 1}),
    ],
)  # fmt: skip
def test_what_was_really_skipped_shows_through_the_jitter(
    blocks: int, n: int, wide: float, skips: dict[int, int]
) -> None:
    for seed in range(4):
        jitter = np.random.default_rng(seed).uniform(-wide, wide, blocks)
        timeline = jittered(blocks, n, jitter, skips)
        gaps = timeline.quality().gaps
        # the more it jitters, the less sure are length and place
        found = sum(gap.lost_samples for gap in gaps)
        assert abs(found - sum(skips.values())) <= (0 if wide < 1 else len(skips))
        assert timeline.samples()[0][-1] + 1 == blocks * n + found
        places = [round(gap.after_s * 1000) + 1 for gap in gaps]
        wanted = [at * n + sum(s for k, s in skips.items() if k < at) for at in skips]
        near = 0 if wide < 0.1 else 60 * wide * n
        assert len(places) == len(wanted) and np.abs(np.subtract(places, wanted)).max() <= near


@pytest.mark.parametrize("at", [1, 2, 3, 5, 397, 398, 399])
@pytest.mark.parametrize(("n", "missing", "wide"), [(10, 500, 0.0), (1, 3, 0.03), (16, 1, 0.03), (1, 40, 2.0)])
def test_gap_near_an_end_shows(at: int, n: int, missing: int, wide: float) -> None:
    jitter = np.random.default_rng(2).uniform(-wide, wide, 400)
    assert jittered(400, n, jitter, {}).quality().gaps == ()
    timeline = jittered(400, n, jitter, {at: missing})
    assert sum(gap.lost_samples for gap in timeline.quality().gaps) == pytest.approx(missing, abs=2 * wide)
    assert timeline.quality().gaps[0].after_s == pytest.approx((at * n - 1) / 1000, abs=0.01)


def test_stamp_that_is_late_alone_is_no_gap_where_others_are_late_too() -> None:
    jitter = np.zeros(400)
    jitter[[50, 130, 399]] = 3.0
    assert jittered(400, 1, jitter, {}).quality().gaps == ()


@pytest.mark.parametrize("n", [1, 16])
def test_stamps_that_do_not_advance_are_a_problem(n: int) -> None:
    timeline = Timeline(replace(hello(), frame_samples=n))
    for i in range(400):
        timeline.add([Block(i, 0, np.zeros((n, 2)), np.zeros(2, int))], 0.001 * n * i)
    quality = timeline.quality()
    assert quality.gaps == () and timeline.samples()[0].size == 400 * n
    (text,) = quality.problems()
    assert "time stamps do not advance" in text and quality.remarks() == [] and "clock" not in str(quality)


def test_damaged_text_lines_are_gaps_of_their_own_however_the_stamps_jitter() -> None:
    """Half of a line is no sample; a damaged heading is none either, which good stamps show."""
    for wide, expected in ((0.02, [1, 1]), (2.0, [1, 1, 1])):
        timeline = Timeline(replace(hello(), bits=0, frame_samples=1))
        rng = np.random.default_rng(1)
        for i in range(600):
            if i in (100, 300):
                timeline.add([Damage("line not understood", 20)], 0.0)
                continue
            if i == 400:
                timeline.add([Damage("header not understood", 20)], 0.0)
            stamp = round(1000 * (i + 5 + rng.uniform(-wide, wide)))
            timeline.add([Block(i, stamp, np.zeros((1, 2)), np.zeros(2, int))], 0.0)
        quality = timeline.quality()
        assert [gap.lost_samples for gap in quality.gaps] == expected and quality.damaged == 3
        assert {gap.cause for gap in quality.gaps} == {"damaged lines"}


def test_device_time_going_back_is_a_restart_and_running_over_is_not() -> None:
    timeline = Timeline(hello())
    timeline.add([block(f, time_us=f * 16_000 + 5_000_000) for f in range(20)], 0.32)
    timeline.add([block(20, time_us=1000)], 0.336 + 0.5)
    (gap,) = timeline.quality().gaps
    assert gap.cause == "restart" and gap.lost_samples == 500
    over = Timeline(hello())
    over.add([block(f, time_us=2**32 - 100_000 + f * 16_000) for f in range(20)], 0.32)
    assert over.quality().gaps == ()


@pytest.mark.parametrize("boot", [1, 2])
def test_restart_is_a_gap_by_the_host_clock(boot: int) -> None:
    """With another boot number even a sequence that happens to continue is a restart."""
    timeline = Timeline(hello())
    timeline.add([hello(boot=1), *(block(f) for f in range(10))], 0.16)
    timeline.add([hello(boot=boot), block(0 if boot == 1 else 10, time_us=0)], 2.16)
    (gap,) = timeline.quality().gaps
    assert gap.cause == "restart" and gap.lost_samples == 2000 - N


def test_changed_description_and_damage() -> None:
    timeline = Timeline(hello())
    timeline.add([block(0), Damage("CRC", 30), Hello("feeder", 2000.0, hello().channels, 16, N)], 0.0)
    quality = timeline.quality()
    assert quality.changed and quality.damaged == 1
    assert any("description" in text for text in quality.problems())
    assert quality.remarks() == ["1 damaged piece on the line"]


def test_a_block_of_another_width_is_no_part_of_the_recording() -> None:
    """The first block already may be of a changed board; the clock then has nothing to go by."""
    timeline = Timeline(hello())
    timeline.add([replace(block(0), samples=np.zeros((N, 3)))], 0.0)
    assert timeline.length == 0
    timeline.add([block(1)], 0.1)
    assert timeline.length == N and timeline.quality().changed


@pytest.mark.parametrize("ppm", [-2000.0, 0.0, 800.0])
def test_drift_of_the_device_clock_is_measured_through_jitter(ppm: float) -> None:
    """Arrivals late by an exponential 3 ms: the drift is found within four standard errors, and those are small."""
    rng = np.random.default_rng(3)
    timeline = Timeline(hello())
    for frame in range(620):
        due = (frame + 1) * N / 1000 / (1 + ppm * 1e-6)
        timeline.add([block(frame)], 100.0 + due + rng.exponential(3e-3))
    quality = timeline.quality()
    assert abs(quality.drift_ppm - ppm) < 4 * quality.drift_std_ppm
    assert quality.drift_std_ppm < 60
    assert any("clock" in text for text in quality.remarks()) == (ppm != 0.0)
    assert quality.problems() == []


@pytest.mark.parametrize("begins", [-0.01, 0.7])
def test_what_is_made_up_for_says_nothing_of_the_clock(begins: float) -> None:
    """A board or computer stands still for 0.8 of 1.5 s, then sends what it holds eight times as fast."""
    rng, timeline = np.random.default_rng(3), Timeline(hello())
    for frame in range(93):
        due = (frame + 1) * N / 1000 + rng.uniform(0, 1e-3)
        held = begins + 0.8 + (due - begins) / 8 if due > begins else due
        timeline.add([block(frame)], 100.0 + max(due, held))
    assert timeline.quality().problems() == []


@pytest.mark.parametrize(("ppm", "refused"), [(100, False), (600, False), (8000, True)])
def test_rate_by_the_device_clock_against_the_declared_one(ppm: float, refused: bool) -> None:
    timeline = Timeline(hello())
    timeline.add([block(f, time_us=round(f * N / 1000 * 1e6 / (1 + ppm * 1e-6))) for f in range(300)], 0.0)
    quality = timeline.quality()
    assert quality.rate_ppm == pytest.approx(ppm, abs=1)
    assert bool(quality.problems()) == refused
    assert bool(quality.remarks()) == (ppm == 600)


def test_over_range_is_a_problem() -> None:
    timeline = Timeline(hello())
    one = block(0)
    timeline.add([Block(one.sequence, one.time_us, one.samples, np.array([0, 3]))], 0.0)
    assert timeline.over_range == {"base": 0, "malleolus": 3}
    assert timeline.quality().problems() == ["over range: malleolus 3 samples"]


FRAME_S = 0.016


def lateness(late_s: np.ndarray, drift: float = 0.0, first_us: int = 0) -> np.ndarray:
    """What is found for frames that come 5 ms after they were taken, and so much later [s]."""
    taken = FRAME_S * np.arange(late_s.size)
    judge = Lateness()
    stamps = [(first_us + round(1e6 * (1 + drift) * t)) % 2**32 for t in taken]
    return np.array([judge.of(us, 40.0 + t + 0.005 + late) for us, t, late in zip(stamps, taken, late_s, strict=True)])


@pytest.mark.parametrize("first_us", [0, 2**32 - 3_000_000])
@pytest.mark.parametrize("drift", [-2e-4, 0.0, 2e-4])
def test_late_frames_are_told_by_how_much(drift: float, first_us: int) -> None:
    """Whatever the clocks' offset, also where the 32-bit clock turns over; a minute's drift counts for little."""
    late = np.zeros(4000)
    late[1000:1040] = np.linspace(0.64, 0.0, 40)  # a computer that looks away for 0.64 s gets all frames at once
    late[2000:] = 0.3
    found = lateness(late, drift, first_us)
    until = FRAME_S * np.arange(4000)  # drift that was allowed for and did not happen, at most
    assert (np.abs(found - late)[:2000] <= 1e-6 + 7e-4 * until[:2000]).all()
    assert found[1000] == pytest.approx(0.64, abs=0.012) and found[2000] == pytest.approx(0.3, abs=0.025)


@pytest.mark.parametrize("drift", [-4e-3, 4e-3])
def test_clock_that_is_only_just_accepted_is_not_late_after_a_quarter_of_an_hour(drift: float) -> None:
    """A recording may be 5000 ppm off; without allowing for it a frame would seem 3.6 s late here."""
    assert lateness(np.zeros(57_000), drift).max() < 1e-3


def test_stamps_that_stand_still_are_told() -> None:
    judge = Lateness()
    for n in range(100):
        judge.of(0, FRAME_S * n)
        assert judge.still == (FRAME_S * n > 1.0)
    judge.of(16_000, 2.0)
    assert not judge.still


def test_restarted_board_is_not_late_for_ever() -> None:
    judge = Lateness()
    for n in range(100):
        judge.of(round(1e6 * (50 + FRAME_S * n)), FRAME_S * n)
    found = [judge.of(round(1e6 * FRAME_S * n), 2.0 + FRAME_S * n) for n in range(100)]
    assert max(found) < 1e-3


def test_one_is_singular_and_a_clock_without_an_uncertainty_is_not_printed() -> None:
    one = Quality(frames=1, lost_frames=1, damaged=1, gaps=(Gap(0.1, 1, "skipped"),), over_range={"base": 1})
    assert str(one) == "1 frame, 1 lost, 1 damaged, 1 gap"
    assert one.problems()[0].startswith("1 sample is missing in 1 gap (")
    assert one.problems()[1] == "over range: base 1 sample"
    assert one.remarks() == ["1 damaged piece on the line"]
    noise = Quality(frames=62, drift_ppm=2900.0, drift_std_ppm=1100.0, rate_ppm=900.0, rate_std_ppm=400.0)
    assert "clock" not in str(noise) and noise.remarks() == noise.problems() == []
    known = Quality(frames=6200, drift_ppm=900.0, drift_std_ppm=10.0)
    assert str(known).endswith("clock +900 +- 30 ppm")
    assert known.remarks() == ["the board's clock differs from the computer's by +900 +- 30 ppm"]
