"""Kernels: functions that are compiled for one signature, once, when they are first called.

Python calls kernels; what they call themselves is :func:`inner`, and in the same file, because
Numba stores what it has compiled for as long as that file does not change.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event

try:
    import fcntl
except ImportError:  # on Windows, where each process compiles for itself
    fcntl = None  # type: ignore[assignment]

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
inner = njit(**OPTIONS)
THREADS = threading.RLock()


class Kernel:
    """A function that is compiled, or taken from Numba's cache, when it is first called.

    Arguments of other types than ``signature`` names are an error: nothing is compiled twice.
    ``every`` lists the kernels of all modules loaded so far.
    """

    every: list[Kernel] = []

    def __init__(self, function, signature, seconds, options):
        self.signature, self.seconds, self.compiled = signature, seconds, None
        self.dispatcher = njit(**OPTIONS | options)(getattr(function, "py_func", function))
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.__module__ = function.__module__
        Kernel.every.append(self)

    def __call__(self, *args):
        return (self.compiled or self.load())(*args)

    def load(self):
        """Take it from the cache, or compile it."""
        with _alone(self.__name__):
            if self.compiled is None and hasattr(self.dispatcher, "compile"):  # Numba is not off
                with event.install_listener("numba:compile", _Status(self)):
                    self.dispatcher.compile(f"({self.signature})")
                self.dispatcher.disable_compile()
            self.compiled = self.dispatcher
        return self.compiled


def kernel(signature, seconds, **options):
    """Make a kernel of a function; its compilation takes about so many ``seconds``."""
    return lambda function: Kernel(function, signature, seconds, options)


@contextmanager
def _alone(name):
    """Let others wait: they find in the cache what the first of them has compiled."""
    with THREADS, ExitStack() as stack:
        if fcntl is not None:
            path = Path(tempfile.gettempdir()) / f"skhoid-{os.getuid()}-{name}.lock"
            fcntl.flock(stack.enter_context(path.open("a")), fcntl.LOCK_EX)
        yield


class _Status(event.Listener):
    """Tells in a terminal what is compiled, if it is not in the cache."""

    def __init__(self, of):
        self.of, self.depth, self.status = of, 0, None

    def on_start(self, _):
        self.depth += 1
        if self.depth == 1 and sys.stderr.isatty():
            from rich.console import Console

            of = self.of.__module__.rpartition(".")[2]
            told = f"Compiling once ({of}), about {self.of.seconds:g} s"
            self.status = Console(stderr=True).status(told)
            self.status.start()

    def on_end(self, _):
        self.depth -= 1
        if self.depth == 0 and self.status is not None:
            self.status.stop()
