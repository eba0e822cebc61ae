"""Every option of every estimator with values that make no sense."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from support.drawn_models import BAD_NAMES, REGRESSORS, SEARCHES, TRANSFORMERS
from support.fuzzing import outcome
from support.synthetic import arx_runs

from skhoid import RecursiveARX, RecursiveARXCV

BAD = [
    *BAD_NAMES, -1.5, 1e-300, "1", b"a", 1j, -(10**9), 10**30, [np.nan], [np.inf], ["1"], [[1]],
    [None], [[]], (1, 2, 3, 4, 5, 6), {"e": 1}, np.zeros((2, 2)), np.array(["a"]),
    pd.Series([1.0]), pd.NA, slice(1), len, lambda t: "a", lambda t: 1 / 0, lambda t: {}["a"],
]  # fmt: skip
DATA = arx_runs(3, 200)


@pytest.mark.fuzz
@pytest.mark.parametrize("cls", [*REGRESSORS, *SEARCHES, *TRANSFORMERS])
def test_an_option_without_sense_is_refused_or_taken(cls):
    for name in cls().get_params(deep=False):
        for value in BAD:
            options = {"inputs": ["e"]} if cls in (RecursiveARX, RecursiveARXCV) else {}
            model = cls(**{**options, name: value})
            outcome(clone(model).fit, *DATA)
            if cls is RecursiveARX:
                outcome(clone(model).partial_fit, *DATA)
