import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from support.pictures import legend_texts

from skhoid import (
    ARXRegressor,
    Decimator,
    DelayShift,
    RunInTrimmer,
    VAFScorer,
    run_labels,
    vaf_score,
)
from skhoid.plotting import SimulationDisplay

N_ROWS = 120
DT = 0.05


def recording(runs, rng=0, **attrs):
    rng = np.random.default_rng(rng)
    index = pd.MultiIndex.from_product([runs, DT * np.arange(N_ROWS)], names=["run", "time"])
    e = np.cumsum(rng.standard_normal(len(index))) / 5
    u = 0.6 * np.r_[0.0, e[:-1]] + 0.05 * rng.standard_normal(len(index))
    y = pd.Series(u, index=index, name="u")
    y.attrs.update(attrs)
    return pd.DataFrame({"e": e}, index=index), y


@pytest.fixture
def data():
    return recording(["A", "B", "C"], units={"u": "deg"})


def test_lines_are_the_recording_the_simulation_and_their_difference(data):
    X, y = data
    model = ARXRegressor(na=1, nb=1, nk=1).fit(X, y)
    display = SimulationDisplay.from_estimator(model, X, y)
    assert display.axes_.shape == (3, 2)
    assert display.figure_ is display.ax_.figure
    prediction = pd.Series(model.predict(X), index=X.index)
    for i, run in enumerate("ABC"):
        measured, simulated = display.measured_[i], display.simulated_[i]
        assert measured.axes is simulated.axes is display.axes_[i, 0]
        np.testing.assert_array_equal(measured.get_xdata(), X.loc[run].index)
        np.testing.assert_array_equal(measured.get_ydata(), y.loc[run])
        np.testing.assert_array_equal(simulated.get_ydata(), prediction.loc[run])
        residual = display.residual_[i]
        assert residual.axes is display.axes_[i, 1]
        np.testing.assert_array_equal(residual.get_ydata(), y.loc[run] - prediction.loc[run])
        assert display.axes_[i, 0].get_xlim() == display.axes_[i, 1].get_xlim()


def test_titles_and_labels_name_run_vaf_and_unit(data):
    X, y = data
    model = ARXRegressor(na=1, nb=1, nk=1).fit(X, y)
    display = SimulationDisplay.from_estimator(model, X, y)
    vaf = vaf_score(y, model.predict(X), average=None)
    np.testing.assert_allclose(display.vaf, vaf)
    titles = [panel.get_title(loc="left") for panel in display.axes_[:, 0]]
    assert titles == [f"{run}: VAF {v:.1f} %" for run, v in zip("ABC", vaf, strict=True)]
    assert display.ax_.get_ylabel() == "u, deg"
    assert display.axes_[0, 1].get_ylabel() == "residual, deg"
    assert display.axes_[-1, -1].get_xlabel() == "time, s"
    assert legend_texts(display) == ["measured", "simulated", "residual"]


def test_missing_measurement_is_a_gap_but_the_simulation_goes_on(data):
    X, y = data
    model = ARXRegressor(na=1, nb=1, nk=1).fit(X, y)
    holey = y.copy()
    holey.iloc[30:40] = np.nan
    display = SimulationDisplay.from_estimator(model, X, holey, runs="A")
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(display.measured_[0].get_ydata())), range(30, 40)
    )
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(display.residual_[0].get_ydata())), range(30, 40)
    )
    assert np.isfinite(display.simulated_[0].get_ydata()).all()
    assert np.isfinite(display.vaf).all()


def test_gap_in_the_recording_breaks_the_lines(data):
    X, y = data
    keep = np.ones(len(X), dtype=bool)
    keep[50:60] = False
    X, y = X[keep], y[keep]
    model = ARXRegressor(na=1, nb=1, nk=1).fit(X, y)
    display = SimulationDisplay.from_estimator(model, X, y, runs="A")
    assert len(display.time[0]) == N_ROWS - 10
    assert np.flatnonzero(np.isnan(display.simulated_[0].get_ydata())).tolist() == [50]


def test_undefined_vaf_is_said():
    _, y = recording(["A"])
    display = SimulationDisplay.from_predictions(0.0 * y, y)
    assert display.ax_.get_title(loc="left") == "A: VAF undefined"


def test_run_in_is_shaded_and_not_scored(data):
    X, y = data
    pipe = make_pipeline(RunInTrimmer(1.0), ARXRegressor(na=1, nb=1, nk=1)).fit(X, y)
    display = SimulationDisplay.from_estimator(pipe, X, y)
    np.testing.assert_allclose(display.run_in_end, 1.0)
    for panel in display.axes_.ravel():
        (patch,) = panel.patches
        np.testing.assert_allclose([patch.get_x(), patch.get_x() + patch.get_width()], [0.0, 1.0])
    np.testing.assert_allclose(display.vaf, vaf_score(y, pipe.predict(X), run_in=1.0, average=None))
    assert VAFScorer()(pipe, X, y) == pytest.approx(vaf_score(y, pipe.predict(X), run_in=1.0))
    assert set(legend_texts(display)) >= {"measured", "simulated", "run-in, not scored"}


