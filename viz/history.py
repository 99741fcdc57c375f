"""The fits of a session in the order in which they were made, and two of them side by side."""

import hashlib
import math
import time
from collections.abc import Iterable, Mapping
from typing import Any

from fasbody.constants import Z95
from fasbody.exceptions import SettingError
from fasbody.presentation import readable
from identification.estimates import Estimate
from viz.job import Answer, Job

Document = dict[str, Any]
#: Constants of a fit in the list: springs first.
_MAIN = 2


class History:
    """Results of fits with their jobs, by numbers that are not used again.

    Args:
        answers: of a session's file, in order.
        count: numbers that were used before.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: an answer is not that of a fit.
    """

    def __init__(self, answers: Iterable[Answer] = (), count: int = 0) -> None:
        self.answers: dict[int, Answer] = {}
        self.count, self.chosen = count, 0
        for job, document in answers:
            self.add(job, {"at": 0.0, **document})

    def add(self, job: Job, document: Mapping[str, Any]) -> Document:
        """Keep a result, and choose it; the document with its number and the time."""
        self.count += 1
        numbered = {"at": time.time(), **document, "type": "fitted", "number": self.count, "script": job.script}
        self.answers[self.count] = job, numbered | {"summary": _summary(self.count, job, numbered)}
        self.chosen = self.count
        return self.answers[self.count][1]

    def answer(self, number: int) -> Answer:
        """A result with its job.

        Raises:
            SettingError: it is no longer kept.
        """
        if number not in self.answers:
            raise SettingError("that fit is no longer kept; reload the page.")
        return self.answers[number]

    def of_model(self, model: str) -> Answer | None:
        """The chosen result if it is of a model, else the last one of that model."""
        numbers = [number for number, (job, _) in self.answers.items() if job.model == model]
        number = self.chosen if self.chosen in numbers else numbers[-1] if numbers else 0
        return self.answers.get(number)

    def document(self) -> Document:
        """The list of fits, as the page has it."""
        return {"type": "history", "fits": [document["summary"] for _, document in self.answers.values()]}

    def comparison(self, numbers: Iterable[int], branch: str = "") -> Document:
        """Two fits in one table: settings, verdict, and constants with the differences between them.

        Only estimates from separate recordings have independent errors, and so a difference with an interval.

        Args:
            numbers: of the two.
            branch: of both, where they have it; otherwise the likelier one.

        Raises:
            SettingError: they are not two fits that are kept.
        """
        pair = [self.answer(number) for number in dict.fromkeys(numbers)]
        if len(pair) != 2:
            raise SettingError("choose two fits to compare.")
        branches = [_branch(document["fit"], branch) for _, document in pair]
        independent = not _contents(pair[0][0]) & _contents(pair[1][0])
        heads = [f"fit {document['number']}, {b['name']}" for (_, document), b in zip(pair, branches, strict=True)]
        rows = [
            [label, *(document["summary"][key] for _, document in pair), ""]
            for label, key in (
                ("model", "model"), ("recordings", "recordings"), ("settings", "settings"), ("fit", "fit"),
                ("verdict", "verdict"), ("constants", "at_hz"),
            )
        ]  # fmt: skip
        tables = [{row["key"]: row for row in b["rows"]} for b in branches]
        for key in dict.fromkeys(key for table in tables for key in table):
            entries = [table.get(key) for table in tables]
            about = entries[0] or entries[1] or {}
            label = f"{about['name']} [{about['unit']}]" if about["unit"] else about["name"]
            rows.append([label, *map(_interval, entries), _difference(entries, independent)])
        fits = [
            {"name": head, "branch": b["name"], "data": document["data"], "curves": document["curves"]}
            for head, b, (_, document) in zip(heads, branches, pair, strict=True)
        ]
        columns = ["quantity", *heads, "difference, 95 %" if independent else "difference"]
        rows = [row for row in rows if any(row[1:])]
        return {"type": "comparison", "columns": columns, "rows": rows, "independent": independent, "fits": fits}


def _summary(number: int, job: Job, document: Mapping[str, Any]) -> Document:
    fit, settings = document["fit"], job.settings
    rows = _branch(fit)["rows"]
    main = sorted(rows, key=lambda row: row["unit"] != "N/m")[:_MAIN]
    percent = fit.get("fit_percent")
    free, bounds = settings.get("free"), settings.get("bounds")
    words = [f"{settings['starts']} starts" if "starts" in settings else "", f"free: {', '.join(free)}" if free else ""]
    words += [f"{name} between {low:g} and {high:g}" for name, (low, high) in dict(bounds or {}).items()]
    words += [f"{name} = {value:g}" for name, value in job.values.items()]
    return {
        "number": number, "at": float(document["at"]), "model": job.model.rpartition("/")[2],
        "recordings": str(len(job.sources)), "files": [source.file for source in job.sources.values()],
        "settings": ", ".join(filter(None, words)), "fit": "" if percent is None else f"{percent:.1f} %",
        "verdict": str(fit.get("verdict", "")), "at_hz": str(fit.get("at", "")),
        "constants": [f"{row['name']} {_interval(row)} {row['unit']}".strip() for row in main],
    }  # fmt: skip


def _branch(fit: Mapping[str, Any], name: str = "") -> Mapping[str, Any]:
    """The branch of a name, or the likelier one; without rows where there is none."""
    branches = fit["branches"]
    first: Mapping[str, Any] = branches[0] if branches else {"name": "no branch", "rows": []}
    return next((branch for branch in branches if branch["name"] == name), first)


def _contents(job: Job) -> set[str]:
    paths = [source.path for source in job.sources.values()]
    return {hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else str(path) for path in paths}


def _interval(row: Mapping[str, Any] | None) -> str:
    return "–" if row is None else str(row.get("interval") or readable(row["value"], 4))


def _difference(entries: list[Mapping[str, Any] | None], independent: bool) -> str:
    """The first constant less the second one, if both are reported.

    Errors of independent estimates add as squares, those below and above separately, since intervals may be lopsided
    (Zou and Donner, Statistics in Medicine 27, 2008, 1693-1702).
    """
    a, b = entries
    if a is None or b is None or "–" in (_interval(a), _interval(b)):
        return "–"
    value = a["value"] - b["value"]
    if not (independent and "lower" in a and "lower" in b):
        return readable(value, 3)
    lower = value - math.hypot(a["value"] - a["lower"], b["upper"] - b["value"])
    upper = value + math.hypot(a["upper"] - a["value"], b["value"] - b["lower"])
    return Estimate(value, (upper - lower) / (2 * Z95), lower, upper, False, "").interval()
