"""Published numbers of feet: the grid against the foot, predictions, bounds against search, drops."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import deformations
from fasbody.arch.load import equilibrium
from fasbody.heel.study import HeelStudy
from reproduction.arch_validation.drop import MEASURED, RANGE, fall, falls
from reproduction.arch_validation.evidence import (
    BOUNDS,
    HEEL_M_S,
    HEEL_N,
    HEEL_SLOPES,
    KER_CUT,
    KER_ELONGATION,
    KER_WHOLE,
    NUMBERS,
    Feet,
    Statics,
    elongation,
    of,
)
from reproduction.arch_validation.proofs import Proof, drop, linear_drop, proofs, resting_drop, turned
from reproduction.arch_validation.validate import Prediction, fit, ship, validate
from reproduction.load_effect.drop import drop as stepped
from simulator.mounted import (
    PAD_N,
    PAD_POWER,
    SHIPPED,
    STANDING_N,
    Mounted,
    stance,
)
from simulator.tissue import Tissue

ARCH = Arch.nominal()
LEG = Mounted(
    arm=0.038, slack=2.5e-3, k_F=3e5, c_F=100.0, k_T=1.4e4, c_T=400.0, k_H=3.5e3, c_H=35.0, k_A=6e4, c_A=400.0,
    lag=2e-4, share=0.2, up=0.1,
)  # fmt: skip
HZ = np.arange(5.0, 120.0, 5.0)


@pytest.fixture(scope="module")
def statics() -> Statics:
    return Statics(ARCH, points=12)


def test_the_grid_is_the_foot_itself(statics: Statics) -> None:
    values = of(np.full((1, len(BOUNDS)), 0.47))
    feet, tissue = Feet(statics, values), Tissue(arm=values[0, 0], slack=values[0, 1])
    for i, weight in enumerate(statics.loads):
        exact = feet.legs.response(stance(ARCH, np.array([weight]), tissue), weight, HZ)
        np.testing.assert_allclose(feet.legs.response(feet._stood(i), weight, HZ).malleolus, exact.malleolus, rtol=0.03)
    at = equilibrium(ARCH, 683.0, springs=tissue)
    assert feet.fascia[0, 0] == pytest.approx(at.share, abs=0.02)
    assert feet.fascia[0, 2] == pytest.approx(at.heel, abs=1e-3)
    low = equilibrium(ARCH.with_height(0.06), 683.0, springs=tissue.cut())
    np.testing.assert_allclose(feet.arangio[3][0], [low.sag, low.elongation], rtol=0.02)


def test_the_shipped_set_meets_what_it_was_fitted_to() -> None:
    """And Kitaoka's fascia and the heel's lever, to which nothing was fitted."""
    feet = ship()
    missed = [n.name for n in NUMBERS if n.fitted and not n.holds(n.predict(feet)).all()]
    assert missed == []
    unfitted = {n.name: bool(n.holds(n.predict(feet)).all()) for n in NUMBERS if not n.fitted}
    assert unfitted["stiffness of the fascia at half its failure load"]
    assert unfitted["heel's share of the load"]
    assert not unfitted["sag, 20 mm arch"]  # see the bounds


def test_legs_walk_downhill_and_know_their_misfit(statics: Statics) -> None:
    shares, cost, first = fit(statics, [None], walkers=24, steps=60, seed=1, draws=600)
    assert shares.shape[0] == 1 and shares.shape[2] == len(BOUNDS) and cost.shape == shares.shape[:2]
    assert (shares >= 0).all() and (shares <= 1).all()

    def misfit(x: np.ndarray) -> np.ndarray:
        feet = Feet(statics, of(x))
        return np.sum([n.misfit(n.predict(feet)) for n in NUMBERS if n.fitted], axis=0)

    np.testing.assert_allclose(misfit(shares[0]), cost[0], rtol=1e-9)
    assert np.median(cost) < 0.7 * np.median(np.sort(misfit(first))[:24])


def test_every_number_is_predicted_without_itself() -> None:
    result = validate(walkers=8, steps=20, draws=300, points=12)
    assert len(result.predictions) == len(NUMBERS)
    assert {p.verdict for p in result.predictions} <= {"predicted", "open", "missed"}
    assert [p.basis for p in result.predictions if "heel's share" in p.number.name] == ["geometry"]
    assert [p.basis for p in result.predictions if "failure load" in p.number.name] == ["tissue"]
    assert [row[0] for row in result.sheet().rows] == [f"{n.name} ({n.source})" for n in NUMBERS]
    assert result.plot("validation") is not None
    assert result.records()[0]["number"] == NUMBERS[0].name


def test_verdicts() -> None:
    number = replace(NUMBERS[6], low=(10.0,), high=(20.0,))
    at = {"number": number, "before": 0.3, "shipped": np.array([15.0])}
    cases = (
        (12, 15, 18, 0.9, "predicted"),
        (5, 15, 40, 0.3, "open"),
        (18, 25, 30, 0.1, "open"),
        (21, 25, 30, 0.0, "missed"),
    )
    for low, middle, high, inside, verdict in cases:
        ends = (np.array([float(x)]) for x in (low, middle, high))
        low_, middle_, high_ = ends
        assert Prediction(low=low_, middle=middle_, high=high_, inside=inside, **at).verdict == verdict


def test_poses_on_paper_are_those_of_the_equations() -> None:
    found = equilibrium(ARCH, 683.0, springs=LEG.tissue)
    d = deformations(ARCH, found.q)
    pose = turned(ARCH, *(np.array(x) for x in (d.d_2, d.d_3, d.d_4)))
    assert pose.sag == pytest.approx(found.sag, abs=1e-14)
    assert pose.elongation == pytest.approx(found.elongation, abs=1e-14)
    # the arms are the slopes of the sag
    for i in range(3):
        step = [np.array(x) for x in (d.d_2, d.d_3, d.d_4)]
        ends = []
        for h in (-1e-6, 1e-6):
            moved = list(step)
            moved[i] = moved[i] + h
            ends.append(float(turned(ARCH, *moved).sag))
        assert (ends[1] - ends[0]) / 2e-6 == pytest.approx(float(pose.arms[i]), rel=1e-6)


@pytest.fixture(scope="module")
def bounds() -> list[Proof]:
    return proofs()


def test_each_bound_excludes(bounds: list[Proof]) -> None:
    assert all(proof.excluded for proof in bounds)
    assert sum("Arangio" in proof.number for proof in bounds) == 7
    assert not replace(bounds[0], bound=20.0).excluded


def test_no_foot_breaks_a_bound(bounds: list[Proof]) -> None:
    """Tissue at least as stiff as Ker's cut foot under all loads: Arangio's arches stay below what is possible."""
    most = {proof.number.removeprefix("Arangio: "): proof.bound for proof in bounds}
    for arm in (0.0405, 0.043, 0.05):
        cut = Tissue(arm=arm, slack=0.0).cut()
        assert (elongation(ARCH, KER_CUT, cut) < 1.15 * KER_ELONGATION).all()
        for height in (20, 60):
            found = equilibrium(ARCH.with_height(1e-3 * height), 683.0, springs=cut)
            assert 1e3 * found.sag < most[f"sag, {height} mm arch, fascia cut"]
            assert 1e3 * found.elongation < most[f"elongation, {height} mm arch, fascia cut"]


@pytest.mark.parametrize(("k", "c"), [(4.6e4, 192.0), (6.55e4, 270.0), (4e3, 492.0)])
def test_a_linear_pad_falls_as_the_equation_says(k: float, c: float) -> None:
    """The last one never lets go: its damping is above critical, and it has the peak and the depth, but loses all."""
    zeta = c / (2 * np.sqrt(k * 5.0))

    def fall(t: float, s: np.ndarray) -> list[float]:
        return [s[1], 9.81 - (k * s[0] + c * s[1]) / 5.0]

    def leaves(t: float, s: np.ndarray) -> float:
        return float(k * s[0] + c * s[1])

    leaves.terminal, leaves.direction = True, -1  # type: ignore[attr-defined]
    run = solve_ivp(fall, (0, 1.0), [0.0, 0.93], events=leaves, rtol=1e-10, atol=1e-12, max_step=1e-3)
    x, v = run.y
    again = np.flatnonzero(np.logical_or.accumulate(v < 0) & (v >= 0))  # where it turns down again on the pad
    end = again[0] if again.size else -1
    back = v[end] ** 2 / 2 + 9.81 * (x.max() - x[end])
    peak, depth, absorbed = (float(x[0]) for x in drop(np.array([k]), np.array([zeta])))
    assert peak == pytest.approx((k * run.y[0] + c * run.y[1]).max() / 5 / 9.81, rel=1e-3)
    assert depth == pytest.approx(run.y[0].max(), rel=1e-3)
    assert absorbed == pytest.approx(1 - back / (0.93**2 / 2 + 9.81 * x.max()), abs=4e-3)


def test_no_linear_pad_is_deeper_than_the_bound() -> None:
    """All stiffnesses and dampers, not only the softest of each damping ratio."""
    k, c = (x.ravel() for x in np.meshgrid(np.geomspace(2e3, 3e5, 80), np.linspace(5, 720, 72)))
    zeta = c / (2 * np.sqrt(k * 5.0))
    peak, depth, absorbed = drop(k, zeta)
    meets = (np.abs(peak / 11.6 - 1) <= 0.2) & (absorbed >= 0.75) & (absorbed <= 0.89)
    assert meets.sum() > 50
    assert 6e-3 < depth[meets].max() < linear_drop() < 1e-3 * MEASURED["depth_mm"][0]
    assert depth[np.abs(peak / 11.6 - 1) <= 0.2].max() > 0.8 * 11.3e-3  # the loss is what excludes it


@pytest.mark.parametrize(("k_F", "eta"), [(SHIPPED.k_F, SHIPPED.eta), (1e5, 0.4)])
def test_the_drop_is_what_mujoco_steps(k_F: float, eta: float) -> None:
    """MuJoCo's contact law, and the table that the chains look it up in."""
    found = stepped(f"1 {k_F} {PAD_N} {1 / (1 - PAD_POWER):.12g} {eta} 0 -1", step=5e-5)
    by_mujoco = [found.peak_g, found.depth_mm, found.absorbed_percent]
    np.testing.assert_allclose(fall(k_F, eta), by_mujoco, rtol=5e-4)
    for i in range(3):
        assert falls(np.array([k_F]), np.array([eta]), i)[0] == pytest.approx(by_mujoco[i], rel=1e-3)


