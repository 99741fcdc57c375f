"""Naming a mechanism from recordings: motions that are stepped or solved here, as files and at a prompt."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fasbody.exceptions import RecordingError
from fasbody.leg.__main__ import app
from fasbody.recording.condition import Condition
from fasbody.recording.recording import Recording
from identification.rivals.mechanism_fit import DEPARTURE, Confusion
from identification.rivals.naming import Naming, name, read

RATE_HZ, SECONDS = 1000.0, 1.6
#: Frequency [Hz], load [kg] and amplitude [m/s^2] of each sine; the loads are not those of the thesis.
SINES = [(f, kg, 8.95) for kg in (0.0, 4.0) for f in (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 50.0)]
SINES += [(f, 0.0, 4.5) for f in (15.0, 20.0, 25.0, 30.0)]


def pressed(hz: np.ndarray, added: np.ndarray, table: np.ndarray, m: float = 4.3) -> tuple[np.ndarray, np.ndarray]:
    """Table and mass on a pad that cannot pull, (n, time) [m/s^2], stepped in absolute coordinates (Heun)."""
    h, rest, power = 1 / (8 * RATE_HZ), 32.0 + 9.81 * added, 1.9
    k = 2e5 / (power * 43 ** (1 - 1 / power))
    A = k**power
    w, u, v = 2 * np.pi * hz, np.zeros(hz.size), np.zeros(hz.size)
    depth = (rest / A) ** (1 / power)

    def pulled(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        d = np.maximum(depth - u, 0.0)
        return np.maximum(0.0, A * d**power - 600 / 2e5 * power * A * d ** (power - 1) * v) - rest

    base, moved = [], []
    for step in range(round((2.0 + SECONDS) / h)):
        t = step * h
        a = table * np.sin(w * t)
        one = pulled(u, v) / m - a
        if t >= 2.0 and step % 8 == 0:
            base.append(a)
            moved.append(one + a)
        x, y = u + h * v, v + h * one
        two = pulled(x, y) / m - table * np.sin(w * (t + h))
        u, v = u + h / 2 * (v + y), v + h / 2 * (one + two)
    return np.array(base).T, np.array(moved).T


def chain(hz: np.ndarray, added: np.ndarray, table: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Table, malleolus and tuberosity of five masses in a row, (n, time) [m/s^2], from their matrices."""
    k, c = [1.6e5, 3e5, 1.6e4, 2.8e4, 5e4], [900.0, 100.0, 400.0, 300.0, 300.0]
    below = [-1, 0, 1, 2, 2]
    t = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    out = []
    for f, kg, a in zip(hz, added, table, strict=True):
        s = 2j * np.pi * f
        D, load = np.diag(s**2 * np.array([1.0, 0.66, 2.64, 2.0, 0.2 + kg])).astype(complex), np.zeros(5, complex)
        for i, j in enumerate(below):
            z = k[i] + s * c[i]
            D[i, i] += z
            if j < 0:
                load[i] = z
            else:
                D[j, j] += z
                D[i, j] -= z
                D[j, i] -= z
        T = np.linalg.solve(D, load)
        turn = -1j * a * np.exp(1j * 2 * np.pi * f * t)
        out.append([turn.real, (T[1] * turn).real, (T[2] * turn).real])
    base, malleolus, tuberosity = np.array(out).transpose(1, 0, 2)
    return base, malleolus, tuberosity


def recorded(base: np.ndarray, *sensors: np.ndarray, sines: list[tuple[float, float, float]] = SINES,
             shift_s: float = 0.0137) -> list[Recording]:  # fmt: skip
    """As a laboratory has it: noise of 0.02 m/s^2, the clock started anywhere."""
    rng = np.random.default_rng(1)
    t = np.arange(base.shape[1]) / RATE_HZ
    cut = round(shift_s * RATE_HZ)
    made = []
    for i, (f, kg, a) in enumerate(sines):
        channels = [x[i, cut:] + 0.02 * rng.standard_normal(t.size - cut) for x in (base, *sensors)]
        about = Condition(subject="7", frequency_hz=f, added_mass_kg=kg, body_mass_kg=70.0)
        made.append(Recording(t[cut:] - t[cut], *channels, condition=about, file=f"{f:g}hz_{kg:g}kg_{a:g}.csv"))
    return made


