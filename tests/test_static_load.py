"""Loaded equilibria against energy, the reduced ODE and published sags; resonance under added mass."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from arch_copies import compiled, high_arch, high_arch_xml
from scipy.optimize import minimize
from typer.testing import CliRunner

from fasbody.arch import lagrange, linear
from fasbody.arch.__main__ import app
from fasbody.arch.bones import Arch
from fasbody.arch.load import ARANGIO_SAG, MEASURED_HZ, equilibrium, load_study, loaded, sag_study
from fasbody.arch.ode import solve
from fasbody.arch.tree import tree_position
from fasbody.exceptions import SimulationError

NOMINAL = Arch.nominal()


def test_equilibrium_minimises_the_energy() -> None:
    """Against a general minimiser of springs plus W times the height of the apex."""
    load = 683.0

    def energy(angles: np.ndarray) -> float:
        heights = NOMINAL.L_2 * np.cos(angles[0]) + NOMINAL.L_3 * np.cos(angles[1]) + NOMINAL.L_4 * np.cos(angles[2])
        theta_1 = np.arccos(heights / NOMINAL.L_1)
        span = NOMINAL.L_1 * np.sin(theta_1)
        span += NOMINAL.L_2 * np.sin(angles[0]) + NOMINAL.L_3 * np.sin(angles[1]) + NOMINAL.L_4 * np.sin(angles[2])
        turns = np.array([theta_1 + angles[0], angles[1] - angles[0], angles[2] - angles[1]])
        rest = [
            NOMINAL.theta_10 + NOMINAL.theta_20,
            NOMINAL.theta_30 - NOMINAL.theta_20,
            NOMINAL.theta_40 - NOMINAL.theta_30,
        ]
        springs = np.array([NOMINAL.k_2, NOMINAL.k_3, NOMINAL.k_4])
        return float(NOMINAL.k_11 * (span - NOMINAL.l_0) ** 2 / 2 + springs @ (turns - rest) ** 2 / 2 + load * heights)

    start = [NOMINAL.theta_20, NOMINAL.theta_30, NOMINAL.theta_40]
    best = minimize(energy, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000})
    np.testing.assert_allclose(equilibrium(NOMINAL, load).q[2:5], best.x, atol=1e-5)


def test_stiffness_is_the_slope_of_load_against_sag() -> None:
    low, middle, high = (equilibrium(NOMINAL, load) for load in (299.0, 300.0, 301.0))
    assert middle.stiffness == pytest.approx(2 / (high.sag - low.sag), rel=1e-5)


def test_share_is_the_work_of_the_tendon_over_the_work_of_the_load() -> None:
    low, middle, high = (equilibrium(NOMINAL, load) for load in (299.0, 300.0, 301.0))
    slope = (high.elongation - low.elongation) / (high.sag - low.sag)
    assert middle.share == pytest.approx(NOMINAL.k_11 * middle.elongation * slope / 300, rel=1e-5)
    assert equilibrium(replace(NOMINAL, k_11=0.0), 300).share == 0


def test_loaded_pose_is_where_the_ode_settles() -> None:
    final = solve(NOMINAL, lambda t: 0.0, np.array([0.0, 3.0]), gravity=9.81, tolerance=1e-7)
    residual = lagrange.right_hand_side(NOMINAL, final.q[-1], np.zeros(6), 9.81)
    assert np.abs(residual).max() < 1e-3
    about = linear.linearise(NOMINAL, final.q[-1], 9.81)
    np.testing.assert_allclose(loaded(NOMINAL).K, about.K, atol=1e-4 * about.K.max())
    np.testing.assert_allclose(about.K, about.K.T, atol=1e-6 * about.K.max())


def test_tangent_about_rest_is_the_closed_form() -> None:
    rest = np.array([0, 0, NOMINAL.theta_20, NOMINAL.theta_30, NOMINAL.theta_40, 0])
    closed, tangent = linear.linearise(NOMINAL), linear.linearise(NOMINAL, rest)
    np.testing.assert_allclose(tangent.K, closed.K, atol=1e-9 * closed.K.max())


def test_nominal_arch_sags_as_arangio_measured() -> None:
    study = sag_study(NOMINAL, np.array(list(ARANGIO_SAG)))
    whole, cut = np.array(list(ARANGIO_SAG.values())).T
    np.testing.assert_allclose(study.sag_cut, cut, rtol=0.07)
    np.testing.assert_allclose(study.sag, whole, rtol=0.08)
    assert study.elongation_cut[1] / study.elongation[1] - 1 == pytest.approx(0.40, abs=0.04)


def test_fascia_share_and_gefens_spring() -> None:
    assert equilibrium(NOMINAL, 683.0).share == pytest.approx(0.12, abs=0.005)
    gefen = equilibrium(replace(NOMINAL, k_11=170e3), 683.0)  # never yielding
    assert gefen.share == pytest.approx(0.68, abs=0.005)
    assert gefen.sag == pytest.approx(3.4e-3, abs=0.05e-3)  # Arangio: 8.65 mm


def test_constant_constants_lower_the_resonance_under_load() -> None:
    study = load_study(NOMINAL)
    peaks, stiffness = [case.peak_hz for case in study.cases], [case.arch_stiffness for case in study.cases]
    assert peaks[0] > peaks[1] > peaks[2]
    assert stiffness[0] > stiffness[1] > stiffness[2]
    low, high = MEASURED_HZ[0.0]
    assert low < peaks[0] < high  # unloaded it is right, loaded it moves the wrong way
    assert peaks[2] < MEASURED_HZ[4.5][0] / 2


def test_collapse_is_one_sentence() -> None:
    soft = replace(NOMINAL, k_2=1.0, k_3=1.0, k_4=1.0, k_11=0.0)
    with pytest.raises(SimulationError, match="collapses under"):
        equilibrium(soft, 5000.0)


def test_past_collapse_is_no_equilibrium() -> None:
    """The nominal 20 mm arch lies flat near 1.2 kN; Newton's method used to go on to a pose below the floor."""
    low = NOMINAL.with_height(0.02)
    assert equilibrium(low, 1000.0).sag < 0.02
    for load in (1300.0, 3000.0, 2e4):
        with pytest.raises(SimulationError, match=r"arch of 20 mm collapses under \d+ N \(at \d+ N on the way\)"):
            equilibrium(low, load)


