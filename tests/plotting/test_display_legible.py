"""Every Display at the width of a screen and of one journal column, on white and on black."""

import inspect
from functools import cache

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import same_color, to_rgb
from support.pictures import COLUMN, DISPLAYS, STYLES, example, faults_of

from skhoid import plotting
from skhoid.plotting import ROLES

DARK = mpl.style.library["dark_background"]
WORDS = {role.word: role for role in ROLES.values()}
QUICK = ("BodeDisplay", "ErrorPathDisplay", "SimulationDisplay", "StudyPathDisplay")
SLOW_BUT_FOR_SOME = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in DISPLAYS
]
made = cache(example)


@pytest.fixture(autouse=True)
def nothing_left():
    yield
    plt.close("all")


def drawn(name, settings, **keywords):
    display = made(name)
    with mpl.rc_context(settings):
        display.plot(**keywords)
        faults = faults_of(display.figure_)
    return display, faults


@pytest.mark.parametrize("style", ["screen", "column"])
@pytest.mark.parametrize("name", SLOW_BUT_FOR_SOME)
def test_no_text_overlaps_or_is_cut_off(name, style):
    _, faults = drawn(name, STYLES[style])
    assert faults == []


@pytest.mark.slow
@pytest.mark.parametrize("name", DISPLAYS)
def test_figures_are_as_wide_as_the_style_says(name):
    display, _ = drawn(name, COLUMN)
    assert display.figure_.get_figwidth() == COLUMN["figure.figsize"][0]


@pytest.mark.slow
@pytest.mark.parametrize("name", DISPLAYS)
def test_nothing_is_black_on_black(name):
    display, _ = drawn(name, DARK)
    for panel in display.figure_.axes:
        behind = np.array(to_rgb(panel.get_facecolor()))
        for line in panel.lines:
            if line.get_linestyle() != "None" and line.get_visible():
                contrast = np.abs(np.array(to_rgb(line.get_color())) - behind).max()
                assert contrast > 0.25, line.get_label()
        for text in [*panel.texts, panel.title, panel.xaxis.label, panel.yaxis.label]:
            box = text.get_bbox_patch()
            colour = np.array(to_rgb(text.get_color()))
            around = behind if box is None else np.array(to_rgb(box.get_facecolor()))
            assert np.abs(colour - around).max() > 0.25, text.get_text()


@pytest.mark.parametrize("settings", [{}, DARK], ids=["white", "black"])
@pytest.mark.slow
@pytest.mark.parametrize("name", DISPLAYS)
def test_a_word_of_a_role_has_its_colour(name, settings):
    with mpl.rc_context(settings):
        display = made(name).plot()
        for panel in display.figure_.axes:
            for line in panel.lines:
                if role := WORDS.get(str(line.get_label())):
                    assert same_color(line.get_color(), role.colour), line.get_label()


def keywords_of(name):
    parameters = inspect.signature(getattr(plotting, name).plot).parameters
    return [key for key in parameters if key.endswith("_kw")]


@pytest.mark.slow
@pytest.mark.parametrize("name", DISPLAYS)
def test_every_keyword_reaches_something_if_it_is_drawn(name):
    keys = keywords_of(name)
    assert keys
    display, _ = drawn(name, {}, **{key: {"gid": f"by {key}"} for key in keys})
    reached = {artist.get_gid() for artist in display.figure_.findobj()}
    assert reached & {f"by {key}" for key in keys}
    with pytest.raises(AttributeError, match="no_such_thing"):
        display.plot(**{key: {"no_such_thing": 1} for key in keys})


@pytest.mark.slow
@pytest.mark.parametrize("name", DISPLAYS)
def test_widths_follow_the_style(name):
    widths = []
    for width in (1.5, 3.0):
        display, _ = drawn(name, {"lines.linewidth": width})
        every = [line for panel in display.figure_.axes for line in panel.lines]
        lines = [line for line in every if line.get_linestyle() != "None"]
        widths.append([line.get_linewidth() for line in lines])
    np.testing.assert_allclose(widths[1], 2 * np.array(widths[0]))
