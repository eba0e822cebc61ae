"""Ranking of the effects tried in one step of a search, by the VAF gained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from ._axes import wrapped
from ._comparison import legend_below, say_instead
from ._display import Display
from ._effects import attributes_of
from ._roles import BLUE, ORANGE, SKY, background, dimmed, foreground, scaled

TAKEN = ("ranking_",)
ADDED, REFUSED = "added", "does not apply"
ROW = 0.235  # inches for each candidate
LEAST = 1.0  # points on the axis, so that small gains look small
FURTHEST_LEFT = 0.35  # of the largest gain; bars that lose more are cut
TEXT_ROOM = 0.5  # of the width, for the text at the ends of the bars
LOOP_ROOM = 0.85  # where it has the points in the closed loop too
BELOW_TICKS = 3.6


@dataclass(kw_only=True, eq=False, repr=False)
class EffectRankingDisplay(Display):
    """Candidates of one step of a search by what they gain on held-out runs.

    Bars are VAF points on runs that were held out of the fit; at their ends these points, those in
    the closed loop where it was asked, and by how much BIC is better. The shaded band is the margin
    from the best to the second. Candidates that these data cannot tell apart from the best are
    hatched; those that do not apply are grey, with the reason.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    ranking : DataFrame
        ``ranking_`` of the search, of one step.
    step : int
        The step.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    figure_ : Figure
        The figure that holds it.
    bars_ : dict of Rectangle
        The bars by effect, best first.
    words_ : dict of Text
        What stands at the ends of the bars, or the reason why one does not apply, by effect.
    margin_ : float
        VAF points from the best to the second; NaN where there is no second.
    confused_ : list of str
        Candidates of the step that cannot be told apart from the best.

    See Also
    --------
    ErrorPathDisplay : The error at each step.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting import EffectRankingDisplay
    >>> ranking = pd.DataFrame(
    ...     {
    ...         "effect": ["dead_zone", "cubic_gain", "preview"],
    ...         "form": ["gap", "cubic", ""],
    ...         "vaf_gain": [10.7, 7.2, float("nan")],
    ...         "delta_bic": [912.0, 610.0, float("nan")],
    ...         "confused_with": [[], [], []],
    ...         "status": ["added", "not better", "does not apply"],
    ...         "reason": ["", "", "X has no target"],
    ...     }
    ... )
    >>> display = EffectRankingDisplay(ranking=ranking, step=1).plot()
    >>> round(display.margin_, 1)
    3.5
    """

    ranking: pd.DataFrame
    step: int

    @classmethod
    def from_estimator(
        cls, search: Any, step: int = 1, *, n_candidates: int | None = None, ax: Any = None
    ) -> Self:
        """Draw one step of a search.

        Parameters
        ----------
        search : fitted EffectSearchCV
            The search.
        step : int, default=1
            The step, from 1 on.
        n_candidates : int or None, default=None
            Draw so many of the best, and none that do not apply. None draws all.
        ax : Axes or None, default=None
            Where to draw. None makes a figure.

        Returns
        -------
        display : EffectRankingDisplay

        Raises
        ------
        ValueError
            If the search has no such step.
        """
        ranking = attributes_of(search, TAKEN, cls.__name__)["ranking"]
        steps = sorted(set(ranking["step"]))
        if len(ranking) and step not in steps:
            raise ValueError(
                f"This search has the steps {', '.join(map(str, steps))}; got step={step!r}."
            )
        of_step = ranking[ranking["step"] == step]
        if n_candidates is not None:
            of_step = of_step[of_step["status"] != REFUSED].head(n_candidates)
        return cls(ranking=of_step, step=step).plot(ax)

    def plot(self, ax: Any = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.

        Returns
        -------
        self : EffectRankingDisplay
        """
        refused = (self.ranking["status"] == REFUSED).to_numpy()
        table = pd.concat([self.ranking[~refused], self.ranking[refused]])
        size = 7.6, max(2.6, 1.5 + ROW * len(table))
        (self.ax_,) = self._take_axes(ax, "the bars", figsize=size)
        self.bars_: dict[str, Any] = {}
        self.words_: dict[str, Any] = {}
        self.margin_ = np.nan
        self.confused_: list[str] = []
        tried = table[table["status"] != REFUSED]
        if not table.empty:
            self._draw_bars(tried)
            self._draw_refused(table[table["status"] == REFUSED], len(tried))
            self._finish(table)
        else:
            say_instead(self.ax_, f"No candidate was tried in step {self.step}.")
        self.ax_.set_title(wrapped(self._title_text(tried), 84), fontsize="medium")
        return self

    def _draw_bars(self, tried: pd.DataFrame) -> None:
        if tried.empty:
            self.ax_.set_xlim(0.0, 1.0)
            return
        gain = _finite(tried["vaf_gain"])
        best = tried.iloc[0]
        self.confused_ = [name for name in best["confused_with"] if name in set(tried["effect"])]
        largest = max(float(np.nanmax(gain, initial=0.0)), LEAST)
        least = float(np.nanmin(gain, initial=0.0))
        left = max(least, -FURTHEST_LEFT * largest)
        in_loop = "gain_loop" in tried and np.isfinite(_finite(tried["gain_loop"])).any()
        width = (largest - left) * (1 + (LOOP_ROOM if in_loop else TEXT_ROOM))
        self.ax_.set_xlim(left - 0.02 * width * (left < 0), left + width)
        for i, row in enumerate(tried.to_dict("records")):
            self._draw_bar(i, row, left)
        if len(tried) > 1:
            self.margin_ = float(gain[0] - gain[1])
            if self.margin_ > 0 and best["status"] == ADDED:
                self.ax_.axvspan(gain[1], gain[0], color=foreground(), alpha=0.08, lw=0, zorder=0)

    def _draw_bar(self, i: int, row: dict[str, Any], left: float) -> None:
        name, gain = row["effect"], float(_finite(row["vaf_gain"]))
        confused = name in self.confused_
        colour, label = SKY, "not added"
        if row["status"] == ADDED:
            colour, label = BLUE, "added"
        elif confused:
            colour, label = ORANGE, "cannot be told apart from the best here"
        (self.bars_[name],) = self.ax_.barh(
            i,
            np.nan_to_num(gain),
            height=0.72,
            color=colour,
            hatch="////" if confused else None,
            edgecolor=background(),
            lw=0.0,
            label=label,
        )
        bic = float(row["delta_bic"])
        parts = [f"{round(gain, 1) + 0.0:+.1f}"] if np.isfinite(gain) else []  # no -0.0
        in_loop = float(row.get("gain_loop", np.nan))
        parts += [f"in the loop {round(in_loop, 1) + 0.0:+.1f}"] if np.isfinite(in_loop) else []
        parts += [f"ΔBIC {round(bic) + 0.0:+.0f}"] if np.isfinite(bic) else []
        cut = " (cut)" if gain < left else ""
        self.words_[name] = self.ax_.annotate(
            ", ".join(parts).replace("-", "−") + cut,
            (max(np.nan_to_num(gain), 0.0), i),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize="small",
        )

    def _draw_refused(self, refused: pd.DataFrame, first: int) -> None:
        for i, row in enumerate(refused.to_dict("records")):
            self.words_[row["effect"]] = self.ax_.annotate(
                _shortened(row["reason"], 84),
                (max(self.ax_.get_xlim()[0], 0.0), first + i),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize="x-small",
                color=dimmed(0.55),
            )

    def _finish(self, table: pd.DataFrame) -> None:
        panel: Axes = self.ax_
        panel.axvline(0.0, color=foreground(), lw=scaled(0.8))
        labels = [
            f"{name} ({form})" if isinstance(form, str) and form else name
            for name, form in zip(table["effect"], table["form"], strict=True)
        ]
        panel.set_yticks(range(len(table)), labels, fontsize="small")
        for tick, status in zip(panel.get_yticklabels(), table["status"], strict=True):
            tick.set_color(dimmed(0.55) if status == REFUSED else foreground())
            tick.set_fontweight("bold" if status == ADDED else "normal")
        panel.set_ylim(len(table) - 0.4, -0.6)
        panel.set_xlabel("VAF gained on held-out runs, points (ΔBIC: positive is better)")
        panel.grid(alpha=0.3, axis="x")
        panel.set_axisbelow(True)
        if self.bars_:
            legend_below(panel, 3, BELOW_TICKS)

    def _title_text(self, tried: pd.DataFrame) -> str:
        added = tried[tried["status"] == ADDED]
        if tried.empty:
            return f"Step {self.step}: no candidate applies"
        if added.empty:
            return f"Step {self.step}: no candidate is better by more than chance"
        title = f"Step {self.step}: {added['effect'].iloc[0]} is added"
        if np.isfinite(self.margin_):
            second = tried["effect"].iloc[1]
            bic = tried["delta_bic"].to_numpy(dtype=float)
            points = f"{self.margin_:.1f} points and " if self.margin_ > 0.05 else ""
            lead = bic[0] - bic[1]
            if lead < 0:  # the second gains too little on held-out runs, or is less plain
                title += f", though {second} is {-lead:.0f} better in BIC"
            else:
                title += f", {points}{lead:.0f} in BIC before {second}"
            if second in self.confused_:
                title += ", which these data cannot tell apart"
        return title


def _finite(values: Any) -> np.ndarray:
    """Gains, NaN where a candidate has none."""
    values = np.asarray(values, dtype=float)
    return np.where(np.isfinite(values), values, np.nan)


def _shortened(text: str, letters: int) -> str:
    return text if len(text) <= letters else f"{text[: letters - 1].rstrip()}…"
