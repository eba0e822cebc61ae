"""How time and memory of reading recordings grow with their rows.

    pip install -e ".[io]"
    python benchmarks/bench_read.py                  # some minutes, 2 GB of disk
    python benchmarks/bench_read.py --rows 1000000   # to try

Runs of 10,000 rows with two channels, in one file. Each size is read in a fresh Python, the fastest
of three; memory is the peak of its resident set above that before, as a multiple of what is read.
Growth is the exponent of time in rows over the last decade. Exits with 1 if it is above 1.1, or
memory above 2.5 tables. ``pandas`` is the same CSV file without PyArrow's reader.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bench_simulate import cpu

RUN = 10_000  # rows
REPEATS = 3
GROWTH, MEMORY = 1.1, 2.5
KINDS = {"csv": ".csv", "pandas": ".csv", "parquet": ".parquet", "mat 5": ".mat", "mat 7.3": ".mat"}
ROADS = {"inputs": "e", "output": "u", "time": "time"}


def write(folder: Path, rows: int) -> dict[str, str]:
    """Write the same recording in every format; returns the file of each."""
    import h5py
    import pyarrow as pa
    import pyarrow.parquet as pq
    from scipy.io import savemat

    rng = np.random.default_rng(0)
    columns = {"run": np.arange(rows) // RUN, "time": np.arange(rows) % RUN / 100}
    columns |= {name: rng.standard_normal(rows).round(6) for name in ("e", "u")}
    paths = {kind: str(folder / f"{kind.split()[-1]}-{rows}{KINDS[kind]}") for kind in KINDS}
    paths["pandas"] = paths["csv"]
    form = ["%d", "%.2f", "%.6f", "%.6f"]
    with open(paths["csv"], "w", encoding="ascii") as file:
        file.write(",".join(columns) + "\n")
        for start in range(0, rows, 100_000):
            part = np.column_stack([each[start : start + 100_000] for each in columns.values()])
            np.savetxt(file, part, delimiter=",", fmt=form)
    pq.write_table(pa.table(columns), paths["parquet"])
    # MATLAB has runs as columns.
    matrices = {name: columns[name].reshape(-1, RUN).T for name in ("e", "u")}
    matrices["time"] = columns["time"][:RUN, None]
    savemat(paths["mat 5"], matrices)
    with h5py.File(paths["mat 7.3"], "w") as file:
        for name, matrix in matrices.items():
            file[name] = matrix.T
    return paths


def measure(kind: str, path: str) -> dict[str, float]:
    """Seconds, and peak memory as a multiple of what is read, in this process."""
    import pyarrow.csv
    import pyarrow.parquet  # noqa: F401

    from skhoid import read_runs

    if kind == "pandas":
        sys.modules["pyarrow.csv"] = None
    options = ROADS if kind.startswith("mat") else ROADS | {"run": "run"}
    with tempfile.TemporaryDirectory() as folder:
        write_small = Path(folder) / "small.csv"
        write_small.write_text("run,time,e,u\n0,0,1,2\n0,1,3,4\n")
        read_runs(write_small, **ROADS)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start, worked = time.perf_counter(), time.process_time()
    X, y = read_runs(path, **options)
    seconds, worked = time.perf_counter() - start, time.process_time() - worked
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    # X and y share their index.
    table = X.memory_usage(deep=True).sum() + y.memory_usage(index=False)
    return {
        "seconds": seconds,
        "cpu": worked,
        "table": table / 2**20,
        "peak": peak * 1024 / table,
        "sum": float(X["e"].sum() + y.sum()),
    }


def in_a_process(kind: str, path: str) -> dict[str, float]:
    command = [sys.executable, __file__, "--one", kind, path]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=10_000_000, help="of the largest file")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), help=f"of {', '.join(KINDS)}")
    parser.add_argument("--folder", help="keep the files here")
    parser.add_argument("--one", nargs=2, help="kind and file: measure that alone")
    given = parser.parse_args()
    if given.one is not None:
        print(json.dumps(measure(*given.one)))
        return 0
    print(f"{cpu()}, {os.cpu_count()} cores, Python {platform.python_version()}\n")
    print(f"{'':<10}{'rows':>12}{'seconds':>9}{'CPU, s':>9}{'growth':>8}{'MB':>8}{'memory':>8}")
    missed = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(given.folder or temporary)
        sizes = [given.rows // 100, given.rows // 10, given.rows]
        files = [write(folder, rows) for rows in sizes]
        for kind in given.kinds:
            before = None
            for rows, paths in zip(sizes, files, strict=True):
                trials = [in_a_process(kind, paths[kind]) for _ in range(REPEATS)]
                found = min(trials, key=lambda one: one["seconds"])
                growth = math.log10(found["cpu"] / before) if before else math.nan
                before = found["cpu"]
                print(
                    f"{kind:<10}{rows:>12,}{found['seconds']:>9.2f}{found['cpu']:>9.2f}"
                    f"{growth:>8.2f}{found['table']:>8.0f}{found['peak']:>8.2f}"
                )
            if growth > GROWTH:
                missed.append(f"{kind}: time grows as rows to the power {growth:.2f}")
            if found["peak"] > MEMORY:
                missed.append(f"{kind}: {found['peak']:.2f} times the table in memory")
    print("\n" + ("\n".join(f"MISSED: {what}" for what in missed) or "All targets met."))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
