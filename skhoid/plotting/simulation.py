"""Measured and simulated output over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from sklearn.utils.validation import check_consistent_length, column_or_1d

from ..metrics import layout_of_output, vaf_score
from ..pipelines import raw_layout, trimmed_rows
from ..preprocessing.gate import as_output, unmasked
from ..preprocessing.transformers import run_in_rows
from ..runs import GAP, RunLayout, check_alignment, run_name
from ..text import vaf_name
from ._axes import with_unit
from ._display import Display
from ._roles import GREY, ROLES, scaled

MAX_RUNS = 5


@dataclass(kw_only=True, eq=False, repr=False)
class SimulationDisplay(Display):
    """Measured against simulated output over time, with the residual below.

    One pair of panels per run; its title gives the VAF. A missing measurement is a gap in the
    line, and so is a gap in the recording. A run-in is shaded and not scored.

    Make it with :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    time : list of ndarray
        Time of the rows of each run in seconds.
    y_true, y_pred : list of ndarray
        Measured and simulated output of each run.
    runs : list of str
        Names of the runs, for the titles.
    vaf : ndarray of shape (n_runs,)
        VAF of the rows shown outside the run-in, in percent, clipped at 0; NaN where undefined.
    run_in_end : ndarray of shape (n_runs,) or None, default=None
        Time at which the run-in ends; NaN where there is none.
    window : (float, float) or None, default=None
        Part of each run that is shown, in seconds.
    centered : bool, default=False
        Whether ``vaf`` is taken about the mean of each run.
    output_name : str, default="output"
        Name of the output.
    unit : str or None, default=None
        Unit of the output.
    n_runs_in_data : int or None, default=None
        Number of runs in the data, if more than are shown.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_runs, 2) or (n_runs, 1)
        For each run the panel of the signals and, if drawn, that of the residual.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    measured_, simulated_, residual_ : list of Line2D
        The lines, one per run; ``residual_`` is empty where residuals are not drawn.

    See Also
    --------
    skhoid.vaf_score : The figure in the titles.

    Examples
    --------
    >>> from skhoid import ARXRegressor, load_human_tracking
    >>> from skhoid.plotting import SimulationDisplay
    >>> X, y = load_human_tracking(1)
    >>> model = ARXRegressor(nk=7).fit(X, y)
    >>> display = SimulationDisplay.from_estimator(model, X, y, window=(10, 20))
    >>> display.ax_.get_ylabel()
    'x, px'
    """

    time: Sequence[np.ndarray]
    y_true: Sequence[np.ndarray]
    y_pred: Sequence[np.ndarray]
    runs: Sequence[str]
    vaf: np.ndarray
    run_in_end: np.ndarray | None = None
    window: tuple[float, float] | None = None
    centered: bool = False
    output_name: str = "output"
    unit: str | None = None
    n_runs_in_data: int | None = None

    @classmethod
    def from_estimator(
        cls,
        estimator: Any,
        X: Any,
        y: Any,
        *,
        runs: Any = None,
        window: tuple[float, float] | None = None,
        centered: bool = False,
        ax: Any = None,
        dt: float | None = None,
        run: Any = None,
        **styles: Any,
    ) -> Self:
        """Simulate with a fitted estimator and draw.

        Parameters
        ----------
        estimator : fitted estimator, pipeline or search
            Its ``predict(X)`` gives the simulated output. The run-in that a
            :class:`skhoid.RunInTrimmer` in it leaves out is shaded and not scored.
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.
        y : Series or array of shape (n_rows,)
            Measured output; its unit is read from ``y.attrs["units"]``.
        runs : label, list of labels or None, default=None
            Runs to show. None means all, but no more than the first five; the figure says so.
        window : (float, float) or None, default=None
            Show, and score, only rows with ``window[0] <= time < window[1]``, in seconds.
        centered : bool, default=False
            Take VAF about the mean of each run.
        ax : Axes, sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`.
        dt : float or None, default=None
            Sampling time in seconds of data without a time index. None means that of the
            estimator.
        run : column name or position, or None, default=None
            Run column of data without a run index. None means that of the estimator.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : SimulationDisplay
        """
        if not hasattr(estimator, "predict"):
            raise TypeError(
                "SimulationDisplay.from_estimator needs a fitted estimator with a predict method; "
                f"got {type(estimator).__name__}."
            )
        layout = raw_layout(estimator, X, dt=dt, run=run)
        check_alignment(X, y)
        check_consistent_length(X, y)
        measured = as_output(y)
        prediction = np.asarray(estimator.predict(X), dtype=float).ravel()
        run_in = trimmed_rows(estimator, X)
        display = cls._of(layout, measured, prediction, run_in, runs, window, centered, y)
        return display.plot(ax, **styles)

    @classmethod
    def from_predictions(
        cls,
        y_true: Any,
        y_pred: Any,
        *,
        runs: Any = None,
        window: tuple[float, float] | None = None,
        centered: bool = False,
        run_in: float | None = None,
        ax: Any = None,
        dt: float | None = None,
        run: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw a simulated output that is already there.

        Parameters
        ----------
        y_true : Series or array of shape (n_rows,)
            Measured output; runs and time are read from its index, its unit from
            ``y_true.attrs["units"]``.
        y_pred : array-like of shape (n_rows,)
            Simulated output, row by row, such as that of ``cross_val_predict``.
        runs : label, list of labels or None, default=None
            Runs to show. None means all, but no more than the first five; the figure says so.
        window : (float, float) or None, default=None
            Show, and score, only rows with ``window[0] <= time < window[1]``, in seconds.
        centered : bool, default=False
            Take VAF about the mean of each run.
        run_in : float or None, default=None
            Shade this many seconds at the start of each run and do not score them.
        ax : Axes, sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`.
        dt : float or None, default=None
            Sampling time in seconds of data without a time index (None: 1).
        run : array of shape (n_rows,) or None, default=None
            Run label of each row, for data without a run index.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : SimulationDisplay
        """
        check_consistent_length(y_true, y_pred)
        measured = as_output(y_true, "y_true")
        prediction = column_or_1d(np.asarray(unmasked(y_pred), dtype=float), warn=False)
        layout = layout_of_output(y_true, dt, run)
        trimmed = run_in_rows(layout, run_in=run_in)
        display = cls._of(layout, measured, prediction, trimmed, runs, window, centered, y_true)
        return display.plot(ax, **styles)

    @classmethod
    def _of(
        cls,
        layout: RunLayout,
        measured: np.ndarray,
        prediction: np.ndarray,
        run_in: np.ndarray,
        runs: Any,
        window: tuple[float, float] | None,
        centered: bool,
        y: Any,
    ) -> Self:
        if layout.trimmed is not None:
            run_in = run_in | layout.trimmed
        chosen = _chosen_runs(layout, runs)
        inside = _in_window(layout, window)
        time, y_true, y_pred, vaf, ends = [], [], [], [], []
        for number in chosen:
            rows = np.arange(layout.run_starts[number], layout.run_starts[number + 1])
            rows = rows[inside[rows]]
            if rows.size == 0:
                raise ValueError(
                    f"Run {layout.labels[number]!r} has no row in the window {window} s."
                )
            scored = rows[~run_in[rows]]
            time.append(layout.time[rows])
            y_true.append(measured[rows])
            y_pred.append(prediction[rows])
            vaf.append(_vaf_or_nan(measured[scored], prediction[scored], centered))
            shaded = rows[run_in[rows]]
            ends.append(layout.time[shaded[-1]] + layout.dt if shaded.size else np.nan)
        name = getattr(y, "name", None)
        return cls(
            time=time,
            y_true=y_true,
            y_pred=y_pred,
            runs=[_run_name(layout.labels[number]) for number in chosen],
            vaf=np.array(vaf),
            run_in_end=np.array(ends),
            window=window,
            centered=centered,
            output_name="output" if name is None else str(name),
            unit=(getattr(y, "attrs", None) or {}).get("units", {}).get(name),
            n_runs_in_data=len(layout.labels) if runs is None else None,
        )

    def plot(
        self,
        ax: Any = None,
        *,
        measured_kw: dict[str, Any] | None = None,
        simulated_kw: dict[str, Any] | None = None,
        residual_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of Axes or None, default=None
            One Axes per run for the signals alone, or two per run, for the signals and the
            residual of the first run, of the second, and so on. None makes a figure with both.
        measured_kw : dict or None, default=None
            Keywords of matplotlib for the measured output.
        simulated_kw : dict or None, default=None
            Keywords of matplotlib for the simulated output.
        residual_kw : dict or None, default=None
            Keywords of matplotlib for the residual.

        Returns
        -------
        self : SimulationDisplay
        """
        styles = {"measured": measured_kw, "simulated": simulated_kw, "residual": residual_kw}
        n_runs = len(self.runs)
        panels = self._take_axes(
            ax,
            "one per run for the signals, or two per run for signals and residual",
            (2 * n_runs, 1),
            allowed=(n_runs, 2 * n_runs),
            figsize=(6.4, 0.8 + 3.0 * n_runs),
            height_ratios=[3, 1.4] * n_runs,
        )
        self.axes_ = panels.reshape(n_runs, -1)
        self.ax_ = panels[0]
        self.measured_: list[Any] = []
        self.simulated_: list[Any] = []
        self.residual_: list[Any] = []
        for number, row in enumerate(self.axes_):
            self._draw_run(number, row)
        self.axes_[-1, -1].set_xlabel("time, s" + self._note())
        self._restyle(
            styles, measured=self.measured_, simulated=self.simulated_, residual=self.residual_
        )
        self._legend_of_panels()
        if self._own:
            self.figure_.align_ylabels(panels)
        return self

    def _draw_run(self, number: int, panels: np.ndarray) -> None:
        time, true, pred = self.time[number], self.y_true[number], self.y_pred[number]
        top = panels[0]
        step = np.diff(time)
        at_gaps = (
            np.flatnonzero(step > GAP * np.median(step)) + 1 if step.size else step.astype(int)
        )
        time = np.insert(time, at_gaps, np.nan)
        true, pred = np.insert(true, at_gaps, np.nan), np.insert(pred, at_gaps, np.nan)
        self.measured_ += top.plot(time, true, label="measured", **ROLES["measured"].style(1.2))
        self.simulated_ += top.plot(time, pred, label="simulated", **ROLES["simulated"].style(1.2))
        top.set_ylabel(with_unit(self.output_name, self.unit))
        top.set_title(self._title(number), loc="left", fontsize="medium")
        if len(panels) == 2:
            bottom = panels[1]
            bottom.axhline(0.0, color=GREY, lw=scaled(0.8))
            self.residual_ += bottom.plot(
                time, true - pred, label="residual", **ROLES["residual"].style(1.0)
            )
            bottom.set_ylabel(with_unit("residual", self.unit))
            top.tick_params(labelbottom=False)
        end = np.nan if self.run_in_end is None else self.run_in_end[number]
        first, last = self.time[number][0], self.time[number][-1]
        for panel in panels:
            if not np.isnan(end):
                panel.axvspan(
                    first, end, color=GREY, alpha=0.3, lw=0, label="run-in, not scored", zorder=0
                )
            if last > first:
                panel.set_xlim(first, last)

    def _title(self, number: int) -> str:
        vaf = self.vaf[number]
        name = vaf_name(centered=self.centered, clipped=bool(vaf <= 0))
        text = "VAF undefined" if np.isnan(vaf) else f"{name} {vaf:.1f} %"
        where = ""
        if self.window is not None:
            where = f" from {self.window[0]:.4g} to {self.window[1]:.4g} s"
        return f"{self.runs[number]}: {text}{where}"

    def _note(self) -> str:
        shown = len(self.runs)
        if self.n_runs_in_data is None or self.n_runs_in_data <= shown:
            return ""
        return f"\n(the first {shown} of {self.n_runs_in_data} runs; name others in runs=)"


