"""A virtual study without recordings: noise-free, linear, with the subjects, trials and straps of fasbody.laboratory.

A hundred studies of twenty subjects take seconds so, and one of hundreds of subjects shows what is true of them all.
"""

import numpy as np
import pandas as pd

from fasbody.laboratory.instrument import Instrument
from fasbody.laboratory.recording import mounted
from fasbody.laboratory.study import FREQUENCIES_HZ, STUDY_INSTRUMENT, Plan
from fasbody.laboratory.subject import Tuberosity, panel
from fasbody.transmissibility.table import Table


def study(seed: int, subjects: int = 20, instrument: Instrument = STUDY_INSTRUMENT) -> Table:
    """The table of a study made of transfer functions alone.

    Args:
        seed: of the subjects and trials, as in `Plan`. subjects: how many. instrument: straps and gains.

    Raises:
        SettingError: fewer than one subject, or a seed that is none.
    """
    plan = Plan(subjects=subjects, seed=seed).check()
    lines = []
    for person in panel(subjects, np.random.default_rng(seed)):
        for c, (posture, mass) in enumerate(plan.conditions):
            for i, f in enumerate(FREQUENCIES_HZ):
                rng = np.random.default_rng((seed, person.number, c, i))
                at = np.array([f])
                strap = instrument.strap(at)[0] * np.exp(-2j * np.pi * f * instrument.delay_s)
                MB = person.foot(f, mass, posture, rng).transmissibility(at)[0]
                TM = Tuberosity.under(mass, rng).response(at)[0]
                instrument.amplitudes(rng), rng.uniform()  # drawn, though a linear foot does not need them
                malleolus, tuberosity = mounted(instrument, rng) * np.array([MB, MB * TM]) * strap
                for pair, H in (("MB", malleolus), ("TB", tuberosity), ("TM", tuberosity / malleolus)):
                    lines.append((str(person.number), posture, mass, f, pair, abs(H), np.degrees(np.angle(H))))
    names = ["subject", "posture", "added_mass_kg", "frequency_hz", "pair", "transmissibility", "phase_deg"]
    return Table(pd.DataFrame(lines, columns=names), "synthetic")
