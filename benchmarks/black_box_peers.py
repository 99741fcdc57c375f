"""Peers of the black-box estimators: SIPPY, pysib and nfoursid on the same data, each in a separate environment.

They are installed by pip under a temporary folder with the versions of numpy and scipy that they want; a peer that does
not install is left out with a sentence.
"""

import json
import subprocess
import tempfile
import venv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

PEERS = {"sippy_unipi": "SIPPY", "pysib": "pysib"}
#: Those that choose or take the order of a state-space model of the systems of known truth.
SPACES = {"sippy_unipi": "SIPPY", "nfoursid": "nfoursid"}

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

CASE_CODE = r"""
import json, sys, time, warnings
import numpy as np
warnings.filterwarnings("ignore")
package, path = sys.argv[1], sys.argv[2]
data = np.load(path)
out = {}

def space(u, y, order):
    if package == "nfoursid":
        import pandas as pd
        from nfoursid.nfoursid import NFourSID
        frame = pd.DataFrame({"u": u, "y": y})
        found = NFourSID(frame, input_columns=["u"], output_columns=["y"], num_block_rows=15)
        found.subspace_identification()
        model, _ = found.system_identification(rank=order)
        return model.a, model.b, model.c, model.d
    from sippy_unipi import system_identification as identify
    free = {"IC": "AIC", "SS_orders": [1, 8]} if order is None else {"SS_fixed_order": order}
    model = identify(y, u, "N4SID", SS_f=15, SS_p=15, **free)
    return model.A, model.B, model.C, model.D

for case in sorted(set(key.split("|")[0] for key in data.files)):
    for order in (int(data[case + "|order"]), None):
        if order is None and package == "nfoursid":
            continue
        fits, seconds = [], []
        for seed in range(int(data[case + "|seeds"])):
            u, y = data[f"{case}|u{seed}"], data[f"{case}|y{seed}"]
            begin = time.process_time()
            try:
                A, B, C, D = (np.asarray(part) for part in space(u - u.mean(), y - y.mean(), order))
                state, answer = np.zeros(len(A)), []
                for value in data[case + "|fresh"]:
                    answer.append((C @ state).item() + D.item() * value)
                    state = A @ state + B[:, 0] * value
                exact = data[case + "|exact"]
                fits.append(100 * (1 - np.linalg.norm(exact - answer) / np.linalg.norm(exact - exact.mean())))
            except Exception:
                fits.append(-np.inf)
            seconds.append(time.process_time() - begin)
        fit = float(np.median(fits))
        key = f"{case}|{'not given' if order is None else 'given'}"
        out[key] = [fit if np.isfinite(fit) else -999.0, float(np.median(seconds))]
print("RESULT " + json.dumps(out))
"""


def run_cases(arrays: Mapping[str, np.ndarray], timeout: float) -> dict[str, dict[str, list[float]] | str]:
    """Fit [%] of fresh data and seconds of each peer's subspace model, by "case|given" or "case|not given"."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savez(folder / "data.npz", **arrays)  # type: ignore[arg-type]
        (folder / "peer.py").write_text(CASE_CODE)
        return {title: _one(package, folder, timeout) for package, title in SPACES.items()}


def run(arrays: Mapping[str, np.ndarray], timeout: float) -> dict[str, dict[str, list[float]] | str]:
    """The estimates of each peer, or why it is left out.

    Args:
        arrays: band [Hz] (M,), exact response there (M,), sample_time [s], and NAME_u, NAME_y of each excitation.
        timeout: seconds for each peer.

    Returns:
        Title of the peer -> "excitation structure" -> largest error [%], rms error [%], seconds; or a sentence.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savez(folder / "data.npz", **arrays)  # type: ignore[arg-type]
        (folder / "peer.py").write_text(PEER_CODE)
        return {title: _one(package, folder, timeout) for package, title in PEERS.items()}


def _one(package: str, folder: Path, timeout: float) -> dict[str, list[float]] | str:
    venv.create(folder / package, with_pip=True)
    python = str(folder / package / "bin" / "python")
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package]
    installed = subprocess.run(install, capture_output=True, text=True, check=False)
    if installed.returncode:
        return f"left out: pip could not install {package} ({_last(installed.stderr)})"
    command = [python, "peer.py", package, "data.npz"]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=timeout)
    except subprocess.TimeoutExpired:
        return f"left out: it did not finish within {timeout:g} s"
    line = next((text for text in done.stdout.splitlines() if text.startswith("RESULT ")), None)
    return f"left out: {_last(done.stderr)}" if line is None else json.loads(line.removeprefix("RESULT "))


def _last(text: str) -> str:
    return (text.strip().splitlines() or ["no message"])[-1]
