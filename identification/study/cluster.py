"""Where jobs are done: in this process, on local processes, or on a Dask cluster. The only importer of dask.

Jobs carry their recordings, so workers need no file of the study; a few are sent ahead, the rest
are read when their turn comes. Dask puts a lost worker's jobs on another one. Its messages are
pickles: whoever reaches the scheduler's port can run programs as you (docs/study.md).
"""

import contextlib
import logging
import uuid
from collections.abc import Callable, Iterable, Iterator
from typing import Any
from urllib.parse import urlsplit

from fasbody import runner
from fasbody.console import once
from fasbody.exceptions import FasError, SettingError, required
from identification.study import job, plan
from identification.study.plan import Work
from identification.study.store import Document

#: Takes work lazily and yields documents as they are ready.
Crew = Callable[[Iterable[Work]], Iterator[Document]]
#: Fewer jobs than this are done here: starting processes takes longer.
FEW = 8
#: Jobs sent ahead for each thread of the cluster, so that none waits for its next recording.
_AHEAD = 2
#: How long to wait for a scheduler, and for its first worker [s].
_PATIENCE_S = 15
_GONE = "the connection to the scheduler is lost; the same command goes on from here."
_QUIET = {"distributed.comm.timeouts.connect": f"{_PATIENCE_S}s"}


@contextlib.contextmanager
def crew(count: int, scheduler: str | None, workers: int) -> Iterator[Crew]:
    """Who does so many jobs: a cluster, local processes, or this one where that is enough.

    Args:
        count: of the jobs.
        scheduler: address of a cluster, None for this machine.
        workers: processes here, 0 for one a core.
    """
    if scheduler is not None:
        with remote(scheduler) as do:
            yield do
    else:
        alone = not workers and count < FEW
        with once():
            yield local(1 if alone else workers or min(runner.cores(), count))


def local(processes: int) -> Crew:
    """So many local processes, one thread each; this one alone where it is one.

    Ctrl-C ends the jobs that it meets, whose documents are not given.
    """

    def do(works: Iterable[Work]) -> Iterator[Document]:
        alone = processes == 1
        done = runner.in_turn(job.run, works) if alone else runner.spread(job.run, works, processes)
        yield from (document for _, document in done)

    return do


@contextlib.contextmanager
def remote(address: str) -> Iterator[Crew]:
    """The workers of an existing scheduler, such as tcp://127.0.0.1:8786.

    Raises:
        MissingPackageError: distributed is not installed.
        SettingError: no scheduler answers there, it has no worker, or its workers have another
            version of this program.
    """
    with required("distributed", "study"):
        import dask
        import distributed

    with dask.config.set(_QUIET), _silent("distributed.client"):
        _ensure(address)
        try:
            client = distributed.Client(address, timeout=_PATIENCE_S)
        except (OSError, ValueError, TimeoutError) as error:
            raise SettingError(
                f"no Dask scheduler answers at {address} ({type(error).__name__}); start one with dask scheduler."
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=_PATIENCE_S)
            except TimeoutError:
                raise SettingError(
                    f"the scheduler at {address} has no worker; start one: dask worker {address}."
                ) from None
            _same_program(client, address)
            yield lambda works: _on(client, works)


@contextlib.contextmanager
def _silent(logger: str) -> Iterator[None]:
    log = logging.getLogger(logger)
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


def _ensure(address: str) -> None:
    try:
        parts = urlsplit(address)
        meant = parts.scheme in ("tcp", "tls") and parts.hostname and parts.port
    except ValueError:  # a port that is no number
        meant = False
    if not meant:
        raise SettingError(f"--scheduler {address} is not tcp://HOST:PORT, for example tcp://127.0.0.1:8786.")


def _same_program(client: Any, address: str) -> None:
    try:
        theirs = set(client.run(plan.program).values())
    except Exception as error:
        raise SettingError(f"the workers of {address} cannot import this program ({error}).") from None
    if theirs != {plan.program()}:
        raise SettingError(f"the workers of {address} have another version of this program; install the same one.")


def _run_on_worker(work: Work, program: str) -> Document:
    """A job on a worker, which may have joined later than the others."""
    if plan.program() != program:
        raise FasError("this worker has another version of the program.")
    return job.run(work)


def _on(client: Any, works: Iterable[Work]) -> Iterator[Document]:
    """Documents in the order in which they are ready; a lost scheduler is a FasError."""
    from distributed.client import CancelledError, ClosedClientError

    try:
        yield from _sent(client, works)
    except (OSError, CancelledError, ClosedClientError):  # CommClosedError is an OSError
        raise FasError(_GONE) from None


def _sent(client: Any, works: Iterable[Work]) -> Iterator[Document]:
    from distributed import as_completed

    program, run, waiting = plan.program(), uuid.uuid4().hex[:8], iter(works)
    sent: dict[str, Work] = {}
    ready = as_completed()

    def refill() -> None:
        most = _AHEAD * max(1, sum(client.nthreads().values()))
        while len(sent) < most and (work := next(waiting, None)) is not None:
            # the key is new in each run, as a shared scheduler may still hold an old result
            future = client.submit(_run_on_worker, work, program, key=f"fit-{work.job.key}-{run}", pure=False)
            sent[future.key] = work
            ready.add(future)

    refill()
    for future in ready:
        work = sent.pop(future.key)
        if future.status == "finished":
            yield future.result()
        elif future.status == "error":
            yield _failed(work, future.exception())
        else:
            raise FasError(_GONE)
        future.release()
        refill()


def _failed(work: Work, error: BaseException) -> Document:
    """What is written of a job whose worker ended, each time it was tried."""
    died = type(error).__name__ == "KilledWorker"
    why = "the worker doing it ended, several times over; memory may be short" if died else " ".join(str(error).split())
    return job.document(work.job, error=f"{work.job}: {why.rstrip('.')}.")
