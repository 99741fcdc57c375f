"""The whole analysis of heel strikes, resumable: persons, laws, population, and their slopes."""

import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fasbody import runner
from fasbody.console import to_json
from fasbody.exceptions import RecordingError, Stopped
from fasbody.heel import stiffness
from fasbody.heel.comparison import Document, Task, judge, persons
from fasbody.heel.estimate import WINDOWS
from fasbody.heel.laws import LAWS
from fasbody.heel.population import Observed, Population, estimate, of_documents
from fasbody.heel.study import HeelStudy
from fasbody.presentation import Tabled

#: Tests of a law on strikes that it was not fitted to.
TESTS = ("other_speed", "other_person")
#: What the compression of these studies is.
INCLUDES = "everything between the skin of the heel and the shank: fat pad, bones, arch and ankle"
#: Law and window of the population: the best of those that the strikes decide for everybody.
POPULATION_LAW, POPULATION_WINDOW = "power", "loading"


@dataclass(frozen=True, eq=False)
class Analysis(Tabled):
    """All results.

    Attributes:
        study: what was read.
        persons: one entry a person and speed.
        laws: one document a law and window.
        law: of the population.
        window: that it describes.
        population: None if there are too few people.
        slopes: of the strikes at the loads of the shaker, empty if there are too few people.
        remarks: one sentence each on what is not there.
        seconds: that it took.
        computed: documents that were not kept from before.
    """

    study: HeelStudy
    persons: Sequence[Document]
    laws: Sequence[Document]
    law: str
    window: str
    population: Population | None
    slopes: Sequence[Population]
    remarks: Sequence[str]
    seconds: float
    computed: int

    def __str__(self) -> str:
        return "\n".join([str(self.study), *self.sentences()])

    def best(self, window: str, test: str) -> tuple[str, float] | None:
        """Law with the least mean error of one of `TESTS`, and that error over the peak."""
        errors = [(float(np.mean([item["error"] for item in d[test]])), d["law"])
                  for d in self.laws if d["window"] == window and d[test]]  # fmt: skip
        return min(errors)[::-1] if errors else None

    def sentences(self) -> list[str]:
        """Which laws predict best, in words."""
        windows = {"loading": "Up to the first force peak", "whole": "For the whole contact"}
        tests = {"other_speed": "normal strikes from slow ones", "other_person": "a person from all others"}
        out = []
        for window, place in windows.items():
            for test, claim in tests.items():
                if best := self.best(window, test):
                    name, percent = LAWS[best[0]].name, 100 * best[1]
                    out.append(f"{place}, best prediction of {claim}: {name}, error {percent:.1f} % of the peak force.")
        return out

    def observed(self) -> tuple[list[Observed], int]:
        """Estimates of the population's law that rest on no bound, and how many do."""
        chosen = (d for d in self.laws if (d["law"], d["window"]) == (self.law, self.window))
        return of_documents(next(chosen))

    def document(self) -> dict[str, Any]:
        """Everything as plain data."""
        study = self.study
        best = {f"{window}, {test}": self.best(window, test) for window in WINDOWS for test in TESTS}
        return {
            "study": study.name, "origin": study.origin, "doi": study.doi, "licence": study.licence,
            "compression_includes": INCLUDES, "strikes": len(study.strikes),
            "problems": list(study.problems), "persons": list(self.persons),
            "laws": list(self.laws), "best": best, "population": self._population(),
            "stiffness": stiffness.rows(self.slopes, stiffness.of_model()),
            "remarks": list(self.remarks), "computed": self.computed, "seconds": self.seconds,
        }  # fmt: skip

    def _population(self) -> dict[str, Any] | None:
        people, law = self.population, LAWS[self.law]
        if people is None:
            return None
        stds = {
            "std_between_persons": np.sqrt(np.diag(people.between)),
            "std_within_person": np.sqrt(np.diag(people.within)),
        }
        items = {item.name: (i, item.unit) for i, item in enumerate(law.parameters)}
        parameters = []
        for row in people.rows():
            i, unit = items[row["parameter"]]
            parameters.append({**row, "unit": unit, **{name: float(std[i]) for name, std in stds.items()}})
        return {
            "law": self.law, "window": self.window, "formula": law.formula,
            "method": "Laplace, restricted maximum likelihood",
            "persons": people.persons, "parameters": parameters,
            "diagnostics": {"converged": people.converged, "inside_95_percent": people.inside},
        }  # fmt: skip


def analyse(
    study: HeelStudy,
    out: Path | None = None,
    laws: Iterable[str] = tuple(LAWS),
    law: str = POPULATION_LAW,
    window: str = POPULATION_WINDOW,
    processes: int = 0,
) -> Analysis:
    """Analyse a study; with a folder, what it holds already is not computed again.

    Args:
        study: the strikes.
        out: folder for the documents.
        laws: keys of the laws to judge.
        law: of the population, one of `laws`.
        window: that the population's law describes.
        processes: 0 for all cores.

    Raises:
        Stopped: Ctrl-C, with what is kept.
    """
    began = time.perf_counter()
    groups = study.groups()
    tasks = [Task(key, which, groups, study.digest) for which in WINDOWS for key in laws]
    store = runner.Store(out / "laws") if out else None
    if store:
        store.make()
    documents, computed = _documents(tasks, store, processes)
    remarks = list(documents[0]["left_out"]) if documents else []
    people, slopes = None, []
    try:
        chosen = [d for d in documents if (d["law"], d["window"]) == (law, window)]
        if chosen:
            observed, bound = of_documents(chosen[0])
            if bound:
                remarks.append(
                    f"{bound} estimates of the {LAWS[law].name} rest on a bound and are not in the population."
                )
            people = estimate([item.name for item in LAWS[law].parameters], observed)
        slopes = stiffness.measured(groups)
    except RecordingError as error:
        remarks.append(str(error))
    seconds = time.perf_counter() - began
    return Analysis(
        study, persons(groups, study.body_weight_n), documents, law, window, people, slopes,
        remarks, seconds, computed,
    )  # fmt: skip


def _documents(
    tasks: Sequence[Task], store: runner.Store | None, processes: int
) -> tuple[list[Document], int]:
    """The document of each task, kept or computed, and how many were computed."""
    kept = {task.key: old for task in tasks if store and (old := store.load(f"{task.key}.json", json.loads)[0])}
    missing = [task for task in tasks if task.key not in kept]
    count = processes or min(runner.cores(), max(1, len(missing)))
    try:
        for index, document in runner.run(judge, missing, "laws", count):
            kept[missing[index].key] = document
            if store:
                store.save(f"{document['key']}.json", to_json(document) + "\n")
    except KeyboardInterrupt:
        if store is None:
            raise
        raise Stopped(
            f"stopped with {len(kept)} of {len(tasks)} laws in {store.folder}; the same command goes on from there."
        ) from None
    return [kept[task.key] for task in tasks], len(missing)
