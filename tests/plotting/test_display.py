"""Every Display follows one convention: keyword fields, and Axes that are taken in one way."""

from dataclasses import fields

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from skhoid import plotting
from skhoid.plotting._display import Display

DISPLAYS = [name for name in plotting.__all__ if name.endswith("Display")]


@pytest.mark.parametrize("name", DISPLAYS)
def test_displays_are_keyword_dataclasses_on_one_base(name):
    cls = getattr(plotting, name)
    assert issubclass(cls, Display)
    assert "__dataclass_fields__" in vars(cls)
    assert fields(cls)
    assert all(field.kw_only for field in fields(cls))
    # Tables have no truth value, and no short text of their own.
    assert cls.__eq__ is object.__eq__
    assert cls.__repr__ is Display.__repr__


def test_a_display_says_in_short_what_it_shows():
    path = pd.DataFrame({"effect": ["baseline", "bias"], "vaf": [50.0, 60.0], "rmse": [2.0, 1.0]})
    path = path.assign(ceiling=np.nan, explainable_gap=np.nan)
    display = plotting.ErrorPathDisplay(
        error_path=path, best_effects=["bias"], verdict="effects found", unit="deg"
    )
    told = repr(display)
    assert told.startswith("<ErrorPathDisplay: error_path of 2 rows, verdict 'effects found'")
    assert len(told) < 120
    assert repr(Display()) == "<Display>"


def test_a_figure_of_its_own_has_the_panels_used_in_their_order():
    display = Display()
    panels = display._take_axes(None, "three", (2, 2), used=[0, 2, 1])
    assert display.figure_.axes == [panels[0], panels[2], panels[1]]
    plt.close(display.figure_)


def test_given_axes_are_taken_in_order():
    figure, grid = plt.subplots(2, 2)
    display = Display()
    assert display._take_axes(grid, "four", (2, 2)).tolist() == grid.ravel().tolist()
    assert display._take_axes(grid[0, 1], "one").tolist() == [grid[0, 1]]
    assert display._take_axes(grid[0], "two or four", (4, 1), allowed=(2, 4)).size == 2
    assert display.figure_ is figure
    with pytest.raises(ValueError, match="ax holds 4 Axes; this plot needs 1 or 2: a pair"):
        display._take_axes(grid, "a pair", allowed=(1, 2))
    with pytest.raises(TypeError, match="or a sequence of them; got float"):
        display._take_axes(np.zeros(2), "two", (2, 1))
    plt.close(figure)


@pytest.mark.parametrize("own", [True, False])
def test_the_legend_is_below_a_figure_of_its_own_or_in_the_first_axes_given(own):
    figure, given = plt.subplots(2)
    display = Display()
    panels = display._take_axes(None if own else given, "two", (2, 1))
    for panel in panels:
        panel.plot([0, 1], label="once")
    display._legend_of_panels()
    holder = display.figure_.legends[0] if own else panels[0].get_legend()
    assert [text.get_text() for text in holder.get_texts()] == ["once"]
    assert panels[1].get_legend() is None
    plt.close(figure)
    plt.close(display.figure_)
