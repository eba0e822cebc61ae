import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from support.plot_checks import covers_nothing, labels_of

from skhoid.plotting.tournament_bias import TournamentBiasDisplay


def points():
    table = pd.MultiIndex.from_product(
        [["K_e", "K_edot", "omega_nm"], ["rls", "ukf", "arx"]], names=["parameter", "method"]
    ).to_frame(index=False)
    table["causal"] = table["method"] != "arx"
    table["bias"] = np.arange(9.0) + 1
    table["sd"] = 20.0 - 2 * np.arange(9.0)
    return table


def test_marks_stand_at_bias_and_deviation():
    display = TournamentBiasDisplay(points=points()).plot()
    for row in points().to_dict("records"):
        mark = display.points_[row["parameter"], row["method"]]
        assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (row["bias"], row["sd"])
        filled = mark.get_markerfacecolor() == mark.get_markeredgecolor()
        assert filled == row["causal"]
    assert labels_of(display.figure_.legends[0]) == ["rls", "ukf", "arx"]
    assert display.axes_.shape == (3,)
    covers_nothing(display)


def test_arcs_are_of_equal_rmse():
    display = TournamentBiasDisplay(points=points()).plot()
    arcs = display.contours_[0]
    for level, paths in zip(arcs.levels, arcs.allsegs, strict=True):
        for path in paths:
            np.testing.assert_allclose(np.hypot(*path.T), level, rtol=1e-3)


def test_given_axes_and_missing_values():
    table = points()
    table.loc[0, "bias"] = np.nan
    axes = Figure().subplots(1, 3)
    display = TournamentBiasDisplay(points=table).plot(axes, point_kw={"alpha": 0.5})
    assert list(display.axes_) == list(axes)
    assert display.points_["K_e", "ukf"].get_alpha() == 0.5
    with pytest.raises(ValueError, match="no column 'sd'"):
        TournamentBiasDisplay(points=points().drop(columns="sd")).plot()
