"""Persons who have a study each: the pooled fits of other results, to join a population."""

from pathlib import Path
from typing import Any

from fasbody.exceptions import InputFileError
from identification.study.store import AGAIN, Store


def joining(results: Path) -> list[dict[str, Any]]:
    """The pooled fits of the results of another study, each subject named with their folder.

    Every laboratory has a subject 1, and a folder of one person has no other.

    Raises:
        InputFileError: there is none, one was altered, or one person has two under the same load.
    """
    folder = results / "fits"
    if not folder.is_dir():
        raise InputFileError(results, "is no folder of results", "name the --out of another study")
    store, fits = Store(folder), {}
    for file in sorted(folder.glob("*.json")):
        document, problem = store.read(file.stem)
        if document is None:
            raise InputFileError(file, problem.removeprefix(f"{file}: ").removesuffix(AGAIN), "run its study again")
        if document["mode"] != "pooled":
            continue
        who = document["subject"], document["posture"], document["added_mass_kg"]
        if who in fits:
            raise InputFileError(
                results,
                f"holds two fits of subject {who[0]}, {who[1]}, {who[2]:g} kg, of other settings or recordings",
                "run its study with one --out for each",
            )
        fits[who] = document
    if not fits:
        raise InputFileError(
            results, "holds no pooled fits", "run python -m identification.study STUDY --mode pooled --out there first"
        )
    return [{**d, "subject": f"{d['subject']} of {results.resolve().name}"} for d in fits.values()]
