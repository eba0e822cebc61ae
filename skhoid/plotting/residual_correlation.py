"""Which signals the residual follows: its correlation with each of them over the lag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ._comparison import (
    CLOSED_LOOP,
    ComparisonBaseDisplay,
    beyond,
    chance,
    channel_name,
    say_instead,
)
from ._roles import GREY, ROLES, dimmed, foreground, scaled, sized


@dataclass(kw_only=True, eq=False, repr=False)
class ResidualCorrelationDisplay(ComparisonBaseDisplay):
    """Correlation of the residual with signals, over the lag.

    At positive lags the residual follows the signal. The band holds a whole curve with probability
    1 - ``false_alarm`` if the residual has nothing to do with the signal; what is outside it is
    vermilion. Signals inside the loop, which the remnant enters, are grey: even the exact model's
    residual correlates with them.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    correlations : DataFrame
        ``Comparison.correlations``.
    false_alarm : float, default=0.01
        Of the bands.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_signals,)
        The panels.
    figure_ : Figure
        The figure that holds them.
    lines_ : dict of Line2D
        Correlation by signal.
    bands_ : dict of FillBetweenPolyCollection
        Bands by signal.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import ResidualCorrelationDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=3, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> display = ResidualCorrelationDisplay.from_comparison(compare(model, X, y))
    >>> list(display.lines_)
    ['f_t', 'e']
    """

    correlations: pd.DataFrame
    false_alarm: float = 0.01

    def plot(
        self,
        ax: Any = None,
        *,
        residual_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        misfit_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of Axes or None, default=None
            As many as there are signals, one if there are none. None makes a figure.
        residual_kw : dict or None, default=None
            Keywords of matplotlib for the correlation.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the band of chance.
        misfit_kw : dict or None, default=None
            Keywords of matplotlib for the marks of what exceeds chance.

        Returns
        -------
        self : ResidualCorrelationDisplay
        """
        styles = {"residual": residual_kw, "band": band_kw, "misfit": misfit_kw}
        tests_first = self.correlations.sort_values("valid", ascending=False, kind="stable")
        tables = dict(list(tests_first.groupby("signal", sort=False)))
        n = max(len(tables), 1)
        size = (6.4, 1.3 + 1.6 * n)
        self.axes_ = self._take_axes(ax, "one for each signal", (n, 1), figsize=size)
        self.lines_: dict[str, Any] = {}
        self.bands_: dict[str, Any] = {}
        self.outside_: list[Any] = []
        if not tables:
            say_instead(self.axes_[0], "Correlation with other signals: not available.")
            return self
        for panel, (name, table) in zip(self.axes_, tables.items(), strict=True):
            self._draw(panel, name, table)
        self.axes_[-1].set_xlabel("lag, s (positive: the residual follows)")
        self._restyle(styles, residual=self.lines_, band=self.bands_, misfit=self.outside_)
        self._legend_of_panels()
        return self

    def _draw(self, panel: Any, name: str, table: pd.DataFrame) -> None:
        table = table.sort_values("lag")
        lag, value, half = (
            table[column].to_numpy(dtype=float) for column in ("lag", "correlation", "band")
        )
        valid = bool(table["valid"].all())
        panel.axhline(0.0, color=foreground(), lw=scaled(0.6))
        panel.axvline(0.0, color=foreground(), lw=scaled(0.6))
        self.bands_[name] = panel.fill_between(
            lag,
            -half,
            half,
            color=GREY,
            alpha=0.3,
            lw=0,
            label=chance(self.false_alarm),
        )
        (self.lines_[name],) = panel.plot(
            lag,
            value,
            color=ROLES["residual"].colour if valid else GREY,
            lw=scaled(1.4),
            label="correlation with the residual" if valid else CLOSED_LOOP,
        )
        outside = np.abs(value) > half
        if valid and outside.any():
            self.outside_ += panel.plot(
                lag[outside],
                value[outside],
                color=ROLES["misfit"].colour,
                marker="o",
                ms=sized(3),
                ls="none",
                label=beyond(self.false_alarm),
            )
        panel.set_title(
            channel_name(name) + ("" if valid else f" ({CLOSED_LOOP})"),
            loc="left",
            fontsize="medium",
            color=foreground() if valid else dimmed(),
        )
        panel.set_xlim(lag[0], lag[-1])
        panel.set_ylabel("correlation")
        panel.grid(alpha=0.3)
