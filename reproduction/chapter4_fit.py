"""Chapter 4, section 4.5: the equations of the estimation, and the estimation itself on the bundled subject."""

from collections.abc import Mapping
from functools import cache

import numpy as np
from scipy.optimize import brentq, least_squares

from fasbody.foot.model import load
from fasbody.foot.parameters import symbol_and_unit
from fasbody.foot.shaker import samples
from fasbody.foot.stepper import trajectory
from fasbody.foot.two_dof import TwoDof
from fasbody.recording.condition import SUBJECTS, foot_mass, shank_mass
from fasbody.recording.study import BUNDLED, bundled, read_truth
from identification.criteria import fit_percent
from identification.fitting import fit_foot
from identification.result import FitResult
from reproduction.check import at_least, at_most, exactly, near, within
from reproduction.row import Outcome, Rows

ROWS = Rows()
FIT, BUNDLE = "python -m identification.fit", "bundled fit"


@cache
def result() -> FitResult:
    """All eight constants from the nine recordings of the bundled subject without load, pooled."""
    found = fit_foot(bundled().under(0.0), load("two_dof"), threads=1, departures=False)
    return found.with_source(found.source, read_truth(BUNDLED))


def predicted(values: Mapping[str, float], hertz: float) -> tuple[np.ndarray, np.ndarray]:
    """Measured and predicted malleolus of one bundled recording, its start left out; `values` by name, with delay."""
    recording = next(r for r in bundled().under(0.0) if r.condition.frequency_hz == hertz)
    foot = TwoDof.from_values({**values, **recording.condition.masses})
    time = recording.time_s - recording.time_s[0] - values["delay"]
    motion = samples(recording.time_s, recording.base_m_s2)
    step = 2.5e-4
    y, *_ = trajectory(np.zeros(4), foot.theta, foot.m_S, foot.m_F, motion.half_steps(step, 15_000), step, 1, 0)
    late = (time > 1.0) & (time < 3.5)
    return recording.malleolus_m_s2[late], np.interp(time[late], step * np.arange(y.size), y)


@ROWS("Eq. 4.34", "prediction error and cost", FIT)
def prediction_error() -> Outcome:
    truth = read_truth(BUNDLED)
    measured, own = predicted(truth, 20.0)
    V = float(np.mean((measured - own) ** 2))
    checks = [at_most("cost at the truth over the mean square of y", V / float(np.mean(measured**2)), 1e-2)]
    for factor in (0.9, 1.1):
        _, other = predicted({**truth, "k_T": factor * truth["k_T"]}, 20.0)
        moved = float(np.mean((measured - other) ** 2))
        checks.append(at_least(f"cost with {factor:g} k_T over that at the truth", moved / V, 1.05))
    return Outcome(
        printed=checks,
        synthetic=True,
        note="The print gives the parameters to the measurement and not to the prediction (errata.md); its square, the "
        "cost, is the same.",
    )


@ROWS("Eq. 4.35-4.40", "nonlinear least squares within bounds by the trust-region-reflective method")
def trust_region() -> Outcome:
    t = np.linspace(0, 1, 50)
    data = 2.0 * np.exp(-3.0 * t)

    def residual(x: np.ndarray) -> np.ndarray:
        return x[0] * np.exp(-x[1] * t) - data

    free = least_squares(residual, [1.0, 1.0], method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    held = least_squares(
        residual, [1.0, 1.0], bounds=([0, 0], [10, 2]), method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    e = np.exp(-2.0 * t)  # at the bound x_1 = 2 the other follows in closed form
    best = float(data @ e / (e @ e))
    H, g, r = np.array([[3.0, 1.0], [1.0, -1.0]]), np.array([1.0, -0.5]), 0.7

    def step(shift: float) -> np.ndarray:
        return np.linalg.solve(H + shift * np.eye(2), -g)

    lowest = -np.linalg.eigvalsh(H)[0]
    shift = brentq(lambda s: 1 / r - 1 / np.linalg.norm(step(s)), lowest + 1e-9, 1e3)  # Eq. 4.38
    s = step(shift)
    circle = r * np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 20_001)), np.sin(a)])
    q = 0.5 * np.einsum("in,ij,jn->n", circle, H, circle) + g @ circle
    curved = np.linalg.eigh(H)[1][:, 0]
    return Outcome(
        printed=[
            at_most("free minimum less the truth", float(np.abs(free.x - [2.0, 3.0]).max()), 1e-6),
            at_most("minimum at a bound less its closed form", float(np.abs(held.x - [best, 2.0]).max()), 1e-6),
            at_most(
                "q at the step of Eq. 4.38 less the least on the circle", float(0.5 * s @ H @ s + g @ s - q.min()), 1e-6
            ),
            at_most("curvature s_2' H s_2 of the direction in Eq. 4.40", float(curved @ H @ curved), -1e-9),
        ],
        note="The method itself is SciPy's; identification/optimiser.py calls it.",
    )


