"""Residual power over time and frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from ._axes import plain_logarithmic
from ._comparison import ComparisonBaseDisplay, beyond, say_instead
from ._roles import background, foreground, scaled, sized

LEAST = 6.0  # dB; chance alone does not use the whole scale
MOST = 20.0
SHOWN = 99.0  # percentile that the scale holds


@dataclass(kw_only=True, eq=False, repr=False)
class ResidualMapDisplay(ComparisonBaseDisplay):
    """Power of the residual over time and frequency, relative to the remnant of the frequency.

    White is the mean remnant, red is more, blue less. Dots mark cells with more than chance gives
    any cell of the map if the remnant does not change in time: a column of red and dots at all
    frequencies is remnant that grows, red and dots at some frequencies are misfit.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    time_frequency : DataFrame
        ``Comparison.time_frequency``: ratios, times in s as the index and frequencies in rad/s as
        the columns; ``attrs["limit"]``, a ratio for each frequency, is what cells must exceed.
    false_alarm : float, default=0.01
        Rate of false alarms of what is marked.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    figure_ : Figure
        The figure that holds it.
    mesh_ : QuadMesh or None
        The ratio in dB.
    colorbar_ : Colorbar or None
        Its scale.
    exceeding_ : Line2D or None
        The dots.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import ResidualMapDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=3, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> display = ResidualMapDisplay.from_comparison(compare(model, X, y))
    >>> display.ax_.get_yscale()
    'log'
    """

    time_frequency: pd.DataFrame
    false_alarm: float = 0.01

    def plot(self, ax: Any = None, *, mesh_kw: dict[str, Any] | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        mesh_kw : dict or None, default=None
            Keywords of matplotlib for the map.

        Returns
        -------
        self : ResidualMapDisplay
        """
        styles = {"mesh": mesh_kw}
        (self.ax_,) = self._take_axes(ax, "the map", figsize=(6.4, 4.2))
        self.mesh_: Any = None
        self.colorbar_: Any = None
        self.exceeding_: Any = None
        omega = self.time_frequency.columns.to_numpy(dtype=float)
        time = self.time_frequency.index.to_numpy(dtype=float)
        ratio = self.time_frequency.to_numpy(dtype=float)[:, omega > 0]
        limit = np.broadcast_to(self.time_frequency.attrs.get("limit", np.inf), omega.shape)
        cells = np.argwhere(ratio > limit[omega > 0])
        omega = omega[omega > 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            level = np.ma.masked_invalid(10 * np.log10(ratio))
        if min(ratio.shape) < 2 or level.count() == 0:
            say_instead(self.ax_, "Time and frequency: not available, no run is long enough.")
            return self
        highest = float(np.percentile(np.abs(level.compressed()), SHOWN))
        end = float(np.clip(np.ceil(highest), LEAST, MOST))
        self.mesh_ = self.ax_.pcolormesh(
            _edges(time),
            np.exp(_edges(np.log(omega))),
            level.T,
            cmap="RdBu_r",
            vmin=-end,
            vmax=end,
            rasterized=True,
        )
        if len(cells):
            (self.exceeding_,) = self.ax_.plot(
                time[cells[:, 0]],
                omega[cells[:, 1]],
                marker="o",
                ms=sized(3.0),
                ls="none",
                # On cells of any colour, in any style.
                color=background(),
                markeredgecolor=foreground(),
                markeredgewidth=scaled(0.8),
                label=beyond(self.false_alarm),
            )
        self._restyle(styles, mesh=self.mesh_)
        self._legend_of_panels()
        self.ax_.set_yscale("log")
        plain_logarithmic(self.ax_.yaxis)
        self.ax_.set_xlabel("time in the run, s")
        self.ax_.set_ylabel("frequency, rad/s")
        self.colorbar_ = self.figure_.colorbar(
            self.mesh_, ax=self.ax_, label="residual / remnant, dB", extend="both"
        )
        return self


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges of cells halfway between their centres."""
    half = np.diff(centres) / 2
    return np.concatenate([[centres[0] - half[0]], centres[:-1] + half, [centres[-1] + half[-1]]])
