"""A search whose best candidate explains nothing of the held-out output says so."""

import warnings

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    EffectSearchCV,
    NothingExplainedWarning,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARXCV,
    VAFScorer,
)

SEARCHES = {
    "delay": DelaySearchCV(ARXRegressor(1, 1), nk=[1, 5, 9], criterion="vaf"),
    "orders": OrderSearchCV(ARXRegressor(nk=8), na=[1, 2], nb=[1]),
    "memory": RecursiveARXCV([64, np.inf], na=1, nb=1, init_window=5.0),
    "effects": EffectSearchCV(OperatorRegressor(), effects=["bias"], max_effects=0),
}


def recorded(output, seed):
    """Two runs of 20 s; output is a function of the input and of noise as smooth as it is."""
    rng = np.random.default_rng(seed)
    e, noise = (np.convolve(rng.standard_normal(1600), np.ones(8) / 8, "same") for _ in range(2))
    index = pd.MultiIndex.from_product([[0, 1], np.arange(800) * 0.025], names=["run", "time"])
    u = pd.Series(output(e, noise, np.arange(1600)), index=index, name="u")
    return pd.DataFrame({"e": e}, index=index), u


UNRELATED = {
    "noise": lambda e, noise, t: noise,
    "another sign in each run": lambda e, noise, t: np.where(t < 800, 1, -1) * np.roll(e, 5),
    "another delay in each run": lambda e, noise, t: np.where(t < 800, np.roll(e, 5), -noise),
}


@pytest.mark.parametrize(
    ("name", "world"),
    [(name, "another sign in each run") for name in SEARCHES]
    + [("delay", "noise"), ("orders", "another delay in each run")],
)
def test_an_output_that_has_nothing_to_do_with_the_input(name, world):
    X, y = recorded(UNRELATED[world], 3)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        search = SEARCHES[name].fit(X, y)
    told = [str(w.message) for w in said if w.category is NothingExplainedWarning]
    assert len(told) == (search.best_score_ <= 0)
    if told:
        assert f"{type(search).__name__}: the best candidate has a VAF of" in told[0]
        assert f"{search.best_score_:.1f} %" in told[0]
        assert "Check that the inputs are what the output answers to" in told[0]


def test_some_of_them_explain_nothing():
    X, y = recorded(UNRELATED["another sign in each run"], 4)
    with pytest.warns(NothingExplainedWarning):
        SEARCHES["delay"].fit(X, y)


@pytest.mark.parametrize("name", SEARCHES)
def test_a_search_that_finds_something_is_silent(name):
    X, y = recorded(lambda e, noise, t: np.roll(e, 8) + 0.2 * noise, 5)
    with warnings.catch_warnings():
        warnings.simplefilter("error", NothingExplainedWarning)
        assert SEARCHES[name].fit(X, y).best_score_ > 0


def test_about_the_mean_too():
    X, y = recorded(UNRELATED["another sign in each run"], 6)
    with pytest.warns(NothingExplainedWarning, match="DelaySearchCV"):
        DelaySearchCV(
            ARXRegressor(1, 1), nk=[5], criterion="vaf", scoring=VAFScorer(centered=True)
        ).fit(X, y)


def test_one_step_losses_are_no_vaf():
    X, y = recorded(UNRELATED["noise"], 7)
    with warnings.catch_warnings():
        warnings.simplefilter("error", NothingExplainedWarning)
        DelaySearchCV(ARXRegressor(1, 1), nk=[1, 5]).fit(X, y)
