"""Chapter 4, sections 4.2 and 4.3: Table 4.1 and the equations of the five-body arch."""

from dataclasses import replace
from functools import cache

import numpy as np

import mjcf
from fasbody import lagrange, linear, printed
from fasbody.arch import DAMPERS, SPRINGS, Arch
from fasbody.arch_ode import malleolus_acceleration, solve
from fasbody.crosscheck import Crosscheck, compare_motion, crosscheck
from fasbody.kinematics import Array, absolute, arms, centres, closing_angle, relative, rest
from fasbody.model import load
from reproduction.arch_energies import (
    differing,
    energy_drift,
    mass_from_energy,
    printed_damping,
    printed_stiffness,
    velocity_terms_from_energy,
)
from reproduction.row import Outcome, Rows, at_least, at_most, exactly, near, within

ROWS = Rows()
CROSSCHECK = "python -m fasbody.crosscheck"
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
            exactly("bodies with mass in mjcf/foot_arch.xml", np.sum(masses > 1e-6), 5),
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
    arguments = set(["theta_1", "theta_2", "theta_3", "theta_4"])
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
    moment = np.abs(printed.spring_forces(_only("k_4"), pose()[0])[3:5]).min()
    drift = energy_drift(replace(Arch.nominal(), **dict.fromkeys(DAMPERS, 0.0) | {"c_1": 1e12}))
    return Outcome(
        printed=[at_most("moment of k_4 in Appendix B, though the sum in U ends at k_3", moment, 1e-9, "N m")],
        right=[at_most("change of T + U over 50 ms without dampers, sum to k_4, over its size", drift, 1e-5)],
    )


def _only(name: str) -> Arch:
    others = dict.fromkeys(SPRINGS + DAMPERS, 0.0) | {"c_1": 1e-300}
    return replace(ARCH, **others | {name: getattr(ARCH, name)})


@ROWS("Eq. 4.10-4.11", "Lagrange's equations of the arch, A(q) q'' = B(q, q', y_B'')", CROSSCHECK, "engines")
def equations_of_motion() -> Outcome:
    q, q_dot = pose()
    A = mass_from_energy(ARCH, q)
    B = velocity_terms_from_energy(ARCH, q, q_dot)
    ours, theirs = (lagrange.velocity_terms(ARCH, q, q_dot, as_printed=way)[:5] for way in (False, True))
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
            at_most("the same extrapolated in the step", max(m.accurate for m in runs), 1e-4),
        ]
    )


@ROWS("Eq. 4.12, mass", "mass matrix of the linear equations")
def linear_mass() -> Outcome:
    A, M = mass_from_energy(ARCH, rest(ARCH)), linear.linearise(ARCH).M[:5, :5]
    return Outcome(
        printed=[at_most("every M_ij against the energies, over that entry", float(np.abs(M / A - 1).max()), 1e-9)]
    )


@ROWS("Eq. 4.12, damping", "damping matrix of the linear equations, against the deformations behind the printed forces")
def linear_damping() -> Outcome:
    wrong = {name: differing(printed.linear(_only(name))[0], printed_damping(_only(name))) for name in DAMPERS}
    C = linear.linearise(ARCH).C
    return Outcome(
        printed=[exactly("entries that differ", sum(map(len, wrong.values())), 0)],
        right=[
            exactly("of them C_33 (c_2)", (3, 3) in wrong["c_2"], 1),
            exactly("and C_66 (c_1)", (6, 6) in wrong["c_1"], 1),
            at_least(
                "least eigenvalue of ours, over the largest",
                float(np.linalg.eigvalsh(C)[0] / np.linalg.eigvalsh(C)[-1]),
                -1e-12,
            ),
        ],
    )


@ROWS("Eq. 4.12, stiffness", "stiffness matrix and constants of the linear equations")
def linear_stiffness() -> Outcome:
    stray = printed.linear(_only("c_T"))[1]  # the bracket of K_33 that has lost its k_11
    wrong = {
        name: differing(printed.linear(_only(name))[1] - stray, printed_stiffness(_only(name))) for name in SPRINGS
    }
    rng = np.random.default_rng(0)
    draws = [Arch.draw(rng) for _ in range(200)]
    indefinite = sum(np.linalg.eigvalsh(-printed.linear(arch)[1])[0] < 0 for arch in draws)
    ours = sum(np.linalg.eigvalsh(linear.linearise(arch).K)[0] <= 0 for arch in draws)
    constants = np.abs(printed.linear(ARCH)[2][2:5]).min()
    force = np.abs(lagrange.right_hand_side(ARCH, rest(ARCH), np.zeros(6), 0.0)).max()
    return Outcome(
        printed=[
            exactly(
                "entries of K that differ from the deformations behind the printed forces",
                sum(map(len, wrong.values())),
                0,
            ),
            exactly("draws of Table 4.2, of 200, with an indefinite printed K", indefinite, 0),
            at_most("least of the static Const3 to Const5 at rest", constants, 1e-6, "N m"),
        ],
        right=[
            exactly("draws with an indefinite K of the consistent model", ours, 0),
            at_most("largest force of the consistent model at rest", force, 1e-6, "N"),
        ],
    )


@ROWS("Eq. 4.13-4.14", "acceleration of the malleolus, nonlinear and linear")
def malleolus() -> Outcome:
    arch, omega = Arch.nominal(), 2 * np.pi * 20
    t = np.linspace(0, 0.5, 4001)
    gap = []
    for amplitude in (1e-3, 8.95):
        run = solve(arch, lambda s, a=amplitude: a * np.sin(omega * s), t, tolerance=1e-9)
        exact = malleolus_acceleration(arch, run.states, amplitude * np.sin(omega * t))
        last = t > 0.4
        z = np.exp(-1j * omega * t[last])
        ratio = abs(np.sum(exact[last] * z) / np.sum(amplitude * np.sin(omega * t[last]) * z))
        gap.append(abs(ratio / abs(linear.transmissibility(arch, np.array([20.0]))[0]) - 1))
    height = lambda run: run.q[:, 0] + run.q[:, 1] + arms(arch, run.q).E_2  # noqa: E731
    spline = np.gradient(np.gradient(height(run), t), t) + 8.95 * np.sin(omega * t)
    return Outcome(
        printed=[
            at_most(
                "Eq. 4.13 against the second difference of the height, over the peak",
                float(np.abs(spline - exact)[200:-4].max() / np.abs(exact).max()),
                2e-3,
            ),
            at_most("Eq. 4.14 against Eq. 4.13, small vibration at 20 Hz", gap[0], 1e-3),
            within("the same at 8.95 m/s^2: the geometry is nearly linear", gap[1], 0, 0.02),
        ],
        note=f"Shipped model: {mjcf.path('foot_arch').name}.",
    )
