"""Small studies for the tests of identification.study, and the command on them."""

import contextlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from fasbody.console import command_line
from fasbody.laboratory.study import Plan, make
from identification.study.command import app

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200", "OMP_NUM_THREADS": "1"}


def small(folder: Path, subjects: int = 1, frequencies: tuple[float, ...] = (20.0, 30.0), seconds: float = 1.0) -> Path:
    """A virtual study of two loads."""
    conditions = (("midstance", 0.0), ("midstance", 2.3))
    plan = Plan(subjects=subjects, conditions=conditions, frequencies_hz=frequencies, seconds=seconds)
    return make(folder, plan, processes=1)


def arguments(study: Path, out: Path, *more: str) -> list[str]:
    """Command line of a quick study in one process."""
    return [sys.executable, "-m", "identification.study", str(study), "--out", str(out), "--starts", "2",
            "--no-report", *more]  # fmt: skip


def fitted(study: Path, out: Path, *more: str, expect: int = 0) -> dict[str, Any]:
    """Run the command to its end: the JSON document, and what it said on stderr; in this process, which is quicker."""
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said), pytest.raises(SystemExit) as ended:
        command_line(lambda: app(arguments(study, out, "--json", *more)[3:]))
    assert (ended.value.code or 0) == expect, said.getvalue()
    return {"said": said.getvalue()} | (json.loads(printed.getvalue()) if expect < 2 else {})


def elsewhere(study: Path, out: Path, *more: str, expect: int = 0) -> dict[str, Any]:
    """The same in a process of its own, which may start others."""
    command = arguments(study, out, "--json", *more)
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == expect, done.stderr
    return {"said": done.stderr} | (json.loads(done.stdout) if expect == 0 else {})


def done(printed: dict[str, Any], mode: str = "per-recording") -> int:
    """How many fits of a mode are there, by the command's document."""
    return next(int(row["done"]) for row in printed["modes"] if row["mode"] == mode)


def documents(out: Path) -> dict[str, dict[str, Any]]:
    """The fits by key, without what differs from run to run: times."""
    found = {}
    for file in sorted((out / "fits").glob("*.json")):
        document = json.loads(file.read_text())
        document.pop("seconds")
        (document["result"] or {}).pop("seconds", None)
        found[document["key"]] = document
    return found
