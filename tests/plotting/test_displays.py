"""Every Display, by the example of its docstring and each of its kinds."""

from dataclasses import fields, replace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color, to_rgb
from matplotlib.figure import Figure
from support.pictures import COLUMN, DISPLAYS, PICTURES, example, faults_of, picture

from skhoid import plotting
from skhoid.plotting import ROLES, SimulationDisplay

DARK = mpl.style.library["dark_background"]
WORDS = {role.word: role for role in ROLES.values()}
SOME = [("ComparisonDisplay", "overview"), ("SearchDisplay", "ranking"), ("BodeDisplay", None)]
SOME += [("PeopleDisplay", None), ("EnsembleDisplay", None), ("TournamentDisplay", None)]
every_picture = pytest.mark.parametrize(("name", "kind"), PICTURES)
some_pictures = pytest.mark.parametrize(("name", "kind"), SOME)


@pytest.fixture(autouse=True)
def nothing_left():
    yield
    plt.close("all")


@pytest.mark.slow
@every_picture
def test_no_text_overlaps_or_is_cut_off_in_a_column(name, kind):
    with mpl.rc_context(COLUMN):
        display = picture(name, kind).plot(gid="main")
        assert faults_of(display.figure_) == []
    assert display.figure_.get_figwidth() == COLUMN["figure.figsize"][0]
    assert "main" in {artist.get_gid() for artist in display.figure_.findobj()}


@pytest.mark.slow
@some_pictures
def test_nothing_is_black_on_black_and_roles_keep_their_colours(name, kind):
    with mpl.rc_context(DARK):
        display = picture(name, kind).plot()
        for panel in display.figure_.axes:
            behind = np.array(to_rgb(panel.get_facecolor()))
            for line in panel.lines:
                if line.get_linestyle() != "None" and line.get_visible():
                    contrast = np.abs(np.array(to_rgb(line.get_color())) - behind).max()
                    assert contrast > 0.25, line.get_label()
                if role := WORDS.get(str(line.get_label())):
                    assert same_color(line.get_color(), role.colour), line.get_label()
            for text in [*panel.texts, panel.title, panel.xaxis.label, panel.yaxis.label]:
                box = text.get_bbox_patch()
                colour = np.array(to_rgb(text.get_color()))
                around = behind if box is None else np.array(to_rgb(box.get_facecolor()))
                assert np.abs(colour - around).max() > 0.25, text.get_text()


def test_keywords_that_no_artist_has_are_refused():
    with pytest.raises(AttributeError, match="no_such_thing"):
        example("TournamentDisplay").plot(no_such_thing=1)


@pytest.mark.slow
@some_pictures
def test_a_picture_in_axes_of_the_caller_is_the_same(name, kind):
    display = picture(name, kind).plot()
    own = drawn_data(display.axes_.flat)
    figure, axes = plt.subplots(len(own), squeeze=False)
    display.plot(axes.ravel())
    assert display.figure_ is figure
    assert list(display.axes_.flat) == axes.ravel().tolist()
    assert display.ax_ is axes[0, 0]
    for before, after in zip(own, drawn_data(display.axes_.flat), strict=True):
        for one, other in zip(before, after, strict=True):
            np.testing.assert_array_equal(one, other)
    with pytest.raises(ValueError, match="ax holds"):
        display.plot([*axes.ravel(), *axes.ravel(), *axes.ravel()])
    with pytest.raises(TypeError, match="ax must be matplotlib Axes"):
        display.plot("axes")


def drawn_data(panels):
    """Data of the lines that stand in the coordinates of each panel."""
    return [
        [line.get_xydata() for line in panel.lines if line.get_transform() == panel.transData]
        for panel in panels
    ]


@pytest.mark.parametrize("name", ["PeopleDisplay", "GroupEffectsDisplay"])
def test_a_figure_of_the_caller_gets_the_panels(name):
    figure = Figure(layout="constrained")
    display = example(name).plot(figure)
    assert display.figure_ is figure
    assert set(display.axes_.flat) <= set(figure.axes)
    assert figure.legends


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ComparisonDisplay", "ParametersDisplay", "PeopleDisplay"])
def test_widths_follow_the_style(name):
    widths = []
    for width in (1.5, 3.0):
        with mpl.rc_context({"lines.linewidth": width}):
            display = example(name).plot()
        every = [line for panel in display.figure_.axes for line in panel.lines]
        lines = [line for line in every if line.get_linestyle() != "None"]
        widths.append([line.get_linewidth() for line in lines])
    np.testing.assert_allclose(widths[1], 2 * np.array(widths[0]))


@pytest.mark.parametrize("name", DISPLAYS)
def test_displays_are_keyword_dataclasses_that_say_in_short_what_they_show(name):
    cls = getattr(plotting, name)
    assert fields(cls)
    assert all(field.kw_only for field in fields(cls))
    assert cls.__eq__ is object.__eq__  # tables have no truth value
    for text in [cls.__doc__, cls.plot.__doc__]:
        assert "%(" not in text


def test_an_unknown_kind_says_which_there_are():
    with pytest.raises(ValueError, match="kind must be one of 'winners', 'bias', 'settling'"):
        replace(example("TournamentDisplay"), kind="x").plot()


def test_roles_are_one_word_and_one_colour_that_can_be_changed():
    try:
        ROLES["simulated"].colour = "tab:red"
        display = example("SimulationDisplay").plot()
        assert same_color(display.simulated_[0].get_color(), "tab:red")
        with pytest.raises(ValueError, match="A colour of matplotlib is needed"):
            ROLES["simulated"].colour = "no colour"
    finally:
        ROLES["simulated"].colour = "#0072B2"
    with mpl.rc_context(DARK):
        assert same_color(ROLES["measured"].colour, "white")
        assert "foreground" in repr(ROLES["measured"])


def test_names_with_dollars_are_shown_as_they_are():
    rows = dict.fromkeys(["measured", "simulated"], np.arange(20.0)) | {"scored": True}
    trace = pd.DataFrame(rows, index=np.arange(20) / 10)
    display = SimulationDisplay(traces={"run $1 of $2": trace}).plot()
    plotting.names_as_they_are(display.figure_, ["run $1 of $2"])
    assert display.ax_.get_title("left").startswith("run $1 of $2")
    display.figure_.draw_without_rendering()
