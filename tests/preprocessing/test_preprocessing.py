"""Decimator, DelayShift and RunInTrimmer: twins, the way back to full rate, the thesis."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, MinMaxScaler, StandardScaler
from support import closed_loop as cl
from support import naive
from support.synthetic import DT, arx_runs, as_table, run_time, stretches_of

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    DelayShift,
    OrderSearchCV,
    RunIndexError,
    RunInTrimmer,
    ShortRunError,
    resample_runs,
    vaf_score,
)
from skhoid.preprocessing.run_in import run_in_rows
from skhoid.runs import read_layout


def signals(lengths, seed=0, n_columns=2):
    rng = np.random.default_rng(seed)
    index = run_time(lengths)
    return pd.DataFrame(rng.standard_normal((len(index), n_columns)), index, ["e", "x"][:n_columns])


def kept_rows(marked):
    (level,) = [name for name in marked.index.names if name.startswith("decimation")]
    return marked.index.get_level_values(level).to_numpy(dtype=bool)


# Decimator


@pytest.mark.parametrize("factor", [2, 3, 5, 7, 8])
@pytest.mark.parametrize("lengths", [[60], [61, 60, 97], [5, 64]])
@pytest.mark.parametrize("method", ["ideal", "downsample", "aggregate"])
def test_filters_against_their_twins(method, lengths, factor):
    X = signals(lengths)
    out = Decimator(factor, method=method).fit_transform(X)
    twin = {"ideal": naive.brick_wall, "aggregate": naive.block_mean}.get(method, lambda s, _: s)
    for begin, end in stretches_of(X):
        for column in X:
            expected = twin(X[column].to_numpy()[begin:end], factor)
            np.testing.assert_allclose(out[column].to_numpy()[begin:end], expected, atol=1e-12)
    number = np.rint(X.index.get_level_values("time").to_numpy() / DT)
    np.testing.assert_array_equal(kept_rows(out), number % factor == 0)


@pytest.mark.parametrize("factor", [2, 3, 7])
@pytest.mark.parametrize("n_rows", [1, 2, 40, 1000, 1001])
def test_odd_padding_against_its_twin(n_rows, factor):
    """The ideal filter, of the run reflected about its end points by 50 rows of the new grid."""
    X = signals([n_rows], n_columns=1)
    e = X["e"].to_numpy()
    margin = min(n_rows - 1, 50 * factor)
    before = [2 * e[0] - e[i] for i in range(margin, 0, -1)]
    after = [2 * e[-1] - e[n_rows - 1 - i] for i in range(1, margin + 1)]
    expected = naive.brick_wall(np.array([*before, *e, *after]), factor)[margin : margin + n_rows]
    found = Decimator(factor, padding="odd", dt=DT).fit_transform(X)["e"]
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_odd_padding_does_not_ring_on_a_ramp():
    X = signals([400], n_columns=1)
    X["e"] = np.linspace(0.0, 10.0, 400)
    error = {
        padding: np.abs(Decimator(4, padding=padding).fit_transform(X)["e"] - X["e"]).max()
        for padding in ("periodic", "odd")
    }
    assert error["odd"] < 0.2
    assert error["periodic"] > 3


def test_filters_cross_no_run_and_no_gap_and_no_end_of_the_run_in():
    X = signals([200, 200])
    for decimator in (Decimator(4), Decimator(4, padding="odd"), Decimator(3, method="aggregate")):
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
    for decimator in (Decimator(4), Decimator(4, padding="odd"), Decimator(4, method="aggregate")):
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


def test_the_mark_carries_factor_and_method_and_ends():
    X = signals([20, 30])
    for factor, method, padding in ((2, "ideal", "odd"), (3, "aggregate", "periodic")):
        out = Decimator(factor, method=method, padding=padding).fit_transform(X)
        assert out.index.names[-1] == f"decimation 1/{factor} {method} {padding}"


def test_marks_survive_sklearn_transformers_with_pandas_output():
    X, y = arx_runs(smooth=2)
    direct = make_pipeline(Decimator(2), DelayShift(0.03), ARXRegressor()).fit(X, y)
    for scaler in (StandardScaler(), MinMaxScaler(), FunctionTransformer()):
        pipe = make_pipeline(RunInTrimmer(0.1), Decimator(2), scaler, DelayShift(0.03),
                             ARXRegressor(2, 2, fit_intercept=True))  # fmt: skip
        pipe.set_output(transform="pandas").fit(X, y)
        assert pipe[-1].dt_ == 2 * DT
        assert pipe.predict(X).shape == (len(X),)
    pipe = make_pipeline(
        Decimator(2), FunctionTransformer(lambda Z: 2 * Z), DelayShift(0.03), ARXRegressor()
    ).fit(X, y)
    np.testing.assert_allclose(pipe[-1].a_, direct[-1].a_, rtol=1e-9)
    np.testing.assert_allclose(2 * pipe[-1].b_, direct[-1].b_, rtol=1e-9)


@pytest.mark.parametrize("method", ["ideal", "downsample", "aggregate"])
def test_y_is_filtered_and_thinned_as_x_is(method):
    X, y = arx_runs(lengths=[120, 97], smooth=1)
    pipe = make_pipeline(Decimator(3, method=method), ARXRegressor(2, 2, 1)).fit(X, y)
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


# The way back to full rate


def through(signal, factor, method="ideal", padding="periodic"):
    """Bring a signal to the kept rows and back: a model that passes its input on."""
    index = run_time([len(signal)])
    X = pd.DataFrame({"e": signal}, index=index)
    pipe = make_pipeline(Decimator(factor, method=method, padding=padding), ARXRegressor(0, 1, 0))
    return pipe.fit(X, signal).predict(X)


@pytest.mark.parametrize("factor", [2, 3, 4, 7, 16])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_a_band_limited_signal_comes_back(factor, share):
    """Measured: 1.8e-3 of the amplitude up to 0.7, 3.6e-3 at 0.8 of the new Nyquist frequency."""
    n = 4096
    periods = round(share * n / (2 * factor))
    signal = np.sin(2 * np.pi * periods * np.arange(n) / n + 0.3)
    back = through(signal, factor)
    inside = slice(30 * factor, -30 * factor)
    assert np.abs(back - signal)[inside].max() < 4e-3
    assert np.abs(back - signal)[::factor].max() < 1e-3  # kept rows are nearly unchanged


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_the_target_of_the_thesis_comes_back(factor):
    signal = cl.target(8192)
    back = through(signal, factor)
    power = np.mean(signal**2)
    # The rows after the last kept one are extrapolated, by less than a step of the new grid.
    assert np.mean((back - signal)[: -10 * factor] ** 2) / power < 1e-5
    assert np.mean((back - signal) ** 2) / power < 1e-4


def test_linear_interpolation_would_be_worse():
    n, factor = 4096, 8
    t = np.arange(n)
    signal = np.sin(2 * np.pi * 64 * t / n)  # a quarter of the new Nyquist frequency
    linear = np.interp(t, t[::factor], signal[::factor])
    inside = slice(300, -300)
    band_limited = through(signal, factor)
    assert np.abs(linear - signal)[inside].max() > 20 * np.abs(band_limited - signal)[inside].max()


@pytest.mark.parametrize("factor", [2, 3, 4, 5])
def test_a_block_mean_belongs_to_the_middle_of_its_block(factor):
    """A mean over d rows lies (d - 1)/2 rows after the first: a ramp comes back where it was."""
    n = 2000
    slow = np.sin(2 * np.pi * 5 * np.arange(n) / n)
    back = through(slow, factor, method="aggregate")
    inside = slice(100, -100)
    assert np.abs(back - slow)[inside].max() < 3e-3
    half_a_row_off = np.sin(2 * np.pi * 5 * (np.arange(n) + 0.5) / n)
    assert np.abs(half_a_row_off - slow).max() > 5e-3


def test_short_runs_and_rows_without_kept_ones():
    X, y = arx_runs(seed=3, smooth=1)
    pipe = make_pipeline(Decimator(4), ARXRegressor(1, 1, 1)).fit(X, y)
    for rows in (slice(0, 1), slice(1, 4), slice(0, 5), slice(117, 120)):
        assert np.isfinite(pipe.predict(X.iloc[rows])).all()


# DelayShift


@settings(max_examples=40, deadline=None)
@given(
    shift=st.integers(0, 12),
    lengths=st.lists(st.integers(1, 10), min_size=1, max_size=4),
    seed=st.integers(0, 99),
)
def test_delay_shift_against_its_twin(shift, lengths, seed):
    X = signals(lengths, seed)
    step = DelayShift(shift * DT, inputs=["e"], dt=DT)
    if shift >= min(lengths):
        with pytest.raises(ShortRunError, match="is longer than run"):
            step.fit(X)
        return
    out = step.fit_transform(X)
    twin = naive.delay(X["e"].to_numpy(), shift, stretches_of(X))
    np.testing.assert_array_equal(out["e"], twin)
    np.testing.assert_array_equal(out["x"], X["x"])
    assert step.n_samples_ == shift


@pytest.mark.parametrize(
    ("delay", "dt", "samples"),
    [
        (0.29, 0.01, 29),  # 28.999999999999996 in floating point
        (0.57, 0.01, 57),
        (0.1 + 0.2, 0.1, 3),
        (0.28 + 1 / 60, 1 / 60, 18),
        (1e-9, 0.01, 0),
        (0.2949, 0.01, 29),
        (0.2951, 0.01, 30),
    ],
)
def test_seconds_to_samples(delay, dt, samples):
    X = pd.DataFrame({"e": np.arange(80.0)}, index=run_time([80], dt=dt))
    step = DelayShift(delay).fit(X)
    assert step.n_samples_ == samples
    assert step.delay_ == pytest.approx(samples * dt)
    np.testing.assert_array_equal(step.transform(X)["e"].to_numpy()[samples:],
                                  np.arange(80.0 - samples))  # fmt: skip


def test_the_shift_stops_at_gaps_but_not_at_the_end_of_the_run_in():
    X = signals([100])
    gapped = X.drop(X.index[40:50])
    out = DelayShift(0.05).fit_transform(gapped)["e"].to_numpy()
    np.testing.assert_array_equal(out, naive.delay(gapped["e"].to_numpy(), 5, [(0, 40), (40, 90)]))
    trimmed = make_pipeline(RunInTrimmer(0.3), DelayShift(0.05)).fit_transform(X)["e"]
    np.testing.assert_array_equal(trimmed.to_numpy()[5:], X["e"].to_numpy()[:-5])


def test_the_default_channel_is_the_error():
    X = signals([30]).rename(columns={"x": "f_t"})
    out = DelayShift(0.02).fit_transform(X)
    assert out["e"].isna().sum() == 2
    assert out["f_t"].isna().sum() == 0
    by_role = DelayShift(0.02, roles={"f_t": "e", "e": "x"}).fit_transform(X)
    assert by_role["f_t"].isna().sum() == 2
    assert by_role["e"].isna().sum() == 0
    assert DelayShift(0.02).fit_transform(X.rename(columns={"e": "p"})).isna().sum().tolist() == [
        2,
        2,
    ]


@pytest.mark.parametrize("factor", [2, 4, 8, 16])
def test_shift_first_then_thin(factor):
    """Section III-D: the first shifted sample used has the offset ceil(n_k / d) d - n_k."""
    X = as_table(cl.simulate("C1", periods=1))[0]
    for steps in ((DelayShift(0.29), Decimator(factor, method="downsample")),
                  (Decimator(factor, method="downsample"), DelayShift(0.29))):  # fmt: skip
        out = make_pipeline(*steps).fit_transform(X)
        thinned = out["e"].to_numpy()[kept_rows(out)]
        first = int(np.flatnonzero(~np.isnan(thinned))[0])
        offset = int(np.ceil(29 / factor)) * factor - 29
        expected = X["e"].to_numpy()[offset::factor][: len(thinned) - first]
        np.testing.assert_array_equal(thinned[first:], expected)


# RunInTrimmer


@settings(max_examples=40, deadline=None)
@given(
    lengths=st.lists(st.integers(5, 30), min_size=1, max_size=4),
    samples=st.integers(0, 4),
    keep=st.booleans(),
)
def test_run_in_is_marked_run_by_run(lengths, samples, keep):
    X = signals(lengths)
    seconds = samples * DT
    step = RunInTrimmer(measurement_time=max(seconds, DT)) if keep else RunInTrimmer(seconds)
    marked = step.fit_transform(X).index.get_level_values("run-in").to_numpy(dtype=bool)
    expected = [
        row >= n - max(samples, 1) if keep else row >= samples for n in lengths for row in range(n)
    ]
    np.testing.assert_array_equal(~marked, expected)


def test_the_simulation_restarts_after_the_run_in_with_zero_output_and_real_past_inputs():
    X, y = arx_runs(2, 120, seed=5)
    pipe = make_pipeline(RunInTrimmer(0.5), ARXRegressor(2, 2, 3)).fit(X, y)
    model = pipe[-1]
    stretches = [(0, 50), (50, 120), (120, 170), (170, 240)]
    e = X[["e"]].to_numpy()
    twin = naive.free_run(e, stretches, model.a_, [model.b_], (3,), past=[0, 0, 120, 120])
    np.testing.assert_allclose(pipe.predict(X), twin, rtol=1e-10, atol=1e-12)
    # First kept row: no output before it, but the inputs 3 and 4 samples before it.
    expected = model.b_ @ e[[47, 46], 0]
    assert pipe.predict(X)[50] == pytest.approx(expected, rel=1e-12)
    assert pipe.predict(X)[120] == 0.0
    # The fit uses rows of the window whose lags lie in the window.
    phi, output, rows, _ = naive.regressor_rows(y.to_numpy(), e, stretches[1::2], 2, (2,), (3,))
    assert model.n_rows_used_ == len(rows)
    np.testing.assert_allclose(model.coef_, np.linalg.lstsq(phi, output, rcond=None)[0], rtol=1e-9)


def test_one_step_predictions_use_the_real_past_of_the_window():
    X, y = arx_runs(1, 120, seed=5)
    pipe = make_pipeline(RunInTrimmer(0.5), ARXRegressor(2, 2, 3)).fit(X, y)
    model = pipe[-1]
    ahead = model.predict_ahead(pipe[:-1].transform(X), y, 2)
    e = X[["e"]].to_numpy()
    twin = naive.predict_ahead(y.to_numpy(), e, [(0, 120)], model.a_, [model.b_], (3,), horizon=2)
    np.testing.assert_allclose(ahead, twin, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("samples", [7, 14, 28, 29, 57, 58])
def test_a_run_in_of_whole_samples_is_that_many(samples):
    """0.07 / 0.01 is 7.000000000000001 and 0.29 / 0.01 is 28.999999999999996."""
    X = signals([100])
    for step in (RunInTrimmer(samples / 100), RunInTrimmer(measurement_time=1 - samples / 100)):
        marked = step.fit_transform(X).index.get_level_values("run-in").to_numpy(dtype=bool)
        np.testing.assert_array_equal(marked, np.arange(100) < samples)


def test_a_window_shorter_than_a_sample():
    with pytest.raises(ValueError, match="measurement_time"):
        RunInTrimmer(measurement_time=0.001).fit_transform(signals([50]))


@pytest.mark.parametrize("name", ["run_in", "measurement_time"])
@pytest.mark.parametrize("seconds", [-1, np.nan, np.inf])
def test_a_time_that_is_none_is_refused(name, seconds):
    layout = read_layout(signals([50]), dt=DT)
    with pytest.raises(ValueError, match=f"{name} is a time in seconds, not negative; got"):
        run_in_rows(layout, **{name: seconds})


def test_order_search_trims_before_it_decimates():
    X, y = arx_runs(smooth=1)
    pipe = make_pipeline(RunInTrimmer(0.3), ARXRegressor(2, 2, 1))
    best = OrderSearchCV(pipe, na=[2], nb=[2], factor=[2]).fit(X, y).best_estimator_
    expected = make_pipeline(RunInTrimmer(0.3), Decimator(2), ARXRegressor(2, 2, 1)).fit(X, y)
    np.testing.assert_allclose(best[-1].coef_, expected[-1].coef_, rtol=1e-9)


def test_decimating_twice_is_refused():
    X = signals([50])
    with pytest.raises(RunIndexError, match="factor=6"):
        make_pipeline(Decimator(2), Decimator(3)).fit(X)


# The thesis's figures


@pytest.fixture(scope="module")
def monte_carlo_recording():
    return as_table(cl.simulate("C1"))


def test_where_the_free_run_starts():
    """99.9553 % from the start of the window, 98.9605 % from its middle (Chapter 5)."""
    X, y = as_table(cl.simulate("C1", periods=10, interpolated_delay=True))
    X, y = X.iloc[-8192:], y.iloc[-8192:]
    model = ARXRegressor(nk=28).fit(X[:4096], y[:4096])
    from_start = vaf_score(y[4096:], model.predict(X)[4096:])
    from_middle = vaf_score(y[4096:], model.predict(X[4096:]))
    assert from_start == pytest.approx(99.95525751609223, abs=1e-9)  # arx2228.C1.vaf_remnant_free
    assert from_middle == pytest.approx(98.9605, abs=5e-5)
    search = OrderSearchCV(ARXRegressor(nk=28), na=[2], nb=[2]).fit(X, y)
    assert search.best_score_ == pytest.approx(from_start, abs=1e-9)


def test_remnant_free_delay_after_decimation(monte_carlo_recording):
    """tau_e and the ZOH sample on each grid: 29 at 100 Hz, 15 at 50 Hz (nk_star.remnant_free)."""
    X, y = (table.iloc[-8192:] for table in monte_carlo_recording)
    thinned = make_pipeline(Decimator(2, method="downsample"), ARXRegressor())
    assert DelaySearchCV(thinned, nk=range(5, 25)).fit(X, y).best_nk_ == 15


def test_phase_of_times_on_half_samples_does_not_depend_on_the_slice():
    X = signals([60], 0)
    time = X.index.get_level_values("time") + DT / 2
    X.index = pd.MultiIndex.from_arrays(
        [X.index.get_level_values("run"), time], names=["run", "time"]
    )
    whole = Decimator(3).fit_transform(X).index.get_level_values(-1).to_numpy()
    for start in range(7):
        part = Decimator(3).fit_transform(X.iloc[start:]).index.get_level_values(-1).to_numpy()
        np.testing.assert_array_equal(part, whole[start:])


def test_holes_keep_their_width_whatever_the_clock_reads():
    widths = []
    for start in (0.0, 1000.0, 1.7e9):
        values = np.sin(np.arange(200.0))
        values[80:100] = np.nan
        index = pd.MultiIndex.from_product(
            [[1], start + DT * np.arange(200)], names=["run", "time"]
        )
        regular, _ = resample_runs(pd.DataFrame({"e": values}, index=index), values, dt=DT)
        widths.append(int(regular["e"].isna().sum()))
    assert widths == [20, 20, 20]


def test_the_run_column_survives_other_transformers():
    X, y = arx_runs()
    array = np.column_stack([X.index.get_level_values("run"), X.to_numpy()])
    scaler = StandardScaler().set_output(transform="pandas")
    pipe = make_pipeline(Decimator(2, dt=DT, run=0), scaler, ARXRegressor(1, 1, 1))
    assert pipe.fit(array, y.to_numpy())[-1].inputs_ == ["x1", "x2"]
