"""The data convention: what runs, time and marks promise.

The first half holds the run-level twins of the scikit-learn checks that are waived because row
order is the data.
"""

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.model_selection import LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from support import naive
from support.synthetic import DT, arx_runs, with_levels

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    DelayShift,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    RunInTrimmer,
    RunTimeWarning,
    run_labels,
    sampling_time,
    select_runs,
)

ESTIMATORS = {
    "miso": ARXRegressor(1, [2, 1], [3, 0], inputs=["e", "x"], covariance="hac"),
    "delay-vaf": DelaySearchCV(ARXRegressor(), nk=[1, 3], criterion="vaf"),
    "order": OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[1, 2], nk=[3]),
    "pipeline": make_pipeline(
        RunInTrimmer(0.2), DelayShift(0.03), Decimator(3), ARXRegressor(2, 1)
    ),
    "aggregate": make_pipeline(Decimator(2, method="aggregate"), ARXRegressor(2, 2, 1)),
    "recursive": RecursiveARX(2, 2, 3, memory_horizon=30, init_window=0.6),
    "recursive-cv": RecursiveARXCV([20, 50, np.inf], 2, 2, 3),
}
each_estimator = pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS.keys())


def model_of(fitted):
    fitted = getattr(fitted, "best_estimator_", fitted)
    return fitted[-1] if hasattr(fitted, "steps") else fitted


def take_runs(table, order):
    return pd.concat([table.loc[[run]] for run in order])


def find_rows(X, order):
    runs = X.index.get_level_values("run").to_numpy()
    return np.concatenate([np.flatnonzero(runs == run) for run in order])


# Twins of the waived checks


@each_estimator
def test_permuting_runs_permutes_the_predictions(estimator):
    """The twin of check_methods_sample_order_invariance."""
    order = [3, 1, 2]
    X, y = arx_runs(lengths=[110, 140, 120], seed=1, smooth=1)
    one = clone(estimator).fit(X, y)
    other = clone(estimator).fit(take_runs(X, order), take_runs(y, order))
    np.testing.assert_allclose(model_of(one).coef_, model_of(other).coef_, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(
        model_of(one).covariance_, model_of(other).covariance_, rtol=1e-7, atol=1e-14
    )
    np.testing.assert_array_equal(
        one.predict(take_runs(X, order)), one.predict(X)[find_rows(X, order)]
    )


@each_estimator
def test_predicting_a_subset_of_runs(estimator):
    """The twin of check_methods_subset_invariance."""
    X, y = arx_runs(4, 110, seed=2)
    fitted = clone(estimator).fit(X, y)
    order = [2, 4]
    np.testing.assert_array_equal(
        fitted.predict(take_runs(X, order)), fitted.predict(X)[find_rows(X, order)]
    )
    scores = [fitted.score(X.loc[[run]], y.loc[[run]]) for run in order]
    assert min(scores) - 1e-9 <= fitted.score(take_runs(X, order), take_runs(y, order))


@each_estimator
def test_every_row_gets_a_prediction(estimator):
    X, y = arx_runs(lengths=[101, 97, 130])
    fitted = clone(estimator).fit(X, y)
    trimmed = any(isinstance(s, RunInTrimmer) for _, s in getattr(estimator, "steps", []))
    for rows in (slice(None), slice(0, 101), slice(7, 99), slice(140, 180 if trimmed else 141)):
        assert fitted.predict(X.iloc[rows]).shape == (len(X.iloc[rows]),)
        assert np.isfinite(fitted.predict(X.iloc[rows])).all()


def test_transformers_keep_every_row_and_the_index():
    X, _ = arx_runs(lengths=[101, 97])
    for step in (Decimator(3), DelayShift(0.05), RunInTrimmer(0.3), Decimator(), RunInTrimmer()):
        out = step.fit_transform(X)
        marks = [name for name in out.index.names if name not in ("run", "time")]
        assert out.index.droplevel(marks).equals(X.index)
        assert list(out.columns) == ["e", "x"]


# Containers


def as_frame(X):
    """Run as a column, time not at all."""
    return X.reset_index("run").reset_index(drop=True)[["run", "e", "x"]]


def with_run_column(estimator, run):
    """The same estimator for tables with a run column and no time index."""
    estimator = clone(estimator)
    steps = [step for _, step in getattr(estimator, "steps", [("", estimator)])]
    for step in steps:
        target = getattr(step, "estimator", None) or step
        names = {"e": 1, "x": 2} if isinstance(run, int) else {"e": "e", "x": "x"}
        inputs = getattr(target, "inputs", None)
        if hasattr(target, "inputs"):
            target.set_params(inputs=[names[i] for i in (inputs or ["e"])])
        target.set_params(dt=DT, run=run)
    return estimator


CONTAINERS = {
    "miso": ARXRegressor(1, [2, 1], [3, 0], inputs=["e", "x"]),
    "delay": DelaySearchCV(ARXRegressor(), nk=range(6)),
    "order": OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[1, 2], nk=[3]),
    "pipeline": make_pipeline(RunInTrimmer(0.2), Decimator(2), DelayShift(0.03), ARXRegressor()),
    "recursive": make_pipeline(DelayShift(0.03), Decimator(2), RecursiveARX(memory_horizon=30)),
}


