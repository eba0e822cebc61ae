"""Runs, a model of any function and short names for the tests of ``compare``."""

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from support.hidden_effects import simulate_runs

COARSE = {"sampling_rate": 25.0, "oversampling": 4}
DT = 0.04
NK = 8  # tau_e and the ZOH sample
SEED = 1


class Gives(RegressorMixin, BaseEstimator):
    """Predicts what a function makes of X."""

    def __init__(self, function=None):
        self.function = function

    def __repr__(self):
        return "Gives()"

    def __sklearn_is_fitted__(self):
        return True

    def fit(self, X, y=None):
        return self

    def predict(self, X):
        return np.asarray(self.function(X), dtype=float)


def runs(n_runs=3, condition="C1", *, seed=SEED, **options):
    return simulate_runs(condition, n_runs, seed=seed, **COARSE, **options)


def vaf(measured, predicted):
    return 100 * (1 - np.sum((measured - predicted) ** 2) / np.sum(measured**2))


def names(comparison):
    return [finding.name for finding in comparison.findings]
