"""What sections 5.4 and 5.5 conclude about the cell."""

import numpy as np

from fasbody.cell.viscoelastic import ReducedCell, StandardLinearSolid, base_response, damped_modes
from reproduction.cell.sweep import YEAST_PA, Sweep
from reproduction.chapter5 import GROUP, SWEEP, at_real_size, by_modulus, by_shape, summary, viscoelastic
from reproduction.check import at_least, at_most, exactly, near, within
from reproduction.row import Outcome, Rows

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
    f = by_shape().frequencies_hz[:, 2:]  # shapes from narrow to wide, modes 3 to 10
    steps, certain = np.diff(f, axis=0), beyond_the_mesh(by_shape())[:, 2:]
    rise, fall = steps > 0, (steps < 0) & certain
    return Outcome(
        printed=[
            exactly("modes from 3 to 10 in which the narrowest is below the widest, of 8", np.sum(f[-1] > f[0]), 8),
            exactly(f"steps of {steps.size} to the next shape that fall by more than the mesh's error", fall.sum(), 0),
        ],
        instead=[
            exactly("modes in which the narrowest is below the widest", np.sum(f[-1] > f[0]), 8),
            within("steps that fall by more than the mesh's error", fall.sum(), 1, 6),
            exactly("of them in modes 3 and 4", fall[:, :2].sum(), 0),
        ],
        note=f"{rise.sum()} of {steps.size} steps rise; {np.sum(~certain)} are within the error. Modes "
        f"{', '.join(str(3 + mode) for mode in np.flatnonzero(~fall.any(axis=0)))} hold step by step.",
    )


def beyond_the_mesh(sweep: Sweep) -> np.ndarray:
    """Which steps from shape to shape, (shapes - 1, modes), exceed the larger estimated error of their two ends."""
    nothing_known = np.full(sweep.frequencies_hz.shape[1], np.inf)
    errors = np.array([nothing_known if a.errors is None else a.errors for a in sweep.analyses])
    relative = np.abs(np.diff(sweep.frequencies_hz, axis=0)) / sweep.frequencies_hz[:-1]
    return relative > np.maximum(errors[:-1], errors[1:])


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


#: Relaxation times [s] and the share of stiffness that relaxes, all assumed: nobody measured them at kilohertz.
ASSUMED_TAU_S = (2e-6, 2e-5, 2e-4)
ASSUMED_G = 0.5


@ROWS("Finding 5.5, 6", "damping is negligible for the frequencies", "python -m fasbody.cell shake", GROUP)
def damping_is_negligible() -> Outcome:
    cell = ReducedCell.of(at_real_size().model, 30)
    shifts, by_damping = [], []
    for tau in ASSUMED_TAU_S:
        solid = StandardLinearSolid(ASSUMED_G, tau)
        modes = damped_modes(cell, (solid, solid), 1)
        shifts.append(100 * (modes.frequencies_hz[0] / at_real_size().frequencies_hz[0] - 1))
        by_damping.append(100 * (1 - np.sqrt(1 - modes.damping[0] ** 2)))
    times = ", ".join(f"{1e6 * tau:g}" for tau in ASSUMED_TAU_S)
    return Outcome(
        printed=[at_most(f"fall of f1 by its damping ratio alone, most of {times} us", max(by_damping), 2, "%")],
        missing="the relaxation time of a cell at kilohertz",
        note="An assumption of the thesis (section 5.3), which computes nothing of it. With a solid half as stiff "
        f"again when fast (assumed, too) f1 rises by {', '.join(f'{shift:.2g}' for shift in shifts)} % at {times} us: "
        "that is stiffening, not damping.",
    )
