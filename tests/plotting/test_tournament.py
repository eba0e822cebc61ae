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


def test_cells_have_the_colour_of_the_best_and_its_loss():
    display = TournamentDisplay(table=winners()).plot()
    assert display.methods_ == ["rls", "ukf"]
    first, close, other, _ = (patch.get_facecolor() for patch in display.patches_[:4])
    assert same_color(first, BLUE)
    assert not same_color(close, BLUE)  # the next method is within 5 %
    assert same_color(other, VERMILION)
    assert [text.get_text() for text in display.ax_.texts] == ["4.0", "9.0", "11", "17"]
    covers_nothing(display)
    with pytest.raises(ValueError, match="no column 'method'"):
        TournamentDisplay(table=winners().drop(columns="method")).plot()


def test_marks_stand_at_bias_and_deviation_in_a_panel_for_each_parameter():
    table = pd.MultiIndex.from_product(
        [["K_edot", "omega_nm"], ["rls", "arx"]], names=["parameter", "method"]
    ).to_frame(index=False)
    table = table.assign(causal=table["method"] == "rls", bias=[1.0, 2, 3, 4], sd=[5.0, 4, 3, 2])
    display = TournamentDisplay(table=table, kind="bias").plot()
    assert [panel.get_title() for panel in display.axes_] == [r"$K_{\dot e}$", r"$\omega_{nm}$"]
    causal, offline, _, last = display.points_
    assert last.get_xydata().tolist() == [[4.0, 2.0]]
    assert same_color(causal.get_markerfacecolor(), causal.get_color())
    assert not same_color(offline.get_markerfacecolor(), offline.get_color())


def test_a_line_for_each_method_and_larger_marks_for_more_remnant():
    table = pd.MultiIndex.from_product(
        [["rls", "arx"], [0.05, 0.15, 0.25]], names=["method", "remnant_intensity"]
    ).to_frame(index=False)
    table = table.assign(
        causal=True, noise=np.arange(1.0, 7.0), settling=[5.0, 6, 8, *[np.inf] * 3]
    )
    display = TournamentDisplay(table=table, kind="settling").plot()
    lines = [line for line in display.ax_.lines if len(line.get_xdata()) == 3]
    np.testing.assert_array_equal(lines[0].get_xydata(), [[1, 5], [2, 6], [3, 8]])
    np.testing.assert_allclose(lines[1].get_ydata(), 1.5 * 8)
    assert display.ax_.get_yticklabels()[-1].get_text() == "never"
    sizes = [point.get_markersize() for point in display.points_[:3]]
    assert sizes == sorted(set(sizes))
    covers_nothing(display)
    own = table[table["remnant_intensity"] == 0.15].assign(remnant_intensity=np.nan, settling=3.0)
    assert len(TournamentDisplay(table=own, kind="settling").plot().points_) == 2
