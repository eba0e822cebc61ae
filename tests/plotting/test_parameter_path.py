import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from support.synthetic import DT, NK, A, B, arx_runs

from skhoid import (
    ARXRegressor,
    DelayShift,
    RecursiveARX,
    make_tracking_runs,
    run_labels,
)
from skhoid.plotting import ParametersDisplay

pytestmark = pytest.mark.slow  # fits, and compiles

NAMES = ["a1", "a2", "b0", "b1"]
TRUE = [*A, *B]
RECURSIVE = RecursiveARX(nk=NK, forgetting=0.98, init="zeros")


@pytest.fixture(scope="module")
def data():
    return arx_runs(3, 300)


@pytest.fixture(scope="module")
def model(data):
    return clone(RECURSIVE).set_params(store_covariance=True).fit(*data)


@pytest.fixture(scope="module")
def average(data):
    return clone(RECURSIVE).set_params(combine="average_estimates").fit(*data)


def path(n=100, **columns):
    """Parameters over time as the constructor takes them."""
    values = dict(zip(NAMES, TRUE, strict=True)) | columns
    return pd.DataFrame(values, index=pd.Index(DT * np.arange(n), name="time"))


def windows(**columns):
    table = {"start": [0.0, 2.0], "stop": [1.0, 3.0], "a1": [-1.4, -1.6], "sd_a1": [0.1, np.nan]}
    return pd.DataFrame(table | columns, index=["ini", "fin"])


def legend_of(display):
    (legend,) = display.figure_.legends
    return [text.get_text() for text in legend.get_texts()]


def test_lines_are_the_path(model):
    display = ParametersDisplay.from_estimator(model)
    assert display.names_ == NAMES
    for i, name in enumerate(NAMES):
        line = display.lines_["estimate", name]
        assert line.axes is display.axes_[i]
        np.testing.assert_array_equal(line.get_xdata(), model.time_path_)
        np.testing.assert_array_equal(line.get_ydata(), model.coef_path_[:, i])
    assert [panel.get_ylabel() for panel in display.axes_] == [
        "$a_{1}$",
        "$a_{2}$",
        "$b_{0}$",
        "$b_{1}$",
    ]
    assert display.axes_[-1].get_xlabel() == "time, s"
    assert display.axes_[0].get_xlim() == (0.0, model.time_path_[-1])


def test_band_is_one_standard_deviation(data, model):
    display = ParametersDisplay.from_estimator(model)
    at, i = 200, 2
    corners = display.bands_["estimate", NAMES[i]].get_paths()[0].vertices
    there = corners[np.isclose(corners[:, 0], model.time_path_[at]), 1]
    value, deviation = model.coef_path_[at, i], np.sqrt(model.covariance_path_[at, i, i])
    np.testing.assert_allclose([there.min(), there.max()], [value - deviation, value + deviation])
    assert legend_of(display) == ["estimate", "± 1 standard deviation"]
    without = ParametersDisplay.from_estimator(clone(RECURSIVE).fit(*data))
    assert without.bands_ == {}


def test_single_runs_are_thin_under_their_mean(average):
    display = ParametersDisplay.from_estimator(average)
    for i, name in enumerate(NAMES):
        mean, thin = display.lines_["estimate", name], display.run_lines_["estimate", name]
        np.testing.assert_array_equal(mean.get_ydata(), average.coef_path_[:, i])
        assert len(thin) == 3
        for run, line in enumerate(thin):
            np.testing.assert_array_equal(line.get_ydata(), average.coef_paths_[run, :, i])
            assert line.get_linewidth() < mean.get_linewidth()
            assert line.get_zorder() < mean.get_zorder()
    assert legend_of(display) == ["estimate", "single runs"]


