"""The size of figures of our own in the style sheet in force, and titles and labels that fit in.

Open it to change what a figure of one journal column looks like beside one for the screen.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text

from ._roles import DEFAULTS

AROUND = 1.2  # inches that title, labels and legend take at a font size of 10 points
PAGE = 7.2  # inches between the margins of a printed page, or of one of the documentation
LEAST_COLUMN = 1.5  # inches that a panel takes at least beside others
LEAST_ROW = 0.75  # inches that a row of panels takes at least, with the labels between them
LEAST_LINE = 8  # letters, below which nothing is broken
KEPT = "\N{NO-BREAK SPACE}"  # for blanks inside of formulas, at which no line breaks


def figure_size(default: tuple[float, float], rows: int) -> tuple[float, float]:
    """Size of a figure, in inches, in the style sheet in force; ``default`` is that without one.

    It is as wide as ``figure.figsize`` says. The height of what is inside the panels is to that
    of ``default`` as the height that ``figure.figsize`` says is to matplotlib's own; letters do
    not shrink with it.
    """
    if is_default_size():
        return default
    letter = mpl.rcParams["font.size"] / DEFAULTS["font.size"]
    around = min(AROUND, 0.5 * default[1]) * letter
    width, height = mpl.rcParams["figure.figsize"]
    inside = max(default[1] - around, 0.0) * height / DEFAULTS["figure.figsize"][1]
    return width, around + max(inside, LEAST_ROW * letter * rows)


def page_width(wide: float, columns: int) -> float:
    """Inches of a picture with panels side by side: those of a page, if it can be read there."""
    return min(wide, max(PAGE, 1.0 + LEAST_COLUMN * columns))


def is_default_size() -> bool:
    """Whether nobody has asked for figures of another size than matplotlib's own."""
    return list(mpl.rcParams["figure.figsize"]) == list(DEFAULTS["figure.figsize"])


def add_lines(figure: Figure, lines: int, size: float) -> None:
    """Make a figure higher by lines of letters of this size in points; not one for the screen."""
    if lines > 0 and not is_default_size():
        figure.set_figheight(figure.get_figheight() + 1.4 * lines * size / 72.0)


class FittingLayout(ConstrainedLayoutEngine):
    """Constrained layout that breaks titles and labels of axes where they are longer than these."""

    def __init__(self) -> None:
        super().__init__()
        self._whole: dict[Text, tuple[str, str]] = {}  # and as it was broken

    def execute(self, fig: Any) -> None:
        for text, (whole, broken) in self._whole.items():
            if text.get_text() == broken:  # else somebody wrote another
                text.set_text(whole)
        self._whole = {}
        super().execute(fig)
        for text, room, side in list(_too_long(fig)):
            whole = text.get_text()
            if _break(text, room, side):
                self._whole[text] = whole, text.get_text()
        if self._whole:
            super().execute(fig)


def _too_long(figure: Figure) -> Iterator[tuple[Text, float, str]]:
    """Titles and labels that are longer than their axes, with the length of these."""
    whole = figure._suptitle  # type: ignore[attr-defined]
    if whole is not None and _length(whole, "width") > figure.bbox.width:
        yield whole, figure.bbox.width, "width"
    for axes in figure.axes:
        box = axes.get_window_extent()
        level = _room(axes, "center"), "width"
        for text, (room, side) in (
            (axes.title, level),
            (axes._left_title, (_room(axes, "left"), "width")),  # type: ignore[attr-defined]
            (axes.xaxis.label, level),
            (axes.yaxis.label, (box.height, "height")),
        ):
            if text.get_visible() and text.get_text() and _length(text, side) > room > 0:
                yield text, room, side


def _room(axes: Axes, where: str) -> float:
    """Length of what stands above a panel: to the edges of the figure if nothing is beside it."""
    box, figure = axes.get_window_extent(), axes.figure.bbox
    place = axes.get_subplotspec()
    if place is not None and place.get_gridspec().ncols > 1:
        return float(box.width)
    if where == "left":
        return float(figure.x1 - box.x0)
    middle = (box.x0 + box.x1) / 2
    return 2.0 * float(min(middle - figure.x0, figure.x1 - middle))


def _length(text: Text, side: str) -> float:
    return float(getattr(text.get_window_extent(), side))


def _break(text: Text, room: float, side: str) -> bool:
    """Break a text into as few lines as fit, about equally long; say whether it could be done."""
    whole = text.get_text()
    lines = whole.splitlines() if side == "width" else [" ".join(whole.split())]
    width = max(map(len, lines))
    while _length(text, side) > room and width > LEAST_LINE:
        width -= 1
        text.set_text("\n".join(_filled(line, width) for line in lines))
    return text.get_text() != whole


def kept_whole(text: str) -> str:
    """A text in which no line breaks inside of a formula or before a percent sign."""
    return re.sub(r"\$[^$]*\$| %", lambda found: found[0].replace(" ", KEPT), text)


def _filled(line: str, width: int) -> str:
    """A line in parts no longer than this, the parts alike; formulas and percentages stay whole."""
    kept = kept_whole(line)
    parts: list[str] = []
    for narrower in range(width, LEAST_LINE - 1, -1):
        found = textwrap.wrap(kept, narrower, break_long_words=False, break_on_hyphens=False)
        if parts and len(found) > len(parts):
            break
        parts = found
    return "\n".join(parts).replace(KEPT, " ")
