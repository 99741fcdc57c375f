"""What docs/equations.md prints is what the code computes: its formulas are evaluated and compared."""

import re

import numpy as np
import pytest
from latex import formulas, matrices, value

from docs import ROOT
from fasbody.arch import kinematics, lagrange
from fasbody.arch.bones import Arch
from fasbody.arch.linear import linearise
from fasbody.arch.ode import malleolus_output, split, state_rate
from fasbody.foot.damper import damping
from fasbody.foot.two_dof import TwoDof
from fasbody.transmissibility import sdof
from identification import criteria

FOOT = TwoDof(1.3e5, 9.4e4, 380.0, 90.0, 140.0, 760.0, -120.0, 180.0, 3.37, 1.05)
STATES = np.array([1.1e-3, -0.7e-3, 0.05, -0.04])
TABLE = 3.3  # m/s^2


@pytest.fixture(scope="module")
def arch() -> dict[str, object]:
    """A moving arch: the names of the page, and what the code makes of them."""
    bones, rng = Arch.nominal(), np.random.default_rng(4)
    states = np.zeros(11)
    states[:5] = kinematics.rest(bones)[:5] + 1e-3 * rng.standard_normal(5)
    states[5:10], states[10] = rng.standard_normal(5), 1e-3
    q, q_dot, forces = split(bones, states)
    l_2, l_3, l_4, h_2, h_3, h_4, E_1, E_2 = kinematics.arms(bones, q)
    names = {name: getattr(bones, name) for name in ("m_T", "m_1", "m_2", "m_3", "m_4", "k_12", "c_1")}
    names |= {f"{kind}_{i}": getattr(bones, f"{kind}_{i}") for kind in "LI" for i in (1, 2, 3, 4)}
    names |= {f"theta_{i}": q[i] for i in (2, 3, 4)} | {f"dtheta_{i}": q_dot[i] for i in (2, 3, 4)}
    names |= {"theta_1": kinematics.closing_angle(bones, q), "z_F": q[0], "z_T": q[1], "y_B": 0.2, "ddy_B": TABLE}
    names |= {"l_2": l_2, "l_3": l_3, "l_4": l_4, "h_2": h_2, "h_3": h_3, "h_4": h_4, "E_1": E_1, "E_2": E_2}
    names["J_1"] = (bones.m_1 * bones.L_1**2 / 4 + bones.I_1) / E_1
    names["Omega"] = names["J_1"] * E_2 / E_1 * (l_2 * q_dot[2] + l_3 * q_dot[3] + l_4 * q_dot[4]) ** 2
    names["y_F"], names["y_T"] = kinematics.absolute(bones, q, 0.2)
    names |= {f"Q_{i + 1}": forces[i] for i in range(6)}
    rate = state_rate(bones, states, TABLE)
    names |= {f"dd{name}": rate[5 + i] for i, name in enumerate(("z_F", "z_T", "theta_2", "theta_3", "theta_4"))}
    names |= {f"theta_{i}0": getattr(bones, f"theta_{i}0") for i in (2, 3, 4)}
    return {"bones": bones, "q": q, "q_dot": q_dot, "states": states, "rate": rate, "names": names}


def test_entries_of_the_nonlinear_equations(arch: dict[str, object]) -> None:
    A = lagrange.mass_matrix(arch["bones"], arch["q"])
    B = lagrange.right_hand_side(arch["bones"], arch["q"], arch["q_dot"], TABLE)
    names = arch["names"] | {f"A_{i + 1}1": A[i, 0] for i in range(5)}
    compared = []
    for left, right in formulas("4.11").items():
        kind, _, index = left.partition("_")
        if kind in ("A", "B") and index.isdigit() and left != "B_6":
            entry = A[int(index[0]) - 1, int(index[1]) - 1] if kind == "A" else B[int(index) - 1]
            assert value(right, names) == pytest.approx(entry, rel=1e-12), left
            compared.append(left)
    assert len(compared) == 15 + 5, compared


def test_positions_of_the_arch(arch: dict[str, object]) -> None:
    centres = kinematics.centres(arch["bones"], arch["q"], 0.2)
    printed = formulas("4.1")
    for body in (1, 2, 3, 4):
        assert value(printed[f"R_{body}x"], arch["names"]) == pytest.approx(centres[body, 0], rel=1e-12)
        assert value(printed[f"R_{body}y"], arch["names"]) == pytest.approx(centres[body, 1], rel=1e-12)
    names = arch["names"]
    assert value(formulas("4.7")["theta_1"], names) == pytest.approx(names["theta_1"], rel=1e-12)
    for left, right in formulas("4.8").items():
        assert value(right, names) == pytest.approx(names[left], abs=1e-14)
    ((_, right),) = formulas("4.6").items()
    assert value(right, names) == pytest.approx(arch["bones"].L_1 * np.cos(names["theta_1"]), rel=1e-12)


