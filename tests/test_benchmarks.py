"""The benchmarks' own arithmetic on tiny sizes; what they measure is not asserted here."""

import importlib
import platform
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from benchmarks import __main__ as bench
from benchmarks import (
    accuracy,
    black_box,
    callbacks,
    coverage,
    fitting,
    peak_to_peak,
    plain_scipy,
    study,
    study_end_to_end,
)  # fmt: skip
from benchmarks.__main__ import TOPICS
from benchmarks.table import Topic, cells, faster, interleaved, judged_if_idle, markdown, read, refreshed
from fasbody.console import to_json
from fasbody.exceptions import SettingError
from fasbody.foot.model import can_be_constrained, load
from fasbody.foot.shaker import sine
from fasbody.foot.simulate import simulate
from fasbody.foot.two_dof import TwoDof
from fasbody.runner import machine
from identification.domains import TimeDomain
from identification.space import space_of
from identification.time_domain import TimeProblem
from reproduction.check import at_least, at_most, told, within


@pytest.mark.parametrize("name", sorted({*TOPICS, "__main__"}))
def test_each_topic_has_a_command(name: str) -> None:
    module = importlib.import_module(f"benchmarks.{name}")
    assert module.app.registered_commands


def test_checks_say_how_much_better_than_required() -> None:
    assert at_most("x", 2.0, 10.0).margin == 5.0
    assert at_most("x", 11.0, 10.0).met is False
    assert at_least("x", 10.0, 2.0).margin == 5.0
    assert at_least("x", 1.9, 2.0).met is False
    assert within("x", 95.0, 92.0, 98.0).met is True
    assert within("x", 99.0, 92.0, 98.0).met is False
    check = faster("x", 2e-3, 1.0, "other", 300.0)
    assert (check.ratio, check.met) == (500.0, True)
    assert cells(check) == ("x", "2 ms", "other: 1 s, at least 300 times", "500", "", "yes")
    assert faster("x", 2e-3, 0.1, "other", 300.0).met is False
    assert cells(faster("x", 2e-3, 0.1, "other")) == ("x", "2 ms", "other: 100 ms", "50", "", "")
    assert cells(within("x", 95.0, 92.0, 98.0, "%")) == ("x", "95 %", "92 to 98 %", "", "", "yes")
    assert cells(told("x", "9 kB")) == ("x", "9 kB", "", "", "", "")
    assert str(told("x", "9 kB")) == "x: 9 kB"
    assert at_most("x", 0.0, 1.0).margin is None


def test_interleaved_takes_turns_after_one_warm_up() -> None:
    order: list[str] = []
    clock = iter(range(100))
    times = interleaved([lambda: order.append("a"), lambda: order.append("b")], 3, lambda: float(next(clock)))
    assert order == ["a", "b"] * 4
    np.testing.assert_array_equal(times, np.ones((3, 2)))


def test_results_name_machine_and_every_row() -> None:
    claim = cells(at_most("first claim", 1.0, 2.0, "ms"))
    text = markdown({"accuracy": Topic("accuracy", "2026-01-01", 0.5, [claim])}, machine(*bench.LIBRARIES))
    assert "| accuracy | first claim | 1 ms | at most 2 ms |  | 2 | yes |" in text
    assert "mujoco 4.0" in text and "accuracy 2026-01-01 (load 0.5)" in text


CELL = Topic("cell", "2026-01-01", 0.5, [["a", "1 s", *[""] * 4], ["b", "2 s", "c", "3", "", "yes"]])
ARCH = Topic("arch", "2026-01-02", 7.0, [["d", "4 s", "e", "", "0.5", "NO"]])


def test_results_are_read_back_on_the_same_machine_only() -> None:
    topics = {"cell": CELL, "arch": ARCH}
    text = markdown(topics, "here")
    assert read(text, "here") == read(text) == topics
    assert read(text, "elsewhere") == {}


@pytest.fixture
def bench_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """The command on a machine called `where`, with the committed page and the reader's own in a folder of the test."""
    (tmp_path / "RESULTS.md").write_text(markdown({"arch": ARCH, "cell": CELL}, "the author's machine"))
    (tmp_path / "speed.md").write_text(
        "| what | measured | required | met |\n|---|---|---|---|\n| cell anew | 9 | at most 2 | NO |\n"
    )
    monkeypatch.setattr(bench, "RESULTS", tmp_path / "RESULTS.md")
    monkeypatch.setattr(bench, "SPEED", tmp_path / "speed.md")
    monkeypatch.setattr(bench, "PAGES", tmp_path)
    monkeypatch.setattr(platform, "node", lambda: "my laptop")
    monkeypatch.setattr(
        bench, "measure", lambda name, *_: [at_most(f"{name} anew", 1.0, 2.0)] if name != "viewer" else []
    )

    def run(where: str, *words: str) -> Result:
        monkeypatch.setattr(bench, "machine", lambda *_: where)
        return CliRunner().invoke(bench.app, words)

    return run


