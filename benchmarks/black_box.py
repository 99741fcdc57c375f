"""Black-box estimators against the truth, against peers and against the plain way: python benchmarks/black_box.py.

Data: the sampled linear two-mass foot, 7000 samples, noise 0.25 m/s^2. Peers (SIPPY, pysib) are installed by pip into
an environment of their own under a temporary folder, with the versions of numpy and scipy that they want; a peer that
does not install is left out with a sentence. Times are processor time on one thread, so that a busy machine disturbs
them little.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"
ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "examples")]

import linear_foot as foot  # noqa: E402
import numpy as np  # noqa: E402

from identification.blackbox import arx, nonlinear, pem, selection, subspace  # noqa: E402
from identification.blackbox.data import Series  # noqa: E402
from identification.blackbox.narx import estimate as estimate_narx  # noqa: E402
from identification.blackbox.polynomial import Orders  # noqa: E402

SAMPLES, NOISE = 7000, 0.25
BAND = np.linspace(5, 60, 56)
INPUTS = {"PRBS": foot.prbs, "multisine": foot.multisine}
MODELS = {"oe": (4, 4, 1), "armax": (4, 4, 4, 1), "bj": (4, 2, 2, 4, 1), "ss": (4,)}
PEERS = {"sippy_unipi": "SIPPY", "pysib": "pysib"}


def record(base: np.ndarray, seed: int) -> Series:
    """The foot's answer to `base` with white noise."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(base))
    return Series(base, foot.linear_output(base) + noise, foot.SAMPLE_TIME)


def estimate(structure: str, series: Series) -> selection.Model:
    """Our estimate of one structure."""
    if structure == "ss":
        return subspace.estimate(series, 4)
    if structure == "ss refined":
        return subspace.estimate(series, 4, refine=True)
    return pem.estimate(structure, series, Orders.of(structure, MODELS[structure]))


def errors(value: np.ndarray) -> tuple[float, float]:
    """Largest and root-mean-square relative error of a response over 5 to 60 Hz, in percent."""
    error = 100 * np.abs(value / foot.response(BAND) - 1)
    return float(error.max()), float(np.sqrt(np.mean(error**2)))


def accuracy(seeds: int) -> None:
    """Median error and time of every structure."""
    print(f"\nresponse error 5-60 Hz and time, median of {seeds} seeds")
    print(f"{'input':10} {'model':11} {'largest %':>10} {'rms %':>7} {'time s':>8}")
    for name, excite in INPUTS.items():
        for structure in (*MODELS, "ss refined"):
            rows = []
            for seed in range(seeds):
                series = record(excite(SAMPLES), seed)
                begin = time.process_time()
                model = estimate(structure, series)
                rows.append((*errors(model.response(BAND).value), time.process_time() - begin))
            largest, rms, seconds = np.median(rows, axis=0)
            print(f"{name:10} {structure:11} {largest:10.3f} {rms:7.3f} {seconds:8.3f}", flush=True)


def coverage(seeds: int) -> None:
    """Share of seeds in which 95 % intervals of the coefficients of B and F hold the truth."""
    num, den = foot.transfer()
    truth = {"oe": [*num[1:], *den[1:]], "armax": [*den[1:], *num[1:]], "bj": [*num[1:], *den[1:]]}
    print(f"\n95 % intervals: share that covers the truth, {seeds} seeds, PRBS (plant coefficients; gain over 5-60 Hz)")
    exact = np.abs(foot.response(BAND))
    for structure, wanted in truth.items():
        inside, gains = [], []
        for seed in range(seeds):
            model = estimate(structure, record(foot.prbs(SAMPLES), 1000 + seed))
            at = np.r_[0:8] if structure != "bj" else np.r_[0:4, 8:12]
            inside.append(np.abs(model.theta[at] - wanted) < 1.96 * model.std_error[at])  # type: ignore[attr-defined]
            response = model.response(BAND)
            gains.append(np.mean(np.abs(np.abs(response.value) - exact) < 1.96 * response.gain_std))
        each = np.mean(inside, axis=0)
        span = f"{100 * each.min():.1f} to {100 * each.max():.1f} %"
        print(f"{structure:6} {span}; gain {100 * np.mean(gains):.1f} %", flush=True)


