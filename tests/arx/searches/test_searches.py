"""The searches for delay and orders: exact against explicit fits, and right on known systems."""

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, KFold, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from support import naive
from support.synthetic import DT, arx_runs, loop_runs, stretches_of

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    DelayShift,
    OrderSearchCV,
    RankDeficiencyError,
    RecursiveARXCV,
    RunCutWarning,
    RunInTrimmer,
    ShortRunError,
    VAFScorer,
    run_labels,
)


class SlowARX(ARXRegressor):
    """The same model, which the searches do not know to be one: they refit every candidate."""


@pytest.fixture(scope="module")
def data():
    return arx_runs(4, 150, noise=0.3)


def rows_of_runs(X, runs):
    return np.isin(X.index.get_level_values("run").to_numpy(), runs)


def fit_naive(X, y, inputs, na, nb, nk, first, train):
    """Least squares on the training rows that lie ``first`` rows or more after a run's start."""
    n_inputs = len(inputs)
    nbs = [nb] * n_inputs if np.ndim(nb) == 0 else nb
    nks = [nk] * n_inputs if np.ndim(nk) == 0 else nk
    phi, output, rows, _ = naive.regressor_rows(
        y.to_numpy(), X[inputs].to_numpy(), stretches_of(X), na, nbs, nks
    )
    begin = np.zeros(len(X), dtype=int)
    for a, b in stretches_of(X):
        begin[a:b] = a
    use = (rows - begin[rows] >= first) & train[rows]
    theta = np.linalg.lstsq(phi[use], output[use], rcond=None)[0]
    mse = np.mean((output[use] - phi[use] @ theta) ** 2)
    free = naive.free_run(
        X[inputs].to_numpy(), stretches_of(X), theta[:na],
        np.split(theta[na:], np.cumsum(nbs)[:-1]), nks,
    )  # fmt: skip
    return theta, mse, free, int(use.sum())


# The delay


@pytest.mark.parametrize("intercept", [False, True])
@pytest.mark.parametrize("inputs", [["e"], ["e", "x"]])
def test_one_step_losses_against_their_twin(data, inputs, intercept):
    X, y = data
    candidates = [0, 1, 2, 3, 7, 12]
    if len(inputs) > 1:
        candidates = [*candidates, (3, 0), (2, 9)]
    model = ARXRegressor(inputs=inputs, fit_intercept=intercept)
    search = DelaySearchCV(model, nk=candidates).fit(X, y)
    twin = naive.one_step_losses(
        y.to_numpy(), X[inputs].to_numpy(), stretches_of(X), 2, 2, candidates, intercept
    )
    np.testing.assert_allclose(search.loss_, twin, rtol=1e-9)
    assert search.best_nk_ == candidates[int(np.argmin(twin))]
    assert search.cv_results_["nk"] == candidates
    np.testing.assert_array_equal(search.cv_results_["loss"], search.loss_)
    assert search.best_nk_ == search.best_estimator_.nk
    assert search.best_delay_ == pytest.approx(np.multiply(search.best_nk_, DT))


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrap",
    [
        pytest.param(lambda model: model, id="bare"),
        pytest.param(lambda model: make_pipeline(DelayShift(0.01), model), id="shift"),
        pytest.param(lambda model: make_pipeline(Decimator(2), model), id="decimated"),
        pytest.param(lambda model: make_pipeline(RunInTrimmer(0.3), model), id="trimmed"),
    ],
)
@pytest.mark.parametrize("criterion", ["one_step", "vaf"])
def test_fast_path_equals_generic_path(data, criterion, wrap, request):
    """With na = 6 every candidate is fitted on the same rows on both paths."""
    na, kind = 6, request.node.callspec.id
    X, y = data
    candidates = [0, 1, 2, 3]
    if kind.endswith("shift"):
        candidates = [0, 1, 2]
    fast, slow = (
        DelaySearchCV(wrap(model), nk=candidates, criterion=criterion).fit(X, y)
        for model in (ARXRegressor(na), SlowARX(na))
    )
    np.testing.assert_allclose(fast.loss_, slow.loss_, rtol=1e-9)
    assert fast.best_nk_ == slow.best_nk_


