"""Chapter 3: the black-box equations on data with a known truth, Tables 3.1 and 3.2, the figures and the statements."""

from functools import cache, partial

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter, max_len_seq, ss2tf

from fasbody.foot.two_dof import TwoDof
from fasbody.recording.condition import foot_mass, shank_mass
from identification import criteria
from identification.blackbox import pem, selection, subspace
from identification.blackbox.data import Series
from identification.blackbox.keep import Single
from identification.blackbox.polynomial import STRUCTURES, Orders, PolynomialModel
from reproduction.check import at_least, at_most, exactly, near
from reproduction.row import Outcome, Rows
from reproduction.virtual import rms

ROWS = Rows()
BLACK_BOX = "python -m identification.blackbox fasbody/studies/synthetic_subject_16"
NOISE, SAMPLES, RATE = 0.25, 7000, 1e-3
#: A foot of 70.7 kg whose linear part makes the test data; its truth is what the estimates are held against.
FOOT = TwoDof(1.31e5, 9.4e4, 165.0, 0.0, 0.0, 310.0, 0.0, 0.0, shank_mass(70.7), foot_mass(70.7))
BAND = np.linspace(5, 60, 56)


@cache
def plant() -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of the sampled foot in rising powers of q^-1."""
    A, B, C = FOOT.state_space()
    block = np.zeros((5, 5))
    block[:4, :4], block[:4, 4] = A, B
    held = expm(block * RATE)
    num, den = ss2tf(held[:4, :4], held[:4, 4:], C[None], np.zeros((1, 1)))
    return num[0], den


@cache
def record(coloured: bool = False) -> Series:
    """The foot on a pseudo-random binary table; noise white, or filtered by 1 / A as ARX assumes it."""
    num, den = plant()
    base = 8.95 * np.repeat(2.0 * max_len_seq(13)[0] - 1.0, 6)[:SAMPLES]
    e = NOISE * np.random.default_rng(0).standard_normal(SAMPLES)
    return Series(base, lfilter(num, den, base) + (lfilter([1.0], den, 0.01 * e) if coloured else e), RATE)


def worst(model: Single) -> float:
    """Largest relative error of the response over 5 to 60 Hz [%]."""
    num, den = plant()
    shift = np.exp(-2j * np.pi * BAND * RATE)
    exact = np.polynomial.polynomial.polyval(shift, num) / np.polynomial.polynomial.polyval(shift, den)
    return float(100 * np.abs(model.response(BAND).value / exact - 1).max())


@cache
def output_error() -> PolynomialModel:
    """An OE model of the white record, which several rows look at."""
    return pem.estimate("oe", record(), Orders.of("oe", (4, 4, 1)))


@ROWS("Eq. 3.1-3.3, Fig. 3.2", "plant and noise filter of the general polynomial model")
def general_structure() -> Outcome:
    model = pem.estimate("bj", record(), Orders.of("bj", (4, 2, 2, 4, 1)))
    (b, af), (c, ad) = model.plant, model.noise
    series = record().cut(2000, 3000)
    e = model.residuals(series)
    through = lfilter(b, af, series.u)[-500:] + lfilter(c, ad, np.r_[np.zeros(len(series) - len(e)), e])[-500:]
    gap = rms(through - series.y[-500:]) / rms(series.y)
    return Outcome(printed=[at_most("y less G u + H e, over y (what is left is the start)", gap, 5e-3)])


@ROWS("Eq. 3.4", "the polynomials A, B, C, D, F and their orders")
def polynomials() -> Outcome:
    taps_3_4 = np.flatnonzero(np.convolve([0.5, 0.3, 0.2], [0, 1]))  # b_0 + b_1 q^-1 + b_2 q^-2 on u(t - 1)
    taps_3_5 = np.flatnonzero([0, 0.3, 0.2])  # b_1 u(t - 1) + b_2 u(t - 2)
    b = output_error().plant[0]
    return Outcome(
        printed=[exactly("taps of B for n_b = 2 in Eq. 3.4 less those in Eq. 3.5", len(taps_3_4) - len(taps_3_5), 0)],
        right=[exactly("taps of ours for n_b = 4, the first at lag n_k = 1", np.flatnonzero(b)[0] + len(b) - 1, 5)],
    )


def structure(name: str, orders: tuple[int, ...], limit: float) -> Outcome:
    """One structure on data whose noise it assumes: the response comes out."""
    series = record(coloured=name in ("arx", "armax"))
    model = pem.estimate(name, series, Orders.of(name, orders))
    fit = selection.judge(model, [series]).fit_percent
    return Outcome(
        printed=[
            at_most("largest error of the response, 5-60 Hz", worst(model), limit, "%"),
            at_least("fit in free simulation", fit, 90, "%"),
        ]
    )


for _equation, _what, _name, _orders, _limit in (
    ("Eq. 3.5", "ARX by least squares", "arx", (4, 4, 1), 1.0),
    ("Eq. 3.6", "ARMAX", "armax", (4, 4, 1, 1), 1.0),
    ("Eq. 3.7", "output error", "oe", (4, 4, 1), 1.0),
):
    ROWS.add(_equation, _what, partial(structure, _name, _orders, _limit))


@ROWS("Eq. 3.8", "Box-Jenkins")
def box_jenkins() -> Outcome:
    def impulse(last: float) -> np.ndarray:
        w = np.zeros(6)
        for t in range(6):
            w[t] = float(t == 0) - sum(d * w[t - i - 1] for i, d in enumerate((0.5, last)) if t > i)
        return w

    wanted = lfilter([1.0], [1.0, 0.5, 0.3], np.eye(6)[0])
    model = pem.estimate("bj", record(), Orders.of("bj", (4, 2, 2, 4, 1)))
    return Outcome(
        printed=[
            at_most(
                "impulse response with a_nd (no such coefficient, 0) for d_nd, error",
                np.abs(impulse(0.0) - wanted).max(),
                1e-9,
            )
        ],
        right=[
            at_most("the same with d_nd", np.abs(impulse(0.3) - wanted).max(), 1e-9),
            at_most("largest error of the estimated response, 5-60 Hz", worst(model), 1.0, "%"),
        ],
    )


@ROWS("Eq. 3.9-3.11", "state-space model in innovations form with its initial state, by a subspace method")
def state_space() -> Outcome:
    model = subspace.estimate(record(), 4, refine=True)
    fit = selection.judge(model, [record()]).fit_percent
    return Outcome(
        printed=[
            at_most("largest error of the response, 5-60 Hz", worst(model), 1.0, "%"),
            at_least("fit in free simulation", fit, 90, "%"),
            exactly("order", model.order, 4),
        ]
    )


@ROWS("Eq. 3.12-3.14", "prediction error of the one-step predictor")
def prediction_error() -> Outcome:
    rng = np.random.default_rng(0)
    e = rng.normal(size=20_000)
    y = lfilter([1.0], [1.0, -0.9], e)
    one_step, from_the_model = np.var(y[1:] - 0.9 * y[:-1]), np.var(y)
    errors = output_error().residuals(record())
    return Outcome(
        printed=[near("variance of the errors with the printed y-hat(t_{t-1}), a simulation", from_the_model, 1, 0.05)],
        right=[
            near("the same one step ahead, y-hat(t given t - 1)", one_step, 1, 0.05),
            near("deviation of the prediction errors of the foot", errors.std(), NOISE, 0.01, "m/s^2"),
        ],
    )


@ROWS("Eq. 3.15-3.16", "mean squared prediction error, and the estimate as its minimum")
def minimum_of_loss() -> Outcome:
    model = output_error()
    problem = pem.Residuals([record()], model.orders)
    steps = np.random.default_rng(1).normal(size=(40, model.spread.shape[1])) @ model.spread.T
    around = [problem.at(model.theta + step).loss for step in steps]
    errors = model.residuals(record())
    return Outcome(
        printed=[
            near("loss over the mean square of the errors", model.loss / np.mean(errors**2), 1, 0.01),
            at_least(
                "least loss at 40 points around, drawn from the covariance, over that at the estimate",
                min(around) / model.loss,
                1,
            ),
        ]
    )


@ROWS("Eq. 3.17-3.18", "final prediction error and its form for few parameters")
def final_prediction_error() -> Outcome:
    gap = abs(criteria.fpe(2.0, 5, 10_000) / criteria.fpe_of_few_parameters(2.0, 5, 10_000) - 1)
    return Outcome(
        printed=[
            near("FPE of loss 1, 10 of 100 samples", criteria.fpe(1.0, 10, 100), 1.1 / 0.9, 1e-12),
            at_most("difference of both forms at d/N = 5e-4, of order (d/N)^2", gap, 2e-6),
        ]
    )


@ROWS("Eq. 3.19", "Akaike's information criterion")
def akaike() -> Outcome:
    N, d, loss = 1000, np.array([2, 6, 12]), np.array([1.2e-4, 1.0e-4, 0.995e-4])
    units = (1.0, 9.81**2, 1e6)  # the square of three units of the output
    as_printed = {int(d[np.log(unit * loss + 2 * d / N).argmin()]) for unit in units}
    right = {int(d[criteria.aic(unit * loss, d, N).argmin()]) for unit in units}
    return Outcome(
        printed=[exactly("orders chosen in three units of the output, as printed", len(as_printed), 1)],
        right=[exactly("the same with log V + 2 d / N", len(right), 1)],
    )


@ROWS("Eq. 3.20", "fit in percent")
def fit_percent() -> Outcome:
    y = np.sin(2 * np.pi * np.arange(5000) / 50)
    model = y + 0.1 * np.random.default_rng(1).normal(size=y.size)
    with np.errstate(divide="ignore"):
        sample = 100 * (1 - np.abs(y - model) / np.abs(y - y.mean()))
    return Outcome(
        printed=[at_least("least fit of a sample with absolute values", float(np.maximum(sample.min(), -1e9)), 0, "%")],
        right=[
            near(
                "with 2-norms, 10 % noise on a sine", criteria.fit_percent(y, model), 100 * (1 - 0.1 * 2**0.5), 0.5, "%"
            )
        ],
    )


@ROWS("Table 3.1", "which polynomials each structure has")
def structures() -> Outcome:
    wanted = {"arx": {"na", "nb"}, "armax": {"na", "nb", "nc"}, "oe": {"nb", "nf"}, "bj": {"nb", "nc", "nd", "nf"}}
    wrong = sum(set(STRUCTURES[name]) - {"nk"} != orders for name, orders in wanted.items())
    return Outcome(printed=[exactly("structures with other polynomials than printed, of 4", wrong, 0)])
