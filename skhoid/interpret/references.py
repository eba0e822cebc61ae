"""reference_fits: batch models of the constant parts of runs, to compare paths with."""

from __future__ import annotations

import warnings
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_consistent_length

from .._sklearn import checked
from ..arx import batch as models  # which imports this package: no class is there yet
from ..arx.base import BaseARX
from ..exceptions import MissingDataWarning
from ..pipelines import final_step, raw_layout, trimmed_rows, unwrapped
from ..preprocessing.gate import as_output
from .conversion import NAMES, operator_parameters

LENGTH = 30.72  # s, as in the thesis
SHARED = ("na", "nb", "nk", "inputs", "fit_intercept", "roles", "dt", "run")


@checked(
    y=["array-like"],
    windows=[str, tuple, list, np.ndarray],
)
def reference_fits(
    X: Any,
    y: Any,
    windows: Any = ("ini", "fin"),
    *,
    estimator: Any = None,
) -> pd.DataFrame:
    """Fit batch ARX models to the parts of runs in which the operator does not change.

    They are what a recursion should find there: the green lines in Figs. 14-17 of the thesis.

    Parameters
    ----------
    X : DataFrame or array of shape (n_rows, n_columns)
        Channels, one row per sample.
    y : Series or array of shape (n_rows,)
        Output.
    windows : "ini", "fin", (float, float) or sequence of them, default=("ini", "fin")
        Parts of each run: its first and its last 30.72 seconds, after a run-in that the
        estimator leaves out, or ``start <= time < stop`` in seconds of the time index.
    estimator : ARX model, or pipeline or search that ends in one, or None, default=None
        The batch models take its orders, delay, inputs and preprocessing; it need not be fitted.
        None means ``ARXRegressor()``.

    Returns
    -------
    references : DataFrame
        One row per window, named ``"ini"``, ``"fin"`` or ``"start-stop"``; columns ``start`` and
        ``stop`` (s), the ARX parameters (named in ``attrs["parameter_names"]``), and with ``na = nb
        = 2`` those of the operator as :func:`operator_parameters` names them, each with its
        standard deviation ``sd_...``.

    Examples
    --------
    >>> from skhoid import RecursiveARX, make_tracking_runs, reference_fits
    >>> X, y = make_tracking_runs("C4", n_runs=3, remnant_intensity=0.1, random_state=0)
    >>> references = reference_fits(X, y, estimator=RecursiveARX(nk=29))
    >>> references[["start", "stop", "b0", "K_edot"]].round(2)
         start   stop    b0  K_edot
    ini    0.0  30.72  0.07    0.04
    fin   51.2  81.92  0.16    0.08
    """
    check_consistent_length(X, y)
    estimator = unwrapped(models.ARXRegressor() if estimator is None else estimator)
    batch = _make_batch(estimator)
    layout = raw_layout(estimator, X)
    measured = ~trimmed_rows(estimator, X)
    if layout.trimmed is not None:
        measured &= ~layout.trimmed
    output = as_output(y)
    rows: dict[str, dict[str, float]] = {}
    if len(windows) == 0:
        raise ValueError("windows is empty; give at least one.")
    single = isinstance(windows, str) or all(isinstance(edge, Real) for edge in windows)
    for window in [windows] if single else windows:
        name, start, stop = _choose_bounds(window, layout, measured)
        slack = 1e-6 * layout.dt
        inside = measured & (layout.time >= start - slack) & (layout.time < stop - slack)
        masked = np.where(inside, output, np.nan)
        if isinstance(y, pd.Series):
            masked = pd.Series(masked, index=y.index, name=y.name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MissingDataWarning)
            try:
                model = clone(batch).fit(X, masked)
            except ValueError as error:
                raise type(error)(
                    f"The window {name!r}, {start:g} to {stop:g} s, cannot be fitted: {error}"
                ) from error
        rows[name] = {"start": start, "stop": stop} | _read_estimates(model)
    frame = pd.DataFrame.from_dict(rows, orient="index")
    frame.attrs["parameter_names"] = list(final_step(model)[1].parameter_names_)
    return frame


def _make_batch(estimator: Any) -> Any:
    """The estimator with a batch model at its end."""
    _, model = final_step(estimator)
    model = unwrapped(model)
    if not isinstance(model, BaseARX):
        raise TypeError(
            "reference_fits needs an ARX model, or a pipeline or search that ends "
            f"in one; got {type(model).__name__}."
        )
    whole = models.ARXRegressor(**{name: getattr(model, name) for name in SHARED})
    if isinstance(estimator, Pipeline):
        steps = [(name, clone(step)) for name, step in estimator.steps[:-1]]
        return Pipeline([*steps, ("arxregressor", whole)])
    return whole


def _choose_bounds(window: Any, layout: Any, measured: np.ndarray) -> tuple[Any, ...]:
    """Name, start and stop of a window in seconds."""
    time = layout.time[measured]
    if isinstance(window, str) and window in ("ini", "fin"):
        run = layout.run_of(np.flatnonzero(measured))
        first, last = (
            np.unique(run, return_index=True)[1],
            np.append(np.flatnonzero(np.diff(run)), run.size - 1),
        )
        start, stop = float(time[first].max()), float(time[last].min()) + layout.dt
        if stop - start + layout.dt / 2 < LENGTH:
            raise ValueError(
                f"The {LENGTH:g} s of {window!r} are longer than the time that the runs share, "
                f"{stop - start:g} s: give (start, stop)."
            )
        return window, *((start, start + LENGTH) if window == "ini" else (stop - LENGTH, stop))
    if isinstance(window, str) or np.size(window) != 2:
        raise ValueError(
            f"A window must be 'ini', 'fin' or (start, stop) in seconds; got {window!r}."
        )
    start, stop = map(float, window)
    return f"{start:g}-{stop:g}", start, stop


def _read_estimates(model: Any) -> dict[str, float]:
    arx = unwrapped(final_step(model)[1])
    found: dict[str, float] = {}
    for name, value, sd in zip(arx.parameter_names_, arx.coef_, arx.standard_errors_, strict=True):
        found |= {name: value, f"sd_{name}": sd}
    if arx.orders_.na == 2 and arx.orders_.nb == (2,):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # that there is NaN, as the table says
                operator = operator_parameters(model).iloc[0]
        except ValueError:  # a delay shorter than the sample that zero-order hold takes
            return found
        for name in NAMES:
            found |= {name: operator[name], f"sd_{name}": operator[f"sd_{name}"]}
    return found
