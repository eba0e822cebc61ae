"""The pictures of people show the tables of the identification and of the search."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import same_color
from sklearn.exceptions import NotFittedError
from support.made_up_people import made_up_group, made_up_people
from support.plot_checks import VERMILION

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.lab.experiment.group import GroupEffectSearch
from skhoid.plotting import ROLES, GroupEffectsDisplay, PeopleDisplay


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_runs_levels_and_ceilings_are_those_of_the_tables():
    people = made_up_people(failing=("S2", "C2"))
    display = PeopleDisplay.from_result(people)
    assert (display.people_, display.conditions_) == (["S1", "S2", "S3"], ["C1", "C2"])
    own = people.runs[people.runs["subject"] == "S1"]
    np.testing.assert_array_equal(display.dots_["S1"].get_ydata(), own["vaf"])
    assert [s[0, 1] for s in display.levels_["S1"].get_segments()] == [80.0, 81.0]
    assert [s[0, 1] for s in display.ceilings_["S1"].get_segments()] == [84.0, 84.0]
    assert list(display.failed_) == ["S2"]
    assert list(display.failed_["S2"].get_xdata()) == [1]
    assert list(display.outlying_) == ["S3"]
    assert len(display.outlying_["S3"].get_xdata()) == 1
    titles = [panel.title for panel in display.axes_]
    assert [title.get_text() for title in titles] == ["S1", "S2", "S3 (!)"]
    assert same_color(titles[2].get_color(), ROLES["misfit"].colour)


def test_a_run_far_below_the_others_does_not_squeeze_them():
    people = made_up_people()
    people.runs.loc[4, "vaf"] = -500.0
    display = PeopleDisplay.from_result(people, people=["S1"])
    low, _ = display.axes_[0].get_ylim()
    assert low > 50
    shown = [line for line in display.axes_[0].lines if line.get_marker() == "v"]
    assert [len(line.get_xdata()) for line in shown] == [1]


def test_nobody_unknown_is_drawn():
    with pytest.raises(ValueError, match="one of 'S1', 'S2', 'S3'; got 'S9'"):
        PeopleDisplay.from_result(made_up_people(), people=["S9"])


def test_cells_are_probabilities_and_intervals_are_prevalences():
    group = made_up_group(made_up_people())
    display = GroupEffectsDisplay.from_search(group)
    rows = [(e, c) for e in ("saturation", "dead_zone") for c in ("all", "C1", "C2")]
    assert display.rows_ == rows
    cells = np.ma.filled(display.cells_.get_array(), np.nan).reshape(len(rows), 3)
    np.testing.assert_allclose(cells[1], [0.97, 0.97, 0.03])
    assert np.isnan(cells[0]).all()  # over all conditions there are no cells
    assert list(zip(*display.named_.get_data(), strict=True)) == [(0, 1), (0, 2)]
    table = group.prevalence_.set_index(["effect", "condition"])
    for key, line in display.intervals_.items():
        np.testing.assert_allclose(line.get_xdata(), 100 * table.loc[key, ["low", "high"]])
        assert same_color(line.get_color(), VERMILION) == table.loc[key, "group"]
    assert display.line_.get_xdata()[0] == 25
    weights = [label.get_fontweight() for label in display.axes_[0].get_yticklabels()]
    assert (weights[0], weights[3]) == ("bold", "normal")


def test_one_condition_has_one_row_for_each_effect():
    people = made_up_people(conditions=("all",))
    group = made_up_group(people)
    group.prevalence_ = group.prevalence_.drop_duplicates("effect")
    assert GroupEffectsDisplay.from_search(group).rows_ == [
        ("saturation", "all"),
        ("dead_zone", "all"),
    ]


def test_a_search_without_effects_says_so():
    group = made_up_group(made_up_people())
    group.prevalence_, group.members_ = group.prevalence_[:0], group.members_[:0]
    display = GroupEffectsDisplay.from_search(group)
    assert display.axes_[0].texts[0].get_text() == "No effect in anybody."


def test_only_a_fitted_group_search_is_drawn():
    search = EffectSearchCV(OperatorRegressor())
    with pytest.raises(TypeError, match="got EffectSearchCV"):
        GroupEffectsDisplay.from_search(search)
    with pytest.raises(NotFittedError):
        GroupEffectsDisplay.from_search(GroupEffectSearch(search))