def test_a_resting_pad_with_the_walkers_slopes_falls_too_hard() -> None:
    """All pads whose slopes lie in the walkers' range, not only the softest, and finer steps."""
    k_F, eta = (x.ravel() for x in np.meshgrid(np.geomspace(3e4, 5e4, 9), np.geomspace(*RANGE[1], 12)))
    slopes = 1e-3 * k_F[:, None] * (np.array(HEEL_N) / PAD_N) ** PAD_POWER
    meets = ((slopes >= HEEL_SLOPES[0]) & (slopes <= HEEL_SLOPES[1])).all(axis=-1)
    assert meets.sum() > 50
    peak = fall(k_F[meets], eta[meets], steps=300)[:, 0]
    assert MEASURED["peak_g"][2] < resting_drop() < peak.min() < 1.1 * resting_drop()


def test_slopes_of_the_heel_and_the_energy_absorbed_predict_peak_and_depth() -> None:
    """What docs/arch.md says of the heel alone: its two constants on a grid, evenly in their logarithms, no chain."""
    k_F, eta = (x.ravel() for x in np.meshgrid(np.geomspace(1e4, 3e5, 240), np.geomspace(*RANGE[1], 120)))
    alike = {name: np.full_like(k_F, value) for name, value in vars(LEG).items()}
    legs = replace(LEG, **alike | {"k_F": k_F, "eta": eta})
    feet = Feet.__new__(Feet)  # the heel needs no arch
    feet.legs = legs
    numbers = {n.name.split()[-1]: n for n in NUMBERS if n.source in ("Baines 2018", "Kinoshita 1993")}
    values = {name: n.predict(feet) for name, n in numbers.items()}

    def said(asked: str, *known: str) -> tuple[float, float]:
        """Median and share inside of one number, where others are known."""
        w = np.exp(-sum(numbers[name].misfit(values[name]) for name in known))
        at = np.argsort(values[asked][:, 0])
        middle = values[asked][at[np.searchsorted(np.cumsum(w[at]), w.sum() / 2)], 0]
        return float(middle), float(w[numbers[asked].holds(values[asked])].sum() / w.sum())

    slope, peak, depth, energy = "N", "peak", "depth", "absorbed"
    assert said(peak, slope, energy) == pytest.approx((13.5, 0.68), rel=0.02)
    assert said(depth, slope, energy) == pytest.approx((9.35, 0.70), rel=0.02)
    assert said(depth, slope) == pytest.approx((9.33, 0.68), rel=0.02)
    assert said(peak, slope) == pytest.approx((15.0, 0.35), rel=0.03)
    assert said(peak, depth, energy) == pytest.approx((11.6, 0.97), rel=0.02)
    assert said(slope, peak, depth, energy) == pytest.approx((31.4, 0.44), rel=0.03)
    low = {f"low {n.name.split()[-1]}": n for n in NUMBERS if "30 mm" in n.name}
    numbers |= low
    values |= {name: n.predict(feet) for name, n in low.items()}
    assert said("low depth", slope) == pytest.approx((8.7, 0.86), rel=0.02)
    assert said("low peak", slope)[1] == pytest.approx(0.21, rel=0.05)
    assert said("low absorbed", slope)[1] == pytest.approx(0.15, rel=0.05)