def best_of(times: int, work: Callable[[], object]) -> float:
    """Shortest processor time."""
    found = []
    for _ in range(times):
        begin = time.process_time()
        work()
        found.append(time.process_time() - begin)
    return min(found)


def grid() -> None:
    """All 3375 ARX models against one `lstsq` each."""
    series = record(foot.prbs(SAMPLES), 0)
    ours = best_of(5, lambda: arx.grid(series))
    shared = arx.grid(series)
    y = series.y[29:]
    loss = np.empty_like(shared.loss)
    begin = time.process_time()
    for na in range(1, 16):
        for nb in range(1, 16):
            for nk in range(1, 16):
                phi, _ = arx.regressors(series, Orders(na=na, nb=nb, nk=nk), 29)
                theta = np.linalg.lstsq(phi, y, rcond=None)[0]
                loss[na - 1, nb - 1, nk - 1] = np.mean((y - phi @ theta) ** 2)
    plain = time.process_time() - begin
    gap = np.max(np.abs(shared.loss / loss - 1))
    print(f"\nARX grid, 3375 models: {1e3 * ours:.1f} ms, one lstsq each {plain:.2f} s, ratio {plain / ours:.0f}, "
          f"largest relative difference of losses {gap:.1e}")  # fmt: skip


def loaded_foot() -> None:
    """Linear against nonlinear models on the nonlinear foot with 4.5 kg, held-out fit in free simulation."""
    print("\nloaded nonlinear foot (4.5 kg), held-out fit %, free simulation")
    for frequency in (10.0, 15.0):
        rng = np.random.default_rng(round(frequency))
        n = 10_000
        base = foot.sine(frequency, n) + 0.03 * rng.standard_normal(n)
        y = foot.nonlinear_output(frequency, n, added_mass=4.5) + 0.05 * rng.standard_normal(n)
        estimation, validation = Series(base, y, foot.SAMPLE_TIME).split()
        oe = pem.estimate("oe", estimation, Orders.of("oe", (2, 2, 1)))
        hw = nonlinear.estimate(estimation, Orders.of("oe", (2, 2, 1)), (3, 3), oe)
        judged = [selection.judge(model, [validation]) for model in (oe, subspace.estimate(estimation, 2), hw)]
        judged.append(estimate_narx(estimation, [validation]))
        print(f"{frequency:g} Hz: " + ", ".join(f"{c.model.label} {c.fit_percent:.2f}" for c in judged), flush=True)


PEER_CODE = r"""
import json, sys, time, warnings
import numpy as np
warnings.filterwarnings("ignore")
package, path = sys.argv[1], sys.argv[2]
data = np.load(path)
shift = np.exp(-2j * np.pi * data["band"] * float(data["sample_time"]))
polyval = np.polynomial.polynomial.polyval
out = {}

def run(name, work):
    begin = time.process_time()
    try:
        value = work()
        seconds = time.process_time() - begin
        error = 100 * np.abs(value / data["exact"] - 1)
        out[name] = [float(error.max()), float(np.sqrt(np.mean(error ** 2))), seconds]
    except Exception as problem:
        out[name] = f"{type(problem).__name__}: {str(problem)[:100]}"

for excitation in ("PRBS", "multisine"):
    u, y = data[excitation + "_u"], data[excitation + "_y"]
    if package == "sippy_unipi":
        from sippy_unipi import system_identification as identify

        def transfer(method, **options):
            system = identify(y, u, method, **options)
            num, den = (np.ravel(part[0][0]) for part in (system.G.num, system.G.den))
            return np.polyval(num, 1 / shift) / np.polyval(den, 1 / shift)

        def space():
            s = identify(y, u, "N4SID", SS_fixed_order=4, SS_f=16, SS_p=16)
            eye = np.eye(len(s.A))
            return np.array([(s.C @ np.linalg.solve(eye / q - s.A, s.B) + s.D)[0, 0] for q in shift])

        run(excitation + " oe", lambda: transfer("OE", OE_orders=[4, 4, 0]))
        run(excitation + " armax", lambda: transfer("ARMAX", ARMAX_orders=[4, 4, 4, 0], ARMAX_mod="OPT"))
        run(excitation + " bj", lambda: transfer("BJ", BJ_orders=[4, 2, 2, 4, 0]))
        run(excitation + " ss", space)
    else:
        import pysib

        def response(found, den):
            model = found[1]
            return polyval(shift, model["B"]) / polyval(shift, model[den])

        run(excitation + " oe", lambda: response(pysib.oe_filtered(u, y, 4, 4, 1), "F"))
        run(excitation + " armax", lambda: response(pysib.armax_filtered(u, y, 4, 4, 4, 1), "A"))
        run(excitation + " bj", lambda: response(pysib.bj_filtered(u, y, 4, 2, 2, 4, 1), "F"))
print("RESULT " + json.dumps(out))
"""


