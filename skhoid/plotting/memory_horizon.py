"""How the quality of a recursive model depends on its memory horizon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter

from ._axes import MARKERS, note_outside, seconds_axis
from ._checks import check_option, fitted_end
from ._display import Display
from ._horizons import horizon_axis, near_best
from ._roles import GREY, background, outlined, scaled, series_colour, sized, veil

LABELS = {
    "gain": "gain in VAF over $\\lambda$ = 1, points",
    "score": "cross-validated VAF, %",
    "overfit_difference": "VAF of training − validation, points",
    "overfit_ratio": "VAF of training / validation",
}
MARGIN = 0.08  # of the range, above and below


@dataclass(kw_only=True, eq=False, repr=False)
class MemoryHorizonDisplay(Display):
    """Tracking ability against noise sensitivity: VAF over memory horizon (Figs. 13, J.1-J.4).

    A point for each setting of a :class:`skhoid.RecursiveARXCV`, over the memory horizon N0 in
    samples on a logarithmic axis, with the infinite one (no forgetting) at its end, and one
    standard deviation over splits to either side. An asterisk marks the setting with the best
    score. Settings with one horizon per parameter stand at the shortest and are joined with those
    of the same ratios.

    Limits leave out values that are far worse than the median of their line, as those of a few
    samples' memory are; a note counts them.

    Make it with :meth:`from_estimator`.

    Parameters
    ----------
    results : DataFrame
        One row per setting: ``label``, ``memory_horizon`` (the shortest of the parameters),
        ``ratios`` (those of the others to it, as text; "" where there is only one), ``best``,
        and ``gain``, ``score``, ``overfit_difference``, ``overfit_ratio`` with their standard
        deviations over splits (``sd_gain``).
    n_splits : int, default=1
        Number of splits; with one there are no deviations.
    n_runs : str or None, default=None
        Number of runs that each model pools, as text.
    dt : float or None, default=None
        Sampling time of the fitted grid in s, for an axis in seconds.

    Attributes
    ----------
    ax_ : Axes
        The panel.
    seconds_ax_ : SecondaryAxis or None
        Its upper axis, in seconds; None where the sampling time is not one for all.
    figure_ : Figure
        The figure that holds it.
    lines_ : dict of Line2D
        Values by name of the line.
    bands_ : dict of FillBetweenPolyCollection
        Standard deviations over splits, by name of the line.
    best_ : dict of Line2D
        Marks of the best settings by label.
    infinite_ : float
        Where an infinite horizon stands on the axis.
    note_ : Text or None
        Count of values outside the panel.

    References
    ----------
    Van Grootheest, thesis, Eqs. 31-32, Fig. 13 and Appendix J.

    Examples
    --------
    >>> from skhoid import RecursiveARXCV, make_tracking_runs
    >>> from skhoid.plotting import MemoryHorizonDisplay
    >>> X, y = make_tracking_runs("C4", n_runs=3, remnant_intensity=0.15, random_state=0)
    >>> search = RecursiveARXCV([64, 128, 256, 512, float("inf")], nk=29).fit(X, y)
    >>> display = MemoryHorizonDisplay.from_estimator(search)
    >>> display.ax_.get_ylabel()
    'gain in VAF over $\\\\lambda$ = 1, points'
    """

    results: pd.DataFrame
    n_splits: int = 1
    n_runs: str | None = None
    dt: float | None = None

    @classmethod
    def from_estimator(
        cls, search: Any, *, kind: str = "gain", ax: Any = None, **styles: Any
    ) -> Self:
        """Draw fitted searches.

        Parameters
        ----------
        search : RecursiveARXCV, pipeline that ends in one, or dict of them by label
            Fitted.
        kind : {"gain", "score", "overfit_difference", "overfit_ratio"}, default="gain"
            Gain of the cross-validated VAF over that without forgetting (Eqs. 31-32); that VAF
            itself (Fig. J.2); VAF of training less validation (Eqs. J.1-J.2), or their ratio
            (Eqs. J.3-J.4).
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : MemoryHorizonDisplay

        Raises
        ------
        sklearn.exceptions.NotFittedError
            If a search is not fitted.
        TypeError
            If it is something else.
        ValueError
            If ``kind`` is not known, or asks for a gain and no search has a value of it.
        """
        given = search if isinstance(search, Mapping) else {"": search}
        searches = {str(label): _fitted_search(s) for label, s in given.items()}
        steps = {float(s.dt_) for s in searches.values()}
        pooled = np.concatenate([np.atleast_1d(s.n_runs_pooled_) for s in searches.values()])
        few, many = int(pooled.min()), int(pooled.max())
        display = cls(
            results=pd.concat([_table(label, s) for label, s in searches.items()]),
            n_splits=min(_n_splits(s.cv_results_) for s in searches.values()),
            n_runs=str(few) if few == many else f"{few} to {many}",
            dt=steps.pop() if len(steps) == 1 else None,
        )
        return display.plot(ax, kind=kind, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        kind: str = "gain",
        line_kw: dict[str, Any] | None = None,
        band_kw: dict[str, Any] | None = None,
        best_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.
        kind : {"gain", "score", "overfit_difference", "overfit_ratio"}, default="gain"
            What to draw, see :meth:`from_estimator`.
        line_kw : dict or None, default=None
            Keywords of matplotlib for the curves.
        band_kw : dict or None, default=None
            Keywords of matplotlib for the bands.
        best_kw : dict or None, default=None
            Keywords of matplotlib for the marks of the best horizons.

        Returns
        -------
        self : MemoryHorizonDisplay
        """
        styles = {"line": line_kw, "band": band_kw, "best": best_kw}
        check_option("kind", kind, LABELS)
        if self.results[kind].isna().all():
            raise ValueError(
                f"There is no value of {kind!r} to draw. A gain is one over no forgetting: put "
                "float('inf') among the memory horizons. A ratio needs positive VAF of validation."
            )
        (self.ax_,) = self._take_axes(ax, "values over memory horizons", figsize=(6.4, 4.2))
        self.lines_: dict[str, Any] = {}
        self.bands_: dict[str, Any] = {}
        self.best_: dict[str, Any] = {}
        self._set_axis()
        for position, (name, rows) in enumerate(_joined(self.results)):
            self._draw_line(name, rows, kind, position)
        self.ax_.set_ylabel(LABELS[kind])
        self._limit(kind)
        self.ax_.grid(alpha=0.3)
        self._restyle(styles, line=self.lines_, band=self.bands_, best=self.best_)
        self._explain()
        return self

    def _set_axis(self) -> None:
        """A logarithmic axis of samples with infinity at its end, and one of seconds."""
        panel, horizons = self.ax_, np.unique(self.results["memory_horizon"])
        finite = horizons[np.isfinite(horizons)]
        self.infinite_ = horizon_axis(panel, horizons)
        self.seconds_ax_: Any = None
        if self.dt is not None and finite.size:
            self.seconds_ax_ = seconds_axis(panel, self.dt, "memory horizon $T_0$, s")
            first, last = finite[0] * self.dt, finite[-1] * self.dt
            powers = LogLocator(subs=(1.0, 2.0, 5.0)).tick_values(first, last)
            inside = powers[(powers >= first) & (powers <= last)]
            self.seconds_ax_.xaxis.set_major_locator(FixedLocator(inside))
            self.seconds_ax_.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            self.seconds_ax_.xaxis.set_minor_locator(NullLocator())

    def _draw_line(self, name: str, rows: pd.DataFrame, kind: str, position: int) -> None:
        colour = series_colour(position)
        at = rows["memory_horizon"].replace(np.inf, self.infinite_).to_numpy()
        value, deviation = rows[kind].to_numpy(), rows[f"sd_{kind}"].to_numpy()
        (self.lines_[name],) = self.ax_.plot(
            at,
            value,
            color=colour,
            marker=MARKERS[position % len(MARKERS)],
            ms=sized(4),
            lw=scaled(1.2),
            label=name or f"mean over {self.n_splits} splits",
        )
        if self.n_splits > 1 and np.isfinite(deviation).any():
            self.bands_[name] = self.ax_.fill_between(
                at, value - deviation, value + deviation, color=colour, alpha=veil(0.15), lw=0
            )
        for label, x, y in zip(
            rows["label"][rows["best"]], at[rows["best"]], value[rows["best"]], strict=True
        ):
            (self.best_[label],) = self.ax_.plot(
                x, y, color=colour, marker="*", ms=sized(15), ls="none", zorder=4, **outlined()
            )

    def _limit(self, kind: str) -> None:
        """Limits that hold the better values of each line."""
        sign = -1.0 if kind.startswith("overfit") else 1.0
        held, shown = [], np.empty(0)
        if kind == "gain":
            held.append(0.0)
            self.ax_.axhline(0.0, color=GREY, lw=scaled(0.8), zorder=1)
        for _, rows in _joined(self.results):
            value = sign * rows[kind].to_numpy()
            deviation = np.nan_to_num(rows[f"sd_{kind}"].to_numpy()) * (self.n_splits > 1)
            known = np.isfinite(value)
            value, deviation = value[known], deviation[known]
            if value.size == 0:
                continue
            shown = np.concatenate([shown, sign * value])
            held += (sign * near_best(value)).tolist()
            better = value >= np.median(value)
            for edge in (value + deviation, value - deviation):
                held += (sign * edge[better]).tolist()
        low, high = min(held), max(held)
        margin = MARGIN * (high - low)
        low, high = low - margin, high + margin
        self.note_: Any = None
        if low < high:
            self.ax_.set_ylim(low, high)
            corner = ("top" if sign < 0 else "bottom", "left")
            self.note_ = note_outside(self.ax_, shown, corner)

    def _explain(self) -> None:
        handles, labels = self.ax_.get_legend_handles_labels()
        if self.bands_:
            over = f"± 1 standard deviation over {self.n_splits} splits"
            handles.append(Rectangle((0, 0), 1, 1, color=GREY, alpha=0.4, lw=0))
            labels.append(over)
        handles.append(
            Line2D([], [], color=background(), marker="*", ms=sized(13), ls="none", **outlined())
        )
        labels.append(self._best_text())
        self._legend(handles, labels)

    def _best_text(self) -> str:
        chosen = self.results[self.results["best"]]
        text = "best"
        if len(chosen) == 1:
            horizon = float(chosen["memory_horizon"].iloc[0])
            text += f": $N_0$ = {'∞' if np.isinf(horizon) else f'{horizon:g}'}"
        if self.n_runs:
            text += f" ({self.n_runs} run{'s' * (self.n_runs != '1')} per model)"
        return text