def test_acceleration_of_the_malleolus(arch: dict[str, object]) -> None:
    computed = malleolus_output(arch["bones"], arch["states"], arch["rate"], TABLE)
    assert value(formulas("4.13")["ddy_out"], arch["names"]) == pytest.approx(computed, rel=1e-12)
    out = linearise(arch["bones"]).out[:5] @ arch["rate"][5:10] + TABLE
    assert value(formulas("4.14")["ddy_out"], arch["names"]) == pytest.approx(out, rel=1e-12)


def test_two_mass_foot() -> None:
    names = {name: getattr(FOOT, name) for name in TwoDof.__dataclass_fields__}
    names |= {f"x_{i + 1}": x for i, x in enumerate(STATES)} | {"ddy_0": TABLE}
    names |= {"z_1": STATES[0], "z_2": STATES[1], "dz_1": STATES[2], "dz_2": STATES[3]}
    names |= {"x_T": STATES[0], "x_F": STATES[1], "dx_T": STATES[2], "dx_F": STATES[3]}
    names |= {left: value(right, names) for left, right in formulas("4.32").items()}
    forces = {left: value(right, names) for left, right in formulas("4.42").items()}
    assert [forces["F_T"], forces["F_F"]] == pytest.approx(FOOT.forces(STATES), rel=1e-13)
    rates = [value(formulas("4.29")[f"ddz_{i}"], names) for i in (1, 2)]
    assert rates == pytest.approx(FOOT.rates(0.0, STATES, TABLE)[2:], rel=1e-13)
    assert value(formulas("4.31")["ddy_1"], names) == pytest.approx(FOOT.output(STATES), rel=1e-13)
    _, matrix, _, column = matrices("4.30")
    A, B, _ = FOOT.state_space()
    linear = names | {"c_T": FOOT.c_11, "c_F": FOOT.c_21}
    np.testing.assert_allclose([[value(cell, linear) for cell in row] for row in matrix], A, rtol=1e-13)
    np.testing.assert_allclose([value(row[0], linear) for row in column], B)


def test_single_formulas() -> None:
    T = value(formulas("2.5")["T"], {"k": 6e4, "omega": 125.0, "c": 400.0, "m": 4.3})
    assert pytest.approx(sdof.transmissibility(125.0, 4.3, 400.0, 6e4), rel=1e-13) == T
    c = value(formulas("4.25")["c"], {"c_1": 380.0, "c_2": 90.0, "c_3": 140.0, "x": 2e-3})
    assert c == pytest.approx(damping(2e-3, 380.0, 90.0, 140.0), rel=1e-13)
    names = {"V": 2.5e-3, "d": 8, "N": 300}
    assert value(formulas("3.17")["FPE"], names) == pytest.approx(criteria.fpe(2.5e-3, 8, 300), rel=1e-13)
    assert value(formulas("3.18")["FPE"], names) == pytest.approx(
        criteria.fpe_of_few_parameters(2.5e-3, 8, 300), rel=1e-13
    )
    assert value(formulas("3.19")["AIC"], names) == pytest.approx(criteria.aic(2.5e-3, 8, 300), rel=1e-13)


def test_a_wrong_formula_is_found() -> None:
    wrong = formulas("2.5")["T"].replace("m\\omega^2", "m\\omega")
    names = {"k": 6e4, "omega": 125.0, "c": 400.0, "m": 4.3}
    assert value(wrong, names) != pytest.approx(sdof.transmissibility(125.0, 4.3, 400.0, 6e4), rel=0.1)


def test_every_equation_has_its_meaning_beside_it() -> None:
    page = (ROOT / "docs" / "equations.md").read_text()
    sections = [part for part in re.split(r"^(?=#+ )", page, flags=re.MULTILINE) if part.startswith("### Eq.")]
    assert len(sections) > 40
    for section in sections:
        title, _, rest = section.partition("\n")
        prose = re.sub(r"^```.*?^```$|^- .*$", "", rest, flags=re.DOTALL | re.MULTILINE)
        assert prose.strip(), f"{title} has no sentence"
