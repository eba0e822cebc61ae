"""Simulations are drawn as the data and the model say, and scored on what is shown."""

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import make_pipeline
from support.pictures import legend_texts

from skhoid import (
    ARXRegressor,
    Decimator,
    DelayShift,
    RunInTrimmer,
    make_tracking_runs,
    vaf_score,
)
from skhoid.plotting import SimulationDisplay, TrackingDisplay

DT = 0.05
N_ROWS = 100


def recording(runs, **attrs):
    rng = np.random.default_rng(0)
    index = pd.MultiIndex.from_product([runs, DT * np.arange(N_ROWS)], names=["run", "time"])
    e = np.cumsum(rng.standard_normal(len(index))) / 5
    u = 0.6 * np.r_[0.0, e[:-1]] + 0.05 * rng.standard_normal(len(index))
    y = pd.Series(u, index=index, name="u")
    y.attrs.update(attrs)
    return pd.DataFrame({"e": e}, index=index), y


@pytest.fixture
def data():
    return recording(["A", "B", "C"], units={"u": "deg"})


@pytest.fixture
def model(data):
    return ARXRegressor(na=1, nb=1, nk=1, initial="rest").fit(*data)


def titles(display):
    return [panel.get_title(loc="left") for panel in display.axes_[:, 0]]


def scores(vaf):
    return [f"{run}: VAF {v:.1f} %" for run, v in zip("ABC", vaf, strict=True)]


def test_lines_are_the_recording_the_simulation_and_their_difference(data, model):
    X, y = data
    display = SimulationDisplay.from_estimator(model, X, y)
    assert display.axes_.shape == (3, 2)
    prediction = pd.Series(model.predict(X), index=X.index)
    for i, run in enumerate("ABC"):
        measured, simulated = display.measured_[i], display.simulated_[i]
        assert measured.axes is simulated.axes is display.axes_[i, 0]
        np.testing.assert_array_equal(measured.get_xdata(), X.loc[run].index)
        np.testing.assert_array_equal(measured.get_ydata(), y.loc[run])
        np.testing.assert_array_equal(simulated.get_ydata(), prediction.loc[run])
        difference = y.loc[run] - prediction.loc[run]
        np.testing.assert_array_equal(display.residual_[i].get_ydata(), difference)
    assert titles(display) == scores(vaf_score(y, model.predict(X), average=None))
    assert display.ax_.get_ylabel() == "u, deg"
    assert legend_texts(display) == ["measured", "simulated", "residual"]


def test_missing_measurements_and_gaps_break_lines(data, model):
    X, y = data
    holey = y.copy()
    holey.iloc[30:40] = np.nan
    display = SimulationDisplay.from_estimator(model, X, holey, runs="A")
    for line in (*display.measured_, *display.residual_):
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(line.get_ydata())), range(30, 40))
    assert np.isfinite(display.simulated_[0].get_ydata()).all()
    assert "VAF 9" in titles(display)[0]
    keep = ~np.isin(np.arange(len(X)), range(50, 60))
    display = SimulationDisplay.from_estimator(model, X[keep], y[keep], runs="A")
    assert np.flatnonzero(np.isnan(display.simulated_[0].get_ydata())).tolist() == [50]
    assert titles(SimulationDisplay.from_predictions(0 * y, y))[0] == "A: VAF undefined"


def test_run_in_is_shaded_and_not_scored(data):
    X, y = data
    pipe = make_pipeline(RunInTrimmer(1.0), ARXRegressor(na=1, nb=1, nk=1)).fit(X, y)
    simulated = pipe.predict(X)
    for display in (
        SimulationDisplay.from_estimator(pipe, X, y),
        SimulationDisplay.from_estimator(pipe[-1], pipe[:-1].transform(X), y),
        SimulationDisplay.from_predictions(y, simulated, run_in=1.0),
    ):
        for panel in display.axes_.ravel():
            (patch,) = panel.patches
            np.testing.assert_allclose([patch.get_x(), patch.get_width()], [0.0, 1.0])
        assert titles(display) == scores(vaf_score(y, simulated, run_in=1.0, average=None))
        assert "run-in, not scored" in legend_texts(display)


@pytest.mark.parametrize("initial", ["rest", "estimate", None])
def test_its_title_has_the_score(initial, data):
    X, y = data
    arx = ARXRegressor(na=1, nb=1, nk=1, initial=initial).fit(X, y)
    only = X.loc[["B"]], y.loc[["B"]]
    display = SimulationDisplay.from_estimator(arx, *only)
    assert titles(display) == [f"B: VAF {arx.score(*only):.1f} %"]


