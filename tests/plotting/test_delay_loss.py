import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import make_pipeline
from support.pictures import legend_texts

from skhoid import ARXRegressor, Decimator, DelaySearchCV, OrderSearchCV
from skhoid.plotting import DelayLossDisplay

DT = 0.02
DELAY = 5


@pytest.fixture(scope="module")
def data():
    """Three runs of u[k] = 0.7 u[k-1] + 0.5 e[k-5] + 0.3 z[k-2] + noise."""
    rng = np.random.default_rng(1)
    index = pd.MultiIndex.from_product([[1, 2, 3], DT * np.arange(400)], names=["run", "time"])
    e, z, noise = rng.standard_normal((3, 3, 400))
    u = np.zeros((3, 400))
    for k in range(DELAY, 400):
        u[:, k] = 0.7 * u[:, k - 1] + 0.5 * e[:, k - DELAY] + 0.3 * z[:, k - 2]
    u += 0.02 * noise
    X = pd.DataFrame({"a": e.ravel(), "b": z.ravel()}, index=index)
    return X, pd.Series(u.ravel(), index=index, name="u")


def search_of(data, columns=("a",), estimator=None, **options):
    X, y = data
    return DelaySearchCV(estimator or ARXRegressor(na=1, nb=1), **options).fit(X[list(columns)], y)


def test_line_is_the_loss_over_the_delay(data):
    search = search_of(data, nk=range(1, 11))
    display = DelayLossDisplay.from_estimator(search)
    np.testing.assert_allclose(display.line_.get_xdata(), DT * np.arange(1, 11))
    np.testing.assert_array_equal(display.line_.get_ydata(), search.loss_)
    assert search.best_nk_ == DELAY
    np.testing.assert_allclose(display.best_.get_xdata(), [search.best_delay_])
    np.testing.assert_allclose(display.best_.get_ydata(), [search.loss_.min()])
    assert display.ax_.get_title() == "Best delay: 0.1 s, 5 samples"
    assert display.ax_.get_xlabel() == "delay, s"
    assert display.ax_.get_ylabel() == "mean squared one-step error"
    assert display.band_ is None


def test_band_spans_one_standard_deviation_over_folds(data):
    search = search_of(data, nk=[4, 5, 6], criterion="vaf")
    display = DelayLossDisplay.from_estimator(search)
    assert display.n_folds == 3
    corners = display.band_.get_paths()[0].vertices
    at = corners[np.isclose(corners[:, 0], search.best_delay_), 1]
    loss, std = search.loss_[1], search.cv_results_["std_test_score"][1]
    np.testing.assert_allclose([at.min(), at.max()], [loss - std, loss + std])
    assert display.ax_.get_ylabel() == "100 − cross-validated VAF, %"
    texts = legend_texts(display)
    assert "± 1 standard deviation over 3 folds" in texts


def test_worthless_models_lie_off_the_plot():
    display = DelayLossDisplay(
        nk=[1, 2, 3, 4],
        loss=np.array([20.0, 5.0, 60.0, 1100.0]),
        best_index=1,
        dt=0.01,
        criterion="vaf",
        std=np.array([3.0, 8.0, 2.0, 500.0]),
        n_folds=5,
    ).plot()
    assert display.ax_.get_yscale() == "log"
    low, high = display.ax_.get_ylim()
    assert 0 < low < 5
    assert 100 < high < 110
    corners = np.concatenate([path.vertices for path in display.band_.get_paths()])
    assert corners[:, 0].max() == pytest.approx(0.03)
    display.figure_.canvas.draw()


def test_unsorted_candidates_and_missing_losses():
    display = DelayLossDisplay(
        nk=[7, 1, 3], loss=np.array([2.0, np.nan, 1.0]), best_index=2, dt=0.5
    ).plot()
    np.testing.assert_array_equal(display.line_.get_xdata(), [0.5, 1.5, 3.5])
    np.testing.assert_array_equal(display.line_.get_ydata(), [np.nan, 1.0, 2.0])
    np.testing.assert_array_equal(display.best_.get_xdata(), [1.5])


def test_decimated_pipeline_counts_samples_of_the_model(data):
    pipe = make_pipeline(Decimator(2, padding="odd"), ARXRegressor(na=1, nb=2))
    search = search_of(data, estimator=pipe, nk=range(1, 6))
    display = DelayLossDisplay.from_estimator(search)
    np.testing.assert_allclose(display.line_.get_xdata(), 2 * DT * np.arange(1, 6))


def test_several_inputs_with_delays_of_their_own(data):
    candidates = [(4, 1), (5, 2), (6, 2)]
    search = search_of(data, columns=("a", "b"), nk=candidates)
    display = DelayLossDisplay.from_estimator(search)
    assert search.best_nk_ == (5, 2)
    np.testing.assert_array_equal(display.line_.get_xdata(), [0, 1, 2])
    np.testing.assert_array_equal(display.line_.get_ydata(), search.loss_)
    names = [label.get_text() for label in display.ax_.get_xticklabels()]
    assert names == ["(4, 1)", "(5, 2)", "(6, 2)"]
    assert display.samples_ax_ is None
    assert display.ax_.get_title() == "Best delays: (0.1, 0.04) s, (5, 2) samples"


def test_delay_over_time(data):
    search = search_of(data, nk=range(1, 11), window=2.0)
    display = DelayLossDisplay.from_estimator(search, kind="path")
    np.testing.assert_array_equal(display.line_.get_xdata(), search.window_time_)
    np.testing.assert_array_equal(display.line_.get_ydata(), search.delay_path_)
    np.testing.assert_allclose(display.best_.get_ydata(), search.best_delay_)
    assert display.ax_.get_xlabel() == "time, s"
    assert display.ax_.get_ylabel() == "delay, s"
    display.figure_.canvas.draw()
    low, high = display.ax_.get_ylim()
    np.testing.assert_allclose(display.samples_ax_.get_ylim(), [low / DT, high / DT])


def test_errors_are_clear(data):
    with pytest.raises(NotFittedError):
        DelayLossDisplay.from_estimator(DelaySearchCV(ARXRegressor()))
    with pytest.raises(TypeError, match="draws a fitted DelaySearchCV; got OrderSearchCV"):
        DelayLossDisplay.from_estimator(OrderSearchCV(ARXRegressor()))
    search = search_of(data, nk=[4, 5])
    with pytest.raises(ValueError, match=r"fit DelaySearchCV\(..., window=<seconds>\)"):
        DelayLossDisplay.from_estimator(search, kind="path")
    with pytest.raises(ValueError, match="kind must be one of 'loss', 'path'; got 'curve'"):
        DelayLossDisplay.from_estimator(search, kind="curve")
    assert not plt.get_fignums()
