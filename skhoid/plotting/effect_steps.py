"""Measured and simulated output over time, before and after a search adds effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np
import pandas as pd

from ..preprocessing.base import as_fitted
from ..runs import RunLayout, read_layout, run_name
from ..search import Verdict
from ._axes import letters_above, with_unit, wrapped
from ._comparison import percent, say_instead
from ._display import Display
from ._effects import (
    BASELINE,
    UNKNOWN,
    attributes_of,
    step_colours,
    step_labels,
    unit_of,
)
from ._roles import ROLES, foreground, scaled

TAKEN = ("predictions_", "error_path_", "verdict_")
SHOWN = 15.0  # s
LEAST_HEIGHT = 4.4  # inches, of a font of 10 points


@dataclass(kw_only=True, eq=False, repr=False)
class EffectStepsDisplay(Display):
    """The measured output against held-out simulations before and after effects are added.

    Above the output, below the residuals, both greyer and dashed before the effects. Simulations
    come from models that have not seen the run. By default the baseline and the last step in the
    15 s of all runs in which the effects help most. The VAF in the legend is that of all held-out
    runs, not of the window.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    predictions : DataFrame
        ``predictions_`` of the search: the columns measured and baseline and one for each effect
        added, over runs and time.
    error_path : DataFrame
        ``error_path_`` of the search, for the VAF.
    verdict : Verdict or str
        ``verdict_`` of the search.
    unit : str or None, default=None
        Unit of the output.
    settling : float, default=0.0
        Seconds at the start of each run, and behind gaps, that the choice of a window passes over.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (2,)
        Output and residual.
    figure_ : Figure
        The figure that holds them.
    run_ : str
        Name of the run shown.
    window_ : (float, float)
        Time shown, in s.
    lines_ : dict of Line2D
        Output, by the names of the columns.
    residuals_ : dict of Line2D
        Residuals, by the names of the columns.

    See Also
    --------
    ErrorPathDisplay : The error at each step.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid.plotting import EffectStepsDisplay
    >>> index = pd.MultiIndex.from_product([[1, 2], np.arange(3000) / 100], names=["run", "time"])
    >>> measured = np.sin(index.get_level_values("time"))
    >>> predictions = pd.DataFrame(
    ...     {"measured": measured, "baseline": 0.8 * measured, "+ dead_zone": measured}, index
    ... )
    >>> path = pd.DataFrame({"effect": ["baseline", "dead_zone"], "vaf": [96.0, 100.0]})
    >>> display = EffectStepsDisplay(
    ...     predictions=predictions, error_path=path, verdict="effects found"
    ... ).plot(run=2)
    >>> list(display.lines_)
    ['measured', 'baseline', '+ dead_zone']
    """

    predictions: pd.DataFrame
    error_path: pd.DataFrame
    verdict: Verdict | str
    unit: str | None = None
    settling: float = 0.0

    @classmethod
    def from_estimator(
        cls,
        search: Any,
        run: Any = None,
        window: tuple[float, float] | None = None,
        steps: Sequence[int] | None = None,
        *,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the steps of a search.

        Parameters
        ----------
        search : fitted EffectSearchCV
            The search.
        run : run label or None, default=None
            The run to show. None takes the one in which the effects help most.
        window : (float, float) or None, default=None
            Begin and end in seconds of time in the run. None takes the 15 s in which the effects
            help most.
        steps : sequence of int or None, default=None
            Steps to show: 0 is the baseline, 1 the model with the first effect. None takes the
            baseline and the last.
        ax : sequence of two Axes or None, default=None
            Where to draw, see :meth:`plot`. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : EffectStepsDisplay
        """
        taken = attributes_of(search, TAKEN, cls.__name__)
        # Simulations start from rest, and scores leave out what that takes.
        model = getattr(search, "best_estimator_", None)
        settling = getattr(as_fitted(model), "settling", 0.0)
        display = cls(unit=unit_of(taken["predictions"]), settling=settling, **taken)
        return display.plot(ax, run=run, window=window, steps=steps, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        run: Any = None,
        window: tuple[float, float] | None = None,
        steps: Sequence[int] | None = None,
        measured_kw: dict[str, Any] | None = None,
        simulated_kw: dict[str, Any] | None = None,
        residual_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of two Axes or None, default=None
            Where to draw output and residual. None makes a figure.
        run : run label or None, default=None
            As of :meth:`from_estimator`.
        window : (float, float) or None, default=None
            As of :meth:`from_estimator`.
        steps : sequence of int or None, default=None
            As of :meth:`from_estimator`.
        measured_kw : dict or None, default=None
            Keywords of matplotlib for the measured output.
        simulated_kw : dict or None, default=None
            Keywords of matplotlib for the simulated outputs.
        residual_kw : dict or None, default=None
            Keywords of matplotlib for the residuals.

        Returns
        -------
        self : EffectStepsDisplay

        Raises
        ------
        ValueError
            If there is no such run or step, or the run has no rows in the window.
        """
        self.axes_ = self._take_axes(
            ax,
            "output and residual",
            (2, 1),
            sharex=True,
            figsize=(7.2, 4.8),
            height_ratios=[1.6, 1.0],
        )
        if self._own:  # of a narrow one, the legend takes three rows
            letter = mpl.rcParams["font.size"] / 10.0
            self.figure_.set_figheight(max(self.figure_.get_figheight(), LEAST_HEIGHT * letter))
        self.lines_: dict[str, Any] = {}
        self.residuals_: dict[str, Any] = {}
        names = [name for name in self.predictions if name != "measured"]
        shown = _shown(names, steps)
        layout = read_layout(self.predictions)
        if not np.isfinite(self.predictions[shown].to_numpy(dtype=float)).any():
            for panel, what in zip(self.axes_, ("simulation", "residual"), strict=True):
                say_instead(panel, f"Held-out {what}: not available.")
            return self
        improvement = _improvement(self.predictions, shown)
        first = np.repeat(layout.starts[:-1], np.diff(layout.starts))
        improvement[layout.time - layout.time[first] < self.settling] = 0.0
        number, self.window_, chosen = _place(layout, improvement, run, window)
        self.run_ = run_name(layout.labels[number])
        begin, end = layout.run_starts[number], layout.run_starts[number + 1]
        inside = (layout.time >= self.window_[0]) & (layout.time <= self.window_[1])
        rows = np.flatnonzero(inside[begin:end]) + begin
        self._draw(layout, rows, shown)
        self._restyle(
            {"measured": measured_kw, "simulated": simulated_kw, "residual": residual_kw},
            measured=self.lines_["measured"],
            simulated=[line for name, line in self.lines_.items() if name != "measured"],
            residual=self.residuals_,
        )
        top, bottom = self.axes_
        title = wrapped(self._title_text(shown, chosen), letters_above(top))
        top.set_title(title, fontsize="medium")
        top.set_ylabel(with_unit("output", self.unit))
        bottom.set_ylabel(with_unit("residual", self.unit))
        bottom.set_xlabel(f"time in run {self.run_}, s")
        self._legend_of_panels()
        return self

    def _draw(self, layout: RunLayout, rows: np.ndarray, shown: list[str]) -> None:
        top, bottom = self.axes_
        vaf = self._vaf()
        # Lines break at gaps in the recording.
        gaps = np.flatnonzero(np.isin(rows[1:], layout.starts)) + 1
        time = np.insert(layout.time[rows], gaps, np.nan)
        table = self.predictions.iloc[rows]
        measured = table["measured"].to_numpy(dtype=float)
        (self.lines_["measured"],) = top.plot(
            time,
            np.insert(measured, gaps, np.nan),
            color=ROLES["measured"].colour,
            lw=scaled(1.2),
            label="measured",
        )
        residual = ROLES["residual"]
        looks = zip(
            shown,
            step_colours(len(shown), ROLES["simulated"].colour),
            step_colours(len(shown), residual.colour),
            strict=True,
        )
        labels = self._labels()
        for i, (name, blue, purple) in enumerate(looks):
            dashes = "--" if i < len(shown) - 1 else "-"
            simulated = table[name].to_numpy(dtype=float)
            known = f", VAF {percent(vaf[name])}" if np.isfinite(vaf.get(name, np.nan)) else ""
            (self.lines_[name],) = top.plot(
                time,
                np.insert(simulated, gaps, np.nan),
                color=blue,
                ls=dashes,
                lw=scaled(1.4),
                label=f"{ROLES['simulated'].word}, {labels.get(name, name)}{known}",
            )
            (self.residuals_[name],) = bottom.plot(
                time,
                np.insert(measured - simulated, gaps, np.nan),
                color=purple,
                ls=dashes,
                lw=scaled(1.1),
            )
        bottom.axhline(0.0, color=foreground(), lw=scaled(0.8), ls=":")
        for panel in self.axes_:
            panel.set_xlim(*self.window_)
            panel.grid(alpha=0.3)

    def _vaf(self) -> dict[str, float]:
        """Held-out VAF of each column of the predictions."""
        path = self.error_path[self.error_path["effect"] != UNKNOWN]
        names = [name for name in self.predictions if name != "measured"]
        return dict(zip(names, path["vaf"].astype(float), strict=False))

    def _labels(self) -> dict[str, str]:
        """What the model of each column of the predictions is called."""
        added = self.error_path.loc[self.error_path["effect"] != UNKNOWN, "effect"]
        names = [name for name in self.predictions if name != "measured"]
        return dict(zip(names, step_labels(added), strict=False))

    def _title_text(self, shown: list[str], chosen: bool) -> str:
        # No line ends within the span.
        span = f"run\xa0{self.run_}, {self.window_[0]:.4g}\xa0to\xa0{self.window_[1]:.4g}\xa0s"
        what = "the baseline is worst" if shown == [BASELINE] else "the effects help most"
        text = f"Where {what}: {span}" if chosen else f"{span[:1].upper()}{span[1:]}"
        return f"{text} ({self.verdict})" if shown == [BASELINE] else text


def _shown(names: list[str], steps: Sequence[int] | None) -> list[str]:
    """Columns of the steps to show."""
    if steps is None:
        return names if len(names) < 2 else [names[0], names[-1]]
    wrong = [step for step in steps if not 0 <= step < len(names)]
    if wrong or not len(steps):
        raise ValueError(
            f"steps must be some of 0 to {len(names) - 1} ({', '.join(names)}); got {steps!r}."
        )
    return [names[step] for step in steps]


def _improvement(predictions: pd.DataFrame, shown: list[str]) -> np.ndarray:
    """By how much the square of the residual falls, or what it is where there is one step."""
    measured = predictions["measured"].to_numpy(dtype=float)
    squares = [(measured - predictions[name].to_numpy(dtype=float)) ** 2 for name in shown]
    gain = squares[0] - squares[-1] if len(squares) > 1 else squares[0]
    return np.nan_to_num(gain)


def _place(
    layout: RunLayout, improvement: np.ndarray, run: Any, window: tuple[float, float] | None
) -> tuple[int, tuple[float, float], bool]:
    """Number of the run and the window to show, and whether they were chosen here."""
    numbers = range(len(layout.labels))
    if run is not None:
        names = [run_name(label) for label in layout.labels]
        if run in layout.labels:
            numbers = range(layout.labels.index(run), layout.labels.index(run) + 1)
        elif str(run) in names:
            numbers = range(names.index(str(run)), names.index(str(run)) + 1)
        else:
            raise ValueError(f"There is no run {run!r}; there are {', '.join(names)}.")
    best: tuple[float, int, tuple[float, float]] | None = None
    for number in numbers:
        rows = slice(layout.run_starts[number], layout.run_starts[number + 1])
        time, gain = layout.time[rows], improvement[rows]
        if window is None:
            total, span = _best_window(time, gain)
        else:
            inside = (time >= window[0]) & (time <= window[1])
            if not inside.any():
                continue
            total, span = float(gain[inside].sum()), (float(window[0]), float(window[1]))
        if best is None or total > best[0]:
            best = total, number, span
    if best is None:
        raise ValueError(f"No row of the runs lies in the window {window!r} s of time in the run.")
    return best[1], best[2], window is None


def _best_window(time: np.ndarray, gain: np.ndarray) -> tuple[float, tuple[float, float]]:
    """The sum over, and the limits of, the 15 s in which most is gained."""
    total = np.r_[0.0, np.cumsum(gain)]
    after = np.searchsorted(time, time + SHOWN, side="right")
    last = max(1, int(np.searchsorted(time, time[-1] - SHOWN, side="right")))
    sums = (total[after] - total[:-1])[:last]
    begin = int(np.argmax(sums))
    return float(sums[begin]), (float(time[begin]), float(time[after[begin] - 1]))