def test_window_shows_and_scores_its_rows_only(data, model):
    X, y = data
    display = SimulationDisplay.from_estimator(model, X, y, runs="B", window=(1.0, 3.0))
    np.testing.assert_allclose(display.measured_[0].get_xdata(), np.arange(20, 60) * DT)
    expected = vaf_score(y.loc[["B"]], model.predict(X)[N_ROWS : 2 * N_ROWS], window=(1.0, 3.0))
    assert titles(display) == [f"B: VAF {expected:.1f} % from 1 to 3 s"]
    with pytest.raises(ValueError, match=r"Run 'A' has no row in the window \(50, 60\) s"):
        SimulationDisplay.from_estimator(model, X, y, window=(50, 60))


def test_decimated_pipeline_is_drawn_at_full_rate(data):
    X, y = data
    arx = ARXRegressor(na=1, nb=1, nk=0, initial="rest")
    pipe = make_pipeline(Decimator(2), DelayShift(DT), arx).fit(X, y)
    display = SimulationDisplay.from_estimator(pipe, X, y, runs="B")
    expected = pipe.predict(X)[N_ROWS : 2 * N_ROWS]
    np.testing.assert_array_equal(display.simulated_[0].get_ydata(), expected)


def test_many_runs_and_their_names():
    _, y = recording([f"r{i}" for i in range(7)])
    display = SimulationDisplay.from_predictions(y, 0.5 * y)
    assert list(display.traces) == ["r0", "r1", "r2", "r3", "r4"]
    assert "the first 5 of 7 runs" in display.axes_[-1, -1].get_xlabel()
    index = pd.MultiIndex.from_product(
        [["S1", "S2"], [1, 2], DT * np.arange(20)], names=["subject", "run", "time"]
    )
    y = pd.Series(np.sin(np.arange(80.0)), index=index, name="u")
    for chosen, names in ((2, ["S1/2", "S2/2"]), ("S2/1", ["S2/1"]), (("S1", 2), ["S1/2"])):
        assert list(SimulationDisplay.from_predictions(y, y, runs=chosen).traces) == names


def test_array_with_run_column_and_sampling_time_of_the_estimator(data, model):
    X, y = data
    array = np.column_stack([np.repeat([3, 4, 5], N_ROWS), X["e"]])
    rest = ARXRegressor(na=1, nb=1, nk=1, initial="rest", dt=DT, run=0)
    of_array = rest.fit(array, y.to_numpy())
    display = SimulationDisplay.from_estimator(of_array, array, y.to_numpy())
    assert list(display.traces) == ["run 3.0", "run 4.0", "run 5.0"]
    twin = SimulationDisplay.from_estimator(model, X, y)
    for one, other in zip(display.simulated_, twin.simulated_, strict=True):
        np.testing.assert_allclose(one.get_xydata(), other.get_xydata())


def test_what_cannot_be_drawn_is_refused(data):
    X, y = data
    with pytest.raises(NotFittedError):
        SimulationDisplay.from_estimator(ARXRegressor(), X, y)
    with pytest.raises(TypeError, match="needs a fitted estimator with a predict method; got dict"):
        SimulationDisplay.from_estimator({}, X, y)
    with pytest.raises(ValueError, match="There is no run 'Z'; the runs are"):
        SimulationDisplay.from_predictions(y, y, runs=["A", "Z"])


def test_signals_of_tracking_runs():
    X, y, truth = make_tracking_runs(
        "C4", n_runs=3, channels=["e", "x"], remnant_intensity=0.15, return_truth=True
    )
    display = TrackingDisplay.from_runs(X, y, truth=truth, window=(30.72, 51.2))
    labels = [panel.get_ylabel() for panel in display.axes_]
    assert labels == ["error e, deg", "output x, deg", "control u, deg"]
    time = display.lines_["e"].get_xdata()
    assert (time[0], time[-1]) == (30.72, 51.19)
    np.testing.assert_array_equal(display.lines_["e"].get_ydata(), X.loc[0, "e"].loc[time])
    others = [line for line in display.ax_.lines if line.get_color() == "#999999"]
    assert len(others) == 2
    drawn = {line.get_label(): line for line in display.axes_[-1].lines}
    expected = truth.u_without_remnant.loc[0].loc[time]
    np.testing.assert_array_equal(drawn["truth, without remnant"].get_ydata(), expected)
    np.testing.assert_allclose(drawn["change"].get_xdata()[0], 40.96, atol=0.02)
    with pytest.raises(ValueError, match="holds no sample"):
        TrackingDisplay.from_runs(X, y, window=(100, 110))
    with pytest.raises(ValueError, match="share their times"):
        TrackingDisplay.from_runs(X.iloc[:-1], y.iloc[:-1])
