"""The tidy table of a study, and what is made of it: curves by subject, resonance ranges, tests, files."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from fasbody.exceptions import FasError, RecordingError
from fasbody.presentation import Presented, Sheet, Tabled, counted
from fasbody.recording.channels import Channel, Layout
from fasbody.recording.condition import POSTURES
from fasbody.recording.recording import Recording
from fasbody.recording.study import Study, StudyFolder
from fasbody.recording.trials import Trial
from fasbody.runner import run
from fasbody.transmissibility.estimate import PAIRS, Row, rows, unwrapped
from fasbody.transmissibility.resonance import Resonance, by_tests, by_thesis

#: An error by the resolution is stated from here on, as a share.
_NOTABLE_BIAS = 0.01
Condition = tuple[str, float]  # posture, added mass [kg]
#: What the standard deviations hold where study.toml says nothing of the sensors.
NOISE_ONLY = "noise only; to add those of gain and delay, state gain_std and delay_std_s in study.toml"


@dataclass(frozen=True, eq=False)
class Curves(Tabled):
    """One pair under one condition.

    Attributes:
        pair: "MB", "TB" or "TM".
        posture: of the foot.
        added_mass_kg: load.
        subjects: names.
        frequency_hz: (f,) ascending.
        T: (subjects, f) transmissibility, NaN where nothing was measured.
        phase_deg: (subjects, f), unwrapped, negative where the output lags.
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
        return _mean(self.T)

    @property
    def mean_phase_deg(self) -> np.ndarray:
        """(f,) mean phase."""
        return _mean(self.phase_deg)

    @cached_property
    def resonance(self) -> Resonance:
        """By the rule of section 2.3.1."""
        return by_thesis(self.frequency_hz, self.T)

    @cached_property
    def resonance_by_tests(self) -> Resonance:
        """By tests that can show a plateau, or its lack."""
        return by_tests(self.frequency_hz, self.T)

    def on(self, frequency_hz: np.ndarray) -> "Curves":
        """The same on other frequencies, NaN where nothing was measured."""
        place = [np.flatnonzero(self.frequency_hz == f) for f in frequency_hz]
        T, phase = (np.full((len(self.subjects), len(place)), np.nan) for _ in range(2))
        for column, at in enumerate(place):
            if at.size:
                T[:, column], phase[:, column] = self.T[:, at[0]], self.phase_deg[:, at[0]]
        return replace(self, frequency_hz=np.asarray(frequency_hz, float), T=T, phase_deg=phase)

    @property
    def condition(self) -> str:
        """Posture and added mass [kg]."""
        return f"{self.posture}, {self.added_mass_kg:g} kg"


