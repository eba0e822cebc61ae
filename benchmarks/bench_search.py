"""Time of a search for missing effects, as a ratio to a reference that runs in the same process.

    pip install -e .
    python benchmarks/bench_search.py

The task is one experiment of the thesis: five runs of 81.92 s at 100 Hz with the channels e, x and
f_t, the whole catalogue, the controlled element given. Searches with nothing missing, one effect,
two, and a delay that was given and is wrong take turns with the reference: ``SIMULATIONS``
simulations of five such runs by the kernels of an operator, its delay and its neuromuscular
system. Time is that of the processor, in one thread. A ratio of the two is nearly the same on fast
and slow machines, alone and beside other work; seconds are not. The numbers mean nothing between
versions that change these kernels: then the seconds of the reference say by how much.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Callable
from statistics import median

import numpy as np
import scipy
from bench_simulate import cpu
from threadpoolctl import threadpool_limits

from skhoid import (
    ControlledElement,
    EffectSearchCV,
    OperatorRegressor,
    _kernels,
    make_tracking_runs,
)
from skhoid.effects import Bias, DeadZone, RateLimit

SIMULATIONS = 1000
N_SAMPLES, N_RUNS, DT = 8192, 5, 0.01
BOUND = 1e60  # of simulated outputs
SEARCHES: dict[str, tuple[object, float | None]] = {
    "nothing": (None, None),
    "dead zone": (DeadZone(width=0.2), None),
    "bias and rate limit": (Bias(level=0.1) + RateLimit(limit=0.4), None),
    "nothing, delay given 60 ms too long": (None, 0.34),
}


def reference() -> None:
    """Simulate five runs again and again, with other parameters each time."""
    error = np.random.default_rng(0).normal(size=(N_SAMPLES, N_RUNS))
    zeta, rest = np.array([0.2]), np.zeros_like(error)
    for i in range(SIMULATIONS):
        late = _kernels.greybox.delayed(error, np.array([[28.0 + i / SIMULATIONS]]))
        omega = np.array([10.0 + i / SIMULATIONS])
        matrices = _kernels.greybox.held_linearly(omega, zeta, DT)
        _kernels.greybox.second_order(late, rest, matrices, 0.0, 0.0, BOUND)


def search_in(effects: object, delay: float | None) -> Callable[[], EffectSearchCV]:
    """A search in runs of an operator with these effects, ready to be fitted."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=N_RUNS,
        remnant_intensity=0.1,
        channels=["e", "x", "f_t"],
        effects=effects,
        random_state=0,
    )
    search = EffectSearchCV(
        OperatorRegressor(delay=delay), controlled_element=ControlledElement(90.0, 6.0)
    )
    return lambda: search.fit(X, y)


def seconds(function: Callable[[], object]) -> tuple[float, object]:
    """Time of the processor that a call takes, and its result."""
    start = time.process_time()
    result = function()
    return time.process_time() - start, result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=int, default=3, help="of each search (default: 3)")
    repeats = parser.parse_args().repeats
    print(
        f"{cpu()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}"
    )
    searches = {name: search_in(*hidden) for name, hidden in SEARCHES.items()}
    taken: dict[str, list[float]] = {name: [] for name in searches}
    ratios: dict[str, list[float]] = {name: [] for name in searches}
    found: dict[str, list[str]] = {}
    with threadpool_limits(1):
        reference()  # compiles
        searches["nothing"]()
        for _ in range(repeats):
            for name, function in searches.items():
                before = seconds(reference)[0]
                spent, fitted = seconds(function)
                here = (before + seconds(reference)[0]) / 2
                taken[name].append(spent)
                ratios[name].append(spent / here)
                found[name] = fitted.best_effects_  # type: ignore[attr-defined]
    print(f"{'ratio':>8}{'s':>8}   search in {N_RUNS} x {N_SAMPLES:,} rows, and what it finds")
    for name in searches:
        ids = ", ".join(found[name]) or "nothing"
        print(f"{median(ratios[name]):8.2f}{median(taken[name]):8.2f}   {name}: {ids}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
