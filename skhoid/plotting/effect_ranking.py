"""Ranking of the effects tried in one step of a search, by the VAF gained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.offsetbox import AnnotationBbox, HPacker, TextArea

from ..effects.registry import title_of
from ..search import Status
from ._axes import letters, letters_above, wrapped
from ._comparison import say_instead
from ._display import Display
from ._effects import attributes_of
from ._roles import BLUE, ORANGE, background, dimmed, faded, foreground, scaled

TAKEN = ("ranking_",)
ROW = 0.235  # inches for each candidate
LEAST = 1.0  # points on the axis, so that small gains look small
FURTHEST_LEFT = 0.35  # of the largest gain; bars that lose more are cut
TEXT_ROOM = 0.22  # of the width, for the points at the ends of the bars
FADED = 0.45  # share of the colour in bars that are not added
NARROW = 66  # letters across a figure, below which forms are left out
COLUMNS = {"delta_bic": "ΔBIC", "gain_loop": "in closed\nloop, points"}
COLUMN = 7.5  # widths of a letter to the right edge of a column


@dataclass(kw_only=True, eq=False, repr=False)
class EffectRankingDisplay(Display):
    """Candidates of one step of a search by what they gain on held-out runs.

    Bars are VAF points on runs that were held out of the fit, with these points at their ends; bars
    of what was not added are faded. The columns beside them are ΔBIC (larger is better) and, where
    it was asked, the points gained in the closed loop. Candidates that these data cannot tell apart
    from the best are hatched; those that do not apply are grey, with the reason.

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
    title_ : Text
        What the step added, and by how much.
    bars_ : dict of Rectangle
        The bars by effect, best first.
    names_ : dict of AnnotationBbox
        Names of the candidates, with their forms, by effect.
    words_ : dict of Text
        Points at the ends of the bars, or the reason why one does not apply, by effect.
    columns_ : dict of dict of Text
        Values beside the bars by effect: ``"delta_bic"``, and ``"gain_loop"`` where it is known.
    margin_ : float
        VAF points from what was added (else the first) to the best other; NaN where there is none.
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
        cls,
        search: Any,
        step: int = 1,
        *,
        n_candidates: int | None = None,
        ax: Any = None,
        **styles: Any,
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
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

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
            of_step = of_step[of_step["status"] != Status.REFUSED].head(n_candidates)
        return cls(ranking=of_step, step=step).plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        bar_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        bar_kw : dict or None, default=None
            Keywords of matplotlib for the bars.

        Returns
        -------
        self : EffectRankingDisplay
        """
        refused = (self.ranking["status"] == Status.REFUSED).to_numpy()
        table = pd.concat([self.ranking[~refused], self.ranking[refused]])
        size = 7.2, max(2.6, 1.1 + ROW * len(table))
        (self.ax_,) = self._take_axes(ax, "the bars", figsize=size)
        if self._own:  # letters do not shrink with the figure
            letter = mpl.rcParams["font.size"] / 10.0
            height = max(self.figure_.get_figheight(), letter * (1.2 + ROW * len(table)))
            self.figure_.set_figheight(height)
        self.bars_: dict[str, Any] = {}
        self.names_: dict[str, Any] = {}
        self.words_: dict[str, Any] = {}
        self.columns_: dict[str, dict[str, Any]] = {}
        self.margin_ = np.nan
        self.confused_: list[str] = []
        tried = table[table["status"] != Status.REFUSED]
        if not table.empty:
            self._draw_bars(tried)
            self._draw_columns(tried)
            self._draw_refused(table[table["status"] == Status.REFUSED], len(tried))
            self._finish(table)
        else:
            say_instead(self.ax_, f"No candidate was tried in step {self.step}.")
        self._restyle({"bar": bar_kw}, bar=self.bars_)
        text = self._title_text(tried)
        if self._own:  # in the middle of the figure: names and columns are beside the bars
            text = wrapped(text, letters(self.figure_))
            self.title_ = self.figure_.suptitle(text, fontsize="medium")
        else:
            text = wrapped(text, letters_above(self.ax_))
            self.title_ = self.ax_.set_title(text, fontsize="medium", pad=18.0)
        return self

    def _draw_bars(self, tried: pd.DataFrame) -> None:
        if tried.empty:
            self.ax_.set_xlim(0.0, 1.0)
            return
        gain = _finite(tried["vaf_gain"])
        best, _ = _first_two(tried)
        self.confused_ = [name for name in best["confused_with"] if name in set(tried["effect"])]
        largest = max(float(np.nanmax(gain, initial=0.0)), LEAST)
        least = float(np.nanmin(gain, initial=0.0))
        left = max(least, -FURTHEST_LEFT * largest)
        loop = "gain_loop" in tried and np.isfinite(_finite(tried["gain_loop"])).any()
        room = max(TEXT_ROOM, (14 + 7 * (1 + loop)) / letters(self.figure_))
        width = (largest - left) * (1 + room)
        self.ax_.set_xlim(left - 0.02 * width * (left < 0), left + width)
        for i, row in enumerate(tried.to_dict("records")):
            self._draw_bar(i, row, left)
        best, second = _first_two(tried)
        if second is not None:
            self.margin_ = float(_finite(best["vaf_gain"]) - _finite(second["vaf_gain"]))

    def _draw_bar(self, i: int, row: dict[str, Any], left: float) -> None:
        name, gain = row["effect"], float(_finite(row["vaf_gain"]))
        confused = name in self.confused_
        added = row["status"] == Status.ADDED
        (self.bars_[name],) = self.ax_.barh(
            i,
            np.nan_to_num(gain),
            height=0.72,
            color=ORANGE if confused else faded(BLUE, 1.0 if added else FADED),
            hatch="////" if confused else None,
            edgecolor=background(),
            lw=0.0,
            label="cannot be told apart from the best here" if confused else None,
        )
        cut = " (cut)" if gain < left else ""
        self.words_[name] = self.ax_.annotate(
            signed(gain, 1) + cut,
            (max(np.nan_to_num(gain), 0.0), i),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize="small",
            fontweight="bold" if added else "normal",
        )

    def _draw_columns(self, tried: pd.DataFrame) -> None:
        """Further values, right-aligned beside the bars."""
        wide = COLUMN * mpl.rcParams["font.size"] * 0.5
        place = 0
        for column, header in COLUMNS.items():
            values = _finite(tried[column]) if column in tried else np.array([])
            if not np.isfinite(values).any():
                continue
            place += 1
            at = (wide * place * (1.35 if place > 1 else 1.0), 0)
            beside = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
            look: dict[str, Any] = {"ha": "right", "fontsize": "small", "annotation_clip": False}
            self.ax_.annotate(header, (1.0, -0.6), at, va="bottom", **beside, **look)
            for i, row in enumerate(tried.to_dict("records")):
                digits = 0 if column == "delta_bic" else 1
                self.columns_.setdefault(row["effect"], {})[column] = self.ax_.annotate(
                    signed(values[i], digits),
                    (1.0, i),
                    at,
                    va="center",
                    color=foreground() if row["status"] == Status.ADDED else dimmed(),
                    **beside,
                    **look,
                )

    def _draw_refused(self, refused: pd.DataFrame, first: int) -> None:
        for i, row in enumerate(refused.to_dict("records")):
            self.words_[row["effect"]] = self.ax_.annotate(
                _shortened(row["reason"], int(1.3 * letters_above(self.ax_))),
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
        panel.set_yticks(range(len(table)), [""] * len(table))
        with_form = not self._own or letters(self.figure_) >= NARROW
        for i, row in enumerate(table.to_dict("records")):
            self.names_[row["effect"]] = self._name(i, row, with_form)
        panel.set_ylim(len(table) - 0.4, -0.6)
        panel.set_xlabel("VAF gained on held-out runs, points")
        panel.grid(alpha=0.3, axis="x")
        panel.set_axisbelow(True)
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)
        if self.confused_:
            self._legend_of_panels()

    def _name(self, i: int, row: dict[str, Any], with_form: bool) -> Any:
        """Name of a candidate left of its bar, and its form, smaller."""
        refused, added = row["status"] == Status.REFUSED, row["status"] == Status.ADDED
        look = {
            "color": dimmed(0.55) if refused else foreground(),
            "fontsize": "small",
            "fontweight": "bold" if added else "normal",
        }
        parts: list[Any] = [TextArea(title_of(row["effect"]), textprops=look)]
        form = row["form"]
        if with_form and isinstance(form, str) and form:
            pale = {"color": dimmed(0.55), "fontsize": "x-small"}
            parts.append(TextArea(form, textprops=pale))
        return self.ax_.add_artist(
            AnnotationBbox(
                HPacker(children=parts, sep=4, pad=0, align="baseline"),
                (0.0, i),
                (-6.0, 0.0),
                xycoords=("axes fraction", "data"),
                boxcoords="offset points",
                box_alignment=(1.0, 0.5),
                frameon=False,
                pad=0.0,
                annotation_clip=False,
            )
        )

    def _title_text(self, tried: pd.DataFrame) -> str:
        added = tried[tried["status"] == Status.ADDED]
        if tried.empty:
            return f"Step {self.step}: no candidate applies"
        if added.empty:
            return f"Step {self.step}: no candidate is better by more than chance"
        best, second = _first_two(tried)
        title = f"Step {self.step}: {title_of(best['effect'])} added"
        if second is None or not np.isfinite(self.margin_):
            return title
        name, lead = title_of(second["effect"]), best["delta_bic"] - second["delta_bic"]
        if lead < 0:  # the second gains too little on held-out runs, or is less plain
            title += f", though {name} has a ΔBIC that is {-lead:.0f} larger"
        elif self.margin_ > 0.05:
            title += f"; runner-up: {name}, {self.margin_:.1f} points behind"
        else:
            title += f"; runner-up: {name}, {lead:.0f} behind in ΔBIC"
        if second["effect"] in self.confused_:
            title += ", which these data cannot tell apart"
        return title


def _first_two(tried: pd.DataFrame) -> tuple[Any, Any]:
    """What was added, else the first, and of the others the one with the longest bar, if any."""
    added = np.flatnonzero((tried["status"] == Status.ADDED).to_numpy())
    first = int(added[0]) if added.size else 0
    others = tried.drop(index=tried.index[first])
    if others["vaf_gain"].notna().any():
        return tried.iloc[first], others.loc[others["vaf_gain"].astype(float).idxmax()]
    return tried.iloc[first], None


def signed(value: float, digits: int) -> str:
    """A number with its sign, never -0; nothing where it is not known."""
    if not np.isfinite(value):
        return ""
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


def _finite(values: Any) -> np.ndarray:
    """Gains, NaN where a candidate has none."""
    values = np.asarray(values, dtype=float)
    return np.where(np.isfinite(values), values, np.nan)


def _shortened(text: str, letters: int) -> str:
    return text if len(text) <= letters else f"{text[: letters - 1].rstrip()}…"
