"""How stiff the heels are where a foot on the shaker rests: the slope of force over compression.

Read off the strikes themselves, without a law: a parabola through the samples of the loading around
the load.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fasbody.foot.model import load
from fasbody.heel.comparison import Groups
from fasbody.heel.population import Observed, Population, estimate
from fasbody.heel.strike import Strike

#: Static loads on the foot of chapter 2 [N]: leg alone, with 2.3 kg and with 4.5 kg on the knee.
LOADS_N = (43.0, 66.0, 88.0)
#: The parabola goes through the samples whose force lies between these shares of the load.
_AROUND = (0.6, 1.4)
#: And which are nearer than so many samples to the first above it.
_BESIDE = 30
#: Pad of the bundled synthetic subject [N/m].
BUNDLED_K_F = 9.4e4


def slopes(strike: Strike, loads_n: Sequence[float] = LOADS_N) -> np.ndarray:
    """Slopes (loads,) of the loading of a strike [N/m].

    NaN where it does not reach a load or has too few samples.
    """
    F, x = strike.force_n[strike.loading], strike.compression_m[strike.loading]
    out = np.full(len(loads_n), np.nan)
    for k, load_n in enumerate(loads_n):
        low, high = (share * load_n for share in _AROUND)
        beside = np.abs(np.arange(F.size) - int(np.argmax(load_n < F))) < _BESIDE
        near = np.flatnonzero((low < F) & (high > F) & beside)
        if F.max() > high and near.size > 3 and np.ptp(x[near]) > 0:
            at = float(np.interp(load_n, F[near], x[near]))
            out[k] = float(np.polyfit(1e3 * (x[near] - at), F[near], 2)[1]) * 1e3
    return out


def measured(groups: Groups, loads_n: Sequence[float] = LOADS_N) -> list[Population]:
    """The population of the slopes, one a load, named after it, such as `43 N`.

    Raises:
        RecordingError: fewer than four persons reach the loads.
    """
    logs = {who: np.log([slopes(s, loads_n) for s in group]).T for who, group in groups.items()}
    out = []
    for k, load_n in enumerate(loads_n):
        known = {who: values[k][np.isfinite(values[k])] for who, values in logs.items()}
        observed = [
            Observed(*who, np.array([v.mean()]), np.array([[np.var(v, ddof=1) / v.size]]))
            for who, v in known.items()
            if v.size >= 3
        ]
        out.append(estimate([f"{load_n:g} N"], observed))
    return out


def of_model() -> dict[str, float]:
    """The nominal pad in `two_dof.xml`, its bounds, and that of the bundled subject [N/m]."""
    foot = load("two_dof")
    item = foot.parameters["k_F"]
    return {
        "nominal_n_per_m": foot.values()["k_F"], "bound_lower_n_per_m": item.lower,
        "bound_upper_n_per_m": item.upper, "bundled_n_per_m": BUNDLED_K_F,
    }  # fmt: skip


def rows(populations: Sequence[Population], beside: Mapping[str, float]) -> list[dict[str, Any]]:
    """One row a load and speed: median, interval, and where a new person lies, with `beside`."""
    out = []
    for row in (row for population in populations for row in population.rows()):
        load_n = float(row.pop("parameter").removesuffix(" N"))
        out.append({"load_n": load_n, "stiffness_n_per_m": row.pop("median"), **row, **beside})
    return out
