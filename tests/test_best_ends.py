"""Whether a fit finds the best end on each side, counted on made-up ends."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import search
from benchmarks.kept import Kept, digest, fit_sources
from benchmarks.search import Ends
from simulator.worlds import CLEAN, SOURCES


def ends(default: tuple[float, ...], many: tuple[float, ...] = (30.0, 41.0), **changes: object) -> Ends:
    names = ("stiff ankle", "stiff pad")
    pair = (dict(zip(names, values, strict=False)) for values in (default, many))
    return replace(Ends(CLEAN, 0, 200, *pair, "undecided", False, (1.0, 9.0)), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("default", "found"),
    [((30.0, 41.0), True), ((30.5, 41.0), True), ((30.0, 41.51), False), ((29.0, 40.0), True), ((30.0,), False)],
)
def test_ends_within_half_a_chi_square_are_one(default: tuple[float, ...], found: bool) -> None:
    assert ends(default).found is found


def test_a_better_end_is_missed_in_silence_or_not() -> None:
    far = (35.0, 41.0)
    feet = [ends((30.0, 41.0)), ends(far, says=True), ends((), (), verdict="none")]
    rows = {check.what: check for check in search.rows_of(feet)}
    assert rows["a better end is missed in silence, of 2 feet"].met is True
    assert rows["both ends found, of 2 feet"].measured == "1"
    assert rows["no result, of 3 feet"].measured == "1"
    for silent in (ends(far), ends(far, says=True, verdict="decided")):
        checks = {check.what: check for check in search.rows_of([*feet, silent])}
        assert checks["a better end is missed in silence, of 3 feet"].met is False
        assert checks["missed in silence"].measured == "clean 0"


def test_ends_are_objectives_of_each_branch() -> None:
    branches = [SimpleNamespace(name=n, world=w) for n, w in (("a", SimpleNamespace(objective=3.0)), ("b", None))]
    assert search.ends_of(SimpleNamespace(branches=branches)) == {"a": 3.0}  # type: ignore[arg-type]


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    """The one foot that is asked for is in the file already, and is read back."""
    file = tmp_path / "search.jsonl"
    sources = [*SOURCES, Path(search.__file__), *fit_sources()]
    kept = ends((30.0, 41.0), seed=3)
    Kept(file, digest(sources, "200")).add({**vars(kept), "seconds": list(kept.seconds)})
    rows = {check.what: check.measured for check in search.measure(1, 200, 1, file, first=3)}
    assert rows["both ends found, of 1 feet"] == "1" and len(file.read_text().splitlines()) == 1
