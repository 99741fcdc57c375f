"""Chapter 4, section 4.4: how much each constant of the arch matters, and what may be left out."""

from dataclasses import replace
from functools import cache

import numpy as np

from fasbody.arch.bones import DAMPERS, PARAMETERS, SPRINGS, Arch
from fasbody.arch.ode import STATES, jacobian, solve, state_rate
from fasbody.arch.reduction import reduce
from fasbody.arch.sensitivity import (
    OUTPUTS,
    Study,
    linear_sensitivity,
    parameter_jacobian,
    sensitivity_along,
    study,
    trajectory_sensitivity,
)
from reproduction.check import at_least, at_most, exactly, near, within
from reproduction.row import TRANSCRIBED, Outcome, Rows

ROWS = Rows()
SENSITIVITY = "python -m fasbody.arch sensitivity --lever-arm 0.015 --lever-arm 0.1"


@ROWS("Eq. 4.15-4.16", "states, constants, and the arch in state-space form")
def state_space_form() -> Outcome:
    arch = Arch.nominal()
    t = np.linspace(0, 0.1, 401)
    run = solve(arch, lambda s: 8.95 * np.sin(125 * s), t, tolerance=1e-9)
    slope = np.gradient(run.states, t, axis=0)[2:-2]
    rate = state_rate(arch, run.states, 8.95 * np.sin(125 * t))[2:-2]
    gap = np.abs(slope - rate).max(axis=0) / np.abs(rate).max(axis=0)
    return Outcome(
        printed=[
            exactly("states, the dashpot's x being massless (A_66 = 0)", len(STATES), 11),
            exactly("constants", len(PARAMETERS), 13),
            at_most("derivative of the trajectory against f, coordinates and x", float(max(*gap[:5], gap[10])), 5e-3),
        ],
    )


@cache
def along() -> tuple[np.ndarray, ...]:
    """The nominal arch along 0.1 s at 20 Hz: deviation, S, malleolus, its derivatives."""
    return sensitivity_along(Arch.nominal(), lambda t: 8.95 * np.sin(40 * np.pi * t), 0.1, 80)


@ROWS("Eq. 4.17-4.18", "first-order sensitivities and their matrix")
def sensitivity_matrix() -> Outcome:
    arch, step = Arch.nominal(), 1e-3
    runs = []
    for sign in (1, -1):
        moved = replace(arch, k_T=arch.k_T * (1 + sign * step))
        runs.append(sensitivity_along(moved, lambda t: 8.95 * np.sin(40 * np.pi * t), 0.1, 80)[2])
    S = along()[3][:, PARAMETERS.index("k_T")]
    difference = (runs[0] - runs[1]) / (2 * step * arch.k_T)
    first_row = {"printed": ("s_11", "s_11"), "right": ("s_11", "s_12")}
    return Outcome(
        printed=[
            exactly("different entries in the first row of Eq. 4.18 as printed", len(set(first_row["printed"])), 2)
        ],
        right=[
            exactly("the same corrected", len(set(first_row["right"])), 2),
            at_most(
                "d(malleolus)/d k_T against central differences, over the largest",
                float(np.abs(S - difference).max() / np.abs(S).max()),
                1e-3,
            ),
        ],
        note=TRANSCRIBED,
    )


@ROWS("Eq. 4.19", "direct differential method: S' = J S + F")
def direct_differential() -> Outcome:
    arch = Arch.nominal()
    state = solve(arch, lambda t: 8.95 * np.sin(125 * t), np.linspace(0, 0.05, 51)).states[-1]
    J, F = jacobian(arch, state, 3.0), parameter_jacobian(arch, state)
    scale = np.abs(state).max()
    by_state = []
    for i in range(11):
        h = 1e-6 * max(abs(state[i]), 1e-3 * scale)
        move = h * np.eye(11)[i]
        by_state.append((state_rate(arch, state + move, 3.0) - state_rate(arch, state - move, 3.0)) / (2 * h))
    J_differences = np.array(by_state).T
    own, exact = (
        trajectory_sensitivity(arch, 30.0, amplitude=1e-3)[-1],
        linear_sensitivity(arch, np.array([30.0]))[0, -1],
    )
    steady = float(np.abs(own - exact).max() / exact.max())
    return Outcome(
        printed=[
            at_most(
                "J against central differences, over its largest entry",
                float(np.abs(J - J_differences).max() / np.abs(J).max()),
                1e-4,
            ),
            exactly("states of F", F.shape[0], 11),
            at_most("S along a small 30 Hz vibration against the exact linear one, malleolus", steady, 0.02),
        ]
    )


