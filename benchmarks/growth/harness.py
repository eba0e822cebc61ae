"""Measures how a work grows with rows: data of any size, and each size in a Python of its own.

A part is a module with ``WORKS``, a dict of names and :class:`Work`, which ends in

    if __name__ == "__main__":
        sys.exit(main(__spec__.name, WORKS))

and is run from ``benchmarks`` by ``python -m growth.<part>``, with ``--largest 1e6`` to be done
sooner. The works are timed by CPU time with one thread, so that other work on the machine does not
count; memory is the peak of the resident set above that with the data, as a multiple of the data.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.signal import cont2discrete, lfilter

DT = 0.01  # s
DELAY = 28  # samples of the operator, in whose model nk is one more for the zero-order hold
LINEAR = 1.1  # exponent of time over the last decade of rows
SMALL = 20_000  # rows of a first call that compiles and imports
REPEATS, ENOUGH = 3, 8.0  # the fastest of so many, unless they take so many seconds together


class Data(NamedTuple):
    """Channels and output of runs."""

    X: pd.DataFrame
    y: pd.Series


def make_data(
    rows: int, run_rows: int = 10_000, dtype: Any = np.float64, random_state: int = 0
) -> Data:
    """Runs of a person in a compensatory loop: channels e, x and f_t, output u.

    The operator is an ARX model of two poles with a lead and a delay, driven by white noise
    besides the error; the element is 5 / (s (s + 1)). 1e7 rows take some seconds, and hardly more
    memory than the data.
    """
    rng = np.random.default_rng(random_state)
    B, A = _discrete([0.3, 0.6], [1.0 / 12**2, 2 * 0.25 / 12, 1.0])
    N, D = _discrete([5.0], [1.0, 1.0, 0.0])
    B = np.r_[np.zeros(DELAY), B]
    loop = np.convolve(B, N)  # powers of z^-1
    loop[: A.size + D.size - 1] += np.convolve(A, D)
    to_output = np.convolve(B, D)
    n_runs = -(-rows // run_rows)
    values = np.empty((3, rows), dtype=dtype)
    output = np.empty(rows, dtype=dtype)
    for first in range(0, n_runs, 20):
        part = slice(first * run_rows, min((first + 20) * run_rows, rows))
        shape = (min(20, n_runs - first), run_rows)
        f_t = lfilter([0.01], [1.0, -1.98, 0.9801], rng.standard_normal(shape))
        noise = 0.03 * rng.standard_normal(shape)
        u = lfilter(to_output, loop, f_t) + lfilter(D, loop, noise)
        x = lfilter(N, D, u)
        for into, signal in zip((*values, output), (f_t - x, x, f_t, u), strict=True):
            into[part] = signal.ravel()[: part.stop - part.start]
    codes = np.int16 if max(n_runs, run_rows) < 2**15 else np.int32  # as pandas keeps them
    runs = np.repeat(np.arange(n_runs, dtype=codes), run_rows)[:rows]
    times = np.tile(np.arange(run_rows, dtype=codes), n_runs)[:rows]
    index = pd.MultiIndex(
        levels=[np.arange(n_runs), np.arange(run_rows) * DT],
        codes=[runs, times],
        names=["run", "time"],
        verify_integrity=False,
    )
    X = pd.DataFrame(values.T, index=index, columns=["e", "x", "f_t"], copy=False)
    return Data(X, pd.Series(output, index=index, name="u", copy=False))


def _discrete(numerator: list[float], denominator: list[float]) -> tuple[np.ndarray, np.ndarray]:
    b, a, _ = cont2discrete((numerator, denominator), DT)
    return b.ravel(), a


def size_of(data: Data) -> int:
    """Bytes of channels, output and index."""
    codes = sum(codes.nbytes for codes in data.X.index.codes)
    return data.X.to_numpy().nbytes + data.y.to_numpy().nbytes + codes


@dataclass(frozen=True)
class Work:
    """A work, the rows it is measured at, and what is wanted of it.

    ``run`` gets what ``make`` makes of a number of rows, whose bytes ``size`` counts.
    ``seconds`` may pass at the last of ``rows``, and ``memory`` is the largest multiple of the
    data beside them; None of either is not checked.
    """

    run: Callable[[Any], Any]
    rows: tuple[int, ...] = (100_000, 1_000_000, 10_000_000)
    seconds: float | None = None
    memory: float | None = None
    make: Callable[[int], Any] = make_data
    size: Callable[[Any], int] = size_of


def measure_here(work: Work, rows: int) -> dict[str, float]:
    """CPU and wall seconds and peak memory of a work, in this process."""
    work.run(work.make(SMALL))
    data = work.make(rows)
    gc.collect()
    before = _peak()
    taken = []
    while len(taken) < REPEATS and sum(cpu for cpu, _ in taken) < ENOUGH:
        wall, cpu = time.perf_counter(), time.process_time()
        work.run(data)
        taken.append((time.process_time() - cpu, time.perf_counter() - wall))
    cpu, wall = min(taken)
    beside = _peak() - before
    return {"seconds": cpu, "wall": wall, "beside": beside, "memory": beside / work.size(data)}


def _peak() -> int:
    """Peak of the resident set in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )


