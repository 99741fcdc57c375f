"""Chapter 4, section 4.3: the linear equations of the arch and its output."""

from functools import partial

import numpy as np

import mjcf
from fasbody.arch import lagrange, linear
from fasbody.arch.bones import DAMPERS, SPRINGS, Arch
from fasbody.arch.kinematics import arms, rest
from fasbody.arch.ode import malleolus_acceleration, solve
from reproduction import printed
from reproduction.arch_energies import (
    differing,
    mass_from_energy,
    only,
    printed_damping,
    printed_stiffness,
)
from reproduction.check import at_least, at_most, exactly, within
from reproduction.row import Outcome, Rows

ROWS = Rows()
ARCH = Arch.draw(np.random.default_rng(0))


@ROWS("Eq. 4.12, mass", "mass matrix of the linear equations")
def linear_mass() -> Outcome:
    A, M = mass_from_energy(ARCH, rest(ARCH)), linear.linearise(ARCH).M[:5, :5]
    return Outcome(
        printed=[at_most("every M_ij against the energies, over that entry", float(np.abs(M / A - 1).max()), 1e-9)]
    )


@ROWS("Eq. 4.12, damping", "damping matrix of the linear equations, against the deformations behind the printed forces")
def linear_damping() -> Outcome:
    wrong = {
        name: differing(printed.linear(only(ARCH, name))[0], printed_damping(only(ARCH, name))) for name in DAMPERS
    }
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
    stray = printed.linear(only(ARCH, "c_T"))[1]  # the bracket of K_33 that has lost its k_11
    alone = {name: only(ARCH, name) for name in SPRINGS}
    wrong = {name: differing(printed.linear(arch)[1] - stray, printed_stiffness(arch)) for name, arch in alone.items()}
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

    def table(amplitude: float, at: float) -> float:
        return amplitude * float(np.sin(omega * at))

    for amplitude in (1e-3, 8.95):
        run = solve(arch, partial(table, amplitude), t, tolerance=1e-9)
        exact = malleolus_acceleration(arch, run.states, amplitude * np.sin(omega * t))
        last = t > 0.4
        z = np.exp(-1j * omega * t[last])
        ratio = abs(np.sum(exact[last] * z) / np.sum(amplitude * np.sin(omega * t[last]) * z))
        gap.append(abs(ratio / abs(linear.transmissibility(arch, np.array([20.0]))[0]) - 1))
    height = run.q[:, 0] + run.q[:, 1] + arms(arch, run.q).E_2
    spline = np.gradient(np.gradient(height, t), t) + 8.95 * np.sin(omega * t)
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
