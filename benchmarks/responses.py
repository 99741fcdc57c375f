"""Frequency responses of known answer: `python -m benchmarks.responses`, ours beside the estimates of before.

A mass on spring and damper, 20 Hz, damping 6 or 25 %, shaken by a sine, a multisine, random motion or a sweep. Both
channels have noise; the shaker wanders in amplitude or frequency; hum and drift are added. The answer is exact: the
motion is multiplied by the response in the frequency domain, over a time that is longer than the recording.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from benchmarks.table import report
from fasbody.console import command_line, console, results
from fasbody.recording.harmonics import Harmonics, find_frequency, fit_harmonics
from fasbody.transmissibility.broadband import broadband
from fasbody.transmissibility.sines import by_segments
from fasbody.transmissibility.spectra import excited, h1
from reproduction.check import Check, at_most, told, within
from simulator.mass import RATE_HZ, SECONDS, WANDERS, Case, recorded, truth


def ratio(out: Harmonics, into: Harmonics) -> tuple[complex, float]:
    """Complex ratio of the fundamentals, and the standard deviation of its real (or imaginary) part."""
    H = out.amplitudes[0] / into.amplitudes[0]
    relative = np.hypot(out.std[0] / abs(out.amplitudes[0]), into.std[0] / abs(into.amplitudes[0]))
    return complex(H), float(abs(H) * relative)


def cases() -> list[Case]:
    """Every excitation, damping and noise; and at 1 % noise everything else that goes wrong."""
    made = [Case(e, z, n) for e in SECONDS for z in (0.06, 0.25) for n in (0.01, 0.05, 0.15)]
    for e in SECONDS:
        for wrong in WANDERS[1:]:
            if e == "sine" or wrong in ("AM", "hum", "drift"):
                made += [Case(e, z, 0.01, wrong) for z in (0.06, 0.25)]
    return made


Estimate = tuple[np.ndarray, np.ndarray, np.ndarray]


def ours(case: Case, t: np.ndarray, base: np.ndarray, mass: np.ndarray) -> Estimate:
    """Frequencies, response, and its standard deviation."""
    channels = {"base": base - base.mean(), "malleolus": mass - mass.mean()}
    if case.excitation == "sine":
        estimate = by_segments(t, channels, find_frequency(t, channels["base"]))
    else:
        estimate = broadband(t, channels, 1.0)
    return estimate.frequency_hz, *estimate.ratio("malleolus")


def before(case: Case, t: np.ndarray, base: np.ndarray, mass: np.ndarray) -> Estimate:
    """The same by the estimates of before: one sine fit a channel, or H1 by Welch's method."""
    base, mass = base - base.mean(), mass - mass.mean()
    if case.excitation == "sine":
        f = find_frequency(t, base)
        H, std = ratio(fit_harmonics(t, mass, f, 1), fit_harmonics(t, base, f, 1))
        return np.array([f]), np.array([H]), np.array([std])
    estimate = h1(base, mass, RATE_HZ, 1.0, excited(base, RATE_HZ, 1.0))
    return estimate.frequency_hz, estimate.H, estimate.std


@dataclass(frozen=True)
class Outcome:
    """Over many recordings and frequencies: bias and scatter of one estimate, and what its 95 % intervals cover.

    The bias is the root mean square over frequencies of the mean error, with what chance adds to it taken off.
    """

    bias_percent: float
    bias_deg: float
    scatter_percent: float
    scatter_deg: float
    cover_percent: float
    cover_phase_percent: float

    @classmethod
    def of(cls, case: Case, estimate: Callable[..., Estimate], seeds: int) -> "Outcome":
        """Of one case."""
        errors, inside = [], []
        for seed in range(seeds):
            f, H, std = estimate(case, *recorded(case, seed))
            use = np.ones(f.size, bool) if case.excitation == "sine" else (f >= 6.5) & (f <= 45.5)
            f, H, std = f[use], H[use], std[use]
            if estimate is before and case.excitation == "sine":  # it averages over a wander around the true frequency
                f = np.full(1, case.frequency_hz)
            error = H / truth(f, case.damping)
            size, turn, half = np.abs(error) - 1, np.angle(error), 1.96 * std / np.abs(H)
            errors.append([100 * size, np.degrees(turn)])
            inside.append([np.abs(size / np.abs(error)) <= half, np.abs(turn) <= half])
        e, covered = np.array(errors), 100 * np.mean(np.array(inside, float), axis=(0, 2))
        mean, spread = e.mean(axis=0), e.std(axis=0, ddof=1)
        bias = np.sqrt(np.maximum(0, np.mean(mean**2 - spread**2 / seeds, axis=1)))
        scatter = np.sqrt(np.mean(spread**2, axis=1))
        return cls(*(float(v) for v in (*bias, *scatter, *covered)))

    @property
    def cells(self) -> list[str]:
        """For a row of the table."""
        return [
            f"{self.bias_percent:.3f} / {self.bias_deg:.3f}", f"{self.scatter_percent:.3f} / {self.scatter_deg:.3f}",
            f"{self.cover_percent:.0f} / {self.cover_phase_percent:.0f}",
        ]  # fmt: skip


