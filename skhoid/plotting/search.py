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

from ..effects.registry import title_of, titles_of
from ..preprocessing.base import as_fitted
from ..runs import RunLayout, read_layout, run_name
from ..search import TRIED, EffectSearchCV, Status, with_effects
from ..text import ceiling_text
from ._axes import cut, draw_arrow, letters, letters_above, say_instead, with_unit, wrapped
from ._display import Display, check_option, check_search
from ._roles import BLUE, ORANGE, ROLES, background, dimmed, faded, foreground, greyed, scaled
from .residual import percent

BASELINE, UNKNOWN = "baseline", "unknown"
OF_SMALL = 1.2  # letters of the small size to one of the medium size
# Path
LOWEST = -20.0  # percent; lower steps are cut and written
WIDTH = 1.25  # inches for each step
SMALL_GAP = 0.05  # points, below which nothing is left
LEAST_SPAN = 10.0  # points of VAF, so that a small gap looks small
ABOVE, BELOW = 0.22, 0.18  # of the span of VAF, for the ceiling's text and for values
# Steps
PALEST = 0.35  # share of the colour, of the baseline; the rest is grey
SHOWN = 15.0  # s
LEAST_HEIGHT = 4.4  # inches, of a font of 10 points: of a narrow one, the legend takes three rows
# Ranking
ROW = 0.235  # inches for each candidate
LEAST = 1.0  # points on the axis, so that small gains look small
FURTHEST_LEFT = 0.35  # of the largest gain; bars that lose more are cut
FADED = 0.45  # share of the colour in bars that are not added
NARROW = 66  # letters across a figure, below which forms are left out
COLUMNS = {"evidence": "nats", "probability": "probability"}
COLUMN = 4.5  # widths of a letter to the right edge of a column


