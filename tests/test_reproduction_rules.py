"""What single rows of docs/reproduction.md are judged by: the print, and nothing that was assumed or never measured."""

import inspect
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from reproduction.book import ROWS
from reproduction.chapter5_findings import beyond_the_mesh
from reproduction.check import at_most
from reproduction.row import TRANSCRIBED, Outcome, Row, Verdict


def by_id(name: str) -> Row:
    return next(row for row in ROWS if row.id == name)


@pytest.mark.parametrize("name", ["Finding 4.4, 1", "Finding 4.4, 2"])
def test_the_reduction_is_judged_as_table_4_2_is_printed(name: str) -> None:
    """The table has no unit of N/m; what that reading gives is told beside the verdict, not by it."""
    outcome = by_id(name).run()
    assert outcome.verdict == Verdict.REPRODUCED
    assert all("mm" not in check.what for check in outcome.checks)
    assert "Read as N/m, which" in outcome.note


@pytest.mark.parametrize("name", ["Finding 3.3, 4", "Finding 6, 3"])
def test_orders_need_the_rank_of_the_recordings(name: str) -> None:
    outcome = by_id(name).run()
    assert outcome.verdict == Verdict.UNMEASURED and "rank" in outcome.missing
    assert replace(outcome, missing="").verdict == Verdict.REPRODUCED


@pytest.mark.parametrize("name", ["Eq. 2.2", "Eq. 4.17-4.18", "Table 5.2"])
def test_a_comparison_of_typed_numbers_says_so(name: str) -> None:
    assert by_id(name).run().note.startswith(TRANSCRIBED)


def test_what_falls_within_the_error_of_the_mesh_is_no_fall() -> None:
    """Three shapes, one mode: a step of 5 % counts, one of 0.4 % between meshes good to 0.5 % does not."""
    analyses = [SimpleNamespace(errors=np.array([0.005])) for _ in range(3)]
    sweep = SimpleNamespace(frequencies_hz=np.array([[100.0], [105.0], [104.6]]), analyses=analyses)
    assert beyond_the_mesh(sweep).ravel().tolist() == [True, False]  # type: ignore[arg-type]
    analyses[0].errors = None
    assert not beyond_the_mesh(sweep).any()  # type: ignore[arg-type]


def test_the_assumption_on_damping_is_not_contradicted_by_assumed_numbers() -> None:
    """What an invented relaxation time gives, whichever way, is no verdict on the thesis."""
    good, bad = at_most("a", 1.0, 2.0), at_most("a", 3.0, 2.0)
    assert {Outcome([check], missing="relaxation time").verdict for check in (good, bad)} == {Verdict.UNMEASURED}
    assert "missing=" in inspect.getsource(by_id("Finding 5.5, 6").run)
