"""The command `fasbody study`: fit a whole study, resumably, here or on a Dask cluster."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fasbody.console import console, print_json, progress_bar, results
from fasbody.exceptions import InputFileError, Stopped
from identification.study import KINDS, MODES

if TYPE_CHECKING:
    from identification.study.findings import Findings
    from identification.study.plan import Job, Work
    from identification.study.store import Store

#: Places of a failure that are named.
_NAMED = 3

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    study: Annotated[Path, typer.Argument(help="study folder")],
    out: Annotated[Path | None, typer.Option(help="folder for results (default results/NAME_study)")] = None,
    mode: Annotated[str, typer.Option(help=f"{' or '.join(MODES)}: the recordings in one fit")] = MODES[0],
    scheduler: Annotated[str | None, typer.Option(help="address of a Dask scheduler, tcp://HOST:PORT")] = None,
    workers: Annotated[
        int, typer.Option(min=0, help="number of local processes; 0: one per core; 1: no extra process")
    ] = 0,
    starts: Annotated[
        int, typer.Option(help="random starts per branch and round; rounds end when the minimum was found twice")
    ] = 12,
    seed: Annotated[int, typer.Option(min=0, help="seed of the random starts")] = 0,
    model: Annotated[str, typer.Option(help="shipped model or MJCF file")] = "two_dof",
    domain: Annotated[str, typer.Option(help="auto, periodic (steady state) or time")] = "auto",
    free: Annotated[str | None, typer.Option(help="parameters to estimate, e.g. k_T,k_F (default: all)")] = None,
    bounds: Annotated[list[str] | None, typer.Option(help="NAME=LOWER:UPPER in SI units; repeat for several")] = None,
    prior: Annotated[list[str] | None, typer.Option(help="prior of every fit, k_T>k_F or k_F=5e4:2e5; repeat")] = None,
    profile: Annotated[str | None, typer.Option(help="parameters to profile, e.g. k_T,k_F")] = None,
    validate: Annotated[
        bool, typer.Option("--validate", help="predict each frequency from the others; compare linear damping")
    ] = False,
    agreement: Annotated[
        bool, typer.Option("--agreement", help="compare fits in steady state and in the time domain (slow)")
    ] = False,
    replay: Annotated[
        int, typer.Option(min=0, help="recordings of each fit to simulate in full in MuJoCo (0: one in twenty)")
    ] = 0,
    subject: Annotated[list[str] | None, typer.Option(help="only this subject; repeat for several")] = None,
    posture: Annotated[list[str] | None, typer.Option(help="only this posture; repeat")] = None,
    added_mass: Annotated[list[float] | None, typer.Option(help="only this added mass in kg; repeat")] = None,
    frequency: Annotated[list[float] | None, typer.Option(help="only this frequency in Hz; repeat")] = None,
    persons: Annotated[
        list[Path] | None,
        typer.Option("--with", help="results of another study, to add its pooled fits to the population; repeat"),
    ] = None,
    page: Annotated[bool, typer.Option("--report/--no-report", help="write summary, figures and report.html")] = True,
    json_: Annotated[bool, typer.Option("--json", help="print one JSON document on stdout")] = False,
) -> None:
    """Fit every recording of a study and check the fits. Existing results are reused.

    You can stop it at any time and start it again with the same command. Exit code 1 if no fit succeeded.

    Examples:
      fasbody study my_study

      fasbody study my_study --mode pooled --subject 3 --subject 7

      fasbody study my_study --profile k_T,k_F --validate --prior "k_T>k_F"

      fasbody study anna --mode pooled --with results/ben_study --with results/cleo_study

      fasbody study my_study --scheduler tcp://127.0.0.1:8786
    """
    from fasbody.foot.model import load
    from fasbody.recording.study import StudyFolder
    from identification.fitting import Settings
    from identification.parameters import limits, names
    from identification.study import report
    from identification.study.findings import Findings
    from identification.study.job import ensure
    from identification.study.plan import Model, Plan, select
    from identification.study.store import Store, pooled_fits
    from identification.study.tracking import Prior
    from identification.study.truth import Truth

    folder = StudyFolder.open(study)
    trials = select(folder.trials, subject=subject, posture=posture, added_mass_kg=added_mass, frequency_hz=frequency)
    how: dict[str, Any] = {"starts": starts, "seed": seed, "domain": domain, "replay": replay}
    settings = Settings(free=names(free), bounds=limits(bounds), threads=1, **how)
    believed, foot = Prior.read(prior or ()), load(model)
    profiled = tuple(dict.fromkeys(names(profile) or ()))
    space = ensure(mode, settings, foot, profiled)
    plan = Plan(folder, trials, settings, Model.of(foot))
    others = [fit for results_of in persons or () for fit in pooled_fits(results_of)]
    out = out or Path("results") / f"{study.resolve().name}_study"
    if out.is_file():
        raise InputFileError(out, "is a file", "name a folder")
    fits, checks = Store(out / "fits"), Store(out / "checks")
    jobs = plan.jobs(mode)
    kinds = [("profile", name) for name in profiled]
    kinds += [("validation", "")] * validate + [("agreement", "")] * agreement
    checking = [job for kind in kinds for job in plan.jobs(mode, *kind)]
    began = time.perf_counter()
    try:
        computed = complete(plan.work, jobs, fits, scheduler, workers)
        kept = fits.documents(job.key for job in jobs)  # read once: a study has hundreds
        done = {job.trials: kept[job.key] for job in jobs if job.key in kept}
        done = {trials: fit for trials, fit in done.items() if fit["status"] == "done"}
        checking = [job for job in checking if job.kind == "validation" or job.trials in done]
        checked = complete(lambda job: plan.work(job, done.get(job.trials)), checking, checks, scheduler, workers)
    except KeyboardInterrupt:
        finished = [*fits.documents(job.key for job in jobs), *checks.documents(job.key for job in checking)]
        count = f"{len(finished)} of {len(jobs) + len(checking)} fits and checks"
        raise Stopped(f"stopped with {count} in {out}; the same command goes on from there.") from None
    seconds = time.perf_counter() - began
    for other in MODES:
        kept |= fits.documents(job.key for job in plan.jobs(other)) if other != mode else {}
    documents = sorted(kept.values(), key=lambda fit: MODES.index(fit["mode"]))
    every = [(kind, "") for kind in KINDS[2:]] + [("profile", item.name) for item in space.free]
    keys = (job.key for m in MODES for kind in every for job in plan.jobs(m, *kind))
    done_checks = list(checks.documents(keys).values())
    unshown = fits.others(kept) + checks.others(check["key"] for check in done_checks)
    rest = believed, ", ".join(prior or ()), others, unshown, mode
    findings = Findings(documents, done_checks, Truth.read(study), *rest)
    if page:
        report.write(out, findings, folder.name, folder.origin)
    run = {"out": out, "computed": computed, "checked": checked, "wanted": len(jobs)}
    show(findings, run | {"done": len(done), "seconds": seconds}, json_)
    if page:
        where = f"[bold]{out / 'report.html'}[/]"
        console.print(f"report: {where}, with summary.csv and figures beside it", soft_wrap=True)
    if not done:
        raise typer.Exit(1)


def complete(
    work: "Callable[[Job], Work]",
    jobs: "Sequence[Job]",
    store: "Store",
    scheduler: str | None,
    workers: int,
) -> int:
    """Do what is missing or failed before; returns how many jobs that were.

    Raises:
        SettingError: no scheduler or worker where one is named.
        InputFileError: the folder cannot be written.
    """
    from identification.study import cluster

    missing = []
    for job in jobs:
        kept, problem = store.read(job.key)
        if problem:
            text = f"{store.folder / job.key}.json: {problem} and is computed again."
            console.print(text, markup=False, soft_wrap=True)
        if kept is None or kept["status"] == "failed":
            missing.append(job)
    if not missing:
        return 0
    with cluster.crew(len(missing), scheduler, workers) as do, progress_bar() as progress:
        store.make()  # not before someone is there to fill it
        began = time.perf_counter()
        what = "fitting" if jobs[0].kind == KINDS[0] else "checking"
        bar = progress.add_task(what, total=len(jobs), completed=len(jobs) - len(missing))
        for done, document in enumerate(do(work(job) for job in missing), 1):
            store.write(document)
            rate = done / (time.perf_counter() - began)
            progress.update(bar, advance=1, description=f"{what}, {rate:.2g}/s")
    return len(missing)


def failures(failed: Sequence[Mapping[str, Any]]) -> list[str]:
    """Each sentence once, with the places that it is about."""
    from identification.study.summary import place

    places: dict[str, list[str]] = {}
    for document in failed:
        places.setdefault(document["error"], []).append(place(document))
    sentences = []
    for error, where in places.items():
        more = f" and {len(where) - _NAMED} more" if len(where) > _NAMED else ""
        sentences.append(f"{'; '.join(where[:_NAMED])}{more}: {error}")
    return sentences


def show(findings: "Findings", run: Mapping[str, Any], as_json: bool) -> None:
    """What is in the folder now, for people or as JSON: counts by mode, findings, and what failed."""
    from fasbody.page import show as show_sheet
    from fasbody.presentation import Sheet
    from identification.study.summary import counts, first, unfollowed_fits

    documents = findings.documents
    failed = [d for d in (*documents, *findings.checks) if d["status"] == "failed"]
    counted = counts(documents, findings.tracked).to_dict("records")
    if as_json:
        about = ("mode", "kind", "parameter", "files", "error")
        unfollowed = [
            {"mode": fit["mode"], "files": fit["files"], "fit_percent": percent}
            for fit, percent in unfollowed_fits(documents, findings.tracked)
        ]
        errors = [{name: document[name] for name in about} for document in failed]
        print_json({**run, "modes": counted, "failed": errors, "poor": unfollowed, **findings.document()})
    else:
        what = f"{run['computed']} fits" + (f" and {run['checked']} checks" if run["checked"] else "")
        title = f"{what} computed in {run['seconds']:.0f} s; {run['done']} of {run['wanted']} fits done"
        names = [name for name in counted[0] if not name.startswith("again")]  # the page has those
        rows = [
            [
                "–" if v is None else f"{v:.4g}" if isinstance(v, float) else str(v)
                for v in (row[name] for name in names)
            ]
            for row in counted
        ]
        show_sheet(Sheet(title, [name.replace("_", " ") for name in names], rows), "mode")
        for s in findings.subjects:
            text = f"subject {s.subject}, {s.posture}, {s.mode}: {s.sentence}"
            results.print(text, markup=False, soft_wrap=True)
    odd = [text for p in findings.populations for text in p.odd()]
    remarks = [first(documents, findings.tracked), findings.without_intervals, *findings.no_population, *odd]
    for sentence in filter(None, [*remarks, findings.elsewhere]):
        console.print(sentence, style="yellow", markup=False, soft_wrap=True)
    left_out = [text for d in documents if d["status"] == "done" for text in d["left_out"]]
    others = [f"failed: {text}" for text in failures(failed)] + [f"left out: {t}" for t in left_out]
    for sentence in others:
        console.print(sentence, markup=False, soft_wrap=True)
