"""Chapter 6: what the thesis concludes, each from rows of the chapters before."""

from collections.abc import Sequence

import numpy as np

from fasbody.transmissibility.findings import LOADS
from fasbody.transmissibility.table import Table
from identification.blackbox import published
from reproduction.chapter3_findings import RANK_UNKNOWN
from reproduction.chapter5 import GROUP, SWEEP, at_real_size, by_modulus, summary
from reproduction.row import Check, Outcome, Rows, at_least, at_most, exactly, near, within
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
