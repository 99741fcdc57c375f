"""A virtual study fitted recording by recording, once, for the rows of section 4.6 and Appendix D."""

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fasbody.model import load
from fasbody.recording import StudyFolder
from fasbody.subjects import ADDED_MASSES_KG
from fasbody.virtual_study import Plan, make
from identification.estimate import Settings, fit
from identification.study.loops import cycles
from identification.study.means import mean_curve
from identification.study.summary import cycle_table, fit_percents, measured, tidy
from identification.study.truth import Truth
from reproduction.virtual import SECONDS

#: As many subjects as section 4.6 has; starts of each fit.
SUBJECTS, STARTS = 18, 4
#: The command that fits a study this way.
STUDY_COMMAND = (
    "python -m fasbody.laboratory S --subjects 18 --seconds 2 && "
    "python -m identification.study S --posture midstance --starts 4"
)
GROUP = "fits of a virtual study"


@cache
def documents() -> tuple[list[dict[str, Any]], Truth | None]:
    """One document a recording, as `python -m identification.study` keeps them, and the truth of the study."""
    foot, made = load("two_dof"), []
    conditions = tuple(("midstance", mass) for mass in ADDED_MASSES_KG)
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(subjects=SUBJECTS, seconds=SECONDS, conditions=conditions)
        study = StudyFolder.open(make(Path(folder) / "study", plan, processes=1))
        truth = Truth.read(Path(folder) / "study")
        for number, trial in enumerate(study.trials):
            recording = study.read(trial)
            result = fit([recording], foot, Settings(starts=STARTS, threads=1)).document()
            condition = recording.condition
            made.append({
                "key": str(number), "mode": "per-recording", "subject": condition.subject,
                "posture": condition.posture, "added_mass_kg": condition.added_mass_kg,
                "frequency_hz": condition.frequency_hz, "files": [trial.file], "origin": study.origin,
                "status": "done", "error": None, "seconds": 0.0, "result": result,
                "cycles": cycles(result, foot, [recording]),
            })  # fmt: skip
    return made, truth


@cache
def table() -> pd.DataFrame:
    """The tidy table of estimates, with outliers marked and truth."""
    made, truth = documents()
    return tidy(made, truth)


@cache
def energies() -> pd.DataFrame:
    """Energies of every cycle and branch [J]."""
    return cycle_table(documents()[0])


@cache
def fits() -> pd.DataFrame:
    """Fit percentage of every recording."""
    return fit_percents(documents()[0])


def chosen(parameter: str, load_kg: float | None = None) -> pd.DataFrame:
    """Rows of one parameter on the branch that fitted best, under one load or all."""
    rows = table()
    rows = rows[rows["chosen"] & (rows["parameter"] == parameter)]
    return rows if load_kg is None else rows[rows["added_mass_kg"] == load_kg]


def told(parameter: str, load_kg: float) -> pd.DataFrame:
    """Those of `chosen` that have a standard error and are no outliers."""
    rows = chosen(parameter, load_kg)
    return rows[measured(rows) & ~rows["outlier"]]


def mean_at(parameter: str, load_kg: float, frequencies_hz: np.ndarray) -> np.ndarray:
    """Spline-fitted mean over subjects without outliers, as in Figures 4.18 to 4.25; NaN where too few tell."""
    curve = mean_curve(chosen(parameter, load_kg))
    if curve.mean.size == 0:
        return np.full(frequencies_hz.shape, np.nan)
    return np.interp(frequencies_hz, curve.frequency_hz, curve.mean, left=np.nan, right=np.nan)
