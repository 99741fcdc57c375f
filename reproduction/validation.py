"""The models beside measurements by others; see docs/credibility.md.

The thesis used few of these numbers; this project's nominal constants were chosen by many of them (Arch.nominal), and
what was chosen by a number cannot be validated by it. Such checks are marked as calibration.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.linear import linearise, response, transmissibility
from fasbody.arch.load import ARANGIO_CUT, ARANGIO_SAG, HEEL, MEASURED_HZ, LoadStudy, SagStudy, load_study, sag_study
from fasbody.heel.comparison import Task, judge
from fasbody.heel.stiffness import measured, of_model
from fasbody.heel.study import HeelStudy
from fasbody.laboratory.subject import constants
from reproduction.arch_validation.drop import MASS_KG
from reproduction.arch_validation.evidence import NUMBERS, Number
from reproduction.arch_validation.proofs import drop, proofs
from reproduction.arch_validation.validate import ship, validate
from reproduction.check import Check, at_least, at_most, near, within
from reproduction.row import Outcome, Rows

ROWS = Rows()
STATIC = "python -m fasbody.arch load"


@cache
def sag() -> SagStudy:
    """Nominal arch, spread to 20, 40 and 60 mm, under 683 N."""
    return sag_study(Arch.nominal(), np.array([0.02, 0.04, 0.06]))


@cache
def loads() -> LoadStudy:
    """Nominal arch under the added masses of Chapter 2."""
    return load_study(Arch.nominal())


def millimetres(what: str, value: float, measured: float, share: float) -> Check:
    """A sag in mm within a share of the published one."""
    return near(f"{what} (published {1e3 * measured:.1f})", 1e3 * value, 1e3 * measured, 1e3 * share * measured, "mm")


@ROWS(
    "Validation 1",
    "Arangio 1998, another model: sag of arches of 20 and 60 mm under 683 N, with and without fascia",
    STATIC,
)
def arangio_sag() -> Outcome:
    study, calibrated, added = sag(), [], []
    for place, height in ((0, 0.02), (2, 0.06)):
        with_fascia, cut = ARANGIO_SAG[height]
        name = f"{1e3 * height:.0f} mm arch"
        calibrated.append(millimetres(name, study.sag[place], with_fascia, 0.1))
        calibrated.append(millimetres(f"{name}, fascia cut", study.sag_cut[place], cut, 0.1))
        more = study.sag_cut[place] - study.sag[place]
        added.append(millimetres(f"what cutting it adds, {name}", more, cut - with_fascia, 0.2))
    return Outcome(
        calibrated=[*calibrated, *added],
        note="k_2 to k_4 and k_11 were chosen by these four numbers; that they come within 10 % hides that the fascia "
        "of a low arch does next to nothing in the model. Arangio computed them, nobody measured them.",
    )


@ROWS("Validation 2", "Arangio 1998, another model: cutting the fascia of a 60 mm arch", STATIC)
def arangio_cut() -> Outcome:
    study = sag()
    more_sag = study.sag_cut[2] / study.sag[2] - 1
    longer = study.elongation_cut[2] / study.elongation[2] - 1
    return Outcome(
        printed=[
            near("more elongation (published +40 %)", 100 * longer, 100 * ARANGIO_CUT[1], 5, "%"),
            near("more elongation over more sag (published 1.11)", longer / more_sag, 40 / 36, 0.17),
        ],
        calibrated=[near("more sag (published +36 %)", 100 * more_sag, 100 * ARANGIO_CUT[0], 5, "%")],
        note="+36 % is 7.5 over 5.5 mm, two of the numbers of Validation 1. No constant was chosen by the elongation, "
        "but geometry ties it to the sag whatever the springs: a k_11 that meets +36 % of sag misses +40 % of "
        "elongation. "
        "So the ratio is the independent number.",
    )


@ROWS("Validation 3", "Kim & Voloshin: share of the fascia 14 %, of the heel 63 %", STATIC)
def kim_voloshin() -> Outcome:
    return Outcome(
        printed=[near("share of the heel at 40 mm (published 63 %)", 100 * sag().heel[1], 100 * HEEL, 7, "%")],
        calibrated=[near("share of the fascia at 40 mm (published 14 %)", 100 * sag().share[1], 14, 5, "%")],
        note="k_11 was chosen by the share of the fascia. The share of the heel is a lever: it tests the lengths of "
        "Table 4.1 and none of the springs.",
    )


@ROWS("Validation 4", "Wee & Voloshin 2013: resonance at 15-25, 30-35, 35 Hz under 0, 2.3, 4.5 kg", STATIC)
def wee_voloshin() -> Outcome:
    ranges = {**MEASURED_HZ, 4.5: (35.0, 40.0)}
    free, *loaded = [
        within(f"peak of the nominal arch with {case.added_mass:g} kg", case.peak_hz, *ranges[case.added_mass], "Hz")
        for case in loads().cases
    ]
    return Outcome(
        printed=loaded,
        calibrated=[free],
        note="c_2 to c_4 were chosen by the peak without load. See the finding on load in Chapter 2.",
    )


@ROWS("Validation 5", "Goggins: ankle of 21 standing people peaks at 16-39 Hz (25-30 Hz at 25-50 Hz input)", STATIC)
def goggins() -> Outcome:
    f = np.arange(5.0, 80.0, 0.1)
    T = np.abs(transmissibility(Arch.nominal(), f))
    return Outcome(
        calibrated=[within("peak of the nominal arch, seated, unloaded", f[T.argmax()], 16, 39, "Hz")],
        note="The same peak as in Validation 4, chosen to lie at 15-25 Hz, most of which this range holds. Standing "
        "people carry their weight, the model only its shank.",
    )


@ROWS(
    "Validation 6",
    "Aruin & Zatsiorsky: ankle 14.9 +- 3.5 kN/m, 430 +- 36 N s/m under vibration",
    "python -m fasbody.laboratory S",
)
def aruin_zatsiorsky() -> Outcome:
    arch, subject, f = Arch.nominal(), constants(10.0, 0.0), np.arange(2.0, 80.0, 0.1)
    soft = np.abs(transmissibility(replace(arch, k_T=14.9e3), f))
    return Outcome(
        printed=[
            near("k_T of the nominal arch (measured 14.9 +- 3.5)", arch.k_T / 1e3, 14.9, 7, "kN/m"),
            within("peak of the nominal arch with the measured k_T (measured 15-25)", f[soft.argmax()], 15, 25, "Hz"),
            near("k_T of the virtual subject at 10 Hz (measured 14.9 +- 3.5)", subject["k_T"] / 1e3, 14.9, 7, "kN/m"),
            near("c_11 of the virtual subject at 10 Hz (measured 430 +- 36)", subject["c_11"], 430, 72, "N s/m"),
        ],
        calibrated=[near("c_T of the nominal arch (measured 430 +- 36)", arch.c_T, 430, 72, "N s/m")],
        note="c_T of the nominal arch was taken from this paper, its k_T was not; limits of two standard deviations.",
    )


@ROWS("Validation 7", "Gefen: plantar fascia 170 +- 45 N/mm", STATIC)
def gefen() -> Outcome:
    arch = Arch.nominal()
    return Outcome(
        printed=[near("k_11, after the dashpot has yielded", arch.k_11 / 1e3, 170, 45, "N/mm")],
        calibrated=[near("k_11 + k_12, before it yields", (arch.k_11 + arch.k_12) / 1e3, 170, 45, "N/mm")],
        note="k_12 is 170 N/mm less k_11 by choice. As a spring that never yields, 170 N/mm contradicts Arangio's sag "
        "(docs/load.md).",
    )


@ROWS("Validation 8", "Kinoshita 1993: heel-pad drop, 5 kg at 0.93 m/s: 11.6 g, 11.3 mm, 79 % absorbed")
def kinoshita() -> Outcome:
    arch = Arch.nominal()
    k, zeta = np.array([arch.k_F]), np.array([arch.c_F / (2 * np.sqrt(arch.k_F * MASS_KG))])
    peak, depth, absorbed = (float(each[0]) for each in drop(k, zeta))
    return Outcome(
        printed=[
            near("peak deceleration (measured 11.6)", peak, 11.6, 2.3, "g"),
            near("deepest compression (measured 11.3)", 1e3 * depth, 11.3, 2.3, "mm"),
            within("energy absorbed (measured 75-89)", 100 * absorbed, 75, 89, "%"),
        ],
        note="The constants of the nominal pad describe vibration of a loaded foot, not an impact; limits of 20 %.",
    )


@ROWS("Validation 9", "Aruin & Zatsiorsky: ankle 26.7 kN/m, 811 N s/m under impact")
def aruin_impact() -> Outcome:
    arch = Arch.nominal()
    return Outcome(
        printed=[
            near("k_T of the nominal arch (measured 26.7)", arch.k_T / 1e3, 26.7, 5.3, "kN/m"),
            near("c_T of the nominal arch (measured 811)", arch.c_T, 811, 162, "N s/m"),
        ],
        note="No scatter is given, so limits of 20 %. The nominal arch describes vibration, not an impact.",
    )


@ROWS("Validation 10", "Goggins: midfoot of 21 standing people peaks at 51-84 Hz")
def goggins_midfoot() -> Outcome:
    f, arch = np.arange(5.0, 150.0, 0.1), Arch.nominal()
    model = linearise(arch)
    rows = {  # joints of the arch, from the metatarsal side: what the links below them lift
        "between metatarsals and cuneiforms": model.out * [1, 0, 0, 0, 1, 0],
        "between cuneiforms and navicular": model.out * [1, 0, 0, 1, 1, 0],
    }
    peaks = {name: f[np.abs(response(replace(model, out=row), f)).argmax()] for name, row in rows.items()}
    return Outcome(
        printed=[within(f"peak of the joint {name}", peak, 51, 84, "Hz") for name, peak in peaks.items()],
        note="Seated and unloaded, where they stood. The toes (99-147 Hz) cannot be compared: the model has none.",
    )


HEEL_STRIKES = "python -m identification.heel"


@ROWS(
    "Validation 11", "Eq. 4.22-4.24 and k_F, judged by 216 heel strikes of eleven walkers (Baines 2018)", HEEL_STRIKES
)
def heel_strikes() -> Outcome:
    study = HeelStudy.read()
    groups = study.groups()
    error = {}
    for law in ("qlv", "nonlinear", "strain_damper", "power"):
        found = judge(Task(law, "loading", groups, study.digest))
        error[law] = 100 * float(np.mean([item["error"] for item in found["other_speed"]]))
    nominal, checks, limits = of_model()["nominal_n_per_m"], [], []
    for slope in measured(groups):
        (load,) = slope.names
        low, high = slope.interval("normal", load, new_person=True)[1:]
        limits.append((low, high))
        checks.append(
            within(
                f"nominal k_F against a walker's slope at {load}, 95 %", nominal / 1e3, low / 1e3, high / 1e3, "kN/m"
            )
        )
    lowest, highest = min(high for _, high in limits) / 1e3, max(low for low, _ in limits) / 1e3
    checks.append(at_least("room for any one linear spring to meet all three", lowest - highest, 0.0, "kN/m"))
    best = 1.1 * error["power"]
    for law, equation in (("qlv", "4.22"), ("nonlinear", "4.23"), ("strain_damper", "4.24")):
        what = (
            f"Eq. {equation}, slow strikes predict normal ones up to the peak: error (power law {error['power']:.3g})"
        )
        checks.append(within(what, error[law], 0.0, best, "%"))
    return Outcome(
        printed=checks,
        note="Compression is everything between skin and shank, and the heel is pressed at half a metre a second: "
        "neither is the vibration of a resting foot (docs/heel_pad.md).",
    )


ARCH = "python -m fasbody.arch validate"


def _checks(number: Number, values: np.ndarray) -> list[Check]:
    """What a leg says of one number, part by part."""
    return [
        within(f"{number.source}, {number.name}" + (f", {i + 1} of {len(values)}" if len(values) > 1 else ""),
               float(values[i]), number.low[i], number.high[i], number.unit) for i in range(len(values))
    ]  # fmt: skip


@ROWS("Validation 12", "an arch under a leg, the shipped set, beside what is published of feet", ARCH)
def shipped() -> Outcome:
    found: dict[bool, list[Check]] = {True: [], False: []}
    feet = ship()
    for number in NUMBERS:
        found[number.fitted] += _checks(number, number.predict(feet)[0])
    return Outcome(
        printed=found[False],
        calibrated=found[True],
        note="Tissue laws from samples, 14 free constants. Those of Arangio and of Kim & Voloshin come from models.",
    )


@ROWS("Validation 13", "the same, each number predicted by legs fitted to the others", ARCH)
def predicted() -> Outcome:
    checks, words = [], []
    for prediction in validate().predictions:
        checks += _checks(prediction.number, prediction.middle)
        words.append(prediction.verdict if prediction.basis == "independent" else prediction.basis)
    counts = ", ".join(f"{word} {words.count(word)}" for word in dict.fromkeys(words))
    return Outcome(
        printed=checks,
        note=f"Shown is the middle of 95 % intervals. With intervals and half of the legs inside: {counts}.",
    )


@ROWS("Validation 14", "what an arch of rigid bones cannot meet together, whatever its springs", ARCH)
def excluded() -> Outcome:
    checks = []
    for proof in proofs():
        bound = at_least if proof.above else at_most
        checks.append(bound(f"{proof.number}, {proof.holds} ({proof.against})", proof.bound, proof.needed, proof.unit))
    return Outcome(printed=checks, note="If the bound holds, no springs can give the published number.")
