"""Words and colours of signals."""

import matplotlib as mpl
import pytest

from skhoid.plotting import PALETTE, ROLES
from skhoid.plotting._roles import background, dimmed, foreground, scaled, series_colour, sized


def test_the_table():
    table = {key: (role.word, role.colour, role.line) for key, role in ROLES.items()}
    assert table == {
        "measured": ("measured", "#000000", "-"),
        "simulated": ("simulated", "#0072B2", "-"),
        "ahead": ("one step ahead", "#56B4E9", "-"),
        "residual": ("residual", "#CC79A7", "-"),
        "remnant": ("remnant", "#999999", "-"),
        "misfit": ("misfit", "#D55E00", "-"),
        "truth": ("truth", "#009E73", "--"),
        "ceiling": ("noise ceiling", "#E69F00", ":"),
    }


def test_what_follows_the_style():
    with mpl.rc_context(mpl.style.library["dark_background"]):
        assert (foreground(), background()) == ("#ffffff", "#000000")
        assert ROLES["measured"].colour == "#ffffff"
        assert dimmed(0.5) in ("#7f7f7f", "#808080")
    with mpl.rc_context({"axes.facecolor": "none", "figure.facecolor": "beige"}):
        assert background() == "#f5f5dc"
    with mpl.rc_context({"lines.linewidth": 3.0, "lines.markersize": 3.0}):
        assert (scaled(1.0), sized(4.0)) == (2.0, 2.0)


def test_a_role_takes_another_colour(monkeypatch):
    role = ROLES["simulated"]
    monkeypatch.setattr(role, "_colour", role.colour)
    role.colour = "tab:red"
    assert role.style(1.0) == {"color": "tab:red", "linestyle": "-", "linewidth": 1.0}
    role.colour = None
    assert role.colour == foreground()
    with pytest.raises(ValueError, match="A colour of matplotlib is needed"):
        role.colour = "no colour"


def test_keywords_of_a_line_go_by_any_alias():
    assert ROLES["truth"].style(1.0, lw=3, c="k") == {
        "color": "k",
        "linestyle": "--",
        "linewidth": 3,
    }


def test_series_go_round():
    assert series_colour(len(PALETTE) + 1) == PALETTE[1]
