"""Delays and orders of an ARX model: the loss of every candidate that a search tried."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import matplotlib as mpl
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import (
    FixedLocator,
    LogLocator,
    MaxNLocator,
    NullLocator,
    StrMethodFormatter,
)

from ..arx.searches import DelaySearchCV, OrderSearchCV
from ..preprocessing.base import as_fitted
from ._axes import draw_band, with_unit
from ._display import Display, check_option, check_search
from ._roles import BLUE, VERMILION, background, foreground, scaled, sized, star, veil

WORTHLESS = 100.0  # percent; with more, the model is worse than none at all
MAX_NAMED = 25  # candidates that get a tick label of their own
# Orders
MAX_PANELS = 12
MAX_TICKS = 10
N_LEVELS = 10
MARGIN = 0.3  # of an order, room for the marks at the edge
LEAST_RANGE = 5.0  # percent; finer contours would show what the VAF cannot tell apart


@dataclass(kw_only=True, eq=False, repr=False)
class DelayLossDisplay(Display):
    """Loss of each candidate delay, or the best delay over time.

    The lower axis is in seconds and the upper one in samples. With several inputs whose delays
    differ, candidates stand side by side, named by their delays in samples.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    nk : list of int or tuple
        Candidates in samples.
    loss : ndarray of shape (n_candidates,)
        Loss of each; NaN leaves a gap.
    best_index : int
        Position of the chosen candidate.
    dt : float
        Sampling time of the model's grid in seconds.
    kind : {"loss", "path"}, default="loss"
        The loss of every candidate, or the delay over time.
    criterion : {"one_step", "vaf"}, default="one_step"
        What the loss is.
    std : ndarray of shape (n_candidates,) or None, default=None
        Standard deviation of the loss over folds.
    n_folds : int, default=1
        Number of folds.
    window_time, nk_path : ndarray of shape (n_windows,) or None, default=None
        Centres of sliding windows in seconds, and the best candidate in each, in samples.
    unit : str or None, default=None
        Unit of the output.

    Attributes
    ----------
    %(panels)
    samples_ax_ : SecondaryAxis or None
        Its second axis, in samples; None where candidates stand side by side.
    line_ : Line2D
        The loss, or the delay over time: the main artist.
    best_ : Line2D
        The mark of the best delay.
    band_ : FillBetweenPolyCollection or None
        One standard deviation over folds to either side.

    Examples
    --------
    >>> from skhoid import ARXRegressor, DelaySearchCV, load_human_tracking
    >>> from skhoid.plotting import DelayLossDisplay
    >>> X, y = load_human_tracking(1)
    >>> search = DelaySearchCV(ARXRegressor(), nk=range(1, 21)).fit(X, y)
    >>> display = DelayLossDisplay.from_estimator(search, unit="px")
    >>> display.ax_.get_ylabel()
    'mean squared one-step error, px²'
    """

    nk: Sequence[Any]
    loss: np.ndarray
    best_index: int
    dt: float
    kind: str = "loss"
    criterion: str = "one_step"
    std: np.ndarray | None = None
    n_folds: int = 1
    window_time: np.ndarray | None = None
    nk_path: np.ndarray | None = None
    unit: str | None = None

    @classmethod
    def from_estimator(
        cls,
        search: DelaySearchCV,
        *,
        kind: str = "loss",
        unit: str | None = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw a fitted search.

        Parameters
        ----------
        search : DelaySearchCV
            Fitted.
        kind : {"loss", "path"}, default="loss"
            The loss of every candidate, or the delay over time, which needs a search with
            ``window=``.
        unit : str or None, default=None
            Unit of the output, for the axis of the one-step loss.
        %(keywords)

        %(display)
        """
        check_search(search, DelaySearchCV, cls.__name__)
        results = search.cv_results_
        n_folds = sum(name.startswith("split") for name in results)
        return cls(
            nk=results["nk"],
            loss=search.loss_,
            best_index=search.best_index_,
            dt=search.dt_,
            kind=kind,
            criterion=as_fitted(search).criterion,
            std=results["std_test_score"] if n_folds > 1 else None,
            n_folds=n_folds,
            window_time=getattr(search, "window_time_", None),
            nk_path=getattr(search, "nk_path_", None),
            unit=unit,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        check_option("kind", self.kind, ("loss", "path"))
        if self.kind == "path" and self.nk_path is None:
            raise ValueError(
                "kind='path' draws the delay over time, which the search has not estimated: fit "
                "DelaySearchCV(..., window=<seconds>)."
            )
        self._take_axes(ax, "the loss over the delay, or the delay over time", figsize=(6.4, 4.2))
        self.samples_ax_: Any = None
        self.band_: Any = None
        table = np.array([np.atleast_1d(nk) for nk in self.nk], dtype=float)
        if self.kind == "path":
            self._draw_path()
        elif (table != table[:, :1]).any():  # inputs have delays of their own
            self._draw_loss(np.arange(len(self.nk)))
            self.line_.set_linestyle("none")  # neighbours are not near each other
            self._name_candidates()
        else:
            self._draw_loss(table[:, 0] * self.dt)
            self.ax_.set_xlabel("delay, s")
            self.samples_ax_ = self.ax_.secondary_xaxis("top", functions=self._to_samples())
            self.samples_ax_.set_xlabel("delay, samples")
            self.samples_ax_.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
        self.ax_.set_title(self._best_text(), fontsize="medium")
        self.ax_.grid(alpha=0.3)
        self._restyle(kwargs, self.line_)
        self._legend_of_panels()
        return self

    def _draw_loss(self, at: np.ndarray) -> None:
        order = np.argsort(at, kind="stable")
        at, loss = at[order], np.asarray(self.loss, dtype=float)[order]
        (self.line_,) = self.ax_.plot(at, loss, color=BLUE, marker=".", ms=sized(6), lw=scaled(1.2))
        if self.std is not None:
            std = np.where(loss < WORTHLESS, np.asarray(self.std, dtype=float)[order], np.nan)
            label = f"± 1 standard deviation over {self.n_folds} folds"
            edges = loss - std, loss + std
            self.band_ = draw_band(self.ax_, at, *edges, BLUE, label, alpha=veil(0.2))
        place = int(np.flatnonzero(order == self.best_index)[0])
        (self.best_,) = self.ax_.plot(
            at[place], loss[place], color=VERMILION, label="best", **star()
        )
        if self.criterion == "vaf":
            self.ax_.set_ylabel("100 − cross-validated VAF, %")
            self._scale_vaf_loss(loss[~np.isnan(loss)])
        else:
            squared = f"{self.unit}²" if self.unit else None
            self.ax_.set_ylabel(with_unit("mean squared one-step error", squared))

    def _scale_vaf_loss(self, loss: np.ndarray) -> None:
        lowest, highest = loss.min(), loss.max()
        if 0 < 10 * lowest < highest:
            self.ax_.set_yscale("log")
            self.ax_.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            self.ax_.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            self.ax_.yaxis.set_minor_locator(NullLocator())
            self.ax_.set_ylim(bottom=lowest / 1.5)
        if lowest < WORTHLESS < highest:
            self.ax_.set_ylim(top=1.05 * WORTHLESS)

    def _name_candidates(self) -> None:
        names = [str(nk) for nk in self.nk]
        every = -(-len(names) // MAX_NAMED)
        self.ax_.set_xticks(range(0, len(names), every), names[::every], rotation=90)
        self.ax_.set_xlabel("delay of each input, samples")

    def _draw_path(self) -> None:
        time, delay = np.asarray(self.window_time), np.asarray(self.nk_path) * self.dt
        best = float(np.max(self.nk[self.best_index])) * self.dt
        look: dict[str, Any] = {"color": VERMILION, "ls": "--", "lw": scaled(1.2)}
        self.best_ = self.ax_.axhline(best, label="all data", **look)
        look = {"color": BLUE, "marker": ".", "ms": sized(8), "lw": scaled(1.2)}
        (self.line_,) = self.ax_.plot(time, delay, label="sliding window", **look)
        self.ax_.set_xlabel("time, s")
        self.ax_.set_ylabel("delay, s")
        self.samples_ax_ = self.ax_.secondary_yaxis("right", functions=self._to_samples())
        self.samples_ax_.set_ylabel("delay, samples")
        self.samples_ax_.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
        self.ax_.margins(y=0.15)

    def _to_samples(self) -> tuple[Any, Any]:
        return (lambda seconds: seconds / self.dt), (lambda samples: samples * self.dt)

    def _best_text(self) -> str:
        nk = self.nk[self.best_index]
        if not isinstance(nk, tuple):
            return f"Best delay: {nk * self.dt:.3g} s, {nk} sample{'s' * (nk != 1)}"
        seconds = ", ".join(f"{k * self.dt:.3g}" for k in nk)
        return f"Best delays: ({seconds}) s, {nk} samples"


@dataclass(kw_only=True, eq=False, repr=False)
class VAFContourDisplay(Display):
    """Contours of the cross-validated VAF over ``na`` and ``nb``, one panel per delay.

    Areas are empty where the VAF is not positive or a candidate could not be fitted; a candidate
    whose neighbours are all such ones is a coloured square. An asterisk marks the highest VAF of
    each panel, a ring the chosen model. With a single ``na`` or ``nb`` the panels show lines
    instead.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    na : list of int
        Orders on the horizontal axis.
    nb : list of int or tuple
        Orders on the vertical axis; tuples, one number per input, stand side by side.
    nk : list of int or tuple
        Delays of the panels in samples.
    vaf : ndarray of shape (n_nk, n_nb, n_na)
        Mean cross-validated VAF in percent, unclipped; NaN where there is none.
    delay : ndarray of shape (n_nk,)
        Delays of the panels in seconds.
    factor : int, default=1
        Decimation factor of the models.
    chosen : (int, int, int) or None, default=None
        Positions of the chosen model in ``nk``, ``nb`` and ``na``, if it is shown.
    n_nk_searched : int or None, default=None
        Number of delays searched, if more than are shown.
    levels : array-like or None, default=None
        Contour levels in percent, increasing, the same in all panels. None takes about ten round
        ones that reach from the lower quartile of the positive values to the highest, over at
        least 5 %; what lies below the first one has the darkest colour.

    Attributes
    ----------
    %(panels)
    contours_ : list of QuadContourSet
        The filled contours, one per panel; empty where lines are drawn. Main artists, as the lines.
    lines_ : list of Line2D
        The lines, one per panel; empty where contours are drawn.
    single_ : list of PathCollection
        Squares for single models, which have too few neighbours for a contour; one per panel.
    highest_ : list of Line2D or None
        The asterisks, one per panel; None in a panel without a positive VAF.
    without_ : list of Line2D
        Crosses at orders whose free run diverges or has no positive VAF, one per panel with any.
    chosen_ : Line2D or None
        The ring around the chosen model.
    colorbar_ : Colorbar or None
        The scale of the contours.

    References
    ----------
    Van Grootheest, thesis, Figs. 5.12 and C.1-C.12.

    Examples
    --------
    >>> from skhoid import ARXRegressor, OrderSearchCV, load_human_tracking
    >>> from skhoid.plotting import VAFContourDisplay
    >>> X, y = load_human_tracking(1)
    >>> search = OrderSearchCV(ARXRegressor(), na=[1, 2, 3], nb=[1, 2, 3], nk=[6, 7]).fit(X, y)
    >>> display = VAFContourDisplay.from_estimator(search)
    >>> [ax.get_title() for ax in display.axes_]
    ['$n_k$ = 6 (0.1 s)', '$n_k$ = 7 (0.117 s)']
    """

    na: Sequence[int]
    nb: Sequence[Any]
    nk: Sequence[Any]
    vaf: np.ndarray
    delay: np.ndarray
    factor: int = 1
    chosen: tuple[int, int, int] | None = None
    n_nk_searched: int | None = None
    levels: Any = None

    @classmethod
    def from_estimator(
        cls,
        search: OrderSearchCV,
        *,
        factor: int | None = None,
        nk: Any = None,
        levels: Any = None,
        ax: Any = None,
        **kwargs: Any,
    ) -> Self:
        """Draw a fitted search.

        Parameters
        ----------
        search : OrderSearchCV
            Fitted.
        factor : int or None, default=None
            Decimation factor to show; None means the chosen one.
        nk : sequence of int or tuple, or None, default=None
            Delays to show, in samples. None means all, but no more than the twelve with the
            highest VAF; the figure says so.
        levels : array-like or None, default=None
            Contour levels in percent.
        %(keywords)

        %(display)
        """
        check_search(search, OrderSearchCV, cls.__name__)
        results = search.cv_results_
        if "mean_test_score" not in results:
            raise ValueError(
                "The search went by an information criterion and simulated nothing, so there is "
                "no VAF to draw: fit one with criterion='vaf'."
            )
        factors = sorted(set(results["param_factor"]))
        wanted = search.best_factor_ if factor is None else factor
        if wanted not in factors:
            raise ValueError(f"factor={factor!r} was not searched; the factors are {factors}.")
        rows = [i for i, d in enumerate(results["param_factor"]) if d == wanted]
        values = {
            name: sorted({results[f"param_{name}"][i] for i in rows}, key=_order)
            for name in ("na", "nb", "nk")
        }
        vaf = np.full([len(values[name]) for name in ("nk", "nb", "na")], np.nan)
        delay = np.full(len(values["nk"]), np.nan)
        chosen = None
        for i in rows:
            k, b, a = (values[n].index(results[f"param_{n}"][i]) for n in ("nk", "nb", "na"))
            vaf[k, b, a] = results["mean_test_score"][i]
            delay[k] = results["delay"][i]
            if i == search.best_index_:
                chosen = (k, b, a)
        shown = _shown_delays(values["nk"], vaf, nk)
        if chosen is not None:
            k, b, a = chosen
            chosen = (shown.index(k), b, a) if k in shown else None
        return cls(
            na=values["na"],
            nb=values["nb"],
            nk=[values["nk"][i] for i in shown],
            vaf=vaf[shown],
            delay=delay[shown],
            factor=wanted,
            chosen=chosen,
            n_nk_searched=len(values["nk"]) if nk is None else None,
            levels=levels,
        ).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        """Draw.

        Parameters
        ----------
        %(keywords)

        %(self)
        """
        n_panels = len(self.nk)
        columns = n_panels if n_panels <= 3 else min(math.ceil(math.sqrt(n_panels)), 4)
        rows = -(-n_panels // columns)
        self._take_axes(
            ax,
            "one per delay n_k",
            (rows, columns),
            used=range(n_panels),
            figsize=(max(4.8, 0.8 + 2.8 * columns), 1.2 + 2.5 * rows),
            sharex=True,
            sharey=True,
        )
        if self._own and self.factor != 1:
            self.figure_.suptitle(f"Decimation factor {self.factor}", fontsize="medium")
        self.contours_: list[Any] = []
        self.single_: list[Any] = []
        self.lines_: list[Any] = []
        self.highest_: list[Any] = []
        self.without_: list[Any] = []
        self.chosen_: Any = None
        self.colorbar_: Any = None
        positive = np.where(self.vaf > 0, self.vaf, np.nan)
        if min(len(self.na), len(self.nb)) > 1:
            levels = _levels(positive) if self.levels is None else self.levels
            labels = self._draw_contours(positive, levels)
        else:
            labels = self._draw_lines(positive)
        for i, panel in enumerate(self.axes_):
            panel.set_title(f"$n_k$ = {self.nk[i]} ({self.delay[i]:.3g} s)", fontsize="medium")
            if not self._own or i + columns >= n_panels:
                panel.set_xlabel(labels[0])
                panel.tick_params(labelbottom=True)
            if not self._own or i % columns == 0:
                panel.set_ylabel(labels[1])
        self._restyle(kwargs, self.contours_, self.lines_)
        self._explain()
        return self

    def _draw_contours(self, vaf: np.ndarray, levels: Any) -> tuple[str, str]:
        """Contours; returns what the axes are called."""
        x, y = _positions(self.na), _positions(self.nb)
        extend = _beyond(vaf, levels)
        some = not np.isnan(vaf).all()
        for i, panel in enumerate(self.axes_):
            field = np.ma.masked_invalid(vaf[i])
            if some:
                self.contours_.append(
                    panel.contourf(x, y, field, levels=levels, cmap="viridis", extend=extend)
                )
                if field.count():
                    look: dict[str, Any] = {"colors": foreground(), "linewidths": scaled(0.4)}
                    panel.contour(x, y, field, levels=levels, **look)
                self.single_.append(_draw_single(panel, x, y, vaf[i], self.contours_[-1]))
            rows, columns = np.nonzero(self.vaf[i] <= 0)
            if rows.size:
                self.without_.append(_mark(panel, x[columns], y[rows], _cross()))
            panel.set_xlim(x[0] - MARGIN, x[-1] + MARGIN)
            panel.set_ylim(y[0] - MARGIN, y[-1] + MARGIN)
            _name_ticks(panel.xaxis, self.na)
            _name_ticks(panel.yaxis, self.nb)
            self.highest_.append(None)
            if field.count():
                row, column = divmod(int(np.nanargmax(vaf[i])), len(self.na))
                self.highest_[-1] = _mark(panel, x[column], y[row], _asterisk())
        if self.chosen is not None:
            number, row, column = self.chosen
            self.chosen_ = _mark(self.axes_[number], x[column], y[row], _ring())
        if some:
            # As many numbers as fit beside a bar of this height.
            height = 72.0 * 0.6 * self.figure_.get_figheight()
            every = max(1, math.ceil(2.0 * len(levels) * mpl.rcParams["font.size"] / height))
            self.colorbar_ = self.figure_.colorbar(
                self.contours_[0], ax=list(self.axes_), label="VAF, %", ticks=levels[::every]
            )
        return "$n_a$", "$n_b$" if _is_plain(self.nb) else "$n_b$ of each input"

    def _draw_lines(self, vaf: np.ndarray) -> tuple[str, str]:
        """Lines over the only orders that vary; returns what the axes are called."""
        over_na = len(self.na) > 1 or len(self.nb) == 1
        orders = self.na if over_na else self.nb
        fixed = f"$n_b$ = {self.nb[0]}" if over_na else f"$n_a$ = {self.na[0]}"
        x = _positions(orders)
        look: dict[str, Any] = {"color": BLUE, "marker": "o", "ms": sized(4), "lw": scaled(1.2)}
        for i, panel in enumerate(self.axes_):
            values = vaf[i].ravel()
            self.lines_ += panel.plot(x, values, **look)
            _name_ticks(panel.xaxis, orders)
            panel.set_xlim(x[0] - MARGIN, x[-1] + MARGIN)
            panel.margins(y=0.15)
            panel.grid(alpha=0.3)
            self.highest_.append(None)
            if not np.isnan(values).all():
                best = int(np.nanargmax(values))
                self.highest_[-1] = _mark(panel, x[best], values[best], _asterisk())
        if self.chosen is not None:
            number, row, column = self.chosen
            at = column if over_na else row
            self.chosen_ = _mark(self.axes_[number], x[at], vaf[number].ravel()[at], _ring())
        return f"{'$n_a$' if over_na else '$n_b$'} ({fixed})", "VAF, %"

    def _explain(self) -> None:
        several = "highest of each panel" if len(self.nk) > 1 else "highest"
        entries = {several: next((m for m in self.highest_ if m is not None), None)}
        entries["chosen model"] = self.chosen_
        entries["diverges, or VAF below 0"] = self.without_[0] if self.without_ else None
        handles = {name: mark for name, mark in entries.items() if mark is not None}
        note, shown = "", len(self.nk)
        if self.n_nk_searched is not None and self.n_nk_searched > shown:
            note = f"the best {shown} of {self.n_nk_searched} delays"
        if self._own:
            if note:
                handles[note] = Line2D([], [], ls="none")
            self._legend(list(handles.values()), list(handles))
        elif handles:
            place: dict[str, Any] = {"loc": "lower right", "fontsize": "small", "framealpha": 0.9}
            self.ax_.legend(
                handles.values(), handles.keys(), markerscale=0.6, title=note or None, **place
            )


def _draw_single(panel: Any, x: np.ndarray, y: np.ndarray, vaf: np.ndarray, like: Any) -> Any:
    """Squares for models without the neighbours that a contour needs."""
    rows, columns = np.nonzero(~np.isnan(vaf) & ~_in_contours(~np.isnan(vaf)))
    return panel.scatter(
        x[columns],
        y[rows],
        c=vaf[rows, columns],
        cmap=like.get_cmap(),
        norm=like.norm,
        marker="s",
        s=50,
        edgecolors=foreground(),
        linewidths=scaled(0.4),
        zorder=3,
    )


def _order(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _shown_delays(searched: list[Any], vaf: np.ndarray, nk: Any) -> list[int]:
    if nk is not None:
        wanted = [tuple(v) if np.ndim(v) else int(v) for v in nk]
        unknown = [v for v in wanted if v not in searched]
        if unknown or not wanted:
            what = f"nk={unknown[0]!r} was not searched" if unknown else "nk is empty"
            raise ValueError(f"{what}; the delays are {searched}.")
        return [searched.index(v) for v in wanted]
    highest = np.where(np.isnan(vaf), -np.inf, vaf).max(axis=(1, 2))
    return sorted(np.argsort(-highest, kind="stable")[:MAX_PANELS].tolist())


def _levels(vaf: np.ndarray) -> np.ndarray:
    known = vaf[~np.isnan(vaf)]
    if known.size == 0:
        return np.linspace(0, 100, N_LEVELS + 1)
    high = float(known.max())
    low = max(min(float(np.quantile(known, 0.25)), high - LEAST_RANGE), 0.0)
    return np.asarray(MaxNLocator(N_LEVELS).tick_values(low, high))


def _in_contours(known: np.ndarray) -> np.ndarray:
    """Points of a cell of the mesh with at least three known corners."""
    corners = [known[:-1, :-1], known[:-1, 1:], known[1:, :-1], known[1:, 1:]]
    drawn = np.sum(corners, axis=0) >= 3
    covered = np.zeros(known.shape, dtype=bool)
    for part in (np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, :-1], np.s_[1:, 1:]):
        covered[part] |= drawn
    return covered & known


def _beyond(vaf: np.ndarray, levels: Any) -> str:
    known = vaf[~np.isnan(vaf)]
    below, above = np.any(known < np.min(levels)), np.any(known > np.max(levels))
    return ("both" if above else "min") if below else ("max" if above else "neither")


def _is_plain(orders: Sequence[Any]) -> bool:
    return not any(isinstance(order, tuple) for order in orders)


def _positions(orders: Sequence[Any]) -> np.ndarray:
    return np.array(orders) if _is_plain(orders) else np.arange(len(orders))


def _name_ticks(axis: Any, orders: Sequence[Any]) -> None:
    if _is_plain(orders):
        few = len(orders) <= MAX_TICKS
        axis.set_major_locator(FixedLocator(orders) if few else MaxNLocator(8, integer=True))
    else:
        axis.set_ticks(range(len(orders)), [str(order) for order in orders])


def _mark(panel: Any, x: Any, y: Any, style: dict[str, Any]) -> Line2D:
    """A mark that may reach over the edge of the panel."""
    (mark,) = panel.plot(x, y, ls="none", clip_on=False, **style)
    return mark


def _asterisk() -> dict[str, Any]:
    return {
        "marker": "*",
        "ms": sized(13),
        "color": background(),
        "markeredgecolor": foreground(),
        "zorder": 4,
    }


def _cross() -> dict[str, Any]:
    return {"marker": "x", "ms": sized(6), "color": foreground(), "zorder": 4}


def _ring() -> dict[str, Any]:
    return {
        "marker": "o",
        "ms": sized(17),
        "color": "none",
        "markeredgecolor": VERMILION,
        "markeredgewidth": scaled(2.2),
        "zorder": 5,
    }
