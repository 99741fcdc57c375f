"""What a study has to fit: jobs, each with a key that follows its recordings' content, the settings and the program."""

import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import mujoco
import numpy as np

from fasbody import runner
from fasbody.exceptions import FasError, SettingError, unknown
from fasbody.foot.model import Foot, check
from fasbody.recording.recording import Recording
from fasbody.recording.study import StudyFolder
from fasbody.recording.trials import Trial
from identification.fitting import Settings
from identification.setup import DOMAINS
from identification.study.filters import KINDS, MODES

#: What this module imports is part of the key of a job.
COMPUTES = "identification.study.job"


@dataclass(frozen=True)
class Model:
    """A compiled foot in a form that travels: MuJoCo's binary model, which needs no file and no mesh beside it."""

    name: str
    binary: bytes

    @classmethod
    def of(cls, foot: Foot) -> Self:
        """Pack a loaded model."""
        buffer = np.zeros(mujoco.mj_sizeModel(foot.model), np.uint8)
        mujoco.mj_saveModel(foot.model, None, buffer)
        return cls(foot.name, buffer.tobytes())

    def foot(self) -> Foot:
        """The model again, kept for the next job of this process."""
        return _unpacked(self)


@functools.lru_cache(maxsize=4)
def _unpacked(model: Model) -> Foot:
    compiled = mujoco.MjModel.from_binary_path("foot.mjb", {"foot.mjb": model.binary})
    return check(compiled, model.name)


@dataclass(frozen=True)
class Job:
    """One fit or check: which trials, what they have in common (None where they differ), and the parameter profiled."""

    key: str
    mode: str
    subject: str
    posture: str
    added_mass_kg: float | None
    frequency_hz: float | None
    origin: str
    trials: tuple[Trial, ...]
    kind: str = KINDS[0]
    parameter: str = ""

    @property
    def files(self) -> list[str]:
        """What recordings.csv calls the trials."""
        return [trial.file for trial in self.trials]

    def __str__(self) -> str:
        return self.files[0] if len(self.trials) == 1 else f"{self.files[0]} and {len(self.trials) - 1} more"


@dataclass(frozen=True)
class Work:
    """Everything that a job needs, so that who does it sees no file of the study.

    Attributes:
        job: what it is.
        recordings: as read.
        model: packed.
        settings: of the fit.
        unread: one sentence for each trial that could not be read.
        basis: the fit's document, for a check of it.
    """

    job: Job
    recordings: tuple[Recording, ...]
    model: Model
    settings: Settings
    unread: tuple[str, ...] = ()
    basis: Mapping[str, Any] | None = None


class Plan:
    """The fits of a study in the order of its table.

    Args:
        study: opened.
        trials: those of its recordings to fit.
        settings: of each fit.
        model: what is fitted.

    Raises:
        SettingError: an invalid domain or number of starts.
    """

    def __init__(self, study: StudyFolder, trials: Sequence[Trial], settings: Settings, model: Model) -> None:
        if settings.domain not in DOMAINS:
            raise SettingError(f"{unknown('domain', settings.domain, DOMAINS)}.")
        if settings.starts < 1:
            raise SettingError(f"the number of starts is {settings.starts}; at least one is needed.", "starts")
        self.study, self.trials, self.settings, self.model = study, list(trials), settings, model
        self._contents = {trial: content(study, trial) for trial in trials}

    def jobs(self, mode: str, kind: str = KINDS[0], parameter: str = "") -> list[Job]:
        """One job a group of recordings that a mode takes together; a validation takes all frequencies of a load.

        Args:
            mode: see MODES.
            kind: see KINDS.
            parameter: whose profile.

        Raises:
            SettingError: no such mode.
        """
        if mode not in MODES:
            raise SettingError(f"{unknown('mode', mode, MODES)}.")
        settings = {n: v for n, v in asdict(self._settings(mode, kind)).items() if n != "threads"}  # changes nothing
        words = [mode, kind, parameter, repr(sorted(settings.items())), program()]
        how = hashlib.sha256("\n".join(words).encode() + self.model.binary)
        together = "pooled" if kind == "validation" and mode == "per-recording" else mode
        jobs: dict[str, Job] = {}
        groups: dict[object, list[Trial]] = {}
        for number, trial in enumerate(self.trials):
            c = trial.condition
            shared = number if together == "per-recording" else (c.subject, c.posture, c.added_mass_kg)
            groups.setdefault(shared, []).append(trial)
        for group in groups.values():
            contents = [self._contents[trial] for trial in group]
            key = hashlib.sha256("\n".join([how.hexdigest(), *contents]).encode()).hexdigest()[:24]
            condition = group[0].condition
            job = Job(
                key=key, mode=mode, subject=condition.subject, posture=condition.posture,
                added_mass_kg=condition.added_mass_kg,
                frequency_hz=condition.frequency_hz if together == "per-recording" else None,
                origin=self.study.origin, trials=tuple(group), kind=kind, parameter=parameter,
            )  # fmt: skip
            jobs.setdefault(key, job)  # a recording listed twice is fitted once
        return list(jobs.values())

    def work(self, job: Job, basis: Mapping[str, Any] | None = None) -> Work:
        """A job with its recordings read; those that cannot be are named in it."""
        recordings, unread = [], []
        for trial in job.trials:
            try:
                recordings.append(self.study.read(trial))
            except FasError as problem:
                unread.append(str(problem))
        settings = self._settings(job.mode, job.kind)
        return Work(job, tuple(recordings), self.model, settings, tuple(unread), basis)

    def _settings(self, mode: str, kind: str) -> Settings:
        """Several frequencies are fitted with errors of model and sensors, and checked with the model assumed exact."""
        return replace(self.settings, departures=self.settings.departures and mode == "pooled" and kind == KINDS[0])


def content(study: StudyFolder, trial: Trial) -> str:
    """Digest of what a recording says and how it is read; neither its name nor its date counts.

    A file that is not there has a digest too: its job fails with a sentence, and has another key once it is there.
    """
    digest = hashlib.sha256(
        repr((study.origin, study.layout.of(trial.path), sorted(asdict(trial.condition).items()))).encode()
    )
    for file in (trial.path, trial.path.with_suffix(".json")):  # the latter holds acquisition's remarks
        digest.update(file.read_bytes() if file.is_file() else b"-")
        digest.update(b"|")
    return digest.hexdigest()


def program() -> str:
    """Digest of the sources that compute a result, which is more than a version says: an edited program, new keys."""
    return runner.program(COMPUTES)[:12]
