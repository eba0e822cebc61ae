"""Box plots of a study's results over remnant intensity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ._axes import limits_of, note_outside
from ._bent_axis import bend_axes, round_up
from ._checks import check_option
from ._display import Display
from ._layout import page_width
from ._roles import GREY, foreground, remnant_colour, scaled, series_colour, sized
from ._study import (
    REPLICATION,
    SAID,
    cell_text,
    check_table,
    ordered,
    quantity,
    refuse_mixtures,
)
from ._study_tables import STATISTICS, boxes_of_cells, differences

NAME = "StudyBoxDisplay"
FILLED = 0.84  # of the distance of intensities that boxes take
APART = 5.0  # times the others' reach, from which a group asks for a logarithmic axis
MUCH = 2.5  # times the range of the whiskers, up to which limits hold the outliers too
MARGIN = 0.06
FLAT = 2.5  # points
SCALES = ("auto", "linear", "symlog")


@dataclass(kw_only=True, eq=False, repr=False)
class StudyBoxDisplay(Display):
    """Box plots of a study: a box for each group beside the other, over remnant intensity.

    Boxes hold the middle half of the replications, with the median as a line; whiskers reach the
    furthest replication within 1.5 times the box, and points are the others. With that, delays
    over remnant filters are Figs. 9, G.1 and G.2, relative biases with fixed and estimated delay
    Figs. 10 and G.3-G.8, and the difference of their VAF is Fig. 12.

    Where one group reaches more than five times as far from zero as the median group, as the
    biases with first-order remnant do, the axis is linear around zero and logarithmic beyond, and
    its label says from where. Otherwise limits hold all whiskers, and a note counts outliers
    outside, if there are some.

    Make it with :meth:`from_table`.

    Parameters
    ----------
    boxes : DataFrame
        One row per box: ``value`` (name of the result), the columns of ``by``, ``x`` and
        ``group``, the number of replications ``n``, ``low``, ``q1``, ``median``, ``q3`` and
        ``high`` of box and whiskers, and all results in ``values``, an array.
    group : str, default="remnant_order"
        Column that is shown by colour.
    x : str, default="remnant_intensity"
        Column along the axis, a place for each of its values.
    by : sequence of str, default=()
        At most two columns that make panels.
    difference : tuple (column, first, second) or None, default=None
        Of what the results are differences.
    reference : float, dict or None, default=None
        Where to draw a dotted line, see :meth:`from_table`.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_rows, n_columns)
        The panels.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    panels_ : list of dict
        What each panel of ``axes_.flat`` shows: ``value`` and the values of ``by``.
    artists_ : list of dict
        Artists of each panel by group: a dict of lists as :meth:`matplotlib.axes.Axes.bxp` returns.
    references_ : list of Line2D or None
        The dotted line in each panel.
    notes_ : list of Text or None
        Count of results outside, in each panel.

    References
    ----------
    Van Grootheest, thesis, Eqs. 29-30, Figs. 9, 10, 12 and Appendix G.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid.plotting.study_boxes import StudyBoxDisplay
    >>> cells = [(m, P_n, i) for m in (1, 2, "nm") for P_n in (0.0, 0.15) for i in range(20)]
    >>> table = pd.DataFrame(cells, columns=["remnant_order", "remnant_intensity", "replication"])
    >>> rng = np.random.default_rng(0)
    >>> table["nk"] = 29 + np.rint(10 * table["remnant_intensity"] * rng.normal(size=len(table)))
    >>> display = StudyBoxDisplay.from_table(table, "nk", reference=29)
    >>> display.boxes["median"].tolist()
    [29.0, 29.0, 29.0, 29.0, 29.0, 29.5]
    >>> display.ax_.get_ylabel()
    'delay $n_k$, samples'
    """

    boxes: pd.DataFrame
    group: str = "remnant_order"
    x: str = "remnant_intensity"
    by: Sequence[str] = ()
    difference: tuple[str, Any, Any] | None = None
    reference: Any = None

    @classmethod
    def from_table(
        cls,
        table: pd.DataFrame,
        value: str | Sequence[str],
        *,
        group: str = "remnant_order",
        x: str = "remnant_intensity",
        by: str | Sequence[str] = (),
        difference: tuple[str, Any, Any] | None = None,
        reference: Any = None,
        scale: str = "auto",
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the table of a study.

        Parameters
        ----------
        table : DataFrame
            One row per replication and cell, with a column ``replication`` after those that name
            the cell. What is not drawn apart must not vary: choose it before.
        value : str or list of str
            Column of results. Several are panels below each other.
        group : str, default="remnant_order"
            Column that is shown by colour.
        x : str, default="remnant_intensity"
            Column along the axis.
        by : str or list of str, default=()
            One or two columns that make panels: side by side, or for one ``value`` and two
            columns, one row for each value of the first.
        difference : tuple (column, first, second) or None, default=None
            Draw results where the column is ``first`` less those of the same replication where it
            is ``second``, as ``("delay", "fixed", "estimated")`` for Eq. 29.
        reference : float, dict or None, default=None
            Where to draw a dotted line. A dict has one for each row, or each column, of panels:
            ``{50: 15, 100: 29}``. None means zero for biases and differences.
        scale : {"auto", "linear", "symlog"}, default="auto"
            Of the vertical axes.
        ax : Axes, array of Axes or None, default=None
            Where to draw, one for each panel. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : StudyBoxDisplay

        Raises
        ------
        TypeError
            If ``table`` is no DataFrame.
        ValueError
            If a column is missing, cells would be mixed, or an option is not known.
        """
        values = [value] if isinstance(value, str) else list(value)
        panels = (by,) if isinstance(by, str) else tuple(by)
        if not values or len(panels) > 2:
            raise ValueError(f"{NAME} needs a value, and takes at most two columns in by.")
        keys = [*panels, x, group]
        if len(set(keys)) < len(keys):
            raise ValueError(f"by, x and group are different columns; got {', '.join(keys)}.")
        column = [] if difference is None else [difference[0]]
        check_table(table, [*keys, *column, *values, REPLICATION], NAME)
        refuse_mixtures(table, [*keys, *column], NAME)
        if difference is not None:
            table = differences(table, values, keys, difference, NAME)
        display = cls(
            boxes=boxes_of_cells(table, values, keys),
            group=group,
            x=x,
            by=panels,
            difference=difference,
            reference=reference,
        )
        return display.plot(ax, **styles, scale=scale)

    def plot(
        self, ax: Any = None, *, scale: str = "auto", box_kw: dict[str, Any] | None = None
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, array of Axes or None, default=None
            Where to draw, one for each panel. None makes a figure.
        scale : {"auto", "linear", "symlog"}, default="auto"
            Of the vertical axes.
        box_kw : dict or None, default=None
            Keywords of matplotlib for the boxes.

        Returns
        -------
        self : StudyBoxDisplay
        """
        styles = {"box": box_kw}
        check_option("scale", scale, SCALES)
        rows, columns = self._grid()
        shape = len(rows), len(columns)
        wide = 6.4 if shape[1] == 1 else 1.4 + min(3.8 * shape[1], 12.0)
        width = page_width(wide, shape[1])
        height = 4.2 if shape[0] == 1 else 1.2 + 1.9 * shape[0]
        shows = f"{shape[0]} rows of {shape[1]} panels"
        self.axes_ = self._take_axes(ax, shows, shape, figsize=(width, height)).reshape(shape)
        self.ax_ = self.axes_[0, 0]
        self._groups = ordered(self.boxes[self.group])
        self._places = ordered(self.boxes[self.x])
        self.panels_ = [{**row, **column} for row in rows for column in columns]
        self.artists_: list[dict[Any, Any]] = []
        self.references_: list[Any] = []
        self.notes_: list[Any] = []
        for row, panels in zip(rows, self.axes_, strict=True):
            shown = [_rows_of(self.boxes, {**row, **column}) for column in columns]
            for column, panel, boxes in zip(columns, panels, shown, strict=True):
                self.artists_.append(self._draw(panel, boxes))
                level = self._level(row, column)
                self.references_.append(
                    None
                    if level is None
                    else panel.axhline(level, color=GREY, ls=":", lw=scaled(1.4), zorder=1.5)
                )
            self._limit(row, columns, panels, pd.concat(shown), scale)
            for panel, boxes in zip(panels, shown, strict=True):
                self._colour_flat_boxes(panel)
                every = np.concatenate([*boxes["values"], np.empty(0)])
                self.notes_.append(note_outside(panel, every, ("top", "right")))
        self._restyle(styles, box=[drawn["boxes"] for d in self.artists_ for drawn in d.values()])
        self._label(columns)
        return self

    def _grid(self) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """What rows and columns of panels show."""
        values = self.boxes["value"].drop_duplicates().tolist()
        levels = {name: ordered(self.boxes[name]) for name in self.by}
        rows = [{"value": value} for value in values]
        if len(values) == 1 and len(self.by) == 2:
            below = self.by[0]
            rows = [{"value": values[0], below: level} for level in levels.pop(below)]
        combinations = product(*levels.values())
        return rows, [dict(zip(levels, found, strict=True)) for found in combinations]

    def _colour(self, position: int) -> str:
        if self.group == "remnant_order":
            return remnant_colour(self._groups[position])
        return series_colour(position)

    def _draw(self, panel: Any, boxes: pd.DataFrame) -> dict[Any, Any]:
        width = FILLED / len(self._groups)
        artists = {}
        for position, group in enumerate(self._groups):
            colour = self._colour(position)
            of_group = _rows_of(boxes, {self.group: group})
            of_group = of_group[of_group["n"] > 0]
            places = [_index(self._places, value) for value in of_group[self.x]]
            offset = (position + 0.5) * width - FILLED / 2
            artists[group] = panel.bxp(
                [_statistics(box) for box in of_group.to_dict("records")],
                positions=np.add(places, offset),
                widths=0.8 * width,
                manage_ticks=False,
                patch_artist=True,
                boxprops={
                    "facecolor": colour,
                    "edgecolor": colour,
                    "alpha": 0.75,
                    "lw": scaled(0.8),
                },
                medianprops={"color": foreground(), "lw": scaled(1.2)},
                whiskerprops={"color": colour, "lw": scaled(0.9)},
                capprops={"color": colour, "lw": scaled(0.9)},
                flierprops={
                    "marker": ".",
                    "ms": sized(3),
                    "markerfacecolor": colour,
                    "markeredgecolor": colour,
                },
            )
        return artists

    def _colour_flat_boxes(self, panel: Any) -> None:
        """Medians in the colour of boxes that are too flat to show it, as of equal delays."""
        for drawn in self.artists_[list(self.axes_.flat).index(panel)].values():
            for box, median in zip(drawn["boxes"], drawn["medians"], strict=True):
                heights = panel.transData.transform(box.get_path().vertices)[:, 1]
                if np.ptp(heights) * 72 / self.figure_.dpi < FLAT:
                    median.set(color=box.get_edgecolor(), lw=scaled(2.4), solid_capstyle="butt")

    def _level(self, row: Mapping[str, Any], column: Mapping[str, Any]) -> float | None:
        """Where the dotted line of a panel stands."""
        level = self.reference
        if level is None and (row["value"].startswith("bias_") or self.difference is not None):
            level = 0.0
        if isinstance(level, Mapping):
            found = [level[key] for key in (*row.values(), *column.values()) if key in level]
            level = found[0] if found else None
        return None if level is None else float(level)

    def _limit(
        self,
        row: Mapping[str, Any],
        columns: Sequence[Mapping[str, Any]],
        panels: Any,
        boxes: pd.DataFrame,
        scale: str,
    ) -> None:
        """One scale and one range for a row, which holds the whiskers and what is near them."""
        boxes = boxes[boxes["n"] > 0]
        label = self._quantity(row["value"])
        if len(self.by) == 2 and len(row) > 1:
            label = f"{cell_text(self.by[0], row[self.by[0]])}\n{label}"
        if boxes.empty:
            panels[0].set_ylabel(label)
            return
        reach = boxes[["low", "high"]].abs().max(axis=1)
        reaches = reach.groupby(boxes[self.group], dropna=False, sort=False).max()
        near = reaches[reaches <= APART * reaches.median()]
        bend = round_up(float(near.max()))
        levels = [x for x in (self._level(row, column) for column in columns) if x is not None]
        every = np.concatenate([*boxes["values"], levels])
        if scale == "symlog" or (scale == "auto" and near.size < reaches.size and bend > 0):
            bend = bend or 1.0
            label += f"\n(log beyond ±{bend:g})"
            bend_axes(panels, bend, every)
        else:
            whiskers = [boxes["low"].min(), boxes["high"].max(), *levels]
            limits = limits_of(whiskers, every, MUCH, MARGIN)
            for panel in panels:
                panel.set_ylim(limits)
                if (every == np.rint(every)).all():
                    panel.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        panels[0].set_ylabel(label)

    def _label(self, columns: Sequence[Any]) -> None:
        for panels in self.axes_:
            for panel in panels:
                panel.set_xlim(-0.5, len(self._places) - 0.5)
                names = [f"{v:g}" if isinstance(v, (int, float)) else str(v) for v in self._places]
                panel.set_xticks(range(len(self._places)), names)
                panel.tick_params(axis="x", length=0)
                for border in np.arange(len(self._places) - 1) + 0.5:
                    panel.axvline(border, color=GREY, lw=scaled(0.5), alpha=0.4, zorder=0.5)
                panel.grid(axis="y", alpha=0.3)
        for panels in self.axes_[:, 1:].T if self._own else []:
            for panel in panels:
                panel.tick_params(labelleft=False)
        for panel in self.axes_[:-1].flat if self._own else []:
            panel.tick_params(labelbottom=False)
        for panel in self.axes_[-1]:
            panel.set_xlabel(quantity(self.x))
        for panel, column in zip(self.axes_[0], columns, strict=True):
            title = ", ".join(cell_text(name, level) for name, level in column.items())
            panel.set_title(title, fontsize="medium")
        handles: list[Any] = [
            Patch(facecolor=self._colour(i), alpha=0.75) for i in range(len(self._groups))
        ]
        labels = [cell_text(self.group, group) for group in self._groups]
        lines = [line for line in self.references_ if line is not None]
        if lines:
            handles.append(lines[0])
            only_delays = all(panel["value"] == "nk" for panel in self.panels_)
            zero = all(line.get_ydata()[0] == 0 for line in lines)
            labels.append("true delay $n_k^0$" if only_delays else "zero" if zero else "reference")
        self._legend(handles, labels, columns=None if self.axes_.shape[1] == 1 else len(labels))
        if self._own:
            self.figure_.align_ylabels(self.axes_[:, 0])

    def _quantity(self, value: str) -> str:
        if self.difference is None:
            return quantity(value)
        name, *levels = self.difference
        first, second = (SAID.get(name, {}).get(str(level), str(level)) for level in levels)
        of, _, unit = quantity(value).partition(", ")
        unit = ", points" if unit == "%" else f", {unit}" if unit else ""
        return f"{of}{unit}:\n{first} − {second}"


def _statistics(box: Mapping[Any, Any]) -> dict[str, Any]:
    """A box as matplotlib takes it."""
    values = box["values"]
    known = {theirs: box[ours] for ours, theirs in STATISTICS.items()}
    return known | {"fliers": values[(values < box["low"]) | (values > box["high"])]}


def _rows_of(boxes: pd.DataFrame, cell: Mapping[str, Any]) -> pd.DataFrame:
    for name, value in cell.items():
        same = boxes[name].isna() if pd.isna(value) else boxes[name] == value
        boxes = boxes[same]
    return boxes


def _index(values: Sequence[Any], wanted: Any) -> int:
    return next(i for i, v in enumerate(values) if v == wanted or (pd.isna(v) and pd.isna(wanted)))
