"""Chapter 5: the cell's model, its natural frequencies and mode shapes, and what the chapter concludes from them."""

import tempfile
from functools import cache, partial
from pathlib import Path

import numpy as np

from fasbody.cell.analysis import Analysis, analyse, assemblies
from fasbody.cell.dome import SHAPES, Dome, Nucleus
from fasbody.cell.materials import MODULI_PA, PRESETS
from fasbody.cell.modal import direct, solve
from fasbody.cell.viscoelastic import ReducedCell, StandardLinearSolid, base_response, damped_modes
from reproduction.cell.sweep import YEAST_PA, Summary, Sweep, summarise, sweep_moduli, sweep_shapes
from reproduction.cell.verification import check_beams, check_sphere
from reproduction.check import at_least, at_most, exactly, near, within
from reproduction.row import TRANSCRIBED, Outcome, Rows

ROWS = Rows()
SWEEP, VERIFY, CELL = (f"python -m fasbody.cell {verb}".strip() for verb in ("sweep", "verify", ""))
GROUP = "cell"
REPRODUCED = PRESETS["as-reproduced"]


@cache
def folder() -> Path:
    """Where the meshes of this run are kept."""
    return Path(tempfile.mkdtemp(prefix="cell-"))


@cache
def by_shape() -> Sweep:
    """Figure 5.9 with the height that gives the printed volume."""
    return sweep_shapes(REPRODUCED, cache=folder())


@cache
def by_modulus() -> Sweep:
    """Figures 5.10, 5.11 and, beyond them, the modulus that section 5.5 extrapolates to."""
    return sweep_moduli(REPRODUCED, Dome(), moduli=(*MODULI_PA, YEAST_PA), cache=folder())


@cache
def summary() -> Summary:
    """Means, deviations and power laws of both."""
    return summarise(by_shape(), by_modulus())


@cache
def at_real_size() -> Analysis:
    """The cell of 100 x 40 um at its real size, with the density of water."""
    return analyse(*assemblies(Dome(), cache=folder()), PRESETS["si"], dome=Dome())


@cache
def viscoelastic() -> tuple[ReducedCell, tuple[StandardLinearSolid, StandardLinearSolid]]:
    """That cell of a standard linear solid, half as stiff again when fast, 20 us."""
    solid = StandardLinearSolid(0.5, 2e-5)
    return ReducedCell.of(at_real_size().model, 30), (solid, solid)


@ROWS("Eq. 5.1", "forced vibration with damping", "python -m fasbody.cell shake", GROUP)
def forced() -> Outcome:
    cell, solids = viscoelastic()
    modes = damped_modes(cell, solids, 2)
    response = base_response(cell, solids, np.array([20.0, 200.0]))
    return Outcome(
        printed=[
            at_most("residual of the damped modes", float(np.max(modes.residuals)), 1e-7),
            within("damping of the first mode, between none and critical", float(modes.damping[0]), 1e-6, 1),
            near("motion of the top along x at 20 Hz over the dish's", float(np.abs(response.at(20.0)[0][0])), 1, 1e-3),
        ],
        note="How large the damping is follows from the relaxation time, which is assumed; that it damps is checked.",
    )


@ROWS("Eq. 5.2-5.3", "undamped vibration as an eigenvalue problem", VERIFY)
def eigenvalue_problem() -> Outcome:
    checks = [*check_sphere()[:2], check_beams()[0]]
    cell = at_real_size()
    modes = solve(cell.model, 10, way=direct())
    apart = np.abs(cell.modes.frequencies_hz / modes.frequencies_hz - 1)
    return Outcome(
        printed=[
            *(at_most(f"error: {check.name}", check.error, check.allowed) for check in checks),
            at_most("residual of K phi - omega^2 M phi, largest of ten", float(np.max(modes.residuals)), 1e-6),
            at_most("LOBPCG against this factorisation, largest of ten frequencies", float(np.max(apart)), 1e-9),
        ]
    )


@ROWS("Fig. 5.1-5.3", "the cell as half an ellipsoid over four bases, with a nucleus", CELL)
def geometry() -> Outcome:
    volume = {h: np.array([Dome(a, b, h).volume_um3 for a, b in SHAPES]) * 1e-18 for h in (9.0, 10.0)}
    return Outcome(
        printed=[
            near(
                "volume at the stated height of 10 um, mean of the four", volume[10.0].mean(), 1.9e-14, 0.05e-14, "m^3"
            ),
            near("volume of the nucleus", Nucleus().volume_um3 * 1e-18, 1.05e-16, 0.005e-16, "m^3"),
        ],
        right=[
            near("volume at 9 um, mean of the four", volume[9.0].mean(), 1.9e-14, 0.05e-14, "m^3"),
            near("volume of the nucleus", Nucleus().volume_um3 * 1e-18, 1.05e-16, 0.005e-16, "m^3"),
        ],
    )


