"""What sections 2.3 and 2.4 state and fasbody.transmissibility judges, on the virtual study and with other seeds."""

import math
from functools import partial

from reproduction.check import exactly
from reproduction.row import TRANSCRIBED, Outcome, Rows
from reproduction.virtual import (
    STUDY,
    STUDY_COMMAND,
    findings_elsewhere,
    large_findings,
    study_findings,
    whatever_the_seed,
)

ROWS = Rows()


def stated(says: str) -> Outcome:
    """One finding on the virtual study, and on those with other seeds."""
    finding = study_findings()[says]
    came_out = math.nan if finding.holds is None else float(finding.holds)  # None: not tested
    holds = exactly("statement holds (1) or not (0) by its tests at p < 0.05", came_out, 1)
    elsewhere = [each[says] for each in findings_elsewhere()]
    return whatever_the_seed([holds], elsewhere, large_findings()[says], f"{finding.came_out}.")


#: Load [kg] -> frequencies [Hz] above which section 2.3.1 puts TB below 1: below Figure 2.4, and below Figure 2.5.
LISTS = {0.0: (30, 40), 2.3: (35, 45), 4.5: (40, 49)}


def tuberosity_below_one() -> Outcome:
    """The text says twice from where on TB is below 1; at how many measured frequencies do the two differ?"""
    checks = []
    for load, limits in LISTS.items():
        first, second = ({f for f in range(10, 55, 5) if f > limit} for limit in limits)
        checks.append(exactly(f"frequencies at which the text's two lists differ, {load:g} kg", len(first ^ second), 0))
    held = [says for says in OF_TUBEROSITY if study_findings()[says].holds]
    return Outcome(
        coherent=checks,
        note=f"{TRANSCRIBED} One slip in six statements; the second list is printed with 'below' for 'above' "
        f"(errata.md). On the virtual study holds: {'; '.join(held) or 'none'}.",
    )


#: Section and statement of every finding, in the order in which they are judged.
STATEMENTS = (
    ("2.3.1", "MB unloaded above 1 below 40 Hz"),
    ("2.3.1", "MB unloaded close to 1 at 45 and 50 Hz"),
    ("2.3.1", "MB with 2.3 kg above 1 at all frequencies"),
    ("2.3.1", "MB with 4.5 kg above 1 at all frequencies"),
    ("2.3.1", "MB resonance with 0 kg: 15-25 Hz (plateau)"),
    ("2.3.1", "MB resonance with 2.3 kg: 30-35 Hz (peak)"),
    ("2.3.1", "MB resonance with 4.5 kg: 35-40 Hz (peak)"),
    ("2.4", "MB below 20 Hz falls with load"),
    ("2.3.1", "MB phase with 0 kg steepest within 5 Hz of the resonance"),
    ("2.3.1", "MB phase with 2.3 kg steepest within 5 Hz of the resonance"),
    ("2.3.1", "MB phase with 4.5 kg steepest within 5 Hz of the resonance"),
    ("2.3.1", "lag of MB less with 2.3 kg, most at 30-35 Hz"),
    ("2.3.1", "lag of MB less with 4.5 kg, most at 30-35 Hz"),
    ("2.3.1", "TB at 10 Hz differs between the loads"),
    ("2.3.1", "TB unloaded without peak or plateau"),
    ("2.3.1", "TB peak with 2.3 kg: 25-30 Hz"),
    ("2.3.1", "TB peak with 4.5 kg: 25-30 Hz"),
    ("2.3.1", "TB alike with 2.3 and 4.5 kg at 15-35 Hz"),
    ("2.3.1", "TB with 0 kg below 1 above 30 Hz"),
    ("2.3.1", "TB with 2.3 kg below 1 above 35 Hz"),
    ("2.3.1", "TB with 4.5 kg below 1 above 40 Hz"),
    ("2.3.1", "TB with 0 kg below 1 above 40 Hz"),
    ("2.3.1", "TB with 2.3 kg below 1 above 45 Hz"),
    ("2.3.1", "TB with 4.5 kg below 1 at 50 Hz"),
    ("2.3.1", "TM with 0 kg without a peak"),
    ("2.3.1", "TM with 0 kg below 1 above 25 Hz"),
    ("2.3.1", "TM with 2.3 kg without a peak"),
    ("2.3.1", "TM with 2.3 kg below 1 above 40 Hz"),
    ("2.3.1", "TM with 4.5 kg without a peak"),
    ("2.3.1", "TM with 4.5 kg below 1 above 40 Hz"),
    ("2.3.2", "MB differs between postures at 10 Hz only"),
    ("2.3.2", "TB differs between postures at 10 Hz only"),
    ("2.3.2", "TM does not differ between postures"),
    ("2.3.2", "MB in plantarflexion: plateau 15-25 Hz"),
    ("2.3.2", "MB in dorsiflexion without a resonance"),
)

#: Those of them that say from where on TB is below 1, which make one row: the text contradicts itself.
OF_TUBEROSITY = [says for _, says in STATEMENTS if says.startswith("TB with") and "below 1" in says]
FIRST_OF_TUBEROSITY = [says for _, says in STATEMENTS].index(OF_TUBEROSITY[0]) + 1

for _place, (_section, _says) in enumerate(STATEMENTS, 1):
    if _says not in OF_TUBEROSITY:
        ROWS.add(f"Finding {_section}, {_place}", _says, partial(stated, _says), STUDY_COMMAND, STUDY)
    elif _place == FIRST_OF_TUBEROSITY:  # in its place
        ROWS.add(
            "Finding 2.3.1, 19-24",
            "TB below 1 above 30, 35, 40 Hz with 0, 2.3, 4.5 kg; and again: above 40, above 45, at 50 Hz",
            tuberosity_below_one, STUDY_COMMAND, STUDY,
        )  # fmt: skip
