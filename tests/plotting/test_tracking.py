"""What TrackingDisplay draws is what it was given."""

import numpy as np
import pytest

from skhoid import make_tracking_runs
from skhoid.plotting import TrackingDisplay


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C4",
        n_runs=3,
        channels=["e", "x", "f_t"],
        remnant_gain="table",
        remnant_intensity=0.15,
        return_truth=True,
        run_in=20.0,
        random_state=0,
    )


def test_panels_hold_the_first_run(runs):
    X, y, truth = runs
    display = TrackingDisplay.from_runs(X, y, truth=truth)
    assert [ax.get_ylabel() for ax in display.axes_] == [
        "error e, deg",
        "output x, deg",
        "target $f_t$, deg",
        "control u, deg",
    ]
    for name in ("e", "x", "f_t"):
        np.testing.assert_array_equal(display.lines_[name].get_ydata(), X.loc[0, name])
    np.testing.assert_array_equal(display.lines_["u"].get_ydata(), y.loc[0])
    panel = display.axes_[-1]
    drawn = [line for line in panel.lines if line.get_label() == "truth, without remnant"]
    np.testing.assert_array_equal(drawn[0].get_ydata(), truth.u_without_remnant.loc[0])
    marks = [line.get_xdata()[0] for line in panel.lines if line.get_label() == "change"]
    np.testing.assert_allclose(marks, [40.96], atol=0.02)


def test_other_runs_are_drawn_behind(runs):
    X, y, _ = runs
    display = TrackingDisplay.from_runs(X, y)
    others = [line for line in display.axes_[0].lines if line is not display.lines_["e"]]
    assert len(others) == 2
    np.testing.assert_array_equal(others[1].get_ydata(), X.loc[2, "e"])


def test_window(runs):
    X, y, truth = runs
    display = TrackingDisplay.from_runs(X, y, truth=truth, window=(30.72, 51.2))
    time = display.lines_["u"].get_xdata()
    assert (time[0], time[-1]) == (30.72, 51.19)
    with pytest.raises(ValueError, match="holds no sample"):
        TrackingDisplay.from_runs(X, y, window=(100, 110))


def test_runs_of_different_times_are_refused(runs):
    X, y, _ = runs
    with pytest.raises(ValueError, match="select_runs"):
        TrackingDisplay.from_runs(X[:-1], y[:-1])