def test_marked_table_and_argument_shade_the_same_run_in(data):
    X, y = data
    marked = RunInTrimmer(1.0).fit_transform(X)
    model = ARXRegressor(na=1, nb=1, nk=1).fit(marked, y)
    by_mark = SimulationDisplay.from_estimator(model, marked, y)
    by_argument = SimulationDisplay.from_predictions(y, model.predict(marked), run_in=1.0)
    np.testing.assert_allclose(by_mark.run_in_end, by_argument.run_in_end)
    np.testing.assert_allclose(by_mark.vaf, by_argument.vaf)


def test_window_shows_and_scores_its_rows_only(data):
    X, y = data
    model = ARXRegressor(na=1, nb=1, nk=1).fit(X, y)
    display = SimulationDisplay.from_estimator(model, X, y, runs="B", window=(1.0, 3.0))
    time = display.measured_[0].get_xdata()
    np.testing.assert_allclose(time, np.arange(20, 60) * DT)
    expected = vaf_score(y.loc[["B"]], model.predict(X)[N_ROWS : 2 * N_ROWS], window=(1.0, 3.0))
    assert display.vaf[0] == pytest.approx(expected)
    assert display.ax_.get_title(loc="left").endswith("% from 1 to 3 s")
    with pytest.raises(ValueError, match=r"Run 'A' has no row in the window \(50, 60\) s"):
        SimulationDisplay.from_estimator(model, X, y, window=(50, 60))


def test_decimated_pipeline_and_search_are_drawn_at_full_rate(data):
    X, y = data
    pipe = make_pipeline(
        Decimator(2, padding="odd"), DelayShift(DT), ARXRegressor(na=1, nb=1, nk=0)
    )
    search = GridSearchCV(
        pipe, {"decimator__factor": [2, 3]}, scoring=VAFScorer(), cv=LeaveOneGroupOut()
    ).fit(X, y, groups=run_labels(X))
    display = SimulationDisplay.from_estimator(search, X, y)
    assert [line.get_xdata().size for line in display.simulated_] == [N_ROWS] * 3
    np.testing.assert_array_equal(
        display.simulated_[1].get_ydata(), search.predict(X)[N_ROWS : 2 * N_ROWS]
    )


def test_many_runs_show_the_first_five_and_say_so():
    _, y = recording([f"r{i}" for i in range(7)])
    display = SimulationDisplay.from_predictions(y, 0.5 * y)
    assert display.runs == ["r0", "r1", "r2", "r3", "r4"]
    assert "the first 5 of 7 runs" in display.axes_[-1, -1].get_xlabel()
    display = SimulationDisplay.from_predictions(y, 0.5 * y, runs=[f"r{i}" for i in range(1, 7)])
    assert len(display.runs) == 6
    assert display.axes_[-1, -1].get_xlabel() == "time, s"


def test_runs_of_several_subjects_are_named_in_full():
    index = pd.MultiIndex.from_product(
        [["S1", "S2"], [1, 2], DT * np.arange(20)], names=["subject", "run", "time"]
    )
    y = pd.Series(np.sin(np.arange(80.0)), index=index, name="u")
    assert SimulationDisplay.from_predictions(y, y).runs == ["S1/1", "S1/2", "S2/1", "S2/2"]
    assert SimulationDisplay.from_predictions(y, y, runs=2).runs == ["S1/2", "S2/2"]
    assert SimulationDisplay.from_predictions(y, y, runs="S2/1").runs == ["S2/1"]
    assert SimulationDisplay.from_predictions(y, y, runs=("S1", 2)).runs == ["S1/2"]


def test_array_with_run_column_and_sampling_time_of_the_estimator(data):
    X, y = data
    array = np.column_stack([np.repeat([3, 4, 5], N_ROWS), X["e"]])
    model = ARXRegressor(na=1, nb=1, nk=1, dt=DT, run=0).fit(array, y.to_numpy())
    display = SimulationDisplay.from_estimator(model, array, y.to_numpy())
    frame = ARXRegressor(na=1, nb=1, nk=1).fit(X, y)
    twin = SimulationDisplay.from_estimator(frame, X, y)
    assert display.runs == ["run 3.0", "run 4.0", "run 5.0"]
    np.testing.assert_allclose(display.vaf, twin.vaf)
    np.testing.assert_allclose(display.time[2], twin.time[2])
    labels = np.repeat(["a", "b", "c"], N_ROWS)
    again = SimulationDisplay.from_predictions(
        y.to_numpy(), model.predict(array), run=labels, dt=DT
    )
    assert again.runs == ["a", "b", "c"]
    np.testing.assert_allclose(again.vaf, twin.vaf)


def test_errors_are_clear(data):
    X, y = data
    with pytest.raises(NotFittedError):
        SimulationDisplay.from_estimator(ARXRegressor(), X, y)
    with pytest.raises(TypeError, match="needs a fitted estimator with a predict method; got dict"):
        SimulationDisplay.from_estimator({}, X, y)
    with pytest.raises(ValueError, match="There is no run 'Z'; the runs are"):
        SimulationDisplay.from_predictions(y, y, runs=["A", "Z"])
    with pytest.raises(ValueError, match="runs is empty"):
        SimulationDisplay.from_predictions(y, y, runs=[])
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        SimulationDisplay.from_predictions(y, y[:-1])
