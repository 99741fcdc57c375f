"""What a trend found: curves of both mirror branches with standard errors, printed and as plain data."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from identification.certification import size_that_matters
from identification.result import Estimate, RecordingFit, identifiability
from identification.study.curves import CurveSpace, Order

_Z95 = 1.959963984540054


@dataclass(frozen=True, eq=False)
class TrendBranch:
    """One of the two mirror solutions of a trend.

    Attributes:
        name: "stiff ankle", "stiff pad" or "best". deviance: -2 log likelihood, offsets integrated out.
        aic, bic: information criteria. chi_square, dof: misfit, offsets included. fit_percent: mean over recordings.
        z: coefficients and offsets. covariance: of the coefficients. scatter: of each curve between recordings.
        space: what they are coefficients of. crosses: k_T passes its mirror image k_F a somewhere.
    """

    name: str
    deviance: float
    aic: float
    bic: float
    chi_square: float
    dof: int
    fit_percent: float
    z: np.ndarray
    covariance: np.ndarray
    scatter: Mapping[str, float]
    space: CurveSpace
    crosses: bool

    @property
    def beta(self) -> np.ndarray:
        """Coefficients (n,)."""
        return self.z[: self.space.size]

    def at(self, frequency_hz: float, added_mass_kg: float) -> dict[str, Estimate]:
        """Parameters of a foot on the curves, key with unit -> estimate, with standard errors given the order."""
        feet = self.space.feet
        B = self.space.design(np.array([frequency_hz]), np.array([added_mass_kg]))[0]
        q = B @ self.beta
        std_q = np.sqrt(np.maximum(0.0, np.einsum("pn,nm,pm->p", B, np.nan_to_num(self.covariance), B)))
        known = ~np.isnan(np.diag(self.covariance))
        theta = feet.to_theta(q)
        lower, upper = feet.bounds  # limits beyond them say no more, and their exponentials outgrow all numbers
        low = feet.to_theta(np.maximum(q - _Z95 * std_q, np.minimum(q, lower)))
        high = feet.to_theta(np.minimum(q + _Z95 * std_q, np.maximum(q, upper)))
        found = {}
        for i, item in enumerate(feet.free):
            held = not known[np.abs(B[i]) > 1e-9].any()
            std = float("nan") if held else float(std_q[i] * feet.slope(theta)[i])
            size = size_that_matters(item)
            word = identifiability(theta[i], std, size, held)
            found[item.key] = Estimate(float(theta[i]), std, float(low[i]), float(high[i]), held, word)
        return found

    def document(self) -> dict[str, Any]:
        """The branch as plain data: its coefficients, and the parameters at each frequency and load recorded."""
        space = self.space
        std = np.sqrt(np.diag(self.covariance))
        where = sorted({(round(float(m), 6), round(float(f), 2)) for f, m in zip(space.frequencies_hz, space.loads_kg,
                                                                                 strict=True)})  # fmt: skip
        return {
            "name": self.name, "deviance": self.deviance, "aic": self.aic, "bic": self.bic,
            "chi_square": self.chi_square, "dof": self.dof, "fit_percent": self.fit_percent, "crosses": self.crosses,
            "scatter": dict(self.scatter),
            "coefficients": {
                label: {"value": float(v), "std_error": float(s)}
                for label, v, s in zip(space.labels, self.beta, std, strict=True)
            },
            "points": [
                {"frequency_hz": f, "added_mass_kg": m, "parameters": {k: asdict(e) for k, e in self.at(f, m).items()}}
                for m, f in where
            ],
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class TrendResult:
    """What a trend found; `document()` is its JSON."""

    source: str
    origin: str
    model: str
    order: Order
    orders: tuple[Mapping[str, Any], ...]
    branches: tuple[TrendBranch, ...]
    recordings: tuple[RecordingFit, ...]
    verdict: str
    reason: str
    log_likelihood_ratio: float
    twin_mujoco_difference: float | None
    base_acceleration_error: float
    starts: tuple[Mapping[str, Any], ...]
    warnings: tuple[str, ...]
    seconds: float

    @property
    def best(self) -> TrendBranch:
        """The likelier branch."""
        return self.branches[0]

    @property
    def p_value(self) -> float | None:
        """Chance of a misfit as large; the scatter has been learnt from the same data, so it is rarely small."""
        return float(chi2.sf(self.best.chi_square, self.best.dof)) if self.best.dof else None

    def feet(self, branch: TrendBranch | None = None) -> list[dict[str, float]]:
        """Parameters of every recording's own foot, its offsets from the curves included."""
        chosen = branch or self.best
        return chosen.space.feet_of(chosen.z)

    def document(self) -> dict[str, Any]:
        """The result as plain data."""
        best = self.best
        return {
            "source": self.source, "origin": self.origin, "model": self.model, "domain": "periodic",
            "fit_percent": best.fit_percent, "chi_square": best.chi_square, "dof": best.dof, "p_value": self.p_value,
            "aic": best.aic, "bic": best.bic,
            "order": asdict(self.order), "orders": [dict(o) for o in self.orders],
            "verdict": self.verdict, "verdict_reason": self.reason,
            "log_likelihood_ratio": self.log_likelihood_ratio,
            "recordings": [
                {"file": r.file, "frequency_hz": r.frequency_hz, "added_mass_kg": r.added_mass_kg,
                 "fit_percent": r.fit_percent, "foot": foot}
                for r, foot in zip(self.recordings, self.feet(), strict=True)
            ],
            "branches": [branch.document() for branch in self.branches],
            "twin_mujoco_difference": self.twin_mujoco_difference,
            "base_acceleration_error": self.base_acceleration_error,
            "starts": [dict(start) for start in self.starts],
            "warnings": list(self.warnings), "seconds": self.seconds,
        }  # fmt: skip

    def __str__(self) -> str:
        scatter = ", ".join(f"{name} {100 * tau:.1f} %" for name, tau in self.best.scatter.items())
        return (
            f"{self.best.name}, {self.order}; fit {self.best.fit_percent:.1f} %; recordings scatter about the curves "
            f"by {scatter}. {self.reason}"
        )
