import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from support.plot_checks import covers_nothing

from skhoid.plotting.tournament_settling import TournamentSettlingDisplay


def points():
    table = pd.MultiIndex.from_product(
        [["rls", "sigmoid", "arx"], [0.05, 0.15, 0.25]], names=["method", "remnant_intensity"]
    ).to_frame(index=False)
    table["causal"] = table["method"] == "rls"
    table["noise"] = np.arange(1.0, 10.0)
    table["settling"] = [5.0, 6, 8, 1, 1, 2, np.inf, np.inf, np.inf]
    return table


def test_a_line_for_each_method_and_larger_marks_for_more_remnant():
    display = TournamentSettlingDisplay(points=points()).plot()
    line = display.lines_["rls"]
    np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3])
    np.testing.assert_array_equal(line.get_ydata(), [5, 6, 8])
    sizes = [display.points_["rls", P].get_markersize() for P in (0.05, 0.15, 0.25)]
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[-1]
    covers_nothing(display)


def test_what_does_not_settle_is_at_the_edge_and_said():
    display = TournamentSettlingDisplay(points=points()).plot()
    np.testing.assert_allclose(display.lines_["arx"].get_ydata(), 1.5 * 8)
    assert display.ax_.get_yticklabels()[-1].get_text() == "never"
    settled = points().replace(np.inf, 3.0)
    display = TournamentSettlingDisplay(points=settled).plot()
    display.figure_.canvas.draw()
    assert "never" not in [label.get_text() for label in display.ax_.get_yticklabels()]


def test_one_intensity_given_axes_and_refusals():
    ax = Figure().subplots()
    one = points()[points()["remnant_intensity"] == 0.15]
    display = TournamentSettlingDisplay(points=one).plot(ax, line_kw={"lw": 3})
    assert display.ax_ is ax
    assert ax.get_title() == ""
    assert display.lines_["rls"].get_linewidth() == 3
    with pytest.raises(ValueError, match="no column 'noise'"):
        TournamentSettlingDisplay(points=points().drop(columns="noise")).plot()
    own = one.assign(remnant_intensity=np.nan)
    assert len(TournamentSettlingDisplay(points=own).plot().points_) == 3


def test_a_legend_of_many_wide_names_is_not_cut():
    names = [
        f"{kind}_{letters}"
        for kind in ("rls", "kalman", "bank")
        for letters in ["mmmm", "wwww", "nnnn"]
    ]
    table = pd.DataFrame(
        {"method": names * 2, "causal": True, "remnant_intensity": [0.05] * 9 + [0.15] * 9}
    ).assign(noise=np.arange(1.0, 19.0), settling=np.arange(2.0, 20.0))
    display = TournamentSettlingDisplay(points=table).plot()
    display.figure_.canvas.draw()
    (legend,) = display.figure_.legends
    box, whole = legend.get_window_extent(), display.figure_.bbox
    assert box.x0 >= whole.x0
    assert box.x1 <= whole.x1
    assert len(legend.get_texts()) == 9
