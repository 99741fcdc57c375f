"""One law compared with all strikes: each person and speed, another speed, and a person left out."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.heel.estimate import LawFit, Paths, fit
from fasbody.heel.laws import LAWS, HeelLaw
from fasbody.heel.strike import Strike
from fasbody.runner import program

Array = np.ndarray
Groups = Mapping[tuple[str, str], tuple[Strike, ...]]
Document = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Task:
    """A law, the window of the strikes that it is compared with, and the strikes.

    Attributes:
        law: key of the law.
        window: one of `estimate.WINDOWS`.
        groups: strikes by person and speed.
        digest: of the study that they are from.
    """

    law: str
    window: str
    groups: Groups
    digest: str

    @property
    def key(self) -> str:
        """Name of the document: of the data, the law and this program."""
        limits = [(item.name, item.start, item.lower, item.upper) for item in LAWS[self.law].parameters]
        parts = f"{program(__name__)} {self.digest} {self.law} {self.window} {limits}"
        return hashlib.sha256(parts.encode()).hexdigest()[:24]


def judge(task: Task) -> Document:
    """Estimates of a law with intervals, and its errors on strikes that it was not fitted to."""
    law = LAWS[task.law]
    fits: dict[tuple[str, str], LawFit] = {}
    left_out = []
    for (subject, speed), strikes in task.groups.items():
        try:
            fits[subject, speed] = fit(law, strikes, task.window)
        except RecordingError as error:
            left_out.append(str(error))
    return {
        "key": task.key, "law": law.key, "window": task.window, "name": law.name,
        "equation": law.equation, "formula": law.formula,
        "persons": [_person(key, of, len(task.groups[key])) for key, of in fits.items()],
        "misfit": float(np.median([of.misfit for of in fits.values()])) if fits else None,
        "at_bound": sum(bool(of.at_bound) for of in fits.values()),
        "other_speed": _other_speed(law, task, fits), "other_person": _other_person(law, task),
        "left_out": left_out,
    }  # fmt: skip


def _person(key: tuple[str, str], fitted: LawFit, strikes: int) -> Document:
    return {
        "subject": key[0], "speed": key[1], "strikes": strikes, "misfit": fitted.misfit,
        "offset_mm": 1e3 * fitted.offset_m,
        "parameters": {name: vars(item) for name, item in fitted.parameters.items()},
        "theta": fitted.theta, "covariance": fitted.covariance,
    }  # fmt: skip


def _other_speed(law: HeelLaw, task: Task, fits: Mapping[tuple[str, str], LawFit]) -> list[Document]:
    """Errors, over the peak, on a person's normal strikes of the law fitted to the slow ones."""
    out = []
    for (subject, speed), fitted in fits.items():
        target = task.groups.get((subject, "normal"))
        if speed == "slow" and target:
            paths = Paths.of(target, task.window)
            error = float(np.mean(paths.misfits(law, fitted.theta, fitted.offset_m)))
            out.append({"subject": subject, "from": speed, "to": "normal", "error": error})
    return out


def _other_person(law: HeelLaw, task: Task) -> list[Document]:
    """Errors on a person's strikes of the law fitted to all other people's, speeds together."""
    strikes: dict[str, list[Strike]] = {}
    for (subject, _), some in sorted(task.groups.items(), key=lambda item: item[0][0]):
        strikes.setdefault(subject, []).extend(some)
    if len(strikes) < 3:
        return []
    theta = pooled(law, [s for group in strikes.values() for s in group], task.window)
    out = []
    for name, group in strikes.items():
        others = [s for other in strikes if other != name for s in strikes[other]]
        of_others = pooled(law, others, task.window, theta)
        error = float(np.mean(Paths.of(group, task.window).misfits(law, of_others)))
        out.append({"subject": name, "strikes": len(group), "error": error})
    return out


def pooled(law: HeelLaw, strikes: Sequence[Strike], window: str, start: Array | None = None) -> Array:
    """Parameters (p,) that fit many people's strikes at once, without offsets.

    Args:
        law: which.
        strikes: of all.
        window: one of `estimate.WINDOWS`.
        start: parameters (p,) to start from, the law's unless given.
    """
    from scipy.optimize import least_squares

    paths = Paths.of(strikes, window)
    zero = np.zeros(len(paths))
    bounds = np.log([[item.lower, item.upper] for item in law.parameters]).T
    first = np.log([item.start for item in law.parameters] if start is None else start)
    inner = bounds[0] + 1e-6, bounds[1] - 1e-6
    solution = least_squares(
        lambda p: paths.residual(law, np.exp(p), zero), np.clip(first, *inner), bounds=bounds,
        x_scale="jac", max_nfev=60, ftol=1e-6, xtol=1e-6,
    )  # fmt: skip
    return np.exp(solution.x)


def persons(groups: Groups, body_weight_n: Mapping[str, float]) -> list[Document]:
    """What the published analysis says of each person and speed: means of the strikes."""
    out = []
    for (subject, speed), strikes in groups.items():
        names = vars(strikes[0].published)
        mean = {n: float(np.mean([getattr(s.published, n) for s in strikes])) for n in names}
        work = float(np.mean([s.work_j for s in strikes]))
        returned = float(np.mean([s.returned_j for s in strikes]))
        out.append({
            "subject": subject, "speed": speed, "strikes": len(strikes),
            "compression_at_peak_mm": 1e3 * mean["compression_at_peak_m"],
            "work_to_peak_j": mean["work_to_peak_j"],
            "contact_speed_m_s": mean["contact_speed_m_s"],
            "time_to_peak_ms": 1e3 * mean["time_to_peak_s"],
            "deepest_mm": 1e3 * mean["deepest_m"],
            "work_to_standstill_j": mean["work_to_standstill_j"],
            "time_to_standstill_ms": 1e3 * mean["time_to_standstill_s"],
            "peak_n": mean["peak_n"],
            "peak_over_body_weight": mean["peak_n"] / body_weight_n.get(subject, np.nan),
            "stood_still": round(mean["turned"] * len(strikes)),
            "returned_at_most_j": returned,
            "absorbed_share_at_least": 1.0 - returned / work if work > 0 else None,
        })  # fmt: skip
    return out
