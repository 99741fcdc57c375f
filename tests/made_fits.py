"""Fits of a small synthetic study as plain documents, made with the fit itself: what the study's command stores."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fasbody.console import to_json
from fasbody.foot.model import load
from fasbody.recording.checks import checked
from fasbody.recording.recording import Recording
from identification.fitting import fit_foot
from identification.study.job import cycles


def document(mode: str, recordings: Sequence[Recording], files: Sequence[str], starts: int = 4) -> dict[str, Any]:
    """One fit as `OUT/fits` holds it."""
    foot = load("two_dof")
    result = fit_foot(recordings, foot, starts=starts, threads=1, departures=False).document()
    first = recordings[0].condition
    single = mode == "per-recording"
    made = {
        "key": f"{mode}-{Path(files[0]).stem}", "mode": mode, "subject": first.subject, "posture": first.posture,
        "added_mass_kg": first.added_mass_kg, "frequency_hz": first.frequency_hz if single else None,
        "files": list(files), "origin": "synthetic", "status": "done", "error": None, "seconds": result["seconds"],
        "result": result, "cycles": cycles(result, foot, [checked(r) for r in recordings]),
    }  # fmt: skip
    return json.loads(to_json(made))


def plain(
    mode: str,
    subject: str,
    load: float | None,
    frequency: float | None,
    branches: dict[str, dict[str, tuple[float, float | None, str]]],
    **more: Any,
) -> dict[str, Any]:
    """A fit as a document without fitting: branch -> key -> (value, standard error, verdict), the best branch first.

    Its cycle is an ellipse of area pi x 2 J at the ankle and pi x 6 J at the pad.
    """
    file = f"recordings/s{subject}_{load}_{frequency}.csv"
    made = [
        {
            "name": name,
            "deviance": 10.0 + 2.0 * number,
            "fit_percent": 90.0 - number,
            "parameters": {
                key: {
                    "value": v,
                    "std_error": s,
                    "lower": None,
                    "upper": None,
                    "at_bound": False,
                    "identifiability": word,
                }
                for key, (v, s, word) in parameters.items()
            },
        }
        for number, (name, parameters) in enumerate(branches.items())
    ]
    at = {"file": file, "frequency_hz": frequency, "added_mass_kg": load}
    starts = [{"start": str(i), "cost": 10.0 + 5 * i, "branch": made[i % len(made)]["name"]} for i in range(3)]
    result = {
        "branches": made, "fit_percent": 90.0, "recordings": [{**at, "fit_percent": 90.0}], "verdict": "undecided",
        "domain": "periodic", "starts": starts, "goodness_of_fit": {"chi_square": 10.0, "dof": 10},
    }  # fmt: skip
    t = 2 * np.pi * np.arange(64) / 64
    parts = {
        part: {"displacement_m": list(np.cos(t)), "force_n": list(size * np.sin(t)), "dissipated_j": np.pi * size}
        for part, size in (("ankle", 2.0), ("fat_pad", 6.0))
    }
    H = {"measured": [1.0, -1.0], "model": [1.0, -1.1]}
    cycle = {**at, **parts, "branch": made[0]["name"], "chosen": True, "dissipated_j": np.pi * 8, "transmissibility": H}
    cycle |= {"shaker_work_j": np.pi * 8.01, "imbalance": 0.01 / 8.01}
    document = {
        "key": f"{mode}-{subject}-{load}-{frequency}", "mode": mode, "subject": subject, "posture": "midstance",
        "added_mass_kg": load, "frequency_hz": frequency, "files": [file], "origin": "synthetic", "status": "done",
        "error": None, "seconds": 1.5, "result": result, "cycles": [cycle],
    }  # fmt: skip
    return document | more


def failed(subject: str, error: str) -> dict[str, Any]:
    """A fit that did not come about."""
    bare = plain("per-recording", subject, 0.0, 10.0, {"best": {}})
    return bare | {"status": "failed", "error": error, "result": None, "cycles": []}
