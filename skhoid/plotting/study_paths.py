"""A study's time-varying estimates: ensembles over time beside the truth."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ._axes import corner_note, limits_of, note_outside
from ._checks import check_some_column
from ._display import Display
from ._layout import page_width
from ._roles import GREY, ORANGE, ROLES, foreground, scaled, veil
from ._study import (
    OPERATOR,
    REPLICATION,
    cell_text,
    check_table,
    chosen,
    chosen_panels,
    ordered,
    quantity,
    refuse_mixtures,
)
from ._study_tables import averages, batch_averages

NAME = "StudyPathDisplay"
BATCH = ("ini", "fin")
BATCH_TIME = 30.72  # s; the thesis's, Section IV-D
AVERAGES = {
    "mean": ("mean over replications", "± 1 standard deviation"),
    "median": ("median over replications", "central 68 %"),
}
SHOWN = (2.0, 98.0)  # percentiles of single estimates that limits hold
OF_BATCH = (25.0, 75.0)  # and of batch fits, which are few
MUCH = 1.8  # times that range, up to which limits hold the averages too
MARGIN = 0.1


@dataclass(kw_only=True, eq=False, repr=False)
class StudyPathDisplay(Display):
    """Estimates of a study over time beside the truth (Figs. 14, 15 and Appendices K and L).

    A row of panels for each parameter and a column for each remnant intensity, of one condition and
    one form of forgetting: the mean over the replications in the colour of text with one
    standard deviation to either side, some single replications in thin grey, the truth in dashed
    green, and mean and standard deviation of the batch fits of the first and last
    part in orange, over their windows.

    Replications without a value at an instant, as operator parameters are where the poles of the
    model are no complex pair, are left out of it; a note in the panel says how many are missing.

    Panels of a parameter have the same limits. These hold the truth and the central 96 % of the
    single estimates of each panel, and the averages only if they are not far from these:
    T_L = K_edot / K_e has no bounds where K_e comes near zero, and a few estimates pull its mean
    and standard deviation anywhere. A note counts the instants at which the mean lies outside;
    ``average="median"`` draws what such estimates do not pull.

    Make it with :meth:`from_table`.

    Parameters
    ----------
    paths : DataFrame
        One row per remnant intensity and instant: ``remnant_intensity``, ``time`` (s), number of
        replications ``n``, and for each parameter its average, ``low_`` and ``high_`` edge of the
        band, and the number ``n_`` of replications that have a value (``low_a1``).
    ranges : dict of tuple (low, high)
        Limits by parameter.
    singles : DataFrame or None, default=None
        Single replications: ``remnant_intensity``, ``replication``, ``time`` and the parameters.
    batch : DataFrame or None, default=None
        Batch fits: ``remnant_intensity``, ``form``, ``start`` and ``stop`` (s), and for each
        parameter the same as in ``paths``.
    truth : DataFrame or None, default=None
        True values over the index ``time``, or in one row.
    transition_time : float or None, default=None
        Instant to mark, in s.
    average : {"mean", "median"}, default="mean"
        What the averages are.
    title : str or None, default=None
        Of the figure.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_params, n_intensities)
        The panels.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    names_ : list of str
        The parameter in each row.
    intensities_ : list of float
        The remnant intensity in each column.
    lines_ : dict of Line2D
        Averages by (parameter, remnant intensity).
    bands_ : dict of FillBetweenPolyCollection
        Their bands by the same.
    singles_ : dict of list of Line2D
        Single replications by the same.
    truth_ : dict of Line2D
        True values by the same.
    batch_ : dict of Line2D
        Batch fits by (form, parameter, remnant intensity).
    notes_ : dict of Text
        Counts of averages outside, by (parameter, remnant intensity).
    missing_ : dict of Text
        Shares of estimates without a value, by the same.

    See Also
    --------
    ParameterPathDisplay : ARX parameters of fitted models.
    OperatorParametersDisplay : Operator parameters of fitted models.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid.plotting.study_paths import StudyPathDisplay
    >>> time = np.arange(0, 80, 0.5)
    >>> true = pd.DataFrame({"b0": 0.09 + 0.07 / (1 + np.exp(20 - time / 2))}, index=time)
    >>> table = pd.MultiIndex.from_product(
    ...     [["C3"], [0.15], range(3), ["lambda"], time],
    ...     names=["condition", "remnant_intensity", "replication", "form", "time"],
    ... ).to_frame(index=False)
    >>> table["b0"] = np.tile(true["b0"], 3) + 0.01 * (table["replication"] - 1)
    >>> display = StudyPathDisplay.from_table(table, truth=true, transition_time=40)
    >>> display.paths[["time", "n", "b0", "low_b0", "high_b0"]].iloc[0].round(3).tolist()
    [0.0, 3.0, 0.09, 0.08, 0.1]
    """

    paths: pd.DataFrame
    ranges: dict[str, tuple[float, float]]
    singles: pd.DataFrame | None = None
    batch: pd.DataFrame | None = None
    truth: pd.DataFrame | None = None
    transition_time: float | None = None
    average: str = "mean"
    title: str | None = None

    @classmethod
    def from_table(
        cls,
        table: pd.DataFrame,
        *,
        condition: str | None = None,
        form: str = "lambda",
        parameters: str | Sequence[str] = "arx",
        remnant_intensity: float | Sequence[float] | None = None,
        truth: pd.DataFrame | None = None,
        transition_time: float | None = None,
        batch_time: float = BATCH_TIME,
        average: str = "mean",
        n_singles: int = 3,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the table of a study of paths.

        Parameters
        ----------
        table : DataFrame
            One row per cell, replication, form of forgetting and instant: ``condition``,
            ``remnant_intensity``, ``replication``, ``form``, ``time`` (s) and the parameters; the
            forms ``"ini"`` and ``"fin"``, if there, are batch fits of the first and last part.
        condition : str or None, default=None
            The condition to draw; None for the only one.
        form : str, default="lambda"
            The form of forgetting to draw.
        parameters : {"arx", "operator"} or list of str, default="arx"
            ARX parameters, operator parameters, or columns.
        remnant_intensity : float, list of float or None, default=None
            Which columns of panels; None for all.
        truth : DataFrame or None, default=None
            True values: columns named as the parameters over the index ``time`` in s, or in one
            row, as ``arx_parameters`` and ``parameters`` of the third result of
            :func:`skhoid.make_tracking_runs` are.
        transition_time : float or None, default=None
            Instant t_M to mark, in s.
        batch_time : float, default=30.72
            Length of the parts that batch fits are of, in s.
        average : {"mean", "median"}, default="mean"
            Mean and standard deviation over the replications, or median and central 68 %.
        n_singles : int, default=3
            How many single replications to draw.
        ax : array of Axes or None, default=None
            Where to draw, one for each parameter and intensity, row by row. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : StudyPathDisplay

        Raises
        ------
        TypeError
            If ``table`` or ``truth`` is no DataFrame.
        ValueError
            If a column is missing, cells would be mixed, a choice is not in the table, or an
            option is not known.
        """
        check_table(table, ["condition", "remnant_intensity", REPLICATION, "form", "time"], NAME)
        if average not in AVERAGES:
            raise ValueError(f"average must be 'mean' or 'median'; got {average!r}.")
        if form in BATCH:
            raise ValueError(f"form={form!r} is a batch fit; choose a form of forgetting.")
        names = _names(table, parameters)
        _check_truth(truth, names)
        table = chosen_panels(table, condition, remnant_intensity, NAME)
        rows = chosen(table, {"form": form}, NAME)
        refuse_mixtures(rows, ["remnant_intensity", "form", "time"], NAME)
        of_batch = table[table["form"].isin(BATCH)]
        time = np.unique(rows["time"].to_numpy(dtype=float))
        step = float(np.diff(time).min()) if time.size > 1 else 0.0
        windows = {
            "ini": (float(time[0]), float(time[0]) + batch_time),
            # The window ends a step after its last instant.
            "fin": (float(time[-1]) + step - batch_time, float(time[-1])),
        }
        singles = ordered(rows[REPLICATION])[:n_singles]
        columns = ["remnant_intensity", REPLICATION, "time", *names]
        paths = averages(rows, ["remnant_intensity", "time"], names, average)
        display = cls(
            paths=paths,
            ranges={name: _range(name, rows, of_batch, paths, truth) for name in names},
            singles=rows.loc[rows[REPLICATION].isin(singles), columns],
            batch=batch_averages(of_batch, names, average, windows) if len(of_batch) else None,
            truth=truth,
            transition_time=transition_time,
            average=average,
            title=f"{rows['condition'].iloc[0]}, {cell_text('form', form)}",
        )
        return display.plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        mean_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        truth_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : array of Axes or None, default=None
            Where to draw, one for each parameter and intensity, row by row. None makes a figure.
        mean_kw : dict or None, default=None
            Keywords of matplotlib for the means.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the bands.
        truth_kw : dict or None, default=None
            Keywords of matplotlib for the truth.

        Returns
        -------
        self : StudyPathDisplay
        """
        styles = {"mean": mean_kw, "band": band_kw, "truth": truth_kw}
        self.names_ = list(self.ranges)
        self.intensities_ = ordered(self.paths["remnant_intensity"])
        shape = len(self.names_), len(self.intensities_)
        width = page_width(max(6.4, 1.2 + 2.7 * shape[1]), shape[1])
        size = width, 1.4 + 1.5 * shape[0]
        shows = "one for each parameter and intensity"
        panels = self._take_axes(ax, shows, shape, figsize=size, sharex=True)
        self.axes_ = panels.reshape(shape)
        self.ax_ = panels[0]
        self.lines_: dict[tuple[str, float], Any] = {}
        self.bands_: dict[tuple[str, float], Any] = {}
        self.singles_: dict[tuple[str, float], list[Any]] = {}
        self.truth_: dict[tuple[str, float], Any] = {}
        self.batch_: dict[tuple[str, str, float], Any] = {}
        self.notes_: dict[tuple[str, float], Any] = {}
        self.missing_: dict[tuple[str, float], Any] = {}
        for column, P_n in enumerate(self.intensities_):
            frame = self.paths[self.paths["remnant_intensity"] == P_n].sort_values("time")
            for name, panel in zip(self.names_, self.axes_[:, column], strict=True):
                self._draw(panel, name, P_n, frame)
                panel.set_ylim(self.ranges[name])
                self._note(panel, name, P_n, frame)
                panel.grid(alpha=0.3)
                panel.tick_params(labelleft=not self._own or column == 0)
            number = int(frame["n"].max())
            title = f"{cell_text('remnant_intensity', P_n)}, {number} run{'s' * (number != 1)}"
            self.axes_[0, column].set_title(title, fontsize="medium")
        for name, panel in zip(self.names_, self.axes_[:, 0], strict=True):
            panel.set_ylabel(quantity(name))
        for panel in self.axes_[-1]:
            panel.set_xlabel("time, s")
        if self._own:
            if self.title:
                self.figure_.suptitle(self.title, fontsize="medium")
            self.figure_.align_ylabels(self.axes_[:, 0])
        self._restyle(styles, mean=self.lines_, band=self.bands_, truth=self.truth_)
        self._legend_of_panels()
        return self

    def _draw(self, panel: Any, name: str, P_n: float, frame: pd.DataFrame) -> None:
        key, time = (name, P_n), frame["time"].to_numpy(dtype=float)
        average, spread = AVERAGES[self.average]
        panel.set_xlim(time.min(), time.max())
        if self.transition_time is not None:
            panel.axvline(
                self.transition_time, color=GREY, ls="--", lw=scaled(1.0), label="$t_M$", zorder=1.4
            )
        self.singles_[key] = []
        if self.singles is not None:
            of_cell = self.singles[self.singles["remnant_intensity"] == P_n]
            style: dict[str, Any] = {"color": GREY, "lw": scaled(0.4), "zorder": 1.6}
            for _, single in of_cell.groupby(REPLICATION, sort=False):
                single = single.sort_values("time")
                (line,) = panel.plot(
                    single["time"], single[name], label="single replications", **style
                )
                self.singles_[key].append(line)
        low, high = (frame[f"{edge}_{name}"].to_numpy(dtype=float) for edge in ("low", "high"))
        if np.isfinite(low).any():
            self.bands_[key] = panel.fill_between(
                time, low, high, color=foreground(), alpha=0.2, lw=0, label=spread, zorder=1.8
            )
        (self.lines_[key],) = panel.plot(
            time, frame[name], color=foreground(), lw=scaled(1.1), label=average, zorder=2.5
        )
        if self.batch is not None:
            for row in self.batch[self.batch["remnant_intensity"] == P_n].to_dict("records"):
                self._draw_batch(panel, name, P_n, row)
        if self.truth is not None and name in self.truth:
            values = self.truth[name].to_numpy(dtype=float)
            at: Any = self.truth.index
            if len(values) == 1:
                at, values = [time.min(), time.max()], np.repeat(values, 2)
            (self.truth_[key],) = panel.plot(
                at, values, label="truth", zorder=2.6, **ROLES["truth"].style(1.4)
            )

    def _draw_batch(self, panel: Any, name: str, P_n: float, row: dict[Any, Any]) -> None:
        span, edges = [row["start"], row["stop"]], [row[f"low_{name}"], row[f"high_{name}"]]
        if np.isfinite(edges).all():
            panel.fill_between(span, *edges, color=ORANGE, alpha=veil(0.25), lw=0, zorder=2.2)
        (self.batch_[row["form"], name, P_n],) = panel.plot(
            span,
            [row[name]] * 2,
            color=ORANGE,
            lw=scaled(1.8),
            label="batch fits, same spread",
            zorder=2.4,
        )

    def _note(self, panel: Any, name: str, P_n: float, frame: pd.DataFrame) -> None:
        """How many averages lie outside, and how many estimates are missing."""
        averages = frame[name].to_numpy(dtype=float)
        if note := note_outside(panel, averages, ("top", "right")):
            self.notes_[name, P_n] = note
        share = 1 - frame[f"n_{name}"].sum() / frame["n"].sum()
        if share > 0:
            text = f"{100 * share:.3g} %" if share > 1e-3 else "< 0.1 %"
            corner = ("bottom", "right")
            self.missing_[name, P_n] = corner_note(panel, f"{text} without value", corner)


def _names(table: pd.DataFrame, parameters: str | Sequence[str]) -> list[str]:
    """The columns to draw."""
    if parameters == "arx":
        names = [name for name in map(str, table.columns) if re.fullmatch(r"[ab]\d+", name)]
    elif parameters == "operator":
        names = [name for name in OPERATOR if name in table]
    elif isinstance(parameters, str):
        raise ValueError(
            f"parameters must be 'arx', 'operator' or a list of columns; got {parameters!r}."
        )
    else:
        names = list(parameters)
        check_table(table, names, NAME)
    if not names:
        raise ValueError(f"{NAME}: the table has no columns of {parameters} parameters.")
    return names


def _check_truth(truth: Any, names: list[str]) -> None:
    if truth is None:
        return
    if not isinstance(truth, pd.DataFrame):
        raise TypeError(f"truth is a DataFrame over time in s; got {type(truth).__name__}.")
    check_some_column(truth, names, "truth")


def _range(
    name: str,
    rows: pd.DataFrame,
    of_batch: pd.DataFrame,
    paths: pd.DataFrame,
    truth: pd.DataFrame | None,
) -> tuple[float, float]:
    """Limits that hold the truth, all but extreme single estimates, and averages near them."""
    held: list[float] = []
    for table, percentiles in ((rows, SHOWN), (of_batch, OF_BATCH)):
        for _, cell in table.groupby("remnant_intensity", sort=False):
            values = _finite(cell[name])
            held += np.percentile(values, percentiles).tolist() if values.size else []
    if truth is not None and name in truth:
        held += _finite(truth[name]).tolist()
    if not held:
        return 0.0, 1.0
    return limits_of(held, [*held, *_finite(paths[name])], MUCH, MARGIN)


def _finite(column: pd.Series) -> np.ndarray:
    values = column.to_numpy(dtype=float)
    finite: np.ndarray = values[np.isfinite(values)]
    return finite
