"""Growth of ``read_runs`` with rows: a channel and the output, in one file.

cd benchmarks && python -m growth.reading      # some minutes, 2 GB of disk; needs skhoid[io]
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from growth.harness import Work, main
from skhoid import read_runs

RUN = 10_000  # rows
BLOCK = 200_000  # rows that are written at a time
SIZE = 2 * 8 + 2 * 2  # bytes of a row that was read: two numbers, and codes of run and time


class File(NamedTuple):
    """A recording in a file, which is there as long as its folder."""

    path: Path
    rows: int
    folder: tempfile.TemporaryDirectory


def blocks(rows: int) -> Iterator[dict[str, np.ndarray]]:
    """Columns of some rows of a recording."""
    rng = np.random.default_rng(0)
    for first in range(0, rows, BLOCK):
        at = np.arange(first, min(first + BLOCK, rows))
        signals = {name: rng.standard_normal(at.size).round(6) for name in ("e", "u")}
        yield {"run": at // RUN, "time": at % RUN / 100, **signals}


def write(path: Path, rows: int) -> None:
    if path.suffix == ".csv":
        with path.open("w", encoding="ascii") as file:
            file.write("run,time,e,u\n")
            for block in blocks(rows):
                form = ["%d", "%.2f", "%.6f", "%.6f"]
                np.savetxt(file, np.column_stack([*block.values()]), delimiter=",", fmt=form)
        return
    columns = {
        name: np.concatenate([block[name] for block in blocks(rows)])
        for name in ("run", "time", "e", "u")
    }
    if path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
        return
    # MATLAB has runs as columns.
    matrices = {name: columns[name].reshape(-1, RUN).T for name in ("e", "u")}
    matrices["time"] = columns["time"][:RUN, None]
    if "7.3" in path.name:
        import h5py

        with h5py.File(path, "w") as file:
            for name, matrix in matrices.items():
                file[name] = matrix.T
    else:
        from scipy.io import savemat

        savemat(path, matrices)


def written(name: str, rows: int) -> File:
    """A file of another process: what writing takes does not count."""
    folder = tempfile.TemporaryDirectory()
    path = Path(folder.name) / name
    process = multiprocessing.get_context("spawn").Process(target=write, args=(path, rows))
    process.start()
    process.join()
    if process.exitcode:
        raise RuntimeError(f"{path} was not written.")
    return File(path, rows, folder)


def read(file: File) -> None:
    roads = {"inputs": "e", "output": "u", "time": "time"}
    if file.path.suffix != ".mat":
        roads["run"] = "run"
    read_runs(file.path, **roads)


def work(name: str, seconds: float | None = None) -> Work:
    return Work(
        read,
        seconds=seconds,
        memory=5.0,
        make=lambda rows: written(name, rows),
        size=lambda file: SIZE * file.rows,
    )


WORKS = {
    "read_runs, CSV": work("runs.csv", seconds=30.0),
    "read_runs, Parquet": work("runs.parquet"),
    "read_runs, MAT 5": work("runs.mat"),
    "read_runs, MAT 7.3": work("runs-7.3.mat"),
}

if __name__ == "__main__":
    sys.exit(main(__spec__.name, WORKS))
