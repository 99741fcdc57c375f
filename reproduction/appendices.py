"""Appendices A to D: tables and figures of the other subjects, Appendix B entry by entry, Figure C.1."""

from functools import partial

import numpy as np

from fasbody.arch import lagrange
from fasbody.arch.bones import DAMPERS
from fasbody.arch.kinematics import arms
from reproduction import printed, published
from reproduction.arch_energies import mass_from_energy, only, printed_damping, velocity_terms_from_energy
from reproduction.chapter3_findings import ALL, BLACK_BOX, PUBLISHED, SUBJECT, panels
from reproduction.chapter4_arch import ARCH, pose
from reproduction.chapter4_sensitivity import SENSITIVITY, draws
from reproduction.check import at_least, at_most, exactly, within
from reproduction.row import Outcome, Rows
from reproduction.virtual import PER_SUBJECT

ROWS = Rows()

for _number, _hertz in enumerate((30, 35, 40, 45, 50), 1):
    _what = f"output of subject 16 at {_hertz} Hz and of five models, three loads"
    ROWS.add(f"Fig. A.{_number}", _what, partial(panels, _hertz), BLACK_BOX, SUBJECT)


def other_subject(subject: int) -> Outcome:
    """Tables A.1 to A.9: transcribed, and impossible to compute again."""
    data = published.table().query(f"subject == {subject}")
    fits = data[[f"{name}_fit" for name in ALL]].to_numpy()
    counts = np.column_stack([published.plant_parameters(data, name) for name in ALL])
    return Outcome(
        printed=[
            exactly("rows transcribed", len(data), PER_SUBJECT),
            within("least fit", fits.min(), 0, 100, "%"),
            within("largest fit", fits.max(), 0, 100, "%"),
            at_least("plant coefficients of the smallest model", counts.min(), 1),
        ],
        missing=f"the recordings of subject {subject}; the checks count what was transcribed",
    )


for _number, _subject in enumerate(range(2, 11), 1):
    _what = f"orders and fits of five structures for subject {_subject}"
    ROWS.add(f"Table A.{_number}", _what, partial(other_subject, _subject), PUBLISHED)


def relative(a: np.ndarray, b: np.ndarray, scale: float | None = None) -> float:
    """Largest difference, over the largest of the second, or over a scale."""
    return float(np.abs(a - b).max() / (np.abs(b).max() if scale is None else scale))


@ROWS("Appendix B, A", "entries of the mass matrix")
def mass_matrix() -> Outcome:
    q, _ = pose()
    exact = mass_from_energy(ARCH, q)
    as_printed, ours = (way.mass_matrix(ARCH, q)[:5, :5] for way in (printed, lagrange))
    wrong = np.abs(as_printed / exact - 1) > 1e-9
    return Outcome(
        printed=[exactly("entries of 25 that differ from the energies", wrong.sum(), 0)],
        right=[
            exactly("of them other than A_55", wrong.sum() - wrong[4, 4], 0),
            within("error of the printed A_55", 100 * (as_printed[4, 4] / exact[4, 4] - 1), 100, 130, "%"),
            at_most("largest relative difference with m_4 L_4^2 / 4", relative(ours / exact, np.ones((5, 5))), 1e-9),
        ],
        note="The printed matrix stays positive definite, so only an entry-wise comparison finds it.",
    )


@ROWS("Appendix B, B_1-B_2", "right-hand sides of z_F and z_T")
def first_two() -> Outcome:
    q, q_dot = pose()
    q_ddot = np.array([0, 0, 30.0, 20.0, -10.0, 0])
    right = float(lagrange.right_hand_side(ARCH, q, q_dot, 1.0)[0])
    as_printed = float(printed.B_1(ARCH, q, q_dot, q_ddot, 1.0))
    repaired = float(printed.B_1(ARCH, q, q_dot, q_dot, 1.0) + ARCH.k_F * (q_dot[0] - q[0]))
    exact = velocity_terms_from_energy(ARCH, q, q_dot)
    ours = lagrange.velocity_terms(ARCH, q, q_dot)
    return Outcome(
        printed=[at_most("printed B_1 against the derived, relative", abs(as_printed / right - 1), 1e-6)],
        right=[
            at_most("the same with rates for accelerations and z_F for its rate", abs(repaired / right - 1), 1e-9),
            at_most("velocity terms of B_1 and B_2 against the energies", relative(ours[:2], exact[:2]), 1e-6),
        ],
    )


def moments(row: int) -> Outcome:
    """B_3 to B_5: velocity products and dampers of one row."""
    q, q_dot = pose()
    exact = velocity_terms_from_energy(ARCH, q, q_dot)
    size = float(np.abs(exact).max())
    as_printed, ours = (way.velocity_terms(ARCH, q, q_dot)[:5] for way in (printed, lagrange))
    slips = [name for name in DAMPERS if damper_differs(row, name, q)]
    return Outcome(
        printed=[
            at_most("printed velocity terms against the energies", relative(as_printed[row], exact[row], size), 1e-6),
            exactly("dampers whose printed terms differ from the stated dashpots, of 6", len(slips), 0),
        ],
        right=[
            at_most("corrected velocity terms against the energies", relative(ours[row], exact[row], size), 1e-6),
        ],
        note=f"Dampers that differ: {', '.join(slips) or 'none'}.",
    )


def damper_differs(row: int, name: str, q: np.ndarray) -> bool:
    """Whether one damper's row of Appendix B differs from the dashpots of docs/errata.md."""
    alone = only(ARCH, name)
    exact = printed_damping(alone, q)
    as_printed = np.array([printed.damper_forces(alone, q, rate)[row] for rate in np.eye(6)])
    angles = slice(2, 5)  # the column of x is c_1 itself, beside which the others are small
    gap = np.abs(as_printed - exact[row])[angles].max()
    return bool(gap > 1e-5 * max(float(np.abs(exact[row, angles]).max()), 1e-300))


for _row, _angle in ((2, "theta_2"), (3, "theta_3"), (4, "theta_4")):
    ROWS.add(f"Appendix B, B_{_row + 1}", f"right-hand side of {_angle}", partial(moments, _row))


@ROWS("Appendix B, B_6", "right-hand side of x, the dashpot of the aponeurosis")
def dashpot() -> Outcome:
    """c_1 x' = k_12 (e - x) with e the length that the aponeurosis really gains."""
    q, _ = pose()
    a = arms(ARCH, q)
    reach = np.sqrt(a.E_1) + a.l_2 + a.l_3 + a.l_4 - ARCH.l_0
    front = ARCH.L_2 * (np.sin(q[2]) - np.sin(ARCH.theta_20))
    ours = lagrange.right_hand_side(only(ARCH, "k_12"), q, np.zeros(6), 0.0)[5] / ARCH.k_12
    return Outcome(
        printed=[
            at_most("printed elongation, navicular only, against heel to heads", float(abs(front / reach - 1)), 1e-6)
        ],
        right=[at_most("elongation in ours against heel to heads", float(abs((ours + q[5]) / reach - 1)), 1e-9)],
    )


@ROWS("Fig. C.1", "relative sensitivities of thirty random arches, case by case", SENSITIVITY + " --figures results")
def case_by_case() -> Outcome:
    literal = draws(None)
    return Outcome(
        printed=[
            exactly("cases", len(literal.values), 30),
            at_least(
                "of them with k_T, c_T, k_F, c_F leading, constants in N m/rad", literal.holds("malleolus").sum(), 26
            ),
        ],
        note="See Fig. 4.3 on the unit.",
    )
