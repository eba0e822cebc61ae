"""The bar of a noise ceiling, of values as they may come."""

import numpy as np
import pytest
from support.plot_checks import widths

from skhoid.plotting import NoiseCeilingDisplay


def written(display):
    """What stands in, above and below the bar."""
    texts = [text.get_text().replace("\n", " ") for text in display.texts_]
    return [*texts, *display.ax_.get_xlabel().replace("\n", ", ").split(", ")]


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
    assert display.ceiling_ is None
    assert {"not explained 30.0 %", "noise ceiling not known"} <= set(written(display))
    assert display.ax_.get_title() == "VAF 70.0 %, noise ceiling not known"


@pytest.mark.parametrize(
    ("vaf", "ceiling", "expected", "said"),
    [
        (-35.0, 80.0, [0.0, 80.0, 20.0], "explained -35.0 %: worse than no model"),
        (85.0, 84.5, [85.0, 0.0, 15.0], "explained 85.0 %"),
        (99.5, 100.3, [99.5, 0.5, 0.0], "misfit 0.8 points"),
        (-35.0, -5.0, [0.0, 0.0, 100.0], "misfit 30.0 points"),
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
    assert said in written(display)
    assert not any("misfit -" in text or "misfit 0.0" in text for text in written(display))


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


def test_parts_of_the_bar_are_named_in_it_and_the_ceiling_above():
    display = NoiseCeilingDisplay(
        vaf=50.0,
        noise_ceiling=80.0,
        noise_ceiling_interval=(78.0, 82.0),
        explainable_gap=30.0,
    ).plot()
    assert written(display)[:4] == [
        "explained 50.0 %",
        "misfit 30.0 points",
        "remnant 20.0 %",
        "noise ceiling 80.0 % (95 % interval 78.0 to 82.0 %)",
    ]
    np.testing.assert_array_equal(display.ceiling_.get_xdata(), [80.0, 80.0])
    assert display.ax_.get_legend() is None