@dataclass(kw_only=True, eq=False, repr=False)
class SearchDisplay(Display):
    """What a search for effects did, step by step.

    ``kind`` is one of

    path
        Held-out VAF as a staircase, a step for each effect that is added, with the noise ceiling;
        the bar on the last step is what is left to explain. The thin dotted staircase is the VAF of
        the same runs in the closed loop, in which the model's own output moves x and e.
    steps
        The measured output against held-out simulations before (greyer, dashed) and after effects
        are added; below, the residuals. The VAF in the legend is that of all held-out runs.
    ranking
        Candidates of one step by the VAF points that they gain on held-out runs, beside evidence
        in nats and the probability that the name is right. Candidates that these data cannot tell
        apart from the best are hatched; what was not added is faded.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    %(search)
    %(search_options)

    Attributes
    ----------
    %(panels)
    lines_ : dict of Artist
        The main artists: staircases ``"vaf"`` and, where it is known, ``"vaf_loop"``; outputs by
        the names of the columns; bars by effect, best first.
    residuals_ : dict of Line2D
        Residuals, by the names of the columns (steps).
    run_, window_ : str, and (float, float)
        Name of the run shown, and the time in s (steps).

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
        %(search_options)
        """
        if hasattr(search, "fit") or not hasattr(search, "error_path_"):
            check_search(search, EffectSearchCV, cls.__name__)
        options: dict[str, Any] = {"run": run, "window": window, "steps": steps, "step": step}
        return cls(search=search, kind=kind, n_candidates=n_candidates, **options).plot(
            ax, **kwargs
        )

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        draw = {"path": self._draw_path, "steps": self._draw_steps, "ranking": self._draw_ranking}
        check_option("kind", self.kind, draw)
        self.lines_: dict[str, Any] = {}
        draw[self.kind](ax, kwargs)
        return self

    # The path

    def _draw_path(self, ax: Any, kwargs: dict[str, Any]) -> None:
        # Structure that no effect explains is no step: nothing was added.
        path = self.search.error_path_
        path = path[path["effect"] != UNKNOWN]
        size = max(6.4, 0.9 + WIDTH * len(path)), 3.8
        self._take_axes(ax, "the VAF", figsize=size)
        panel = self.ax_
        panel.set_title(self._title_of_path(path), fontsize="medium")
        if not np.isfinite(path["vaf"].to_numpy(dtype=float)).any():
            say_instead(panel, "Held-out VAF: not available.")
            return
        vaf, ceiling = (path[name].to_numpy(dtype=float) for name in ("vaf", "ceiling"))
        in_loop = path.get("vaf_loop", pd.Series(np.nan, path.index)).to_numpy(dtype=float)
        known = np.r_[vaf, in_loop, ceiling]
        high = np.nanmax(known)
        low = min(max(np.nanmin(known), LOWEST), high - LEAST_SPAN)
        span = high - low
        edges = np.arange(len(path) + 1) - 0.5
        stairs: dict[str, Any] = {"edges": edges, "baseline": None}
        look: dict[str, Any] = {"color": ROLES["simulated"].colour, "lw": scaled(2.6), "zorder": 3}
        self.lines_["vaf"] = panel.stairs(vaf, label="free run", **stairs, **look)
        for i, value in enumerate(vaf):
            self._write_value(i, value)
        if np.isfinite(ceiling).any():
            panel.stairs(ceiling, **stairs, **ROLES["ceiling"].style(2.2))
            last = len(path) - 1
            if np.isfinite(ceiling[last]):
                draw_arrow(panel, (last + 0.4, ceiling[last]), (0.0, 14.0), ROLES["ceiling"].colour)
        if np.isfinite(in_loop).any():
            look = {"color": foreground(), "lw": scaled(1.0), "ls": ":"}
            self.lines_["vaf_loop"] = panel.stairs(
                in_loop, label="in the closed loop", **stairs, **look
            )
        low -= 0.0 if np.nanmin(known) < LOWEST else BELOW * span
        panel.set_ylim(low, high + ABOVE * span)
        panel.set_ylabel("held-out VAF, %")
        lines = self._say_what_is_left(panel, path)
        panel.set_ylim(low, high + (1 + 0.6 * (lines - 1)) * ABOVE * span)
        self._restyle(kwargs, self.lines_)
        each = max(int(OF_SMALL * letters_above(panel) / len(path)) - 2, 6)
        labels = [wrapped(label, each) for label in _step_labels(path["effect"])]
        panel.set_xlim(-0.5, len(path) - 0.5)
        panel.set_xticks(range(len(path)), labels, fontsize="small")
        panel.tick_params(axis="x", length=0)
        if len(self.lines_) > 1:
            self._legend_of_panels()

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

    def _write_value(self, i: int, value: float) -> None:
        """The VAF at its step, at the lower edge where the step is below."""
        low = value < LOWEST
        place: dict[str, Any] = {"textcoords": "offset points", "ha": "center"}
        self.ax_.annotate(
            f"↓ {percent(value)}" if low else percent(value),
            (i, LOWEST if low else np.nan_to_num(value)),
            (0, 4 if low else -4),
            va="bottom" if low else "top",
            bbox={"facecolor": background(), "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
            **place,
        )

    def _say_what_is_left(self, panel: Axes, path: pd.DataFrame) -> int:
        """The ceiling named where it is drawn, and what is left up to it; return the lines."""
        last = path.iloc[-1]
        vaf, ceiling, gap = (float(last[n]) for n in ("vaf", "ceiling", "explainable_gap"))
        if np.isnan(ceiling):
            text, at, side = "noise ceiling not known", panel.get_ylim()[1], "top"
        else:
            at, side = max(vaf, ceiling), "bottom"
            text = f"noise ceiling {ceiling_text(ceiling)}: "
            if gap >= SMALL_GAP:
                left = UNKNOWN in self.search.best_effects_
                text += f"{gap:.1f} points left to explain{', not in the catalogue' * left}"
                look: dict[str, Any] = {"color": ROLES["misfit"].colour, "lw": scaled(5.0)}
                ends = [max(vaf, LOWEST), ceiling]
                panel.plot([len(path) - 0.6] * 2, ends, solid_capstyle="butt", **look)
            else:
                text += "nothing left to explain"
        text = wrapped(text, int(OF_SMALL * 0.9 * letters_above(panel)))
        place: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "fontsize": "small"}
        away = (4, -3 if side == "top" else 3)
        panel.annotate(text, (0.0, at), away, textcoords="offset points", va=side, **place)
        return text.count("\n") + 1

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
        names = [name for name in predictions if name != "measured"]
        steps = [0, len(names) - 1][: len(names)] if self.steps is None else list(self.steps)
        for step in steps:
            check_option("a step", step, range(len(names)))
        shown = [names[step] for step in steps]
        if not np.isfinite(predictions[shown].to_numpy(dtype=float)).any():
            for panel, what in ((top, "simulation"), (bottom, "residual")):
                say_instead(panel, f"Held-out {what}: not available.")
            return
        layout = read_layout(predictions)
        number = self._choose_place(layout, shown)
        begin, end = layout.run_starts[number], layout.run_starts[number + 1]
        inside = (layout.time >= self.window_[0]) & (layout.time <= self.window_[1])
        self._draw_simulations(layout, np.flatnonzero(inside[begin:end]) + begin, names, shown)
        simulated = {name: line for name, line in self.lines_.items() if name != "measured"}
        self._restyle(kwargs, simulated)
        # No line ends within the span.
        span = f"run\xa0{self.run_}, {self.window_[0]:.4g}\xa0to\xa0{self.window_[1]:.4g}\xa0s"
        what = "the baseline is worst" if shown == [BASELINE] else "the effects help most"
        title = f"Where {what}: {span}" if self.window is None else span
        top.set_title(title, fontsize="medium")
        unit = predictions.attrs.get("units", {}).get("measured")
        top.set_ylabel(with_unit("output", unit))
        bottom.set_ylabel(with_unit("residual", unit))
        bottom.set_xlabel(f"time in run {self.run_}, s")
        self._legend_of_panels()

    def _choose_place(self, layout: RunLayout, shown: list[str]) -> int:
        """Choose the run and its 15 s in which the square of the residual falls most."""
        predictions = self.search.predictions_
        residuals = predictions[shown].sub(predictions["measured"], axis=0)
        squares = residuals.to_numpy(dtype=float) ** 2
        gain = squares[:, 0] - (squares[:, -1] if len(shown) > 1 else 0.0)
        # Simulations start from rest, and scores leave out what that takes.
        model = getattr(self.search, "best_estimator_", None)
        settling = getattr(as_fitted(model), "settling", 0.0)
        first = np.repeat(layout.starts[:-1], np.diff(layout.starts))
        gain = np.where(layout.time - layout.time[first] < settling, 0.0, np.nan_to_num(gain))
        names = [run_name(label) for label in layout.labels]
        if self.run is not None:
            check_option("run", str(self.run), names)
        best = -np.inf
        chosen = 0
        for number, name in enumerate(names):
            rows = slice(layout.run_starts[number], layout.run_starts[number + 1])
            time = layout.time[rows]
            if self.run is not None and name != str(self.run):
                continue
            total = np.r_[0.0, np.cumsum(gain[rows])]
            starts = time[: max(1, int(np.searchsorted(time, time[-1] - SHOWN, side="right")))]
            ends = starts + SHOWN
            if self.window is not None:
                starts, ends = (np.array([edge], dtype=float) for edge in self.window)
            begin, end = np.searchsorted(time, starts), np.searchsorted(time, ends, side="right")
            if (begin == end).all():
                continue
            place = int(np.argmax(total[end] - total[begin]))
            if (total[end] - total[begin])[place] > best:
                best, chosen = (total[end] - total[begin])[place], number
                self.window_ = self.window or (float(starts[place]), float(time[end[place] - 1]))
        if best == -np.inf:
            raise ValueError(f"No row of the runs lies in window={self.window!r} s of their time.")
        self.run_ = names[chosen]
        return chosen

    def _draw_simulations(
        self, layout: RunLayout, rows: np.ndarray, names: list[str], shown: list[str]
    ) -> None:
        top, bottom = self.axes_
        # Held-out VAF of each column of the predictions, and what its model is called.
        path = self.search.error_path_
        path = path[path["effect"] != UNKNOWN]
        vaf = dict(zip(names, path["vaf"].astype(float), strict=False))
        labels = dict(zip(names, _step_labels(path["effect"]), strict=False))
        # Lines break at gaps in the recording.
        gaps = np.flatnonzero(np.isin(rows[1:], layout.starts)) + 1
        time = np.insert(layout.time[rows], gaps, np.nan)
        table = self.search.predictions_.iloc[rows].astype(float)
        measured = np.insert(table["measured"].to_numpy(), gaps, np.nan)
        look = ROLES["measured"].style(1.2)
        (self.lines_["measured"],) = top.plot(time, measured, label="measured", **look)
        for i, name in enumerate(shown):
            # The last step has the colour itself, the baseline is the greyest.
            share = PALEST + (1.0 - PALEST) * i / (len(shown) - 1) if len(shown) > 1 else 1.0
            blue, purple = (greyed(ROLES[r].colour, share) for r in ("simulated", "residual"))
            dashes = "--" if i < len(shown) - 1 else "-"
            simulated = np.insert(table[name].to_numpy(), gaps, np.nan)
            known = f", VAF {percent(vaf[name])}" if np.isfinite(vaf.get(name, np.nan)) else ""
            label = f"{ROLES['simulated'].word}, {labels.get(name, name)}{known}"
            (self.lines_[name],) = top.plot(
                time, simulated, color=blue, ls=dashes, lw=scaled(1.4), label=label
            )
            (self.residuals_[name],) = bottom.plot(
                time, measured - simulated, color=purple, ls=dashes, lw=scaled(1.1)
            )
        bottom.axhline(0.0, color=foreground(), lw=scaled(0.8), ls=":")
        for panel in self.axes_:
            panel.set_xlim(*self.window_)
            panel.grid(alpha=0.3)

    # The ranking

    def _draw_ranking(self, ax: Any, kwargs: dict[str, Any]) -> None:
        every = self.search.ranking_
        if len(every):
            check_option("step", self.step, sorted(set(every["step"])))
        ranking = every[every["step"] == self.step]
        refused = ~ranking["status"].isin(TRIED).to_numpy()
        tried, refused = ranking[~refused], ranking[refused]
        if self.n_candidates is not None:
            tried, refused = tried.head(self.n_candidates), refused[:0]
        table = pd.concat([tried, refused])
        size = 7.2, max(2.6, 1.1 + ROW * len(table))
        self._take_axes(ax, "the bars", figsize=size, least_height=1.2 + ROW * len(table))
        if table.empty:
            say_instead(self.ax_, f"No candidate was tried in step {self.step}.")
        else:
            self._draw_bars(tried)
            self._draw_columns(tried)
            self._draw_refused(refused, len(tried))
            self._finish(table)
        self._restyle(kwargs, self.lines_)
        text = self._title_of_ranking(tried)
        if self._own:  # in the middle of the figure: names and columns are beside the bars
            self.figure_.suptitle(text, fontsize="medium")
        else:
            self.ax_.set_title(text, fontsize="medium", pad=18.0)

    def _draw_bars(self, tried: pd.DataFrame) -> None:
        gains = tried["vaf_gain"].astype(float).replace([np.inf, -np.inf], np.nan)
        largest = max(float(gains.max(skipna=True)) if gains.notna().any() else 0.0, LEAST)
        least = min(float(gains.min(skipna=True)) if gains.notna().any() else 0.0, 0.0)
        left = max(least, -FURTHEST_LEFT * largest)
        room = max(0.22, 28 / letters(self.figure_))  # for the points at the ends of the bars
        width = (largest - left) * (1 + room)
        self.ax_.set_xlim(left - 0.02 * width * (left < 0), left + width)
        confused = _first_two(tried)[0]["confused_with"] if len(tried) else []
        for i, (row, gain) in enumerate(zip(tried.to_dict("records"), gains, strict=True)):
            alike, added = row["effect"] in confused, row["status"] == Status.ADDED
            (self.lines_[row["effect"]],) = self.ax_.barh(
                i,
                np.nan_to_num(gain),
                height=0.72,
                color=ORANGE if alike else faded(BLUE, 1.0 if added else FADED),
                hatch="////" if alike else None,
                edgecolor=background(),
                lw=0.0,
                label="cannot be told apart from the best here" if alike else None,
            )
            text = _signed(gain, 1) + (" (cut)" if gain < left else "")
            self._write_beside(i, max(np.nan_to_num(gain), 0.0), text, bold=added)

    def _write_beside(
        self, i: int, at: float, text: str, *, bold: bool = False, **look: Any
    ) -> None:
        look = {"fontsize": "small", "fontweight": "bold" if bold else "normal", **look}
        self.ax_.annotate(text, (at, i), (4, 0), textcoords="offset points", va="center", **look)

    def _draw_columns(self, tried: pd.DataFrame) -> None:
        """Further values, right-aligned beside the bars."""
        wide = COLUMN * mpl.rcParams["font.size"]
        at = 0.0
        for column, header in COLUMNS.items():
            values = tried.get(column, pd.Series(np.nan, tried.index)).astype(float)
            if not np.isfinite(values).any():
                continue
            at += 0.85 * wide * (1.7 if at else 1.0)
            look: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "ha": "right"}
            look |= {"textcoords": "offset points", "fontsize": "small", "annotation_clip": False}
            self.ax_.annotate(header, (1.0, -0.6), (at, 0), va="bottom", **look)
            for i, (value, status) in enumerate(zip(values, tried["status"], strict=True)):
                text = f"{value:.0f}" if column == "evidence" else f"{100 * value:.0f} %"
                colour = foreground() if status == Status.ADDED else dimmed()
                self.ax_.annotate(text, (1.0, i), (at, 0), va="center", color=colour, **look)

    def _draw_refused(self, refused: pd.DataFrame, first: int) -> None:
        start = max(self.ax_.get_xlim()[0], 0.0)
        for i, reason in enumerate(refused["reason"]):
            text = cut(reason, int(1.3 * letters_above(self.ax_)))
            self._write_beside(first + i, start, text, color=dimmed(0.55), fontsize="x-small")

    def _finish(self, table: pd.DataFrame) -> None:
        panel: Axes = self.ax_
        panel.axvline(0.0, color=foreground(), lw=scaled(0.8))
        panel.set_yticks(range(len(table)), [""] * len(table))
        with_form = not self._own or letters(self.figure_) >= NARROW
        for i, row in enumerate(table.to_dict("records")):
            self._write_name(i, row, with_form)
        panel.set_ylim(len(table) - 0.4, -0.6)
        panel.set_xlabel("VAF gained on held-out runs, points")
        panel.grid(alpha=0.3, axis="x")
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
        self._legend_of_panels()

    def _write_name(self, i: int, row: dict[str, Any], with_form: bool) -> None:
        """Name of a candidate left of its bar, and its form, smaller."""
        look = {
            "color": foreground() if row["status"] in TRIED else dimmed(0.55),
            "fontsize": "small",
            "fontweight": "bold" if row["status"] == Status.ADDED else "normal",
        }
        parts: list[Any] = [TextArea(title_of(row["effect"]), textprops=look)]
        form = row["form"]
        if with_form and isinstance(form, str) and form:
            pale = {"color": dimmed(0.55), "fontsize": "x-small"}
            parts.append(TextArea(form, textprops=pale))
        self.ax_.add_artist(
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
        if tried.empty:
            return f"Step {self.step}: no candidate applies"
        if not (tried["status"] == Status.ADDED).any():
            return f"Step {self.step}: no candidate is better by more than chance"
        best, second = _first_two(tried)
        title = f"Step {self.step}: {title_of(best['effect'])} added"
        if second is None or not np.isfinite(best["vaf_gain"] - second["vaf_gain"]):
            return title
        points, lead = (best[name] - second[name] for name in ("vaf_gain", "evidence"))
        name = title_of(second["effect"])
        if lead < 0:  # the second gains too little on held-out runs, or is less plain
            title += f", though {name} has {-lead:.0f} nats more"
        else:
            behind = f"{points:.1f} points" if points > 0.05 else f"{lead:.0f} nats"
            title += f"; runner-up: {name}, {behind} behind"
        alike = second["effect"] in best["confused_with"]
        return f"{title}, which these data cannot tell apart" if alike else title


def _step_labels(effects: Iterable[str]) -> list[str]:
    """Names of the models: the baseline, and with all effects that each step has by then."""
    added = [name for name in effects if name != BASELINE]
    return [with_effects(added[:n]) for n in range(len(added) + 1)]


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
