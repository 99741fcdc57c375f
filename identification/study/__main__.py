"""`python -m identification.study`: fit a whole study, resumably, here or on a Dask cluster."""

import contextlib
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from fasbody.console import command_line, console, print_json, progress_bar, results
from fasbody.model import load
from fasbody.recording import StudyFolder
from identification.estimate import Settings
from identification.study import cluster, report
from identification.study.cluster import Crew
from identification.study.job import Document
from identification.study.plan import MODES, Filters, Job, Model, Plan
from identification.study.store import Store
from identification.study.summary import counts
from identification.study.truth import Truth

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[Path, typer.Argument(help="study folder")],
    out: Annotated[Path | None, typer.Option(help="folder for results (default results/NAME_study)")] = None,
    mode: Annotated[str, typer.Option(help=f"{', '.join(MODES)}: what one fit takes together")] = MODES[0],
    scheduler: Annotated[str | None, typer.Option(help="address of a Dask scheduler, tcp://HOST:PORT")] = None,
    workers: Annotated[int, typer.Option(min=0, help="local processes; 0 for one a core, 1 for this one")] = 0,
    starts: Annotated[int, typer.Option(help="starts of each fit")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="seed of the random starts")] = 0,
    model: Annotated[str, typer.Option(help="shipped model or MJCF file")] = "two_dof",
    domain: Annotated[str, typer.Option(help="auto, periodic (steady state) or time")] = "auto",
    subject: Annotated[list[str] | None, typer.Option(help="only this subject; repeat for several")] = None,
    posture: Annotated[list[str] | None, typer.Option(help="only this posture; repeat")] = None,
    added_mass: Annotated[list[float] | None, typer.Option(help="only this added mass in kg; repeat")] = None,
    frequency: Annotated[list[float] | None, typer.Option(help="only this frequency in Hz; repeat")] = None,
    page: Annotated[bool, typer.Option("--report/--no-report", help="write summary, figures and report.html")] = True,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Fit every recording of a study, computing only what is missing.

    It may be stopped at any moment and started again with the same command. Examples:
      python -m identification.study my_study

      python -m identification.study my_study --mode pooled --subject 3 --subject 7

      python -m identification.study my_study --scheduler tcp://127.0.0.1:8786
    """
    folder = StudyFolder.open(study)
    filters = Filters(tuple(subject or ()), tuple(posture or ()), tuple(added_mass or ()), tuple(frequency or ()))
    settings = Settings(starts=starts, seed=seed, domain=domain, threads=1)
    plan = Plan(folder, filters.choose(folder.trials), settings, Model.of(load(model)))
    jobs = plan.jobs(mode)
    out = out or Path("results") / f"{study.resolve().name}_study"
    store = Store.open(out)
    began = time.perf_counter()
    try:
        computed = complete(plan, jobs, store, scheduler, workers)
    except KeyboardInterrupt:
        kept = len(store.documents(job.key for job in jobs))
        console.print(
            f"stopped with {kept} of {len(jobs)} fits in {store.folder}; the same command goes on from there.",
            soft_wrap=True,
        )
        raise typer.Exit(130) from None
    seconds = time.perf_counter() - began
    documents = [d for each in MODES for d in store.documents(job.key for job in plan.jobs(each))]
    if page:
        report.write(out, documents, folder.name, folder.origin, Truth.read(study))
    show(documents, computed, seconds, json_, out)
    if page:
        console.print(f"report: [bold]{out / 'report.html'}[/], with summary.csv and figures beside it", soft_wrap=True)


def complete(plan: Plan, jobs: Sequence[Job], store: Store, scheduler: str | None, workers: int) -> int:
    """Do what is missing or failed before; returns how many fits that were."""
    missing = []
    for job in jobs:
        found, problem = store.read(job.key)
        if problem:
            console.print(problem, markup=False, soft_wrap=True)
        if found is None or found["status"] == "failed":
            missing.append(job)
    if not missing:
        return 0
    began = time.perf_counter()
    with crew(len(missing), scheduler, workers) as do, progress_bar() as progress:
        bar = progress.add_task("fitting", total=len(jobs), completed=len(jobs) - len(missing))
        for done, document in enumerate(do(plan.work(job) for job in missing), 1):
            store.write(document)
            rate = done / (time.perf_counter() - began)
            progress.update(bar, advance=1, description=f"fitting, {rate:.2g} fits/s")
    return len(missing)


@contextlib.contextmanager
def crew(count: int, scheduler: str | None, workers: int) -> Iterator[Crew]:
    """Who does so many jobs: a cluster where one is named, else local processes, or this one where that is enough."""
    cores = workers or min(len(os.sched_getaffinity(0)), count)
    if scheduler is not None:
        with cluster.remote(scheduler) as do:
            yield do
    elif cores == 1 or (not workers and (count < cluster.FEW or not cluster.installed())):
        yield cluster.here
    else:
        with cluster.local(cores) as do:
            yield do


def show(documents: Sequence[Document], computed: int, seconds: float, as_json: bool, out: Path) -> None:
    """What is in the folder now, for people or as JSON: counts by mode, and what failed."""
    failed = [document for document in documents if document["status"] == "failed"]
    counted = counts(documents).to_dict("records")
    if as_json:
        failures = [{"mode": d["mode"], "files": d["files"], "error": d["error"]} for d in failed]
        print_json({"out": out, "computed": computed, "seconds": seconds, "modes": counted, "failed": failures})
    else:
        table = Table(title=f"{computed} fits computed in {seconds:.0f} s", title_justify="left")
        for name in counted[0]:
            table.add_column(name.replace("_", " "), justify="left" if name == "mode" else "right")
        for row in counted:
            table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()))
        results.print(table)
    for document in failed:
        console.print(f"failed: {document['error']}", markup=False, soft_wrap=True)
    for document in documents:
        for sentence in document["left_out"] if document["status"] == "done" else ():
            console.print(f"left out: {sentence}", markup=False, soft_wrap=True)


if __name__ == "__main__":
    command_line(app)