@pytest.fixture(scope="module")
def flying() -> list[Recording]:
    hz, added, table = map(np.array, zip(*SINES, strict=True))
    return recorded(*pressed(hz, added, table))


@pytest.fixture(scope="module")
def linked() -> list[Recording]:
    hz, added, table = map(np.array, zip(*SINES, strict=True))
    return recorded(*chain(hz, added, table))


def named(recordings: list[Recording]) -> Naming:
    (seen,) = read(recordings)
    (result,) = name(seen)
    return result


@pytest.fixture(scope="module")
def second(linked: list[Recording]) -> Naming:
    """What is said of the chain."""
    return named(linked)


@pytest.mark.long
def test_a_foot_that_leaves_the_plate_is_named(flying: list[Recording]) -> None:
    result = named(flying)
    assert result.named == "lift-off"
    assert result.seen.plan.harmonics
    assert not result.seen.plan.tuberosity
    assert result.fits[0].air > 0.5
    assert result.fits[0].values["k"] == pytest.approx(2e5, rel=0.3)
    assert "Subject 7: lift-off. All other mechanisms are excluded" in result.sentence
    assert not result.seen.left_out  # tops flattened on one side are no saturated sensor


def test_the_second_harmonic_does_not_depend_on_when_the_clock_started(flying: list[Recording]) -> None:
    late = [replace(r, **{k: v[3:] for k, v in r.channels.items()}) for r in flying]
    one, other = read(flying)[0].recordings.second, read(late)[0].recordings.second
    assert np.abs(one).max() > 0.2
    np.testing.assert_allclose(one, other, atol=0.01)


def test_a_second_mode_is_named(second: Naming) -> None:
    assert second.named == "second mode"
    assert second.seen.plan.tuberosity
    assert np.abs(second.seen.recordings.second).max() < 0.02
    assert second.sentence.startswith("Subject 7: second mode. All other mechanisms are excluded (1000 to 1)")
    assert re.search(r" except second mode with lift-off, .* special case \(\d+ to 1 against\)\.$", second.sentence)


@pytest.mark.long
def test_without_the_tuberosity_it_is_undecided(linked: list[Recording]) -> None:
    alone = named([replace(r, tuberosity_m_s2=None) for r in linked])
    assert (alone.named, alone.verdict.best) == ("undecided", "second mode")  # not lift-off for having fewer constants
    assert any("tuberosity" in note for note in alone.notes)


@pytest.mark.long
def test_few_sines_are_no_verdict_and_a_doubled_period_is_left_out(linked: list[Recording]) -> None:
    few = named(linked[:5])
    assert few.named == "undecided"
    assert "too few" in few.sentence
    t = linked[3].time_s
    doubled = replace(linked[3], malleolus_m_s2=linked[3].malleolus_m_s2 + 1.0 * np.sin(np.pi * 25.0 * t))
    (seen,) = read([*linked[:3], doubled, *linked[4:]])
    assert (~seen.recordings.repeats).sum() == 1
    assert "25hz_0kg_8.95.csv does not repeat" in seen.notes[0]
    alone = next(name(seen))  # one alone excludes no linear mechanism
    assert alone.named == "second mode"
    shaken = linked[3].base_m_s2 + 0.06 * 8.95 * np.sin(np.pi * 25.0 * t)
    answered = linked[3].malleolus_m_s2 + 0.06 * 8.95 * np.sin(np.pi * 25.0 * t - 0.3)
    linear = replace(linked[3], base_m_s2=shaken, malleolus_m_s2=answered)  # the table's own subharmonic
    assert read([linear])[0].recordings.repeats.all()


@pytest.mark.long
def test_a_pad_that_stiffens_in_contact_is_not_called_lift_off() -> None:
    hz, added, table = map(np.array, zip(*SINES, strict=True))
    base, moved = pressed(hz, added, 0.35 * table)  # a third of the amplitude: pressed all the time, and nonlinear
    quiet = [(f, kg, 0.35 * a) for f, kg, a in SINES]
    result = named(recorded(base, moved, sines=quiet))
    assert result.named == "undecided"
    assert result.fits[0].air == 0
    assert "never leaves the plate" in result.sentence


