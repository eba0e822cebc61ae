"""One word, one colour and one line for each kind of signal in every picture; other colours too.

Open it to change what a role looks like, or what follows the style sheet in force. Nothing else in
the house names a colour (a test holds that).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.cbook import normalize_kwargs
from matplotlib.colors import is_color_like, to_hex, to_rgb, to_rgba
from matplotlib.lines import Line2D

# Okabe and Ito's colours, which people with any colour vision tell apart, on white and on black.
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREY = "#999999"

# Series that are not roles (conditions, runs, parameters, orders), in this order in each picture.
PALETTE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY)

DEFAULTS = mpl.rcParamsDefault


class Role:
    """How one kind of signal is called and drawn.

    Parameters
    ----------
    word : str
        Its name in legends.
    colour : str or None
        Any colour of matplotlib. None is the foreground of the style sheet in force.
    line : str
        Style of its line.

    Attributes
    ----------
    colour : str
        The colour; assign another to change it in every picture that is drawn from then on, and
        None for the foreground of the style sheet.
    """

    def __init__(self, word: str, colour: str | None, line: str = "-") -> None:
        self.word = word
        self.line = line
        self.colour = colour

    @property
    def colour(self) -> str:
        return foreground() if self._colour is None else self._colour

    @colour.setter
    def colour(self, colour: str | None) -> None:
        if colour is not None and not is_color_like(colour):
            raise ValueError(f"A colour of matplotlib is needed, or None; got {colour!r}.")
        self._colour = colour

    def style(self, width: float | None = None, **more: Any) -> dict[str, Any]:
        """Keywords of a line: colour, line style and, in points by default, width."""
        look: dict[str, Any] = {"color": self.colour, "linestyle": self.line}
        if width is not None:
            look["linewidth"] = scaled(width)
        return normalize_kwargs(look, Line2D) | normalize_kwargs(more, Line2D)  # under any alias

    def __repr__(self) -> str:
        colour = "foreground" if self._colour is None else self._colour
        return f"Role({self.word!r}, colour={colour!r}, line={self.line!r})"


ROLES: Mapping[str, Role] = MappingProxyType(
    {
        "measured": Role("measured", None),
        "simulated": Role("simulated", BLUE),
        "ahead": Role("one step ahead", SKY),
        "residual": Role("residual", PURPLE),
        "remnant": Role("remnant", GREY),
        "misfit": Role("misfit", VERMILION),
        "truth": Role("truth", GREEN, "--"),
        "ceiling": Role("noise ceiling", ORANGE, ":"),
    }
)
"""How each kind of signal is called and drawn, by its key."""


def foreground() -> str:
    """The colour of text in the style sheet in force: black on white, white on black."""
    return _hex("text.color", "axes.edgecolor", default="black")


def background() -> str:
    """The colour behind the lines in the style sheet in force."""
    return _hex("axes.facecolor", "figure.facecolor", default="white")


def dimmed(share: float = 0.65) -> str:
    """A colour between back and foreground of the style sheet, so far towards the latter."""
    front, back = to_rgba(foreground()), to_rgba(background())
    red, green, blue = (share * front[i] + (1 - share) * back[i] for i in range(3))
    return to_hex((red, green, blue))


def choose_readable(colour: Any) -> str:
    """Black or white, whichever text in a patch of this colour is read by more easily."""
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in to_rgb(colour)]
    luminance = float(np.dot([0.2126, 0.7152, 0.0722], linear))  # as WCAG 2 defines it
    return "black" if luminance > 0.179 else "white"


def greyed(colour: Any, share: float) -> str:
    """A colour with grey in it, so that it is seen on any background: 1 is the colour itself."""
    return _mixed(colour, GREY, share)


def faded(colour: Any, share: float) -> str:
    """A colour with the background of the style sheet in it: 1 is the colour itself."""
    return _mixed(colour, background(), share)


def _mixed(one: Any, other: Any, share: float) -> str:
    mixed: Any = share * np.array(to_rgb(one)) + (1 - share) * np.array(to_rgb(other))
    return to_hex(mixed)


def veil(share: float) -> float:
    """How opaque a band of any colour is: so much on light backgrounds, twice as much on dark."""
    return share if choose_readable(background()) == "black" else min(1.0, 2.0 * share)


def series_colour(position: int) -> str:
    """The colour of a series that is not a role: its place in :data:`PALETTE`, again and again."""
    return PALETTE[position % len(PALETTE)]


def remnant_colour(order: object) -> str:
    """The colour of a remnant filter: of orders 1 to 4 and "nm", in each picture the same."""
    known = ("1", "2", "3", "4", "nm")
    return PALETTE[known.index(str(order))] if str(order) in known else GREY


def scaled(width: float) -> float:
    """A line's width in points, wider or thinner as ``lines.linewidth`` is than its default."""
    return width * mpl.rcParams["lines.linewidth"] / DEFAULTS["lines.linewidth"]


def sized(marker: float) -> float:
    """A marker's size in points, larger or smaller as ``lines.markersize`` is than its default."""
    return marker * mpl.rcParams["lines.markersize"] / DEFAULTS["lines.markersize"]


def outlined() -> dict[str, Any]:
    """Keywords of markers with an outline that shows on the style's background."""
    return {"markeredgecolor": foreground(), "markeredgewidth": scaled(0.6)}


def star(size: float = 15.0) -> dict[str, Any]:
    """Keywords of the mark of what is best."""
    return {"marker": "*", "ms": sized(size), "ls": "none", "zorder": 4, **outlined()}


def _hex(*names: str, default: str) -> str:
    """The first of these settings that is a colour that covers something."""
    settings: Any = mpl.rcParams
    for name in names:
        colour: Any = settings[name]
        if is_color_like(colour) and to_rgba(colour)[3] > 0:
            return to_hex(colour)
    return to_hex(default)
