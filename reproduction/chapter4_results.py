"""Chapter 4, section 4.6: traces, hysteresis loops and constants of a virtual study, fitted recording by recording."""

from functools import partial

import numpy as np
from scipy.stats import spearmanr

from fasbody.subjects import ADDED_MASSES_KG
from fasbody.virtual_study import FREQUENCIES_HZ
from identification.study import figures
from identification.study.motion import figures as motion
from identification.study.summary import measured
from reproduction.fitted import GROUP, STUDY_COMMAND, chosen, documents, energies, fits, mean_at, table, told
from reproduction.row import Check, Outcome, Rows, at_least, at_most, exactly, within

ROWS = Rows()
F = np.array(FREQUENCIES_HZ)


def traces(hertz: float) -> Outcome:
    """Measured and simulated malleolus under three loads."""
    found = fits()
    percent = found[(found["frequency_hz"] - hertz).abs() < 1]["fit_percent"]  # the frequency found, not that set
    return Outcome(
        printed=[
            at_least("least fit over subjects and loads (stated: about 70-90 %)", percent.min(), 70, "%"),
            exactly("recordings fitted", len(percent), len({d["subject"] for d in documents()[0]}) * 3),
        ],
        synthetic=True,
    )


for _number, _hertz in enumerate(FREQUENCIES_HZ, 6):
    ROWS.add(f"Fig. 4.{_number}", f"malleolus at {_hertz:g} Hz and the fitted model, three loads",
             partial(traces, _hertz), STUDY_COMMAND, GROUP)  # fmt: skip


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


def loops(load: float) -> Outcome:
    """Loops of one load: does the fat pad dissipate more, and does that survive the mirror solution?"""
    cycles = energies().query(f"added_mass_kg == {load}")
    best, other = (cycles[cycles["chosen"] == flag] for flag in (True, False))
    more = [float(np.mean(part["fat_pad_j"] > part["ankle_j"])) for part in (best, other)]
    stored = [c for d in documents()[0] for c in d["cycles"] if c["chosen"] and d["added_mass_kg"] == load]
    picture = figures.save(
        motion.loops(
            [c for d in documents()[0] if d["subject"] == "1" for c in d["cycles"] if c["chosen"]], "synthetic"
        ),
        "svg",
    )
    return Outcome(
        printed=[at_least("share of recordings in which the fat pad dissipates more, likelier branch", more[0], 0.9)],
        coherent=[at_least("the same on the mirror branch, which fits alike", more[1], 0.9)],
        synthetic=True,
        note=f"{len(stored)} loops of each part, figure of {len(picture) / 1e3:.0f} kB.",
    )


for _number, _load in zip((15, 16, 17), ADDED_MASSES_KG, strict=True):
    ROWS.add(f"Fig. 4.{_number}", f"force against displacement of ankle and fat pad, {_load:g} kg",
             partial(loops, _load), STUDY_COMMAND, GROUP)  # fmt: skip


def rank(values: np.ndarray) -> float:
    """Spearman's correlation of a mean curve with frequency, where it is known."""
    known = np.isfinite(values)
    return float(spearmanr(F[known], values[known]).statistic)


def rises(parameter: str, sign: int, by_load: bool) -> Outcome:
    """A constant that rises (1) or falls (-1) with frequency, and rises with load if stated."""
    means = [mean_at(parameter, load, F) for load in ADDED_MASSES_KG]
    checks = [
        at_least(
            f"{'rank' if sign > 0 else 'minus rank'} correlation of the mean with frequency, {load:g} kg",
            sign * rank(mean),
            0.6,
        )
        for load, mean in zip(ADDED_MASSES_KG, means, strict=True)
    ]
    if by_load:
        both = np.isfinite(means[2]) & np.isfinite(means[0])
        higher = float(np.mean(means[2][both] > means[0][both]))
        checks.append(
            at_least(f"share of {both.sum()} frequencies at which the mean is higher with 4.5 kg than without",
                     higher, 0.75)
        )  # fmt: skip
    return Outcome(printed=checks, synthetic=True, note=known(parameter))


def no_trend(parameter: str) -> Outcome:
    """A constant without clear dependence on frequency: by all estimates, as means are known at few frequencies."""
    rows = [told(parameter, load) for load in ADDED_MASSES_KG]
    worst = max(abs(float(spearmanr(own["frequency_hz"], own["value"]).statistic)) for own in rows)
    return Outcome(
        printed=[at_most("largest rank correlation of the estimates with frequency under any load", worst, 0.7)],
        synthetic=True,
        note=known(parameter),
    )