def test_heel_and_heads_carry_what_mujoco_finds() -> None:
    """Pads and closure of the MJCF, loaded through the tibia in the pose of the equations."""
    model, load = compiled(), 400.0
    data, settled = mujoco.MjData(model), equilibrium(NOMINAL, load)
    data.qpos[1:] = tree_position(NOMINAL, settled.q)
    data.xfrc_applied[model.body("tibia").id, 1] = -load
    mujoco.mj_forward(model, data)
    stiffness = model.tendon_stiffness.reshape(model.ntendon, -1)[:2, 0]
    springs = stiffness * (data.ten_length[:2] - model.tendon_length0[:2])
    closing = data.efc_force[0] * np.array([1.0, -1.0])  # along the heel's tendon, against the heads'
    upward = closing - springs
    assert upward.sum() == pytest.approx(load, rel=1e-3)
    assert upward[0] / load == pytest.approx(settled.heel, rel=2e-3)


def test_another_model(tmp_path) -> None:
    file = tmp_path / "high.xml"
    file.write_text(high_arch_xml())
    high = Arch.from_model(high_arch())
    runs = [CliRunner().invoke(app, ["load", "--json", "--model", model]) for model in ("foot_arch", str(file))]
    nominal, edited = (json.loads(run.stdout)["sag"]["sag"] for run in runs)
    assert edited[2] == pytest.approx(equilibrium(high.with_height(0.04), 683.0).sag)
    assert edited[2] < 0.8 * nominal[2]


@pytest.mark.long
def test_command(tmp_path) -> None:
    result = CliRunner().invoke(app, ["load", "--json", "--figures", str(tmp_path)])
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert len(document["sag"]["sag"]) == 5
    assert [row["added_mass"] for row in document["load"]] == [0.0, 2.3, 4.5]
    assert (tmp_path / "sag.png").exists()
    assert (tmp_path / "load.png").exists()
