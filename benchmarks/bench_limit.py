"""Recursions side by side against a loop in C that is vectorised by hand, in one run.

    pip install -e .
    python benchmarks/bench_limit.py

``limit.c`` is what the machine can do: 16 recursions of the thesis's ARX[2,2] model, without any
care for missing values and poor excitation, compiled for each kind of vector of this machine.
The kernels of the package take care of both. Figures are nanoseconds per lane and sample, best and
median of repetitions taken in turn; the ratio is that of the best ones, to the faster C loop. Exits
with 1 if a ratio is missed. Without a C compiler there is nothing to compare with.
"""

from __future__ import annotations

import ctypes
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from bench_recursion import FIRST, FORGETTING, LANES, NK, P0, Lanes, aligned, operator_data
from bench_simulate import cpu, timed

from skhoid import _kernels

N_ROWS, REPEATS = 8192, 60
AGREES = 1e-9  # largest difference of paths
ALIKE = 1000  # rows from which they are compared: rounding of P0 is forgotten
SOURCE = Path(__file__).with_name("limit.c")
VECTORS = [("AVX2", "__AVX2__", 4, ["-mno-avx512f"]), ("AVX-512", "__AVX512F__", 8, [])]
WANTED = {"runs": 1.5, "settings": 1.3, "runs_by_parameter": 2.0, "settings_by_parameter": 2.0}


def compiled(cc: str, folder: Path) -> dict[str, ctypes.CDLL]:
    """The C loop by kind of vector, as far as this machine has it."""
    native = [cc, "-O3", "-march=native"]
    says = subprocess.run(
        [*native, "-dM", "-E", "-x", "c", os.devnull], capture_output=True, text=True, check=True
    ).stdout
    kinds = [(name, lanes, flags) for name, sign, lanes, flags in VECTORS if sign in says]
    libraries = {}
    for name, lanes, flags in kinds or [("two lanes", 2, [])]:
        out = folder / f"limit{lanes}.so"
        wide = [f"-mprefer-vector-width={64 * lanes}"] if kinds else []
        command = [*native, *flags, *wide, f"-DV={lanes}", "-shared", "-fPIC", "-o", out, SOURCE]
        subprocess.run(command, check=True)
        libraries[name] = ctypes.CDLL(str(out))
    return libraries


def of_c(
    library: ctypes.CDLL, name: str, e: np.ndarray, u: np.ndarray, forgetting: np.ndarray
) -> tuple[Callable[[], object], np.ndarray]:
    """A call of the C loop, and the path it leaves."""
    function, path = getattr(library, name), _kernels.aligned((len(u), 4, LANES))
    function.restype = None
    arrays = [aligned(values) for values in (e, u, forgetting)]
    *signals, factors = [values.ctypes.data_as(ctypes.c_void_p) for values in arrays]
    out = path.ctypes.data_as(ctypes.c_void_p)

    def call() -> None:
        assert arrays  # lives as long as the call
        function(*signals, len(u), NK, factors, ctypes.c_double(P0), out)

    return call, path


def main() -> int:
    cc = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if cc is None:
        print("There is no C compiler (cc, gcc or clang), so the limit is not known: skipped.")
        return 0
    version = subprocess.run([cc, "--version"], capture_output=True, text=True, check=True).stdout
    print(f"{cpu()}; Python {platform.python_version()}; {version.splitlines()[0]}")
    records = [operator_data(seed) for seed in range(LANES)]
    e = np.column_stack([X[:N_ROWS, 0] for X, _ in records])
    u = np.column_stack([y[:N_ROWS] for _, y in records])
    settings = 1 - 0.5 ** np.arange(1, LANES + 1)
    calls: dict[str, Callable[[], object]] = {}
    paths: dict[str, np.ndarray] = {}
    with tempfile.TemporaryDirectory() as folder:
        libraries = compiled(cc, Path(folder))
        for case in WANTED:
            some = slice(0, 1) if case.startswith("settings") else slice(None)
            factors = settings if case.startswith("settings") else np.full(LANES, FORGETTING)
            factors = np.repeat(factors[None], 4, axis=0)
            if case.endswith("by_parameter"):
                factors[:2] = 1.0
            lanes = Lanes(e[:, some], u[:, some], factors if factors[0, 0] == 1.0 else factors[:1])
            calls[case], paths[case] = lanes.learn, lanes.path
            for kind, library in libraries.items():
                name = f"{case}, C with {kind}"
                calls[name], paths[name] = of_c(library, case, e[:, some], u[:, some], factors)
        times = timed(calls, REPEATS)
    per = 1e9 / ((N_ROWS - FIRST) * LANES)
    ok = True
    print(f"\n{LANES} lanes, {REPEATS} repetitions, per lane and sample    best    median")
    for case, limit in WANTED.items():
        limits = [f"{case}, C with {kind}" for kind in libraries]
        for name in [*limits, case]:
            print(f"{name:45s} {per * times[name][0]:9.2f} {per * median(times[name]):9.2f} ns")
        ratio = times[case][0] / min(times[name][0] for name in limits)
        off = max(np.abs(paths[name] - paths[case])[ALIKE:, :, 7:].max() for name in limits)
        good = ratio <= limit and off <= AGREES
        ok &= good
        print(
            f"    ratio {ratio:.2f} (<= {limit:g}), paths differ by {off:.0e} (<= {AGREES:g}) "
            f"{'ok' if good else 'MISSED'}"
        )
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
