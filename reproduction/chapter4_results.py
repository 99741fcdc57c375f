"""Chapter 4, section 4.6: traces and constants of a virtual study, fitted recording by recording."""

from collections.abc import Iterable
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import f_oneway, spearmanr

from fasbody.laboratory.study import FREQUENCIES_HZ
from fasbody.recording.condition import ADDED_MASSES_KG
from fasbody.transmissibility.statistics import ALPHA
from identification.figures import save
from identification.study.summary import measured
from reproduction.boxes import boxes
from reproduction.check import Check, at_least, at_most, exactly, within
from reproduction.fitted import (
    BRANCHES,
    DRAWN,
    GROUP,
    STUDY_COMMAND,
    SUBJECTS,
    documents,
    fits,
    mean_at,
    on_branch,
    table,
)
from reproduction.row import Outcome, Rows

ROWS = Rows()
F = np.array(FREQUENCIES_HZ)
#: Frequencies with a mean, from which a trend is spoken of.
FEWEST = 5
_NO_STANDARD_ERROR = (
    "One sine has fewer numbers than there are constants, so an estimate from it has no standard error, and no mean "
    "is drawn of such estimates."
)
#: What sections 4.6 and 4.7 say of the fits.
STATED_PERCENT = (70.0, 90.0)


def traces(hertz: float) -> Outcome:
    """Measured and simulated malleolus of the drawn subject under three loads."""
    found = fits()
    at = (found["subject"] == DRAWN) & ((found["frequency_hz"] - hertz).abs() < 1)  # the frequency found, not that set
    percent = found[at]["fit_percent"]
    return Outcome(
        printed=[
            exactly("recordings of virtual subject 16 fitted", len(percent), len(ADDED_MASSES_KG)),
            within("least fit (stated: about 70-90 %)", percent.min(), *STATED_PERCENT, "%"),
            within("largest fit", percent.max(), *STATED_PERCENT, "%"),
        ],
        synthetic=True,
        note="A model fits the recordings of its own kind better than it fitted those of people.",
    )


for _number, _hertz in enumerate(FREQUENCIES_HZ, 6):
    ROWS.add(f"Fig. 4.{_number}", f"malleolus at {_hertz:g} Hz and the fitted model, three loads",
             partial(traces, _hertz), STUDY_COMMAND, GROUP)  # fmt: skip


def rank(values: np.ndarray) -> float:
    """Spearman's correlation of a mean curve with frequency, where it is known; 0 where at fewer than `FEWEST`."""
    known = np.isfinite(values)
    return float(spearmanr(F[known], values[known]).statistic) if known.sum() >= FEWEST else 0.0


def enough(means: Iterable[Iterable[np.ndarray]]) -> Check:
    """Whether mean curves of loads and branches can show a trend, as estimates without a standard error have none."""
    fewest = min(int(np.isfinite(mean).sum()) for both in means for mean in both)
    return at_least("fewest frequencies of 9 with a mean, any load and branch", fewest, FEWEST)


#: Correlation from which a mean curve has a trend: of nine frequencies, p = 0.05 for the largest of three loads.
TREND = 0.78


def rises(parameter: str, sign: int, by_load: bool) -> Outcome:
    """A constant that rises (1) or falls (-1) with frequency, and rises with load if stated; on both branches."""
    means = {load: [mean_at(parameter, load, F, first) for first in BRANCHES] for load in ADDED_MASSES_KG}
    true = true_means(parameter)
    ranks = {load: min(sign * rank(mean) for mean in both) for load, both in means.items()}
    name = f"{'rank' if sign > 0 else 'minus rank'} correlation of the mean with frequency, lesser of both branches"
    checks = [at_least(f"{name}, {load:g} kg", found, TREND) for load, found in ranks.items()]
    checks.append(enough(means.values()))
    missed = sum(sign * rank(true[load]) >= TREND and found < TREND for load, found in ranks.items())
    if by_load:
        light, *_, heavy = ADDED_MASSES_KG
        higher = min(int(np.sum(b > a)) for a, b in zip(means[light], means[heavy], strict=True))
        checks.append(at_least("frequencies of 9 at which the mean is higher with 4.5 kg than without", higher, 7))
        missed += int(np.sum(true[heavy] > true[light])) >= 7 > higher
    return Outcome(
        printed=checks,
        present=[at_least("of these, true of the constants and missed by the fit", missed, 1)],
        synthetic=True,
        note=known(parameter),
    )


def no_trend(parameter: str, by_frequency: bool) -> Outcome:
    """A constant that does not depend on the load and, if stated, shows no trend over frequency; on both branches."""
    differ = max(loads_differ(on_branch(parameter, first)) for first in BRANCHES)
    means = [[mean_at(parameter, load, F, first) for first in BRANCHES] for load in ADDED_MASSES_KG]
    name = "frequencies of 9 at which the loads differ (analysis of variance), more of both branches"
    checks = [at_most(name, differ, 2), enough(means)]
    if by_frequency:
        largest = max(abs(rank(mean)) for both in means for mean in both)
        name = "largest rank correlation of a mean with frequency, any load, any branch"
        checks.append(at_most(name, largest, TREND))
    return Outcome(
        printed=checks,
        present=[exactly("different true values", on_branch(parameter, True)["truth"].nunique(), 1)],
        synthetic=True,
        note=known(parameter),
    )


