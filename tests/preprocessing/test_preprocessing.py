"""Decimator, DelayShift and RunInTrimmer together, on the runs of the thesis."""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from support import closed_loop as cl
from support.synthetic import DT, as_table, signals

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    OrderSearchCV,
    vaf_score,
)


@pytest.fixture(scope="module")
def monte_carlo_recording():
    return as_table(cl.simulate("C1"))


def test_where_the_free_run_starts():
    """From rest, 99.9553 % from the start of the window, 98.9605 % from its middle (Chapter 5)."""
    X, y = as_table(cl.simulate("C1", periods=10, interpolated_delay=True))
    X, y = X.iloc[-8192:], y.iloc[-8192:]
    from_rest = ARXRegressor(nk=28, initial="rest")
    model = clone(from_rest).fit(X[:4096], y[:4096])
    from_start = vaf_score(y[4096:], model.predict(X)[4096:])
    from_middle = vaf_score(y[4096:], model.predict(X[4096:]))
    assert from_start == pytest.approx(99.95525751609223, abs=1e-9)  # arx2228.C1.vaf_remnant_free
    assert from_middle == pytest.approx(98.9605, abs=5e-5)
    search = OrderSearchCV(from_rest, na=[2], nb=[2]).fit(X, y)
    assert search.best_score_ == pytest.approx(from_start, abs=1e-9)
    estimated = ARXRegressor(nk=28).fit(X[:4096], y[:4096])
    assert vaf_score(y[4096:], estimated.predict(X[4096:])) > 99.7
    assert estimated.score(X[4096:], y[4096:]) > 99.9


def test_remnant_free_delay_after_decimation(monte_carlo_recording):
    """tau_e and the ZOH sample on each grid: 29 at 100 Hz, 15 at 50 Hz (nk_star.remnant_free)."""
    X, y = (table.iloc[-8192:] for table in monte_carlo_recording)
    thinned = make_pipeline(Decimator(2, method="downsample"), ARXRegressor())
    assert DelaySearchCV(thinned, nk=range(5, 25)).fit(X, y).best_nk_ == 15


def test_phase_of_times_on_half_samples_does_not_depend_on_the_slice():
    X = signals([60], 0)
    time = X.index.get_level_values("time") + DT / 2
    X.index = pd.MultiIndex.from_arrays(
        [X.index.get_level_values("run"), time], names=["run", "time"]
    )
    whole = Decimator(3).fit_transform(X).index.get_level_values(-1).to_numpy()
    for start in range(7):
        part = Decimator(3).fit_transform(X.iloc[start:]).index.get_level_values(-1).to_numpy()
        np.testing.assert_array_equal(part, whole[start:])