def test_many_runs_are_a_band():
    X, y = arx_runs(11, 100)
    short = y.groupby(level="run").cumcount() < 60
    keep = (run_labels(X) != 11) | short.to_numpy()  # the last run ends before the others
    model = clone(RECURSIVE).set_params(combine="average_estimates").fit(X[keep], y[keep])
    display = ParametersDisplay.from_estimator({"mean": model})
    assert display.run_lines_ == {}
    for at, n in ((50, 11), (80, 10)):
        estimates = model.coef_paths_[:n, at, 0]
        value, deviation = model.coef_path_[at, 0], estimates.std(ddof=1)
        corners = display.bands_["mean", "a1"].get_paths()[0].vertices
        there = corners[np.isclose(corners[:, 0], DT * at), 1]
        expected = [value - deviation, value + deviation]
        np.testing.assert_allclose([there.min(), there.max()], expected)
    assert legend_of(display) == ["mean", "± 1 standard deviation over 11 runs"]


def test_several_models_and_a_batch_level(data, model):
    batch = ARXRegressor(nk=NK).fit(*data)
    display = ParametersDisplay.from_estimator({"recursive": model, "batch": batch})
    line = display.lines_["batch", "b0"]
    np.testing.assert_array_equal(line.get_ydata(), np.repeat(batch.coef_[2], 2))
    np.testing.assert_array_equal(line.get_xdata(), [0.0, model.time_path_[-1]])
    assert line.get_linestyle() == "--"
    assert line.get_color() != display.lines_["recursive", "b0"].get_color()


def test_pipelines_are_taken_apart(data):
    pipeline = make_pipeline(DelayShift(delay=NK * DT), RecursiveARX(init="zeros")).fit(*data)
    display = ParametersDisplay.from_estimator(pipeline)
    expected = pipeline[-1].coef_path_[:, 3]
    np.testing.assert_array_equal(display.lines_["estimate", "b1"].get_ydata(), expected)


def test_many_parameters_stand_in_two_columns(data):
    model = RecursiveARX(na=3, nb=2, nk=NK, inputs=["e", "x"], init="zeros").fit(*data)
    display = ParametersDisplay.from_estimator(model)
    assert display.names_[3:] == ["b0(e)", "b1(e)", "b0(x)", "b1(x)"]
    assert display.axes_[3].get_ylabel() == "$b_{0}$ (e)"
    columns = [panel.get_subplotspec().colspan.start for panel in display.axes_]
    assert columns == [0, 0, 0, 1, 1, 1, 1]
    display.figure_.canvas.draw()
    bottom = [panel for panel in display.axes_ if panel.get_xlabel()]
    assert bottom == [display.axes_[2], display.axes_[6]]
    for panel in display.axes_:
        assert panel.xaxis.get_tick_params()["labelbottom"] == (panel in bottom)
    many_inputs = RecursiveARX(na=1, nb=4, nk=NK, inputs=["e", "x"], init="zeros").fit(*data)
    display = ParametersDisplay.from_estimator(many_inputs)
    columns = [panel.get_subplotspec().colspan.start for panel in display.axes_]
    assert columns == [0] * 5 + [1] * 4


def test_truth_over_time(model):
    time = np.linspace(0, 3, 7)
    truth = pd.DataFrame({"b0": 1 + time, "K_e": time}, index=time)
    display = ParametersDisplay.from_estimator(model, truth)
    assert list(display.truth_) == ["b0"]
    np.testing.assert_array_equal(display.truth_["b0"].get_xdata(), time)
    np.testing.assert_array_equal(display.truth_["b0"].get_ydata(), 1 + time)
    values = np.cumsum(np.ones((300, 4)), axis=0)
    display = ParametersDisplay.from_estimator(model, values)
    np.testing.assert_array_equal(display.truth_["b1"].get_xdata(), model.time_path_)
    np.testing.assert_array_equal(display.truth_["b1"].get_ydata(), values[:, 3])


def test_truth_of_a_simulation():
    X, y, truth = make_tracking_runs("C4", n_runs=1, return_truth=True)
    model = RecursiveARX(nk=truth.nk).fit(X, y)
    display = ParametersDisplay.from_estimator(model, truth)
    np.testing.assert_array_equal(display.truth_["b1"].get_ydata(), truth.arx_parameters["b1"])
    slow = RecursiveARX(nk=15, dt=0.02).fit(X.to_numpy()[::2], y.to_numpy()[::2])
    with pytest.raises(ValueError, match=r"hold at steps of 0.01 s, and the model 'estimate' has"):
        ParametersDisplay.from_estimator(slow, truth)
    del truth["arx_parameters"]
    with pytest.raises(ValueError, match="no true ARX parameters"):
        ParametersDisplay.from_estimator(model, truth)


