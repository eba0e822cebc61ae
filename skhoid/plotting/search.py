"""What a search for effects did: its steps, its candidates, and the simulations on the way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.offsetbox import AnnotationBbox, HPacker, TextArea
from sklearn.exceptions import NotFittedError

from ..effects.registry import title_of, titles_of
from ..preprocessing.base import as_fitted
from ..runs import RunLayout, read_layout, run_name
from ..search import Status, with_effects
from ._axes import cut, letters, letters_above, say_instead, with_unit, wrapped
from ._display import Display, check_option
from ._roles import (
    BLUE,
    ORANGE,
    ROLES,
    background,
    dimmed,
    faded,
    foreground,
    greyed,
    scaled,
)
from .residual import percent

NEEDED = {
    "path": ("error_path_", "best_effects_", "verdict_", "predictions_"),
    "steps": ("predictions_", "error_path_", "verdict_"),
    "ranking": ("ranking_",),
}
BASELINE, UNKNOWN = "baseline", "unknown"
OF_SMALL = 1.2  # letters of the small size to one of the medium size
# Path
LOWEST = -20.0  # percent; lower steps are cut and written
WIDTH = 1.25  # inches for each step
SMALL_GAP = 0.05  # points, below which nothing is left
LEAST_SPAN = 10.0  # points of VAF, so that a small gap looks small
BESIDE_EACH_OTHER = 0.25  # of a step, by which two values on it are off its middle
ABOVE, BELOW = 0.22, 0.18  # of the span of VAF, for the ceiling's text and for values
ROOM = 0.09  # of the span of VAF, that a line of text takes
# Steps
PALEST = 0.35  # share of the colour, of the baseline; the rest is grey
SHOWN = 15.0  # s
LEAST_HEIGHT = 4.4  # inches, of a font of 10 points: of a narrow one, the legend takes three rows
# Ranking
ROW = 0.235  # inches for each candidate
LEAST = 1.0  # points on the axis, so that small gains look small
FURTHEST_LEFT = 0.35  # of the largest gain; bars that lose more are cut
TEXT_ROOM = 0.22  # of the width, for the points at the ends of the bars
FADED = 0.45  # share of the colour in bars that are not added
NARROW = 66  # letters across a figure, below which forms are left out
COLUMNS = {"delta_bic": "ΔBIC", "gain_loop": "in closed\nloop, points"}
COLUMN = 7.5  # widths of a letter to the right edge of a column


@dataclass(kw_only=True, eq=False, repr=False)
class SearchDisplay(Display):
    """What a search for effects did, step by step.

    ``kind`` says what is drawn:

    path
        Held-out VAF as a staircase: one step for each effect that is added, named by all effects
        that its model has. The dotted line is the noise ceiling: what any model driven by these
        channels can reach. The bar on the last step, in the colour of misfit, is what is left to
        explain. The thin dotted staircase is the VAF of the same runs in the closed loop, in which
        the model's own output moves x and e: what follows the remnant round the loop does not rise
        there. A second panel has the RMSE, where it is asked for.
    steps
        The measured output against held-out simulations before and after effects are added; above
        the output, below the residuals, both greyer and dashed before the effects. Simulations come
        from models that have not seen the run. The VAF in the legend is that of all held-out runs,
        not of the window.
    ranking
        Candidates of one step by what they gain on held-out runs. Bars are VAF points on runs that
        were held out of the fit; bars of what was not added are faded. The columns beside them are
        ΔBIC (larger is better) and, where it was asked, the points gained in the closed loop.
        Candidates that these data cannot tell apart from the best are hatched; those that do not
        apply are grey, with the reason.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    search : fitted EffectSearchCV
        The search, or whatever has the attributes of one that are drawn.
    kind : {"path", "steps", "ranking"}, default="path"
        What to draw.
    rmse : bool, default=False
        Draw the RMSE of the path too, in a figure made here; of given Axes, the second has it.
    run : run label or None, default=None
        The run of which steps are shown. None takes the one in which the effects help most.
    window : (float, float) or None, default=None
        Begin and end of it in seconds of time in the run. None takes the 15 s in which the effects
        help most.
    steps : sequence of int or None, default=None
        Steps to show: 0 is the baseline, 1 the model with the first effect. None takes the
        baseline and the last.
    step : int, default=1
        The step of a ranking, from 1 on.
    n_candidates : int or None, default=None
        Rank so many of the best, and none that do not apply. None draws all.

    Attributes
    ----------
    %(panels)
    lines_ : dict of Artist
        The main artists: staircases ``"vaf"``, ``"vaf_loop"`` where it is known and ``"rmse"``
        where it is drawn; outputs by the names of the columns; bars by effect, best first.
    ceilings_ : dict of StepPatch
        The ceiling in each panel of the path; empty where it is not known.
    gap_, ceiling_text_ : Artist or None
        The bar where something is left, and what is written at the ceiling.
    labels_ : dict of list of Text
        Values on the steps, by the names of the staircases.
    run_, window_ : str, and (float, float)
        Name of the run shown, and the time in s.
    residuals_ : dict of Line2D
        Residuals, by the names of the columns.
    names_, words_ : dict of Artist
        Names of the candidates with their forms; and points at the ends of the bars, or the reason
        why one does not apply.
    columns_ : dict of dict of Text
        Values beside the bars by effect: ``"delta_bic"``, and ``"gain_loop"`` where it is known.
    margin_ : float
        VAF points from what was added (else the first) to the best other; NaN where there is none.
    confused_ : list of str
        Candidates of the step that cannot be told apart from the best.

    See Also
    --------
    EffectDisplay : What a single effect does.

    Examples
    --------
    >>> from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
    >>> from skhoid.effects import DeadZone
    >>> from skhoid.plotting import SearchDisplay
    >>> X, y = make_tracking_runs(
    ...     n_runs=2, remnant_intensity=0.1, effects=DeadZone(width=0.6), random_state=0
    ... )
    >>> search = EffectSearchCV(OperatorRegressor(), effects=["dead_zone", "bias"]).fit(X, y)
    >>> display = SearchDisplay.from_estimator(search)
    >>> list(display.lines_)
    ['vaf']
    >>> display = SearchDisplay.from_estimator(search, "ranking")
    >>> list(display.lines_)
    ['dead_zone', 'bias']
    """

    search: Any
    kind: str = "path"
    rmse: bool = False
    run: Any = None
    window: tuple[float, float] | None = None
    steps: Sequence[int] | None = None
    step: int = 1
    n_candidates: int | None = None

    @classmethod
    def from_estimator(
        cls,
        search: Any,
        kind: str = "path",
        *,
        rmse: bool = False,
        run: Any = None,
        window: tuple[float, float] | None = None,
        steps: Sequence[int] | None = None,
        step: int = 1,
        n_candidates: int | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw a search.

        Parameters
        ----------
        %(search)
        kind : {"path", "steps", "ranking"}, default="path"
            What to draw.
        rmse : bool, default=False
            Draw the RMSE of the path too.
        run, window, steps
            Of kind "steps": the run, begin and end in s, and the steps to show.
        step, n_candidates : int, and int or None
            Of kind "ranking": the step, from 1 on, and how many of the best to draw; None draws
            all, also those that do not apply.
        %(keywords)

        %(display)

        Raises
        ------
        ValueError
            If there is no such kind, run or step, or the run has no rows in the window.
        """
        return cls(
            search=search,
            kind=kind,
            rmse=rmse,
            run=run,
            window=window,
            steps=steps,
            step=step,
            n_candidates=n_candidates,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        check_option("kind", self.kind, NEEDED)
        _check_fitted(self.search, NEEDED[self.kind], type(self).__name__)
        self.lines_: dict[str, Any] = {}
        draw = {"path": self._draw_path, "steps": self._draw_steps, "ranking": self._draw_ranking}
        draw[self.kind](ax, kwargs)
        return self

    @property
    def _unit(self) -> str | None:
        """Unit of the output."""
        unit: str | None = self.search.predictions_.attrs.get("units", {}).get("measured")
        return unit

    # The path

    def _draw_path(self, ax: Any, kwargs: dict[str, Any]) -> None:
        # Structure that no effect explains is no step: nothing was added.
        every = self.search.error_path_
        path = every[every["effect"] != UNKNOWN]
        self._take_axes(
            ax,
            "VAF and, if wanted, RMSE",
            (1 + self.rmse, 1),
            allowed=(1, 2),
            sharex=True,
            figsize=(max(6.4, 0.9 + WIDTH * len(path)), 5.6 if self.rmse else 3.8),
        )
        self.ceilings_: dict[str, Any] = {}
        self.ceiling_text_: Any = None
        self.labels_: dict[str, list[Any]] = {}
        self.gap_: Any = None
        top = self.ax_
        title = wrapped(self._title_of_path(path), letters_above(top))
        top.set_title(title, fontsize="medium")
        if not np.isfinite(path["vaf"].to_numpy(dtype=float)).any():
            for panel, what in zip(self.axes_, ("VAF", "RMSE"), strict=False):
                say_instead(panel, f"Held-out {what}: not available.")
            return
        self._draw_vaf(top, path)
        if len(self.axes_) == 2:
            self._draw_rmse(self.axes_[1], path)
        self._restyle(kwargs, self.lines_)
        each = max(int(OF_SMALL * letters_above(top) / len(path)) - 2, 6)
        labels = [wrapped(label, each) for label in _step_labels(path["effect"])]
        for panel in self.axes_:
            panel.set_xlim(-0.5, len(path) - 0.5)
            panel.set_xticks(range(len(path)), labels, fontsize="small")
            panel.tick_params(axis="x", length=0, labelbottom=panel is self.axes_[-1])

    def _draw_vaf(self, panel: Axes, path: pd.DataFrame) -> None:
        vaf, ceiling = (path[name].to_numpy(dtype=float) for name in ("vaf", "ceiling"))
        in_loop = path.get("vaf_loop", pd.Series(np.nan, path.index)).to_numpy(dtype=float)
        known = np.r_[vaf, in_loop, ceiling]
        high = np.nanmax(known)
        low = min(max(np.nanmin(known), LOWEST), high - LEAST_SPAN)
        span = high - low
        self._draw_stairs(panel, "vaf", vaf, ceiling, [percent(v) for v in vaf])
        if np.isfinite(in_loop).any():
            self._draw_in_loop(panel, in_loop)
            self._part(vaf, in_loop, ceiling, ROOM * span)
        low -= 0.0 if np.nanmin(known) < LOWEST else BELOW * span
        panel.set_ylim(low, high + ABOVE * span)
        panel.set_ylabel("held-out VAF, %")
        self._say_what_is_left(panel, path)
        more = self.ceiling_text_.get_text().count("\n")
        panel.set_ylim(low, high + (1 + 0.6 * more) * ABOVE * span)

    def _draw_rmse(self, panel: Axes, path: pd.DataFrame) -> None:
        vaf, ceiling, rmse = (path[n].to_numpy(dtype=float) for n in ("vaf", "ceiling", "rmse"))
        # The power of the output, which VAF is relative to, is that of the RMSE at a VAF of 0.
        floor = rmse * np.sqrt(np.clip(100.0 - ceiling, 0.0, None) / (100.0 - vaf))
        self._draw_stairs(panel, "rmse", rmse, floor, [f"{v:#.3g}" for v in rmse])
        panel.set_ylim(0.0, 1.14 * panel.get_ylim()[1])
        panel.set_ylabel(with_unit("held-out RMSE", self._unit))

    def _title_of_path(self, path: pd.DataFrame) -> str:
        best, verdict = self.search.best_effects_, str(self.search.verdict_)
        found = [name for name in best if name != UNKNOWN]
        added = list(path["effect"][1:])
        vaf = path["vaf"].to_numpy(dtype=float)
        rise = f"held-out VAF from {vaf[0]:.1f}\xa0to\xa0{vaf[-1]:.1f}\xa0%"
        if not found:
            # Effects may be added without being named: none explains enough.
            title = verdict[:1].upper() + verdict[1:]
            return f"{title}; stand-ins: {titles_of(added)}" if added else title
        names = titles_of(found)
        text = f"{names[:1].upper()}{names[1:]}: {rise}" if np.isfinite(vaf).all() else names
        return f"{text}; {verdict}" if len(found) < len(best) else text

    def _draw_stairs(
        self, panel: Axes, name: str, values: np.ndarray, ceiling: np.ndarray, labels: list[str]
    ) -> None:
        edges = np.arange(len(values) + 1) - 0.5
        colour = ROLES["simulated" if name == "vaf" else "residual"].colour
        self.lines_[name] = panel.stairs(
            values, edges, baseline=None, color=colour, lw=scaled(2.6), zorder=3
        )
        if np.isfinite(ceiling).any():
            look = ROLES["ceiling"].style(2.2)
            self.ceilings_[name] = panel.stairs(ceiling, edges, baseline=None, **look)
        self._label(panel, name, values, labels)

    def _draw_in_loop(self, panel: Axes, values: np.ndarray) -> None:
        edges = np.arange(len(values) + 1) - 0.5
        self.lines_["vaf_loop"] = panel.stairs(
            values, edges, baseline=None, color=foreground(), lw=scaled(1.0), ls=":"
        )
        labels = [percent(v) if np.isfinite(v) else "" for v in values]
        first = int(np.flatnonzero(np.isfinite(values))[0])
        labels[first] = f"in the closed loop\n{labels[first]}"
        self._label(panel, "vaf_loop", values, labels)

    def _part(self, vaf: np.ndarray, in_loop: np.ndarray, ceiling: np.ndarray, room: float) -> None:
        """Move values of free run and closed loop apart, and away from the ceiling."""
        texts = zip(self.labels_["vaf"], self.labels_["vaf_loop"], strict=True)
        for (of_free, of_loop), free, loop, top in zip(texts, vaf, in_loop, ceiling, strict=True):
            high, of_high = max((free, of_free), (loop, of_loop), key=lambda pair: pair[0])
            if not np.isfinite(loop) or abs(free - loop) > 2 * room:
                continue
            if high >= LOWEST and not high + 2 * room > top:
                of_high.set_position((0, 4))
                of_high.set_va("bottom")
                continue
            for label, side in ((of_free, -1.0), (of_loop, 1.0)):
                label.xy = (label.xy[0] + side * BESIDE_EACH_OTHER, label.xy[1])

    def _label(self, panel: Axes, name: str, values: np.ndarray, labels: list[str]) -> None:
        """Write the value on each step."""
        self.labels_[name] = []
        for i, (value, label) in enumerate(zip(values, labels, strict=True)):
            low = name != "rmse" and value < LOWEST
            above = low or name == "rmse"
            self.labels_[name].append(
                panel.annotate(
                    f"↓ {label}" if low else label,
                    (i, LOWEST if low else np.nan_to_num(value)),
                    xytext=(0, 4 if above else -4),
                    textcoords="offset points",
                    ha="center",
                    va="bottom" if above else "top",
                    fontsize="small" if name == "vaf_loop" else "medium",
                    visible=bool(label),
                )
            )

    def _say_what_is_left(self, panel: Axes, path: pd.DataFrame) -> None:
        """The ceiling named where it is drawn, and what is left up to it, as a bar and in words."""
        last = path.iloc[-1]
        vaf, ceiling, gap = (float(last[n]) for n in ("vaf", "ceiling", "explainable_gap"))
        left = UNKNOWN in self.search.best_effects_
        if np.isnan(ceiling):
            text, at = "noise ceiling not known", panel.get_ylim()[1]
        else:
            # Remnant that passes a nonlinearity lowers the ceiling seen by a model without it.
            passed = (path["vaf"] > path["ceiling"] + SMALL_GAP).any()
            text, at = f"noise ceiling {percent(ceiling)}", max(vaf, ceiling)
            text += " (a lower bound)" if passed else ""
            some = gap >= SMALL_GAP
            text += f": {gap:.1f} points left to explain" if some else ": nothing left to explain"
            if some:
                (self.gap_,) = panel.plot(
                    [len(path) - 0.6] * 2,
                    [max(vaf, LOWEST), ceiling],
                    color=ROLES["misfit"].colour,
                    lw=scaled(5.0),
                    solid_capstyle="butt",
                )
        if left and not np.isnan(ceiling) and gap >= SMALL_GAP:
            text += ", not in the catalogue"
        self.ceiling_text_ = panel.annotate(
            wrapped(text, int(OF_SMALL * 0.9 * letters_above(panel))),
            (0.0, at),
            (4, -3 if np.isnan(ceiling) else 3),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="top" if np.isnan(ceiling) else "bottom",
            fontsize="small",
        )

    # The steps

    def _draw_steps(self, ax: Any, kwargs: dict[str, Any]) -> None:
        top, bottom = self._take_axes(
            ax,
            "output and residual",
            (2, 1),
            sharex=True,
            figsize=(7.2, 4.8),
            height_ratios=[1.6, 1.0],
            least_height=LEAST_HEIGHT,
        )
        self.residuals_: dict[str, Any] = {}
        predictions = self.search.predictions_
        shown = _shown([name for name in predictions if name != "measured"], self.steps)
        if not np.isfinite(predictions[shown].to_numpy(dtype=float)).any():
            for panel, what in ((top, "simulation"), (bottom, "residual")):
                say_instead(panel, f"Held-out {what}: not available.")
            return
        layout = read_layout(predictions)
        improvement = _improvement(predictions, shown)
        # Simulations start from rest, and scores leave out what that takes.
        model = getattr(self.search, "best_estimator_", None)
        settling = getattr(as_fitted(model), "settling", 0.0)
        first = np.repeat(layout.starts[:-1], np.diff(layout.starts))
        improvement[layout.time - layout.time[first] < settling] = 0.0
        number, self.window_, chosen = _place(layout, improvement, self.run, self.window)
        self.run_ = run_name(layout.labels[number])
        begin, end = layout.run_starts[number], layout.run_starts[number + 1]
        inside = (layout.time >= self.window_[0]) & (layout.time <= self.window_[1])
        rows = np.flatnonzero(inside[begin:end]) + begin
        self._draw_simulations(layout, rows, shown)
        simulated = {name: line for name, line in self.lines_.items() if name != "measured"}
        self._restyle(kwargs, simulated)
        title = wrapped(self._title_of_steps(shown, chosen), letters_above(top))
        top.set_title(title, fontsize="medium")
        top.set_ylabel(with_unit("output", self._unit))
        bottom.set_ylabel(with_unit("residual", self._unit))
        bottom.set_xlabel(f"time in run {self.run_}, s")
        self._legend_of_panels()

    def _draw_simulations(self, layout: RunLayout, rows: np.ndarray, shown: list[str]) -> None:
        top, bottom = self.axes_
        # Held-out VAF of each column of the predictions, and what its model is called.
        path = self.search.error_path_
        path = path[path["effect"] != UNKNOWN]
        names = [name for name in self.search.predictions_ if name != "measured"]
        vaf = dict(zip(names, path["vaf"].astype(float), strict=False))
        labels = dict(zip(names, _step_labels(path["effect"]), strict=False))
        # Lines break at gaps in the recording.
        gaps = np.flatnonzero(np.isin(rows[1:], layout.starts)) + 1
        time = np.insert(layout.time[rows], gaps, np.nan)
        table = self.search.predictions_.iloc[rows]
        measured = table["measured"].to_numpy(dtype=float)
        (self.lines_["measured"],) = top.plot(
            time,
            np.insert(measured, gaps, np.nan),
            label="measured",
            **ROLES["measured"].style(1.2),
        )
        for i, name in enumerate(shown):
            # The last step has the colour itself, the baseline is the greyest.
            share = PALEST + (1.0 - PALEST) * i / (len(shown) - 1) if len(shown) > 1 else 1.0
            blue, purple = (greyed(ROLES[r].colour, share) for r in ("simulated", "residual"))
            dashes = "--" if i < len(shown) - 1 else "-"
            simulated = table[name].to_numpy(dtype=float)
            known = f", VAF {percent(vaf[name])}" if np.isfinite(vaf.get(name, np.nan)) else ""
            label = f"{ROLES['simulated'].word}, {labels.get(name, name)}{known}"
            gapped, left = (np.insert(v, gaps, np.nan) for v in (simulated, measured - simulated))
            look = {"ls": dashes, "lw": scaled(1.4), "label": label}
            (self.lines_[name],) = top.plot(time, gapped, color=blue, **look)
            (self.residuals_[name],) = bottom.plot(
                time, left, color=purple, ls=dashes, lw=scaled(1.1)
            )
        bottom.axhline(0.0, color=foreground(), lw=scaled(0.8), ls=":")
        for panel in self.axes_:
            panel.set_xlim(*self.window_)
            panel.grid(alpha=0.3)

    def _title_of_steps(self, shown: list[str], chosen: bool) -> str:
        # No line ends within the span.
        span = f"run\xa0{self.run_}, {self.window_[0]:.4g}\xa0to\xa0{self.window_[1]:.4g}\xa0s"
        what = "the baseline is worst" if shown == [BASELINE] else "the effects help most"
        text = f"Where {what}: {span}" if chosen else f"{span[:1].upper()}{span[1:]}"
        return f"{text} ({self.search.verdict_})" if shown == [BASELINE] else text

    # The ranking

    def _draw_ranking(self, ax: Any, kwargs: dict[str, Any]) -> None:
        every = self.search.ranking_
        numbers = sorted(set(every["step"])) if "step" in every else [self.step]
        if len(every) and self.step not in numbers:
            raise ValueError(
                f"This search has the steps {', '.join(map(str, numbers))}; got step={self.step!r}."
            )
        ranking = every[every["step"] == self.step] if "step" in every else every
        refused = (ranking["status"] == Status.REFUSED).to_numpy()
        tried, refused = ranking[~refused], ranking[refused]
        if self.n_candidates is not None:
            tried, refused = tried.head(self.n_candidates), refused[:0]
        table = pd.concat([tried, refused])
        size = 7.2, max(2.6, 1.1 + ROW * len(table))
        self._take_axes(ax, "the bars", figsize=size, least_height=1.2 + ROW * len(table))
        self.names_: dict[str, Any] = {}
        self.words_: dict[str, Any] = {}
        self.columns_: dict[str, dict[str, Any]] = {}
        self.margin_ = np.nan
        self.confused_: list[str] = []
        if not table.empty:
            self._draw_bars(tried)
            self._draw_columns(tried)
            self._draw_refused(refused, len(tried))
            self._finish(table)
        else:
            say_instead(self.ax_, f"No candidate was tried in step {self.step}.")
        self._restyle(kwargs, self.lines_)
        text = self._title_of_ranking(tried)
        if self._own:  # in the middle of the figure: names and columns are beside the bars
            self.figure_.suptitle(wrapped(text, letters(self.figure_)), fontsize="medium")
        else:
            text = wrapped(text, letters_above(self.ax_))
            self.ax_.set_title(text, fontsize="medium", pad=18.0)

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
        (self.lines_[name],) = self.ax_.barh(
            i,
            np.nan_to_num(gain),
            height=0.72,
            color=ORANGE if confused else faded(BLUE, 1.0 if added else FADED),
            hatch="////" if confused else None,
            edgecolor=background(),
            lw=0.0,
            label="cannot be told apart from the best here" if confused else None,
        )
        ended = " (cut)" if gain < left else ""
        self.words_[name] = self.ax_.annotate(
            _signed(gain, 1) + ended,
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
                    _signed(values[i], digits),
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
                cut(row["reason"], int(1.3 * letters_above(self.ax_))),
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
        panel.spines[["top", "right"]].set_visible(False)
        if self.confused_:
            self._legend_of_panels()

    def _name(self, i: int, row: dict[str, Any], with_form: bool) -> Any:
        """Name of a candidate left of its bar, and its form, smaller."""
        look = {
            "color": dimmed(0.55) if row["status"] == Status.REFUSED else foreground(),
            "fontsize": "small",
            "fontweight": "bold" if row["status"] == Status.ADDED else "normal",
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

    def _title_of_ranking(self, tried: pd.DataFrame) -> str:
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


def _check_fitted(search: Any, names: Iterable[str], display: str) -> None:
    """Refuse anything that has not the attributes of a fitted search."""
    missing = [name for name in names if not hasattr(search, name)]
    if missing and type(search).__name__ == "EffectSearchCV":
        raise NotFittedError(
            f"This EffectSearchCV is not fitted yet. Call fit(X, y) before {display}."
        )
    if missing:
        raise TypeError(
            f"{display}.from_estimator draws a fitted EffectSearchCV; got "
            f"{type(search).__name__}, which has no {missing[0]}."
        )


def _step_labels(effects: Iterable[str]) -> list[str]:
    """Names of the models: the baseline, and with all effects that each step has by then."""
    added = [name for name in effects if name != BASELINE]
    return [with_effects(added[:n]) for n in range(len(added) + 1)]


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


def _first_two(tried: pd.DataFrame) -> tuple[Any, Any]:
    """What was added, else the first, and of the others the one with the longest bar, if any."""
    added = np.flatnonzero((tried["status"] == Status.ADDED).to_numpy())
    first = int(added[0]) if added.size else 0
    others = tried.drop(index=tried.index[first])
    if others["vaf_gain"].notna().any():
        return tried.iloc[first], others.loc[others["vaf_gain"].astype(float).idxmax()]
    return tried.iloc[first], None


def _signed(value: float, digits: int) -> str:
    """A number with its sign, never -0; nothing where it is not known."""
    if not np.isfinite(value):
        return ""
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


def _finite(values: Any) -> np.ndarray:
    """Gains, NaN where a candidate has none."""
    values = np.asarray(values, dtype=float)
    return np.where(np.isfinite(values), values, np.nan)
