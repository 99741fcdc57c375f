"""Notes on a fit, and how many parameters its excitation can determine."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fasbody.foot.parameters import symbol_and_unit
from fasbody.recording.recording import Recording
from fasbody.sentences import Sentence, called
from identification.estimates import Allowance, quantile
from identification.harmonics import Line
from identification.nuisances import FOOT_STD
from identification.parameters import MASSES, Space
from identification.result import UNLIKELY, Branch, Departures, chance
from identification.sensors import MALLEOLUS

#: Fit below which something is wrong [%], and error of the base above which the shaker is.
LEAST_FIT, _BASE_ERROR = 85.0, 1e-4
#: A line counts if its amplitude exceeds this share of the largest one, and five times its noise.
_SHARE, _NOISE = 1e-3, 5.0


def follows(fit_percent: Any) -> Any:
    """Whether a fit follows its recordings, by its fit percentage, the mean over them: the one rule of the project.

    One that does not fails to fit, and says nothing of the foot. A percentage that is not known (NaN) fails nothing.
    """
    return ~np.less(fit_percent, LEAST_FIT)


def advice(
    best: Branch,
    space: Space,
    rank: int,
    data: Sequence[Recording],
    fits: Sequence[float],
    base_error: float,
    others: Sequence[Departures] = (),
) -> list[str]:
    """Sentences on a fit's best branch.

    Args:
        best: the branch.
        space: what was free.
        rank: of the excitation.
        data: the recordings.
        fits: of each recording [%].
        base_error: of the base that MuJoCo realised.
        others: the other branches that the data leave open.
    """
    texts = []
    more = (
        "Record more frequencies"
        if len({r.condition.frequency_hz for r in data}) > 1
        else "Fit recordings of several frequencies together"
    )
    if best.p_value is not None and best.p_value < UNLIKELY:
        texts.append(
            f"With the model assumed exact, the misfit is larger than the noise (chi-square {best.chi_square:.4g} for "
            f"{best.dof} degrees of freedom, {chance(best.p_value)}). The standard errors with the model assumed exact "
            "are multiplied by the square root of chi-square per degree of freedom. They are still too small if "
            "constants change between recordings."
        )
    below = [(fit, r.file) for fit, r in zip(fits, data, strict=True) if not follows(fit)]
    likely = best.p_value is not None and best.p_value >= UNLIKELY
    followed = best.departures is not None and best.departures.follows
    if below and not likely and not followed:  # else it is the sensors' noise
        fit, file = min(below)
        texts.append(
            f"The fit of {file} is only {fit:.0f} %. Check that its channels are aligned and in the right unit, that "
            "it is a recording of this foot, and that the bounds are not too narrow."
        )
    if base_error > _BASE_ERROR:
        texts.append(f"In MuJoCo, the base acceleration differs from the recorded one by {base_error:.1e} of its peak.")
    if best.dof == 0:
        exact = (
            "Any foot fits them exactly, so goodness of fit is no evidence."
            if best.chi_square <= 1
            else "They should fit exactly but do not: the search missed the minimum, or it lies outside the bounds."
        )
        count = f"There are not more data than the {len(space.free)} free parameters. {exact}"
        texts.append(Sentence(f"{count} {more} or estimate fewer parameters (", called("free"), ")."))
    if rank < len(space.free):
        texts.append(
            f"{_these(data)} at most {rank} numbers on a linear foot, two for each frequency in the base motion, "
            f"harmonics included. They cannot determine {len(space.free)} free parameters. Nonlinear "
            f"dampers add information through harmonics, but too little for an interval. "
            f"{more}."
        )
    bound = [key for key, e in best.parameters.items() if e.at_bound]
    zero = [key for key in bound if best.parameters[key].value == 0.0]
    may_trust = best.departures is None or best.departures.follows
    if zero and may_trust:
        texts.append(f"At the lower bound, zero: {', '.join(map(_symbol, zero))}. Larger values may fit, too.")
    if set(bound) - set(zero):
        rest = ", ".join(_symbol(key) for key in bound if key not in zero)
        texts.append(f"At a bound: {rest}. This value is not an estimate.")
    few = best.departures is None and rank < len(space.free)
    free = {key: e for key, e in best.parameters.items() if not e.at_bound}
    weak = [key for key, e in free.items() if few or e.identifiability == "not identifiable"]
    if weak and may_trust:
        why = "rank too small" if few else "standard error too large"
        texts.append(f"Not identifiable from these recordings: {', '.join(map(_symbol, weak))} ({why}).")
    narrow = {k: e.if_model_true for k, e in best.parameters.items() if _bend(k) and e.if_model_true and e.lower == 0}
    if trusted := [_symbol(key) for key, e in narrow.items() if e.lower > 0 and rank >= len(space.free) and may_trust]:
        texts.append(
            f"Different from zero only with the model assumed exact: {', '.join(trusted)}."
        )
    held = [name for name in space.fixed if name not in MASSES]
    if held and best.departures is not None and not best.departures.follows:
        texts.append(
            Sentence(
                f"Held at the model's values: {', '.join(held)}. A wrong value causes a misfit. Estimate them instead "
                "(",
                called("free"),
                ").",
            )
        )
    loads = len({recording.condition.added_mass_kg for recording in data})
    return [*texts, *(about_departures(best.departures, others, loads) if best.departures else [])]


def _these(data: Sequence[Recording]) -> str:
    return "This recording gives" if len(data) == 1 else f"These {len(data)} recordings give"


def _bend(key: str) -> bool:
    """Whether it is one of the dampers' constants that bend them."""
    return key.endswith("_per_m") and not key.endswith(("_n_per_m", "_s_per_m"))


