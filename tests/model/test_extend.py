"""Adding an effect to a model: what comes to nothing is not followed."""

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.model.fitting import Criterion, minimise

WORTH = 1e-3  # of the power of the output


def fitted_core(effects=None):
    X, y = make_tracking_runs(
        condition="C1", n_runs=5, remnant_intensity=0.1, random_state=0, effects=effects
    )
    estimator = OperatorRegressor()
    prepared = estimator.prepare(X, y)
    return estimator.first_fit(prepared), Criterion(prepared.record)


def test_a_fit_that_cannot_reach_what_is_asked_stays_where_it_is():
    parent, criterion = fitted_core()
    start = parent.theta * 1.02
    whole = minimise(parent.simulator, criterion, start)
    reached = minimise(parent.simulator, criterion, start, below=1.01 * parent.sse)
    asked_too_much = minimise(parent.simulator, criterion, start, below=0.5 * parent.sse)
    assert [fit.hopeless for fit in (whole, reached, asked_too_much)] == [False, False, True]
    assert reached.sse == whole.sse < asked_too_much.sse
