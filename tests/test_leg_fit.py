"""A fit of leg.xml to recordings that no line of it made: closed form in absolute coordinates, noise, two loads."""

import numpy as np
import pytest

from fasbody.foot.model import load
from fasbody.recording.condition import Condition, foot_mass
from fasbody.recording.recording import Recording
from identification.fitting import fit_foot

BODY_KG = 70.7
#: Foot, malleolus, shank, thigh, tissue: mass [kg], what it stands on, stiffness [N/m], damping [N s/m].
CHAIN = (
    (foot_mass(BODY_KG), -1, 1.8e5, 60.0), (0.695, 0, 1.669e5, 40.6), (2.705, 1, 1.6e4, 420.0),
    (2.06, 2, 2.792e4, 971.0),
    (0.2, 2, 5e4, 555.0),
)  # fmt: skip
FREE = {"k_T": 1.6e4, "k_A": 5e4}


def recorded(hz: float, added: float, carrier: int = 4) -> Recording:
    """Table, malleolus and tuberosity of the chain with the added mass on one of its masses."""
    s, D = 2j * np.pi * hz, np.zeros((6, 6), complex)
    for i, (mass, on, k, c) in enumerate(CHAIN):
        D[np.ix_([i + 1, on + 1], [i + 1, on + 1])] += (k + s * c) * np.array([[1, -1], [-1, 1]])
        D[i + 1, i + 1] += s**2 * (mass + added * (i == carrier))
    y = np.linalg.solve(D[1:, 1:], -D[1:, 0])
    rng, t = np.random.default_rng([1, round(hz), round(10 * added)]), np.arange(1200) / 1000
    turn = 8.95 * np.exp(s * t)
    base, malleolus, tuberosity = ((turn * H).real + 0.03 * rng.normal(size=t.size) for H in (1.0, y[1], y[2]))
    condition = Condition("made", "midstance", added, BODY_KG, hz)
    others = {"tuberosity": tuberosity}
    return Recording(
        t, base, malleolus, condition=condition, file=f"{hz:g} {added:g}", origin="synthetic", others=others
    )


def test_intervals_hold_the_truth_with_the_added_mass_where_the_model_says() -> None:
    """Were the load bolted to the shank, the malleolus would move otherwise, so its place matters to the fit."""
    bolted, soft = (recorded(30.0, 4.5, carrier).malleolus_m_s2.std() for carrier in (2, 4))
    assert abs(bolted / soft - 1) > 0.05
    foot = load("leg").with_values({"k_F": 1.8e5, "c_F": 60.0, "c_T": 420.0})
    data = [recorded(20.0, 0.0), recorded(30.0, 4.5)]
    result = fit_foot(data, foot, free=[*FREE], starts=1, threads=1, departures=False, delay=False)
    for name, value in FREE.items():
        found = result.best[name]
        assert found.lower < value < found.upper
        assert found.value == pytest.approx(value, rel=0.02)
        assert found.upper - found.lower < 0.1 * value