def _symbol(key: str) -> str:
    """A parameter as the table calls it."""
    return symbol_and_unit(key)[0]


#: Standard deviations of a prior, or standard errors, beyond which something else is named.
_FAR = 3.0
#: Times the scatter of a repeated condition beyond which what a model leaves is not the person's.
_BEYOND = 2.0


def about_departures(departures: Departures, others: Sequence[Departures] = (), loads: int = 1) -> list[str]:
    """What the recordings say of the masses, and of each thing that may be true beside the model and seems to be.

    A fit that does not follow them says nothing of that, and neither does one of two open branches alone.

    Args:
        departures: of the likelier branch.
        others: those of the other branches that the data leave open.
        loads: how many were on the knee.
    """
    if not departures.follows:
        return _culprits(departures)
    texts = _ruler(departures)
    for mass in departures.masses:
        if mass.weighed:
            texts.append(
                f"The recordings narrow {mass.name} to {mass.interval()} kg without load (95 %). Its standard "
                f"deviation is {100 * mass.learned:.0f} % smaller than the {mass.basis} one. The estimate is "
                f"{abs(100 * (mass.value / mass.stated - 1)):.1f} % {'above' if mass.value > mass.stated else 'below'} "
                f"the {mass.basis} {mass.stated:.4g} kg."
            )
    if departures.masses and not any(mass.weighed for mass in departures.masses):
        assumed = any(mass.assumed for mass in departures.masses)
        usual = any(mass.prior_std == FOOT_STD for mass in departures.masses)
        better = ("; ", called("body_mass"), " narrows it") if assumed else ()
        better = better or (("; ", called("mass_std"), " if you know them better") if usual else ())
        scale = (
            "The recordings do not determine the leg's mass. So no stiffness or damping constant is more accurate "
            f"than the {'assumed' if assumed else 'stated'} masses "
            f"(standard deviation up to {100 * max(m.prior_std for m in departures.masses):.3g} %"
        )
        remedy = f"). A {'second' if loads == 1 else 'heavier'} load may determine it."
        texts.append(Sentence(scale, *better, remedy))
    unseen = {nuisance.name for other in others for nuisance in other.nuisances if not _shows(nuisance)}
    significant = [nuisance for nuisance in departures.nuisances if _shows(nuisance) and nuisance.name not in unseen]
    texts += [_sign(nuisance) for nuisance in significant if nuisance.group != "load"]
    return [*texts, *_loads(departures, [nuisance for nuisance in significant if nuisance.group == "load"])]


