"""Many independent small jobs on all cores, results as they come, with one progress bar."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

from fasbody.console import held, progress_bar
from fasbody.exceptions import FasError

Task = TypeVar("Task")
Result = TypeVar("Result")
#: Fewer jobs than this are done here: starting processes takes longer.
_FEW = 40
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run(
    function: Callable[[Task], Result], tasks: Sequence[Task], description: str, processes: int = 0
) -> Iterator[tuple[int, Result]]:
    """Yield (index, result) of each task as it ends; results are not kept. Ctrl-C ends the processes at once.

    Args:
        function: importable, of one argument. tasks: its arguments. description: for the progress bar.
        processes: 0 for all cores; 1, or few tasks, stay in this process.

    Raises:
        FasError: what `function` raises; or the machine ended a process.
    """
    count = processes or len(os.sched_getaffinity(0))
    with progress_bar() as progress:
        bar = progress.add_task(description, total=len(tasks))
        if count == 1 or (len(tasks) < _FEW and not processes):
            for index, task in enumerate(tasks):
                yield index, function(task)
                progress.advance(bar)
            return
        with _pool(count) as pool:
            with held():  # which are started here, as tasks come in
                jobs = {pool.submit(function, task): index for index, task in enumerate(tasks)}
            try:
                for job in as_completed(list(jobs)):
                    yield jobs.pop(job), job.result()
                    progress.advance(bar)
            except BrokenProcessPool:
                raise FasError("a worker process was ended by the system; memory may be short.") from None


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes whose linear algebra has one thread; after an exception they are not waited for."""
    before = {name: os.environ.get(name) for name in _THREADS}
    others = set(multiprocessing.active_children())
    os.environ.update(dict.fromkeys(_THREADS, "1"))  # the children's linear algebra must not fight for the cores
    # spawn, not fork: the progress bar runs a thread
    pool = ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
