"""Recursive ARX models: forgetting, starts, several runs, missing data, streams, the grid."""

from typing import Any

import numpy as np
from cases import case, model_items
from worlds import NK, arx, loop

import skhoid
from skhoid import RecursiveARX, RecursiveARXCV, VAFScorer

OPTIONS: dict[str, dict[str, Any]] = {
    "no forgetting": {},
    "lambda": {"forgetting": 0.99},
    "Lambda": {"forgetting": [1.0, 1.0, 0.98, 0.98]},
    "Lambda diagonal": {"forgetting": [1.0, 0.999, 0.98, 0.98], "forgetting_form": "diagonal"},
    "N0": {"memory_horizon": 64},
    "N0 2": {"memory_horizon": 2},
    "N0 by parameter": {"memory_horizon": [np.inf, np.inf, 64, 32]},
    "T0": {"memory_time": 2.56},
    "intercept": {"memory_horizon": 128, "fit_intercept": True},
    "zeros": {"init": "zeros", "forgetting": 0.99},
    "given start": {"init": [-1.2, 0.4, 0.1, 0.1], "p0": 100.0, "forgetting": 0.995},
    "window": {"init_window": 10.24, "memory_time": 5.12},
    "p0": {"p0": 1e4, "memory_horizon": 128},
    "average": {"combine": "average_estimates", "memory_horizon": 64},
    "last": {"parameters": "last", "memory_horizon": 128},
    "smooth": {"smooth": True, "memory_horizon": 64},
    "covariance": {"store_covariance": True, "memory_horizon": 64},
    "resets": {"reset_times": [20.0, 40.96], "memory_horizon": 256},
    "two inputs": {"inputs": ["e", "x"], "nb": [2, 1], "nk": [NK, 17], "memory_horizon": 512},
}


def fitted(options: dict[str, Any], condition: str = "C4") -> dict[str, Any]:
    options = {"nk": NK, "inputs": ["e"]} | options
    found = {}
    for n_runs in (1, 3):
        X, y = loop(condition, n_runs)
        model = RecursiveARX(**options).fit(X, y)
        other = loop(condition, 2, 7)
        items = model_items(model, *other) | {"simulate": model.simulate(other[0])}
        found |= {f"{n_runs} runs/{name}": value for name, value in items.items()}
    return found


for _name, _options in OPTIONS.items():
    case(f"recursive/{_name}", options=_options)(fitted)


@case("recursive/missing")
def missing() -> dict[str, Any]:
    """No measurement, a gap, a pause of zeros and a held input, in one recording."""
    X, y = (table.copy() for table in loop("C5", 2))
    y.iloc[300:330] = np.nan
    X.iloc[700:720, 0] = np.nan
    X.iloc[900:1300], y.iloc[900:1300] = 0.0, 0.0
    keep = np.r_[0:1500, 1525 : len(y)]
    X, y = X.iloc[keep], y.iloc[keep]
    model = RecursiveARX(nk=NK, inputs=["e"], forgetting=0.95).fit(X, y)
    return model_items(model, X, y)


def streamed(options: dict[str, Any], chunk: int) -> dict[str, Any]:
    X, y = arx(n_runs=2, seed=3)
    model = RecursiveARX(nk=3, inputs=["e"], dt=0.04, **options)
    for start in range(0, len(y), chunk):
        model.partial_fit(X.iloc[start : start + chunk], y.iloc[start : start + chunk])
    return model_items(model, X, y)


for _name, _options in {
    "zeros": {"init": "zeros", "forgetting": 0.99},
    "window": {"init_window": 4.0, "memory_time": 2.0},
    "covariance": {"init": "zeros", "memory_horizon": 50, "store_covariance": True},
}.items():
    for _chunk in (1, 37, 400):
        case(f"recursive/stream/{_name} by {_chunk}", options=_options, chunk=_chunk)(streamed)


def grid(options: dict[str, Any]) -> dict[str, Any]:
    X, y = loop("C4", 3)
    horizons = [16, 64, 256, (np.inf, np.inf, 64, 64), np.inf]
    search = RecursiveARXCV(horizons, nk=NK, inputs=["e"], **options).fit(X, y)
    return model_items(search, *loop("C4", 1, 7))


for _name, _options in {
    "plain": {},
    "window": {"scoring": VAFScorer(window=(30.72, 51.2))},
    "zeros": {"init": "zeros", "p0": 1e3},
}.items():
    case(f"recursive cv/{_name}", options=_options)(grid)


@case("recursive/forgetting_factor")
def factors() -> dict[str, Any]:
    return {
        "N0": skhoid.forgetting_factor([2, 256, np.inf]),
        "T0": skhoid.forgetting_factor(memory_time=2.56, dt=0.01),
    }
