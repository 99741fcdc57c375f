"""Chapter 4, sections 4.2 and 4.3: Table 4.1 and the equations of the five-body arch."""

from dataclasses import replace
from functools import cache
from inspect import signature

import numpy as np

from fasbody.arch import lagrange
from fasbody.arch.bones import DAMPERS, Arch
from fasbody.arch.crosscheck import Crosscheck, compare_motion, crosscheck
from fasbody.arch.kinematics import Array, absolute, centres, closing_angle, relative, rest
from fasbody.foot.model import load
from reproduction import printed
from reproduction.arch_energies import (
    energy_drift,
    mass_from_energy,
    only,
    velocity_terms_from_energy,
)
from reproduction.check import at_least, at_most, exactly, near
from reproduction.row import Outcome, Rows

ROWS = Rows()
CROSSCHECK = "python -m fasbody.arch crosscheck"
BODIES = ("tibia", "calcaneus_talus", "navicular", "cuneiforms", "metatarsals")
ARCH = Arch.draw(np.random.default_rng(0))


@cache
def pose() -> tuple[Array, Array]:
    """A pose and its rates, away from rest in every coordinate."""
    rng = np.random.default_rng(1)
    q = rest(ARCH) + rng.uniform(-1, 1, 6) * np.array([5e-3, 5e-3, 0.1, 0.1, 0.1, 1e-3])
    return q, rng.uniform(-3, 3, 6)


@cache
def engines() -> Crosscheck:
    """Equations, Pinocchio and MuJoCo at 300 random poses."""
    return crosscheck(samples=300)


@ROWS("Fig. 4.1-4.2", "the arch: two bodies in earlier work, five here, as drawn and as model", CROSSCHECK, "engines")
def the_model() -> Outcome:
    model = load("foot_arch").model
    masses = np.array([model.body(name).mass[0] for name in BODIES])
    return Outcome(
        printed=[
            exactly("bodies with mass in mjcf/foot_arch.xml", int(np.sum(masses > 1e-6)), 5),
            near("their mass less that of Table 4.1", masses.sum() - 2.36 - 0.215, 0, 1e-6, "kg"),
            exactly("coordinates of the equations", len(rest(ARCH)), 6),
        ]
    )


@ROWS("Table 4.1", "masses, lengths, inertias and angles of the five bodies")
def table_4_1() -> Outcome:
    arch = Arch.thesis()
    gap = arch.L_1 * np.cos(np.radians(59.7)) - arch.height_0
    m, L, inertia = (np.array([getattr(arch, f"{x}_{i}") for i in range(1, 5)]) for x in "mLI")
    return Outcome(
        printed=[
            at_most("gap that the printed angles leave in the arch", 1e6 * abs(gap), 0.5, "um"),
            at_most(
                "spread of I / (m L^2) over the bodies, one formula for all", float(np.ptp(inertia / (m * L**2))), 0.005
            ),
        ],
        right=[
            near("theta_1 that closes it", np.degrees(arch.theta_10), 59.6970, 1e-4, "degrees"),
            near("I_1, I_2 over m L^2", float(np.mean((inertia / (m * L**2))[:2])), 1 / 3, 0.003),
            near("I_3, I_4 over m L^2", float(np.mean((inertia / (m * L**2))[2:])), 1 / 12, 0.003),
        ],
        note="theta_1 follows from Eq. 4.7; the centroidal inertias are `Arch.thesis('centroidal')`.",
    )


@ROWS("Eq. 4.1-4.5", "centres of the tibia and of the four bodies of the foot")
def positions() -> Outcome:
    q, _ = pose()
    model_q = q.copy()
    R, theta_1 = centres(ARCH, model_q, 0.01), float(closing_angle(ARCH, model_q))
    y_F, _ = absolute(ARCH, model_q, 0.01)
    turns = (*q[2:5],)
    # a walk along the chain from heel to heads, link by link
    x, y, walk = -ARCH.L_1 * np.sin(theta_1), float(y_F), []
    lengths, angles = (ARCH.L_1, ARCH.L_2, ARCH.L_3, ARCH.L_4), (-theta_1, *turns)
    for L, theta, up in zip(lengths, angles, (1, -1, -1, -1), strict=True):
        dx, dy = L * abs(np.sin(theta)), up * L * np.cos(theta)
        walk.append((x + dx / 2, y + dy / 2))
        x, y = x + dx, y + dy
    return Outcome(
        printed=[at_most("largest distance from a walk along the links", float(np.abs(R[1:] - walk).max()), 1e-12, "m")]
    )


