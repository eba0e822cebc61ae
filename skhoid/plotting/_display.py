"""The base of every Display: its panels, its keywords, its legend, what it refuses.

Open it to change how all displays take the Axes of a caller, make figures of their own, place their
legends, or describe what they have in common.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from inspect import cleandoc
from typing import Any, Self

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text
from sklearn.utils.validation import check_is_fitted

from ..pipelines import taken_apart
from ._axes import HANDLE, KEPT, kept_whole, legend_columns, legend_entries, legend_inside, wrapped
from ._axes import letters as letters_of
from ._roles import DEFAULTS, scaled

AROUND = 1.2  # inches that title, labels and legend take at a font size of 10 points
PAGE = 7.2  # inches between the margins of a printed page, or of one of the documentation
LEAST_COLUMN = 1.5  # inches that a panel takes at least beside others
LEAST_ROW = 0.75  # inches that a row of panels takes at least, with the labels between them
LEAST_LINE = 8  # letters, below which nothing is broken

# What docstrings of displays share: a line ``%(name)`` in one of them stands for these.
SHARED = {
    "ax": """
        ax : Axes, sequence of Axes, Figure or None, default=None
            Where to draw: Axes, one for each panel in the order of ``axes_``, or a figure without
            any, which gets them. None makes a figure.
        """,
    "kwargs": """
        **kwargs : dict
            Keywords of matplotlib for the main artists, under any alias.
        """,
    "keywords": """
        %(ax)
        %(kwargs)
        """,
    "display": """
        Returns
        -------
        display : Display
            Of the class that this is called on, drawn.
        """,
    "self": """
        Returns
        -------
        self : Display
        """,
    "panels": """
        axes_ : ndarray of Axes
            The panels.
        ax_ : Axes
            The first of them.
        figure_ : Figure
            The figure that holds them.
        """,
    "what_of_runs": """
        runs : label, list of labels or None, default=None
            Runs to show. None means all, but no more than the first five; the figure says so.
        window : (float, float) or None, default=None
            Show, and score, only rows with ``window[0] <= time < window[1]``, in seconds.
        centered : bool, default=False
            Take VAF about the mean of each run.
        """,
    "boxes": """
        group : str, default="remnant_order"
            Column that is shown by colour.
        by : str or None, default=None
            Column whose values are panels side by side.
        difference : tuple (column, first, second) or None, default=None
            Results where the column is ``first`` less those of the same replication where it is
            ``second``, as ``("delay", "fixed", "estimated")`` for Eq. 29.
        reference : float or None, default=None
            Where to draw a dotted line. None means zero for biases and differences.
        """,
    "delays": """
        kind : {"loss", "path"}, default="loss"
            The loss of every candidate, or the delay over time, which needs a search with
            ``window=``.
        unit : str or None, default=None
            Unit of the output, for the axis of the one-step loss.
        """,
    "search_options": """
        kind : {"path", "steps", "ranking"}, default="path"
            What to draw.
        run : run label or None, default=None
            The run of which steps are shown. None takes the one in which the effects help most.
        window : (float, float) or None, default=None
            Begin and end of it in seconds of time in the run. None takes the 15 s in which the
            effects help most.
        steps : sequence of int or None, default=None
            Steps to show: 0 is the baseline, 1 the model with the first effect. None takes the
            baseline and the last.
        step : int, default=1
            The step of a ranking, from 1 on.
        n_candidates : int or None, default=None
            Rank so many of the best, and none that do not apply. None draws all.
        """,
    "sizes": """
        axes_ : ndarray of Axes, shape (n_rows, n_columns)
            The panels.
        ax_ : Axes
            The first of them.
        figure_ : Figure
            The figure that holds them.
        """,
    "references": """
        references : DataFrame or None, default=None
            Result of :func:`skhoid.reference_fits`: batch models of constant parts of the runs,
            drawn as orange levels over its windows.
        """,
    "search": """
        search : fitted EffectSearchCV
            The search.
        """,
    "transition_time": """
        transition_time : float or None, default=None
            Instant to mark, in s.
        """,
}


# What each class method that makes a display says at its end.
ENDING = """
        %(keywords)

        %(display)
        """


@dataclass(kw_only=True, eq=False, repr=False)
class Display:
    """What is to be drawn, computed before; :meth:`plot` draws it.

    Subclasses are dataclasses too: their fields are the parameters of the constructor, and what
    ``plot`` draws are attributes that end in an underscore.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name, member in vars(cls).items():
            described = getattr(member, "__func__", member)
            if name.startswith("from_"):
                described.__doc__ = f"{cleandoc(str(described.__doc__))}\n{cleandoc(ENDING)}"
            elif name == "plot" and described.__doc__ is None:
                described.__doc__ = Display.plot.__doc__
        for member in (cls, *vars(cls).values()):
            described = getattr(member, "__func__", member)
            doc = getattr(described, "__doc__", None)
            if (isinstance(member, type) or callable(described)) and "%(" in (doc or ""):
                described.__doc__ = _filled_in(str(doc))

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        raise NotImplementedError

    def __repr__(self) -> str:
        kind = getattr(self, "kind", "")
        return f"<{type(self).__name__}{kind and f': {kind}'}>"

    def _take_axes(
        self,
        ax: Any,
        shows: str,
        shape: tuple[int, int] = (1, 1),
        *,
        used: Iterable[int] | None = None,
        allowed: Sequence[int] | None = None,
        least_height: float = 0.0,
        **options: Any,
    ) -> np.ndarray:
        """The panels in order: the Axes of ``ax``, or those of a figure of our own.

        That is a new one where ``ax`` is None, and ``ax`` itself where it is a figure. It has
        panels in rows and columns of this ``shape``, made with the ``options`` of ``plt.subplots``
        (``figsize`` for the default style, see :func:`figure_size`); those that are not among
        ``used`` are taken away. It is at least so high, in inches for a font of 10 points: letters
        do not shrink with it. As many Axes as there are panels are allowed, or as many as one of
        ``allowed``; ``shows`` says what they are, for who gives the wrong number of them.
        """
        self._own = ax is None or isinstance(ax, Figure)
        places = list(range(math.prod(shape)) if used is None else used)
        if self._own:
            size = figure_size(options.pop("figsize", mpl.rcParams["figure.figsize"]), shape[0])
            figure = plt.figure(figsize=size, layout=FittingLayout()) if ax is None else ax
            figure.set_figheight(max(size[1], least_height * letter_size()))
            grid = figure.subplots(*shape, squeeze=False, **options)
            for spare in set(range(grid.size)) - set(places):
                grid.flat[spare].remove()
            panels = [grid.flat[place] for place in places]
        else:
            panels = _given_axes(ax, allowed or (len(places),), shows)
        self.axes_ = np.array(panels, dtype=object)
        self.ax_ = panels[0]
        self.figure_ = panels[0].figure
        return self.axes_

    def _restyle(self, kwargs: dict[str, Any], *artists: Any) -> None:
        """Give the main artists (any nest of them) the keywords of the caller.

        To be called before a legend is made, which copies what it finds.
        """
        for artist in _artists_in(artists) if kwargs else []:
            artist.set(**kwargs)

    def _legend(self, handles: Sequence[Any], labels: Sequence[str]) -> None:
        """One legend: below a figure of our own, else in the first of the given Axes."""
        if not self._own:
            legend_inside(self.ax_, handles, labels)
        elif labels:
            width = letters_of(self.figure_)
            labels = [wrapped(label, width - HANDLE) for label in labels]
            for n_columns in range(legend_columns(labels, width), 0, -1):
                legend = self.figure_.legend(
                    handles, labels, loc="outside lower center", ncols=n_columns, frameon=False
                )
                if n_columns == 1 or legend.get_window_extent().width <= self.figure_.bbox.width:
                    break
                legend.remove()
            for line in legend.get_lines():  # as thin as in the panels they would not be seen
                line.set_linewidth(max(line.get_linewidth(), scaled(1.2)))
                line.set_alpha(None)
            rows = -(-sum(1 + label.count("\n") for label in labels) // n_columns)
            add_lines(self.figure_, rows - 1, legend.get_texts()[0].get_fontsize())

    def _legend_of_panels(self) -> None:
        """One legend for what the panels show, each label once."""
        entries = legend_entries(self.axes_.flat)
        self._legend(list(entries.values()), list(entries))


def _filled_in(doc: str) -> str:
    """A docstring with the pieces that it shares with others, at the indent of their names."""
    while found := re.search(r"^( *)%\((\w+)\)$", doc, flags=re.MULTILINE):
        piece = textwrap.dedent(SHARED[found[2]]).strip()
        doc = doc.replace(found[0], textwrap.indent(piece, found[1]), 1)
    return doc


def _artists_in(some: Any) -> Iterator[Any]:
    """All artists in lists, dicts and containers."""
    if isinstance(some, Artist):
        yield some
    elif isinstance(some, (dict, list, tuple, np.ndarray)):
        for each in some.values() if isinstance(some, dict) else some:
            yield from _artists_in(each)


def _given_axes(ax: Any, allowed: Sequence[int], shows: str) -> list[Axes]:
    """The Axes of ``ax`` (one, or a sequence or array of them) in order, as many as allowed."""
    axes = [ax] if isinstance(ax, Axes) else list(np.asarray(ax, dtype=object).ravel())
    wrong = [a for a in axes if not isinstance(a, Axes)]
    if wrong:
        raise TypeError(
            f"ax must be matplotlib Axes, or a sequence of them; got {type(wrong[0]).__name__}."
        )
    if len(axes) not in allowed:
        numbers = " or ".join(str(n) for n in dict.fromkeys(allowed))
        raise ValueError(
            f"ax holds {len(axes)} Axes; this plot needs {numbers}: {shows}. ax=None makes them."
        )
    return axes


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


def letter_size() -> float:
    """Size of letters in the style sheet in force, in units of 10 points."""
    return float(mpl.rcParams["font.size"]) / 10.0


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


def check_search(search: Any, expected: type, display: str) -> None:
    """Refuse anything but a fitted search of the expected class."""
    if not isinstance(search, expected):
        raise TypeError(
            f"{display}.from_estimator draws a fitted {expected.__name__}; got "
            f"{type(search).__name__}."
        )
    check_is_fitted(search, "best_estimator_")


def fitted_end(estimator: Any) -> Any:
    """The fitted estimator at the end of searches and pipelines."""
    _, last = taken_apart(estimator)
    if hasattr(last, "fit"):
        check_is_fitted(last)
    return last


def check_option(name: str, value: Any, known: Iterable[Any]) -> None:
    """Refuse a value that is not among those known."""
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}; got {value!r}.")


def check_some_column(table: pd.DataFrame, names: Sequence[str], what: str) -> None:
    """Refuse a table with none of these columns."""
    if not any(name in table for name in names):
        raise ValueError(
            f"{what} has none of the columns {', '.join(names)}; it has "
            f"{', '.join(map(str, table.columns))}."
        )
