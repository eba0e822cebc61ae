import numpy as np
import pandas as pd
import pytest

from skhoid import ARXRegressor, HumanOperator, Sigmoid, load_human_tracking
from skhoid.interpret.conversion import NAMES, operator_parameters
from skhoid.plotting import ParametersDisplay

TRANSITION = HumanOperator(
    K_e=Sigmoid(0.09, 0.07, rate=0.5, time=40), K_edot=Sigmoid(0.036, 0.084, rate=0.5, time=40)
)
PANELS = ["K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"]


def table(time=None, **columns):
    """Parameters as operator_parameters returns them."""
    values = {"K_e": 0.09, "T_L": 0.4, "K_edot": 0.036, "tau_e": 0.28}
    values |= {"omega_nm": 11.0, "zeta_nm": 0.35}
    values |= {"sd_K_e": 0.01, "sd_tau_e": np.nan} | columns
    index = pd.Index([0] if time is None else time, name=None if time is None else "time")
    return pd.DataFrame(values, index=index)


def path():
    time = np.linspace(0, 80, 41)
    K_e, K_edot = TRANSITION.gains(time)
    return table(time, K_e=K_e, K_edot=K_edot, T_L=K_edot / K_e)


@pytest.fixture(scope="module")
def model():
    return ARXRegressor(nk=8).fit(*load_human_tracking(1))


def test_lines_are_the_estimates():
    frame = path()
    display = ParametersDisplay.from_frame(frame)
    assert display.names_ == PANELS
    assert len(display.axes_) == 5
    for name in PANELS:
        line = display.lines_["estimate", name]
        np.testing.assert_array_equal(line.get_xdata(), frame.index)
        np.testing.assert_array_equal(line.get_ydata(), frame[name])
    labels = [panel.get_ylabel() for panel in display.axes_]
    assert labels[0] == "$K_e$"
    assert labels[1] == "$T_L$, s"
    assert labels[3] == r"$\omega_{nm}$, rad/s"
    assert display.axes_[0].get_title() == r"$\tau_e$ = 0.28 s"
    assert display.axes_[-1].get_xlabel() == "time, s"


def test_truth_of_an_operator_is_evaluated_at_the_instants():
    display = ParametersDisplay.from_frame(path(), truth=TRANSITION)
    time = path().index
    K_e, K_edot = TRANSITION.gains(time.to_numpy())
    drawn = display.truth_["K_e"].get_xdata()
    at = np.searchsorted(drawn, time)
    np.testing.assert_array_equal(drawn[at], time)
    assert np.diff(drawn).max() < 0.01 * np.ptp(time)  # a step stays one between estimates
    np.testing.assert_allclose(display.truth_["T_L"].get_ydata()[at], K_edot / K_e)
    np.testing.assert_allclose(display.truth_["omega_nm"].get_ydata(), 11.25)


def test_truth_as_a_frame():
    truth = table(zeta_nm=0.4).drop(columns="T_L")
    display = ParametersDisplay.from_frame(path(), truth=truth)
    np.testing.assert_allclose(display.truth_["zeta_nm"].get_ydata(), 0.4)
    assert "T_L" not in display.truth_


def test_batch_models_are_points():
    frames = {"a": table(), "b": table(K_e=np.nan), "c": table(K_e=0.1, sd_K_e=0.02)}
    display = ParametersDisplay.from_frame(frames, truth=HumanOperator())
    np.testing.assert_array_equal(display.lines_["c", "K_e"].get_xydata(), [[2, 0.1]])
    (bar,) = display.bands_["c", "K_e"].get_segments()
    np.testing.assert_allclose(bar[:, 1], [0.08, 0.12])
    assert [tick.get_text() for tick in display.axes_[-1].get_xticklabels()] == ["a", "b", "c"]
    assert [text.get_text() for text in display.axes_[0].texts] == ["none"]
    np.testing.assert_allclose(display.truth_["K_e"].get_ydata(), 0.09)


@pytest.mark.parametrize(
    "frames",
    [{"a": table(), "b": table(tau_e=0.3)}, {"a": table(sd_tau_e=0.01)}],
    ids=["differs", "uncertain"],
)
def test_delay_that_is_estimated_has_a_panel(frames):
    display = ParametersDisplay.from_frame(frames)
    assert display.names_ == [*PANELS, "tau_e"]
    assert display.axes_[0].get_title() == ""


def test_infinite_and_missing_estimates():
    frame = path()
    T_L = frame["T_L"].to_numpy().copy()
    T_L[[0, 1]] = [np.inf, np.nan]
    nothing = np.full(len(frame), np.nan)
    display = ParametersDisplay.from_frame(frame.assign(T_L=T_L, zeta_nm=nothing))
    assert display.notes_["T_L"].get_text() == "1 of 40 outside"
    assert np.isfinite(display.axes_[1].get_ylim()).all()


def test_from_estimator(model):
    display = ParametersDisplay.from_estimator(model, kind="operator")
    expected = operator_parameters(model)
    for name in PANELS:
        assert display.lines_["estimate", name].get_ydata()[0] == expected[name].iloc[0]
    models = {"poles": model, "same": model}
    display = ParametersDisplay.from_estimator(models, kind="operator")
    assert list(display.frames) == ["poles", "same"]


def test_refusals():
    with pytest.raises(TypeError, match="'a' is a list"):
        ParametersDisplay.from_frame({"a": [1]})
    with pytest.raises(ValueError, match="no column 'T_L'"):
        ParametersDisplay.from_frame(table().drop(columns="T_L"))
    with pytest.raises(
        TypeError, match="truth must be a HumanOperator, a DataFrame or a row of one; got dict"
    ):
        ParametersDisplay.from_frame(table(), truth={})
    with pytest.raises(ValueError, match=r"truth=operator\.at\(t\)"):
        ParametersDisplay.from_frame(table(), truth=TRANSITION)
    assert set(PANELS) < set(NAMES)
