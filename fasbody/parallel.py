"""Many independent small jobs on all cores, results as they come, with one progress bar."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from fasbody.console import progress_bar
from fasbody.exceptions import FasError

Task = TypeVar("Task")
Result = TypeVar("Result")
#: Fewer jobs than this are done here: starting processes takes longer.
_FEW = 40
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run(
    function: Callable[[Task], Result], tasks: Sequence[Task], description: str, processes: int = 0
) -> Iterator[tuple[int, Result]]:
    """Yield (index, result) of each task as it ends; results are not kept.

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
        before = {name: os.environ.get(name) for name in _THREADS}
        os.environ.update(dict.fromkeys(_THREADS, "1"))  # the children's linear algebra must not fight for the cores
        try:
            # spawn, not fork: the progress bar runs a thread
            with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn")) as pool:
                jobs = {pool.submit(function, task): index for index, task in enumerate(tasks)}
                try:
                    for job in as_completed(list(jobs)):
                        yield jobs.pop(job), job.result()
                        progress.advance(bar)
                except BrokenProcessPool:
                    raise FasError("a worker process was ended by the system; memory may be short.") from None
                finally:
                    for job in jobs:
                        job.cancel()
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
