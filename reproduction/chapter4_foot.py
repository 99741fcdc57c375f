"""Chapter 4, section 4.4: dampers of pads and joints, and the two-mass foot."""

import numpy as np
from scipy.integrate import quad, solve_ivp

from fasbody.foot import damper, shaker
from fasbody.foot.model import load
from fasbody.foot.simulate import simulate
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import TwoDof
from reproduction.check import at_most, exactly, near
from reproduction.row import Outcome, Rows

ROWS = Rows()
FOOT = TwoDof(1.31e5, 9.4e4, 165.0, 90.0, 140.0, 310.0, -120.0, 180.0, 3.374, 1.052)


@ROWS("Eq. 4.22", "quasi-linear viscoelastic pad")
def viscoelastic_pad() -> Outcome:
    c, tau_1, tau_2 = 0.3, 0.01, 1.0
    gaps = []
    for t in (0.0, 0.05, 0.5):
        spectrum = quad(lambda u, t=t: np.exp(-t / np.exp(u)), np.log(tau_1), np.log(tau_2))[0]
        exact = (1 + c * spectrum) / (1 + c * np.log(tau_2 / tau_1))
        gaps.append(abs(damper.relaxation(t, c, tau_1, tau_2) / exact - 1))
    return Outcome(printed=[at_most("relaxation function against quadrature", max(gaps), 1e-4)])


@ROWS("Eq. 4.23", "nonlinear spring and nonlinear damper")
def power_law_pad() -> Outcome:
    slow, fast = (damper.power_law(0.2, rate, 2.0, 3.0, 4.0, 1.0, 0.5) - 2.0 * 0.2**3 for rate in (0.1, 0.4))
    exponents = {"printed": {"k", "m"}, "defined": {"k", "m", "n"}}
    return Outcome(
        printed=[
            exactly(
                "exponents that the text names and the equation never uses",
                len(exponents["defined"] - exponents["printed"]),
                0,
            )
        ],
        right=[near("growth of the damper's force with four times the rate, n = 0.5", fast / slow, 2, 1e-9)],
    )


@ROWS("Eq. 4.24-4.25", "linear spring with a damper that grows with strain, and c = c_1 exp(-c_2 x) cos(c_3 x)")
def nonlinear_dampers() -> Outcome:
    x = np.array([-2e-3, 0.0, 3e-3])
    own = np.array([damper.damping(v, 310.0, -120.0, 180.0) for v in x])
    strain = damper.strain_damper(0.1, 0.5, 4.0, 3.0)
    return Outcome(
        printed=[
            at_most(
                "c(x) against the formula",
                float(np.abs(own / (310 * np.exp(120 * x) * np.cos(180 * x)) - 1).max()),
                1e-12,
            ),
            near("pad at strain 0.1 and rate 0.5", strain, 4.0 * 0.1 + 3.0 * 0.1 * 0.5, 1e-12, "N"),
        ]
    )


@ROWS("Eq. 4.26-4.29, Fig. 4.4", "the two-mass foot in absolute and in relative coordinates")
def two_masses() -> Outcome:
    omega, m_S, m_F = 2 * np.pi * 20, FOOT.m_S, FOOT.m_F

    def absolute(t: float, s: np.ndarray) -> list[float]:  # Eq. 4.26, base moved
        y_0, v_0 = -8.95 / omega**2 * np.sin(omega * t), -8.95 / omega * np.cos(omega * t)
        f_T, f_F = FOOT.forces(np.array([s[0] - s[1], s[1] - y_0, s[2] - s[3], s[3] - v_0]))
        return [s[2], s[3], -f_T / m_S, (f_T - f_F) / m_F]

    t = np.linspace(0, 0.3, 301)
    v_0 = -8.95 / omega
    y = solve_ivp(absolute, (0, 0.3), [0, 0, v_0, v_0], t_eval=t, rtol=1e-10, atol=1e-14, method="DOP853").y
    z = solve_ivp(
        lambda s, x: FOOT.rates(s, x, 8.95 * np.sin(omega * s)),
        (0, 0.3),
        np.zeros(4),
        t_eval=t,
        rtol=1e-10,
        atol=1e-14,
        method="DOP853",
    ).y
    gap = np.abs((y[0] - y[1]) - z[0]).max() / np.abs(z[0]).max()
    motion = shaker.sine(20.0, 0.3)
    step = 2.5e-4
    rollout = simulate(
        load("two_dof").with_values({name: getattr(FOOT, name) for name in vars(FOOT)}), motion, step=step
    )
    twin, *_ = trajectory(
        np.zeros(4), FOOT.theta, m_S, m_F, motion.half_steps(step, rollout.malleolus.shape[1]), step, 1, 0
    )
    mujoco = np.abs(rollout.malleolus[0] - twin).max() / np.abs(twin).max()
    return Outcome(
        printed=[
            at_most("z_1 from Eq. 4.26 against Eq. 4.29, over the peak", float(gap), 1e-7),
            at_most(
                "MuJoCo stepping mjcf/two_dof.xml against the compiled equations, over the peak", float(mujoco), 1e-6
            ),
        ]
    )


@ROWS("Eq. 4.30-4.31", "the same in state space, with the malleolus as output")
def two_mass_state_space() -> Outcome:
    f = np.linspace(1, 100, 200)
    s = 2j * np.pi * f
    k_T, k_F, c_T, c_F, m_S, m_F = FOOT.k_T, FOOT.k_F, FOOT.c_11, FOOT.c_21, FOOT.m_S, FOOT.m_F
    T, F = k_T + s * c_T, k_F + s * c_F
    dynamic = np.moveaxis(np.array([[m_S * s**2 + T, -T], [-T, m_F * s**2 + T + F]]), -1, 0)
    direct = np.linalg.solve(dynamic, np.stack([0 * F, F], -1)[..., None])[:, 0, 0]
    gap = np.abs(FOOT.transmissibility(f) / direct - 1).max()
    mirror = np.abs(FOOT.mirror().transmissibility(f) / FOOT.transmissibility(f) - 1).max()
    return Outcome(
        printed=[at_most("|T| of Eqs. 4.30, 4.31 against the impedances of Eq. 4.26, 1-100 Hz", float(gap), 1e-9)],
        note=f"A second foot, stiffness and damping exchanged, has the same response to {mirror:.0e}.",
    )


@ROWS("Eq. 4.32-4.33", "nonlinear dampers of ankle and fat pad, and the model as x' = F, y = H")
def nonlinear_two_masses() -> Outcome:
    x = np.array([1e-3, -2e-3, 0.05, -0.1])
    c_T, c_F = damper.damping(x[0], 165.0, 90.0, 140.0), damper.damping(x[1], 310.0, -120.0, 180.0)
    f_T, f_F = FOOT.forces(x)
    return Outcome(
        printed=[
            near("F_T less k_T x_1 + c_T(x_1) x_3", float(f_T) - (FOOT.k_T * x[0] + c_T * x[2]), 0, 1e-9, "N"),
            near("F_F less k_F x_2 + c_F(x_2) x_4", float(f_F) - (FOOT.k_F * x[1] + c_F * x[3]), 0, 1e-9, "N"),
            near("m_S y'' + F_T", float(FOOT.m_S * FOOT.output(x) + f_T), 0, 1e-9, "N"),
        ],
        note="The text before Eq. 4.32 refers to Eq. 4.18 where Eq. 4.25 is meant.",
    )
