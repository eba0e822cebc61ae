"""Splits and windows without sense, which the fuzz suite found."""

import numpy as np
import pytest
from support.synthetic import arx_runs

from skhoid import ARXRegressor, DelaySearchCV, OrderSearchCV, ShortRunError


@pytest.mark.parametrize(
    ("cv", "said"),
    [
        (["no such name"], "cv holds 'no such name', which is not a pair"),
        ([1], "cv holds 1, which is not a pair"),
        ([(range(9), range(9), 3)], "cv holds .*, which is not a pair"),
        (
            [(range(200), [10**9])],
            r"cv holds \[1000000000\]: rows must be whole numbers from 0 to "
            r"399",
        ),
        ([("a", range(9))], "cv holds 'a': rows must be"),
        ([([True, False], range(9))], r"cv holds \[True, False\]: rows must be .* or a mask"),
    ],
)
def test_splits_without_sense(cv, said):
    X, y = arx_runs(1, 400)
    with pytest.raises(ValueError, match=said):
        OrderSearchCV(ARXRegressor(), na=[1], nb=[1], nk=[1, 2], cv=cv).fit(X, y)


def test_a_window_of_data_without_known_lags():
    X, y = arx_runs(1, 3)
    X.iloc[0] = np.nan
    with pytest.raises(ShortRunError, match="0 rows are left"):
        DelaySearchCV(ARXRegressor(), nk=[0, 1], window=0.5).fit(X, y)