def test_references_are_levels_over_their_windows(data, model):
    references = windows()
    display = ParametersDisplay.from_estimator(model, references=references)
    assert list(display.references_) == [("ini", "a1"), ("fin", "a1")]
    line = display.references_["ini", "a1"]
    np.testing.assert_array_equal(line.get_xydata(), [[0.0, -1.4], [1.0, -1.4]])
    assert line.get_color() != display.lines_["estimate", "a1"].get_color()
    corners = np.concatenate(
        [band.get_paths()[0].vertices for band in display.axes_[0].collections]
    )
    assert np.isclose(corners, [1.0, -1.3]).all(axis=1).any()
    assert legend_of(display)[-1] == "batch ± 1 standard deviation"


def test_limits_hold_truth_but_not_the_start():
    start = np.r_[1e3, -1e3, np.full(98, -1.5)]
    display = ParametersDisplay(
        frames={"estimate": path(a1=start)}, truth=pd.DataFrame({"a1": [-1.9]})
    ).plot()
    low, high = display.axes_[0].get_ylim()
    assert -2.0 < low < -1.9
    assert -1.5 < high < -1.4
    assert display.notes_["a1"].get_text() == "2 of 100 outside"
    assert list(display.notes_) == ["a1"]


def test_limits_hold_all_estimates_where_none_is_far_away():
    noisy = np.random.default_rng(0).standard_normal(1000)
    display = ParametersDisplay(frames={"estimate": path(1000, a1=noisy)}).plot()
    low, high = display.axes_[0].get_ylim()
    assert low < noisy.min() < noisy.max() < high
    assert display.notes_ == {}


def test_stretches_without_estimates():
    gap = np.where(np.arange(100) % 30 < 10, np.nan, -1.5)
    runs = np.tile(path()[NAMES].to_numpy(), (2, 1, 1))
    runs[1, 50:] = np.nan
    display = ParametersDisplay(
        frames={"one": path(a1=gap, a2=np.nan), "two": path()}, runs={"two": runs}
    ).plot()
    np.testing.assert_array_equal(display.lines_["one", "a1"].get_ydata(), gap)
    np.testing.assert_array_equal(display.run_lines_["two", "a1"][1].get_ydata(), runs[1, :, 0])
    display.figure_.canvas.draw()


def test_refusals(data, model):
    batch = ARXRegressor(nk=NK).fit(*data)
    with pytest.raises(NotFittedError):
        ParametersDisplay.from_estimator(RecursiveARX())
    with pytest.raises(ValueError, match="no model here has a path"):
        ParametersDisplay.from_estimator(batch)
    with pytest.raises(TypeError, match=r"draws fitted ARX models.*got LinearRegression"):
        ParametersDisplay.from_estimator(LinearRegression().fit(*data))
    with pytest.raises(TypeError, match="got str"):
        ParametersDisplay.from_estimator("model")
    with pytest.raises(ValueError, match=r"truth has none of the columns a1, a2, b0, b1; it has c"):
        ParametersDisplay.from_estimator(model, {"c": 1.0})
    with pytest.raises(ValueError, match=r"a row for each of 300 instants, or one.*\(7, 4\)"):
        ParametersDisplay.from_estimator(model, np.ones((7, 4)))
    with pytest.raises(TypeError, match="result of reference_fits; got dict"):
        ParametersDisplay.from_estimator(model, references={})
    with pytest.raises(ValueError, match="no column 'stop'"):
        ParametersDisplay.from_estimator(model, references=windows().drop(columns="stop"))
    with pytest.raises(ValueError, match="has none of the columns a1, a2, b0, b1"):
        ParametersDisplay.from_estimator(model, references=windows().drop(columns="a1"))
