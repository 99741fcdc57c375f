"""The black box on public recordings, without any option: Silverbox, cascaded tanks and a flexible robot arm.

The files are not shipped: `--fetch` clones two public repositories that hold them, with git, into the folder. Silverbox
(Wigren and Schoukens 2013) is estimated on the first half of its multisines, judged on the second and on the arrow,
which reaches beyond them, and once more on fewer multisines; the tanks (Schoukens and others 2016) are estimated on
their first recording and judged on their second; the arm (DaISy, Favoreel) on its second half.
"""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.table import JsonOption, report
from fasbody.console import command_line
from fasbody.exceptions import InputFileError
from identification import criteria
from identification.blackbox import pem
from identification.blackbox.candidate import Candidate, judge
from identification.blackbox.data import Series
from identification.blackbox.filters import shifted
from identification.blackbox.identify import identify
from identification.blackbox.polynomial import Orders
from reproduction.check import Check, at_least, at_most, told

#: Repositories and the files in them.
SOURCES = {
    "https://github.com/biaslab/nsi-silverbox": ("data/Silverbox/SNLS80mV.csv",),
    "https://github.com/Rafa7046/Non_Linear_Identification": ("src/data/tanque.csv", "src/data/robot-arm.csv"),
}
#: Sample times [s]: 2^14 / 10 MHz; DaISy states none of the arm.
SILVERBOX_S, TANKS_S, ARM_S = 2**14 / 1e7, 4.0, 1.0
#: Samples of Silverbox: the arrow ends, multisines last from and to.
ARROW, MULTISINES, FEWER = 40_495, slice(40_650, 127_400), slice(40_650, 110_000)
#: Orders by hand that automatic ones must equal, and by how much [points] they may miss.
BY_HAND, MISSED = (3, 2, 0), 0.05
#: Coefficients of a pulse response fitted to the held-out part itself: about the most of a linear model.
PULSE = 800
#: Samples of a simulation that its start-up may spoil.
SKIPPED = 1000


def fetch(folder: Path) -> None:
    """Clone what is not there.

    Raises:
        InputFileError: git or the network does not give it.
    """
    for source in SOURCES:
        place = folder / Path(source).name
        if not place.is_dir():
            try:
                command = ["git", "clone", "--quiet", "--depth", "1", source, str(place)]
                subprocess.run(command, check=True, capture_output=True, text=True)
            except (OSError, subprocess.CalledProcessError) as error:
                said = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
                raise InputFileError(place, f"cannot be fetched from {source} ({said})", "try again") from error


def columns(folder: Path, name: str) -> np.ndarray:
    """The columns (n, c) of one of the files.

    Raises:
        InputFileError: it is not there.
    """
    places = (folder / Path(source).name / file for source, files in SOURCES.items() for file in files)
    place = next(place for place in places if place.name == name)
    if not place.is_file():
        raise InputFileError(place, "is not there", "python -m benchmarks.public_data FOLDER --fetch gets it")
    return np.genfromtxt(place, delimiter=",", skip_header=1)


def silverbox(folder: Path) -> Iterator[Check]:
    """A resonator with a hard spring, 87,000 samples of multisines and an arrow."""
    u, y = columns(folder, "SNLS80mV.csv")[:, :2].T
    found = identify(Series(u[MULTISINES], y[MULTISINES], SILVERBOX_S, "Silverbox"), ("oe", "narx")).models
    first = slice(MULTISINES.start, (MULTISINES.start + MULTISINES.stop) // 2)
    arrow = Series(u[:ARROW] - u[first].mean(), y[:ARROW] - y[first].mean(), SILVERBOX_S, "arrow", part=True)
    oe, narx = found["oe"].best, found["narx"].best
    yield from linear(Series(u[MULTISINES], y[MULTISINES], SILVERBOX_S, "all multisines"), oe)
    few = Series(u[FEWER], y[FEWER], SILVERBOX_S, "fewer multisines")
    yield from linear(few, identify(few, ("oe",)).models["oe"].best)
    held = 1e3 * narx.missed * float(np.std(y[first.stop : MULTISINES.stop]))
    yield at_most(f"Silverbox, {narx.model.label}: held-out error", held, 0.30, "mV")
    for one in (oe, narx):
        error = 1e3 * float(np.std((arrow.y - one.model.simulate(arrow))[SKIPPED:]))
        published = "0.26 mV (Paduart and others 2010, nonlinear state space)" if one is narx else ""
        yield told(f"Silverbox, {one.model.label}: error on the arrow", f"{error:.3g} mV", published)


def linear(series: Series, chosen: Candidate) -> Iterator[Check]:
    """An automatic output-error model beside one by hand, and beside a pulse response fitted to the held-out part."""
    first, held = series.split()
    by_hand = judge(pem.estimate("oe", first, Orders.of("oe", BY_HAND)), [held]).fit_percent
    what, fit = f"Silverbox, {series.name}, {chosen.model.label}: held-out fit", chosen.fit_percent
    beside = f"OE {BY_HAND}: {by_hand:.2f} %, at most {MISSED} less"
    yield Check(what, fit, by_hand - MISSED, said=f"{fit:.2f} %", beside=beside)
    phi = np.column_stack([shifted(held.u, PULSE), np.ones(len(held))])
    most = criteria.fit_percent(held.y, phi @ np.linalg.solve(phi.T @ phi, phi.T @ held.y))
    yield told(f"Silverbox, {series.name}, {PULSE} coefficients fitted to the held-out part itself", f"{most:.2f} %")


def tanks(folder: Path) -> Iterator[Check]:
    """Two tanks that overflow: 1024 samples to estimate on, and as many to judge."""
    u, fresh_u, y, fresh_y = columns(folder, "tanque.csv")[:, :4].T
    both = Series(np.concatenate([u, fresh_u]), np.concatenate([y, fresh_y]), TANKS_S, "tanks")
    for chosen in identify(both, ("oe", "hw", "narx")).models.values():
        model, fresh = chosen.best.model, both.split()[1]
        error = float(np.sqrt(np.mean((fresh.y - model.simulate(fresh)) ** 2)))
        what = f"cascaded tanks, {model.label}: error on the second recording"
        yield at_most(what, error, 0.36, "V") if model.structure == "narx" else told(what, f"{error:.3f} V")
    exchanged = Series(np.concatenate([fresh_u, u]), np.concatenate([fresh_y, y]), TANKS_S, "tanks exchanged")
    narx = identify(exchanged, ("narx",)).models["narx"].best
    error = narx.missed * float(np.std(y))
    yield told(f"cascaded tanks, {narx.model.label} of the second recording: error on the first", f"{error:.3f} V")


def arm(folder: Path) -> Iterator[Check]:
    """A flexible robot arm under a sine sweep, 1024 samples."""
    u, y = columns(folder, "robot-arm.csv").T
    best = max(
        (m.best for m in identify(Series(u, y, ARM_S, "robot arm")).models.values()), key=lambda c: c.fit_percent
    )
    yield at_least(f"robot arm, {best.model.label}: held-out fit", best.fit_percent, 97.0, "%")


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    folder: Annotated[Path, typer.Argument(help="where the recordings are")] = Path("results/public_data"),
    get: Annotated[bool, typer.Option("--fetch", help="clone them with git first")] = False,
    json_: JsonOption = False,
) -> None:
    """Black-box models of public recordings. Takes some minutes.

    Examples:
      python -m benchmarks.public_data --fetch
    """
    if get:
        fetch(folder)
    report("public data", [*silverbox(folder), *tanks(folder), *arm(folder)], json_)


if __name__ == "__main__":
    command_line(app)
