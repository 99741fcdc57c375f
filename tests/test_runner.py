"""Work spread and kept: what Python loads for a result is in its key, and a damaged file is told and made again."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fasbody import runner
from fasbody.exceptions import InputFileError
from fasbody.runner import ROOT, Store, key, program, sources


def test_all_that_python_loads_for_a_result_is_in_its_key() -> None:
    """Beside what a package's own page says, and what prints, spreads and keeps; test_study_plan.py has the fits."""
    module = "fasbody.cell.mesher"
    code = f"import sys, {module}\nprint(*(getattr(m, '__file__', '') for m in sys.modules.values()))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    ours = {Path(file) for file in loaded if Path(file).is_relative_to(ROOT) and "site-packages" not in file}
    missed = {file.name for file in ours - set(sources(module))}
    assert len(ours) > 4 and missed <= {"__init__.py", "console.py", "presentation.py", "runner.py"}


def test_what_is_imported_for_types_or_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A chosen plug-in computes, so it counts; a name for the type checker does not."""
    files = {
        "fasbody/a.py": "from fasbody import b\nif TYPE_CHECKING:\n    import fasbody.c",
        "fasbody/b.py": "def f():\n    from fasbody.plug import chosen", "fasbody/c.py": "",
        "fasbody/plug/chosen.py": "importlib.import_module(name)", "fasbody/plug/other.py": "import numpy",
    }  # fmt: skip
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    names = [file.relative_to(tmp_path / "fasbody").as_posix() for file in sources("fasbody.a")]
    assert names == ["a.py", "b.py", "plug/chosen.py", "plug/other.py"]
    before = program("fasbody.a")
    (tmp_path / "fasbody/plug/other.py").write_text("import scipy")
    program.cache_clear()
    assert program("fasbody.a") != before


def test_keys_differ_with_every_part() -> None:
    assert key("a", 1) == key("a", 1)
    assert len({key("a", 1), key("a", 2), key("a1"), key("a", "1", ""), key("a"), key("", "a")}) == 6
    assert key(b"a") == key("a")


def test_a_store_keeps_whole_files_and_tells_of_damaged_ones(tmp_path: Path) -> None:
    store = Store(tmp_path / "kept")
    assert store.load("x", int) == (None, "")
    store.save("x", "12")
    assert store.load("x", int) == (12, "")
    (tmp_path / "kept" / "x").write_text("1?")
    found, problem = store.load("x", int)
    assert found is None and problem.endswith("x: is broken and is computed again.")
    with pytest.raises(InputFileError, match="is a file"):
        Store(tmp_path / "kept" / "x").make()


def test_what_a_killed_run_left_is_cleared_away(tmp_path: Path) -> None:
    old, new, whole = (tmp_path / name for name in (".a.json.abcdefgh", ".b.json.ijklmnop", "c.json"))
    for file in (old, new, whole, mine := tmp_path / ".mine.toml"):
        file.write_text("")
    for file in (old, whole, mine):
        os.utime(file, (0, time.time() - 7200))
    Store(tmp_path).make()
    assert sorted(tmp_path.iterdir()) == [new, mine, whole]


_WORK = """
import os
from fasbody.exceptions import FasError, InputFileError
from fasbody.runner import run

def square(x):
    if x < 0:
        raise InputFileError(f"{x}.csv", "no square")
    return x * x

def die(x):
    os._exit(1)

if __name__ == "__main__":
    for processes in (1, 2):
        print(sorted(run(square, [3, 4], "squares", processes)))
        for function, task in ((square, -4), *([(die, 1)] if processes == 2 else [])):
            try:
                list(run(function, [task], "refused", processes))
            except FasError as error:
                print(type(error).__name__, error)
"""


def test_results_come_with_their_place_from_here_or_from_processes(tmp_path: Path) -> None:
    """In a process of its own, for one of its children ends without a word."""
    (tmp_path / "work.py").write_text(_WORK)
    environment = {**os.environ, "PYTHONPATH": str(Path(runner.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "work.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    once = ["[(0, 9), (1, 16)]", "InputFileError -4.csv: no square."]
    assert done.stdout.splitlines() == [
        *once, *once, "FasError a worker process was ended by the system; memory may be short.",
    ]  # fmt: skip
