"""Chapter 2: equations, Table 2.1 and figures; its statements are in chapter2_findings.py and chapter2_trends.py."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from fasbody.foot.shaker import PEAK_TO_PEAK
from fasbody.presentation import picture
from fasbody.recording.condition import SUBJECTS
from fasbody.recording.harmonics import fit_harmonics
from fasbody.transmissibility import figures, sdof
from fasbody.transmissibility.findings import LOADS, POSTURES
from fasbody.transmissibility.spectra import cross_covariance, cross_spectrum, lowpass, peak_to_peak
from fasbody.transmissibility.table import Condition
from reproduction.check import at_least, at_most, exactly, near
from reproduction.row import TRANSCRIBED, Outcome, Rows
from reproduction.virtual import (
    STUDY,
    STUDY_COMMAND,
    bundled,
    exact_table,
    study_table,
)

ROWS = Rows()


@ROWS("Eq. 2.1", "transmissibility as the ratio of two peak-to-peak values after the 100 Hz filter")
def peak_to_peak_ratio() -> Outcome:
    t = np.arange(10_000) / 1000
    base, output = 8.95 * np.sin(2 * np.pi * 20 * t), 1.25 * 8.95 * np.sin(2 * np.pi * 20 * t - 0.6)
    clean = peak_to_peak(output, base, 1000.0, frequency_hz=20.0)
    rng = np.random.default_rng(0)
    noisy = [x + rng.normal(0, 0.18, t.size) for x in (base, output)]
    biased = peak_to_peak(noisy[1], noisy[0], 1000.0)
    fitted = [fit_harmonics(t, x, 20.0, 1).amplitudes[0] for x in noisy]
    return Outcome(
        printed=[
            near("ratio of two known sines, 50 samples a period", clean, 1.25, 5e-3),
            near("the same with 2 % noise, peak to peak", biased, 1.25, 0.02),
        ],
        note=f"The sine fit that this project uses instead gives {abs(fitted[1] / fitted[0]):.5f} with the noise.",
    )


@ROWS("Eq. 2.2", "cross-spectrum from the cross-covariance; its phase is the phase shift")
def cross_spectrum_phase() -> Outcome:
    used, defined = {"n", "alpha_0", "k", "dt"}, {"n", "omega_0", "k", "dt"}
    t = np.arange(2000) / 1000
    x, y = np.sin(2 * np.pi * 20 * t), np.sin(2 * np.pi * 20 * t - 0.7)
    phase = np.angle(cross_spectrum(x, y, 1000.0, 20.0))
    return Outcome(
        printed=[exactly("symbols in the equation that the text does not define", len(used - defined), 0)],
        right=[near("phase with omega_0 for alpha_0, lag of 0.7 rad", phase, -0.7, 1e-6, "rad")],
        note=TRANSCRIBED,
    )


@ROWS("Eq. 2.3", "cross-covariance of two recordings")
def covariance() -> Outcome:
    rng, N, k = np.random.default_rng(0), 64, 5
    x, y = rng.normal(size=(2, N))
    x, y = x - x.mean(), y - y.mean()
    direct = sum(x[i] * y[i + k] for i in range(N - k)) / N
    return Outcome(
        printed=[at_most("last sample that the printed sum asks for, of 0 to 63", (N - k) + k, N - 1)],
        right=[
            near("covariance at lag 5 less the direct sum to N - 1 - k", cross_covariance(x, y)[k] - direct, 0, 1e-12)
        ],
    )


@ROWS("Eq. 2.4, Fig. 2.9", "motion of a single mass on spring and damper over a moved base")
def single_mass() -> Outcome:
    m, c, k, omega = 4.3, 400.0, 6e4, 2 * np.pi * 20

    def rates(t: float, s: np.ndarray) -> list[float]:
        y_i, v_i = np.sin(omega * t), omega * np.cos(omega * t)
        return [s[1], -(c * (s[1] - v_i) + k * (s[0] - y_i)) / m]

    t = np.arange(0.75, 1.0, 1e-3)
    run = solve_ivp(rates, (0, 1), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-12)
    amplitude = abs(fit_harmonics(t, run.y[0], 20.0, 1).amplitudes[0])
    exact = abs(sdof.response(np.array([omega]), m, c, k)[0])
    return Outcome(printed=[near("integrated amplitude over the closed form", amplitude / exact, 1, 1e-6)])


@ROWS("Eq. 2.5", "transmissibility of the single mass")
def single_mass_transmissibility() -> Outcome:
    m, c, k, omega = 4.3, 400.0, 6e4, 2 * np.pi * 20
    top = k**2 + (omega * c) ** 2
    as_printed = np.sqrt(top / ((k - m * omega) ** 2 + (omega * c) ** 2))
    exact = abs(sdof.response(np.array([omega]), m, c, k)[0])  # straight from Eq. 2.4
    return Outcome(
        printed=[near("as printed, 20 Hz, 4.3 kg, 400 N s/m, 60 kN/m", as_printed, exact, 1e-3)],
        right=[near("with omega squared", float(sdof.transmissibility(omega, m, c, k)), exact, 1e-9)],
    )


@ROWS("Table 2.1", "age, height and mass of the twenty subjects, with mean, deviation and extremes")
def subjects() -> Outcome:
    age, mass = (np.array([getattr(s, name) for s in SUBJECTS.values()]) for name in ("age_yr", "mass_kg"))
    return Outcome(
        printed=[
            near("printed mean age 22.30 less that of the rows", 22.30 - age.mean(), 0, 0.005, "yr"),
            near("printed mean mass 70.70 less that of the rows", 70.70 - mass.mean(), 0, 0.005, "kg"),
            near("printed largest mass 86.18 less that of the rows", 86.18 - mass.max(), 0, 0.005, "kg"),
        ],
        right=[
            near("mean age", age.mean(), 22.35, 0.005, "yr"),
            near("mean mass", mass.mean(), 70.69, 0.005, "kg"),
            near("largest mass (subject 12)", mass.max(), 88.00, 0.005, "kg"),
            near("deviation of the mass", mass.std(ddof=1), 11.44, 0.1, "kg"),
        ],
    )


@ROWS("Fig. 2.1-2.2", "the shaker, the accelerometers and the three postures", command="python -m fasbody.laboratory S")
def set_up() -> Outcome:
    recording = bundled()[2]
    base = float(np.ptp(lowpass(recording.base_m_s2, recording.rate_hz)[100:-100]))
    return Outcome(
        printed=[
            near("sampling rate of a virtual recording", recording.rate_hz, 1000, 1e-6, "Hz"),
            near("peak to peak of the table at 20 Hz", base, PEAK_TO_PEAK, 0.3, "m/s^2"),
            exactly("frequencies from 10 to 50 Hz", len(bundled()), 9),
            exactly("postures of the virtual study", len({posture for posture, _ in study_conditions()}), 3),
        ],
        synthetic=True,
    )


def study_conditions() -> Sequence[Condition]:
    """The five conditions of Chapter 2."""
    return [*LOADS, *POSTURES[1:]]


def curves_of_subjects(pair: str, conditions: Sequence[Condition]) -> Outcome:
    """Figures with one curve a subject: nothing is missing, and recordings give what the transfer functions say."""
    table = study_table()
    shown = [table.curves(pair, *condition) for condition in conditions]
    exact = [exact_table().curves(pair, *condition) for condition in conditions]
    gaps = np.concatenate([np.abs(a.T / b.T - 1).ravel() for a, b in zip(shown, exact, strict=True)])
    turns = np.concatenate([_turn(a.phase_deg - b.phase_deg).ravel() for a, b in zip(shown, exact, strict=True)])
    picture(figures.subjects(table, pair, conditions), "svg")  # it can be drawn
    missing = sum(int(np.isnan(c.T).sum() + np.isnan(c.phase_deg).sum()) for c in shown)
    checks = [
        exactly("curves drawn", sum(len(c.subjects) for c in shown), 20 * len(conditions)),
        exactly("points missing", missing, 0),
        at_most("median gap to the transfer functions of the same subjects", 100 * np.median(gaps), 0.2, "%"),
        at_most("95th percentile of the gap in phase", np.percentile(turns, 95), 0.5, "degrees"),
    ]
    return Outcome(printed=checks, synthetic=True)


def _turn(difference_deg: np.ndarray) -> np.ndarray:
    """Size of a difference of angles, 0 to 180 degrees."""
    return np.abs((difference_deg + 180) % 360 - 180)


for _number, _pair, _conditions, _what in (
    ("Fig. 2.3", "MB", LOADS, "malleolus over base of every subject under three loads, with phase"),
    ("Fig. 2.4", "TB", LOADS, "tuberosity over base of every subject under three loads, with phase"),
    ("Fig. 2.6", "MB", POSTURES, "malleolus over base of every subject in three postures, with phase"),
    ("Fig. 2.7", "TB", POSTURES, "tuberosity over base of every subject in three postures, with phase"),
):
    ROWS.add(_number, _what, partial(curves_of_subjects, _pair, _conditions), STUDY_COMMAND, STUDY)


def mean_curves(conditions: Sequence[Condition]) -> Outcome:
    """Figures 2.5 and 2.8: means of the recordings beside those of the transfer functions of the same subjects."""
    table = study_table()
    gap = turn = 0.0
    for pair in ("MB", "TB", "TM"):
        for condition in conditions:
            own, exact = (each.curves(pair, *condition) for each in (table, exact_table()))
            gap = max(gap, float(np.abs(own.mean / exact.mean - 1).max()))
            turn = max(turn, float(_turn(own.mean_phase_deg - exact.mean_phase_deg).max()))
    picture(figures.means(table, conditions), "svg")  # it can be drawn
    return Outcome(
        printed=[
            at_most("largest gap of a mean to the transfer functions of the same subjects", 100 * gap, 0.5, "%"),
            at_most("largest gap in phase", turn, 0.5, "degrees"),
        ],
        synthetic=True,
    )


ROWS.add(
    "Fig. 2.5",
    "mean transmissibilities and phases under three loads",
    partial(mean_curves, LOADS),
    STUDY_COMMAND,
    STUDY,
)
ROWS.add("Fig. 2.8", "the same in three postures", partial(mean_curves, POSTURES), STUDY_COMMAND, STUDY)


def damping_for(T: float, omega: float, m: float, k: np.ndarray) -> np.ndarray:
    """Damping c [N s/m] that gives transmissibility T at stiffness k (n,) [N/m], by Eq. 2.5; NaN where none does."""
    above = k**2 - T**2 * (k - m * omega**2) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = above / (omega**2 * (T**2 - 1))
        return np.where(squared >= 0, np.sqrt(np.maximum(squared, 0)), np.nan)


@ROWS("Fig. 2.10", "lines of equal transmissibility of the single mass over stiffness and damping")
def contour_lines() -> Outcome:
    omega, worst, points = 2 * np.pi * 20, 0.0, 0
    k = np.geomspace(1e3, 4e5, 400)
    for T in (0.6, 0.8, 1.2, 1.5, 2.0):
        c = damping_for(T, omega, sdof.MASS_KG, k)
        there = np.isfinite(c) & (c > 0)
        again = sdof.transmissibility(omega, sdof.MASS_KG, c[there], k[there])
        worst, points = max(worst, float(np.abs(again / T - 1).max())), points + int(there.sum())
    return Outcome(
        printed=[
            at_most("T on its own contour, largest deviation", worst, 1e-9),
            at_least("points on contours", points, 200),
        ],
        note="Drawn with the corrected Eq. 2.5; the printed one has no resonance.",
    )
