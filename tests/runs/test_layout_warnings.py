"""Any uniform clock works, and who steers too slowly is asked; pooled subjects are said."""

import warnings

import numpy as np
import pandas as pd
import pytest
from support.synthetic import arx_runs, with_levels

from skhoid import (
    ARXRegressor,
    PooledRunsWarning,
    SlowClockWarning,
    sampling_time,
)


def furnace(X, y, dt=9.0):
    """Runs of a machine, of which no channel has a role."""
    late, output = slow(X.add_prefix("gas_"), y, dt)
    return late, output


def slow(X, y, dt):
    time = X.groupby("run").cumcount().to_numpy() * dt
    return with_levels(X, time=time), y.array


def test_a_machine_may_tick_every_nine_seconds():
    X, y = arx_runs(3, 200)
    late = furnace(X, y)
    assert sampling_time(late[0]) == 9.0
    plain = ARXRegressor(2, 2, 3, inputs=["e"]).fit(X, y)
    model = ARXRegressor(2, 2, 3, inputs=["gas_e"]).fit(*late)
    np.testing.assert_array_equal(model.coef_, plain.coef_)
    np.testing.assert_array_equal(model.predict(late[0]), plain.predict(X))


def test_a_person_on_a_slow_clock_is_asked():
    X, y = arx_runs(2, 100)
    X = X.assign(f_t=1.0)
    with pytest.warns(SlowClockWarning, match=r"advances by 10 a row.*milliseconds.*dt=10"):
        assert sampling_time(slow(X, y, 10.0)[0]) == 10.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sampling_time(slow(X, y, 10.0)[0], dt=10.0) == 10.0


@pytest.mark.parametrize("level", ["subject", "condition"])
def test_pooled_runs_are_said(level):
    model = ARXRegressor(2, 2, 3)
    X, y = arx_runs(2, 300)
    people = {"A": X, "B": X, "C": X, "D": X}
    both = pd.concat(people, names=[level])
    output = pd.concat(dict.fromkeys(people, y), names=[level])
    what = rf'4 {level}s are fitted as those of one: A, B, C, ...*groupby\(level="{level}"\)'
    with pytest.warns(PooledRunsWarning, match=what):
        model.fit(both, output)
    with warnings.catch_warnings():
        warnings.simplefilter("error", PooledRunsWarning)
        alone = both.loc[["A"]]
        model.fit(alone, output.loc[alone.index])