def _culprits(departures: Departures) -> list[str]:
    """Where a fit that does not follow its recordings misses them."""
    texts = []
    itself = departures.repeats_by_itself
    if itself is not None and departures.repeatability > _BEYOND * itself:
        texts.append(
            f"Recordings of one condition repeat to {100 * itself:.2g} %, but the model deviates by "
            f"{100 * departures.repeatability:.2g} %. So the model or a stated condition is wrong."
        )
    if departures.misfit is None:
        return texts
    out = departures.misfit.standing_out()
    parts = [f"{name} ({_share(share)})" for name, share in list(out.get("recordings", {}).items())[:3]]
    parts += [f"harmonic {name} ({_share(share)})" for name, share in list(out.get("harmonics", {}).items())[:2]]
    parts += [f"the {name} ({_share(share)})" for name, share in out.get("sensors", {}).items()]
    if parts:
        texts.append(
            f"Most of the misfit is in {', '.join(parts)}. Check load, body mass, unit and mounting of these "
            "recordings, or fit without them: one wrong recording can spoil the fit of others."
        )
    else:
        spread = (
            "The misfit is spread over all recordings and harmonics, so no single recording is wrong. Check load, body "
            "mass and units first, then compare other models ("
        )
        texts.append(Sentence(spread, called("compare_rivals"), ")."))
    return texts


#: Standard deviations of their priors that both masses must be off to the same side to raise an alarm.
_ALIKE = 1.5


#: Standard error of the common scale that nobody needs to narrow.
_NARROW = 0.02


def _ruler(departures: Departures) -> list[str]:
    """What all constants share: the scale that masses and load set."""
    texts = []
    if departures.scale_std > _NARROW:
        half = 100 * quantile(departures.repeatability, departures.dof) * departures.scale_std
        texts.append(
            "All stiffness and damping constants are proportional to the leg's mass, which is known to "
            f"±{half:.2g} % (95 %). Natural frequencies, damping ratios and constants per kilogram do not depend on "
            "it. A force plate under the foot, with and without the load, determines it better (static_force_n in "
            "[known] of study.toml)."
        )
    off = [nuisance.off for nuisance in departures.nuisances if nuisance.group == "masses"]
    if len(off) == 2 and min(off) * max(off) > 0 and min(map(abs, off)) > _ALIKE:
        way = "heavier" if off[0] > 0 else "lighter"
        texts.append(
            f"The estimated masses of shank and foot are both {way} than stated, by about the same factor. The added "
            "mass or the body mass may be wrong, or thigh and chair carry part of the load."
        )
    return texts


def _shows(allowance: Allowance) -> bool:
    """Whether the recordings show it: beyond its prior where that is narrow, beyond its standard error elsewhere."""
    if allowance.group in ("masses", "gain", "delay", "drift"):
        return abs(allowance.off) > _FAR
    return (allowance.kind in _SIGNS or allowance.group == "load") and abs(allowance.seen) > _FAR


#: Least p at which recordings are said to agree with constants that do not change with the load.
_AGREES = 0.1


def _loads(departures: Departures, significant: Sequence[Allowance]) -> list[str]:
    """Whether the recordings show constants that change with the load, in one note of all of them.

    Args:
        departures: of the likelier branch.
        significant: those of its changes that differ from none.
    """
    follow = [nuisance for nuisance in departures.nuisances if nuisance.group == "load"]
    if departures.constant is None or not follow or not departures.follows:
        return []
    falls = max(0.0, departures.constant - departures.objective) / max(1.0, departures.per_dof)
    p = float(chdtrc(len(follow), falls))
    gain = f"{len(follow)} parameters for such a change lower the sum of squares by {falls:.3g}, {chance(p)}"
    signs = [
        f"{item.name} differs by {_share(item.value - 1)} from the value without load "
        f"({_share(item.lower - 1)} to {_share(item.upper - 1)}, 95 %)"
        for item in significant
    ]
    changes = f" {'; '.join(signs)}." if signs else ""
    if p < UNLIKELY:
        return [f"The recordings contradict constants that do not change with the load ({gain}).{changes}"]
    allows = " Intervals and odds allow for a change within the prior."
    if signs or p < _AGREES:
        return [f"The recordings do not settle whether constants change with the load ({gain}).{changes}{allows}"]
    return [f"The recordings agree with constants that do not change with the load ({gain}).{allows}"]


