"""The map of residuals over time and frequency, of a table as it may come."""

import numpy as np
import pandas as pd

from skhoid.plotting import ResidualMapDisplay


def test_map_of_zeros_at_frequency_zero():
    ratio = pd.DataFrame([[0.0, 0.0, 1.0], [0.0, 10.0, 1.0]], [1.0, 2.0], [0.0, 1.0, 10.0])
    display = ResidualMapDisplay(time_frequency=ratio).plot()
    levels = display.mesh_.get_array()
    assert levels.mask.tolist() == [[True, False], [False, False]]
    assert levels.compressed().tolist() == [10.0, 0.0, 0.0]
    np.testing.assert_allclose(display.ax_.get_ylim(), [10**-0.5, 10**1.5])
