"""Very many runs: a few at a time, and minima that some of them show first."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Effects
from skhoid.model import fitting as module
from skhoid.model.cores import OperatorCore
from skhoid.model.fitting import (
    Criterion,
    find_residual,
    minimise,
    take_some_runs,
    whitened_derivatives,
)
from skhoid.model.simulator import Simulator
from skhoid.model.uncertainty import estimate_covariance

THETA = np.array([0.09, 0.036, 11.0, 0.35, 0.28])


@pytest.fixture(scope="module")
def data():
    return make_tracking_runs(
        condition="C1", n_runs=7, duration=10.24, remnant_intensity=0.1, random_state=0
    )


@pytest.fixture
def record(data):
    return OperatorRegressor().prepare(*data).record


@pytest.fixture
def few_at_a_time(monkeypatch):
    monkeypatch.setattr("skhoid.effects.record.LARGE", 5000)
    monkeypatch.setattr("skhoid.effects.record.CACHED", 3100)  # three runs


def effects(*ids):
    return Effects.of(list(ids))


@pytest.mark.parametrize("added", [("bias", "integral")])
def test_a_few_runs_at_a_time_make_the_same_output_and_derivatives(
    record, added, monkeypatch, request
):
    steps = (
        [(name, effect.variants(record)[0]) for name, effect in effects(*added)] if added else []
    )
    whole = Simulator(OperatorCore(None), Effects(steps), record)
    theta = np.clip(np.r_[THETA, 0.02 * np.ones(len(whole.names) - 5)], whole.low, whole.high)
    criterion = Criterion(record)
    criterion.set_noise(criterion.remnant_model(whole.run(theta)))
    expected = whole.run(theta), whitened_derivatives(whole, criterion, theta)
    fit = minimise(whole, criterion, theta, max_iter=2)
    covariance = estimate_covariance(whole, criterion, fit)
    request.getfixturevalue("few_at_a_time")
    apart = Simulator(OperatorCore(None), Effects(steps), record)
    assert [runs.stop - runs.start for runs, _ in apart.parts()] == [3, 3, 1]
    rounding = {"rtol": 1e-9, "atol": 1e-12}  # of the starts of the integral, solved for
    np.testing.assert_allclose(apart.run(theta), expected[0], **rounding)
    np.testing.assert_allclose(
        find_residual(apart, criterion, theta), criterion.residual(expected[0]), **rounding
    )
    np.testing.assert_allclose(
        whitened_derivatives(apart, criterion, theta), expected[1], rtol=1e-6, atol=1e-8
    )
    again = minimise(apart, criterion, theta, max_iter=2)
    np.testing.assert_allclose(again.sse, fit.sse, rtol=1e-9)
    np.testing.assert_allclose(estimate_covariance(apart, criterion, fit), covariance, rtol=1e-6)
    for simulator in (whole, apart):
        simulator.run(theta)
    np.testing.assert_allclose(
        apart.run_with_change(2, 9.0), whole.run_with_change(2, 9.0), **rounding
    )
    np.testing.assert_array_equal(
        apart.last_state.command.position, whole.last_state.command.position
    )


def simulated(monkeypatch, data, most):
    """A fit, and the samples that were simulated of all runs together and of some."""
    n_runs = len(data[0].groupby(level="run"))
    counted = {True: 0, False: 0}
    plain = OperatorCore.response

    def response(self, command, *args):
        n, runs = command.position.shape
        counted[runs == n_runs] += n * runs
        return plain(self, command, *args)

    monkeypatch.setattr(module, "MOST_ROWS", most)
    monkeypatch.setattr(OperatorCore, "response", response)
    fitted = OperatorRegressor(settling=1.0).fit(*data)
    monkeypatch.undo()
    return fitted, counted


def test_all_runs_decide_where_the_minimum_is_and_are_simulated_less(monkeypatch, data):
    of_all, before = simulated(monkeypatch, data, 10**9)
    by_some, after = simulated(monkeypatch, data, 2000)
    assert after[True] < 0.45 * before[True]
    sd = of_all.parameters_["sd"]
    away = (by_some.parameters_["value"] - of_all.parameters_["value"]).abs()
    assert (away < 0.1 * sd).all()
    np.testing.assert_allclose(by_some.loglik_, of_all.loglik_, atol=0.05)
    np.testing.assert_allclose(by_some.vaf_, of_all.vaf_, atol=0.01)
    assert by_some.n_rows_used_ == of_all.n_rows_used_
    some = OperatorRegressor(settling=1.0).prepare(*data).record
    monkeypatch.setattr(module, "MOST_ROWS", 2000)
    assert take_some_runs(some).n_runs == 2
