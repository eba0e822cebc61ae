"""Speed of identify_people: 15 people, 4 conditions, 5 runs of 5,000 rows each.

    pip install -e ".[io]"
    python benchmarks/bench_people.py

Wall clock of the whole call with two processes, whose start counts in the first figure; then the
same with a folder, killed in the middle and resumed. The data are simulated once, and kept in the
temporary folder of the system. Exits with 1 if a target is missed or a resumed result differs.
"""

from __future__ import annotations

import os
import pickle
import platform
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
    if len(sys.argv) == 3:
        timed(sys.argv[1], *experiment(), folder=sys.argv[2])
    else:
        sys.exit(main())
