"""Variance accounted for, as a function and as a scorer."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_consistent_length, column_or_1d

from ._sklearn import DT, RUN_IN, WINDOW, StrOptions, checked
from .exceptions import MissingDataWarning, UsageError
from .pipelines import prediction_from, raw_layout, reach_model, trimmed_rows
from .preprocessing.gate import as_output, check_not_too_small, unmasked
from .preprocessing.transformers import run_in_rows
from .runs import RunLayout, check_alignment, read_layout

__all__ = ["VAF_FLOOR", "VAFScorer", "vaf_score"]

MOST = 1e100  # of predictions, as of simulations, so that squares do not overflow
VAF_FLOOR = -1000.0  # percent; what an unstable simulation scores, so that means stay finite


@checked(
    y_true=["array-like"],
    y_pred=["array-like"],
    run_in=RUN_IN,
    window=WINDOW,
    average=[StrOptions({"pooled", "mean"}), None],
    centered=["boolean"],
    dt=DT,
)
def vaf_score(
    y_true: Any,
    y_pred: Any,
    *,
    run_in: float | None = None,
    window: tuple[float, float] | None = None,
    average: str | None = "pooled",
    centered: bool = False,
    dt: float | None = None,
    run: Any = None,
) -> Any:
    """Variance accounted for by a simulated output, in percent.

    ``VAF = max(0, 1 - sum((y - y_hat)**2) / sum(y**2)) * 100``, Eq. 25 of the thesis. As in the
    thesis, means are kept; rows in which ``y_true`` is NaN are left out.

    Parameters
    ----------
    y_true : Series, DataFrame of one column or array of shape (n_rows,)
        Measured output; runs and time are read from its index.
    y_pred : array-like of shape (n_rows,)
        Simulated output, row by row.
    run_in : float or None, default=None
        Leave out this many seconds at the start of each run.
    window : (float, float) or None, default=None
        Score only rows with ``window[0] <= time < window[1]``, in seconds of the time index.
    average : {"pooled", "mean"} or None, default="pooled"
        Sum the squares over all runs, or average the VAFs of the runs; None returns one VAF per
        run, NaN for a run in which nothing was measured.
    centered : bool, default=False
        Remove the mean that each run of the measured output has from it and the simulated output
        alike: 100 times the R² of a run, to which an offset of the simulation counts.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : array of shape (n_rows,) or None, default=None
        Run label of each row, for data without a run index.

    Returns
    -------
    vaf : float or ndarray of shape (n_runs,)
        In percent, 100 for a perfect simulation, clipped at 0.

    Raises
    ------
    ValueError
        If no row is left to score, if the measured output is zero throughout, or if a prediction
        is NaN.

    See Also
    --------
    VAFScorer : The same, unclipped, for ``scoring=`` in scikit-learn's searches.

    Examples
    --------
    >>> from skhoid import vaf_score
    >>> round(vaf_score([1.0, 2.0, 3.0], [1.0, 2.0, 2.0]), 2)
    92.86
    """
    layout, y, prediction, keep = _rows_to_score(y_true, y_pred, run_in, window, dt, run)
    value = vaf_of_rows(y, prediction, keep, layout, average, centered)
    return np.maximum(value, 0.0) if average is None else max(value, 0.0)


def _rows_to_score(
    y_true: Any, y_pred: Any, run_in: Any, window: Any, dt: Any, run: Any
) -> tuple[RunLayout, np.ndarray, np.ndarray, np.ndarray]:
    check_consistent_length(y_true, y_pred)
    check_alignment(y_true, y_pred, ("y_true", "y_pred"))
    y = as_output(y_true, "y_true")
    check_not_too_small(y, "y_true")
    prediction = column_or_1d(np.asarray(unmasked(y_pred), dtype=float), warn=False)
    finite = np.isfinite(prediction)
    prediction = np.where(finite, np.clip(prediction, -MOST, MOST), prediction)
    layout = layout_of_output(y_true, dt, run)
    return layout, y, prediction, scored_rows(layout, run_in, window)


def layout_of_output(y: Any, dt: float | None, run: Any) -> RunLayout:
    """Runs and time of an output, from its index or from the run label of each row."""
    index = y.index if isinstance(y, (pd.Series, pd.DataFrame)) else None
    if run is None:
        return read_layout(y if index is not None else np.asarray(y).reshape(-1, 1), dt=dt)
    check_consistent_length(y, run)
    return read_layout(pd.DataFrame({"run": np.asarray(run)}, index=index), dt=dt, run="run")


def scored_rows(layout: RunLayout, run_in: float | None, window: Any) -> np.ndarray:
    """Rows outside the run-in and inside the window."""
    keep = np.ones(layout.n_rows, dtype=bool)
    if run_in is not None:
        keep &= ~run_in_rows(layout, run_in=run_in)
    if layout.trimmed is not None:
        keep &= ~layout.trimmed
    if window is not None:
        start, stop = _edges(window)
        slack = 1e-6 * layout.dt
        keep &= (layout.time >= start - slack) & (layout.time < stop - slack)
    return keep


def _edges(window: Any) -> tuple[float, float]:
    """Start and stop of a window in seconds."""
    try:
        start, stop = map(float, window)
    except (TypeError, ValueError):
        start = stop = np.nan
    if not start < stop:
        raise ValueError(f"window must be (start, stop) in seconds, start first; got {window!r}.")
    return start, stop


def warn_of_unscored(layout: RunLayout, y: np.ndarray, keep: np.ndarray) -> None:
    """Warn of runs that are to be scored, and have no measurement in any row."""
    known = ~np.isnan(y)
    n_rows = np.diff(layout.run_starts)
    if known[layout.run_starts[1:] - 1].all():
        return
    run = layout.run_of(np.arange(y.size))
    empty = np.bincount(run, known, n_rows.size) == 0
    empty &= np.bincount(run, keep, n_rows.size) > 0
    if empty.any() and (known & keep).any():
        names = [repr(layout.labels[i]) for i in np.flatnonzero(empty)]
        warnings.warn(
            f"y is NaN in all rows of run {', '.join(names)}, which is not scored.",
            MissingDataWarning,
            stacklevel=3,
        )


def vaf_of_rows(
    y: np.ndarray,
    prediction: np.ndarray,
    keep: np.ndarray,
    layout: RunLayout,
    average: str | None,
    centered: bool,
) -> Any:
    """Unclipped VAF with a finite floor, of the rows in ``keep``."""
    if average not in ("pooled", "mean", None):
        raise ValueError(f"average must be 'pooled', 'mean' or None; got {average!r}.")
    signal, error, run = scored_signals(y, prediction, keep, layout, centered)
    n_runs = len(layout.labels)
    lost = np.bincount(run, error**2, n_runs)
    power = np.bincount(run, signal**2, n_runs)
    scored = np.bincount(run, minlength=n_runs) > 0
    value = vaf_of_sums(lost, power, scored, average)
    return value if average is None else float(value)


def vaf_of_sums(
    lost: np.ndarray, power: np.ndarray, scored: np.ndarray, average: str | None
) -> np.ndarray:
    """Unclipped VAF with a finite floor, of sums of squares by run on the first axis.

    ``lost`` are those of the error, for several models on further axes, ``power`` those of the
    measured output of runs that were ``scored``.
    """
    if not scored.any():
        raise UsageError(
            "No row is left to score: the run-in, the window and missing values exclude all rows."
        )
    power = np.where(scored, power, np.nan)
    if average == "pooled":
        lost, power = lost.sum(axis=0, keepdims=True), np.nansum(power, keepdims=True)
    elif average == "mean":
        lost, power = lost[scored], power[scored]
    if np.any(power == 0):
        raise ValueError(
            "VAF is undefined: the measured output is zero (or, centered, constant) in all scored "
            "rows" + ("." if average == "pooled" else " of a run.")
        )
    power = power.reshape(-1, *[1] * (lost.ndim - 1))
    values = np.maximum(100.0 * (1.0 - lost / power), VAF_FLOOR)
    return values if average is None else values.mean(axis=0)


def scored_signals(
    y: np.ndarray, prediction: np.ndarray, keep: np.ndarray, layout: RunLayout, centered: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured output, error and run number of the rows in ``keep`` that were measured.

    ``centered`` removes the mean that the output has in these rows of a run from measurement and
    simulation, so that the error is the same.
    """
    for name, values in (("y_true", y), ("y_pred", prediction)):
        if np.isinf(values[keep]).any():
            row = int(np.flatnonzero(keep & np.isinf(values))[0])
            raise ValueError(f"{name} contains infinity, first in {layout.where(row)}.")
    if np.isnan(prediction[keep]).any():
        row = int(np.flatnonzero(keep & np.isnan(prediction))[0])
        raise ValueError(f"The prediction is NaN in {layout.where(row)}.")
    keep = keep & ~np.isnan(y)
    if not keep.any():
        raise UsageError(
            "No row is left to score: the run-in, the window and missing values exclude all "
            f"{y.size} rows. A run in which nothing was measured has no score.",
            hint="Leave it out of X and y (skhoid.select_runs).",
            options=["files"],
        )
    run = layout.run_of(np.flatnonzero(keep))
    signal, error = y[keep], y[keep] - prediction[keep]
    if centered:
        n_runs = len(layout.labels)
        count = np.maximum(np.bincount(run, minlength=n_runs), 1)
        signal = signal - (np.bincount(run, signal, n_runs) / count)[run]
    return signal, error, run


