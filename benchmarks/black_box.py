"""Black-box estimators against the truth, against peers and against the plain way.

Data: the sampled linear two-mass foot of examples/linear_foot.py, 7000 samples, noise 0.25 m/s^2. Times are processor
time; `OMP_NUM_THREADS=1` keeps them on one thread, and `python -m benchmarks` sets it.
"""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

sys.path.append(str(Path(__file__).resolve().parent.parent / "examples"))

import linear_foot as foot
import numpy as np
import typer

from benchmarks import black_box_cases, black_box_peers
from benchmarks.table import JsonOption, faster, report
from fasbody.console import command_line, console
from identification.blackbox import nonlinear, pem, selection, subspace
from identification.blackbox.data import Series
from identification.blackbox.keep import Single
from identification.blackbox.narx import estimate as estimate_narx
from identification.blackbox.polynomial import Orders
from reproduction.check import Check, at_most, told

SAMPLES, NOISE = 7000, 0.25
BAND = np.linspace(5, 60, 56)
INPUTS = {"PRBS": foot.prbs, "multisine": foot.multisine}
MODELS = {"oe": (4, 4, 1), "armax": (4, 4, 4, 1), "bj": (4, 2, 2, 4, 1), "ss": (4,)}


def record(base: np.ndarray, seed: int) -> Series:
    """The foot's answer to `base` with white noise."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(base))
    return Series(base, foot.linear_output(base) + noise, foot.SAMPLE_TIME)


def estimate(structure: str, series: Series) -> Single:
    """Our estimate of one structure."""
    if structure.startswith("ss"):
        return subspace.estimate(series, 4, refine=structure == "ss refined")
    return pem.estimate(structure, series, Orders.of(structure, MODELS[structure]))


def errors(value: np.ndarray) -> tuple[float, float]:
    """Largest and root-mean-square relative error of a response over 5 to 60 Hz, in percent."""
    error = 100 * np.abs(value / foot.response(BAND) - 1)
    return float(error.max()), float(np.sqrt(np.mean(error**2)))


def timed(structure: str, series: Series) -> tuple[float, float, float]:
    """Largest and rms error [%] and processor time [s] of one estimate."""
    begin = time.process_time()
    value = estimate(structure, series).response(BAND).value
    return *errors(value), time.process_time() - begin


def accuracy(seeds: int) -> Iterator[Check]:
    """Median error and time of every structure."""
    for name, excite in INPUTS.items():
        for structure in (*MODELS, "ss refined"):
            trials = [timed(structure, record(excite(SAMPLES), seed)) for seed in range(seeds)]
            largest, rms, seconds = np.median(trials, axis=0)
            what = f"{structure} on {name}: largest (rms) error of the response 5-60 Hz, median of {seeds} seeds"
            yield told(what, f"{largest:.3f} ({rms:.3f}) % in {seconds:.3f} s")


def coverage(seeds: int) -> Iterator[Check]:
    """Share of seeds in which 95 % intervals of the coefficients of B and F, and of the gain, hold the truth."""
    num, den = foot.transfer()
    truth = {
        "oe": [*num[1:], *den[1:]], "armax": [*den[1:], *num[1:]], "bj": [*num[1:], *den[1:]],
        "ss refined": [0.0, *num[1:], *den[1:]],
    }  # fmt: skip
    exact = np.abs(foot.response(BAND))
    for name, excite in INPUTS.items():
        for structure, coefficients in truth.items():
            inside, gains = [], []
            for seed in range(seeds):
                model = estimate(structure, record(excite(SAMPLES), 1000 + seed))
                plant: Any = getattr(model, "transfer", model)
                at = np.r_[0:4, 8:12] if structure == "bj" else np.arange(len(coefficients))
                inside.append(np.abs(plant.theta[at] - coefficients) < 1.96 * plant.std_error[at])
                response = model.response(BAND)
                gains.append(np.mean(np.abs(np.abs(response.value) - exact) < 1.96 * response.gain_std))
            shares, gain = 100 * np.mean(inside, axis=0), 100 * float(np.mean(gains))
            what = f"{structure} on {name}: 95 % intervals that hold the truth, {seeds} seeds"
            measured = f"gain {gain:.1f} %, plant coefficients {shares.min():.1f} to {shares.max():.1f} %"
            yield Check(what, gain, 92, 98, said=measured, beside="gain 92 to 98 %", asked=seeds >= 50)


def best_of(times: int, work: Callable[[], object]) -> float:
    """Shortest processor time [s]."""
    seconds = []
    for _ in range(times):
        begin = time.process_time()
        work()
        seconds.append(time.process_time() - begin)
    return min(seconds)


def grid(largest: int = 15) -> Iterator[Check]:
    """All ARX models with n_a, n_b, n_k = 1..largest against one `lstsq` each."""
    series = record(foot.prbs(SAMPLES), 0)
    ours = best_of(5, lambda: pem.grid(series, largest, largest, largest))
    shared = pem.grid(series, largest, largest, largest)
    first = 2 * largest - 1
    y, loss = series.y[first:], np.empty_like(shared.loss)
    begin = time.process_time()
    for place in np.ndindex(loss.shape):
        na, nb, nk = (k + 1 for k in place)
        phi, _ = pem.regressors(series, Orders(na=na, nb=nb, nk=nk), first)
        loss[place] = np.mean((y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0]) ** 2)
    plain = time.process_time() - begin
    yield faster(f"ARX grid, {loss.size} models", ours, plain, "one lstsq each")
    apart = float(np.max(np.abs(shared.loss / loss - 1)))
    yield at_most("ARX grid, largest relative difference of losses", apart, 1e-9)


def loaded_foot() -> Iterator[Check]:
    """Linear against nonlinear models on the nonlinear foot with 4.5 kg, held-out fit in free simulation."""
    for frequency in (10.0, 15.0):
        rng = np.random.default_rng(round(frequency))
        n = 10_000
        base = foot.sine(frequency, n) + 0.03 * rng.standard_normal(n)
        y = foot.nonlinear_output(frequency, n, added_mass=4.5) + 0.05 * rng.standard_normal(n)
        estimation, validation = Series(base, y, foot.SAMPLE_TIME).split()
        oe = pem.estimate("oe", estimation, Orders.of("oe", (2, 2, 1)))
        hw = nonlinear.estimate(estimation, Orders.of("oe", (2, 2, 1)), (3, 3), oe)
        linear, *others = [selection.judge(m, [validation]) for m in (oe, subspace.estimate(estimation, 2), hw)]
        for choice in (*others, estimate_narx(estimation, [validation])):
            yield told(
                f"loaded nonlinear foot, {frequency:g} Hz, {choice.model.label}: held-out fit in free simulation",
                f"{choice.fit_percent:.2f} %", f"{linear.model.label}: {linear.fit_percent:.2f} %",
                (100 - linear.fit_percent) / (100 - choice.fit_percent),
            )  # fmt: skip


def peers(timeout: float) -> Iterator[Check]:
    """The same data (seed 0) through other packages."""
    arrays: dict[str, np.ndarray] = {"band": BAND, "exact": foot.response(BAND), "sample_time": np.array(1e-3)}
    ours: dict[str, tuple[float, float, float]] = {}
    for name, excite in INPUTS.items():
        series = record(excite(SAMPLES), 0)
        arrays |= {f"{name}_u": series.u, f"{name}_y": series.y}
        ours |= {f"{name} {structure}": timed(structure, series) for structure in MODELS}
    for title, results in black_box_peers.run(arrays, timeout).items():
        if isinstance(results, str):
            console.print(f"{title} is {results}", soft_wrap=True)
            continue
        for key, theirs in results.items():
            name, structure = key.split()
            what = f"{structure} on {name}, seed 0: largest error 5-60 Hz, time; ratio of times"
            mine = f"{ours[key][0]:.3f} % in {ours[key][2]:.3f} s"
            other = theirs if isinstance(theirs, str) else f"{theirs[0]:.3f} % in {theirs[2]:.3f} s"
            ratio = None if isinstance(theirs, str) else theirs[2] / ours[key][2]
            yield told(what, mine, f"{title}: {other}", ratio)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(help="records for the medians")] = 20,
    intervals: Annotated[int, typer.Option(help="records for the coverage of the intervals")] = 100,
    with_peers: Annotated[
        bool, typer.Option("--peers/--no-peers", help="install and run SIPPY, pysib and nfoursid, too")
    ] = True,
    timeout: Annotated[float, typer.Option(help="seconds for each peer")] = 400.0,
    json_: JsonOption = False,
) -> None:
    """Compare black-box estimators with the truth and with other packages. Takes some minutes.

    Examples:
      OMP_NUM_THREADS=1 python -m benchmarks.black_box --no-peers
    """
    rows = [*accuracy(seeds), *grid(), *loaded_foot(), *coverage(intervals), *black_box_cases.rows(seeds)]
    rows += [*black_box_cases.random_plants(), *black_box_cases.several(), *black_box_cases.search_time()]
    others = [*peers(timeout), *black_box_cases.peers(timeout)] if with_peers else []
    report("black-box models", rows + others, json_)


if __name__ == "__main__":
    command_line(app)
