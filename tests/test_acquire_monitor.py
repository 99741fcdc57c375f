"""Faults at a simulated bench: each is said within half a second or refused, and none of a sound recording's is."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from feeder import CONDITION

from fasbody.acquire import monitor
from fasbody.acquire.capture import Capture
from fasbody.acquire.folder import convert
from fasbody.acquire.monitor import Drive, Fault, Judged, Monitor, Window, faults
from fasbody.acquire.wire import Channel, Hello, encode_data, encode_hello

COUNTS, RANGE, SECONDS, BLOCK, AT_S = 800.0, 39.2, 4.0, 10, 1.29
@dataclass(frozen=True)
class Bench:
    """A sine on the base; the malleolus is a mass on a spring (25 Hz, damping ratio 0.3), in closed form."""

    hz: float = 20.0
    rate: float = 1000.0
    amplitude: float = 8.95
    noise: float = 0.03
    seed: int = 0

    @property
    def t(self) -> np.ndarray:
        return np.arange(round(SECONDS * self.rate)) / self.rate

    def noisy(self, size: int, times: float = 1.0) -> np.ndarray:
        return np.random.default_rng(self.seed).normal(0, self.noise * times, (size, 2)) * [1, 1.7]

    def at(self, t: np.ndarray) -> np.ndarray:
        """Both sensors without noise at times (n,): (n, 2), with a shaker's harmonics."""
        out = np.zeros((t.size, 2))
        for h, share in ((1, 1.0), (2, 0.015), (3, 0.008)):
            wave = self.amplitude * share * np.exp(2j * np.pi * h * self.hz * t)
            out += np.column_stack([wave.imag, (transfer(h * self.hz) * wave).imag])
        return out

    def sound(self) -> np.ndarray:
        return self.at(self.t) + self.noisy(self.t.size)


def transfer(hz: float | np.ndarray) -> complex | np.ndarray:
    r = np.asarray(hz) / 25.0
    return (1 + 0.6j * r) / (1 - r**2 + 0.6j * r)


def column(values: np.ndarray, sensor: int, change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    out = values.copy()
    out[:, sensor] = change(out[:, sensor])
    return out


def after(bench: Bench, sensor: int, change: Callable[[np.ndarray, np.ndarray], np.ndarray], at: float) -> np.ndarray:
    """A sensor's samples from `at` on, changed: (its values, time since)."""
    late = bench.t >= at

    def changed(x: np.ndarray) -> np.ndarray:
        return np.where(late, change(x, bench.t - at), x)

    return column(bench.sound(), sensor, changed)


def mains(bench: Bench, hz: float, size: float) -> np.ndarray:
    return size * np.sin(2 * np.pi * hz * bench.t + 1.0)


def some(bench: Bench, size: float, seed: int = 7) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, size, bench.t.size)


def removed(bench: Bench, seconds: float, at: float, sensor: int | None = None) -> np.ndarray:
    """Samples lost (or, with a negative time, doubled) at one place, whose stamps do not tell."""
    t = bench.t + seconds * (bench.t >= at)
    moved = bench.at(t) + bench.noisy(t.size)
    return moved if sensor is None else column(bench.sound(), sensor, lambda x: moved[:, sensor])


def sparse(bench: Bench, since: np.ndarray) -> np.ndarray:
    """Where samples are spikes: the first, and some later ones."""
    return (some(bench, 1) > 2.7) | (np.abs(since) < 0.5 / bench.rate)


