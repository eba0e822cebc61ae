"""Least delays of what the output moves: without them identify finds the element's inverse."""

import numpy as np
import pandas as pd
import pytest
from support.hidden_disturbance import tracked

from skhoid import ARXRegressor, DelaySearchCV
from skhoid.arx.least_delay import find_least_delay
from skhoid.diagnosis.identification import ModelChoice, identify

DT = 1 / 60


@pytest.fixture(scope="module")
def runs():
    """Much remnant, and x(k) answers u(k) already, as in some laboratories."""
    record = tracked("1/(s(s+1))", direct=True, remnant=0.6, seed=1, runs=3)
    n, m = record.y.shape
    index = pd.MultiIndex.from_arrays(
        [np.repeat(np.arange(m), n), np.tile(np.round(np.arange(n) * DT, 9), m)],
        names=["run", "time"],
    )
    X = pd.DataFrame({k: v.T.ravel() for k, v in record.channels.items()}, index=index)
    return X, pd.Series(record.y.T.ravel(), index=index, name="u")


def found(runs, inputs, **options):
    choice = ModelChoice(inputs=inputs, na=2, nb=3, **options)
    return identify(*runs, choice, longest_delay=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("inputs", [["e", "x"], ["e", "f_t"]])
def test_the_inverse_of_the_element_is_not_tried(runs, inputs):
    model = ARXRegressor(2, 3, inputs=inputs, fit_intercept=True)
    leaks = DelaySearchCV(model, nk=range(19), criterion="vaf").fit(*runs)
    assert leaks.best_delay_ < 0.1
    b = leaks.best_estimator_.b_[1 if inputs[1] == "x" else 0]
    assert b[1] == pytest.approx(-2 * b[0], rel=0.1)  # a second difference
    kept = found(runs, inputs)
    assert kept.least_delay.domain == "human"
    assert min(kept.best.model.orders_.nk) >= 6


def test_a_delay_at_the_limit_is_said(runs):
    limited = found(runs, ["e", "x"], least_delay=0.28)
    assert "at its lower bound" in " ".join(map(str, limited.notes))
    given = identify(*runs, ModelChoice(inputs=["e", "x"], na=2, nb=2, nk=1))
    assert "shorter than the least delay, 6 (0.1 s)" in str(given.notes[0])
    with pytest.raises(ValueError, match=r"longest delay to try, 0\.05 s, is below the least"):
        identify(*runs, ModelChoice(inputs=["e", "x"]), longest_delay=0.05)


def least(inputs, columns=None, **options):
    return find_least_delay(inputs, columns or inputs, DT, **options)


def test_who_has_which_least_delay():
    assert least(["f_t"]).samples == 0
    assert least(["f_t"], ["e", "f_t"]).samples == 0
    assert least(["e"]).samples == 1
    assert least(["e"], ["e", "x"]).samples == 6
    assert least(["e", "x"]).samples == 6
    assert least(["err", "pos"], roles={"err": "e", "pos": "x"}).samples == 6
    assert least(["e", "x"], domain="machine").samples == 1
    assert least(["e", "x"], seconds=0.15).samples == 9
    assert least(["e", "x"], seconds=0.0).samples == 0
    assert not least(["e"], ["e", "x"]).closed
    with pytest.raises(ValueError, match="domain must be"):
        least(["e"], domain="robot")
    with pytest.raises(ValueError, match="least_delay must be"):
        least(["e"], seconds=-1.0)
