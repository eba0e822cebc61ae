"""Simulated runs as a dataset: the data convention, the truth behind it, and unstable loops."""

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    CompensatoryTask,
    HumanOperator,
    Multisine,
    Ramp,
    Remnant,
    make_tracking_runs,
    run_labels,
    sampling_time,
    tracking_condition,
)

ALL_CHANNELS = ["e", "x", "f_t", "dist"]


def make(condition="C1", n_runs=2, **options):
    """Runs of four seconds after two of run-in."""
    return make_tracking_runs(condition, n_runs, **({"duration": 4.0, "run_in": 2.0} | options))


# The data convention


@pytest.mark.parametrize("n_runs", [1, np.int64(2)])
@pytest.mark.parametrize("channels", [("x", "e"), ALL_CHANNELS])
def test_layout(n_runs, channels):
    X, y = make(n_runs=n_runs, channels=channels)
    assert isinstance(X, pd.DataFrame)
    assert isinstance(y, pd.Series)
    assert list(X.columns) == list(channels)
    assert X.shape == (400 * n_runs, len(channels))
    assert X.index.names == ["run", "time"]
    assert X.index.equals(y.index)
    assert y.name == "u"
    assert set(X.dtypes) == {np.dtype(float)}
    assert y.dtype == float
    assert list(X.index.unique("run")) == list(range(n_runs))
    time = X.loc[0].index.to_numpy()
    np.testing.assert_array_equal(time, np.arange(400) / 100)
    assert sampling_time(X) == pytest.approx(0.01)
    assert len(set(run_labels(X))) == n_runs


def test_channels_are_the_signals_of_the_task():
    disturbance = Multisine().interleaved(scale=0.02, random_state=0)
    options = {"disturbance": disturbance, "remnant_gain": 0.02, "random_state": 3}
    X, y = make(n_runs=10, channels=ALL_CHANNELS, **options)
    record = CompensatoryTask(
        disturbance=disturbance, remnant=Remnant(gain=0.02), duration=4.0, run_in=2.0
    ).simulate(10, random_state=3)
    for column, signal in (("e", record.e), ("x", record.x)):
        np.testing.assert_array_equal(X[column].to_numpy().reshape(10, -1), signal)
    for column, signal in (("f_t", record.f_t), ("dist", record.f_d)):
        found = X[column].to_numpy().reshape(10, -1)
        np.testing.assert_array_equal(found, np.repeat(signal, 10, axis=0))
    np.testing.assert_array_equal(y.to_numpy().reshape(10, -1), record.u)
    np.testing.assert_array_equal(X["e"], X["f_t"] - X["x"])
    np.testing.assert_allclose(X["dist"].loc[4].to_numpy(), disturbance(np.arange(400) / 100))


def test_the_default_is_the_measurement_window_after_seven_others():
    X, _ = make_tracking_runs(n_runs=1)
    assert X.shape == (8192, 1)
    assert X.index[-1] == (0, 81.91)
    assert np.var(X["e"]) / np.var(Multisine()(np.arange(8192) / 100)) == pytest.approx(
        0.17780685142128813,
        abs=1e-6,  # score.C1.montecarlo_100Hz
    )


# Run-in


def test_run_in_has_negative_times():
    X, y = make(keep_run_in=1.5, remnant_gain=0.02, random_state=0)
    window, u = make(remnant_gain=0.02, random_state=0)
    assert X.index[0] == (0, -1.5)
    assert len(X) == 2 * 550
    np.testing.assert_array_equal(X.loc[(slice(None), slice(0, None)), :], window)
    np.testing.assert_array_equal(y[X.index.get_level_values("time") >= 0], u)


# Options


def test_remnant_intensity_is_reached():
    """The mean of 40 ratios around that of ten others: sigma about 0.15 * 15 % / sqrt(10)."""
    _, y, truth = make_tracking_runs(
        "C1", 40, remnant_intensity=0.15, run_in=20.0, random_state=0, return_truth=True
    )
    ratios = truth.remnant.groupby(level="run").var() / y.groupby(level="run").var()
    assert ratios.mean() == pytest.approx(0.15, abs=4 * 0.15 * 0.15 / np.sqrt(10))


def test_adaptation_lag():
    """The operator changes later than the controlled element, and otherwise as before."""
    options = {"duration": 50.0, "run_in": 5.0, "return_truth": True, "n_runs": 1}
    prompt, late = (make("C4", adaptation_lag=lag, **options) for lag in (0.0, 4.0))
    parameters = late[2].parameters
    shifted = prompt[2].parameters[["K_e", "K_edot"]].shift(400).dropna()
    np.testing.assert_allclose(parameters[["K_e", "K_edot"]].iloc[400:], shifted, atol=1e-12)
    np.testing.assert_array_equal(parameters["K_c"], prompt[2].parameters["K_c"])
    np.testing.assert_array_equal(late[1].loc[0, :40.5], prompt[1].loc[0, :40.5])
    assert np.abs(late[1] - prompt[1]).max() > 0.01
    early = make("C4", adaptation_lag=-4.0, **options)[2].parameters
    np.testing.assert_allclose(
        early["K_e"].iloc[:-400], prompt[2].parameters["K_e"].iloc[400:], atol=1e-12
    )


def test_perturbation():
    """One thing is added to a parameter, in time, on top of the adaptation."""
    truth = make(
        "C3",
        perturbation={"K_e": -0.01, "zeta_nm": Ramp(0.0, 0.1, 1.0, 3.0)},
        adaptation_lag=1.0,
        return_truth=True,
    )[2]
    t = truth.parameters.index.to_numpy()
    plain = tracking_condition("C3").operator
    np.testing.assert_allclose(truth.parameters["K_e"], plain.K_e(t - 1.0) - 0.01)
    np.testing.assert_allclose(truth.parameters["zeta_nm"], 0.35 + Ramp(0, 0.1, 1, 3)(t))
    np.testing.assert_allclose(truth.parameters["K_edot"], plain.K_edot(t - 1.0))
    direct = make("C1", operator=HumanOperator(K_e=0.08, T_L=0.5))[1]
    added = make("C1", perturbation={"K_e": -0.01, "K_edot": lambda t: 0.004})[1]
    np.testing.assert_allclose(added, direct, rtol=0, atol=1e-14)


# The truth


# The design's example


def test_remnant_follows_an_operator_that_is_late():
    task = make_tracking_runs(
        "C4", 1, remnant_intensity=0.15, adaptation_lag=5.0, return_truth=True, random_state=0
    )[2].task
    prompt = make_tracking_runs("C4", 1, remnant_intensity=0.15, return_truth=True, random_state=0)[
        2
    ].task
    assert task.remnant.gain.time == pytest.approx(45.96)
    assert task.remnant.gain.initial == prompt.remnant.gain.initial
