"""Advice fits the model that is at hand."""

import re

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LinearRegression
from support.hidden_effects import simulate_runs

from skhoid import ARXRegressor, DelaySearchCV, OperatorRegressor, compare
from skhoid.diagnosis.findings import NextSteps
from skhoid.recordings import check_channels

LATER, EARLIER = 0.08, -0.04
ESTIMATED = "The model estimates its delay: fit it on runs of the same condition, or search what"


@pytest.fixture(scope="module")
def runs():
    X, y, _ = simulate_runs("C1", 2, seed=0, sampling_rate=25.0, oversampling=4)
    return X, y


@pytest.mark.parametrize(
    ("model", "seconds", "step"),
    [
        (ARXRegressor(nk=8), LATER, r"Search the delay again \(DelaySearchCV\)"),
        (DelaySearchCV(ARXRegressor(), nk=[7, 8]), EARLIER, r"\(DelaySearchCV\)"),
        (OperatorRegressor(delay=0.2), LATER, "was given as 0.2 s: delay=None, or .*wrong_delay"),
        (OperatorRegressor(delay=0.2), EARLIER, "was given as 0.2 s: delay=None, or .*wrong_delay"),
        (OperatorRegressor(), LATER, ESTIMATED),
        (OperatorRegressor(delay=0.2, effects="wrong_delay"), LATER, ESTIMATED),
        (LinearRegression(), LATER, "0.08 s more"),
        (LinearRegression(), EARLIER, "0.04 s less"),
    ],
    ids=lambda value: repr(value) if hasattr(value, "fit") else "",
)
def test_delay(runs, model, seconds, step):
    X, y = runs
    with pytest.MonkeyPatch.context() as patch:
        # An operator's fit is slow, and its parameters say all that is asked here.
        patch.setattr(OperatorRegressor, "fit", lambda self, X, y: self)
        then = NextSteps(model.fit(X, y))
    assert re.search(step, then.delay(seconds))


def test_a_wrong_delay_of_an_operator_is_told(runs):
    X, y = runs
    found = compare(OperatorRegressor(delay=0.2).fit(X, y), X, y).findings
    (delay,) = [finding for finding in found if finding.name == "delay"]
    assert "off by 2 samples" in delay.evidence
    assert delay.next_step.startswith("Free the delay, which was given as 0.2 s")


def test_one_is_not_many(runs):
    X, y = runs
    model = ARXRegressor(nk=8).fit(X, y)
    y = y.copy()
    y.iloc[200] = np.nan
    X = pd.DataFrame({"x": X["e"].to_numpy()})
    X.iloc[200] = np.nan
    notes = [str(note) for note in compare(model, runs[0], y).notes]
    assert "1 row in which the output is missing is left out" in notes
    (missing,) = check_channels(X, dt=0.04)
    assert missing.title == "x has 1 missing sample"
    assert "rows is NaN or infinite, the longest stretch 1 row (0.04 s)" in missing.evidence
