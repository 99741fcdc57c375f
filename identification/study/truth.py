"""How many true values of a synthetic study the fits recover.

A virtual study stores the foot's constants of every recording (`constants.csv`); a study of one
foot has them once (`truth.json`). A recording has separate constants; a pooled fit is compared with
the mean over its frequencies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import pandas as pd

from fasbody.foot.two_dof import NAMES
from fasbody.laboratory.study import CONSTANTS
from fasbody.recording.csv import read_table
from fasbody.recording.study import read_truth

#: Standard errors within which an estimate counts as right.
WITHIN = 2.0
#: Ways of taking a branch: by the fit, as shown, and the nearer one; their columns in the table.
WAYS = {"chosen": "chosen", "tracked": "shown", "either": "nearer"}


@dataclass(frozen=True)
class Truth:
    """The constants a synthetic study was made from.

    Attributes:
        constants: file of a recording -> name -> value.
        same: name -> value where all recordings share it.
    """

    constants: Mapping[str, Mapping[str, float]]
    same: Mapping[str, float]

    @classmethod
    def read(cls, study: Path) -> Self | None:
        """The truth of a study folder, None where there is none.

        Raises:
            InputFileError: it is there and cannot be read.
        """
        same, file = read_truth(study), study / CONSTANTS
        if not same:
            return None
        table = read_table(file, ("file", *NAMES)) if file.is_file() else {}
        rows = {str(row["file"]): [float(row[name] or "nan") for name in NAMES] for row in table.values()}
        return cls({name: dict(zip(NAMES, row, strict=True)) for name, row in rows.items()}, same)

    def of(self, files: Sequence[str]) -> dict[str, float]:
        """Name -> true value of a fit of these recordings; what is not known is not in it."""
        # as recordings.csv has the file; messages put the study's name before it
        rows = [self.constants.get(f) or self.constants.get(f.partition("/")[2], {}) for f in files]
        if not rows or not all(rows):
            return dict(self.same)
        return {**self.same, **{name: float(np.mean([row[name] for row in rows])) for name in NAMES}}


def recovery(table: pd.DataFrame) -> pd.DataFrame:
    """How many estimates of `summary.tidy` are within two standard errors of the truth.

    Returns:
        One row a mode and parameter, and one of all parameters: `estimates` (with a truth, one a
        fit), and for each way of taking a branch, `chosen` (by the fit), `tracked` (what is shown)
        and `either` (the nearer to the truth, which needs the truth): WAY, how many are within two
        standard errors, of WAY_of that have one (the others are at a bound or not seen), and
        WAY_error, the median relative error of all. Of `tracked` also `identified` and
        `identified_of` (those that say so of themselves), and the median relative `std_error`.
    """
    known = table[table["truth"].notna() & table["value"].notna()].copy()
    if known.empty:
        return pd.DataFrame()
    off = known["value"] - known["truth"]
    known["right"] = off.abs() <= WITHIN * known["std_error"]
    known["has_error"] = np.isfinite(known["std_error"])
    known["error"] = (off / known["truth"].where(known["truth"] != 0)).abs()
    known["relative"] = (known["std_error"] / known["value"].where(known["value"] != 0)).abs()
    known["nearer"] = _nearer(known)
    rows = []
    for mode, of_mode in known.groupby("mode", sort=False):
        groups = {"all": of_mode} | dict(list(of_mode.groupby("parameter", sort=False)))
        for parameter, group in groups.items():
            rows.append({"mode": mode, "parameter": parameter, **_counts(group)})
    return pd.DataFrame(rows)


def _nearer(known: pd.DataFrame) -> pd.Series:
    """Whether each row is of its fit's branch nearer to the truth, by logarithms of what is positive."""
    fit = known.groupby(["mode", "key", "added_mass_kg", "frequency_hz"], dropna=False).ngroup()
    positive = (known["truth"] > 0) & (known["value"] > 0)
    distance = np.log((known["value"] / known["truth"]).where(positive)).abs()
    of_branch = distance.groupby([fit, known["branch"]]).transform("mean").fillna(np.inf)
    return of_branch <= of_branch.groupby(fit).transform("min")


def _counts(group: pd.DataFrame) -> dict[str, float]:
    counts: dict[str, float] = {"estimates": int(group["shown"].sum())}
    for name, column in WAYS.items():
        rows = group[group[column]]
        counts |= {name: int(rows["right"].sum()), f"{name}_of": int(rows["has_error"].sum())}
        counts[f"{name}_error"] = float(rows["error"].median())
    rows = group[group["shown"] & group["has_error"]]
    sure = rows[rows["verdict"] == "identified"]
    counts |= {"identified": int(sure["right"].sum()), "identified_of": len(sure)}
    return counts | {"std_error": float(rows["relative"].median())}