def peers(timeout: float) -> None:
    """The same data through other packages, each in its own environment."""
    print(f"\npeers, same data (seed 0): largest % / rms % / time s, at most {timeout:g} s each")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.npz"
        arrays: dict[str, np.ndarray] = {"band": BAND, "exact": foot.response(BAND), "sample_time": np.array(1e-3)}
        for name, excite in INPUTS.items():
            series = record(excite(SAMPLES), 0)
            arrays |= {f"{name}_u": series.u, f"{name}_y": series.y}
            for structure in MODELS:
                begin = time.process_time()
                value = estimate(structure, series).response(BAND).value
                seconds, (largest, rms) = time.process_time() - begin, errors(value)
                print(f"{'this package':14} {name:10} {structure:6} {largest:9.3f} {rms:8.3f} {seconds:8.3f}")
        np.savez(path, **arrays)  # type: ignore[arg-type]
        script = Path(folder) / "peer.py"
        script.write_text(PEER_CODE)
        for package, title in PEERS.items():
            place = Path(folder) / package
            venv.create(place, with_pip=True)
            python = place / "bin" / "python"
            install = subprocess.run(
                [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package],
                capture_output=True, text=True, check=False,
            )  # fmt: skip
            if install.returncode:
                reason = (install.stderr.strip().splitlines() or ["no message"])[-1]
                print(f"{title} is left out: pip could not install {package} ({reason})")
                continue
            try:
                done = subprocess.run(
                    [python, str(script), package, str(path)], capture_output=True, text=True, check=False,
                    timeout=timeout, cwd=folder,
                )  # fmt: skip
            except subprocess.TimeoutExpired:
                print(f"{title} is left out: it did not finish within {timeout:g} s")
                continue
            line = next((text for text in done.stdout.splitlines() if text.startswith("RESULT ")), None)
            if line is None:
                print(f"{title} is left out: {(done.stderr.strip().splitlines() or ['no output'])[-1]}")
                continue
            for name, result in json.loads(line[7:]).items():
                excitation, structure = name.split()
                text = result if isinstance(result, str) else "{:9.3f} {:8.3f} {:8.3f}".format(*result)
                print(f"{title:14} {excitation:10} {structure:6} {text}")


def main() -> None:
    """All tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="records for the medians")
    parser.add_argument("--coverage", type=int, default=100, help="records for the coverage")
    parser.add_argument("--timeout", type=float, default=400, help="seconds for each peer")
    parser.add_argument("--no-peers", action="store_true", help="do not install and run other packages")
    options = parser.parse_args()
    accuracy(options.seeds)
    grid()
    loaded_foot()
    coverage(options.coverage)
    if not options.no_peers:
        peers(options.timeout)


if __name__ == "__main__":
    main()
