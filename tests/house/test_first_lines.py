"""The first lines that a user of scikit-learn types: each is right, or an error that helps."""

import io
import pickle
from functools import cache

import joblib
import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor, make_column_transformer
from sklearn.exceptions import DataConversionWarning, NotFittedError
from sklearn.model_selection import (
    GridSearchCV,
    LeaveOneGroupOut,
    cross_val_predict,
    cross_validate,
    train_test_split,
)
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from skhoid import (
    ARXRegressor,
    EffectSearchCV,
    MissingDataWarning,
    OperatorRegressor,
    RecursiveARX,
    RunIndexError,
    ShortRunError,
    SlowClockWarning,
    VAFScorer,
    run_labels,
)

N, DT = 800, 0.02
RNG = np.random.default_rng(0)
E = np.convolve(RNG.standard_normal(N), np.ones(8) / 8, "same")
U = np.zeros(N)
for t in range(12, N):
    U[t] = 0.7 * U[t - 1] + 0.5 * E[t - 10] + 0.02 * RNG.standard_normal()
INDEX = pd.MultiIndex.from_product([[0, 1], np.arange(N // 2) * DT], names=["run", "time"])
X = pd.DataFrame({"e": E, "x": np.cumsum(E) * DT}, index=INDEX)
Y = pd.Series(U, index=INDEX, name="u")
XA, YA, G = X.to_numpy(), Y.to_numpy(), np.asarray(run_labels(X))
MODELS = {
    "ARX": ARXRegressor(1, 1, 10),
    "recursive": RecursiveARX(1, 1, 10, memory_horizon=200, init_window=5.0),
    "operator": OperatorRegressor(),
    "search": EffectSearchCV(OperatorRegressor(), effects=["bias"], max_effects=0),
}
EACH = pytest.mark.parametrize("name", MODELS)
PLAIN = pytest.mark.parametrize("name", ["ARX", "recursive", "operator"])
LINEAR = pytest.mark.parametrize("name", ["ARX", "recursive"])


def model(name, **params):
    """One of the models; parameters of the model that a search has are set in it."""
    inner = {"dt", "inputs", "na"}
    prefix = "estimator__" if name == "search" else ""
    return clone(MODELS[name]).set_params(
        **{(prefix + key if key in inner else key): value for key, value in params.items()}
    )


def on_arrays(name):
    return model(name, inputs=[0], dt=DT)


@cache
def fitted_to_tables(name):
    return model(name).fit(X, Y)


@cache
def fitted_to_arrays(name):
    return on_arrays(name).fit(XA, YA)


@PLAIN
def test_tables_arrays_and_lists_are_the_same(name):
    one = [Y[G == 0], X[G == 0]]
    twin = model(name).fit(one[1], one[0]).predict(one[1])
    x, y = XA[G == 0], YA[G == 0]
    for X_given, y_given in [(x, y), (x.tolist(), y.tolist())]:
        np.testing.assert_allclose(on_arrays(name).fit(X_given, y_given).predict(X_given), twin)
    bare = pd.DataFrame(x, columns=["e", "x"])
    np.testing.assert_allclose(model(name, dt=DT).fit(bare, pd.Series(y)).predict(bare), twin)


@LINEAR
@pytest.mark.parametrize(
    "y", [Y.to_frame(), YA[:, None], YA.astype(object), Y.astype(str), YA.astype("f4")]
)
def test_the_output_in_other_containers(name, y):
    table = isinstance(y, pd.DataFrame | pd.Series)
    fitted = model(name) if table else on_arrays(name)
    given = X if table else XA
    if y.ndim == 2:
        with pytest.warns(DataConversionWarning, match="column-vector"):
            fitted.fit(given, y)
    else:
        fitted.fit(given, y)
    twin = (model(name) if table else on_arrays(name)).fit(given, Y if table else YA)
    np.testing.assert_allclose(fitted.predict(given), twin.predict(given), atol=1e-3)


@PLAIN
def test_whole_numbers_and_single_precision(name):
    whole = np.rint(1000 * XA).astype(int), np.rint(1000 * YA).astype(int)
    scaled = on_arrays(name).fit(*whole).predict(whole[0]) / 1000
    twin = fitted_to_arrays(name).predict(XA)
    np.testing.assert_allclose(scaled, twin, atol=0.02)
    single = on_arrays(name).fit(XA.astype("f4"), YA.astype("f4"))
    np.testing.assert_allclose(single.predict(XA), twin, atol=1e-3)


@LINEAR
def test_a_scaler_needs_pandas_output(name):
    with pytest.raises(RunIndexError, match=r'set_output\(transform="pandas"\)'):
        make_pipeline(StandardScaler(), model(name)).fit(X, Y)
    pipe = make_pipeline(StandardScaler(), model(name)).set_output(transform="pandas")
    centred = X - X.mean()
    twin = model(name).fit(centred / X.std(ddof=0), Y)
    assert pipe.fit(X, Y).score(X, Y) == pytest.approx(twin.score(centred / X.std(ddof=0), Y))


@PLAIN
def test_a_column_transformer_may_put_its_steps_before_names(name):
    named = make_column_transformer((StandardScaler(), ["e", "x"])).set_output(transform="pandas")
    plain = make_column_transformer(
        (StandardScaler(), ["e", "x"]), verbose_feature_names_out=False
    ).set_output(transform="pandas")
    one, other = (make_pipeline(c, model(name)).fit(X, Y) for c in (named, plain))
    assert one[-1].inputs_ == ["standardscaler__e"]
    assert one.score(X, Y) == other.score(X, Y)
    with pytest.raises(ValueError, match=r"verbose_feature_names_out=False\) keeps names"):
        make_pipeline(named, model(name, inputs=["e"])).fit(X, Y)


@LINEAR
def test_the_target_may_be_transformed(name):
    doubled = TransformedTargetRegressor(model(name), func=double, inverse_func=halve).fit(X, Y)
    np.testing.assert_allclose(
        doubled.predict(X), fitted_to_tables(name).predict(X), atol=2e-3 * Y.std()
    )


def double(y):
    return 2 * y


def halve(y):
    return y / 2


@LINEAR
def test_a_grid_over_orders(name):
    search = GridSearchCV(
        model(name), {"na": [0, 1, 2]}, cv=LeaveOneGroupOut(), error_score="raise"
    )
    search.fit(X, Y, groups=G)
    assert search.best_params_["na"] in (1, 2)
    assert search.best_score_ == search.cv_results_["mean_test_score"].max() > 95


@PLAIN
def test_several_scores(name):
    scoring = {"r2": "r2", "rmse": "neg_root_mean_squared_error", "vaf": VAFScorer()}
    found = cross_validate(
        model(name), X, Y, cv=LeaveOneGroupOut(), groups=G, scoring=scoring, error_score="raise"
    )
    assert (found["test_r2"] > 0.95).all()
    assert (found["test_vaf"] > 95).all()
    whole = cross_val_predict(model(name), X, Y, cv=LeaveOneGroupOut(), groups=G)
    for run, rmse in enumerate(found["test_rmse"]):
        error = (whole - YA)[run == G]
        assert -rmse == pytest.approx(np.sqrt(np.mean(error**2)))


@EACH
def test_shuffled_rows_are_refused(name):
    a, _, b, _ = train_test_split(X, Y, random_state=0)
    with pytest.raises(RunIndexError, match="shuffled, or drawn one by one"):
        model(name).fit(a, b)
    with pytest.raises(RunIndexError, match="row indexes of X and y disagree"):
        model(name).fit(X, Y.sample(frac=1.0, random_state=0))


@EACH
def test_copies_and_files(name):
    fitted = fitted_to_tables(name)
    file = io.BytesIO()
    joblib.dump(fitted, file)
    file.seek(0)
    for again in (pickle.loads(pickle.dumps(fitted)), joblib.load(file)):
        np.testing.assert_array_equal(again.predict(X), fitted.predict(X))
    assert clone(fitted).get_params().keys() == fitted.get_params().keys()
    with pytest.raises(NotFittedError):
        clone(fitted).predict(X)


@PLAIN
def test_features(name):
    fitted = fitted_to_tables(name)
    assert (fitted.n_features_in_, fitted.feature_names_in_.tolist()) == (2, ["e", "x"])
    assert not hasattr(fitted_to_arrays(name), "feature_names_in_")
    with pytest.raises(ValueError, match="same order"):
        fitted.predict(X[["x", "e"]])
    with pytest.raises(ValueError, match=r"missing:\n- x"):
        fitted.predict(X[["e"]])


@PLAIN
def test_missing_values_are_left_out_or_held_and_said(name):
    holes = np.isin(np.arange(N), range(150, 160))
    fitted = model(name)
    if name == "operator":
        fitted.fit(X, Y.mask(holes))
    else:
        with pytest.warns(MissingDataWarning, match="10 rows of 'u' are NaN"):
            fitted.fit(X, Y.mask(holes))
    assert fitted.score(X, Y) > 95
    with pytest.warns(MissingDataWarning, match="10 rows of"):
        predicted = fitted.predict(X.assign(e=X["e"].mask(holes)))
    assert np.isfinite(predicted).all()


@EACH
@pytest.mark.parametrize(
    ("X_given", "y_given", "error", "says"),
    [
        (XA[:1], YA[:1], ShortRunError, r"n_samples = 1\b"),
        (XA[:0], YA[:0], ValueError, r"0 sample\(s\)"),
        (XA[:, 0], YA, ValueError, "Expected 2D array, got 1D array"),
        (XA[None], YA, ValueError, "dim 3"),
        (XA, YA[:-1], ValueError, "inconsistent numbers of samples"),
        (XA, np.c_[YA, YA], ValueError, "1d array"),
        (XA, None, ValueError, "requires y"),
        (XA, ["left", "right"] * (N // 2), ValueError, "'left' in row 0, which is not a number"),
        (np.where(XA[5] == XA, np.inf, XA), YA, ValueError, "infinity"),
    ],
)
def test_what_cannot_be_fitted(name, X_given, y_given, error, says):
    with pytest.raises(error, match=says):
        on_arrays(name).fit(X_given, y_given)


@PLAIN
def test_one_row_can_be_predicted(name):
    assert fitted_to_tables(name).predict(X[:1]).shape == (1,)
    assert fitted_to_arrays(name).predict(XA[:1]).shape == (1,)


@pytest.mark.parametrize("name", ["operator", "search"])
@pytest.mark.filterwarnings("ignore::skhoid.NothingExplainedWarning")
def test_a_person_sampled_once_a_second_is_doubted(name):
    with pytest.warns(SlowClockWarning, match=r"each row counts as 1 s.*Give the sampling time"):
        model(name, inputs=[0]).fit(XA, YA)


@pytest.mark.parametrize(
    "attribute",
    ["coef_", "a_", "b_", "intercept_", "parameters_", "covariance_", "noise_variance_"],
)
def test_before_a_stream_has_enough_rows(attribute):
    stream = RecursiveARX(1, 1, 10, init_window=5.0, dt=DT)
    assert not hasattr(stream, attribute)
    stream.partial_fit(XA[:40], YA[:40])
    with pytest.raises(NotFittedError, match="collected 40 rows of the 250"):
        getattr(stream, attribute)
    with pytest.raises(NotFittedError, match="collected 40 rows of the 250"):
        stream.predict(XA)
    assert not hasattr(stream, attribute)
    stream.partial_fit(XA[40:400], YA[40:400])
    assert hasattr(stream, attribute)


@EACH
def test_unknown_and_wrong_parameters(name):
    with pytest.raises(ValueError, match=r"Invalid parameter 'alpha'.*Valid parameters are"):
        model(name).set_params(alpha=1.0)
    assert not hasattr(model(name), "set_output")
