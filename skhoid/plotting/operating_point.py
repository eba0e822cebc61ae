"""Where in amplitude the model fails: mean residual over the level of a channel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ._axes import letters_above, letters_across, with_unit, wrapped
from ._comparison import (
    CLOSED_LOOP,
    ComparisonBaseDisplay,
    beyond,
    chance,
    channel_name,
    exceeding,
    residual_label,
    say_instead,
)
from ._layout import figure_size
from ._roles import GREY, ROLES, dimmed, scaled, sized

COLUMNS = 3
LEAST_ROW = 1.95  # inches of a row of panels, of a font of 10 points
LETTERS = 28  # across a panel with its label, at least


@dataclass(kw_only=True, eq=False, repr=False)
class OperatingPointDisplay(ComparisonBaseDisplay):
    """Mean residual over the level of each channel.

    Each panel bins one channel, so much earlier than the residual as its label says. The grey
    band holds all means of a panel with probability 1 - ``false_alarm`` if the residual does not
    depend on the channel; means outside it have the colour of misfit. What cannot be tested in a
    closed loop is grey. A slope is a wrong gain, a bend at zero an asymmetry or a dead zone, a bend
    at the ends a limit. The levels of the output are those simulated; a level at which the measured
    one is held, such as that of a stop, is a dashed line among them.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    by_operating_point : DataFrame
        ``Comparison.by_operating_point``.
    unit : str or None, default=None
        Unit of the output.
    false_alarm : float, default=0.01
        Of the bands.
    tests : DataFrame or None, default=None
        ``Comparison.tests``: the levels held (test ``"level"``) that exceed chance are marked.
    output : str, default="u"
        Name of the output.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_channels,)
        The panels.
    figure_ : Figure
        The figure that holds them.
    lines_ : dict of Line2D
        Mean residual by channel.
    bands_ : dict of FillBetweenPolyCollection
        Bands by channel.
    levels_ : dict {str: list of float}
        Levels marked, by channel.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import OperatingPointDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=3, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> display = OperatingPointDisplay.from_comparison(compare(model, X, y))
    >>> display.axes_[0].get_ylabel()
    'mean residual, deg'
    """

    by_operating_point: pd.DataFrame
    unit: str | None = None
    false_alarm: float = 0.01
    tests: pd.DataFrame | None = None
    output: str = "u"

    def plot(
        self,
        ax: Any = None,
        *,
        residual_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of Axes or None, default=None
            As many as there are channels, one if there are none. None makes a figure.
        residual_kw : dict or None, default=None
            Keywords of matplotlib for the mean residuals.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the bands.

        Returns
        -------
        self : OperatingPointDisplay
        """
        tables = dict(list(self.by_operating_point.groupby("channel", sort=False)))
        n = max(len(tables), 1)
        columns = min(n, COLUMNS)
        width, _ = figure_size((max(4.2, 0.8 + 2.6 * columns), 1.0), 1)
        columns = min(columns, max(letters_across(width) // LETTERS, 1))
        rows = math.ceil(n / columns)
        self.axes_ = self._take_axes(
            ax,
            "one for each channel",
            (rows, columns),
            used=range(n),
            sharey=True,
            figsize=(max(4.2, 0.8 + 2.6 * columns), 0.9 + 2.3 * rows),
        )
        if self._own:  # labels of two lines, and one beside each row
            letter = mpl.rcParams["font.size"] / 10.0
            height = max(self.figure_.get_figheight(), letter * (0.6 + LEAST_ROW * rows))
            self.figure_.set_figheight(height)
        self.lines_: dict[str, Any] = {}
        self.bands_: dict[str, Any] = {}
        self.levels_: dict[str, list[float]] = {}
        if not tables:
            say_instead(self.axes_[0], "Mean residual over levels: not available.")
            return self
        units = self.by_operating_point.attrs.get("units", {})
        for i, (panel, (name, bins)) in enumerate(zip(self.axes_, tables.items(), strict=True)):
            self.lines_[name], self.bands_[name] = draw_bins(
                panel, bins, self.false_alarm, self.output, units.get(name)
            )
            self._mark_levels(panel, name)
            if not self._own or i % columns == 0:
                panel.set_ylabel(residual_label(self.unit))
        self._restyle(
            {"residual": residual_kw, "band": band_kw}, residual=self.lines_, band=self.bands_
        )
        self._legend_of_panels()
        return self

    def _mark_levels(self, panel: Axes, name: str) -> None:
        """Where the signal sticks or clips, if it does."""
        if self.tests is None:
            return
        held = self.tests[self.tests["test"].eq("level") & exceeding(self.tests)]
        levels = held.loc[held["signal"].eq(name), "where"].dropna().tolist()
        for level in levels:
            panel.axvline(
                level,
                color=ROLES["misfit"].colour,
                ls="--",
                lw=scaled(1.0),
                label="level held, measured",
            )
        if levels:
            self.levels_[name] = levels


def draw_bins(
    panel: Axes, bins: pd.DataFrame, false_alarm: float, output: str, unit: str | None
) -> tuple[Any, Any]:
    """Mean residual in the bins of one channel, and the band of chance around zero."""
    bins = bins.sort_values("center")
    at, mean, half = (bins[name].to_numpy(dtype=float) for name in ("center", "mean", "band"))
    band = panel.fill_between(
        at, -half, half, color=GREY, alpha=0.35, lw=0, label=chance(false_alarm)
    )
    panel.axhline(0.0, color=GREY, lw=scaled(0.8))
    valid = bool(bins["valid"].all())
    (line,) = panel.plot(
        at,
        mean,
        color=ROLES["residual"].colour if valid else dimmed(0.55),
        marker="o",
        ms=sized(3.5),
        lw=scaled(1.2),
        label="residual" if valid else CLOSED_LOOP,
    )
    raised = exceeding(bins)
    if valid and raised.any():
        panel.plot(
            at[raised],
            mean[raised],
            color=ROLES["misfit"].colour,
            marker="o",
            ms=sized(5.5),
            ls="none",
            label=beyond(false_alarm),
            zorder=3,
        )
    panel.set_xlabel(wrapped(_label(bins, output, unit), letters_above(panel)))
    panel.xaxis.set_major_locator(MaxNLocator(4))
    if not valid:
        panel.set_title(CLOSED_LOOP, fontsize="small", color=dimmed())
    panel.grid(alpha=0.3)
    return line, band


def _label(bins: pd.DataFrame, output: str, unit: str | None) -> str:
    channel, lag = bins["channel"].iloc[0], float(bins["lag"].iloc[0])
    name = channel_name(channel)
    if channel in (output, f"{output} rate"):
        # Not the measured one, which holds the residual itself.
        name = f"simulated {channel}"
    late = f" {lag:.2f} s earlier" if lag > 0 else ""
    return with_unit(f"{name}{late}", unit)
