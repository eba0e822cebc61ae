"""Every option of every estimator with values that make no sense."""

import pytest
from sklearn.base import clone
from support.drawn_models import REGRESSORS, SEARCHES, TRANSFORMERS
from support.fuzzing import outcome
from support.hostile import BAD
from support.synthetic import arx_runs

from skhoid import RecursiveARX, RecursiveARXCV

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
