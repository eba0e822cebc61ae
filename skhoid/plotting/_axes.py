"""What is written in and beside single panels: labels, ticks, notes, legends, limits, names.

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

from ._roles import background, dimmed, scaled, veil

LETTER = 0.523  # mean width of a letter, of the size of its font
HANDLE = 9  # letters that a handle takes in a legend
TITLE = 1.1  # of the width of a panel before layout, which widens it
MARKERS = "os^Dv<>"
FEW_DECADES = 300.0  # from one end of an axis to the other
KEPT = "\N{NO-BREAK SPACE}"  # for blanks inside of formulas, at which no line breaks
SYMBOLS = {
    "K_e": "$K_e$",
    "T_L": "$T_L$",
    "K_edot": r"$K_{\dot e}$",
    "omega_nm": r"$\omega_{nm}$",
    "zeta_nm": r"$\zeta_{nm}$",
    "tau_e": r"$\tau_e$",
}


def with_unit(quantity: str, unit: str | None) -> str:
    """A quantity and its unit as the label of an axis.

    Parameters
    ----------
    quantity : str
        What it is.
    unit : str or None
        Its unit, if it has one.

    Returns
    -------
    label : str

    Examples
    --------
    >>> from skhoid.plotting import with_unit
    >>> with_unit("output", "deg")
    'output, deg'
    """
    return f"{quantity}, {unit}" if unit else quantity


def letters(figure: Any) -> int:
    """Letters in a line across the figure."""
    return letters_across(figure.get_figwidth())


def letters_across(width: float) -> int:
    """Letters in so many inches."""
    return int(72.0 * width / (LETTER * mpl.rcParams["font.size"]))


def letters_above(panel: Axes) -> int:
    """Letters in a line of a title of medium size above a panel."""
    share = panel.get_window_extent().width / panel.figure.bbox.width
    return max(int(TITLE * share * letters(panel.figure)), 12)


def kept_whole(text: str) -> str:
    """A text in which no line breaks inside of a formula or before a percent sign."""
    return re.sub(r"\$[^$]*\$| %", lambda found: found[0].replace(" ", KEPT), text)


def wrapped(text: str, width: int) -> str:
    """A text in lines of at most so many letters; formulas stay whole."""
    lines = "\n".join(textwrap.wrap(kept_whole(text), max(width, 1), break_on_hyphens=False))
    return lines if KEPT in text else lines.replace(KEPT, " ")


def legend_columns(labels: Iterable[str], width: int) -> int:
    """Columns of a legend with as few rows as fit into so many letters."""
    lengths = [len(re.sub(r"[$\\_^{}]", "", label)) + HANDLE for label in labels]
    for rows in range(1, len(lengths)):
        columns = -(-len(lengths) // rows)
        if sum(part.max() for part in np.array_split(lengths, columns)) <= width:
            return columns
    return 1


def parameter_symbol(name: str) -> str:
    """Name of a parameter of the operator, or of an ARX model such as b0 or b0(e), as a formula."""
    found = re.fullmatch(r"([ab])(\d+)(?:\((.*)\))?", name)
    if found is None:
        return SYMBOLS.get(name, name)
    letter, number, channel = found.groups()
    return f"${letter}_{{{number}}}$" + (f" ({channel})" if channel else "")


def note_outside(panel: Axes, values: np.ndarray, corner: tuple[str, str]) -> Any:
    """Count the values outside the limits, in a corner of the panel; None if there are none."""
    low, high = panel.get_ylim()
    shown = values[~np.isnan(values)]
    outside = int(np.sum((shown < low) | (shown > high)))
    if not outside:
        return None
    return corner_note(panel, f"{outside} of {shown.size} outside", corner)


def corner_note(panel: Axes, text: str, corner: tuple[str, str]) -> Any:
    """Small text in a corner of the panel, on its background."""
    return panel.text(
        {"left": 0.01, "right": 0.99}[corner[1]],
        {"bottom": 0.04, "top": 0.96}[corner[0]],
        text,
        transform=panel.transAxes,
        ha=corner[1],
        va=corner[0],
        fontsize="small",
        bbox={"facecolor": background(), "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
    )


def say_instead(panel: Axes, text: str, width: int = 46) -> None:
    """What is not available, in the place where it would be drawn."""
    # Not set_xticks([]), which panels that share the axis would lose their ticks by.
    panel.tick_params(which="both", length=0, labelbottom=False, labelleft=False)
    middle: dict[str, Any] = {"transform": panel.transAxes, "ha": "center", "va": "center"}
    panel.text(0.5, 0.5, wrapped(text, width), color=dimmed(), fontsize="small", **middle)


def draw_band(
    panel: Axes, x: Any, low: Any, high: Any, colour: Any, label: str | None = None, **more: Any
) -> Any:
    """A band of this colour from ``low`` to ``high``, through which lines are seen."""
    look: dict[str, Any] = {"color": colour, "alpha": veil(0.25), "lw": 0, "label": label}
    return panel.fill_between(x, low, high, **(look | more))


def draw_arrow(
    panel: Axes, at: tuple[float, float], away: tuple[float, float], colour: Any
) -> None:
    """An arrow from a point (of the data) by some points of paper: a bound that is exceeded."""
    look = {"arrowstyle": "<-", "color": colour, "lw": scaled(1.6), "shrinkA": 0, "shrinkB": 0}
    panel.annotate("", at, away, textcoords="offset points", arrowprops=look)


def find_limits(
    inner: Any, outer: Any, much: float, margin: float, least: float = 1e-12
) -> tuple[float, float]:
    """Limits that hold ``outer``, or where that takes ``much`` times its range, ``inner`` alone.

    The ``margin`` above and below is a share of the range, which is taken as ``least`` at least.
    """
    held = outer if np.ptp(outer) <= much * np.ptp(inner) else inner
    low, high = float(np.min(held)), float(np.max(held))
    beyond = margin * max(high - low, 0.02 * abs(high), least)
    return low - beyond, high + beyond


def plain_logarithmic(axis: Axis, *, minor_ticks: bool = True) -> None:
    """Plain numbers on a logarithmic axis, at 1, 2 and 5 where its ends are a few decades apart."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < FEW_DECADES * low else (1.0,)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
    if not minor_ticks:
        axis.set_minor_locator(NullLocator())


