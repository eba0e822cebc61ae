"""Speed of batch identification against its peers, in one run, as ratios.

    pip install -e ".[bench]"
    python benchmarks/bench_identify.py

Each figure is the best of many repeats, taken alternately with its peer. Exits with 1 if a target
is missed.
"""

from __future__ import annotations

import platform
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from skhoid import ARXRegressor, DelaySearchCV

N_ROWS = 8192
REPEATS = 60


def operator_data(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Smooth input and the output of the thesis's operator model, state 1, with white noise."""
    rng = np.random.default_rng(seed)
    e = lfilter([0.1], [1, -0.9], rng.standard_normal(N_ROWS))
    numerator = np.zeros(31)
    numerator[29:] = 0.04428, -0.04318
    u = lfilter(numerator, [1, -1.91211, 0.92427], e)
    return e[:, None], u + 0.01 * rng.standard_normal(N_ROWS)


def best_times(*functions: Callable[[], object], repeats: int = REPEATS) -> list[float]:
    """Best time of each function in seconds, called in turn."""
    best = [np.inf] * len(functions)
    for _ in range(repeats):
        for i, function in enumerate(functions):
            start = time.perf_counter()
            function()
            best[i] = min(best[i], time.perf_counter() - start)
    return best


def import_time(statement: str) -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", statement], check=True)
    return time.perf_counter() - start


def frols_fit(X: np.ndarray, y: np.ndarray) -> Callable[[], object] | None:
    """SysIdentPy's FROLS, told to find the same four regressors of the same lags."""
    try:
        from sysidentpy.basis_function import Polynomial
        from sysidentpy.model_structure_selection import FROLS
    except ImportError:
        return None

    def fit() -> object:
        model = FROLS(
            n_terms=4,
            order_selection=False,
            ylag=[1, 2],
            xlag=[29, 30],
            basis_function=Polynomial(degree=1),
        )
        return model.fit(X=X, y=y[:, None])

    return fit


def main() -> int:
    X, y = operator_data()
    lags = np.column_stack([-y[29:-1], -y[28:-2], X[1:-29, 0], X[:-30, 0]])
    target = y[30:]
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {platform.machine()}")
    ok = True

    def report(what: str, value: float, peer: float, limit: float) -> None:
        nonlocal ok
        ratio = value / peer
        ok &= ratio <= limit
        print(
            f"{what:55s} {1e3 * value:9.3f} ms / {1e3 * peer:9.3f} ms = {ratio:6.2f}"
            f"   (target <= {limit:g}) {'ok' if ratio <= limit else 'MISSED'}"
        )

    model = ARXRegressor(nk=29)
    fit, lstsq = best_times(
        lambda: model.fit(X, y), lambda: np.linalg.lstsq(lags, target, rcond=None)
    )
    agreement = np.abs(model.coef_ - np.linalg.lstsq(lags, target, rcond=None)[0]).max()
    print(f"largest difference of the coefficients from lstsq: {agreement:.1e}")
    report("ARXRegressor.fit / numpy lstsq on the ready matrix", fit, lstsq, 5.0)

    frols = frols_fit(X, y)
    if frols is None:
        print("SysIdentPy is not installed; its comparison is left out")
    else:
        fit, peer = best_times(lambda: model.fit(X, y), frols, repeats=10)
        report("ARXRegressor.fit / SysIdentPy FROLS fit", fit, peer, 1.0)

    search = DelaySearchCV(ARXRegressor(), nk=range(1, 51))
    fit, searched = best_times(lambda: model.fit(X, y), lambda: search.fit(X, y), repeats=30)
    assert search.best_nk_ == 29
    report("DelaySearchCV over 50 delays / one fit", searched, fit, 20.0)

    ours, theirs = [], []
    for _ in range(7):
        ours.append(import_time("import skhoid, sys; assert 'matplotlib' not in sys.modules"))
        theirs.append(import_time("import sklearn.linear_model, pandas"))
    report("import skhoid / import sklearn.linear_model, pandas", min(ours), min(theirs), 1.4)
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
