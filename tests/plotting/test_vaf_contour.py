import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError

from skhoid import ARXRegressor, DelaySearchCV, OrderSearchCV
from skhoid.plotting import VAFContourDisplay

DT = 0.02


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(2)
    index = pd.MultiIndex.from_product([[1, 2], DT * np.arange(400)], names=["run", "time"])
    a, b, noise = rng.standard_normal((3, 2, 400))
    u = np.zeros((2, 400))
    for k in range(3, 400):
        u[:, k] = 1.2 * u[:, k - 1] - 0.5 * u[:, k - 2] + 0.5 * a[:, k - 3] + 0.2 * b[:, k - 1]
    u += 0.05 * noise
    X = pd.DataFrame({"a": a.ravel(), "b": b.ravel()}, index=index)
    return X, pd.Series(u.ravel(), index=index, name="u")


@pytest.fixture(scope="module")
def search(data):
    X, y = data
    return OrderSearchCV(ARXRegressor(), na=[1, 2, 3], nb=[1, 2], nk=[2, 3], factor=[1, 2]).fit(
        X[["a"]], y
    )


def xy(mark):
    return mark.get_xdata().item(), mark.get_ydata().item()


def score(search, **params):
    (found,) = (
        s
        for p, s in zip(
            search.cv_results_["params"], search.cv_results_["mean_test_score"], strict=True
        )
        if p == params
    )
    return found


@pytest.mark.parametrize("factor", [1, 2])
def test_field_holds_the_scores_of_one_factor(search, factor):
    display = VAFContourDisplay.from_estimator(search, factor=factor)
    assert display.vaf.shape == (2, 2, 3)
    for k, nk in enumerate(display.nk):
        assert display.axes_[k].get_title() == f"$n_k$ = {nk} ({nk * DT * factor:.3g} s)"
        for j, nb in enumerate(display.nb):
            for i, na in enumerate(display.na):
                expected = score(search, na=na, nb=nb, nk=nk, factor=factor)
                assert display.vaf[k, j, i] == expected


def test_marks(search):
    display = VAFContourDisplay.from_estimator(search)
    assert display.factor == search.best_factor_
    for k, mark in enumerate(display.highest_):
        row, column = np.unravel_index(display.vaf[k].argmax(), (2, 3))
        assert mark.axes is display.axes_[k]
        assert xy(mark) == (display.na[column], display.nb[row])
    assert xy(display.chosen_) == (search.best_na_, search.best_nb_)
    assert display.chosen_.axes is display.axes_[display.nk.index(search.best_nk_)]


def test_areas_without_positive_vaf_are_empty():
    vaf = np.array([[[-5.0, 50.0, 60.0], [np.nan, 70.0, 80.0], [0.0, 75.0, 70.0]]])
    display = VAFContourDisplay(
        na=[1, 2, 3], nb=[1, 2, 3], nk=[4], vaf=vaf, delay=np.array([0.04])
    ).plot()
    (contours,) = display.contours_
    drawn = np.concatenate([p.vertices for p in contours.get_paths() if len(p.vertices)])
    assert drawn[:, 0].min() == 2.0
    assert xy(display.highest_[0]) == (3, 2)


def test_single_model_is_a_square():
    nan = np.nan
    vaf = np.array([[[50.0, nan, 60.0], [nan, nan, 70.0], [-1.0, 75.0, 80.0]]])
    display = VAFContourDisplay(
        na=[1, 2, 3], nb=[1, 2, 3], nk=[4], vaf=vaf, delay=np.array([0.04]), levels=[40, 60, 80]
    ).plot()
    # The three models at the upper right make a triangle; the other two belong to none.
    assert display.single_[0].get_offsets().tolist() == [[1, 1], [3, 1]]
    assert display.single_[0].get_array().tolist() == [50, 60]


def test_panel_without_any_model_stays_empty():
    vaf = np.array([[[-5.0, -3.0], [np.nan, 0.0]], [[1.0, 2.0], [3.0, 4.0]]])
    display = VAFContourDisplay(
        na=[1, 2], nb=[1, 2], nk=[1, 2], vaf=vaf, delay=np.array([0.1, 0.2])
    ).plot()
    assert display.highest_[0] is None
    assert xy(display.highest_[1]) == (2, 2)
    display.figure_.canvas.draw()


def test_one_row_of_candidates_becomes_lines(data):
    X, y = data
    search = OrderSearchCV(ARXRegressor(), na=[1, 2, 3], nb=[1], nk=[2, 3]).fit(X[["a"]], y)
    display = VAFContourDisplay.from_estimator(search)
    assert display.contours_ == []
    assert display.colorbar_ is None
    for k, line in enumerate(display.lines_):
        np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3])
        values = display.vaf[k, 0]
        np.testing.assert_array_equal(line.get_ydata(), np.where(values > 0, values, np.nan))
    assert display.ax_.get_ylabel() == "VAF, %"
    assert display.ax_.get_xlabel() == "$n_a$ ($n_b$ = 1)"
    assert xy(display.chosen_)[0] == search.best_na_
    display.figure_.canvas.draw()


def test_orders_and_delays_per_input(data):
    X, y = data
    search = OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[(1, 1), (2, 1)], nk=[(3, 1), (2, 1)]).fit(
        X, y
    )
    display = VAFContourDisplay.from_estimator(search)
    assert display.nk == [(2, 1), (3, 1)]
    assert [text.get_text() for text in display.ax_.get_yticklabels()] == ["(1, 1)", "(2, 1)"]
    assert display.vaf[1, 0, 1] == score(search, na=2, nb=(1, 1), nk=(3, 1), factor=1)


@pytest.mark.slow
def test_many_delays_show_the_best_and_say_so():
    vaf = np.linspace(10, 90, 15)[:, None, None] + np.zeros((15, 2, 2))
    search = OrderSearchCV(ARXRegressor())
    params = [
        {"na": na, "nb": nb, "nk": nk, "factor": 1}
        for na in (1, 2)
        for nb in (1, 2)
        for nk in range(15)
    ]
    search.best_estimator_ = object()
    search.best_factor_, search.best_index_ = 1, 0
    search.cv_results_ = {
        "params": params,
        "mean_test_score": [vaf[p["nk"], 0, 0] for p in params],
        "delay": [p["nk"] * DT for p in params],
        **{f"param_{n}": [p[n] for p in params] for n in ("na", "nb", "nk", "factor")},
    }
    display = VAFContourDisplay.from_estimator(search)
    assert display.nk == list(range(3, 15))
    assert display.chosen_ is None
    (legend,) = display.figure_.legends
    assert legend.get_texts()[-1].get_text() == "the best 12 of 15 delays"
    display = VAFContourDisplay.from_estimator(search, nk=[0, 14])
    assert display.nk == [0, 14]
    assert display.chosen_ is not None


def test_errors_are_clear(search):
    with pytest.raises(NotFittedError):
        VAFContourDisplay.from_estimator(OrderSearchCV(ARXRegressor()))
    with pytest.raises(TypeError, match="draws a fitted OrderSearchCV; got DelaySearchCV"):
        VAFContourDisplay.from_estimator(DelaySearchCV(ARXRegressor()))
    with pytest.raises(ValueError, match=r"factor=7 was not searched; the factors are \[1, 2\]"):
        VAFContourDisplay.from_estimator(search, factor=7)
    with pytest.raises(ValueError, match="nk=9 was not searched"):
        VAFContourDisplay.from_estimator(search, nk=[9])
