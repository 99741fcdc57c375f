"""A second load tells a foot from its mirror image: `python examples/two_loads_decide.py [FIGURE.png]`.

The foot is linear, so one load leaves the fit undecided: the sentence gives both feet, and which of them is drawn first
is a matter of the name. The same foot recorded with 4.5 kg on the knee as well is decided: the ratio
a = m_S / (m_S + m_F) is another one, and only one foot fits both. That holds for constants that do not change with the
load, as here; where they do, see docs/study_methods.md.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from linear_foot import BODY_MASS, FOOT
from matplotlib.figure import Figure

from fasbody.foot.model import load
from fasbody.laboratory.foot import record
from fasbody.laboratory.instrument import Instrument
from fasbody.presentation import COLOURS, PAGE, printed, write_figure
from fasbody.recording.recording import Condition, Recording
from identification.fitting import Settings, fit_foot
from identification.result import FitResult

LINEAR = dict.fromkeys(("c_12", "c_13", "c_22", "c_23"), 0.0)
TRUTH = replace(FOOT, c_11=300.0, c_21=600.0, **LINEAR)


def recordings(added_mass_kg: float) -> list[Recording]:
    """Five synthetic recordings, 10 to 50 Hz, with this mass on the knee."""
    rng, instrument = np.random.default_rng(round(10 * added_mass_kg)), Instrument()
    foot, made = replace(TRUTH, m_S=TRUTH.m_S + added_mass_kg), []
    for f in (10.0, 20.0, 30.0, 40.0, 50.0):
        one = record(foot, instrument.motion(f, 3.0, rng), 2.0, instrument, rng)
        made.append(replace(one, condition=Condition("1", "midstance", added_mass_kg, BODY_MASS, f)))
    return made


@printed
def main(picture: Path = Path("two_loads_decide.png")) -> dict[str, FitResult]:
    """Fit one load and two, draw both branches of each; return the results."""
    bare, heavy = recordings(0.0), recordings(4.5)
    # these feet are synthetic: masses are exact, and no constant follows the load
    sure = {"mass_std": 0.0, "exclude": ("all",)}
    settings = Settings(free=("k_T", "k_F", "c_11", "c_21"), starts=2, **sure)  # type: ignore[arg-type]
    foot = load("two_dof").with_values(LINEAR)
    results = {"one load": fit_foot(bare, foot, settings), "two loads": fit_foot(bare + heavy, foot, settings)}
    figure = Figure(figsize=(PAGE, 3.2), layout="constrained")
    for ax, (name, result) in zip(figure.subplots(1, 2, sharey=True), results.items(), strict=True):
        misfit = [branch.chi_square / branch.dof for branch in result.branches]
        colours = [COLOURS[2] if branch in result.open else "0.6" for branch in result.branches]
        for branch, value, colour in zip(result.branches, misfit, colours, strict=True):
            ax.plot([branch.name], [value], "o", ms=8, color=colour)
            side = 8 if value >= 1 else -8  # of the dotted line
            ax.annotate(f"{value:.3g}", (branch.name, value), (10, side), textcoords="offset points", va="center")
        ax.margins(x=0.5)
        ax.axhline(1, color="k", lw=0.8, ls=":")
        ax.set_title(f"{name}: {result.verdict}", loc="left")
        ax.set_yscale("log")
    figure.axes[0].set_ylabel("chi-square per degree of freedom")
    figure.axes[0].set_ylim(0.3, 3 * max(b.chi_square / b.dof for r in results.values() for b in r.branches))
    write_figure(figure, picture)
    return results


if __name__ == "__main__":
    for name, result in main(*map(Path, sys.argv[1:2])).items():
        print(f"{name}: {result.sentence()}")
