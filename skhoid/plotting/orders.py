"""Delays and orders of an ARX model: the loss of every candidate that a search tried."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, MaxNLocator

from ..arx.searches import DelaySearchCV, OrderSearchCV
from ..preprocessing.base import as_fitted
from ._axes import draw_band, legend_entries, plain_logarithmic, with_unit
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
    search : DelaySearchCV
        Fitted.
    %(delays)

    Attributes
    ----------
    %(panels)
    line_ : Line2D
        The loss, or the delay over time: the main artist.

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

    search: DelaySearchCV
    kind: str = "loss"
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
        %(delays)
        """
        check_search(search, DelaySearchCV, cls.__name__)
        return cls(search=search, kind=kind, unit=unit).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        check_option("kind", self.kind, ("loss", "path"))
        search, dt = self.search, self.search.dt_
        if self.kind == "path" and not hasattr(search, "nk_path_"):
            raise ValueError(
                "kind='path' draws the delay over time, which the search has not estimated: fit "
                "DelaySearchCV(..., window=<seconds>)."
            )
        self._take_axes(ax, "the loss over the delay, or the delay over time", figsize=(6.4, 4.2))
        table = np.array([np.atleast_1d(nk) for nk in search.cv_results_["nk"]], dtype=float)
        in_samples: Any = (lambda seconds: seconds / dt), (lambda samples: samples * dt)
        if self.kind == "path":
            self._draw_path()
            second = self.ax_.secondary_yaxis("right", functions=in_samples)
            second.set_ylabel("delay, samples")
            second.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
        elif (table != table[:, :1]).any():  # inputs have delays of their own
            self._draw_loss(np.arange(len(table)))
            self.line_.set_linestyle("none")  # neighbours are not near each other
            names = [str(nk) for nk in search.cv_results_["nk"]]
            every = -(-len(names) // MAX_NAMED)
            self.ax_.set_xticks(range(0, len(names), every), names[::every], rotation=90)
            self.ax_.set_xlabel("delay of each input, samples")
        else:
            self._draw_loss(table[:, 0] * dt)
            self.ax_.set_xlabel("delay, s")
            second = self.ax_.secondary_xaxis("top", functions=in_samples)
            second.set_xlabel("delay, samples")
            second.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
        self.ax_.set_title(self._best_text(), fontsize="medium")
        self.ax_.grid(alpha=0.3)
        self._restyle(kwargs, self.line_)
        self._legend_of_panels()
        return self

    def _draw_loss(self, at: np.ndarray) -> None:
        results, best = self.search.cv_results_, self.search.best_index_
        order = np.argsort(at, kind="stable")
        loss = np.asarray(self.search.loss_, dtype=float)
        (self.line_,) = self.ax_.plot(
            at[order], loss[order], color=BLUE, marker=".", ms=sized(6), lw=scaled(1.2)
        )
        n_folds = sum(name.startswith("split") for name in results)
        if n_folds > 1:
            std = np.where(loss < WORTHLESS, results["std_test_score"], np.nan)
            label = f"± 1 standard deviation over {n_folds} folds"
            edges = (loss - std)[order], (loss + std)[order]
            draw_band(self.ax_, at[order], *edges, BLUE, label, alpha=veil(0.2))
        self.ax_.plot(at[best], loss[best], color=VERMILION, label="best", **star())
        if as_fitted(self.search).criterion == "vaf":
            self.ax_.set_ylabel("100 − cross-validated VAF, %")
            lowest, highest = np.nanmin(loss), np.nanmax(loss)
            if 0 < 10 * lowest < highest:
                self.ax_.set_yscale("log")
                self.ax_.set_ylim(bottom=lowest / 1.5)
            if lowest < WORTHLESS < highest:
                self.ax_.set_ylim(top=1.05 * WORTHLESS)
            if self.ax_.get_yscale() == "log":
                plain_logarithmic(self.ax_.yaxis, minor_ticks=False)
        else:
            squared = f"{self.unit}²" if self.unit else None
            self.ax_.set_ylabel(with_unit("mean squared one-step error", squared))

    def _draw_path(self) -> None:
        search, dt = self.search, self.search.dt_
        best = float(np.max(search.cv_results_["nk"][search.best_index_])) * dt
        look: dict[str, Any] = {"color": VERMILION, "ls": "--", "lw": scaled(1.2)}
        self.ax_.axhline(best, label="all data", **look)
        look = {"color": BLUE, "marker": ".", "ms": sized(8), "lw": scaled(1.2)}
        delay = np.asarray(search.nk_path_) * dt
        (self.line_,) = self.ax_.plot(search.window_time_, delay, label="sliding window", **look)
        self.ax_.set_xlabel("time, s")
        self.ax_.set_ylabel("delay, s")
        self.ax_.margins(y=0.15)

    def _best_text(self) -> str:
        nk, dt = self.search.cv_results_["nk"][self.search.best_index_], self.search.dt_
        if not isinstance(nk, tuple):
            return f"Best delay: {nk * dt:.3g} s, {nk} sample{'s' * (nk != 1)}"
        seconds = ", ".join(f"{k * dt:.3g}" for k in nk)
        return f"Best delays: ({seconds}) s, {nk} samples"


@dataclass(kw_only=True, eq=False, repr=False)
class VAFContourDisplay(Display):
    """Contours of the cross-validated VAF over ``na`` and ``nb``, one panel per delay.

    Areas are empty where the VAF is not positive or a candidate could not be fitted. An asterisk
    marks the highest VAF of each panel, a ring the chosen model, and a cross a model whose free run
    diverges or has no positive VAF. With a single ``na`` or ``nb`` the panels show lines instead.
    Of more than twelve delays, those with the highest VAF are drawn.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    search : OrderSearchCV
        Fitted, by the VAF.
    factor : int or None, default=None
        Decimation factor to show; None means the chosen one.

    Attributes
    ----------
    %(panels)
    contours_ : list of QuadContourSet
        The filled contours, one per panel; empty where lines are drawn. Main artists, as the lines.
    lines_ : list of Line2D
        The lines, one per panel; empty where contours are drawn.

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

    search: OrderSearchCV
    factor: int | None = None

    @classmethod
    def from_estimator(
        cls, search: OrderSearchCV, *, factor: int | None = None, ax: Any = None, **kwargs: Any
    ) -> Self:
        """Draw a fitted search.

        Parameters
        ----------
        search : OrderSearchCV
            Fitted, by the VAF.
        factor : int or None, default=None
            Decimation factor to show; None means the chosen one.
        """
        check_search(search, OrderSearchCV, cls.__name__)
        if "mean_test_score" not in search.cv_results_:
            raise ValueError(
                "The search went by an information criterion and simulated nothing, so there is "
                "no VAF to draw: fit one with criterion='vaf'."
            )
        if factor is not None:
            check_option("factor", factor, sorted(set(search.cv_results_["param_factor"])))
        return cls(search=search, factor=factor).plot(ax, **kwargs)

    def plot(self, ax: Any = None, **kwargs: Any) -> Self:
        n_searched = self._read()
        n_panels = len(self._nk)
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
        if self._own and self._factor != 1:
            self.figure_.suptitle(f"Decimation factor {self._factor}", fontsize="medium")
        self.contours_: list[Any] = []
        self.lines_: list[Any] = []
        draw = self._draw_contours if min(len(self._na), len(self._nb)) > 1 else self._draw_lines
        labels = draw(np.where(self._vaf > 0, self._vaf, np.nan))
        for i, panel in enumerate(self.axes_):
            seconds = f"{self._delay[i]:.3g} s"
            panel.set_title(f"$n_k$ = {self._nk[i]} ({seconds})", fontsize="medium")
            if not self._own or i + columns >= n_panels:
                panel.set_xlabel(labels[0])
                panel.tick_params(labelbottom=True)
            if not self._own or i % columns == 0:
                panel.set_ylabel(labels[1])
        self._restyle(kwargs, self.contours_, self.lines_)
        entries = legend_entries(self.axes_)
        if n_searched > n_panels:
            entries[f"the best {n_panels} of {n_searched} delays"] = Line2D([], [], ls="none")
        self._legend(list(entries.values()), list(entries))
        return self

    def _read(self) -> int:
        """Take the VAF of all orders and of the best delays from the search; count the delays."""
        results, search = self.search.cv_results_, self.search
        self._factor = search.best_factor_ if self.factor is None else self.factor
        rows = [i for i, d in enumerate(results["param_factor"]) if d == self._factor]
        orders: dict[str, list[Any]] = {
            name: sorted(
                {results[f"param_{name}"][i] for i in rows},
                key=lambda order: np.atleast_1d(order).tolist(),
            )
            for name in ("nk", "nb", "na")
        }
        vaf = np.full([len(values) for values in orders.values()], np.nan)
        delay = np.full(len(orders["nk"]), np.nan)
        self._chosen: tuple[int, int, int] | None = None
        for i in rows:
            k, b, a = (values.index(results[f"param_{n}"][i]) for n, values in orders.items())
            vaf[k, b, a] = results["mean_test_score"][i]
            delay[k] = results["delay"][i]
            if i == search.best_index_:
                self._chosen = (k, b, a)
        highest = np.where(np.isnan(vaf), -np.inf, vaf).max(axis=(1, 2))
        shown = sorted(np.argsort(-highest, kind="stable")[:MAX_PANELS].tolist())
        if self._chosen is not None:
            k, b, a = self._chosen
            self._chosen = (shown.index(k), b, a) if k in shown else None
        self._na, self._nb = orders["na"], orders["nb"]
        self._nk = [orders["nk"][i] for i in shown]
        self._vaf, self._delay = vaf[shown], delay[shown]
        return len(highest)

    def _draw_contours(self, vaf: np.ndarray) -> tuple[str, str]:
        """Contours; returns what the axes are called."""
        x, y = _positions(self._na), _positions(self._nb)
        levels = _levels(vaf)
        for i, panel in enumerate(self.axes_):
            field = np.ma.masked_invalid(vaf[i])
            if field.count():
                self.contours_.append(
                    panel.contourf(x, y, field, levels=levels, cmap="viridis", extend="min")
                )
                look: dict[str, Any] = {"colors": foreground(), "linewidths": scaled(0.4)}
                panel.contour(x, y, field, levels=levels, **look)
                row, column = divmod(int(np.nanargmax(vaf[i])), len(self._na))
                self._mark_highest(panel, x[column], y[row])
            rows, columns = np.nonzero(self._vaf[i] <= 0)
            if rows.size:
                look = {"marker": "x", "ms": sized(6), "color": foreground(), "ls": "none"}
                label = "diverges, or VAF below 0"
                panel.plot(x[columns], y[rows], clip_on=False, zorder=4, label=label, **look)
            panel.set_xlim(x[0] - MARGIN, x[-1] + MARGIN)
            panel.set_ylim(y[0] - MARGIN, y[-1] + MARGIN)
            _name_ticks(panel.xaxis, self._na)
            _name_ticks(panel.yaxis, self._nb)
        if self._chosen is not None:
            number, row, column = self._chosen
            self._ring(self.axes_[number], x[column], y[row])
        if self.contours_:
            bar = self.figure_.colorbar(self.contours_[0], ax=list(self.axes_), label="VAF, %")
            bar.ax.yaxis.set_major_locator(MaxNLocator(6))
        return "$n_a$", "$n_b$" if _is_plain(self._nb) else "$n_b$ of each input"

    def _draw_lines(self, vaf: np.ndarray) -> tuple[str, str]:
        """Lines over the only orders that vary; returns what the axes are called."""
        over_na = len(self._na) > 1 or len(self._nb) == 1
        orders = self._na if over_na else self._nb
        fixed = f"$n_b$ = {self._nb[0]}" if over_na else f"$n_a$ = {self._na[0]}"
        x = _positions(orders)
        look: dict[str, Any] = {"color": BLUE, "marker": "o", "ms": sized(4), "lw": scaled(1.2)}
        for i, panel in enumerate(self.axes_):
            values = vaf[i].ravel()
            self.lines_ += panel.plot(x, values, **look)
            _name_ticks(panel.xaxis, orders)
            panel.set_xlim(x[0] - MARGIN, x[-1] + MARGIN)
            panel.margins(y=0.15)
            panel.grid(alpha=0.3)
            if not np.isnan(values).all():
                best = int(np.nanargmax(values))
                self._mark_highest(panel, x[best], values[best])
        if self._chosen is not None:
            number, row, column = self._chosen
            at = column if over_na else row
            self._ring(self.axes_[number], x[at], vaf[number].ravel()[at])
        return f"{'$n_a$' if over_na else '$n_b$'} ({fixed})", "VAF, %"

    def _mark_highest(self, panel: Axes, x: float, y: float) -> None:
        label = "highest of each panel" if len(self._nk) > 1 else "highest"
        panel.plot(x, y, color=background(), clip_on=False, label=label, **star(13))

    def _ring(self, panel: Axes, x: float, y: float) -> None:
        look: dict[str, Any] = {"marker": "o", "ms": sized(17), "mfc": "none", "mec": VERMILION}
        look |= {"ls": "none", "mew": scaled(2.2), "zorder": 5}
        panel.plot(x, y, clip_on=False, label="chosen model", **look)


def _levels(vaf: np.ndarray) -> np.ndarray:
    """About ten round levels, from the lower quartile to the highest; the rest is darkest."""
    known = vaf[~np.isnan(vaf)]
    if known.size == 0:
        return np.linspace(0, 100, N_LEVELS + 1)
    high = float(known.max())
    low = max(min(float(np.quantile(known, 0.25)), high - LEAST_RANGE), 0.0)
    return np.asarray(MaxNLocator(N_LEVELS).tick_values(low, high))


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
