"""Parameters over time, of one model and of many runs."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from support.pictures import legend_texts
from support.synthetic import DT, NK, A, B, arx_runs

from skhoid import ARXRegressor, DelayShift, HumanOperator, RecursiveARX, Sigmoid
from skhoid.plotting import EnsembleDisplay, ParametersDisplay

ARX = ["a1", "a2", "b0", "b1"]
PANELS = ["K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"]
CHANGING = HumanOperator(
    K_e=Sigmoid(0.09, 0.07, rate=0.5, time=40), K_edot=Sigmoid(0.036, 0.084, rate=0.5, time=40)
)


@pytest.fixture(scope="module")
def data():
    return arx_runs(3, 300)


@pytest.fixture(scope="module")
def model(data):
    recursive = RecursiveARX(nk=NK, forgetting=0.98, init="zeros", store_covariance=True)
    return recursive.fit(*data)


def path(n=100, **columns):
    values = dict(zip(ARX, [*A, *B], strict=True)) | columns
    return pd.DataFrame(values, index=pd.Index(DT * np.arange(n), name="time"))


def table(time=None, **columns):
    """Parameters as operator_parameters returns them."""
    values = {"K_e": 0.09, "T_L": 0.4, "K_edot": 0.036, "tau_e": 0.28}
    values |= {"omega_nm": 11.0, "zeta_nm": 0.35, "sd_K_e": 0.01, "sd_tau_e": np.nan} | columns
    index = pd.Index([0] if time is None else time, name=None if time is None else "time")
    return pd.DataFrame(values, index=index)


def drawn(panel, label):
    """Data of the lines of a label."""
    return [line.get_xydata() for line in panel.lines if line.get_label() == label]


def notes(panel):
    return [text.get_text() for text in panel.texts]


def band_at(band, x):
    corners = band.get_paths()[0].vertices
    there = corners[np.isclose(corners[:, 0], x), 1]
    return [there.min(), there.max()]


def test_lines_and_bands_are_path_and_deviation(model):
    display = ParametersDisplay.from_estimator(model)
    assert display.names_ == ARX
    for i, name in enumerate(ARX):
        line = display.lines_["estimate", name]
        assert line.axes is display.axes_[i]
        np.testing.assert_array_equal(line.get_xdata(), model.time_path_)
        np.testing.assert_array_equal(line.get_ydata(), model.coef_path_[:, i])
    value, deviation = model.coef_path_[200, 2], np.sqrt(model.covariance_path_[200, 2, 2])
    found = band_at(display.bands_["estimate", "b0"], model.time_path_[200])
    np.testing.assert_allclose(found, [value - deviation, value + deviation])
    assert legend_texts(display) == ["estimate", "± 1 standard deviation"]
    assert display.axes_[2].get_ylabel() == "$b_{0}$"


def test_single_runs_a_batch_level_and_a_pipeline(data):
    settings = {"nk": NK, "forgetting": 0.98, "init": "zeros"}
    average = RecursiveARX(combine="average_estimates", **settings).fit(*data)
    batch = ARXRegressor(nk=NK).fit(*data)
    display = ParametersDisplay.from_estimator({"mean": average, "batch": batch})
    thin = [line for line in display.axes_[0].lines if line.get_linewidth() < 1]
    for line, expected in zip(thin, average.coef_paths_[:, :, 0], strict=True):
        np.testing.assert_array_equal(line.get_ydata(), expected)
    level = display.lines_["batch", "b0"]
    np.testing.assert_array_equal(level.get_ydata(), np.repeat(batch.coef_[2], 2))
    np.testing.assert_array_equal(level.get_xdata(), average.time_path_[[0, -1]])
    pipeline = make_pipeline(DelayShift(delay=NK * DT), RecursiveARX(init="zeros")).fit(*data)
    display = ParametersDisplay.from_estimator(pipeline)
    expected = pipeline[-1].coef_path_[:, 3]
    np.testing.assert_array_equal(display.lines_["estimate", "b1"].get_ydata(), expected)


def test_many_parameters_stand_in_two_columns(data):
    model = RecursiveARX(na=3, nb=2, nk=NK, inputs=["e", "x"], init="zeros").fit(*data)
    display = ParametersDisplay.from_estimator(model)
    assert display.names_[3:] == ["b0(e)", "b1(e)", "b0(x)", "b1(x)"]
    columns = [panel.get_subplotspec().colspan.start for panel in display.axes_]
    assert columns == [0, 0, 0, 1, 1, 1, 1]
    assert [panel for panel in display.axes_ if panel.get_xlabel()] == [*display.axes_[[2, 6]]]


def test_truth_and_references(model):
    time = np.linspace(0, 3, 7)
    truth = pd.DataFrame({"b0": 1 + time, "K_e": time}, index=time)
    windows = pd.DataFrame(
        {"start": [0.0, 2.0], "stop": [1.0, 3.0], "a1": [-1.4, -1.6], "sd_a1": [0.1, np.nan]}
    )
    display = ParametersDisplay.from_estimator(model, truth, windows)
    (true,) = drawn(display.axes_[2], "truth")
    np.testing.assert_array_equal(true, np.c_[time, 1 + time])
    first, second = drawn(display.axes_[0], "batch ± 1 standard deviation")
    np.testing.assert_array_equal(first, [[0.0, -1.4], [1.0, -1.4]])
    np.testing.assert_array_equal(second, [[2.0, -1.6], [3.0, -1.6]])


def test_true_parameters_of_a_simulation_hold_at_its_rate(model):
    truth = SimpleNamespace(task=SimpleNamespace(sampling_rate=1 / DT), arx_parameters=path())
    display = ParametersDisplay.from_estimator(model, truth)
    np.testing.assert_array_equal(drawn(display.axes_[3], "truth")[0][:, 1], B[1])
    truth.task.sampling_rate = 1000.0
    with pytest.raises(ValueError, match=r"hold at steps of 0.001 s, and the model 'estimate'"):
        ParametersDisplay.from_estimator(model, truth)


def test_limits_hold_truth_but_not_the_start():
    start = np.r_[1e3, -1e3, np.full(98, -1.5)]
    display = ParametersDisplay(
        frames={"estimate": path(a1=start)}, truth=pd.DataFrame({"a1": [-1.9]})
    ).plot()
    low, high = display.axes_[0].get_ylim()
    assert -2.0 < low < -1.9
    assert -1.5 < high < -1.4
    assert notes(display.axes_[0]) == ["2 of 100 outside"]
    noisy = np.random.default_rng(0).standard_normal(1000)
    panel = ParametersDisplay(frames={"estimate": path(1000, a1=noisy)}).plot().axes_[0]
    low, high = panel.get_ylim()
    assert low < noisy.min() < noisy.max() < high
    assert notes(panel) == []


def test_operator_over_time_with_its_functions_as_truth():
    time = np.linspace(0, 80, 41)
    K_e, K_edot = CHANGING.gains(time)
    frame = table(time, K_e=K_e, K_edot=K_edot, T_L=K_edot / K_e, zeta_nm=np.nan)
    display = ParametersDisplay.from_frame(frame, truth=CHANGING)
    assert display.names_ == PANELS
    np.testing.assert_array_equal(display.lines_["estimate", "T_L"].get_ydata(), frame["T_L"])
    assert display.axes_[1].get_ylabel() == "$T_L$, s"
    assert display.axes_[0].get_title() == r"$\tau_e$ = 0.28 s"
    (true,) = drawn(display.axes_[0], "truth")
    assert np.diff(true[:, 0]).max() < 0.1  # a step stays one between estimates
    np.testing.assert_allclose(true[np.searchsorted(true[:, 0], time), 1], K_e)


def test_batch_models_are_points():
    frames = {"a": table(), "b": table(K_e=np.nan), "c": table(K_e=0.1, sd_K_e=0.02, tau_e=0.3)}
    display = ParametersDisplay.from_frame(frames, truth=HumanOperator())
    assert display.names_ == [*PANELS, "tau_e"]  # which differs
    np.testing.assert_array_equal(display.lines_["c", "K_e"].get_xydata(), [[2, 0.1]])
    (bar,) = display.bands_["c", "K_e"].get_segments()
    np.testing.assert_allclose(bar[:, 1], [0.08, 0.12])
    assert [tick.get_text() for tick in display.axes_[-1].get_xticklabels()] == ["a", "b", "c"]
    assert notes(display.axes_[0]) == ["none"]
    with pytest.raises(ValueError, match=r"truth=operator\.at\(t\)"):
        ParametersDisplay.from_frame(table(), truth=CHANGING)


def test_what_cannot_be_drawn_is_refused(data, model):
    with pytest.raises(ValueError, match="no model here has a path"):
        ParametersDisplay.from_estimator(ARXRegressor(nk=NK).fit(*data))
    with pytest.raises(TypeError, match=r"draws fitted ARX models.*got LinearRegression"):
        ParametersDisplay.from_estimator(LinearRegression().fit(*data))
    with pytest.raises(ValueError, match=r"truth has none of the columns a1, a2, b0, b1; it has c"):
        ParametersDisplay.from_estimator(model, pd.DataFrame({"c": [1.0]}))
    with pytest.raises(TypeError, match="references is a DataFrame"):
        ParametersDisplay.from_estimator(model, references=[1])
    with pytest.raises(ValueError, match="no column 'T_L'"):
        ParametersDisplay.from_frame(table().drop(columns="T_L"))


TIME = np.linspace(0.0, 60.0, 31)
RUNS = {(1, "A"): 0.1, (2, "A"): 0.3, ("mean", "A"): 0.2, (1, "B"): 9.0, ("mean", "B"): 9.0}


@pytest.fixture(scope="module")
def result():
    """What an analysis of two people gives, as far as it is drawn."""
    marks = {"condition": "C4", "form": "lambda", "time": TIME}
    paths = [
        pd.DataFrame({"subject": who, "run": run} | marks | dict.fromkeys(ARX, level))
        for (run, who), level in RUNS.items()
    ]
    batch = {"condition": "C4", "subject": "A", "run": "mean", "start": 0.0, "stop": 30.0}
    return SimpleNamespace(
        paths=pd.concat(paths),
        batch=pd.DataFrame([batch | dict.fromkeys(ARX, 0.25)]),
        conditions=["C4"],
        memory_horizon=256.0,
        transition_times={"C4": 40.0},
    )


def test_a_column_for_each_person(result):
    display = EnsembleDisplay.from_result(result)
    assert display.axes_.shape == (4, 2)
    assert [panel.get_title() for panel in display.axes_[0]] == ["A", "B"]
    assert display.figure_.get_suptitle() == "C4: λ, $N_0$ = 256"
    panel = display.axes_[0, 0]
    levels = sorted(line.get_ydata()[0] for line in panel.lines if len(line.get_xdata()) > 2)
    assert levels == [0.1, 0.2, 0.3]
    np.testing.assert_array_equal(drawn(panel, "batch"), [[[0.0, 0.25], [30.0, 0.25]]])
    assert drawn(panel, "transition")[0][0, 0] == 40.0
    assert panel.get_ylim() == display.axes_[0, 1].get_ylim()
    assert EnsembleDisplay.from_result(result, subjects=["B"]).axes_.shape == (4, 1)
    with pytest.raises(ValueError, match="a subject must be one of 'A', 'B'; got 'S4'"):
        EnsembleDisplay.from_result(result, subjects=["S4"])
    with pytest.raises(ValueError, match="form must be one of 'lambda', 'Lambda'; got 'ini'"):
        EnsembleDisplay.from_result(result, form="ini")


def test_a_column_for_each_intensity_of_a_study():
    rows = pd.MultiIndex.from_product(
        [["C3"], [0.15, 0.0], range(9), ["lambda", "ini"], [0.0, 40.0, 80.0]],
        names=["condition", "remnant_intensity", "replication", "form", "time"],
    ).to_frame(index=False)
    rows["b0"] = 0.1 + 0.01 * rows["replication"] + 0.1 * (rows["form"] == "ini")
    rows["T_L"] = np.where(rows["replication"] == 8, 1e6, rows["b0"])
    display = EnsembleDisplay.from_table(rows, truth=pd.DataFrame({"b0": [0.12]}))
    assert [panel.get_title() for panel in display.axes_[0]] == [
        "$P_n$ = 0, 9 runs",
        "$P_n$ = 0.15, 9 runs",
    ]
    panel = display.axes_[0, 1]
    np.testing.assert_allclose(drawn(panel, "mean over replications")[0][:, 1], 0.14)
    (band, *_) = panel.collections
    deviation = 0.01 * np.std(range(9), ddof=1)
    np.testing.assert_allclose(band_at(band, 40.0), [0.14 - deviation, 0.14 + deviation])
    np.testing.assert_allclose(drawn(panel, "batch ± 1 standard deviation")[0][0], [0.0, 0.24])
    calm = EnsembleDisplay.from_table(rows, parameters="operator").axes_[0, 0]
    np.testing.assert_allclose(drawn(calm, "median over replications")[0][:, 1], 0.14)
    with pytest.raises(ValueError, match="draws one condition"):
        EnsembleDisplay.from_table(pd.concat([rows, rows.assign(condition="C1")]))
    with pytest.raises(ValueError, match="no column 'time'"):
        EnsembleDisplay.from_table(rows.drop(columns="time"))