def phase_ticks(axis: Axis) -> None:
    """Ticks of a phase in degrees, at parts of a turn."""
    axis.set_major_locator(MaxNLocator(7, steps=[1.8, 3.6, 4.5, 9]))


def legend_entries(panels: Any) -> dict[str, Any]:
    """Handles for a legend of several panels by label, each label once.

    Parameters
    ----------
    panels : iterable of Axes
        The panels.

    Returns
    -------
    entries : dict {str: artist}

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> from skhoid.plotting import legend_entries
    >>> figure, panels = plt.subplots(2)
    >>> for panel in panels:
    ...     _ = panel.plot([0, 1], label="measured")
    >>> list(legend_entries(panels))
    ['measured']
    """
    entries: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    return entries


def legend_inside(panel: Axes, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """A small legend in a panel, where it hides least; none without labels."""
    if labels:
        panel.legend(handles, labels, loc="best", fontsize="small")


def names_as_they_are(figure: Figure, names: Iterable[str]) -> None:
    """Show names from the data as such: matplotlib takes what is between dollars for formulas.

    Its setting ``text.parse_math`` would also spoil the labels of logarithmic axes.

    Parameters
    ----------
    figure : Figure
        With all texts in it.
    names : iterable of str
        Names of channels, runs, people and units.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> from skhoid.plotting import names_as_they_are
    >>> figure, panel = plt.subplots()
    >>> title = panel.set_title("run $1 of $2")
    >>> names_as_they_are(figure, ["run $1 of $2"])
    >>> title.get_parse_math()
    False
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


def short_names(names: Iterable[Any], most: int) -> list[str]:
    """Names of at most so many letters; what all have in common is left out where one is longer."""
    whole = [str(name) for name in names]
    if all(len(name) <= most for name in whole):
        return whole
    if len(set(whole)) > 1:
        start = _in_common(whole)
        end = _in_common([name[start:][::-1] for name in whole])
        if start > most // 2:
            whole = ["…" + name[start:] for name in whole]
        if end > 2:
            whole = [name[: len(name) - end] + "…" for name in whole]
    return [cut(name, most) for name in whole]


def cut(text: str, most: int) -> str:
    """A text of at most so many letters."""
    return text if len(text) <= most else f"{text[: most - 1].rstrip()}…"


def _in_common(names: list[str]) -> int:
    """Letters at the start that are the same in all names, but not a part of a number."""
    same = 0
    for letters in zip(*names, strict=False):
        if len(set(letters)) > 1:
            break
        same += 1
    while same and names[0][same - 1].isdigit():
        same -= 1
    return same
