"""The arch under a leg against all its matrices at once and against the chain of leg.xml."""

from dataclasses import replace

import numpy as np
import pytest

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import arms
from fasbody.arch.lagrange import mass_matrix
from fasbody.arch.load import equilibrium, tangent
from fasbody.foot.model import load
from fasbody.leg.chain import Leg
from simulator.mounted import (
    FOOT_KG,
    PAD_N,
    SHANK_KG,
    THIGH_KG,
    TISSUE_KG,
    Mounted,
    Stance,
    stance,
)

ARCH = Arch.nominal()
LEG = Mounted(
    arm=0.038, slack=2.5e-3, k_F=3e5, c_F=100.0, k_T=1.4e4, c_T=400.0, k_H=3.5e3, c_H=35.0, k_A=6e4, c_A=400.0,
    lag=2e-4, share=0.2, up=0.1,
)  # fmt: skip
HZ = np.arange(5.0, 120.0, 5.0)


def test_elimination_is_the_solution_of_all_equations() -> None:
    """Eight coordinates: z_F, z_T, three angles, thigh, tissue; mass by rows that carry it."""
    weight, added = 80.0, 2.3
    q = equilibrium(ARCH, weight, springs=LEG.tissue).q
    a, unit = arms(ARCH, q), np.eye(7)
    apex = np.array([1, 0, -a.l_2, -a.l_3, -a.l_4, 0, 0])
    shank = apex + unit[1]
    M, K, C = np.zeros((7, 7)), np.zeros((7, 7)), np.zeros((7, 7))
    M[:5, :5] = mass_matrix(replace(ARCH, m_T=1e-12), q)[:5, :5]
    flesh = FOOT_KG - ARCH.m_F
    carried = (
        (flesh * (1 - LEG.up), unit[0]), (flesh * LEG.up + SHANK_KG * LEG.share, apex),
        (SHANK_KG * (1 - LEG.share), shank), (THIGH_KG, shank + unit[5]), (TISSUE_KG + added, shank + unit[6]),
    )  # fmt: skip
    for mass, row in carried:
        M += mass * np.outer(row, row)
    K[2:5, 2:5] = -tangent(ARCH, q, weight, LEG.tissue)
    C[2:5, 2:5] = LEG.lag * K[2:5, 2:5]
    pad = LEG.k_F * (weight / PAD_N) ** 0.61
    for i, k, c in ((0, pad, LEG.c_F), (1, LEG.k_T, LEG.c_T), (5, LEG.k_H, LEG.c_H), (6, LEG.k_A, LEG.c_A)):
        K[i, i] += k
        C[i, i] += c
    s = 2j * np.pi * HZ[:, None, None]
    x = np.linalg.solve(s**2 * M + s * C + K, np.broadcast_to(-(M @ unit[0])[:, None], (len(HZ), 7, 1)))[..., 0]
    rows = (apex, shank, [1, 0, 0, -a.l_3, -a.l_4, 0, 0], [1, 0, 0, 0, -a.l_4, 0, 0])
    expected = [1 + s[:, 0, 0] ** 2 * (x @ np.asarray(row)) for row in rows]
    found = LEG.response(stance(ARCH, np.array(weight), LEG.tissue), weight, HZ, added)
    for one, other in zip((found.malleolus, found.tuberosity, *found.midfoot.T), expected, strict=True):
        np.testing.assert_allclose(np.ravel(one), other, rtol=1e-9, atol=1e-12)


def test_an_arch_without_bones_is_the_hindfoot_of_the_chain() -> None:
    """leg.xml, which MuJoCo and Pinocchio confirm, with a massless spring in place of the arch."""
    leg = Leg.from_model(load("leg").model, "leg")
    at = {name: i for i, name in enumerate(leg.names)}
    k, c = leg.stiffness, leg.damping
    hindfoot = at["hindfoot"]
    tiny = 1e-9
    spring = Stance(
        np.array([k[hindfoot] / tiny, 1e20, 1e20]), np.array([tiny**-0.5, 0, 0]), np.zeros(3), 0.0, np.zeros((2, 3))
    )
    shank, malleolus = leg.mass[at["talocrural"]], leg.mass[hindfoot]
    assert shank + malleolus == pytest.approx(SHANK_KG)
    same = Mounted(
        arm=1.0, slack=0.0, lag=c[hindfoot] / k[hindfoot], share=malleolus / SHANK_KG, up=0.0,
        **{f"{kind}_{mine}": values[at[joint]] for kind, values in (("k", k), ("c", c))
           for mine, joint in (("F", "fat_pad"), ("T", "talocrural"), ("H", "thigh"), ("A", "tissue"))},
    )  # fmt: skip
    for added in (0.0, 4.5):
        loaded, found = leg.with_added(added), same.response(spring, PAD_N, HZ, added)
        np.testing.assert_allclose(found.malleolus, loaded.at("malleolus", HZ), rtol=1e-6)
        np.testing.assert_allclose(found.tuberosity, loaded.at("tuberosity", HZ), rtol=1e-6)
