"""RecursiveARX: free runs and predictions along the path of the parameters."""

import numpy as np
import pytest
from support import naive
from support.recursion_twin import (
    ORDERS,
    changing_runs,
    recursive,
    sample_numbers,
    shifted,
    stretches_of,
)
from support.synthetic import DT, arx_runs

from skhoid import (
    RunTimeWarning,
)

NK = ORDERS["nk"]


def split(theta):
    return theta[:2], [theta[2:4]], 0.0


def rows_of_path(model, X):
    """Parameters of every row: those of its time, and beyond the path its nearest end."""
    numbers = np.rint(model.time_path_ / DT).astype(int)
    at = np.searchsorted(numbers, np.clip(sample_numbers(X), numbers[0], numbers[-1]))
    return model.coef_path_[at]


def twin_of_predict(model, X):
    path = rows_of_path(model, X)
    return naive.free_run_along(X[["e"]].to_numpy(), stretches_of(X), split, path, (NK,))


@pytest.fixture(scope="module")
def fitted():
    X, y = changing_runs(400, 2)
    part = X.index.get_level_values("time") > 0.5 - DT / 2
    return recursive(memory_horizon=30).fit(X[part], y[part]), X, y


def test_predict_follows_the_path(fitted):
    model, X, _ = fitted
    assert model.time_path_[0] == pytest.approx(0.5)
    longer, _ = arx_runs(lengths=[600, 100], seed=9)
    for rows in (X, longer, shifted(X, -2.0), shifted(X, 2.0)):
        found = model.predict(rows[X.columns])
        np.testing.assert_allclose(found, twin_of_predict(model, rows), rtol=1e-10, atol=1e-12)
    far = shifted(X, 100.0)
    with pytest.warns(RunTimeWarning, match=r"run 1, t = 100 s .* 0.5 to 3.99 s"):
        found = model.predict(far[X.columns])
    np.testing.assert_allclose(found, twin_of_predict(model, far), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("horizon", [1, 5])
@pytest.mark.parametrize("parameters", ["path", "last"])
def test_predict_ahead(horizon, parameters):
    X, y = changing_runs(200, 2)
    model = recursive(memory_horizon=30, parameters=parameters).fit(X, y)
    path = np.tile(model.coef_, (400, 1))
    if parameters == "path":  # as it was known ``horizon`` samples before
        known = np.concatenate([np.tile(model.initial_coef_, (horizon, 1)), model.coef_path_])
        path = np.tile(known[:200], (2, 1))
    holed = y.copy()
    holed.iloc[[50, 51, 260]] = np.nan
    for output in (y, holed):
        twin = naive.predict_ahead_along(
            output.to_numpy(), X.to_numpy(), stretches_of(X), split, path, (NK,), horizon
        )
        found = model.predict_ahead(X, output, horizon=horizon)
        np.testing.assert_allclose(found, twin, rtol=1e-10, atol=1e-12)


# The grid that marks leave