def measure(module: str, name: str, rows: int) -> dict[str, float]:
    """The same in a Python of its own, with one thread."""
    one_thread = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    done = subprocess.run(
        [sys.executable, "-m", module, "--one", name, str(rows)],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[1],
        env=os.environ | one_thread,
    )
    return json.loads(done.stdout.splitlines()[-1])


def exponent(found: Mapping[int, Mapping[str, float]]) -> float:
    """Growth of time over the last decade of sizes, or over less at first: 1 is linear."""
    more = max(found)
    less = max((rows for rows in found if 10 * rows <= more), default=min(found))
    growth = found[more]["seconds"] / found[less]["seconds"]
    return float(np.log(growth) / np.log(more / less))


def table(module: str, works: Mapping[str, Work], largest: float = np.inf) -> list[str]:
    """Print the figures of works, and return what was missed."""
    head = (
        f"{'':<34}{'rows':>10}{'CPU s':>9}{'wall s':>9}{'growth':>8}{'memory, MB':>12}{'x data':>8}"
    )
    print(head, flush=True)
    missed = []
    for name, work in works.items():
        found: dict[int, dict[str, float]] = {}
        for rows in [rows for rows in work.rows if rows <= largest]:
            one = found[rows] = measure(module, name, rows)
            grown = f"{exponent(found):.2f}" if len(found) > 1 else ""
            print(
                f"{name:<34}{rows:>10}{one['seconds']:>9.2f}{one['wall']:>9.2f}{grown:>8}"
                f"{one['beside'] / 2**20:>12.0f}{one['memory']:>8.2f}",
                flush=True,
            )
        if len(found) > 1 and exponent(found) > LINEAR:
            missed.append(f"{name}: time grows with rows to the power {exponent(found):.2f}")
        if rows < work.rows[-1]:
            continue
        if work.seconds is not None and one["seconds"] > work.seconds:
            missed.append(f"{name}: {one['seconds']:.1f} s for {rows} rows, not {work.seconds:g}")
        if work.memory is not None and one["memory"] > work.memory:
            missed.append(f"{name}: {one['memory']:.2f} times the data, not {work.memory:g}")
    return missed


def main(module: str, works: Mapping[str, Work]) -> int:
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help=f"of {', '.join(works)}")
    parser.add_argument("--largest", type=float, default=np.inf, help="most rows")
    parser.add_argument("--one", nargs=2, metavar=("NAME", "ROWS"), help="measure that alone")
    given = parser.parse_args()
    if given.one is not None:
        print(json.dumps(measure_here(works[given.one[0]], int(given.one[1]))))
        return 0
    chosen = {name: works[name] for name in given.names or works}
    missed = table(module, chosen, given.largest)
    print("\n" + ("\n".join(f"MISSED: {what}" for what in missed) or "All targets met."))
    return 1 if missed else 0