def test_a_reader_writes_a_page_of_his_own(bench_here: Callable[..., Result], tmp_path: Path) -> None:
    """What is committed keeps every topic, whatever machine another reader has; his own page grows by topics."""
    before = (tmp_path / "RESULTS.md").read_text()
    for topic in ("cell", "accuracy"):
        assert bench_here("a laptop", topic).exit_code == 0
    assert (tmp_path / "RESULTS.md").read_text() == before
    assert list(read((tmp_path / "my-laptop.md").read_text(), "a laptop")) == ["accuracy", "cell"]


def test_the_committed_page_is_replaced_when_asked_and_loses_no_topic(
    bench_here: Callable[..., Result], tmp_path: Path
) -> None:
    page = tmp_path / "RESULTS.md"
    before = page.read_text()
    lost = bench_here("a laptop", "cell", "--commit")
    assert isinstance(lost.exception, SettingError) and "would lose arch; measure" in str(lost.exception)
    assert page.read_text() == before and not (tmp_path / "my-laptop.md").exists()
    bench_here("the author's machine", "cell", "viewer", "--commit")
    kept = read(page.read_text(), "the author's machine")
    assert kept["arch"] == ARCH and kept["cell"].rows[0][0] == "cell anew" and list(kept) == ["arch", "cell"]
    assert (tmp_path / "speed.md").read_text().endswith("\n| cell anew | 1 | at most 2 | yes |\n")
    bench_here("a laptop", "arch")
    assert bench_here("a laptop", "cell", "--commit").exit_code == 0  # arch is on the laptop's page already
    assert list(read(page.read_text(), "a laptop")) == ["arch", "cell"]


def test_page_of_speed_has_the_numbers_of_the_results() -> None:
    page, results = ((bench.ROOT / name).read_text() for name in ("docs/speed.md", "benchmarks/RESULTS.md"))
    assert refreshed(page, results) == page


def test_observed_order_of_a_fourth_order_error() -> None:
    step = np.array([1e-3, 5e-4, 2.5e-4])
    np.testing.assert_allclose(accuracy.order(step, 7 * step**4), [4.0, 4.0])


def test_errors_shrink_with_the_step() -> None:
    found = accuracy.errors(load("two_dof").with_values(accuracy.SETS["stiff"]), 30.0, (1e-3, 5e-4), seconds=0.1)
    assert found.recorded[1] < found.recorded[0] / 8
    assert found.smooth[1] < found.smooth[0] / 8
    assert (found.at_samples <= found.between).all()


def test_step_costs_are_times_of_all_three() -> None:
    times = callbacks.step_costs(repeats=1, steps=5)
    assert times.shape == (1, 3) and (times > 0).all()


def test_sine_fit_rows_hold_mean_and_scatter_of_what_was_fitted() -> None:
    made = peak_to_peak.measure(seeds=4)
    e = peak_to_peak.errors(10.0, 0.02, 0.2, 4)
    assert [row.met for row in made[:4]] == [True] * 4
    assert float(made[1].measured.split()[0]) >= round(e[:, 0].std(ddof=1), 4) - 1e-4
    assert made[-1].measured.startswith("+3.") and "4 recordings" in made[0].what


def test_memory_and_time_of_a_command_are_its_own(tmp_path: Path) -> None:
    (tmp_path / "hungry.py").write_text("x = bytearray(200_000_000)\nx[::4096] = bytes(len(x[::4096]))\n")
    (tmp_path / "modest.py").write_text("")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        large, small = (study_end_to_end.measured(name)[2] for name in ("hungry", "modest"))
        with pytest.raises(RuntimeError, match="nowhere ended with 1"):
            study_end_to_end.measured("nowhere")
    assert large > 190 and small < 100  # though the larger one ran first


def test_a_subset_of_a_study_is_spread_over_it() -> None:
    assert study.spread(range(540), 5) == [0, 135, 270, 404, 539]
    assert study.spread(range(3), 81) == [0, 1, 2]


def test_busy_cores_give_no_verdict_on_threads() -> None:
    idle = at_least("gain", 1.0, 1.7)
    assert judged_if_idle(idle, 0.0) is idle
    row = judged_if_idle(idle, 1000.0)
    assert row.met is None and "load 1000.0" in row.what and row.measured == "1"


def test_black_box_topics_give_rows() -> None:
    """Tiny sizes: every topic runs, and what it says of the grid agrees with one least-squares solution each."""
    made = list(black_box.grid(2))
    assert made[1].met is True and made[0].ratio is not None
    timed = black_box.timed("oe", black_box.record(black_box.foot.prbs(black_box.SAMPLES), 0))
    assert 0 < timed[1] < timed[0] < 1.0


