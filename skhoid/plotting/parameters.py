"""Parameters over time: of ARX models, or of the human operator that they stand for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..human import HumanOperator
from ..interpret.arx_channel import is_arx
from ..interpret.conversion import NAMES, UNITS, operator_parameters
from ._axes import draw_band, limits_of, note_outside, parameter_symbol, with_unit
from ._display import Display, check_option, check_some_column, fitted_end
from ._roles import BLUE, GREEN, GREY, ORANGE, PALETTE, ROLES, scaled, sized

SHOWN = (2.0, 98.0)  # percentiles of the estimates that limits always hold
FEW = 20  # estimates, below which limits hold all
MUCH = 2.0  # times the range of these percentiles, up to which limits hold all
MARGIN = 0.12  # of the range, above and below
DEVIATION = "± 1 standard deviation"
MOST_LINES = 10  # single runs that are drawn one by one
MEAN = 1.8  # width of the line of a mean over single runs
ONE_COLUMN = 5  # panels below each other, before there are two columns
UNEVEN = 3  # panels that one of the columns may have more than the other
EXACT = 1e-9  # s; a delay known better is no estimate
CROWDED = 50  # letters in one row of labels
FINE = 1000  # instants at which a true operator is drawn


@dataclass(kw_only=True, eq=False, repr=False)
class ParametersDisplay(Display):
    """Parameters over time, a panel each (Figs. 14-17, 5.14 and 5.16).

    The path of each recursive model with one standard deviation to either side, where it is known:
    of ARX parameters where the model keeps its covariances (``store_covariance=True``). Of a model
    that averages estimates of single runs (``combine="average_estimates"``) these are thin lines
    under their mean; of more than ten runs the band is their standard deviation. The truth is green
    and dashed, and references are orange. Batch models among the recursive ones are dashed levels;
    where there are only batch models, parameters of the operator are points side by side.

    The operator's are K_e, T_L, K_edot, omega_nm and zeta_nm. Its delay is in the title, or in a
    panel where it varies or has a standard deviation.

    Limits hold the true values, the references and all estimates, unless those take twice the range
    of their central 96 %, as the first instants from an arbitrary start do, and as T_L = K_edot /
    K_e does where K_e comes near zero. A note in the panel counts the estimates outside.

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
    run_lines_ : dict of list of Line2D
        Estimates of single runs by the same.
    truth_ : dict of Line2D
        True values by parameter.
    references_ : dict of Line2D
        References by (window, parameter).
    notes_ : dict of Text
        Counts of estimates outside the panel, by parameter.

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
        truth : Bunch, DataFrame, Series, dict, array, HumanOperator or None, default=None
            True values: the third result of :func:`skhoid.make_tracking_runs`; a frame over time
            with columns named as the parameters; constants, named or in the order of the
            parameters (an array has one row per instant, or is one row); or an operator, for its
            parameters.
        %(references)
        kind : {"arx", "operator"}, default="arx"
            The parameters of the models, or those of the operator that
            :func:`skhoid.operator_parameters` finds in them; with options of that, see
            :meth:`from_frame`.
        %(transition_time)
        parameters : sequence of str or None, default=None
            Names of the parameters to draw, such as ``["a1", "b0"]``. None draws all.
        %(keywords)

        %(display)

        Raises
        ------
        TypeError
            If it is not an ARX model, or truth or references are something else.
        ValueError
            If no model keeps a path, or truth or references do not fit the parameters.
        """
        check_option("kind", kind, ("arx", "operator"))
        given = model if isinstance(model, Mapping) else {"estimate": model}
        known: dict[str, Any] = {"transition_time": transition_time, "parameters": parameters}
        if kind == "operator":
            frames = {str(label): operator_parameters(m) for label, m in given.items()}
            return cls.from_frame(frames, truth, references, ax=ax, **known, **kwargs)
        models = {str(label): _arx_model(m) for label, m in given.items()}
        frames = {label: _frame(m) for label, m in models.items()}
        if not _times_of(frames.values()):
            raise ValueError(
                "ParametersDisplay draws ARX parameters over time, and no model here has a path of "
                "them: fit a RecursiveARX."
            )
        runs = {
            label: np.asarray(m.coef_paths_)
            for label, m in models.items()
            if getattr(m, "coef_paths_", None) is not None
        }
        for label in [label for label, paths in runs.items() if len(paths) > MOST_LINES]:
            frames[label] = _over_runs(frames[label], runs.pop(label))
        names = _names(frames)
        _check_references(references, names, varying=True)
        true = _true_coefficients(truth, names, frames, models)
        return cls(frames=frames, runs=runs, truth=true, references=references, **known).plot(
            ax, **kwargs
        )

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
        truth : HumanOperator, DataFrame, Series or None, default=None
            True values: an operator, whose functions of time are evaluated, or a frame with
            columns of the same names, such as the ``truth.parameters`` of make_tracking_runs, or a
            row of one.
        %(references)
        %(transition_time)
        parameters : sequence of str or None, default=None
            Names of the parameters to draw. None draws all.
        %(keywords)

        %(display)

        Raises
        ------
        TypeError
            If a frame or the truth is something else.
        ValueError
            If columns are missing, or truth or references need times and no estimate varies.
        """
        frames = dict(frame) if isinstance(frame, Mapping) else {"estimate": frame}
        for label, table in frames.items():
            if not isinstance(table, pd.DataFrame):
                raise TypeError(
                    "ParametersDisplay.from_frame draws results of operator_parameters; "
                    f"{label!r} is a {type(table).__name__}."
                )
            missing = [name for name in NAMES if name not in table]
            if missing:
                raise ValueError(f"The frame {label!r} has no column {missing[0]!r}.")
        _check_references(references, NAMES, varying=bool(_times_of(frames.values())))
        return cls(
            frames=frames,
            truth=_true_operator(truth, frames),
            references=references,
            transition_time=transition_time,
            parameters=parameters,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        of_operator = any("K_e" in table for table in self.frames.values())
        every = list(NAMES) if of_operator else _names(self.frames)
        delay = self._delay() if of_operator else None
        for name in self.parameters or ():
            check_option("a name in parameters", name, every)
        names = [name for name in every if name != "tau_e"]
        names += ["tau_e"] * (of_operator and delay is None)
        if self.parameters is not None:
            names = list(self.parameters)
        over_time = bool(_times_of(self.frames.values()))
        bottom = self._begin([names] if of_operator else _columns(names), ax)
        for name, panel in zip(self.names_, self.axes_, strict=True):
            for position, (label, frame) in enumerate(self.frames.items()):
                if name not in frame:
                    continue
                if over_time:
                    self._draw_over_time(panel, name, position, label)
                else:
                    self._draw_point(panel, name, position, label)
            self._draw_known(panel, name)
            self._limit(panel, name)
            panel.set_ylabel(with_unit(parameter_symbol(name), UNITS.get(name)), fontsize="large")
            panel.grid(alpha=0.3)
        for panel in bottom if over_time else ():
            panel.set_xlabel("time, s")
        if not over_time:
            self._name_points()
        if delay is not None:
            self.ax_.set_title(f"{parameter_symbol('tau_e')} = {delay:.3g} s")
        self._restyle(kwargs, self.lines_)
        self._legend_of_panels()
        return self

    def _begin(self, columns: list[list[str]], ax: Any) -> np.ndarray:
        """Panels for the parameters, and nothing in them yet; return those at the bottom."""
        self.names_ = [name for column in columns for name in column]
        shape = max(map(len, columns)), len(columns)
        bottom = self._take_axes(
            ax,
            f"one for each of {', '.join(self.names_)}",
            shape,
            used=[
                i + shape[1] * row for i, names in enumerate(columns) for row in range(len(names))
            ],
            figsize=(6.4, 0.9 + 1.4 * shape[0]),
            sharex=True,
        )
        if self._own:
            self.figure_.align_ylabels(self.axes_)
            bottom = self.axes_[np.cumsum([len(names) for names in columns]) - 1]
            for panel in bottom:
                panel.tick_params(labelbottom=True)
        self.lines_: dict[tuple[str, str], Any] = {}
        self.bands_: dict[tuple[str, str], Any] = {}
        self.run_lines_: dict[tuple[str, str], Any] = {}
        self.truth_: dict[str, Any] = {}
        self.references_: dict[tuple[str, str], Any] = {}
        self.notes_: dict[str, Any] = {}
        if times := _times_of(self.frames.values()):
            # All of it and no more, also where a path is NaN at an end.
            first, last = min(t.min() for t in times), max(t.max() for t in times)
            for panel in self.axes_ if first < last else []:
                panel.set_xlim(first, last)
        return bottom

    def _colour(self, position: int) -> str:
        """Colour of an estimate: not those of the truth and, where there are any, of references."""
        taken = {GREEN} if self.references is None else {GREEN, ORANGE}
        available = [c for c in PALETTE if c not in taken]
        return available[position % len(available)]

    def _draw_over_time(self, panel: Any, name: str, position: int, label: str) -> None:
        """A line and its band; a batch model is level over all of the time that others span."""
        table, colour = self.frames[label], self._colour(position)
        time, value, deviation = table.index, table[name].to_numpy(), _deviation_of(table, name)
        dashes = "-"
        if not _is_over_time(table):
            times = _times_of(self.frames.values())
            time = pd.Index([min(t.min() for t in times), max(t.max() for t in times)])
            value, deviation, dashes = np.repeat(value, 2), np.repeat(deviation, 2), "--"
        (self.lines_[label, name],) = panel.plot(
            time, value, color=colour, label=label, ls=dashes, lw=scaled(1.0)
        )
        if np.isfinite(deviation).any():
            meaning = table.attrs.get("deviation", DEVIATION)
            edges = value - deviation, value + deviation
            self.bands_[label, name] = draw_band(panel, time, *edges, colour, meaning)
        if self.runs and label in self.runs:
            # Single runs as thin lines under their mean.
            values = self.runs[label][:, :, _names({label: table}).index(name)]
            look: dict[str, Any] = {"lw": scaled(0.5), "alpha": 0.5, "zorder": 1.8}
            lines = panel.plot(table.index, values.T, color=colour, **look)
            lines[0].set_label("single runs")
            self.lines_[label, name].set_linewidth(MEAN)
            self.run_lines_[label, name] = lines

    def _draw_point(self, panel: Any, name: str, position: int, label: str) -> None:
        table = self.frames[label]
        value, deviation = table[name].iloc[0], np.nan_to_num(_deviation_of(table, name))
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
            middle = panel.get_xaxis_transform()
            panel.text(
                position, 0.5, "none", transform=middle, color=GREY, ha="center", va="center"
            )

    def _name_points(self) -> None:
        crowded = sum(map(len, self.frames)) > CROWDED
        slant: dict[str, Any] = {"rotation": 20, "ha": "right"} if crowded else {}
        for panel in self.axes_:
            panel.set_xticks(range(len(self.frames)), list(self.frames), **slant)
            panel.set_xlim(-0.5, len(self.frames) - 0.5)

    def _delay(self) -> float | None:
        """The delay that all estimates share and take as exact, in s."""
        tables = self.frames.values()
        delays = np.concatenate([table["tau_e"] for table in tables])
        delays = delays[np.isfinite(delays)]
        uncertain = any((_deviation_of(table, "tau_e") > EXACT).any() for table in tables)
        if uncertain or delays.size == 0 or np.ptp(delays) > EXACT:
            return None
        return float(delays[0])

    def _draw_known(self, panel: Any, name: str) -> None:
        """Truth, references, and the transition in grey."""
        if self.references is not None and name in self.references:
            self._draw_references(panel, name, self.references)
        if self.truth is not None and name in self.truth:
            values = self.truth[name].to_numpy(dtype=float)
            style = {**ROLES["truth"].style(1.4), "label": "truth", "zorder": 2.4}
            if _is_over_time(self.truth):
                (self.truth_[name],) = panel.plot(self.truth.index, values, **style)
            else:
                self.truth_[name] = panel.axhline(values[0], **style)
        if self.transition_time is not None:
            look: dict[str, Any] = {"color": GREY, "lw": scaled(1.2), "ls": ":", "zorder": 1.5}
            panel.axvline(self.transition_time, label="transition", **look)

    def _draw_references(self, panel: Any, name: str, references: pd.DataFrame) -> None:
        deviations = _deviation_of(references, name)
        label = f"batch {DEVIATION}" if np.isfinite(deviations).any() else "batch"
        look: dict[str, Any] = {"lw": scaled(2.0), "solid_capstyle": "butt", "zorder": 2.3}
        for (window, row), deviation in zip(references.iterrows(), deviations, strict=True):
            span, level = [row["start"], row["stop"]], float(row[name])
            if np.isnan(level):
                continue
            if np.isfinite(deviation):
                draw_band(panel, span, level - deviation, level + deviation, ORANGE, zorder=2.2)
            (self.references_[str(window), name],) = panel.plot(
                span, [level] * 2, color=ORANGE, label=label, **look
            )

    def _limit(self, panel: Any, name: str) -> None:
        """Limits that hold what is known and all but extreme estimates, also of single runs."""
        inner: list[float] = []
        if name in self.truth_ and self.truth is not None:
            inner += self.truth[name].tolist()
        for (_, of), line in self.references_.items():
            inner += [line.get_ydata()[0]] if of == name else []
        inner = [value for value in inner if np.isfinite(value)]
        outer = list(inner)
        tables = [table for table in self.frames.values() if name in table]
        estimates = [table[name].to_numpy(dtype=float) for table in tables]
        deviations = [_deviation_of(table, name) for table in tables]
        lines = [line for (_, of), some in self.run_lines_.items() if of == name for line in some]
        of_runs = [np.asarray(line.get_ydata(), dtype=float) for line in lines]
        every = np.concatenate([*of_runs, np.empty(0)])
        for value, deviation in zip([*estimates, every], [*deviations, np.zeros(1)], strict=True):
            finite, deviation = value[np.isfinite(value)], deviation[np.isfinite(deviation)]
            if finite.size == 0:
                continue
            typical = float(np.median(deviation)) if deviation.size else 0.0
            low, high = typical_range(finite)
            inner += [low - typical, high + typical]
            outer += [finite.min() - typical, finite.max() + typical]
        if not inner:
            return
        low, high = limits_of(inner, outer, MUCH, MARGIN, least=0.0)
        if low < high:
            panel.set_ylim(low, high)
            varying = [_is_over_time(table) for table in tables]
            counted = zip(estimates, varying, strict=True)  # of single runs nothing
            shown = np.concatenate([e for e, over_time in counted if over_time or not any(varying)])
            if note := note_outside(panel, shown, ("top", "right")):
                self.notes_[name] = note


def _is_over_time(table: pd.DataFrame) -> bool:
    return bool(table.index.name == "time")


def _times_of(tables: Iterable[pd.DataFrame]) -> list[np.ndarray]:
    """The instants of those that vary in time."""
    return [table.index.to_numpy(dtype=float) for table in tables if _is_over_time(table)]


def _deviation_of(table: pd.DataFrame, name: str) -> np.ndarray:
    if f"sd_{name}" not in table:
        return np.full(len(table), np.nan)
    return table[f"sd_{name}"].to_numpy(dtype=float)


def _in_one_row(truth: pd.DataFrame) -> pd.DataFrame:
    """True values in one row without a time where they do not vary."""
    if (truth == truth.iloc[0]).all(axis=None):
        return truth[:1].reset_index(drop=True)
    return truth


def typical_range(values: np.ndarray) -> tuple[float, float]:
    """Percentiles that are values themselves: between two, an outlier would pull them."""
    if values.size < FEW:
        return float(values.min()), float(values.max())
    low = np.percentile(values, SHOWN[0], method="higher")
    return float(low), float(np.percentile(values, SHOWN[1], method="lower"))


def _check_references(references: Any, names: Sequence[str], *, varying: bool) -> None:
    """Refuse anything but a result of reference_fits, and where no estimate varies in time."""
    if references is None:
        return
    if not isinstance(references, pd.DataFrame):
        raise TypeError(
            f"references is the result of reference_fits; got {type(references).__name__}."
        )
    missing = [name for name in ("start", "stop") if name not in references]
    if missing:
        raise ValueError(
            f"references has no column {missing[0]!r}: each of its rows is an estimate from the "
            "window from start to stop, in s."
        )
    check_some_column(references, names, "references")
    if not varying:
        raise ValueError(
            "references stand at times, and no estimate varies in time: draw batch models among "
            "the estimates."
        )


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


def _over_runs(frame: pd.DataFrame, runs: np.ndarray) -> pd.DataFrame:
    """The frame with standard deviations over its runs, which are too many for lines."""
    names = _names({"": frame})
    known = (~np.isnan(runs)).sum(axis=0)
    squares = np.nansum((runs - frame[names].to_numpy()) ** 2, axis=0)
    deviations = np.sqrt(np.where(known > 1, squares / np.maximum(known - 1, 1), np.nan))
    frame = frame.assign(**{f"sd_{n}": d for n, d in zip(names, deviations.T, strict=True)})
    frame.attrs["deviation"] = f"{DEVIATION} over {len(runs)} runs"
    return frame


def _names(frames: Mapping[str, pd.DataFrame]) -> list[str]:
    """Parameters of all frames, in order."""
    columns = [str(name) for frame in frames.values() for name in frame]
    names = dict.fromkeys(name for name in columns if not name.startswith("sd_"))
    kinds = {"a": 0, "b": 1}
    return sorted(names, key=lambda name: kinds.get(name[0], 2))


def _columns(names: list[str]) -> list[list[str]]:
    """Few parameters below each other; of more, output and input coefficients side by side."""
    n_outputs = sum(name.startswith("a") for name in names)
    if len(names) <= ONE_COLUMN:
        return [names]
    if abs(len(names) - 2 * n_outputs) > UNEVEN:
        n_outputs = -(-len(names) // 2)
    return [names[:n_outputs], names[n_outputs:]]


def _true_coefficients(
    truth: Any, names: list[str], frames: dict[str, pd.DataFrame], models: dict[str, Any]
) -> pd.DataFrame | None:
    """True values over time, or in one row where they do not vary."""
    if truth is None:
        return None
    if hasattr(truth, "task") or hasattr(truth, "arx_parameters"):
        truth = _coefficients_of(truth, models)
    if isinstance(truth, (pd.Series, Mapping)):
        truth = pd.DataFrame([dict(truth)])
    if not isinstance(truth, pd.DataFrame):
        truth = _with_names(truth, names, frames)
    check_some_column(truth, names, "truth")
    known = [name for name in names if name in truth]
    truth = _in_one_row(truth[known].astype(float))
    return truth.rename_axis("time") if len(truth) > 1 else truth


def _coefficients_of(truth: Any, models: dict[str, Any]) -> pd.DataFrame:
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


def _with_names(truth: Any, names: list[str], frames: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """An array with the names of the parameters and the instants of the estimates."""
    values = np.atleast_2d(np.asarray(truth, dtype=float))
    times = {len(time): time for time in _times_of(frames.values())}
    if values.ndim != 2 or values.shape[1] != len(names) or len(values) not in {1, *times}:
        rows = " or ".join(map(str, times))
        raise ValueError(
            f"An array of true values has {len(names)} columns ({', '.join(names)}) and a row for "
            f"each of {rows} instants, or one; got the shape {values.shape}. A DataFrame over time "
            "may have instants of its own."
        )
    return pd.DataFrame(values, index=times.get(len(values)), columns=names)


def _true_operator(truth: Any, frames: dict[str, pd.DataFrame]) -> pd.DataFrame | None:
    """True values over the times of the estimates, or in one row where they do not vary."""
    truth = getattr(truth, "parameters", truth)  # the third result of make_tracking_runs
    if isinstance(truth, pd.Series):
        truth = truth.to_frame().T
    times = _times_of(frames.values())
    varying = (
        "The truth varies in time and no estimate does, so its values have no place here. Give it "
        "at one instant: truth=operator.at(t), or truth=frame.loc[t]."
    )
    if truth is None:
        return None
    if isinstance(truth, pd.DataFrame):
        truth = _in_one_row(truth[[name for name in NAMES if name in truth]])
        if len(truth) > 1 and not times:
            raise ValueError(varying)
        return truth
    if not isinstance(truth, HumanOperator):
        raise TypeError(
            "truth must be a HumanOperator, a DataFrame or a row of one; got "
            f"{type(truth).__name__}."
        )
    index = pd.Index([0])
    if times:
        instants = np.concatenate(times)
        fine = np.linspace(instants.min(), instants.max(), FINE)
        index = pd.Index(np.union1d(instants, fine), name="time")
    elif any(callable(getattr(truth, name)) for name in NAMES):
        raise ValueError(varying)
    instants = index.to_numpy(dtype=float)
    return pd.DataFrame(truth.over_time(instants), index=index)
