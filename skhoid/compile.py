"""Compile all kernels ahead, for images, clusters and tests: ``python -m skhoid.compile``."""

from __future__ import annotations

import argparse
import time
from importlib import import_module
from typing import Any

from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import track

from . import _kernels


def compile_all(n_jobs: int = -1) -> str:
    """Compile what is not yet in Numba's cache; a terminal shows the progress.

    Parameters
    ----------
    n_jobs : int, default=-1
        Processes; -1 for all cores.

    Returns
    -------
    folder : str
        Of the cache.
    """
    kernels = find_kernels()
    longest_first = sorted(range(len(kernels)), key=lambda i: -kernels[i].seconds)
    run = Parallel(n_jobs, return_as="generator_unordered")
    done = run(delayed(_compile)(i) for i in longest_first)
    console = Console(stderr=True)
    for _ in track(
        done, "Compiling", len(kernels), console=console, disable=not console.is_terminal
    ):
        pass
    return str(kernels[0].dispatcher.stats.cache_path)


def find_kernels() -> list[Any]:
    """All kernels of the package."""
    for name in sorted(_kernels.MODULES):
        import_module(f"{_kernels.__name__}.{name}")
    return import_module(f"{_kernels.__name__}.kernel").Kernel.every


def _compile(i: int) -> None:
    find_kernels()[i].load()


def main(words: list[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m skhoid.compile", description=__doc__)
    parser.add_argument(
        "-j", "--jobs", type=int, default=-1, metavar="N", help="processes (default: all cores)"
    )
    start = time.perf_counter()
    folder = compile_all(parser.parse_args(words).jobs)
    print(
        f"{len(find_kernels())} kernels are compiled, in {folder}, after "
        f"{time.perf_counter() - start:.1f} s."
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
