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
    check_channels,
    lost_control,
    performance_scores,
    resample_runs,
)

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


@pytest.mark.parametrize("model", [ARXRegressor, OperatorRegressor])
def test_the_run_column_is_no_input(model):
    with pytest.raises(ValueError, match="names 'e', which is the run column"):
        model(inputs=["e"], run=0).fit(X, Y)
