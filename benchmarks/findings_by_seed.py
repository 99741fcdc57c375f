"""In how many virtual studies does each finding of section 2.3 come out? `python benchmarks/findings_by_seed.py 100`.

Noise-free and linear (no recordings are made), with the same subjects, trials and straps as fasbody.laboratory, so that
a hundred studies of twenty subjects take a minute or two.
"""

import sys
from collections import Counter

import numpy as np
import pandas as pd

from fasbody.instrument import Instrument
from fasbody.transmissibility.findings import findings
from fasbody.transmissibility.table import Table
from fasbody.virtual_recording import mounted
from fasbody.virtual_study import FREQUENCIES_HZ, STUDY_INSTRUMENT, Plan
from fasbody.virtual_subject import Tuberosity, panel


def study(seed: int, subjects: int = 20, instrument: Instrument = STUDY_INSTRUMENT) -> Table:
    """The table of a study made of transfer functions alone."""
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


def main() -> None:
    """Print how often each finding holds."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    held: Counter[str] = Counter()
    rules: dict[str, tuple[Counter[str], Counter[str]]] = {}
    best: list[tuple[int, int]] = []
    for seed in range(count):
        table = study(seed)
        made = findings(table)
        for c in table.each():
            by_thesis, by_equivalence = rules.setdefault(c.title, (Counter(), Counter()))
            by_thesis[str(c.resonance.kind)] += 1
            by_equivalence[str(c.shown.kind)] += 1
        held.update({f.says: int(f.holds is True) for f in made})
        best.append((sum(f.holds is True for f in made), seed))
    print(f"share of {count} virtual studies of 20 subjects in which each statement comes out")
    for says, n in held.items():
        print(f"{100 * n / count:5.0f} %  {says}")
    print("what the rule of section 2.3.1 finds, and what is shown beyond chance (fasbody/resonance.py), % of studies")
    for title, counts in rules.items():
        cells = (", ".join(f"{kind} {100 * n / count:.0f}" for kind, n in c.most_common()) for c in counts)
        print(f"{title:26} {next(cells):36} | {next(cells)}")
    print("most statements at once:", ", ".join(f"{n} with seed {seed}" for n, seed in sorted(best, reverse=True)[:5]))


if __name__ == "__main__":
    main()
