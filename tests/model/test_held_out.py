"""Fits without some of the rows."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.model.extend import refitted, shared_derivatives
from skhoid.model.fitting import Criterion


@pytest.fixture(scope="module")
def fitted():
    X, y = make_tracking_runs(n_runs=3, duration=20.48, remnant_intensity=0.1, random_state=4)
    prepared = OperatorRegressor().prepare(X, y)
    model = OperatorRegressor(effects="dead_zone").first_fit(prepared)
    criterion = Criterion(prepared.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    return model.refined(criterion), criterion


def without_run(criterion, run):
    train = np.ones_like(criterion.record.known)
    train[:, run] = False
    return train


def test_derivatives_that_folds_share_change_nothing(fitted):
    model, criterion = fitted
    rows = shared_derivatives(model, criterion)
    for run in range(3):
        train = without_run(criterion, run)
        alone, shared = (refitted(model, criterion, train, rows=r) for r in (None, rows))
        np.testing.assert_allclose(shared.theta, alone.theta, rtol=1e-7)
        assert shared.sse == pytest.approx(alone.sse, rel=1e-10)
