"""The command `python -m identification.study`: fit a whole study, resumably, here or on a Dask cluster."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fasbody import runner
from fasbody.console import console, print_json, progress_bar, results
from fasbody.exceptions import InputFileError, Stopped
from fasbody.recording.study import StudyFolder
from identification.study.filters import KINDS, MODES, Filters
from identification.study.store import Store

if TYPE_CHECKING:
    from identification.study.cluster import Crew
    from identification.study.findings import Findings
    from identification.study.job import Document
    from identification.study.plan import Job, Work

#: Places of a failure that are named.
_NAMED = 3

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[Path, typer.Argument(help="study folder")],
    out: Annotated[Path | None, typer.Option(help="folder for results (default results/NAME_study)")] = None,
    mode: Annotated[str, typer.Option(help=f"{', '.join(MODES)}: what one fit takes together")] = MODES[0],
    scheduler: Annotated[str | None, typer.Option(help="address of a Dask scheduler, tcp://HOST:PORT")] = None,
    workers: Annotated[int, typer.Option(min=0, help="local processes; 0 for one per core, 1 for this one")] = 0,
    starts: Annotated[int, typer.Option(help="starts of each branch in a round of each fit")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="seed of the random starts")] = 0,
    model: Annotated[str, typer.Option(help="shipped model or MJCF file")] = "two_dof",
    domain: Annotated[str, typer.Option(help="auto, periodic (steady state) or time")] = "auto",
    free: Annotated[str | None, typer.Option(help="parameters to estimate, e.g. k_T,k_F (default: all)")] = None,
    bounds: Annotated[list[str] | None, typer.Option(help="NAME=LOWER:UPPER in SI units; repeat for several")] = None,
    prior: Annotated[list[str] | None, typer.Option(help="prior of every fit, k_T>k_F or k_F=5e4:2e5; repeat")] = None,
    profile: Annotated[str | None, typer.Option(help="parameters to profile, e.g. k_T,k_F")] = None,
    validate: Annotated[
        bool, typer.Option("--validate", help="leave one frequency out; linear against nonlinear damping")
    ] = False,
    agreement: Annotated[
        bool, typer.Option("--agreement", help="steady state against time domain (slow: fits every sample)")
    ] = False,
    replay: Annotated[
        int, typer.Option(min=0, help="recordings of each fit that MuJoCo replays in full (0: one in twenty)")
    ] = 0,
    subject: Annotated[list[str] | None, typer.Option(help="only this subject; repeat for several")] = None,
    posture: Annotated[list[str] | None, typer.Option(help="only this posture; repeat")] = None,
    added_mass: Annotated[list[float] | None, typer.Option(help="only this added mass in kg; repeat")] = None,
    frequency: Annotated[list[float] | None, typer.Option(help="only this frequency in Hz; repeat")] = None,
    persons: Annotated[
        list[Path] | None,
        typer.Option("--with", help="results of another study, whose pooled fits join the population; repeat"),
    ] = None,
    page: Annotated[bool, typer.Option("--report/--no-report", help="write summary, figures and report.html")] = True,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Fit every recording of a study and check the fits, computing only what is missing.

    It may be stopped at any moment and started again with the same command. Exit code 1 if no fit at all could be done.

    Examples:
      python -m identification.study my_study

      python -m identification.study my_study --mode pooled --subject 3 --subject 7

      python -m identification.study my_study --profile k_T,k_F --validate --prior "k_T>k_F"

      python -m identification.study anna --mode pooled --with results/ben_study --with results/cleo_study

      python -m identification.study my_study --scheduler tcp://127.0.0.1:8786
    """
    from fasbody.foot.model import load
    from identification.fitting import Settings
    from identification.parameters import limits, names
    from identification.study import report
    from identification.study.checks import ensure
    from identification.study.findings import gather
    from identification.study.persons import joining
    from identification.study.plan import Model, Plan
    from identification.study.tracking import Prior
    from identification.study.truth import Truth

    folder = StudyFolder.open(study)
    filters = Filters(tuple(subject or ()), tuple(posture or ()), tuple(added_mass or ()), tuple(frequency or ()))
    settings = Settings(
        free=names(free), bounds=limits(bounds), starts=starts, seed=seed, domain=domain, threads=1, replay=replay
    )
    believed = Prior.read(prior or ())
    foot = load(model)
    profiled = tuple(dict.fromkeys(names(profile) or ()))
    space = ensure(mode, settings, foot, profiled)
    plan = Plan(folder, filters.choose(folder.trials), settings, Model.of(foot))
    others = [d for results_of in persons or () for d in joining(results_of)]
    out = out or Path("results") / f"{study.resolve().name}_study"
    if out.is_file():
        raise InputFileError(out, "is a file", "name a folder")
    fits, checks = Store(out / "fits"), Store(out / "checks")
    jobs = plan.jobs(mode)
    checking = [job for name in profiled for job in plan.jobs(mode, "profile", name)]
    checking += plan.jobs(mode, "validation") if validate else []
    checking += plan.jobs(mode, "agreement") if agreement else []
    began = time.perf_counter()
    try:
        computed = complete(plan.work, jobs, fits, scheduler, workers)
        kept = fits.documents(job.key for job in jobs)  # read and verified once: a study has hundreds
        basis = {job.trials: kept.get(job.key) for job in jobs}
        checking = [job for job in checking if job.kind == "validation" or _done(basis[job.trials])]
        checked = complete(lambda job: plan.work(job, basis.get(job.trials)), checking, checks, scheduler, workers)
    except KeyboardInterrupt:
        count = len(fits.documents(job.key for job in jobs)) + len(checks.documents(job.key for job in checking))
        raise Stopped(
            f"stopped with {count} of {len(jobs) + len(checking)} fits and checks in {out}; the same command goes on "
            "from there."
        ) from None
    seconds = time.perf_counter() - began
    modes = [kept if m == mode else fits.documents(job.key for job in plan.jobs(m)) for m in MODES]
    documents = [d for fits_of_mode in modes for d in fits_of_mode.values()]
    kinds = [(kind, "") for kind in KINDS[2:]] + [("profile", item.name) for item in space.free]
    keys = (job.key for m in MODES for kind in kinds for job in plan.jobs(m, *kind))
    done_checks = list(checks.documents(keys).values())
    unshown = fits.others(d["key"] for d in documents) + checks.others(d["key"] for d in done_checks)
    findings = gather(documents, done_checks, believed, ", ".join(prior or ()), others)
    findings = replace(findings, unshown=unshown, requested=mode)
    if page:
        report.write(out, documents, folder.name, folder.origin, Truth.read(study), findings)
    done = sum(map(_done, kept.values()))
    run = {"out": out, "computed": computed, "checked": checked, "wanted": len(jobs), "done": done, "seconds": seconds}
    show(documents, findings, run, json_)
    if page:
        console.print(f"report: [bold]{out / 'report.html'}[/], with summary.csv and figures beside it", soft_wrap=True)
    if not done:
        raise typer.Exit(1)


