"""Shared by all tests: the stock foot, edited copies of its MJCF, noisy synthetic recordings, commands."""

import fcntl
import gc
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: more threads wait for each other

import numpy as np
import oracle
import pytest
from hypothesis import HealthCheck, settings

import mjcf
from fasbody.foot.model import Foot, load
from fasbody.recording.recording import Condition, Recording
from fasbody.recording.study import bundled
from identification.fitting import fit_foot
from identification.result import FitResult

ROOT = Path(__file__).parent.parent
gc.disable()  # until the tests are imported

# A shell's background job ignores Ctrl-C, and its children inherit that: not those of the tests, which press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Neither an example nor the making of some is timed: a busy machine is not a failure.
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")

#: Files that compute or wait longest, the longest first: with the short ones behind them all processes end together.
LONGEST = (
    "edits", "acquire_audio", "study_cluster", "rivals", "director", "blackbox_selection", "viz_recordings",
    "nuisances", "transmissibility", "docs_blocks", "acquire_monitor", "viz_motion", "fitting", "cell_body",
    "acquire_session", "constraints", "sensors", "leg_naming", "acquire_generator", "simulate", "viz_page",
    "repeatability", "optimiser", "report", "bundled", "cell_mesh", "intervals", "steady_state", "arch_motion",
    "architecture", "viz_bench_page", "acquire_firmware", "study_report", "viz_command", "viz_workbench", "viz_tasks",
    "viz_session", "study_population", "study_run", "acquire", "simulator", "wheel",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {f"test_{name}.py": number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


def pytest_collection_finish() -> None:
    """What is imported by now stays: the garbage collector need not look at half a million objects again and again."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def foot() -> Foot:
    return load("two_dof")


@pytest.fixture(scope="session")
def fitted(foot: Foot, tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    """The stock foot fitted to three of the bundled recordings, with its mirror image: quick, and rough.

    The first process that needs it computes it for all.
    """
    base = tmp_path_factory.getbasetemp()
    kept = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "fitted.pickle"
    with kept.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            three = [item for item in bundled().under(0.0) if item.condition.frequency_hz in (10, 20, 30)]
            made = fit_foot(three, foot, free=["k_T", "k_F", "c_11", "c_21"], starts=2)
            kept.write_bytes(pickle.dumps(made))
    return pickle.loads(kept.read_bytes())


@pytest.fixture
def edited(tmp_path: Path) -> Callable[..., Path]:
    """Write a copy of two_dof.xml with (old, new) texts replaced, each of which must be there."""

    def edit(*replacements: tuple[str, str]) -> Path:
        text = mjcf.text("two_dof")
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        file = tmp_path / "edited.xml"
        file.write_text(text)
        return file

    return edit


@pytest.fixture(scope="session")
def trial() -> Callable[..., Recording]:
    """Make a steady synthetic recording with the oracle: parameters, frequency, noise; see `oracle.steady`."""
    known: dict[object, tuple[np.ndarray, ...]] = {}

    def make(
        p: dict[str, float], frequency_hz: float, *, seed: int = 0, added: float = 0.0, seconds: float = 3.0,
        noise: tuple[float, float] = (0.03, 0.05), rate_hz: float = 1200.0, **more: object,
    ) -> Recording:  # fmt: skip
        condition = Condition("16", "midstance", added, 72.57, frequency_hz)
        key = (*p.values(), *map(str, more.values()), frequency_hz, rate_hz, seconds, added)
        if key not in known:  # the motion without noise
            known[key] = oracle.steady({**p, **condition.masses}, frequency_hz, rate_hz, seconds, **more)
        t, base, malleolus = known[key]
        rng = np.random.default_rng((seed, round(frequency_hz), round(10 * added)))
        noisy = (x + rng.normal(0, s, t.size) for x, s in zip((base, malleolus), noise, strict=True))
        return Recording(t, *noisy, condition=condition, file=f"{frequency_hz:g}hz.csv", origin="synthetic")

    return make


@pytest.fixture(scope="session")
def command() -> Callable[..., subprocess.CompletedProcess[str]]:
    """`python -m MODULE words...` as a user runs it, a process of its own; `in_process.command` is quicker."""

    def run(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
        return subprocess.run(
            [sys.executable, "-m", *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
        )

    return run


@pytest.fixture
def bench() -> Iterator[Any]:
    """The workbench of the two-mass foot, without the process that fits, which takes seconds to start."""
    from viz.bench import Bench
    from viz.feet import Show

    made = Bench(Show(["two_dof"]))
    made.fits.prepare = lambda: None  # type: ignore[method-assign]
    yield made
    made.close()


@pytest.fixture(scope="module")
def opened() -> Iterator[Any]:
    """Headless Chromium; a module's, as its event loop is in the way of others."""
    from viewer import browser

    with browser() as found:
        yield found


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `in_process.draw_nothing`."""
    from in_process import draw_nothing

    draw_nothing(monkeypatch)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Acquisition in this process waits for long, and does not compare a simulated board's clock with the computer's.

    On a busy machine a second without a sample is no fault of the board, which falls behind and catches up. A test of
    patience sets its own afterwards; those of the clocks are in test_acquire_timeline.py.
    """
    for name in ("board.BLIND_S", "board.STALLED_S", "board.HELLO_S", "session.STALLED_S", "generator._ANSWER_S"):
        monkeypatch.setattr(f"fasbody.acquire.{name}", 60.0)
    monkeypatch.setattr("fasbody.acquire.guard.SILENT_S", 60.0)
    monkeypatch.setattr("fasbody.acquire.timeline._drift", lambda pairs: (0.0, float("inf")))


@pytest.fixture
def feeder(tmp_path: Path, patient: None) -> Iterator[Any]:
    """A `feeder.Feeder`, the board made of a thread."""
    from feeder import Feeder

    with Feeder(tmp_path) as made:
        yield made


@pytest.fixture
def board(feeder: Any) -> Iterator[Any]:
    """A `Board` that has heard the feeder's hello."""
    from fasbody.acquire.board import Board

    made = Board(feeder.port, 921600)
    made.wait_for_hello()
    yield made
    made.close()
