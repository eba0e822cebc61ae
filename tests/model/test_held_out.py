"""Fits without some of the rows."""

from dataclasses import replace

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.arx.base import ESTIMATE
from skhoid.model.extend import refitted, shared_derivatives
from skhoid.model.fitting import Criterion, derivatives, minimise
from skhoid.model.model import Model


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


def test_rows_left_out_do_not_matter(fitted):
    model, criterion = fitted
    train = without_run(criterion, 1)
    found = refitted(model, criterion, train)
    criterion.record.y[:, 1] += 10.0
    try:
        again = refitted(model, Criterion(criterion.record, criterion.noise), train)
    finally:
        criterion.record.y[:, 1] -= 10.0
    np.testing.assert_allclose(again.theta, found.theta, rtol=1e-12)


def test_is_the_minimum_on_its_rows(fitted):
    model, criterion = fitted
    train = without_run(criterion, 0)
    found = refitted(model, criterion, train)
    inside = criterion.on(train)
    assert found.sse == pytest.approx(inside.sse(found.output))
    assert found.sse <= inside.sse(model.output)
    elsewhere = minimise(model.simulator, inside, 1.1 * model.theta, max_iter=40, tol=1e-7)
    assert found.sse <= elsewhere.sse * (1 + 1e-4)


def test_starts_from_the_parent_too(fitted):
    model, criterion = fitted
    train = without_run(criterion, 2)
    parent = {"K_e": 0.05, "tau_e": 0.2}
    alone = refitted(model, criterion, train)
    both = refitted(model, criterion, train, starts=[parent])
    assert both.sse <= alone.sse


def test_derivatives_that_folds_share_change_nothing(fitted):
    model, criterion = fitted
    rows = shared_derivatives(model, criterion)
    for run in range(3):
        train = without_run(criterion, run)
        alone, shared = (refitted(model, criterion, train, rows=r) for r in (None, rows))
        np.testing.assert_allclose(shared.theta, alone.theta, rtol=1e-7)
        assert shared.sse == pytest.approx(alone.sse, rel=1e-10)


def test_derivatives_by_some_parameters_are_those_of_all(fitted):
    model, criterion = fitted
    whole = derivatives(model.simulator, criterion, model.theta)
    some = derivatives(model.simulator, criterion, model.theta, [3, 1])
    np.testing.assert_array_equal(some, whole[[3, 1, -1]])


def test_initial_states_are_of_the_rows_fitted_and_share_no_derivatives(fitted):
    model, criterion = fitted
    simulator = model.simulator
    begun = simulator.on(replace(simulator.record, initial=ESTIMATE, _derived={}))
    assert shared_derivatives(Model(begun, model.fit), criterion) is None
