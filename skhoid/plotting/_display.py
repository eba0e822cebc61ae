"""The base of every Display: the Axes that it draws on, and the legend of its figure.

Open it to change how all displays take the Axes of a caller, make figures of their own, or place
their legends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any, Self

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from ._axes import HANDLE, legend_columns, legend_entries, legend_inside, letters, wrapped
from ._roles import DEFAULTS

MOST_TOLD = 4  # fields in a repr
LEAST_ROW = 1.1  # inches that a row of panels takes at least, at a font size of 10 points


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
            _, grid = plt.subplots(*shape, squeeze=False, layout="constrained", **options)
            for spare in set(range(grid.size)) - set(places):
                grid.flat[spare].remove()
            panels = [grid.flat[place] for place in places]
        else:
            panels = _given_axes(ax, allowed or (len(places),), shows)
        self._panels = np.array(panels, dtype=object)
        self.figure_ = panels[0].figure
        return self._panels

    def _legend(
        self,
        handles: Sequence[Any],
        labels: Sequence[str],
        *,
        columns: int | None = None,
        frameon: bool | None = None,
    ) -> None:
        """One legend: below a figure of our own, else in the first of the given Axes."""
        if not self._own:
            legend_inside(self._panels[0], handles, labels)
        elif labels:
            self.figure_.legend(
                handles,
                [wrapped(label, letters(self.figure_) - HANDLE) for label in labels],
                loc="outside lower center",
                ncols=legend_columns(labels, letters(self.figure_), columns),
                frameon=frameon,
            )

    def _legend_of_panels(self, *, frameon: bool | None = None) -> None:
        """One legend for what the panels show, each label once."""
        entries = legend_entries(self._panels)
        self._legend(list(entries.values()), list(entries), frameon=frameon)


def figure_size(default: tuple[float, float], rows: int) -> tuple[float, float]:
    """Size of a figure, in inches, in the style sheet in force; ``default`` is that without one.

    It is as wide as ``figure.figsize`` says, and as much lower or higher than ``default`` as that
    is than matplotlib's own setting, but that letters do not shrink with it, so that each row of
    panels keeps a least height.
    """
    set_, own = mpl.rcParams["figure.figsize"], DEFAULTS["figure.figsize"]
    if list(set_) == list(own):
        return default
    letter = mpl.rcParams["font.size"] / DEFAULTS["font.size"]
    height = default[1] * set_[1] / own[1]
    return set_[0], max(height, LEAST_ROW * letter * (rows + 0.5)) if rows > 1 else height


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
