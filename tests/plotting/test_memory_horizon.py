"""The trade-off of memory horizons, of searches and of a study."""

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LinearRegression
from support.pictures import legend_texts
from support.synthetic import NK, arx_runs

from skhoid import RecursiveARXCV
from skhoid.plotting import MemoryHorizonDisplay

INF = float("inf")


@pytest.fixture(scope="module")
def data():
    return arx_runs(3, 200, noise=1.0)


@pytest.fixture(scope="module")
def search(data):
    return RecursiveARXCV([8, 32, 128, INF], nk=NK, init="zeros").fit(*data)


def stars(display):
    return [line for panel in display.axes_ for line in panel.lines if line.get_marker() == "*"]


@pytest.mark.parametrize(("kind", "column"), [("gain", "gain"), ("score", "mean_test_score")])
def test_values_and_deviations_are_those_of_the_search(search, kind, column):
    display = MemoryHorizonDisplay.from_estimator(search, kind=kind)
    (line,) = display.lines_.values()
    results, best = search.cv_results_, search.best_index_
    np.testing.assert_array_equal(line.get_ydata(), results[column])
    (star,) = stars(display)
    assert star.get_xydata().tolist() == [line.get_xydata()[best].tolist()]
    corners = display.ax_.collections[0].get_paths()[0].vertices
    deviation = results["std_gain" if kind == "gain" else "std_test_score"][0]
    there = corners[np.isclose(corners[:, 0], 8), 1]
    np.testing.assert_allclose(np.ptp(there), 2 * deviation)
    assert [tick.get_text() for tick in display.ax_.get_xticklabels()] == ["8", "32", "128", "∞"]


def test_several_searches_and_horizons_of_each_parameter(data, search):
    horizons = [32, (INF, INF, 32, 32), 128, (INF, INF, 128, 128), INF]
    other = RecursiveARXCV(horizons, nk=NK, init="zeros").fit(*data)
    display = MemoryHorizonDisplay.from_estimator({"one": search, "two": other}, kind="score")
    assert [line for _, line in display.lines_] == [
        "one",
        "two, one $N_0$",
        "two, (∞, ∞, $N_0$, $N_0$)",
    ]
    joined = display.lines_["", "two, (∞, ∞, $N_0$, $N_0$)"]
    scores = other.cv_results_["mean_test_score"][[1, 3, 4]]
    np.testing.assert_array_equal(joined.get_ydata(), scores)
    assert joined.get_xdata()[:2].tolist() == [32, 128]


def test_a_study_has_a_panel_for_each_condition_and_form():
    cells = [["C4", "C1"], [0.15, 0.0], ["lambda", "Lambda"], [2.0, 8, 64, 512, INF]]
    names = ["condition", "remnant_intensity", "form", "memory_horizon"]
    table = pd.MultiIndex.from_product(cells, names=names).to_frame(index=False)
    table["vaf_validation"] = 90 - 2000 * table["remnant_intensity"] / table["memory_horizon"]
    table["vaf_estimation"] = 95.0
    table["gain"] = table["vaf_validation"] - 90
    summary = table.set_index(names)
    display = MemoryHorizonDisplay.from_summary(summary)
    assert [panel.get_title() for panel in display.axes_] == [
        r"C4, $\lambda$",
        r"C4, $\Lambda$",
        r"C1, $\lambda$",
        r"C1, $\Lambda$",
    ]
    line = display.lines_[r"C4, $\Lambda$", "$P_n$ = 0.15"]
    np.testing.assert_allclose(line.get_ydata(), -300 / np.array([2.0, 8, 64, 512, INF]))
    assert display.ax_.get_ylim()[0] > -150
    assert "outside" in display.ax_.texts[0].get_text()
    ratio = MemoryHorizonDisplay.from_summary(summary, kind="overfit_ratio")
    line = ratio.lines_[r"C1, $\lambda$", "$P_n$ = 0"]
    np.testing.assert_allclose(line.get_ydata(), 95 / 90)
    assert legend_texts(ratio)[-1] == "best of the line"


def test_what_cannot_be_drawn_is_refused(data):
    with pytest.raises(TypeError, match=r"fitted RecursiveARXCV.*got LinearRegression"):
        MemoryHorizonDisplay.from_estimator(LinearRegression().fit(*data))
    endless = RecursiveARXCV([16, 32], nk=NK, init="zeros").fit(*data)
    with pytest.raises(ValueError, match=r"put float\('inf'\) among the memory horizons"):
        MemoryHorizonDisplay.from_estimator(endless)