def fit_percent(vaf: float) -> float:
    """The fit that MATLAB's ``compare`` prints, in percent, of a VAF about the mean."""
    return 100.0 - 10.0 * float(np.sqrt(100.0 - vaf))


class VAFScorer:
    """Score a fitted estimator by the VAF of its free run, for ``scoring=``.

    Returns the unclipped VAF in percent, at least -1000, so that a search can tell a bad model from
    a worse one; with ``fraction`` from -10 to 1. Rows that a :class:`RunInTrimmer` in the pipeline
    leaves out are not scored. Scores are at the full rate, whatever the decimation factor, so that
    factors can be compared. Where runs do not begin at rest, their start is estimated from their
    first seconds: at most 10 s (or 200 rows), and a quarter of a run.

    Parameters
    ----------
    run_in : float or None, default=None
        Leave out this many seconds at the start of each run.
    window : (float, float) or None, default=None
        Score only rows with ``window[0] <= time < window[1]``, in seconds of the time index.
    rate : {"full", "model"}, default="full"
        ``"model"`` scores on the filtered and thinned signals that the model was fitted on, as the
        thesis does. Filtering leaves less to explain, so these scores tend to favour the coarsest
        model: do not use them to choose a decimation factor.
    average : {"pooled", "mean"}, default="pooled"
        Sum the squares over all runs, or average the VAFs of the runs.
    centered : bool, default=False
        Remove the mean of each run of the measured output from both signals first, as R² does.
    fraction : bool, default=False
        Divide by 100, as scikit-learn's scores of regressors are: 1 is perfect.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index. None uses that of the estimator.
    run : column name or position, or None, default=None
        Run column of ``X`` for data without a run index. None uses that of the estimator.

    See Also
    --------
    vaf_score : The function, clipped at zero.

    Examples
    --------
    >>> from skhoid import ARXRegressor, VAFScorer, load_human_tracking
    >>> X, y = load_human_tracking(1)
    >>> model = ARXRegressor(nk=7).fit(X, y)
    >>> bool(VAFScorer(run_in=2.0)(model, X, y) > 90)
    True
    """

    def __init__(
        self,
        *,
        run_in: float | None = None,
        window: tuple[float, float] | None = None,
        rate: str = "full",
        average: str = "pooled",
        centered: bool = False,
        fraction: bool = False,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        if rate not in ("full", "model"):
            raise ValueError(f"rate must be 'full' or 'model'; got {rate!r}.")
        if average not in ("pooled", "mean"):
            raise ValueError(f"average must be 'pooled' or 'mean'; got {average!r}.")
        self.run_in = run_in
        self.window = window
        self.rate = rate
        self.average = average
        self.centered = centered
        self.fraction = fraction
        self.dt = dt
        self.run = run

    def check_for_search(self) -> None:
        """Refuse what skhoid's own searches cannot take."""
        if self.rate == "model":
            raise ValueError(
                "A search scores at the full rate; VAFScorer(rate='model') cannot choose between "
                "models."
            )
        if self.fraction:
            raise ValueError(
                "skhoid's searches show scores in percent; VAFScorer(fraction=True) is for those "
                "of scikit-learn."
            )

    def __repr__(self) -> str:
        shown = [f"{k}={v!r}" for k, v in vars(self).items() if v is not None and v is not False]
        return f"VAFScorer({', '.join(shown)})"

    def __call__(self, estimator: Any, X: Any, y: Any) -> float:
        """Score the free run of a fitted estimator on ``X`` against ``y``.

        Parameters
        ----------
        estimator : fitted estimator or pipeline
        X : DataFrame or array of shape (n_rows, n_columns)
        y : Series or array of shape (n_rows,)

        Returns
        -------
        vaf : float
            In percent (or a fraction), unclipped, at least -1000 %.
        """
        return self._percent(estimator, X, y) / (100.0 if self.fraction else 1.0)

    def _percent(self, estimator: Any, X: Any, y: Any) -> float:
        check_alignment(X, y)
        layout = raw_layout(estimator, X, dt=self.dt, run=self.run)
        keep = scored_rows(layout, self.run_in, self.window) & ~trimmed_rows(estimator, X)
        if self.rate == "model":
            model, X = reach_model(estimator, X)
            return model.score_at_model_rate(X, y, keep, self.average, self.centered)
        measured = as_output(y)
        prediction, fed = prediction_from(estimator, X, y)
        if fed.size == keep.size:
            keep &= fed
        warn_of_unscored(layout, measured, keep)
        return vaf_of_rows(measured, prediction, keep, layout, self.average, self.centered)
