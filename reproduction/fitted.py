"""A virtual study fitted recording by recording, once, for the rows of section 4.6 and Appendix D."""

import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fasbody.foot.model import Foot, load
from fasbody.laboratory.study import Plan, make
from fasbody.recording.condition import ADDED_MASSES_KG
from fasbody.recording.study import StudyFolder
from identification.fitting import Settings
from identification.study.job import cycles, run
from identification.study.means import mean_curve
from identification.study.plan import Model
from identification.study.plan import Plan as Fits
from identification.study.summary import cycle_table, measured, outliers, tidy
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
#: The subject whose traces and loops the thesis draws.
DRAWN = "16"
#: What `cycles` needs to know of a branch whose foot is given.
TRUE = {"name": "true"}


def exact(foot: Foot, constants: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Constants by name as a fit's document has its parameters."""
    return {foot.parameters[name].key: {"value": value} for name, value in constants.items() if name in foot.parameters}


@cache
def documents() -> tuple[list[dict[str, Any]], Truth]:
    """One document a recording, as `python -m identification.study` keeps them, and the truth of the study.

    Besides, "true_cycles": the energies of the foot that the recording was made from.
    """
    foot, made = load("two_dof"), []
    conditions = tuple(("midstance", mass) for mass in ADDED_MASSES_KG)
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(subjects=SUBJECTS, seconds=SECONDS, conditions=conditions)
        study = StudyFolder.open(make(Path(folder) / "study", plan, processes=1))
        truth = Truth.read(Path(folder) / "study")
        assert truth is not None, "a study just made has its truth"
        fits = Fits(study, study.trials, Settings(starts=STARTS, threads=1), Model.of(foot))
        for job in fits.jobs("per-recording"):
            work = fits.work(job)
            own = {"branches": [{**TRUE, "parameters": exact(foot, truth.constants[job.files[0]])}]}
            made.append({**run(work), "true_cycles": cycles(own, foot, work.recordings)})
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
def true_energies() -> pd.DataFrame:
    """Energies of every cycle of the feet that the recordings were made from [J]."""
    return cycle_table([{**document, "cycles": document["true_cycles"]} for document in documents()[0]])


def losses(cycles: pd.DataFrame, load_kg: float) -> pd.DataFrame:
    """The nine cycles of the drawn subject under one load, in the order of the frequencies."""
    mine = cycles[(cycles["subject"] == DRAWN) & (cycles["added_mass_kg"] == load_kg)]
    return mine.sort_values("frequency_hz")


@cache
def fits() -> pd.DataFrame:
    """Mode, subject, posture, load, frequency and fit percentage of every recording of every fit."""
    of_fit, of_recording = ("mode", "subject", "posture"), ("file", "added_mass_kg", "frequency_hz", "fit_percent")
    return pd.DataFrame([
        {k: d[k] for k in of_fit} | {k: r[k] for k in of_recording}
        for d in documents()[0] if d["status"] == "done" for r in d["result"]["recordings"]
    ])  # fmt: skip


#: The branch that a fit names first, and the other. Where the odds are even the first is so by its name alone, and by
#: that name it is the true one of these virtual subjects, whose ankles are stiff: nothing may rest on the first alone.
BRANCHES = {True: "first branch", False: "its mirror image"}


@cache
def on_branch(parameter: str, first: bool) -> pd.DataFrame:
    """Rows of one parameter on the first branch or on the mirror image where there is one, outliers marked there."""
    rows = table()
    rows = rows[rows["parameter"] == parameter]
    other = rows[~rows["chosen"]]
    alone = rows["chosen"] & ~rows["key"].isin(other["key"])
    rows = (rows[rows["chosen"]] if first else pd.concat([other, rows[alone]])).copy()
    rows["outlier"] = False
    for _, group in rows[measured(rows)].groupby(["added_mass_kg", "frequency_hz"]):
        rows.loc[group.index, "outlier"] = outliers(group["value"].to_numpy())
    return rows


def mean_at(parameter: str, load_kg: float, frequencies_hz: np.ndarray, first: bool) -> np.ndarray:
    """Spline-fitted mean over subjects without outliers, as in Figures 4.18 to 4.25; NaN where too few are measured."""
    rows = on_branch(parameter, first)
    curve = mean_curve(rows[rows["added_mass_kg"] == load_kg])
    if curve.mean.size == 0:
        return np.full(frequencies_hz.shape, np.nan)
    return np.interp(frequencies_hz, curve.frequency_hz, curve.mean, left=np.nan, right=np.nan)
