"""How many true values of a synthetic study the fits recover.

A virtual study stores the foot's constants of every recording (`constants.csv`); a study of one foot has them once
(`truth.json`). The reference depends on the mode. A recording has separate constants; a pooled fit is
compared with the mean over its frequencies.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import pandas as pd

from fasbody.exceptions import InputFileError
from fasbody.foot.two_dof import NAMES
from fasbody.laboratory.study import CONSTANTS
from fasbody.recording.csv import read_table

#: Standard errors within which an estimate counts as right.
WITHIN = 2.0
#: What tells one fit's branches apart in the tidy table.
UNIT = ["mode", "key", "added_mass_kg", "frequency_hz"]
#: What recordings of one frequency cannot determine, whatever the fit; printed in every report.
LIMITS = (
    "A recording of one frequency is worth its harmonics: amplitude and phase of the fundamental, and what the bend of "
    "the dampers leaves in the few harmonics below 100 Hz. Two numbers are known well, and eight constants are asked "
    "for. So one frequency knows neither the delay between the channels (it looks like damping) nor, where the "
    "response is nearly linear, which of the two mirror solutions is the foot, as both move the malleolus alike. Noise "
    "decides which one a fit takes; its standard errors belong to the branch, not to the choice. A fit percentage "
    "tells neither."
)


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
        file = study / "truth.json"
        if not file.is_file():
            return None
        try:
            document = json.loads(file.read_text())
            same = {name: float(value) for name, value in document["parameters"].items()}
            same["delay"] = float(document["instrument"]["delay_s"])
        except (ValueError, KeyError, TypeError, AttributeError):
            raise InputFileError(file, "is not the truth of a synthetic study", "make it anew or delete it") from None
        constants = {}
        if (study / CONSTANTS).is_file():
            table = read_table(study / CONSTANTS, ("file", *NAMES))
            constants = {
                str(row["file"]): {name: float(row[name] or "nan") for name in NAMES} for row in table.values()
            }
        return cls(constants, same)

    def of(self, files: Sequence[str]) -> dict[str, float]:
        """Name -> true value of a fit of these recordings; empty where it is not known."""
        rows = [self._row(file) for file in files]
        if not rows or not all(rows):
            return dict(self.same)
        return {**self.same, **{name: float(np.mean([row[name] for row in rows])) for name in NAMES}}

    def _row(self, file: str) -> Mapping[str, float]:
        """By the file as recordings.csv has it; messages put the study's name before it."""
        return self.constants.get(file) or self.constants.get(file.partition("/")[2], {})


def recovery(table: pd.DataFrame) -> pd.DataFrame:
    """How many estimates are within two standard errors of the truth, and how far off, by mode and parameter.

    Args:
        table: the tidy table of `summary.tidy`, with truth.

    Returns:
        One row a mode and parameter, and one of all parameters: `estimates` (with a truth, one a fit), and for each way
        of taking a branch, `chosen` (by the fit), `tracked` (that of the subject's fits together where they decide,
        else by the fit: what is shown) and `either` (the nearer to the truth, which needs the truth):
        WAY, how many are within two standard errors, of WAY_of that have one (the others are at a bound or not
        seen), and WAY_error, the median relative error of all. Of `tracked` also `identified` and `identified_of`
        (those that say so of themselves), and the median relative `std_error`.
    """
    known = table[table["truth"].notna() & table["value"].notna()].copy()
    if known.empty:
        return pd.DataFrame()
    known["right"] = (known["value"] - known["truth"]).abs() <= WITHIN * known["std_error"]
    known["has_error"] = np.isfinite(known["std_error"])
    known["nearer"] = _nearer(known)
    rows = []
    for mode, of_mode in known.groupby("mode", sort=False):
        for parameter in ["all", *dict.fromkeys(of_mode["parameter"])]:
            group = of_mode if parameter == "all" else of_mode[of_mode["parameter"] == parameter]
            rows.append({"mode": mode, "parameter": parameter, **_counts(group)})
    return pd.DataFrame(rows)


def _nearer(known: pd.DataFrame) -> pd.Series:
    """Whether each row is of its fit's branch nearer to the truth, by the logarithms of what is positive."""
    unit = known.groupby(UNIT, dropna=False).ngroup()
    positive = (known["truth"] > 0) & (known["value"] > 0)
    distance = np.log((known["value"] / known["truth"]).where(positive)).abs()
    of_branch = distance.groupby([unit, known["branch"]]).transform("mean").fillna(np.inf)
    return of_branch <= of_branch.groupby(unit).transform("min")


def _counts(group: pd.DataFrame) -> dict[str, float]:
    counts: dict[str, float] = {"estimates": int(group["shown"].sum())}
    for name, column in (("chosen", "chosen"), ("tracked", "shown"), ("either", "nearer")):
        rows = group[group[column]]
        counts |= {name: int(rows["right"].sum()), f"{name}_of": int(rows["has_error"].sum())}
        counts[f"{name}_error"] = float((rows["value"] / rows["truth"].where(rows["truth"] != 0) - 1).abs().median())
    rows = group[group["shown"] & group["has_error"]]
    sure = rows[rows["verdict"] == "identified"]
    counts |= {"identified": int(sure["right"].sum()), "identified_of": len(sure)}
    with np.errstate(divide="ignore", invalid="ignore"):
        counts["std_error"] = float((rows["std_error"] / rows["value"].abs()).median())
    return counts
