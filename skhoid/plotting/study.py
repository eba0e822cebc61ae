"""Results of Monte-Carlo studies: box plots over remnant, and frequency responses of methods.

Paths over time are in ``ensembles``, memory horizons in ``memory``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.cbook import boxplot_stats
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ._axes import (
    MARKERS,
    bend_axes,
    corner_note,
    limits_of,
    note_outside,
    phase_ticks,
    plain_logarithmic,
    round_up,
)
from ._display import Display, check_option, page_width
from ._roles import (
    GREY,
    PALETTE,
    ROLES,
    foreground,
    remnant_colour,
    scaled,
    series_colour,
    sized,
)
from ._study import (
    REPLICATION,
    SAID,
    cell_text,
    cells_of,
    check_table,
    chosen,
    chosen_panels,
    ordered,
    quantity,
    refuse_mixtures,
)

BOXES, RESPONSES = "StudyBoxDisplay", "StudyResponseDisplay"
# Box plots
STATISTICS = {"low": "whislo", "q1": "q1", "median": "med", "q3": "q3", "high": "whishi"}
FILLED = 0.84  # of the distance of intensities that boxes take
APART = 5.0  # times the others' reach, from which a group asks for a logarithmic axis
MUCH = 2.5  # times the range of the whiskers, up to which limits hold the outliers too
MARGIN = 0.06
FLAT = 2.5  # points
SCALES = ("auto", "linear", "symlog")
# Responses
KEYS = ["remnant_intensity", "method", "omega"]
COMPLEX = ["H_real", "H_imag"]
STATED = ["magnitude_sd", "phase_sd"]
METHODS = ("fc", "batch", "recursive")
PARTS = ("magnitude", "phase")
SDS = {
    "magnitude": {
        "spread": "magnitude_sd",
        "total": "total_sd",
        "stated": "stated_magnitude_sd",
    },
    "phase": {"spread": "phase_sd", "total": "total_phase_sd", "stated": "stated_phase_sd"},
}
N_POINTS = 300
LEAST = 0.3  # of the smallest mean, below which magnitudes are cut
SPAN = 100.0  # from the lowest standard deviation on an axis to the median
CROWDED = 200.0  # from one end of an axis to the other, from where only powers of ten have names
ROOM = 0.8  # of the smallest distance of lines, for all that belongs to one
STEP = 0.16  # of the smallest distance of lines, between what stands beside each other
Truth = Callable[[np.ndarray], Any]


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
    %(boxes)

    Attributes
    ----------
    %(sizes)
    panels_ : list of dict
        What each panel of ``axes_.flat`` shows: ``value`` and the values of ``by``.
    artists_ : list of dict
        Artists of each panel by group: a dict of lists as :meth:`matplotlib.axes.Axes.bxp`
        returns. The boxes are the main artists.
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
    >>> from skhoid.plotting import StudyBoxDisplay
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
    scale: str = "auto"

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
        **kwargs: Any,
    ) -> Self:
        """Draw the table of a study.

        Parameters
        ----------
        table : DataFrame
            One row per replication and cell, with a column ``replication`` after those that name
            the cell. What is not drawn apart must not vary: choose it before.
        value : str or list of str
            Column of results. Several are panels below each other.
        %(boxes)
        %(keywords)

        %(display)

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
            raise ValueError(f"{BOXES} needs a value, and takes at most two columns in by.")
        keys = [*panels, x, group]
        if len(set(keys)) < len(keys):
            raise ValueError(f"by, x and group are different columns; got {', '.join(keys)}.")
        column = [] if difference is None else [difference[0]]
        check_table(table, [*keys, *column, *values, REPLICATION], BOXES)
        refuse_mixtures(table, [*keys, *column], BOXES)
        if difference is not None:
            table = _differences(table, values, keys, difference)
        return cls(
            boxes=_boxes_of(table, values, keys),
            group=group,
            x=x,
            by=panels,
            difference=difference,
            reference=reference,
            scale=scale,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        check_option("scale", self.scale, SCALES)
        rows, columns = self._grid()
        shape = len(rows), len(columns)
        wide = 6.4 if shape[1] == 1 else 1.4 + min(3.8 * shape[1], 12.0)
        size = page_width(wide, shape[1]), 4.2 if shape[0] == 1 else 1.2 + 1.9 * shape[0]
        shows = f"{shape[0]} rows of {shape[1]} panels"
        self.axes_ = self._take_axes(ax, shows, shape, figsize=size).reshape(shape)
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
                look: dict[str, Any] = {"color": GREY, "ls": ":", "lw": scaled(1.4), "zorder": 1.5}
                self.references_.append(None if level is None else panel.axhline(level, **look))
            self._limit(row, columns, panels, pd.concat(shown))
            for panel, boxes in zip(panels, shown, strict=True):
                self._colour_flat_boxes(panel)
                every = np.concatenate([*boxes["values"], np.empty(0)])
                self.notes_.append(note_outside(panel, every, ("top", "right")))
        self._restyle(kwargs, [drawn["boxes"] for d in self.artists_ for drawn in d.values()])
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
            thin = {"color": colour, "lw": scaled(0.9)}
            box = {"facecolor": colour, "edgecolor": colour, "alpha": 0.75, "lw": scaled(0.8)}
            point = {"marker": ".", "ms": sized(3), "mfc": colour, "mec": colour}
            artists[group] = panel.bxp(
                [_statistics(box) for box in of_group.to_dict("records")],
                positions=np.add(places, (position + 0.5) * width - FILLED / 2),
                widths=0.8 * width,
                manage_ticks=False,
                patch_artist=True,
                boxprops=box,
                medianprops={"color": foreground(), "lw": scaled(1.2)},
                whiskerprops=thin,
                capprops=thin,
                flierprops=point,
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
    ) -> None:
        """One scale and one range for a row, which holds the whiskers and what is near them."""
        boxes = boxes[boxes["n"] > 0]
        label = self._quantity(row["value"])
        if len(self.by) == 2 and len(row) > 1:
            label = f"{cell_text(self.by[0], row[self.by[0]])}\n{label}"
        panels[0].set_ylabel(label)
        if boxes.empty:
            return
        reach = boxes[["low", "high"]].abs().max(axis=1)
        reaches = reach.groupby(boxes[self.group], dropna=False, sort=False).max()
        near = reaches[reaches <= APART * reaches.median()]
        bend = round_up(float(near.max()))
        levels = [x for x in (self._level(row, column) for column in columns) if x is not None]
        every = np.concatenate([*boxes["values"], levels])
        far = near.size < reaches.size and bend > 0
        if self.scale == "symlog" or (self.scale == "auto" and far):
            bend = bend or 1.0
            panels[0].set_ylabel(f"{label}\n(log beyond ±{bend:g})")
            bend_axes(panels, bend, every)
            return
        whiskers = [boxes["low"].min(), boxes["high"].max(), *levels]
        for panel in panels:
            panel.set_ylim(limits_of(whiskers, every, MUCH, MARGIN))
            if (every == np.rint(every)).all():
                panel.yaxis.set_major_locator(MaxNLocator(6, integer=True))

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


def _boxes_of(table: pd.DataFrame, values: list[str], keys: list[str]) -> pd.DataFrame:
    """Box and whiskers of each cell."""
    rows = []
    for value in values:
        for key, part in table.groupby(keys, sort=False, dropna=False):
            found = part[value].to_numpy(dtype=float)
            found = found[np.isfinite(found)]
            (known,) = boxplot_stats(found) if found.size else ({},)
            row = {"value": value, **dict(zip(keys, key, strict=True)), "n": found.size}
            row |= {ours: known.get(theirs, np.nan) for ours, theirs in STATISTICS.items()}
            rows.append(row | {"values": found})
    return pd.DataFrame(rows)


def _differences(
    table: pd.DataFrame, values: list[str], keys: list[str], difference: tuple[str, Any, Any]
) -> pd.DataFrame:
    """Results at one level of a column less those at another, replication by replication."""
    name, first, second = difference
    index = [c for c in dict.fromkeys([*cells_of(table), *keys]) if c != name] + [REPLICATION]
    # Cells without a remnant filter are cells too: their order may be NaN.
    columns = [*index, *values]
    sides = [chosen(table, {name: level}, BOXES)[columns] for level in (first, second)]
    both = sides[0].merge(sides[1], on=index, suffixes=("", "_other"))
    others = both[[f"{value}_other" for value in values]].to_numpy()
    both[values] = both[values].to_numpy() - others
    return both[columns]


@dataclass(kw_only=True, eq=False, repr=False)
class StudyResponseDisplay(Display):
    """Bode plots of a study: estimates of each method, with found and stated spread (Appendix I).

    A column of panels for each method, of one condition. Markers in the upper two, magnitude and
    phase, are means of the complex estimates over the replications (Eqs. H.1-H.4). Of the bars
    around them, the thick are standard deviations of magnitude and phase over the replications, the
    thin the total standard deviation in the complex plane that the thesis draws (Eqs. H.5-H.8),
    which is larger: it holds errors along the circle too. The pale bars beside them, without a
    marker, are what a single estimate states (Eqs. H.9-H.10; root mean square over the
    replications), to be compared with the thick ones.

    The lower two panels show the same standard deviations on axes of their own, since those of ARX
    models are too small for bars: of the magnitude, as a share of the mean, and of the phase.
    These axes leave out what is below a hundredth of the median, as deviations without remnant are.

    Make it with :meth:`from_table`.

    Parameters
    ----------
    responses : DataFrame
        One row per remnant intensity, method and line: ``remnant_intensity``, ``method``, ``omega``
        (rad/s), number of replications ``n``; of the mean ``magnitude`` and ``phase`` (deg);
        ``magnitude_sd`` and ``phase_sd`` (deg) over the replications, ``total_sd`` (Eq. H.7) and
        ``total_phase_sd`` (deg, Eq. H.8); and ``stated_magnitude_sd`` and ``stated_phase_sd``
        (deg). NaN stands for what is not known.
    truth : DataFrame or None, default=None
        ``omega`` (rad/s), ``magnitude`` and ``phase`` (deg) of the true response.
    title : str, default=""
        Of the figure.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (4, n_methods)
        Magnitudes, phases, and the standard deviations of both.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    methods_ : list of str
        The method in each column.
    means_ : dict of Line2D
        By (``"magnitude"`` or ``"phase"``, method, remnant intensity): the main artists.
    bars_ : dict of LineCollection
        By (kind, part, method, remnant intensity), where the kind is ``"spread"`` (over the
        replications), ``"total"`` or ``"stated"``.
    sd_lines_ : dict of Line2D
        Standard deviations of magnitude (%) and phase (deg) by the same.
    truth_ : list of Line2D
        The true response in each panel of the upper two rows.
    notes_ : dict of Text
        Counts of bars of magnitude that are cut, by method.

    See Also
    --------
    BodeDisplay : Single responses and their intervals.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid import HumanOperator
    >>> from skhoid.plotting import StudyResponseDisplay
    >>> omega = np.array([0.5, 1.0, 2.0, 5.0])
    >>> true = HumanOperator().frequency_response
    >>> rng = np.random.default_rng(0)
    >>> runs = []
    >>> for i in range(10):
    ...     H = true(omega) * (1 + 0.1 * rng.normal(size=4) + 0.1j * rng.normal(size=4))
    ...     run = {"condition": "C1", "remnant_intensity": 0.15, "replication": i, "method": "fc"}
    ...     runs.append(pd.DataFrame({**run, "omega": omega, "H_real": H.real, "H_imag": H.imag}))
    >>> table = pd.concat(runs).assign(magnitude_sd=np.nan, phase_sd=np.nan)
    >>> display = StudyResponseDisplay.from_table(table, truth=true)
    >>> display.methods_
    ['fc']
    """

    responses: pd.DataFrame
    truth: pd.DataFrame | None = None
    title: str = ""

    @classmethod
    def from_table(
        cls,
        table: pd.DataFrame,
        *,
        condition: str | None = None,
        remnant_intensity: float | Sequence[float] | None = None,
        truth: Truth | pd.DataFrame | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the table of a study of frequency responses.

        Parameters
        ----------
        table : DataFrame
            One row per cell, replication, method and line: ``condition``, ``remnant_intensity``,
            ``replication``, ``method``, ``omega`` (rad/s), ``H_real``, ``H_imag``, and what the
            estimate states of itself, ``magnitude_sd`` and ``phase_sd`` (rad), NaN where it does
            not.
        condition : str or None, default=None
            The condition to draw; None for the only one.
        remnant_intensity : float, list of float or None, default=None
            What to draw, one colour each; None for all.
        truth : callable, DataFrame or None, default=None
            The true response: a function of frequencies in rad/s, as ``frequency_response`` of a
            :class:`skhoid.HumanOperator` is, or a table of ``omega``, ``H_real`` and ``H_imag``.
            It also shows which turn a phase belongs to; without, phases go on from line to line,
            which a long delay between lines far apart makes slip.
        %(keywords)

        %(display)

        Raises
        ------
        TypeError
            If ``table`` is no DataFrame, or ``truth`` neither that nor a function.
        ValueError
            If a column is missing, cells would be mixed, or a choice is not in the table.
        """
        check_table(table, ["condition", *KEYS, REPLICATION, *COMPLEX, *STATED], RESPONSES)
        table = chosen_panels(table, condition, remnant_intensity, RESPONSES)
        refuse_mixtures(table, KEYS, RESPONSES)
        omega = np.unique(table["omega"].to_numpy(dtype=float))
        if not (omega > 0).all():
            raise ValueError(f"{RESPONSES}: omega is in rad/s and positive; got {omega.min():g}.")
        true = None if truth is None else _true_response(truth, omega)
        title = str(table["condition"].iloc[0])
        return cls(responses=_ensembles(table, true), truth=true, title=title).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        methods = ordered(self.responses["method"])
        self.methods_ = [m for m in METHODS if m in methods]
        self.methods_ += [m for m in methods if m not in METHODS]
        columns = len(self.methods_)
        self.axes_ = self._take_axes(
            ax,
            "magnitude, phase, and their standard deviations, of each method",
            (4, columns),
            figsize=(page_width(max(6.4, 1.4 + 3.2 * columns), columns), 9.6),
            sharex=True,
        ).reshape(4, columns)
        self.means_: dict[tuple[str, str, float], Any] = {}
        self.bars_: dict[tuple[str, str, str, float], Any] = {}
        self.sd_lines_: dict[tuple[str, str, str, float], Any] = {}
        self.truth_: list[Any] = []
        self.notes_: dict[str, Any] = {}
        self._intensities = ordered(self.responses["remnant_intensity"])
        lines = np.log(np.unique(self.responses["omega"]))
        # Beside each other: each intensity, and its stated spread.
        wide = min(STEP, ROOM / (2 * len(self._intensities)))
        wide *= np.diff(lines).min() if lines.size > 1 else 0.5
        for method, four in zip(self.methods_, self.axes_.T, strict=True):
            for panel in four:
                panel.set_xscale("log")
                panel.grid(alpha=0.3)
            for panel in (four[0], *four[2:]):
                panel.set_yscale("log")
            if self.truth is not None:
                for panel, name in zip(four[:2], PARTS, strict=True):
                    style = {**ROLES["truth"].style(1.4), "label": "truth", "zorder": 1.8}
                    self.truth_ += panel.plot(self.truth["omega"], self.truth[name], **style)
            for position, P_n in enumerate(self._intensities):
                shift = wide * (2 * position - len(self._intensities) + 0.5)
                of_method = self.responses[self.responses["method"] == method]
                rows = of_method[of_method["remnant_intensity"] == P_n].sort_values("omega")
                if not rows.empty:
                    self._draw(four, rows, (method, P_n), position, (shift, wide))
            four[0].set_title(cell_text("method", method), fontsize="medium")
        self._limit()
        self._restyle(kwargs, self.means_)
        self._label()
        return self

    def _draw(
        self,
        panels: Any,
        rows: pd.DataFrame,
        key: tuple[str, float],
        position: int,
        aside: tuple[float, float],
    ) -> None:
        """Means with bars, and their standard deviations over frequency."""
        shift, wide = aside
        omega, colour = rows["omega"].to_numpy(dtype=float), series_colour(position)
        at, beside = omega * np.exp(shift), omega * np.exp(shift + wide)
        mark = {"marker": MARKERS[position % len(MARKERS)], "ms": sized(3.5)}
        dots: dict[str, Any] = {"lw": scaled(1.0), "ls": ":"}
        kinds: dict[str, tuple[Any, dict[str, Any], dict[str, Any]]] = {
            "spread": (at, {"lw": scaled(2.4), "zorder": 2.6}, {"lw": scaled(1.4), **mark}),
            "total": (at, {**dots, "zorder": 2.5}, dots),
            "stated": (
                beside,
                {"lw": scaled(4.5), "alpha": 0.4, "zorder": 2.4},
                {"lw": scaled(4.5), "alpha": 0.4, "zorder": 1.9},
            ),
        }
        states = rows["stated_magnitude_sd"].notna().any()
        for upper, lower, name in zip(panels[:2], panels[2:], PARTS, strict=True):
            (self.means_[name, *key],) = upper.plot(
                at, rows[name], color=colour, ls="none", zorder=3, **mark
            )
            for kind, (where, bar, line) in kinds.items():
                if kind == "stated" and not states:
                    continue
                sd = rows[SDS[name][kind]]
                self.bars_[kind, name, *key] = _bars(upper, where, rows[name], sd, colour, bar)
                share = 100 * sd / rows["magnitude"] if name == "magnitude" else sd
                (self.sd_lines_[kind, name, *key],) = lower.plot(
                    omega, share.where(share > 0), color=colour, **line
                )

    def _limit(self) -> None:
        """The same limits for all methods; bars of magnitude that come near zero are cut."""
        table = self.responses
        size = table["magnitude"].to_numpy(dtype=float)
        sds = ["magnitude_sd", "total_sd", "stated_magnitude_sd"]
        widest = np.nan_to_num(table[sds].to_numpy(dtype=float)).max(axis=1)
        lows, tops, phases = size - widest, size + widest, []
        wide = [table[name].fillna(0.0) for name in ("total_phase_sd", "stated_phase_sd")]
        for sd in wide:
            phases += [table["phase"] - sd, table["phase"] + sd]
        if self.truth is not None:
            size = np.append(size, self.truth["magnitude"])
            tops = np.append(tops, self.truth["magnitude"])
            phases.append(self.truth["phase"])
        bottom = max(LEAST * np.nanmin(size), 0.8 * np.nanmin(lows))
        every = pd.concat(phases)
        for magnitude, phase in self.axes_[:2].T:
            magnitude.set_ylim(bottom, 1.3 * np.nanmax(tops))
            phase.set_ylim(every.min() - 15, every.max() + 15)
            phase_ticks(phase.yaxis)
        for panels in self.axes_[2:]:
            values = [np.asarray(a.get_ydata(), dtype=float) for p in panels for a in p.lines]
            known = np.concatenate(values)
            known = known[np.isfinite(known)]
            if known.size:
                lowest = known[known >= np.median(known) / SPAN].min()
                for panel in panels:
                    panel.set_ylim(lowest / 1.4, known.max() * 1.4)
        for panel in self.axes_[[0, 2, 3]].flat:
            plain_logarithmic(panel.yaxis, CROWDED, minor_ticks=False)
        for panel in self.axes_.flat:
            plain_logarithmic(panel.xaxis, CROWDED, minor_ticks=False)
        for column, method in enumerate(self.methods_):
            cut = int(np.sum(lows[(table["method"] == method).to_numpy()] < bottom))
            if cut:
                text = f"{cut} bar{'s' * (cut > 1)} cut"
                corner = ("bottom", "right")
                self.notes_[method] = corner_note(self.axes_[0, column], text, corner, 0.03)

    def _label(self) -> None:
        names = ("magnitude", "phase, deg", "sd of magnitude, %", "sd of phase, deg")
        for panel, name in zip(self.axes_[:, 0], names, strict=True):
            panel.set_ylabel(name)
        for panel in self.axes_[-1]:
            panel.set_xlabel("frequency, rad/s")
        for panel in self.axes_[:, 1:].flat if self._own else []:
            panel.tick_params(labelleft=False, which="both")
        handles: list[Any] = [
            Line2D([], [], color=series_colour(i), marker=MARKERS[i % len(MARKERS)], ls="")
            for i in range(len(self._intensities))
        ]
        labels = [f"{cell_text('remnant_intensity', P)}: mean" for P in self._intensities]
        colour = PALETTE[0]
        if self.responses["magnitude_sd"].notna().any():
            handles.append(Line2D([], [], color=colour, lw=scaled(2.4)))
            handles.append(Line2D([], [], color=colour, lw=scaled(1.0), ls=":"))
            labels += ["± 1 sd over replications", "± 1 total sd, Eqs. H.7-H.8"]
        if any(kind == "stated" for kind, *_ in self.bars_):
            handles.append(Line2D([], [], color=colour, lw=scaled(4.5), alpha=0.4))
            labels.append("± 1 sd stated, Eqs. H.9-H.10")
        if self.truth_:
            handles.append(self.truth_[0])
            labels.append("truth")
        if self._own:
            if self.title:
                self.figure_.suptitle(self.title, fontsize="medium")
            self.figure_.align_ylabels(self.axes_[:, 0])
        self._legend(handles, labels)


def _bars(
    panel: Any, at: np.ndarray, means: pd.Series, sd: pd.Series, colour: str, look: dict[str, Any]
) -> Any:
    """Bars to either side of the means; on a logarithmic axis they end above zero."""
    middle, half = means.to_numpy(dtype=float), sd.to_numpy(dtype=float)
    low = middle - half
    if means.name == "magnitude":
        low = np.where(low > 0, low, 1e-9 * middle)
    known = np.isfinite(half)
    return panel.vlines(at[known], low[known], (middle + half)[known], color=colour, **look)


def _true_response(truth: Any, omega: np.ndarray) -> pd.DataFrame:
    """Magnitude and phase of the true response."""
    if isinstance(truth, pd.DataFrame):
        check_table(truth, ["omega", *COMPLEX], f"{RESPONSES}: truth")
        truth = truth.sort_values("omega")
        lines = truth["omega"].to_numpy(dtype=float)
        H = truth["H_real"].to_numpy(dtype=float) + 1j * truth["H_imag"].to_numpy(dtype=float)
    elif callable(truth):
        lines = np.geomspace(omega[0] / 1.2, omega[-1] * 1.2, N_POINTS)
        H = np.asarray(truth(lines), dtype=complex)
    else:
        raise TypeError(
            f"truth is a function of omega or a table of it; got {type(truth).__name__}."
        )
    phase = np.degrees(np.unwrap(np.angle(H)))
    return pd.DataFrame({"omega": lines, "magnitude": np.abs(H), "phase": phase})


def _ensembles(table: pd.DataFrame, truth: pd.DataFrame | None) -> pd.DataFrame:
    """Means over the replications, their spread, and what single estimates state."""
    H = table["H_real"].to_numpy(dtype=float) + 1j * table["H_imag"].to_numpy(dtype=float)
    rows = table[KEYS].assign(
        re=H.real,
        im=H.imag,
        size=np.abs(H),
        stated_size=table["magnitude_sd"].to_numpy(dtype=float) ** 2,
        stated_angle=table["phase_sd"].to_numpy(dtype=float) ** 2,
    )
    groups = rows.groupby(KEYS, sort=True)
    mean = groups[["re", "im"]].mean()
    centre = (mean["re"] + 1j * mean["im"]).to_numpy()
    # Angles to the mean, which do not wrap unless they are half a turn off.
    own = mean["re"].index.get_indexer(pd.MultiIndex.from_frame(rows[KEYS]))
    angle = np.degrees(np.angle(H * np.conj(centre[own])))
    angles = rows[KEYS].assign(angle=angle).groupby(KEYS, sort=True)["angle"]
    total = np.sqrt(groups[["re", "im"]].var(ddof=1).sum(axis=1, skipna=False))
    size = np.abs(centre)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = total.to_numpy() / size
    total_phase = np.where(ratio > 1, 180.0, np.degrees(np.arctan(ratio)))  # NaN stays NaN
    stated = np.sqrt(groups[["stated_size", "stated_angle"]].mean())
    found = pd.DataFrame(
        {
            "n": groups.size(),
            "magnitude": size,
            "phase": np.degrees(np.angle(centre)),
            "magnitude_sd": groups["size"].std(ddof=1),
            "phase_sd": angles.std(ddof=1),
            "total_sd": total,
            "total_phase_sd": total_phase,
            "stated_magnitude_sd": stated["stated_size"],
            "stated_phase_sd": np.degrees(stated["stated_angle"]),
        },
        index=mean.index,
    ).reset_index()
    for _, rows_of in found.groupby(KEYS[:2], sort=False):
        phase = rows_of["phase"].to_numpy(dtype=float)
        if truth is None:
            phase = np.degrees(np.unwrap(np.radians(phase)))
        else:
            near = np.interp(np.log(rows_of["omega"]), np.log(truth["omega"]), truth["phase"])
            phase = phase - 360 * np.round((phase - near) / 360)
        found.loc[rows_of.index, "phase"] = phase
    return found