#: Kinds of nuisances that show what leg or sensor does.
_SIGNS = ("mount", "relaxing", "rocking")


def _owner(allowance: Allowance) -> str:
    whose = allowance.person or allowance.sensor or MALLEOLUS[0]
    return f"the {whose}'" if whose.endswith("s") else f"the {whose}'s"


def _share(x: float) -> str:
    return f"{100 * x:.3g} %"


def _sign(item: Allowance) -> str:
    if item.kind == "mount":
        low = f"{item.upper**-0.5:.0f}"
        high = f"{item.lower**-0.5:.0f} Hz" if item.lower > 0 else "beyond any"
        return (
            f"A sign of a sensor on soft tissue: the mount of {_owner(item)} sensor resonates at "
            f"{item.value**-0.5:.0f} Hz ({low} to {high}). Tap the sensor to check this (mount in [known] of "
            "study.toml)."
        )
    if item.group == "relaxation":
        return (
            f"A sign that the spring {item.constant} relaxes: its relaxing part is {_share(item.value)} of its "
            f"stiffness at rest ({_share(item.lower)} to {_share(item.upper)})."
        )
    if item.group == "rocking":
        return (
            f"A sign that the leg rocks: rotation adds {_share(item.value)} of the base's acceleration "
            f"({_share(item.lower)} to {_share(item.upper)})."
        )
    if item.group == "delay":
        return (
            f"A sign of a wrong model: the delay of {_owner(item)} channel, {1e3 * item.value:.3g} ms, is "
            f"{abs(item.off):.1f} standard deviations from the mean of its prior."
        )
    if item.group == "masses":
        return (
            f"A sign of a wrong model or a wrong body mass: the {item.name} differs by {_share(item.value - 1)} from "
            "the stated one."
        )
    return (
        f"A sign of a wrong calibration or model: the {item.kind} of {_owner(item)} channel is {_share(item.value)}, "
        f"{abs(item.off):.1f} standard deviations from the mean of its prior."
    )


def excitation_rank(recordings: Sequence[Recording]) -> int:
    """Twice the number of distinct lines in the base motion, of each load for itself: another mass is another system.

    They do not determine a linear system with more parameters than that. Noise is not excitation: lines below 1e-3
    of the largest, or below five standard deviations, do not count.
    """
    lines: list[tuple[float, float]] = []
    for recording in recordings:
        load = recording.condition.added_mass_kg
        excited = _periodic_lines(recording) if recording.condition.frequency_hz else _broadband_lines(recording)
        resolution = 0.5 / (recording.time_s[-1] - recording.time_s[0])
        for frequency in excited:
            if all(abs(frequency - other) > resolution for under, other in lines if under == load):
                lines.append((load, frequency))
    return 2 * len(lines)


def _periodic_lines(recording: Recording) -> list[float]:
    frequency = recording.condition.frequency_hz or 0.0
    h = Line.of(recording).base
    size = np.abs(h.amplitudes)
    counted = (size > _SHARE * size.max()) & (size > _NOISE * h.std)
    return [frequency * (i + 1) for i in np.flatnonzero(counted)]


def _broadband_lines(recording: Recording) -> list[float]:
    base = recording.base_m_s2
    size = np.abs(np.fft.rfft(base)) * 2 / base.size
    noise = float(np.median(size[int(0.7 * size.size) :]))  # above 0.35 of the sampling rate there is only noise,
    if noise > 0.1 * size.max():  # unless the excitation goes so far
        noise = 0.0
    counted = (size > _SHARE * size.max()) & (size > _NOISE * noise)
    return list(np.flatnonzero(counted) * recording.rate_hz / base.size)
