"""What a study's fits and checks say together: tables, subjects' branches, populations."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import pandas as pd

from fasbody.exceptions import SettingError
from fasbody.presentation import counted
from identification.study import summary
from identification.study.population import Population, populations
from identification.study.tracking import Fit, Prior, Tracking, track
from identification.study.truth import Truth, recovery

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
        plain = asdict(self)
        return {**plain, "said": plain.pop("sentence")}


@dataclass(frozen=True, eq=False)
class Findings:
    """All that the fits of a study say.

        findings = Findings(documents, truth=Truth.read(study))
        report.write(out, findings, "my study", "synthetic")

    Attributes:
        documents: the fits.
        checks: documents of their checks.
        truth: of a synthetic study.
        prior: of the branches.
        prior_text: the prior in words.
        others: fits of persons of other studies, who join the population alone.
        unshown: how many documents of each mode are of other settings or recordings.
        requested: the mode of the command.
    """

    documents: Sequence[Document] = ()
    checks: Sequence[Document] = ()
    truth: Truth | None = None
    prior: Prior | None = None
    prior_text: str = ""
    others: Sequence[Document] = ()
    unshown: Mapping[str, int] = field(default_factory=dict)
    requested: str = ""

    @cached_property
    def subjects(self) -> list[Subject]:
        """The branches of every subject's fits, tracked together."""
        groups: dict[tuple[str, str, str], list[Document]] = {}
        for fit in self.documents:
            if fit["status"] == "done":
                groups.setdefault((fit["mode"], fit["subject"], fit["posture"]), []).append(fit)
        return [self._tracked(*who, fits) for who, fits in groups.items()]

    def _tracked(self, mode: str, subject: str, posture: str, fits: Sequence[Document]) -> Subject:
        """Of fits that follow their recordings, have two branches and a frequency or many."""
        usable = [fit for fit in fits if not summary.misfit(fit)]
        two = [fit for fit in usable if len(fit["result"]["branches"]) > 1]
        two = [fit for fit in two if mode == "pooled" or fit["frequency_hz"] is not None]
        tracking, text = None, "Fits without a frequency or a mirror solution are not combined."
        if not usable:
            text = "No fit follows its recordings, so no branch is decided."
        try:
            if two:
                tracking = track([Fit.from_document(fit) for fit in two], prior=self.prior)
                text = tracking.sentence
        except SettingError as problem:
            text = f"Subject {subject}, {mode}: {problem}"
        return Subject(mode, subject, posture, tracking, text)

    @cached_property
    def tracked(self) -> dict[str, str]:
        """Key of a fit -> name of its branch, or "undecided"."""
        return {c.key: c.branch for s in self.subjects if s.tracking for c in s.tracking.choices}

    @cached_property
    def _population(self) -> tuple[list[Population], list[str]]:
        keys = {fit["key"] for fit in self.documents}  # hold the content: no fit counts twice
        others = (fit for fit in self.others if fit["key"] not in keys)
        return populations([*self.documents, *others])

    @property
    def populations(self) -> list[Population]:
        """Of the pooled fits."""
        return self._population[0]

    @property
    def no_population(self) -> list[str]:
        """Why some persons make none."""
        return self._population[1]

    @cached_property
    def table(self) -> pd.DataFrame:
        """The tidy table, see `summary.tidy`."""
        profiles = {(r["fit"], r["key"]): r for _, r in self.of("profile")}
        return summary.tidy(self.documents, self.truth, self.tracked, profiles)

    @cached_property
    def energy(self) -> pd.DataFrame:
        """The cycles, see `summary.cycle_table`."""
        return summary.cycle_table(self.documents, self.tracked)

    @cached_property
    def recovered(self) -> pd.DataFrame:
        """How much of the truth the fits recover, see `truth.recovery`; empty without one."""
        return recovery(self.table) if self.truth else pd.DataFrame()

    @property
    def elsewhere(self) -> str:
        """What is in the folder and not shown, in a sentence; empty where nothing is."""
        sentences = []
        for mode, count in sorted(self.unshown.items()):
            documents = counted(count, f"{mode} document")
            other = "" if mode == self.requested else ", a mode that was not asked for,"
            was, is_ = ("was", "is") if count == 1 else ("were", "are")
            made = f"{was} made with other settings, recordings or program"
            sentences.append(f"{documents} in this folder{other} {made}, and {is_} not shown.")
        return " ".join(sentences)

    @property
    def without_intervals(self) -> str:
        """That no fit of one recording has an interval, in a sentence; empty where one has."""
        alone = self.table[self.table["mode"] == "per-recording"]
        if alone.empty or summary.measured(alone).any():
            return ""
        return (
            "One frequency cannot determine all constants, so no estimate has an interval. Fit the frequencies of a "
            "subject together with --mode pooled."
        )

    def of(self, kind: str) -> list[tuple[Document, Document]]:
        """Document and result of each check of a kind that is done."""
        done = (check for check in self.checks if check["status"] == "done")
        return [(check, check["result"]) for check in done if check["kind"] == kind]

    def document(self) -> dict[str, Any]:
        """As plain data."""
        kinds = {"profiles": "profile", "validation": "validation", "agreement": "agreement"}
        about = ("mode", "subject", "posture", "files")
        return {
            name: [{**{n: check[n] for n in about}, **result} for check, result in self.of(kind)]
            for name, kind in kinds.items()
        } | {
            "tracking": [subject.document() for subject in self.subjects],
            "prior": self.prior_text,
            "unshown": sum(self.unshown.values()),
            "unshown_by_mode": dict(self.unshown),
            "populations": [population.document() for population in self.populations],
            "no_population": self.no_population,
        }
