"""Chapter 6: what the thesis concludes, each from rows of the chapters before."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fasbody.transmissibility.findings import LOADS
from fasbody.transmissibility.table import Table
from reproduction import published
from reproduction.chapter3_findings import PUBLISHED, RANK_UNKNOWN
from reproduction.chapter3_tables import range_of_fits
from reproduction.chapter4_energy import pad_dissipates_more
from reproduction.chapter4_results import rises
from reproduction.chapter5 import GROUP, SWEEP, at_real_size, by_modulus, summary
from reproduction.check import Check, at_least, at_most, exactly, near, within
from reproduction.fitted import GROUP as FITS
from reproduction.fitted import STUDY_COMMAND as FIT_COMMAND
from reproduction.row import Outcome, Rows
from reproduction.virtual import STUDY, STUDY_COMMAND, judged

ROWS = Rows()


@ROWS(
    "Finding 6, 1",
    "transmissibility falls with frequency, and load moves the resonance from 20 to 30-40 Hz",
    STUDY_COMMAND,
    STUDY,
)
def load_and_resonance() -> Outcome:
    def judge(table: Table) -> Sequence[Check]:
        curves = [table.curves("MB", *condition) for condition in LOADS]
        tops = [float(c.frequency_hz[c.mean.argmax()]) for c in curves]
        return [
            at_most("unloaded mean MB at 50 Hz over that at 10 Hz", float(curves[0].mean[-1] / curves[0].mean[0]), 1),
            within("highest mean with 2.3 kg", tops[1], 30, 40, "Hz"),
            within("highest mean with 4.5 kg", tops[2], 30, 40, "Hz"),
        ]

    note = "In the virtual subject the peaks come from constants that rise with frequency; such a peak is no mode."
    return judged(judge, note)


@ROWS("Finding 6, 2", "more mass on the knee transmits more at 30-40 Hz", STUDY_COMMAND, STUDY)
def more_mass_transmits_more() -> Outcome:
    def judge(table: Table) -> Sequence[Check]:
        free, *heavy = (table.curves("MB", *condition).mean[4:7] for condition in LOADS)
        least = float(min(np.min(c - free) for c in heavy))
        return [at_least("least increase of mean MB at 30-40 Hz by a load", least, 0)]

    return judged(judge)


@ROWS(
    "Finding 6, 3",
    "state-space orders of 2 to 8 guide the order of the physical model",
    "python examples/single_sine.py",
)
def guide() -> Outcome:
    orders = published.table()["ss_order"]
    states = {"two masses": 4, "five bodies": 11}
    within_range = [orders.min() <= n <= orders.max() for n in states.values()]
    return Outcome(
        printed=[
            at_most(
                "share of printed state-space orders outside of 2 to 8", float(np.mean(~orders.between(2, 8))), 0.05
            ),
            exactly("states of the two-mass foot within the printed orders (1: yes)", within_range[0], 1),
        ],
        missing=RANK_UNKNOWN,
        note=f"A state-space model of the smallest printed order has {2 * orders.min() + 1} coefficients, a pure sine "
        f"determines {published.SINE_RANK}, the bundled series with their harmonics {published.HARMONICS_RANK}; see "
        "finding 4 of section 3.3.",
    )


def stiffer() -> Outcome:
    """Ankle and fat pad both stiffer with load and frequency: Figures 4.18 and 4.22 together."""
    ankle, pad = (rises(stiffness, 1, True) for stiffness in ("k_T", "k_F"))
    return Outcome(
        printed=[
            replace(check, what=f"{stiffness}: {check.what}")
            for stiffness, part in (("k_T", ankle), ("k_F", pad))
            for check in part.printed
        ],
        present=[at_least("missed by the fits, of either", sum(part.present[0].value for part in (ankle, pad)), 1)],
        synthetic=True,
        note="Details under Fig. 4.18 and Fig. 4.22.",
    )


@ROWS(
    "Finding 6, 4", "natural frequencies of 18-25 Hz whatever the shape, 10-211 Hz whatever the modulus", SWEEP, GROUP
)
def cell_frequencies() -> Outcome:
    means, first = summary().mean_hz, by_modulus().frequencies_hz[:-1, 0]
    real = at_real_size().frequencies_hz[0]
    return Outcome(
        printed=[within("first frequency at real size", real, 18, 25, "Hz")],
        right=[
            near("mean of mode 1 on the thesis' scale", means[0], 18, 0.5, "Hz"),
            near("mean of mode 10", means[9], 25, 0.5, "Hz"),
            near("f1 at 30 Pa", first[0], 10, 0.5, "Hz"),
            near("f1 at 15 kPa", first[-1], 211, 2, "Hz"),
            near("first frequency at real size", real, 6400, 50, "Hz"),
        ],
    )


ROWS.add("Finding 6, 5", "the fat pad dissipates more than the ankle", pad_dissipates_more, FIT_COMMAND, FITS)
ROWS.add("Finding 6, 6", "ankle and fat pad stiffen with load and frequency", stiffer, FIT_COMMAND, FITS)
ROWS.add("Finding 6, 7", "fits of 60 to 98 % (Abstract, too)", range_of_fits, PUBLISHED)