def contact(bench: Bench) -> np.ndarray:
    """A loose contact: open for 5 ms at random, a quarter of the time."""
    return np.repeat(np.random.default_rng(3).random(bench.t.size // 5 + 1) < 0.25, 5)[: bench.t.size]


def clipped(share: float, sensor: int) -> Callable[[Bench, float], np.ndarray]:
    """At the input of a converter that then averages eight samples of 8 kHz: no sample is at the rail."""

    def make(b: Bench, at: float) -> np.ndarray:
        fine = np.repeat(b.t, 8) + np.tile(np.arange(8) / 8 / b.rate, b.t.size)
        x = b.at(fine)[:, sensor]
        top = share * np.abs(x).max()
        cut = np.clip(x, -top, top).reshape(-1, 8).mean(axis=1)
        return after(b, sensor, lambda old, _: cut + b.noisy(b.t.size)[:, sensor], at)

    return make


def low_pass(x: np.ndarray, share: float) -> np.ndarray:
    out = np.empty_like(x)
    state = 0.0
    for i, value in enumerate(x):
        state += share * (value - state)
        out[i] = state
    return out


Maker = Callable[[Bench, float], np.ndarray]
#: Name, when it begins [s], what the sensors then show, and whether nobody sees the base any more.
FAULTS: list[tuple[str, float, Maker, bool]] = [
    ("base flat", AT_S, lambda b, at: after(b, 0, lambda x, s: 0 * x, at), True),
    ("base at the rail", AT_S, lambda b, at: after(b, 0, lambda x, s: 0 * x + RANGE, at), True),
    ("base silent but for noise", AT_S, lambda b, at: after(b, 0, lambda x, s: some(b, 0.03), at), True),
    ("base silent from the start", 0.0, lambda b, at: after(b, 0, lambda x, s: some(b, 0.03), at), True),
    ("base floats to the rail", AT_S,
     lambda b, at: after(b, 0, lambda x, s: 35 * (1 - np.exp(-s / 0.3)) + some(b, 0.5), at), True),
    ("base floats with hum", AT_S, lambda b, at: after(b, 0, lambda x, s: mains(b, 50, 6.0) + some(b, 0.5), at), True),
    ("base loose contact", AT_S, lambda b, at: after(b, 0, lambda x, s: np.where(contact(b), 0, x), at), True),
    ("base gain halves", AT_S, lambda b, at: after(b, 0, lambda x, s: 0.5 * x, at), False),
    ("base gain falls to a third", AT_S, lambda b, at: after(b, 0, lambda x, s: x / 3, at), True),
    ("base gain rises", AT_S, lambda b, at: after(b, 0, lambda x, s: 1.3 * x, at), False),
    ("base at a third of its level from the start", 0.0, lambda b, at: after(b, 0, lambda x, s: x / 3, at), True),
    ("base inverted", AT_S, lambda b, at: after(b, 0, lambda x, s: -x, at), False),
    ("base turned in gravity", AT_S, lambda b, at: after(b, 0, lambda x, s: x + 3, at), False),
    ("base hum 50 Hz", AT_S, lambda b, at: after(b, 0, lambda x, s: x + mains(b, 50, 1), at), False),
    ("base hum 60 Hz", AT_S, lambda b, at: after(b, 0, lambda x, s: x + mains(b, 50.3, 1), at), False),
    ("base noise", AT_S, lambda b, at: after(b, 0, lambda x, s: x + some(b, 0.7), at), False),
    ("base one spike", AT_S, lambda b, at: after(b, 0, lambda x, s: x + 5 * (np.abs(s) < 0.5 / b.rate), at), False),
    ("base clipped before its filter", AT_S, clipped(0.5, 0), False),
    ("base slow", AT_S, lambda b, at: after(b, 0, lambda x, s: low_pass(x, 0.1), at), False),
    ("base has a bit stuck", AT_S,
     lambda b, at: after(b, 0, lambda x, s: (np.round(x * COUNTS).astype(int) | 4096) / COUNTS, at), True),
    ("malleolus flat", AT_S, lambda b, at: after(b, 1, lambda x, s: 0 * x, at), False),
    ("malleolus flat from the start", 0.0, lambda b, at: after(b, 1, lambda x, s: 0 * x, at), False),
    ("malleolus flat near the end", 3.7, lambda b, at: after(b, 1, lambda x, s: 0 * x, at), False),
    ("malleolus silent but for noise", AT_S, lambda b, at: after(b, 1, lambda x, s: some(b, 0.05), at), False),
    ("malleolus floats", AT_S, lambda b, at: after(b, 1, lambda x, s: mains(b, 50, 5) + some(b, 0.5), at), False),
    ("malleolus floats from the start", 0.0,
     lambda b, at: after(b, 1, lambda x, s: mains(b, 60, 5) + some(b, 0.5), at), False),
    ("malleolus loose contact", AT_S, lambda b, at: after(b, 1, lambda x, s: np.where(contact(b), 0, x), at), False),
    ("malleolus loose on the skin", AT_S, lambda b, at: after(b, 1, lambda x, s: 2 * x, at), False),
    ("malleolus rattles", AT_S, lambda b, at: after(b, 1, lambda x, s: x + some(b, 2), at), False),
    ("malleolus inverted", AT_S, lambda b, at: after(b, 1, lambda x, s: -x, at), False),
    ("malleolus turned in gravity", AT_S, lambda b, at: after(b, 1, lambda x, s: x - 4, at), False),
    ("malleolus hum 50 Hz from the start", 0.0, lambda b, at: after(b, 1, lambda x, s: x + mains(b, 50, 1), at), False),
    ("malleolus spikes", AT_S, lambda b, at: after(b, 1, lambda x, s: x + 6 * sparse(b, s), at), False),
    ("malleolus clipped before its filter", AT_S, clipped(0.3, 1), False),
    ("malleolus late by 5 ms", AT_S, lambda b, at: removed(b, -0.005, at, 1), False),
    ("malleolus equal to the base", AT_S, lambda b, at: after(b, 1, lambda x, s: b.sound()[:, 0], at), False),
    ("equal, each with its noise", 0.0,
     lambda b, at: after(b, 1, lambda x, s: b.sound()[:, 0] + some(b, 0.05), at), False),
    ("swapped", AT_S, lambda b, at: np.where(b.t[:, None] >= at, b.sound()[:, ::-1], b.sound()), False),
    ("swapped from the start", 0.0,
     lambda b, at: b.sound()[:, ::-1] * b.amplitude / np.abs(transfer(b.hz) * b.amplitude), False),
    ("drive at another frequency", 0.0, lambda b, at: replace(b, hz=b.hz + 0.7).sound(), False),
    ("clock 1 % fast", 0.0, lambda b, at: b.at(1.01 * b.t) + b.noisy(b.t.size), False),
    ("shaker stops", AT_S, lambda b, at: b.at(b.t) * (b.t < at)[:, None] + b.noisy(b.t.size), True),
    ("shaker stops for 0.2 s", AT_S,
     lambda b, at: b.at(b.t) * ((b.t < at) | (b.t > at + 0.2))[:, None] + b.noisy(b.t.size), True),
    ("97 samples of 48 kHz lost", 1.43, lambda b, at: removed(b, 97 / 48_000, at), False),
    ("97 samples of 48 kHz doubled", 2.21, lambda b, at: removed(b, -97 / 48_000, at), False),
    *((f"24 samples of 48 kHz lost at {at:g} s", at, lambda b, at: removed(b, 24 / 48_000, at), False)
      for at in (0.31, 1.4, 2.5)),
    ("one sample of 1 kHz lost", 1.7, lambda b, at: removed(b, 1e-3, at), False),
    ("one sample of 1 kHz doubled", 1.76, lambda b, at: removed(b, -1e-3, at), False),
    ("a frame doubled", 1.9, lambda b, at: removed(b, -0.016, at), False),
    ("a period and a bit lost", 2.3, lambda b, at: removed(b, 0.053, at), False),
    ("malleolus alone loses 12 samples", 1.3, lambda b, at: removed(b, 12e-3, at, 1), False),
]  # fmt: skip


def written(folder: Path, bench: Bench, values: np.ndarray) -> tuple[list[str], str]:
    """A recording of these samples through wire and capture: its problems, and the table of good ones."""
    hello = Hello("made", bench.rate, tuple(Channel(r, RANGE, COUNTS) for r in ("base", "malleolus")), 16, BLOCK, 1)
    counts = np.clip(np.round(COUNTS * values), -32768, 32767).astype(np.int32)
    data = encode_hello(hello)
    for i in range(len(counts) // BLOCK):
        stamp = round(1e6 * i * BLOCK / bench.rate)
        data += encode_data(i, stamp, counts[i * BLOCK : (i + 1) * BLOCK], 16)
    capture = Capture(folder / "captures" / "x.fascap")
    about = {"seconds": len(counts) // BLOCK * BLOCK / bench.rate, "origin": "synthetic",
             "level": {"peak_to_peak": 2 * bench.amplitude},
             "condition": vars(replace(CONDITION, frequency_hz=bench.hz))}  # fmt: skip
    capture.add("M", 0.0, json.loads(json.dumps(about)))
    capture.add("B", 1.0, data)
    capture.close()
    made = convert(capture.file, folder)
    listed = folder / "recordings.csv"
    return list(made.problems), listed.read_text() if listed.is_file() else ""


def heard(bench: Bench, values: np.ndarray) -> list[tuple[float, Fault]]:
    """When which fault is said [s]; block by block, as samples come."""
    watching, block = Monitor(bench.rate, Drive(bench.hz, bench.amplitude)), round(0.01 * bench.rate)
    return [
        ((start + block) / bench.rate, fault)
        for start in range(0, len(values), block)
        for fault in watching.add(start, values[start : start + block])
    ]


@pytest.mark.parametrize(("name", "at", "make", "lost"), FAULTS, ids=[row[0] for row in FAULTS])
def test_a_fault_is_said_within_half_a_second_or_refused(
    tmp_path: Path, name: str, at: float, make: Maker, lost: bool
) -> None:
    bench = Bench()
    values = make(bench, at)
    said = heard(bench, values)
    problems, listed = written(tmp_path, bench, values)
    assert problems and "x.csv" not in listed
    print(f"| {name} | {f'{said[0][0] - at:.2f} s' if said else 'refused'} | {said[0][1] if said else problems[0]} |")
    assert not said or 0 < said[0][0] - at <= 0.5
    assert not lost or any(fault.rule.final and when - at <= 0.5 for when, fault in said)


def sweep(rate: float) -> np.ndarray:
    t = np.arange(round(12 * rate)) / rate
    return 8 * np.sin(2 * np.pi * (5 * t + (60 - 5) / 24 * t**2))


def random(rate: float) -> np.ndarray:
    n = round(12 * rate)
    hz = np.fft.rfftfreq(n, 1 / rate)
    noise = np.fft.rfft(np.random.default_rng(2).normal(size=n)) * ((hz > 3) & (hz < 60))
    wave = np.fft.irfft(noise, n)
    return 5 * wave / wave.std()


@pytest.mark.parametrize(
    ("rate", "noise"), [(500.0, 0.1), (1000.0, 0.01), pytest.param(4000.0, 0.1, marks=pytest.mark.long)]
)
def test_sound_sines_raise_no_alarm(rate: float, noise: float) -> None:
    """Also at a tenth of the usual level, with a clock that is off and a level that fades."""
    for hz in (5.0, 8.0, 12.3, 20.0, 31.5, 60.0):
        for amplitude in (8.95, 0.9):
            bench = Bench(hz, rate, amplitude, noise, seed=int(10 * hz))
            faded = bench.at(1.002 * bench.t) * (1 + 0.02 * bench.t[:, None]) + bench.noisy(bench.t.size)
            for values in (bench.sound(), faded):
                assert [str(fault) for _, fault in heard(bench, values)] == [], (hz, amplitude)
                assert not faults(np.arange(len(values)), values, rate, Drive(hz, amplitude))


@pytest.mark.parametrize("made", [sweep, random])
def test_sound_broadband_raises_no_alarm_and_its_faults_do(made: Callable[[float], np.ndarray]) -> None:
    rate = 1000.0
    base = made(rate)
    n = base.size
    shaken = np.fft.irfft(np.fft.rfft(base) * transfer(np.fft.rfftfreq(n, 1 / rate)), n)
    sound = np.column_stack([base, shaken]) + np.random.default_rng(1).normal(0, 0.05, (n, 2))
    index, late = np.arange(n), np.arange(n) >= 5000
    assert not faults(index, sound, rate, Drive())
    for broken, said in (
        (column(sound, 0, lambda x: np.where(late, 0, x)), "base flat"),
        (column(sound, 1, lambda x: np.where(late, 0, x)), "malleolus flat"),
        (column(sound, 1, lambda x: np.where(late, sound[:, 0], x)), "malleolus equal to the base"),
        (column(sound, 1, lambda x: np.where(late, 0.01 * x, x)), "malleolus does not follow"),
        (column(sound, 0, lambda x: np.where(late, 0.003 * x, x)), "base lost"),
        (column(sound, 1, lambda x: x + 90 * (index == 6000)), "malleolus spikes"),
    ):
        first = faults(index, broken, rate, Drive())[0]
        assert str(first).startswith(said) and 0 < first.end - 5000 <= 1500
    hit = sound + 90 * (index == 6000)[:, None]  # a blow on the base is none
    assert not faults(index, hit, rate, Drive())


def test_white_noise_of_a_skin_sensor_raises_no_alarm() -> None:
    bench = Bench(60.0, noise=0.3)
    assert not heard(bench, bench.sound())


@pytest.mark.parametrize("hz", [5.0, 10.0, 20.0, 50.0])
def test_a_person_who_sways_breaks_no_sine(hz: float) -> None:
    """The phase sways by 0.02 rad and the level by 5 % at 0.6 Hz, with a clock that is 0.3 % off."""
    bench = Bench(hz)
    sway = np.sin(2 * np.pi * 0.6 * bench.t)
    moved = bench.at(1.003 * bench.t + 0.02 * sway / (2 * np.pi * hz)) * (1 + 0.05 * sway)[:, None]
    assert not heard(bench, moved + bench.noisy(bench.t.size))


@pytest.mark.parametrize("hz", [10.0, 16.0, 25.0])
def test_a_foot_that_lifts_and_lands_each_period_is_no_spike(hz: float) -> None:
    """A landing is a pulse of 12 ms, as through a heel pad, as large as the base; it comes with every period."""
    bench = Bench(hz)
    since = bench.t % (1 / hz)
    landing = 9 * np.where(since < 0.012, np.sin(np.pi * since / 0.012), 0.0)
    assert not heard(bench, bench.sound() + np.column_stack([0 * landing, landing]))


def test_a_gap_begins_anew_and_short_ends_are_judged() -> None:
    bench = Bench()
    values = bench.sound()
    index = np.concatenate([np.arange(1500), np.arange(1507, 4000)])
    assert not faults(index, values[index], 1000.0, Drive(20.0, bench.amplitude))
    values[3890:, 1] = 0  # too late for a whole hop
    found = faults(np.arange(4000), values, 1000.0, Drive(20.0, bench.amplitude))
    assert found and {fault.end for fault in found} == {4000}


def plain() -> Judged:
    """Features of a sound window, exactly as the drive predicts."""
    two = np.ones(2)
    now = Window(0, 0.25, 9 * two * (1 + 0j), 0 * two, 0.1 * two, 0.3 * two, 3 * two, 0 * two, 0 * two, 0 * two, 1.0)
    return Judged(now, now, now, Drive(20.0, 9.0))


def with_(**changes: object) -> Judged:
    of = plain()
    return replace(of, now=replace(of.now, **changes))  # type: ignore[arg-type]


def pair(sensor: int, value: complex, other: complex) -> np.ndarray:
    out = np.array([other, other], complex)
    out[sensor] = value
    return out


def cases() -> list[tuple[str, int, Callable[[float], Judged]]]:
    """Each rule, and what is judged where its feature is at so many times its limit."""
    quiet = Drive()
    both: list[tuple[str, int, Callable[[float], Judged]]] = []
    for i in monitor.SENSORS:
        both += [
            ("flat", i, lambda k, i=i: with_(flat=pair(i, k * monitor.FLAT_S, 0).real)),
            ("hums", i, lambda k, i=i: with_(hum=pair(i, k * monitor.HUM, 0).real, rest=pair(i, 0.2, 0).real)),
            ("spikes", i, lambda k, i=i: with_(crest=pair(i, k * monitor.SPIKE, 3).real, peak=pair(i, 2, 0).real)),
            ("off its mean", i, lambda k, i=i: with_(mean=pair(i, k * monitor.OFFSET, 0).real)),
            ("noisy", i, lambda k, i=i: with_(rest=pair(i, k * (0.2 + 0.27), 0.1).real)),
        ]  # fmt: skip
    one = np.ones(2)
    return [
        *both,
        ("lost", 0, lambda k: with_(line=pair(0, 9 * monitor.LEAST_SHARE / k, 9))),
        ("lost", 0, lambda k: replace(with_(line=pair(0, 9 * monitor.SILENT / k, 9)), drive=quiet)),
        ("not as driven", 0, lambda k: with_(rest=pair(0, k * (9 * monitor.WAVEFORM + 0.15), 0).real)),
        ("off its level", 0, lambda k: with_(line=pair(0, 9 * (1 + k * monitor.LEVEL), 9 * (1 + k * monitor.LEVEL)))),
        ("off its level", 0, lambda k: with_(line=9 * (1 - k * monitor.LEVEL) * (one + 0j))),
        ("breaks", 0, lambda k: replace(plain(), turn=k * monitor.TURN, known=True)),
        ("breaks", 0, lambda k: replace(plain(), drift=-k * monitor.CLOCK * 2 * np.pi * 20 * 0.25, known=True)),
        ("breaks", 0, lambda k: replace(plain(), turn=k * (monitor.TURN + monitor.CLOCK * 2 * np.pi * 20 * 0.25))),
        ("breaks", 0, lambda k: with_(step=k * monitor.STEP)),
        ("breaks", 0, lambda k: replace(with_(step=k * monitor.STEP), before=None)),
        ("equal to the base", 1, lambda k: with_(unlike=monitor.EQUAL / k)),
        ("does not follow", 1, lambda k: with_(rest=pair(1, k * 9 * monitor.FOLLOWS, 0.1).real)),
        ("does not follow", 1, lambda k: replace(with_(line=pair(1, 9 * monitor.SILENT / k, 9)), drive=quiet)),
        ("changed", 1, lambda k: with_(line=pair(1, 9 * (1 - k * monitor.RATIO), 9))),
        ("jumps", 1, lambda k: with_(line=pair(1, 9 * (1 - k * monitor.RATIO_STEP), 9))),
    ]


@pytest.mark.parametrize(("name", "sensor", "at"), cases())
def test_each_threshold_on_either_side(name: str, sensor: int, at: Callable[[float], Judged]) -> None:
    steady = at(1.0).drive.frequency_hz is not None
    named = [r for r in monitor.RULES if (r.name, r.sensor) == (name, sensor) and r.steady in (None, steady)]
    (rule,) = named
    below, above = (at(share).excesses(sensor)[rule.feature] for share in (0.98, 1.02))
    assert below < 1 <= above


def test_every_rule_has_a_case() -> None:
    assert {(r.name, r.sensor) for r in monitor.RULES} == {(name, sensor) for name, sensor, _ in cases()}


def test_both_sensors_on_one_mass_may_be_alike() -> None:
    of = with_(unlike=0.0)
    (rule,) = (r for r in monitor.RULES if r.name == "equal to the base")
    one_mass = replace(of, drive=Drive(20.0, 9.0, one_mass=True))
    assert of.excesses(1)[rule.feature] >= 1 > one_mass.excesses(1)[rule.feature]
