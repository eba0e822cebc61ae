"""``Decimator`` against its twins, its marks, and the way back to full rate."""

import numpy as np
import pandas as pd
import pytest
from sklearn.pipeline import make_pipeline
from support import naive
from support.synthetic import DT, arx_runs, kept_rows, run_time, signals, stretches_of

from skhoid import (
    ARXRegressor,
    Decimator,
    RunInTrimmer,
    make_tracking_runs,
)


@pytest.mark.parametrize("factor", [2, 7])
@pytest.mark.parametrize("lengths", [[61, 60, 97], [5, 64]])
@pytest.mark.parametrize("method", ["ideal", "downsample", "aggregate"])
def test_filters_against_their_twins(method, lengths, factor):
    X = signals(lengths)
    out = Decimator(factor, method=method, padding="periodic").fit_transform(X)
    twin = {"ideal": naive.brick_wall, "aggregate": naive.block_mean}.get(method, lambda s, _: s)
    for begin, end in stretches_of(X):
        for column in X:
            expected = twin(X[column].to_numpy()[begin:end], factor)
            np.testing.assert_allclose(out[column].to_numpy()[begin:end], expected, atol=1e-12)
    number = np.rint(X.index.get_level_values("time").to_numpy() / DT)
    np.testing.assert_array_equal(kept_rows(out), number % factor == 0)


def test_filters_cross_no_run_and_no_gap_and_no_end_of_the_run_in():
    X = signals([200, 200])
    for decimator in (
        Decimator(4),
        Decimator(4, padding="periodic"),
        Decimator(3, method="aggregate"),
    ):
        whole = decimator.fit_transform(X)
        np.testing.assert_array_equal(whole.loc[[2]], decimator.transform(X.loc[[2]]))
        gapped = X.drop(X.index[80:120])
        parts = [decimator.transform(X.iloc[part]) for part in (slice(80), slice(120, 200))]
        np.testing.assert_array_equal(decimator.transform(gapped).loc[[1]], pd.concat(parts))
        marked = RunInTrimmer(0.8).fit_transform(X)
        window = decimator.transform(marked).loc[1].iloc[80:]
        np.testing.assert_array_equal(window, decimator.transform(X.iloc[80:200]))


def test_nan_stay_where_they_are_and_do_not_spread():
    X = signals([200, 50])
    holed = X.copy()
    holed.iloc[[20, 21, 22], 0] = np.nan
    holed.iloc[200:, 1] = np.nan
    for decimator in (
        Decimator(4),
        Decimator(4, padding="periodic"),
        Decimator(4, method="aggregate"),
    ):
        out = decimator.fit_transform(holed)
        np.testing.assert_array_equal(out.isna(), holed.isna())
        bridged = X.copy()
        bridged.iloc[[20, 21, 22], 0] = np.interp([20, 21, 22], [19, 23], X.iloc[[19, 23], 0])
        expected = decimator.transform(bridged)
        known = holed.notna().to_numpy()
        np.testing.assert_allclose(out.to_numpy()[known], expected.to_numpy()[known], atol=1e-12)


def test_factor_one_leaves_container_and_index():
    X = signals([20, 30])
    out = Decimator().fit_transform(X)
    pd.testing.assert_frame_equal(out, X)
    array = X.to_numpy()
    np.testing.assert_array_equal(Decimator().fit_transform(array), array)
    assert isinstance(Decimator().fit_transform(array), np.ndarray)
    assert isinstance(Decimator(2).fit_transform(array), pd.DataFrame)
    assert list(Decimator(2).fit_transform(array).index.names)[:2] == ["run", "time"]


@pytest.mark.parametrize("method", ["ideal", "downsample", "aggregate"])
def test_y_is_filtered_and_thinned_as_x_is(method):
    X, y = arx_runs(lengths=[120, 97], smooth=1)
    thinner = Decimator(3, method=method, padding="periodic")
    pipe = make_pipeline(thinner, ARXRegressor(2, 2, 1)).fit(X, y)
    twin = {"ideal": naive.brick_wall, "aggregate": naive.block_mean}.get(method, lambda s, _: s)
    e, u, stretches = [], [], []
    for begin, end in stretches_of(X):
        at = sum(map(len, u))
        e.append(twin(X["e"].to_numpy()[begin:end], 3)[::3])
        u.append(twin(y.to_numpy()[begin:end], 3)[::3])
        stretches.append((at, at + len(u[-1])))
    phi, output, rows, _ = naive.regressor_rows(
        np.concatenate(u), np.concatenate(e)[:, None], stretches, 2, (2,), (1,)
    )
    theta = np.linalg.lstsq(phi, output, rcond=None)[0]
    np.testing.assert_allclose(pipe[-1].coef_, theta, rtol=1e-9)
    assert pipe[-1].n_rows_used_ == len(rows)
    assert pipe[-1].dt_ == pytest.approx(3 * DT)


@pytest.mark.parametrize("run_in", [2.0, 6.0])
def test_runs_that_are_no_whole_periods_give_the_same_model(run_in):
    """A filter that takes them for periods rings at their ends: b0 is a quarter smaller."""
    task = {"channels": ["e"], "sampling_rate": 200, "remnant_intensity": 0.08, "random_state": 70}
    X, y = make_tracking_runs("C1", 3, **task)
    whole, part = (
        make_pipeline(RunInTrimmer(leave_out), Decimator(4, padding=padding), ARXRegressor(nk=14))
        .fit(X, y)[-1]
        .coef_
        for leave_out, padding in ((None, "periodic"), (run_in, "odd"))
    )
    np.testing.assert_allclose(part, whole, rtol=0.02)
    assert Decimator().padding == "odd"


# The way back to full rate


def through(signal, factor, method="ideal", padding="periodic"):
    """Bring a signal to the kept rows and back: a model that passes its input on."""
    index = run_time([len(signal)])
    X = pd.DataFrame({"e": signal}, index=index)
    pipe = make_pipeline(Decimator(factor, method=method, padding=padding), ARXRegressor(0, 1, 0))
    return pipe.fit(X, signal).predict(X)


@pytest.mark.parametrize("factor", [2, 7])
@pytest.mark.parametrize("share", [0.1, 0.8])
def test_a_band_limited_signal_comes_back(factor, share):
    """Measured: 1.8e-3 of the amplitude up to 0.7, 3.6e-3 at 0.8 of the new Nyquist frequency."""
    n = 4096
    periods = round(share * n / (2 * factor))
    signal = np.sin(2 * np.pi * periods * np.arange(n) / n + 0.3)
    back = through(signal, factor)
    inside = slice(30 * factor, -30 * factor)
    assert np.abs(back - signal)[inside].max() < 4e-3
    assert np.abs(back - signal)[::factor].max() < 1e-3  # kept rows are nearly unchanged
