"""Persons who have a study each: the pooled fits of other results, to join a population."""

from pathlib import Path
from typing import Any

from fasbody.exceptions import InputFileError
from identification.study.store import Store


def joining(results: Path) -> list[dict[str, Any]]:
    """The pooled fits of the results of another study, each subject named with their folder.

    Every laboratory has a subject 1, and a folder of one person has no other.

    Raises:
        InputFileError: there is none.
    """
    store = Store(results / "fits")
    keys = [file.stem for file in sorted((results / "fits").glob("*.json"))]
    found = [d for d in store.documents(keys).values() if d["mode"] == "pooled"]
    if not found:
        raise InputFileError(
            results, "holds no pooled fits", "run python -m identification.study STUDY --mode pooled --out there first"
        )
    return [{**d, "subject": f"{d['subject']} of {results.resolve().name}"} for d in found]
