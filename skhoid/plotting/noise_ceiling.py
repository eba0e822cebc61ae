"""Noise ceiling: the output as explained, explainable and remnant, in one bar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from ._axes import letters, wrapped
from ._comparison import ComparisonBaseDisplay, legend_below, percent
from ._layout import add_lines
from ._roles import ROLES, dimmed, foreground, scaled

INTERVAL = "95 % interval of the ceiling"
BELOW_TICKS = 2.4
NARROW = 60  # letters, in which two columns of the legend have no room


@dataclass(kw_only=True, eq=False, repr=False)
class NoiseCeilingDisplay(ComparisonBaseDisplay):
    """The measured output as a bar: explained, explainable and remnant.

    Blue is what the model explains (its VAF), vermilion what a better model could explain beyond it
    (up to the noise ceiling), grey what no model driven by the measured error can. Without a
    ceiling the bar has two parts, and the figure says why. A VAF below zero leaves no blue.

    Make it with :meth:`from_comparison` or :meth:`from_estimator`.

    Parameters
    ----------
    vaf : float
        Free-run VAF of the model in percent.
    noise_ceiling : float
        The highest VAF that a model can reach, in percent; NaN if it is not known.
    noise_ceiling_interval : (float, float)
        Its 95 % interval.
    explainable_gap : float
        VAF points up to the ceiling, of the runs for which it is known.
    ceiling_note : str, default=""
        Where the ceiling comes from, or why there is none.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    figure_ : Figure
        The figure that holds it.
    parts_ : dict of Rectangle
        The parts of the bar by name.
    interval_ : ErrorbarContainer or None
        The interval of the ceiling.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> from skhoid.plotting import NoiseCeilingDisplay
    >>> X, y = make_tracking_runs(
    ...     "C1", n_runs=5, remnant_intensity=0.15, channels=["e", "f_t"], random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(X, y)
    >>> display = NoiseCeilingDisplay.from_comparison(compare(model, X, y))
    >>> list(display.parts_)
    ['explained', 'explainable', 'remnant']
    """

    vaf: float
    noise_ceiling: float
    noise_ceiling_interval: tuple[float, float]
    explainable_gap: float
    ceiling_note: str = ""

    def plot(self, ax: Any = None, *, bar_kw: dict[str, Any] | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        bar_kw : dict or None, default=None
            Keywords of matplotlib for the parts of the bar.

        Returns
        -------
        self : NoiseCeilingDisplay
        """
        styles = {"bar": bar_kw}
        (self.ax_,) = self._take_axes(ax, "the bar", figsize=(6.4, 2.4))
        across = letters(self.figure_)
        columns = 2 if across > NARROW else 1
        note = wrapped(f"Noise ceiling {self.ceiling_note}", across)
        self.parts_, self.interval_ = draw_ceiling_bar(self.ax_, self, columns=columns, note=note)
        self._restyle(styles, bar=self.parts_)
        if self._own:
            rows = -(-(len(self.parts_) + 1) // columns) + note.count("\n") - 2
            add_lines(self.figure_, rows + 1, mpl.rcParams["font.size"])
        self.ax_.set_title(ceiling_text(self), fontsize="medium")
        return self


def ceiling_text(comparison: Any) -> str:
    """VAF and ceiling, for a title; of a comparison or whatever has its attributes."""
    found = f"VAF {percent(comparison.vaf)}"
    if np.isnan(comparison.noise_ceiling):
        return f"{found}, noise ceiling not available"
    gap = comparison.explainable_gap
    left = f"{gap:.1f} points left to explain" if gap > 0 else "nothing left to explain"
    return f"{found}, noise ceiling {percent(comparison.noise_ceiling)}: {left}"


def draw_ceiling_bar(
    panel: Axes, comparison: Any, columns: int, note: str = ""
) -> tuple[dict[str, Any], Any]:
    """The bar, its interval, and a legend below that names the parts and their sizes."""
    ceiling = comparison.noise_ceiling
    known = not np.isnan(ceiling)
    # Where not all runs share their target, the ceiling and the gap are of those that do.
    left = max(comparison.explainable_gap, 0.0) if known else 0.0
    explained = ceiling - left if left > 0 else comparison.vaf
    end = float(np.clip(explained, 0.0, 100.0))
    worse = ": worse than no model" if explained < 0 else ""
    spans = {
        "explained": (ROLES["simulated"].colour, 0.0, end, f"explained {percent(explained)}{worse}")
    }
    if known:
        top = float(np.clip(ceiling, end, 100.0))
        gap = f"explainable {left:.1f} points" if left >= 0.05 else "nothing left to explain"
        spans["explainable"] = (ROLES["misfit"].colour, end, top, gap)
        spans["remnant"] = (
            ROLES["remnant"].colour,
            top,
            100.0,
            f"remnant {percent(100.0 - ceiling)}",
        )
    else:
        rest = f"not explained {percent(100.0 - explained)}: no ceiling"
        spans["not explained"] = (dimmed(0.15), end, 100.0, rest)
    parts = {}
    for name, (colour, low, high, label) in spans.items():
        (parts[name],) = panel.barh(0, high - low, left=low, height=0.8, color=colour, label=label)
    low, high = np.clip(comparison.noise_ceiling_interval, 0.0, 100.0)
    interval = None
    if known and np.isfinite([low, high]).all():
        at = float(np.clip(ceiling, low, high))
        interval = panel.errorbar(
            at,
            0,
            xerr=[[at - low], [high - at]],
            color=foreground(),
            lw=scaled(1.6),
            capsize=5,
            capthick=scaled(1.6),
            label=INTERVAL,
        )
    panel.set_xlim(0.0, 100.0)
    panel.set_ylim(-0.5, 0.5)
    panel.set_yticks([])
    panel.xaxis.set_major_formatter("{x:g} %")
    legend_below(panel, columns, BELOW_TICKS, title=note or None, title_fontsize="small")
    return parts, interval
