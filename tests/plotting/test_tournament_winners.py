import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from support.plot_checks import covers_nothing

from skhoid.plotting._roles import series_colour
from skhoid.plotting.tournament_winners import TournamentWinnersDisplay

CELLS = [("C1", 0.05), ("C1", 0.15), ("C4", 0.05), ("C4", 0.15), ("drift", 0.15)]


def winners():
    table = pd.DataFrame(CELLS, columns=["row", "column"]).assign(panel="causal methods")
    table["column"] = table["column"].map("{:g}".format)
    table["method"] = ["ukf", "rls", "rls", "rls", "iv"]
    table["loss"] = [3.2, 8.0, 11.0, 99.8, 20.0]
    table["next_loss"] = [3.3, 12.0, 15.0, np.inf, 30.0]
    return table


def test_each_cell_has_the_colour_of_its_winner():
    display = TournamentWinnersDisplay(winners=winners()).plot()
    assert display.methods_ == ["rls", "ukf", "iv"]
    (patches,), (texts,) = display.patches_, display.texts_
    assert set(patches) == {(row, f"{column:g}") for row, column in CELLS}
    assert to_hex(patches["C4", "0.05"].get_facecolor()) == series_colour(0).lower()
    assert to_hex(patches["drift", "0.15"].get_facecolor()) == series_colour(2).lower()
    assert texts["C4", "0.05"].get_text() == "11"
    assert texts["C4", "0.15"].get_text() == "100"
    assert patches["drift", "0.15"].get_xy() == (0.5, 1.5)
    covers_nothing(display)


def test_a_close_race_is_pale():
    display = TournamentWinnersDisplay(winners=winners()).plot()
    (patches,) = display.patches_
    pale = to_hex(patches["C1", "0.05"].get_facecolor())
    assert pale != series_colour(1).lower()
    assert np.mean(patches["C1", "0.05"].get_facecolor()[:3]) > np.mean(
        display.figure_.legends[0].get_patches()[1].get_facecolor()[:3]
    )


def test_two_panels_share_rows_and_colours():
    both = pd.concat([winners(), winners().assign(panel="offline methods", method="rls")])
    display = TournamentWinnersDisplay(winners=both).plot()
    assert [ax.get_title() for ax in display.axes_] == ["causal methods", "offline methods"]
    assert display.axes_[0].get_ylim() == display.axes_[1].get_ylim() == (2.5, -0.5)
    covers_nothing(display)


def test_given_axes_styles_and_refusals():
    ax = Figure().subplots()
    display = TournamentWinnersDisplay(winners=winners()).plot(ax, cell_kw={"alpha": 0.5})
    assert display.ax_ is ax
    assert {patch.get_alpha() for patch in display.patches_[0].values()} == {0.5}
    with pytest.raises(ValueError, match="no column 'loss'"):
        TournamentWinnersDisplay(winners=winners().drop(columns="loss")).plot()
