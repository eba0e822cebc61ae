"""Every option of every estimator with values that make no sense."""

import pytest
from sklearn.base import clone
from support.drawn_models import REGRESSORS, SEARCHES, TRACKING, TRANSFORMERS
from support.fuzzing import outcome
from support.hostile import BAD
from support.synthetic import arx_runs

from skhoid import ARXRegressor, RecursiveARX, RecursiveARXCV, RecursiveIV

DATA = arx_runs(3, 200)
LONGER = arx_runs(1, 700)  # for windows


@pytest.mark.fuzz
@pytest.mark.parametrize("cls", [*REGRESSORS, *TRACKING, *SEARCHES, *TRANSFORMERS])
def test_an_option_without_sense_is_refused_or_taken(cls):
    data = LONGER if cls in TRACKING else DATA
    needed = {"estimator": ARXRegressor()} if cls in SEARCHES else {}
    for name in cls(**needed).get_params(deep=False):
        for value in BAD:
            one_input = cls in (RecursiveARX, RecursiveARXCV, *TRACKING)
            options = needed | ({"inputs": ["e"]} if one_input else {})
            if cls is RecursiveIV:
                options["instruments"] = ["x"]
            model = cls(**{**options, name: value})
            outcome(clone(model).fit, *data)
            if hasattr(cls, "partial_fit"):
                outcome(clone(model).partial_fit, *data)
