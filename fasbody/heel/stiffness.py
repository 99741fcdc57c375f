"""How stiff the heels are where a foot on the shaker rests: the slope of force over compression.

Read off the strikes themselves, without a law: a parabola through the samples of the loading around
the load.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.foot.model import load
from fasbody.heel.comparison import Groups
from fasbody.heel.population import Observed, Population, estimate
from fasbody.heel.strike import Strike

#: Static loads on the foot of chapter 2 [N]: leg alone, with 2.3 kg and with 4.5 kg on the knee.
LOADS_N = (43.0, 66.0, 88.0)
#: The parabola goes through the samples whose force lies between these shares of the load.
_AROUND = (0.6, 1.4)
#: Pad of the bundled synthetic subject [N/m].
BUNDLED_K_F = 9.4e4


def slopes(strike: Strike, loads_n: Sequence[float] = LOADS_N) -> np.ndarray:
    """Slopes (loads,) of the loading of a strike [N/m].

    NaN where it does not reach a load or has too few samples.
    """
    F, x = strike.force_n[strike.loading], strike.compression_m[strike.loading]
    low, high = _AROUND
    out = []
    for load_n in loads_n:
        beside = np.abs(np.arange(F.size) - int(np.argmax(load_n < F))) < 30
        near = np.flatnonzero((low * load_n < F) & (high * load_n > F) & beside)
        if F.max() > high * load_n and near.size > 3 and np.ptp(x[near]) > 0:
            at = float(np.interp(load_n, F[near], x[near]))
            out.append(float(np.polyfit(1e3 * (x[near] - at), F[near], 2)[1]) * 1e3)
        else:
            out.append(np.nan)
    return np.array(out)


def measured(groups: Groups, loads_n: Sequence[float] = LOADS_N) -> list[Population]:
    """The population of the slopes, one a load, named after it, such as `43 N`.

    Raises:
        RecordingError: fewer than four persons reach the loads.
    """
    logs = {key: np.log([slopes(s, loads_n) for s in group]) for key, group in groups.items()}
    out = []
    for k, load_n in enumerate(loads_n):
        observed = []
        for (subject, speed), values in logs.items():
            known = values[np.isfinite(values[:, k]), k]
            if known.size >= 3:
                covariance = np.array([[np.var(known, ddof=1) / known.size]])
                observed.append(Observed(subject, speed, np.array([known.mean()]), covariance))
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


def rows(populations: Sequence[Population], beside: Mapping[str, float]) -> list[dict[str, object]]:
    """One row a load and speed: median, interval, and where a new person lies, with `beside`."""
    out: list[dict[str, object]] = []
    for population in populations:
        (name,) = population.names
        for speed in population.speeds:
            value, lower, upper = population.interval(speed, name)
            low, high = population.predictive(speed, name)
            out.append({
                "load_n": float(name.removesuffix(" N")), "speed": speed,
                "stiffness_n_per_m": value, "lower": lower, "upper": upper,
                "new_person_lower": low, "new_person_upper": high, **beside,
            })  # fmt: skip
    return out
