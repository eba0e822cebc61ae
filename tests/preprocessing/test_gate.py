"""What is read: containers, masks, sizes of values; the same everywhere."""

import warnings

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from sklearn.base import clone

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    EffectSearchCV,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    VAFScorer,
    check_channels,
    compare,
    fourier_coefficients,
    make_tracking_runs,
)

pytestmark = pytest.mark.filterwarnings("ignore::skhoid.exceptions.MissingDataWarning")

X, Y = make_tracking_runs(
    "C1",
    1,
    duration=10.24,
    sampling_rate=50,
    remnant_intensity=0.1,
    channels=("e", "x", "f_t"),
    random_state=0,
)
FRAME = X.reset_index(drop=True)
ARRAY, OUTPUT = X.to_numpy(), Y.to_numpy()
GAPS_X, GAPS_Y = ARRAY.copy(), OUTPUT.copy()
GAPS_X[100:110, 0] = np.nan
GAPS_Y[300:310] = np.nan
MASKED_X = np.ma.masked_array(np.where(np.isnan(GAPS_X), 1e6, GAPS_X), np.isnan(GAPS_X))
MASKED_Y = np.ma.masked_array(np.where(np.isnan(GAPS_Y), 1e6, GAPS_Y), np.isnan(GAPS_Y))
BATCH = ARXRegressor(nk=15, inputs=[0])
MODELS = {
    "batch": BATCH,
    "instruments": ARXRegressor(nk=15, inputs=[0], method="iv", instruments=[2]),
    "recursive": RecursiveARX(nk=15, inputs=[0], init_window=100),
    "orders": OrderSearchCV(BATCH, na=[2], nb=[1, 2], nk=[15]),
}
each_model = pytest.mark.parametrize("name", MODELS)


# Masks


@each_model
def test_a_mask_says_that_nothing_was_measured(name):
    missing = clone(MODELS[name]).fit(GAPS_X, GAPS_Y)
    masked = clone(MODELS[name]).fit(MASKED_X, MASKED_Y)
    np.testing.assert_array_equal(masked.predict(MASKED_X), missing.predict(GAPS_X))
    assert masked.score(MASKED_X, MASKED_Y) == missing.score(GAPS_X, GAPS_Y)
    assert VAFScorer()(masked, MASKED_X, MASKED_Y) == VAFScorer()(missing, GAPS_X, GAPS_Y)
    if hasattr(missing, "predict_ahead"):
        np.testing.assert_array_equal(
            masked.predict_ahead(MASKED_X, MASKED_Y), missing.predict_ahead(GAPS_X, GAPS_Y)
        )


# Containers


@pytest.mark.parametrize(
    "same",
    [
        FRAME.astype(pd.SparseDtype(float, 0.0)),
        FRAME.convert_dtypes(dtype_backend="pyarrow"),
        pl.DataFrame(FRAME),
    ],
    ids=["sparse", "arrow columns", "polars"],
)
def test_containers_that_are_read(same):
    model = ARXRegressor(nk=15).fit(FRAME, OUTPUT)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        other = ARXRegressor(nk=15).fit(same, OUTPUT)
    np.testing.assert_array_equal(other.coef_, model.coef_)
    np.testing.assert_array_equal(other.predict(same), model.predict(FRAME))


TWICE = FRAME.set_axis(["e", "x", "x"], axis=1)
REFUSED = {
    "arrow table": (pa.Table.from_pandas(FRAME), TypeError, r"X is a Table.*X\.to_pandas\(\)"),
    "lazy frame": (pl.DataFrame(FRAME).lazy(), TypeError, r"X is a LazyFrame.*X\.collect\(\)"),
    "dict": (dict(FRAME), TypeError, r"X is a dict.*pandas\.DataFrame\(X\)"),
    "the same name twice": (TWICE, ValueError, "2 columns of X are called 'x'"),
    "no columns": (FRAME[[]], ValueError, "X has no columns"),
    "no rows": (FRAME[:0], ValueError, r"0 sample\(s\)"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_containers_that_are_refused(case):
    table, error, match = REFUSED[case]
    y = OUTPUT[: len(table)] if isinstance(table, pd.DataFrame) else OUTPUT
    model = ARXRegressor(nk=15).fit(FRAME, OUTPUT)
    for read in (
        lambda: ARXRegressor().fit(table, y),
        lambda: OperatorRegressor().fit(table, y),
        lambda: RecursiveARX().partial_fit(table, y),
        lambda: DelaySearchCV(ARXRegressor()).fit(table, y),
        lambda: EffectSearchCV(OperatorRegressor()).fit(table, y),
        lambda: Decimator(2).fit(table),
        lambda: model.predict(table),
        lambda: model.score(table, y),
    ):
        with pytest.raises(error, match=match):
            read()
    if case != "no rows":
        with pytest.raises(error, match=match):
            compare(model, table, y)
        with pytest.raises(error, match=match):
            check_channels(table, y)
        with pytest.raises(error, match=match):
            fourier_coefficients(table, y, forcing=[1.0])


# Sizes of values


def test_sizes_that_are_refused():
    model = clone(BATCH)
    with pytest.raises(ValueError, match=r"Column 0 of X holds values of 1e\+150, too large"):
        model.fit(np.where(ARRAY[7, 0] == ARRAY, 1e150, ARRAY), OUTPUT)
    with pytest.raises(ValueError, match=r"y holds values of .*e\+308, too large"):
        model.fit(ARRAY, OUTPUT / np.abs(OUTPUT).max() * 1e308)
    with pytest.raises(ValueError, match=r"Column 0 of X is never larger than .*e-10., too small"):
        model.fit(ARRAY * np.array([1e-100, 1, 1]), OUTPUT)
    with pytest.raises(ValueError, match=r"y is never larger than .*e-10., too small"):
        model.fit(ARRAY, OUTPUT * 1e-100)


def test_a_stream_may_fade_and_may_not_grow_too_large():
    one = RecursiveARX(init="zeros", p0=1)
    one.partial_fit(ARRAY[:, :1], OUTPUT).partial_fit(ARRAY[:5, :1] * 1e-60, OUTPUT[:5] * 1e-60)
    with pytest.raises(ValueError, match="Column 0 of X holds"):
        one.partial_fit(ARRAY[:5, :1] * 1e60, OUTPUT[:5])
    assert clone(one).partial_fit(ARRAY[:5, :1] * 1e-60, OUTPUT[:5]).n_updates_ == 3
