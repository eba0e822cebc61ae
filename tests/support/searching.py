"""A search without its estimator, to look at its steps."""

import numpy as np

from skhoid import OperatorRegressor
from skhoid.effects import Effects
from skhoid.search.judges import HeldOutRows
from skhoid.search.steps import Search


def search_of(X, y, effects, text=None, **options):
    """A search that leaves one run out at a time, and the model that it starts from."""
    estimator = OperatorRegressor(controlled_element=text, **options)
    prepared = estimator.prepare(X, y)
    known = prepared.record.known
    folds = []
    for run in range(known.shape[1]):
        test = np.zeros_like(known)
        test[:, run] = known[:, run]
        folds.append(HeldOutRows(test, known & ~test))
    tried = [effect for _, effect in Effects.of(effects)]
    search = Search(prepared.core, prepared.record, tried, folds)
    return search, estimator.first_fit(prepared)
