"""One study on 1, 2 and 4 workers, on loky and on dask, with workers and the study killed.

    pip install -e ".[io,dask]"
    python benchmarks/bench_cluster.py             # a study of a minute; some ten in all
    python benchmarks/bench_cluster.py --share 0.1 # a tenth of it, to try

Each data set is an 81.92 s run of the thesis, simulated, with a delay search and a recursive fit.
Runs on 1 and on 2 workers alternate, as the speed of a machine may change by the minute; the
speed-up is the median over pairs. All tables must be identical. Exits with 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import platform
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import distributed
import joblib
import pandas as pd
from bench_simulate import cpu
from joblib import Parallel, delayed, parallel_config

from skhoid import ARXRegressor, DelaySearchCV, MonteCarloStudy, RecursiveARX
from skhoid.exceptions import StudyWarning
from skhoid.lab.studies.blocks import DataSet

SPEEDUP = 1.8  # from 1 to 2 workers
REPLICATIONS = 360  # of each of 6 cells: about a minute on one core
REPEATS = 3  # pairs
KILLS = (0.2, 0.35, 0.5)  # of the time of the whole study
CELLS = {"condition": ["C1", "C3", "C5"], "remnant_intensity": [0.05, 0.15]}


def fits(data: DataSet) -> dict[str, float]:
    search = DelaySearchCV(ARXRegressor(na=2, nb=2), nk=range(20, 41)).fit(data.X, data.y)
    model = RecursiveARX(na=2, nb=2, nk=search.best_nk_, memory_horizon=256).fit(data.X, data.y)
    a1, b0 = search.best_estimator_.coef_[0], model.coef_path_[-1, 2]
    return {"nk": search.best_nk_, "a1": a1, "b0_at_the_end": b0}


def study(share: float) -> MonteCarloStudy:
    n = max(8, round(share * REPLICATIONS))
    return MonteCarloStudy(fits, CELLS, n, block_size=8, random_state=2017)


@contextlib.contextmanager
def dask_cluster(n_workers: int) -> Iterator[distributed.Client]:
    with (
        distributed.LocalCluster(
            n_workers=n_workers, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
        parallel_config(backend="dask"),
    ):
        client.run(warm)
        yield client


@contextlib.contextmanager
def loky_workers(n_workers: int) -> Iterator[None]:
    with parallel_config(backend="loky", n_jobs=n_workers):
        Parallel(max_nbytes=None)(delayed(warm)() for _ in range(n_workers))
        yield


def warm() -> None:
    """Load the library and its compiled code before the clock runs."""
    MonteCarloStudy(fits, {"condition": ["C1"]}, 1, random_state=0).run()


def timed(run: Callable[[], pd.DataFrame]) -> tuple[float, pd.DataFrame]:
    start = time.perf_counter()
    table = run()
    return time.perf_counter() - start, table


def with_a_killed_worker(share: float, seconds: float, folder: Path) -> tuple[float, pd.DataFrame]:
    """Two dask workers, one of which is killed after a third of the time."""
    with dask_cluster(2) as client:
        victim = min(client.run(os.getpid).values())
        killer = threading.Timer(seconds / 3, os.kill, (victim, signal.SIGKILL))
        killer.start()
        return timed(lambda: study(share).run(folder))


def with_a_killed_study(
    share: float, seconds: float, folder: Path
) -> tuple[float, list[int], pd.DataFrame]:
    """The main process killed three times, and what was kept each time."""
    command = [sys.executable, __file__, "--share", str(share), "--into", str(folder)]
    kept, start = [], time.perf_counter()
    for part in KILLS:
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()  # it begins
            time.sleep(part * seconds)
            process.kill()
        kept.append(len(list(folder.glob("blocks/block-*"))))
    subprocess.run(command, check=True, stdout=subprocess.PIPE)
    return time.perf_counter() - start, kept, study(share).run(folder)


def _reported(
    name: str, workers: Any, share: float, reference: pd.DataFrame, identical: list[bool]
) -> float:
    with workers:
        seconds, table = timed(lambda: study(share).run())
    identical.append(table.equals(reference))
    print(f"{name:<22}{seconds:>9.1f}  {identical[-1]}", flush=True)
    return seconds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--share", type=float, default=1.0, help="part of the study")
    parser.add_argument("--into", type=Path, help="only compute the study, in this folder")
    given = parser.parse_args()
    share = given.share
    warnings.simplefilter("error", StudyWarning)  # no data set may fail
    if given.into is not None:
        print("begins", flush=True)
        study(share).run(given.into)
        return 0
    print(f"{cpu()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(f"joblib {joblib.__version__}, distributed {distributed.__version__}\n")
    warm()
    alone, reference = timed(lambda: study(share).run())
    print(f"{len(reference)} data sets in blocks of 8; one process without joblib: {alone:.1f} s\n")
    print(f"{'workers':<22}{'seconds':>9}  identical")
    identical, gains, latest = [], {}, 0.0
    for name, workers in (("loky", loky_workers), ("dask", dask_cluster)):
        pairs = []
        for _ in range(REPEATS):
            one, latest = (
                _reported(f"{name} {n}", workers(n), share, reference, identical) for n in (1, 2)
            )
            pairs.append(one / latest)
        gains[name] = median(pairs)
        each = ", ".join(f"{gain:.2f}" for gain in pairs)
        print(f"{name}, from 1 to 2: {gains[name]:.2f} (median of {each})")
    _reported("dask 4", dask_cluster(4), share, reference, identical)
    with tempfile.TemporaryDirectory() as place:
        taken, table = with_a_killed_worker(share, latest, Path(place) / "worker")
        identical.append(table.equals(reference))
        print(f"{'dask 2, one killed':<22}{taken:>9.1f}  {identical[-1]}")
        taken, kept, table = with_a_killed_study(share, alone, Path(place) / "study")
        identical.append(table.equals(reference))
        print(f"{'alone, killed 3 times':<22}{taken:>9.1f}  {identical[-1]}")
    print(f"\nblocks kept at each kill, of {-(-len(reference) // 8)}: {kept}")
    missed = [] if all(identical) else ["tables differ"]
    for name, gain in gains.items():
        if gain < SPEEDUP:
            missed.append(f"{name}: {gain:.2f} times as fast with 2 workers, not {SPEEDUP}")
    print("\n".join(f"MISSED: {what}" for what in missed) or "All targets met.")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
