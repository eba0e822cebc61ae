"""Averages over runs, and batch models of constant parts."""

import numpy as np
import pandas as pd
import pytest
from support.synthetic import arx_runs, with_levels

from skhoid import (
    ARXRegressor,
    Decimator,
    RecursiveARX,
    RunIndexError,
    ensemble_average,
    make_tracking_runs,
    operator_parameters,
    reference_fits,
)


def test_mean_of_equal_runs():
    X, y = arx_runs(n_runs=3)
    X_mean, y_mean = ensemble_average(X, y)
    of_run = [X.loc[run].to_numpy() for run in (1, 2, 3)]
    np.testing.assert_allclose(X_mean, np.mean(of_run, axis=0), rtol=1e-12)
    np.testing.assert_allclose(y_mean, y.groupby(level="time").mean(), rtol=1e-12)
    assert X_mean.index.equals(y_mean.index)
    assert list(X_mean.index.names) == ["run", "time"]
    assert X_mean.index.get_level_values("run").unique().tolist() == ["mean"]
    assert y_mean.name == "u"
    assert list(X_mean.columns) == ["e", "x"]


def test_common_instants_missing_values_and_outer_levels():
    X, y = arx_runs(lengths=[100, 80, 90])
    y.iloc[5] = np.nan
    X_mean, y_mean = ensemble_average(X, y.to_numpy())
    assert len(X_mean) == 80
    assert y_mean.iloc[5] == pytest.approx((y.loc[2].iloc[5] + y.loc[3].iloc[5]) / 2)
    two = [with_levels(table, subject=["A"] * 180 + ["B"] * 90) for table in (X, y)]
    X_two, y_two = ensemble_average(*two)
    assert X_two.index.names == two[0].index.names
    pd.testing.assert_series_equal(
        y_two.xs("B", level="subject").droplevel("run"), y.loc[3], check_names=False
    )
    assert len(y_two) == 80 + 90


def test_errors_of_the_average():
    X, y = arx_runs(n_runs=2)
    with pytest.raises(RunIndexError, match="'run' and 'time'"):
        ensemble_average(X.to_numpy(), y.to_numpy())
    late = pd.concat([X.loc[[1]], with_levels(X.loc[[2]], time=5 + 0.01 * np.arange(120))])
    with pytest.raises(RunIndexError, match="no instant in common"):
        ensemble_average(late, y.to_numpy())
    with pytest.raises(RunIndexError, match="Decimator"):
        ensemble_average(Decimator(2).fit_transform(X), y)
    with pytest.raises(ValueError, match="different targets f_t"):
        ensemble_average(X.assign(f_t=X["e"]), y)


@pytest.fixture(scope="module")
def adapting():
    return make_tracking_runs("C4", 2, remnant_intensity=0.1, random_state=1)


def test_references_are_batch_models_of_the_windows(adapting):
    X, y = adapting
    found = reference_fits(X, y, ["ini", (60, 70), "fin"], estimator=RecursiveARX(nk=29))
    assert found.index.tolist() == ["ini", "60-70", "fin"]
    assert found[["start", "stop"]].to_numpy().ravel() == pytest.approx(
        [0, 30.72, 60, 70, 51.2, 81.92]
    )
    time = X.index.get_level_values("time")
    for _, row in found.iterrows():
        inside = (time >= row["start"] - 1e-6) & (time < row["stop"] - 1e-6)
        masked = y.where(inside)
        with pytest.warns(UserWarning, match="NaN"):
            model = ARXRegressor(nk=29).fit(X, masked)
        names = found.attrs["parameter_names"]
        np.testing.assert_allclose(row[names].to_numpy(dtype=float), model.coef_)
        deviations = row[[f"sd_{name}" for name in names]].to_numpy(dtype=float)
        np.testing.assert_allclose(deviations, model.standard_errors_)
        operator = operator_parameters(model).iloc[0]
        assert row["K_edot"] == pytest.approx(operator["K_edot"])
        assert row["sd_omega_nm"] == pytest.approx(operator["sd_omega_nm"])
