"""The fits of a study as one tidy table: a row a parameter, branch and condition, and which of them are outliers."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from fasbody.foot.parameters import symbol_and_unit
from identification.branches import STIFF_ANKLE, STIFF_PAD
from identification.recommendations import LEAST_FIT, follows
from identification.study.truth import Truth

#: Columns of summary.csv.
COLUMNS = (
    "mode", "subject", "posture", "added_mass_kg", "frequency_hz", "branch", "chosen", "parameter", "unit", "value",
    "std_error", "lower", "upper", "verdict", "outlier", "truth", "key", "tracked", "shown", "decided_by",
    "profile_lower", "profile_upper", "fit_percent",
)  # fmt: skip
#: What the subjects of one box have in common.
GROUP = ["mode", "posture", "added_mass_kg", "frequency_hz", "parameter"]
#: What may choose the branch that is shown, see `displayed_branch`; and those that leave it open.
DECIDED_BY = ("tracking", "likelihood", "undecided", "not compared", "no mirror")
OPEN = ("undecided", "not compared")
#: How well an estimate is known, best first.
VERDICTS = ("identified", "weak", "not identifiable")
#: Fewest values that make a box, and how many interquartile ranges its whiskers reach.
FEWEST, _WHISKER = 4, 1.5
#: Difference of two costs that is none, in itself and as a share.
_SAME, _SAME_SHARE = 1e-2, 1e-6
#: Most fits below the limit that are named, and the mode that is expected to have some.
_LISTED, _POOLED = 10, "pooled"


def displayed_branch(document: Mapping[str, Any], tracked: Mapping[str, str] | None = None) -> tuple[str, str]:
    """The branch of a fit that every table and figure shows, and what chose it.

    Args:
        document: a fit that is done.
        tracked: key of a fit -> its branch among all of the subject, or "undecided".

    Returns:
        Its name, and "tracking" where all fits of the subject together decide; else the likelier branch of the fit, and
        "likelihood" where its data decide alone, "undecided" where nothing does, "not compared" where it has no other
        (out of bounds, unstable), "no mirror" where the model has none that is known.
    """
    names = [branch["name"] for branch in document["result"]["branches"]]
    together = (tracked or {}).get(document["key"], "")
    if together in names:
        return together, "tracking"
    verdict = together or document["result"]["verdict"]
    if verdict == "not compared" and names[0] not in (STIFF_ANKLE, STIFF_PAD):
        verdict = "no mirror"
    return names[0], "likelihood" if verdict == "decided" else verdict


def measured(rows: pd.DataFrame) -> pd.Series:
    """Which estimates count in means, bands and boxes: those with a standard error, of a fit that follows its data.

    Without one are those at a bound, and those that the recording does not determine.
    """
    return rows["value"].notna() & np.isfinite(rows["std_error"]) & follows(rows["fit_percent"])


def tidy(
    documents: Iterable[Mapping[str, Any]], truth: Truth | None = None, tracked: Mapping[str, str] | None = None,
    profiles: Mapping[tuple[str, str], Mapping[str, Any]] | None = None,
) -> pd.DataFrame:  # fmt: skip
    """The table of summary.csv; failed fits have no row.

    Args:
        documents: fits as `OUT/fits` has them.
        truth: of a synthetic study.
        tracked: see `displayed_branch`.
        profiles: (key of a fit, parameter's key) -> profile of its chosen branch, whose verdict replaces that of the
            standard error, and whose open sides are empty.
    """
    rows = []
    for document in documents:
        if document["status"] == "done":
            name, by = displayed_branch(document, tracked)
            choice = {"tracked": (tracked or {}).get(document["key"], ""), "decided_by": by}
            of_fit = _rows(document, truth, profiles or {})
            rows += [{**row, **choice, "shown": row["branch"] == name} for row in of_fit]
    table = pd.DataFrame(rows, columns=[c for c in COLUMNS if c != "outlier"])
    numbers = ["added_mass_kg", "frequency_hz", "value", "std_error", "lower", "upper", "truth"]
    numbers += ["profile_lower", "profile_upper", "fit_percent"]
    table[numbers] = table[numbers].astype(float)
    table = table.astype({"chosen": bool, "shown": bool})
    table["outlier"] = False
    for _, group in table[table["shown"] & measured(table)].groupby(GROUP, dropna=False):
        table.loc[group.index, "outlier"] = outliers(group["value"].to_numpy())
    return table[list(COLUMNS)]


def _rows(
    document: Mapping[str, Any], truth: Truth | None, profiles: Mapping[tuple[str, str], Mapping[str, Any]]
) -> Iterable[dict[str, Any]]:
    shared = {name: document[name] for name in ("mode", "subject", "posture", "key")}
    f = document["frequency_hz"]
    at = {"added_mass_kg": document["added_mass_kg"], "frequency_hz": None if f is None else nominal(f)}
    known = truth.of(document["files"]) if truth else {}
    for number, branch in enumerate(document["result"]["branches"]):
        for key, e in branch["parameters"].items():
            symbol, unit = symbol_and_unit(key)
            profile = profiles.get((document["key"], key), {})
            if profile.get("branch") != branch["name"]:
                profile = {}
            yield {
                **shared, **at, "branch": branch["name"], "chosen": number == 0, "parameter": symbol, "unit": unit,
                "fit_percent": branch["fit_percent"],
                **{name: e[name] for name in ("value", "std_error", "lower", "upper")},
                "verdict": word(document["mode"], branch, e["identifiability"], profile.get("verdict")),
                "truth": known.get(symbol),
                "profile_lower": None if profile.get("open_below") else profile.get("lower"),
                "profile_upper": None if profile.get("open_above") else profile.get("upper"),
            }  # fmt: skip


def word(mode: str, branch: Mapping[str, Any], verdict: str, profile: str | None) -> str:
    """The verdict of an estimate in the study, by that of its fit and that of its profile: the worse of both.

    One frequency identifies nothing (`truth.LIMITS`), however small its standard error; neither does a fit that
    assumes the model exact, nor one of several recordings that does not follow them.
    """
    worst = max((v.partition(",")[0] for v in (verdict, profile) if v), key=VERDICTS.index)
    if mode == _POOLED and not follows(branch["fit_percent"]):
        return VERDICTS[-1]
    sure = mode == _POOLED and branch.get("world") is not None
    return worst if sure or worst != VERDICTS[0] else VERDICTS[1]


def quartiles(values: np.ndarray) -> tuple[float, float]:
    """Q1 and Q3 as section 4.6 defines them: medians of the lower and the upper half, without the middle value."""
    x = np.sort(values)
    half = x.size // 2
    return float(np.median(x[:half])), float(np.median(x[x.size - half :]))


def outliers(values: np.ndarray) -> np.ndarray:
    """Which values (n,) lie more than 1.5 interquartile ranges beyond the quartiles; none of fewer than four."""
    known = np.isfinite(values)
    if known.sum() < FEWEST:
        return np.zeros(values.shape, bool)
    low, high = quartiles(values[known])
    reach = _WHISKER * (high - low)
    return known & ((values < low - reach) | (values > high + reach))


def displayed_fit(document: Mapping[str, Any], tracked: Mapping[str, str] | None = None) -> float:
    """Fit percentage of the branch that is shown, the mean over its recordings."""
    name, _ = displayed_branch(document, tracked)
    return float(next(b["fit_percent"] for b in document["result"]["branches"] if b["name"] == name))


def place(document: Mapping[str, Any]) -> str:
    """Subject, posture, load and frequency of a fit or check, as far as its recordings share them."""
    words = [f"subject {document['subject']}", document["posture"]]
    words += [f"{document['added_mass_kg']:g} kg"] if document["added_mass_kg"] is not None else []
    words += [f"{document['frequency_hz']:g} Hz"] if document["frequency_hz"] is not None else []
    return ", ".join(words)


def unfollowed_fits(
    documents: Iterable[Mapping[str, Any]], tracked: Mapping[str, str] | None = None
) -> list[tuple[Mapping[str, Any], float]]:
    """Fits whose shown branch does not follow its recordings, with its fit percentage, the lowest first."""
    fits = [(d, displayed_fit(d, tracked)) for d in documents if d["status"] == "done"]
    return sorted(((d, fit) for d, fit in fits if not follows(fit)), key=lambda pair: pair[1])


def unfollowed_sentence(documents: Sequence[Mapping[str, Any]], tracked: Mapping[str, str] | None = None) -> str:
    """How many fits failed to fit, and which; empty where none did."""
    unfollowed, done = unfollowed_fits(documents, tracked), sum(d["status"] == "done" for d in documents)
    if not unfollowed:
        return ""
    listed = "; ".join(f"{d['mode']}, {place(d)}: {fit:.1f} %" for d, fit in unfollowed[:_LISTED])
    more = f"; and {len(unfollowed) - _LISTED} more" if len(unfollowed) > _LISTED else ""
    return (
        f"{len(unfollowed)} of {done} fits follow their recordings to less than {LEAST_FIT:g} % ({listed}{more}). They "
        "are left out of means, bands, boxes and energies; more --starts or wider --bounds may find better ones."
    )


def _serving(documents: Iterable[Mapping[str, Any]]) -> tuple[int, int]:
    """In how many pooled fits one set of constants serves all frequencies, and of how many."""
    fits = [d for d in documents if d["mode"] == _POOLED and d["status"] == "done" and d["frequency_hz"] is None]
    serves = [d for d in fits if all((b.get("world") or {}).get("follows") for b in d["result"]["branches"][:1])]
    return len(serves), len(fits)


def one_set(documents: Iterable[Mapping[str, Any]]) -> str:
    """Whether one set of constants serves all frequencies, by the pooled fits; empty where there are none."""
    serves, count = _serving(documents)
    text = f"One set of constants serves all frequencies in {serves} of {count} pooled fits"
    if serves == count:
        return f"{text}." if count else ""
    return (
        f"{text}: in the others the constants change with frequency, or the model is another one, and such a fit says "
        "nothing of the foot but that."
    )


def first(documents: Sequence[Mapping[str, Any]], tracked: Mapping[str, str] | None = None) -> str:
    """What matters first, in one sentence: that constants change, else which fits do not follow their recordings.

    A fit of constants that change does not follow its recordings from any start, so only the first of the two is
    stated.
    """
    serves, count = _serving(documents)
    return (serves == count and unfollowed_sentence(documents, tracked)) or one_set(documents)


def cycle_table(documents: Sequence[Mapping[str, Any]], tracked: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Energies of every cycle [J], one row a recording and branch: mode, subject, condition, parts, work, imbalance.

    Cycles may be of a foot that is no branch of the fit, such as the one a synthetic recording was made from.
    """
    choice = {d["key"]: displayed_branch(d, tracked) for d in documents if d["status"] == "done"}
    rows = [
        {
            **{name: d[name] for name in ("mode", "subject", "posture", "key")},
            **{name: c[name] for name in ("file", "added_mass_kg", "branch", "chosen", "shaker_work_j", "imbalance")},
            "frequency_hz": nominal(c["frequency_hz"]),
            "ankle_j": c["ankle"]["dissipated_j"], "fat_pad_j": c["fat_pad"]["dissipated_j"],
            "fit_percent": {b["name"]: b["fit_percent"] for b in d["result"]["branches"]}.get(c["branch"], np.nan),
            "shown": c["branch"] == choice[d["key"]][0], "decided_by": choice[d["key"]][1],
        }
        for d in documents
        for c in d.get("cycles") or []
    ]  # fmt: skip
    columns = ["mode", "subject", "posture", "key", "file", "added_mass_kg", "frequency_hz", "branch", "chosen"]
    table = pd.DataFrame(rows, columns=[*columns, "ankle_j", "fat_pad_j", "shaker_work_j", "imbalance", "shown",
                                         "decided_by", "fit_percent"])  # fmt: skip
    return table.astype({"chosen": bool, "shown": bool})


def nominal(frequency_hz: float) -> float:
    """The frequency that was set, from the one found in a recording: to a tenth of a hertz."""
    return round(frequency_hz, 1)


def csv(table: pd.DataFrame) -> str:
    """summary.csv as text: numbers of eight digits, empty where there is none."""
    return table.to_csv(index=False, float_format="%.8g", lineterminator="\n")


def counts(documents: Sequence[Mapping[str, Any]], tracked: Mapping[str, str] | None = None) -> pd.DataFrame:
    """One row a mode: fits, done, failed, recordings, mean fit [%] of the branch shown, verdicts alone, seconds.

    `again` of `again_of` fits with several starts met their best end from a second start: the others may have missed a
    better one.
    """
    rows = []
    for mode in dict.fromkeys(d["mode"] for d in documents):
        of_mode = [d for d in documents if d["mode"] == mode]
        done = [d["result"] for d in of_mode if d["status"] == "done"]
        verdicts = [r.get("verdict", "") for r in done]
        fits = [displayed_fit(d, tracked) for d in of_mode if d["status"] == "done"]
        started = [r["starts"] for r in done if len(r.get("starts") or ()) > 1]
        rows.append({
            "mode": mode, "fits": len(of_mode), "done": len(done), "failed": len(of_mode) - len(done),
            "recordings": sum(len(r["recordings"]) for r in done),
            "fit_percent": float(np.mean(fits)) if fits else None,
            "decided": verdicts.count("decided"), "undecided": verdicts.count("undecided"),
            "again": sum(map(_met_again, started)), "again_of": len(started),
            "seconds": sum(d.get("seconds") or 0.0 for d in of_mode),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _met_again(starts: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the second best start, or a later one, ended where the best did: on its branch, at its cost."""
    best, *others = sorted(starts, key=lambda s: s["cost"])
    near = max(_SAME, _SAME_SHARE * best["cost"])
    return any(s["branch"] == best["branch"] and s["cost"] - best["cost"] <= near for s in others)
