"""How stiff the heels are where a foot on the shaker rests: the slope of force over compression at a load.

Read off the strikes themselves, without a law: a parabola through the samples of the loading around the load.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fasbody.heel.strike import Strike
from identification.heel.population import Observed, Population, estimate
from identification.heel.study import Groups

#: Static loads on the foot of chapter 2 [N]: leg alone, with 2.3 kg and with 4.5 kg on the knee.
LOADS_N = (43.0, 66.0, 88.0)
#: The parabola goes through the samples whose force lies between these shares of the load.
_AROUND = (0.6, 1.4)


def slopes(strike: Strike, loads_n: Sequence[float] = LOADS_N) -> np.ndarray:
    """Slopes (loads,) [N/m] of the loading of a strike; NaN where it does not reach a load or has too few samples."""
    F, x = strike.force_n[strike.loading], strike.compression_m[strike.loading]
    out = []
    for load in loads_n:
        i = int(np.argmax(load < F))
        near = np.flatnonzero((_AROUND[0] * load < F) & (_AROUND[1] * load > F) & (np.abs(np.arange(F.size) - i) < 30))
        if F.max() > _AROUND[1] * load and near.size > 3 and np.ptp(x[near]) > 0:
            at = float(np.interp(load, F[near], x[near]))
            out.append(float(np.polyfit(1e3 * (x[near] - at), F[near], 2)[1]) * 1e3)
        else:
            out.append(np.nan)
    return np.array(out)


def measured(groups: Groups, loads_n: Sequence[float] = LOADS_N) -> list[Population]:
    """The population of the slopes, one a load, named after it, such as `43 N`.

    Raises:
        RecordingError: fewer than four persons reach the loads.
    """
    found = {key: np.log([slopes(strike, loads_n) for strike in strikes]) for key, strikes in groups.items()}
    out = []
    for k, load in enumerate(loads_n):
        observed = []
        for (subject, speed), logs in found.items():
            own = logs[np.isfinite(logs[:, k]), k]
            if own.size >= 3:
                covariance = np.array([[np.var(own, ddof=1) / own.size]])
                observed.append(Observed(subject, speed, np.array([own.mean()]), covariance))
        out.append(estimate([f"{load:g} N"], observed))
    return out


def rows(populations: Sequence[Population], beside: Mapping[str, float]) -> list[dict[str, object]]:
    """One row a load and speed: median, its interval, and where a new person lies, with the numbers `beside` it."""
    out: list[dict[str, object]] = []
    for population in populations:
        (name,) = population.names
        for speed in population.speeds:
            value, lower, upper = population.interval(speed, name)
            low, high = population.predictive(speed, name)
            out.append({
                "load_n": float(name.removesuffix(" N")), "speed": speed, "stiffness_n_per_m": value, "lower": lower,
                "upper": upper, "new_person_lower": low, "new_person_upper": high, **beside,
            })  # fmt: skip
    return out
