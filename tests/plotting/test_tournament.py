"""Pictures of tournaments show the losses, errors and settling times of their methods."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from support.plot_checks import BLUE, VERMILION, covers_nothing

from skhoid.plotting import TournamentDisplay


@pytest.fixture(autouse=True)
def nothing_left():
    yield
    plt.close("all")


def winners():
    cells = [
        (p, r, c) for p in ("causal", "offline") for r in ("C1", "C4") for c in ("0.05", "0.15")
    ]
    table = pd.DataFrame(cells, columns=["panel", "row", "column"])
    table["method"] = ["rls", "rls", "ukf", "rls"] * 2
    table["loss"] = [4.0, 9.0, 11.0, 17.4] * 2
    return table.assign(next_loss=[8.0, 9.2, 20.0, 30.0] * 2)


def of_parameters():
    table = pd.MultiIndex.from_product(
        [["K_edot", "omega_nm", "tau_e"], ["rls", "arx"]], names=["parameter", "method"]
    ).to_frame(index=False)
    table["causal"] = table["method"] == "rls"
    return table.assign(bias=np.arange(1.0, 7.0), sd=[5.0, 4, 3, 2, 1, np.nan])


def settling():
    table = pd.MultiIndex.from_product(
        [["rls", "sigmoid", "arx"], [0.05, 0.15, 0.25]], names=["method", "remnant_intensity"]
    ).to_frame(index=False)
    table["causal"] = table["method"] == "rls"
    table["noise"] = np.arange(1.0, 10.0)
    table["settling"] = [5.0, 6, 8, 1, 1, 2, np.inf, np.inf, np.inf]
    return table


def test_cells_have_the_colour_of_the_best_and_its_loss():
    display = TournamentDisplay(table=winners()).plot()
    assert display.methods_ == ["rls", "ukf"]
    cell = display.patches_[0]["C4", "0.05"]
    assert same_color(cell.get_facecolor(), VERMILION)
    assert same_color(display.patches_[1]["C1", "0.05"].get_facecolor(), BLUE)
    # The next method is within 5 %.
    assert not same_color(display.patches_[0]["C1", "0.15"].get_facecolor(), BLUE)
    assert display.texts_[0]["C4", "0.15"].get_text() == "17"
    assert display.texts_[0]["C1", "0.05"].get_text() == "4.0"
    covers_nothing(display)


def test_marks_stand_at_bias_and_deviation_in_a_panel_for_each_parameter():
    display = TournamentDisplay(table=of_parameters(), kind="bias").plot()
    assert [panel.get_title() for panel in display.axes_] == [
        r"$K_{\dot e}$",
        r"$\omega_{nm}$",
        r"$\tau_e$",
    ]
    assert display.points_["omega_nm", "arx"].get_xydata().tolist() == [[4.0, 2.0]]
    causal, offline = display.points_["K_edot", "rls"], display.points_["K_edot", "arx"]
    assert same_color(causal.get_markerfacecolor(), causal.get_color())
    assert not same_color(offline.get_markerfacecolor(), offline.get_color())


def test_a_line_for_each_method_and_larger_marks_for_more_remnant():
    display = TournamentDisplay(table=settling(), kind="settling").plot()
    np.testing.assert_array_equal(display.lines_["rls"].get_xydata(), [[1, 5], [2, 6], [3, 8]])
    sizes = [display.points_["rls", P].get_markersize() for P in (0.05, 0.15, 0.25)]
    assert sizes == sorted(set(sizes))
    covers_nothing(display)
    np.testing.assert_allclose(display.lines_["arx"].get_ydata(), 1.5 * 8)
    assert display.ax_.get_yticklabels()[-1].get_text() == "never"


def test_settling_of_one_intensity_and_of_methods_that_all_settle():
    table = settling().replace(np.inf, 3.0)
    one = table[table["remnant_intensity"] == 0.15]
    display = TournamentDisplay(table=one, kind="settling").plot()
    assert display.ax_.get_title() == ""
    assert "never" not in [label.get_text() for label in display.ax_.get_yticklabels()]
    own = one.assign(remnant_intensity=np.nan)
    assert len(TournamentDisplay(table=own, kind="settling").plot().points_) == 3


@pytest.mark.parametrize(
    ("kind", "table"), [("winners", winners()), ("bias", of_parameters()), ("settling", settling())]
)
def test_a_table_without_a_column_is_refused(kind, table):
    with pytest.raises(ValueError, match="no column 'method'"):
        TournamentDisplay(table=table.drop(columns="method"), kind=kind).plot()