def test_topic_is_run_by_its_own_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """One topic in a process of its own gives its rows back."""
    row = at_most("claim", 1.0, 2.0, "ms")
    printed = to_json({"title": "t", "rows": [row.document()]})
    seen = {}

    def fake(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        seen["command"] = command
        return subprocess.CompletedProcess(command, 0, printed)

    monkeypatch.setattr(subprocess, "run", fake)
    assert bench.measure("accuracy") == [replace(row, source="accuracy")]
    assert seen["command"][1:] == ["-m", "benchmarks.accuracy", "--json"]


@pytest.fixture(scope="module")
def short() -> TimeProblem:
    foot = load("two_dof")
    return TimeDomain(foot, [fitting.sweep_recording(1.0)], space_of(foot, delay=False), twin=True).problem()


def test_scipy_solves_the_same_problem(short: TimeProblem) -> None:
    """RK45 at rtol 1e-6 and the twin give the same misfit, far from the minimum, with each initial state in use."""
    z = short.start(short.space.to_q(short.space.theta(load("two_dof").values())))
    z[-4:] = 0.3, -0.2, 0.1, 0.4
    ours = float(np.sum(short.residual(z) ** 2))
    assert np.sum(plain_scipy.residual(short, z) ** 2) == pytest.approx(ours, rel=1e-3)


def test_plain_rates_are_those_of_the_model(short: TimeProblem) -> None:
    recording = short.recordings[0]
    foot = TwoDof.from_values(load("two_dof").values())
    t = recording.time_s - recording.time_s[0]
    x = np.array([4e-4, -7e-4, 0.05, -0.08])
    plain = plain_scipy.plain_rates(foot, t, recording.base_m_s2)(float(t[200]), x)
    np.testing.assert_allclose(plain, foot.rates(0.0, x, float(recording.base_m_s2[200])), rtol=1e-9)


def test_one_noise_seed_of_the_coverage_study() -> None:
    truth = coverage.FEET[coverage.STRONG]
    clean = coverage.motions(truth, (10.0, 20.0, 30.0), seconds=1.0)
    found = coverage.trial(truth, clean, seed=0)
    assert 2 * (6 + 5 + 3) - 9 <= found.dof <= 2 * (6 + 5 + 3) - 7  # the priors of bends use up less than a number each
    assert found.chi_square < 5 * found.dof
    assert set(found.covered) == set(coverage.COUNTED)


def test_coverage_rows_count_trials() -> None:
    good = coverage.Trial(dict.fromkeys(coverage.COUNTED, True), 50.0, 53, True, True)
    bad = replace(good, covered=dict.fromkeys(coverage.COUNTED, False), true_is_best=False)
    undecided = replace(good, decided=False)
    trials = {coverage.STRONG: [good] * 3 + [bad], coverage.WEAK: [undecided, good], coverage.BETWEEN: []}
    made = coverage.rows_of(trials)
    by_name = {row.what.split(" (")[0]: row for row in made}
    assert by_name["95 % interval of k_T holds the truth, 4 seeds"].measured == "75 %"
    assert by_name["95 % interval of k_T holds the truth, 4 seeds"].met is None  # too few to require anything
    assert by_name["strongly nonlinear"].measured == "3" and by_name["strongly nonlinear"].met is False
    assert by_name["nearly linear"].measured == "1" and by_name["nearly linear"].met is False


def test_skipping_the_constraint_stage_changes_no_bit() -> None:
    foot = load("two_dof")
    assert not can_be_constrained(foot.model)
    motion = sine(30.0, 0.1)
    fast = simulate(foot, motion)
    foot.model.opt.disableflags = 0
    slow = simulate(foot, motion)
    np.testing.assert_array_equal(fast.malleolus, slow.malleolus)


@pytest.mark.parametrize("change", ["limit", "contact", "equality"])
def test_a_model_that_can_be_constrained_keeps_the_stage(change: str, tmp_path) -> None:  # type: ignore[no-untyped-def]
    import mjcf

    text = mjcf.path("two_dof").read_text()
    edits = {
        "limit": ('<joint name="fat_pad"', '<joint name="fat_pad" range="-0.01 0.01"'),
        "contact": ('<geom name="table"', '<geom name="table" contype="1" conaffinity="1"'),
        "equality": ("<actuator>", '<equality><joint joint1="talocrural" active="false"/></equality><actuator>'),
    }
    old, new = edits[change]
    assert old in text
    file = tmp_path / "foot.xml"
    file.write_text(text.replace(old, new, 1))
    foot = load(file)
    assert can_be_constrained(foot.model) and not foot.model.opt.disableflags
