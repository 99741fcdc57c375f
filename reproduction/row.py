"""One row: what the thesis has there, the function that runs it, the numbers that came out and the verdict they give.

No verdict is written down: `Outcome.verdict` follows from comparing numbers with the limits of each check. Where the
thing to be judged is wording or a list, the row compares its own transcription of the print, and its note says so
(`TRANSCRIBED`).
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

from reproduction.check import Check

#: Begins the note of a row that holds two printed things against each other: the numbers are typed in the row.
TRANSCRIBED = "Compares transcriptions of the print."


class Verdict(StrEnum):
    """What a run can say about a place in the thesis."""

    REPRODUCED = "reproduced"
    CORRECTED = "corrected (erratum)"
    SYNTHETIC = "shown on synthetic data"
    UNRELIABLE = "not found reliably on synthetic data"
    UNMEASURED = "cannot be reproduced without the recordings"
    CONTRADICTED = "contradicted"
    CALIBRATED = "calibrated to it"
    FAILED = "failed"


#: Groups of checks of an outcome, as its attributes are called, and how a reader is told which one a check is of.
GROUPS = {
    "printed": "", "calibrated": "calibration: ", "right": "corrected: ", "instead": "instead: ",
    "coherent": "the text with itself: ", "present": "in the data: ",
}  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """The numbers of one row.

    Attributes:
        printed: what must hold if the thesis is right here.
        calibrated: numbers that constants of the model were chosen by; that they come out is no evidence.
        right: what must hold if it is wrong and the correction that stands in docs/errata.md is right; empty if none.
        instead: numbers that came out where the thesis is wrong and no correction mends it; they must hold, too.
        coherent: the statement beside other statements of the thesis. No data may enter: if it fails, two statements
            exclude each other, whatever anybody measures. That it holds alone reproduces nothing.
        present: what must hold for the statement to be true of the synthetic data, by the constants they were made
            from or by a large draw of them; `printed` failing then is a failure of the analysis.
        synthetic: the data were made by a model, so agreement shows the method and is no evidence.
        missing: a measurement that the statement rests on and no check of the row reads, in words; "" if none.
        note: what a reader should know, a sentence at most.
    """

    printed: Sequence[Check] = ()
    calibrated: Sequence[Check] = ()
    right: Sequence[Check] = ()
    instead: Sequence[Check] = ()
    coherent: Sequence[Check] = ()
    present: Sequence[Check] = ()
    synthetic: bool = False
    missing: str = ""
    note: str = ""

    @property
    def checks(self) -> list[Check]:
        """All of them."""
        return [replace(check, source=group) for group in GROUPS for check in getattr(self, group)]

    @property
    def verdict(self) -> Verdict:
        """What the numbers say."""
        if not self.checks or not _hold(self.right, self.instead):
            return Verdict.FAILED
        if not all(math.isfinite(check.value) for check in self.checks):
            return Verdict.FAILED
        if not _hold(self.coherent):
            return Verdict.CONTRADICTED
        if not (self.printed or self.calibrated):
            return Verdict.FAILED  # nothing was asked of the statement itself
        if self.missing:
            return Verdict.UNMEASURED
        if _hold(self.printed, self.calibrated):
            met = Verdict.REPRODUCED if self.printed else Verdict.CALIBRATED
            return Verdict.SYNTHETIC if self.synthetic else met
        if self.right:
            return Verdict.CORRECTED
        if not self.synthetic:
            return Verdict.CONTRADICTED
        return Verdict.UNRELIABLE if self.present and _hold(self.present) else Verdict.UNMEASURED

    def document(self) -> dict[str, Any]:
        """As plain data, with the verdict."""
        plain = asdict(self)
        for group in GROUPS:
            plain[group] = [check.document() for check in self.checks if check.source == group]
        return plain | {"verdict": str(self.verdict)}


def _hold(*groups: Sequence[Check]) -> bool:
    """Whether every check of every group holds."""
    return all(check.met for group in groups for check in group)


@dataclass(frozen=True)
class Row:
    """One place in the thesis.

    Attributes:
        id: such as "Eq. 4.11-4.12", "Table 4.2", "Fig. 4.15-4.17" or "Finding 2.3-1"; several joined by ", ".
        what: what stands there, in own words.
        run: the function that computes it.
        command: what a reader can type; by default this row alone.
        group: rows of one group share what is slow to make and run in one process, one after the other.
    """

    id: str
    what: str
    run: Callable[[], Outcome]
    command: str
    group: str

    @property
    def numbers(self) -> list[str]:
        """Every single item that the id covers: "Eq. 4.11-4.12" gives Eq. 4.11 and Eq. 4.12."""
        if listed := re.fullmatch(r"(Finding \S+), (\d+)-(\d+)", self.id):
            section, first, last = listed.groups()
            return [section, *(f"{section}, {n}" for n in range(int(first), int(last) + 1))]
        parts = (part for part in self.id.split(", ") if re.match(_KINDS, part))  # "Eq. 4.12, mass" is of Eq. 4.12
        return [item for part in parts for item in _expand(part)]

    @property
    def file(self) -> str:
        """Name of the file that keeps the result."""
        return re.sub(r"[^a-z0-9]+", "-", self.id.lower()).strip("-") + ".json"


#: How an item of the thesis, or a comparison with others' measurements, is called.
_KINDS = r"(Eq\.|Table|Fig\.|Finding|Appendix|Validation) "


def _expand(part: str) -> Iterator[str]:
    span = re.fullmatch(r"(Eq\.|Table|Fig\.) (\w+)\.(\d+)-(\w+)\.(\d+)", part)
    if span is None:
        yield part
        return
    kind, chapter, first, other, last = span.groups()
    if chapter != other or int(first) >= int(last):
        raise ValueError(f"{part!r} is no range within one chapter.")
    yield from (f"{kind} {chapter}.{n}" for n in range(int(first), int(last) + 1))


class Rows(list[Row]):
    """The rows of one file; used as a decorator: `@rows("Eq. 2.5", "what stands there")`."""

    def __call__(
        self, id: str, what: str, command: str = "", group: str = ""
    ) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
        """Register the function below as the row `id`."""

        def register(run: Callable[[], Outcome]) -> Callable[[], Outcome]:
            self.add(id, what, run, command, group)
            return run

        return register

    def add(self, id: str, what: str, run: Callable[[], Outcome], command: str = "", group: str = "") -> None:
        """Register `run` as the row `id`, for rows made in a loop."""
        self.append(Row(id, what, run, command or f'python -m reproduction --only "{id}"', group or id))
