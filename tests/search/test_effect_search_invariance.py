"""The name does not depend on how rows are ordered, scaled, split or left out."""

import numpy as np
import pandas as pd
import pytest
from sklearn.model_selection import KFold
from support.open_loop import dead, recorded, searched

from skhoid import RunCutWarning

pytestmark = pytest.mark.slow


def test_splits_of_any_kind(hidden_data):
    rows = np.arange(len(hidden_data[0]))
    cv = [(rows[rows >= 2000], rows[rows < 2000]), (rows[rows < 4000], rows[rows >= 4000])]
    search = searched(hidden_data, ["dead_zone", "bias"], cv=cv)
    assert search.best_effects_ == ["dead_zone"]
    assert search.predictions_.notna().all().all()


def test_splits_that_cut_runs_are_told(hidden_data):
    with pytest.warns(RunCutWarning, match="cut run 1"):
        search = searched(hidden_data, ["dead_zone", "bias"], cv=KFold(4))
    assert search.best_effects_ == ["dead_zone"]


def test_a_single_run_is_cut_into_blocks():
    X, y = recorded(1, 90.0, inner=dead)
    search = searched((X, y), ["dead_zone", "bias", "saturation"])
    assert search.best_effects_ == ["dead_zone"]
    assert search.predictions_.notna().all().all()


def test_runs_in_another_order_give_the_same(hidden_data, found):
    X, y = hidden_data
    order = pd.concat([X.loc[[run]] for run in (3, 1, 2)])
    other = searched((order, y.loc[order.index]))
    assert other.best_effects_ == found.best_effects_
    np.testing.assert_allclose(
        other.error_path_[["vaf", "rmse"]], found.error_path_[["vaf", "rmse"]], rtol=1e-3
    )


def test_the_scale_of_the_signals_does_not_matter(hidden_data, found):
    X, y = hidden_data
    scaled = searched((20 * X, y / 50))
    assert scaled.best_effects_ == found.best_effects_
    np.testing.assert_allclose(scaled.error_path_["vaf"], found.error_path_["vaf"], atol=0.02)
    width = scaled.best_estimator_.parameters_.loc["dead_zone__width", "value"]
    expected = 20 * found.best_estimator_.parameters_.loc["dead_zone__width", "value"]
    assert width == pytest.approx(expected, rel=1e-3)


def test_missing_values_of_y(hidden_data, found):
    X, y = hidden_data
    y = y.copy()
    y.iloc[700:750] = np.nan
    search = searched((X, y))
    assert search.best_effects_ == found.best_effects_
    assert search.error_path_["vaf"].iloc[-1] == pytest.approx(
        found.error_path_["vaf"].iloc[-1], abs=0.5
    )
