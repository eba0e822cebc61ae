"""Signals over time: those of the loop, and the output measured and simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_consistent_length, column_or_1d

from ..metrics import layout_of_output, vaf_score
from ..pipelines import prediction_from, raw_layout, trimmed_rows
from ..preprocessing.gate import as_output, unmasked
from ..preprocessing.transformers import run_in_rows
from ..runs import GAP, RunLayout, check_alignment, output_name, read_layout, run_name
from ..simulation import change_times
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
    traces : dict of DataFrame
        ``measured`` and ``simulated`` output over time in s, and whether each row is ``scored``,
        by the names of the runs.
    centered : bool, default=False
        Take VAF about the mean of each run.
    output : str, default="output"
        Name of the output.
    unit : str or None, default=None
        Its unit.
    note : str, default=""
        What is said below the panels.

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

    traces: Mapping[str, pd.DataFrame]
    centered: bool = False
    output: str = "output"
    unit: str | None = None
    note: str = ""

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
            It simulates the output as for ``score``. The run-in that a
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
        """
        if not hasattr(estimator, "predict"):
            raise TypeError(
                "SimulationDisplay.from_estimator needs a fitted estimator with a predict method; "
                f"got {type(estimator).__name__}."
            )
        layout = raw_layout(estimator, X, dt=dt, run=run)
        check_alignment(X, y)
        check_consistent_length(X, y)
        simulated, _ = prediction_from(estimator, X, y)
        run_in = trimmed_rows(estimator, X)
        traces, note = _traces(layout, as_output(y), simulated, run_in, runs, window)
        return cls(traces=traces, note=note, centered=centered, **_find_name(y)).plot(ax, **kwargs)

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
        """
        check_consistent_length(y_true, y_pred)
        simulated = column_or_1d(np.asarray(unmasked(y_pred), dtype=float), warn=False)
        layout = layout_of_output(y_true, dt, run)
        trimmed = run_in_rows(layout, run_in=run_in)
        measured = as_output(y_true, "y_true")
        traces, note = _traces(layout, measured, simulated, trimmed, runs, window)
        return cls(traces=traces, note=note, centered=centered, **_find_name(y_true)).plot(
            ax, **kwargs
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
        n_runs = len(self.traces)
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
        for (name, trace), row in zip(self.traces.items(), self.axes_, strict=True):
            self._draw_run(name, trace, row)
        panels[-1].set_xlabel(f"time, s{self.note}")
        self._restyle(kwargs, self.simulated_)
        self._legend_of_panels()
        if self._own:
            self.figure_.align_ylabels(panels)
        return self

    def _draw_run(self, name: str, trace: pd.DataFrame, panels: np.ndarray) -> None:
        top, first, last = panels[0], trace.index[0], trace.index[-1]
        step = np.diff(trace.index)
        gaps: Any = np.flatnonzero(step > GAP * np.median(step)) + 1 if step.size else []
        columns = (trace.index, trace["measured"], trace["simulated"])
        time, true, pred = (np.insert(v.to_numpy(dtype=float), gaps, np.nan) for v in columns)
        self.measured_ += top.plot(time, true, label="measured", **ROLES["measured"].style(1.2))
        self.simulated_ += top.plot(time, pred, label="simulated", **ROLES["simulated"].style(1.2))
        top.set_ylabel(with_unit(self.output, self.unit))
        text = f"{name}: {self._vaf_text(trace[trace['scored']])}{trace.attrs.get('where', '')}"
        top.set_title(text, loc="left", fontsize="medium")
        if len(panels) == 2:
            bottom = panels[1]
            bottom.axhline(0.0, color=GREY, lw=scaled(0.8))
            look = ROLES["residual"].style(1.0)
            self.residual_ += bottom.plot(time, true - pred, label="residual", **look)
            bottom.set_ylabel(with_unit("residual", self.unit))
            top.tick_params(labelbottom=False)
        run_in = trace.index[~trace["scored"]]
        for panel in panels:
            if len(run_in):
                end = run_in[-1] + (np.median(step) if step.size else 0.0)
                look = {"color": GREY, "alpha": 0.3, "lw": 0, "zorder": 0}
                panel.axvspan(first, end, label="run-in, not scored", **look)
            if last > first:
                panel.set_xlim(first, last)

    def _vaf_text(self, trace: pd.DataFrame) -> str:
        true, pred = trace["measured"], trace["simulated"]
        known = true.dropna()
        still = known.empty or (np.ptp(known) == 0 if self.centered else not known.any())
        if still or pred.isna().any():
            return "VAF undefined"
        vaf = float(vaf_score(true.to_numpy(), pred.to_numpy(), centered=self.centered))
        return f"{vaf_name(centered=self.centered, clipped=vaf <= 0)} {vaf:.1f} %"


def _find_name(y: Any) -> dict[str, Any]:
    name = getattr(y, "name", None)
    units = (getattr(y, "attrs", None) or {}).get("units", {})
    return {"output": "output" if name is None else str(name), "unit": units.get(name)}


def _traces(
    layout: RunLayout,
    measured: np.ndarray,
    simulated: np.ndarray,
    run_in: np.ndarray,
    runs: Any,
    window: tuple[float, float] | None,
) -> tuple[dict[str, pd.DataFrame], str]:
    """The rows of the window of each chosen run, by its name; and how many runs there are more."""
    scored = ~run_in if layout.trimmed is None else ~(run_in | layout.trimmed)
    labels, where = list(layout.labels), ""
    inside = np.ones(layout.n_rows, dtype=bool)
    if window is not None:
        slack = 1e-6 * layout.dt
        inside = (layout.time >= window[0] - slack) & (layout.time < window[1] - slack)
        where = f" from {window[0]:.4g} to {window[1]:.4g} s"
    traces = {}
    for number in _chosen_runs(labels, runs):
        rows = np.arange(layout.run_starts[number], layout.run_starts[number + 1])
        rows = rows[inside[rows]]
        if rows.size == 0:
            raise ValueError(f"Run {labels[number]!r} has no row in the window {window} s.")
        columns = {"measured": measured, "simulated": simulated, "scored": scored}
        trace = pd.DataFrame({n: v[rows] for n, v in columns.items()}, index=layout.time[rows])
        trace.attrs["where"] = where
        traces[_run_name(labels[number])] = trace
    note = f"\n(the first {MAX_RUNS} of {len(labels)} runs; name others in runs=)"
    return traces, note if runs is None and len(labels) > MAX_RUNS else ""


def _run_name(label: Any) -> str:
    return run_name(label) if isinstance(label, (str, tuple)) else f"run {label}"


def _chosen_runs(labels: list[Any], runs: Any) -> list[int]:
    if runs is None:
        return list(range(min(len(labels), MAX_RUNS)))
    known = [
        {label, _run_name(label), *(label[-1:] if isinstance(label, tuple) else ())}
        for label in labels
    ]
    wanted = [runs] if np.ndim(runs) == 0 or runs in labels else list(runs)
    for label in wanted:
        if not any(label in names for names in known):
            raise ValueError(f"There is no run {label!r}; the runs are {labels}.")
    return [i for i, names in enumerate(known) if not names.isdisjoint(wanted)]


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
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw runs that share their times.

        Parameters
        ----------
        X : DataFrame of shape (n_rows, n_channels)
            Channels, with the row index levels ``run`` and ``time``; units are read from
            ``X.attrs["units"]``.
        y : Series of shape (n_rows,)
            The operator's output.
        truth : Bunch or None, default=None
            Third result of :func:`skhoid.make_tracking_runs`: draws the response without remnant
            too, and marks the instant at which the controlled element changes.
        window : tuple of float or None, default=None
            Begin and end of the times to draw, in s; the end is left out.
        transition : float or None, default=None
            Instant to mark, in s; known from ``truth`` where it is given.
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
            change = change_times(truth.task)
            transition = change[1] if transition is None and change else transition
        return cls(
            time=time[shown],
            signals=signals,
            response=response,
            transition=transition,
            units={**X.attrs.get("units", {}), **y.attrs.get("units", {})},
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        n = len(self.signals)
        size = 6.4, 1.0 + 1.5 * n
        self._take_axes(ax, "one for each signal", (n, 1), sharex=True, figsize=size)
        several = any(len(signal) > 1 for signal in self.signals.values())
        first = "first run" if several else ROLES["measured"].word
        self.lines_: dict[str, Any] = {}
        for panel, (name, signal) in zip(self.axes_, self.signals.items(), strict=True):
            others = signal[1 : 1 + MOST_SHOWN]
            if len(others):
                look = {"color": GREY, "lw": scaled(0.4), "alpha": 0.6}
                panel.plot(self.time, others.T, zorder=1, label="other runs", **look)
            look = ROLES["measured"].style(0.9)
            (self.lines_[name],) = panel.plot(self.time, signal[0], label=first, **look)
            if self.response is not None and name == list(self.signals)[-1]:
                look = ROLES["truth"].style(1.1)
                panel.plot(self.time, self.response, zorder=3, label=TRUTH, **look)
            if self.transition is not None and self.time[0] < self.transition < self.time[-1]:
                look = {"color": dimmed(), "ls": ":", "lw": scaled(1.2)}
                panel.axvline(self.transition, label="change", **look)
            panel.set_ylabel(with_unit(CHANNELS.get(name, name), (self.units or {}).get(name)))
            panel.grid(alpha=0.3)
        self.axes_[-1].set_xlabel("time, s")
        self.axes_[-1].set_xlim(self.time[0], self.time[-1])
        self.figure_.align_ylabels(self.axes_)
        self._restyle(kwargs, self.lines_)
        if several or self.response is not None or self.transition is not None:
            self._legend_of_panels()
        return self
