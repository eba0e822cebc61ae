import numpy as np
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from support.synthetic import DT, NK, arx_runs

from skhoid import DelayShift, RecursiveARX
from skhoid.plotting import ForgettingProfileDisplay

pytestmark = pytest.mark.slow  # fits, and compiles


@pytest.fixture(scope="module")
def data():
    return arx_runs(1, 300)


def recursive(data, **params):
    return RecursiveARX(nk=NK, init="zeros", **params).fit(*data)


def test_weights_of_constant_factors():
    display = ForgettingProfileDisplay.from_factors([0.9, 0.99, 1.0])
    assert list(display.lines_) == ["λ = 0.9", "λ = 0.99", "λ = 1"]
    for factor, line in zip([0.9, 0.99, 1.0], display.lines_.values(), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), np.arange(256))
        np.testing.assert_allclose(line.get_ydata(), factor ** np.arange(256))
    panel = display.axes_[0]
    assert panel.get_xlabel() == "age $t - k$, samples"
    assert panel.get_ylabel() == r"weight $\beta(t, k)$"
    assert display.seconds_ax_ is None


def test_weights_of_a_factor_over_time():
    """Eq. 4.22 as it stands: beta(t, k) is the product of lambda(j) over j = k + 1 ... t."""
    path = np.random.default_rng(0).uniform(0.8, 1.0, 30)
    display = ForgettingProfileDisplay.from_factors({"variable": path}, n_samples=20)
    weights = display.lines_["variable"].get_ydata()
    t = path.size - 1
    expected = [np.prod([path[j] for j in range(k + 1, t + 1)]) for k in range(t, t - 20, -1)]
    np.testing.assert_allclose(weights, expected)
    longer = ForgettingProfileDisplay.from_factors({"variable": path}, n_samples=500)
    assert longer.weights["variable"].size == 30


def test_memory_horizons_lie_on_the_curve():
    display = ForgettingProfileDisplay.from_factors([0.5, 0.9, 0.99, 1.0])
    panel = display.axes_[1]
    curve = display.curve_
    np.testing.assert_allclose(curve.get_ydata(), 1 / (1 - np.asarray(curve.get_xdata())))
    for factor in (0.5, 0.9, 0.99):
        point = display.horizons_[f"λ = {factor:g}"]
        np.testing.assert_allclose(point.get_xydata(), [[factor, 1 / (1 - factor)]])
    endless = display.horizons_["λ = 1"]
    np.testing.assert_allclose(endless.get_xydata(), [[1.0, panel.get_ylim()[1]]])
    assert endless.get_marker() == "^"
    assert panel.get_yscale() == "log"
    assert [text.get_text() for text in panel.texts] == ["∞"]
    assert panel.get_ylim()[0] > 1


def test_factor_over_time_covers_a_part_of_the_curve():
    display = ForgettingProfileDisplay.from_factors({"variable": np.array([0.9, 0.99, 0.95])})
    part = display.horizons_["variable"].get_xydata()
    np.testing.assert_allclose(part[[0, -1]], [[0.9, 10], [0.99, 100]])
    np.testing.assert_allclose(part[:, 1], 1 / (1 - part[:, 0]))


def test_model_with_one_factor(data):
    display = ForgettingProfileDisplay.from_estimator(recursive(data, memory_horizon=50))
    (label,) = display.lines_
    assert label == "λ = 0.98, $N_0$ = 50"
    weights = display.weights[label]
    np.testing.assert_allclose(weights, 0.98 ** np.arange(201))  # four horizons
    assert display.seconds_ax_.get_xlabel() == "age, s"
    display.figure_.canvas.draw()
    assert display.seconds_ax_.get_xlim() == pytest.approx((0, 200 * DT))


def test_factors_of_their_own_have_a_line_each(data):
    model = recursive(data, memory_horizon=(np.inf, np.inf, 20, 20))
    display = ForgettingProfileDisplay.from_estimator({"Λ": model}, n_samples=64)
    first, second = display.lines_
    assert first == "Λ, $a_{1}$, $a_{2}$: λ = 1, $N_0$ = ∞"
    assert second == "Λ, $b_{0}$, $b_{1}$: λ = 0.95, $N_0$ = 20"
    np.testing.assert_allclose(display.weights[second], 0.95 ** np.arange(64))


def test_forgetting_over_time_at_an_instant(data):
    path = np.full(300, 0.99)
    path[100:120] = 0.8
    model = recursive(data, forgetting=lambda t: path)
    display = ForgettingProfileDisplay.from_estimator(model, n_samples=50)
    (label,) = display.lines_
    assert label == "λ = 0.8 to 0.99"
    np.testing.assert_allclose(display.weights[label], 0.99 ** np.arange(50))
    display = ForgettingProfileDisplay.from_estimator(model, time=DT * 119, n_samples=50)
    (weights,) = display.weights.values()
    np.testing.assert_allclose(weights[:21], 0.8 ** np.arange(21))
    np.testing.assert_allclose(weights[21:23], 0.8**20 * 0.99 ** np.array([1, 2]))
    with pytest.raises(ValueError, match=r"time=-1 s is before the first instant"):
        ForgettingProfileDisplay.from_estimator(model, time=-1)


def test_pipelines_and_several_models(data):
    pipeline = make_pipeline(
        DelayShift(delay=NK * DT), RecursiveARX(init="zeros", forgetting=0.9)
    ).fit(*data)
    models = {"short": pipeline, "long": recursive(data)}
    display = ForgettingProfileDisplay.from_estimator(models)
    assert list(display.lines_) == ["short: λ = 0.9, $N_0$ = 10", "long: λ = 1, $N_0$ = ∞"]


def test_refusals(data):
    with pytest.raises(NotFittedError):
        ForgettingProfileDisplay.from_estimator(RecursiveARX())
    with pytest.raises(TypeError, match="got LinearRegression"):
        ForgettingProfileDisplay.from_estimator(LinearRegression().fit(*data))
    with pytest.raises(ValueError, match=r"above 0 and up to 1; 'λ = 1.5' has 1.5"):
        ForgettingProfileDisplay.from_factors([0.9, 1.5])
    with pytest.raises(ValueError, match="'path' has 0"):
        ForgettingProfileDisplay.from_factors({"path": [0.9, 0.0]})
    with pytest.raises(ValueError, match=r"number or an array over time; got the shape \(2, 2\)"):
        ForgettingProfileDisplay.from_factors({"path": np.ones((2, 2))})
    with pytest.raises(ValueError, match=r"array of the shape \(2, 2\)"):
        ForgettingProfileDisplay.from_factors(np.ones((2, 2)))
    with pytest.raises(ValueError, match="0 forgetting factors over 256 samples"):
        ForgettingProfileDisplay.from_factors([])
