"""The tissue arch against energy, one joint on paper, many at once against one by one, and Ker's curves."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import deformations, rest
from fasbody.arch.load import equilibrium, load_study
from fasbody.exceptions import ModelError, SettingError, SimulationError
from simulator.mounted import poses
from simulator.tissue import Tissue

ARCH = Arch.nominal()
TISSUE = Tissue(arm=0.038, slack=2.5e-3)


def test_laws_begin_at_rest_and_never_give_way() -> None:
    e, d = np.linspace(-2e-3, 9e-3, 200), np.linspace(-0.3, 0.3, 201)
    tension, moment = TISSUE.tension(e), TISSUE.moment(3, d)
    assert (tension[e <= TISSUE.slack] == 0).all() and (np.diff(tension) >= 0).all() and tension[-1] > 500
    assert moment[100] == 0 and (np.diff(moment) > 0).all()
    np.testing.assert_allclose(moment, -moment[::-1])


def test_fascia_is_as_stiff_as_its_paper_says() -> None:
    """Natali's law at 1, 2 and 4 % of 146 mm, by its derivative on paper: d(sigma / l) / dl A / L."""
    for strain, published in ((0.01, 176e3), (0.02, 217e3), (0.04, 339e3)):
        assert TISSUE.tangent(np.array(TISSUE.slack + strain * 0.146)) == pytest.approx(published, rel=0.06)
    assert TISSUE.tangent(np.array(1e-3)) == 0


def test_equilibrium_of_tissue_minimises_the_energy() -> None:
    load = 683.0

    def energy(angles: np.ndarray) -> float:
        q = rest(ARCH)
        q[2:5] = angles
        d = deformations(ARCH, q)
        stored = quad(lambda x: float(TISSUE.tension(np.array(x))), 0, float(d.e), points=[TISSUE.slack])[0]
        for joint, turn in ((2, d.d_2), (3, d.d_3), (4, d.d_4)):
            stored += quad(lambda x, j=joint: float(TISSUE.moment(j, np.array(x))), 0, float(turn))[0]
        return stored + load * float(np.cos(angles) @ [ARCH.L_2, ARCH.L_3, ARCH.L_4])

    start = rest(ARCH)[2:5]
    options = {"xatol": 1e-8, "fatol": 1e-11, "maxiter": 3000}
    best = minimize(energy, start, method="Nelder-Mead", options=options)
    np.testing.assert_allclose(equilibrium(ARCH, load, springs=TISSUE).q[2:5], best.x, atol=2e-5)


def test_the_apex_obeys_the_lever_of_a_truss() -> None:
    """W x1 x2 / l = T h + M_2, whatever the forefoot does."""
    load = 500.0
    found = equilibrium(ARCH, load, springs=TISSUE)
    d = deformations(ARCH, found.q)
    height = ARCH.height_0 - found.sag
    behind = np.sqrt(ARCH.L_1**2 - height**2)
    whole = ARCH.l_0 + found.elongation
    ligaments = float(TISSUE.moment(2, d.d_2)) + float(TISSUE.tension(d.e)) * height
    assert load * behind * (whole - behind) / whole == pytest.approx(ligaments, rel=1e-9)


def test_linear_springs_are_the_arch_as_it_was() -> None:
    plain, given = equilibrium(ARCH, 300.0), equilibrium(ARCH, 300.0, springs=ARCH)
    np.testing.assert_array_equal(plain.q, given.q)


def test_many_at_once_are_one_by_one_and_the_collapsed_are_told() -> None:
    loads = np.array([42.0, 347.0, 3000.0])
    q, stands = poses(ARCH, loads, TISSUE)
    assert stands.all()
    for row, load in zip(q, loads, strict=True):
        np.testing.assert_allclose(row[2:5], equilibrium(ARCH, load, springs=TISSUE).q[2:5], atol=1e-11)
    low = ARCH.with_height(0.02)
    _, stands = poses(low, np.array([500.0, 3000.0]), low)
    assert stands.tolist() == [True, False]
    with pytest.raises(SimulationError):
        equilibrium(low, 3000.0)


def test_no_load_is_the_limit_of_a_small_one() -> None:
    for springs in (None, TISSUE):
        none, small = equilibrium(ARCH, 0.0, springs=springs), equilibrium(ARCH, 1e-3, springs=springs)
        assert none.sag == 0 and np.isfinite(vars(none)["share"])
        assert none.share == pytest.approx(small.share, abs=1e-6)
        assert none.stiffness == pytest.approx(small.stiffness, rel=1e-4)
    with pytest.raises(SettingError, match="zero or more"):
        equilibrium(ARCH, -1.0)


def test_a_mass_that_nobody_measured_has_no_range() -> None:
    study = load_study(ARCH, (0.0, 1.0))
    assert np.isnan(study.cases[1].factor)
    assert study.sheet().rows[1][2] == ""
    assert study.plot("load_resonance") is not None


def test_refused_sizes() -> None:
    with pytest.raises(ModelError, match="arm"):
        Tissue(arm=0.0, slack=0.0)
    with pytest.raises(ModelError, match="slack"):
        Tissue(arm=0.03, slack=-1e-3)