@ROWS("Eq. 4.41", "criterion trace(E' E W), with W the identity the sum of squares", FIT, BUNDLE)
def criterion() -> Outcome:
    E = np.random.default_rng(0).normal(size=(500, 1))
    best = result().best
    return Outcome(
        printed=[
            near("trace over the sum of squares", float(np.trace(E.T @ E) / np.sum(E**2)), 1, 1e-12),
            within(
                "weighted by the noise: chi-square per degree of freedom of the bundled fit",
                best.chi_square / best.dof,
                0.3,
                2,
            ),
        ],
        note="This project weights by the noise of each harmonic, so the sum has a distribution and errors follow.",
    )


@ROWS("Fig. 4.5", "estimation as a loop of prediction, comparison and search", FIT, BUNDLE)
def procedure() -> Outcome:
    found = result()
    return Outcome(
        printed=[
            at_least("mean fit over nine recordings", found.fit_percent, 90, "%"),
            at_least("starts", sum(int(start["evaluations"]) for start in found.starts), 8),
            at_most("harmonic balance against MuJoCo's rollout", found.twin_mujoco_difference or 0.0, 1e-4),
        ],
        synthetic=True,
    )


#: Mass of the four links of Table 4.1 together.
BONES_KG = 0.215


@ROWS("Finding 4.5, 1", "masses of foot and shank are 1.45 and 4.65 % of the body's", "python -m fasbody.laboratory S")
def segment_masses() -> Outcome:
    mean = float(np.mean([s.mass_kg for s in SUBJECTS.values()]))
    return Outcome(
        printed=[
            near(
                "mean mass of foot and shank, 4.3 kg in section 2.3.3",
                shank_mass(mean) + foot_mass(mean),
                4.3,
                0.05,
                "kg",
            ),
        ],
        note=f"Table 4.1 weighs the bones alone, {BONES_KG / foot_mass(mean):.2f} of the whole foot of section 4.5; "
        "the two do not exclude each other.",
    )


@ROWS("Finding 4.5, 2", "all eight constants come out of the recordings", FIT, BUNDLE)
def recovery() -> Outcome:
    found, wrong, scores = result(), [], []
    for key, estimate in found.parameters.items():
        truth = found.truth_of(key)
        if truth is not None and np.isfinite(estimate.std_error) and estimate.std_error > 0:
            scores.append(abs(estimate.value - truth) / estimate.std_error)
            if scores[-1] > 3:
                wrong.append(key)
    identified = sum(e.identifiability.startswith("identified") for e in found.parameters.values())
    return Outcome(
        printed=[
            exactly("estimates further than three standard errors from the truth", len(wrong), 0),
            at_least("constants with a known truth compared", len(scores), 8),
            at_least("identified to 10 %", identified, 6),
        ],
        synthetic=True,
        note=f"Nine frequencies pooled; branches: {found.verdict}.",
    )


@ROWS("Finding 4.7, 1", "the fitted model serves frequencies that were not recorded", FIT, BUNDLE)
def other_frequencies() -> Outcome:
    foot, worst = load("two_dof"), []
    for left_out in (20.0, 35.0):
        kept = [r for r in bundled().under(0.0) if r.condition.frequency_hz != left_out]
        best = fit_foot(kept, foot, starts=4, threads=1, departures=False).best
        values = foot.values() | {symbol_and_unit(key)[0]: e.value for key, e in best.parameters.items()}
        worst.append(fit_percent(*predicted(values, left_out)))
    return Outcome(
        printed=[at_least("fit at a frequency left out, 20 and 35 Hz, the lesser", min(worst), 90, "%")],
        synthetic=True,
        note="The bundled foot has the same constants at all frequencies; the thesis' subjects do not.",
    )
