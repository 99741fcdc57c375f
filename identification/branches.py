"""The mirror solution, and what the data say about it.

With known masses and the malleolus acceleration alone, the linear two-mass foot has two parameter sets with the same
response: k_T' = a k_F, k_F' = k_T / a, c_T' = a c_F, c_F' = c_T / a with a = m_S / (m_S + m_F). No input tells them
apart; nonlinear damping, a second load or a second sensor does. A fit therefore follows both branches to their ends and
compares their likelihoods.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fasbody.foot.two_dof import NAMES, TwoDof
from fasbody.presentation import readable
from fasbody.sentences import Sentence, called

#: Odds of one branch over the other beyond which the matter is decided. In 504 legs that depart from the model it was
#: decided wrongly once; beyond 100, decisive in the words of Jeffreys (1961), four times.
DECISIVE_ODDS = 1000.0
#: Log of the odds up to which branches are tied: rounding alone then orders them, and the name does it instead.
TIE = 0.01
LEFT_OUT = "The {name} branch is left out: the motion of its best fits is unstable in MuJoCo."
DOES_NOT_FOLLOW = (
    "No branch is decided, as the model does not follow the recordings: it deviates by {percent:.3g} %. For "
    "people 2 to 5 % is assumed as usual, and above {bound:.3g} % nothing is decided."
)
#: Chi-square per degree of freedom beyond which a model assumed exact is not exact, and decides nothing.
MISSES = 2.0
NOT_EXACT = (
    "No branch is decided, as the model is assumed exact but does not fit the recordings to their noise: chi-square is "
    "{excess:.3g} per degree of freedom, and above {bound:g} nothing is decided."
)
FOLLOWS_LITTLE = (
    "No branch is decided, as the model does not follow the recordings: the mean fit is {percent:.0f} %, and {least:g} "
    "% is required."
)
NOT_EXHAUSTED = (
    "No branch is decided, as the search was not exhaustive: the best fit of the less likely branch was found only "
    "once. Use more starts (--starts), or state what is known in [known] of study.toml."
)
#: Names of the branches by what is stiffer than its mirror image.
STIFF_ANKLE, STIFF_PAD = "stiff ankle", "stiff pad"
#: What a foot and its mirror image exchange.
EXCHANGED = ("k_T", "k_F", "c_11", "c_21")
#: The spring beside each of these dampers.
SPRING_OF = {"c_11": "k_T", "c_21": "k_F"}


def misses(chi_square: float, dof: int) -> bool:
    """Whether a model assumed exact misses its recordings by more than their noise."""
    return chi_square > MISSES * max(1, dof)


def ratio(masses: Sequence[Mapping[str, float]], values: Mapping[str, float]) -> float:
    """The ratio a = m_S / (m_S + m_F), its mean over the recordings: several loads have no exact common mirror."""
    persons = [{**values, **m} for m in masses] or [dict(values)]
    return float(np.mean([m["m_S"] / (m["m_S"] + m["m_F"]) for m in persons]))


def side(values: Mapping[str, float], a: float) -> str:
    """Which branch a parameter set belongs to: k_T above or below a k_F, where it is its own mirror image."""
    return STIFF_ANKLE if values["k_T"] > a * values["k_F"] else STIFF_PAD


def mirrored(values: Mapping[str, float], a: float) -> dict[str, float]:
    """The mirror image of named values; the masses only enter through a."""
    m_F = 1.0
    image = TwoDof.from_values({**values, "m_S": a * m_F / (1 - a), "m_F": m_F}).mirror()
    return {**values, **{name: getattr(image, name) for name in NAMES}}


def has_mirror(free: Sequence[str], declared: Container[str]) -> str:
    """Why a fit cannot go to the mirror image, or nothing if it can.

    Args:
        free: estimated parameters.
        declared: all that the model declares.
    """
    if not all(name in declared for name in (*NAMES, "m_S", "m_F")):
        return "This model has no mirror solution that is known in closed form; one solution is reported."
    held = [name for name in EXCHANGED if name not in free]
    if held:
        names = ", ".join(held)
        return f"The mirror solution was not compared, as {names} must be free for it; one solution is reported."
    return ""


def pinned(at_bound: Mapping[str, bool], values: Mapping[str, float] | None = None) -> list[str]:
    """Which of the exchanged constants rest on a bound beyond which a foot could lie.

    A damper that does next to nothing beside its spring rests on zero, beyond which nothing lies.

    Args:
        at_bound: parameter's key ("k_F_n_per_m") -> whether it does.
        values: of the same, None where nothing is known.
    """
    resting = [name for name in EXCHANGED if any(rests for key, rests in at_bound.items() if key.startswith(name))]
    return [name for name in resting if not _nothing(name, values or {})]


def _nothing(name: str, values: Mapping[str, float]) -> bool:
    """Whether a damper adds less than a hundredth to its spring at 50 Hz."""
    if name not in SPRING_OF:
        return False
    c, k = (
        next((v for key, v in values.items() if key.startswith(symbol)), None) for symbol in (name, SPRING_OF[name])
    )
    return c is not None and k is not None and 2 * np.pi * 50 * c < 0.01 * k


@dataclass(frozen=True)
class Recorded:
    """What a fit had to tell mirror images apart.

    Attributes:
        loads, sensors: how many.
        follow: the constants may change with the load.
    """

    loads: int = 1
    sensors: int = 1
    follow: bool = False

    @property
    def may_tell(self) -> str:
        """What else may, in a sentence."""
        sensor = "a second sensor, on the bones of the foot"
        more = f" {sensor.capitalize()}, usually decides." if self.sensors == 1 else ""
        if self.loads == 1:
            return f"{more} A second load can decide, if the constants do not change with it.".strip()
        if not self.follow:
            return f"The loads do not separate them.{more}"
        return Sentence(
            "The loads do not separate them if the constants may change with the load. Most models of ",
            called("compare_rivals"), " exclude such a change, so it may find one branch.", more,
            " Excluding nuisance parameters (", called("exclude"), ") can help.",
        )  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """Whether the data decide between the branches.

    Attributes:
        word: "decided" (the odds exceed 1000 to 1), "undecided" or "not compared".
        log_likelihood_ratio: of the best branch over the other, scaled by the misfit.
        sentence: for people.
    """

    word: str
    log_likelihood_ratio: float
    sentence: str

    @property
    def tied(self) -> bool:
        """Whether the branches are equally likely."""
        return self.word == "undecided" and self.log_likelihood_ratio < TIE


def judge(
    names: Sequence[str],
    deviances: Sequence[float],
    chi_square: float,
    dof: int,
    rests: Sequence[str] = (),
    recorded: Recorded | None = None,
) -> Verdict:
    """Compare branches by -2 log likelihood.

    Args:
        names: of the branches, best first.
        deviances: -2 log likelihood of each.
        chi_square: misfit of the best, for dof degrees of freedom: where the model does not fit to
            the noise, the difference is scaled down by the reduced chi-square.
        dof: see chi_square.
        rests: stiffness and damping of the second branch that rest on their bounds (`pinned`). It
            would fit better beyond, so that the bounds and not the data may speak against it:
            nothing is decided.
        recorded: what was recorded, so that no advice is given that was followed.
    """
    recorded = recorded or Recorded()
    if len(names) < 2:
        text = "The mirror image of this solution is outside the bounds or the same solution; nothing was compared."
        return Verdict("not compared", 0.0, text)
    excess = max(1.0, chi_square / max(1, dof))
    ratio_ = 0.5 * (deviances[1] - deviances[0]) / excess
    decided = ratio_ > np.log(DECISIVE_ODDS) and not rests
    pair = " and ".join(sorted(names[:2]))
    if rests and ratio_ > np.log(DECISIVE_ODDS):
        text = Sentence(
            f"The {names[0]} branch fits better, but the {names[1]} branch is limited by the bound of "
            f"{', '.join(rests)}, so the bounds and not the data may exclude it. Wider bounds (",
            called("bounds"),
            f"){' or a second load' if recorded.loads == 1 else ''} can decide.",
        )
    elif decided:
        odds = "more than a million" if ratio_ > np.log(1e6) else readable(float(np.exp(ratio_)))
        text = f"The {names[0]} solution is favoured over its mirror image ({names[1]}) by odds of {odds} to 1."
    else:
        text = Sentence(
            f"The data do not decide between {pair}: both parameter sets describe the recordings. ",
            recorded.may_tell,
        )
    return Verdict("decided" if decided else "undecided", float(ratio_), text)