def _done(document: "Document | None") -> bool:
    return document is not None and document["status"] == "done"


def complete(
    work: "Callable[[Job], Work]", jobs: "Sequence[Job]", store: Store, scheduler: str | None, workers: int
) -> int:  # fmt: skip
    """Do what is missing or failed before; returns how many jobs that were.

    Args:
        work: a job with its recordings read.
        jobs: what is to be done.
        store: of the documents.
        scheduler: address of a cluster.
        workers: processes otherwise.

    Raises:
        SettingError: no scheduler or worker where one is named. InputFileError: the folder cannot be written.
    """
    missing = []
    for job in jobs:
        kept, problem = store.read(job.key)
        if problem:
            console.print(problem, markup=False, soft_wrap=True)
        if kept is None or kept["status"] == "failed":
            missing.append(job)
    if not missing:
        return 0
    with crew(len(missing), scheduler, workers) as do, progress_bar() as progress:
        store.make()  # not before someone is there to fill it
        began = time.perf_counter()
        what = "fitting" if jobs[0].kind == KINDS[0] else "checking"
        bar = progress.add_task(what, total=len(jobs), completed=len(jobs) - len(missing))
        for done, document in enumerate(do(work(job) for job in missing), 1):
            store.write(document)
            rate = done / (time.perf_counter() - began)
            progress.update(bar, advance=1, description=f"{what}, {rate:.2g}/s")
    return len(missing)


