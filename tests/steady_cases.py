"""Steady recordings of two-mass feet, and the problem that a fit makes of them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import oracle

from fasbody.foot.model import load
from fasbody.foot.two_mass import parameters, resolved
from fasbody.recording.condition import Condition
from fasbody.recording.recording import Recording
from identification.fitting import Settings
from identification.residual import Problem
from identification.setup import Setup

#: A foot whose dampers bend a little, with the masses of somebody of 72.57 kg, and a shaker that distorts.
BENT = {**{name: float(x) for name, x in oracle.TRUTH.items()}, "c_12": 30.0, "c_13": 60.0, "c_22": -40.0, "c_23": 60.0}
BASE = np.array([-8.95j, 0.13 + 0.05j, 0.07j])
BODY_KG = 72.57
RATE_HZ, SECONDS = 1000.0, 1.2
BOTH = ("malleolus", "foot")


def recorded(
    p: Mapping[str, float], hz: float, *, added: float = 0.0, seed: int = 0, noise: float = 0.02, scatter: float = 0.0,
    person: str = "", body_kg: float = BODY_KG, share: float = 1.0, second: bool = False,
) -> Recording:  # fmt: skip
    """A second or so of a foot in a steady state, of a harmonic balance that test_two_mass.py checks.

    Args:
        p: constants; masses follow from the body's. added: load [kg], of which the leg carries `share`.
        noise: of every sample [m/s^2]. scatter: of every harmonic of the sensors, as a share. second: on the foot, too.
    """
    condition = Condition(person, "midstance", added, body_kg, hz)
    masses = replace(condition, added_mass_kg=share * added).masses
    found = resolved(parameters({**masses, **p})[None], np.array([2 * np.pi * hz]), BASE[None])
    rng = np.random.default_rng([seed, round(10 * hz), round(10 * added)])
    t = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ

    def channel(Y: np.ndarray, scatter: float) -> np.ndarray:
        Y = Y + scatter * np.abs(Y) * (rng.normal(size=Y.size) + 1j * rng.normal(size=Y.size))
        turn = np.exp(2j * np.pi * hz * np.outer(t, np.arange(1, Y.size + 1)))
        return np.asarray((turn @ Y).real + noise * rng.normal(size=t.size))

    table, shank = channel(BASE, 0.0), channel(found.shank[0], scatter)
    others = {"foot": channel(found.foot[0], scatter)} if second else {}
    file = f"{person}{hz:g}hz_{added:g}kg.csv"
    return Recording(t, table, shank, condition=condition, file=file, origin="synthetic", others=others)


def session(
    p: Mapping[str, float], frequencies: Sequence[float], loads: Sequence[float] = (0.0,), **more: Any
) -> list[Recording]:
    """A recording of each frequency under each load."""
    return [recorded(p, hz, added=added, **more) for added in loads for hz in frequencies]


def problem(data: Sequence[Recording], p: Mapping[str, float] = BENT, **settings: Any) -> Problem:
    """What a fit of the foot with constants p makes of recordings."""
    return Setup.of(data, load("two_dof").with_values(dict(p)), Settings(**settings)).problem()
