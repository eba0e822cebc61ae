"""Results of Monte-Carlo studies: box plots over remnant, and frequency responses of methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, StrMethodFormatter

from ._axes import MARKERS, find_limits, note_outside, phase_ticks, plain_logarithmic
from ._display import Display, page_width
from ._roles import (
    GREY,
    ROLES,
    foreground,
    remnant_colour,
    scaled,
    series_colour,
    sized,
)
from ._study import REPLICATION, SAID, cell_text, check_table, ordered, quantity

PLACE = "remnant_intensity"
FILLED = 0.84  # of the distance of intensities that boxes take
APART = 5.0  # times the others' reach, from which a group asks for a logarithmic axis
MUCH = 2.5  # times the range of the whiskers, up to which limits hold the outliers too
MARGIN = 0.06
FLAT = 2.5  # points
# Responses
METHODS = ("fc", "batch", "recursive")
PARTS = ("magnitude", "phase")
N_POINTS = 300
LEAST = 0.3  # of the smallest mean, below which magnitudes are cut
SPAN = 100.0  # from the lowest standard deviation on an axis to the median
STEP = 0.03  # of a frequency, between what stands beside each other


@dataclass(kw_only=True, eq=False, repr=False)
class StudyBoxDisplay(Display):
    """Box plots of a study: a box for each group beside the other, over remnant intensity.

    Boxes hold the middle half of the replications, with the median as a line; whiskers reach the
    furthest replication within 1.5 times the box, and points are the others. With that, delays
    over remnant filters are Figs. 9, G.1 and G.2, relative biases with fixed and estimated delay
    Figs. 10 and G.3-G.8, and the difference of their VAF is Fig. 12.

    Where one group reaches more than five times as far from zero as the median group, as the
    biases with first-order remnant do, the axis is linear around zero and logarithmic beyond.
    Otherwise a note counts outliers outside.

    Make it with :meth:`from_table`.

    Parameters
    ----------
    table : DataFrame
        One row per replication and cell, with ``remnant_intensity``.
    values : sequence of str
        Columns of results, a row of panels each.
    %(boxes)

    Attributes
    ----------
    %(sizes)
    artists_ : list of dict
        Artists of each panel by group: a dict of lists as :meth:`matplotlib.axes.Axes.boxplot`
        returns. The boxes are the main artists.

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
    >>> display.ax_.get_ylabel()
    'delay $n_k$, samples'
    """

    table: pd.DataFrame
    values: Sequence[str]
    group: str = "remnant_order"
    by: str | None = None
    difference: tuple[str, Any, Any] | None = None
    reference: float | None = None

    @classmethod
    def from_table(
        cls,
        table: pd.DataFrame,
        value: str | Sequence[str],
        *,
        group: str = "remnant_order",
        by: str | None = None,
        difference: tuple[str, Any, Any] | None = None,
        reference: float | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the table of a study.

        Parameters
        ----------
        table : DataFrame
            One row per replication and cell, with ``remnant_intensity`` and ``replication``. What
            is not drawn apart must not vary: choose it before.
        value : str or list of str
            Column of results. Several are panels below each other.
        %(boxes)
        """
        values = [value] if isinstance(value, str) else list(value)
        keys = [PLACE, group, *([by] if by else []), REPLICATION]
        column = [] if difference is None else [difference[0]]
        check_table(table, [*keys, *column, *values], cls.__name__)
        if table.duplicated([*keys, *column]).any():
            raise ValueError(
                f"{cls.__name__}: the table has several rows of one {', '.join([*keys, *column])}. "
                "Choose one cell of what else varies, as table[table['condition'] == 'C1'] does."
            )
        if difference is not None:
            sides = [
                table[table[difference[0]] == level].set_index(keys)[values]
                for level in difference[1:]
            ]
            table = (sides[0] - sides[1]).reset_index()
        return cls(
            table=table,
            values=values,
            group=group,
            by=by,
            difference=difference,
            reference=reference,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        columns = [None] if self.by is None else ordered(self.table[self.by])
        shape = len(self.values), len(columns)
        wide = 6.4 if shape[1] == 1 else 1.4 + min(3.8 * shape[1], 12.0)
        size = page_width(wide, shape[1]), 4.2 if shape[0] == 1 else 1.2 + 1.9 * shape[0]
        shows = f"{shape[0]} rows of {shape[1]} panels"
        self._take_axes(ax, shows, shape, figsize=size)
        self.axes_ = self.axes_.reshape(shape)
        self._groups = ordered(self.table[self.group])
        self._places = ordered(self.table[PLACE])
        self.artists_: list[dict[Any, Any]] = []
        lines = []
        for value, panels in zip(self.values, self.axes_, strict=True):
            level = self.reference
            if level is None and (value.startswith("bias_") or self.difference is not None):
                level = 0.0
            for column, panel in zip(columns, panels, strict=True):
                part = self.table if column is None else self.table[self.table[self.by] == column]
                self.artists_.append(self._draw(panel, part, value))
                if level is not None:
                    look: dict[str, Any] = {"color": GREY, "ls": ":", "lw": scaled(1.4)}
                    lines.append(panel.axhline(level, zorder=1.5, **look))
            self._limit(value, panels, level)
        self._restyle(kwargs, [drawn["boxes"] for d in self.artists_ for drawn in d.values()])
        for column, panel in zip(columns, self.axes_[0], strict=True):
            panel.set_title("" if self.by is None else cell_text(self.by, column), size="medium")
        self._name_places()
        handles: list[Any] = [Patch(facecolor=self._colour(g), alpha=0.75) for g in self._groups]
        labels = [cell_text(self.group, group) for group in self._groups]
        if lines:
            zero = all(line.get_ydata()[0] == 0 for line in lines)
            only_delays = list(self.values) == ["nk"]
            handles.append(lines[0])
            labels.append("true delay $n_k^0$" if only_delays else "zero" if zero else "reference")
        self._legend(handles, labels)
        return self

    def _colour(self, group: Any) -> str:
        if self.group == "remnant_order":
            return remnant_colour(group)
        return series_colour(self._groups.index(group))

    def _draw(self, panel: Axes, table: pd.DataFrame, value: str) -> dict[Any, Any]:
        width = FILLED / len(self._groups)
        artists = {}
        for position, group in enumerate(self._groups):
            colour = self._colour(group)
            of_group = table[(table[self.group] == group) & np.isfinite(table[value])]
            thin = {"color": colour, "lw": scaled(0.9)}
            artists[group] = panel.boxplot(
                [of_group.loc[of_group[PLACE] == place, value] for place in self._places],
                positions=np.arange(len(self._places)) + (position + 0.5) * width - FILLED / 2,
                widths=0.8 * width,
                manage_ticks=False,
                patch_artist=True,
                boxprops={"fc": colour, "ec": colour, "alpha": 0.75, "lw": scaled(0.8)},
                medianprops={"color": foreground(), "lw": scaled(1.2)},
                whiskerprops=thin,
                capprops=thin,
                flierprops={"marker": ".", "ms": sized(3), "mfc": colour, "mec": colour},
            )
        return artists

    def _limit(self, value: str, panels: Any, level: float | None) -> None:
        """One scale and one range for a row, which holds the whiskers and what is near them."""
        label = self._quantity(value)
        row = self.artists_[-len(panels) :]
        reach = {
            group: np.concatenate([c.get_ydata() for drawn in row for c in drawn[group]["caps"]])
            for group in self._groups
        }
        levels = [] if level is None else [level]
        every = np.concatenate([self.table[value].dropna(), levels])
        furthest = np.array([np.nanmax(np.abs(ends), initial=0.0) for ends in reach.values()])
        near = furthest[furthest <= APART * np.median(furthest)]
        bend = float(f"{near.max():.0e}") if near.size else 0.0
        far = near.size < furthest.size and bend > 0
        whiskers = np.concatenate([*reach.values(), levels])
        for panel in panels:
            if far:
                panel.set_yscale("symlog", linthresh=bend, linscale=1.5)
                panel.set_yticks(bend * np.array([-100, -10, -1, 0, 1, 10, 100]))
                panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
                panel.set_ylim(1.2 * min(every.min(), -bend), 1.2 * max(every.max(), bend))
            elif np.isfinite(whiskers).any():
                held = whiskers[np.isfinite(whiskers)]
                panel.set_ylim(find_limits(held, every, MUCH, MARGIN))
                if (every == np.rint(every)).all():
                    panel.yaxis.set_major_locator(MaxNLocator(6, integer=True))
                note_outside(panel, every, ("top", "right"))
        panels[0].set_ylabel(f"{label}\n(log beyond ±{bend:g})" if far else label)
        for drawn in (d for of_panel in row for d in of_panel.values()):
            for box, median in zip(drawn["boxes"], drawn["medians"], strict=True):
                # Medians in the colour of boxes that are too flat to show it, as of equal delays.
                heights = box.axes.transData.transform(box.get_path().vertices)[:, 1]
                if np.ptp(heights) * 72 / self.figure_.dpi < FLAT:
                    look: dict[str, Any] = {"color": box.get_edgecolor(), "lw": scaled(2.4)}
                    median.set(solid_capstyle="butt", **look)

    def _name_places(self) -> None:
        for panel in self.axes_.flat:
            panel.set_xlim(-0.5, len(self._places) - 0.5)
            panel.set_xticks(range(len(self._places)), [f"{place:g}" for place in self._places])
            panel.tick_params(axis="x", length=0)
            for border in np.arange(len(self._places) - 1) + 0.5:
                panel.axvline(border, color=GREY, lw=scaled(0.5), alpha=0.4, zorder=0.5)
            panel.grid(axis="y", alpha=0.3)
            if self._own:
                panel.label_outer()
        for panel in self.axes_[-1]:
            panel.set_xlabel(quantity(PLACE))
        if self._own:
            self.figure_.align_ylabels(self.axes_[:, 0])

    def _quantity(self, value: str) -> str:
        if self.difference is None:
            return quantity(value)
        name, *levels = self.difference
        first, second = (SAID.get(name, {}).get(str(level), str(level)) for level in levels)
        return f"{quantity(value).replace(', %', ', points')}:\n{first} − {second}"


@dataclass(kw_only=True, eq=False, repr=False)
class StudyResponseDisplay(Display):
    """Bode plots of a study: estimates of each method, with found and stated spread (Appendix I).

    A column of panels for each method. The upper two hold magnitude and phase of the means of the
    complex estimates over the replications (Eqs. H.1-H.4), with one standard deviation over the
    replications to either side. The lower two show standard deviations on axes of their own, since
    those of ARX models are too small for bars: solid with markers over the replications; dotted the
    total one in the complex plane that the thesis draws (Eq. H.7), which holds errors along the
    circle too; and wide and pale what a single estimate states (Eqs. H.9-H.10; root mean square
    over the replications). These axes leave out what is below a hundredth of the median, as
    deviations without remnant are.

    Make it with :meth:`from_summary`.

    Parameters
    ----------
    summary : DataFrame
        One row per remnant intensity, method and line, as in :meth:`from_summary`.
    truth : callable or None, default=None
        The true response over frequencies in rad/s.

    Attributes
    ----------
    %(sizes)
    means_ : dict of Line2D
        By (``"magnitude"`` or ``"phase"``, method, remnant intensity): the main artists.

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
    >>> summary = pd.DataFrame(
    ...     {
    ...         "condition": "C1",
    ...         "remnant_intensity": 0.15,
    ...         "method": "fc",
    ...         "omega": omega,
    ...         "magnitude": np.abs(true(omega)),
    ...         "phase": np.degrees(np.angle(true(omega))),
    ...         "magnitude_sd": 0.1 * np.abs(true(omega)),
    ...         "phase_sd": 5.0,
    ...         "relative_sd": 0.14,
    ...         "stated_magnitude_sd": np.nan,
    ...         "stated_phase_sd": np.nan,
    ...     }
    ... )
    >>> display = StudyResponseDisplay.from_summary(summary, truth=true)
    >>> display.axes_.shape
    (4, 1)
    """

    summary: pd.DataFrame
    truth: Any = None

    @classmethod
    def from_summary(
        cls, summary: pd.DataFrame, *, truth: Any = None, ax: Any = None, **kwargs: Any
    ) -> Self:
        """Draw the summary of a study of frequency responses in one condition.

        Parameters
        ----------
        summary : DataFrame
            One row per ``condition``, ``remnant_intensity``, ``method`` and ``omega`` (rad/s), as
            index or columns; of the mean estimate ``magnitude`` and ``phase`` (deg), their standard
            deviations ``magnitude_sd`` and ``phase_sd`` (deg), the total ``relative_sd`` (a share
            of the magnitude), and, root mean square, what estimates state of themselves,
            ``stated_magnitude_sd`` and ``stated_phase_sd`` (deg). NaN stands for what is not known.
        truth : callable or None, default=None
            The true response: a function of frequencies in rad/s, as ``frequency_response`` of a
            :class:`skhoid.HumanOperator` is.
        """
        table = summary.reset_index()
        needed = ["condition", "remnant_intensity", "method", "omega", *PARTS, "relative_sd"]
        check_table(table, [*needed, "magnitude_sd", "phase_sd"], cls.__name__)
        if len(set(table["condition"])) > 1:
            raise ValueError(f"{cls.__name__} draws one condition; choose its rows.")
        return cls(summary=table, truth=truth).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        table = self.summary
        methods = sorted(set(table["method"]), key=[*METHODS, *table["method"]].index)
        intensities = ordered(table["remnant_intensity"])
        shape = 4, len(methods)
        self._take_axes(
            ax,
            "magnitude, phase, and their standard deviations, of each method",
            shape,
            figsize=(page_width(max(6.4, 1.4 + 3.2 * shape[1]), shape[1]), 9.6),
            sharex=True,
            sharey="row",
        )
        self.axes_ = self.axes_.reshape(shape)
        self.means_: dict[tuple[str, str, float], Any] = {}
        lines = np.sort(table["omega"].unique())
        fine = np.geomspace(lines[0] / 1.2, lines[-1] * 1.2, N_POINTS)
        true = None if self.truth is None else np.asarray(self.truth(fine), dtype=complex)
        phase = None if true is None else np.degrees(np.unwrap(np.angle(true)))
        for method, panels in zip(methods, self.axes_.T, strict=True):
            panels[0].set_title(cell_text("method", method), fontsize="medium")
            for panel in panels:
                panel.set_xscale("log")
                panel.grid(alpha=0.3)
            if true is not None:
                for panel, values in zip(panels, (np.abs(true), phase), strict=False):
                    panel.plot(fine, values, label="truth", zorder=1.8, **ROLES["truth"].style(1.4))
            for position, P_n in enumerate(intensities):
                of = table[(table["method"] == method) & (table["remnant_intensity"] == P_n)]
                of = of.sort_values("omega")
                turns = 0.0 if phase is None else of["phase"] - np.interp(of["omega"], fine, phase)
                turned = of["phase"] - 360 * np.round(turns / 360)
                self._draw(panels, of.assign(phase=turned), (method, P_n), position)
        self._limit()
        self._restyle(kwargs, self.means_)
        names = ("magnitude", "phase, deg", "sd of magnitude, %", "sd of phase, deg")
        for panel, name in zip(self.axes_[:, 0], names, strict=True):
            panel.set_ylabel(name)
        for panel in self.axes_[-1]:
            panel.set_xlabel("frequency, rad/s")
        if self._own:
            self.figure_.suptitle(str(table["condition"].iloc[0]), fontsize="medium")
            self.figure_.align_ylabels(self.axes_[:, 0])
        self._legend_of_panels()
        return self

    def _draw(self, panels: Any, rows: pd.DataFrame, key: tuple[str, float], position: int) -> None:
        """Means with bars, and their standard deviations over frequency."""
        omega, colour = rows["omega"], series_colour(position)
        beside = omega * (1.0 + STEP * position)
        mark: dict[str, Any] = {"marker": MARKERS[position % len(MARKERS)], "ms": sized(3.5)}
        text = cell_text("remnant_intensity", key[1])
        sizes = 100 / rows["magnitude"]
        kinds: tuple[tuple[str, Any, Any, dict[str, Any]], ...] = (
            ("± 1 sd over replications", rows["magnitude_sd"] * sizes, rows["phase_sd"], mark),
            ("total sd, Eq. H.7", 100 * rows["relative_sd"], None, {"ls": ":"}),
            (
                "sd stated, Eqs. H.9-H.10",
                rows.get("stated_magnitude_sd", np.nan) * sizes,
                rows.get("stated_phase_sd"),
                {"lw": scaled(4.5), "alpha": 0.4},
            ),
        )
        for name, panel in zip(PARTS, panels, strict=False):
            look: dict[str, Any] = {"color": colour, "ls": "none", "zorder": 3, **mark}
            self.means_[name, *key], _, _ = panel.errorbar(
                beside,
                rows[name],
                rows[f"{name}_sd"].fillna(0.0),
                elinewidth=scaled(2.0),
                label=f"{text}: mean",
                **look,
            )
        for label, *values, look in kinds:
            for panel, sd in zip(panels[2:], values, strict=True):
                if sd is not None and (sd > 0).any():
                    look = {"color": colour, "lw": scaled(1.2), **look}
                    panel.plot(omega, sd.where(sd > 0), label=label, **look)

    def _limit(self) -> None:
        """Bars of magnitude that come near zero are cut, and deviations that are next to none."""
        magnitude, phase, *below = self.axes_[:, 0]
        for panel in (magnitude, *below):
            panel.set_yscale("log")
        magnitude.set_ylim(
            bottom=max(LEAST * self.summary["magnitude"].min(), magnitude.get_ylim()[0])
        )
        phase_ticks(phase.yaxis)
        for panel in below:
            lines = [
                line for of in panel.get_shared_y_axes().get_siblings(panel) for line in of.lines
            ]
            known = np.concatenate([line.get_ydata() for line in lines] + [np.empty(0)])
            known = known[np.isfinite(known)]
            if known.size:
                lowest = known[known >= np.median(known) / SPAN].min()
                panel.set_ylim(lowest / 2, known.max() * 2)  # so that some ticks have names
        for panel in self.axes_[[0, 2, 3]].flat:
            plain_logarithmic(panel.yaxis, minor_ticks=False)
        for panel in self.axes_.flat:
            plain_logarithmic(panel.xaxis, minor_ticks=False)
