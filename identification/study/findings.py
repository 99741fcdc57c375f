"""What a study's checks found, and the branches tracked over its subjects: for the report, summary.csv and --json."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fasbody.exceptions import SettingError
from fasbody.foot.parameters import symbol_and_unit
from identification.study.evidence import Fit, Prior
from identification.study.summary import place
from identification.study.tables import Grid, Section
from identification.study.tracking import Tracking, track

_TRACKED_MODES = ("per-recording", "pooled")
_LISTED = 40
#: Whether two domains agree, in words, in the order of the table.
_ANSWER = {False: "no", True: "yes", None: "nothing to compare"}
_ORDER = list(_ANSWER)
Document = Mapping[str, Any]


@dataclass(frozen=True)
class Subject:
    """The branches of one subject's fits in one posture, tracked together, or why not."""

    mode: str
    subject: str
    posture: str
    tracking: Tracking | None
    said: str


@dataclass(frozen=True)
class Findings:
    """All of it.

    Attributes:
        subjects: tracked ones. checks: documents of the checks that are done. prior: that the tracking had, in words.
        more: further sections of the page. unshown: documents in the folder that are of other settings or recordings.
    """

    subjects: Sequence[Subject] = ()
    checks: Sequence[Document] = ()
    prior: str = ""
    more: Sequence[Section] = ()
    unshown: int = 0

    @property
    def elsewhere(self) -> str:
        """What is in the folder and not shown, in a sentence; empty where nothing is."""
        one = self.unshown == 1
        made = f"{self.unshown} document{'' if one else 's'} in this folder {'was' if one else 'were'} made with"
        text = f"{made} other settings, recordings or program, and {'is' if one else 'are'} not shown."
        return text if self.unshown else ""

    @property
    def tracked(self) -> dict[str, str]:
        """Key of a fit -> name of its branch, or "undecided"."""
        return {c.key: c.branch for s in self.subjects if s.tracking for c in s.tracking.choices}

    @property
    def profiles(self) -> dict[tuple[str, str], Document]:
        """Key of a fit and a parameter's key -> its profile."""
        return {(r["fit"], r["key"]): r for _, r in self._of("profile")}

    def _of(self, kind: str) -> list[tuple[Document, Document]]:
        return [(d, d["result"]) for d in self.checks if d["kind"] == kind and d["status"] == "done"]

    def document(self) -> dict[str, Any]:
        """As plain data."""

        def listed(kind: str) -> list[dict[str, Any]]:
            return [{**{n: d[n] for n in ("mode", "subject", "posture", "files")}, **r} for d, r in self._of(kind)]

        return {
            "tracking": [{**asdict(s), "tracking": s.tracking and s.tracking.document()} for s in self.subjects],
            "prior": self.prior, "profiles": listed("profile"), "validation": listed("validation"),
            "agreement": listed("agreement"), "unshown": self.unshown,
        }  # fmt: skip

    def sections(self) -> list[Section]:
        """What the page shows of them."""
        found = [
            self._tracking() if self.subjects else None, self._profiles(), self._held_out(), self._damping(),
            self._agreement(), *self.more,
        ]  # fmt: skip
        return [section for section in found if section is not None]

    def _tracking(self) -> Section:
        rows = []
        for s in self.subjects:
            choices = s.tracking.choices if s.tracking else ()
            names = [c.branch for c in choices]
            overall = max(s.tracking.overall.items(), key=lambda i: i[1], default=("", 0.0)) if s.tracking else ("", 0)
            cells = [str(names.count(n)) for n in ("stiff ankle", "stiff pad", "undecided")]
            rows.append([f"{s.mode}, {s.posture}", s.subject, *cells, overall[0], _odds(overall[1])])
        texts = [
            "The constants of one foot change smoothly with frequency and load, so all fits of a subject are weighed "
            "together: likelihood, continuity and, where given, a prior. A branch is chosen above 1000 to 1. "
            "Continuity carries a decision to the neighbours and cannot make one. Tables and figures show the branch "
            "that is chosen here; undecided fits keep their own. The last two columns compare only the two assignments "
            "that keep to one branch for all fits, not the mixed ones: high odds there stand beside undecided fits.",
            f"Prior: {self.prior}." if self.prior else "No prior was given (--prior).",
            *dict.fromkeys(s.said for s in self.subjects if s.said and s.tracking is None),
        ]
        header = ["mode", "subject", "stiff ankle", "stiff pad", "undecided", "if one branch for all",
                  "its odds over the other for all"]  # fmt: skip
        return Section("Branches over a subject", texts, Grid(header, rows))

    def _profiles(self) -> Section | None:
        found = self._of("profile")
        if not found:
            return None
        rows = []
        for d, r in sorted(found, key=lambda pair: not pair[1]["departs"])[:_LISTED]:
            low = "open" if r["open_below"] else f"{r['lower']:.4g}"
            high = "open" if r["open_above"] else f"{r['upper']:.4g}"
            wald = " to ".join(f"{x:.4g}" for x in r["wald"])
            note = "; a better fit was met" if r["better"] else ""
            departs = "departs" if r["departs"] else ""
            rows.append([f"{place(d)} ({d['mode']})", symbol_and_unit(r["key"])[0], r["verdict"] + note, departs,
                         f"{r['value']:.4g}", f"{low} to {high}", wald])  # fmt: skip
        count = sum(r["departs"] for _, r in found)
        texts = [
            f"{len(found)} profiles; {count} depart from the interval of their standard error by more than a tenth "
            "of its width, and come first. A profile is of the fit's own branch; where that is shown, the verdict "
            "above and in summary.csv is the profile's. An open side means that the recordings set no limit there.",
            *_more(len(found)),
        ]
        header = ["fit", "parameter", "verdict", "from Wald's", "estimate", "95 % profile", "95 % by standard error"]
        return Section("Profile likelihood", texts, Grid(header, rows))

    def _held_out(self) -> Section | None:
        found = [(d, r["held_out"]) for d, r in self._of("validation")]
        if not found:
            return None
        rows = []
        for mode in dict.fromkeys(d["mode"] for d, _ in found):
            mine = [r for d, r in found if d["mode"] == mode]
            inside = [row for r in mine for row in r["rows"] if not row["edge"]]
            ends = [row for r in mine for row in r["rows"] if row["edge"]]
            rows.append([
                mode, str(len(mine)), str(len(inside)), _median(row["percent"] for row in inside),
                _median(row["chi_square"] / row["numbers"] for row in inside),
                _median(row["percent"] for row in ends), str(sum(len(r["failed"]) for r in mine)),
            ])  # fmt: skip
        header = ["mode", "groups", "recordings", "held-out error [%]", "chi-square per number",
                  "error at the ends [%]", "no stable prediction"]  # fmt: skip
        text = (
            "Each frequency is predicted from the others; medians. The lowest and the highest one are extrapolations "
            "and stand apart. The chi-square is over the noise of the measurement alone, so the scatter of a foot from "
            "trial to trial is in it."
        )
        return Section("Leave one frequency out", [text], Grid(header, rows))

    def _damping(self) -> Section | None:
        found = [(d, r["damping"]) for d, r in self._of("validation") if r["damping"]]
        if not found:
            return None
        rows = []
        for d, r in found[:_LISTED]:
            linear, bent = r["linear"], r["nonlinear"]
            errors = " / ".join(f"{c['held_out_percent']:.3g}" for c in (linear, bent))
            rows.append([d["mode"], place(d), f"{linear['aic'] - bent['aic']:.4g}",
                         f"{linear['bic'] - bent['bic']:.4g}", errors, *r["preferred"].values()])  # fmt: skip
        header = [
            "mode",
            "fit",
            "AIC less nonlinear's",
            "BIC less nonlinear's",
            "held-out error [%], linear / nonlinear",
        ]
        header += ["AIC prefers", "BIC prefers", "held-out prefers"]
        text = (
            "Both laws of the dampers were fitted to the same recordings. Differences are the linear law's criterion "
            "less the nonlinear one's: a positive one speaks for the nonlinear law. Errors are linear / nonlinear."
        )
        return Section("Linear or nonlinear damping", [text, *_more(len(found))], Grid(header, rows))

    def _agreement(self) -> Section | None:
        found = self._of("agreement")
        if not found:
            return None
        answers = [r["agrees"] for _, r in found]
        alike, none = answers.count(True), answers.count(None)
        texts = [f"{alike} of {len(found) - none} fits agree within three joint standard errors in all parameters."]
        texts += [f"In {none} more there is nothing to compare."] if none else []
        rows = []
        for d, r in sorted(found, key=lambda pair: _ORDER.index(pair[1]["agrees"]))[:_LISTED]:
            known = [abs(x["z"]) for x in r["differences"] if x["z"] is not None and np.isfinite(x["z"])]
            rows.append([d["mode"], place(d), r["branch"], _ANSWER[r["agrees"]],
                         f"{max(known):.2g}" if known else "–", r["sentence"]])  # fmt: skip
        header = ["mode", "fit", "branch", "agrees", "largest difference [joint errors]", "why"]
        return Section("Steady state and time domain", [*texts, *_more(len(found))], Grid(header, rows))


