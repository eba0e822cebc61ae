"""The machine that work runs on: its memory, and what happens when a process is told to end."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from typing import Any

__all__ = ["check_memory", "ended_by_sigterm"]

_NUMBER = 8  # bytes


def check_memory(n_numbers: float, what: str) -> None:
    """Refuse, before work begins, what needs more memory than the machine has."""
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # not a POSIX system
        return
    if _NUMBER * n_numbers > memory:
        raise ValueError(
            f"{what} would take {_NUMBER * n_numbers / 2**30:.3g} GiB of memory, and the machine "
            f"has {memory / 2**30:.3g} GiB."
        )


@contextlib.contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """Leave by SystemExit at SIGTERM, so that workers are ended and hidden files go.

    By default the process ends at once, and its workers work on. A handler of the user's stays.
    """
    is_main = multiprocessing.current_process().name == "MainProcess"
    # Only the main thread gets signals, and only it may say what they do.
    if not is_main or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    if before is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _leave(*_: Any) -> None:
    raise SystemExit(128 + signal.SIGTERM)
