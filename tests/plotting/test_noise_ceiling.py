"""The bar of a noise ceiling, of values as they may come."""

import numpy as np
import pytest
from support.plot_checks import labels_of, widths

from skhoid.plotting import NoiseCeilingDisplay


def test_bar_without_a_ceiling():
    display = NoiseCeilingDisplay(
        vaf=70.0,
        noise_ceiling=np.nan,
        noise_ceiling_interval=(np.nan, np.nan),
        explainable_gap=np.nan,
    ).plot()
    assert widths(display.parts_) == {
        "explained": 70.0,
        "not explained": pytest.approx(30.0),
    }
    assert display.interval_ is None
    assert "not explained 30.0 %: no ceiling" in labels_of(display.ax_.get_legend())
    assert display.ax_.get_title() == "VAF 70.0 %, noise ceiling not available"


@pytest.mark.parametrize(
    ("vaf", "ceiling", "expected", "said"),
    [
        (-35.0, 80.0, [0.0, 80.0, 20.0], "explained -35.0 %: worse than no model"),
        (85.0, 84.5, [85.0, 0.0, 15.0], "nothing left to explain"),
        (99.5, 100.3, [99.5, 0.5, 0.0], "explainable 0.8 points"),
        (-35.0, -5.0, [0.0, 0.0, 100.0], "explainable 30.0 points"),
    ],
)
def test_bar_stays_between_0_and_100(vaf, ceiling, expected, said):
    display = NoiseCeilingDisplay(
        vaf=vaf,
        noise_ceiling=ceiling,
        noise_ceiling_interval=(ceiling - 1, ceiling + 1),
        explainable_gap=ceiling - vaf,
    ).plot()
    np.testing.assert_allclose(list(widths(display.parts_).values()), expected, atol=1e-12)
    assert said in labels_of(display.ax_.get_legend())


def test_an_estimate_below_the_vaf_leaves_what_is_explained():
    """The ceiling is then the VAF."""
    display = NoiseCeilingDisplay(
        vaf=85.0,
        noise_ceiling=85.0,
        noise_ceiling_interval=(83.5, 85.5),
        explainable_gap=-0.5,
    ).plot()
    assert list(widths(display.parts_).values()) == [85.0, 0.0, 15.0]


def test_bar_of_a_ceiling_known_for_some_runs():
    display = NoiseCeilingDisplay(
        vaf=70.0,
        noise_ceiling=85.0,
        noise_ceiling_interval=(84.0, 86.0),
        explainable_gap=10.0,
    ).plot()
    assert list(widths(display.parts_).values()) == [75.0, 10.0, 15.0]