def test_goggins_two_peaks_are_within_the_model_class() -> None:
    """Found by a search; no bound can exclude them, though this leg misses nearly all else."""
    soft = Mounted(
        arm=0.015109, slack=0.0, k_F=325640.0, c_F=362.9, k_T=13727.0, c_T=195.04, k_H=13322.0, c_H=20.243,
        k_A=32591.0, c_A=20.38, lag=0.0014634, share=0.050167, up=0.38088,
    )  # fmt: skip
    f = np.arange(10.0, 120.0, 0.1)  # finely: a narrow peak counts, too
    found = soft.response(stance(ARCH, np.array(STANDING_N), soft.tissue), STANDING_N, f)
    peaks = [f[np.abs(np.ravel(T)).argmax()] for T in (found.malleolus, found.midfoot[..., 0], found.midfoot[..., 1])]
    goggins = {n.name: n for n in NUMBERS if n.source == "Goggins"}
    assert goggins["ankle, standing"].holds(np.array(peaks[:1]))
    assert goggins["midfoot, standing, two joints"].holds(np.array(peaks[1:]))


def test_the_heel_s_slopes_are_those_of_the_walkers() -> None:
    """What the evidence calls Baines' limits is what reproduction's row 11 found in his walkers, and the page says."""
    docs = Path(__file__).parents[2] / "docs"
    row = next(x for x in (docs / "reproduction.md").read_text().splitlines() if x.startswith("| Validation 11 |"))
    shown = re.findall(r"slope at (\d+) N, 95 %: 100 kN/m \((?:NOT )?([\d.]+) to ([\d.]+)\)", row)
    assert [float(load) for load, _, _ in shown] == list(HEEL_N)
    np.testing.assert_allclose([[float(x) for x in found[1:]] for found in shown], np.transpose(HEEL_SLOPES), rtol=5e-3)
    told = "; ".join(f"{low:.3g}-{high:.3g}" for low, high in zip(*HEEL_SLOPES, strict=True))
    assert told in (docs / "credibility.md").read_text()


