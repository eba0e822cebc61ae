"""Parameters over time of many runs side by side: of people, or of the replications of a study."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..interpret.conversion import UNITS
from ._axes import (
    corner_note,
    draw_band,
    limits_of,
    note_outside,
    parameter_symbol,
    with_unit,
)
from ._display import Display, check_option, check_some_column, page_width
from ._roles import GREY, ORANGE, PALETTE, ROLES, foreground, scaled
from ._study import (
    OPERATOR,
    REPLICATION,
    cell_text,
    check_table,
    chosen,
    chosen_panels,
    ordered,
    refuse_mixtures,
)
from .parameters import MARGIN, MUCH, SHOWN, typical_range

NAME = "EnsembleDisplay"
PARAMETERS = {
    "arx": ("a1", "a2", "b0", "b1"),
    "operator": ("K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"),
}
FORMS = {
    "lambda": "λ, $N_0$ = {N0}",
    "Lambda": "Λ, $N_0$ = ∞ for $a_1$ and $a_2$, {N0} for $b_0$ and $b_1$",
}
RUN_COLOURS = [colour for colour in PALETTE if colour not in (ORANGE, GREY)]
MOST_NAMED = 7  # runs with an entry of their own in the legend
MEAN = "mean"  # the run that is the mean of the others
BATCH = ("ini", "fin")
BATCH_TIME = 30.72  # s; the thesis's, Section IV-D
OF_BATCH = (25.0, 75.0)  # percentiles of batch fits that limits hold, which are few
CENTRAL = (0.16, 0.84)
AVERAGES = {
    "mean": ("mean over replications", "± 1 standard deviation"),
    "median": ("median over replications", "central 68 %"),
}


@dataclass(kw_only=True, eq=False, repr=False)
class EnsembleDisplay(Display):
    """Parameters over time of people's runs (Figs. 16, 17), or of replications (Figs. 14, 15).

    A row of panels for each parameter and a column for each person, or for each remnant intensity
    of a study. Single runs are thin, coloured where they are people's; their mean has the colour of
    text, with a band of its spread in a study; batch fits of the first and last part are orange,
    over their windows; the truth is green and dashed, and a change is grey.

    The panels of a parameter have the same limits. These hold the truth, the batch fits and the
    single estimates but for their outer 2 % at each end, and all averages only if they are not far
    from these: T_L = K_edot / K_e has no bounds where K_e comes near zero, and a few estimates pull
    its mean and standard deviation anywhere. A note counts the values outside; another says
    how many replications have no value, as operator parameters have none where the poles of the
    model are no complex pair. ``average="median"`` draws what far estimates do not pull.

    Make it with :meth:`from_result` or :meth:`from_table`.

    Parameters
    ----------
    paths : DataFrame
        Averages: a row for each panel's column and instant, with a column named as ``by`` says,
        ``time`` (s) and the parameters; where known the edges ``low_`` and ``high_`` of the band
        (``low_a1``), the number of runs ``n``, and the number ``n_`` of those that have a value.
    ranges : dict of tuple (low, high)
        Limits by parameter, in the order of the rows.
    by : {"subject", "remnant_intensity"}, default="subject"
        What the columns of panels are.
    singles : DataFrame or None, default=None
        Single runs: the column ``by``, ``run`` or ``replication``, ``time`` and the parameters.
    batch : DataFrame or None, default=None
        Batch fits: the column ``by``, ``form``, ``start`` and ``stop`` (s), and for each parameter
        the same as in ``paths``.
    truth : DataFrame or None, default=None
        True values over the index ``time``, or in one row.
    %(transition_time)
    words : tuple of two str, default=("mean of the runs", "")
        What averages and bands are called.
    title : str, default=""
        Of the figure.

    Attributes
    ----------
    %(sizes)
    names_, columns_ : list
        The parameter in each row, and the person or remnant intensity in each column.
    lines_, bands_, truth_ : dict of Artist
        Averages, the main artists, their bands and true values by (parameter, column).
    singles_ : dict of dict of Line2D
        Single runs by the same, and by run.
    batch_ : dict of Line2D
        Batch fits by (parameter, column, form).
    notes_, missing_ : dict of Text
        Counts of values outside, and shares of estimates without a value, by (parameter, column).

    See Also
    --------
    ParametersDisplay : Parameters of fitted models.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid.plotting import EnsembleDisplay
    >>> time = np.arange(0, 80, 0.5)
    >>> true = pd.DataFrame({"b0": 0.09 + 0.07 / (1 + np.exp(20 - time / 2))}, index=time)
    >>> table = pd.MultiIndex.from_product(
    ...     [["C3"], [0.15], range(3), ["lambda"], time],
    ...     names=["condition", "remnant_intensity", "replication", "form", "time"],
    ... ).to_frame(index=False)
    >>> table["b0"] = np.tile(true["b0"], 3) + 0.01 * (table["replication"] - 1)
    >>> display = EnsembleDisplay.from_table(table, truth=true, transition_time=40)
    >>> display.paths[["time", "n", "b0", "low_b0", "high_b0"]].iloc[0].round(3).tolist()
    [0.0, 3.0, 0.09, 0.08, 0.1]
    """

    paths: pd.DataFrame
    ranges: dict[str, tuple[float, float]]
    by: str = "subject"
    singles: pd.DataFrame | None = None
    batch: pd.DataFrame | None = None
    truth: pd.DataFrame | None = None
    transition_time: float | None = None
    words: tuple[str, str] = ("mean of the runs", "")
    title: str = ""

    @classmethod
    def from_result(
        cls,
        result: Any,
        condition: Any = None,
        *,
        form: str = "lambda",
        parameters: str = "arx",
        subjects: Any = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw what :func:`skhoid.lab.experiment.analyse_experiment` found.

        Parameters
        ----------
        result : ExperimentResult
            Of the analysis.
        condition : label or None, default=None
            Condition; None is the only one.
        form : {"lambda", "Lambda"}, default="lambda"
            Forgetting.
        parameters : {"arx", "operator"}, default="arx"
            a1, a2, b0, b1, or K_e, T_L, K_edot, omega_nm, zeta_nm.
        subjects : sequence of labels or None, default=None
            None means all that have runs in this condition.
        %(keywords)

        %(display)

        Raises
        ------
        ValueError
            If there is no such condition, form, subject or set of parameters.
        """
        check_option("form", form, FORMS)
        check_option("parameters", parameters, PARAMETERS)
        conditions = list(result.conditions)
        if condition is None and len(conditions) == 1:
            condition = conditions[0]
        check_option("condition", condition, conditions)
        paths, batch = (t[t["condition"] == condition] for t in (result.paths, result.batch))
        paths, batch = paths[paths["form"] == form], batch[batch["run"] == MEAN]
        there = list(dict.fromkeys(paths["subject"]))
        wanted = there if subjects is None else np.atleast_1d(np.asarray(subjects, object)).tolist()
        if not wanted or any(subject not in there for subject in wanted):
            raise ValueError(
                f"subjects are some of {', '.join(map(str, there))}, which have runs in "
                f"{condition}; got {subjects!r}."
            )
        paths = pd.concat([paths[paths["subject"] == subject] for subject in wanted])
        batch = batch[batch["subject"].isin(wanted)]
        names = PARAMETERS[parameters]
        forgetting = FORMS[form].format(N0=f"{result.memory_horizon:g}")
        return cls(
            paths=paths[paths["run"] == MEAN],
            ranges={name: _range_of_runs(paths[name], batch[name]) for name in names},
            singles=paths[paths["run"] != MEAN],
            batch=batch,
            transition_time=result.transition_times.get(condition),
            title=forgetting if condition == "all" else f"{condition}: {forgetting}",
        ).plot(ax, **kwargs)

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
        **kwargs: Any,
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
        %(transition_time)
        batch_time : float, default=30.72
            Length of the parts that batch fits are of, in s.
        average : {"mean", "median"}, default="mean"
            Mean and standard deviation over the replications, or median and central 68 %.
        n_singles : int, default=3
            How many single replications to draw.
        %(keywords)

        %(display)

        Raises
        ------
        TypeError
            If ``table`` or ``truth`` is no DataFrame.
        ValueError
            If a column is missing, cells would be mixed, a choice is not in the table, or an
            option is not known.
        """
        keys = ["remnant_intensity", "form", "time"]
        check_table(table, ["condition", *keys, REPLICATION], NAME)
        check_option("average", average, AVERAGES)
        if form in BATCH:
            raise ValueError(f"form={form!r} is a batch fit; choose a form of forgetting.")
        names = _names(table, parameters)
        if truth is not None:
            if not isinstance(truth, pd.DataFrame):
                raise TypeError(f"truth is a DataFrame over time in s; got {type(truth).__name__}.")
            check_some_column(truth, names, "truth")
        table = chosen_panels(table, condition, remnant_intensity, NAME)
        rows = chosen(table, {"form": form}, NAME)
        refuse_mixtures(rows, keys, NAME)
        of_batch = table[table["form"].isin(BATCH)]
        paths = _averages(rows, ["remnant_intensity", "time"], names, average)
        singles = rows[rows[REPLICATION].isin(ordered(rows[REPLICATION])[:n_singles])]
        batch = None
        if len(of_batch):
            batch = _averages(of_batch, ["remnant_intensity", "form"], names, average)
            time = np.unique(rows["time"].to_numpy(dtype=float))
            step = float(np.diff(time).min()) if time.size > 1 else 0.0
            first = batch["form"] == "ini"
            # The last window ends a step after its last instant.
            batch["start"] = np.where(first, time[0], time[-1] + step - batch_time)
            batch["stop"] = np.where(first, time[0] + batch_time, time[-1])
        return cls(
            paths=paths,
            ranges={n: _range_of_study(n, rows, of_batch, paths, truth) for n in names},
            by="remnant_intensity",
            singles=singles[["remnant_intensity", REPLICATION, "time", *names]],
            batch=batch,
            truth=truth,
            transition_time=transition_time,
            words=AVERAGES[average],
            title=f"{rows['condition'].iloc[0]}, {cell_text('form', form)}",
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        self.names_ = list(self.ranges)
        self.columns_ = list(dict.fromkeys(self.paths[self.by]))
        if self.by != "subject":
            self.columns_ = ordered(self.paths[self.by])
        shape = len(self.names_), len(self.columns_)
        width = page_width(max(6.4, 1.1 + 2.8 * shape[1]), shape[1])
        self._take_axes(
            ax,
            f"{shape[0]} parameters in {shape[1]} columns, row by row",
            shape,
            figsize=(width, 1.5 + 1.55 * shape[0]),
            sharex=True,
        )
        self.axes_ = self.axes_.reshape(shape)
        self.lines_: dict[tuple[str, Any], Any] = {}
        self.bands_: dict[tuple[str, Any], Any] = {}
        self.singles_: dict[tuple[str, Any], dict[Any, Any]] = {}
        self.truth_: dict[tuple[str, Any], Any] = {}
        self.batch_: dict[tuple[str, Any, str], Any] = {}
        self.notes_: dict[tuple[str, Any], Any] = {}
        self.missing_: dict[tuple[str, Any], Any] = {}
        for panels, column in zip(self.axes_.T, self.columns_, strict=True):
            frame = self.paths[self.paths[self.by] == column].sort_values("time")
            for name, panel in zip(self.names_, panels, strict=True):
                self._draw_singles(panel, name, column)
                self._draw_average(panel, name, column, frame)
                self._draw_batch(panel, name, column)
                self._draw_known(panel, name, column, frame["time"])
                panel.set_ylim(self.ranges[name])
                self._note(panel, name, column, frame)
                panel.grid(alpha=0.3)
                panel.tick_params(labelleft=not self._own or panel is self.axes_[0, 0])
            panels[0].set_title(self._title(column, frame), fontsize="medium")
            panels[-1].set_xlabel("time, s")
        for name, panel in zip(self.names_, self.axes_[:, 0], strict=True):
            panel.set_ylabel(with_unit(parameter_symbol(name), UNITS.get(name)), fontsize="large")
            panel.tick_params(labelleft=True)
        if self._own:
            if self.title:
                self.figure_.suptitle(self.title, fontsize="medium")
            self.figure_.align_ylabels(self.axes_[:, 0])
        self._restyle(kwargs, self.lines_)
        self._legend_of_panels()
        return self

    def _title(self, column: Any, frame: pd.DataFrame) -> str:
        """Name of a column of panels; none of the only one without a name."""
        if self.by == "subject":
            return "" if self.columns_ == ["all"] else str(column)
        number = int(frame["n"].max())
        return f"{cell_text(self.by, column)}, {number} run{'s' * (number != 1)}"

    def _draw_singles(self, panel: Any, name: str, column: Any) -> None:
        lines = self.singles_.setdefault((name, column), {})
        if self.singles is None:
            return
        single = "run" if "run" in self.singles else REPLICATION
        every = list(dict.fromkeys(self.singles[single]))
        of_cell = self.singles[self.singles[self.by] == column]
        for which, table in of_cell.groupby(single, sort=False):
            look: dict[str, Any] = {"color": GREY, "lw": scaled(0.4), "zorder": 1.6}
            label = "single replications"
            if single == "run":
                colour = RUN_COLOURS[every.index(which) % len(RUN_COLOURS)]
                look |= {"color": colour, "lw": scaled(0.6), "alpha": 0.8}
                label = f"run {which}" if len(every) <= MOST_NAMED else "single runs"
            table = table.sort_values("time")
            (lines[which],) = panel.plot(table["time"], table[name], label=label, **look)

    def _draw_average(self, panel: Any, name: str, column: Any, frame: pd.DataFrame) -> None:
        time, key = frame["time"], (name, column)
        if f"low_{name}" in frame and frame[f"low_{name}"].notna().any():
            edges = frame[f"low_{name}"], frame[f"high_{name}"]
            self.bands_[key] = draw_band(
                panel, time, *edges, foreground(), self.words[1], alpha=0.2, zorder=1.8
            )
        look: dict[str, Any] = {"color": foreground(), "lw": scaled(1.4), "zorder": 2.5}
        (self.lines_[key],) = panel.plot(time, frame[name], label=self.words[0], **look)

    def _draw_batch(self, panel: Any, name: str, column: Any) -> None:
        batch = self.batch
        for row in [] if batch is None else batch[batch[self.by] == column].to_dict("records"):
            span = [row["start"], row["stop"]]
            edges = row.get(f"low_{name}", np.nan), row.get(f"high_{name}", np.nan)
            label = "batch, first and last part"
            if np.isfinite(edges).all():
                draw_band(panel, span, *edges, ORANGE, zorder=2.2)
                label = "batch fits, same spread"
            if np.isfinite(row[name]):
                look: dict[str, Any] = {"color": ORANGE, "solid_capstyle": "butt", "zorder": 2.4}
                (self.batch_[name, column, row["form"]],) = panel.plot(
                    span, [row[name]] * 2, lw=scaled(2.4), label=label, **look
                )

    def _draw_known(self, panel: Any, name: str, column: Any, time: pd.Series) -> None:
        """The truth, and the instant of a change."""
        ends = [time.min(), time.max()]
        if ends[0] < ends[1]:
            panel.set_xlim(*ends)
        if self.truth is not None and name in self.truth:
            values = self.truth[name].to_numpy(dtype=float)
            at: Any = self.truth.index
            if len(values) == 1:
                at, values = ends, np.repeat(values, 2)
            look = ROLES["truth"].style(1.4)
            (self.truth_[name, column],) = panel.plot(at, values, label="truth", zorder=2.6, **look)
        if self.transition_time is not None:
            look = {"color": GREY, "ls": "--", "lw": scaled(1.2), "zorder": 1.5}
            panel.axvline(self.transition_time, label="$t_M$, the change", **look)

    def _note(self, panel: Any, name: str, column: Any, frame: pd.DataFrame) -> None:
        """How many values lie outside, and how many estimates are missing."""
        shown = [frame[name].to_numpy(dtype=float)]
        if self.by == "subject":
            shown += [line.get_ydata() for line in self.singles_[name, column].values()]
        if note := note_outside(panel, np.concatenate(shown), ("top", "right")):
            self.notes_[name, column] = note
        if f"n_{name}" in frame:
            share = 1 - frame[f"n_{name}"].sum() / frame["n"].sum()
            text = f"{100 * share:.3g} %" if share > 1e-3 else "< 0.1 %"
            if share > 0:
                corner = ("bottom", "right")
                self.missing_[name, column] = corner_note(panel, f"{text} without value", corner)


def _names(table: pd.DataFrame, parameters: str | Sequence[str]) -> list[str]:
    """The columns of a study to draw."""
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


def _averages(rows: pd.DataFrame, keys: list[str], names: list[str], average: str) -> pd.DataFrame:
    """Average, edges of the band and number of values of each parameter."""
    groups = rows.groupby(keys, sort=False)
    parts, counts = groups[names], groups[names].count()
    if average == "mean":
        centre, deviation = parts.mean(), parts.std(ddof=1)
        low, high = centre - deviation, centre + deviation
    else:
        centre, low, high = parts.median(), *(parts.quantile(q) for q in CENTRAL)
        low, high = low.where(counts > 1), high.where(counts > 1)
    edges = [low.add_prefix("low_"), high.add_prefix("high_"), counts.add_prefix("n_")]
    table: pd.DataFrame = pd.concat([groups.size().rename("n"), centre, *edges], axis=1)
    return table.reset_index()


def _range_of_runs(estimates: pd.Series, levels: pd.Series) -> tuple[float, float]:
    """Limits that all people share; outer estimates only where they take little room."""
    values, known = _finite(estimates), _finite(levels)
    if values.size + known.size == 0:
        return 0.0, 1.0
    inner = np.append(typical_range(values) if values.size else values, known)
    return limits_of(inner, np.append(values, known), MUCH, MARGIN)


def _range_of_study(
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
