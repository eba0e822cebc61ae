"""Averages over runs, and batch models of constant parts."""

import numpy as np
import pandas as pd
import pytest
from sklearn.pipeline import make_pipeline
from support.synthetic import NK, A, B, arx_runs, with_levels

from skhoid import (
    ARXRegressor,
    Decimator,
    DelayShift,
    RecursiveARX,
    RunIndexError,
    RunInTrimmer,
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


def test_remnant_falls():
    X, y, truth = make_tracking_runs(
        "C1", 16, remnant_intensity=0.2, random_state=0, return_truth=True
    )
    linear = pd.Series(truth.u_without_remnant.to_numpy().ravel(), index=y.index)
    _, y_mean = ensemble_average(X, y)
    _, linear_mean = ensemble_average(X, linear)
    ratio = (y_mean - linear_mean).var() / (y - linear).var()
    assert ratio == pytest.approx(1 / 16, rel=0.5)


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


def test_references_of_pipelines(adapting):
    X, y = adapting
    steps = (RunInTrimmer(10.0), Decimator(2), DelayShift(0.29))
    pipe = make_pipeline(*steps, RecursiveARX(memory_time=2.56))
    found = reference_fits(X, y, estimator=pipe, length=20.0)
    assert found.loc["ini", ["start", "stop"]].tolist() == pytest.approx([10.0, 30.0])
    fitted = reference_fits(X, y, estimator=pipe.fit(X, y), length=20.0)
    pd.testing.assert_frame_equal(found, fitted)
    np.testing.assert_allclose(found["tau_e"], 0.28)


def test_references_of_arrays_and_other_orders():
    X, y = arx_runs(n_runs=1, n_rows=4000, noise=0.01)
    estimator = ARXRegressor(2, 2, NK, dt=0.01)
    found = reference_fits(X[["e"]].to_numpy(), y.to_numpy(), estimator=estimator, length=15)
    np.testing.assert_allclose(found.loc["fin", ["a1", "a2", "b0", "b1"]], [*A, *B], rtol=0.01)
    three = reference_fits(X, y, estimator=RecursiveARX(3, 2, NK), length=15)
    assert "K_e" not in three
    assert list(reference_fits(X, y, ["ini"]).columns[:4]) == ["start", "stop", "a1", "sd_a1"]


def test_errors_of_references(adapting):
    X, y = adapting
    with pytest.raises(ValueError, match="'ini', 'fin' or"):
        reference_fits(X, y, ["middle"])
    with pytest.raises(TypeError, match="ARX model"):
        reference_fits(X, y, estimator=Decimator())
    with pytest.raises(ValueError, match=r"500-600.*nothing was measured"):
        reference_fits(X, y, (500, 600), estimator=RecursiveARX(nk=29))
    with pytest.raises(ValueError, match="length=100 s is longer"):
        reference_fits(X, y, "fin", estimator=RecursiveARX(nk=29), length=100)
