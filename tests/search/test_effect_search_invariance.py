"""The name does not depend on how rows are ordered, scaled, split or left out."""

import numpy as np
import pandas as pd
import pytest
from sklearn.model_selection import KFold, LeaveOneGroupOut
from support.open_loop import RATE, dead, recorded, searched

from skhoid import EffectSearchCV, OperatorRegressor, RunCutWarning

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "cv",
    [3, "splits"],
    ids=["3", "splits"],
)
def test_cross_validation_of_any_kind(hidden_data, cv):
    X, y = hidden_data
    if cv == "splits":
        rows = np.arange(len(X))
        cv = [(rows[rows >= 2000], rows[rows < 2000]), (rows[rows < 4000], rows[rows >= 4000])]
    search = searched((X, y), ["dead_zone", "bias"], cv=cv)
    assert search.best_effects_ == ["dead_zone"]
    assert search.predictions_.notna().all().all()


def test_splits_that_cut_runs_are_told(hidden_data):
    with pytest.warns(RunCutWarning, match="cut run 1"):
        search = searched(hidden_data, ["dead_zone", "bias"], cv=KFold(4))
    assert search.best_effects_ == ["dead_zone"]


def test_leaving_out_groups_is_the_default_of_several_runs(hidden_data):
    default = searched(hidden_data, ["dead_zone"])
    explicit = searched(hidden_data, ["dead_zone"], cv=LeaveOneGroupOut())
    pd.testing.assert_frame_equal(default.predictions_, explicit.predictions_)


def test_a_single_run_is_cut_into_blocks():
    X, y = recorded(1, 90.0, inner=dead)
    search = searched((X, y), ["dead_zone", "bias", "saturation"])
    assert search.best_effects_ == ["dead_zone"]
    assert search.predictions_.notna().all().all()
    of_array = EffectSearchCV(
        OperatorRegressor(dt=1 / RATE), effects=["dead_zone", "bias", "saturation"]
    ).fit(X.to_numpy(), y.to_numpy())
    assert of_array.best_effects_ == ["dead_zone"]
    assert of_array.error_path_["vaf"].iloc[-1] == pytest.approx(
        search.error_path_["vaf"].iloc[-1], abs=1e-6
    )


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