def _fitted_search(estimator: Any) -> Any:
    """The fitted search at the end of a pipeline."""
    search = fitted_end(estimator)
    results = getattr(search, "cv_results_", {})
    if "memory_horizon" not in results or "gain" not in results:
        raise TypeError(
            "MemoryHorizonDisplay.from_estimator draws a fitted RecursiveARXCV, or a pipeline that "
            f"ends in one; got {type(search).__name__}."
        )
    return search


def _n_splits(results: Mapping[str, Any]) -> int:
    return sum(name.startswith("split") and name.endswith("_test_score") for name in results)


def _table(label: str, search: Any) -> pd.DataFrame:
    """Settings of a search, sorted by horizon, with deviations over splits."""
    results = search.cv_results_
    horizons = [np.atleast_1d(np.asarray(h, dtype=float)) for h in results["memory_horizon"]]
    splits = range(_n_splits(results))
    test = np.array([results[f"split{i}_test_score"] for i in splits], dtype=float)
    train = np.array([results[f"split{i}_train_score"] for i in splits], dtype=float)
    without = [i for i, h in enumerate(horizons) if np.isinf(h).all()]
    base = test[:, without[-1:]] if without else np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        # The ratio to a VAF of 0 or less says nothing.
        split_ratios = np.where(test > 0, train / test, np.nan)
    table = pd.DataFrame(
        {
            "label": label,
            "memory_horizon": [h.min() for h in horizons],
            "ratios": [_ratios(h) for h in horizons],
            "best": np.arange(len(horizons)) == search.best_index_,
            "gain": np.asarray(results["gain"], dtype=float),
            "score": np.asarray(results["mean_test_score"], dtype=float),
            "overfit_difference": np.asarray(results["overfit_difference"], dtype=float),
            "overfit_ratio": np.asarray(results["overfit_ratio"], dtype=float),
            "sd_gain": np.std(test - base, axis=0),
            "sd_score": np.std(test, axis=0),
            "sd_overfit_difference": np.std(train - test, axis=0),
            "sd_overfit_ratio": np.std(split_ratios, axis=0),
        }
    )
    return table.sort_values("memory_horizon", kind="stable")


def _ratios(horizons: np.ndarray) -> str:
    """Horizons of parameters in units of the shortest."""
    shortest = horizons.min()
    if np.isinf(shortest) or (horizons == shortest).all():
        return ""
    parts = []
    for horizon in horizons:
        ratio = horizon / shortest
        parts.append("∞" if np.isinf(ratio) else "$N_0$" if ratio == 1 else f"{ratio:g} $N_0$")
    return f"({', '.join(parts)})"


def _joined(results: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Lines and their names: settings of a label with the same ratios, and no forgetting."""
    lines = []
    for label, of_label in results.groupby("label", sort=False):
        infinite = np.isinf(of_label["memory_horizon"])
        kinds = list(dict.fromkeys(of_label["ratios"][~infinite])) or [""]
        for ratios in kinds:
            rows = of_label[infinite | (of_label["ratios"] == ratios)]
            several = len(kinds) > 1
            kind = ratios if several or not label else ""
            name = ", ".join(filter(None, (str(label), kind or "one $N_0$" * several)))
            lines.append((name, rows))
    return lines
