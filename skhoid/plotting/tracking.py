"""Time traces of tracking runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ..runs import output_name, read_layout
from ._axes import with_unit
from ._display import Display
from ._roles import GREY, ROLES, dimmed, scaled

NAMES = {
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
    axes_ : list of Axes
        The panels, from top to bottom.
    figure_ : Figure
        The figure that holds them.
    lines_ : dict of Line2D
        The first run's line, by signal.

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
        **styles: Any,
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
        ax : sequence of Axes or None, default=None
            As many as there are signals. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : TrackingDisplay
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
            transition = transition_time(element) if transition is None else transition
        units = units or {**X.attrs.get("units", {}), **y.attrs.get("units", {})}
        display = cls(
            time=time[shown], signals=signals, response=response, transition=transition, units=units
        )
        return display.plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        measured_kw: dict[str, Any] | None = None,
        runs_kw: dict[str, Any] | None = None,
        truth_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            As many as there are signals. None makes a figure.
        measured_kw : dict or None, default=None
            Keywords of matplotlib for the first run.
        runs_kw : dict or None, default=None
            Keywords of matplotlib for the other runs.
        truth_kw : dict or None, default=None
            Keywords of matplotlib for the response without remnant.

        Returns
        -------
        self : TrackingDisplay
        """
        styles = {"measured": measured_kw, "runs": runs_kw, "truth": truth_kw}
        n = len(self.signals)
        size = 6.4, 1.0 + 1.5 * n
        self.axes_ = list(
            self._take_axes(ax, "one for each signal", (n, 1), sharex=True, figsize=size)
        )
        self.lines_: dict[str, Any] = {}
        self.runs_: list[Any] = []
        self.truth_: list[Any] = []
        for panel, (name, signal) in zip(self.axes_, self.signals.items(), strict=True):
            others = signal[1 : 1 + MOST_SHOWN]
            if len(others):
                look = {"color": GREY, "lw": scaled(0.4), "alpha": 0.6}
                self.runs_ += panel.plot(self.time, others.T, zorder=1, label="other runs", **look)
            (self.lines_[name],) = panel.plot(
                self.time, signal[0], label=self._first(), **ROLES["measured"].style(0.9)
            )
            if self.response is not None and name == list(self.signals)[-1]:
                self.truth_ += panel.plot(
                    self.time, self.response, zorder=3, label=TRUTH, **ROLES["truth"].style(1.1)
                )
            if self.transition is not None and self.time[0] < self.transition < self.time[-1]:
                look = {"color": dimmed(), "ls": ":", "lw": scaled(1.2)}
                panel.axvline(self.transition, label="change", **look)
            panel.set_ylabel(with_unit(NAMES.get(name, name), (self.units or {}).get(name)))
            panel.grid(alpha=0.3)
        self.axes_[-1].set_xlabel("time, s")
        self.axes_[-1].set_xlim(self.time[0], self.time[-1])
        self.figure_.align_ylabels(self.axes_)
        self._restyle(styles, measured=self.lines_, runs=self.runs_, truth=self.truth_)
        if self.runs_ or self.truth_ or self.transition is not None:
            self._legend_of_panels()
        return self

    def _first(self) -> str:
        several = any(len(signal) > 1 for signal in self.signals.values())
        return "first run" if several else ROLES["measured"].word


def transition_time(parameters: pd.DataFrame) -> float | None:
    """Where parameters change most between two instants, in s; None where they do not."""
    change = parameters.diff().abs() / (parameters.max() - parameters.min()).replace(0.0, np.nan)
    total = change.max(axis=1)
    return float(total.idxmax()) if total.max() > 0 else None
