"""Chapter 4, section 4.6: what ankle and fat pad dissipate, by the fits and by the feet the recordings were made from.

A solution and its mirror image exchange the two losses, and one frequency seldom decides between them, so a statement
must hold on both.
"""

from functools import partial

import numpy as np
import pandas as pd

from fasbody.recording.condition import ADDED_MASSES_KG
from identification.figures import save
from identification.study import figures as motion
from reproduction.chapter4_results import F, true_means
from reproduction.check import at_least, at_most, exactly
from reproduction.fitted import (
    BRANCHES,
    DRAWN,
    GROUP,
    STUDY_COMMAND,
    documents,
    energies,
    losses,
    mean_at,
    true_energies,
)
from reproduction.row import Outcome, Rows

ROWS = Rows()
LIGHT, *_, HEAVY = ADDED_MASSES_KG


@ROWS(
    "Eq. 4.42", "forces of ankle and fat pad; the areas of their loops are the dissipated energy", STUDY_COMMAND, GROUP
)
def hysteresis_forces() -> Outcome:
    cycles = energies()
    return Outcome(
        printed=[
            at_most(
                "shaker's work less the areas of both loops, of the work, largest",
                float(cycles["imbalance"].abs().max()),
                5e-3,
            ),
            at_least("cycles", len(cycles), 9 * 3 * 2),
        ],
        note="The shaker's work comes from the masses' momentum, not from the dampers' forces.",
    )


def more_in_the_pad(cycles: pd.DataFrame) -> float:
    """Share of cycles in which the fat pad dissipates more than the ankle."""
    return float(np.mean(cycles["fat_pad_j"] > cycles["ankle_j"]))


def branch(load: float, chosen: bool) -> pd.DataFrame:
    """Cycles of the drawn subject under a load on the first branch, or on the other."""
    cycles = energies()
    return losses(cycles[cycles["chosen"] == chosen], load)


def loops(load: float) -> Outcome:
    """Loops of the drawn subject under one load: does the fat pad dissipate more, and does that survive the mirror?"""
    mine = [d for d in documents()[0] if d["subject"] == DRAWN and d["added_mass_kg"] == load]
    stored = [c for d in mine for c in d["cycles"] if c["chosen"]]
    save(motion.loops(stored, "synthetic"), "svg")  # they can be drawn
    return Outcome(
        printed=[
            exactly("loops drawn of each part of virtual subject 16", len(stored), F.size),
            *(
                at_least(f"share of them in which the fat pad dissipates more, {name}", more_in_the_pad(part), 0.9)
                for name, part in ((name, branch(load, which)) for which, name in BRANCHES.items())
            ),
        ],
        present=[
            at_least("the same of the feet they were made from", more_in_the_pad(losses(true_energies(), load)), 0.9)
        ],
        synthetic=True,
    )


for _number, _load in zip((15, 16, 17), ADDED_MASSES_KG, strict=True):
    ROWS.add(f"Fig. 4.{_number}", f"force against displacement of ankle and fat pad of subject 16, {_load:g} kg",
             partial(loops, _load), STUDY_COMMAND, GROUP)  # fmt: skip


@ROWS("Finding 4.6, 3", "the fat pad dissipates more than the ankle", STUDY_COMMAND, GROUP)
def pad_dissipates_more() -> Outcome:
    def share(cycles: pd.DataFrame) -> float:
        return float(np.median(cycles["fat_pad_j"] / (cycles["fat_pad_j"] + cycles["ankle_j"])))

    cycles = energies()
    return Outcome(
        printed=[
            at_least(f"median share of the pad, 18 subjects, {name}", share(cycles[cycles["chosen"] == which]), 0.5)
            for which, name in BRANCHES.items()
        ],
        present=[at_least("the same of the feet they were made from", share(true_energies()), 0.5)],
        synthetic=True,
        note="The mirror solution exchanges the two energies; load or a second sensor decides, one frequency does not.",
    )


@ROWS("Finding 4.6, 4", "without load the fat pad of subject 16 dissipates most at 15 Hz", STUDY_COMMAND, GROUP)
def pad_at_15_hz() -> Outcome:
    def most(cycles: pd.DataFrame) -> float:
        return float(cycles["frequency_hz"].iloc[int(cycles["fat_pad_j"].argmax())])

    return Outcome(
        printed=[
            exactly(f"largest loss, {name}", most(branch(LIGHT, which)), 15, "Hz") for which, name in BRANCHES.items()
        ],
        present=[exactly("the same of the feet they were made from", most(losses(true_energies(), LIGHT)), 15, "Hz")],
        synthetic=True,
    )


@ROWS("Finding 4.6, 5", "with 4.5 kg the loop of the ankle of subject 16 vanishes", STUDY_COMMAND, GROUP)
def ankle_with_load() -> Outcome:
    def largest(cycles: pd.DataFrame) -> float:
        return float((100 * cycles["ankle_j"] / (cycles["ankle_j"] + cycles["fat_pad_j"])).max())

    return Outcome(
        printed=[
            at_most(f"largest share of the ankle in the energy, {name}", largest(branch(HEAVY, which)), 5, "%")
            for which, name in BRANCHES.items()
        ],
        present=[at_most("the same of the feet they were made from", largest(losses(true_energies(), HEAVY)), 5, "%")],
        synthetic=True,
    )


@ROWS("Finding 4.6, 6", "c_21 of the fat pad is higher than c_11 of the ankle", STUDY_COMMAND, GROUP)
def pad_damps_more() -> Outcome:
    checks = []
    for first, name in BRANCHES.items():
        pad, ankle = (np.array([mean_at(c, load, F, first) for load in ADDED_MASSES_KG]) for c in ("c_21", "c_11"))
        known = int(np.isfinite(pad - ankle).sum())
        checks.append(at_least(f"of 27 pairs of means, those that are known, {name}", known, 14))
        checks.append(exactly(f"of these, those with the higher c_21, {name}", int(np.sum(pad > ankle)), known))
    truly = [true_means("c_21")[load] > true_means("c_11")[load] for load in ADDED_MASSES_KG]
    return Outcome(
        printed=checks,
        present=[exactly("the same of the true constants", int(np.sum(truly)), 27)],
        synthetic=True,
        note="The mirror solution exchanges the two constants.",
    )