def test_a_foot_far_nearer_than_assumed_is_said(second: Naming) -> None:
    verdicts = (replace(second.verdict, per_dof=x) for x in (1e-3, 1.0))
    near, usual = (replace(second, verdict=verdict).notes for verdict in verdicts)
    assert [note for note in near if note not in usual] == [
        "Second mode fits much better than these assumptions imply (chi-square 0.001 per number, about 1 expected), "
        "so the odds are too cautious."
    ]
    assert any(f"model error of {100 * DEPARTURE:g} %" in note for note in usual)


@pytest.mark.long
def test_a_repeated_sine_counts_once(linked: list[Recording]) -> None:
    (once,), (twice,) = read(linked), read([*linked, *linked])
    np.testing.assert_allclose(twice.recordings.MB, once.recordings.MB)
    np.testing.assert_allclose(twice.plan.frequency_hz, once.plan.frequency_hz)
    assert twice.plan.frequency_hz.size == len(linked)


def test_what_cannot_serve_is_said(linked: list[Recording]) -> None:
    dead = replace(linked[0], malleolus_m_s2=np.zeros_like(linked[0].time_s))
    (seen,) = read([dead, *linked[1:]])
    assert seen.plan.frequency_hz.size == len(linked) - 1
    assert "10hz_0kg" in seen.left_out[0]
    (lone,) = read([dead])
    with pytest.raises(RecordingError, match="No recording of subject 7 can be used: 10hz_0kg"):
        next(name(lone))


def test_two_people_are_two_answers(linked: list[Recording], flying: list[Recording]) -> None:
    other = [replace(r, condition=replace(r.condition, subject="8")) for r in flying]
    assert [(s.subject, s.plan.tuberosity) for s in read([*linked, *other])] == [("7", True), ("8", False)]


@pytest.mark.long
def test_virtual_subjects_are_shaken_in_the_same_way(linked: list[Recording]) -> None:
    (seen,) = read(linked)
    *_, last = name(seen, subjects=1)
    assert last.tried is not None
    assert last.tried.subjects == 5
    told = f"{last.tried.right} were named correctly, {last.tried.wrong} wrongly, "
    assert told in last.notes[-1] and last.notes[-1].endswith("too few for a rate (more with --subjects).")
    many = Confusion("p", {truth: 20 * list(each) for truth, each in last.tried.verdicts.items()})
    assert "rate" not in replace(last, tried=many).notes[-1]
    assert last.tried.right >= 3
    figure = last.plot()
    marks = [line for ax in figure.axes for line in ax.lines if line.get_marker() in ("o", "s")]
    assert sum(len(line.get_xdata()) for line in marks) == 2 * len(SINES)


@pytest.mark.long
def test_the_command_reads_a_study(tmp_path: Path, linked: list[Recording]) -> None:
    (tmp_path / "recordings").mkdir()
    listed = ["file,subject,posture,added_mass_kg,frequency_hz"]
    for r in linked:
        file = f"recordings/{r.file}"
        channels = np.column_stack([r.time_s, r.base_m_s2, r.malleolus_m_s2, r.tuberosity_m_s2])
        head = "time_s,base_m_s2,malleolus_m_s2,tuberosity_m_s2"
        np.savetxt(tmp_path / file, channels, "%.6g", ",", header=head, comments="")
        listed.append(f"{file},7,midstance,{r.condition.added_mass_kg:g},{r.condition.frequency_hz:g}")
    (tmp_path / "recordings.csv").write_text("\n".join(listed))
    (tmp_path / "subjects.csv").write_text("subject,mass_kg\n7,70\n")
    (tmp_path / "study.toml").write_text('[study]\norigin = "synthetic"\n')
    picture = tmp_path / "mechanism.svg"
    done = CliRunner().invoke(app, ["name", str(tmp_path), "--subjects", "0", "--json", "--figure", str(picture)])
    assert done.exit_code == 0, done.output
    (found,) = json.loads(done.stdout[done.stdout.index("[\n") :])
    assert (found["named"], found["subject"], found["recordings"]) == ("second mode", "7", 20)
    assert picture.stat().st_size > 10_000
