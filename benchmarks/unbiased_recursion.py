"""Bias, variance and divergence of the unbiased recursions, beside recursive least squares.

    python benchmarks/unbiased_recursion.py [--runs 417] [--memory 6.4] [--jobs 2] [--out FILE]

In each of C1 to C6 and each remnant order 1 to 4, at P_n = 0.15 and 100 Hz, single runs are
followed by RecursiveARX, RecursiveBoxJenkins and RecursiveIV with the same memory. From the last
15 s (C3 to C6: 26 s and more after the change) come the bias (mean over runs and instants, in per
cent of the truth) and the standard deviation; 417 runs a cell are 10,008 in all. Diverged is a run
with an estimate anywhere after the first window that is not finite, or beyond a hundred times the
truth, of the coefficients; "not complex" are instants whose poles are no pair.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from skhoid import (
    RecursiveARX,
    RecursiveBoxJenkins,
    RecursiveIV,
    arx_to_operator,
    make_tracking_runs,
    tracking_condition,
    zoh_parameters,
)

NAMES = ("K_e", "K_edot", "omega_nm", "zeta_nm")
BLOCK = 25  # runs simulated at a time
NK, DT, LAST, FIRST_WINDOW = 29, 0.01, 1500, 3072
FAR = 100.0  # times the truth
SEED = 5000  # tuned on seeds below 100


def followed(condition, order, runs, block, memory):
    """Estimates of one block: (method, run) -> operator parameters in the last rows, diverged."""
    X, y = make_tracking_runs(
        condition,
        n_runs=runs,
        remnant_intensity=0.15,
        remnant_order=order,
        channels=["e", "f_t"],
        run_in=30.0,
        random_state=SEED + 100 * block,
    )
    signals, u = X.to_numpy().reshape(runs, -1, 2), y.to_numpy().reshape(runs, -1)
    truth = zoh_parameters(tracking_condition(condition).operator, DT, np.arange(u.shape[1]) * DT)
    common = {"nk": NK, "memory_time": memory, "dt": DT, "inputs": [0]}
    models = {
        "RecursiveARX": RecursiveARX(**common),
        "RecursiveBoxJenkins": RecursiveBoxJenkins(**common),
        "RecursiveIV": RecursiveIV(**common, instruments=[1]),
    }
    found = []
    for name, model in models.items():
        for run in range(runs):
            path = model.fit(signals[run], u[run]).coef_path_
            later = path[FIRST_WINDOW:]
            far = np.abs(later) > FAR * np.abs(truth[FIRST_WINDOW:]).max(axis=0)
            values, _, _ = arx_to_operator(path[-LAST:], DT)
            stacked = np.stack([values[n] for n in NAMES], axis=1)
            found.append((name, bool(far.any() or not np.isfinite(later).all()), stacked))
    return found


def cell(condition, order, runs, memory):
    """One row of the table for each method."""
    operator = tracking_condition(condition).operator.at(81.9)
    K_e, K_edot = (float(gain[0]) for gain in operator.gains(np.zeros(1)))
    truth = np.array([K_e, K_edot, operator.omega_nm, operator.zeta_nm])
    sizes = [min(BLOCK, runs - first) for first in range(0, runs, BLOCK)]
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for block, size in enumerate(sizes):
            found += followed(condition, order, size, block, memory)
    rows = []
    warnings.simplefilter("ignore")  # means of nothing, where no pair of poles is complex
    for method in dict.fromkeys(name for name, _, _ in found):
        errors = np.stack([v for name, _, v in found if name == method]) / truth - 1.0
        diverged = sum(far for name, far, _ in found if name == method)
        row = {"condition": condition, "order": order, "method": method, "runs": runs}
        row |= {"diverged": diverged, "not complex": float(np.isnan(errors).mean())}
        for k, name in enumerate(NAMES):
            of_run = np.nanmean(errors[:, :, k], axis=1)
            row[f"bias {name}"] = 100 * np.nanmean(errors[:, :, k])
            row[f"se {name}"] = 100 * np.nanstd(of_run) / np.sqrt(np.isfinite(of_run).sum())
            row[f"sd {name}"] = 100 * np.nanstd(errors[:, :, k])
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=417)
    parser.add_argument("--memory", type=float, default=6.4)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out")
    options = parser.parse_args()
    cells = [(f"C{c}", order) for c in range(1, 7) for order in (1, 2, 3, 4)]
    found = Parallel(options.jobs)(
        delayed(cell)(*one, options.runs, options.memory) for one in cells
    )
    table = pd.DataFrame([row for rows in found for row in rows])
    if options.out:
        table.to_csv(options.out, index=False)
    with pd.option_context("display.width", 250, "display.max_columns", 30, "display.max_rows", 99):
        print(table.round(1).to_string(index=False))
    least = table[table["method"] == "RecursiveARX"].set_index(["condition", "order"])
    for method in ("RecursiveBoxJenkins", "RecursiveIV"):
        part = table[table["method"] == method].set_index(["condition", "order"])
        bias = part[[f"bias {n}" for n in NAMES]].abs()
        ratio = (part[[f"sd {n}" for n in NAMES]] / least[[f"sd {n}" for n in NAMES]]) ** 2
        print(f"\n{method}: {int(part['diverged'].sum())} of {int(part['runs'].sum())} diverged.")
        print(f"  cells with a bias below 5 %: {(bias < 5).sum().to_dict()} of {len(part)}")
        print(f"  largest bias: {bias.max().round(1).to_dict()}")
        print(f"  variance over that of RecursiveARX, median: {ratio.median().round(2).to_dict()}")


if __name__ == "__main__":
    main()
