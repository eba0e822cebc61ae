"""Speed of identify_people and of ``skhoid experiment``.

    pip install -e ".[io]"
    python benchmarks/bench_people.py
    python benchmarks/bench_people.py experiment          # half an hour; with fewer: experiment 2 1

``experiment PEOPLE CONDITIONS`` (12 and 4 if nothing is said; 5 runs of 90 s at 60 Hz of each, 3
of 4 people with a stop) prints the processor seconds of the command with two workers, for three
effects and for the whole catalogue.

Without it: identify_people of 15 people, 4 conditions, 5 runs of 5,000 rows each. Wall clock of the
whole call with two processes, whose start counts in the first figure; then the same with a folder,
killed in the middle and resumed. The data are simulated once, and kept in the temporary folder of
the system. Exits with 1 if a target is missed or a resumed result differs.
"""

from __future__ import annotations

import os
import pickle
import platform
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pandas as pd
from bench_simulate import cpu
from joblib.externals.loky import get_reusable_executor

from skhoid import ARXRegressor, OperatorRegressor, simulate_experiment
from skhoid.lab.experiment import identify_people
from skhoid.lab.experiment.people import PeopleResult

DATA = Path(tempfile.gettempdir()) / "skhoid-bench-people.pkl"
ROWS, RATE, RUN_IN = 5_000, 100.0, 8.08
ESTIMATORS = {"ARX": (ARXRegressor(nk=29), 5.0), "operator": (OperatorRegressor(), 60.0)}  # s
TABLES = ("table", "groups", "runs", "failures", "outlying")


def experiment() -> tuple[pd.DataFrame, pd.Series]:
    if not DATA.exists():
        found = simulate_experiment(
            15,
            ["C1", "C2", "C3", "C4"],
            runs=5,
            duration=ROWS / RATE - RUN_IN,
            run_in=RUN_IN,
            sampling_rate=RATE,
            random_state=0,
            n_jobs=2,
        )
        DATA.write_bytes(pickle.dumps(found))
    return pickle.loads(DATA.read_bytes())


def timed(name: str, X: Any, y: Any, **options: Any) -> tuple[float, PeopleResult]:
    start = time.perf_counter()
    found = identify_people(ESTIMATORS[name][0], X, y, n_jobs=2, progress=False, **options)
    return time.perf_counter() - start, found


def killed(name: str, folder: Path) -> int:
    """Start the call in a process, kill it when half is done; how many groups are finished."""
    command = [sys.executable, __file__, name, str(folder)]
    process = subprocess.Popen(command, start_new_session=True)
    while process.poll() is None and len(list(folder.glob("blocks/block-*"))) < 30:
        time.sleep(0.01)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)  # with its workers
    process.wait()
    return len(list(folder.glob("blocks/block-*")))


def search(folder: Path, people: int, conditions: int) -> None:
    """Processor seconds of the command, from files to the page."""
    X, y = simulate_experiment(
        people,
        ["C1", "C2", "C3", "C4"][:conditions],
        runs=5,
        duration=82.0,
        run_in=8.0,
        sampling_rate=60.0,
        remnant_intensity=0.1,
        random_state=3,
    )
    for number, (_, own) in enumerate(y.groupby(level="subject")):
        if number % 4 < 3:
            limit = 1.1 * float(own.std())
            y.loc[own.index] = own.clip(-limit, limit)
    for key, part in X.assign(stick=y).groupby(level=["subject", "condition", "run"]):
        table = part.reset_index("time").reset_index(drop=True)
        table["time"] -= table["time"].iloc[0]
        table[["time", "e", "x", "f_t", "stick"]].to_csv(
            folder / "{}_{}_run{}.csv".format(*key), index=False
        )
    for name, words in {
        "three effects": ["--effects", "saturation", "dead_zone", "bias"],
        "whole catalogue": [],
    }.items():
        command = [Path(sys.executable).with_name("skhoid"), "experiment", folder, *words]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        options = ["--jobs", "2", "--out", folder / f"{len(words)}.html"]
        subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        print(f"{name}: {seconds:.0f} s of processor, {seconds / people / conditions:.1f} s each")


def main() -> int:
    print(f"{cpu()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    X, y = experiment()
    missed = False
    for name, (_, most) in ESTIMATORS.items():
        get_reusable_executor().shutdown(wait=True)
        first, whole = timed(name, X, y)
        again, _ = timed(name, X, y)
        with tempfile.TemporaryDirectory() as folder:
            done = killed(name, Path(folder) / "people")
            rest, resumed = timed(name, X, y, folder=Path(folder) / "people")
        same = all(getattr(whole, table).equals(getattr(resumed, table)) for table in TABLES)
        ok = first <= most and same
        missed |= not ok
        load = "/".join(f"{value:.1f}" for value in os.getloadavg())
        print(
            f"{name:9s} {first:6.1f} s with the start of processes, {again:6.1f} s without; at "
            f"most {most:g}. Killed after {done} of 60 groups, resumed in {rest:.1f} s, "
            f"{'the same' if same else 'NOT THE SAME'}. Load {load}. {'ok' if ok else 'MISSED'}"
        )
    return int(missed)


if __name__ == "__main__":
    if sys.argv[1:2] == ["experiment"]:
        with tempfile.TemporaryDirectory() as folder:
            search(Path(folder), *map(int, sys.argv[2:] or (12, 4)))
    elif len(sys.argv) == 3:
        timed(sys.argv[1], *experiment(), folder=sys.argv[2])
    else:
        sys.exit(main())
