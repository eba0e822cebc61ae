"""ARX parameters over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..interpret.arx_channel import is_arx
from ._axes import parameter_symbol
from ._checks import check_option, check_some_column, fitted_end
from ._estimates import DEVIATION, EstimatesDisplay, check_references, in_one_row, times_of
from ._roles import scaled

MOST_LINES = 10  # single runs that are drawn one by one
MEAN = 1.8  # width of the line of a mean over single runs
ONE_COLUMN = 5  # panels below each other, before there are two columns
UNEVEN = 3  # panels that one of the columns may have more than the other


@dataclass(kw_only=True, eq=False, repr=False)
class ParameterPathDisplay(EstimatesDisplay):
    """ARX parameters over time, a panel each (Figs. 14, 16, 5.14 and 5.16).

    The path of each recursive model with one standard deviation to either side, where the model
    keeps its covariances (``store_covariance=True``). Of a model that averages estimates of single
    runs (``combine="average_estimates"``) these are thin lines under their mean; of more than ten
    runs the band is their standard deviation. The truth is green and
    dashed, and references are orange. Batch models among the recursive ones are dashed levels.

    Limits hold the true values, the references and all estimates, unless those take twice the range
    of their central 96 %, as the first instants from an arbitrary start do. A note in the panel
    counts the estimates outside.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    frames : dict of DataFrame
        Estimates by label: a column for each parameter and, where known, one of standard
        deviations (``sd_a1``), over the index ``time`` in s, or in one row of a batch model.
    truth : DataFrame or None, default=None
        True values in the same columns, over ``time`` or in one row.
    references : DataFrame or None, default=None
        Result of :func:`skhoid.reference_fits`, drawn as orange levels over its windows.
    transition_time : float or None, default=None
        Instant to mark, in s.
    runs : dict of ndarray of shape (n_runs, n_instants, n_params), or None, default=None
        Estimates of single runs by label, for the parameters and instants of the frame.
    parameters : sequence of str or None, default=None
        Names of the parameters to draw. None draws all.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_params,)
        The panels.
    figure_ : Figure
        The figure that holds them.
    names_ : list of str
        The parameter in each panel.
    lines_ : dict of Line2D
        Estimates by (label, parameter).
    run_lines_ : dict of list of Line2D
        Estimates of single runs by (label, parameter).
    bands_ : dict of FillBetweenPolyCollection
        Standard deviations by (label, parameter).
    truth_ : dict of Line2D
        True values by parameter.
    references_ : dict of Line2D
        References by (window, parameter).
    notes_ : dict of Text
        Counts of estimates outside the panel, by parameter.

    See Also
    --------
    OperatorParametersDisplay : The same as parameters of the human operator.
    skhoid.reference_fits : Batch models of constant parts, to compare with.

    Examples
    --------
    >>> from skhoid import ARXRegressor, RecursiveARX, make_tracking_runs
    >>> from skhoid.plotting import ParameterPathDisplay
    >>> X, y, truth = make_tracking_runs(
    ...     "C4", n_runs=1, remnant_intensity=0.15, return_truth=True, random_state=0
    ... )
    >>> models = {
    ...     "$N_0$ = 256": RecursiveARX(nk=29, memory_horizon=256).fit(X, y),
    ...     "batch": ARXRegressor(nk=29).fit(X, y),
    ... }
    >>> display = ParameterPathDisplay.from_estimator(models, truth, transition_time=40.96)
    >>> display.names_
    ['a1', 'a2', 'b0', 'b1']
    """

    runs: Mapping[str, np.ndarray] | None = None
    parameters: Sequence[str] | None = None

    @classmethod
    def from_estimator(
        cls,
        model: Any,
        truth: Any = None,
        references: pd.DataFrame | None = None,
        *,
        transition_time: float | None = None,
        parameters: Sequence[str] | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw fitted recursive models.

        Parameters
        ----------
        model : fitted RecursiveARX, pipeline or search that ends in one, or dict of them by label
            Among them there may be batch models.
        truth : Bunch, DataFrame, Series, dict, array or None, default=None
            True values: the third result of :func:`skhoid.make_tracking_runs`; a frame over time
            with columns named as the parameters; or constants, named or in the order of the
            parameters. An array has one row per instant, or is one row.
        references : DataFrame or None, default=None
            Result of :func:`skhoid.reference_fits`: batch models of constant parts of the runs.
        transition_time : float or None, default=None
            Instant to mark, in s.
        parameters : sequence of str or None, default=None
            Names of the parameters to draw, such as ``["a1", "b0"]``. None draws all.
        ax : sequence of Axes or None, default=None
            One for each parameter drawn. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : ParameterPathDisplay

        Raises
        ------
        sklearn.exceptions.NotFittedError
            If a model is not fitted.
        TypeError
            If it is not an ARX model, or truth or references are something else.
        ValueError
            If no model keeps a path, or truth or references do not fit the parameters.
        """
        given = model if isinstance(model, Mapping) else {"estimate": model}
        models = {str(label): _arx_model(m) for label, m in given.items()}
        frames = {label: _frame(m) for label, m in models.items()}
        if not times_of(frames.values()):
            raise ValueError(
                "ParameterPathDisplay draws parameters over time, and no model here has a path of "
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
        check_references(references, names, varying=True)
        display = cls(
            frames=frames,
            runs=runs,
            truth=_truth(truth, names, frames, models),
            references=references,
            transition_time=transition_time,
            parameters=parameters,
        )
        return display.plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        line_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        truth_kw: dict[str, Any] | None = None,
        reference_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            One for each parameter. None makes a figure.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the estimates.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the bands.
        truth_kw : dict or None, default=None
            Keywords of matplotlib for the truth.
        reference_kw : dict or None, default=None
            Keywords of matplotlib for the references.

        Returns
        -------
        self : ParameterPathDisplay
        """
        styles = {
            "line": line_kw,
            "band": band_kw,
            "truth": truth_kw,
            "reference": reference_kw,
        }
        names = _names(self.frames)
        for name in self.parameters or ():
            check_option("a name in parameters", name, names)
        names = list(names if self.parameters is None else self.parameters)
        self._begin(_columns(names), ax)
        self.run_lines_: dict[tuple[str, str], Any] = {}
        for name, panel in zip(names, self.axes_, strict=True):
            of_runs = [np.empty(0)]
            for position, (label, frame) in enumerate(self.frames.items()):
                if name not in frame:
                    continue
                self._draw_over_time(panel, name, position, label)
                if self.runs and label in self.runs:
                    of_runs.append(self._draw_runs(panel, name, position, label, self.runs[label]))
            self._draw_known(panel, name)
            self._limit(panel, name, np.concatenate(of_runs))
            panel.set_ylabel(parameter_symbol(name), fontsize="large")
            panel.grid(alpha=0.3)
        for panel in self._bottom:
            panel.set_xlabel("time, s")
        self._restyle(
            styles,
            line=self.lines_,
            band=self.bands_,
            truth=self.truth_,
            reference=self.references_,
        )
        self._legend_of_panels()
        return self

    def _draw_runs(
        self, panel: Any, name: str, position: int, label: str, runs: np.ndarray
    ) -> np.ndarray:
        """Single runs as thin lines under their mean; return their values."""
        table = self.frames[label]
        values = runs[:, :, _names({label: table}).index(name)]
        lines = panel.plot(
            table.index,
            values.T,
            color=self._colour(position),
            lw=scaled(0.5),
            alpha=0.5,
            zorder=1.8,
        )
        lines[0].set_label("single runs")
        self.lines_[label, name].set_linewidth(MEAN)
        self.run_lines_[label, name] = lines
        return values.ravel()


def _arx_model(estimator: Any) -> Any:
    """The fitted ARX model at the end of searches and pipelines."""
    model = fitted_end(estimator)
    if not is_arx(model):
        raise TypeError(
            "ParameterPathDisplay draws fitted ARX models, or pipelines and searches that end in "
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


def _truth(
    truth: Any, names: list[str], frames: dict[str, pd.DataFrame], models: dict[str, Any]
) -> pd.DataFrame | None:
    """True values over time, or in one row where they do not vary."""
    if truth is None:
        return None
    if hasattr(truth, "task") or hasattr(truth, "arx_parameters"):
        truth = _of_simulation(truth, models)
    if isinstance(truth, (pd.Series, Mapping)):
        truth = pd.DataFrame([dict(truth)])
    if not isinstance(truth, pd.DataFrame):
        truth = _named(truth, names, frames)
    check_some_column(truth, names, "truth")
    known = [name for name in names if name in truth]
    truth = in_one_row(truth[known].astype(float))
    return truth.rename_axis("time") if len(truth) > 1 else truth


def _of_simulation(truth: Any, models: dict[str, Any]) -> pd.DataFrame:
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


def _named(truth: Any, names: list[str], frames: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """An array with the names of the parameters and the instants of the estimates."""
    values = np.atleast_2d(np.asarray(truth, dtype=float))
    times = {len(time): time for time in times_of(frames.values())}
    if values.ndim != 2 or values.shape[1] != len(names) or len(values) not in {1, *times}:
        rows = " or ".join(map(str, times))
        raise ValueError(
            f"An array of true values has {len(names)} columns ({', '.join(names)}) and a row for "
            f"each of {rows} instants, or one; got the shape {values.shape}. A DataFrame over time "
            "may have instants of its own."
        )
    return pd.DataFrame(values, index=times.get(len(values)), columns=names)