@ROWS(
    "Table 5.1",
    "moduli of cytoplasm, nucleus, membrane and cytoskeleton in other work",
    "python -m fasbody.cell --membrane --filaments 1",
    GROUP,
)
def literature() -> Outcome:
    from fasbody.cell.cytoskeleton import Tensegrity
    from fasbody.cell.membrane import Membrane

    skeleton, cell = Tensegrity(bundle=1.0), PRESETS["si"]
    pairs = [  # ours and the row that three of the four sources share [Pa]
        (cell.cytoplasm.E, 100.0), (cell.cytoplasm.nu, 0.37), (cell.nucleus.E, 400.0), (cell.nucleus.nu, 0.37),
        (Membrane().E, 1e3), (Membrane().nu, 0.3), (skeleton.strut_E, 1.2e9), (skeleton.cable_E, 2.6e9),
    ]  # fmt: skip
    plain = at_real_size().frequencies_hz[0]
    pair = assemblies(Dome(), cache=folder())
    skin = analyse(pair[0], None, PRESETS["si"], count=2, membrane=Membrane()).frequencies_hz[0]
    bars = analyse(pair[0], None, PRESETS["si"], count=2, cytoskeleton=skeleton).frequencies_hz[0]
    return Outcome(
        printed=[
            exactly("values of Table 5.1 that the models have otherwise", sum(a != b for a, b in pairs), 0),
            within("first frequency with the table's membrane, over that without", skin / plain, 1, 1.01),
            within("the same with its microtubules and filaments as a tensegrity", bars / plain, 1.01, 1.1),
        ],
        note="Struts and cables are bars, without Poisson's ratio. The thesis lists these values and leaves "
        "membrane and cytoskeleton out of its model.",
    )


@ROWS("Table 5.2", "moduli, Poisson's ratio and density of the model", SWEEP)
def table_5_2() -> Outcome:
    text, table = {30, 100, 500, 1000, 5000, 15000}, {30, 100, 1000, 5000, 10000}
    per_mm3 = 1.25e-7 / 1e-9
    return Outcome(
        printed=[
            exactly("moduli that text and table do not share", len(text ^ table), 0),
            within("density of a cell as printed", 1.25e-7, 900, 1200, "kg/m^3"),
        ],
        right=[
            near(
                "the printed number per mm^3, which gives the printed frequencies",
                per_mm3,
                REPRODUCED.cytoplasm.rho,
                1e-9,
                "kg/m^3",
            ),
            exactly("moduli of either list that the sweep has", len((text | table) & set(MODULI_PA)), 7),
        ],
        note=f"{TRANSCRIBED} Even so the density is an eighth of water's; `--preset si` has 1000 kg/m^3.",
    )


@ROWS("Fig. 5.4", "the mesh of 10-node tetrahedra", VERIFY, GROUP)
def mesh() -> Outcome:
    analysis = at_real_size()
    errors = analysis.errors if analysis.errors is not None else np.array([np.nan])
    return Outcome(
        printed=[
            at_least("least Jacobian over the mean", analysis.model.assembly.mesh.quality.det_j_min, 0.05),
            at_most("estimated error of the first frequency", float(errors[0]), 0.01),
        ],
        note=f"{analysis.model.assembly.dof} unknowns.",
    )


def mode_shapes(shape: int) -> Outcome:
    """Figures 5.5 to 5.8: sway along z, sway along x, twist, compression."""
    analysis = by_shape().analyses[shape]
    labels = [mode.label for mode in analysis.descriptions[:5]]
    wide = analysis.frequencies_hz[1] / analysis.frequencies_hz[0] - 1
    place = labels.index("x compression") if "x compression" in labels else -1
    sways = {label for label in labels[:2] if label in ("z sway", "x sway")}
    return Outcome(
        printed=[
            exactly("of modes 1 and 2, sways along z and x", len(sways), 2),
            exactly("mode 3 twists about y (1: yes)", labels[2] == "twist about y", 1),
            within("number of the mode that compresses along x", place + 1, 4, 5),
        ],
        note=f"Modes 1 to 5: {', '.join(labels)}; the first two are {wide:.2%} apart.",
    )


for _shape, (_length, _width) in enumerate(SHAPES):
    _what = f"mode shapes of the cell of {_length:g} x {_width:g} um"
    ROWS.add(f"Fig. 5.{5 + _shape}", _what, partial(mode_shapes, _shape), SWEEP + " --out results/cell", GROUP)


@ROWS(
    "Fig. 5.9", "natural frequencies over the shape: 18.07 and 18.15 Hz, means of ten modes 18 to 25 Hz", SWEEP, GROUP
)
def frequencies_by_shape() -> Outcome:
    own = summary()
    real = at_real_size().frequencies_hz[0]
    return Outcome(
        printed=[within("first frequency of the cell at its real size", real, 17.9, 18.3, "Hz")],
        right=[
            near("mean of f1 with lengths in mm for um and 9 um for 10", own.mean_hz[0], 18.07, 0.1, "Hz"),
            near("its deviation over the shapes", own.std_hz[0], 0.08, 0.03, "Hz"),
            near("mean of f2", own.mean_hz[1], 18.15, 0.1, "Hz"),
            near("its deviation", own.std_hz[1], 0.03, 0.02, "Hz"),
            near("mean of f10", own.mean_hz[9], 25, 0.5, "Hz"),
            near("first frequency at real size and density of water", real, 6400, 50, "Hz"),
        ],
        note="The 18 Hz are those of a body 10 cm long (docs/cell.md).",
    )


@ROWS("Fig. 5.10-5.11", "first frequency over the modulus: 10 Hz at 30 Pa, 211 Hz at 15 kPa, a power law", SWEEP, GROUP)
def frequencies_by_modulus() -> Outcome:
    first = {a.model.materials[0].E: a.frequencies_hz[0] for a in by_modulus().analyses}
    return Outcome(
        printed=[
            near("f1 at 30 Pa", first[30.0], 10, 0.5, "Hz"),
            near("f1 at 15,000 Pa", first[15000.0], 211, 2, "Hz"),
            *(within(f"exponent, fitted {law.way}", law.b, 0.48, 0.5) for law in summary().laws),
        ],
        note="On the thesis' scale, lengths in mm for um and a height of 9 um.",
    )
