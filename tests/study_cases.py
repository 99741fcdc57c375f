"""Fits of a small synthetic study as plain documents, made with the fit itself: what the study's command stores."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fasbody.checks import checked
from fasbody.console import to_json
from fasbody.model import load
from fasbody.recording import Recording, StudyFolder
from identification.estimate import Settings, fit
from identification.study.loops import cycles

#: The virtual study's ankle under load is stiffer than the model's bound of 1e6 N/m.
BOUNDS = {"k_T": (1e4, 1e7)}


def document(mode: str, recordings: Sequence[Recording], files: Sequence[str], starts: int = 4) -> dict[str, Any]:
    """One fit as `OUT/fits` holds it."""
    foot = load("two_dof")
    result = fit(recordings, foot, Settings(starts=starts, threads=1, bounds=BOUNDS)).document()
    first = recordings[0].condition
    single = mode == "per-recording"
    made = {
        "key": f"{mode}-{Path(files[0]).stem}", "mode": mode, "subject": first.subject, "posture": first.posture,
        "added_mass_kg": first.added_mass_kg, "frequency_hz": first.frequency_hz if single else None,
        "files": list(files), "origin": "synthetic", "status": "done", "error": None, "seconds": result["seconds"],
        "result": result, "cycles": cycles(result, foot, [checked(r) for r in recordings]),
    }  # fmt: skip
    return json.loads(to_json(made))


def documents(folder: Path, pooled: bool = True, starts: int = 4) -> list[dict[str, Any]]:
    """Every recording alone, and pooled over frequencies if wanted."""
    study = StudyFolder.open(folder)
    read = [(trial.file, study.read(trial)) for trial in study.trials]
    fits = [document("per-recording", [r], [file], starts) for file, r in read]
    if pooled:
        groups: dict[tuple[str, str, float], list[tuple[str, Recording]]] = {}
        for file, r in read:
            c = r.condition
            groups.setdefault((c.subject, c.posture, c.added_mass_kg), []).append((file, r))
        fits += [document("pooled", [r for _, r in g], [file for file, _ in g], starts) for g in groups.values()]
    return fits