def loads_differ(rows: pd.DataFrame) -> int:
    """At how many frequencies the estimates under the loads differ significantly."""
    count = 0
    for _, at in rows[~rows["outlier"] & measured(rows)].groupby("frequency_hz"):
        groups = [group["value"] for _, group in at.groupby("added_mass_kg") if len(group) > 1]
        count += len(groups) > 1 and bool(f_oneway(*groups).pvalue < ALPHA)
    return count


def true_means(parameter: str) -> dict[float, np.ndarray]:
    """Mean of the true constants over subjects at the nine frequencies, by load."""
    true = on_branch(parameter, True).groupby(["added_mass_kg", "frequency_hz"])["truth"].mean()
    return {load: true[load].to_numpy() for load in ADDED_MASSES_KG}


def known(parameter: str) -> str:
    """How well one recording knows a constant, and what the true constants do."""
    if not measured(on_branch(parameter, True)).any():
        return _NO_STANDARD_ERROR
    shares = []
    for first in BRANCHES:
        rows = on_branch(parameter, first)
        shares.append(float(np.mean((rows["value"] - rows["truth"]).abs() <= 3 * rows["std_error"])))
    rows = on_branch(parameter, True)
    moves = rows["truth"].nunique() > 1
    ranks = ", ".join(f"{rank(true):.2f}" for true in true_means(parameter).values()) if moves else "none"
    return (
        f"Known to 10 %, the model assumed exact, in {np.mean(rows['verdict'] == 'identified'):.0%} of recordings; "
        f"truth within 3 standard errors in {shares[0]:.0%} on the first branch, in {shares[1]:.0%} on the other; "
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
for _number, _symbol, _by_frequency in (
    (20, "c_12", False), (21, "c_13", False), (24, "c_22", True), (25, "c_23", True)
):  # fmt: skip
    _over = "load or frequency" if _by_frequency else "load"
    ROWS.add(
        f"Fig. 4.{_number}",
        f"mean over subjects: {_symbol} without clear dependence on {_over}",
        partial(no_trend, _symbol, _by_frequency),
        STUDY_COMMAND,
        GROUP,
    )


def distributions(load: float) -> Outcome:
    """Figures D.1 to D.3: distributions of the eight constants and outliers beyond 1.5 interquartile ranges."""
    rows = table()
    rows = rows[rows["chosen"] & (rows["added_mass_kg"] == load) & (rows["parameter"] != "delay")]
    save(boxes(rows, "synthetic"), "svg")  # they can be drawn
    counted = rows[measured(rows)]
    name = "share of the estimates with a standard error that are outliers"
    return Outcome(
        printed=[
            exactly("constants times frequencies", rows.groupby(["parameter", "frequency_hz"]).ngroups, 72),
            at_least("of these, with a standard error in three subjects or more", _drawn(counted), 72),
            *([within(name, float(counted["outlier"].mean()), 0.0, 0.25)] if len(counted) else []),
        ],
        present=[exactly("recordings fitted", rows["key"].nunique(), SUBJECTS * F.size)],
        synthetic=True,
        note=_NO_STANDARD_ERROR,
    )


def _drawn(rows: pd.DataFrame) -> int:
    """Of how many constants and frequencies there is a distribution."""
    subjects = rows.groupby(["parameter", "frequency_hz"])["subject"].nunique()
    return int((subjects >= 3).sum())


#: Figures D.1 to D.3, which stand with the appendices.
APPENDIX = Rows()
for _number, _load in enumerate(ADDED_MASSES_KG, 1):
    APPENDIX.add(f"Fig. D.{_number}", f"distribution of the estimated constants, {_load:g} kg",
                 partial(distributions, _load), STUDY_COMMAND, GROUP)  # fmt: skip


@ROWS("Finding 4.6, 1", "the fit is 70-90 %, and worse at 10-20 Hz than above", STUDY_COMMAND, GROUP)
def fit_percentages() -> Outcome:
    percent = fits()
    low, high = (percent.query(text)["fit_percent"].mean() for text in ("frequency_hz < 22", "frequency_hz > 22"))
    return Outcome(
        printed=[
            within("mean fit", percent["fit_percent"].mean(), *STATED_PERCENT, "%"),
            at_least("mean above 20 Hz less that up to 20 Hz", high - low, 0, "points"),
        ],
        synthetic=True,
    )


@ROWS("Finding 4.6, 2", "implied by the figures: one frequency tells the fat pad from the ankle", STUDY_COMMAND, GROUP)
def branches() -> Outcome:
    verdicts = [document["result"]["verdict"] for document in documents()[0]]
    decided = sum(verdict.startswith("decided") for verdict in verdicts)
    share = decided / len(verdicts)
    return Outcome(
        printed=[at_least("share of recordings whose branch is decided at odds of 1000 to 1", share, 0.9)],
        present=[at_least(f"recordings of {len(verdicts)} that are", decided, 1)],
        synthetic=True,
        note="With known masses and the malleolus alone, stiffness and damping of both parts can change places.",
    )
