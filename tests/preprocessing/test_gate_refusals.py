"""What the fuzz suite found at the gate, as plain cases."""

import datetime

import numpy as np
import pandas as pd
import polars as pl
import pytest

from skhoid import (
    ARXRegressor,
    DelayShift,
    OperatorRegressor,
    RecursiveARX,
    check_channels,
    lost_control,
    performance_scores,
    resample_runs,
    select_runs,
)
from skhoid.exceptions import IrregularSamplingError, MissingDataWarning, RunIndexError

INDEX = pd.MultiIndex.from_product([["a", "b"], 0.02 * np.arange(60)], names=["run", "time"])
RNG = np.random.default_rng(0)
X = pd.DataFrame(RNG.standard_normal((120, 3)), columns=["e", "x", "f_t"], index=INDEX)
Y = X["e"].rolling(3, min_periods=1).mean().rename("u")


@pytest.mark.parametrize("entry", [[1], pd.NaT, pd.NA, object, "1,5", "", 1j])
def test_an_entry_that_is_no_number_is_named(entry):
    table = X.astype(object)
    table.iloc[3, 1] = entry
    for call in (ARXRegressor().fit, check_channels, resample_runs):
        with pytest.raises(ValueError, match=r"column 'x' of X holds .* in row 3"):
            call(table, Y)


@pytest.mark.parametrize(
    ("entry", "error", "said"),
    [
        (
            datetime.datetime(2026, 1, 1),
            TypeError,
            r"Row 3 of X holds datetime.* in column 1; each",
        ),
        ({}, TypeError, r"Row 3 of X holds \{\} in column 1; each argument"),
        (10**400, ValueError, "Row 3 of X holds 1000.* in column 1; each argument"),
        ("one", ValueError, "Row 3 of X holds 'one' in column 1; each argument"),
        ([1.0, 2.0], ValueError, r"Row 3 of X holds \[1.0, 2.0\] in column 1; each argument"),
    ],
)
def test_an_entry_of_an_array_that_is_no_number_is_named(entry, error, said):
    table = X.to_numpy().tolist()
    table[3][1] = entry
    for model in (ARXRegressor(dt=0.02), DelayShift(0.1, dt=0.02)):
        with pytest.raises(error, match=said):
            model.fit(table, list(Y))


@pytest.mark.parametrize("entry", [1j, "one", np.datetime64("2026-01-01", "s")])
def test_masked_arrays_of_something_else_are_refused(entry):
    values = np.ma.masked_array([[entry]] * 9, mask=[[True]] + 8 * [[False]])
    for model in (ARXRegressor(), RecursiveARX(inputs=[0])):
        with pytest.raises((TypeError, ValueError), match="Row 1 of X holds"):
            model.fit(values, np.arange(9.0))


@pytest.mark.parametrize("bare", [pd.Series([b"a", 1.0]), pd.Series([1.0, 2.0, 3.0])])
def test_a_series_is_no_table(bare):
    for call in (ARXRegressor().fit, RecursiveARX().partial_fit):
        with pytest.raises(ValueError, match=r"X is a Series.*pass X.to_frame\(\)"):
            call(bare, np.ones(len(bare)))


def test_a_row_of_an_entry_alone():
    with pytest.raises(ValueError, match="Row 1 of X holds 'two' in column 0"):
        ARXRegressor().fit(["1", "two", "3"], [1.0, 2.0, 3.0])


def test_a_number_is_no_table():
    for bare in (np.array(1.0), np.array(1.0, dtype=object)):
        with pytest.raises(ValueError, match="Expected 2D array"):
            ARXRegressor().fit(bare, [1.0])


def test_rows_of_different_lengths():
    with pytest.raises(ValueError, match="Row 2 of X holds 1 values but row 0 holds 2"):
        ARXRegressor().fit([[1.0, 2.0], [1.0, 2.0], [3.0]], [1.0, 2.0, 3.0])


def test_times_are_no_channel():
    table = X.assign(x=pd.to_timedelta(np.arange(120), unit="s"))
    with pytest.raises(ValueError, match="column 'x' of X holds times"):
        ARXRegressor().fit(table, Y)


@pytest.mark.parametrize("kind", [object, str, "Int64", "boolean"])
def test_numbers_of_other_kinds_are_checked_too(kind):
    table = X.round().astype("int64").astype(kind) if kind != "boolean" else (X > 0).astype(kind)
    for call in (check_channels, performance_scores):
        call(table, Y, **({"windows": "T_m"} if call is performance_scores else {}))
    assert len(lost_control(table)) == 0


@pytest.mark.parametrize("kind", ["string", "string[pyarrow]"])
def test_text_with_a_gap_is_a_number_with_a_gap(kind):
    text = X.assign(e=X["e"].astype(str).astype(kind))
    text.iloc[7, 0] = pd.NA
    numbers = X.copy()
    numbers.iloc[7, 0] = np.nan
    with pytest.warns(MissingDataWarning):
        found, expected = (ARXRegressor().fit(table, Y).coef_ for table in (text, numbers))
    np.testing.assert_array_equal(found, expected)
    shifted = [DelayShift(0.1).fit_transform(table)["e"] for table in (text, numbers)]
    pd.testing.assert_series_equal(*shifted)
    output = Y.astype(str).astype(kind)
    output.iloc[7] = pd.NA
    with pytest.warns(MissingDataWarning):
        found, expected = (ARXRegressor().fit(X, y).coef_ for y in (output, output.astype(float)))
    np.testing.assert_array_equal(found, expected)


