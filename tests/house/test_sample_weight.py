"""``sample_weight``: weighted least squares by runs, 0 as "not measured", routing, and errors."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut, cross_validate
from sklearn.pipeline import make_pipeline

from skhoid import (
    ARXRegressor,
    Decimator,
    DelayShift,
    OperatorRegressor,
    RecursiveARX,
    make_tracking_runs,
    run_labels,
    select_runs,
)

X, Y = make_tracking_runs(
    "C1", 3, duration=20.48, sampling_rate=50, remnant_intensity=0.1, random_state=0
)
RUN = np.asarray(run_labels(X))
TIMES = {0: 2, 1: 3, 2: 1}
OF_RUNS = np.array([float(TIMES[run]) for run in RUN])
ARX = ARXRegressor(nk=14)
RLS = RecursiveARX(nk=14, memory_horizon=200, init_window=5.0)
HOLES = np.ones(len(Y))
HOLES[[5, 77, *range(200, 230), 900, 1400]] = 0.0


def repeated():
    """Each run as often as its weight says."""
    copies = [run for run, times in TIMES.items() for _ in range(times)]
    renamed = []
    for number, run in enumerate(copies):
        of_run = run == RUN
        renamed.append([t[of_run].rename(index={run: number}, level="run") for t in (X, Y)])
    return tuple(pd.concat(parts) for parts in zip(*renamed, strict=True))


@pytest.mark.parametrize(
    "model",
    [
        ARX,
        ARX.__class__(na=1, nb=3, nk=14, fit_intercept=True, covariance="hac"),
        RLS,
        RecursiveARX(nk=14, forgetting="variable", init_window=5.0),
        RecursiveARX(nk=14, memory_horizon=(100, 100, 300, 300), init="zeros"),
        RecursiveARX(nk=14, memory_time=4.0, smooth=True, init_window=5.0),
        make_pipeline(Decimator(2), ARXRegressor(nk=7)),
    ],
)
def test_whole_numbers_of_whole_runs_are_runs_that_are_there_so_often(model):
    name = "" if isinstance(model, (ARXRegressor, RecursiveARX)) else "arxregressor__"
    weighted = sklearn.clone(model).fit(X, Y, **{f"{name}sample_weight": OF_RUNS})
    twin = sklearn.clone(model).fit(*repeated())
    one, other = (m[-1] if name else m for m in (weighted, twin))
    np.testing.assert_allclose(one.coef_, other.coef_, rtol=1e-9, atol=1e-12)
    if not name:
        assert weighted.score(X, Y, OF_RUNS) == pytest.approx(twin.score(*repeated()))
    if hasattr(one, "coef_path_"):
        np.testing.assert_allclose(one.coef_path_, other.coef_path_, rtol=1e-8, atol=1e-10)


def test_an_operator_weighs_its_runs():
    weighted = OperatorRegressor().fit(X, Y, OF_RUNS).parameters_
    twin, plain = OperatorRegressor().fit(*repeated()).parameters_, OperatorRegressor().fit(X, Y)
    apart = (weighted["value"] - twin["value"]).abs()
    # The prior of people's numbers weighs less beside twice the rows.
    assert (apart < 0.15 * weighted["sd"]).all()
    assert (apart < (weighted["value"] - plain.parameters_["value"]).abs()).all()


@pytest.mark.parametrize(
    "model", [ARX, RLS, OperatorRegressor(), ARXRegressor(1, 1, 14).with_effect("bias")]
)
@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_zero_is_not_measured(model):
    weighted = sklearn.clone(model).fit(X, Y, HOLES)
    missing = sklearn.clone(model).fit(X, Y.where(HOLES > 0))
    pd.testing.assert_frame_equal(weighted.parameters_, missing.parameters_)
    np.testing.assert_array_equal(weighted.predict(X), missing.predict(X))
    assert weighted.score(X, Y, HOLES) == missing.score(X, Y.where(HOLES > 0))


def test_no_warning_tells_of_rows_that_the_weights_leave_out():
    ARX.fit(X, Y, HOLES)
    RLS.fit(X, Y, np.where(RUN == 1, 0.0, HOLES))


def test_only_ratios_count():
    one = sklearn.clone(ARX).fit(X, Y, OF_RUNS).parameters_
    other = sklearn.clone(ARX).fit(X, Y, 7.0 * OF_RUNS).parameters_
    pd.testing.assert_frame_equal(one, other, rtol=1e-6)
    pd.testing.assert_frame_equal(
        sklearn.clone(ARX).fit(X, Y, 3).parameters_, sklearn.clone(ARX).fit(X, Y).parameters_
    )


def test_the_twin_is_weighted_least_squares():
    """Without output lags the model is a linear regression of each row, with any weights."""
    rng = np.random.default_rng(1)
    e = rng.standard_normal(300)
    y = 2.0 * e + 0.5 * np.r_[0.0, e[:-1]] + rng.standard_normal(300)
    w = rng.uniform(0.1, 5.0, 300)
    ours = ARXRegressor(na=0, nb=2).fit(e[:, None], y, w)
    table = np.c_[e[1:], e[:-1]]
    twin = LinearRegression(fit_intercept=False).fit(table, y[1:], w[1:])
    np.testing.assert_allclose(ours.coef_, twin.coef_)
    left = y[1:] - twin.predict(table)
    sigma2 = (w[1:] * left**2).sum() / (299 - 2)
    covariance = sigma2 * np.linalg.inv(table.T @ (table * w[1:, None]))
    np.testing.assert_allclose(ours.covariance_, covariance)
    score = 100 * (1 - (w * (y - ours.predict(e[:, None])) ** 2).sum() / (w * y**2).sum())
    assert ours.score(e[:, None], y, w) == pytest.approx(score)


def test_standard_errors_hold_where_weights_are_inverse_variances():
    """95 % intervals in 120 records of which one half has three times the noise."""
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(120):
        e = rng.standard_normal(400)
        scale = np.where(np.arange(400) < 200, 1.0, 3.0)
        y = np.zeros(400)
        noise = 0.3 * scale * rng.standard_normal(400)
        for t in range(1, 400):
            y[t] = 0.8 * y[t - 1] + e[t] + noise[t]
        table = ARXRegressor(na=1, nb=1).fit(e[:, None], y, scale**-2).parameters_
        inside.append((table["low"] <= [-0.8, 1.0]) & (table["high"] >= [-0.8, 1.0]))
    assert 0.90 < np.mean(inside) < 0.985  # 240 intervals: 0.95 within 2.9 standard errors


@pytest.mark.parametrize(
    ("options", "pieces"),
    [
        ({"memory_horizon": 200}, 64),
        ({"init": "zeros", "forgetting": 0.99}, 64),
        ({"forgetting": "variable"}, 1),
        ({"forgetting": "variable"}, 64),
        ({"memory_horizon": (100, 100, 300, 300), "reset_times": [12.0]}, 64),
        ({"forgetting": lambda t: np.where(t < 12.0, 0.99, 0.95), "fit_intercept": True}, 64),
    ],
)
def test_a_stream_with_weights_is_the_fit_bit_for_bit(options, pieces):
    first = RUN == 0
    x, y = X[first].to_numpy(), Y[first].to_numpy()
    w = np.random.default_rng(3).uniform(0.2, 3.0, len(y))
    w[[3, *range(250, 260), 400]] = 0.0
    if pieces == 1:  # it takes a millisecond each
        x, y, w = x[:260], y[:260], w[:260]
    model = RecursiveARX(nk=14, init_window=4.0, dt=0.02, **options)
    whole = sklearn.clone(model).fit(x, y, w)
    stream = sklearn.clone(model)
    for begin in range(0, len(y), pieces):
        rows = slice(begin, begin + pieces)
        stream.partial_fit(x[rows], y[rows], w[rows])
    np.testing.assert_array_equal(stream.coef_, whole.coef_)
    np.testing.assert_array_equal(stream.covariance_, whole.covariance_)
    assert stream.n_updates_ == whole.n_updates_


def test_a_stream_may_have_weights_now_and_then():
    first = RUN == 0
    x, y, ones = X[first].to_numpy(), Y[first].to_numpy(), np.ones(first.sum())
    model = RecursiveARX(nk=14, init_window=100, memory_horizon=200)
    plain, mixed = sklearn.clone(model), sklearn.clone(model)
    for begin in range(0, len(y), 50):
        rows = slice(begin, begin + 50)
        plain.partial_fit(x[rows], y[rows])
        mixed.partial_fit(x[rows], y[rows], *([ones[rows]] if begin % 100 else []))
    np.testing.assert_array_equal(plain.coef_, mixed.coef_)


@pytest.mark.parametrize("model", [ARX, RLS, OperatorRegressor()])
@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (-1.0, r"sample_weight is -1 in row 0"),
        (np.r_[np.ones(len(Y) - 1), np.nan], r"sample_weight is nan in row 3071"),
        (np.full(len(Y), np.inf), "sample_weight is inf in row 0"),
        (np.zeros(len(Y)), "Sample weights are zero in all rows in which y was measured"),
        (np.ones(7), r"sample_weight.shape == \(7,\), expected \(3072,\)"),
        (np.ones((len(Y), 2)), "must be 1D array or scalar"),
        (pd.Series(1.0, Y.index[::-1]), "sample_weight"),
    ],
)
def test_what_weights_may_not_be(model, weights, message):
    with pytest.raises(ValueError, match=message):
        model.fit(X, Y, sample_weight=weights)


@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_weights_of_measured_rows_alone_are_refused_where_all_are_zero_there():
    with pytest.raises(ValueError, match="zero in all rows in which y was measured"):
        ARX.fit(X, Y.where(RUN == 1), (RUN != 1).astype(float))


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_instruments_take_no_weights_but_leave_rows_out():
    e = X["e"].to_numpy()
    table = X.assign(f_t=np.sin(np.arange(len(e)) / 7) + np.sin(np.arange(len(e)) / 3))
    model = ARXRegressor(na=1, nb=1, nk=14, method="iv", inputs=["e"])
    with pytest.raises(ValueError, match=r"method='iv' cannot weigh rows"):
        model.fit(table, Y, OF_RUNS)
    kept = sklearn.clone(model).fit(table, Y, np.where(RUN == 2, 0.0, 2.0))
    twin = sklearn.clone(model).fit(*select_runs(table, Y, runs=[0, 1]))
    np.testing.assert_allclose(kept.coef_, twin.coef_)


def test_metadata_is_routed_through_a_pipeline_and_a_search():
    with sklearn.config_context(enable_metadata_routing=True):
        model = ARXRegressor().set_fit_request(sample_weight=True)
        model.set_score_request(sample_weight=True)
        pipe = make_pipeline(DelayShift(0.28), model)
        search = GridSearchCV(pipe, {"arxregressor__na": [1, 2]}, cv=LeaveOneGroupOut())
        search.fit(X, Y, sample_weight=OF_RUNS, groups=RUN)
        direct = make_pipeline(DelayShift(0.28), model.set_params(na=search.best_params_[
            "arxregressor__na"])).fit(X, Y, sample_weight=OF_RUNS)  # fmt: skip
        np.testing.assert_array_equal(search.best_estimator_[-1].coef_, direct[-1].coef_)
        assert search.score(X, Y, sample_weight=OF_RUNS) == direct.score(
            X, Y, sample_weight=OF_RUNS
        )
        stream = RecursiveARX().set_partial_fit_request(sample_weight=True)
        assert "sample_weight" in stream.get_metadata_routing().partial_fit.requests
        found = cross_validate(
            ARXRegressor(nk=14).set_fit_request(sample_weight=True).set_score_request(
                sample_weight=False
            ),
            X, Y, cv=LeaveOneGroupOut(), params={"sample_weight": OF_RUNS, "groups": RUN},
        )  # fmt: skip
        assert (found["test_score"] > 50).all()


def test_a_search_slices_weights_by_fold_without_routing():
    search = GridSearchCV(ARX, {"na": [1, 2]}, cv=LeaveOneGroupOut())
    search.fit(X, Y, groups=RUN, sample_weight=OF_RUNS)
    twin = sklearn.clone(ARX).set_params(**search.best_params_).fit(X, Y, OF_RUNS)
    np.testing.assert_array_equal(search.best_estimator_.coef_, twin.coef_)
