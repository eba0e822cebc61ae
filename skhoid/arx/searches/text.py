"""Candidates in the summary of a search: which to show, and the standard error of the best."""

from __future__ import annotations

from typing import Any

import numpy as np

N_SHOWN = 5


def standard_error_over_folds(results: dict[str, Any], index: int) -> float:
    """Standard error over folds of the mean VAF of a candidate; NaN of a single fold."""
    n_folds = sum(key.startswith("split") and key.endswith("_test_score") for key in results)
    return float(results["std_test_score"][index] / np.sqrt(n_folds - 1)) if n_folds > 1 else np.nan


def highest(vaf: np.ndarray, error: float) -> tuple[np.ndarray, str]:
    """The candidates to show, best first, and a caption with the standard error of the best."""
    caption = "Highest VAF"
    if np.isfinite(error):
        near = int(np.sum(vaf >= np.nanmax(vaf) - error))
        caption += (
            f" ({near} of {vaf.size} within one standard error, {error:.2g} points, of the best)"
        )
    return lowest(-vaf), caption


def lowest(loss: np.ndarray) -> np.ndarray:
    """The candidates to show, best first, without those that could not be fitted."""
    order = np.argsort(loss)[:N_SHOWN]
    return order[~np.isnan(loss[order])]