def test_window_follows_a_delay_that_jumps():
    """The delay is 3 samples in the first half and 9 in the second."""
    rng = np.random.default_rng(0)
    X, _ = arx_runs(1, 2000)
    e = X["e"].to_numpy()
    y = np.zeros(2000)
    for t in range(12, 2000):
        nk = 3 if t < 1000 else 9
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + e[t - nk] + 0.5 * e[t - nk - 1]
        y[t] += 0.2 * rng.standard_normal()
    search = DelaySearchCV(ARXRegressor(), nk=range(1, 15), window=2.0).fit(X, y)
    assert search.window_time_[1] - search.window_time_[0] == pytest.approx(0.5)
    ends = search.window_time_ + 1.0
    starts = search.window_time_ - 1.0
    assert set(search.nk_path_[ends <= 10.0]) == {3.0}
    assert set(search.nk_path_[starts >= 10.0]) == {9.0}
    np.testing.assert_allclose(search.delay_path_, search.nk_path_ * DT)
    assert search.loss_path_.shape == (search.window_time_.size, 14)
    # Each window is an ordinary search over its rows.
    number = np.rint(X.index.get_level_values("time").to_numpy() / DT)
    inside = (number >= round(starts[3] / DT)) & (number < round(ends[3] / DT))
    for column, nk in ((2, 3), (8, 9)):
        _, mse, _, _ = fit_naive(X, pd.Series(y), ["e"], 2, 2, nk, 15, inside)
        assert search.loss_path_[3, column] == pytest.approx(mse, rel=1e-9)


def test_too_long_candidates_name_the_run(data):
    X, y = data
    with pytest.raises(ShortRunError, match=r"Run 1 \(and 3 more\).*200 samples back"):
        DelaySearchCV(ARXRegressor(), nk=range(1, 200)).fit(X, y)


def test_dependent_candidates_are_nan_and_not_chosen(data):
    X, y = data
    twice = X.assign(f=X.groupby("run")["e"].shift(2))
    twice.loc[twice["f"].isna(), "f"] = 0.0
    model = ARXRegressor(inputs=["e", "f"])
    search = DelaySearchCV(model, nk=[(3, 1), (3, 3)]).fit(twice, y)
    assert np.isnan(search.loss_).tolist() == [True, False]
    with pytest.raises(RankDeficiencyError):
        DelaySearchCV(model, nk=[(3, 1)]).fit(twice, y)


# The orders