@ROWS("Eq. 4.6-4.7", "closure of the arch, and theta_1 from it")
def closure() -> Outcome:
    q, _ = pose()
    gap = ARCH.L_1 * np.cos(closing_angle(ARCH, q)) - np.cos(q[2:5]) @ [ARCH.L_2, ARCH.L_3, ARCH.L_4]
    arguments = set(signature(closing_angle).parameters)
    return Outcome(
        printed=[
            near("height of the heel over the heads", float(gap), 0, 1e-15, "m"),
            at_least("times that time stands in the constraint, called rheonomic", "t" in arguments, 1),
        ],
        right=[
            exactly("the same for a scleronomic one", "t" in arguments, 0),
            near("height of the heel over the heads", float(gap), 0, 1e-15, "m"),
        ],
    )


@ROWS("Eq. 4.8", "stretch of fat pad and ankle from the heights of table, foot and tibia")
def relative_coordinates() -> Outcome:
    q, _ = pose()
    y_F, y_T = absolute(ARCH, q, 0.02)
    z = np.array(relative(ARCH, q, y_F, y_T, 0.02))
    return Outcome(printed=[at_most("there and back again, difference", float(np.abs(z - q[:2]).max()), 1e-15, "m")])


@ROWS("Eq. 4.9", "kinetic and potential energy and dissipation")
def energies() -> Outcome:
    moment = np.abs(printed.spring_forces(only(ARCH, "k_4"), pose()[0])[3:5]).min()
    drift = energy_drift(replace(Arch.nominal(), **dict.fromkeys(DAMPERS, 0.0) | {"c_1": 1e12}))
    return Outcome(
        printed=[at_most("moment of k_4 in Appendix B, though the sum in U ends at k_3", moment, 1e-9, "N m")],
        right=[at_most("change of T + U over 50 ms without dampers, sum to k_4, over its size", drift, 1e-5)],
    )


@ROWS("Eq. 4.10-4.11", "Lagrange's equations of the arch, A(q) q'' = B(q, q', y_B'')", CROSSCHECK, "engines")
def equations_of_motion() -> Outcome:
    q, q_dot = pose()
    A = mass_from_energy(ARCH, q)
    B = velocity_terms_from_energy(ARCH, q, q_dot)
    ours, theirs = (way.velocity_terms(ARCH, q, q_dot)[:5] for way in (lagrange, printed))
    three = max(*engines().mass_matrix.values(), *engines().bias.values())
    return Outcome(
        printed=[
            at_most(
                "velocity terms of Appendix B against the energies, over the largest",
                float(np.abs(theirs - B).max() / np.abs(B).max()),
                1e-6,
            )
        ],
        right=[
            at_most("the corrected ones", float(np.abs(ours - B).max() / np.abs(B).max()), 1e-6),
            at_most(
                "mass matrix against the energies",
                float(np.abs(lagrange.mass_matrix(ARCH, q)[:5, :5] - A).max() / A.max()),
                1e-9,
            ),
            at_most("equations, Pinocchio and MuJoCo, largest difference", three, 1e-8),
        ],
        note="The energies are built from Eqs. 4.1 to 4.7 by complex steps and share nothing with Appendix B.",
    )


@ROWS(
    "Eq. 4.11, motion",
    "the nonlinear equations integrated, against MuJoCo stepping mjcf/foot_arch.xml",
    CROSSCHECK + " --dynamics",
    "engines",
)
def motion() -> Outcome:
    foot = load("foot_arch")
    runs = compare_motion(foot, Arch.from_model(foot.model, foot.name), (10.0, 30.0, 50.0))
    return Outcome(
        printed=[
            at_most(
                "malleolus at 10, 30, 50 Hz, largest difference over the peak", max(m.difference for m in runs), 1e-3
            ),
            at_most("the same extrapolated in the step", max(m.accurate for m in runs), 2e-4),
        ]
    )
