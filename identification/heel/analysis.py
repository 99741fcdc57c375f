"""The whole analysis of heel strikes, resumable: persons, laws, population, and what follows for the shaker."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fasbody import runner
from fasbody.console import make_folder
from fasbody.exceptions import RecordingError, Stopped
from fasbody.heel.laws import LAWS
from fasbody.heel.study import HeelStudy
from fasbody.presentation import Tabled
from identification.heel import population, stiffness, store
from identification.heel.estimate import WINDOWS
from identification.heel.population import Population
from identification.heel.study import Document, Task, judge, persons

#: How a law is held against strikes that it was not fitted to.
TESTS = ("other_speed", "other_person")
#: What the compression of these studies is.
INCLUDES = "everything between the skin of the heel and the shank: fat pad, bones, arch and ankle"
#: The law of the population and its window: the best of those whose parameters the strikes decide for everybody.
POPULATION_LAW, POPULATION_WINDOW = "power", "loading"


@dataclass(frozen=True, eq=False)
class Analysis(Tabled):
    """Everything that was found.

    Attributes:
        study: what was read. persons: one entry a person and speed. laws: one document a law and window.
        population: of the law named `law` over the window `window`, None if there are too few people. slopes: of the
        strikes at the loads of the shaker, empty if there are too few people. remarks: one sentence each on what is not
        there. seconds: that it took. computed: documents that were not found on disk.
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
        """Law with the least mean error of `other_speed` or `other_person`, and that error over the peak."""
        found = [(float(np.mean([item["error"] for item in d[test]])), d["law"])
                 for d in self.laws if d["window"] == window and d[test]]  # fmt: skip
        return (min(found)[1], min(found)[0]) if found else None

    def sentences(self) -> list[str]:
        """What was found of the laws, in words."""
        out = []
        for window, words in (("loading", "up to the first force peak"), ("whole", "over the whole contact")):
            for test, asked in (
                ("other_speed", "slow strikes predict normal ones"),
                ("other_person", "others predict a person"),
            ):
                if best := self.best(window, test):
                    out.append(
                        f"{words}, {asked} best by the {LAWS[best[0]].name}: error {100 * best[1]:.1f} % of the peak."
                    )
        return out

    def document(self) -> dict[str, Any]:
        """Everything as plain data."""
        from identification.heel.shaker import beside

        study = self.study
        return {
            "study": study.name, "origin": study.origin, "doi": study.doi, "licence": study.licence,
            "compression_includes": INCLUDES, "strikes": len(study.strikes), "problems": list(study.problems),
            "persons": list(self.persons), "laws": list(self.laws),
            "best": {f"{window}, {test}": self.best(window, test) for window in WINDOWS for test in TESTS},
            "population": self._population(), "stiffness": stiffness.rows(self.slopes, beside()),
            "remarks": list(self.remarks), "computed": self.computed, "seconds": self.seconds,
        }  # fmt: skip

    def _population(self) -> dict[str, Any] | None:
        found = self.population
        if found is None:
            return None
        law = LAWS[self.law]
        out: list[dict[str, Any]] = []
        for speed in found.speeds:
            for item in law.parameters:
                value, lower, upper = found.interval(speed, item.name)
                low, high = found.predictive(speed, item.name)
                i = found.names.index(item.name)
                out.append({
                    "speed": speed, "parameter": item.name, "unit": item.unit, "median": value,
                    "lower": lower, "upper": upper,
                    "new_person_lower": low, "new_person_upper": high,
                    "std_between_persons": float(np.sqrt(found.between[i, i])),
                    "std_within_person": float(np.sqrt(found.within[i, i])),
                })  # fmt: skip
        return {
            "law": self.law, "window": self.window, "formula": law.formula,
            "method": "Laplace, restricted maximum likelihood",
            "persons": found.persons, "parameters": out,
            "diagnostics": {"converged": found.converged, "inside_95_percent": found.inside},
        }  # fmt: skip


def analyse(
    study: HeelStudy, out: Path | None = None, laws: Iterable[str] = tuple(LAWS), law: str = POPULATION_LAW,
    window: str = POPULATION_WINDOW, processes: int = 0,
) -> Analysis:  # fmt: skip
    """Analyse a study; with a folder, what it holds already is not computed again.

    Args:
        study: the strikes. out: folder for the documents. laws: keys of the laws to judge. law, window: of the
        population.
        processes: 0 for all cores.

    Raises:
        Stopped: Ctrl-C, with what is kept.
    """
    began = time.perf_counter()
    groups = study.groups()
    tasks = [Task(key, which, groups, study.digest) for which in WINDOWS for key in laws]
    folder = make_folder(out / "laws") if out else None
    kept = {task.key: old for task in tasks if folder and (old := store.read(folder, task.key))}
    missing = [task for task in tasks if task.key not in kept]
    computed = 0
    try:
        count = processes or min(runner.cores(), max(1, len(missing)))
        for index, document in runner.run(judge, missing, "laws", count):
            kept[missing[index].key] = document
            computed += 1
            if folder:
                store.write(folder, document)
    except KeyboardInterrupt:
        if folder is None:
            raise
        raise Stopped(
            f"stopped with {len(kept)} of {len(tasks)} laws in {folder}; the same command goes on from there."
        ) from None
    documents = [kept[task.key] for task in tasks]
    remarks = [sentence for document in documents[:1] for sentence in document["left_out"]]
    found: Population | None = None
    slopes: Sequence[Population] = ()
    try:
        chosen = next((d for d in documents if d["law"] == law and d["window"] == window), None)
        if chosen is not None:
            observed, dropped = population.of_documents(chosen)
            if dropped:
                remarks.append(
                    f"{dropped} estimates of the {LAWS[law].name} rest on a bound and are not in the population."
                )
            found = population.estimate([item.name for item in LAWS[law].parameters], observed)
        slopes = stiffness.measured(groups)
    except RecordingError as error:
        remarks.append(str(error))
    return Analysis(
        study, persons(groups, study.body_weight_n), documents, law, window, found, slopes, remarks,
        time.perf_counter() - began, computed,
    )  # fmt: skip