def gather(
    documents: Sequence[Document], checks: Sequence[Document] = (), prior: Prior | None = None, said: str = ""
) -> Findings:
    """Track the branches of every subject's fits, and take the checks along.

    Args:
        documents: the fits. checks: their checks. prior: of the branches. said: the prior in words.
    """
    subjects: dict[tuple[str, str, str], list[Document]] = {}
    for d in documents:
        if d["status"] == "done" and d["mode"] in _TRACKED_MODES:
            subjects.setdefault((d["mode"], d["subject"], d["posture"]), []).append(d)
    return Findings([_tracked(*who, mine, prior) for who, mine in subjects.items()], checks, said)


def _tracked(mode: str, subject: str, posture: str, documents: Sequence[Document], prior: Prior | None) -> Subject:
    """Fits with one branch say nothing about the choice, and sweeps have no place in frequency."""
    two = [d for d in documents if len(d["result"]["branches"]) > 1]
    two = [d for d in two if mode == "pooled" or d["frequency_hz"] is not None]
    if not two:
        return Subject(mode, subject, posture, None, "Fits without a frequency or a mirror solution are not tracked.")
    try:
        found = track([Fit.from_document(d) for d in two], prior=prior)
    except SettingError as problem:
        return Subject(mode, subject, posture, None, f"Subject {subject}, {mode}: {problem}")
    return Subject(mode, subject, posture, found, found.sentence)


def _median(values: Iterable[float]) -> str:
    found = list(values)
    return f"{np.median(found):.3g}" if found else "–"


def _odds(value: float) -> str:
    return "–" if not value else "over a million to 1" if value > 1e6 else f"{value:.3g} to 1"


def _more(count: int) -> list[str]:
    return [f"The first {_LISTED} of {count} are shown; all are in checks/ and --json."] if count > _LISTED else []