def _run_name(label: Any) -> str:
    return run_name(label) if isinstance(label, (str, tuple)) else f"run {label}"


def _chosen_runs(layout: RunLayout, runs: Any) -> list[int]:
    labels = list(layout.labels)
    if runs is None:
        return list(range(min(len(labels), MAX_RUNS)))
    known = [
        {label, _run_name(label), *(label[-1:] if isinstance(label, tuple) else ())}
        for label in labels
    ]
    wanted = [runs] if np.ndim(runs) == 0 or runs in labels else list(runs)
    if not wanted:
        raise ValueError("runs is empty; name at least one run, or None for the first ones.")
    for label in wanted:
        if not any(label in names for names in known):
            raise ValueError(f"There is no run {label!r}; the runs are {labels}.")
    return [i for i, names in enumerate(known) if not names.isdisjoint(wanted)]


def _in_window(layout: RunLayout, window: tuple[float, float] | None) -> np.ndarray:
    if window is None:
        return np.ones(layout.n_rows, dtype=bool)
    start, stop = window
    slack = 1e-6 * layout.dt
    return (layout.time >= start - slack) & (layout.time < stop - slack)


def _vaf_or_nan(y_true: np.ndarray, y_pred: np.ndarray, centered: bool) -> float:
    known = y_true[~np.isnan(y_true)]
    undefined = known.size == 0 or (np.ptp(known) == 0 if centered else not np.any(known))
    if undefined or np.isnan(y_pred).any():
        return float("nan")
    return float(vaf_score(y_true, y_pred, centered=centered))
