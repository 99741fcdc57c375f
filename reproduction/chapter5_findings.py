"""What sections 5.4 and 5.5 conclude about the cell."""

import numpy as np

from fasbody.cell.response import base_response
from fasbody.cell.sweep import YEAST_PA
from reproduction.chapter5 import GROUP, SWEEP, at_real_size, by_modulus, by_shape, summary, viscoelastic
from reproduction.row import Outcome, Rows, at_least, at_most, exactly, near, within

ROWS = Rows()


@ROWS("Finding 5.4, 1", "the first frequencies do not depend on the shape", SWEEP, GROUP)
def shape_does_not_matter() -> Outcome:
    first = by_shape().frequencies_hz[:, 0]
    ratio = summary().mean_hz[1] / summary().mean_hz[0]
    return Outcome(
        printed=[
            at_most("spread of f1 over four shapes, of its mean", 100 * np.ptp(first) / first.mean(), 2, "%"),
            near("f2 over f1, means", ratio, 18.15 / 18.07, 0.005),
        ]
    )


@ROWS("Finding 5.4, 2", "from mode 3 on, the narrower the cell the lower the frequency", SWEEP, GROUP)
def narrower_is_lower() -> Outcome:
    f = by_shape().frequencies_hz  # shapes from narrow to wide
    monotone = [bool(np.all(np.diff(f[:, mode]) > 0)) for mode in range(2, 10)]
    return Outcome(
        printed=[exactly("modes from 3 to 10 for which it holds", sum(monotone), 8)],
        instead=[
            within("modes for which it holds", sum(monotone), 2, 7),
            exactly("of modes 3 and 4", sum(monotone[:2]), 2),
        ],
    )


@ROWS("Finding 5.4, 3", "the frequency rises with the modulus", SWEEP, GROUP)
def modulus_matters() -> Outcome:
    first = by_modulus().frequencies_hz[:-1, 0]
    return Outcome(
        printed=[at_least("least rise of f1 from one modulus to the next", float(np.diff(first).min()), 0, "Hz")]
    )


@ROWS("Finding 5.5, 4", "1.4 kHz at 0.75 MPa, close to the 0.8-1.6 kHz measured on yeast", SWEEP, GROUP)
def yeast() -> Outcome:
    laws = [law(YEAST_PA) for law in summary().laws]
    last = by_modulus().analyses[-1]
    return Outcome(
        printed=[
            *(
                near(f"power law at 0.75 MPa, fitted {law.way}", hz, 1400, 100, "Hz")
                for law, hz in zip(summary().laws, laws, strict=True)
            ),
            near("the model itself at 0.75 MPa, on the thesis' scale", summary().direct_hz, 1400, 600, "Hz"),
        ],
        instead=[
            near("the model itself at 0.75 MPa, on the thesis' scale", summary().direct_hz, 243, 10, "Hz"),
            at_least(
                "share of the nucleus in the kinetic energy of that mode", last.descriptions[0].nucleus_share, 0.5
            ),
        ],
        note="With a nucleus of 400 Pa the first mode becomes the nucleus'; the law must not be extrapolated.",
    )


@ROWS(
    "Finding 5.5, 5",
    "frequencies near the natural one (18-25 Hz) are those that make bone cells grow (20-60 Hz)",
    "python -m fasbody.cell shake",
    GROUP,
)
def resonance_and_growth() -> Outcome:
    first = at_real_size().frequencies_hz[0]
    cell, solids = viscoelastic()
    motion = np.abs(base_response(cell, solids, np.array([20.0, 50.0])).at(20.0)[0]).max()
    return Outcome(
        printed=[within("first natural frequency of the cell at its real size", first, 20, 60, "Hz")],
        instead=[
            at_least("first natural frequency over 60 Hz", first / 60, 50),
            near("motion of the top over that of the dish at 20 Hz", float(motion), 1, 1e-3),
        ],
        note="Below its resonance a cell rides along with the dish.",
    )


@ROWS("Finding 5.5, 6", "damping is negligible for the frequencies", "python -m fasbody.cell shake", GROUP)
def damping_is_negligible() -> Outcome:
    from fasbody.cell.viscoelastic import damped_modes

    cell, solids = viscoelastic()
    damped = damped_modes(cell, solids, 1).frequencies_hz[0]
    shift = 100 * abs(damped / at_real_size().frequencies_hz[0] - 1)
    return Outcome(
        printed=[at_most("shift of f1 by a standard linear solid, half as stiff again when fast", shift, 2, "%")],
        instead=[within("the same shift", shift, 2, 20, "%")],
        note="The relaxation time, 20 us, is an assumption; nobody has measured one at this frequency. The thesis "
        "assumes the damping away and computes nothing.",
    )
