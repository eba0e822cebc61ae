"""The pictures of people show the tables of the identification, the search and the mixed model."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import same_color
from sklearn.exceptions import NotFittedError
from support.made_up_people import made_up_group, made_up_people
from support.parameter_tables import simulated
from support.plot_checks import VERMILION, covers_nothing

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.lab.experiment import mixed_model
from skhoid.lab.experiment.group import GroupEffectSearch
from skhoid.plotting import ROLES, GroupEffectsDisplay, GroupMeansDisplay, PeopleDisplay


@pytest.fixture(autouse=True)
def nothing_left():
    yield
    plt.close("all")


def of_label(panel, label):
    """Data of the lines of a label."""
    return [line.get_xydata() for line in panel.lines if line.get_label() == label]


def test_runs_levels_and_ceilings_are_those_of_the_tables():
    people = made_up_people(failing=("S2", "C2"))
    display = PeopleDisplay.from_result(people)
    assert (display.people_, display.conditions_) == (["S1", "S2", "S3"], ["C1", "C2"])
    first, second, third = display.axes_
    own = people.runs[people.runs["subject"] == "S1"]
    np.testing.assert_array_equal(of_label(first, "run")[0][:, 1], own["vaf"])
    assert [line[0, 1] for line in of_label(first, "all runs in one fit")] == [80.0, 81.0]
    assert [line[0, 1] for line in of_label(first, ROLES["ceiling"].word)] == [84.0, 84.0]
    assert [line[0, 0] for line in of_label(second, "no fit")] == [1]
    assert len(of_label(third, "looks wrong")[0]) == 1
    titles = [panel.title for panel in display.axes_]
    assert [title.get_text() for title in titles] == ["S1", "S2", "S3 (!)"]
    assert same_color(titles[2].get_color(), ROLES["misfit"].colour)


def test_a_run_far_below_is_a_mark_at_the_edge():
    people = made_up_people()
    people.runs.loc[4, "vaf"] = -500.0
    display = PeopleDisplay.from_result(people, people=["S1"])
    assert display.ax_.get_ylim()[0] > -40
    assert len(of_label(display.ax_, "run below the panel")[0]) == 1
    with pytest.raises(ValueError, match="one of 'S1', 'S2', 'S3'; got 'S9'"):
        PeopleDisplay.from_result(people, people=["S9"])


def test_cells_are_probabilities_and_intervals_are_prevalences():
    group = made_up_group(made_up_people())
    display = GroupEffectsDisplay.from_search(group)
    rows = [(e, c) for e in ("saturation", "dead_zone") for c in ("all", "C1", "C2")]
    assert display.rows_ == rows
    matrix, forest = display.axes_
    cells = np.ma.filled(matrix.collections[0].get_array(), np.nan).reshape(len(rows), 3)
    np.testing.assert_allclose(cells[1], [0.97, 0.97, 0.03])
    assert np.isnan(cells[0]).all()  # over all conditions there are no cells
    assert of_label(matrix, "named in this person alone")[0].tolist() == [[0, 1], [0, 2]]
    table = group.prevalence_.set_index(["effect", "condition"])
    intervals = [line for line in forest.lines if len(line.get_xdata()) == 2][: len(rows)]
    for key, line in zip(rows, intervals, strict=True):
        np.testing.assert_allclose(line.get_xdata(), 100 * table.loc[key, ["low", "high"]])
        assert same_color(line.get_color(), VERMILION) == table.loc[key, "group"]
    assert of_label(forest, "least of the group, 25 %")[0][0, 0] == 25
    weights = [label.get_fontweight() for label in matrix.get_yticklabels()]
    assert (weights[0], weights[3]) == ("bold", "normal")


def test_one_condition_has_one_row_for_each_effect_and_none_says_so():
    group = made_up_group(made_up_people(conditions=("all",)))
    group.prevalence_ = group.prevalence_.drop_duplicates("effect")
    rows = [("saturation", "all"), ("dead_zone", "all")]
    assert GroupEffectsDisplay.from_search(group).rows_ == rows
    group.prevalence_, group.members_ = group.prevalence_[:0], group.members_[:0]
    display = GroupEffectsDisplay.from_search(group)
    assert display.ax_.texts[0].get_text() == "No effect in anybody."
    search = GroupEffectSearch(EffectSearchCV(OperatorRegressor()))
    with pytest.raises(NotFittedError):
        GroupEffectsDisplay.from_search(search)


@pytest.fixture(scope="module")
def means():
    return mixed_model(simulated(effect=0.06), "K_e")


def test_forest_shows_people_and_the_mean_of_the_model(means):
    display = GroupMeansDisplay.from_result(means, "forest")
    assert display.conditions_ == ["C1", "C2", "C3", "C4"]
    for condition, panel in zip(display.conditions_, display.axes_, strict=True):
        own = means.own_means[means.own_means["condition"] == condition]
        squares = [line.get_xdata()[0] for line in panel.lines if line.get_marker() == "s"]
        np.testing.assert_allclose(squares, own["estimate"])
        row = means.effects.set_index("condition").loc[condition]
        corners = panel.patches[0].get_xy()[:4, 0]
        np.testing.assert_allclose(corners, [row["low"], row["mean"], row["high"], row["mean"]])
    assert display.ax_.get_yticklabels()[-1].get_text() == "mean"
    covers_nothing(display)


def test_lines_of_people_and_brackets_of_what_is_significant(means):
    display = GroupMeansDisplay.from_result(means)
    (drawn,) = [line for line in display.ax_.lines if line.get_marker() == "D"]
    np.testing.assert_allclose(drawn.get_ydata().astype(float), means.effects["mean"])
    people = of_label(display.ax_, "people, mean of runs")
    assert len(people) == 12
    wanted = means.contrasts[means.contrasts["p_adjusted"] < 0.05]
    brackets = [line for line in display.ax_.lines if len(line.get_xdata()) == 4]
    brackets = [line.get_xydata() for line in brackets if line.get_marker() == "None"]
    pairs = {tuple(display.conditions_[int(x)] for x in line[[0, 3], 0]) for line in brackets}
    assert pairs == {tuple(sorted(p)) for p in wanted[["condition", "against"]].to_numpy()}
    assert min(line[1, 1] for line in brackets) > np.nanmax(people, axis=None)
    covers_nothing(display)


def test_none_significant_is_said():
    result = mixed_model(simulated(2, effect=0.0), "K_e", transform="log")
    said = [text.get_text() for text in GroupMeansDisplay.from_result(result).ax_.texts]
    assert said == ["no contrast with p < 0.05 (Holm)"]