@pytest.mark.parametrize("slow", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_cv_results_equal_explicit_fits(data, slow):
    X, y = data
    model = (SlowARX if slow else ARXRegressor)()
    # First rows of all candidates are equal when the output lags decide; else the fast path
    # compares on the rows of the largest candidate.
    grid = {"na": [5], "nb": [1, 2], "nk": [2, 3]} if slow else {"na": [1, 2], "nb": [1, 2],
                                                                 "nk": [2, 3]}  # fmt: skip
    search = OrderSearchCV(model, **grid).fit(X, y)
    first = 5 if slow else 4
    results = search.cv_results_
    assert len(results["params"]) == np.prod([len(v) for v in grid.values()])
    for i, params in enumerate(results["params"]):
        na, nb, nk = params["na"], params["nb"], params["nk"]
        scores = []
        for fold, run in enumerate((1, 2, 3, 4)):
            test = rows_of_runs(X, [run])
            *_, free, _ = fit_naive(X, y, ["e"], na, nb, nk, first, ~test)
            scores.append(max(naive.vaf(y[test], free[test]), -1000))
            assert results[f"split{fold}_test_score"][i] == pytest.approx(scores[-1], abs=1e-7)
        assert results["mean_test_score"][i] == pytest.approx(np.mean(scores), abs=1e-7)
        assert results["std_test_score"][i] == pytest.approx(np.std(scores), abs=1e-7)
        everything = np.ones(len(X), dtype=bool)
        _, mse, _, n_rows = fit_naive(X, y, ["e"], na, nb, nk, first, everything)
        complexity = (na + nb) * np.log(n_rows) / n_rows
        if not slow:  # the generic path takes the noise variance for the mean square
            assert results["bic"][i] == pytest.approx(np.log(mse) + complexity, abs=1e-9)
            assert results["mbic"][i] == pytest.approx(np.log(mse) + 3 * complexity, abs=1e-9)
        assert results["n_params"][i] == na + nb
        assert results["delay"][i] == pytest.approx(nk * DT)
        assert results["param_na"][i] == na
    assert results["rank_test_score"][np.argmax(results["mean_test_score"])] == 1


def test_one_standard_error_rule_picks_the_smallest(data):
    X, y = data
    search = OrderSearchCV(ARXRegressor(), nk=[3], na=[1, 2, 3, 4], nb=[1, 2, 3]).fit(X, y)
    results = search.cv_results_
    vaf = results["mean_test_score"]
    best = int(np.argmax(vaf))
    splits = np.array([results[f"split{i}_test_score"][best] for i in range(4)])
    assert search.standard_error_ == pytest.approx(splits.std(ddof=1) / 2)
    good = np.flatnonzero(vaf >= vaf[best] - search.standard_error_)
    smallest = results["n_params"][good].min()
    assert search.cv_results_["n_params"][search.best_index_] == smallest
    tied = [i for i in good if results["n_params"][i] == smallest]
    assert search.best_index_ == max(tied, key=lambda i: vaf[i])
    assert smallest < results["n_params"].max()
    chosen = results["params"][search.best_index_]
    assert search.best_params_ == chosen
    assert (search.best_na_, search.best_nb_, search.best_nk_) == (
        chosen["na"], chosen["nb"], chosen["nk"]
    )  # fmt: skip
    assert search.best_score_ == vaf[search.best_index_]
    best_rule = OrderSearchCV(
        ARXRegressor(), nk=[3], na=[1, 2, 3, 4], nb=[1, 2, 3], rule="best"
    ).fit(X, y)
    assert best_rule.best_index_ == best


@pytest.mark.slow
def test_bic_finds_the_true_order():
    """ARX(2, 2, 3): BIC is consistent, and misses with probability of about log(n)/n per lag."""
    right = 0
    for seed in range(8):
        X, y = arx_runs(2, 400, seed=seed, noise=0.5)
        search = OrderSearchCV(
            ARXRegressor(), na=[1, 2, 3, 4], nb=[1, 2, 3], nk=[2, 3, 4], criterion="bic"
        )
        search.fit(X, y)
        right += (search.best_na_, search.best_nb_, search.best_nk_) == (2, 2, 3)
    assert right >= 6


def test_decimation_factors(data):
    X, y = arx_runs(3, 400, noise=0.1, smooth=2)
    search = OrderSearchCV(
        ARXRegressor(), na=[2], nb=[2], nk={1: [2, 3], 2: [1, 2], 4: [0]}, factor=[1, 2, 4]
    )
    search.fit(X, y)
    assert [(p["factor"], p["nk"]) for p in search.cv_results_["params"]] == [
        (1, 2), (1, 3), (2, 1), (2, 2), (4, 0),
    ]  # fmt: skip
    np.testing.assert_allclose(search.cv_results_["delay"], [0.02, 0.03, 0.02, 0.04, 0.0])
    # Every score is taken at full rate: that of a stock search over the same pipeline.
    for factor, nk, row in ((1, 3, 1), (2, 1, 2), (4, 0, 4)):
        pipe = make_pipeline(Decimator(factor), ARXRegressor(2, 2, nk))
        stock = GridSearchCV(pipe, {"decimator__factor": [factor]}, scoring=VAFScorer(),
                             cv=LeaveOneGroupOut())  # fmt: skip
        stock.fit(X, y, groups=run_labels(X))
        # The candidates of one factor are compared on the same rows: a row a run fewer.
        found = search.cv_results_["mean_test_score"][row]
        assert found == pytest.approx(stock.best_score_, abs=0.05)
    inside = OrderSearchCV(
        make_pipeline(Decimator(8), ARXRegressor()), na=[2], nb=[2], nk=[0, 1], factor=[1, 2]
    ).fit(X, y)
    assert inside.best_estimator_[0].factor == inside.best_factor_ in (1, 2)
    with pytest.raises(ValueError, match="cannot compare decimation factors"):
        OrderSearchCV(ARXRegressor(), na=[2], nb=[2], factor=[1, 2], criterion="bic").fit(X, y)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"na": [1.7]}, "whole number"),
        ({"factor": [2.5]}, "factor"),
        ({"factor": [1, 2], "nk": {1: [1]}}, "factor 2"),
    ],
)
def test_candidates_that_should_be_refused(data, options, error):
    X, y = data
    with pytest.raises(ValueError, match=error):
        OrderSearchCV(ARXRegressor(), **{"na": [1], "nb": [1], **options}).fit(X, y)


