"""The machine: its memory, and what happens when a process is told to end."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from typing import Any

__all__ = ["check_memory", "ended_by_signals"]

_NUMBER = 8  # bytes


def check_memory(n_numbers: float, what: str) -> None:
    """Refuse, before work begins, what needs more memory than the machine has."""
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # not a POSIX system
        return
    if _NUMBER * n_numbers > memory:
        raise ValueError(
            f"{what} would take {_NUMBER * n_numbers / 2**30:.3g} GiB of memory, but the machine "
            f"has {memory / 2**30:.3g} GiB."
        )


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Leave by SystemExit at SIGTERM and SIGHUP, so that workers are ended and hidden files go.

    By default the process ends at once, and its workers work on. A handler of the user's stays,
    and what is ignored, as by nohup, stays so.
    """
    is_main = multiprocessing.current_process().name == "MainProcess"
    # Only the main thread gets signals, and only it may say what they do.
    if not is_main or threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name, None) for name in ("SIGTERM", "SIGHUP")]  # none on Windows
    taken = [n for n in numbers if n is not None and signal.getsignal(n) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, _leave)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _leave(number: int, *_: Any) -> None:
    raise SystemExit(128 + number)
