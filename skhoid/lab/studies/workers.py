"""Jobs in joblib: results as they finish, dying workers, and their progress."""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import Any

from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from joblib.parallel import get_active_backend
from threadpoolctl import threadpool_limits

from ... import WorkersLostError
from ..._machine import ended_by_signals
from .store import Store

GIVEN_UP = 3  # jobs that kill their workers, before all is given up
ROUND = 16  # jobs a worker, where results do not come one by one
# Of loky, concurrent.futures, dask and ray; none of the last two need be installed.
LOST = {"BrokenExecutor", "CommClosedError", "KilledWorker", "TerminatedWorkerError"} | {
    "RayActorError",
    "WorkerCrashedError",
}


def yield_results(
    jobs: Mapping[int, Any],
    compute: Callable[[Any], Any],
    *,
    n_jobs: int | None,
    threads: bool = False,
) -> Generator[tuple[int, Any], None, None]:
    """Yield the number of each job and its result, in the order in which they finish.

    Where workers die, the jobs that may have killed them are sent again alone; those that kill
    workers even then are left out, and an error names them when all others are done. ``threads``
    says that the work releases Python's lock, so that threads suffice unless another backend is
    requested.
    """
    waiting, lost = dict(jobs), list[int]()
    while waiting:
        try:
            with contextlib.closing(_send(waiting, compute, n_jobs, threads)) as results:
                for number, result in results:
                    del waiting[number]
                    yield number, result
        except Exception as error:
            _check_lost(error)
            under_way = 2 * effective_n_jobs(n_jobs)  # as joblib's pre_dispatch
            for number in list(waiting)[:under_way]:
                alone = {number: waiting.pop(number)}
                try:
                    yield from _send(alone, compute, n_jobs, threads)
                except Exception as again:
                    _check_lost(again)
                    lost.append(number)
                if len(lost) == GIVEN_UP:
                    raise _given_up(jobs, lost, len(waiting)) from error
    if lost:
        raise _given_up(jobs, lost, 0)


def _check_lost(error: Exception) -> None:
    """Raise an error that is not the loss of a worker."""
    if not LOST & {kind.__name__ for kind in type(error).__mro__}:
        raise error


def _given_up(jobs: Mapping[int, Any], lost: list[int], left: int) -> WorkersLostError:
    return WorkersLostError(
        f"Workers died repeatedly on each of these blocks, even when run alone: "
        f"{'; '.join(str(jobs[number])[:200] for number in lost)}. Of {len(jobs)} blocks, {left} "
        "more are left; finished blocks are kept in the study's folder, if it has one. Often the "
        "cause is too little memory: use smaller blocks (block_size)."
    )


def _send(
    jobs: Mapping[int, Any], compute: Callable[[Any], Any], n_jobs: int | None, threads: bool
) -> Generator[tuple[int, Any], None, None]:
    backend, _ = get_active_backend(prefer="threads" if threads else None)
    if hasattr(backend, "client"):
        yield from _send_to_dask(backend, jobs, compute)
        return
    options: dict[str, Any] = {"n_jobs": n_jobs, "prefer": "threads" if threads else None}
    options |= {"batch_size": 1, "max_nbytes": None}
    calls = [delayed(_placed)(number, compute, job) for number, job in jobs.items()]
    if not backend.supports_return_generator:
        size = ROUND * effective_n_jobs(n_jobs)
        for first in range(0, len(calls), size):
            yield from Parallel(**options)(calls[first : first + size])
        return
    results = Parallel(return_as="generator_unordered", **options)(calls)
    try:
        for result in results:  # noqa: UP028  'yield from' closes them before the next lines
            yield result
    finally:
        with warnings.catch_warnings():  # that results were not used, when the study is stopped
            warnings.simplefilter("ignore", UserWarning)
            results.close()


def _send_to_dask(
    backend: Any, jobs: Mapping[int, Any], compute: Callable[[Any], Any]
) -> Iterator[tuple[int, Any]]:
    """Send through the client of joblib's dask backend, which itself never hears of killed workers.

    Dask itself resends what was on a killed worker, up to about four times in all.
    """
    from distributed import as_completed

    client, killed = backend.client, None
    futures = [
        client.submit(_placed, number, compute, job, pure=False, **backend.submit_kwargs)
        for number, job in jobs.items()
    ]
    try:
        for future in as_completed(futures):
            error = future.exception()
            if error is None:
                yield future.result()
            elif type(error).__name__ in LOST:
                killed = error  # others go on
            else:
                raise error
            future.release()
    finally:
        client.cancel([future for future in futures if not future.done()])
    if killed is not None:
        raise killed


def _placed(number: int, compute: Callable[[Any], Any], job: Any) -> tuple[int, Any]:
    """The result of a job, with its number.

    Linear algebra runs in one thread, and joblib too unless more is asked for: the machine is then
    not divided among workers twice, and sums are the same however many there are.
    """
    with threadpool_limits(1), parallel_config(backend="threading", n_jobs=1):
        return number, compute(job)


def completed(
    jobs: Mapping[int, Any],
    compute: Callable[[Any], Any],
    store: Store | None,
    *,
    finished: Mapping[int, Any] | None = None,
    n_jobs: int | None,
    progress: bool | None,
    what: str,
    threads: bool = False,
) -> list[Any]:
    """The results of all numbers in order: those that the store has, and those of other jobs."""
    if finished is None:
        finished = {} if store is None else store.finished()
    found = dict(finished)
    waiting = {number: job for number, job in jobs.items() if number not in found}
    if waiting:
        done = yield_results(waiting, compute, n_jobs=n_jobs, threads=threads)
        with (
            ended_by_signals(),
            # Around those of jobs, which in threads would lift each other's.
            threadpool_limits(1),
            progress_bar(progress, len(found) + len(waiting), len(found), what) as advance,
            contextlib.closing(done),
        ):
            for number, result in done:
                found[number] = result
                if store is not None:
                    store.write(number, result)
                advance(str(jobs[number]))
    return [found[number] for number in sorted(found)]


@contextlib.contextmanager
def progress_bar(shown: bool | None, total: int, done: int, what: str) -> Iterator[Any]:
    """A function to call with the name of each result; None for ``shown``: only in a terminal.

    Without a terminal, as in the log of a cluster, each result is a line.
    """
    in_terminal = sys.stderr.isatty()
    if not (in_terminal if shown is None else shown) or total == done:
        yield lambda name: None
        return
    if not in_terminal:
        start, finished = time.monotonic(), itertools.count(1)

        def say(name: str) -> None:
            n = next(finished)
            left = (total - done - n) * (time.monotonic() - start) / n / 60
            print(
                f"{what}: {name}, {done + n} of {total} done, {left:.0f} min left",
                file=sys.stderr,
                flush=True,
            )

        yield say
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn

    columns = [*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn()]
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total, completed=done)
        yield lambda name: bar.advance(task)