def measure(seeds: int, keep: Path | None = None, only: str = "") -> list[tuple[Case, Outcome, Outcome]]:
    """Every case by both estimates; kept in a file case by case, so that a run can be resumed.

    Args:
        seeds: recordings of broadband motion, each with forty frequencies; of sines eight times as many.
        keep: JSON file. only: part of the name of the cases wanted.
    """
    kept = json.loads(keep.read_text()) if keep and keep.is_file() else {}
    rows = []
    for case in cases():
        if only not in str(case):
            continue
        count = seeds * (8 if case.excitation == "sine" else 1)
        key = f"{case}, {count} recordings"
        if key not in kept:
            kept[key] = [vars(Outcome.of(case, way, count)) for way in (ours, before)]
            if keep:
                keep.write_text(json.dumps(kept, indent=1))
        new, old = (Outcome(**values) for values in kept[key])
        rows.append((case, new, old))
    return rows


#: Fewer seeds scatter by more than what is asked.
ENOUGH = 25
HEADS = (
    "recording", "bias [% / deg]", "scatter [% / deg]", "95 % covers [%]", "before: bias", "before: scatter",
    "before: covers",
)  # fmt: skip


def checks(rows: list[tuple[Case, Outcome, Outcome]]) -> list[Check]:
    """Worst bias and coverage by excitation; those of the earlier estimates without a requirement."""
    made = []
    for excitation in SECONDS:
        mine = [(case, new, old) for case, new, old in rows if case.excitation == excitation]
        if not mine:
            continue
        for what, unit in (("bias_percent", "%"), ("bias_deg", "degrees")):
            worst = max(mine, key=lambda row: getattr(row[1], what))
            made.append(at_most(f"bias, worst of {excitation} ({worst[0]})", getattr(worst[1], what), 0.1, unit))
            made.append(
                told(
                    f"the same of the estimate before, {excitation}",
                    f"{max(getattr(r[2], what) for r in mine):.3g} {unit}",
                )
            )
        every = [(v, case) for case, new, _ in mine for v in (new.cover_percent, new.cover_phase_percent)]
        for value, case in (min(every, key=lambda v: v[0]), max(every, key=lambda v: v[0])):
            made.append(within(f"95 % intervals cover, extreme of {excitation} ({case})", value, 92, 98, "%"))
    return made


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    seeds: Annotated[int, typer.Option(min=2, help="broadband recordings per case; eight times as many sines")] = 25,
    only: Annotated[str, typer.Option(help="part of the names of the cases wanted, such as 'sine'")] = "",
    keep: Annotated[Path | None, typer.Option(help="JSON file that keeps each case, to resume a run")] = None,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Frequency responses with a known answer, for every kind of excitation.

    Examples:
      python -m benchmarks.responses --only sine --keep responses.json
    """
    with console.status("estimating"):
        rows = measure(seeds, keep, only)
    if not json_:
        printed = Table(*map(escape, HEADS), title="ours, and before", title_justify="left")
        for case, new, old in rows:
            printed.add_row(escape(str(case)), *new.cells, *old.cells)
        results.print(printed)
    verdicts = checks(rows)
    if seeds < ENOUGH:
        few = f"judged from {ENOUGH} seeds on"
        verdicts = [replace(row, beside=f"{row.against}, {few}", asked=False) if row.asked else row
                 for row in verdicts]  # fmt: skip
    report("Frequency responses", verdicts, json_)


if __name__ == "__main__":
    command_line(app)