def assert_same_model(one, X_one, other, X_other):
    np.testing.assert_allclose(model_of(one).coef_, model_of(other).coef_, rtol=1e-12)
    assert model_of(one).dt_ == pytest.approx(model_of(other).dt_, rel=1e-12)
    np.testing.assert_allclose(one.predict(X_one), other.predict(X_other), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("estimator", CONTAINERS.values(), ids=CONTAINERS.keys())
def test_a_run_column_equals_a_run_index(estimator):
    X, y = arx_runs(lengths=[110, 120, 101])
    indexed = clone(estimator).fit(X, y)
    frame = as_frame(X)
    columned = with_run_column(estimator, "run").fit(frame, y.to_numpy())
    assert_same_model(indexed, X, columned, frame)
    named = frame.assign(run=frame["run"].map({1: "first", 2: "again", 3: "last"}))
    assert_same_model(indexed, X, with_run_column(estimator, "run").fit(named, y.to_numpy()), named)


@pytest.mark.parametrize("name", ["miso", "delay", "order", "pipeline"])
def test_numpy_equals_pandas(name):
    X, y = arx_runs(lengths=[110, 120, 101])
    indexed = clone(CONTAINERS[name]).fit(X, y)
    array = as_frame(X).to_numpy(dtype=float)
    positional = with_run_column(CONTAINERS[name], 0).fit(array, y.to_numpy())
    assert_same_model(indexed, X, positional, array)


def test_the_run_column_of_an_array_is_never_an_input():
    X, y = arx_runs()
    array = as_frame(X).to_numpy(dtype=float)
    pipe = make_pipeline(Decimator(2, dt=DT, run=0), ARXRegressor(1, 1, 1))
    assert pipe.fit(array, y.to_numpy())[-1].inputs_ == ["x1", "x2"]


def test_integer_column_names_are_names():
    X, y = arx_runs()
    frame = as_frame(X).set_axis([1, 2, 3], axis=1)
    model = ARXRegressor(1, 1, 3, run=1, dt=DT).fit(frame, y.to_numpy())
    expected = ARXRegressor(1, 1, 3, inputs=["e", "x"]).fit(X, y)
    np.testing.assert_allclose(model.coef_, expected.coef_, rtol=1e-12)


def test_a_bare_array_is_one_run_of_one_second_samples():
    X, y = arx_runs(1)
    model = ARXRegressor(2, 2, 3).fit(X.to_numpy(), y.to_numpy())
    expected = ARXRegressor(2, 2, 3, inputs=["e", "x"]).fit(X, y)
    np.testing.assert_array_equal(model.coef_, expected.coef_)
    assert model.dt_ == 1.0
    np.testing.assert_array_equal(model.predict(X.to_numpy()), expected.predict(X))


def test_a_time_index_alone_is_one_run():
    X, y = arx_runs(1)
    model = ARXRegressor(2, 2, 3).fit(X.droplevel("run"), y.droplevel("run"))
    assert model.dt_ == DT
    np.testing.assert_array_equal(model.coef_, ARXRegressor(2, 2, 3).fit(X, y).coef_)


def test_level_order_and_labels_mean_nothing():
    X, y = arx_runs()
    expected = ARXRegressor(2, 2, 3).fit(X, y).predict(X)
    names = with_levels(X, run=X.index.get_level_values("run").map({1: "b", 2: "a", 3: "c"}))
    for other in (X.swaplevel(), names):
        found = ARXRegressor(2, 2, 3).fit(other, y.to_numpy()).predict(other)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.filterwarnings("ignore::skhoid.exceptions.PooledRunsWarning")
def test_lags_never_cross_subjects_and_conditions():
    X, y = arx_runs(4)
    run = X.index.get_level_values("run").to_numpy()
    levels = {"run": (run - 1) % 2 + 1, "subject": np.where(run <= 2, "S1", "S2")}
    # The last run of S1 and the first of S2 have other labels; make those of the middle equal.
    levels["run"] = np.array([1, 2, 2, 1])[run - 1]
    nested, nested_y = with_levels(X, **levels), with_levels(y.to_frame(), **levels)["u"]
    model = ARXRegressor(2, 2, 3).fit(nested, nested_y)
    np.testing.assert_array_equal(model.coef_, ARXRegressor(2, 2, 3).fit(X, y).coef_)
    assert sorted(set(run_labels(nested))) == ["S1/1", "S1/2", "S2/1", "S2/2"]
    assert set(run_labels(nested, level="subject")) == {"S1", "S2"}
    split = list(LeaveOneGroupOut().split(nested, groups=run_labels(nested, level="subject")))
    assert len(split) == 2


def test_select_runs_within_each_subject():
    X, y = arx_runs(6, 20, nk=0)
    run = X.index.get_level_values("run").to_numpy()
    nested = with_levels(X, run=(run - 1) % 3 + 1, subject=np.where(run <= 3, "S1", "S2"))
    last, y_last = select_runs(nested, y.to_numpy(), last=2)
    np.testing.assert_array_equal(last.to_numpy(), X.to_numpy()[np.isin(run, [2, 3, 5, 6])])
    np.testing.assert_array_equal(y_last, y.to_numpy()[np.isin(run, [2, 3, 5, 6])])
    first = select_runs(nested, first=1)
    np.testing.assert_array_equal(first.to_numpy(), X.to_numpy()[np.isin(run, [1, 4])])
    some = select_runs(nested, runs=[3, 1])
    np.testing.assert_array_equal(some.to_numpy(), X.to_numpy()[np.isin(run, [1, 3, 4, 6])])


# Time


@pytest.mark.parametrize(("factor", "blocks"), [(1, -50), (3, 7), (8, 10**6)])
def test_shifting_time_by_whole_blocks_changes_nothing(factor, blocks):
    X, y = arx_runs(seed=2, smooth=1)
    later = with_levels(X, time=X.index.get_level_values("time") + blocks * factor * DT)
    pipe = make_pipeline(Decimator(factor), DelayShift(0.03), ARXRegressor(2, 1))
    one = clone(pipe).fit(X, y)
    other = clone(pipe).fit(later, y.to_numpy())
    np.testing.assert_array_equal(one[-1].coef_, other[-1].coef_)
    np.testing.assert_array_equal(one.predict(X), other.predict(later))


@pytest.mark.parametrize(("factor", "start"), [(2, 1), (3, 17), (7, 60)])
def test_the_phase_of_the_mark_is_fixed_by_time(factor, start):
    X, _ = arx_runs(1)
    decimator = Decimator(factor, method="downsample").fit(X)
    part = slice(start, start + 40)
    assert decimator.transform(X.iloc[part]).index.equals(decimator.transform(X).index[part])


def test_sampling_time_of_a_subset_is_that_of_the_model():
    X, y = arx_runs()
    model = ARXRegressor(2, 2, 3).fit(X, y)
    assert model.predict(X.iloc[:1]).shape == (1,)  # one row has no step
    assert sampling_time(X) == DT
    assert sampling_time(with_levels(X, time=X.index.get_level_values("time") * 5 / 3)) == 1 / 60


@pytest.mark.parametrize("missing", [1, 2, 30])
def test_lags_never_reach_across_a_gap(missing):
    X, y = arx_runs(2)
    keep = np.delete(np.arange(len(X)), np.arange(50, 50 + missing))
    Xg, yg = X.iloc[keep], y.iloc[keep]
    stretches = [(0, 50), (50, 120 - missing), (120 - missing, 240 - missing)]
    phi, output, rows, _ = naive.regressor_rows(
        yg.to_numpy(), Xg[["e"]].to_numpy(), stretches, 2, (2,), (3,)
    )
    model = ARXRegressor(2, 2, 3).fit(Xg, yg)
    assert model.n_rows_used_ == len(rows)
    np.testing.assert_allclose(model.coef_, np.linalg.lstsq(phi, output, rcond=None)[0], rtol=1e-9)
    twin = naive.free_run(Xg[["e"]].to_numpy(), stretches, model.a_, [model.b_], (3,))
    np.testing.assert_allclose(model.predict(Xg), twin, rtol=1e-9, atol=1e-12)
    ahead = naive.predict_ahead(
        yg.to_numpy(), Xg[["e"]].to_numpy(), stretches, model.a_, [model.b_], (3,), horizon=3
    )
    np.testing.assert_allclose(model.predict_ahead(Xg, yg, 3), ahead, rtol=1e-9, atol=1e-12)


def test_an_integer_index_with_a_jump_is_a_gap():
    """KFold leaves such an index in a bare frame."""
    X, y = arx_runs(1)
    bare, bare_y = X[["e"]].reset_index(drop=True), y.reset_index(drop=True)
    keep = np.delete(np.arange(120), np.arange(50, 80))
    gap = ARXRegressor(2, 2, 3).fit(bare.iloc[keep], bare_y.iloc[keep])
    expected = ARXRegressor(2, 2, 3).fit(X.iloc[keep], y.iloc[keep])
    np.testing.assert_array_equal(gap.coef_, expected.coef_)
    assert gap.n_rows_used_ == 90 - 2 * 4


def test_jitter_is_warned_of_and_measured():
    X, y = arx_runs()
    jitter = 2e-4 * np.sin(1.7 * np.arange(len(X)))
    shaken = with_levels(X, time=X.index.get_level_values("time") + jitter)
    with pytest.warns(RunTimeWarning, match=r"jitter by up to .* % of .*resample_runs"):
        model = ARXRegressor(2, 2, 3).fit(shaken, y.to_numpy())
    assert 0.02 < model.jitter_ < 0.05
    # The mean step of a run takes the jitter of its two ends: 2 % over 119 steps.
    assert model.dt_ == pytest.approx(DT, rel=2 * 0.02 / 119)
    np.testing.assert_array_equal(model.coef_, ARXRegressor(2, 2, 3).fit(X, y).coef_)


def test_polars_with_a_run_column():
    polars = pytest.importorskip("polars")
    X, y = arx_runs(lengths=[110, 120, 101])
    frame = as_frame(X)
    expected = ARXRegressor(2, 1, 3, run="run", dt=DT).fit(frame, y.to_numpy())
    table = polars.from_pandas(frame)
    found = ARXRegressor(2, 1, 3, run="run", dt=DT).fit(table, y.to_numpy())
    np.testing.assert_array_equal(found.coef_, expected.coef_)
    np.testing.assert_array_equal(found.predict(table), expected.predict(frame))
    assert found.inputs_ == expected.inputs_