def test_kers_cut_foot_follows_from_the_whole_one() -> None:
    """Arm and slack by least squares on the whole foot alone; the fascia is Natali's, its size D'Hondt's."""

    def misfit(x: np.ndarray) -> float:
        found = elongation(ARCH, KER_WHOLE, Tissue(arm=x[0] / 1e2, slack=abs(x[1]) / 1e3))
        return float((((found - KER_ELONGATION) / (3e-4 + 0.05 * KER_ELONGATION)) ** 2).sum())

    x = minimize(misfit, [3.5, 2.0], method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-2}).x
    tissue = Tissue(arm=x[0] / 1e2, slack=abs(x[1]) / 1e3)
    cut = elongation(ARCH, KER_CUT, tissue.cut())
    np.testing.assert_allclose(cut[3:], KER_ELONGATION[3:], rtol=0.1)
    assert np.abs(cut - KER_ELONGATION).max() < 0.9e-3
    with_fascia = elongation(ARCH, KER_CUT, tissue)
    assert (with_fascia[4:] < 0.95 * KER_ELONGATION[4:]).all()  # the cut is seen
    whole = elongation(ARCH, KER_CUT, replace(tissue, slack=0.0))
    assert (whole[4:] < 0.9 * KER_ELONGATION[4:]).all()  # and so is the slack


def test_heels_are_pressed_at_one_rate_where_their_slopes_are_read() -> None:
    """What the arch's evidence takes as the rate of Baines' slopes."""
    persons, study = [], HeelStudy.read()
    for (_, speed), strikes in study.groups().items():
        if speed == "normal":
            at = [[s.rate_m_s[int(np.argmax(s.force_n > load))] for load in HEEL_N] for s in strikes]
            persons.append(np.mean(at, axis=0))
    assert len(persons) == 11
    np.testing.assert_allclose(np.mean(persons, axis=0), HEEL_M_S, atol=0.006)
