"""What is known of each fit's branches before they are weighed together: likelihood, a prior, a second sensor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError, unknown
from fasbody.foot.two_dof import TwoDof
from identification.branches import EXCHANGED, pinned
from identification.space import limits

#: Curves whose continuity counts.
CURVES = EXCHANGED
#: Odds that a believed order of the stiffnesses is given in each fit.
BELIEVED = 1e4
#: A value outside a prior's range costs one standard deviation for this change of its logarithm.
_OUTSIDE = 0.1


@dataclass(frozen=True)
class BranchFit:
    """One branch of one fit: named values, their relative standard errors (missing: unknown), -2 log likelihood."""

    name: str
    values: Mapping[str, float]
    relative_errors: Mapping[str, float]
    deviance: float


@dataclass(frozen=True)
class Fit:
    """One fit of a subject.

    Attributes:
        frequency_hz: None for a pooled one. added_mass_kg: load. branches: both of them. masses: on it, which a
            foot-bone channel needs. key: of its document.
    """

    frequency_hz: float | None
    added_mass_kg: float
    branches: tuple[BranchFit, ...]
    masses: Mapping[str, float] | None = None
    key: str = ""

    @classmethod
    def from_document(cls, document: Mapping[str, Any], masses: Mapping[str, float] | None = None) -> "Fit":
        """From a fit's JSON document with `result`, as a study stores it.

        Where the model misfits, the deviances are scaled by the reduced chi-square as in branches.judge, and as there
        nothing speaks against a branch whose stiffness or damping rests on a bound: it would fit better beyond.
        """
        result = document["result"]
        goodness = result["goodness_of_fit"]
        excess = max(1.0, goodness["chi_square"] / max(1, goodness["dof"]))
        found, least = [], min(branch["deviance"] for branch in result["branches"])
        for branch in result["branches"]:
            values, errors = {}, {}
            for key, e in branch["parameters"].items():
                name = next((n for n in (*CURVES, "c_12", "c_13", "c_22", "c_23") if key.startswith(f"{n}_")), key)
                values[name] = e["value"]
                if e["std_error"] is not None and np.isfinite(e["std_error"]) and e["value"]:
                    errors[name] = abs(e["std_error"] / e["value"])
            rests = pinned({key: bool(e["at_bound"]) for key, e in branch["parameters"].items()})
            deviance = least if rests else branch["deviance"]
            found.append(BranchFit(branch["name"], values, errors, deviance / excess))
        f = document["frequency_hz"]
        place = None if f is None else round(f, 1), document["added_mass_kg"]
        return cls(*place, tuple(found), masses, document.get("key", ""))


@dataclass(frozen=True)
class Prior:
    """What is believed beforehand.

    Attributes:
        ranges: name -> (lower, upper) that the constant is believed to lie in. stiff_ankle_odds: of k_T above k_F over
            the contrary, 1 for none.
    """

    ranges: Mapping[str, tuple[float, float]] | None = None
    stiff_ankle_odds: float = 1.0

    @classmethod
    def read(cls, texts: Sequence[str]) -> "Prior | None":
        """From the command line: "k_T>k_F", "k_T<k_F", or ranges such as "k_F=5e4:2e5"; None of nothing.

        Raises:
            SettingError: none of these, or more than one order.
        """
        odds = {"k_T>k_F": BELIEVED, "k_F<k_T": BELIEVED, "k_T<k_F": 1 / BELIEVED, "k_F>k_T": 1 / BELIEVED}
        plain = [text.replace(" ", "") for text in texts]
        orders = [text for text in texts if "<" in text or ">" in text]
        try:
            ranges = limits([text for text in plain if text not in odds], "--prior")
        except SettingError as problem:
            raise SettingError(f"{str(problem).rstrip('.')}, nor an order: k_T>k_F or k_T<k_F.") from None
        for name, (low, high) in ranges.items():
            if name not in CURVES:
                raise SettingError(f"{unknown('parameter with a prior', name, CURVES)}, or k_T>k_F, k_T<k_F.")
            if not 0 < low < high:
                raise SettingError(f"--prior {name}={low:g}:{high:g} is not a range; give 0 < lower < upper.")
        if len(orders) > 1:
            raise SettingError(f"--prior orders k_T and k_F {len(orders)} times ({', '.join(orders)}); give one order.")
        order = next((odds[text] for text in plain if text in odds), 1.0)
        return cls(ranges, order) if texts else None

    def log(self, values: Mapping[str, float]) -> float:
        """Log prior up to a constant."""
        total = np.log(self.stiff_ankle_odds) if values["k_T"] > values["k_F"] else 0.0
        for name, (low, high) in (self.ranges or {}).items():
            beyond = np.log(values[name] / np.clip(values[name], low, high))
            total -= 0.5 * (beyond / _OUTSIDE) ** 2
        return float(total)


@dataclass(frozen=True)
class FootBone:
    """A second sensor: foot over base acceleration (complex) at a frequency and a load, and the error of each part."""

    frequency_hz: float
    added_mass_kg: float
    response: complex
    std: float


def foot_response(values: Mapping[str, float], masses: Mapping[str, float], frequency_hz: float) -> complex:
    """Foot over base acceleration of the linear part of the two-mass foot."""
    A, B, _ = TwoDof.from_values(
        {**dict.fromkeys(("c_12", "c_13", "c_22", "c_23"), 0.0), **values, **masses}
    ).state_space()
    s = 2j * np.pi * frequency_hz
    return complex(1 + s**2 * np.linalg.solve(s * np.eye(4) - A, B)[1])  # y2'' = y0'' + z2''


def log_weight(fit: Fit, branch: BranchFit, prior: Prior, bones: Sequence[FootBone]) -> float:
    """Log probability of one branch of one fit, without its neighbours, up to a constant."""
    least = min(b.deviance for b in fit.branches)
    total = -0.5 * (branch.deviance - least) + prior.log(branch.values)
    for bone in bones:
        if (bone.frequency_hz, bone.added_mass_kg) == (fit.frequency_hz, fit.added_mass_kg):
            error = abs(foot_response(branch.values, fit.masses or {}, bone.frequency_hz) - bone.response)
            total -= 0.5 * (error / bone.std) ** 2
    return float(total)
