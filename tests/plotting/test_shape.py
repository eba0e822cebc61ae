"""The curve of what has no name, with its band."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from sklearn.exceptions import NotFittedError
from support.pictures import legend_texts
from support.plot_checks import covers_nothing
from support.shapes import a_shape

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import FreeGain
from skhoid.plotting import EffectDisplay


@pytest.fixture
def search():
    """One that has found nothing, until a test gives it a shape."""
    X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    return EffectSearchCV(OperatorRegressor(), effects=["bias"]).fit(X, y)


def test_curve_band_and_nearest_name_are_those_of_the_search(search):
    search.shape_ = a_shape()
    display = EffectDisplay.from_shape(search)
    curve = search.shape_.curve
    np.testing.assert_array_equal(display.lines_["curve"].get_xdata(), curve.index)
    np.testing.assert_array_equal(display.lines_["curve"].get_ydata(), curve["value"])
    (path,) = display.bands_["curve"].get_paths()
    assert path.vertices[:, 1].min() == curve["low"].min()
    assert path.vertices[:, 1].max() == curve["high"].max()
    np.testing.assert_array_equal(display.nearest_.get_ydata(), search.shape_.nearest_curve)
    assert legend_texts(display) == [
        "without the effect",
        "95 % band, of the whole curve",
        "curve",
        "nearest name: cubic gain",
        "knots",
    ]
    assert display.ax_.get_xlabel() == "error e, deg"
    assert display.ax_.get_title() == (
        "It acts on the error, as a function of its size and sign\n+9.9 points of held-out VAF"
    )


def test_a_name_that_is_far_is_not_drawn():
    far = a_shape().nearest.assign(distance=[0.75, 0.9])
    assert EffectDisplay.from_shape(a_shape(nearest=far)).nearest_ is None


def test_a_factor_does_nothing_where_it_is_one():
    display = EffectDisplay.from_shape(
        a_shape(effect=FreeGain(knots=(0.0, 1.0), values=(0.0, 0.0)))
    )
    assert set(display.without_.get_ydata()) == {1.0}


def test_a_search_without_a_shape_is_refused(search):
    with pytest.raises(ValueError, match="no shape to draw: nothing is missing"):
        EffectDisplay.from_shape(search)
    with pytest.raises(NotFittedError):
        EffectDisplay.from_shape(EffectSearchCV(OperatorRegressor()))
    with pytest.raises(TypeError, match="draws a fitted EffectSearchCV"):
        EffectDisplay.from_shape(OperatorRegressor())


@pytest.mark.parametrize("font_size", [8, 10, 13])
def test_nothing_is_covered(font_size):
    with plt.rc_context({"font.size": font_size}):
        covers_nothing(a_shape().plot())
