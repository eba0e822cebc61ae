"""A search in a process of its own: with progress, ended at once, never left behind."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import IO, Any

OFTEN = 0.2  # s, between two messages of progress
MOST = 0.97  # share of the work that is said before all is done


class SearchJob:
    """The ``fit`` of a search in another process.

    Parameters
    ----------
    search : EffectSearchCV
        Unfitted.
    X, y : DataFrame, Series
        Its data.
    progress : callable
        Called with a share from 0 to 1 and words, from another thread.
    ended : callable
        Called once, from another thread, with the job, the fitted search or None, and the reason
        in words where it failed. It is not called where the job was stopped.
    """

    def __init__(
        self,
        search: Any,
        X: Any,
        y: Any,
        progress: Callable[[float, str], None],
        ended: Callable[[SearchJob, Any, str], None],
    ):
        self._progress, self._ended = progress, ended
        self._stopped = threading.Event()
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(
            target=_searching, args=(theirs,), daemon=True, name="skhoid-search"
        )
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it is read
        with _block_interrupts(), _errors_into(self._errors):
            self._process.start()
        theirs.close()
        self._thread = threading.Thread(
            target=self._follow, args=(search, X, y), daemon=True, name="skhoid-search-follow"
        )
        self._thread.start()

    @property
    def pid(self) -> int | None:
        """Of the process that searches."""
        return self._process.pid

    def stop(self) -> None:
        """End it at once; what it has found is lost."""
        self._stopped.set()
        self._process.kill()
        self._process.join(5)

    def _last_error(self) -> str:
        """The last line that the process wrote; all of them go to the terminal."""
        with self._errors as file:
            file.seek(0)
            text = file.read().decode(errors="replace")
        sys.stderr.write(text)
        return text.rstrip().rpartition("\n")[2].strip()

    def _follow(self, search: Any, X: Any, y: Any) -> None:
        found, why = None, None
        try:
            self._ours.send((search, X, y))
            while True:
                kind, *content = self._ours.recv()
                if kind == "progress":
                    if not self._stopped.is_set():
                        self._progress(*content)
                    continue
                found, why = content
                break
        except (EOFError, OSError):
            pass  # it has ended: why is asked below
        self._ours.close()
        self._process.join(5)
        error = self._last_error()
        if why is None:
            why = _ended(self._process.exitcode, error)
        if not self._stopped.is_set():
            self._ended(self, found, why)


@contextlib.contextmanager
def _block_interrupts() -> Iterator[None]:
    """Ctrl+C in the terminal is for the server, which ends the search: it inherits the mask."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _errors_into(file: IO[bytes]) -> Iterator[None]:
    """What a process that is started here writes to its standard error goes to this file."""
    before = os.dup(2)
    os.dup2(file.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)


def _ended(code: int | None, error: str) -> str:
    if code == -signal.SIGKILL:
        return (
            "The search was ended from outside (SIGKILL) and has found nothing. The system does "
            "that where memory does not suffice: close other programs, or leave runs out."
        )
    why = f": {error}" if error else ""
    return f"The search ended without a result (exit code {code}){why}"


class _Telling:
    """A callback of scikit-learn that tells the server how far the search is."""

    def __init__(self, pipe: Connection, steps: int):
        self._pipe, self._steps = pipe, max(steps, 1)
        self._step = self._done = self._of = 0
        self._last = 0.0

    def setup(self, estimator: Any, context: Any) -> None:
        """Nothing to prepare."""

    def on_fit_task_begin(self, estimator: Any, context: Any) -> None:
        """A step of the search begins."""
        if context.parent is not None and context.max_subtasks:
            self._step, self._done, self._of = self._step + 1, 0, context.max_subtasks
            self._tell()

    def on_fit_task_end(self, estimator: Any, context: Any) -> None:
        """A piece of work is done."""
        if context.parent is not None and not context.max_subtasks:
            self._done += 1
            if time.monotonic() - self._last > OFTEN:
                self._tell()

    def teardown(self, estimator: Any, context: Any) -> None:
        """Nothing to clear away."""

    def _tell(self) -> None:
        self._last = time.monotonic()
        within = min(self._done / self._of, 1.0)
        share = min((self._step - 1 + within) / self._steps, MOST)
        words = f"Searching, step {self._step}: {100 * within:.0f} % of its fits are done."
        self._pipe.send(("progress", share, words))


def _searching(pipe: Connection) -> None:
    """What the other process does."""
    try:
        search, X, y = pipe.recv()
        search.set_callbacks(_Telling(pipe, int(search.max_effects) + 1))
        search.fit(X, y)
        search.set_callbacks()
        pipe.send(("done", search, ""))
    except OSError:  # nobody waits: the server was killed
        return
    except MemoryError:
        pipe.send(("failed", None, "The memory does not suffice for this search."))
    except Exception as error:
        text = " ".join(str(error).split()) or type(error).__name__
        pipe.send(("failed", None, f"The search failed: {text}"))
