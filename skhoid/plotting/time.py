"""Signals over time: those of the loop, and the output measured and simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_consistent_length, column_or_1d

from ..metrics import layout_of_output, vaf_score
from ..pipelines import raw_layout, trimmed_rows
from ..preprocessing.gate import as_output, unmasked
from ..preprocessing.transformers import run_in_rows
from ..runs import GAP, RunLayout, check_alignment, output_name, read_layout, run_name
from ..text import vaf_name
from ._axes import with_unit
from ._display import Display
from ._roles import GREY, ROLES, dimmed, scaled

MAX_RUNS = 5
CHANNELS = {
    "e": "error e",
    "x": "output x",
    "f_t": "target $f_t$",
    "dist": "disturbance $f_d$",
    "u": "control u",
    "n": "remnant n",
}
TRUTH = "truth, without remnant"
MOST_SHOWN = 20  # single runs, beside the first


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
        The lines, one per run; ``residual_`` is empty where residuals are not drawn. The simulated
        ones are the main artists.

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
        dt: float | None = None,
        run: Any = None,
        ax: Any = None,
        **kwargs: Any,
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
        %(what_of_runs)
        dt : float or None, default=None
            Sampling time in seconds of data without a time index. None means that of the
            estimator.
        run : column name or position, or None, default=None
            Run column of data without a run index. None means that of the estimator.
        %(keywords)

        %(display)
        """
        if not hasattr(estimator, "predict"):
            raise TypeError(
                "SimulationDisplay.from_estimator needs a fitted estimator with a predict method; "
                f"got {type(estimator).__name__}."
            )
        layout = raw_layout(estimator, X, dt=dt, run=run)
        check_alignment(X, y)
        check_consistent_length(X, y)
        both = as_output(y), np.asarray(estimator.predict(X), dtype=float).ravel()
        run_in = trimmed_rows(estimator, X)
        return cls._of(layout, both, run_in, runs, window, centered, y).plot(ax, **kwargs)

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
        dt: float | None = None,
        run: Any = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw a simulated output that is already there.

        Parameters
        ----------
        y_true : Series or array of shape (n_rows,)
            Measured output; runs and time are read from its index, its unit from
            ``y_true.attrs["units"]``.
        y_pred : array-like of shape (n_rows,)
            Simulated output, row by row, such as that of ``cross_val_predict``.
        %(what_of_runs)
        run_in : float or None, default=None
            Shade this many seconds at the start of each run and do not score them.
        dt : float or None, default=None
            Sampling time in seconds of data without a time index (None: 1).
        run : array of shape (n_rows,) or None, default=None
            Run label of each row, for data without a run index.
        %(keywords)

        %(display)
        """
        check_consistent_length(y_true, y_pred)
        prediction = column_or_1d(np.asarray(unmasked(y_pred), dtype=float), warn=False)
        both = as_output(y_true, "y_true"), prediction
        layout = layout_of_output(y_true, dt, run)
        trimmed = run_in_rows(layout, run_in=run_in)
        return cls._of(layout, both, trimmed, runs, window, centered, y_true).plot(ax, **kwargs)

    @classmethod
    def _of(
        cls,
        layout: RunLayout,
        both: tuple[np.ndarray, np.ndarray],
        run_in: np.ndarray,
        runs: Any,
        window: tuple[float, float] | None,
        centered: bool,
        y: Any,
    ) -> Self:
        measured, prediction = both
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

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of Axes, Figure or None, default=None
            One Axes per run for the signals alone, or two per run, for the signals and the
            residual of the first run, of the second, and so on. None makes a figure with both.
        %(kwargs)

        %(self)
        """
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
        self.measured_: list[Any] = []
        self.simulated_: list[Any] = []
        self.residual_: list[Any] = []
        for number, row in enumerate(self.axes_):
            self._draw_run(number, row)
        note = ""
        if self.n_runs_in_data is not None and self.n_runs_in_data > n_runs:
            note = f"\n(the first {n_runs} of {self.n_runs_in_data} runs; name others in runs=)"
        panels[-1].set_xlabel("time, s" + note)
        self._restyle(kwargs, self.simulated_)
        self._legend_of_panels()
        if self._own:
            self.figure_.align_ylabels(panels)
        return self

    def _draw_run(self, number: int, panels: np.ndarray) -> None:
        time, true, pred = self.time[number], self.y_true[number], self.y_pred[number]
        top, first, last = panels[0], time[0], time[-1]
        step = np.diff(time)
        at_gaps = (
            np.flatnonzero(step > GAP * np.median(step)) + 1 if step.size else np.array([], int)
        )
        time, true, pred = (np.insert(v, at_gaps, np.nan) for v in (time, true, pred))
        self.measured_ += top.plot(time, true, label="measured", **ROLES["measured"].style(1.2))
        self.simulated_ += top.plot(time, pred, label="simulated", **ROLES["simulated"].style(1.2))
        top.set_ylabel(with_unit(self.output_name, self.unit))
        top.set_title(self._title(number), loc="left", fontsize="medium")
        if len(panels) == 2:
            bottom = panels[1]
            bottom.axhline(0.0, color=GREY, lw=scaled(0.8))
            look = ROLES["residual"].style(1.0)
            self.residual_ += bottom.plot(time, true - pred, label="residual", **look)
            bottom.set_ylabel(with_unit("residual", self.unit))
            top.tick_params(labelbottom=False)
        end = np.nan if self.run_in_end is None else self.run_in_end[number]
        for panel in panels:
            if not np.isnan(end):
                look = {"color": GREY, "alpha": 0.3, "lw": 0, "zorder": 0}
                panel.axvspan(first, end, label="run-in, not scored", **look)
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


