"""The estimate run over whole recordings in MuJoCo: the traces of the report and the fit percentage of the thesis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from fasbody.model import Foot
from fasbody.recording import Recording
from fasbody.shaker import samples
from fasbody.simulate import Batch
from identification.blackbox.criteria import fit_percent
from identification.columns import Coordinates
from identification.space import DELAY
from identification.time_engines import TimeTwin, grid


@dataclass(frozen=True, eq=False)
class Replay:
    """Model traces of all recordings.

    Attributes:
        traces: malleolus acceleration (n,) of each recording at its samples, delayed like the measurement [m/s^2].
        fits: fit percentage of each, Eq. (3.20). base_error: largest relative error of the realised base acceleration.
        twin_difference: largest difference between twin and MuJoCo over the peak, None where no twin exists.
    """

    traces: list[np.ndarray]
    fits: list[float]
    base_error: float
    twin_difference: float | None


def replay(
    foot: Foot,
    recordings: Sequence[Recording],
    values: Mapping[str, float] | Sequence[Mapping[str, float]],
    starts: Sequence[np.ndarray],
    twin: bool,
    threads: int = 0,
) -> Replay:
    """Run every recording from its initial states [m, m/s], driven by the spline through its base channel.

    Args:
        foot: the model. recordings: checked. values: parameters by name, with the delay, of all recordings or of each.
            starts: initial states of each (`Coordinates.unpack`). twin: compare with the compiled twin.
            threads: 0 for all cores.
    """
    coordinates = Coordinates(foot)
    traces: list[np.ndarray] = [np.empty(0)] * len(recordings)
    base_error, difference = 0.0, 0.0
    grids = [grid(recording, foot) for recording in recordings]
    feet = [values] * len(recordings) if isinstance(values, Mapping) else values
    full = [{**foot_values, **r.condition.masses} for foot_values, r in zip(feet, recordings, strict=True)]
    engine = TimeTwin(foot, recordings) if twin else None
    for shape in dict.fromkeys(grids):
        group = [i for i, g in enumerate(grids) if g == shape]
        h, n, stride = shape
        batch = Batch(foot, len(group), threads)
        batch.set({name: np.array([full[i][name] for i in group]) for name in foot.parameters if name in full[0]})
        times = [recordings[i].time_s - recordings[i].time_s[0] for i in group]
        motions = [samples(t, recordings[i].base_m_s2) for t, i in zip(times, group, strict=True)]
        controls = np.stack([motion.controls(h, n) for motion in motions])
        out = batch.run(controls, h, *coordinates.unpack(np.stack([starts[i] for i in group])))
        base_error = max(base_error, out.base_error)
        for row, i in enumerate(group):
            y = out.malleolus[row, ::stride]
            if engine is not None:
                other, _ = engine.run(i, full[i], (), starts[i])
                difference = max(difference, float(np.abs(y - other).max() / np.abs(other).max()))
            t = times[row]
            traces[i] = CubicSpline(t, y)(t - full[i].get(DELAY.name, 0.0))
    fits = [fit_percent(r.malleolus_m_s2, y) for r, y in zip(recordings, traces, strict=True)]
    return Replay(traces, fits, base_error, difference if twin else None)
