"""One law compared with all strikes: each person and speed, another speed, a person left out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.heel.estimate import LawFit, Paths, fit, pooled
from fasbody.heel.laws import LAWS, HeelLaw
from fasbody.heel.strike import Strike
from fasbody.runner import key, program

Groups = Mapping[tuple[str, str], tuple[Strike, ...]]
Document = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Task:
    """A law, and the strikes that it is compared with.

    Attributes:
        law: key of the law.
        window: of the strikes, one of `estimate.WINDOWS`.
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
        return key(program(__name__), self.digest, self.law, self.window)


def judge(task: Task) -> Document:
    """Estimates of a law with intervals, and its errors on strikes that it was not fitted to."""
    law = LAWS[task.law]
    fits: dict[tuple[str, str], LawFit] = {}
    left_out = []
    for group, strikes in task.groups.items():
        try:
            fits[group] = fit(law, strikes, task.window)
        except RecordingError as error:
            left_out.append(str(error))
    return {
        "key": task.key, "law": law.key, "window": task.window, "name": law.name,
        "equation": law.equation, "formula": law.formula,
        "persons": [
            {"subject": subject, "speed": speed, "strikes": len(task.groups[subject, speed]),
             "misfit": of.misfit, "offset_mm": 1e3 * of.offset_m,
             "parameters": {name: vars(item) for name, item in of.parameters.items()},
             "theta": of.theta, "covariance": of.covariance}
            for (subject, speed), of in fits.items()
        ],
        "misfit": float(np.median([of.misfit for of in fits.values()])) if fits else None,
        "at_bound": sum(bool(of.at_bound) for of in fits.values()),
        "other_speed": _other_speed(law, task, fits), "other_person": _other_person(law, task),
        "left_out": left_out,
    }  # fmt: skip


def _error(law: HeelLaw, window: str, theta: np.ndarray, strikes: Sequence[Strike], offset_m: float = 0.0) -> float:
    """Mean error of the force over the peak on strikes that the law was not fitted to."""
    return float(np.mean(Paths.of(strikes, window).misfits(law, theta, offset_m)))


def _other_speed(law: HeelLaw, task: Task, fits: Mapping[tuple[str, str], LawFit]) -> list[Document]:
    return [
        {"subject": subject, "from": speed, "to": "normal",
         "error": _error(law, task.window, of.theta, task.groups[subject, "normal"], of.offset_m)}
        for (subject, speed), of in fits.items()
        if speed == "slow" and (subject, "normal") in task.groups
    ]  # fmt: skip


def _other_person(law: HeelLaw, task: Task) -> list[Document]:
    strikes: dict[str, list[Strike]] = {}
    for (subject, _), some in sorted(task.groups.items(), key=lambda item: item[0][0]):
        strikes.setdefault(subject, []).extend(some)
    if len(strikes) < 3:
        return []
    theta = pooled(law, [s for group in strikes.values() for s in group], task.window)
    errors = []
    for name, group in strikes.items():
        others = [s for other in strikes if other != name for s in strikes[other]]
        error = _error(law, task.window, pooled(law, others, task.window, theta), group)
        errors.append({"subject": name, "strikes": len(group), "error": error})
    return errors


def persons(groups: Groups, body_weight_n: Mapping[str, float]) -> list[Document]:
    """What the published analysis says of each person and speed: means of the strikes."""
    rows = []
    for (subject, speed), strikes in groups.items():
        mean = {n: float(np.mean([getattr(s.published, n) for s in strikes])) for n in vars(strikes[0].published)}
        work, returned = (float(np.mean([getattr(s, n) for s in strikes])) for n in ("work_j", "returned_j"))
        rows.append({
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
    return rows
