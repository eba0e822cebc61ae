import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student
from sklearn.pipeline import make_pipeline
from support.pictures import legend_texts

from skhoid import ARXRegressor, ControlledElement, DelayShift, HumanOperator
from skhoid.interpret import FrequencyResponse
from skhoid.plotting import ROLES, BodeDisplay

DENSE = np.geomspace(0.1, 40.0, 200)
LINES = np.array([0.3, 1.0, 3.0, 9.0, 17.0])


@pytest.fixture(scope="module")
def operator():
    return FrequencyResponse.of(HumanOperator(), DENSE)


@pytest.fixture(scope="module")
def measured():
    """Four noisy runs at sparse lines."""
    rng = np.random.default_rng(0)
    truth = HumanOperator().frequency_response(LINES)
    noise = 0.05 * (rng.standard_normal((4, 5)) + 1j * rng.standard_normal((4, 5)))
    return FrequencyResponse(LINES, truth * (1 + noise))


@pytest.fixture(scope="module")
def model():
    rng = np.random.default_rng(1)
    e = rng.standard_normal(2000)
    u = np.zeros(2000)
    for k in range(10, 2000):
        u[k] = 0.8 * u[k - 1] + 0.1 * e[k - 10] + 0.02 * rng.standard_normal()
    pipeline = make_pipeline(DelayShift(0.1, dt=0.02), ARXRegressor(na=1, nb=1, nk=5, dt=0.02))
    return pipeline.fit(e[:, None], u)


def test_curves_and_markers_are_the_responses(operator, measured):
    display = BodeDisplay.from_responses({"model": operator, "data": measured})
    curve, markers = display.magnitude_.values()
    np.testing.assert_array_equal(curve.get_xdata(), DENSE)
    np.testing.assert_allclose(curve.get_ydata(), operator.magnitude)
    np.testing.assert_allclose(display.phase_["model"].get_ydata(), operator.phase)
    assert (curve.get_linestyle(), curve.get_marker()) == ("-", "None")
    mean = measured.mean(standard_error=True)
    np.testing.assert_allclose(markers.get_ydata(), mean.magnitude)
    assert markers.get_linestyle() == "None"
    assert list(display.magnitude_) == ["model", "data, mean of 4 runs"]
    z = student.ppf(0.975, 3)  # the spread of four runs
    bars, phase_bars = (panel.collections[0] for panel in display.axes_)
    ends = np.array(bars.get_segments())[:, :, 1]
    factor = np.exp(z * mean.magnitude_sd / mean.magnitude)
    np.testing.assert_allclose(ends.T, [mean.magnitude / factor, mean.magnitude * factor])
    ends = np.array(phase_bars.get_segments())[:, :, 1]
    np.testing.assert_allclose(np.diff(ends.T, axis=0)[0], 2 * z * mean.phase_sd)
    top, bottom = display.axes_
    assert (top.get_xscale(), top.get_yscale(), bottom.get_xscale()) == ("log",) * 3
    assert legend_texts(display)[-1] == "95 % intervals"
    assert (bottom.get_xlabel(), bottom.get_ylabel()) == ("frequency, rad/s", "phase, deg")
    assert display.crossover_ is None


def test_the_truth_looks_like_the_truth(operator):
    shown = dict.fromkeys(["a", "truth", "b", "c"], operator)
    lines = BodeDisplay.from_responses(shown).magnitude_
    colours = [line.get_color() for line in lines.values()]
    truth = ROLES["truth"]
    assert (colours[1], lines["truth"].get_linestyle()) == (truth.colour, truth.line)
    assert len(set(colours)) == 4


def test_noisy_phases_come_near_the_curve(operator):
    truth = HumanOperator().frequency_response(LINES)
    slipped = FrequencyResponse(LINES, truth, delay=-0.4)  # a wrong delay unwraps wrongly
    display = BodeDisplay.from_responses([operator, slipped])
    expected = FrequencyResponse.of(HumanOperator(), LINES).phase
    np.testing.assert_allclose(display.phase_["response 2"].get_ydata(), expected)


def test_estimator_with_its_band_and_nyquist(model):
    display = BodeDisplay.from_estimator(model)
    nyquist = np.pi / 0.02
    line = display.magnitude_["ARXRegressor"]
    assert line.get_xdata()[[0, -1]] == pytest.approx([0.1, nyquist])
    expected = FrequencyResponse.of(model, line.get_xdata())
    np.testing.assert_allclose(line.get_ydata(), expected.magnitude)
    assert expected.delay == pytest.approx(0.2)
    for panel in display.axes_:
        dashed = [a for a in panel.lines if a.get_linestyle() == "--"]
        assert dashed[0].get_xdata()[0] == pytest.approx(nyquist)
    band = display.ax_.collections[0]
    vertices = band.get_paths()[0].vertices
    upper = expected.magnitude * np.exp(
        norm.ppf(0.975) * expected.magnitude_sd / expected.magnitude
    )
    assert vertices[:, 1].max() == pytest.approx(upper.max())
    assert display.axes_[1].get_ylim()[0] >= -720  # the delay does not flatten the plot


def test_open_loop_marks_crossover_and_margin(operator):
    element = ControlledElement()
    display = BodeDisplay.from_estimator(
        HumanOperator(), DENSE, controlled_element=element, compare={"same": operator}
    )
    np.testing.assert_allclose(display.crossover_.loc["same"], [1.5635, 76.67], rtol=1e-3)
    assert list(display.crossover_.index) == ["same", "HumanOperator"]
    found = "$\\omega_c$ = 1.56 rad/s, $\\varphi_m$ = 77°"
    for name in ("same", "HumanOperator"):
        assert f"{name}: {found}" in " ".join(legend_texts(display)).replace("\n", " ")
    dotted = [a for a in display.axes_[0].lines if a.get_linestyle() == ":"]
    assert dotted[0].get_xdata()[0] == pytest.approx(1.5635, rel=1e-3)
    segment = next(a for a in display.axes_[1].lines if a.get_linewidth() == 3.0)
    np.testing.assert_allclose(segment.get_ydata(), [-180, -103.3], atol=0.1)


def test_open_loop_without_crossover_says_so(operator):
    display = BodeDisplay.from_responses([operator * 1e-3], view="open_loop")
    assert display.crossover_.isna().all(axis=None)
    assert "no crossover" in legend_texts(display)[-1]


def test_lost_lines_leave_gaps(operator):
    holed = FrequencyResponse(LINES, [np.nan, 1.0, 1j, np.nan, -1.0])
    display = BodeDisplay.from_responses({"holed": holed, "model": operator})
    assert np.isnan(display.magnitude_["holed"].get_ydata()).tolist() == [
        True,
        False,
        False,
        True,
        False,
    ]
    everything_lost = FrequencyResponse(LINES, np.full(5, np.nan))
    BodeDisplay.from_responses({"lost": everything_lost})
