"""Every edit of `tests/model_edits.py` that is followed, at three amplitudes and three frequencies, and some in pairs.

Small motion is compared with the independent calculation of the table (masses in absolute coordinates, equations of the
arch). Where laws bend there is none: stepping is then compared with harmonic balance, which has no step.

    python -m benchmarks.edits --pairs 30
"""

import importlib
import os
import sys
import tempfile
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from fasbody.console import command_line, progress_bar
from fasbody.exceptions import FasError, ModelError, SimulationError
from reproduction.check import Check, at_most

TESTS = Path(__file__).resolve().parent.parent / "tests"
HZ, PEAKS = (10.0, 20.0, 45.0), (0.02, 1.0, 9.0)
#: Ways in which each edit is read; `edits.READERS` has more, which the tests ask.
READ = ("simulate", "balance", "viewer")
#: In place of an error, where stepping is the only way that follows an edit.
UNCOMPARED = "followed, but there is nothing to compare it with: balance and viewer refuse it"


def table_at(hz: float) -> ModuleType:
    """The table of edits with its truths at another frequency."""
    sys.path.append(str(TESTS)) if str(TESTS) not in sys.path else None
    os.environ["EDITS_HZ"] = str(hz)
    sys.modules.pop("model_edits", None)
    return importlib.import_module("model_edits")


def readings(edits: ModuleType, file: Path, peak: float) -> dict[str, complex | str]:
    """T by every way of `READ`, or the sentence that refuses; a motion that is not smooth has no balance."""
    edits.__dict__["PEAK"] = peak
    responses: dict[str, complex | str] = {}
    for reader in READ:
        try:
            responses[reader] = edits.READERS[reader](file)["T"]
        except (SimulationError, ModelError) as error:
            responses[reader] = str(error)
    return responses


def best(responses: dict[str, complex | str]) -> complex | None:
    """What has no step, or else what has settled."""
    read = (responses[reader] for reader in ("balance", "viewer"))
    return next((T for T in read if not isinstance(T, str)), None)


def rows(progress: Any) -> Iterator[tuple[str, float, float, str, float | str]]:
    """Edit, frequency, amplitude, way and error of each comparison, or the sentence that refuses it."""
    for hz in HZ:
        edits = table_at(hz)
        followed = [edit for edit in edits.EDITS if edit.truth is not None]
        for edit in progress.track(followed, description=f"{hz:g} Hz"):
            with tempfile.TemporaryDirectory() as folder:
                file = edit.write(Path(folder))
                for peak in PEAKS:
                    responses = readings(edits, file, peak)
                    truth = edit.truth.T if peak == PEAKS[0] else best(responses)
                    for reader, T in responses.items():
                        error = T if isinstance(T, str) else UNCOMPARED if truth is None else abs(T / truth - 1)
                        yield f"{edit.model}: {edit.says}", hz, peak, reader, error


def paired(count: int, progress: Any) -> Iterator[tuple[str, float | str]]:
    """Names and error of stepping against balance of two edits at once, or the sentence that refuses both together."""
    edits = table_at(20.0)
    followed = [edit for edit in edits.EDITS if edit.truth is not None and not edit.text]
    pairs = [(a, b) for a, b in combinations(followed, 2) if a.model == b.model]
    for i in progress.track(np.random.default_rng(0).permutation(len(pairs))[:count], description="pairs"):
        one, other = pairs[i]
        text = edits.mjcf.text(one.model)
        for old, new in (*one.changes, *other.changes):
            text = text.replace(old, new)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "copy.xml"
            file.write_text(text)
            name = f"{one.model}: {one.says} + {other.says}"
            try:
                edits.load(file)
            except FasError as error:
                yield name, str(error)
                continue
            responses = readings(edits, file, PEAKS[1])
        stepped, truth = responses["simulate"], best(responses)
        if isinstance(stepped, str):
            yield name, stepped
        else:
            yield name, np.inf if truth is None else abs(stepped / truth - 1)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    pairs: Annotated[int, typer.Option(help="pairs of edits, drawn at random")] = 30, json_: JsonOption = False
) -> None:
    """Edits of the models at three amplitudes and frequencies, and in pairs.

    Examples:
      python -m benchmarks.edits --pairs 5
    """
    with progress_bar() as progress:
        single, combined = list(rows(progress)), list(paired(pairs, progress))
    checks: list[Check] = []
    for peak in PEAKS:
        for reader in READ:
            mine = [row for row in single if row[2] == peak and row[3] == reader]
            errors = [(row[4], row) for row in mine if isinstance(row[4], float)]
            worst, of = max(errors, key=lambda pair: pair[0])
            against = "the independent calculation" if peak == PEAKS[0] else "harmonic balance"
            what = f"{len(errors)} of {len(mine)} readings by {reader} at {peak:g} m/s^2 against {against}"
            what += f", others refused; worst: {of[0]}, {of[1]:g} Hz"
            checks.append(at_most(what, worst, 1e-3))
    followed = [error for _, error in combined if isinstance(error, float)]
    refused = [f"{name}: {error}" for name, error in combined if isinstance(error, str)]
    refused += [
        f"{edit}, {hz:g} Hz, {peak:g} m/s^2, {reader}: {error}"
        for edit, hz, peak, reader, error in single
        if isinstance(error, str)
    ]
    worst_pair = max(combined, key=lambda row: row[1] if isinstance(row[1], float) else 0.0)
    checks.append(at_most(f"{len(followed)} pairs by simulate, worst: {worst_pair[0]}", max(followed), 1e-3))
    report("edits", checks, json_)
    for sentence in refused:
        print(f"refused: {sentence}", file=sys.stderr)


if __name__ == "__main__":
    command_line(app)