def test_a_single_run_is_halved_as_in_the_thesis():
    X, y = arx_runs(1, 401, noise=0.3)
    search = OrderSearchCV(ARXRegressor(), na=[2], nb=[1, 2], nk=[3]).fit(X, y)
    test = np.arange(401) >= 201
    for i, nb in enumerate((1, 2)):
        *_, free, _ = fit_naive(X, y, ["e"], 2, nb, 3, 4, ~test)
        assert search.cv_results_["split0_test_score"][i] == pytest.approx(
            naive.vaf(y[test], free[test]), abs=1e-8
        )
    assert 0 < search.standard_error_ < 10


# Splits


def test_a_split_that_cuts_a_run_is_warned_of_once():
    X, y = arx_runs(1, 300)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        search = OrderSearchCV(ARXRegressor(), na=[2], nb=[2], nk=[3], cv=KFold(3)).fit(X, y)
    cut = [w for w in caught if issubclass(w.category, RunCutWarning)]
    assert len(cut) == 1
    assert "cut run 1" in str(cut[0].message)
    assert "LeaveOneGroupOut" in str(cut[0].message)
    # Simulated from the start of the run, fitted on the rows whose lags lie in the training part.
    test = np.arange(300) // 100 == 1
    phi, output, rows, _ = naive.regressor_rows(
        y.to_numpy(), X[["e"]].to_numpy(), [(0, 100), (200, 300)], 2, [2], [3]
    )
    theta = np.linalg.lstsq(phi, output, rcond=None)[0]
    free = naive.free_run(X[["e"]].to_numpy(), [(0, 300)], theta[:2], [theta[2:]], [3])
    assert not test[rows].any()
    assert search.cv_results_["split1_test_score"][0] == pytest.approx(
        naive.vaf(y[test], free[test]), abs=1e-8
    )


@pytest.mark.parametrize(
    "search",
    [
        DelaySearchCV(ARXRegressor(), nk=[2, 3]),
        OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[2], nk=[3], factor=[1, 2]),
        RecursiveARXCV([64, 256], nk=3, n_jobs=2),
    ],
    ids=["one_step", "order", "recursive"],
)
def test_progress_bars(data, search, capsys):
    callback = pytest.importorskip("sklearn.callback", reason="came with scikit-learn 1.9")
    X, y = data
    search.set_callbacks(callback.ProgressBar())
    search.fit(X, y)
    assert np.isfinite(search.predict(X)).all()
    assert type(search).__name__ in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore::skhoid.NothingExplainedWarning")
def test_instrumental_variables_can_be_searched():
    """The path that fits candidates one by one, with one that cannot be fitted."""
    X, y = loop_runs(2, remnant_gain=0.0109)
    target = X["f_t"] * 0 + np.sin(2 * np.pi * X.index.get_level_values("time") / 81.92 * 22)
    X = X.assign(f_t=target)
    model = make_pipeline(ARXRegressor(nk=29, method="iv", instruments=["f_t"], inputs=["e"]))
    search = OrderSearchCV(model, na=[1, 6], nb=[1]).fit(X, y)
    results = search.cv_results_
    assert np.isnan(results["mean_test_score"][1])
    assert np.isnan(results["bic"][1])
    assert search.best_na_ == 1
    assert search.predict(X).shape == y.shape


@pytest.mark.parametrize("search", [DelaySearchCV, OrderSearchCV])
def test_only_arx_models_are_searched(search, data):
    with pytest.raises(TypeError, match=r"needs an ARX model.*got Ridge"):
        search(Ridge()).fit(*data)


@pytest.mark.parametrize("still", [0.0, 3.0])
def test_an_input_that_is_still_where_a_fold_fits_is_named(still):
    rng = np.random.default_rng(0)
    e = np.where(np.arange(1000) < 600, still, rng.standard_normal(1000))
    u = 0.1 * rng.standard_normal(1000)
    index = pd.MultiIndex.from_product([[1], np.arange(1000) * 0.01], names=["run", "time"])
    X, y = pd.DataFrame({"e": e}, index=index), pd.Series(u, index=index, name="u")
    search = DelaySearchCV(ARXRegressor(fit_intercept=True), range(20), criterion="vaf")
    with pytest.raises(ValueError, match=r"On rows 1 to 500 of 1000.*Input 'e' is"):
        search.fit(X, y)
