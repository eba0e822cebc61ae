"""Means of people and of the group are those of the mixed model."""

import numpy as np
import pytest
from support.parameter_tables import simulated
from support.plot_checks import covers_nothing

from skhoid.lab.experiment import mixed_model
from skhoid.plotting import GroupMeansDisplay


@pytest.fixture(scope="module")
def result():
    return mixed_model(simulated(effect=0.06), "K_e")


def test_forest_shows_people_and_the_mean_of_the_model(result):
    display = GroupMeansDisplay.from_result(result, "forest")
    assert display.conditions_ == ["C1", "C2", "C3", "C4"]
    assert ("S11", "C4") not in display.points_
    used = result.data[(result.data["subject"] == "S2") & (result.data["condition"] == "C3")]
    mean = np.average(used["value"], weights=used["weight"])
    assert display.points_["S2", "C3"].get_xdata()[0] == pytest.approx(mean)
    low, high = display.intervals_["S2", "C3"].get_xdata()
    assert low < mean < high
    row = result.effects.iloc[1]
    corners = display.means_["C2"].get_xy()[:4, 0]
    np.testing.assert_allclose(corners, [row["low"], row["mean"], row["high"], row["mean"]])
    labels = [tick.get_text() for tick in display.ax_.get_yticklabels()]
    assert labels == [*display.subjects_, "mean"]
    assert display.ax_.get_ylim()[0] > display.ax_.get_ylim()[1]
    covers_nothing(display)


def test_lines_of_people_and_brackets_of_what_is_significant(result):
    display = GroupMeansDisplay.from_result(result)
    np.testing.assert_allclose(display.means_["all"].get_ydata(), result.effects["mean"])
    assert len(display.points_) == 12
    assert np.isnan(display.points_["S11"].get_ydata()[3])
    ends = result.effects.loc[0, ["low", "high"]].astype(float)
    np.testing.assert_allclose(display.intervals_["C1"].get_ydata(), ends)
    wanted = result.contrasts[result.contrasts["p_adjusted"] < 0.05]
    assert 0 < len(wanted) < 6
    assert set(display.brackets_) == set(zip(wanted["condition"], wanted["against"], strict=True))
    heights = [line.get_ydata()[1] for line in display.brackets_.values()]
    assert len(set(heights)) == len(heights)
    assert min(heights) > np.nanmax([line.get_ydata() for line in display.points_.values()])
    covers_nothing(display)


@pytest.mark.slow
def test_none_significant_is_said():
    result = mixed_model(simulated(2, effect=0.0), "K_e", transform="log")
    display = GroupMeansDisplay.from_result(result)
    assert not display.brackets_
    said = [text.get_text() for text in display.ax_.texts]
    assert said == ["no contrast with p < 0.05 (Holm)"]