@dataclass(kw_only=True, eq=False, repr=False)
class TrackingDisplay(Display):
    """Signals of tracking runs over time, a panel each (Figs. 7 and E.2-E.14 of the thesis).

    The first run stands out, the others are thin and grey. The operator's response without
    remnant, where it is known, is green and dashed; instants at which something changes are
    dotted.

    Make it with :meth:`from_runs`.

    Parameters
    ----------
    time : ndarray of shape (n_samples,)
        Time in s.
    signals : dict of ndarray of shape (n_runs, n_samples)
        Signals by name.
    response : ndarray of shape (n_samples,) or None, default=None
        The operator's response without remnant in the first run.
    transition : float or None, default=None
        Instant to mark, in s.
    units : dict or None, default=None
        Units by signal.

    Attributes
    ----------
    %(panels)
    lines_ : dict of Line2D
        The first run's line, by signal: the main artists.
    runs_, truth_ : list of Line2D
        The other runs, and the response without remnant.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> from skhoid.plotting import TrackingDisplay
    >>> X, y = make_tracking_runs("C3", n_runs=2, channels=["e", "x"])
    >>> display = TrackingDisplay.from_runs(X, y, window=(30.72, 51.2))
    >>> [ax.get_ylabel() for ax in display.axes_]
    ['error e, deg', 'output x, deg', 'control u, deg']
    """

    time: np.ndarray
    signals: dict[str, np.ndarray]
    response: np.ndarray | None = None
    transition: float | None = None
    units: dict[str, str] | None = None

    @classmethod
    def from_runs(
        cls,
        X: pd.DataFrame,
        y: pd.Series,
        *,
        truth: Any = None,
        window: tuple[float, float] | None = None,
        transition: float | None = None,
        units: dict[str, str] | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw runs that share their times.

        Parameters
        ----------
        X : DataFrame of shape (n_rows, n_channels)
            Channels, with the row index levels ``run`` and ``time``.
        y : Series of shape (n_rows,)
            The operator's output.
        truth : Bunch or None, default=None
            Third result of :func:`skhoid.make_tracking_runs`: draws the response without remnant
            too, and marks the instant at which the controlled element changes.
        window : tuple of float or None, default=None
            Begin and end of the times to draw, in s; the end is left out.
        transition : float or None, default=None
            Instant to mark, in s; known from ``truth`` where it is given.
        units : dict or None, default=None
            Units by channel; None takes ``X.attrs["units"]``.
        %(keywords)

        %(display)
        """
        layout = read_layout(X)
        n_runs = len(layout.labels)
        time = layout.time[: layout.n_rows // n_runs]
        if layout.n_rows % n_runs or not np.array_equal(layout.time, np.tile(time, n_runs)):
            raise ValueError(
                "TrackingDisplay draws runs that share their times; choose among them with "
                "skhoid.select_runs(X, y, ...)."
            )
        table = X.assign(**{output_name(y): y})
        begin, end = (-np.inf, np.inf) if window is None else window
        shown = (time >= begin) & (time < end)
        if not shown.any():
            raise ValueError(
                f"window={window} holds no sample; the runs go from {time[0]:g} to {time[-1]:g} s."
            )
        signals = {
            name: table[name].to_numpy(dtype=float).reshape(n_runs, -1)[:, shown]
            for name in table.columns
        }
        response = None
        if truth is not None:
            if truth.remnant.any():
                response = truth.u_without_remnant.to_numpy().reshape(n_runs, -1)[0, shown]
            element = truth.parameters[["K_c", "omega_b"]]
            transition = _transition_time(element) if transition is None else transition
        return cls(
            time=time[shown],
            signals=signals,
            response=response,
            transition=transition,
            units=units or {**X.attrs.get("units", {}), **y.attrs.get("units", {})},
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        n = len(self.signals)
        size = 6.4, 1.0 + 1.5 * n
        self._take_axes(ax, "one for each signal", (n, 1), sharex=True, figsize=size)
        several = any(len(signal) > 1 for signal in self.signals.values())
        first = "first run" if several else ROLES["measured"].word
        self.lines_: dict[str, Any] = {}
        self.runs_: list[Any] = []
        self.truth_: list[Any] = []
        for panel, (name, signal) in zip(self.axes_, self.signals.items(), strict=True):
            others = signal[1 : 1 + MOST_SHOWN]
            if len(others):
                look = {"color": GREY, "lw": scaled(0.4), "alpha": 0.6}
                self.runs_ += panel.plot(self.time, others.T, zorder=1, label="other runs", **look)
            look = ROLES["measured"].style(0.9)
            (self.lines_[name],) = panel.plot(self.time, signal[0], label=first, **look)
            if self.response is not None and name == list(self.signals)[-1]:
                look = ROLES["truth"].style(1.1)
                self.truth_ += panel.plot(self.time, self.response, zorder=3, label=TRUTH, **look)
            if self.transition is not None and self.time[0] < self.transition < self.time[-1]:
                look = {"color": dimmed(), "ls": ":", "lw": scaled(1.2)}
                panel.axvline(self.transition, label="change", **look)
            panel.set_ylabel(with_unit(CHANNELS.get(name, name), (self.units or {}).get(name)))
            panel.grid(alpha=0.3)
        self.axes_[-1].set_xlabel("time, s")
        self.axes_[-1].set_xlim(self.time[0], self.time[-1])
        self.figure_.align_ylabels(self.axes_)
        self._restyle(kwargs, self.lines_)
        if self.runs_ or self.truth_ or self.transition is not None:
            self._legend_of_panels()
        return self


def _transition_time(parameters: pd.DataFrame) -> float | None:
    """Where parameters change most between two instants, in s; None where they do not."""
    change = parameters.diff().abs() / (parameters.max() - parameters.min()).replace(0.0, np.nan)
    total = change.max(axis=1)
    return float(total.idxmax()) if total.max() > 0 else None
