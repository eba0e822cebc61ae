import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from support.synthetic import DT, NK, arx_runs

from skhoid import RecursiveARXCV
from skhoid.plotting import MemoryHorizonDisplay

pytestmark = pytest.mark.slow  # simulates studies

INF = float("inf")
HORIZONS = [8, 32, 128, INF]
KINDS = ["gain", "score", "overfit_difference", "overfit_ratio"]


@pytest.fixture(scope="module")
def data():
    return arx_runs(3, 300, noise=1.0)


@pytest.fixture(scope="module")
def search(data):
    return RecursiveARXCV(HORIZONS, nk=NK, init="zeros").fit(*data)


def table(horizons=HORIZONS, **columns):
    """Settings as the constructor takes them."""
    n = len(horizons)
    values = {"panel": "", "line": "one", "memory_horizon": horizons, "best": np.arange(n) == 1}
    for kind in KINDS:
        values |= {kind: np.linspace(1, 2, n), f"sd_{kind}": 0.1}
    return pd.DataFrame(values | columns)


def legend_of(display):
    (legend,) = display.figure_.legends
    return [text.get_text() for text in legend.get_texts()]


def xy(mark):
    return mark.get_xdata().item(), mark.get_ydata().item()


@pytest.mark.parametrize(
    ("kind", "column"),
    [
        ("gain", "gain"),
        ("score", "mean_test_score"),
        ("overfit_difference", "overfit_difference"),
        ("overfit_ratio", "overfit_ratio"),
    ],
)
def test_values_are_those_of_the_search(search, kind, column):
    display = MemoryHorizonDisplay.from_estimator(search, kind=kind)
    (line,) = display.lines_.values()
    np.testing.assert_array_equal(line.get_ydata(), search.cv_results_[column])
    np.testing.assert_array_equal(line.get_xdata(), [8, 32, 128, display.infinite_])
    (mark,) = display.best_.values()
    best = search.best_index_
    assert xy(mark) == (line.get_xdata()[best], search.cv_results_[column][best])


@pytest.mark.parametrize("kind", KINDS)
def test_bands_are_the_spread_over_splits(search, kind):
    results = search.cv_results_
    test = np.array([results[f"split{i}_test_score"] for i in range(3)])
    train = np.array([results[f"split{i}_train_score"] for i in range(3)])
    per_split = {
        "gain": test - test[:, [3]],
        "score": test,
        "overfit_difference": train - test,
        "overfit_ratio": train / test,
    }[kind]
    display = MemoryHorizonDisplay.from_estimator(search, kind=kind)
    (line,), (band,) = display.lines_.values(), display.bands_.values()
    corners = band.get_paths()[0].vertices
    for i, x in enumerate(line.get_xdata()):
        there = corners[np.isclose(corners[:, 0], x), 1]
        expected = line.get_ydata()[i] + np.array([-1, 1]) * per_split[:, i].std()
        np.testing.assert_allclose([there.min(), there.max()], expected, atol=1e-12)
    assert legend_of(display)[:2] == ["mean over 3 splits", "± 1 standard deviation over 3 splits"]


def test_infinity_is_at_the_right_end(search):
    display = MemoryHorizonDisplay.from_estimator(search)
    names = [text.get_text() for text in display.ax_.get_xticklabels()]
    assert names == ["8", "32", "128", "∞"]
    assert display.infinite_ > 128
    assert display.ax_.get_xscale() == "log"
    assert display.ax_.get_xlabel() == "memory horizon $N_0$, samples"
    display.figure_.canvas.draw()
    np.testing.assert_allclose(display.seconds_ax_.get_xticks(), [0.1, 0.2, 0.5, 1.0])
    assert display.seconds_ax_.get_xlabel() == "memory horizon $T_0$, s"
    assert display.dt == pytest.approx(DT)


def test_several_searches(data, search):
    other = RecursiveARXCV([16, 64, INF], nk=NK - 1, init="zeros").fit(*data)
    display = MemoryHorizonDisplay.from_estimator({"3": search, "2": other})
    assert list(display.lines_) == [("", "3"), ("", "2")]
    assert list(display.best_) == [("", "3"), ("", "2")]
    infinite = {line.get_xdata()[-1] for line in display.lines_.values()}
    assert infinite == {display.infinite_}
    assert legend_of(display)[-1] == "best (2 runs per model)"
    colours = {line.get_color() for line in display.lines_.values()}
    assert len(colours) == 2


def test_horizons_of_each_parameter_stand_at_the_shortest(data):
    horizons = [32, (INF, INF, 32, 32), 128, (INF, INF, 128, 128), (128, 128, 32, 32), INF]
    search = RecursiveARXCV(horizons, nk=NK, init="zeros").fit(*data)
    display = MemoryHorizonDisplay.from_estimator(search, kind="score")
    score = search.cv_results_["mean_test_score"]
    end = display.infinite_
    expected = {
        "one $N_0$": ([32, 128, end], score[[0, 2, 5]]),
        "(∞, ∞, $N_0$, $N_0$)": ([32, 128, end], score[[1, 3, 5]]),
        "(4 $N_0$, 4 $N_0$, $N_0$, $N_0$)": ([32, end], score[[4, 5]]),
    }
    assert [line for _, line in display.lines_] == list(expected)
    for name, (x, y) in expected.items():
        np.testing.assert_array_equal(display.lines_["", name].get_xdata(), x)
        np.testing.assert_array_equal(display.lines_["", name].get_ydata(), y)
    display = MemoryHorizonDisplay.from_estimator({"Λ": search})
    assert list(display.lines_)[1] == ("", "Λ, (∞, ∞, $N_0$, $N_0$)")


def test_limits_leave_out_what_is_far_worse():
    gain = [-900.0, 3.0, 4.0, 0.0]
    display = MemoryHorizonDisplay(results=table(gain=gain), n_splits=2).plot()
    low, high = display.ax_.get_ylim()
    assert -10 < low < 0
    assert 4.1 < high < 5
    assert display.notes_[""].get_text() == "1 of 4 outside"
    difference = [900.0, 5.0, 4.0, 3.0]
    results = table(overfit_difference=difference)
    display = MemoryHorizonDisplay(results=results, kind="overfit_difference").plot()
    low, high = display.ax_.get_ylim()
    assert low < 3.0 < 5.0 < high < 20
    assert display.notes_[""].get_text() == "1 of 4 outside"


def test_one_split_has_no_band():
    display = MemoryHorizonDisplay(results=table()).plot()
    assert display.bands_ == {}
    assert display.seconds_ax_ is None
    assert display.notes_ == {}


@pytest.mark.parametrize("horizons", [[INF], [64], [64, 65, 66]])
def test_few_horizons(horizons):
    display = MemoryHorizonDisplay(results=table(horizons), dt=0.01, kind="score").plot()
    display.figure_.canvas.draw()
    (line,) = display.lines_.values()
    low, high = display.ax_.get_xlim()
    assert ((line.get_xdata() > low) & (line.get_xdata() < high)).all()


def test_refusals(data, search):
    with pytest.raises(NotFittedError):
        MemoryHorizonDisplay.from_estimator(RecursiveARXCV())
    with pytest.raises(TypeError, match=r"fitted RecursiveARXCV.*got LinearRegression"):
        MemoryHorizonDisplay.from_estimator(LinearRegression().fit(*data))
    with pytest.raises(ValueError, match="kind must be one of 'gain', 'score'"):
        MemoryHorizonDisplay.from_estimator(search, kind="loss")
    with pytest.raises(ValueError, match=r"put float\('inf'\) among the memory horizons"):
        MemoryHorizonDisplay(results=table(gain=np.nan)).plot()