@dataclass(frozen=True, eq=False, repr=False)
class Table(Presented):
    """All rows of a study.

    Attributes:
        frame: with the columns of `Row`.
        origin: of the data.
        problems: sentences on unusable recordings.
        covers: what the standard deviations of the rows hold.
    """

    frame: pd.DataFrame
    origin: str
    problems: tuple[str, ...] = ()
    covers: str = NOISE_ONLY

    figures: ClassVar[str] = "fasbody.transmissibility.figures"
    plots: ClassVar[tuple[str, ...]] = ("means", "spectrum", "subjects")

    @classmethod
    def of(
        cls, study: StudyFolder | Study, resolution_hz: float = 1.0, processes: int = 0, estimate: str = "best"
    ) -> "Table":
        """Analyse a study; of a folder, one recording in memory a process."""
        if isinstance(study, Study):
            return cls.of_recordings(study.recordings, resolution_hz, estimate)
        light = StudyFolder(study.name, study.origin, "", (), study.layout)  # all that a worker needs besides its trial
        jobs = [(light, trial, resolution_hz, estimate) for trial in study.trials]
        results = sorted(run(_analyse, jobs, "transmissibility", processes), key=lambda result: result[0])
        return cls._made_of([part for _, part in results], study.origin, _stated(study.layout))

    @classmethod
    def of_recordings(
        cls, recordings: Sequence[Recording], resolution_hz: float = 1.0, estimate: str = "best"
    ) -> "Table":
        """Analyse recordings in memory."""
        parts = [_rows_or_problem(recording, resolution_hz, estimate) for recording in recordings]
        return cls._made_of(parts, recordings[0].origin, recordings[0].calibration)

    @classmethod
    def _made_of(cls, parts: Sequence[list[Row] | str], origin: str, channels: Mapping[str, Channel]) -> "Table":
        """Of the rows of each recording, or the sentence on why it has none."""
        lines = [asdict(row) for part in parts if not isinstance(part, str) for row in part]
        problems = tuple(part for part in parts if isinstance(part, str))
        if not lines:
            raise RecordingError(problems[0])
        return cls(_common_band(pd.DataFrame(lines)), origin, problems, covered(channels))

    def __str__(self) -> str:
        subjects, files = self.frame["subject"].nunique(), self.frame["file"].nunique()
        counts = (counted(files, "recording"), counted(subjects, "subject"), counted(len(self.frame), "row"))
        return "{} of {}, {}, ".format(*counts) + f"origin: {self.origin.removeprefix('of ').removesuffix(' origin')}"

    def sheet(self) -> Sheet:
        """Resonance of each pair and condition."""
        rows = [
            (c.pair, c.posture, f"{c.added_mass_kg:g}", str(len(c.subjects)), str(c.resonance)) for c in self.each()
        ]
        columns = ("pair", "posture", "load [kg]", "subjects", "resonance (rule of the thesis)")
        return Sheet(str(self), columns, rows, (f"Standard errors include {self.covers}.", *self.problems))

    def records(self) -> list[dict[str, Any]]:
        """The rows."""
        return self.frame.to_dict("records")

    def plot(self, kind: str = "", **options: Any) -> Any:
        """Draw it; the conditions are all that were measured, and the pair MB, unless given.

        Args:
            kind: "means", "spectrum" or "subjects"; by what was measured unless given.
            options: conditions, pair.

        Raises:
            SettingError: no such plot.
        """
        kind = kind or ("spectrum" if self.broadband else "means")
        options = {"conditions": self.conditions} | ({"pair": self.pairs[0]} if kind == "subjects" else {}) | options
        return super().plot(kind, **options)

    @cached_property
    def broadband(self) -> bool:
        """Whether a recording was of many frequencies at once."""
        return bool(_broadband(self.frame).any())

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
        key = pair, posture, added_mass_kg
        if key not in self._known:
            self._known[key] = self._curves(*key)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[str, str, float], Curves]:
        """Curves computed so far, cached for tests, figures and tables."""
        return {}

    def _curves(self, pair: str, posture: str, added_mass_kg: float) -> Curves:
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

    def levels(
        self, pair: str, conditions: Sequence[Condition], frequency_hz: float, quantity: str = "transmissibility"
    ) -> np.ndarray:
        """(subjects, conditions) transmissibility or phase_deg at one frequency, NaN where nothing was measured."""
        values = self._by_condition[quantity]
        if (pair, frequency_hz) not in values.index:
            return np.empty((0, len(conditions)))
        part = values.loc[(pair, frequency_hz)]
        return part.reindex(columns=pd.MultiIndex.from_tuples(conditions)).to_numpy(float)

    @cached_property
    def _by_condition(self) -> dict[str, pd.DataFrame]:
        """Transmissibility and phase_deg, one row a pair, frequency and subject, one column a condition."""
        rows, columns = ["pair", "frequency_hz", "subject"], ["posture", "added_mass_kg"]
        return {
            quantity: self.frame.pivot_table(index=rows, columns=columns, values=quantity)
            for quantity in ("transmissibility", "phase_deg")
        }

    def resolved(self, resolution_hz: float) -> str:
        """A sentence on what the resolution costs broadband estimates, empty where that does not show."""
        bias = self.frame["resolution_bias"]
        if not (bias.abs() > _NOTABLE_BIAS).any():
            return ""
        worst = self.frame.loc[bias.abs().idxmax()]
        return (
            f"the resolution of {resolution_hz:g} Hz makes {worst['pair']} at {worst['frequency_hz']:g} Hz wrong by "
            f"{100 * worst['resolution_bias']:+.1f} % ({worst['method']}, {worst['file']}; column resolution_bias); "
            "ask for a finer one, or record longer."
        )

    def csv(self) -> str:
        """The rows as CSV text."""
        return self.frame.to_csv(index=False, float_format="%.6g")

    def netcdf(self) -> bytes:
        """The curves as one NetCDF file: (subject, posture, added_mass_kg, pair, frequency_hz)."""
        import xarray

        keys = ["subject", "posture", "added_mass_kg", "pair", "frequency_hz"]
        values = [c for c in self.frame.columns if c not in (*keys, "file", "method")]
        data: Any = xarray.Dataset.from_dataframe(self.frame.groupby(keys)[values].mean())
        data.attrs |= {"origin": self.origin, "source": "fasbody.transmissibility", "standard_deviations": self.covers}
        for name in values:
            data[name].attrs["units"] = "degree" if "deg" in name else "1"
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "table.nc"
            data.to_netcdf(file, engine="h5netcdf")
            return file.read_bytes()


def _broadband(frame: pd.DataFrame) -> pd.Series:
    """Which rows are of broadband recordings; steps of sines are none."""
    return ~frame["method"].str.startswith("sine")


def _common_band(frame: pd.DataFrame) -> pd.DataFrame:
    """Broadband recordings only over the band that all of them excite: a mean over fewer would not be comparable."""
    broadband = _broadband(frame)
    f = frame[broadband].groupby("file")["frequency_hz"]
    low, high = f.min().max(), f.max().min()
    if not low < high:  # no broadband recordings, or none in common
        return frame
    return frame[~broadband | frame["frequency_hz"].between(low, high)].reset_index(drop=True)


def _stated(layout: Layout) -> dict[str, Channel]:
    return {name: c for one in (layout, *(other for _, other in layout.apart)) for name, c in one.channels.items()}


def covered(channels: Mapping[str, Channel]) -> str:
    """What the standard deviations hold, given what study.toml says of the channels."""
    stated = [n for n, c in channels.items() if c.gain_std or c.delay_std_s]
    if not stated:
        return NOISE_ONLY
    return f"noise, and the uncertainty of gain and delay stated in study.toml ({', '.join(stated)})"


def _mean(values: np.ndarray) -> np.ndarray:
    """Over the subjects; NaN at a frequency without a measurement."""
    known = np.isfinite(values).any(axis=0)
    mean = np.full(values.shape[1], np.nan)
    mean[known] = np.nanmean(values[:, known], axis=0)
    return mean


def _order(posture: str) -> tuple[int, str]:
    return (POSTURES.index(posture) if posture in POSTURES else len(POSTURES), posture)


def _analyse(task: tuple[StudyFolder, Trial, float, str]) -> list[Row] | str:
    """Rows of one trial, or the sentence on why there are none."""
    study, trial, resolution, estimate = task
    try:
        recording = study.read(trial)
    except FasError as error:
        return str(error)
    part = _rows_or_problem(recording, resolution, estimate)
    return part if isinstance(part, str) else [replace(row, file=trial.file) for row in part]


def _rows_or_problem(recording: Recording, resolution_hz: float, estimate: str) -> list[Row] | str:
    try:
        return rows(recording, resolution_hz, estimate)
    except RecordingError as error:
        return str(error)
