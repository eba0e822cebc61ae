"""Jobs in joblib: results as they finish, dying workers, and a progress bar."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import Any

from joblib import Parallel, delayed, parallel_config
from threadpoolctl import threadpool_limits

from ... import WorkersLostError
from ..._machine import ended_by_signals

ATTEMPTS = 2  # of a block alone, before it is given up
GIVEN_UP = 3  # blocks in a row, before the study is
POLL, LOOK, PATIENCE = 0.01, 2.0, 60.0  # s: for results, for workers, without workers
ROUNDS = (4, 32)  # blocks a worker of the first round and of the largest
# Of loky, concurrent.futures, dask and ray; none of the last two need be installed.
LOST = {"BrokenExecutor", "CommClosedError", "KilledWorker", "TerminatedWorkerError"} | {
    "RayActorError",
    "WorkerCrashedError",
}


def results_of(
    jobs: Sequence[Any],
    compute: Callable[[Any], Any],
    *,
    n_jobs: int | None,
    threads: bool = False,
) -> Generator[tuple[int, Any], None, None]:
    """Yield the place of each job and its result, in the order in which they finish.

    Jobs whose workers die are sent again; those that kill workers even when sent alone are left
    out, and an error names them when all others are done. ``threads`` says that the work releases
    Python's lock, so that threads suffice unless another backend is requested.
    """
    waiting, lost, in_a_row = dict(enumerate(jobs)), list[int](), 0
    while waiting:
        before, sent = len(waiting), Sent()
        try:
            with contextlib.closing(_send(waiting, compute, n_jobs, threads, sent)) as results:
                for place, result in results:
                    del waiting[place]
                    yield place, result
        except Exception as error:
            _check_lost(error)
            suspects = sent.lost or list(waiting)[: sent.at_once]
            if not sent.lost and len(waiting) < before:
                for place in suspects:  # others first
                    waiting[place] = waiting.pop(place)
                continue
            for place in suspects:  # alone, so that one that kills takes no other with it
                alone = {place: waiting.pop(place)}
                for attempt in range(attempts := 1 if sent.lost else ATTEMPTS):
                    try:
                        yield from _send(alone, compute, n_jobs, threads, Sent())
                        in_a_row = 0
                        break
                    except Exception as again:
                        _check_lost(again)
                        if attempt == attempts - 1:
                            lost.append(place)
                            in_a_row += 1
                if in_a_row == GIVEN_UP:
                    raise _given_up(jobs, lost, len(waiting), error) from error
    if lost:
        raise _given_up(jobs, lost, 0, None)


def _check_lost(error: Exception) -> None:
    """Raise an error that is not the loss of a worker."""
    if not LOST & {kind.__name__ for kind in type(error).__mro__}:
        raise error


def _given_up(
    jobs: Sequence[Any], lost: list[int], left: int, error: Exception | None
) -> WorkersLostError:
    why = "" if error is None else f" ({type(error).__name__})"
    return WorkersLostError(
        f"Workers died{why} repeatedly on each of these blocks, even when run alone: "
        f"{'; '.join(str(jobs[place])[:200] for place in lost)}. Of {len(jobs)} blocks, {left} "
        "more are left; finished blocks are kept in the study's folder, if it has one. Often the "
        "cause is too little memory: use smaller blocks (block_size)."
    )


class Sent:
    """How many jobs may be under way at once, and which were lost, if the sender knows."""

    def __init__(self) -> None:
        self.at_once, self.lost = 1, list[int]()


def _send(
    waiting: dict[int, Any],
    compute: Callable[[Any], Any],
    n_jobs: int | None,
    threads: bool,
    sent: Sent,
) -> Generator[tuple[int, Any], None, None]:
    options: dict[str, Any] = {"n_jobs": n_jobs, "prefer": "threads" if threads else None}
    options |= {"batch_size": 1, "max_nbytes": None}
    parallel = Parallel(**options)
    backend = parallel._backend
    if hasattr(backend, "client"):
        yield from _send_to_dask(backend, waiting, compute, sent)
        return
    workers = parallel._effective_n_jobs()
    sent.at_once = 2 * workers  # as joblib's pre_dispatch
    if backend.supports_return_generator:
        calls = (delayed(placed)(place, compute, job) for place, job in list(waiting.items()))
        results = Parallel(return_as="generator_unordered", **options)(calls)
        try:
            for result in results:  # noqa: UP028  'yield from' closes them before the next lines
                yield result
        finally:
            with warnings.catch_warnings():  # that results were not used, when the study is stopped
                warnings.simplefilter("ignore", UserWarning)
                results.close()
        return
    # Results come when all of a round are there; a round of many blocks keeps workers busy.
    places, size = list(waiting), ROUNDS[0]
    while places:
        chosen, places = places[: size * workers], places[size * workers :]
        yield from parallel(delayed(placed)(place, compute, waiting[place]) for place in chosen)
        size = min(2 * size, ROUNDS[1])


def _send_to_dask(
    backend: Any, waiting: dict[int, Any], compute: Callable[[Any], Any], sent: Sent
) -> Iterator[tuple[int, Any]]:
    """Send through the client of joblib's dask backend, which itself never hears of killed workers.

    Dask itself resends what was on a killed worker, up to about four times in all.
    """
    from distributed import as_completed

    client, killed = backend.client, None
    workers = Workers(client, backend.wait_for_workers_timeout)
    futures = {
        client.submit(placed, place, compute, job, pure=False, **backend.submit_kwargs): place
        for place, job in list(waiting.items())
    }
    try:
        with backend.retrieval_context():
            done = as_completed(futures)
            while done.count():
                finished = list(done.next_batch(block=False))
                if not finished:
                    time.sleep(POLL)
                    workers.check()
                for future in finished:
                    error = future.exception()
                    if error is None:
                        yield future.result()
                    elif type(error).__name__ in LOST:
                        killed = error  # others go on
                        sent.lost.append(futures[future])
                    else:
                        raise error
                    future.release()
    finally:
        client.cancel([future for future in futures if not future.done()])
    if killed is not None:
        raise killed


class Workers:
    """Watch whether a dask cluster has workers; without any it would wait for ever."""

    def __init__(self, client: Any, patience: float) -> None:
        self.client, self.patience = client, max(PATIENCE, patience)
        self.seen = self.looked = time.monotonic()

    def check(self) -> None:
        now = time.monotonic()
        if now - self.looked < LOOK:
            return
        self.looked = now
        if self.client.nthreads():
            self.seen = now
        elif now - self.seen > self.patience:
            raise WorkersLostError(
                f"The dask cluster has had no workers for {self.patience:g} s. Finished blocks "
                "are kept in the study's folder, if it has one."
            )


_limits, _guard = list[Any](), threading.Lock()


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra in one thread, and joblib too unless more is asked for.

    The machine is then not divided among workers twice, and sums are the same however many there
    are. Limits hold for the whole process: of several threads, the last one to leave lifts them.
    """
    with _guard:
        _limits.append(None if _limits else threadpool_limits(1))
    try:
        with parallel_config(backend="threading", n_jobs=1):
            yield
    finally:
        with _guard:
            first = _limits[0]
            _limits.pop()
            if not _limits:
                first.restore_original_limits()


