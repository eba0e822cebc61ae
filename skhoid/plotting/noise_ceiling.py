"""Noise ceiling: the output as explained, misfit and remnant, in one bar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from ._axes import letters, letters_above, wrapped
from ._comparison import ComparisonBaseDisplay, percent
from ._layout import add_lines
from ._roles import ROLES, dimmed, foreground, readable_on, scaled

SMALL = 1.2  # letters of the small size to one of the medium size
FROM_THE_TOP = 1.15  # top of the panel; the bar ends at 0.4, the text about the ceiling is above


@dataclass(kw_only=True, eq=False, repr=False)
class NoiseCeilingDisplay(ComparisonBaseDisplay):
    """The measured output as a bar: explained, misfit and remnant.

    The first part is what the model explains (its VAF), the second what a better model could
    explain beyond it (up to the noise ceiling, a dotted line with its 95 % interval), the third
    what no model driven by the measured error can. Without a ceiling the bar has two parts, and
    the figure says why. A VAF below zero leaves nothing of the first.

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
    texts_ : list of Text
        What is written in and above the bar.
    ceiling_ : Line2D or None
        The ceiling.
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
    ['explained', 'misfit', 'remnant']
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
        (self.ax_,) = self._take_axes(ax, "the bar", figsize=(6.4, 2.2))
        source = self.ceiling_note
        if np.isfinite(self.noise_ceiling):
            source = f"noise ceiling {source}"
        note = wrapped(source[:1].upper() + source[1:], letters(self.figure_))
        if self._own:
            add_lines(self.figure_, note.count("\n") + 2, mpl.rcParams["font.size"])
        bar = draw_ceiling_bar(self.ax_, self, note=note if self.ceiling_note else "")
        self.parts_, self.texts_ = bar.parts, bar.texts
        self.ceiling_, self.interval_ = bar.ceiling, bar.interval
        self._restyle({"bar": bar_kw}, bar=self.parts_)
        self.ax_.set_title(ceiling_text(self), fontsize="medium")
        return self


def ceiling_text(comparison: Any) -> str:
    """VAF and ceiling, for a title; of a comparison or whatever has its attributes."""
    found = f"VAF {percent(comparison.vaf)}"
    if np.isnan(comparison.noise_ceiling):
        return f"{found}, noise ceiling not known"
    gap = comparison.explainable_gap
    left = f"{gap:.1f} points left to explain" if gap > 0 else "nothing left to explain"
    return f"{found}, noise ceiling {percent(comparison.noise_ceiling)}: {left}"


@dataclass(frozen=True)
class CeilingBar:
    """What is drawn: the parts of the bar by name, texts, the ceiling and its interval."""

    parts: dict[str, Any]
    texts: list[Any]
    ceiling: Any = None
    interval: Any = None


def draw_ceiling_bar(panel: Axes, comparison: Any, note: str = "") -> CeilingBar:
    """The bar, its parts named in it, or below the panel where they are too small for that."""
    panel.set_xlim(0.0, 100.0)
    panel.set_ylim(-0.5, FROM_THE_TOP)
    panel.set_yticks([])
    panel.xaxis.set_major_formatter("{x:g} %")
    for side in ("left", "right", "top"):
        panel.spines[side].set_visible(False)
    parts, texts, small = {}, [], []
    room = letters_above(panel) / 100.0
    for name, colour, low, high, size in _spans(comparison):
        (parts[name],) = panel.barh(0, high - low, left=low, height=0.8, color=colour)
        if max(len(name), len(size)) + 1 > room * (high - low):
            small += [f"{name} {size}"] if size else []
            continue
        texts.append(
            panel.text(
                (low + high) / 2,
                0,
                f"{name}\n{size}",
                ha="center",
                va="center",
                fontsize="small",
                color=readable_on(colour),
                bbox={"facecolor": colour, "edgecolor": "none", "pad": 0.0},
            )
        )
    ceiling, interval = _draw_ceiling(panel, comparison, texts)
    below = [", ".join(small)] if small else []
    panel.set_xlabel("\n".join([*below, note] if note else below), fontsize="small")
    return CeilingBar(parts, texts, ceiling, interval)


def _spans(comparison: Any) -> list[tuple[str, str, float, float, str]]:
    """Name, colour, begin and end in percent, and size in words, of each part of the bar."""
    ceiling, known = comparison.noise_ceiling, not np.isnan(comparison.noise_ceiling)
    # Where not all runs share their target, the ceiling and the gap are of those that do.
    left = max(comparison.explainable_gap, 0.0) if known else 0.0
    explained = ceiling - left if left > 0 else comparison.vaf
    end = float(np.clip(explained, 0.0, 100.0))
    size = percent(explained) + (": worse than no model" if explained < 0 else "")
    spans = [("explained", ROLES["simulated"].colour, 0.0, end, size)]
    if not known:
        rest = percent(100.0 - explained)
        return [*spans, ("not explained", dimmed(0.15), end, 100.0, rest)]
    top = float(np.clip(ceiling, end, 100.0))
    gap = f"{left:.1f} points" if left >= 0.05 else ""
    remnant = percent(max(100.0 - ceiling, 0.0))
    return [
        *spans,
        ("misfit", ROLES["misfit"].colour, end, top, gap),
        ("remnant", ROLES["remnant"].colour, top, 100.0, remnant),
    ]


def _draw_ceiling(panel: Axes, comparison: Any, texts: list[Any]) -> tuple[Any, Any]:
    """The ceiling as a line across the bar, named above it, and its interval."""
    ceiling = comparison.noise_ceiling
    if np.isnan(ceiling):
        texts.append(_above(panel, 100.0, "noise ceiling not known", foreground()))
        return None, None
    at, role = float(np.clip(ceiling, 0.0, 100.0)), ROLES["ceiling"]
    (line,) = panel.plot([at, at], [-0.5, 0.62], **role.style(2.4), solid_capstyle="butt", zorder=3)
    low, high = np.clip(comparison.noise_ceiling_interval, 0.0, 100.0)
    text, interval = f"{role.word} {percent(ceiling)}", None
    if np.isfinite([low, high]).all():
        text += f" (95 % interval {low:.1f} to {high:.1f} %)"
        inside = float(np.clip(at, low, high))
        interval = panel.errorbar(
            inside,
            0.52,
            xerr=[[inside - low], [high - inside]],
            color=foreground(),
            lw=scaled(1.4),
            capsize=3,
            capthick=scaled(1.4),
        )
    texts.append(_above(panel, at, text, foreground()))
    return line, interval


def _above(panel: Axes, at: float, text: str, colour: str) -> Any:
    """Text above the bar, on that side of ``at`` where there is more room."""
    left = at > 50.0
    # From the edge of the panel where the text is longer than the room to that side.
    room = SMALL * letters_above(panel) * (at if left else 100.0 - at) / 100.0
    if len(text) > room:
        at = 100.0 if left else 0.0
    return panel.text(
        at,
        0.68,
        text,
        ha="right" if left else "left",
        va="bottom",
        fontsize="small",
        color=colour,
    )
