"""docs/reproduction.md from the results: counts, then one table a chapter. Same code, same machine: same text."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import ascii_uppercase
from typing import Any

from jinja2 import Environment, FileSystemLoader

from fasbody.laboratory.study import Plan
from reproduction.book import CHAPTERS, OUTSIDE
from reproduction.check import machine
from reproduction.row import GROUPS, Row, Verdict
from reproduction.run import LIBRARIES
from reproduction.virtual import LARGE, OTHER_SEEDS, USUALLY

Results = Mapping[str, Mapping[str, Any]]
#: A command of so many rows stands once on the page, and its letter in the rows.
SHARED_BY = 5


def counts(rows: Sequence[Row], results: Results) -> dict[str, int]:
    """Verdict -> number of rows, in the order of `Verdict`; those that did not occur are left out."""
    found = Counter(str(results[row.id]["verdict"]) for row in rows if row.id in results)
    return {str(verdict): found[str(verdict)] for verdict in Verdict if found[str(verdict)]}


def markdown(results: Results) -> str:
    """The page.

    Args:
        results: row id -> its document, of every row.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), trim_blocks=True, lstrip_blocks=True, autoescape=False
    )
    environment.filters["cell"] = cell
    thesis = [row for rows in CHAPTERS.values() for row in rows]
    often = [command for command, n in Counter(row.command for row in thesis).most_common() if n >= SHARED_BY]
    return environment.get_template("report.md.j2").render(
        chapters=CHAPTERS, outside=OUTSIDE, results=results, machine=machine(*LIBRARIES), total=len(thesis),
        counts=counts(thesis, results), outside_counts=counts(OUTSIDE, results),
        by_chapter={title: counts(rows, results) for title, rows in CHAPTERS.items()},
        letters=dict(zip(often, ascii_uppercase, strict=False)),
        verdicts=[str(verdict) for verdict in Verdict], numbers=numbers,
        seed=Plan().seed, other_seeds=OTHER_SEEDS, large=LARGE, usually=f"{100 * USUALLY:g} %",
    )  # fmt: skip


def numbers(document: Mapping[str, Any]) -> str:
    """What came out and what was asked for, check by check."""
    if document.get("error"):
        return f"failed: {document['error']}"
    shown = [group for group in GROUPS if group != "present" or document["verdict"] != str(Verdict.SYNTHETIC)]
    parts = [f"{GROUPS[group]}{check['text']}" for group in shown for check in document[group]]
    if document["missing"]:
        parts.append(f"not there: {document['missing']}")
    text = "; ".join(parts)
    return f"{text}. {document['note']}" if document["note"] else text


def cell(text: str) -> str:
    """Text that cannot end a table's cell or become markup."""
    return text.replace("|", "\\|").replace("\n", " ").replace("*", "\\*").replace("<", "&lt;").replace("_", "\\_")
