"""The base of every Display: the Axes that it draws on, and the legend of its figure.

Open it to change how all displays take the Axes of a caller, make figures of their own, or place
their legends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any, Self

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from ._axes import HANDLE, legend_columns, legend_entries, legend_inside, letters, wrapped
from ._layout import FittingLayout, add_lines, figure_size
from ._roles import scaled

MOST_TOLD = 4  # fields in a repr


@dataclass(kw_only=True, eq=False, repr=False)
class Display:
    """What is to be drawn, computed before; :meth:`plot` draws it.

    Subclasses are dataclasses too: their fields are the parameters of the constructor, and what
    ``plot`` draws are attributes that end in an underscore.
    """

    def plot(self, *args: Any, **kwargs: Any) -> Self:
        raise NotImplementedError

    def __repr__(self) -> str:
        """What it shows, in short: single values, and the sizes of tables."""
        told = [_in_short(field.name, getattr(self, field.name)) for field in fields(self)]
        shown = ", ".join([text for text in told if text][:MOST_TOLD])
        return f"<{type(self).__name__}{shown and f': {shown}'}>"

    def _take_axes(
        self,
        ax: Any,
        shows: str,
        shape: tuple[int, int] = (1, 1),
        *,
        used: Iterable[int] | None = None,
        allowed: Sequence[int] | None = None,
        **options: Any,
    ) -> np.ndarray:
        """The panels in order: the Axes of ``ax``, or where that is None, of a figure of our own.

        ``shows`` says what they are, for who gives the wrong number of them. A figure of our own
        has panels in rows and columns of this ``shape``, made with the ``options`` of
        ``plt.subplots`` (``figsize`` for the default style, see :func:`figure_size`); those that
        are not among ``used`` are taken away. As many Axes as there are panels are allowed, or as
        many as one of ``allowed``.
        """
        self._own = ax is None
        places = list(range(math.prod(shape)) if used is None else used)
        if self._own:
            if "figsize" in options:
                options["figsize"] = figure_size(options["figsize"], shape[0])
            _, grid = plt.subplots(*shape, squeeze=False, layout=FittingLayout(), **options)
            for spare in set(range(grid.size)) - set(places):
                grid.flat[spare].remove()
            panels = [grid.flat[place] for place in places]
        else:
            panels = _given_axes(ax, allowed or (len(places),), shows)
        self._panels = np.array(panels, dtype=object)
        self.figure_ = panels[0].figure
        return self._panels

    def _restyle(self, styles: Mapping[str, Any], **artists: Any) -> None:
        """Give artists (one, or any nest of them) the keywords that are there by the same name.

        To be called before a legend is made, which copies what it finds.
        """
        for name, some in artists.items():
            for artist in _artists_in(some) if styles.get(name) else []:
                artist.set(**styles[name])

    def _legend(
        self,
        handles: Sequence[Any],
        labels: Sequence[str],
        *,
        columns: int | None = None,
    ) -> None:
        """One legend: below a figure of our own, else in the first of the given Axes."""
        if not self._own:
            legend_inside(self._panels[0], handles, labels)
        elif labels:
            width = letters(self.figure_)
            labels = [wrapped(label, width - HANDLE) for label in labels]
            for n_columns in range(legend_columns(labels, width, columns), 0, -1):
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
        entries = legend_entries(self._panels)
        self._legend(list(entries.values()), list(entries))


def _artists_in(some: Any) -> Iterator[Any]:
    """All artists in lists, dicts and containers."""
    if isinstance(some, Artist):
        yield some
    elif isinstance(some, (dict, list, tuple, np.ndarray)):
        for each in some.values() if isinstance(some, dict) else some:
            yield from _artists_in(each)


def _in_short(name: str, value: Any) -> str:
    """A field in a repr; nothing for what is not known, or not short."""
    if isinstance(value, str):
        return f"{name} {value!r}" if 0 < len(value) <= 30 else ""
    if isinstance(value, bool | np.bool_):
        return f"{name} {value}"
    if isinstance(value, Real):
        return f"{name} {float(value):.4g}" if np.isfinite(float(value)) else ""
    if hasattr(value, "columns"):
        return f"{name} of {len(value)} rows"
    shape = np.shape(value) if hasattr(value, "shape") else ()
    return f"{name} of {' x '.join(map(str, shape))} values" if shape else ""


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
