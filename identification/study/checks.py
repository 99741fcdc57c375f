"""Checks of a study's fits, each a separate job: profile, validation, agreement of the two domains."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, unknown
from fasbody.foot.model import Foot
from fasbody.recording.recording import Recording
from identification import optimiser
from identification.fitting import Settings
from identification.intervals import Solution
from identification.parameters import DELAY, Space, space_of
from identification.setup import Setup
from identification.study.agreement import agreement
from identification.study.filters import KINDS
from identification.study.loops import values_of
from identification.study.plan import Work
from identification.study.profile import profiles_of
from identification.study.validation import NONLINEAR, compare_damping, held, leave_one_frequency_out


def ensure(mode: str, settings: Settings, foot: Foot, profile: Sequence[str]) -> Space:
    """The space of a study's fits, its checks validated.

    Args:
        mode: of the fits.
        settings: of the fits.
        foot: the model.
        profile: parameters.

    Raises:
        SettingError: a parameter that is not estimated, or a bound that is none.
    """
    space = space_of(foot, settings.free, settings.bounds, settings.delay is not False)
    free = [item.name for item in space.free]
    for name in profile:
        if name not in free:
            raise SettingError(f"{unknown('parameter to profile', name, free)}.")
    if mode == "per-recording" and DELAY.name in profile:
        raise SettingError("one frequency cannot tell the delay, which per-recording fits hold; profile it in pooled.")
    return space


def check(work: Work, recordings: Sequence[Recording], foot: Foot) -> dict[str, Any]:
    """What a check of usable recordings finds, as plain data."""
    if work.job.kind == KINDS[1]:
        return _profile(work, recordings, foot)
    if work.job.kind == KINDS[2]:
        return _validation(work.job.mode, work.settings, recordings, foot)
    return agreement(recordings, foot, work.settings).document()


def _profile(work: Work, recordings: Sequence[Recording], foot: Foot) -> dict[str, Any]:
    """Profile of the chosen branch, the model assumed exact, from where the fit ended."""
    fit: Mapping[str, Any] = work.basis["result"] if work.basis else {}
    if fit.get("domain") != "periodic":
        raise SettingError(f"{work.job}: a profile needs a fit in the steady state, and there is none.")
    best = fit["branches"][0]
    settings = replace(work.settings, domain="periodic", delay="delay_s" in best["parameters"])
    problem = held(Setup.of(recordings, foot, settings))
    variables = problem.variables
    q = variables.start(values_of(best, foot))
    sign = int(np.sign(q[variables.index["k_F"]])) if variables.ratio is not None else 0
    problem = problem.weighed(q)
    q, objective, converged = optimiser.finished(problem, q, sign)
    solution = Solution(best["name"], problem, optimiser.Optimum(sign, q, objective, converged, 1, 1))
    (profile,) = profiles_of(solution, (work.job.parameter,))
    return {"fit": work.basis["key"] if work.basis else "", "branch": best["name"], **profile.document()}


def _validation(mode: str, settings: Settings, recordings: Sequence[Recording], foot: Foot) -> dict[str, Any]:
    """Held-out errors, and both laws of damping where all frequencies are fitted together and the law may bend."""
    free = space_of(foot, settings.free, settings.bounds, delay=False).names
    if mode == "per-recording" or not set(NONLINEAR) & set(free):
        return {"held_out": leave_one_frequency_out(recordings, foot, mode, settings).document(), "damping": None}
    damping = compare_damping(recordings, foot, settings)
    return {"held_out": damping.held_out.document(), "damping": damping.document()}
