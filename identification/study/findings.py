"""What a study's checks found, and the branches tracked over its subjects: for the report, summary.csv and --json."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from fasbody.exceptions import SettingError
from fasbody.presentation import counted
from identification.study.population import Population, populations, without
from identification.study.tracking import Fit, Prior, Tracking, track

_TRACKED_MODES = ("per-recording", "pooled")
Document = Mapping[str, Any]


@dataclass(frozen=True)
class Subject:
    """The branches of one subject's fits in one posture, tracked together, or why not."""

    mode: str
    subject: str
    posture: str
    tracking: Tracking | None
    sentence: str

    def document(self) -> dict[str, Any]:
        """As plain data."""
        plain = {**asdict(self), "tracking": self.tracking and self.tracking.document()}
        plain["said"] = plain.pop("sentence")
        return plain


@dataclass(frozen=True)
class Findings:
    """All of it.

    Attributes:
        subjects: tracked ones.
        checks: documents of the checks that are done.
        prior: that the tracking had, in words.
        unshown: how many documents of each mode in the folder are of other settings or recordings.
        requested: the mode of the command.
        populations: of the pooled fits.
        no_population: why some persons make none.
    """

    subjects: Sequence[Subject] = ()
    checks: Sequence[Document] = ()
    prior: str = ""
    unshown: Mapping[str, int] = field(default_factory=dict)
    requested: str = ""
    populations: Sequence[Population] = ()
    no_population: Sequence[str] = ()

    @property
    def elsewhere(self) -> str:
        """What is in the folder and not shown, in a sentence; empty where nothing is."""
        sentences = []
        for mode, count in sorted(self.unshown.items()):
            other = "" if mode == self.requested else ", a mode that was not asked for,"
            was, is_ = ("was", "is") if count == 1 else ("were", "are")
            sentences.append(
                f"{counted(count, f'{mode} document')} in this folder{other} {was} made with other settings, "
                f"recordings or program, and {is_} not shown."
            )
        return " ".join(sentences)

    @property
    def tracked(self) -> dict[str, str]:
        """Key of a fit -> name of its branch, or "undecided"."""
        return {c.key: c.branch for s in self.subjects if s.tracking for c in s.tracking.choices}

    @property
    def profiles(self) -> dict[tuple[str, str], Document]:
        """Key of a fit and a parameter's key -> its profile."""
        return {(r["fit"], r["key"]): r for _, r in self.of("profile")}

    def of(self, kind: str) -> list[tuple[Document, Document]]:
        """Document and result of each check of a kind that is done."""
        return [(d, d["result"]) for d in self.checks if d["kind"] == kind and d["status"] == "done"]

    def document(self) -> dict[str, Any]:
        """As plain data."""

        def listed(kind: str) -> list[dict[str, Any]]:
            return [{**{n: d[n] for n in ("mode", "subject", "posture", "files")}, **r} for d, r in self.of(kind)]

        return {
            "tracking": [s.document() for s in self.subjects],
            "prior": self.prior, "profiles": listed("profile"), "validation": listed("validation"),
            "agreement": listed("agreement"), "unshown": sum(self.unshown.values()),
            "unshown_by_mode": dict(self.unshown),
            "populations": [p.document() for p in self.populations],
            "no_population": list(self.no_population),
        }  # fmt: skip


def gather(
    documents: Sequence[Document], checks: Sequence[Document] = (), prior: Prior | None = None, prior_text: str = "",
    others: Sequence[Document] = (),
) -> Findings:  # fmt: skip
    """Track the branches of every subject's fits, and take the checks along.

    Args:
        documents: the fits.
        checks: their checks.
        prior: of the branches.
        prior_text: the prior in words.
        others: fits of persons of other studies, who join the population alone.
    """
    subjects: dict[tuple[str, str, str], list[Document]] = {}
    for d in documents:
        if d["status"] == "done" and d["mode"] in _TRACKED_MODES:
            subjects.setdefault((d["mode"], d["subject"], d["posture"]), []).append(d)
    tracked = [_tracked(*who, fits, prior) for who, fits in subjects.items()]
    keys = {d["key"] for d in documents}  # holds the recordings' content, so that no fit counts twice
    everyone = [*documents, *(d for d in others if d["key"] not in keys)]
    return Findings(tracked, checks, prior_text, populations=populations(everyone), no_population=without(everyone))


def _tracked(mode: str, subject: str, posture: str, documents: Sequence[Document], prior: Prior | None) -> Subject:
    """Fits with one branch say nothing about the choice, and sweeps have no place in frequency."""
    two = [d for d in documents if len(d["result"]["branches"]) > 1]
    two = [d for d in two if mode == "pooled" or d["frequency_hz"] is not None]
    if not two:
        return Subject(mode, subject, posture, None, "Fits without a frequency or a mirror solution are not tracked.")
    try:
        tracking = track([Fit.from_document(d) for d in two], prior=prior)
    except SettingError as problem:
        return Subject(mode, subject, posture, None, f"Subject {subject}, {mode}: {problem}")
    return Subject(mode, subject, posture, tracking, tracking.sentence)
