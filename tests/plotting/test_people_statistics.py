import numpy as np
import pytest
from matplotlib import pyplot as plt
from support.parameter_tables import simulated
from support.plot_checks import covers_nothing

from skhoid.lab.experiment import mixed_model
from skhoid.plotting.condition_means import ConditionMeansDisplay
from skhoid.plotting.parameter_forest import ParameterForestDisplay


@pytest.fixture(scope="module")
def result():
    return mixed_model(simulated(effect=0.06), "K_e")


def test_forest_shows_people_and_the_mean_of_the_model(result):
    display = ParameterForestDisplay.from_result(result)
    assert display.conditions_ == ["C1", "C2", "C3", "C4"]
    assert ("S11", "C4") not in display.points_
    used = result.data[(result.data["subject"] == "S2") & (result.data["condition"] == "C3")]
    mean = np.average(used["value"], weights=used["weight"])
    assert display.points_["S2", "C3"].get_xdata()[0] == pytest.approx(mean)
    low, high = display.intervals_["S2", "C3"].get_xdata()
    assert low < mean < high
    row = result.effects.iloc[1]
    corners = display.diamonds_["C2"].get_xy()[:4, 0]
    np.testing.assert_allclose(corners, [row["low"], row["mean"], row["high"], row["mean"]])
    labels = [tick.get_text() for tick in display.ax_[0].get_yticklabels()]
    assert labels == [*display.subjects_, "mean"]
    assert display.ax_[0].get_ylim()[0] > display.ax_[0].get_ylim()[1]
    covers_nothing(display)


def test_lines_of_people_and_brackets_of_what_is_significant(result):
    display = ConditionMeansDisplay.from_result(result)
    np.testing.assert_allclose(display.mean_.get_ydata(), result.effects["mean"])
    assert len(display.lines_) == 12
    assert np.isnan(display.lines_["S11"].get_ydata()[3])
    np.testing.assert_allclose(
        display.intervals_["C1"].get_ydata(), result.effects.loc[0, ["low", "high"]].astype(float)
    )
    wanted = result.contrasts[result.contrasts["p_adjusted"] < 0.05]
    assert 0 < len(wanted) < 6
    assert set(display.brackets_) == set(zip(wanted["condition"], wanted["against"], strict=True))
    heights = [line.get_ydata()[1] for line in display.brackets_.values()]
    assert len(set(heights)) == len(heights)
    assert min(heights) > np.nanmax([line.get_ydata() for line in display.lines_.values()])
    covers_nothing(display)


@pytest.mark.slow
def test_none_significant_is_said():
    display = ConditionMeansDisplay.from_result(
        mixed_model(simulated(2, effect=0.0), "K_e", transform="log")
    )
    assert not display.brackets_
    assert display.note_.get_text() == "no contrast with p < 0.05 (holm)"


@pytest.mark.slow
def test_given_axes_and_styles_are_used(result):
    _, axes = plt.subplots(1, 4)
    display = ParameterForestDisplay.from_result(result, ax=axes, point_kw={"color": "red"})
    assert display.ax_[0] is axes[0]
    assert display.points_["S1", "C1"].get_color() == "red"
    _, ax = plt.subplots()
    assert ConditionMeansDisplay.from_result(result, ax=ax, mean_kw={"lw": 3}).ax_ is ax


def test_own_intervals_are_wider_where_a_person_is_less_certain():
    """Half-widths are those of the cell's weight: the shares of its runs add up to 1 in all."""
    found = mixed_model(simulated(), "K_e")
    own = found.own_means.set_index(["subject", "condition"])
    weight = found.data.dropna(subset="weight").groupby(["subject", "condition"])["cell_weight"]
    half = (own["high"] - own["low"]) / 2 * np.sqrt(weight.first())
    np.testing.assert_allclose(half, half.iloc[0])
    assert weight.first().max() > 1.5 * weight.first().min()
