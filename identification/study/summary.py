"""The fits of a study as tidy tables: a row a parameter, branch and condition; a row a cycle; a row a mode."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from fasbody.foot.parameters import symbol_and_unit
from identification.branches import STIFF_ANKLE, STIFF_PAD, misses
from identification.recommendations import LEAST_FIT, follows
from identification.study import VERDICTS
from identification.study.truth import Truth

Document = Mapping[str, Any]
#: Columns of summary.csv.
COLUMNS = (
    "mode", "subject", "posture", "added_mass_kg", "frequency_hz", "branch", "chosen", "parameter", "unit", "value",
    "std_error", "lower", "upper", "verdict", "outlier", "truth", "key", "tracked", "shown", "decided_by",
    "profile_lower", "profile_upper", "fit_percent", "at_bound",
)  # fmt: skip
#: Those that are neither text nor flags.
_NUMBERS = (
    "added_mass_kg", "frequency_hz", "value", "std_error", "lower", "upper", "truth", "profile_lower",
    "profile_upper", "fit_percent",
)  # fmt: skip
#: Columns of energy.csv.
CYCLES = (
    "mode", "subject", "posture", "key", "file", "added_mass_kg", "frequency_hz", "branch", "chosen", "ankle_j",
    "fat_pad_j", "shaker_work_j", "imbalance", "shown", "decided_by", "fit_percent",
)  # fmt: skip
#: What the subjects of one box have in common.
GROUP = ["mode", "posture", "added_mass_kg", "frequency_hz", "parameter"]
#: What may choose the branch that is shown, see `displayed_branch`; and those that leave it open.
DECIDED_BY = ("tracking", "likelihood", "undecided", "not compared", "no mirror")
OPEN = ("undecided", "not compared")
#: Fewest values that make a box, and how many interquartile ranges its whiskers reach.
FEWEST, _WHISKER = 4, 1.5
#: Difference of two costs that is none, in itself and as a share.
_SAME, _SAME_SHARE = 1e-2, 1e-6
#: Most fits below the limit that are named.
_LISTED = 10


def displayed_branch(document: Document, tracked: Mapping[str, str] | None = None) -> tuple[str, str]:
    """The branch of a fit that every table and figure shows, and what chose it.

    Args:
        document: a fit that is done.
        tracked: key of a fit -> its branch among all of the subject, or "undecided".

    Returns:
        Its name, and "tracking" where all fits of the subject together decide; else the likelier
        branch of the fit, and "likelihood" where its data decide alone, "undecided" where nothing
        does, "not compared" where it has no other (out of bounds, unstable), "no mirror" where the
        model has none that is known.
    """
    names = [branch["name"] for branch in document["result"]["branches"]]
    together = (tracked or {}).get(document["key"], "")
    if together in names:
        return together, "tracking"
    verdict = together or document["result"]["verdict"]
    if verdict == "not compared" and names[0] not in (STIFF_ANKLE, STIFF_PAD):
        verdict = "no mirror"
    return names[0], "likelihood" if verdict == "decided" else verdict


def misfit(document: Document) -> str:
    """Why a fit that is done says nothing of its foot; empty where it does.

    Such a fit has no odds, intervals or energies.
    """
    result = document["result"]
    best, goodness = result["branches"][0], result["goodness_of_fit"]
    world = best.get("world")
    alone = document["mode"] != "pooled" and result["domain"] == "periodic" and not world
    if alone and misses(goodness["chi_square"], goodness["dof"]):
        return "the model, assumed exact, does not fit the recording"
    if document["mode"] != "pooled" or (world["follows"] if world else follows(best["fit_percent"])):
        return ""
    if world:
        return "the fit does not follow the recordings"
    return f"the fit follows the recordings to less than {LEAST_FIT:g} %"


def measured(rows: pd.DataFrame) -> pd.Series:
    """Which estimates count in means, bands and boxes: those with a standard error, of a fit that follows.

    Without one are those at a bound, and those that the recording does not determine.
    """
    return rows["value"].notna() & np.isfinite(rows["std_error"]) & follows(rows["fit_percent"])


def tidy(
    documents: Iterable[Document],
    truth: Truth | None = None,
    tracked: Mapping[str, str] | None = None,
    profiles: Mapping[tuple[str, str], Document] | None = None,
) -> pd.DataFrame:
    """The table of summary.csv; failed fits have no row.

    Args:
        documents: fits as `OUT/fits` has them.
        truth: of a synthetic study.
        tracked: see `displayed_branch`.
        profiles: (key of a fit, parameter's key) -> profile of its chosen branch, whose verdict
            replaces that of the standard error, and whose open sides are empty.
    """
    done = (document for document in documents if document["status"] == "done")
    rows = (row for d in done for row in _rows(d, truth, tracked or {}, profiles or {}))
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    flags = dict.fromkeys(("chosen", "shown", "outlier", "at_bound"), bool)
    table = table.astype(dict.fromkeys(_NUMBERS, float) | flags)
    for _, group in table[table["shown"] & measured(table)].groupby(GROUP, dropna=False):
        table.loc[group.index, "outlier"] = outliers(group["value"].to_numpy())
    return table


def _rows(
    document: Document,
    truth: Truth | None,
    tracked: Mapping[str, str],
    profiles: Mapping[tuple[str, str], Document],
) -> Iterable[dict[str, Any]]:
    name, by = displayed_branch(document, tracked)
    shared = {column: document[column] for column in ("mode", "subject", "posture", "key", "added_mass_kg")}
    shared |= {"tracked": tracked.get(document["key"], ""), "decided_by": by, "outlier": False}
    f = document["frequency_hz"]
    shared["frequency_hz"] = None if f is None else nominal(f)
    known = truth.of(document["files"]) if truth else {}
    none = dict.fromkeys(("std_error", "lower", "upper")) if misfit(document) else {}
    for number, branch in enumerate(document["result"]["branches"]):
        of_branch = {"branch": branch["name"], "chosen": number == 0, "shown": branch["name"] == name}
        for key, e in branch["parameters"].items():
            symbol, unit = symbol_and_unit(key)
            profile = profiles.get((document["key"], key), {})
            profile = profile if profile.get("branch") == branch["name"] else {}
            yield {
                **shared, **of_branch, "parameter": symbol, "unit": unit,
                "fit_percent": branch["fit_percent"], "truth": known.get(symbol),
                **{column: e[column] for column in ("value", "std_error", "lower", "upper")},
                "verdict": word(document["mode"], branch, e["identifiability"], profile.get("verdict")),
                "profile_lower": None if profile.get("open_below") else profile.get("lower"),
                "profile_upper": None if profile.get("open_above") else profile.get("upper"),
                "at_bound": bool(e["at_bound"]), **none,
            }  # fmt: skip


def word(mode: str, branch: Document, verdict: str, profile: str | None) -> str:
    """The verdict of an estimate in the study, by that of its fit and that of its profile: the worse.

    One frequency identifies nothing, however small its standard error; neither does a fit that
    assumes the model exact, nor one of several recordings that does not follow them.
    """
    worst = max((v.partition(",")[0] for v in (verdict, profile) if v), key=VERDICTS.index)
    if mode == "pooled" and not follows(branch["fit_percent"]):
        return VERDICTS[-1]
    sure = mode == "pooled" and branch.get("world") is not None
    return worst if sure or worst != VERDICTS[0] else VERDICTS[1]


def quartiles(values: np.ndarray) -> tuple[float, float]:
    """Q1 and Q3 as section 4.6 has them: medians of lower and upper half, without the middle value."""
    x = np.sort(values)
    half = x.size // 2
    return float(np.median(x[:half])), float(np.median(x[x.size - half :]))


def outliers(values: np.ndarray) -> np.ndarray:
    """Which values (n,) lie 1.5 interquartile ranges beyond the quartiles; none of fewer than four."""
    known = np.isfinite(values)
    if known.sum() < FEWEST:
        return np.zeros(values.shape, bool)
    low, high = quartiles(values[known])
    reach = _WHISKER * (high - low)
    return known & ((values < low - reach) | (values > high + reach))


def displayed_fit(document: Document, tracked: Mapping[str, str] | None = None) -> float:
    """Fit percentage of the branch that is shown, the mean over its recordings."""
    name, _ = displayed_branch(document, tracked)
    branches = document["result"]["branches"]
    return float(next(b["fit_percent"] for b in branches if b["name"] == name))


def place(document: Document) -> str:
    """Subject, posture, load and frequency of a fit or check, as far as its recordings share them."""
    words = [f"subject {document['subject']}", document["posture"]]
    units = {"added_mass_kg": "kg", "frequency_hz": "Hz"}
    known = {name: unit for name, unit in units.items() if document[name] is not None}
    return ", ".join([*words, *(f"{document[name]:g} {unit}" for name, unit in known.items())])


def unfollowed_fits(
    documents: Iterable[Document], tracked: Mapping[str, str] | None = None
) -> list[tuple[Document, float]]:
    """Fits whose shown branch does not follow its recordings, and its percentage, the lowest first."""
    fits = [(d, displayed_fit(d, tracked)) for d in documents if d["status"] == "done"]
    return sorted((pair for pair in fits if not follows(pair[1])), key=lambda pair: pair[1])


def unfollowed_sentence(documents: Sequence[Document], tracked: Mapping[str, str] | None = None) -> str:
    """How many fits failed to fit, and which; empty where none did."""
    unfollowed = unfollowed_fits(documents, tracked)
    if not unfollowed:
        return ""
    count, done = len(unfollowed), sum(d["status"] == "done" for d in documents)
    listed = "; ".join(f"{d['mode']}, {place(d)}: {fit:.1f} %" for d, fit in unfollowed[:_LISTED])
    more = f"; and {count - _LISTED} more" if count > _LISTED else ""
    return (
        f"{count} of {done} fits follow their recordings to less than {LEAST_FIT:g} % ({listed}{more}). They "
        "are left out of means, bands, boxes and energies; more --starts or wider --bounds may find better ones."
    )


def one_set(documents: Iterable[Document]) -> tuple[bool, str]:
    """Whether one set of constants serves all frequencies of all pooled fits, and a sentence."""
    done = [d for d in documents if d["mode"] == "pooled" and d["status"] == "done"]
    worlds = list(filter(None, (d["result"]["branches"][0].get("world") for d in done)))
    serves, count = sum(bool(world["follows"]) for world in worlds), len(worlds)
    text = f"One set of constants describes all frequencies in {serves} of {count} pooled fits"
    if serves == count:
        return True, f"{text}." if count else ""
    others = "in the others " if serves else ""
    return False, (
        f"{text}: {others}the constants change with frequency, or the model is wrong. Constants of such a fit "
        "are not those of the foot."
    )


def first(documents: Sequence[Document], tracked: Mapping[str, str] | None = None) -> str:
    """What matters first, in one sentence: that constants change, else which fits do not follow.

    A fit of constants that change follows its recordings from no start, so only the first is stated.
    """
    serves, sentence = one_set(documents)
    return (serves and unfollowed_sentence(documents, tracked)) or sentence


def cycle_table(documents: Sequence[Document], tracked: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Energies of every cycle [J], a row a recording and branch: `CYCLES`; none of a `misfit`.

    Cycles may be of a foot that is no branch of the fit, such as the one a synthetic recording was
    made from.
    """
    rows = []
    for d in (d for d in documents if d["status"] == "done" and not misfit(d)):
        name, by = displayed_branch(d, tracked)
        percent = {branch["name"]: branch["fit_percent"] for branch in d["result"]["branches"]}
        for c in d.get("cycles") or []:
            parts = {"ankle_j": c["ankle"]["dissipated_j"], "fat_pad_j": c["fat_pad"]["dissipated_j"]}
            choice = {"shown": c["branch"] == name, "decided_by": by, "frequency_hz": nominal(c["frequency_hz"])}
            row = {**d, **c, **parts, **choice, "fit_percent": percent.get(c["branch"], np.nan)}
            rows.append({column: row[column] for column in CYCLES})
    return pd.DataFrame(rows, columns=list(CYCLES)).astype({"chosen": bool, "shown": bool})


def nominal(frequency_hz: float) -> float:
    """The frequency that was set, from the one found in a recording: to a tenth of a hertz."""
    return round(frequency_hz, 1)


def csv(table: pd.DataFrame) -> str:
    """A table as text: numbers of eight digits, empty where there is none."""
    return table.to_csv(index=False, float_format="%.8g", lineterminator="\n")


def counts(documents: Sequence[Document], tracked: Mapping[str, str] | None = None) -> pd.DataFrame:
    """One row a mode: fits, done, failed, recordings, mean fit [%], verdicts alone, seconds.

    `again` of `again_of` fits with several starts met their best end from a second start: the
    others may have missed a better one.
    """
    rows = []
    for mode in dict.fromkeys(d["mode"] for d in documents):
        of_mode = [d for d in documents if d["mode"] == mode]
        done = [d for d in of_mode if d["status"] == "done"]
        verdicts = [d["result"].get("verdict", "") for d in done]
        searches = [d["result"].get("starts") or () for d in done]
        started = [starts for starts in searches if len(starts) > 1 or any("hits" in s for s in starts)]
        rows.append({
            "mode": mode, "fits": len(of_mode), "done": len(done), "failed": len(of_mode) - len(done),
            "recordings": sum(len(d["result"]["recordings"]) for d in done),
            "fit_percent": float(np.mean([displayed_fit(d, tracked) for d in done])) if done else None,
            "decided": verdicts.count("decided"), "undecided": verdicts.count("undecided"),
            "again": sum(map(_met_again, started)), "again_of": len(started),
            "seconds": sum(d.get("seconds") or 0.0 for d in of_mode),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _met_again(starts: Sequence[Document]) -> bool:
    """Whether a second start ended where the best did; `hits` counts those of a steady side."""
    best, *others = sorted(starts, key=lambda s: s["cost"])
    if "hits" in best:
        return bool(best["hits"] > 1)
    near = best["cost"] + max(_SAME, _SAME_SHARE * best["cost"])
    return any(s["branch"] == best["branch"] and s["cost"] <= near for s in others)
