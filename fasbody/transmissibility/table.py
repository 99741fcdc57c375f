"""The tidy table of a study, and what is made of it: curves by subject, resonance ranges, tests, files."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fasbody import statistics
from fasbody.exceptions import FasError, RecordingError
from fasbody.parallel import run
from fasbody.recording import Recording, StudyFolder, Trial
from fasbody.statistics import Resonance
from fasbody.transmissibility.estimate import PAIRS, Row, rows, unwrapped

Condition = tuple[str, float]  # posture, added mass [kg]


@dataclass(frozen=True, eq=False)
class Curves:
    """One pair under one condition.

    Attributes:
        pair: "MB", "TB" or "TM". posture. added_mass_kg. subjects: names. frequency_hz: (f,) ascending.
        T, phase_deg: (subjects, f), NaN where nothing was measured; phase unwrapped, negative where the output lags.
    """

    pair: str
    posture: str
    added_mass_kg: float
    subjects: tuple[str, ...]
    frequency_hz: np.ndarray
    T: np.ndarray
    phase_deg: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """(f,) mean transmissibility over subjects."""
        return np.nanmean(self.T, axis=0)

    @property
    def mean_phase_deg(self) -> np.ndarray:
        """(f,) mean phase."""
        return np.nanmean(self.phase_deg, axis=0)

    @cached_property
    def resonance(self) -> Resonance:
        """By the rule of section 2.3.1; "none" with fewer than three subjects or frequencies."""
        try:
            return statistics.resonance(self.frequency_hz, self.T)
        except RecordingError:
            return Resonance("none")

    @property
    def title(self) -> str:
        """Pair, posture and added mass [kg]."""
        return f"{self.pair}, {self.posture}, {self.added_mass_kg:g} kg"


@dataclass(frozen=True, eq=False)
class Table:
    """All rows of a study, as a data frame with the columns of `Row`; problems: sentences on unusable recordings."""

    frame: pd.DataFrame
    origin: str
    problems: tuple[str, ...] = ()

    @classmethod
    def of(cls, study: StudyFolder, resolution_hz: float = 1.0, processes: int = 0) -> "Table":
        """Analyse a study, one recording in memory a process."""
        light = StudyFolder(study.name, study.origin, "", (), study.layout)  # what a process needs besides its trial
        jobs = [(light, trial, resolution_hz) for trial in study.trials]
        found: dict[int, list[Row] | str] = dict(run(_analyse, jobs, "transmissibility", processes))
        ordered = [found[i] for i in range(len(jobs))]
        lines = [row.document() for part in ordered if not isinstance(part, str) for row in part]
        problems = tuple(part for part in ordered if isinstance(part, str))
        if not lines:
            raise RecordingError(problems[0])
        return cls(pd.DataFrame(lines), study.origin, problems)

    @classmethod
    def of_recordings(cls, recordings: Sequence[Recording], resolution_hz: float = 1.0) -> "Table":
        """Analyse recordings in memory."""
        lines = [row.document() for recording in recordings for row in rows(recording, resolution_hz)]
        return cls(pd.DataFrame(lines), recordings[0].origin)

    def __str__(self) -> str:
        subjects, files = self.frame["subject"].nunique(), self.frame["file"].nunique()
        return f"{files} {self.origin} recordings of {subjects} subjects, {len(self.frame)} rows"

    @property
    def pairs(self) -> list[str]:
        """The pairs that were measured, in the order of the thesis."""
        return [pair for pair in PAIRS if (self.frame["pair"] == pair).any()]

    @property
    def conditions(self) -> list[Condition]:
        """Postures and loads, those in midstance first, by load."""
        seen = self.frame[["posture", "added_mass_kg"]].drop_duplicates().itertuples(index=False)
        return sorted(((str(p), float(m)) for p, m in seen), key=lambda c: (_order(c[0]), c[1]))

    def curves(self, pair: str, posture: str, added_mass_kg: float) -> Curves:
        """Curves of one pair and condition; repeated recordings of a subject are averaged."""
        f = self.frame
        part = f[(f["pair"] == pair) & (f["posture"] == posture) & (f["added_mass_kg"] == added_mass_kg)]
        part = part.assign(z=part["transmissibility"] * np.exp(1j * np.radians(part["phase_deg"])))
        part = part.assign(re=part["z"].to_numpy().real, im=part["z"].to_numpy().imag)
        T = part.pivot_table(index="subject", columns="frequency_hz", values="transmissibility", sort=True)
        z = part.pivot_table(index="subject", columns="frequency_hz", values=["re", "im"], sort=True)
        phase = np.degrees(np.angle(z["re"].to_numpy() + 1j * z["im"].to_numpy()))
        return Curves(
            pair, posture, added_mass_kg, tuple(map(str, T.index)), T.columns.to_numpy(float), T.to_numpy(float),
            np.array([unwrapped(row) for row in phase]).reshape(T.shape),
        )  # fmt: skip

    def each(self) -> Iterator[Curves]:
        """Curves of every pair and condition."""
        for pair in self.pairs:
            for posture, mass in self.conditions:
                yield self.curves(pair, posture, mass)

    def levels(self, pair: str, conditions: Sequence[Condition], frequency_hz: float) -> np.ndarray:
        """(subjects, conditions) transmissibility at one frequency, NaN where nothing was measured."""
        f = self.frame
        part = f[(f["pair"] == pair) & (f["frequency_hz"] == frequency_hz)]
        wide = part.pivot_table(index="subject", columns=["posture", "added_mass_kg"], values="transmissibility")
        return wide.reindex(columns=pd.MultiIndex.from_tuples(conditions)).to_numpy(float)

    def csv(self) -> str:
        """The rows as CSV text."""
        return self.frame.to_csv(index=False, float_format="%.6g")

    def netcdf(self) -> bytes:
        """The curves as one NetCDF file: (subject, posture, added_mass_kg, pair, frequency_hz)."""
        import xarray

        keys = ["subject", "posture", "added_mass_kg", "pair", "frequency_hz"]
        values = [c for c in self.frame.columns if c not in (*keys, "file")]
        data: Any = xarray.Dataset.from_dataframe(self.frame.groupby(keys)[values].mean())
        data.attrs |= {"origin": self.origin, "source": "fasbody.transmissibility"}
        for name in values:
            data[name].attrs["units"] = "degree" if "deg" in name else "1"
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "table.nc"
            data.to_netcdf(file, engine="h5netcdf")
            return file.read_bytes()


def _order(posture: str) -> tuple[int, str]:
    known = ("midstance", "plantarflexion", "dorsiflexion")
    return (known.index(posture) if posture in known else len(known), posture)


def _analyse(task: tuple[StudyFolder, Trial, float]) -> list[Row] | str:
    """Rows of one trial, or the sentence on why there are none."""
    study, trial, resolution = task
    try:
        return [replace(row, file=trial.file) for row in rows(study.read(trial), resolution)]
    except FasError as error:
        return str(error)
