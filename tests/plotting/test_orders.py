"""Losses of delays and contours of orders are those of the searches."""

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError
from support.pictures import legend_texts

from skhoid import ARXRegressor, DelaySearchCV, OrderSearchCV
from skhoid.plotting import DelayLossDisplay, VAFContourDisplay

DT = 0.02
DELAY = 5


@pytest.fixture(scope="module")
def data():
    """Three runs of u[k] = 0.7 u[k-1] + 0.5 e[k-5] + 0.3 z[k-2] + noise."""
    rng = np.random.default_rng(1)
    index = pd.MultiIndex.from_product([[1, 2, 3], DT * np.arange(300)], names=["run", "time"])
    e, z, noise = rng.standard_normal((3, 3, 300))
    u = np.zeros((3, 300))
    for k in range(DELAY, 300):
        u[:, k] = 0.7 * u[:, k - 1] + 0.5 * e[:, k - DELAY] + 0.3 * z[:, k - 2]
    u += 0.02 * noise
    X = pd.DataFrame({"a": e.ravel(), "b": z.ravel()}, index=index)
    return X, pd.Series(u.ravel(), index=index, name="u")


def delays_of(data, columns=("a",), **options):
    X, y = data
    return DelaySearchCV(ARXRegressor(na=1, nb=1), **options).fit(X[list(columns)], y)


def star(panel):
    return next(line.get_xydata()[0] for line in panel.lines if line.get_marker() == "*")


def test_loss_over_the_delay(data):
    search = delays_of(data, nk=range(1, 11))
    display = DelayLossDisplay.from_estimator(search)
    np.testing.assert_allclose(display.line_.get_xdata(), DT * np.arange(1, 11))
    np.testing.assert_array_equal(display.line_.get_ydata(), search.loss_)
    np.testing.assert_allclose(star(display.ax_), [DT * DELAY, search.loss_.min()])
    assert display.ax_.get_title() == "Best delay: 0.1 s, 5 samples"


def test_vaf_has_a_band_over_folds(data):
    search = delays_of(data, nk=[6, 5, 4], criterion="vaf")
    display = DelayLossDisplay.from_estimator(search)
    assert (np.diff(display.line_.get_xdata()) > 0).all()
    corners = display.ax_.collections[0].get_paths()[0].vertices
    there = corners[np.isclose(corners[:, 0], DT * DELAY), 1]
    np.testing.assert_allclose(np.ptp(there), 2 * search.cv_results_["std_test_score"][1])
    assert "± 1 standard deviation over 3 folds" in legend_texts(display)
    assert display.ax_.get_ylabel() == "100 − cross-validated VAF, %"


def test_several_inputs_with_delays_of_their_own(data):
    search = delays_of(data, columns=("a", "b"), nk=[(4, 1), (5, 2), (6, 2)])
    display = DelayLossDisplay.from_estimator(search)
    names = [label.get_text() for label in display.ax_.get_xticklabels()]
    assert names == ["(4, 1)", "(5, 2)", "(6, 2)"]
    assert display.ax_.get_title() == "Best delays: (0.1, 0.04) s, (5, 2) samples"


def test_delay_over_time(data):
    search = delays_of(data, nk=range(1, 11), window=2.0)
    display = DelayLossDisplay.from_estimator(search, kind="path")
    np.testing.assert_array_equal(display.line_.get_xdata(), search.window_time_)
    np.testing.assert_allclose(display.line_.get_ydata(), search.delay_path_)
    with pytest.raises(ValueError, match=r"fit DelaySearchCV\(..., window=<seconds>\)"):
        DelayLossDisplay.from_estimator(delays_of(data, nk=[4, 5]), kind="path")


@pytest.fixture(scope="module")
def orders(data):
    X, y = data
    return OrderSearchCV(ARXRegressor(), na=[1, 2, 3], nb=[1, 2], nk=[4, 5], factor=[1, 2]).fit(
        X[["a"]], y
    )


def test_marks_of_the_contours(orders):
    display = VAFContourDisplay.from_estimator(orders)
    results, factor = orders.cv_results_, orders.best_factor_
    table = pd.DataFrame({n: results[f"param_{n}"] for n in ("na", "nb", "nk", "factor")})
    table["vaf"] = results["mean_test_score"]
    for nk, panel in zip((4, 5), display.axes_, strict=True):
        assert panel.get_title() == f"$n_k$ = {nk} ({nk * DT * factor:.3g} s)"
        here = table[(table["nk"] == nk) & (table["factor"] == factor) & (table["vaf"] > 0)]
        if len(here):
            best = here.loc[here["vaf"].idxmax()]
            assert star(panel).tolist() == [best["na"], best["nb"]]
    chosen = display.axes_[[4, 5].index(orders.best_nk_)]
    (ring,) = [line for line in chosen.lines if line.get_label() == "chosen model"]
    assert ring.get_xydata().tolist() == [[orders.best_na_, orders.best_nb_]]
    other = VAFContourDisplay.from_estimator(orders, factor=3 - factor)
    assert "chosen model" not in legend_texts(other)
    with pytest.raises(ValueError, match="factor must be one of 1, 2; got 7"):
        VAFContourDisplay.from_estimator(orders, factor=7)


def test_one_row_of_candidates_becomes_lines(data):
    X, y = data
    search = OrderSearchCV(ARXRegressor(), na=[1, 2, 3], nb=[1], nk=[5]).fit(X[["a"]], y)
    display = VAFContourDisplay.from_estimator(search)
    (line,) = display.lines_
    scores = np.asarray(search.cv_results_["mean_test_score"])
    np.testing.assert_array_equal(line.get_ydata(), np.where(scores > 0, scores, np.nan))
    assert display.ax_.get_xlabel() == "$n_a$ ($n_b$ = 1)"


def test_orders_of_each_input(data):
    search = OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[(1, 1), (2, 1)], nk=[(5, 2), (4, 2)]).fit(
        *data
    )
    display = VAFContourDisplay.from_estimator(search)
    assert [text.get_text() for text in display.ax_.get_yticklabels()] == ["(1, 1)", "(2, 1)"]


def test_many_delays_show_the_best_and_say_so():
    search = OrderSearchCV(ARXRegressor())
    params = [(na, nb, nk, 1) for na in (1, 2) for nb in (1, 2) for nk in range(15)]
    search.best_estimator_, search.best_factor_, search.best_index_ = object(), 1, 0
    search.cv_results_ = {
        "mean_test_score": [10.0 + 5 * nk if nk > 3 else np.nan for _, _, nk, _ in params],
        "delay": [nk * DT for _, _, nk, _ in params],
        **dict(
            zip(
                ("param_na", "param_nb", "param_nk", "param_factor"),
                map(list, zip(*params, strict=True)),
                strict=True,
            )
        ),
    }
    display = VAFContourDisplay.from_estimator(search)
    assert len(display.axes_) == 12
    assert legend_texts(display)[-1] == "the best 12 of 15 delays"


def test_what_is_no_fitted_search_is_refused():
    with pytest.raises(NotFittedError):
        DelayLossDisplay.from_estimator(DelaySearchCV(ARXRegressor()))
    with pytest.raises(TypeError, match="draws a fitted OrderSearchCV; got DelaySearchCV"):
        VAFContourDisplay.from_estimator(DelaySearchCV(ARXRegressor()))
