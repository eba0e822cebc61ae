"""Speed of compare, as a whole and in parts, and of its pictures.

    pip install -e .
    python benchmarks/bench_compare.py

The task is one experiment of the thesis: five runs of 81.92 s at 100 Hz with the channels e, x, f_t
and a disturbance, against an ARX[2,2] model of five other runs. Figures are best and median of
repetitions taken in turn. Exits with 1 if the target is missed.
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable
from statistics import median
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
import scipy
from bench_simulate import cpu, timed

from skhoid import ARXRegressor, Multisine, check_channels, compare, make_tracking_runs, select_runs
from skhoid.diagnosis.ceiling import noise_ceiling
from skhoid.diagnosis.signals import read_signals

matplotlib.use("Agg")
import matplotlib.pyplot as plt

REPEATS, PICTURE_REPEATS = 10, 3
COMPARE = 1.5  # s
PICTURES = (
    "overview",
    "time",
    "frequency",
    "amplitude",
    "correlation",
    "map",
    "ceiling",
    "runs",
)


def experiment() -> tuple[ARXRegressor, pd.DataFrame, pd.Series]:
    """A model of five runs, and five others."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=10,
        remnant_intensity=0.15,
        channels=["e", "x", "f_t", "dist"],
        disturbance=Multisine().interleaved(scale=0.1, random_state=0),
        random_state=0,
    )
    model = ARXRegressor(nk=29, inputs=["e"]).fit(*select_runs(X, y, first=5))
    return model, *select_runs(X, y, last=5)


def drawn(name: str, comparison: Any) -> Callable[[], None]:
    """Draw a picture down to its pixels."""

    def draw() -> None:
        display = comparison.plot(name)
        display.figure_.canvas.draw()
        plt.close(display.figure_)

    return draw


def main() -> int:
    load = f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "?"
    print(
        f"{cpu()}, {os.cpu_count()} cores, load {load}; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}, pandas {pd.__version__}, "
        f"Matplotlib {matplotlib.__version__}"
    )
    model, X, y = experiment()
    n_runs = X.index.get_level_values("run").nunique()
    print(f"\n{n_runs} runs, {len(X)} rows, channels {', '.join(X.columns)}; {REPEATS} repetitions")
    signals = read_signals(model, X, y)
    calls: dict[str, Callable[[], object]] = {
        "compare": lambda: compare(model, X, y),
        "    the model's own predict": lambda: model.predict(X),
        "    predictions, channels, repeats": lambda: read_signals(model, X, y),
        "    noise ceiling": lambda: noise_ceiling(signals),
        "    check_channels": lambda: check_channels(X, y),
        "compare, one run": lambda: compare(model, *select_runs(X, y, first=1)),
    }
    times = timed(calls, REPEATS)
    comparison = compare(model, X, y)
    calls = {name: drawn(name, comparison) for name in PICTURES}
    times |= timed(calls, PICTURE_REPEATS)
    print(f"{'':42s} best    median   target, s")
    ok = True
    for name, seconds in times.items():
        verdict = ""
        if name == "compare":
            ok = seconds[0] <= COMPARE
            verdict = f"{COMPARE:g} {'ok' if ok else 'MISSED'}"
        print(f"{name:40s} {seconds[0]:6.3f} {median(seconds):9.3f}   {verdict}")
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
