"""What a study has to fit: jobs, whose keys hold the recordings, the settings and the program."""

import functools
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
from identification.study import KINDS, MODES

#: What this module imports is part of the key of a job.
COMPUTES = "identification.study.job"


def select(trials: Sequence[Trial], **filters: Sequence[str | float] | None) -> list[Trial]:
    """The trials of a study that pass all filters.

    Args:
        trials: all of them.
        **filters: name in the condition -> the values to take; none takes all.

    Raises:
        SettingError: a value that no recording has, or nothing passes.
    """
    chosen = list(trials)
    for field, values in filters.items():
        of = {trial: _text(getattr(trial.condition, field)) for trial in trials}
        texts = [_text(value) for value in values or ()]
        for text in texts:
            if text not in of.values():
                kind = field.removesuffix("_kg").removesuffix("_hz").replace("_", " ")
                valid = list(dict.fromkeys(of.values()))
                raise SettingError(f"{unknown(kind, text, valid)} in this study.")
        chosen = [trial for trial in chosen if not texts or of[trial] in texts]
    if not chosen:
        raise SettingError("no recording of the study passes all the filters together.")
    return chosen


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Model:
    """A compiled foot that travels: MuJoCo's binary model needs no file and no mesh beside it."""

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
    """One fit or check.

    Attributes:
        key: of its document.
        mode: of `MODES`.
        subject: whose recordings these are.
        posture: of all.
        added_mass_kg: of all.
        frequency_hz: of all; None where they differ.
        origin: of the study.
        trials: the recordings.
        kind: of `KINDS`.
        parameter: that is profiled.
    """

    key: str
    mode: str
    subject: str
    posture: str
    added_mass_kg: float
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
        first, more = self.files[0], len(self.trials) - 1
        return f"{first} and {more} more" if more else first


@dataclass(frozen=True)
class Work:
    """Everything that a job needs, so that a worker needs no file of the study.

    Attributes:
        job: what it is.
        recordings: as read.
        model: packed.
        settings: of the fit.
        unread: a sentence on each trial that could not be read.
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

        plan = Plan(study, study.trials, Settings(), Model.of(foot))
        job.run(plan.work(plan.jobs("pooled")[0]))

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
        """A job for each group that a mode takes together; a validation takes all frequencies.

        Raises:
            SettingError: no such mode.
        """
        if mode not in MODES:
            raise SettingError(f"{unknown('mode', mode, MODES)}.")
        settings = asdict(self._settings(mode, kind))
        del settings["threads"]  # changes nothing
        how = [mode, kind, parameter, repr(sorted(settings.items())), program()]
        alone = mode == "per-recording" and kind != "validation"
        groups: dict[object, list[Trial]] = {}
        for number, trial in enumerate(self.trials):
            c = trial.condition
            shared = number if alone else (c.subject, c.posture, c.added_mass_kg)
            groups.setdefault(shared, []).append(trial)
        jobs: dict[str, Job] = {}
        for group in groups.values():
            key = runner.key(*how, self.model.binary, *(self._contents[trial] for trial in group))
            c = group[0].condition
            f = c.frequency_hz if alone else None
            who = (c.subject, c.posture, c.added_mass_kg, f, self.study.origin)
            job = Job(key, mode, *who, tuple(group), kind, parameter)
            jobs.setdefault(key, job)  # a recording listed twice is fitted once
        return list(jobs.values())

    def work(self, job: Job, basis: Mapping[str, Any] | None = None) -> Work:
        """A job with its recordings read; those that cannot be are named in it."""
        recordings, unread = [], []
        for trial in job.trials:
            subject = trial.condition.subject
            if trial.condition.body_mass_kg is None:
                unread.append(f"{trial.file}: subjects.csv has no mass_kg of subject {subject!r}.")
                continue
            try:
                recordings.append(self.study.read(trial))
            except FasError as problem:
                unread.append(str(problem))
        settings = self._settings(job.mode, job.kind)
        return Work(job, tuple(recordings), self.model, settings, tuple(unread), basis)

    def _settings(self, mode: str, kind: str) -> Settings:
        """Fits of several frequencies include model and sensor errors; the others and checks do not."""
        pooled_fit = mode == "pooled" and kind == KINDS[0]
        return replace(self.settings, departures=self.settings.departures and pooled_fit)


def content(study: StudyFolder, trial: Trial) -> str:
    """Digest of what a recording says and how it is read; neither its name nor its date counts.

    A file that is missing has a digest too: its job fails, and has another key once it is there.
    """
    condition = sorted(asdict(trial.condition).items())
    remarks = trial.path.with_suffix(".json")  # of the acquisition
    files = [path.read_bytes() if path.is_file() else b"-" for path in (trial.path, remarks)]
    return runner.key(study.origin, study.layout.of(trial.path), condition, *files)


def program() -> str:
    """Digest of the sources that compute a result: an edited program has new keys."""
    return runner.program(COMPUTES)[:12]
