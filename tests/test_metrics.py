"""VAF as a function and as a scorer."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.metrics import r2_score
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from support import naive
from support.synthetic import DT, arx_runs, run_time, with_levels

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    DelayShift,
    OrderSearchCV,
    RunIndexError,
    RunInTrimmer,
    VAFScorer,
    run_labels,
    vaf_score,
)


def pair(lengths=(60, 40, 50), seed=0, noise=0.5):
    rng = np.random.default_rng(seed)
    index = run_time(list(lengths))
    measured = pd.Series(rng.standard_normal(len(index)) + 1.0, index=index, name="u")
    return measured, measured.to_numpy() + noise * rng.standard_normal(len(index))


def cut_runs(series):
    return [series.loc[[run]].index for run in series.index.unique("run")]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.0, 2.0), st.integers(1, 40))
def test_vaf_against_its_twin(seed, noise, n):
    measured, model = pair((n, 3), seed, noise)
    twin = naive.vaf(measured, model)
    assert vaf_score(measured, model) == pytest.approx(max(twin, 0.0), abs=1e-9)
    assert vaf_score(measured.to_numpy(), model) == pytest.approx(max(twin, 0.0), abs=1e-9)
    assert vaf_score(measured, measured) == 100.0


def test_it_keeps_means_and_is_clipped_and_not_a_correlation():
    measured, _ = pair()
    assert vaf_score(measured, measured - measured.mean()) < 60
    assert vaf_score(measured, -measured) == 0.0
    assert vaf_score(measured, 0.5 * measured) == pytest.approx(75.0)


OFF = {
    "an offset": lambda y: y + 2.0,
    "half the size about another level": lambda y: 0.5 * y - 1.0,
    "the wrong sign": lambda y: -y,
    "an offset of a scaled output": lambda y: 1.2 * y + 0.05 * np.arange(y.size),
    "the other unit": lambda y: y / 57.3,
    "the mean": lambda y: np.full(y.size, y.mean()),
}


@pytest.mark.parametrize("level", [0.0, 5.0, -300.0])
@pytest.mark.parametrize("kind", OFF)
def test_about_the_mean_it_is_the_coefficient_of_determination(kind, level):
    y = level + np.sin(0.05 * np.arange(900)) + 0.1 * np.random.default_rng(0).standard_normal(900)
    y[::50] = np.nan
    known = ~np.isnan(y)
    simulated = np.zeros(900)
    simulated[known] = OFF[kind](y[known])
    expected = max(100 * r2_score(y[known], simulated[known]), -1000.0)
    assert vaf_score(y, simulated, centered=True) == pytest.approx(max(expected, 0.0), abs=1e-9)
    X = pd.DataFrame({"in": simulated})
    scorer = VAFScorer(centered=True)
    as_it_is = ARXRegressor(0, 1, 0).fit(X, pd.Series(simulated))
    assert scorer(as_it_is, X, y) == pytest.approx(expected, abs=1e-6)
    scorer.fraction = True
    assert scorer(as_it_is, X, y) == pytest.approx(expected / 100, abs=1e-8)


def test_a_fraction_ranks_as_a_percentage_does(data):
    X, y = data
    one, hundred = (
        GridSearchCV(
            ARXRegressor(), {"nk": [0, 3, 6]}, scoring=VAFScorer(fraction=f), cv=LeaveOneGroupOut()
        ).fit(X, y, groups=run_labels(X))
        for f in (True, False)
    )
    np.testing.assert_allclose(
        100 * one.cv_results_["mean_test_score"], hundred.cv_results_["mean_test_score"]
    )
    assert 0 < one.best_score_ <= 1
    with pytest.raises(ValueError, match="in percent"):
        DelaySearchCV(ARXRegressor(), scoring=VAFScorer(fraction=True), criterion="vaf").fit(X, y)


def test_pooled_mean_and_per_run():
    measured, model = pair()
    model[60:100] += 3.0  # the second run is bad
    each = [naive.vaf(measured[i], pd.Series(model, measured.index)[i]) for i in cut_runs(measured)]
    np.testing.assert_allclose(vaf_score(measured, model, average=None), np.maximum(each, 0))
    assert vaf_score(measured, model, average="mean") == pytest.approx(max(np.mean(each), 0))
    assert vaf_score(measured, model) == pytest.approx(max(naive.vaf(measured, model), 0))
    assert min(each) < 0


@pytest.mark.parametrize("run_in", [0.0, 0.1, 0.29])
def test_run_in_is_left_out_of_every_run(run_in):
    measured, model = pair()
    kept = measured.index.get_level_values("time").to_numpy() >= run_in - 1e-9
    expected = naive.vaf(measured[kept], model[kept])
    assert vaf_score(measured, model, run_in=run_in) == pytest.approx(expected)
    later = with_levels(measured.to_frame(), time=measured.index.get_level_values("time") + 7)["u"]
    assert vaf_score(later, model, run_in=run_in) == pytest.approx(expected)


def test_window_is_half_open_in_seconds_of_the_index():
    measured, model = pair()
    number = np.rint(measured.index.get_level_values("time").to_numpy() / DT)
    kept = (number >= 7) & (number < 29)
    expected = naive.vaf(measured[kept], model[kept])
    assert vaf_score(measured, model, window=(0.07, 0.29)) == pytest.approx(expected)
    both = kept & (number >= 10)
    expected = naive.vaf(measured[both], model[both])
    assert vaf_score(measured, model, window=(0.07, 0.29), run_in=0.1) == pytest.approx(expected)
    assert vaf_score(measured, model, window=(-np.inf, np.inf)) == vaf_score(measured, model)


def test_missing_measurements_are_left_out():
    measured, model = pair()
    holed = measured.copy()
    holed.iloc[::3] = np.nan
    assert vaf_score(holed, model) == pytest.approx(naive.vaf(holed, model))
    model[::3] = np.nan
    with pytest.raises(ValueError, match=r"prediction is NaN in run 1, t = 0 s \(row 0\)"):
        vaf_score(measured, model)


def test_zero_power_is_an_error():
    measured, model = pair()
    with pytest.raises(ValueError, match="VAF is undefined: the measured output is zero"):
        vaf_score(0 * measured, model)
    with pytest.raises(ValueError, match="constant"):
        vaf_score(0 * measured + 3, model, centered=True)
    resting = measured.copy()
    resting.loc[[2]] = 0.0
    assert vaf_score(resting, model) < 100  # pooled: one run at rest does no harm
    for average in ("mean", None):
        with pytest.raises(ValueError, match="of a run"):
            vaf_score(resting, model, average=average)


def test_runs_of_data_without_an_index():
    measured, model = pair()
    labels = measured.index.get_level_values("run").to_numpy()
    for average in ("pooled", "mean"):
        indexed = vaf_score(measured, model, average=average, run_in=0.1)
        plain = vaf_score(
            measured.to_numpy(), model, average=average, run_in=0.1, dt=DT, run=labels
        )
        assert plain == pytest.approx(indexed, rel=1e-12)
    assert vaf_score(measured.to_frame(), model) == vaf_score(measured, model)


# The scorer


@pytest.fixture(scope="module")
def data():
    return arx_runs(4, 150, noise=0.5, smooth=1)


def test_scorer_is_unclipped_with_a_finite_floor(data):
    X, y = data
    model = ARXRegressor(2, 2, 3).fit(X, y)
    assert VAFScorer()(model, X, y) == model.score(X, y)
    model.coef_ = np.array([0.0, 0.0, -2.0, 0.0])
    value = VAFScorer()(model, X, y)
    assert -1000 < value < 0
    assert value == pytest.approx(naive.vaf(y, model.predict(X)))
    model.coef_ = np.array([-3.0, 2.0, 1.0, 0.0])
    assert VAFScorer()(model, X, y) == -1000.0
    assert VAFScorer(average="mean")(model, X, y) == -1000.0


@pytest.mark.parametrize(
    "options",
    [
        {"run_in": 0.3},
        {"window": (0.2, 1.1)},
        {"average": "mean"},
        {"centered": True},
        {"run_in": 0.3, "average": "mean", "centered": True},
    ],
)
def test_scorer_equals_the_function(data, options):
    X, y = data
    model = ARXRegressor(2, 2, 3).fit(X, y)
    assert VAFScorer(**options)(model, X, y) == pytest.approx(
        vaf_score(y, model.predict(X), **options), rel=1e-12
    )


def test_scorer_at_model_rate(data):
    X, y = data
    thinner = Decimator(3, padding="periodic")
    pipe = make_pipeline(DelayShift(0.03), thinner, ARXRegressor(2, 2)).fit(X, y)
    marked = pipe[:-1].transform(X)
    e, u, stretches = [], [], []
    for run in (1, 2, 3, 4):
        at = sum(map(len, u))
        e.append(marked.loc[run]["e"].to_numpy()[::3])
        u.append(naive.brick_wall(y.loc[run].to_numpy(), 3)[::3])
        stretches.append((at, at + len(u[-1])))
    inputs = np.nan_to_num(np.concatenate(e))[:, None]
    free = naive.free_run(inputs, stretches, pipe[-1].a_, [pipe[-1].b_], (0,))
    expected = naive.vaf(np.concatenate(u), free)
    assert VAFScorer(rate="model")(pipe, X, y) == pytest.approx(expected, rel=1e-9)
    # Without a Decimator both rates are one.
    plain = ARXRegressor(2, 2, 3).fit(X, y)
    assert VAFScorer(rate="model")(plain, X, y) == pytest.approx(plain.score(X, y), rel=1e-12)
    # The thesis's figure is the kinder one.
    assert expected > VAFScorer()(pipe, X, y)


@pytest.mark.parametrize(
    "search",
    [
        DelaySearchCV(ARXRegressor(), nk=[2, 3]),
        OrderSearchCV(ARXRegressor(), na=[2], nb=[2], nk=[3]),
    ],
)
def test_scorer_reads_through_a_search(data, search):
    X, y = data
    fitted = clone(search).fit(X, y)
    best = fitted.best_estimator_
    for scorer in (VAFScorer(), VAFScorer(rate="model"), VAFScorer(run_in=0.2)):
        assert scorer(fitted, X, y) == scorer(best, X, y)


def test_a_trimmed_run_in_is_left_out_of_stock_searches(data):
    X, y = data
    spoilt = y.copy()
    early = X.index.get_level_values("time") < 0.3
    spoilt[early] = 50.0
    pipe = make_pipeline(RunInTrimmer(0.3), ARXRegressor(2, 2, 3, initial="rest"))
    search = GridSearchCV(pipe, {"arxregressor__na": [1, 2]}, scoring=VAFScorer(),
                          cv=LeaveOneGroupOut())  # fmt: skip
    search.fit(X, spoilt, groups=run_labels(X))
    clean = clone(search).fit(X, y, groups=run_labels(X))
    np.testing.assert_allclose(
        search.cv_results_["mean_test_score"], clean.cv_results_["mean_test_score"], rtol=1e-12
    )
    # The score of a pipeline, and the scorer on it and on the whole search, agree.
    best = clean.best_estimator_
    assert best.score(X, y) == pytest.approx(VAFScorer()(best, X, y), rel=1e-12)
    assert clean.score(X, y) == pytest.approx(VAFScorer()(best, X, y), rel=1e-12)
    kept = naive.vaf(y[~early], best.predict(X)[~early])
    assert best.score(X, y) == pytest.approx(kept, rel=1e-12)


def test_scorer_checks_and_shows_its_options():
    assert repr(VAFScorer(run_in=2.0, centered=True)) == (
        "VAFScorer(run_in=2.0, rate='full', average='pooled', centered=True)"
    )
    for options in ({"rate": "half"}, {"average": None}):
        with pytest.raises(ValueError, match="must be"):
            VAFScorer(**options)


def test_scorer_refuses_rows_in_another_order(data):
    X, y = data
    model = ARXRegressor(2, 2, 3).fit(X, y)
    with pytest.raises(RunIndexError):
        VAFScorer()(model, X, y.iloc[::-1])


def test_scorer_takes_time_and_runs_from_the_model():
    X, y = arx_runs(2, 200)
    array = np.column_stack([X.index.get_level_values("run"), X.to_numpy()])
    model = ARXRegressor(2, 2, 3, inputs=[1], dt=0.01, run=0).fit(array, y.to_numpy())
    told = VAFScorer(run_in=1.0, average="mean", dt=0.01, run=0)(model, array, y.to_numpy())
    assert VAFScorer(run_in=1.0, average="mean")(model, array, y.to_numpy()) == told
    indexed = ARXRegressor(2, 2, 3).fit(X, y)
    assert VAFScorer(run_in=1.0, average="mean")(indexed, X, y) == pytest.approx(told, rel=1e-12)


def test_run_labels_beside_a_time_index():
    index = pd.Index(0.01 * np.arange(8), name="time")
    measured = pd.Series([1.0, 1, 1, 1, 2, 2, 2, 2], index=index)
    model = measured.copy()
    model.iloc[[0, 1, 4, 5]] = 9.0
    labels = np.repeat(["a", "b"], 4)
    assert vaf_score(measured, model, run=labels, run_in=0.02) == 100.0
