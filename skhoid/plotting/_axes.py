"""Colours, labels, limits, notes and legends of single panels.

Open it for what is drawn the same way in plots that have nothing else in common.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import (
    LogLocator,
    MaxNLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)

from ._layout import KEPT, kept_whole
from ._roles import background

LETTER = 0.523  # mean width of a letter, of the size of its font
HANDLE = 9  # letters that a handle takes in a legend
TITLE = 1.1  # of the width of a panel before layout, which widens it
MARKERS = "os^Dv<>"
FEW_DECADES = 300.0  # from one end of an axis to the other


def with_unit(quantity: str, unit: str | None) -> str:
    return f"{quantity}, {unit}" if unit else quantity


def letters(figure: Any, size: float | None = None) -> int:
    """Letters of a ``size`` in points (None: that of the style) in a line across the figure."""
    return letters_across(figure.get_figwidth(), size)


def letters_across(width: float, size: float | None = None) -> int:
    """Letters of a ``size`` in points (None: that of the style) in so many inches."""
    return int(72.0 * width / (LETTER * (size or mpl.rcParams["font.size"])))


def letters_above(panel: Axes) -> int:
    """Letters in a line of a title of medium size above a panel."""
    share = panel.get_window_extent().width / panel.figure.bbox.width
    return max(int(TITLE * share * letters(panel.figure)), 12)


def wrapped(text: str, width: int) -> str:
    lines = "\n".join(textwrap.wrap(kept_whole(text), max(width, 1), break_on_hyphens=False))
    return lines if KEPT in text else lines.replace(KEPT, " ")


def legend_columns(labels: Iterable[str], width: int, most: int | None = None) -> int:
    """Columns of a legend with as few rows as fit into so many letters; no more than ``most``."""
    lengths = [len(re.sub(r"[$\\_^{}]", "", label)) + HANDLE for label in labels]
    for rows in range(1, len(lengths)):
        columns = min(-(-len(lengths) // rows), most or len(lengths))
        if sum(part.max() for part in np.array_split(lengths, columns)) <= width:
            return columns
    return 1


def parameter_symbol(name: str) -> str:
    """Name of an ARX parameter, such as b0 or b0(e), as mathematics."""
    found = re.fullmatch(r"([ab])(\d+)(?:\((.*)\))?", name)
    if found is None:
        return name
    letter, number, channel = found.groups()
    return f"${letter}_{{{number}}}$" + (f" ({channel})" if channel else "")


def seconds_axis(panel: Axes, dt: float, label: str) -> Any:
    """An upper axis in seconds to one in samples."""
    functions: Any = (lambda samples: samples * dt), (lambda seconds: seconds / dt)
    axis = panel.secondary_xaxis("top", functions=functions)
    axis.set_xlabel(label)
    return axis


def note_outside(panel: Axes, values: np.ndarray, corner: tuple[str, str]) -> Any:
    """Count the values outside the limits, in a corner of the panel; None if there are none."""
    low, high = panel.get_ylim()
    shown = values[~np.isnan(values)]
    outside = int(np.sum((shown < low) | (shown > high)))
    if not outside:
        return None
    return corner_note(panel, f"{outside} of {shown.size} outside", corner)


def corner_note(panel: Axes, text: str, corner: tuple[str, str], edge: float = 0.04) -> Any:
    """Small text in a corner of the panel, on its background."""
    return panel.text(
        {"left": 0.01, "right": 0.99}[corner[1]],
        {"bottom": edge, "top": 1.0 - edge}[corner[0]],
        text,
        transform=panel.transAxes,
        ha=corner[1],
        va=corner[0],
        fontsize="small",
        bbox={"facecolor": background(), "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
    )


def limits_of(
    inner: Any, outer: Any, much: float, margin: float, least: float = 1e-12
) -> tuple[float, float]:
    """Limits that hold ``outer``, or where that takes ``much`` times its range, ``inner`` alone.

    The ``margin`` above and below is a share of the range, which is taken as ``least`` at least.
    """
    held = outer if np.ptp(outer) <= much * np.ptp(inner) else inner
    low, high = float(np.min(held)), float(np.max(held))
    beyond = margin * max(high - low, 0.02 * abs(high), least)
    return low - beyond, high + beyond


def plain_logarithmic(axis: Axis, few: float = FEW_DECADES, *, minor_ticks: bool = True) -> None:
    """Plain numbers on a logarithmic axis, at 1, 2 and 5 where its ends are a few decades apart."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < few * low else (1.0,)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
    if not minor_ticks:
        axis.set_minor_locator(NullLocator())


def phase_ticks(axis: Axis) -> None:
    """Ticks of a phase in degrees, at parts of a turn."""
    axis.set_major_locator(MaxNLocator(7, steps=[1.8, 3.6, 4.5, 9]))


def legend_entries(panels: Any) -> dict[str, Any]:
    """Handles by label, each label once."""
    entries: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    return entries


def legend_inside(panel: Axes, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """A small legend in a panel, where it hides least; none without labels."""
    if labels:
        panel.legend(handles, labels, loc="best", fontsize="small")


def legend_above(panel: Axes, columns: int | None = None) -> None:
    """A legend above the right end of a panel, in one row unless ``columns`` says otherwise."""
    entries = legend_entries([panel])
    panel.legend(
        entries.values(),
        entries.keys(),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=columns or len(entries),
        frameon=False,
        fontsize="small",
        borderaxespad=0.2,
    )


def names_as_they_are(figure: Figure, names: Iterable[str]) -> None:
    """Show names from the data as such: matplotlib takes what is between dollars for formulas.

    Its setting ``text.parse_math`` would also spoil the labels of logarithmic axes.
    """
    # Texts may quote or wrap a name, so its parts are looked for.
    parts = [part for name in names for part in re.split(r"[\s\\'\"]+", name) if "$" in part]
    if not parts:
        return
    for panel in figure.axes:
        for axis in (panel.xaxis, panel.yaxis):
            axis.get_ticklabels()  # which are made only now
    for text in figure.findobj(Text):
        if any(part in text.get_text() for part in parts):
            text.set_parse_math(False)