def test_labels_that_are_none():
    table = X.reset_index(drop=True).assign(run=[[1]] * 60 + [2] * 60)
    for call in (
        ARXRegressor(run="run", dt=0.02).fit,
        lambda X, y: check_channels(X, y, run="run"),
    ):
        with pytest.raises(
            RunIndexError, match=r"column 'run' is \[1\] in row 0: labels must be numbers"
        ):
            call(table, Y.to_numpy())
    table["run"] = [1.0] * 60 + [np.nan] * 60
    with pytest.raises(RunIndexError, match="column 'run' is missing in row 60"):
        ARXRegressor(run="run", dt=0.02).fit(table, Y.to_numpy())


def test_text_of_other_frames_is_named():
    table = pl.from_pandas(X.reset_index(drop=True)).with_columns(x=pl.lit("1,5"))
    with pytest.raises(ValueError, match="The column 'x' of X holds '1,5' in row 0, which is not"):
        ARXRegressor().fit(table, Y.to_numpy())


def test_infinities_of_both_signs():
    endless = X.assign(e=np.where(X["e"] > 0, np.inf, -np.inf))
    with pytest.raises(ValueError, match=r"X contains infinity .*, first in column 'e', row 0"):
        ARXRegressor().fit(endless, Y)
    plain = X.reset_index(drop=True)
    plain.iloc[7] = -np.inf
    for table, column in ((plain, "'e'"), (plain.to_numpy(), 0), (pl.from_pandas(plain), "'e'")):
        with pytest.raises(ValueError, match=f"X contains infinity .*column {column}, row 7"):
            ARXRegressor().fit(table, Y.to_numpy())
    endless = Y.where(Y < 1, np.inf)
    row = int(np.flatnonzero(np.isinf(endless))[0])
    for call in (ARXRegressor().fit, check_channels, performance_scores):
        with pytest.raises(ValueError, match=f"Input y contains infinity .* in row {row}"):
            call(X, endless)
    with pytest.raises(ValueError, match=r"Input X contains infinity .* in column 'f_t', row 0"):
        lost_control(X.assign(f_t=-np.inf))


def test_an_output_of_no_or_other_rows():
    for call in (ARXRegressor().fit, resample_runs, lambda X, y: select_runs(X, y, last=1)):
        with pytest.raises(ValueError, match="inconsistent numbers of samples"):
            call(X, Y[:0])
    assert len(select_runs(X, list(Y), last=1)[1]) == 60


def test_an_output_that_names_a_column_twice():
    with pytest.raises(ValueError, match="2 columns of y are called 'u'"):
        ARXRegressor().fit(X, pd.concat([Y, Y], axis=1))


def test_structured_arrays():
    with pytest.raises(TypeError, match=r"pass pandas.DataFrame\(X\)"):
        ARXRegressor().fit(np.rec.fromarrays([X["e"], X["x"]]), Y.to_numpy())
    with pytest.raises(TypeError, match="pass one of its fields"):
        ARXRegressor().fit(X.to_numpy(), np.rec.fromarrays([Y]))
    shown = memoryview(X.to_numpy().astype("V8"))
    with pytest.raises(TypeError, match=r"pass pandas.DataFrame\(X\), or a plain array"):
        ARXRegressor().fit(shown, Y.to_numpy())
    with pytest.raises(TypeError, match="pass one of its fields"):
        ARXRegressor().fit(X.to_numpy(), shown)


def test_memoryviews_are_read():
    model = ARXRegressor().fit(memoryview(X.to_numpy()), memoryview(Y.to_numpy()))
    np.testing.assert_array_equal(model.coef_, ARXRegressor().fit(X.to_numpy(), Y.to_numpy()).coef_)


@pytest.mark.parametrize("model", [ARXRegressor, OperatorRegressor])
def test_the_run_column_is_no_input(model):
    with pytest.raises(ValueError, match="names 'e', which is the run column"):
        model(inputs=["e"], run=0).fit(X, Y)


@pytest.mark.parametrize("name", ["inputs", "init", "reset_times", "memory_time"])
@pytest.mark.parametrize("value", ["no such word", {}])
def test_options_that_are_no_numbers(name, value):
    with pytest.raises((ValueError, TypeError), match=rf"{name}|memory must be a number"):
        RecursiveARX(**{"inputs": [0], name: value}).fit(X, Y)


def test_resampling_needs_the_labels_of_all_runs():
    labels = ["a"] * 60 + [None] * 60
    index = pd.MultiIndex.from_arrays([labels, INDEX.get_level_values("time")], names=INDEX.names)
    with pytest.raises(RunIndexError, match="Row 60 has no label"):
        resample_runs(X.set_axis(index))
    with pytest.raises(IrregularSamplingError, match="at least two rows"):
        resample_runs(X[:0])