@contextlib.contextmanager
def crew(count: int, scheduler: str | None, workers: int) -> "Iterator[Crew]":
    """Who does so many jobs: a cluster where one is named, else local processes, or this one where that is enough."""
    from identification.study import cluster

    cores = workers or min(runner.cores(), count)
    if scheduler is not None:
        with cluster.remote(scheduler) as do:
            yield do
    elif cores == 1 or (not workers and (count < cluster.FEW or not cluster.installed())):
        with cluster.in_process() as do:
            yield do
    else:
        with cluster.local(cores) as do:
            yield do


def failures(failed: Sequence[Mapping[str, Any]]) -> list[str]:
    """Each sentence once, with the places that it is about."""
    from identification.study.summary import place

    places: dict[str, list[str]] = {}
    for d in failed:
        places.setdefault(d["error"], []).append(place(d))
    return [
        f"{'; '.join(where[:_NAMED])}{f' and {len(where) - _NAMED} more' if len(where) > _NAMED else ''}: {error}"
        for error, where in places.items()
    ]


def show(documents: "Sequence[Document]", findings: "Findings", run: Mapping[str, Any], as_json: bool) -> None:
    """What is in the folder now, for people or as JSON: counts by mode, findings, and what failed."""
    from identification.study.summary import counts, first, unfollowed_fits

    failed = [d for d in (*documents, *findings.checks) if d["status"] == "failed"]
    counted = counts(documents, findings.tracked).to_dict("records")
    if as_json:
        errors = [{name: d[name] for name in ("mode", "kind", "parameter", "files", "error")} for d in failed]
        unfollowed = [{"mode": d["mode"], "files": d["files"], "fit_percent": fit}
                for d, fit in unfollowed_fits(documents, findings.tracked)]  # fmt: skip
        print_json({**run, "modes": counted, "failed": errors, "poor": unfollowed, **findings.document()})
    else:
        what = f"{run['computed']} fits and {run['checked']} checks" if run["checked"] else f"{run['computed']} fits"
        title = f"{what} computed in {run['seconds']:.0f} s; {run['done']} of {run['wanted']} fits done"
        from rich.table import Table

        table = Table(title=title, title_justify="left")
        names = [name for name in counted[0] if not name.startswith("again")]  # the page says those in words
        for name in names:
            table.add_column(name.replace("_", " "), justify="left" if name == "mode" else "right")
        for row in counted:
            table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in (row[n] for n in names)))
        results.print(table)
        for subject in findings.subjects:
            results.print(f"subject {subject.subject}, {subject.posture}, {subject.mode}: {subject.sentence}",
                          markup=False, soft_wrap=True)  # fmt: skip
    odd = (text for p in findings.populations for text in p.odd())
    for sentence in (first(documents, findings.tracked), *findings.no_population, *odd, findings.elsewhere):
        if sentence:
            console.print(sentence, style="yellow", markup=False, soft_wrap=True)
    for sentence in failures(failed):
        console.print(f"failed: {sentence}", markup=False, soft_wrap=True)
    for sentence in (text for d in documents if d["status"] == "done" for text in d["left_out"]):
        console.print(f"left out: {sentence}", markup=False, soft_wrap=True)
