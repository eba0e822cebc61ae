"""Recursions side by side against a loop in C vectorised by hand, and a plain loop, in one run.

    pip install -e .
    python benchmarks/bench_limit.py

``limit.c`` is what the machine can do: 16 recursions of the thesis's ARX[2,2] model, without any
care for missing values and poor excitation, for vectors of 256 and 512 bits. The plain loop is the
kernel's algorithm over lanes, without that care either: vectors by hand stay in the package for as
long as it takes more than 1.3 times as long as they do. Figures are the best processor times per
lane and sample of repetitions taken in turn. Exits with 1 if a ratio to the faster C is missed.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from bench_recursion import FIRST, FORGETTING, LANES, NK, P0, Lanes, operator_data
from bench_simulate import cpu
from numba import njit

from skhoid import _kernels

N_ROWS, REPEATS = 8192, 60
AGREES, ALIKE = 1e-9, 1000  # largest difference of paths from this row on: P0 is forgotten
SOURCE = Path(__file__).with_name("limit.c")
FLAGS = {4: ["-mavx2", "-mfma", "-mno-avx512f"], 8: ["-mprefer-vector-width=512"]}
WANTED = {"runs": 1.5, "settings": 1.3, "runs_by_parameter": 2.0, "settings_by_parameter": 2.0}
WORTH = 1.3  # times the vectors, up to which a plain loop would replace them
COLUMNS, LAGS = np.array([0, 0, 1, 1]), np.array([1, 2, NK, NK + 1])


@njit(error_model="numpy", fastmath={"contract"})
def plain(Z, target, columns, lags, inflate, U, D, theta, path):
    """The update of ``_kernels.rls`` (Bierman 1977), in loops over constant lanes."""
    N = columns.size
    f, g, e = np.empty((N, LANES)), np.empty((N, LANES)), np.empty(LANES)
    phi, alpha, w = np.empty((N, LANES)), np.empty(LANES), np.empty(LANES)
    for t in range(FIRST, Z.shape[1]):
        for j in range(LANES):
            e[j], alpha[j] = target[t, j], 1.0
        for k in range(N):
            z, fk, gk, dk, of_theta, now = (
                Z[columns[k], t - lags[k]],
                f[k],
                g[k],
                D[k],
                theta[k],
                phi[k],
            )
            for j in range(LANES):
                fk[j] = now[j] = z[j]
                e[j] -= z[j] * of_theta[j]
            for i in range(k):
                u, other = U[k * (k - 1) // 2 + i], phi[i]
                for j in range(LANES):
                    fk[j] += u[j] * other[j]
            for j in range(LANES):
                d, before = dk[j] * inflate[j], alpha[j]
                gk[j] = d * fk[j]
                alpha[j] = before + fk[j] * gk[j]
                dk[j] = d * before / alpha[j]
                w[j] = -fk[j] / before
            for i in range(k):
                u, gi = U[k * (k - 1) // 2 + i], g[i]
                for j in range(LANES):
                    old = u[j]
                    u[j] = old + gi[j] * w[j]
                    gi[j] += old * gk[j]
        for j in range(LANES):
            e[j] /= alpha[j]
        for k in range(N):
            gk, of_theta, out = g[k], theta[k], path[t, k]
            for j in range(LANES):
                of_theta[j] += gk[j] * e[j]
                out[j] = of_theta[j]


def plain_call(e: np.ndarray, u: np.ndarray) -> tuple[Callable[[], object], np.ndarray]:
    """A call of the plain loop for runs, and the path it leaves."""
    Z, path = np.stack([-u, e]), _kernels.aligned((N_ROWS, 4, LANES))
    inflate = np.full(LANES, 1 / FORGETTING)

    def call() -> None:
        U, D, theta = np.zeros((6, LANES)), np.full((4, LANES), P0), np.zeros((4, LANES))
        plain(Z, u, COLUMNS, LAGS, inflate, U, D, theta, path)

    return call, path


def c_call(
    library: ctypes.CDLL, name: str, e: np.ndarray, u: np.ndarray, forgetting: np.ndarray
) -> tuple[Callable[[], object], np.ndarray]:
    """A call of the C loop, and the path it leaves."""
    function, path = getattr(library, name), _kernels.aligned((N_ROWS, 4, LANES))
    function.restype = None
    arrays = [np.ascontiguousarray(values) for values in (e, u, forgetting)]
    *signals, factors = [values.ctypes.data_as(ctypes.c_void_p) for values in arrays]
    out = path.ctypes.data_as(ctypes.c_void_p)

    def call() -> None:
        assert arrays  # lives as long as the call
        function(*signals, N_ROWS, NK, factors, ctypes.c_double(P0), out)

    return call, path


def compiled(folder: Path) -> dict[str, ctypes.CDLL]:
    """The C loop for each kind of vector that this machine has; empty without a compiler."""
    cc = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    found = {}
    for lanes, sign in ((4, "avx2"), (8, "avx512f")) if cc else ():
        if sign in flags:
            out = folder / f"limit{lanes}.so"
            more = [*FLAGS[lanes], f"-DV={lanes}", "-shared", "-fPIC", "-o", str(out), str(SOURCE)]
            subprocess.run([str(cc), "-O3", "-march=native", *more], check=True)
            found[f"C, {sign}"] = ctypes.CDLL(str(out))
    return found


def main() -> int:
    records = [operator_data(seed) for seed in range(LANES)]
    e = np.column_stack([X[:N_ROWS, 0] for X, _ in records])
    u = np.column_stack([y[:N_ROWS] for _, y in records])
    calls: dict[tuple[str, str], tuple[Callable[[], object], np.ndarray]] = {}
    with tempfile.TemporaryDirectory() as folder:
        libraries = compiled(Path(folder))
        if not libraries:
            print("There is no C compiler, or no AVX2 here, so the limit is not known: skipped.")
            return 0
        for case in WANTED:
            is_shared = case.startswith("settings")
            some = slice(0, 1) if is_shared else slice(None)
            settings = 1 - 0.5 ** np.arange(1, LANES + 1)
            factors = np.tile(settings if is_shared else np.full(LANES, FORGETTING), (4, 1))
            wide = case.endswith("by_parameter")
            if wide:
                factors[:2] = 1.0
            lanes = Lanes(e[:, some], u[:, some], factors if wide else factors[:1])
            calls[case, "kernel"] = lanes.learn, lanes.path
            for kind, library in libraries.items():
                calls[case, kind] = c_call(library, case, e[:, some], u[:, some], factors)
        calls["runs", "plain Numba"] = plain_call(e, u)
        best = dict.fromkeys(calls, np.inf)
        for _ in range(REPEATS):
            for name, (call, _) in calls.items():
                start = time.process_time()
                call()
                best[name] = min(best[name], time.process_time() - start)
    ok, per = True, 1e9 / ((N_ROWS - FIRST) * LANES)
    print(f"{cpu()}; {LANES} lanes, ns per lane and sample, best of {REPEATS}")
    for case, limit in WANTED.items():
        for kind in (kind for of, kind in calls if of == case):
            off = np.abs(calls[case, kind][1] - calls[case, "kernel"][1])[ALIKE:, :, 7:].max()
            ok &= bool(off <= AGREES)
            print(f"{case:24s} {kind:12s} {per * best[case, kind]:6.2f}   differs by {off:.0e}")
        ratio = best[case, "kernel"] / min(best[case, kind] for kind in libraries)
        ok &= ratio <= limit
        print(f"{case:24s} ratio {ratio:.2f} (<= {limit:g}) {'ok' if ratio <= limit else 'MISSED'}")
    ratio = best["runs", "plain Numba"] / best["runs", "kernel"]
    print(f"plain Numba over vectors by hand {ratio:.2f} (vectors stay above {WORTH:g})")
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
