"""The callbacks' machine code: kept without numba, made anew where what is kept is of no use."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from fasbody.foot import engine, native
from fasbody.foot.engine import _ACTUATOR, _PASSIVE, Callbacks, self_test

#: Writes the difference from the Python twin, and whether numba was loaded.
PROGRAM = (
    "import sys; from fasbody.foot.engine import native, self_test; "
    "print(self_test(native()), 'numba' in sys.modules)"
)


def run() -> list[str]:
    """What another process says of its callbacks."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert not done.stderr
    return done.stdout.split()


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Path]:
    """An empty cache, and its one file."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def file() -> Path:
        (one,) = tmp_path.rglob("*.json")
        return one

    return file


def test_only_the_first_process_loads_numba(kept: Callable[[], Path]) -> None:
    first = run()
    text = kept().read_text()
    second = run()
    assert (first[1], second[1]) == ("True", "False") and first[0] == second[0] and float(first[0]) < 1e-12
    kept().write_text(text[:1000])  # cut off
    assert run() == first and kept().read_text() == text


def test_a_cache_that_cannot_be_written_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "fasbody").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run()[1] == "True"


def test_kept_code_that_calls_what_is_no_mathematics_is_not_run(kept: Callable[[], Path]) -> None:
    """Nor is it code that lacks a symbol; both are made anew."""
    at = native.addresses(engine.find_offsets(), engine.mujoco.mjNBIAS)
    right = kept().read_text()
    code = json.loads(right)
    code["passive"]["ir"] += "\ndeclare i32 @system(ptr)\n"
    with pytest.raises(RuntimeError, match="call system"):
        native._loaded(code)
    code = json.loads(right)
    code["passive"]["symbol"] += "_"
    kept().write_text(json.dumps(code))
    with pytest.raises(RuntimeError, match="lack a symbol"):
        native._loaded(code)
    again = native.addresses(engine.find_offsets(), engine.mujoco.mjNBIAS)
    assert again != at and native._loaded(json.loads(kept().read_text()))
    made = Callbacks(_PASSIVE(again["passive"]), _ACTUATOR(again["act_dyn"]), _ACTUATOR(again["act_bias"]), None)
    assert self_test(made) < 1e-12


def test_other_offsets_are_other_code(kept: Callable[[], Path]) -> None:
    offsets = engine.find_offsets()
    assert native._key(offsets, 10) != native._key({**offsets, "time": offsets["time"] + 1}, 10)
    assert native._key(offsets, 10) != native._key(offsets, 12)
