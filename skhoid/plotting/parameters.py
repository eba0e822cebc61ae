"""Parameters over time: of ARX models, or of the human operator that they stand for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..human import HumanOperator
from ..interpret.arx_channel import is_arx
from ..interpret.conversion import FROM_POLES, NAMES, UNITS, operator_parameters
from ._axes import draw_band, find_limits, note_outside, parameter_symbol, with_unit
from ._display import Display, check_option, check_some_column, fitted_end, page_width
from ._roles import BLUE, GREEN, GREY, ORANGE, PALETTE, ROLES, scaled, sized
from ._study import REPLICATION, cell_text, check_table, ordered

SHOWN = (2.0, 98.0)  # percentiles of the estimates that limits always hold
FEW = 20  # estimates, below which limits hold all
MUCH = 2.0  # times the range of these percentiles, up to which limits hold all
MARGIN = 0.12  # of the range, above and below
DEVIATION = "± 1 standard deviation"
ONE_COLUMN = 5  # panels below each other, before there are two columns
EXACT = 1e-9  # s; a delay known better is no estimate
CROWDED = 50  # letters in one row of labels
FINE = 1000  # instants at which a true operator is drawn
# Of many runs
ARX = ("a1", "a2", "b0", "b1")
FORMS = {
    "lambda": "λ, $N_0$ = {N0}",
    "Lambda": "Λ, $N_0$ = ∞ for $a_1$ and $a_2$, {N0} for $b_0$ and $b_1$",
}
MEAN = "mean"  # the run that is the mean of the others
BATCH_TIME = 30.72  # s; first and last part of a run, as in the thesis's Section IV-D
CENTRAL = (0.16, 0.84)  # as much as ± 1 standard deviation holds of a normal distribution
SINGLES = 3  # replications of a study that are drawn one by one


@dataclass(kw_only=True, eq=False, repr=False)
class ParametersDisplay(Display):
    """Parameters over time, a panel each (Figs. 14-17, 5.14 and 5.16).

    The path of each recursive model with one standard deviation to either side, where it is known:
    of ARX parameters where the model keeps its covariances (``store_covariance=True``). Of a model
    that averages estimates of single runs (``combine="average_estimates"``) these are thin lines
    under their mean. The truth is green and dashed, and references are orange. Batch models among
    the recursive ones are dashed levels; where there are only batch models, parameters of the
    operator are points side by side.

    The operator's are K_e, T_L, K_edot, omega_nm and zeta_nm. Its delay is in the title, or in a
    panel where it varies or has a standard deviation.

    Limits hold all but extreme estimates, such as the first instants from an arbitrary start, and
    T_L = K_edot / K_e where K_e comes near zero. A note in the panel counts those outside.

    Make it with :meth:`from_estimator` or :meth:`from_frame`.

    Parameters
    ----------
    frames : dict of DataFrame
        Estimates by label: a column for each parameter and, where known, one of standard
        deviations (``sd_a1``), over the index ``time`` in s, or in one row of a batch model.
        ``attrs["deviation"]`` may say of what the latter are.
    truth : DataFrame or None, default=None
        True values in the same columns, over ``time`` or in one row.
    %(references)
    %(transition_time)
    runs : dict of ndarray of shape (n_runs, n_instants, n_params), or None, default=None
        Estimates of single runs by label, for the parameters and instants of the frame.
    parameters : sequence of str or None, default=None
        Names of the parameters to draw. None draws all.

    Attributes
    ----------
    %(panels)
    names_ : list of str
        The parameter in each panel.
    lines_, bands_ : dict of Artist
        Estimates, the main artists, and standard deviations, by (label, parameter): areas, or the
        bars of points.

    See Also
    --------
    skhoid.reference_fits : Batch models of constant parts, to compare with.
    skhoid.operator_parameters : Parameters of the operator from a model.

    Examples
    --------
    >>> from skhoid import ARXRegressor, RecursiveARX, make_tracking_runs
    >>> from skhoid.plotting import ParametersDisplay
    >>> X, y, truth = make_tracking_runs(
    ...     "C4", n_runs=1, remnant_intensity=0.15, return_truth=True, random_state=0
    ... )
    >>> models = {
    ...     "$N_0$ = 256": RecursiveARX(nk=29, memory_horizon=256).fit(X, y),
    ...     "batch": ARXRegressor(nk=29).fit(X, y),
    ... }
    >>> display = ParametersDisplay.from_estimator(models, truth, transition_time=40.96)
    >>> display.names_
    ['a1', 'a2', 'b0', 'b1']
    >>> display = ParametersDisplay.from_estimator(models, truth, kind="operator")
    >>> display.names_
    ['K_e', 'T_L', 'K_edot', 'omega_nm', 'zeta_nm']
    """

    frames: Mapping[str, pd.DataFrame]
    truth: pd.DataFrame | None = None
    references: pd.DataFrame | None = None
    transition_time: float | None = None
    runs: Mapping[str, np.ndarray] | None = None
    parameters: Sequence[str] | None = None

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        truth: Any = None,
        references: pd.DataFrame | None = None,
        *,
        kind: str = "arx",
        transition_time: float | None = None,
        parameters: Sequence[str] | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw fitted models.

        Parameters
        ----------
        model : fitted RecursiveARX, pipeline or search that ends in one, or dict of them by label
            Among them there may be batch models.
        truth : Bunch, DataFrame, HumanOperator or None, default=None
            True values: the third result of :func:`skhoid.make_tracking_runs`; a frame over time,
            or of one row, with columns named as the parameters; or an operator, for its parameters.
        %(references)
        kind : {"arx", "operator"}, default="arx"
            The parameters of the models, or those of the operator that
            :func:`skhoid.operator_parameters` finds in them; with options of that, see
            :meth:`from_frame`.
        %(transition_time)
        parameters : sequence of str or None, default=None
            Names of the parameters to draw, such as ``["a1", "b0"]``. None draws all.
        """
        check_option("kind", kind, ("arx", "operator"))
        given = model if isinstance(model, Mapping) else {"estimate": model}
        known: dict[str, Any] = {"transition_time": transition_time, "parameters": parameters}
        if kind == "operator":
            frames = {str(label): operator_parameters(m) for label, m in given.items()}
            return cls.from_frame(frames, truth, references, ax=ax, **known, **kwargs)
        models = {str(label): _arx_model(m) for label, m in given.items()}
        frames = {label: _frame(m) for label, m in models.items()}
        if not _find_times(frames.values()):
            raise ValueError(
                "ParametersDisplay draws ARX parameters over time, and no model here has a path of "
                "them: fit a RecursiveARX."
            )
        runs = {
            label: np.asarray(m.coef_paths_)
            for label, m in models.items()
            if getattr(m, "coef_paths_", None) is not None
        }
        if hasattr(truth, "task") or hasattr(truth, "arx_parameters"):
            truth = _find_coefficients(truth, models)
        names = _names(frames)
        return cls(
            frames=frames,
            runs=runs,
            truth=_checked_table(truth, names, "truth"),
            references=_checked_table(references, names, "references"),
            **known,
        ).plot(ax, **kwargs)

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        truth: Any = None,
        references: pd.DataFrame | None = None,
        *,
        transition_time: float | None = None,
        parameters: Sequence[str] | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw parameters of the operator that have been computed.

        Parameters
        ----------
        frame : DataFrame, or dict of them by label
            Results of :func:`skhoid.operator_parameters`.
        truth : Bunch, DataFrame, HumanOperator or None, default=None
            True values: the third result of :func:`skhoid.make_tracking_runs`, a frame with columns
            of the same names, or an operator, whose functions of time are evaluated.
        %(references)
        %(transition_time)
        parameters : sequence of str or None, default=None
            Names of the parameters to draw. None draws all.
        """
        frames = dict(frame) if isinstance(frame, Mapping) else {"estimate": frame}
        for table in frames.values():
            check_table(table, NAMES, cls.__name__)
        truth = getattr(truth, "parameters", truth)  # the third result of make_tracking_runs
        if isinstance(truth, HumanOperator):
            truth = _over_time(truth, _find_times(frames.values()))
        return cls(
            frames=frames,
            truth=_checked_table(truth, NAMES, "truth"),
            references=_checked_table(references, NAMES, "references"),
            transition_time=transition_time,
            parameters=parameters,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        of_operator = any("K_e" in table for table in self.frames.values())
        every = list(NAMES) if of_operator else _names(self.frames)
        for name in self.parameters or ():
            check_option("a name in parameters", name, every)
        delay = self._delay() if of_operator else None
        names = [n for n in every if n != "tau_e"] + ["tau_e"] * (of_operator and delay is None)
        names = list(self.parameters or names)
        times = _find_times(self.frames.values())
        bottom = self._begin(names, of_operator, ax)
        for name, panel in zip(self.names_, self.axes_, strict=True):
            for position, (label, frame) in enumerate(self.frames.items()):
                if name in frame:
                    draw = self._draw_path if times else self._draw_point
                    draw(panel, name, position, label)
            self._draw_known(panel, name)
            self._limit(panel, name)
            panel.set_ylabel(with_unit(parameter_symbol(name), UNITS.get(name)), fontsize="large")
            panel.grid(alpha=0.3)
        if times:
            # All of it and no more, also where a path is NaN at an end.
            first, last = min(t.min() for t in times), max(t.max() for t in times)
            for panel in self.axes_ if first < last else []:
                panel.set_xlim(first, last)
            for panel in bottom:
                panel.set_xlabel("time, s")
        else:
            self._name_points()
        if delay is not None:
            self.ax_.set_title(f"{parameter_symbol('tau_e')} = {delay:.3g} s")
        self._restyle(kwargs, self.lines_)
        self._legend_of_panels()
        return self

    def _begin(self, names: list[str], of_operator: bool, ax: Any) -> np.ndarray:
        """Panels for the parameters, and nothing in them yet; return those at the bottom."""
        columns = [names]
        if len(names) > ONE_COLUMN and not of_operator:  # those of the output, and of the inputs
            n_outputs = sum(name.startswith("a") for name in names) or -(-len(names) // 2)
            columns = [names[:n_outputs], names[n_outputs:]]
        self.names_ = names
        shape = max(map(len, columns)), len(columns)
        places = [i + shape[1] * row for i, some in enumerate(columns) for row in range(len(some))]
        bottom = self._take_axes(
            ax,
            f"one for each of {', '.join(names)}",
            shape,
            used=places,
            figsize=(6.4, 0.9 + 1.4 * shape[0]),
            sharex=True,
        )
        if self._own:
            self.figure_.align_ylabels(self.axes_)
            bottom = self.axes_[np.cumsum([len(some) for some in columns]) - 1]
            for panel in bottom:
                panel.tick_params(labelbottom=True)
        self.lines_: dict[tuple[str, str], Any] = {}
        self.bands_: dict[tuple[str, str], Any] = {}
        return bottom

    def _draw_path(self, panel: Any, name: str, position: int, label: str) -> None:
        """A line and its band; a batch model is level over all of the time that others span."""
        taken = {GREEN} if self.references is None else {GREEN, ORANGE}
        colours = [colour for colour in PALETTE if colour not in taken]
        table, colour = self.frames[label], colours[position % len(colours)]
        time, value, deviation = table.index, table[name].to_numpy(), _find_deviation(table, name)
        dashes, width = "-", 1.0
        if not _is_over_time(table):
            times = _find_times(self.frames.values())
            time = pd.Index([min(t.min() for t in times), max(t.max() for t in times)])
            value, deviation, dashes = np.repeat(value, 2), np.repeat(deviation, 2), "--"
        if self.runs and label in self.runs:
            values = self.runs[label][:, :, _names({label: table}).index(name)]
            look: dict[str, Any] = {"lw": scaled(0.5), "alpha": 0.5, "zorder": 1.8}
            lines = panel.plot(table.index, values.T, color=colour, **look)
            lines[0].set_label("single runs")
            width = 1.8
        (self.lines_[label, name],) = panel.plot(
            time, value, color=colour, label=label, ls=dashes, lw=scaled(width)
        )
        if np.isfinite(deviation).any():
            meaning = table.attrs.get("deviation", DEVIATION)
            edges = value - deviation, value + deviation
            self.bands_[label, name] = draw_band(panel, time, *edges, colour, meaning)

    def _draw_point(self, panel: Any, name: str, position: int, label: str) -> None:
        table = self.frames[label]
        value, deviation = table[name].iloc[0], np.nan_to_num(_find_deviation(table, name))
        point, _, bars = panel.errorbar(
            [position],
            [value],
            deviation[:1],
            color=BLUE,
            marker="o",
            ms=sized(5),
            ls="none",
            capsize=4,
            label=f"estimate {DEVIATION}" if position == 0 else None,
        )
        self.lines_[label, name], self.bands_[label, name] = point, bars[0]
        if np.isnan(value):
            middle: dict[str, Any] = {"transform": panel.get_xaxis_transform(), "ha": "center"}
            panel.text(position, 0.5, "none", color=GREY, va="center", **middle)

    def _name_points(self) -> None:
        crowded = sum(map(len, self.frames)) > CROWDED
        slant: dict[str, Any] = {"rotation": 20, "ha": "right"} if crowded else {}
        for panel in self.axes_:
            panel.set_xticks(range(len(self.frames)), list(self.frames), **slant)
            panel.set_xlim(-0.5, len(self.frames) - 0.5)

    def _delay(self) -> float | None:
        """The delay that all estimates share and take as exact, in s."""
        tables = [table for table in self.frames.values() if "tau_e" in table]
        delays = np.concatenate([*(table["tau_e"] for table in tables), np.empty(0)])
        delays = delays[np.isfinite(delays)]
        uncertain = any((_find_deviation(table, "tau_e") > EXACT).any() for table in tables)
        if uncertain or delays.size == 0 or np.ptp(delays) > EXACT:
            return None
        return float(delays[0])

    def _draw_known(self, panel: Any, name: str) -> None:
        """Truth, references, and the transition in grey."""
        if self.references is not None and name in self.references:
            self._draw_references(panel, name, self.references)
        if self.truth is not None and name in self.truth:
            values = self.truth[name].to_numpy(dtype=float)
            style = {**ROLES["truth"].style(1.4), "label": "truth", "zorder": 2.6}
            if len(values) > 1:
                panel.plot(self.truth.index, values, **style)
            else:
                panel.axhline(values[0], **style)
        if self.transition_time is not None:
            look: dict[str, Any] = {"color": GREY, "lw": scaled(1.2), "ls": ":", "zorder": 1.5}
            panel.axvline(self.transition_time, label="transition", **look)

    def _draw_references(self, panel: Any, name: str, references: pd.DataFrame) -> None:
        deviations = _find_deviation(references, name)
        label = f"batch {DEVIATION}" if np.isfinite(deviations).any() else "batch"
        look: dict[str, Any] = {"lw": scaled(2.0), "solid_capstyle": "butt", "zorder": 2.3}
        for row, deviation in zip(references.to_dict("records"), deviations, strict=True):
            span, level = [row["start"], row["stop"]], float(row[name])
            if np.isfinite(deviation):
                draw_band(panel, span, level - deviation, level + deviation, ORANGE, zorder=2.2)
            if np.isfinite(level):
                panel.plot(span, [level] * 2, color=ORANGE, label=label, **look)

    def _limit(self, panel: Any, name: str) -> None:
        """Limits that hold what is known and all but extreme estimates, also of single runs."""
        known = [
            table[name]
            for table in (self.truth, self.references)
            if table is not None and name in table
        ]
        held = _finite(np.concatenate([*known, np.empty(0)])).tolist()
        outer = list(held)
        paths = [line.get_ydata() for (_, of), line in self.lines_.items() if of == name]
        for label, runs in (self.runs or {}).items():
            paths.append(runs[:, :, _names({label: self.frames[label]}).index(name)])
        spread = [_finite(_find_deviation(table, name)) for table in self.frames.values()]
        margins = [float(np.median(s)) for s in spread if s.size]
        margin = max(margins, default=0.0)
        for values in map(_finite, paths):
            if values.size:
                low, high = _typical_range(values)
                held += [low - margin, high + margin]
                outer += [values.min() - margin, values.max() + margin]
        if held:
            low, high = find_limits(held, outer, MUCH, MARGIN, least=0.0)
            if low < high:
                panel.set_ylim(low, high)
                lines = [line for (_, of), line in self.lines_.items() if of == name]
                shown = np.concatenate([line.get_ydata() for line in lines]).astype(float)
                note_outside(panel, shown, ("top", "right"))


@dataclass(kw_only=True, eq=False, repr=False)
class EnsembleDisplay(Display):
    """Parameters over time of people's runs (Figs. 16, 17), or of replications (Figs. 14, 15).

    A row of panels for each parameter and a column for each person, or for each remnant intensity
    of a study. Single runs are thin; over them lies their mean, with a band of its spread in a
    study (of parameters of the operator the median and the central 68 %, because a mean of
    T_L = K_edot / K_e may be anywhere). Batch fits of the first and last part are orange, the truth
    is green and dashed. The panels of a parameter have the same limits.

    Make it with :meth:`from_result` or :meth:`from_table`.

    Parameters
    ----------
    columns : dict of ParametersDisplay
        What each column of panels shows, by its title; all have the same ``parameters``.
    title : str, default=""
        Of the figure.

    Attributes
    ----------
    %(sizes)

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
    >>> display.axes_.shape
    (1, 1)
    """

    columns: Mapping[str, ParametersDisplay]
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
        """
        check_option("form", form, FORMS)
        conditions = list(result.conditions)
        if condition is None and len(conditions) == 1:
            condition = conditions[0]
        check_option("condition", condition, conditions)
        paths, batch = (t[t["condition"] == condition] for t in (result.paths, result.batch))
        paths = paths[paths["form"] == form]
        there = list(dict.fromkeys(paths["subject"]))
        wanted = there if subjects is None else np.atleast_1d(np.asarray(subjects, object)).tolist()
        for subject in wanted:
            check_option("a subject", subject, there)
        columns = {}
        for subject in wanted:
            of = paths[paths["subject"] == subject]
            levels = batch[(batch["subject"] == subject) & (batch["run"] == MEAN)]
            columns["" if there == ["all"] else str(subject)] = _column(
                "mean of the runs",
                of[of["run"] == MEAN].set_index("time"),
                [rows for _, rows in of[of["run"] != MEAN].groupby("run", sort=False)],
                parameters,
                references=levels,
                transition_time=result.transition_times.get(condition),
            )
        title = FORMS[form].format(N0=f"{result.memory_horizon:g}")
        return cls(
            columns=columns, title=title if condition == "all" else f"{condition}: {title}"
        ).plot(ax, **kwargs)

    @classmethod
    def from_table(
        cls,
        table: pd.DataFrame,
        *,
        form: str = "lambda",
        parameters: str = "arx",
        truth: pd.DataFrame | None = None,
        transition_time: float | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the table of a study of paths in one condition.

        Parameters
        ----------
        table : DataFrame
            One row per remnant intensity, replication, form of forgetting and instant:
            ``condition``, ``remnant_intensity``, ``replication``, ``form``, ``time`` (s) and the
            parameters; the forms ``"ini"`` and ``"fin"``, if there, are batch fits of the first and
            last 30.72 s.
        form : str, default="lambda"
            The form of forgetting to draw.
        parameters : {"arx", "operator"}, default="arx"
            a1, a2, b0, b1, or K_e, T_L, K_edot, omega_nm, zeta_nm.
        truth : DataFrame or None, default=None
            True values: columns named as the parameters over the index ``time`` in s, or in one
            row, as ``arx_parameters`` and ``parameters`` of the third result of
            :func:`skhoid.make_tracking_runs` are.
        %(transition_time)
        """
        needed = ["condition", "remnant_intensity", REPLICATION, "form", "time"]
        check_table(table, needed, cls.__name__)
        check_option("form", form, list(dict.fromkeys(table["form"])))
        if len(set(table["condition"])) > 1:
            raise ValueError("EnsembleDisplay draws one condition; choose its rows of the table.")
        median = parameters == "operator"
        columns = {}
        for P_n in ordered(table["remnant_intensity"]):
            cell = table[table["remnant_intensity"] == P_n]
            rows = cell[cell["form"] == form]
            time = np.unique(rows["time"].to_numpy(dtype=float))
            batch = _average(cell[cell["form"].isin(["ini", "fin"])], "form", median).reset_index()
            first = batch["form"] == "ini"
            batch["start"] = np.where(first, time[0], time[-1] - BATCH_TIME)
            batch["stop"] = np.where(first, time[0] + BATCH_TIME, time[-1])
            singles = [part for _, part in rows.groupby(REPLICATION)][:SINGLES]
            number = rows[REPLICATION].nunique()
            title = f"{cell_text('remnant_intensity', P_n)}, {number} run{'s' * (number != 1)}"
            columns[title] = _column(
                f"{'median' if median else 'mean'} over replications",
                _average(rows, "time", median),
                singles,
                parameters,
                references=batch if len(batch) else None,
                truth=truth,
                transition_time=transition_time,
            )
        title = f"{table['condition'].iloc[0]}, {cell_text('form', form)}"
        return cls(columns=columns, title=title).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        columns = list(self.columns.values())
        names = list(columns[0].parameters or ())
        shape = len(names), len(columns)
        self._take_axes(
            ax,
            f"{shape[0]} parameters in {shape[1]} columns, row by row",
            shape,
            figsize=(page_width(max(6.4, 1.1 + 2.8 * shape[1]), shape[1]), 1.5 + 1.55 * shape[0]),
            sharex=True,
        )
        self.axes_ = self.axes_.reshape(shape)
        for (title, column), panels in zip(self.columns.items(), self.axes_.T, strict=True):
            column.plot(panels, **kwargs)
            if legend := panels[0].get_legend():
                legend.remove()
            panels[0].set_title(title, fontsize="medium")
            for panel in panels[:-1]:
                panel.set_xlabel("")
        for name, row in zip(names, self.axes_, strict=True):
            limits = np.array([panel.get_ylim() for panel in row])
            for column, panel in zip(columns, row, strict=True):
                panel.set_ylim(limits[:, 0].min(), limits[:, 1].max())
                for text in list(panel.texts):
                    text.remove()
                lines = [line for (_, of), line in column.lines_.items() if of == name]
                note_outside(
                    panel, np.concatenate([x.get_ydata() for x in lines]), ("top", "right")
                )
            for panel in row[1:]:
                panel.set_ylabel("")
                panel.tick_params(labelleft=not self._own)
        if self._own:
            self.figure_.suptitle(self.title, fontsize="medium")
            self.figure_.align_ylabels(self.axes_[:, 0])
        self._legend_of_panels()
        return self


def _column(
    label: str,
    average: pd.DataFrame,
    singles: list[pd.DataFrame],
    parameters: str,
    **known: Any,
) -> ParametersDisplay:
    """The average of runs, and some of them under it."""
    check_option("parameters", parameters, ("arx", "operator"))
    wanted = ARX if parameters == "arx" else tuple(FROM_POLES)
    names = [name for name in wanted if name in average]
    if not names:
        raise ValueError(f"The table has no columns of {parameters} parameters.")
    deviations = [f"sd_{name}" for name in names if f"sd_{name}" in average]
    frame = average[[*names, *deviations]].sort_index()
    frame.attrs["deviation"] = average.attrs.get("deviation", DEVIATION)
    paths = [one.set_index("time")[names].reindex(frame.index).to_numpy() for one in singles]
    runs = {label: np.array(paths)} if paths else None
    return ParametersDisplay(frames={label: frame}, runs=runs, parameters=names, **known)


def _average(rows: pd.DataFrame, by: str, median: bool) -> pd.DataFrame:
    """Mean and standard deviation over replications, or median and half of the central 68 %."""
    names = [name for name in map(str, rows.columns) if name in (*ARX, *FROM_POLES)]
    groups = rows.groupby(by)[names]
    centre, spread = groups.mean(), groups.std()
    if median:
        centre, low, high = groups.median(), *(groups.quantile(q) for q in CENTRAL)
        spread = (high - low) / 2
    table: pd.DataFrame = centre.join(spread.add_prefix("sd_"))
    table.attrs["deviation"] = "half of the central 68 %" if median else DEVIATION
    return table


def _is_over_time(table: pd.DataFrame) -> bool:
    return bool(table.index.name == "time")


def _find_times(tables: Iterable[pd.DataFrame]) -> list[np.ndarray]:
    """The instants of those that vary in time."""
    return [table.index.to_numpy(dtype=float) for table in tables if _is_over_time(table)]


def _find_deviation(table: pd.DataFrame, name: str) -> np.ndarray:
    if f"sd_{name}" not in table:
        return np.full(len(table), np.nan)
    return table[f"sd_{name}"].to_numpy(dtype=float)


def _finite(values: Any) -> np.ndarray:
    values = np.ravel(np.asarray(values, dtype=float))
    finite: np.ndarray = values[np.isfinite(values)]
    return finite


def _typical_range(values: np.ndarray) -> tuple[float, float]:
    """Percentiles that are values themselves: between two, an outlier would pull them."""
    if values.size < FEW:
        return float(values.min()), float(values.max())
    low = np.percentile(values, SHOWN[0], method="higher")
    return float(low), float(np.percentile(values, SHOWN[1], method="lower"))


def _checked_table(table: Any, names: Sequence[str], what: str) -> pd.DataFrame | None:
    """The columns of these names; one row of true values that do not vary."""
    if table is None:
        return None
    if not isinstance(table, pd.DataFrame):
        raise TypeError(f"{what} is a DataFrame with columns named as the parameters; got {table}.")
    check_some_column(table, names, what)
    if what == "truth":
        table = table[[name for name in names if name in table]].astype(float)
        return table[:1] if (table == table.iloc[0]).all(axis=None) else table
    return table


def _arx_model(estimator: Any) -> Any:
    """The fitted ARX model at the end of searches and pipelines."""
    model = fitted_end(estimator)
    if not is_arx(model):
        raise TypeError(
            "ParametersDisplay draws fitted ARX models, or pipelines and searches that end in "
            f"one; got {type(model).__name__}."
        )
    if not hasattr(model, "coef_path_") and hasattr(model, "partial_fit"):
        raise ValueError(
            f"This {type(model).__name__} has the current parameters only, since partial_fit keeps "
            "no path. Fit it with fit(X, y), or collect coef_ between blocks."
        )
    return model


def _frame(model: Any) -> pd.DataFrame:
    """Estimates and their standard deviations."""
    names = list(model.parameter_names_)
    if not hasattr(model, "coef_path_"):
        values, covariance = model.coef_[None], getattr(model, "covariance_", None)
        index = pd.Index([0])
    else:
        values, covariance = model.coef_path_, getattr(model, "covariance_path_", None)
        index = pd.Index(np.asarray(model.time_path_, dtype=float), name="time")
    frame = pd.DataFrame(np.asarray(values), index=index, columns=names)
    if covariance is not None:
        variances = np.diagonal(covariance, axis1=-2, axis2=-1)[..., : len(names)]
        frame[[f"sd_{name}" for name in names]] = np.sqrt(np.maximum(np.atleast_2d(variances), 0.0))
    return frame


def _names(frames: Mapping[str, pd.DataFrame]) -> list[str]:
    """Parameters of all frames, in order."""
    columns = [str(name) for frame in frames.values() for name in frame]
    names = dict.fromkeys(name for name in columns if not name.startswith("sd_"))
    kinds = {"a": 0, "b": 1}
    return sorted(names, key=lambda name: kinds.get(name[0], 2))


def _find_coefficients(truth: Any, models: dict[str, Any]) -> pd.DataFrame:
    """True ARX parameters of make_tracking_runs, which hold at the rate of the simulation."""
    if not hasattr(truth, "arx_parameters"):
        raise ValueError(
            "This simulation has no true ARX parameters: those of an operator in a pursuit display "
            "or of a fitted model are not two poles and two input coefficients."
        )
    dt = 1 / truth.task.sampling_rate
    for label, model in models.items():
        if abs(model.dt_ - dt) > 1e-6 * dt:
            raise ValueError(
                f"The true ARX parameters hold at steps of {dt:g} s, and the model {label!r} has "
                f"steps of {model.dt_:g} s. Give those of the operator at these steps: "
                "truth=skhoid.zoh_parameters(operator, dt, time)."
            )
    table: pd.DataFrame = truth.arx_parameters
    return table


def _over_time(operator: HumanOperator, times: list[np.ndarray]) -> pd.DataFrame:
    """True values over the times of the estimates, or in one row where they do not vary."""
    if not times and any(callable(getattr(operator, name)) for name in NAMES):
        raise ValueError(
            "The truth varies in time and no estimate does, so its values have no place here. Give "
            "it at one instant: truth=operator.at(t)."
        )
    instants = np.concatenate(times or [np.zeros(1)])
    fine = np.union1d(instants, np.linspace(instants.min(), instants.max(), FINE))
    return pd.DataFrame(operator.over_time(fine), index=pd.Index(fine, name="time"))