def known(parameter: str) -> str:
    """How well one recording knows a constant, and what the true constants do."""
    rows = chosen(parameter)
    share = float(np.mean(rows["verdict"] == "identified"))
    right = (rows["value"] - rows["truth"]).abs() <= 3 * rows["std_error"]
    true = rows.groupby(["added_mass_kg", "frequency_hz"])["truth"].mean()
    ranks = (
        ", ".join(f"{rank(true[load].to_numpy()):.2f}" for load in ADDED_MASSES_KG) if true.nunique() > 1 else "none"
    )
    return (
        f"Identified to 10 % in {share:.0%} of recordings, truth within 3 standard errors in {np.mean(right):.0%}; "
        f"rank correlation of the true means with frequency: {ranks}."
    )


for _number, _symbol, _what, _sign, _by_load in (
    (18, "k_T", "stiffness of the ankle rises with frequency and load", 1, True),
    (19, "c_11", "damping of the ankle falls with frequency, and is higher with load at low ones", -1, False),
    (22, "k_F", "stiffness of the fat pad rises with frequency and load", 1, True),
    (23, "c_21", "damping of the fat pad rises with frequency and load", 1, True),
):
    ROWS.add(
        f"Fig. 4.{_number}",
        f"mean over subjects: {_what}",
        partial(rises, _symbol, _sign, _by_load),
        STUDY_COMMAND,
        GROUP,
    )
for _number, _symbol in ((20, "c_12"), (21, "c_13"), (24, "c_22"), (25, "c_23")):
    ROWS.add(
        f"Fig. 4.{_number}",
        f"mean over subjects: no clear trend of {_symbol}",
        partial(no_trend, _symbol),
        STUDY_COMMAND,
        GROUP,
    )


def boxes(load: float) -> Outcome:
    """Figures D.1 to D.3: distributions of the eight constants and outliers beyond 1.5 interquartile ranges."""
    rows = table()
    rows = rows[rows["chosen"] & (rows["added_mass_kg"] == load) & (rows["parameter"] != "delay")]
    picture = figures.save(figures.boxes(rows, "synthetic"), "svg")
    return Outcome(
        printed=[
            exactly("constants times frequencies", rows.groupby(["parameter", "frequency_hz"]).ngroups, 72),
            within(
                "share of the estimates with a standard error that are outliers",
                float(rows["outlier"].sum() / measured(rows).sum()),
                0.0,
                0.25,
            ),
            at_least("size of the figure", len(picture) / 1e3, 20, "kB"),
        ],
        synthetic=True,
    )


#: Figures D.1 to D.3, which stand with the appendices.
APPENDIX = Rows()
for _number, _load in enumerate(ADDED_MASSES_KG, 1):
    APPENDIX.add(f"Fig. D.{_number}", f"distribution of the estimated constants, {_load:g} kg",
                 partial(boxes, _load), STUDY_COMMAND, GROUP)  # fmt: skip


@ROWS("Finding 4.6, 1", "the fit is 70-90 %, and worse at 10-20 Hz than above", STUDY_COMMAND, GROUP)
def fit_percentages() -> Outcome:
    percent = fits()
    low, high = (percent.query(text)["fit_percent"].mean() for text in ("frequency_hz < 22", "frequency_hz > 22"))
    return Outcome(
        printed=[
            at_least("mean fit", percent["fit_percent"].mean(), 70, "%"),
            at_least("mean above 20 Hz less that up to 20 Hz", high - low, 0, "points"),
        ],
        synthetic=True,
    )


@ROWS("Finding 4.6, 2", "single recordings tell the fat pad from the ankle", STUDY_COMMAND, GROUP)
def branches() -> Outcome:
    verdicts = [document["result"]["verdict"] for document in documents()[0]]
    decided = sum(verdict.startswith("decided") for verdict in verdicts) / len(verdicts)
    return Outcome(
        printed=[at_least("share of recordings whose branch is decided at odds of 1000 to 1", decided, 0.9)],
        instead=[at_most("that share", decided, 0.5)],
        note="With known masses and the malleolus alone, stiffness and damping of both parts can change places.",
    )


@ROWS("Finding 4.6, 3", "the fat pad dissipates more than the ankle", STUDY_COMMAND, GROUP)
def pad_dissipates_more() -> Outcome:
    cycles = energies()
    best, other = (cycles[cycles["chosen"] == flag] for flag in (True, False))
    share = [float(np.median(p["fat_pad_j"] / (p["fat_pad_j"] + p["ankle_j"]))) for p in (best, other)]
    exchanged: list[Check] = [at_least("median share of the pad on the other branch", share[1], 0.5)]
    return Outcome(
        printed=[at_least("median share of the pad in the energy, likelier branch", share[0], 0.5)],
        coherent=exchanged,
        synthetic=True,
        note="The mirror solution exchanges the two energies; load or a second sensor decides, one frequency does not.",
    )
