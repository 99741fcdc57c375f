"""One law held against everybody: each person and speed, the same person at another speed, and a person left out."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.exceptions import RecordingError
from fasbody.heel.laws import LAWS, HeelLaw
from fasbody.heel.strike import Strike
from fasbody.runner import program
from identification.heel.estimate import LawFit, Paths, fit

Array = np.ndarray
Groups = Mapping[tuple[str, str], tuple[Strike, ...]]
Document = dict[str, Any]
#: What this module imports is part of the key of a document.
_COMPUTES = "identification.heel.study"


@dataclass(frozen=True, eq=False)
class Task:
    """A law, the window of the strikes that it is held against, and the strikes by person and speed."""

    law: str
    window: str
    groups: Groups
    digest: str

    @property
    def key(self) -> str:
        """Name of the document: of the data, the law and this program."""
        parameters = [(item.name, item.start, item.lower, item.upper) for item in LAWS[self.law].parameters]
        return hashlib.sha256(
            f"{program(_COMPUTES)} {self.digest} {self.law} {self.window} {parameters}".encode()
        ).hexdigest()[:24]


def judge(task: Task) -> Document:
    """Estimates of a law with intervals, and its errors on strikes that it was not fitted to, as plain data."""
    law = LAWS[task.law]
    fits: dict[tuple[str, str], LawFit] = {}
    left_out = []
    for (subject, speed), strikes in task.groups.items():
        try:
            fits[subject, speed] = fit(law, strikes, task.window)
        except RecordingError as error:
            left_out.append(str(error))
    return {
        "key": task.key, "law": law.key, "window": task.window, "name": law.name, "equation": law.equation,
        "formula": law.formula, "persons": [_person(key, found, len(task.groups[key])) for key, found in fits.items()],
        "misfit": float(np.median([found.misfit for found in fits.values()])) if fits else None,
        "at_bound": sum(bool(found.at_bound) for found in fits.values()),
        "other_speed": _other_speed(law, task, fits), "other_person": _other_person(law, task), "left_out": left_out,
    }  # fmt: skip


def _person(key: tuple[str, str], found: LawFit, strikes: int) -> Document:
    return {
        "subject": key[0], "speed": key[1], "strikes": strikes, "misfit": found.misfit,
        "offset_mm": 1e3 * found.offset_m,
        "parameters": {name: vars(item) for name, item in found.parameters.items()},
        "theta": found.theta, "covariance": found.covariance,
    }  # fmt: skip


def _other_speed(law: HeelLaw, task: Task, fits: Mapping[tuple[str, str], LawFit]) -> list[Document]:
    """Errors on a person's normal strikes of the law fitted to the same person's slow ones, over each strike's peak."""
    out = []
    for (subject, speed), found in fits.items():
        target = task.groups.get((subject, "normal"))
        if speed == "slow" and target:
            errors = Paths.of(target, task.window).misfits(law, found.theta, found.offset_m)
            out.append({"subject": subject, "from": speed, "to": "normal", "error": float(np.mean(errors))})
    return out


def _other_person(law: HeelLaw, task: Task) -> list[Document]:
    """Errors on a person's strikes of the law fitted to all other people's, speeds together."""
    people = sorted({subject for subject, _ in task.groups})
    if len(people) < 3:
        return []
    strikes = {name: [s for key, group in task.groups.items() if key[0] == name for s in group] for name in people}
    theta = pooled(law, [s for group in strikes.values() for s in group], task.window)
    out = []
    for name in people:
        others = [s for other in people if other != name for s in strikes[other]]
        theta_others = pooled(law, others, task.window, theta)
        errors = Paths.of(strikes[name], task.window).misfits(law, theta_others)
        out.append({"subject": name, "strikes": len(strikes[name]), "error": float(np.mean(errors))})
    return out


def pooled(law: HeelLaw, strikes: Sequence[Strike], window: str, start: Array | None = None) -> Array:
    """Parameters (p,) that fit many people's strikes at once, without offsets: a law for somebody not seen."""
    from scipy.optimize import least_squares

    paths = Paths.of(strikes, window)
    nothing = np.zeros(len(paths))
    bounds = np.log([[item.lower, item.upper] for item in law.parameters]).T
    first = np.log([item.start for item in law.parameters]) if start is None else np.log(start)
    inner = bounds[0] + 1e-6, bounds[1] - 1e-6
    found = least_squares(
        lambda p: paths.residual(law, np.exp(p), nothing), np.clip(first, *inner), bounds=bounds, x_scale="jac",
        max_nfev=60, ftol=1e-6, xtol=1e-6,
    )  # fmt: skip
    return np.exp(found.x)


def persons(groups: Groups, body_weight_n: Mapping[str, float]) -> list[Document]:
    """What the published analysis says of each person and speed: means of the strikes."""
    out = []
    for (subject, speed), strikes in groups.items():
        mean = {
            name: float(np.mean([getattr(s.published, name) for s in strikes])) for name in vars(strikes[0].published)
        }
        work, returned = (float(np.mean([getattr(s, name) for s in strikes])) for name in ("work_j", "returned_j"))
        out.append({
            "subject": subject, "speed": speed, "strikes": len(strikes),
            "compression_at_peak_mm": 1e3 * mean["compression_at_peak_m"], "work_to_peak_j": mean["work_to_peak_j"],
            "contact_speed_m_s": mean["contact_speed_m_s"], "time_to_peak_ms": 1e3 * mean["time_to_peak_s"],
            "deepest_mm": 1e3 * mean["deepest_m"], "work_to_standstill_j": mean["work_to_standstill_j"],
            "time_to_standstill_ms": 1e3 * mean["time_to_standstill_s"], "peak_n": mean["peak_n"],
            "peak_over_body_weight": mean["peak_n"] / body_weight_n.get(subject, np.nan),
            "stood_still": round(mean["turned"] * len(strikes)),
            "returned_at_most_j": returned, "absorbed_share_at_least": 1.0 - returned / work if work > 0 else None,
        })  # fmt: skip
    return out