def placed(place: int, compute: Callable[[Any], Any], job: Any) -> tuple[int, Any]:
    """The result of a job, with its place."""
    with one_thread():
        return place, compute(job)


def completed(
    jobs: Mapping[int, Any],
    compute: Callable[[Any], Any],
    finished: Mapping[int, Any],
    keep: Callable[[int, Any], None] | None,
    *,
    n_jobs: int | None,
    progress: bool | None,
    what: str,
    threads: bool = False,
) -> list[Any]:
    """The results of all numbers in order: those that are finished, and those of the jobs.

    ``keep`` is given the number and the result of each job as soon as it is there.
    """
    found, wanted = dict(finished), list(jobs)
    if wanted:
        done = results_of(list(jobs.values()), compute, n_jobs=n_jobs, threads=threads)
        with (
            ended_by_signals(),
            progress_bar(progress, len(found) + len(wanted), len(found), what) as advance,
            contextlib.closing(done),
        ):
            for place, result in done:
                found[wanted[place]] = result
                if keep is not None:
                    keep(wanted[place], result)
                advance()
    return [found[number] for number in sorted(found)]


@contextlib.contextmanager
def progress_bar(shown: bool | None, total: int, done: int, what: str) -> Iterator[Any]:
    """A function to call at each result; None for ``shown`` means: only in a terminal."""
    if shown is None:
        shown = sys.stderr.isatty()
    if not shown or total == done:
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()]
    columns += [TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()]
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total, completed=done)
        yield lambda: bar.advance(task)