@ROWS("Eq. 4.20-4.21", "relative sensitivities over time")
def relative_sensitivity() -> Outcome:
    def sampled(n: int) -> tuple[np.ndarray, np.ndarray]:
        t = 2 * np.pi * (np.arange(n) + 0.3) / n
        return np.sin(t) + np.cos(t), np.sin(t)

    quotients, norms, means = [], [], []
    for n in (101, 10_001):
        x, s = sampled(n)
        quotients.append(np.sqrt(np.mean((s / x) ** 2)))
        norms.append(np.linalg.norm(s) / np.linalg.norm(x))
        means.append(np.sqrt(np.sum(s**2)) / n)
    return Outcome(
        printed=[
            near("quotient of samples, 10,001 over 101 samples", float(quotients[1] / quotients[0]), 1, 0.05),
            near("mean (1/N) sqrt(sum), 10,001 over 101 samples", float(means[1] / means[0]), 1, 0.05),
        ],
        right=[near("quotient of norms, 10,001 over 101 samples", float(norms[1] / norms[0]), 1, 1e-3)],
    )


@cache
def draws(lever_arm_m: float | None) -> Study:
    """Thirty arches from Table 4.2."""
    *_, last = study(lever_arm_m=lever_arm_m)
    return last


@ROWS("Table 4.2", "ranges of the thirteen constants for the random draws", SENSITIVITY)
def table_4_2() -> Outcome:
    rng = np.random.default_rng(0)
    values = np.array([[getattr(arch, name) for name in PARAMETERS] for arch in (Arch.draw(rng) for _ in range(300))])
    k, c = values[:, : len(SPRINGS)], values[:, len(SPRINGS) :]
    return Outcome(
        printed=[
            within("smallest spring", k.min(), 1e4, 3e6), within("largest spring", k.max(), 1e4, 3e6),
            within("smallest damper", c.min(), 1e2, 3e3), within("largest damper", c.max(), 1e2, 3e3),
            exactly("springs and dampers", len(SPRINGS + DAMPERS), 13),
        ],
        note="The table gives no unit for the rotational constants; see Fig. 4.3.",
    )  # fmt: skip


@ROWS("Fig. 4.3", "relative sensitivity of the malleolus: k_T, c_T, k_F, c_F dominate", SENSITIVITY)
def dominating_constants() -> Outcome:
    literal, by_arm = draws(None).holds("malleolus").sum(), draws(0.015).holds("malleolus").sum()
    return Outcome(
        printed=[at_least("draws of 30 in which the four lead, rotational constants in N m/rad", literal, 26)],
        note=f"Read as N/m at the 15 mm arm of a real joint they lead in {by_arm}: the table leaves the unit open.",
    )


@ROWS("Finding 4.4, 1", "the segments of the arch hardly move, so that its ligaments do not matter", SENSITIVITY)
def arch_does_not_matter() -> Outcome:
    literal = draws(None)
    springs = [PARAMETERS.index(name) for name in ("k_11", "k_12", "k_2", "k_3", "k_4")]
    at_malleolus = literal.values[:, OUTPUTS.index("malleolus")]
    share = at_malleolus[:, springs].max(axis=1) / at_malleolus[:, PARAMETERS.index("k_T")]
    angles = [int(literal.holds(name).sum()) for name in ("theta_2", "theta_3", "theta_4")]
    mean = linear_sensitivity(Arch.nominal())[:, OUTPUTS.index("malleolus")].mean(axis=0)
    of = dict(zip(PARAMETERS, mean, strict=True))
    inside = max(of[name] for name in ("k_11", "k_12", "k_2", "k_3", "k_4")) / of["k_T"]
    four = "draws of 30 in which k_T, c_T, k_F, c_F lead"
    return Outcome(
        printed=[
            at_least(f"{four}, Table 4.2 read literally (N m/rad)", literal.holds("malleolus").sum(), 26),
            at_most(
                "sensitivity of the malleolus to a spring of the arch over that to k_T, largest of all",
                share.max(),
                0.1,
            ),
        ],
        note=f"For the small turns of the arch itself they lead in {max(angles)} draws at most: its own springs do. "
        "Table 4.2 gives the rotational constants no unit. Read as N/m, which it does not print, at a lever of "
        f"15 mm the four lead in {draws(0.015).holds('malleolus').sum()} draws, of 100 mm in "
        f"{draws(0.1).holds('malleolus').sum()}; in this project's nominal arch a spring of the arch reaches "
        f"{inside:.2f} of k_T. Only 1e4 N m/rad and more make the arch rigid (docs/sensitivity.md).",
    )


@ROWS("Finding 4.4, 2", "the five bodies may be replaced by two masses", "python -m fasbody.arch reduction")
def reduction() -> Outcome:
    result = reduce()
    medians = {arm: float(np.median(values)) for arm, values in result.differences.items()}
    others = ", ".join(f"{100 * medians[a]:.2g} % at {1e3 * a:g} mm" for a in medians if a is not None)
    name, five, two = result.examples[0]
    nominal = float(np.median(np.abs(five - two) / two))
    return Outcome(
        printed=[
            at_most("median difference of |T|, Table 4.2 read literally (N m/rad)", 100 * medians[None], 5, "%"),
        ],
        note=f"Read as N/m, which the table does not print: {others}; {name} arch of this project: {100 * nominal:.0f} "
        "%. There a fitted two-mass foot still describes the malleolus; its k_T and k_F contain the arch.",
    )
