"""The picture of what has no name: the curve of the search, its band, knots, nearest name."""

import copy
from types import SimpleNamespace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from support.plot_checks import covers_nothing

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import DeadZone
from skhoid.plotting import ShapeDisplay

mpl.use("Agg")


@pytest.fixture(scope="module")
def search():
    """A search that knows no dead zone."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=3,
        duration=40.96,
        sampling_rate=50,
        remnant_intensity=0.05,
        effects=DeadZone(width=0.6),
        random_state=0,
    )
    return EffectSearchCV(OperatorRegressor(), effects=["bias"]).fit(X, y)


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_it_draws_the_curve_and_band_of_the_search(search):
    display = ShapeDisplay.from_estimator(search)
    curve = search.shape_.curve
    np.testing.assert_array_equal(display.line_.get_xdata(), curve.index)
    np.testing.assert_array_equal(display.line_.get_ydata(), curve["value"])
    low, high = display.band_.get_datalim(display.ax_.transData).intervaly
    assert low == pytest.approx(curve["low"].min())
    assert high == pytest.approx(curve["high"].max())
    ticks = display.knots_.get_xdata()
    assert set(ticks) == set(search.shape_.effect.knots)
    assert display.ax_.get_title().startswith("It acts on the error")
    assert "of held-out VAF" in display.ax_.get_title().replace("\n", " ").replace("\xa0", " ")


def test_the_dashed_curve_is_the_nearest_name(search):
    shape = search.shape_
    assert shape.nearest.index[0] == "dead_zone"
    display = ShapeDisplay.from_shape(shape)
    assert display.nearest_.get_label() == "nearest name: dead zone"
    np.testing.assert_array_equal(display.nearest_.get_ydata(), shape.nearest_curve)
    assert display.nearest_.get_linestyle() == "--"


def test_styles_and_axes_of_ones_own(search):
    _, ax = plt.subplots()
    display = search.shape_.plot(ax)
    assert display.ax_ is ax
    styled = display.plot(line_kw={"color": "red"}, nearest_kw={"alpha": 0.5})
    assert styled.line_.get_color() == "red"
    assert styled.nearest_.get_alpha() == 0.5


def test_without_knots_or_a_nearest_name():
    at = pd.Index(np.linspace(0.0, 80.0, 41), name="time")
    curve = pd.DataFrame({"value": 1.0, "low": 0.8, "high": 1.2}, at)
    display = ShapeDisplay(curve=curve, x_label="time in the run, s", y_label="factor").plot()
    assert display.nearest_ is None
    assert display.knots_.get_xdata().size == 0


@pytest.mark.parametrize("font_size", [8, 10, 13])
def test_nothing_is_covered(search, font_size):
    with mpl.rc_context({"font.size": font_size}):
        covers_nothing(search.shape_.plot())


def test_a_search_without_a_shape_is_refused(search):
    other = copy.copy(search)
    other.shape_ = None
    with pytest.raises(ValueError, match="This search has no shape to draw"):
        ShapeDisplay.from_estimator(other)
    with pytest.raises(TypeError, match="EffectSearchCV"):
        ShapeDisplay.from_estimator(SimpleNamespace())
