"""``RunInTrimmer``: what it marks, and what a model starts from."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.pipeline import make_pipeline
from support import naive
from support.synthetic import DT, arx_runs, signals

from skhoid import ARXRegressor, Decimator, OrderSearchCV, RunInTrimmer


@settings(max_examples=10, deadline=None)
@given(
    lengths=st.lists(st.integers(5, 30), min_size=1, max_size=4),
    samples=st.integers(0, 4),
    keep=st.booleans(),
)
def test_run_in_is_marked_run_by_run(lengths, samples, keep):
    X = signals(lengths)
    seconds = samples * DT
    step = RunInTrimmer(measurement_time=max(seconds, DT)) if keep else RunInTrimmer(seconds)
    marked = step.fit_transform(X).index.get_level_values("run-in").to_numpy(dtype=bool)
    expected = [
        row >= n - max(samples, 1) if keep else row >= samples for n in lengths for row in range(n)
    ]
    np.testing.assert_array_equal(~marked, expected)


def test_the_simulation_restarts_after_the_run_in_with_zero_output_and_real_past_inputs():
    X, y = arx_runs(2, 120, seed=5)
    pipe = make_pipeline(RunInTrimmer(0.5), ARXRegressor(2, 2, 3)).fit(X, y)
    model = pipe[-1]
    stretches = [(0, 50), (50, 120), (120, 170), (170, 240)]
    e = X[["e"]].to_numpy()
    twin = naive.free_run(e, stretches, model.a_, [model.b_], (3,), past=[0, 0, 120, 120])
    np.testing.assert_allclose(pipe.predict(X), twin, rtol=1e-10, atol=1e-12)
    # First kept row: no output before it, but the inputs 3 and 4 samples before it.
    expected = model.b_ @ e[[47, 46], 0]
    assert pipe.predict(X)[50] == pytest.approx(expected, rel=1e-12)
    assert pipe.predict(X)[120] == 0.0
    # The fit uses rows of the window whose lags lie in the window.
    phi, output, rows, _ = naive.regressor_rows(y.to_numpy(), e, stretches[1::2], 2, (2,), (3,))
    assert model.n_rows_used_ == len(rows)
    np.testing.assert_allclose(model.coef_, np.linalg.lstsq(phi, output, rcond=None)[0], rtol=1e-9)


def test_order_search_trims_before_it_decimates():
    X, y = arx_runs(smooth=1)
    pipe = make_pipeline(RunInTrimmer(0.3), ARXRegressor(2, 2, 1))
    best = OrderSearchCV(pipe, na=[2], nb=[2], factor=[2]).fit(X, y).best_estimator_
    expected = make_pipeline(RunInTrimmer(0.3), Decimator(2), ARXRegressor(2, 2, 1)).fit(X, y)
    np.testing.assert_allclose(best[-1].coef_, expected[-1].coef_, rtol=1e-9)
