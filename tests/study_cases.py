"""Steady synthetic recordings of a foot whose constants are known functions of frequency and load."""

from collections.abc import Callable, Sequence

import numpy as np

from fasbody.foot.two_dof import TwoDof
from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.study import steady
from fasbody.laboratory.subject import Tuberosity
from fasbody.recording.recording import Condition, Recording

BODY_KG = 70.0
NONLINEAR = {"c_12": 60.0, "c_13": 120.0, "c_22": -80.0, "c_23": 160.0}
Constants = Callable[[float, float], dict[str, float]]


def power_laws(f: float, load: float) -> dict[str, float]:
    """Straight lines in log f, a factor for the load: the order (2, 1, 1) exactly."""
    x, t = np.log(f / 20), load / 4.5
    return {
        "k_T": 1.3e5 * np.exp(0.5 * x + 0.3 * t), "k_F": 9e4 * np.exp(0.3 * x + 0.2 * t),
        "c_11": 300 * np.exp(-0.3 * x + 0.4 * t), "c_21": 700 * np.exp(0.1 * x + 0.15 * t), **NONLINEAR,
    }  # fmt: skip


def record(
    law: Constants, f: float, load: float = 0.0, *, seed: int = 0, noise: float = 1.0, scatter: float = 0.0,
    seconds: float = 3.0,
) -> Recording:  # fmt: skip
    """One recording: sensors' noise 0.03 and 0.05 m/s^2 times `noise`, constants off their law by `scatter`."""
    rng = np.random.default_rng((seed, round(100 * f), round(100 * load)))
    condition = Condition("1", "midstance", load, BODY_KG, f)
    values = law(f, load)
    for name in ("k_T", "k_F", "c_11", "c_21"):
        values[name] *= float(np.exp(scatter * rng.normal()))
    masses = {n: condition.masses[n] for n in ("m_S", "m_F")}
    sensors = Instrument(noise_base=0.03 * noise, noise_malleolus=0.05 * noise, bits=20, delay_s=0.0)
    made, _ = steady(TwoDof(**values, **masses), Tuberosity.under(0.0), f, seconds, sensors, rng)
    return Recording(
        made.time_s, made.base_m_s2, made.malleolus_m_s2, condition=condition, file=f"{f:g}hz_{load:g}kg.csv",
        origin="synthetic",
    )  # fmt: skip


def study(law: Constants, frequencies: Sequence[float], loads: Sequence[float], **more: float) -> list[Recording]:
    """All recordings of one subject."""
    return [record(law, f, load, **more) for load in loads for f in frequencies]  # type: ignore[arg-type]
